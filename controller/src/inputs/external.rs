//! External commands of the tool's velocity: which messages count, and how much.
//!
//! A command is a desired motion and no state. One that is not finite, too old, from the future or out
//! of order is ignored, so that the leaf fades out once the last good one is too old. Nothing that
//! arrives here stops the arm, and all other leaves and limits act as without it.

use tprmp_messages::ToolCommand;
use tprmp_model::controller_config::External;
use tprmp_rmpflow::leaves::VelocityFollower;
use tprmp_rmpflow::natural::Natural;
use tprmp_spatial::Twist;

/// A desired velocity this near to the command equals it: no ever smaller numbers, with which
/// processors are slow \[m/s or rad/s\].
const NEAR: f64 = 1e-9;

/// The desired velocity of the tool, faded in and out.
#[derive(Debug, Clone, Copy)]
pub struct ExternalCommand {
    leaf: VelocityFollower,
    fade_s: f64,
    age_max_ns: u64,
    /// The newest command that counted.
    newest: Option<Received>,
    /// It, smoothed: the velocity of the leaf.
    desired: Twist,
    /// Fraction of its weight that the leaf has, 0 to 1.
    weight: f64,
}

#[derive(Debug, Clone, Copy)]
struct Received {
    sequence: u64,
    time_ns: u64,
    velocity: Twist,
}

impl ExternalCommand {
    /// Nothing was received yet.
    #[must_use]
    pub fn new(config: &External) -> Self {
        Self {
            leaf: config.leaf(),
            fade_s: config.fade_s,
            age_max_ns: config.age_max_ns,
            newest: None,
            desired: Twist::ZERO,
            weight: 0.0,
        }
    }

    /// Updates with a message at the time `now_ns` \[ns\], if it counts. While a command is
    /// fresh, only one with a higher sequence counts; after that another publisher may begin.
    pub fn update(&mut self, message: &ToolCommand, now_ns: u64) {
        let velocity = Twist {
            linear: message.linear_velocity.into(),
            angular: message.angular_velocity.into(),
        };
        let in_order =
            self.fresh_command(now_ns).is_none_or(|last| message.sequence > last.sequence);
        if message.is_finite() && in_order && self.is_fresh(message.time_ns, now_ns) {
            let velocity = self.leaf.within(&velocity);
            let ToolCommand { sequence, time_ns, .. } = *message;
            self.newest = Some(Received { sequence, time_ns, velocity });
        }
    }

    /// A stamp from the future is as wrong as an old one.
    fn is_fresh(&self, time_ns: u64, now_ns: u64) -> bool {
        now_ns.abs_diff(time_ns) <= self.age_max_ns
    }

    fn fresh_command(&self, now_ns: u64) -> Option<Received> {
        self.newest.filter(|received| self.is_fresh(received.time_ns, now_ns))
    }

    /// Moves on by `dt` \[s\] to the time `now_ns` \[ns\]: the leaf gains weight while a command is fresh
    /// and loses it else, and its velocity goes over into that of the command, so that no acceleration
    /// jumps.
    pub fn advance(&mut self, now_ns: u64, dt: f64) {
        let step = dt / self.fade_s;
        let Some(Received { velocity, .. }) = self.fresh_command(now_ns) else {
            self.weight = (self.weight - step).max(0.0);
            return;
        };
        if self.weight == 0.0 {
            self.desired = velocity;
        }
        self.weight = (self.weight + step).min(1.0);
        let fraction = dt / (dt + self.fade_s);
        for (desired, to) in [
            (&mut self.desired.linear, velocity.linear),
            (&mut self.desired.angular, velocity.angular),
        ] {
            let change = to - *desired;
            *desired = if change.length() < NEAR { to } else { *desired + change * fraction };
        }
    }

    /// Takes the weight away at once, for an arm that starts anew: a fresh command fades in.
    pub fn restart(&mut self) {
        self.weight = 0.0;
    }

    /// Whether the leaf is active.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.weight > 0.0
    }

    /// The leaf on \[linear; angular\] of a tool moving with `velocity`; `None` while it is not active.
    #[must_use]
    pub fn leaf(&self, velocity: &Twist) -> Option<Natural<6>> {
        self.is_active().then(|| self.leaf.evaluate(velocity, &self.desired, self.weight))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn external() -> ExternalCommand {
        ExternalCommand::new(&External {
            linear_inertia_kg: 4.0,
            angular_inertia_kg_m2: 2.0,
            response_1_s: 8.0,
            linear_max_m_s: 0.25,
            angular_max_rad_s: 1.0,
            fade_s: 0.05,
            age_max_ns: 100 * MS,
        })
    }

    fn command(sequence: u64, time_ns: u64, x: f64) -> ToolCommand {
        let linear_velocity = [x, 0.0, 0.0];
        ToolCommand { sequence, time_ns, linear_velocity, ..Default::default() }
    }

    /// Force along x on a tool at rest.
    fn force(external: &ExternalCommand) -> f64 {
        external.leaf(&Twist::ZERO).map_or(0.0, |leaf| leaf.force[0])
    }

    #[test]
    fn a_command_fades_in_holds_and_fades_out_once_it_is_too_old() {
        let mut external = external();
        external.advance(1000 * MS, 0.001);
        assert!(external.leaf(&Twist::ZERO).is_none(), "nobody commands");
        external.update(&command(1, 1000 * MS, 0.2), 1000 * MS);
        let full = 8.0 * 4.0 * 0.2;
        let mut last = 0.0;
        for tick in 1..=300 {
            external.advance((1000 + tick) * MS, 0.001);
            let now = force(&external);
            assert!((now - last).abs() <= full * 0.02 + 1e-9, "it jumps at {tick} ms");
            match tick {
                ..50 => assert!(now > last, "{tick}"),
                50..=100 => assert!((now - full).abs() < 1e-9, "{tick} {now}"),
                101..149 => assert!(now < last && external.is_active(), "{tick}"),
                _ => {}
            }
            last = now;
        }
        assert!(external.leaf(&Twist::ZERO).is_none());
    }

    #[test]
    fn a_changed_command_is_blended_without_a_jump() {
        let mut external = external();
        let mut last = 0.0;
        for tick in 0..1000 {
            let now_ns = (1000 + tick) * MS;
            let x = if tick < 400 { 0.2 } else { -0.2 };
            external.update(&command(tick + 1, now_ns, x), now_ns);
            external.advance(now_ns, 0.001);
            let now = force(&external);
            assert!((now - last).abs() < 0.02 * 8.0 * 4.0 * 0.4 + 1e-9, "{tick}: {last} to {now}");
            last = now;
        }
        assert!((last + 8.0 * 4.0 * 0.2).abs() < 1e-3);
    }

    #[test]
    fn what_does_not_count_changes_nothing() {
        let now_ns = 1000 * MS;
        let nan = |f: fn(&mut ToolCommand, f64), value| {
            let mut command = command(9, now_ns, 0.1);
            f(&mut command, value);
            command
        };
        let faulty = [
            nan(|c, v| c.linear_velocity[2] = v, f64::NAN),
            nan(|c, v| c.angular_velocity[0] = v, f64::NAN),
            nan(|c, v| c.linear_velocity[1] = v, f64::INFINITY),
            command(9, now_ns - 101 * MS, 0.1),
            command(9, now_ns + 101 * MS, 0.1),
            command(9, 0, 0.1),
            command(9, u64::MAX, 0.1),
        ];
        for message in faulty {
            let mut silent = external();
            silent.update(&message, now_ns);
            silent.advance(now_ns, 0.001);
            assert!(silent.leaf(&Twist::ZERO).is_none(), "{message:?}");
            let mut active = external();
            active.update(&command(8, now_ns, 0.2), now_ns);
            let mut undisturbed = active;
            active.update(&message, now_ns);
            for _ in 0..100 {
                active.advance(now_ns, 0.001);
                undisturbed.advance(now_ns, 0.001);
            }
            assert_eq!(active.leaf(&Twist::ZERO), undisturbed.leaf(&Twist::ZERO), "{message:?}");
        }
    }

    #[test]
    fn out_of_order_counts_only_for_somebody_new() {
        let mut external = external();
        external.update(&command(50, 1000 * MS, 0.2), 1000 * MS);
        external.update(&command(50, 1001 * MS, -0.2), 1001 * MS);
        external.update(&command(1, 1001 * MS, -0.2), 1001 * MS);
        external.advance(1001 * MS, 0.001);
        assert!(force(&external) > 0.0);
        // The last one has died: another publisher begins at 1.
        external.update(&command(1, 1200 * MS, -0.2), 1200 * MS);
        for tick in 0..90 {
            external.advance((1200 + tick) * MS, 0.01);
        }
        assert!((force(&external) + 8.0 * 4.0 * 0.2).abs() < 1e-6);
    }

    #[test]
    fn after_a_restart_the_command_fades_in() {
        let mut external = external();
        external.update(&command(1, 1000 * MS, 0.2), 1000 * MS);
        external.advance(1000 * MS, 1.0);
        let full = force(&external);
        external.restart();
        assert!(!external.is_active());
        external.advance(1001 * MS, 0.001);
        assert!(force(&external) < 0.05 * full);
    }
}
