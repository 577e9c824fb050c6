//! Intervals that hold what they stand for, whatever was rounded: each end is rounded outwards.

use core::iter::Sum;
use core::ops::{Add, Mul, Neg, Sub};

/// All numbers from `low` to `high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Interval {
    pub(crate) low: f64,
    pub(crate) high: f64,
}

/// By how much of itself a power may be wrong, in each direction: four times what is rounded off.
const POWER_ERROR: f64 = 4.0 * f64::EPSILON;

impl Interval {
    pub(crate) const ZERO: Self = Self::point(0.0);

    pub(crate) const fn point(value: f64) -> Self {
        Self { low: value, high: value }
    }

    /// The numbers between two, in any order.
    pub(crate) fn between(a: f64, b: f64) -> Self {
        Self { low: a.min(b), high: a.max(b) }
    }

    fn outwards(low: f64, high: f64) -> Self {
        Self { low: low.next_down(), high: high.next_up() }
    }

    /// The least interval that holds both.
    pub(crate) fn hull(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// |x| at most.
    pub(crate) fn magnitude(self) -> f64 {
        self.low.abs().max(self.high.abs())
    }

    pub(crate) fn middle(self) -> f64 {
        0.5 * (self.low + self.high)
    }

    pub(crate) fn is_below_zero(self) -> bool {
        self.high < 0.0
    }

    pub(crate) fn is_above_zero(self) -> bool {
        self.low > 0.0
    }

    pub(crate) fn exp(self) -> Self {
        let (low, high) = (self.low.exp(), self.high.exp());
        Self::outwards(low * (1.0 - POWER_ERROR), high * (1.0 + POWER_ERROR))
    }

    /// 1/x of positive numbers.
    pub(crate) fn reciprocal(self) -> Self {
        Self::outwards(1.0 / self.high, 1.0 / self.low)
    }

    pub(crate) fn square(self) -> Self {
        let (a, b) = (self.low * self.low, self.high * self.high);
        let least = if self.low <= 0.0 && self.high >= 0.0 { 0.0 } else { a.min(b).next_down() };
        Self { low: least, high: a.max(b).next_up() }
    }
}

impl Add for Interval {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::outwards(self.low + other.low, self.high + other.high)
    }
}

impl Sub for Interval {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Neg for Interval {
    type Output = Self;
    fn neg(self) -> Self {
        Self { low: -self.high, high: -self.low }
    }
}

impl Mul for Interval {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let products = [
            self.low * other.low,
            self.low * other.high,
            self.high * other.low,
            self.high * other.high,
        ];
        // What is no number holds nothing: it must not be lost in a comparison.
        if products.iter().any(|product| product.is_nan()) {
            return Self { low: f64::NEG_INFINITY, high: f64::INFINITY };
        }
        let [a, b, c, d] = products;
        Self::outwards(a.min(b).min(c.min(d)), a.max(b).max(c.max(d)))
    }
}

impl Mul<f64> for Interval {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        self * Self::point(factor)
    }
}

impl Sum for Interval {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        terms.fold(Self::ZERO, |sum, term| sum + term)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// An interval, and a number in it.
    fn interval() -> impl Strategy<Value = (Interval, f64)> {
        (-20.0..20.0_f64, 0.0..5.0_f64, 0.0..=1.0_f64).prop_map(|(low, width, fraction)| {
            let interval = Interval { low, high: low + width };
            (interval, (low + fraction * width).clamp(interval.low, interval.high))
        })
    }

    proptest! {
        #[test]
        fn what_is_computed_holds_what_it_stands_for((a, x) in interval(), (b, y) in interval()) {
            let holds = |interval: Interval, value: f64| interval.low <= value && value <= interval.high;
            prop_assert!(holds(a + b, x + y) && holds(a - b, x - y) && holds(a * b, x * y));
            prop_assert!(holds(a.square(), x * x) && holds(a.exp(), x.exp()) && holds(-a, -x));
            prop_assert!(a.low <= 0.0 || holds(a.reciprocal(), 1.0 / x));
            prop_assert!(holds(a.hull(b), x) && holds(a.hull(b), y) && x.abs() <= a.magnitude());
        }
    }

    #[test]
    fn ends_are_rounded_outwards() {
        let tenth = Interval::point(0.1);
        let three = tenth + tenth + tenth;
        assert!(three.low < 0.3 && three.high > 0.3);
        let lost = Interval::point(f64::INFINITY) * Interval::ZERO;
        assert!(!lost.is_above_zero() && !lost.is_below_zero());
    }
}
