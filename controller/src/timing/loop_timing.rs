//! When the loop ticks: it waits for its schedule or for a state, and knows how late it is.

use core::sync::atomic::{AtomicBool, Ordering};

use tprmp_model::controller_config::Loop;

use crate::timing::overruns::Overruns;
use crate::timing::pacing::{Arrivals, POLL_NS, Pacing, Schedule, Wake};
use crate::timing::realtime::{monotonic_ns, sleep_until, spin_until};

/// In lockstep, a stop waits this long for the publisher's next state \[ns\].
const LAST_STATE_NS: u64 = 200_000_000;
/// In lockstep, a publisher that is silent for so long has left \[ns\].
const LOCKSTEP_PATIENCE_NS: u64 = 30_000_000_000;
/// Most time one tick integrates over, whatever was missed \[s\].
const STEP_MAX_S: f64 = 0.02;

/// The schedule of the loop.
#[derive(Debug)]
pub struct LoopTiming {
    pacing: Pacing,
    config: Loop,
    schedule: Schedule,
    arrivals: Arrivals,
    /// Missed periods.
    pub overruns: Overruns,
    /// When the last tick began, `None` before the first \[ns\].
    last_ns: Option<u64>,
}

impl LoopTiming {
    /// A loop that has not begun.
    #[must_use]
    pub fn new(config: Loop, pacing: Pacing) -> Self {
        Self {
            pacing,
            schedule: Schedule::new(config.period_ns, 0),
            arrivals: Arrivals::new(config.period_ns, config.spin_ns, 0),
            overruns: Overruns::new(config.overruns_in_a_row_max),
            last_ns: None,
            config,
        }
    }

    /// What paces the loop.
    #[must_use]
    pub fn pacing(&self) -> Pacing {
        self.pacing
    }

    /// The loop begins at the time `now_ns` \[ns\].
    pub fn begin(&mut self, now_ns: u64) {
        self.schedule = Schedule::new(self.config.period_ns, now_ns);
        self.arrivals = Arrivals::new(self.config.period_ns, self.config.spin_ns, now_ns);
    }

    /// Sleeps until the next period. Where it spins at the end of it, first calls `in_slack`.
    pub fn wait_for_schedule(&mut self, in_slack: impl FnOnce()) -> Wake {
        let due_ns = self.schedule.due_ns();
        sleep_until(due_ns.saturating_sub(self.config.spin_ns));
        if self.config.spin_ns > 0 {
            in_slack();
            spin_until(due_ns);
        }
        self.schedule.woke(monotonic_ns())
    }

    /// Waits until `receive` finds a new state, with pauses where it need not spin. On the machine's
    /// clock it also wakes when the state gets too old, or after a period where the arm brakes without
    /// a state. In lockstep a stop ends the wait, or a publisher that has left: `None`.
    pub fn wait_for_state(
        &mut self,
        stop: &AtomicBool,
        brakes_blindly: bool,
        mut receive: impl FnMut() -> bool,
    ) -> Option<Wake> {
        let since_ns = monotonic_ns();
        let lockstep = self.pacing == Pacing::Lockstep;
        let age_max_ns =
            if brakes_blindly { self.config.period_ns } else { self.config.state_age_max_ns };
        // The first state was received while connecting: it counts as new.
        let first = self.last_ns.is_none();
        loop {
            let received = receive();
            let woke_ns = monotonic_ns();
            if received || first {
                return Some(self.arrivals.arrived(woke_ns));
            }
            let waited_ns = woke_ns - since_ns;
            if !lockstep && waited_ns > age_max_ns {
                return Some(self.arrivals.missed(woke_ns));
            }
            let stopping = stop.load(Ordering::Relaxed);
            let patience_ns = if stopping { LAST_STATE_NS } else { LOCKSTEP_PATIENCE_NS };
            if lockstep && waited_ns > patience_ns {
                return None;
            }
            if self.arrivals.spins(woke_ns) {
                core::hint::spin_loop();
            } else {
                sleep_until(woke_ns + POLL_NS);
            }
        }
    }

    /// A tick begins: gives the time since the last one, a period for the first, within bounds \[s\].
    pub fn step_s(&mut self, now_ns: u64) -> f64 {
        match self.last_ns.replace(now_ns) {
            Some(last_ns) => (now_ns.saturating_sub(last_ns) as f64 * 1e-9).clamp(1e-6, STEP_MAX_S),
            None => self.config.period_ns as f64 * 1e-9,
        }
    }
}
