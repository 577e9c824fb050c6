//! The reference motion: an integrated acceleration whose jerk, size, speed and distance to the position
//! limits are bounded in each tick, whatever is wanted. Pure functions.

use nalgebra::SVector;

use crate::motion::limits::JointLimits;

/// Position, velocity and acceleration of all joints. Each is the integral of the next.
#[derive(Debug, Clone, Copy)]
pub struct JointMotion<const N: usize> {
    /// q \[rad or m\].
    pub position: SVector<f64, N>,
    /// q̇ \[rad/s or m/s\].
    pub velocity: SVector<f64, N>,
    /// q̈ \[rad/s² or m/s²\].
    pub acceleration: SVector<f64, N>,
}

/// A speed below this is rest: processors are slow with subnormal numbers [rad/s or m/s].
const REST: f64 = 1e-12;
/// Joints outside their limits are moved back with this fraction of their largest speed …
const RETURN_FRACTION: f64 = 0.02;
/// … which is come to in about so long \[s\].
const RETURN_S: f64 = 0.1;

impl<const N: usize> JointMotion<N> {
    /// At rest at `position` \[rad or m\].
    #[must_use]
    pub fn at_rest(position: SVector<f64, N>) -> Self {
        Self { position, velocity: SVector::zeros(), acceleration: SVector::zeros() }
    }

    /// Goes on for `dt` \[s\] with the acceleration nearest to `wanted` \[rad/s² or m/s²\] that the limits
    /// allow.
    ///
    /// The order of the limits is that in which they are kept where they contradict each other: jerk,
    /// acceleration, speed, distance to the position limits.
    pub fn advance(&mut self, wanted: &SVector<f64, N>, limits: &JointLimits<N>, dt: f64) {
        for i in 0..N {
            let a = self.permitted(i, wanted[i], limits, dt);
            let v = self.velocity[i] + a * dt;
            let v = if v.abs() < REST { 0.0 } else { v };
            let [lower, upper] = &limits.position_end;
            self.acceleration[i] = a;
            self.velocity[i] = v;
            // From outside it goes no further outside.
            let q = self.position[i];
            self.position[i] = (q + v * dt).clamp(lower[i].min(q), upper[i].max(q));
        }
    }

    /// The acceleration of joint `i`.
    ///
    /// Towards a bound of the speed it leaves what can be taken back at the largest jerk. The bound of the
    /// speed falls with the distance to the position limit, so that half of the acceleration stops the
    /// joint before it; the distance is that after the acceleration has been turned round.
    fn permitted(&self, i: usize, wanted: f64, limits: &JointLimits<N>, dt: f64) -> f64 {
        let (q, v, a) = (self.position[i], self.velocity[i], self.acceleration[i]);
        let (most, jerk) = (limits.acceleration_max[i], limits.jerk_max[i]);
        let speed_towards = |room: f64, v: f64, a: f64| {
            let turned_s = (a + 0.5 * most).max(0.0) / jerk;
            let room = room - (v + 0.5 * a.max(0.0) * turned_s).max(0.0) * turned_s;
            limits.velocity_max[i].min((most * room.max(0.0)).sqrt())
        };
        let upper = speed_towards(limits.position_upper[i] - q, v, a);
        let lower = -speed_towards(q - limits.position_lower[i], -v, -a);
        let within = |room: f64| takes_back(room.abs(), jerk, dt).copysign(room);
        wanted
            .min(within(upper - v))
            .max(within(lower - v))
            .clamp(-most, most)
            .clamp(a - jerk * dt, a + jerk * dt)
    }

    /// As [`JointMotion::braking`], but joints that are outside the robot's description, or hardly inside, go back.
    #[must_use]
    pub fn returning(&self, limits: &JointLimits<N>, fraction: f64, dt: f64) -> SVector<f64, N> {
        let mut wanted = self.braking(limits, fraction, dt);
        let inset = 0.5 * limits.return_max;
        let [lower, upper] = &limits.position_end;
        for i in 0..N {
            let (q, speed) = (self.position[i], RETURN_FRACTION * limits.velocity_max[i]);
            let back = if q > upper[i] - inset {
                -speed
            } else if q < lower[i] + inset {
                speed
            } else {
                continue;
            };
            let most = fraction * limits.acceleration_max[i];
            wanted[i] = ((back - self.velocity[i]) / RETURN_S).clamp(-most, most);
        }
        wanted
    }

    /// The accelerations that bring the motion to rest \[rad/s² or m/s²\]: every joint arrives at zero
    /// together, the hardest-braked one with `fraction` of its largest acceleration.
    #[must_use]
    pub fn braking(&self, limits: &JointLimits<N>, fraction: f64, dt: f64) -> SVector<f64, N> {
        let rate = (0..N)
            .filter(|&i| self.velocity[i] != 0.0)
            .map(|i| {
                let speed = self.velocity[i].abs();
                let most = limits.acceleration_max[i] * fraction;
                most.min(takes_back(speed, limits.jerk_max[i], dt)) / speed
            })
            .fold(1.0 / dt, f64::min);
        self.velocity * -rate
    }

    /// The length of braking as [`JointMotion::braking`] does it, along the path of any point of the arm, for each
    /// m/s of its speed \[s\]: half of the time for it, in which the deceleration also grows and is taken back.
    #[must_use]
    pub fn braking_length_s(&self, limits: &JointLimits<N>, fraction: f64) -> f64 {
        let time_s = |i: usize| {
            let most = limits.acceleration_max[i] * fraction;
            self.velocity[i].abs() / most + most / limits.jerk_max[i]
        };
        0.5 * (0..N).map(time_s).fold(0.0, f64::max)
    }

    /// Whether it is at rest.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.velocity.amax() == 0.0
    }
}

/// The acceleration that, taken back by `jerk` \[rad/s³ or m/s³\] from the next tick of `dt` \[s\] on, has
/// changed the speed by no more than `room` \[rad/s or m/s\]: a dt + a²/2j = room.
fn takes_back(room: f64, jerk: f64, dt: f64) -> f64 {
    let step = jerk * dt;
    // As a quotient: exact where little room is left.
    2.0 * jerk * room / ((step * step + 2.0 * jerk * room).sqrt() + step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;
    use proptest::prelude::*;

    fn limits() -> JointLimits<2> {
        JointLimits {
            position_lower: Vector2::new(-1.0, -2.0),
            position_upper: Vector2::new(1.0, 2.0),
            velocity_max: Vector2::new(1.5, 3.0),
            acceleration_max: Vector2::new(10.0, 20.0),
            jerk_max: Vector2::new(500.0, 4000.0),
            effort_max: Vector2::repeat(100.0),
            effort_rate_max: Vector2::repeat(1e4),
            position_end: [Vector2::new(-1.1, -2.1), Vector2::new(1.1, 2.1)],
            return_max: 0.1,
        }
    }

    fn wanted() -> impl Strategy<Value = [f64; 2]> {
        let one = || (-1.0..1.0_f64, -1.0..4.0_f64).prop_map(|(x, e)| x * 10_f64.powf(e));
        [one(), one()]
    }

    proptest! {
        /// Whatever is wanted, for however long, in ticks of any length.
        #[test]
        fn no_sequence_of_wanted_accelerations_leaves_the_limits(
            sequence in prop::collection::vec((wanted(), 1..60_usize, 1e-5..4e-3_f64), 1..60),
        ) {
            let limits = limits();
            let mut motion = JointMotion::at_rest(Vector2::zeros());
            for (wanted, ticks, dt) in sequence {
                for _ in 0..ticks {
                    let before = motion;
                    motion.advance(&wanted.into(), &limits, dt);
                    for i in 0..2 {
                        let jerk = (motion.acceleration[i] - before.acceleration[i]) / dt;
                        prop_assert!(jerk.abs() <= limits.jerk_max[i] * (1.0 + 1e-6));
                        prop_assert!(motion.acceleration[i].abs() <= limits.acceleration_max[i]);
                        prop_assert!(motion.velocity[i].abs() <= limits.velocity_max[i] + 1e-9);
                        let v = (motion.position[i] - before.position[i]) / dt;
                        prop_assert!((v - motion.velocity[i]).abs() < 1e-6, "each the integral");
                        let beyond = motion.position[i].abs() - limits.position_upper[i];
                        prop_assert!(beyond < 2e-2, "{beyond}");
                    }
                }
            }
        }

        /// From any motion to rest, in bounded time, without swinging back and forth.
        #[test]
        fn braking_ends_at_rest_in_bounded_time(
            wanted in wanted(), ticks in 0..400_usize, fraction in 0.2..1.0_f64, dt in 1e-4..4e-3_f64,
        ) {
            let limits = limits();
            let mut motion = JointMotion::at_rest(Vector2::zeros());
            for _ in 0..ticks {
                motion.advance(&wanted.into(), &limits, dt);
            }
            let mut passed_s = 0.0;
            let mut turns = 0;
            while !motion.rests() {
                let before = motion.velocity;
                let braking = motion.braking(&limits, fraction, dt);
                motion.advance(&braking, &limits, dt);
                turns += (0..2).filter(|&i| before[i] * motion.velocity[i] < 0.0).count();
                passed_s += dt;
                let (a, j) = (&limits.acceleration_max, &limits.jerk_max);
                let longest = |i: usize| (limits.velocity_max[i] + a[i] * a[i] / j[i]) / (a[i] * fraction)
                    + 4.0 * a[i] / j[i];
                prop_assert!(passed_s <= 2.0 * longest(0).max(longest(1)) + 10.0 * dt, "{passed_s} s");
            }
            prop_assert!(turns <= 2, "{turns}");
        }
    }

    #[test]
    fn a_straight_motion_brakes_on_its_line() {
        let limits = limits();
        let mut motion = JointMotion::at_rest(Vector2::zeros());
        motion.velocity = Vector2::new(1.5, -1.0);
        while !motion.rests() {
            let braking = motion.braking(&limits, 0.5, 1e-3);
            motion.advance(&braking, &limits, 1e-3);
            let cross = -motion.velocity[0] - motion.velocity[1] * 1.5;
            // The joint that may change its acceleration faster waits for the other one within a few ticks.
            assert!(cross.abs() < 0.1, "{cross}");
        }
    }

    #[test]
    fn a_joint_beyond_its_range_may_only_come_back() {
        let limits = limits();
        let mut motion = JointMotion::at_rest(Vector2::new(1.05, -2.05));
        for desired in [Vector2::new(10.0, -20.0), Vector2::new(-5.0, 5.0)] {
            let before = motion.position;
            for _ in 0..300 {
                motion.advance(&desired, &limits, 1e-3);
            }
            assert_eq!(motion.position != before, desired[0] < 0.0, "{}", motion.position);
        }
        assert!(motion.position[0] < 1.0 && motion.position[1] > -2.0, "{}", motion.position);
    }
}
