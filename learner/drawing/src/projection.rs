//! How space is seen: along an axis, or from a corner.

use glam::{DMat2, DMat3, DVec2, DVec3};

/// Least side of a box, in fractions of the longest.
const SIDE_FRACTION_MIN: f64 = 0.3;

/// A parallel projection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum View {
    /// Along an axis: these two coordinates, to the right and up.
    Along([usize; 2]),
    /// Isometric, from where x and z are large and y is small.
    Corner,
}

/// The views of a planar skill.
pub const PLANE: &[View] = &[View::Along([0, 1])];
/// The views of a spatial skill: front and side, plan and corner below.
pub const SPACE: &[View] =
    &[View::Along([0, 2]), View::Along([1, 2]), View::Along([0, 1]), View::Corner];

impl View {
    /// Directions to the right and up.
    fn directions(self) -> [DVec3; 2] {
        match self {
            Self::Along(axes) => axes.map(|i| DVec3::AXES[i]),
            Self::Corner => {
                [DVec3::new(1.0, 1.0, 0.0).normalize(), DVec3::new(-1.0, 1.0, 2.0).normalize()]
            }
        }
    }

    /// Where a point is seen.
    pub fn point(self, p: DVec3) -> DVec2 {
        let [right, up] = self.directions();
        DVec2::new(right.dot(p), up.dot(p))
    }

    /// What a covariance looks like: P C Pᵀ, whose ellipses are the outlines of the ellipsoids.
    pub fn covariance(self, c: DMat3) -> DMat2 {
        let [right, up] = self.directions();
        let (cr, cu) = (c * right, c * up);
        DMat2::from_cols(
            DVec2::new(right.dot(cr), up.dot(cr)),
            DVec2::new(right.dot(cu), up.dot(cu)),
        )
    }

    /// The point of a slice that is seen at `seen`; what the view does not show is that of `plane`.
    pub fn on_slice(self, seen: DVec2, plane: DVec3) -> DVec3 {
        let [right, up] = self.directions();
        plane + right * (seen.x - right.dot(plane)) + up * (seen.y - up.dot(plane))
    }

    /// The coordinate that is not seen; `None` in the isometric view.
    pub fn depth(self) -> Option<usize> {
        match self {
            Self::Along([a, b]) => Some(3 - a - b),
            Self::Corner => None,
        }
    }

    /// What is seen of a box.
    pub fn range(self, space: &Bounds) -> [DVec2; 2] {
        let corners = space.corners().map(|corner| self.point(corner));
        [
            corners.into_iter().fold(DVec2::INFINITY, DVec2::min),
            corners.into_iter().fold(DVec2::NEG_INFINITY, DVec2::max),
        ]
    }
}

/// A Gaussian over positions \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipsoid {
    /// Mean \[m\].
    pub mean: DVec3,
    /// Covariance \[m²\].
    pub covariance: DMat3,
    /// Mean phase.
    pub phase: f64,
}

impl Ellipsoid {
    /// The position part of a Gaussian of a model, `mean` of two or three coordinates at least, of
    /// which the first `dimension` are the position's.
    pub fn new(dimension: usize, mean: &[f64], covariance: &[Vec<f64>], phase: f64) -> Self {
        let mut ellipsoid = Self { mean: DVec3::ZERO, covariance: DMat3::ZERO, phase };
        for (i, row) in covariance.iter().enumerate().take(dimension) {
            ellipsoid.mean[i] = mean[i];
            for (j, entry) in row.iter().enumerate().take(dimension) {
                ellipsoid.covariance.col_mut(j)[i] = *entry;
            }
        }
        ellipsoid
    }

    /// Ends of the box around `deviations` of it.
    pub fn ends(&self, deviations: f64) -> [DVec3; 2] {
        let c = self.covariance;
        let half = DVec3::new(c.x_axis.x.sqrt(), c.y_axis.y.sqrt(), c.z_axis.z.sqrt());
        [self.mean - half * deviations, self.mean + half * deviations]
    }
}

/// A box in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Least coordinates \[m\].
    pub low: DVec3,
    /// Largest coordinates \[m\].
    pub high: DVec3,
}

impl Bounds {
    /// Around points of the plane or of space, with a margin that is a fraction of the largest side. No
    /// side is so thin that its axis could not be read; in the plane there is no height.
    pub fn around(planar: bool, points: impl IntoIterator<Item = DVec3>, margin: f64) -> Self {
        let ends = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = points.into_iter().fold(ends, |(low, high), p| (low.min(p), high.max(p)));
        let side = (high - low).max_element();
        let thin = (DVec3::splat(SIDE_FRACTION_MIN * side) - (high - low)) * 0.5;
        let mut room = thin.max(DVec3::splat(margin * side));
        if planar {
            room.z = 0.0;
        }
        Self { low: low - room, high: high + room }
    }

    /// Its eight corners.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |axis: usize| if i >> axis & 1 == 1 { self.high } else { self.low };
            DVec3::new(pick(0).x, pick(1).y, pick(2).z)
        })
    }
}

/// Standard deviations along the principal axes, and the angle of the first axis \[rad\].
pub fn principal_axes(covariance: DMat2) -> (DVec2, f64) {
    let (a, b, c) = (covariance.x_axis.x, covariance.x_axis.y, covariance.y_axis.y);
    let (mean, radius) = (0.5 * (a + c), (0.5 * (a - c)).hypot(b));
    let variances = DVec2::new(mean + radius, (mean - radius).max(0.0));
    (DVec2::new(variances.x.sqrt(), variances.y.sqrt()), 0.5 * (2.0 * b).atan2(a - c))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The projected ellipsoid and the ellipse of the projected covariance reach equally far in
    /// every direction, and no point of the one lies outside the other.
    #[test]
    fn an_ellipse_is_the_outline_of_its_ellipsoid() {
        let root = DMat3::from_cols(
            DVec3::new(0.3, 0.1, -0.05),
            DVec3::new(0.0, 0.2, 0.15),
            DVec3::new(0.02, -0.1, 0.4),
        );
        let covariance = root * root.transpose();
        for view in SPACE {
            let seen = view.covariance(covariance);
            let inverse = seen.inverse();
            let (mut farthest, mut reach): (f64, f64) = (0.0, 0.0);
            let (axes, major) = principal_axes(seen);
            let major = DVec2::from_angle(major);
            for i in 0..200 {
                for k in 0..200 {
                    let (height, angle) = (f64::from(i) / 99.5 - 1.0, f64::from(k) * 0.0314159);
                    let r = (1.0 - height * height).max(0.0).sqrt();
                    // A point of the surface of the ellipsoid at two deviations.
                    let sphere = DVec3::new(r * angle.cos(), r * angle.sin(), height);
                    let p = view.point(root * sphere * 2.0);
                    farthest = farthest.max(p.dot(inverse * p).sqrt());
                    reach = reach.max(p.dot(major));
                }
            }
            assert!(farthest <= 2.0 + 1e-9 && farthest > 1.999, "{view:?}: {farthest}");
            assert!((reach - 2.0 * axes.x).abs() < 1e-3, "{view:?}: {reach}");
        }
    }

    #[test]
    fn principal_axes_are_those_of_the_covariance() {
        let rotation = DMat2::from_angle(0.7);
        let covariance =
            rotation * DMat2::from_diagonal(DVec2::new(9.0, 4.0)) * rotation.transpose();
        let (axes, angle) = principal_axes(covariance);
        assert!((axes - DVec2::new(3.0, 2.0)).length() < 1e-12);
        assert!((angle - 0.7).abs() < 1e-12);
    }

    #[test]
    fn a_box_has_room_on_each_side() {
        let points = [DVec3::ZERO, DVec3::X * 2.0];
        let space = Bounds::around(false, points, 0.1);
        assert!((space.high - space.low - DVec3::new(2.4, 0.6, 0.6)).length() < 1e-12);
        let plane = Bounds::around(true, points, 0.1);
        assert_eq!((plane.low.z, plane.high.z), (0.0, 0.0));
    }

    #[test]
    fn a_slice_is_seen_where_it_is() {
        let plane = DVec3::new(0.1, 0.2, 0.3);
        for view in SPACE {
            let seen = DVec2::new(-0.4, 0.7);
            assert!((view.point(view.on_slice(seen, plane)) - seen).length() < 1e-12);
        }
        let p = View::Along([0, 2]).on_slice(DVec2::new(1.0, 2.0), plane);
        assert_eq!(p, DVec3::new(1.0, 0.2, 2.0));
        assert_eq!(View::Along([0, 2]).depth(), Some(1));
    }
}
