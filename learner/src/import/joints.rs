//! Poses of the tool from recorded joints: a robot and its kinematics, as a controller's configuration
//! names them.

use tprmp_model::controller_config;
use tprmp_spatial::Pose;

use super::selection::{AngleUnit, Selection};
use crate::file_error::FileError;
use crate::record::RecordError;
use crate::record::arm::{self, Arm, Positions};

/// Joints may stand so far beyond the limits of the robot's description \[rad or m\]: offsets of encoders.
const BEYOND_MAX: f64 = 0.1;

/// A robot whose joints were recorded.
pub(super) struct Joints {
    arm: Box<dyn Arm>,
    /// Names of the joints, from base to tool.
    pub(super) names: Vec<String>,
    /// Radians in a unit of recorded angles.
    angle_rad: f64,
    /// What is said of it.
    pub(super) note: String,
}

impl Joints {
    /// The robot that is asked for, if any.
    pub(super) fn open(selection: &Selection) -> Result<Option<Self>, FileError> {
        let Some(config) = &selection.robot else { return Ok(None) };
        let fail = |problem: String| FileError::input(config, "option --robot", problem);
        let robot = controller_config::read(config).map_err(|e| fail(e.to_string()))?.robot;
        let arm = arm::read(config, &robot).map_err(|error| match error {
            RecordError::File(error) => error,
            other => fail(other.to_string()),
        })?;
        let degrees = selection.joint_unit == Some(AngleUnit::Deg);
        let angle_rad = if degrees { f64::to_radians(1.0) } else { 1.0 };
        let file = config.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let note = format!("poses of `{}` by the joints of {file}", robot.tool_frame());
        Ok(Some(Self { arm, names: robot.joints, angle_rad, note }))
    }

    /// X_BE, the pose of the tool in the base frame, at recorded positions of the joints, as many as
    /// there are; or the joint that is wrong, and what was expected.
    pub(super) fn tool_pose(&mut self, recorded: &[f64]) -> Result<Pose, (String, String)> {
        let mut positions: Positions = [0.0; _];
        for (i, number) in recorded.iter().enumerate() {
            let rotates = self.arm.rotates(i);
            let position = number * if rotates { self.angle_rad } else { 1.0 };
            let [least, greatest] = self.arm.limits(i);
            if !(position >= least - BEYOND_MAX && position <= greatest + BEYOND_MAX) {
                let unit = if rotates { "rad" } else { "m" };
                let hint = if rotates { "; degrees are read with --joint-unit deg" } else { "" };
                let problem = format!(
                    "expected a position within {least} to {greatest} {unit}, the robot's limits, found \
                     {position}{hint}"
                );
                return Err((self.names[i].clone(), problem));
            }
            positions[i] = position;
        }
        Ok(self.arm.tool_pose(&positions))
    }
}
