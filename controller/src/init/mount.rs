//! How the base of an arm is mounted, by the joints above it.

use glam::DVec3;
use tprmp_robot::Document;
use tprmp_spatial::Pose;

/// \[m/s²\]
const GRAVITY: f64 = 9.81;
/// A base whose z axis is nearer to the vertical than this stands upright \[rad\].
const UPRIGHT: f64 = 1e-3;

/// A base in the root of its description, whose z axis points up and whose origin lies on the ground.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mount {
    /// Up, in the base.
    pub up: DVec3,
    /// How high the base is \[m\].
    height_m: f64,
}

impl Mount {
    /// Of a base, `None` for the root; joints above it stand at zero.
    pub(super) fn of(document: &Document, base: Option<&str>) -> Self {
        let (mut pose, mut at) = (Pose::IDENTITY, base.unwrap_or_default());
        // A tree is no deeper than it has joints.
        for _ in &document.joints {
            let Some(joint) = document.joints.iter().find(|joint| joint.child == at) else { break };
            pose = joint.origin.pose().compose(&pose);
            at = &joint.parent;
        }
        Self { up: pose.orientation.inverse() * DVec3::Z, height_m: pose.position.z }
    }

    /// Whether the base is not upright.
    pub(super) fn is_turned(&self) -> bool {
        self.up.angle_between(DVec3::Z) > UPRIGHT
    }

    /// Gravity in the base \[m/s²\].
    pub(super) fn gravity_m_s2(&self) -> [f64; 3] {
        if self.is_turned() { (self.up * -GRAVITY).to_array() } else { [0.0, 0.0, -GRAVITY] }
    }

    /// The height of the ground in the base \[m\]; `None` where that is turned: then there is no plane z = const.
    pub(super) fn ground_m(&self) -> Option<f64> {
        (!self.is_turned()).then_some(-self.height_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tprmp_files::{Existing, write};

    #[test]
    fn a_base_that_hangs_or_stands_high_is_told_from_one_on_the_ground() {
        let path = std::env::temp_dir().join(format!("tprmp-mount-{}.urdf", std::process::id()));
        let of = |origin: &str| {
            let text = format!(
                r#"<robot name="r"><link name="world"/><link name="base"/><joint name="j" type="fixed">{origin}
                   <parent link="world"/><child link="base"/></joint></robot>"#
            );
            write(&path, text, Existing::Replace).unwrap();
            Mount::of(&Document::read(&path).unwrap(), Some("base"))
        };
        let hanging = of(r#"<origin xyz="0 0 2" rpy="3.141592653589793 0 0"/>"#);
        assert!(hanging.is_turned() && hanging.ground_m().is_none());
        assert!((DVec3::from(hanging.gravity_m_s2()) - DVec3::Z * GRAVITY).length() < 1e-9);
        let high = of(r#"<origin xyz="0.3 0 0.8" rpy="0 0 1"/>"#);
        assert_eq!((high.ground_m(), high.gravity_m_s2()), (Some(-0.8), [0.0, 0.0, -9.81]));
        std::fs::remove_file(path).unwrap();
    }
}
