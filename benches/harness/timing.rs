//! Times of a short computation on a machine that others use too.

use std::time::Instant;

/// Calls in a batch: so many that reading the clock does not matter, and so few that most batches
/// run through without the machine turning to something else.
const BATCH: usize = 16;
/// Batches of a measurement.
const BATCHES: usize = 5_000;

/// Mean times of a call in a batch, over all batches \[µs\].
#[derive(Debug, Clone, Copy)]
pub struct Times {
    /// The best batch: what the computation itself takes.
    pub best_us: f64,
    /// Median.
    pub p50_us: f64,
    /// 99th percentile.
    pub p99_us: f64,
    /// 99.9th percentile.
    pub p999_us: f64,
    /// Worst batch.
    pub max_us: f64,
}

/// Measures what a call of `work` takes.
pub fn measure(mut work: impl FnMut()) -> Times {
    let mut batches = vec![0.0; BATCHES];
    for batch in &mut batches {
        let since = Instant::now();
        for _ in 0..BATCH {
            work();
        }
        *batch = since.elapsed().as_secs_f64() * 1e6 / BATCH as f64;
    }
    let at = |fraction| tprmp_drawing::quantile(&batches, fraction).unwrap_or(f64::NAN);
    Times {
        best_us: at(0.0),
        p50_us: at(0.5),
        p99_us: at(0.99),
        p999_us: at(0.999),
        max_us: at(1.0),
    }
}

/// The straight line through points that lies nearest to them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Value at zero.
    pub start: f64,
    /// Growth a unit.
    pub slope: f64,
    /// Largest distance of a point from the line, as a fraction of the largest value.
    pub deviation: f64,
}

impl Line {
    /// Least squares. There must be two different abscissas.
    pub fn through(points: &[(f64, f64)]) -> Self {
        let count = points.len() as f64;
        let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / count;
        let (x, y) = (mean(|p| p.0), mean(|p| p.1));
        let spread: f64 = points.iter().map(|p| (p.0 - x).powi(2)).sum();
        let slope = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / spread;
        let start = y - slope * x;
        let largest = points.iter().map(|p| p.1).fold(0.0, f64::max);
        let off = points.iter().map(|p| (p.1 - start - slope * p.0).abs()).fold(0.0, f64::max);
        Self { start, slope, deviation: off / largest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_in_order() {
        let mut sum = 0.0_f64;
        let times = measure(|| sum += std::hint::black_box(1.0));
        let Times { best_us, p50_us, p99_us, p999_us, max_us } = times;
        assert!(best_us <= p50_us && p50_us <= p99_us && p99_us <= p999_us && p999_us <= max_us);
        assert_eq!(sum, (BATCH * BATCHES) as f64);
    }

    #[test]
    fn a_line_is_found_and_a_curve_is_not_one() {
        let line = Line::through(&[(1.0, 5.0), (2.0, 7.0), (4.0, 11.0)]);
        assert!((line.start - 3.0).abs() < 1e-12 && (line.slope - 2.0).abs() < 1e-12);
        assert!(line.deviation < 1e-12);
        assert!(Line::through(&[(0.0, 0.0), (1.0, 1.0), (2.0, 4.0)]).deviation > 0.05);
    }
}
