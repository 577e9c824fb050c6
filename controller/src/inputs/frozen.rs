//! Whether the position of a joint stands still to the last digit while the joint is commanded to move: the same
//! reading again and again with a new stamp, or an encoder that died.

use nalgebra::SVector;
use tprmp_messages::Reason;

use crate::detail::{About, Detail};

/// A joint is commanded to move when it is commanded to be faster \[rad/s or m/s\] …
const COMMANDED_MIN: f64 = 0.02;
/// … for so long \[ns\] …
const DURATION_NS: u64 = 40_000_000;
/// … and by so much \[rad or m\]: three steps of an encoder of 12 bits.
const MOVED_MIN: f64 = 0.005;
/// States that have to be alike, at least.
const ALIKE_MIN: u32 = 3;
/// Or torques should have made it faster by so much \[rad/s or m/s\] …
const GAINED_MIN: f64 = 0.05;
/// … within so long or longer \[s\], where it is commanded to be faster than this \[rad/s or m/s\].
const GAINED_S: f64 = 0.02;
const GAINED_COMMANDED_MIN: f64 = 0.001;
/// A robot that braked by itself may obey again: it is tried once, after standing still for so long \[ns\].
const RETRY_NS: u64 = 500_000_000;

/// What the robot was asked for last.
#[derive(Debug, Clone, Copy)]
pub struct Asked<'a, const N: usize> {
    /// Positions \[rad or m\].
    pub position: &'a [f64],
    /// Velocities \[rad/s or m/s\].
    pub velocity: &'a [f64],
    /// Accelerations that torques were to cause and that were not measured \[rad/s² or m/s²\]; zero where the robot
    /// does not obey torques.
    pub missing: SVector<f64, N>,
}

/// What is known of a joint.
#[derive(Debug, Clone, Copy, Default)]
struct Watched {
    /// States that said the same, after the first.
    alike: u32,
    /// For how long it has been commanded to move since the position changed \[s\], and by how much faster it should
    /// have become by torques \[rad/s or m/s\].
    driven: Option<(f64, f64)>,
    /// Since when the joint is commanded to move \[ns\], and from where \[rad or m\].
    commanded: Option<(u64, f64)>,
}

impl Watched {
    fn drive<const N: usize>(&mut self, i: usize, asked: Option<Asked<'_, N>>, elapsed_s: f64) {
        let moves = |asked: &Asked<'_, N>| asked.velocity[i].abs() >= GAINED_COMMANDED_MIN;
        self.driven = asked.filter(moves).map(|asked| {
            let (for_s, gained) = self.driven.unwrap_or_default();
            (for_s + elapsed_s, gained + asked.missing[i] * elapsed_s)
        });
    }
}

/// Watches the position of each of N joints.
#[derive(Debug)]
pub struct FrozenPositions<const N: usize> {
    /// A joint has so long to move \[ns\].
    duration_ns: u64,
    last: Option<(SVector<f64, N>, u64)>,
    joints: [Watched; N],
    found: Option<Detail>,
    /// Whether all joints stood still then, and the robot may have braked by itself.
    all_stood: bool,
    at_rest_since_ns: Option<u64>,
    retried: bool,
}

impl<const N: usize> FrozenPositions<N> {
    /// Of joints that follow with this lag \[s\].
    #[must_use]
    pub fn new(lag_s: f64) -> Self {
        Self {
            duration_ns: DURATION_NS + (lag_s * 1e9) as u64,
            last: None,
            joints: [Watched::default(); N],
            found: None,
            all_stood: false,
            at_rest_since_ns: None,
            retried: false,
        }
    }

    /// Somebody has looked: begins anew.
    pub fn forget(&mut self) {
        *self = Self { duration_ns: self.duration_ns, ..Self::new(0.0) };
    }

    /// What was found: until the joint's position changes, or, where no joint moved, for one more try until the arm
    /// was commanded to rest for half a second.
    #[must_use]
    pub fn found(&self) -> Option<&Detail> {
        self.found.as_ref()
    }

    /// Updates with positions \[rad or m\] that were measured at a time \[ns\], and what was asked for last, where the
    /// robot obeys.
    ///
    /// # Errors
    /// [`Reason::PositionsFrozen`].
    pub fn update(
        &mut self,
        measured: &SVector<f64, N>,
        time_ns: u64,
        asked: Option<Asked<'_, N>>,
    ) -> Result<(), Reason> {
        if let Some((last, last_ns)) = self.last {
            let elapsed_s = time_ns.saturating_sub(last_ns) as f64 * 1e-9;
            for (i, joint) in self.joints.iter_mut().enumerate() {
                if last[i] == measured[i] {
                    joint.alike = joint.alike.saturating_add(u32::from(last_ns != time_ns));
                    joint.drive(i, asked, elapsed_s);
                    continue;
                }
                *joint = Watched::default();
                if self.found.is_some_and(|found| found.index as usize == i) {
                    (self.found, self.retried) = (None, false);
                }
            }
        }
        self.last = Some((*measured, time_ns));
        self.found = self.judge(measured, time_ns, asked);
        self.found.map_or(Ok(()), |found| Err(found.reason))
    }

    fn judge(
        &mut self,
        measured: &SVector<f64, N>,
        time_ns: u64,
        asked: Option<Asked<'_, N>>,
    ) -> Option<Detail> {
        let speed = |i: usize| asked.map_or(0.0, |asked| asked.velocity[i].abs());
        if (0..N).all(|i| speed(i) < GAINED_COMMANDED_MIN) {
            self.joints.iter_mut().for_each(|joint| joint.commanded = None);
            let since_ns = *self.at_rest_since_ns.get_or_insert(time_ns);
            if self.all_stood && !self.retried && time_ns.saturating_sub(since_ns) >= RETRY_NS {
                self.retried = self.found.take().is_some();
            }
            return self.found;
        }
        self.at_rest_since_ns = None;
        if self.found.is_some() {
            return self.found;
        }
        let position = asked?.position;
        for (i, joint) in self.joints.iter_mut().enumerate() {
            let gained = joint
                .driven
                .is_some_and(|(for_s, gained)| for_s >= GAINED_S && gained.abs() >= GAINED_MIN);
            if speed(i) < COMMANDED_MIN {
                joint.commanded = None;
            } else {
                joint.commanded.get_or_insert((time_ns, position[i]));
            }
            let stands = joint.commanded.is_some_and(|(since_ns, from)| {
                let lasts = time_ns.saturating_sub(since_ns) >= self.duration_ns;
                lasts && (position[i] - from).abs() >= MOVED_MIN
            });
            if joint.alike >= ALIKE_MIN && (stands || gained) {
                let commanded_s = |(since_ns, _)| time_ns.saturating_sub(since_ns) as f64 * 1e-9;
                let for_s = joint.commanded.map(commanded_s).or(joint.driven.map(|(s, _)| s));
                let expected = [position[i], for_s.unwrap_or(0.0)];
                let reason = Reason::PositionsFrozen;
                self.all_stood = self.joints.iter().all(|joint| joint.alike >= ALIKE_MIN);
                return Some(Detail::new(reason, About::Frozen, measured[i], expected).at(i));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    const MS: u64 = 1_000_000;

    fn asked<'a, const N: usize>(
        position: &'a [f64; N],
        velocity: &'a [f64; N],
    ) -> Option<Asked<'a, N>> {
        Some(Asked { position, velocity, missing: SVector::zeros() })
    }

    /// When it is found that an arm that is commanded to move at 0.5 rad/s does not \[ms\].
    fn found_ms(measured: impl Fn(u64) -> f64, period_ms: u64) -> Option<u64> {
        let mut frozen = FrozenPositions::<2>::new(0.0);
        (0..500_u64).find(|&k| {
            let commanded = [[0.0, 0.5e-3 * k as f64], [0.0, 0.5]];
            let at = k / period_ms * period_ms;
            let position = Vector2::new(0.3, measured(at));
            let commanded = asked(&commanded[0], &commanded[1]);
            frozen.update(&position, at * MS, commanded).is_err()
        })
    }

    #[test]
    fn positions_that_do_not_change_are_found_within_50_ms_of_motion() {
        assert_eq!(found_ms(|_| 0.2, 1), Some(40));
        assert!(found_ms(|_| 0.2, 8).unwrap() <= 50);
        // An encoder of 12 bits that follows with a dead time of 30 ms.
        let steps = |k: u64| (0.5e-3 * k.saturating_sub(30) as f64 / 1.5e-3).floor() * 1.5e-3;
        assert_eq!(found_ms(steps, 1), None);
    }

    #[test]
    fn one_joint_that_stands_still_beside_one_that_moves_is_found() {
        let mut frozen = FrozenPositions::<2>::new(0.0);
        let mut update = |k: u64| {
            let commanded = [1e-3 * k as f64, 1e-3 * k as f64];
            let measured = Vector2::new(0.9e-3 * k as f64, 0.2);
            let result = frozen.update(&measured, k * MS, asked(&commanded, &[1.0, 1.0]));
            result.err().and(frozen.found().map(|found| (k, found.index)))
        };
        assert_eq!((0..100).find_map(&mut update), Some((40, 1)));
    }

    #[test]
    fn a_servo_has_its_lag_to_move_in() {
        let mut frozen = FrozenPositions::<1>::new(0.1);
        let at = nalgebra::Vector1::new(0.2);
        let mut is_found =
            |k: u64| frozen.update(&at, k * MS, asked(&[1e-3 * k as f64], &[1.0])).is_err();
        assert_eq!((0..400).find(|&k| is_found(k)), Some(140));
    }

    #[test]
    fn it_lasts_until_a_position_changes_but_for_one_more_try() {
        let mut frozen = FrozenPositions::<2>::new(0.0);
        let at = Vector2::new(0.3, 0.2);
        // Commanded to move for 100 ms, and then to rest for 600 ms.
        let attempt = |frozen: &mut FrozenPositions<2>, at: &Vector2<f64>, begun_ms: u64| {
            let mut update = |k: u64, position: [f64; 2], velocity: [f64; 2]| {
                frozen.update(at, (begun_ms + k) * MS, asked(&position, &velocity))
            };
            let moved = (0..100).map(|k| update(k, [0.3, 0.2 + 1e-3 * k as f64], [0.0, 1.0]));
            let moved = moved.last().unwrap();
            let rested = [200, 600, 700].map(|k| update(k, [0.3; 2], [0.0; 2]));
            (moved, rested[0], rested[2])
        };
        let found = Err(Reason::PositionsFrozen);
        assert_eq!(attempt(&mut frozen, &at, 0), (found, found, Ok(())));
        assert_eq!(attempt(&mut frozen, &at, 1000), (found, found, found));
        // Another position: all is forgotten.
        let elsewhere = at * 1.001;
        assert_eq!(attempt(&mut frozen, &elsewhere, 2000), (found, found, Ok(())));
        assert_eq!(attempt(&mut frozen, &elsewhere, 3000), (found, found, found));
        frozen.forget();
        assert_eq!(attempt(&mut frozen, &elsewhere, 4000), (found, found, Ok(())));
    }

    #[test]
    fn a_torque_that_moves_nothing_is_found_however_slow_the_motion() {
        let found_ms = |missing: f64, speed: f64| {
            let mut frozen = FrozenPositions::<2>::new(0.0);
            (0..500_u64).find(|&k| {
                let position = Vector2::new(1e-6 * k as f64, 0.2 + 1e-6 * k.min(100) as f64);
                let missing = Vector2::new(0.0, if k > 100 { missing } else { 0.0 });
                let asked = Asked { position: &[0.0; 2], velocity: &[0.0, speed], missing };
                frozen.update(&position, k * MS, Some(asked)).is_err()
            })
        };
        assert_eq!(found_ms(10.0, 0.005), Some(120));
        assert_eq!(found_ms(1.0, 0.005), Some(150));
        assert_eq!(found_ms(0.1, 0.005), None, "a load that is learned");
        assert_eq!(found_ms(10.0, 0.0), None, "held where it rests");
    }

    #[test]
    fn one_dead_joint_beside_others_that_moved_is_not_tried_again() {
        let mut frozen = FrozenPositions::<2>::new(0.0);
        let mut update = |k: u64, speed: f64| {
            let measured = Vector2::new(0.9e-3 * k.min(100) as f64, 0.2);
            frozen.update(&measured, k * MS, asked(&[1e-3 * k as f64; 2], &[speed; 2]))
        };
        assert!((0..100).any(|k| update(k, 1.0).is_err()));
        assert!((101..2000).all(|k| update(k, 0.0).is_err()));
    }
}
