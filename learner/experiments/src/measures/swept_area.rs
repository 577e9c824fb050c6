//! The swept error area.

use glam::DVec3;

/// Area that a straight line between points of the same number sweeps on its way along two paths in the
/// plane \[m²\]  [swept error area of Khansari-Zadeh & Billard 2014, “Learning control Lyapunov function to ensure
/// stability of dynamical system-based robot reaching motions”]:
///
/// ```text
/// Σ_t A(a_t, a_t+1, b_t+1, b_t)
/// ```
///
/// * `A`  area of the quadrilateral of these corners. Where its outline crosses itself they are taken in an
///   order in which it does not, as by Jekel et al. 2019, “Similarity measures for identifying material
///   parameters from hysteresis loops using inverse analysis”
///
/// # Panics
/// When the paths have not the same number of points.
#[must_use]
pub fn swept_area(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len(), "points of the same number are compared");
    std::iter::zip(a.windows(2), b.windows(2)).map(|(p, q)| area([p[0], p[1], q[1], q[0]])).sum()
}

/// Area of a quadrilateral: corners are exchanged until it is simple.
fn area([a, b, c, d]: [DVec3; 4]) -> f64 {
    let orders = [[a, b, c, d], [b, a, c, d]];
    shoelace(&orders.into_iter().find(is_simple).unwrap_or([a, c, b, d]))
}

/// Whether the outline does not cross itself: it turns to the same side at three corners or more.
fn is_simple(corners: &[DVec3; 4]) -> bool {
    let edge = |i: usize| corners[(i + 1) % 4] - corners[i % 4];
    let turns: [f64; 4] = std::array::from_fn(|i| edge(i).cross(edge(i + 1)).z);
    let count = |side: fn(&&f64) -> bool| turns.iter().filter(side).count();
    let right = count(|turn| **turn < 0.0);
    let left = count(|turn| **turn > 0.0);
    4 - left.min(right) > 2
}

/// Gauss's area formula.
fn shoelace(corners: &[DVec3; 4]) -> f64 {
    let sum: f64 = (0..4).map(|i| corners[i].cross(corners[(i + 1) % 4]).z).sum();
    0.5 * sum.abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(points: &[[f64; 2]]) -> Vec<DVec3> {
        points.iter().map(|[x, y]| DVec3::new(*x, *y, 0.0)).collect()
    }

    #[test]
    fn an_area_is_that_of_its_quadrilaterals() {
        let base = path(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]);
        // Aside; over a triangle and a trapezium; and across, where sides of signed areas would cancel.
        for (other, expected) in [
            (path(&[[0.0, 1.0], [1.0, 1.0], [2.0, 1.0]]), 2.0),
            (path(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]), 2.0),
            (path(&[[0.0, 1.0], [1.0, 1.0], [2.0, 0.0]]), 1.5),
        ] {
            assert!((swept_area(&other, &base) - expected).abs() < 1e-12);
            assert!((swept_area(&base, &other) - expected).abs() < 1e-12);
        }
        assert_eq!(swept_area(&base, &base), 0.0);
    }

    #[test]
    fn opposite_sides_do_not_cancel() {
        let base = path(&[[0.0, 0.0], [1.0, 0.0]]);
        // The outline crosses itself: by signed areas it would be nothing.
        let across = path(&[[0.0, 1.0], [1.0, -1.0]]);
        assert!(swept_area(&across, &base) > 0.5);
    }
}
