//! The axis along which an arm's tool comes to what it works on, and that of the tool a model was learned with.

use glam::{DQuat, DVec3};
use nalgebra::SVector;
use tprmp_robot::{Chain, JointKind, Kinematics, forward_kinematics, point_position};

/// From this angle on between the taught approach axis and the arm's, a transform is missing \[°\].
pub(crate) const APART_DEG: f64 = 30.0;
/// Directions as near to an axis of the frame as this are that axis \[rad\].
const AXIS_ANGLE: f64 = 0.2;

/// The axis of the last joint in the tool's frame, pointing outward: a flange's face is normal to it. That of the
/// last one that rotates, where there is one.
pub(crate) fn approach_axis<const N: usize>(chain: &Chain<N>, at: &SVector<f64, N>) -> DVec3 {
    let mut kinematics = Kinematics::new();
    forward_kinematics(chain, at, &mut kinematics);
    let last = (0..N).rev().find(|i| chain.joint_kind(*i) == Some(JointKind::Revolute));
    let column = kinematics.tool_jacobian.column(last.unwrap_or(N - 1)).into_owned();
    let first = if last.is_some() { 3 } else { 0 };
    let axis = DVec3::new(column[first], column[first + 1], column[first + 2]);
    let before = point_position(&kinematics, last.unwrap_or(N - 1).saturating_sub(1), DVec3::ZERO);
    let outward = kinematics.tool_position() - before;
    let axis = if axis.dot(outward) < -1e-6 { -axis } else { axis };
    snapped(kinematics.tool_pose().orientation.inverse() * axis)
}

/// A direction, as an axis of the frame where it is near to one.
#[must_use]
pub(crate) fn snapped(direction: DVec3) -> DVec3 {
    let direction = direction.normalize_or(DVec3::Z);
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
    let near = axes.into_iter().find(|axis| axis.angle_between(direction) < AXIS_ANGLE);
    near.unwrap_or(direction)
}

/// The orientation of a tool whose approach axis is `taught` (in its own frame) on a flange whose is `own`.
#[must_use]
pub(crate) fn orientation(own: DVec3, taught: DVec3) -> DQuat {
    DQuat::from_rotation_arc(taught, own)
}

/// An axis in words.
#[must_use]
pub(crate) fn named(axis: DVec3) -> String {
    for (name, of) in [("x", DVec3::X), ("y", DVec3::Y), ("z", DVec3::Z)] {
        if axis.dot(of).abs() > 1.0 - 1e-9 {
            return format!("{}{name}", if axis.dot(of) < 0.0 { "−" } else { "" });
        }
    }
    format!("({:.2}, {:.2}, {:.2})", axis.x, axis.y, axis.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_taught_axis_comes_to_lie_on_the_flanges() {
        let q = orientation(DVec3::X, DVec3::Z);
        assert!((q * DVec3::Z - DVec3::X).length() < 1e-12);
        assert_eq!(snapped(DVec3::new(0.01, 2.0, 0.0)), DVec3::Y);
        assert_eq!(
            [named(DVec3::NEG_Y), named(DVec3::new(0.6, 0.0, 0.8))],
            ["−y", "(0.60, 0.00, 0.80)"]
        );
    }

    #[test]
    fn the_shipped_arms_tool_points_along_its_z() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../config/robots/ur5.urdf");
        let chain = Chain::<6>::from_urdf(file, "suction_tip").unwrap();
        let q = SVector::from([0.3, -1.2, 1.5, -1.7, -1.4, 0.2]);
        assert_eq!(approach_axis(&chain, &q), DVec3::Z);
    }
}
