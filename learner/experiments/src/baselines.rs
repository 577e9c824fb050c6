//! Policies to compare with, from the thesis' related work, implemented plainly.

mod dmp;
mod lqr;
mod pd;

pub use dmp::{Dmp, DmpFollower};
pub use lqr::{Lqr, LqrFollower};
pub use pd::Pd;

use glam::DVec3;

/// A path's point, velocity and acceleration by central differences; at rest after its end.
pub(crate) fn sampled(points: &[DVec3], step_s: f64, time_s: f64) -> [DVec3; 3] {
    let last = points.len() - 1;
    let at = (time_s / step_s).max(0.0);
    if at >= last as f64 {
        return [points[last], DVec3::ZERO, DVec3::ZERO];
    }
    let i = at as usize;
    let difference = |k: usize| {
        let (a, b, c) = (points[k.saturating_sub(1)], points[k], points[(k + 1).min(last)]);
        let between = if k == 0 || k == last { 1.0 } else { 2.0 };
        let bend =
            if k == 0 || k == last { DVec3::ZERO } else { (a - 2.0 * b + c) / step_s.powi(2) };
        [b, (c - a) / (between * step_s), bend]
    };
    let ([p, v, a], [q, w, b]) = (difference(i), difference(i + 1));
    let fraction = at - i as f64;
    [p.lerp(q, fraction), v.lerp(w, fraction), a.lerp(b, fraction)]
}
