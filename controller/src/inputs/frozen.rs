//! Whether positions stand still to the last digit while the arm is commanded to move: the same reading again and
//! again with a new stamp.

use nalgebra::SVector;
use tprmp_messages::Reason;

use crate::detail::{About, Detail};

/// The arm is commanded to move when a joint is commanded to be faster \[rad/s or m/s\] …
const COMMANDED_MIN: f64 = 0.02;
/// … for so long \[ns\] …
const DURATION_NS: u64 = 40_000_000;
/// … and by so much \[rad or m\]: three steps of an encoder of 12 bits.
const MOVED_MIN: f64 = 0.005;
/// States that have to be alike, at least.
const ALIKE_MIN: u32 = 3;
/// A robot that braked by itself may obey again: it is tried once, after standing still for so long \[ns\].
const RETRY_NS: u64 = 500_000_000;

/// Since when the arm is commanded to move.
#[derive(Debug, Clone, Copy)]
struct Commanded<const N: usize> {
    since_ns: u64,
    from: SVector<f64, N>,
}

/// Watches the positions of N joints.
#[derive(Debug, Default)]
pub struct FrozenPositions<const N: usize> {
    last: Option<(SVector<f64, N>, u64)>,
    alike: u32,
    commanded: Option<Commanded<N>>,
    found: Option<Detail>,
    at_rest_since_ns: Option<u64>,
    retried: bool,
}

impl<const N: usize> FrozenPositions<N> {
    /// Somebody has looked: begins anew.
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    /// What was found: until a position changes, or for one more try until the arm was commanded to rest for half a
    /// second.
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
        match &self.last {
            Some((last, last_ns)) if last == measured => {
                if *last_ns != time_ns {
                    self.alike = self.alike.saturating_add(1);
                }
            }
            _ => self.forget(),
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
        let moves = |(_, velocity): &(&[f64], &[f64])| {
            velocity[..N].iter().any(|v| v.abs() >= COMMANDED_MIN)
        };
        let Some((position, _)) = commanded.filter(moves) else {
            self.commanded = None;
            let since_ns = *self.at_rest_since_ns.get_or_insert(time_ns);
            if !self.retried && time_ns.saturating_sub(since_ns) >= RETRY_NS {
                self.retried = self.found.take().is_some();
            }
            return self.found;
        };
        self.at_rest_since_ns = None;
        if self.found.is_some() {
            return self.found;
        }
        let position = SVector::<f64, N>::from_column_slice(&position[..N]);
        let begun = Commanded { since_ns: time_ns, from: position };
        let Commanded { since_ns, from } = *self.commanded.get_or_insert(begun);
        let elapsed_ns = time_ns.saturating_sub(since_ns);
        let moved = (position - from).abs();
        let index = moved.imax();
        let frozen =
            self.alike >= ALIKE_MIN && elapsed_ns >= DURATION_NS && moved[index] >= MOVED_MIN;
        frozen.then(|| {
            let expected = [position[index], elapsed_ns as f64 * 1e-9];
            Detail::new(Reason::PositionsFrozen, About::Frozen, measured[index], expected).at(index)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    const MS: u64 = 1_000_000;

    /// When it is found that an arm that is commanded to move at 0.5 rad/s does not \[ms\].
    fn found_ms(measured: impl Fn(u64) -> f64, period_ms: u64) -> Option<u64> {
        let mut frozen = FrozenPositions::<2>::default();
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
    fn it_lasts_until_a_position_changes_but_for_one_more_try() {
        let mut frozen = FrozenPositions::<2>::default();
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
