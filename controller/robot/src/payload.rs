//! What an arm carries beside its links.

use crate::inertia::SpatialInertia;
use crate::placement::Placement;
use crate::selection::PointMass;

/// A body fixed to the tool, which counts beside the links in [`crate::inverse_dynamics_with`] and
/// [`crate::gravity_torques_with`].
#[derive(Debug, Clone, Copy)]
pub struct Payload(
    /// In the frame of the last joint.
    pub(crate) SpatialInertia,
);

impl Payload {
    /// Nothing.
    pub const NONE: Self = Self(SpatialInertia::ZERO);

    /// A body of a tool that is there in the frame of the last joint.
    pub(crate) fn of(tool: &Placement, body: &PointMass) -> Self {
        let centre = tool.transform_point(body.centre);
        Self(SpatialInertia::from_centre(body.mass, centre, glam::DMat3::ZERO))
    }

    /// So much of it: 0 is none, 1 the whole.
    #[inline]
    pub fn scaled(&self, fraction: f64) -> Self {
        Self(SpatialInertia {
            mass: self.0.mass * fraction,
            first_moment: self.0.first_moment * fraction,
            inertia: self.0.inertia * fraction,
        })
    }

    /// The last body of a chain with it.
    #[inline]
    pub(crate) fn with_last(&self, last: SpatialInertia) -> SpatialInertia {
        // A body without mass stays as it is, to the last bit.
        if self.0.mass == 0.0 { last } else { last.plus(&self.0) }
    }
}
