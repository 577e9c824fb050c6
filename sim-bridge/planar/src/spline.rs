//! A smooth curve through points of the plane: a cubic spline with free ends.

use glam::DVec2;

/// A cubic spline: continuous up to the second derivative, which is zero at both ends.
///
/// The parameter between two points is the root of their distance (centripetal), which keeps the
/// curve from overshooting where a short piece follows a long one [Lee 1989].
#[derive(Debug, Clone)]
pub(crate) struct Spline {
    /// Parameters of the points, from 0 to 1.
    knots: Vec<f64>,
    points: Vec<DVec2>,
    /// Second derivatives at the points.
    second_derivatives: Vec<DVec2>,
}

impl Spline {
    /// The spline through two or more points, of which neighbours lie apart.
    pub(crate) fn through(points: &[DVec2]) -> Self {
        let mut knots = vec![0.0];
        for pair in points.windows(2) {
            knots.push(knots[knots.len() - 1] + (pair[1] - pair[0]).length().sqrt());
        }
        let whole = knots[knots.len() - 1];
        knots.iter_mut().for_each(|knot| *knot /= whole);
        let second_derivatives = second_derivatives(&knots, points);
        Self { knots, points: points.to_vec(), second_derivatives }
    }

    /// The point at a parameter between 0 and 1.
    pub(crate) fn point(&self, s: f64) -> DVec2 {
        let i = self.knots.partition_point(|knot| *knot <= s).clamp(1, self.knots.len() - 1);
        let step = self.knots[i] - self.knots[i - 1];
        let (a, b) = ((self.knots[i] - s) / step, (s - self.knots[i - 1]) / step);
        let [before, after] = [self.second_derivatives[i - 1], self.second_derivatives[i]];
        let cubic = (a.powi(3) - a) * before + (b.powi(3) - b) * after;
        a * self.points[i - 1] + b * self.points[i] + cubic * (step * step / 6.0)
    }
}

/// A tridiagonal system, solved by elimination.
fn second_derivatives(knots: &[f64], points: &[DVec2]) -> Vec<DVec2> {
    let n = points.len();
    let step = |i: usize| knots[i + 1] - knots[i];
    let slope = |i: usize| (points[i + 1] - points[i]) / step(i);
    // Rows of x[i] + upper x[i + 1] = right.
    let (mut upper, mut right) = (vec![0.0; n], vec![DVec2::ZERO; n]);
    for i in 1..n - 1 {
        let (before, after) = (step(i - 1), step(i));
        let pivot = 2.0 * (before + after) - before * upper[i - 1];
        upper[i] = after / pivot;
        right[i] = (6.0 * (slope(i) - slope(i - 1)) - before * right[i - 1]) / pivot;
    }
    let mut x = vec![DVec2::ZERO; n];
    for i in (1..n - 1).rev() {
        x[i] = right[i] - upper[i] * x[i + 1];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_passes_its_points_without_a_kink() {
        let points = [(0.0, 0.0), (1.0, 0.4), (1.2, -0.5), (0.3, -0.6), (0.0, 0.9)];
        let points = points.map(DVec2::from);
        let spline = Spline::through(&points);
        let h = 1e-5;
        for (knot, point) in spline.knots.iter().zip(points) {
            assert!((spline.point(*knot) - point).length() < 1e-12);
        }
        for knot in &spline.knots[1..4] {
            let at = |i: f64| spline.point(knot + i * h);
            let slopes = [(at(0.0) - at(-1.0)) / h, (at(1.0) - at(0.0)) / h];
            let curved = [at(0.0) - 2.0 * at(-1.0) + at(-2.0), at(2.0) - 2.0 * at(1.0) + at(0.0)];
            assert!((slopes[0] - slopes[1]).length() < 0.01 * slopes[0].length());
            assert!((curved[0] - curved[1]).length() < 0.05 * curved[0].length().max(1e-9));
        }
    }

    #[test]
    fn two_points_are_joined_by_a_straight_line() {
        let spline = Spline::through(&[DVec2::ZERO, DVec2::new(2.0, 1.0)]);
        assert!((spline.point(0.25) - DVec2::new(0.5, 0.25)).length() < 1e-12);
    }
}
