//! Times in buckets, and what follows from counts.

use hdrhistogram::Histogram;
use serde_json::{Map, Value, json};

use crate::results::Verdict;

/// Widest bucket: eight an octave.
const BUCKET_RATIO: f64 = 1.090_507_732_665_257_7;
/// Bars an octave of a picture.
const BARS: f64 = 4.0;
/// A difference that chance makes this often proves nothing.
const CHANCE: f64 = 0.05;

/// Counts of times: upper bound \[µs\] and count, in order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Buckets(Vec<(f64, u64)>);

impl Buckets {
    /// From pairs of upper bound \[µs\] and count, in any order.
    pub fn new(mut pairs: Vec<(f64, u64)>) -> Self {
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut merged: Vec<(f64, u64)> = Vec::new();
        for (upper, count) in pairs {
            match merged.last_mut() {
                Some((last, sum)) if (*last - upper).abs() < 1e-9 * upper => *sum += count,
                _ => merged.push((upper, count)),
            }
        }
        merged.retain(|(_, count)| *count > 0);
        Self(merged)
    }

    /// From the array of `[upper bound, count]` in a summary; `None` when it is not one.
    pub fn from_json(array: &Value) -> Option<Self> {
        let pair = |p: &Value| Some((p.get(0)?.as_f64()?, p.get(1)?.as_u64()?));
        array.as_array()?.iter().map(pair).collect::<Option<Vec<_>>>().map(Self::new)
    }

    /// From a histogram of nanoseconds, eight buckets an octave.
    pub fn from_histogram(histogram: &Histogram<u64>) -> Self {
        let bucket = |ns: u64| ((ns.max(10) as f64 * 1e-3).log2() * 8.0).ceil() / 8.0;
        Self::new(
            histogram
                .iter_recorded()
                .map(|v| (bucket(v.value_iterated_to()).exp2(), v.count_since_last_iteration()))
                .collect(),
        )
    }

    /// Adds those of another run.
    pub fn add(&mut self, other: &Self) {
        let mut all = core::mem::take(&mut self.0);
        all.extend(&other.0);
        *self = Self::new(all);
    }

    /// Upper bounds and counts.
    pub fn pairs(&self) -> &[(f64, u64)] {
        &self.0
    }

    /// For a picture, bars of one width, four an octave: lower and upper bound \[µs\], and count.
    pub fn bars(&self) -> Vec<(f64, f64, u64)> {
        let mut bars: Vec<(i32, u64)> = Vec::new();
        for (upper, count) in &self.0 {
            let bar = (upper.log2() * BARS - 1e-6).ceil() as i32;
            match bars.last_mut() {
                Some((last, sum)) if *last == bar => *sum += count,
                _ => bars.push((bar, *count)),
            }
        }
        let bound = |bar: i32| (f64::from(bar) / BARS).exp2();
        bars.into_iter().map(|(bar, count)| (bound(bar - 1), bound(bar), count)).collect()
    }

    /// Number of times counted.
    pub fn total(&self) -> u64 {
        self.0.iter().map(|(_, count)| count).sum()
    }

    /// Number of times in buckets that end above a limit \[µs\].
    pub fn above(&self, limit_us: f64) -> u64 {
        self.0.iter().filter(|(upper, _)| *upper > limit_us).map(|(_, count)| count).sum()
    }

    /// The time below which a fraction of them lies, interpolated inside its bucket \[µs\].
    pub fn quantile(&self, fraction: f64) -> f64 {
        let wanted = fraction * self.total() as f64;
        let (mut below, mut before) = (0.0, 0.0_f64);
        for (upper, count) in &self.0 {
            let count = *count as f64;
            if below + count >= wanted {
                let lower = before.max(upper / BUCKET_RATIO);
                return lower + (upper - lower) * ((wanted - below) / count).clamp(0.0, 1.0);
            }
            below += count;
            before = *upper;
        }
        f64::NAN
    }

    /// `p50`, `p99` and `p999` with a prefix and the unit, for a row.
    pub fn percentiles(&self, prefix: &str) -> Map<String, Value> {
        [("p50", 0.5), ("p99", 0.99), ("p999", 0.999)]
            .into_iter()
            .map(|(name, fraction)| {
                (format!("{prefix}{name}_us"), rounded(self.quantile(fraction)))
            })
            .collect()
    }

    /// For a row.
    pub fn to_json(&self) -> Value {
        self.0.iter().map(|(upper, count)| json!([rounded(*upper), count])).collect()
    }
}

/// A time to the nanosecond, `null` where there is none.
pub fn rounded(us: f64) -> Value {
    if us.is_finite() { json!((us * 1e3).round() / 1e3) } else { Value::Null }
}

/// Late ones among a number of cycles.
#[derive(Debug, Clone, Copy, Default)]
pub struct Misses {
    /// Late ones.
    pub late: u64,
    /// All of them.
    pub cycles: u64,
}

impl std::iter::Sum for Misses {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        let add = |a: Self, b: Self| Self { late: a.late + b.late, cycles: a.cycles + b.cycles };
        all.fold(Self::default(), add)
    }
}

impl Misses {
    /// Adds those of another run.
    pub fn add(&mut self, other: Self) {
        self.late += other.late;
        self.cycles += other.cycles;
    }

    fn rate(self) -> f64 {
        self.late as f64 / self.cycles as f64
    }
}

/// Whether the misses are at most `factor` times those of a reference that ran beside them.
///
/// More than that is a breach only where chance would hardly make it: conditional on their sum, the
/// counts of two Poisson processes are binomial.
pub fn compare_misses(ours: Misses, reference: Misses, factor: f64) -> Verdict {
    let must = format!("at most {factor} × the late wake-ups of cyclictest");
    let found = format!(
        "{} of {} cycles missed, cyclictest {} of {} later than the period",
        ours.late, ours.cycles, reference.late, reference.cycles
    );
    if ours.cycles == 0 || reference.cycles == 0 {
        return Verdict { must, found, holds: None };
    }
    if ours.rate() <= factor * reference.rate() {
        return Verdict { must, found, holds: Some(true) };
    }
    let weight = factor * ours.cycles as f64;
    let fraction = weight / (weight + reference.cycles as f64);
    let chance = binomial_tail(ours.late + reference.late, fraction, ours.late);
    if chance < CHANCE {
        return Verdict { must, found, holds: Some(false) };
    }
    let found = format!("{found}: more, but chance makes that in {:.0} % of runs", 100.0 * chance);
    Verdict { must, found, holds: None }
}

/// P(X ≥ k) for X binomial with n trials and probability p, 0 < p < 1.
fn binomial_tail(n: u64, p: f64, k: u64) -> f64 {
    let ln_ratio = p.ln() - (-p).ln_1p();
    let mut ln_term = n as f64 * (-p).ln_1p();
    let mut sum = 0.0;
    for i in 0..=n {
        if i >= k {
            sum += ln_term.exp();
        }
        ln_term += ((n - i) as f64 / (i + 1) as f64).ln() + ln_ratio;
    }
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_in_their_buckets_and_between_them() {
        let mut histogram = Histogram::<u64>::new(3).unwrap();
        for us in 1..=1000_u64 {
            histogram.record(us * 1000).unwrap();
        }
        let buckets = Buckets::from_histogram(&histogram);
        assert_eq!(buckets.total(), 1000);
        for (fraction, us) in [(0.01, 10.0), (0.5, 500.0), (0.99, 990.0), (0.999, 999.0)] {
            let found = buckets.quantile(fraction);
            assert!((found / us - 1.0).abs() < 0.05, "{fraction}: {found}");
        }
        assert!(Buckets::default().quantile(0.5).is_nan());
    }

    #[test]
    fn buckets_of_any_width_become_bars_of_one() {
        let buckets = Buckets::new(vec![(1.0, 1), (1.1, 2), (1.18, 3), (2.0, 4), (64.0, 5)]);
        let bars = buckets.bars();
        let quarters = |upper: &f64| (4.0 * upper.log2()).round();
        let counts: Vec<_> =
            bars.iter().map(|(_, upper, count)| (quarters(upper), *count)).collect();
        assert_eq!(counts, [(0.0, 1), (1.0, 5), (4.0, 4), (24.0, 5)]);
        assert!(bars.iter().all(|(low, high, _)| (high / low - 0.25_f64.exp2()).abs() < 1e-12));
    }

    #[test]
    fn buckets_of_two_runs_are_counted_together() {
        let mut sum = Buckets::new(vec![(2.0, 3), (1.0, 1)]);
        sum.add(&Buckets::new(vec![(2.0, 4), (8.0, 1), (4.0, 0)]));
        assert_eq!(sum.pairs(), [(1.0, 1), (2.0, 7), (8.0, 1)]);
        assert_eq!((sum.above(2.0), sum.above(1.0), sum.above(8.0)), (1, 8, 0));
        assert_eq!(Buckets::from_json(&sum.to_json()), Some(sum));
        assert_eq!(Buckets::from_json(&json!([[1.0]])), None);
    }

    #[test]
    fn the_tail_of_a_binomial_is_that_of_its_tables() {
        assert!((binomial_tail(10, 0.5, 8) - 56.0 / 1024.0).abs() < 1e-12);
        assert!((binomial_tail(10, 0.5, 0) - 1.0).abs() < 1e-12);
        assert!((binomial_tail(3, 0.25, 3) - 1.0 / 64.0).abs() < 1e-12);
        // Twenty standard deviations above the mean, and at the mean.
        assert!(binomial_tail(10_000, 0.5, 6_000) < 1e-80);
        assert!((binomial_tail(10_000, 0.5, 5_000) - 0.504).abs() < 1e-3);
    }

    #[test]
    fn misses_are_judged_by_their_rate_and_by_chance() {
        let misses = |late, cycles| Misses { late, cycles };
        let holds = |ours, reference| compare_misses(ours, reference, 1.2).holds;
        assert_eq!(holds(misses(0, 1000), misses(0, 1000)), Some(true));
        assert_eq!(holds(misses(12, 1000), misses(10, 1000)), Some(true));
        assert_eq!(holds(misses(24, 2000), misses(10, 1000)), Some(true));
        // One more than none is no proof; nine more than none is one.
        assert_eq!(holds(misses(1, 1000), misses(0, 1000)), None);
        assert_eq!(holds(misses(9, 1000), misses(0, 1000)), Some(false));
        assert_eq!(holds(misses(200, 1000), misses(100, 1000)), Some(false));
        assert_eq!(holds(misses(0, 0), misses(0, 1000)), None);
    }
}
