//! Round numbers along an axis.

use crate::text::number;

/// Mean width of a letter of 13 px, on the safe side \[px\].
pub(crate) const LETTER_PX: f64 = 6.2;
/// Room between the numbers of a horizontal axis \[px\].
const NUMBERS_APART_PX: f64 = 14.0;

/// The next larger of 1, 2 and 5 times a power of ten.
pub(crate) fn nice_step(least: f64) -> f64 {
    let power = 10_f64.powf(least.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= least * 0.999);
    factor.unwrap_or(10.0) * power
}

/// The whole decades around two positive numbers: ends of a logarithmic axis.
pub fn decades(low: f64, high: f64) -> [f64; 2] {
    let first = low.max(1e-12).log10().floor();
    [first, high.max(1e-12).log10().ceil().max(first + 1.0)].map(|power| 10_f64.powf(power))
}

/// Round numbers between two ends, at most about `count` of them.
fn linear(low: f64, high: f64, count: f64) -> Vec<f64> {
    let step = nice_step((high - low) / count.clamp(2.0, 9.0));
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

/// Powers of ten between two exponents, at most nine.
pub(crate) fn logarithmic(low: f64, high: f64) -> Vec<f64> {
    let (first, last) = ((low - 1e-9).ceil() as i32, (high + 1e-9).floor() as i32);
    let stride = ((last - first) / 8 + 1).max(1) as usize;
    (first..=last).step_by(stride).map(|power| 10_f64.powi(power)).collect()
}

/// As many ticks as have room for their numbers side by side on an axis of a length \[px\].
pub(crate) fn side_by_side(low: f64, high: f64, length: f64) -> Vec<f64> {
    let fits = |ticks: &Vec<f64>| {
        let widest = ticks.iter().map(|tick| number(*tick).chars().count()).max().unwrap_or(0);
        let apart = ticks.get(1).map_or(length, |next| (next - ticks[0]) / (high - low) * length);
        apart >= LETTER_PX * widest as f64 + NUMBERS_APART_PX
    };
    let mut fewer = (2..=9).rev().map(|count| linear(low, high, f64::from(count)));
    fewer.find(fits).unwrap_or_default()
}

/// Ticks of an axis of a length \[px\] whose numbers stand above each other: two at least, where there
/// is room.
pub(crate) fn above_each_other(low: f64, high: f64, length: f64) -> Vec<f64> {
    let denser = [38.0, 28.0, 18.0].map(|apart| linear(low, high, length / apart));
    let [sparse, ..] = &denser;
    denser.iter().find(|ticks| ticks.len() > 1).unwrap_or(sparse).clone()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(linear(-0.13, 6.2, 7.0), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(logarithmic(-1.2, 2.0), [0.1, 1.0, 10.0, 100.0]);
        assert_eq!(logarithmic(-6.0, 12.0).len(), 7);
    }

    #[test]
    fn decades_hold_their_numbers() {
        assert_eq!(decades(0.07, 2400.0), [0.01, 10_000.0]);
        assert_eq!(decades(5.0, 5.0), [1.0, 10.0]);
        assert_eq!(decades(10.0, 10.0), [10.0, 100.0]);
    }
}
