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
/// A robot that braked by itself may obey again: it is tried once, after standing still for so long \[ns\].
const RETRY_NS: u64 = 500_000_000;

/// What is known of a joint.
#[derive(Debug, Clone, Copy, Default)]
struct Watched {
    /// States that said the same, after the first.
    alike: u32,
    /// Since when the joint is commanded to move \[ns\], and from where \[rad or m\].
    commanded: Option<(u64, f64)>,
}

/// Watches the position of each of N joints.
#[derive(Debug)]
pub struct FrozenPositions<const N: usize> {
    /// A joint has so long to move \[ns\].
    duration_ns: u64,
    last: Option<(SVector<f64, N>, u64)>,
    joints: [Watched; N],
    found: Option<Detail>,
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
            at_rest_since_ns: None,
            retried: false,
        }
    }

    /// Somebody has looked: begins anew.
    pub fn forget(&mut self) {
        *self = Self { duration_ns: self.duration_ns, ..Self::new(0.0) };
    }

    /// What was found: until the joint's position changes, or for one more try until the arm was commanded to rest
    /// for half a second.
    #[must_use]
    pub fn found(&self) -> Option<&Detail> {
        self.found.as_ref()
    }

    /// Updates with positions \[rad or m\] that were measured at a time \[ns\], and the positions and velocities that
    /// were commanded last, where the robot obeys.
    ///
    /// # Errors
    /// [`Reason::PositionsFrozen`].
    pub fn update(
        &mut self,
        measured: &SVector<f64, N>,
        time_ns: u64,
        commanded: Option<(&[f64], &[f64])>,
    ) -> Result<(), Reason> {
        if let Some((last, last_ns)) = self.last {
            for (i, joint) in self.joints.iter_mut().enumerate() {
                if last[i] == measured[i] {
                    joint.alike = joint.alike.saturating_add(u32::from(last_ns != time_ns));
                    continue;
                }
                *joint = Watched::default();
                if self.found.is_some_and(|found| found.index as usize == i) {
                    (self.found, self.retried) = (None, false);
                }
            }
        }
        self.last = Some((*measured, time_ns));
        self.found = self.judge(measured, time_ns, commanded);
        self.found.map_or(Ok(()), |found| Err(found.reason))
    }

    fn judge(
        &mut self,
        measured: &SVector<f64, N>,
        time_ns: u64,
        commanded: Option<(&[f64], &[f64])>,
    ) -> Option<Detail> {
        let speed = |i: usize| commanded.map_or(0.0, |(_, velocity)| velocity[i].abs());
        if (0..N).all(|i| speed(i) < COMMANDED_MIN) {
            self.joints.iter_mut().for_each(|joint| joint.commanded = None);
            let since_ns = *self.at_rest_since_ns.get_or_insert(time_ns);
            if !self.retried && time_ns.saturating_sub(since_ns) >= RETRY_NS {
                self.retried = self.found.take().is_some();
            }
            return self.found;
        }
        self.at_rest_since_ns = None;
        if self.found.is_some() {
            return self.found;
        }
        let (position, _) = commanded?;
        for (i, joint) in self.joints.iter_mut().enumerate() {
            if speed(i) < COMMANDED_MIN {
                joint.commanded = None;
                continue;
            }
            let (since_ns, from) = *joint.commanded.get_or_insert((time_ns, position[i]));
            let elapsed_ns = time_ns.saturating_sub(since_ns);
            let moved = (position[i] - from).abs();
            if joint.alike >= ALIKE_MIN && elapsed_ns >= self.duration_ns && moved >= MOVED_MIN {
                let expected = [position[i], elapsed_ns as f64 * 1e-9];
                let reason = Reason::PositionsFrozen;
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

    /// When it is found that an arm that is commanded to move at 0.5 rad/s does not \[ms\].
    fn found_ms(measured: impl Fn(u64) -> f64, period_ms: u64) -> Option<u64> {
        let mut frozen = FrozenPositions::<2>::new(0.0);
        (0..500_u64).find(|&k| {
            let commanded = [[0.0, 0.5e-3 * k as f64], [0.0, 0.5]];
            let at = k / period_ms * period_ms;
            let position = Vector2::new(0.3, measured(at));
            let commanded = Some((&commanded[0][..], &commanded[1][..]));
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
            let result = frozen.update(&measured, k * MS, Some((&commanded, &[1.0, 1.0])));
            result.err().and(frozen.found().map(|found| (k, found.index)))
        };
        assert_eq!((0..100).find_map(&mut update), Some((40, 1)));
    }

    #[test]
    fn a_servo_has_its_lag_to_move_in() {
        let mut frozen = FrozenPositions::<1>::new(0.1);
        let at = nalgebra::Vector1::new(0.2);
        let mut is_found =
            |k: u64| frozen.update(&at, k * MS, Some((&[1e-3 * k as f64], &[1.0]))).is_err();
        assert_eq!((0..400).find(|&k| is_found(k)), Some(140));
    }

    #[test]
    fn it_lasts_until_a_position_changes_but_for_one_more_try() {
        let mut frozen = FrozenPositions::<2>::new(0.0);
        let at = Vector2::new(0.3, 0.2);
        // Commanded to move for 100 ms, and then to rest for 600 ms.
        let attempt = |frozen: &mut FrozenPositions<2>, at: &Vector2<f64>, begun_ms: u64| {
            let mut update = |k: u64, position: [f64; 2], velocity: [f64; 2]| {
                frozen.update(at, (begun_ms + k) * MS, Some((&position, &velocity)))
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
}
