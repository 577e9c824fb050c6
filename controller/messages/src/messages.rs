//! Plain old data, `repr(C)`, no pointers: what lies in shared memory.

use iceoryx2::prelude::ZeroCopySend;

use crate::layout::{message, wire_enum};

/// Most joints a message carries.
pub const JOINT_CAPACITY: usize = 8;
/// Most task frames a message carries.
pub const FRAME_CAPACITY: usize = 8;
/// Most obstacles a message carries.
pub const OBSTACLE_CAPACITY: usize = 32;
/// Longest name of a frame, in bytes of UTF-8; shorter names are padded with zeros.
pub const NAME_CAPACITY: usize = 24;

message! {
    /// The state of the robot, from a state publisher to the controller.
    derive(Default) struct RobotState = "RobotStateV3" {
        /// Counts up by one from message to message: what is missing is counted as lost.
        sequence: u64,
        /// When the state was measured \[ns\].
        time_ns: u64,
        /// Number of joints in use, the first ones of each array.
        joint_count: u32,
        /// What the gripper senses: a [`GripperState`].
        gripper_state: u32,
        /// What the robot itself is doing: a [`RobotMode`].
        robot_mode: u32,
        /// 0 while the robot's safety system permits motion, 1 while it does not.
        safety_stop: u32,
        /// [`joint_names_hash`](crate::joint_names_hash) of the joints' names, in the order of the arrays; 0 where
        /// the publisher does not say.
        joint_names_hash: u64,
        /// Joint positions \[rad or m\].
        position: [f64; JOINT_CAPACITY],
        /// Joint velocities \[rad/s or m/s\].
        velocity: [f64; JOINT_CAPACITY],
        /// Measured joint torques or forces, without gravity \[N m or N\]; zero where not measured.
        torque: [f64; JOINT_CAPACITY],
    }
}

message! {
    /// The task parameters: frames and obstacles, from their sources to the controller. A state publisher may be
    /// the only source, or one of several.
    derive(Default) struct TaskFrames = "TaskFramesV3" {
        /// Counts up by at least one from message to message.
        sequence: u64,
        /// When the frames were measured \[ns\], on the clock of [`RobotState::time_ns`].
        time_ns: u64,
        /// Name of the source, UTF-8, padded with zeros: each of several has one of its own. A state publisher
        /// may leave it empty.
        source: [u8; NAME_CAPACITY],
        /// Number of frames in use, the first ones of the array.
        frame_count: u32,
        /// Number of obstacles in use, the first ones of the array.
        obstacle_count: u32,
        /// Named frames.
        frames: [Frame; FRAME_CAPACITY],
        /// Obstacles.
        obstacles: [Obstacle; OBSTACLE_CAPACITY],
    }
}

message! {
    /// A named task frame in the robot's base frame `B`.
    derive(Default) struct Frame = "FrameV1" {
        /// UTF-8, padded with zeros.
        name: [u8; NAME_CAPACITY],
        /// 1 when the pose may be used, 0 when it is unknown.
        valid: u32,
        /// Explicit padding, zero.
        padding: u32,
        /// Origin \[m\].
        position: [f64; 3],
        /// Orientation, unit quaternion `w, x, y, z`.
        quaternion: [f64; 4],
        /// Velocity of the origin \[m/s\].
        linear_velocity: [f64; 3],
        /// Angular velocity, expressed in `B` \[rad/s\].
        angular_velocity: [f64; 3],
    }
}

message! {
    /// A moving obstacle in the robot's base frame `B`.
    derive(Default) struct Obstacle = "ObstacleV2" {
        /// What `size` means: an [`ObstacleKind`].
        kind: u32,
        /// 1 when the obstacle is there, 0 when it is not. One that is not measured any more is still
        /// there: publish its last pose.
        valid: u32,
        /// Centre; of a half-space, a point on its surface \[m\].
        position: [f64; 3],
        /// Orientation, unit quaternion `w, x, y, z`.
        quaternion: [f64; 4],
        /// Velocity of `position` \[m/s\].
        linear_velocity: [f64; 3],
        /// Angular velocity, expressed in `B` \[rad/s\].
        angular_velocity: [f64; 3],
        /// What it is depends on the kind; the rest is unused \[m\].
        size: [f64; 3],
    }
}

message! {
    /// What the controller wants the robot to do, from the controller to the robot.
    ///
    /// A torque interface applies `torque + gravity_torque` (an arm that adds gravity itself only
    /// `torque`); a velocity or position interface uses `velocity` or `position`. After `expiry_ns`
    /// the command must no longer be obeyed: the robot brakes. [`CommandGuard`](crate::CommandGuard) knows
    /// when.
    derive(Default) struct JointCommand = "JointCommandV1" {
        /// Counts up by one from message to message.
        sequence: u64,
        /// [`RobotState::sequence`] of the state this command answers.
        state_sequence: u64,
        /// When the command was computed \[ns\]; in lockstep, the state's time.
        time_ns: u64,
        /// When the command expires \[ns\].
        expiry_ns: u64,
        /// A [`CommandMode`].
        mode: u32,
        /// A [`GripperCommand`].
        gripper_command: u32,
        /// Number of joints in use, the first ones of each array.
        joint_count: u32,
        /// A [`Reason`]: why the controller does not follow its policy, or makes no progress with it.
        reason: u32,
        /// Desired positions, integrated \[rad or m\].
        position: [f64; JOINT_CAPACITY],
        /// Desired velocities, integrated \[rad/s or m/s\].
        velocity: [f64; JOINT_CAPACITY],
        /// Desired accelerations \[rad/s² or m/s²\].
        acceleration: [f64; JOINT_CAPACITY],
        /// Joint torques or forces without gravity \[N m or N\].
        torque: [f64; JOINT_CAPACITY],
        /// Joint torques or forces that hold the arm against gravity \[N m or N\].
        gravity_torque: [f64; JOINT_CAPACITY],
    }
}

message! {
    /// A desired velocity of the tool: from teleoperation, hand guiding or another planner. It is for a
    /// controller whose configuration listens.
    ///
    /// It acts beside the skill and is no state: one that is faulty, or older than the controller permits,
    /// is ignored. Zeros ask for a tool at rest; to let go, stop publishing.
    derive(Default) struct ToolCommand = "ToolCommandV1" {
        /// Counts up by at least one from message to message; a publisher that begins while no other command
        /// is fresh may begin anywhere.
        sequence: u64,
        /// When the command was given \[ns\], on the clock of [`RobotState::time_ns`].
        time_ns: u64,
        /// Velocity of the tool's origin, expressed in `B` \[m/s\].
        linear_velocity: [f64; 3],
        /// Angular velocity of the tool, expressed in `B` \[rad/s\].
        angular_velocity: [f64; 3],
    }
}

message! {
    /// How the controller is doing, once a tick or every few.
    derive(Default) struct ControllerStatus = "ControllerStatusV3" {
        /// Counts up by one from message to message.
        sequence: u64,
        /// When the tick ended \[ns\].
        time_ns: u64,
        /// A [`LifeCycle`].
        life_cycle: u32,
        /// A [`Reason`].
        reason: u32,
        /// Ticks so far.
        ticks: u64,
        /// Ticks that ended after their deadline or came after skipped periods, so far.
        deadline_misses: u64,
        /// Periods that passed without a tick, so far.
        skipped_periods: u64,
        /// States that are missing between those that arrived, by their numbers, so far.
        states_lost: u64,
        /// Heap allocations inside the loop, so far, without those of `connections`.
        allocations: u64,
        /// How often a new peer had to be connected to inside the loop, so far.
        connections: u64,
        /// Period of the loop \[ns\].
        period_ns: u64,
        /// How late the last tick woke up \[ns\].
        wake_up_ns: u64,
        /// Age of the state the last tick used \[ns\].
        state_age_ns: u64,
        /// Time the last tick took to receive its messages \[ns\].
        receiving_ns: u64,
        /// Time the last tick took for checks, policy and limits \[ns\].
        evaluation_ns: u64,
        /// Time the last tick took to publish its command \[ns\].
        publishing_ns: u64,
        /// Distance of the tool from the goal \[m\].
        goal_distance_m: f64,
        /// Angle of the tool from the goal \[rad\].
        goal_angle_rad: f64,
        /// Lyapunov value Φ + ½ ẏᵀMẏ of the skill in canonical coordinates \[J\].
        energy_j: f64,
    }
}

wire_enum! {
    /// What the gripper senses.
    GripperState {
        /// No gripper, or nothing sensed.
        None = 0,
        /// The gripper is open or its vacuum is off.
        Open = 1,
        /// The gripper holds an object.
        Holding = 2,
    }
}

wire_enum! {
    /// What the robot itself is doing.
    RobotMode {
        /// It obeys commands.
        Running = 0,
        /// Its own protective stop: it brakes, or stands still.
        ProtectiveStop = 1,
        /// Its emergency stop.
        EmergencyStop = 2,
        /// It is guided by hand.
        HandGuiding = 3,
        /// It reports a fault.
        Fault = 4,
    }
}

wire_enum! {
    /// What the gripper should do.
    GripperCommand {
        /// Open, vacuum off.
        Release = 0,
        /// Close, vacuum on.
        Grip = 1,
    }
}

wire_enum! {
    /// What kind of command this is.
    CommandMode {
        /// No motion: brake, whatever the other fields say. Sent as a last command, and while there
        /// is no state to move from.
        Stop = 0,
        /// Follow the policy.
        Track = 1,
        /// Decelerate and hold, for the reason given.
        Hold = 2,
    }
}

wire_enum! {
    /// The controller's life cycle: `controller/LIFECYCLE.md` has every transition.
    LifeCycle {
        /// Waiting for a first valid state and valid frames.
        Waiting = 0,
        /// Following the skill.
        Running = 1,
        /// The object is held: lifting it.
        Lifting = 2,
        /// The task is done: holding still.
        Done = 3,
        /// Decelerating or holding because of [`ControllerStatus::reason`].
        Holding = 4,
        /// Ramping down to leave.
        Stopping = 5,
        /// All is well; the arm is held until somebody starts it.
        Ready = 6,
        /// Decelerating or holding because of [`ControllerStatus::reason`], until somebody resets it.
        Fault = 7,
    }
}

wire_enum! {
    /// Why the controller does not follow its policy, or makes no progress with it. Each of the former
    /// has one safe action: decelerate to rest in bounded time and hold, then fade in again once the
    /// cause has gone.
    Reason {
        /// It follows it.
        None = 0,
        /// No state arrives any more: the newest is older than its limit.
        StateStale = 1,
        /// The state's sequence number went back: the publisher was restarted.
        SequenceWentBack = 2,
        /// A number in the state is not finite.
        StateNotFinite = 3,
        /// The state has another number of joints than the robot's description.
        JointCount = 4,
        /// A frame the skill needs is missing or marked invalid.
        FrameMissing = 5,
        /// A number in a frame or an obstacle is not finite.
        FrameNotFinite = 6,
        /// A frame's quaternion is not of unit length.
        QuaternionNotUnit = 7,
        /// An obstacle is of a kind this controller does not know, or its mark is neither 0 nor 1.
        ObstacleUnknown = 8,
        /// The newest frames are older than their limit.
        FramesStale = 9,
        /// The tree could not be resolved: its metric is not positive definite.
        ResolveFailed = 10,
        /// The policy's command was not finite.
        CommandNotFinite = 11,
        /// A signal asked for a stop.
        StopRequested = 12,
        /// A measured joint position is outside the robot's description.
        JointLimit = 13,
        /// Too many periods were missed in a row.
        Overrun = 14,
        /// A measured speed is far beyond the joint's limit, or a position or velocity has jumped.
        StateUnbelievable = 15,
        /// The gripper reports a state this controller does not know.
        GripperUnknown = 16,
        /// It follows its policy, but the arm stands still before an obstacle or before itself.
        Blocked = 17,
        /// It follows its policy, but the arm stands still short of the goal.
        Unreachable = 18,
        /// A first state has arrived; those that follow have to confirm it.
        StateUnconfirmed = 19,
        /// States arrive, but their sequence number does not grow.
        SequenceStuck = 20,
        /// States arrive, but their time stamp does not grow.
        StateTimeStuck = 21,
        /// States arrive, but their time stamp is farther from the present than a state may be old:
        /// another clock.
        StateClock = 22,
        /// Positions change by something else than their velocities say.
        VelocityUnbelievable = 23,
        /// Too many states in a row are missing, by their sequence numbers.
        StatesLost = 24,
        /// The loop was held up for longer than a command lives: the robot has braked on its own.
        CommandExpired = 25,
        /// The sequence number of the states went back again within a second: two sources publish.
        TwoSources = 26,
        /// The robot reports a protective stop.
        ProtectiveStop = 27,
        /// The robot reports an emergency stop.
        EmergencyStop = 28,
        /// The robot is guided by hand.
        HandGuiding = 29,
        /// The robot reports a fault, or a mode that there is not.
        RobotFault = 30,
        /// The robot's safety system does not permit motion.
        SafetyStop = 31,
        /// Nobody has asked for a start yet.
        StartNotRequested = 32,
        /// Somebody asked for a hold.
        HoldRequested = 33,
        /// The controller before this one ended without a stop.
        EndedUnexpectedly = 34,
        /// The arm is not at rest, or not where the last commands ended.
        ArmElsewhere = 35,
        /// The gripper holds something that this controller did not grip.
        GripperHolds = 36,
        /// The hash of the joints' names is another one: other joints, or another order.
        JointOrder = 37,
        /// The arm is commanded to move, states arrive, and no position changes.
        PositionsFrozen = 38,
        /// The controller runs in lockstep, the publisher does not wait for its commands.
        PublisherNotInLockstep = 39,
        /// More frames than a message carries.
        FrameCount = 40,
        /// A frame is farther from the base than any arm reaches.
        FrameFar = 41,
        /// The frame of the start is where the tool is, with its quaternion in another order.
        QuaternionOrder = 42,
        /// More obstacles than a message carries.
        ObstacleCount = 43,
        /// A size of an obstacle is zero or negative.
        ObstacleSize = 44,
        /// An obstacle's quaternion is not of unit length.
        ObstacleQuaternion = 45,
        /// The task grips, and the state says that there is no gripper.
        GripperNone = 46,
        /// It follows its policy and is at the goal, where it waits for the gripper to hold.
        GripperAwaited = 47,
        /// Two sources publish the same frame, or have the same name.
        FrameTwice = 48,
        /// A joint that is a little outside its position limits is moved back, slowly.
        JointReturning = 49,
        /// The start frame is published, and the tool that starts there is elsewhere.
        StartElsewhere = 50,
    }
}

wire_enum! {
    /// Shape of an obstacle.
    ObstacleKind {
        /// A ball: `position` is its centre, `size[0]` its radius \[m\].
        Sphere = 0,
        /// Everything below the plane through `position` whose normal is the z axis.
        HalfSpace = 1,
        /// All points within a radius of a stretch of the z axis: `size[0]` is the radius, `size[1]`
        /// the length of the stretch, to which the round ends are added \[m\].
        Capsule = 2,
        /// A box: `size` are its edges along x, y and z \[m\].
        Box = 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_enum_survives_the_wire() {
        for reason in Reason::ALL {
            assert_eq!(Reason::from_wire(reason.to_wire()), Some(*reason));
        }
        assert_eq!(Reason::from_wire(Reason::ALL.len() as u32), None);
        assert_eq!(ObstacleKind::from_wire(1), Some(ObstacleKind::HalfSpace));
        assert_eq!(ObstacleKind::from_wire(4), None);
    }
}
