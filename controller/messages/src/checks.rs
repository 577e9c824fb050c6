//! What a message must be by itself, before anybody believes it: counts, names, finite numbers, unit
//! quaternions. Whether it fits a robot, a skill or the time is judged by its reader.

use core::fmt;

use crate::messages::{
    Frame, NAME_CAPACITY, Obstacle, ObstacleKind, Reason, RobotState, TaskFrames, ToolCommand,
};

/// How far a quaternion's length may be from one.
pub const QUATERNION_TOLERANCE: f64 = 1e-3;

/// A name that no message carries; as text, what was expected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NameFault;

impl fmt::Display for NameFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "expected a name of 1 to {NAME_CAPACITY} bytes")
    }
}

impl std::error::Error for NameFault {}

fn finite<'a>(values: impl IntoIterator<Item = &'a f64>) -> bool {
    values.into_iter().all(|value| value.is_finite())
}

/// Whether a quaternion `w, x, y, z` is of unit length, up to [`QUATERNION_TOLERANCE`].
fn is_unit([w, x, y, z]: [f64; 4]) -> bool {
    ((x * x + y * y + z * z + w * w).sqrt() - 1.0).abs() <= QUATERNION_TOLERANCE
}

fn check(holds: bool, reason: Reason) -> Result<(), Reason> {
    if holds { Ok(()) } else { Err(reason) }
}

impl RobotState {
    /// The positions of `joints` joints \[rad or m\].
    ///
    /// # Errors
    /// When it has another number of them, or one is not finite.
    pub fn check_positions(&self, joints: usize) -> Result<&[f64], Reason> {
        check(self.joint_count as usize == joints, Reason::JointCount)?;
        let position = &self.position[..joints];
        check(finite(position), Reason::StateNotFinite)?;
        Ok(position)
    }

    /// The positions and velocities of `joints` joints \[rad or m, rad/s or m/s\]; the torques are
    /// checked too.
    ///
    /// # Errors
    /// As [`Self::check_positions`].
    pub fn check(&self, joints: usize) -> Result<[&[f64]; 2], Reason> {
        let position = self.check_positions(joints)?;
        let (velocity, torque) = (&self.velocity[..joints], &self.torque[..joints]);
        check(finite(velocity.iter().chain(torque)), Reason::StateNotFinite)?;
        Ok([position, velocity])
    }
}

impl TaskFrames {
    /// The frames in use.
    ///
    /// # Errors
    /// When there are more of them than a message carries.
    pub fn listed(&self) -> Result<&[Frame], Reason> {
        self.frames.get(..self.frame_count as usize).ok_or(Reason::FrameMissing)
    }

    /// The obstacles that are there.
    ///
    /// # Errors
    /// When more are in use than a message carries.
    pub fn present(&self) -> Result<impl Iterator<Item = &Obstacle>, Reason> {
        let listed = self.obstacles.get(..self.obstacle_count as usize);
        Ok(listed.ok_or(Reason::ObstacleUnknown)?.iter().filter(|obstacle| obstacle.valid != 0))
    }
}

impl Frame {
    /// A valid frame at rest at `position` \[m\], not rotated.
    ///
    /// # Errors
    /// When no message carries the name.
    pub fn at(name: &str, position: [f64; 3]) -> Result<Self, NameFault> {
        let (name, quaternion) = (name_bytes(name)?, [1.0, 0.0, 0.0, 0.0]);
        Ok(Self { name, valid: 1, position, quaternion, ..Default::default() })
    }

    /// The frame of this name among `frames`, a valid one where there are several.
    #[must_use]
    pub fn find<'a>(frames: &'a [Self], name: &[u8; NAME_CAPACITY]) -> Option<&'a Self> {
        let named = || frames.iter().filter(|frame| frame.name == *name);
        named().find(|frame| frame.valid == 1).or_else(|| named().next())
    }

    /// Whether its pose can be used.
    ///
    /// # Errors
    /// When it is marked invalid, a number is not finite, or the quaternion is not of unit length.
    pub fn check_pose(&self) -> Result<(), Reason> {
        check(self.valid == 1, Reason::FrameMissing)?;
        check(finite(self.position.iter().chain(&self.quaternion)), Reason::FrameNotFinite)?;
        check(is_unit(self.quaternion), Reason::QuaternionNotUnit)
    }

    /// Whether its pose and velocities can be used.
    ///
    /// # Errors
    /// As [`Self::check_pose`].
    pub fn check(&self) -> Result<(), Reason> {
        let velocity = self.linear_velocity.iter().chain(&self.angular_velocity);
        check(self.valid == 1, Reason::FrameMissing)?;
        check(finite(velocity), Reason::FrameNotFinite)?;
        self.check_pose()
    }
}

impl Obstacle {
    /// Its kind, where that is known and everything else can be used. A ball looks the same from all
    /// sides: the length of its quaternion does not matter.
    ///
    /// # Errors
    /// When its mark, kind or size is none that there is, a number is not finite, or the quaternion is
    /// not of unit length.
    pub fn check(&self) -> Result<ObstacleKind, Reason> {
        check(self.valid == 1, Reason::ObstacleUnknown)?;
        check(finite(self.quaternion.iter().chain(&self.size)), Reason::FrameNotFinite)?;
        let kind = ObstacleKind::from_wire(self.kind).ok_or(Reason::ObstacleUnknown)?;
        let sizes = match kind {
            ObstacleKind::HalfSpace => 0,
            ObstacleKind::Sphere => 1,
            ObstacleKind::Capsule => 2,
            ObstacleKind::Box => 3,
        };
        check(self.size[..sizes].iter().all(|size| *size >= 0.0), Reason::ObstacleUnknown)?;
        let turns = kind != ObstacleKind::Sphere;
        check(!turns || is_unit(self.quaternion), Reason::QuaternionNotUnit)?;
        let motion = [self.position, self.linear_velocity, self.angular_velocity];
        check(finite(motion.as_flattened()), Reason::FrameNotFinite)?;
        Ok(kind)
    }
}

impl ToolCommand {
    /// Whether all its numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        finite(self.linear_velocity.iter().chain(&self.angular_velocity))
    }
}

/// A name in the wire's form.
///
/// # Errors
/// When it is empty or longer than [`NAME_CAPACITY`].
pub fn name_bytes(name: &str) -> Result<[u8; NAME_CAPACITY], NameFault> {
    let mut bytes = [0; NAME_CAPACITY];
    bytes.get_mut(..name.len()).ok_or(NameFault)?.copy_from_slice(name.as_bytes());
    if name.is_empty() { Err(NameFault) } else { Ok(bytes) }
}

/// A name from the wire's form, `None` when it is not UTF-8.
#[must_use]
pub fn name_str(bytes: &[u8; NAME_CAPACITY]) -> Option<&str> {
    core::str::from_utf8(unpadded(bytes)).ok()
}

/// A text from the wire, without the zeros that fill its place.
pub(crate) fn unpadded(bytes: &[u8]) -> &[u8] {
    &bytes[..bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len())]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_survives_the_wire_and_a_bad_one_is_refused() {
        assert_eq!(name_str(&name_bytes("object").unwrap()), Some("object"));
        let longest = "a".repeat(NAME_CAPACITY);
        assert_eq!(name_str(&name_bytes(&longest).unwrap()), Some(longest.as_str()));
        assert_eq!(name_bytes(&"a".repeat(NAME_CAPACITY + 1)), Err(NameFault));
        assert_eq!(name_bytes(""), Err(NameFault));
        assert_eq!(name_str(&[0xff; NAME_CAPACITY]), None);
    }

    #[test]
    fn of_several_frames_of_a_name_the_valid_one_counts() {
        let [one, other] = ["one", "other"].map(|name| name_bytes(name).unwrap());
        let frame = |name, valid| Frame { name, valid, ..Default::default() };
        let frames = [frame(one, 0), frame(one, 1), frame(other, 2)];
        assert!(core::ptr::eq(Frame::find(&frames, &one).unwrap(), &frames[1]));
        let unknown = Frame::find(&frames, &other).unwrap();
        assert_eq!(unknown.check(), Err(Reason::FrameMissing));
        assert!(Frame::find(&frames[..2], &other).is_none());
    }

    #[test]
    fn a_state_is_checked_as_far_as_it_is_used() {
        let mut state = RobotState { joint_count: 2, ..Default::default() };
        state.position[2] = f64::NAN;
        assert!(state.check(2).is_ok(), "what is beyond the joints does not count");
        assert_eq!(state.check(3), Err(Reason::JointCount));
        state.torque[1] = f64::INFINITY;
        assert_eq!(state.check(2), Err(Reason::StateNotFinite));
        assert!(state.check_positions(2).is_ok());
    }
}
