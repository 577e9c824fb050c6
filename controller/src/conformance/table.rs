//! The checks, in their order, and what came of each.

use tprmp_files::outln;

macro_rules! checks {
    ($($(#[$meta:meta])* $variant:ident = $name:literal, $remedy:literal;)+) => {
        /// What is looked at.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Check { $($(#[$meta])* $variant),+ }
        impl Check {
            /// All of them, in the order of the table.
            pub const ALL: &[Self] = &[$(Self::$variant),+];
            /// Its name in the table.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),+ }
            }
            /// What to do where it fails.
            #[must_use]
            pub fn remedy(self) -> &'static str {
                match self { $(Self::$variant => $remedy),+ }
            }
        }
    };
}

checks! {
    /// Names, types and bounds of the services.
    Services = "services", "open the services as `controller/messages/README.md` says, with iceoryx2 0.9.3";
    /// Whether states arrive.
    States = "states arrive", "publish states in real time, on this instance, without waiting for commands";
    /// How many joints.
    JointCount = "joint count", "set `joint_count` to the number of `robot.joints`";
    /// In which order.
    JointNames = "joint names", "set `joint_names_hash` to that of `robot.joints`, in this order";
    /// No number is missing.
    Numbers = "finite numbers", "publish no state whose reading has failed";
    /// Positions are in their ranges.
    Positions = "positions", "publish rad or m, with the zero and sign of the URDF";
    /// Stamps are about now.
    Clock = "clock", "stamp in ns on CLOCK_MONOTONIC, when the state is measured";
    /// How often, how evenly.
    Rate = "rate", "publish more often and more evenly, from a thread with real-time priority";
    /// Sequence numbers.
    Sequence = "sequence", "count `sequence` up by one from state to state";
    /// Stamps grow.
    Stamps = "stamps", "stamp each state anew";
    /// Velocities at rest.
    Rest = "velocity at rest", "measure the velocity in rad/s or m/s, with the position's sign";
    /// Torques at rest.
    Gravity = "torque at rest", "publish the torque without what holds the arm against gravity";
    /// Mode, safety flag, gripper.
    Modes = "mode and gripper", "set `robot_mode`, `safety_stop` and `gripper_state` to what the robot reports";
    /// Whether frames arrive.
    Frames = "frames arrive", "publish frames before the first state, and with each state";
    /// Frames are of now.
    FrameClock = "clock of frames", "stamp the frames on the clock of the states";
    /// Names and poses.
    FramePoses = "frames", "publish frames in m in the robot's base, quaternions w x y z, with the skill's names, each by one source";
    /// Obstacles.
    Obstacles = "obstacles", "publish at most 32 obstacles of known kinds over all sources, with sizes above 0";
    /// Each joint follows its command.
    Joints = "order and sign", "let index i of states and commands be joint i of `robot.joints`, with its sign";
    /// Velocities in motion.
    Velocity = "velocity in motion", "measure the velocity in rad/s or m/s, with the position's sign";
    /// Torques in motion.
    Torque = "torque in motion", "publish the torque with the sign that accelerates the joint";
    /// A command that expires.
    Expiry = "expired command", "brake once `expiry_ns` has passed: `CommandGuard` does";
    /// A command that says to stop.
    Stop = "Stop", "brake on mode `Stop`, whatever the other fields say: `CommandGuard` does";
    /// A controller that is killed.
    Killed = "killed controller", "brake where commands no longer come: `CommandGuard` does";
}

/// What came of a check.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Verdict {
    /// It holds; what was seen.
    Passed(String),
    /// It does not; what was seen.
    Failed(String),
    /// Why it was not looked at.
    NotTried(String),
}

/// What came of all of them.
#[derive(Debug, Default)]
pub struct Table {
    lines: Vec<(Check, Verdict)>,
}

impl Table {
    /// Adds what came of a check, and prints it.
    pub fn add(&mut self, check: Check, verdict: Verdict) {
        let (word, text) = match &verdict {
            Verdict::Passed(text) => ("passed", text.clone()),
            Verdict::Failed(text) => ("FAILED", format!("{text}; remedy: {}", check.remedy())),
            Verdict::NotTried(text) => ("not tried", text.clone()),
        };
        outln!("{word:>9}  {:<18} {text}", check.name());
        self.lines.push((check, verdict));
    }

    /// Adds what came of a check that gives a text either way.
    pub fn judge(&mut self, check: Check, result: Result<String, String>) {
        self.add(check, result.map_or_else(Verdict::Failed, Verdict::Passed));
    }

    /// Adds all checks that have no line yet as not tried.
    pub fn skip_rest(&mut self, why: &str) {
        let rest = Check::ALL.iter().filter(|check| self.lines.iter().all(|(of, _)| of != *check));
        for check in rest.copied().collect::<Vec<_>>() {
            self.add(check, Verdict::NotTried(why.into()));
        }
    }

    /// How many have failed.
    #[must_use]
    pub fn failed(&self) -> usize {
        self.lines.iter().filter(|(_, verdict)| matches!(verdict, Verdict::Failed(_))).count()
    }
}
