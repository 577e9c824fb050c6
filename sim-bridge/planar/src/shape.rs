//! The strokes that the scripted expert draws, and how they follow their two frames.

use std::f64::consts::PI;

use glam::{DMat2, DVec2};

use crate::scene::RecordSettings;
use crate::spline::Spline;

/// Points of the table from arc length to the curve's parameter.
const TABLE_POINTS: usize = 2001;

/// Position and angle about z of a planar frame, in the base frame `B`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlanarPose {
    /// Origin \[m\].
    pub(crate) position_m: DVec2,
    /// Angle about z \[rad\].
    pub(crate) angle_rad: f64,
}

impl PlanarPose {
    /// A point given in this frame, in `B` \[m\].
    pub(crate) fn transform(&self, point: DVec2) -> DVec2 {
        self.position_m + DMat2::from_angle(self.angle_rad) * point
    }

    /// A point given in `B`, in this frame \[m\].
    pub(crate) fn inverse_transform(&self, point: DVec2) -> DVec2 {
        DMat2::from_angle(-self.angle_rad) * (point - self.position_m)
    }

    /// The frame's orientation as a quaternion w, x, y, z.
    pub(crate) fn quaternion_wxyz(&self) -> [f64; 4] {
        let (sin, cos) = (0.5 * self.angle_rad).sin_cos();
        [cos, 0.0, 0.0, sin]
    }
}

/// A stroke, by its fraction of arc length σ ∈ \[0, 1\].
#[derive(Debug, Clone)]
pub(crate) struct Stroke {
    curve: Curve,
    /// Arc length from the start up to s = i/(n − 1) \[m\].
    arc_m: Vec<f64>,
}

/// A curve by a parameter s ∈ \[0, 1\].
#[derive(Debug, Clone)]
enum Curve {
    /// A lying S from (−length/2, 0) to (length/2, 0):
    /// x(s) = l (s − ½) − b sin 4πs, y(s) = −h sin 2πs.
    LyingS { length_m: f64, height_m: f64, overhang_m: f64 },
    /// A spline through waypoints.
    Spline(Spline),
}

impl Curve {
    fn point(&self, s: f64) -> DVec2 {
        match self {
            Self::LyingS { length_m, height_m, overhang_m } => DVec2::new(
                length_m * (s - 0.5) - overhang_m * (4.0 * PI * s).sin(),
                -height_m * (2.0 * PI * s).sin(),
            ),
            Self::Spline(spline) => spline.point(s),
        }
    }
}

impl Stroke {
    /// The lying S of a scene.
    pub(crate) fn lying_s(settings: &RecordSettings) -> Self {
        let RecordSettings { length_m, height_m, overhang_m, .. } = *settings;
        Self::along(Curve::LyingS { length_m, height_m, overhang_m })
    }

    /// A smooth stroke through waypoints \[m\], of which neighbours lie apart.
    pub(crate) fn through(waypoints: &[DVec2]) -> Self {
        Self::along(Curve::Spline(Spline::through(waypoints)))
    }

    fn along(curve: Curve) -> Self {
        let mut arc_m = Vec::with_capacity(TABLE_POINTS);
        let mut arc = 0.0;
        let mut last = curve.point(0.0);
        for i in 0..TABLE_POINTS {
            let point = curve.point(i as f64 / (TABLE_POINTS - 1) as f64);
            arc += (point - last).length();
            arc_m.push(arc);
            last = point;
        }
        Self { curve, arc_m }
    }

    /// Where it starts \[m\].
    pub(crate) fn start(&self) -> DVec2 {
        self.curve.point(0.0)
    }

    /// Where it ends \[m\].
    pub(crate) fn end(&self) -> DVec2 {
        self.curve.point(1.0)
    }

    /// How long it is \[m\].
    pub(crate) fn length_m(&self) -> f64 {
        self.arc_m[TABLE_POINTS - 1]
    }

    /// The point at the fraction σ of the arc length \[m\].
    pub(crate) fn point(&self, fraction: f64) -> DVec2 {
        let wanted = fraction.clamp(0.0, 1.0) * self.length_m();
        let above = self.arc_m.partition_point(|arc| *arc < wanted).clamp(1, TABLE_POINTS - 1);
        let (low, high) = (self.arc_m[above - 1], self.arc_m[above]);
        let s = (above as f64 - 1.0 + (wanted - low) / (high - low)) / (TABLE_POINTS - 1) as f64;
        self.curve.point(s)
    }

    /// The point at σ of the stroke laid between two frames: at the start it moves with the start
    /// frame, at the end with the end frame, between with a smooth blend of both \[m\].
    pub(crate) fn between(&self, start: &PlanarPose, end: &PlanarPose, fraction: f64) -> DVec2 {
        let point = self.point(fraction);
        let with_start = start.transform(point - self.start());
        let with_end = end.transform(point - self.end());
        with_start.lerp(with_end, minimum_jerk(fraction))
    }
}

/// 10τ³ − 15τ⁴ + 6τ⁵: from 0 to 1 with no velocity and no acceleration at both ends
/// [Flash and Hogan 1985].
pub(crate) fn minimum_jerk(tau: f64) -> f64 {
    let tau = tau.clamp(0.0, 1.0);
    tau.powi(3) * (10.0 - 15.0 * tau + 6.0 * tau * tau)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::tests::scene;

    #[test]
    fn the_stroke_runs_evenly_from_its_start_to_its_end() {
        let stroke = Stroke::lying_s(&scene().record);
        assert!((stroke.point(0.0) - stroke.start()).length() < 1e-12);
        assert!((stroke.point(1.0) - stroke.end()).length() < 1e-12);
        let step = |i: u32| {
            (stroke.point(f64::from(i + 1) / 200.0) - stroke.point(f64::from(i) / 200.0)).length()
        };
        let steps: Vec<f64> = (0..200).map(step).collect();
        let longest = steps.iter().copied().fold(0.0, f64::max);
        let shortest = steps.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(longest < 1.01 * shortest, "{shortest} to {longest}");
    }

    #[test]
    fn the_stroke_follows_its_frames_at_both_ends() {
        let stroke = Stroke::lying_s(&scene().record);
        let start = PlanarPose { position_m: DVec2::new(-1.0, 0.3), angle_rad: 0.2 };
        let end = PlanarPose { position_m: DVec2::new(1.4, -0.1), angle_rad: -0.3 };
        assert!((stroke.between(&start, &end, 0.0) - start.position_m).length() < 1e-12);
        assert!((stroke.between(&start, &end, 1.0) - end.position_m).length() < 1e-12);
        let near_end = end.transform(stroke.point(0.97) - stroke.end());
        assert!((stroke.between(&start, &end, 0.97) - near_end).length() < 1e-3);
    }
}
