//! A detail beside a reason: numbers of a fixed size.

use tprmp_messages::{NAME_CAPACITY, Reason};

macro_rules! about {
    ($($(#[$meta:meta])* $variant:ident),+ $(,)?) => {
        /// What the numbers of a detail are.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        #[repr(u32)]
        pub enum About { $($(#[$meta])* $variant),+ }
        impl About {
            pub(super) const ALL: &[Self] = &[$(Self::$variant),+];
        }
    };
}

about! {
    /// There is nothing to add to the reason.
    #[default]
    Nothing,
    /// Position of a joint; least and greatest \[rad or m\].
    Position,
    /// Position of a joint that is not finite.
    PositionNotFinite,
    /// Velocity of a joint that is not finite.
    VelocityNotFinite,
    /// Torque of a joint that is not finite.
    TorqueNotFinite,
    /// Number of joints; that of the robot.
    JointCount,
    /// Hash of the joints' names, in the bytes of `name`.
    JointNames,
    /// Speed of a joint; the largest that is believed \[rad/s or m/s\].
    Speed,
    /// Position of a joint; where it has to be by its last state, and within what \[rad or m\].
    PositionJump,
    /// Velocity of a joint; the last one, and by how much it can have changed \[rad/s or m/s\].
    VelocityJump,
    /// What positions of a joint changed by beside its velocities; the most \[rad or m\].
    Drift,
    /// Sequence number; the last one.
    Sequence,
    /// Time stamp; the last one \[ns\].
    Stamp,
    /// Time stamp; the present, and by how much they may differ \[ns\].
    Clock,
    /// Age of the newest message; the greatest \[ns\].
    Age,
    /// States that are missing in a row; the most.
    Lost,
    /// Position of a joint that does not change; the commanded one \[rad or m\], since when \[s\].
    Frozen,
    /// States that came without a command in between.
    Unanswered,
    /// A frame that is not there.
    FrameMissing,
    /// Age of a frame of a source, or of a source's obstacles where it names none; the greatest \[ns\].
    FrameAge,
    /// A frame that two sources publish.
    FrameTwice,
    /// A name that two sources have.
    SourceTwice,
    /// A source too many; the most.
    SourceCount,
    /// Number of obstacles of all sources together, the last of which goes beyond; the most.
    ObstacleTotal,
    /// A frame that is marked invalid; its mark.
    FrameInvalid,
    /// A number of a frame that is not finite.
    FrameNotFinite,
    /// Length of a frame's quaternion.
    FrameQuaternion,
    /// Distance of a frame from the base; the greatest \[m\].
    FrameFar,
    /// Angle of the start frame from the tool, and with its quaternion in the other order \[rad\].
    FrameOrder,
    /// Distance of the start frame from the tool \[m\]; its angle \[rad\].
    StartElsewhere,
    /// Number of frames; the most.
    FrameCount,
    /// Kind of an obstacle.
    ObstacleKind,
    /// Mark of an obstacle.
    ObstacleMark,
    /// A size of an obstacle \[m\]; which of them.
    ObstacleSize,
    /// Length of an obstacle's quaternion.
    ObstacleQuaternion,
    /// An obstacle with a number that is not finite.
    ObstacleNotFinite,
    /// Number of obstacles; the most.
    ObstacleCount,
    /// A mode of the robot.
    RobotMode,
    /// A state of the gripper.
    Gripper,
}

/// What was seen beside a reason, and what was expected.
#[derive(Debug, Clone, Copy, Default)]
pub struct Detail {
    /// The reason.
    pub reason: Reason,
    /// What the numbers are.
    pub about: About,
    /// Which joint, obstacle or frame, from 0.
    pub index: u32,
    /// Name of the frame, or the hash of the joints' names.
    pub name: [u8; NAME_CAPACITY],
    /// Names of the sources it is about; what is unused is zero, and so is the name of a source without one.
    pub sources: [[u8; NAME_CAPACITY]; 2],
    /// In the unit of what it is about.
    pub seen: f64,
    /// In the unit of what it is about; what is unused is 0.
    pub expected: [f64; 2],
}

impl Detail {
    /// A reason without anything to add.
    #[must_use]
    pub fn plain(reason: Reason) -> Self {
        Self { reason, ..Self::default() }
    }

    /// Numbers about something that has no place among others.
    #[must_use]
    pub fn new(reason: Reason, about: About, seen: f64, expected: [f64; 2]) -> Self {
        Self { about, seen, expected, ..Self::plain(reason) }
    }

    /// The same about the one of this index.
    #[must_use]
    pub fn at(self, index: usize) -> Self {
        Self { index: index as u32, ..self }
    }

    /// The same about the frame of this name.
    #[must_use]
    pub fn named(self, name: &[u8; NAME_CAPACITY]) -> Self {
        Self { name: *name, ..self }
    }

    /// The same about a message of the source of this name.
    #[must_use]
    pub fn of_source(self, source: &[u8; NAME_CAPACITY]) -> Self {
        Self { sources: [*source, self.sources[1]], ..self }
    }

    /// The first position that is outside of its limits [rad or m], or nothing to add.
    #[must_use]
    pub fn beyond(reason: Reason, position: &[f64], lower: &[f64], upper: &[f64]) -> Self {
        let inside = |i: &usize| !(lower[*i]..=upper[*i]).contains(&position[*i]);
        match (0..position.len()).find(inside) {
            None => Self::plain(reason),
            Some(i) => {
                let limits = [lower[i], upper[i]];
                Self::new(reason, About::Position, position[i], limits).at(i)
            }
        }
    }
}
