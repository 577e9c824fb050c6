//! From joint positions to the pose of the tool.

use std::path::Path;

use nalgebra::SVector;
use tprmp_messages::JOINT_CAPACITY;
use tprmp_model::controller_config::Robot;
use tprmp_robot::{
    Chain, Interface, JointKind, Kinematics, Selection, count_joints, forward_kinematics,
};
use tprmp_spatial::Pose;

use super::error::RecordError;
use crate::file_error::FileError;

/// Joint positions \[rad or m\]; those beyond the arm's number of joints are not looked at.
pub(crate) type Positions = [f64; JOINT_CAPACITY];

/// An arm of any number of joints.
pub(crate) trait Arm {
    /// Number of joints.
    fn joints(&self) -> usize;

    /// Whether joint `i` rotates; the others slide.
    fn rotates(&self, i: usize) -> bool;

    /// Least and greatest position of joint `i` \[rad or m\].
    fn limits(&self, i: usize) -> [f64; 2];

    /// X_BE, the pose of the tool in the base frame, at joint positions [rad or m].
    fn tool_pose(&mut self, position: &Positions) -> Pose;
}

struct Serial<const N: usize> {
    chain: Chain<N>,
    kinematics: Kinematics<N>,
}

impl<const N: usize> Arm for Serial<N> {
    fn joints(&self) -> usize {
        N
    }

    fn rotates(&self, i: usize) -> bool {
        self.chain.joint_kind(i) == Some(JointKind::Revolute)
    }

    fn limits(&self, i: usize) -> [f64; 2] {
        [self.chain.position_lower()[i], self.chain.position_upper()[i]]
    }

    fn tool_pose(&mut self, position: &Positions) -> Pose {
        let q = SVector::from_fn(|i, _| position[i]);
        forward_kinematics(&self.chain, &q, &mut self.kinematics);
        self.kinematics.tool_pose()
    }
}

/// Reads the arm that a controller's configuration names.
pub(crate) fn read(config: &Path, robot: &Robot) -> Result<Box<dyn Arm>, RecordError> {
    match count_joints(&robot.urdf, kinematic(robot))? {
        2 => serial::<2>(config, robot),
        3 => serial::<3>(config, robot),
        4 => serial::<4>(config, robot),
        5 => serial::<5>(config, robot),
        6 => serial::<6>(config, robot),
        7 => serial::<7>(config, robot),
        8 => serial::<8>(config, robot),
        count => unreachable!("arms have 2 to 8 joints, not {count}"),
    }
}

/// The chain of a robot of which only the poses are asked for: masses, efforts and shapes do not matter.
fn kinematic(robot: &Robot) -> Selection {
    Selection { interface: Interface::Motion, ignores_shapes: true, ..robot.selection() }
}

fn serial<const N: usize>(config: &Path, robot: &Robot) -> Result<Box<dyn Arm>, RecordError> {
    let chain = Chain::<N>::from_urdf(&robot.urdf, kinematic(robot))?;
    if chain.joint_names()[..] != robot.joints[..] {
        let problem = format!(
            "expected the joints that `{}` has between its root and `{}`, {:?}, found {:?}",
            robot.urdf.display(),
            robot.tool_frame(),
            chain.joint_names(),
            robot.joints
        );
        return Err(FileError::key(config, "robot.joints", problem).into());
    }
    Ok(Box::new(Serial { chain, kinematics: Kinematics::new() }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tprmp_model::controller_config;

    fn shipped(name: &str) -> (std::path::PathBuf, Robot) {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/controllers");
        let path = folder.join(name);
        let robot = controller_config::read(&path).unwrap().robot;
        (path, robot)
    }

    #[test]
    fn the_point_is_where_its_joints_are() {
        let (path, robot) = shipped("planar.ron");
        let mut arm = read(&path, &robot).unwrap();
        assert_eq!(arm.joints(), 2);
        assert!(!arm.rotates(0) && !arm.rotates(1));
        let mut position = [9.0; JOINT_CAPACITY];
        position[..2].copy_from_slice(&[0.25, -0.5]);
        let pose = arm.tool_pose(&position);
        assert!((pose.position - glam::DVec3::new(0.25, -0.5, 0.0)).length() < 1e-12);
    }

    #[test]
    fn joints_that_the_description_does_not_have_are_refused_by_name() {
        let (path, mut robot) = shipped("ur5_pick.ron");
        let arm = read(&path, &robot).unwrap();
        assert!(arm.joints() == 6 && (0..6).all(|joint| arm.rotates(joint)));
        robot.joints[1] = "no_such_joint".into();
        let message = read(&path, &robot).err().unwrap().to_string();
        for part in ["ur5_pick.ron", "robot.joints", "no_such_joint", "shoulder_lift_joint"] {
            assert!(message.contains(part), "{message}");
        }
    }
}
