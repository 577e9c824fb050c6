//! What a message must be by itself, before anybody believes it: counts, names, finite numbers, unit
//! quaternions. Whether it fits a robot, a skill or the time is judged by its reader.

use core::fmt;

use crate::messages::{
    Frame, NAME_CAPACITY, Obstacle, ObstacleKind, Reason, RobotState, TaskFrames, ToolCommand,
};

/// How far a quaternion's length may be from one.
pub const QUATERNION_TOLERANCE: f64 = 1e-3;
/// No frame is farther from the robot's base: what is, is in millimetres, or seen from elsewhere \[m\].
pub const FRAME_DISTANCE_MAX_M: f64 = 20.0;

/// A name that no message carries; as text, what was expected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NameFault;

impl fmt::Display for NameFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "expected a name of 1 to {NAME_CAPACITY} bytes")
    }
}

impl std::error::Error for NameFault {}

/// Largest number of a frame or an obstacle \[m, m/s, rad/s\]: products of several stay finite, and nothing is that
/// far away or that fast.
pub const NUMBER_MAX: f64 = 1e6;

/// Whether a number of a frame or an obstacle is one, and at most [`NUMBER_MAX`].
#[must_use]
pub fn is_usable(number: f64) -> bool {
    number.abs() <= NUMBER_MAX
}

fn usable<'a>(values: impl IntoIterator<Item = &'a f64>) -> bool {
    values.into_iter().all(|value| is_usable(*value))
}

fn finite<'a>(values: impl IntoIterator<Item = &'a f64>) -> bool {
    values.into_iter().all(|value| value.is_finite())
}

/// Length of a quaternion.
#[must_use]
pub fn quaternion_length([w, x, y, z]: [f64; 4]) -> f64 {
    (x * x + y * y + z * z + w * w).sqrt()
}

/// Whether a quaternion `w, x, y, z` is of unit length, up to [`QUATERNION_TOLERANCE`].
fn is_unit(quaternion: [f64; 4]) -> bool {
    (quaternion_length(quaternion) - 1.0).abs() <= QUATERNION_TOLERANCE
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
    /// An empty message of the source of this name.
    ///
    /// # Errors
    /// When no message carries the name.
    pub fn of_source(name: &str) -> Result<Self, NameFault> {
        Ok(Self { source: name_bytes(name)?, ..Self::default() })
    }

    /// The frames in use.
    ///
    /// # Errors
    /// When there are more of them than a message carries.
    pub fn listed(&self) -> Result<&[Frame], Reason> {
        self.frames.get(..self.frame_count as usize).ok_or(Reason::FrameCount)
    }

    /// The obstacles that are there.
    ///
    /// # Errors
    /// When more are in use than a message carries.
    pub fn present(&self) -> Result<impl Iterator<Item = &Obstacle>, Reason> {
        let listed = self.obstacles.get(..self.obstacle_count as usize);
        Ok(listed.ok_or(Reason::ObstacleCount)?.iter().filter(|obstacle| obstacle.valid != 0))
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
        check(usable(self.position.iter().chain(&self.quaternion)), Reason::FrameNotFinite)?;
        check(is_unit(self.quaternion), Reason::QuaternionNotUnit)
    }

    /// Whether its pose and velocities can be used.
    ///
    /// # Errors
    /// As [`Self::check_pose`], and when it is farther than [`FRAME_DISTANCE_MAX_M`] from the base.
    pub fn check(&self) -> Result<(), Reason> {
        let velocity = self.linear_velocity.iter().chain(&self.angular_velocity);
        check(self.valid == 1, Reason::FrameMissing)?;
        check(usable(velocity), Reason::FrameNotFinite)?;
        self.check_pose()?;
        check(self.distance_m() <= FRAME_DISTANCE_MAX_M, Reason::FrameFar)
    }

    /// How far it is from the base \[m\].
    #[must_use]
    pub fn distance_m(&self) -> f64 {
        let [x, y, z] = self.position;
        x.hypot(y).hypot(z)
    }
}

/// Whether a ball or capsule can have this radius \[m\]: no arm is outside of a larger one.
fn is_radius(size: f64) -> bool {
    size > 0.0 && size <= FRAME_DISTANCE_MAX_M
}

impl Obstacle {
    /// Its kind, where that is known and everything else can be used. A ball looks the same from all
    /// sides: the length of its quaternion does not matter.
    ///
    /// # Errors
    /// When its mark or kind is none that there is, a size is zero or negative (but the length of a capsule
    /// may be zero), a radius is beyond [`FRAME_DISTANCE_MAX_M`], a number is not finite, or the quaternion is not of unit length.
    pub fn check(&self) -> Result<ObstacleKind, Reason> {
        check(self.valid == 1, Reason::ObstacleUnknown)?;
        check(usable(self.quaternion.iter().chain(&self.size)), Reason::FrameNotFinite)?;
        let kind = ObstacleKind::from_wire(self.kind).ok_or(Reason::ObstacleUnknown)?;
        check(self.bad_size(kind).is_none(), Reason::ObstacleSize)?;
        let turns = kind != ObstacleKind::Sphere;
        check(!turns || is_unit(self.quaternion), Reason::ObstacleQuaternion)?;
        let motion = [self.position, self.linear_velocity, self.angular_velocity];
        check(usable(motion.as_flattened()), Reason::FrameNotFinite)?;
        Ok(kind)
    }
}

impl Obstacle {
    /// Which of its sizes is none that this kind can have, the first one.
    #[must_use]
    pub fn bad_size(&self, kind: ObstacleKind) -> Option<usize> {
        let (sizes, least): (usize, fn(f64) -> bool) = match kind {
            ObstacleKind::HalfSpace => (0, |_| true),
            ObstacleKind::Sphere => (1, is_radius),
            // One without length is a ball.
            ObstacleKind::Capsule if is_radius(self.size[0]) => (2, |size| size >= 0.0),
            ObstacleKind::Capsule => (1, is_radius),
            ObstacleKind::Box => (3, |size| size > 0.0),
        };
        self.size[..sizes].iter().position(|size| !least(*size))
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

/// What [`RobotState::joint_names_hash`] is for joints of these names in this order: FNV-1a of 64 bits over each
/// name's UTF-8 and a zero. Never 0, which says that it is not given.
#[must_use]
pub fn joint_names_hash(names: &[impl AsRef<str>]) -> u64 {
    let bytes = names.iter().flat_map(|name| name.as_ref().bytes().chain([0]));
    let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    hash.max(1)
}

/// A text from the wire, without the zeros that fill its place.
pub(crate) fn unpadded(bytes: &[u8]) -> &[u8] {
    &bytes[..bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len())]
}

#[cfg(test)]
mod tests {
    use super::*;

    const HASH_XY: u64 = 0x7460_2fe1_934c_ffd4;

    #[test]
    fn a_name_survives_the_wire_and_a_bad_one_is_refused() {
        assert_eq!(name_str(&name_bytes("object").unwrap()), Some("object"));
        let longest = "a".repeat(NAME_CAPACITY);
        assert_eq!(name_str(&name_bytes(&longest).unwrap()), Some(longest.as_str()));
        assert_eq!(name_bytes(&"a".repeat(NAME_CAPACITY + 1)), Err(NameFault));
        assert_eq!(name_bytes(""), Err(NameFault));
        assert_eq!(name_str(&[0xff; NAME_CAPACITY]), None);
    }

    /// The same numbers stand in the tests of the Python mirror.
    #[test]
    fn the_hash_of_names_is_one_of_their_order() {
        assert_eq!(joint_names_hash(&["x_joint", "y_joint"]), HASH_XY);
        assert_ne!(joint_names_hash(&["y_joint", "x_joint"]), HASH_XY);
        assert_ne!(joint_names_hash(&["x_jointy", "_joint"]), HASH_XY);
        assert_ne!(joint_names_hash(&[""; 0]), 0);
    }

    #[test]
    fn a_size_is_above_zero_where_the_kind_has_one() {
        let size = |kind: ObstacleKind, size| {
            let quaternion = [1.0, 0.0, 0.0, 0.0];
            let kind = kind.to_wire();
            Obstacle { kind, valid: 1, quaternion, size, ..Default::default() }.check()
        };
        let bad = Err(Reason::ObstacleSize);
        assert_eq!(size(ObstacleKind::HalfSpace, [0.0; 3]), Ok(ObstacleKind::HalfSpace));
        assert_eq!(size(ObstacleKind::Sphere, [0.0; 3]), bad);
        assert_eq!(size(ObstacleKind::Capsule, [0.1, 0.0, 0.0]), Ok(ObstacleKind::Capsule));
        assert_eq!(size(ObstacleKind::Capsule, [0.0, 1.0, 0.0]), bad);
        assert_eq!(size(ObstacleKind::Capsule, [0.1, -1.0, 0.0]), bad);
        assert_eq!(size(ObstacleKind::Box, [0.1, 0.1, 0.0]), bad);
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
