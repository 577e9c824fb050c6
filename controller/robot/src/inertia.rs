//! Spatial inertia of a rigid body.

use glam::{DMat3, DVec3};

use crate::placement::Placement;

/// Inertia of a rigid body about the origin of a frame, expressed in that frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SpatialInertia {
    /// Mass m [kg].
    pub(crate) mass: f64,
    /// First moment h = m c, with c the centre of mass [kg m].
    pub(crate) first_moment: DVec3,
    /// Rotational inertia about the frame's origin, not about the centre of mass [kg m²].
    pub(crate) inertia: DMat3,
}

impl SpatialInertia {
    /// No mass.
    pub(crate) const ZERO: Self =
        Self { mass: 0.0, first_moment: DVec3::ZERO, inertia: DMat3::ZERO };

    /// From mass [kg], centre of mass [m] and rotational inertia about the centre of mass [kg m²].
    #[inline]
    pub(crate) fn from_centre(mass: f64, centre: DVec3, inertia_centre: DMat3) -> Self {
        Self {
            mass,
            first_moment: mass * centre,
            inertia: inertia_centre + mass * steiner(centre, centre),
        }
    }

    /// The same body seen from a frame `A`, with `x` = X_AC the placement of the present frame `C`.
    ///
    /// `h_A = R h + m p`,  `I_A = R I Rᵀ + 2 sym S(R h, p) + m S(p, p)`,  `S(a, b) = (a·b) 1 − a bᵀ`
    #[inline]
    pub(crate) fn moved(&self, x: &Placement) -> Self {
        let Placement { rotation, position } = *x;
        let h = rotation * self.first_moment;
        let cross = steiner(h, position);
        Self {
            mass: self.mass,
            first_moment: h + self.mass * position,
            inertia: rotation * self.inertia * rotation.transpose()
                + cross
                + cross.transpose()
                + self.mass * steiner(position, position),
        }
    }

    /// Both bodies as one; both must be expressed in the same frame.
    #[inline]
    pub(crate) fn plus(&self, other: &Self) -> Self {
        Self {
            mass: self.mass + other.mass,
            first_moment: self.first_moment + other.first_moment,
            inertia: self.inertia + other.inertia,
        }
    }
}

/// (a·b) 1 − a bᵀ
#[inline]
fn steiner(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_diagonal(DVec3::splat(a.dot(b))) - DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}
