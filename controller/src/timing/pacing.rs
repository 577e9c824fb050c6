//! When the loop wakes up: the schedule of the periodic trigger, and how long it may spin while it
//! waits for a state. Pure functions of the clock's reading.

use tprmp_model::controller_config::Trigger;

/// Pause between two looks for a new state, where the loop does not spin \[ns\].
pub const POLL_NS: u64 = 20_000;

/// What paces the loop, and which clock it believes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pacing {
    /// `CLOCK_MONOTONIC`, woken as configured.
    RealTime(Trigger),
    /// One tick a state, on the clock of the states: exact whatever the machine's load.
    Lockstep,
}

/// When the loop woke up, and when it should have.
#[derive(Debug, Clone, Copy)]
pub struct Wake {
    /// On the loop's clock: `CLOCK_MONOTONIC`, in lockstep that of the states \[ns\].
    pub now_ns: u64,
    /// On `CLOCK_MONOTONIC` \[ns\].
    pub woke_ns: u64,
    /// By then the command has to be out, on `CLOCK_MONOTONIC` \[ns\].
    pub deadline_ns: u64,
    /// How late: since the schedule, or since the loop last looked for a state \[ns\].
    pub late_ns: u64,
    /// Periods that passed without a tick.
    pub skipped: u64,
}

impl Wake {
    fn new(due_ns: u64, woke_ns: u64, period_ns: u64) -> Self {
        let late_ns = woke_ns.saturating_sub(due_ns);
        let skipped = late_ns / period_ns;
        let deadline_ns = due_ns + (skipped + 1) * period_ns;
        Self { now_ns: woke_ns, woke_ns, deadline_ns, late_ns, skipped }
    }

    /// The same on the clock of the states, on which nothing is late.
    #[must_use]
    pub fn at_state(self, state_ns: u64) -> Self {
        Self { now_ns: state_ns, late_ns: 0, skipped: 0, ..self }
    }
}

/// An absolute schedule. What was missed is skipped and never caught up with in a burst; the
/// schedule itself does not drift.
#[derive(Debug)]
pub struct Schedule {
    period_ns: u64,
    due_ns: u64,
}

impl Schedule {
    /// A schedule whose first tick is due a period after `now_ns`.
    #[must_use]
    pub fn new(period_ns: u64, now_ns: u64) -> Self {
        Self { period_ns, due_ns: now_ns + period_ns }
    }

    /// When the next tick is due \[ns\].
    #[must_use]
    pub fn due_ns(&self) -> u64 {
        self.due_ns
    }

    /// The loop woke up at `woke_ns` for the tick that was due: sets the next one.
    pub fn woke(&mut self, woke_ns: u64) -> Wake {
        let wake = Wake::new(self.due_ns, woke_ns, self.period_ns);
        self.due_ns = wake.deadline_ns;
        wake
    }
}

/// Expects the next state from those that arrived, and says when to spin for it: near the time at
/// which it is expected, and never for more than four fifths of the time. A real-time thread that
/// does not sleep is stopped by the kernel (`sched_rt_runtime_us`).
#[derive(Debug)]
pub struct Arrivals {
    period_ns: u64,
    /// Spins so long before and after the expected time \[ns\].
    spin_ns: u64,
    last_ns: u64,
    interval_ns: u64,
    looked_ns: u64,
    spinning: bool,
    budget_ns: u64,
}

impl Arrivals {
    /// Nothing has arrived yet.
    #[must_use]
    pub fn new(period_ns: u64, spin_ns: u64, now_ns: u64) -> Self {
        Self {
            period_ns,
            spin_ns,
            last_ns: now_ns,
            interval_ns: 0,
            looked_ns: now_ns,
            spinning: false,
            budget_ns: spin_ns,
        }
    }

    /// The loop looked at `now_ns` and a state had arrived: it may have lain there since the last
    /// look.
    pub fn arrived(&mut self, now_ns: u64) -> Wake {
        let measured = now_ns - self.last_ns;
        let (least, most) = (self.interval_ns / 2, self.interval_ns.saturating_mul(2));
        // Smoothed, so that one state that comes late does not spoil the expectation; another rate
        // is taken over at once.
        self.interval_ns = if (least..=most).contains(&measured) {
            self.interval_ns - self.interval_ns / 8 + measured / 8
        } else {
            measured
        };
        self.last_ns = now_ns;
        let wake = Wake::new(self.looked_ns, now_ns, self.period_ns);
        self.account(now_ns);
        wake
    }

    /// The loop looked at `now_ns` in vain and waits no longer.
    pub fn missed(&mut self, now_ns: u64) -> Wake {
        let wake = Wake::new(self.looked_ns, now_ns, self.period_ns);
        self.account(now_ns);
        wake
    }

    /// The loop looked at `now_ns` in vain: whether to look again at once, without a sleep.
    pub fn spins(&mut self, now_ns: u64) -> bool {
        self.account(now_ns);
        let expected_ns = self.last_ns + self.interval_ns;
        self.spinning = self.budget_ns > 0 && now_ns.abs_diff(expected_ns) <= self.spin_ns;
        self.spinning
    }

    /// Four fifths of all time may be spun, up to `spin_ns` in advance.
    fn account(&mut self, now_ns: u64) {
        let elapsed_ns = now_ns - self.looked_ns;
        self.looked_ns = now_ns;
        self.budget_ns = if self.spinning {
            self.budget_ns.saturating_sub(elapsed_ns.div_ceil(5))
        } else {
            self.spin_ns.min(self.budget_ns.saturating_add(elapsed_ns / 5 * 4))
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 1_000_000;

    #[test]
    fn a_late_tick_is_skipped_over_and_the_schedule_does_not_drift() {
        let mut schedule = Schedule::new(PERIOD_NS, 5);
        let start = 5;
        // Lateness of each wake-up, the periods that it skips, and the period it ends in.
        for (late, skipped, period) in
            [(0, 0, 1), (130_000, 0, 2), (999_999, 0, 3), (3_200_000, 3, 7), (40, 0, 8)]
        {
            let due = schedule.due_ns();
            let wake = schedule.woke(due + late);
            assert_eq!((wake.late_ns, wake.skipped), (late, skipped));
            assert_eq!(schedule.due_ns(), start + (period + 1) * PERIOD_NS);
            assert_eq!(wake.deadline_ns, schedule.due_ns());
            assert!(schedule.due_ns() > wake.woke_ns, "no tick is due before it wakes");
        }
    }

    /// A publisher with a jitter; the loop sleeps `POLL_NS` or spins in looks of 200 ns. Gives the
    /// fraction of states that were met while spinning, and of the time spent so.
    fn wait_for(interval_ns: u64, jitter_ns: u64, spin_ns: u64) -> (f64, f64) {
        let mut arrivals = Arrivals::new(PERIOD_NS, spin_ns, 0);
        let (mut now, mut met, mut spun) = (0, 0, 0);
        let states = 2000;
        for k in 1..=states {
            let arrival = k * interval_ns + (k * 7919) % (jitter_ns + 1);
            let mut spinning = false;
            while now < arrival {
                spinning = arrivals.spins(now);
                let step = if spinning { 200 } else { POLL_NS };
                spun += if spinning { step } else { 0 };
                now += step;
            }
            let wake = arrivals.arrived(now);
            assert!(wake.late_ns <= if spinning { 200 } else { POLL_NS });
            met += u64::from(spinning);
            now += 5_000;
        }
        (met as f64 / states as f64, spun as f64 / now as f64)
    }

    #[test]
    fn it_spins_near_the_expected_arrival_and_only_there() {
        let (met, spun) = wait_for(2_000_000, 30_000, 80_000);
        assert!(met > 0.98, "{met}");
        assert!(spun < 0.08, "{spun}");
    }

    #[test]
    fn without_a_spin_it_only_sleeps() {
        assert_eq!(wait_for(2_000_000, 30_000, 0), (0.0, 0.0));
    }

    #[test]
    fn a_fast_publisher_does_not_make_it_spin_all_the_time() {
        let (met, spun) = wait_for(50_000, 0, 100_000);
        assert!(spun < 0.81, "{spun}");
        assert!(met > 0.6, "{met}");
    }

    #[test]
    fn a_silent_publisher_is_not_spun_for() {
        let mut arrivals = Arrivals::new(PERIOD_NS, 50_000, 0);
        arrivals.arrived(1_000_000);
        let spun = (1_000_000..100_000_000_u64).step_by(10_000);
        let spun = spun.filter(|now| arrivals.spins(*now)).count();
        assert!(spun <= 11, "{spun}");
    }

    #[test]
    fn a_wait_that_was_held_up_counts_the_periods_that_passed() {
        let mut arrivals = Arrivals::new(PERIOD_NS, 0, 0);
        assert!(!arrivals.spins(1_000));
        let wake = arrivals.arrived(5_201_000);
        assert_eq!((wake.late_ns, wake.skipped), (5_200_000, 5));
        assert!(wake.deadline_ns > wake.woke_ns);
    }
}
