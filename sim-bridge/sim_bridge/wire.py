"""The messages of tprmp, as ctypes. Made by `controller layout --format python`: do not edit.

SI units, quaternions w x y z, poses and velocities in the robot's base frame, times in ns on
CLOCK_MONOTONIC. Names are UTF-8, padded with zeros.
"""

import ctypes
from enum import IntEnum

ICEORYX2_VERSION = "0.9.3"
PREFIX = "tprmp_<user id>_<instance>_"
ROOT = "/tmp/tprmp-<user id>/<instance>/"

JOINT_CAPACITY = 8
FRAME_CAPACITY = 8
OBSTACLE_CAPACITY = 32
NAME_CAPACITY = 24
TEXT_CAPACITY = 1000
FRAME_SOURCES_MAX = 8
STATE_BUFFER = 16
OBSERVER_BUFFER = 256

SERVICES = {
    "robot_state": {
        "name": "<instance>/robot_state/v1",
        "max_publishers": 1,
        "max_subscribers": 8,
        "max_nodes": 16,
        "history_size": 1,
        "subscriber_max_buffer_size": 256,
        "has_safe_overflow": True,
    },
    "task_frames": {
        "name": "<instance>/task_frames/v1",
        "max_publishers": 8,
        "max_subscribers": 8,
        "max_nodes": 16,
        "history_size": 1,
        "subscriber_max_buffer_size": 1,
        "has_safe_overflow": True,
    },
    "joint_command": {
        "name": "<instance>/joint_command/v1",
        "max_publishers": 1,
        "max_subscribers": 8,
        "max_nodes": 16,
        "history_size": 1,
        "subscriber_max_buffer_size": 1,
        "has_safe_overflow": True,
    },
    "controller_status": {
        "name": "<instance>/controller_status/v1",
        "max_publishers": 1,
        "max_subscribers": 8,
        "max_nodes": 16,
        "history_size": 1,
        "subscriber_max_buffer_size": 256,
        "has_safe_overflow": True,
    },
    "tool_command": {
        "name": "<instance>/tool_command/v1",
        "max_publishers": 1,
        "max_subscribers": 8,
        "max_nodes": 16,
        "history_size": 1,
        "subscriber_max_buffer_size": 1,
        "has_safe_overflow": True,
    },
}


class GripperState(IntEnum):
    """What the gripper senses."""

    # No gripper, or nothing sensed.
    NONE = 0
    # The gripper is open or its vacuum is off.
    OPEN = 1
    # The gripper holds an object.
    HOLDING = 2


class RobotMode(IntEnum):
    """What the robot itself is doing."""

    # It obeys commands.
    RUNNING = 0
    # Its own protective stop: it brakes, or stands still.
    PROTECTIVE_STOP = 1
    # Its emergency stop.
    EMERGENCY_STOP = 2
    # It is guided by hand.
    HAND_GUIDING = 3
    # It reports a fault.
    FAULT = 4


class GripperCommand(IntEnum):
    """What the gripper should do."""

    # Open, vacuum off.
    RELEASE = 0
    # Close, vacuum on.
    GRIP = 1


class CommandMode(IntEnum):
    """What kind of command this is."""

    # No motion: brake, whatever the other fields say. Sent as a last command, and while there is no
    # state to move from.
    STOP = 0
    # Follow the policy.
    TRACK = 1
    # Decelerate and hold, for the reason given.
    HOLD = 2


class LifeCycle(IntEnum):
    """The controller's life cycle: `controller/LIFECYCLE.md` has every transition."""

    # Waiting for a first valid state and valid frames.
    WAITING = 0
    # Following the skill.
    RUNNING = 1
    # The object is held: lifting it.
    LIFTING = 2
    # The task is done: holding still.
    DONE = 3
    # Decelerating or holding because of `ControllerStatus::reason`.
    HOLDING = 4
    # Ramping down to leave.
    STOPPING = 5
    # All is well; the arm is held until somebody starts it.
    READY = 6
    # Decelerating or holding because of `ControllerStatus::reason`, until somebody resets it.
    FAULT = 7


class Reason(IntEnum):
    """Why the controller does not follow its policy, or makes no progress with it.

    Each of the former has one safe action: decelerate to rest in bounded time and hold, then fade
    in again once the cause has gone.
    """

    # It follows it.
    NONE = 0
    # No state arrives any more: the newest is older than its limit.
    STATE_STALE = 1
    # The state's sequence number went back: the publisher was restarted.
    SEQUENCE_WENT_BACK = 2
    # A number in the state is not finite.
    STATE_NOT_FINITE = 3
    # The state has another number of joints than the robot's description.
    JOINT_COUNT = 4
    # A frame the skill needs is missing or marked invalid.
    FRAME_MISSING = 5
    # A number in a frame or an obstacle is not finite.
    FRAME_NOT_FINITE = 6
    # A frame's quaternion is not of unit length.
    QUATERNION_NOT_UNIT = 7
    # An obstacle is of a kind this controller does not know, or its mark is neither 0 nor 1.
    OBSTACLE_UNKNOWN = 8
    # The newest frames are older than their limit.
    FRAMES_STALE = 9
    # The tree could not be resolved: its metric is not positive definite.
    RESOLVE_FAILED = 10
    # The policy's command was not finite.
    COMMAND_NOT_FINITE = 11
    # A signal asked for a stop.
    STOP_REQUESTED = 12
    # A measured joint position is outside the robot's description.
    JOINT_LIMIT = 13
    # Too many periods were missed in a row.
    OVERRUN = 14
    # A measured speed is far beyond the joint's limit, or a position or velocity has jumped.
    STATE_UNBELIEVABLE = 15
    # The gripper reports a state this controller does not know.
    GRIPPER_UNKNOWN = 16
    # It follows its policy, but the arm stands still before an obstacle or before itself.
    BLOCKED = 17
    # It follows its policy, but the arm stands still short of the goal.
    UNREACHABLE = 18
    # A first state has arrived; those that follow have to confirm it.
    STATE_UNCONFIRMED = 19
    # States arrive, but their sequence number does not grow.
    SEQUENCE_STUCK = 20
    # States arrive, but their time stamp does not grow.
    STATE_TIME_STUCK = 21
    # States arrive, but their time stamp is farther from the present than a state may be old:
    # another clock.
    STATE_CLOCK = 22
    # Positions change by something else than their velocities say.
    VELOCITY_UNBELIEVABLE = 23
    # Too many states in a row are missing, by their sequence numbers.
    STATES_LOST = 24
    # The loop was held up for longer than a command lives: the robot has braked on its own.
    COMMAND_EXPIRED = 25
    # The sequence number of the states went back again within a second: two sources publish.
    TWO_SOURCES = 26
    # The robot reports a protective stop.
    PROTECTIVE_STOP = 27
    # The robot reports an emergency stop.
    EMERGENCY_STOP = 28
    # The robot is guided by hand.
    HAND_GUIDING = 29
    # The robot reports a fault, or a mode that there is not.
    ROBOT_FAULT = 30
    # The robot's safety system does not permit motion.
    SAFETY_STOP = 31
    # Nobody has asked for a start yet.
    START_NOT_REQUESTED = 32
    # Somebody asked for a hold.
    HOLD_REQUESTED = 33
    # The controller before this one ended without a stop.
    ENDED_UNEXPECTEDLY = 34
    # The arm is not at rest, or not where the last commands ended.
    ARM_ELSEWHERE = 35
    # The gripper holds something that this controller did not grip.
    GRIPPER_HOLDS = 36
    # The hash of the joints' names is another one: other joints, or another order.
    JOINT_ORDER = 37
    # The arm is commanded to move, states arrive, and no position changes.
    POSITIONS_FROZEN = 38
    # The controller runs in lockstep, the publisher does not wait for its commands.
    PUBLISHER_NOT_IN_LOCKSTEP = 39
    # More frames than a message carries.
    FRAME_COUNT = 40
    # A frame is farther from the base than any arm reaches.
    FRAME_FAR = 41
    # The frame of the start is where the tool is, with its quaternion in another order.
    QUATERNION_ORDER = 42
    # More obstacles than a message carries.
    OBSTACLE_COUNT = 43
    # A size of an obstacle is zero or negative.
    OBSTACLE_SIZE = 44
    # An obstacle's quaternion is not of unit length.
    OBSTACLE_QUATERNION = 45
    # The task grips, and the state says that there is no gripper.
    GRIPPER_NONE = 46
    # It follows its policy and is at the goal, where it waits for the gripper to hold.
    GRIPPER_AWAITED = 47
    # Two sources publish the same frame, or have the same name.
    FRAME_TWICE = 48


class ObstacleKind(IntEnum):
    """Shape of an obstacle."""

    # A ball: `position` is its centre, `size0` its radius [m].
    SPHERE = 0
    # Everything below the plane through `position` whose normal is the z axis.
    HALF_SPACE = 1
    # All points within a radius of a stretch of the z axis: `size0` is the radius, `size1` the
    # length of the stretch, to which the round ends are added [m].
    CAPSULE = 2
    # A box: `size` are its edges along x, y and z [m].
    BOX = 3


class ControlVerb(IntEnum):
    """What somebody asks of a controller."""

    # Nothing: the answer tells how it is.
    STATUS = 0
    # Go on, from waiting for a start or from a hold.
    START = 1
    # Decelerate to rest and hold, until a start.
    HOLD = 2
    # Ramp down and leave.
    STOP = 3
    # Somebody has looked: forget the fault.
    RESET = 4
    # Follow the model in the file of the text.
    SWAP_MODEL = 5
    # Change the setting of the text to the value.
    SET = 6


class RobotState(ctypes.Structure):
    """The state of the robot, from a state publisher to the controller."""

    _fields_ = [
        # Counts up by one from message to message: what is missing is counted as lost.
        ("sequence", ctypes.c_uint64),
        # When the state was measured [ns].
        ("time_ns", ctypes.c_uint64),
        # Number of joints in use, the first ones of each array.
        ("joint_count", ctypes.c_uint32),
        # What the gripper senses: a `GripperState`.
        ("gripper_state", ctypes.c_uint32),
        # What the robot itself is doing: a `RobotMode`.
        ("robot_mode", ctypes.c_uint32),
        # 0 while the robot's safety system permits motion, 1 while it does not.
        ("safety_stop", ctypes.c_uint32),
        # `joint_names_hash` of the joints' names, in the order of the arrays; 0 where the publisher
        # does not say.
        ("joint_names_hash", ctypes.c_uint64),
        # Joint positions [rad or m].
        ("position", ctypes.c_double * 8),
        # Joint velocities [rad/s or m/s].
        ("velocity", ctypes.c_double * 8),
        # Measured joint torques or forces, without gravity [N m or N]; zero where not measured.
        ("torque", ctypes.c_double * 8),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "RobotStateV3"


assert ctypes.sizeof(RobotState) == 232
assert RobotState.sequence.offset == 0
assert RobotState.time_ns.offset == 8
assert RobotState.joint_count.offset == 16
assert RobotState.gripper_state.offset == 20
assert RobotState.robot_mode.offset == 24
assert RobotState.safety_stop.offset == 28
assert RobotState.joint_names_hash.offset == 32
assert RobotState.position.offset == 40
assert RobotState.velocity.offset == 104
assert RobotState.torque.offset == 168


class Frame(ctypes.Structure):
    """A named task frame in the robot's base frame `B`."""

    _fields_ = [
        # UTF-8, padded with zeros.
        ("name", ctypes.c_uint8 * 24),
        # 1 when the pose may be used, 0 when it is unknown.
        ("valid", ctypes.c_uint32),
        # Explicit padding, zero.
        ("padding", ctypes.c_uint32),
        # Origin [m].
        ("position", ctypes.c_double * 3),
        # Orientation, unit quaternion `w, x, y, z`.
        ("quaternion", ctypes.c_double * 4),
        # Velocity of the origin [m/s].
        ("linear_velocity", ctypes.c_double * 3),
        # Angular velocity, expressed in `B` [rad/s].
        ("angular_velocity", ctypes.c_double * 3),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "FrameV1"


assert ctypes.sizeof(Frame) == 136
assert Frame.name.offset == 0
assert Frame.valid.offset == 24
assert Frame.padding.offset == 28
assert Frame.position.offset == 32
assert Frame.quaternion.offset == 56
assert Frame.linear_velocity.offset == 88
assert Frame.angular_velocity.offset == 112


class Obstacle(ctypes.Structure):
    """A moving obstacle in the robot's base frame `B`."""

    _fields_ = [
        # What `size` means: an `ObstacleKind`.
        ("kind", ctypes.c_uint32),
        # 1 when the obstacle is there, 0 when it is not. One that is not measured any more is still
        # there: publish its last pose.
        ("valid", ctypes.c_uint32),
        # Centre; of a half-space, a point on its surface [m].
        ("position", ctypes.c_double * 3),
        # Orientation, unit quaternion `w, x, y, z`.
        ("quaternion", ctypes.c_double * 4),
        # Velocity of `position` [m/s].
        ("linear_velocity", ctypes.c_double * 3),
        # Angular velocity, expressed in `B` [rad/s].
        ("angular_velocity", ctypes.c_double * 3),
        # What it is depends on the kind; the rest is unused [m].
        ("size", ctypes.c_double * 3),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "ObstacleV2"


assert ctypes.sizeof(Obstacle) == 136
assert Obstacle.kind.offset == 0
assert Obstacle.valid.offset == 4
assert Obstacle.position.offset == 8
assert Obstacle.quaternion.offset == 32
assert Obstacle.linear_velocity.offset == 64
assert Obstacle.angular_velocity.offset == 88
assert Obstacle.size.offset == 112


class TaskFrames(ctypes.Structure):
    """The task parameters: frames and obstacles, from their sources to the controller.

    A state publisher may be the only source, or one of several.
    """

    _fields_ = [
        # Counts up by at least one from message to message.
        ("sequence", ctypes.c_uint64),
        # When the frames were measured [ns], on the clock of `RobotState::time_ns`.
        ("time_ns", ctypes.c_uint64),
        # Name of the source, UTF-8, padded with zeros: each of several has one of its own. A state
        # publisher may leave it empty.
        ("source", ctypes.c_uint8 * 24),
        # Number of frames in use, the first ones of the array.
        ("frame_count", ctypes.c_uint32),
        # Number of obstacles in use, the first ones of the array.
        ("obstacle_count", ctypes.c_uint32),
        # Named frames.
        ("frames", Frame * 8),
        # Obstacles.
        ("obstacles", Obstacle * 32),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "TaskFramesV3"


assert ctypes.sizeof(TaskFrames) == 5488
assert TaskFrames.sequence.offset == 0
assert TaskFrames.time_ns.offset == 8
assert TaskFrames.source.offset == 16
assert TaskFrames.frame_count.offset == 40
assert TaskFrames.obstacle_count.offset == 44
assert TaskFrames.frames.offset == 48
assert TaskFrames.obstacles.offset == 1136


class JointCommand(ctypes.Structure):
    """What the controller wants the robot to do, from the controller to the robot.

    A torque interface applies `torque + gravity_torque` (an arm that adds gravity itself only
    `torque`); a velocity or position interface uses `velocity` or `position`. After `expiry_ns` the
    command must no longer be obeyed: the robot brakes. `CommandGuard` knows when.
    """

    _fields_ = [
        # Counts up by one from message to message.
        ("sequence", ctypes.c_uint64),
        # `RobotState::sequence` of the state this command answers.
        ("state_sequence", ctypes.c_uint64),
        # When the command was computed [ns]; in lockstep, the state's time.
        ("time_ns", ctypes.c_uint64),
        # When the command expires [ns].
        ("expiry_ns", ctypes.c_uint64),
        # A `CommandMode`.
        ("mode", ctypes.c_uint32),
        # A `GripperCommand`.
        ("gripper_command", ctypes.c_uint32),
        # Number of joints in use, the first ones of each array.
        ("joint_count", ctypes.c_uint32),
        # A `Reason`: why the controller does not follow its policy, or makes no progress with it.
        ("reason", ctypes.c_uint32),
        # Desired positions, integrated [rad or m].
        ("position", ctypes.c_double * 8),
        # Desired velocities, integrated [rad/s or m/s].
        ("velocity", ctypes.c_double * 8),
        # Desired accelerations [rad/s² or m/s²].
        ("acceleration", ctypes.c_double * 8),
        # Joint torques or forces without gravity [N m or N].
        ("torque", ctypes.c_double * 8),
        # Joint torques or forces that hold the arm against gravity [N m or N].
        ("gravity_torque", ctypes.c_double * 8),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "JointCommandV1"


assert ctypes.sizeof(JointCommand) == 368
assert JointCommand.sequence.offset == 0
assert JointCommand.state_sequence.offset == 8
assert JointCommand.time_ns.offset == 16
assert JointCommand.expiry_ns.offset == 24
assert JointCommand.mode.offset == 32
assert JointCommand.gripper_command.offset == 36
assert JointCommand.joint_count.offset == 40
assert JointCommand.reason.offset == 44
assert JointCommand.position.offset == 48
assert JointCommand.velocity.offset == 112
assert JointCommand.acceleration.offset == 176
assert JointCommand.torque.offset == 240
assert JointCommand.gravity_torque.offset == 304


class ToolCommand(ctypes.Structure):
    """A desired velocity of the tool: from teleoperation, hand guiding or another planner, to a
    controller whose configuration listens.

    It acts beside the skill and is no state: one that is faulty, or older than the controller
    permits, is ignored. Zeros ask for a tool at rest; to let go, stop publishing.
    """

    _fields_ = [
        # Counts up by at least one from message to message; a publisher that begins while no other
        # command is fresh may begin anywhere.
        ("sequence", ctypes.c_uint64),
        # When the command was given [ns], on the clock of `RobotState::time_ns`.
        ("time_ns", ctypes.c_uint64),
        # Velocity of the tool's origin, expressed in `B` [m/s].
        ("linear_velocity", ctypes.c_double * 3),
        # Angular velocity of the tool, expressed in `B` [rad/s].
        ("angular_velocity", ctypes.c_double * 3),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "ToolCommandV1"


assert ctypes.sizeof(ToolCommand) == 64
assert ToolCommand.sequence.offset == 0
assert ToolCommand.time_ns.offset == 8
assert ToolCommand.linear_velocity.offset == 16
assert ToolCommand.angular_velocity.offset == 40


class ControllerStatus(ctypes.Structure):
    """How the controller is doing, once a tick or every few."""

    _fields_ = [
        # Counts up by one from message to message.
        ("sequence", ctypes.c_uint64),
        # When the tick ended [ns].
        ("time_ns", ctypes.c_uint64),
        # A `LifeCycle`.
        ("life_cycle", ctypes.c_uint32),
        # A `Reason`.
        ("reason", ctypes.c_uint32),
        # Ticks so far.
        ("ticks", ctypes.c_uint64),
        # Ticks that ended after their deadline or came after skipped periods, so far.
        ("deadline_misses", ctypes.c_uint64),
        # Periods that passed without a tick, so far.
        ("skipped_periods", ctypes.c_uint64),
        # States that are missing between those that arrived, by their numbers, so far.
        ("states_lost", ctypes.c_uint64),
        # Heap allocations inside the loop, so far, without those of `connections`.
        ("allocations", ctypes.c_uint64),
        # How often a new peer had to be connected to inside the loop, so far.
        ("connections", ctypes.c_uint64),
        # Period of the loop [ns].
        ("period_ns", ctypes.c_uint64),
        # How late the last tick woke up [ns].
        ("wake_up_ns", ctypes.c_uint64),
        # Age of the state the last tick used [ns].
        ("state_age_ns", ctypes.c_uint64),
        # Time the last tick took to receive its messages [ns].
        ("receiving_ns", ctypes.c_uint64),
        # Time the last tick took for checks, policy and limits [ns].
        ("evaluation_ns", ctypes.c_uint64),
        # Time the last tick took to publish its command [ns].
        ("publishing_ns", ctypes.c_uint64),
        # Distance of the tool from the goal [m].
        ("goal_distance_m", ctypes.c_double),
        # Angle of the tool from the goal [rad].
        ("goal_angle_rad", ctypes.c_double),
        # Lyapunov value Φ + ½ ẏᵀMẏ of the skill in canonical coordinates [J].
        ("energy_j", ctypes.c_double),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "ControllerStatusV3"


assert ctypes.sizeof(ControllerStatus) == 144
assert ControllerStatus.sequence.offset == 0
assert ControllerStatus.time_ns.offset == 8
assert ControllerStatus.life_cycle.offset == 16
assert ControllerStatus.reason.offset == 20
assert ControllerStatus.ticks.offset == 24
assert ControllerStatus.deadline_misses.offset == 32
assert ControllerStatus.skipped_periods.offset == 40
assert ControllerStatus.states_lost.offset == 48
assert ControllerStatus.allocations.offset == 56
assert ControllerStatus.connections.offset == 64
assert ControllerStatus.period_ns.offset == 72
assert ControllerStatus.wake_up_ns.offset == 80
assert ControllerStatus.state_age_ns.offset == 88
assert ControllerStatus.receiving_ns.offset == 96
assert ControllerStatus.evaluation_ns.offset == 104
assert ControllerStatus.publishing_ns.offset == 112
assert ControllerStatus.goal_distance_m.offset == 120
assert ControllerStatus.goal_angle_rad.offset == 128
assert ControllerStatus.energy_j.offset == 136


class ControlRequest(ctypes.Structure):
    """A request."""

    _fields_ = [
        # A `ControlVerb`.
        ("verb", ctypes.c_uint32),
        # Explicit padding, zero.
        ("padding", ctypes.c_uint32),
        # For `ControlVerb::Set`, in the unit of the setting.
        ("value", ctypes.c_double),
        # The path of a model, or the name of a setting.
        ("text", ctypes.c_uint8 * 1000),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "ControlRequestV1"


assert ctypes.sizeof(ControlRequest) == 1016
assert ControlRequest.verb.offset == 0
assert ControlRequest.padding.offset == 4
assert ControlRequest.value.offset == 8
assert ControlRequest.text.offset == 16


class ControlAnswer(ctypes.Structure):
    """An answer."""

    _fields_ = [
        # 1 when the request was taken, 0 when it was refused.
        ("accepted", ctypes.c_uint32),
        # A `LifeCycle`.
        ("life_cycle", ctypes.c_uint32),
        # A `Reason`.
        ("reason", ctypes.c_uint32),
        # Explicit padding, zero.
        ("padding", ctypes.c_uint32),
        # For people: what was done, or why it was not.
        ("text", ctypes.c_uint8 * 1000),
    ]

    @staticmethod
    def type_name() -> str:
        """Name on the wire."""
        return "ControlAnswerV1"


assert ctypes.sizeof(ControlAnswer) == 1016
assert ControlAnswer.accepted.offset == 0
assert ControlAnswer.life_cycle.offset == 4
assert ControlAnswer.reason.offset == 8
assert ControlAnswer.padding.offset == 12
assert ControlAnswer.text.offset == 16
