//! A model in the form in which the controller and the learner's rollouts evaluate it.

use tprmp_rmpflow::frame_map::{FrameMap, FrameMapError};
use tprmp_rmpflow::skill::{PositionField, Skill};

use super::{Manifold, SkillModel};

impl SkillModel {
    /// The skill, ready to be evaluated.
    ///
    /// # Errors
    /// When start and goal coincide.
    pub fn skill(&self) -> Result<Skill, FrameMapError> {
        let position = match self.manifold {
            Manifold::R2 => PositionField::Plane(Box::new(self.position.field())),
            Manifold::R3 | Manifold::R3S3 => PositionField::Space(Box::new(self.position.field())),
        };
        Ok(Skill {
            map: FrameMap::new(self.canonical.into())?,
            position,
            orientation: self.orientation.as_ref().map(|field| Box::new(field.field())),
        })
    }
}
