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

    NONE = 0  # No gripper, or nothing sensed.
    OPEN = 1  # The gripper is open or its vacuum is off.
    HOLDING = 2  # The gripper holds an object.


class RobotMode(IntEnum):
    """What the robot itself is doing."""

    RUNNING = 0  # It obeys commands.
    PROTECTIVE_STOP = 1  # Its own protective stop: it brakes, or stands still.
    EMERGENCY_STOP = 2  # Its emergency stop.
    HAND_GUIDING = 3  # It is guided by hand.
    FAULT = 4  # It reports a fault.


class GripperCommand(IntEnum):
    """What the gripper should do."""

    RELEASE = 0  # Open, vacuum off.
    GRIP = 1  # Close, vacuum on.


class CommandMode(IntEnum):
    """What kind of command this is."""

    # No motion: brake, whatever the other fields say. Sent as a last command, and while there is no
    # state to move from.
    STOP = 0
    TRACK = 1  # Follow the policy.
    HOLD = 2  # Decelerate and hold, for the reason given.


class LifeCycle(IntEnum):
    """The controller's life cycle: `controller/LIFECYCLE.md` has every transition."""

    WAITING = 0  # Waiting for a first valid state and valid frames.
    RUNNING = 1  # Following the skill.
    LIFTING = 2  # The object is held: lifting it.
    DONE = 3  # The task is done: holding still.
    HOLDING = 4  # Decelerating or holding because of `ControllerStatus::reason`.
    STOPPING = 5  # Ramping down to leave.
    READY = 6  # All is well; the arm is held until somebody starts it.
    # Decelerating or holding because of `ControllerStatus::reason`, until somebody resets it.
    FAULT = 7


class Reason(IntEnum):
    """Why the controller does not follow its policy, or makes no progress with it.

    Each of the former has one safe action: decelerate to rest in bounded time and hold, then fade
    in again once the cause has gone.
    """

    NONE = 0  # It follows it.
    STATE_STALE = 1  # No state arrives any more: the newest is older than its limit.
    SEQUENCE_WENT_BACK = 2  # The state's sequence number went back: the publisher was restarted.
    STATE_NOT_FINITE = 3  # A number in the state is not finite.
    JOINT_COUNT = 4  # The state has another number of joints than the robot's description.
    FRAME_MISSING = 5  # A frame the skill needs is missing or marked invalid.
    FRAME_NOT_FINITE = 6  # A number in a frame or an obstacle is not finite.
    QUATERNION_NOT_UNIT = 7  # A frame's quaternion is not of unit length.
    # An obstacle is of a kind this controller does not know, or its mark is neither 0 nor 1.
    OBSTACLE_UNKNOWN = 8
    FRAMES_STALE = 9  # The newest frames are older than their limit.
    RESOLVE_FAILED = 10  # The tree could not be resolved: its metric is not positive definite.
    COMMAND_NOT_FINITE = 11  # The policy's command was not finite.
    STOP_REQUESTED = 12  # A signal asked for a stop.
    JOINT_LIMIT = 13  # A measured joint position is outside the robot's description.
    OVERRUN = 14  # Too many periods were missed in a row.
    # A measured speed is far beyond the joint's limit, or a position or velocity has jumped.
    STATE_UNBELIEVABLE = 15
    GRIPPER_UNKNOWN = 16  # The gripper reports a state this controller does not know.
    # It follows its policy, but the arm stands still before an obstacle or before itself.
    BLOCKED = 17
    UNREACHABLE = 18  # It follows its policy, but the arm stands still short of the goal.
    STATE_UNCONFIRMED = 19  # A first state has arrived; those that follow have to confirm it.
    SEQUENCE_STUCK = 20  # States arrive, but their sequence number does not grow.
    STATE_TIME_STUCK = 21  # States arrive, but their time stamp does not grow.
    # States arrive, but their time stamp is farther from the present than a state may be old:
    # another clock.
    STATE_CLOCK = 22
    VELOCITY_UNBELIEVABLE = 23  # Positions change by something else than their velocities say.
    STATES_LOST = 24  # Too many states in a row are missing, by their sequence numbers.
    # The loop was held up for longer than a command lives: the robot has braked on its own.
    COMMAND_EXPIRED = 25
    # The sequence number of the states went back again within a second: two sources publish.
    TWO_SOURCES = 26
    PROTECTIVE_STOP = 27  # The robot reports a protective stop.
    EMERGENCY_STOP = 28  # The robot reports an emergency stop.
    HAND_GUIDING = 29  # The robot is guided by hand.
    ROBOT_FAULT = 30  # The robot reports a fault, or a mode that there is not.
    SAFETY_STOP = 31  # The robot's safety system does not permit motion.
    START_NOT_REQUESTED = 32  # Nobody has asked for a start yet.
    HOLD_REQUESTED = 33  # Somebody asked for a hold.
    ENDED_UNEXPECTEDLY = 34  # The controller before this one ended without a stop.
    ARM_ELSEWHERE = 35  # The arm is not at rest, or not where the last commands ended.
    GRIPPER_HOLDS = 36  # The gripper holds something that this controller did not grip.
    # The hash of the joints' names is another one: other joints, or another order.
    JOINT_ORDER = 37
    POSITIONS_FROZEN = 38  # The arm is commanded to move, states arrive, and no position changes.
    # The controller runs in lockstep, the publisher does not wait for its commands.
    PUBLISHER_NOT_IN_LOCKSTEP = 39
    FRAME_COUNT = 40  # More frames than a message carries.
    FRAME_FAR = 41  # A frame is farther from the base than any arm reaches.
    # The frame of the start is where the tool is, with its quaternion in another order.
    QUATERNION_ORDER = 42
    OBSTACLE_COUNT = 43  # More obstacles than a message carries.
    OBSTACLE_SIZE = 44  # A size of an obstacle is zero or negative.
    OBSTACLE_QUATERNION = 45  # An obstacle's quaternion is not of unit length.
    GRIPPER_NONE = 46  # The task grips, and the state says that there is no gripper.
    # It follows its policy and is at the goal, where it waits for the gripper to hold.
    GRIPPER_AWAITED = 47
    FRAME_TWICE = 48  # Two sources publish the same frame, or have the same name.
    # A joint that is a little outside its position limits is moved back, slowly.
    JOINT_RETURNING = 49
    # The start frame is published, and the tool that starts there is elsewhere.
    START_ELSEWHERE = 50


class ObstacleKind(IntEnum):
    """Shape of an obstacle."""

    SPHERE = 0  # A ball: `position` is its centre, `size[0]` its radius [m].
    HALF_SPACE = 1  # Everything below the plane through `position` whose normal is the z axis.
    # All points within a radius of a stretch of the z axis: `size[0]` is the radius, `size[1]` the
    # length of the stretch, to which the round ends are added [m].
    CAPSULE = 2
    BOX = 3  # A box: `size` are its edges along x, y and z [m].


class ControlVerb(IntEnum):
    """What somebody asks of a controller."""

    STATUS = 0  # Nothing: the answer tells how it is.
    START = 1  # Go on, from waiting for a start or from a hold.
    HOLD = 2  # Decelerate to rest and hold, until a start.
    STOP = 3  # Ramp down and leave.
    RESET = 4  # Somebody has looked: forget the fault.
    SWAP_MODEL = 5  # Follow the model in the file of the text.
    SET = 6  # Change the setting of the text to the value.


class RobotState(ctypes.Structure):
    """The state of the robot, from a state publisher to the controller."""

    _fields_ = [
        # Counts up by one from message to message: what is missing is counted as lost.
        ("sequence", ctypes.c_uint64),
        ("time_ns", ctypes.c_uint64),  # When the state was measured [ns].
        ("joint_count", ctypes.c_uint32),  # Number of joints in use, the first ones of each array.
        ("gripper_state", ctypes.c_uint32),  # What the gripper senses: a `GripperState`.
        ("robot_mode", ctypes.c_uint32),  # What the robot itself is doing: a `RobotMode`.
        # 0 while the robot's safety system permits motion, 1 while it does not.
        ("safety_stop", ctypes.c_uint32),
        # `joint_names_hash` of the joints' names, in the order of the arrays; 0 where the publisher
        # does not say.
        ("joint_names_hash", ctypes.c_uint64),
        ("position", ctypes.c_double * 8),  # Joint positions [rad or m].
        ("velocity", ctypes.c_double * 8),  # Joint velocities [rad/s or m/s].
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
        ("name", ctypes.c_uint8 * 24),  # UTF-8, padded with zeros.
        ("valid", ctypes.c_uint32),  # 1 when the pose may be used, 0 when it is unknown.
        ("padding", ctypes.c_uint32),  # Explicit padding, zero.
        ("position", ctypes.c_double * 3),  # Origin [m].
        ("quaternion", ctypes.c_double * 4),  # Orientation, unit quaternion `w, x, y, z`.
        ("linear_velocity", ctypes.c_double * 3),  # Velocity of the origin [m/s].
        ("angular_velocity", ctypes.c_double * 3),  # Angular velocity, expressed in `B` [rad/s].
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
        ("kind", ctypes.c_uint32),  # What `size` means: an `ObstacleKind`.
        # 1 when the obstacle is there, 0 when it is not. One that is not measured any more is still
        # there: publish its last pose.
        ("valid", ctypes.c_uint32),
        ("position", ctypes.c_double * 3),  # Centre; of a half-space, a point on its surface [m].
        ("quaternion", ctypes.c_double * 4),  # Orientation, unit quaternion `w, x, y, z`.
        ("linear_velocity", ctypes.c_double * 3),  # Velocity of `position` [m/s].
        ("angular_velocity", ctypes.c_double * 3),  # Angular velocity, expressed in `B` [rad/s].
        ("size", ctypes.c_double * 3),  # What it is depends on the kind; the rest is unused [m].
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
        ("sequence", ctypes.c_uint64),  # Counts up by at least one from message to message.
        # When the frames were measured [ns], on the clock of `RobotState::time_ns`.
        ("time_ns", ctypes.c_uint64),
        # Name of the source, UTF-8, padded with zeros: each of several has one of its own. A state
        # publisher may leave it empty.
        ("source", ctypes.c_uint8 * 24),
        ("frame_count", ctypes.c_uint32),  # Number of frames in use, the first ones of the array.
        # Number of obstacles in use, the first ones of the array.
        ("obstacle_count", ctypes.c_uint32),
        ("frames", Frame * 8),  # Named frames.
        ("obstacles", Obstacle * 32),  # Obstacles.
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
        ("sequence", ctypes.c_uint64),  # Counts up by one from message to message.
        # `RobotState::sequence` of the state this command answers.
        ("state_sequence", ctypes.c_uint64),
        # When the command was computed [ns]; in lockstep, the state's time.
        ("time_ns", ctypes.c_uint64),
        ("expiry_ns", ctypes.c_uint64),  # When the command expires [ns].
        ("mode", ctypes.c_uint32),  # A `CommandMode`.
        ("gripper_command", ctypes.c_uint32),  # A `GripperCommand`.
        ("joint_count", ctypes.c_uint32),  # Number of joints in use, the first ones of each array.
        # A `Reason`: why the controller does not follow its policy, or makes no progress with it.
        ("reason", ctypes.c_uint32),
        ("position", ctypes.c_double * 8),  # Desired positions, integrated [rad or m].
        ("velocity", ctypes.c_double * 8),  # Desired velocities, integrated [rad/s or m/s].
        ("acceleration", ctypes.c_double * 8),  # Desired accelerations [rad/s² or m/s²].
        ("torque", ctypes.c_double * 8),  # Joint torques or forces without gravity [N m or N].
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
    """A desired velocity of the tool: from teleoperation, hand guiding or another planner.

    It is for a controller whose configuration listens. It acts beside the skill and is no state:
    one that is faulty, or older than the controller permits, is ignored. Zeros ask for a tool at
    rest; to let go, stop publishing.
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
        ("sequence", ctypes.c_uint64),  # Counts up by one from message to message.
        ("time_ns", ctypes.c_uint64),  # When the tick ended [ns].
        ("life_cycle", ctypes.c_uint32),  # A `LifeCycle`.
        ("reason", ctypes.c_uint32),  # A `Reason`.
        ("ticks", ctypes.c_uint64),  # Ticks so far.
        # Ticks that ended after their deadline or came after skipped periods, so far.
        ("deadline_misses", ctypes.c_uint64),
        ("skipped_periods", ctypes.c_uint64),  # Periods that passed without a tick, so far.
        # States that are missing between those that arrived, by their numbers, so far.
        ("states_lost", ctypes.c_uint64),
        # Heap allocations inside the loop, so far, without those of `connections`.
        ("allocations", ctypes.c_uint64),
        # How often a new peer had to be connected to inside the loop, so far.
        ("connections", ctypes.c_uint64),
        ("period_ns", ctypes.c_uint64),  # Period of the loop [ns].
        ("wake_up_ns", ctypes.c_uint64),  # How late the last tick woke up [ns].
        ("state_age_ns", ctypes.c_uint64),  # Age of the state the last tick used [ns].
        ("receiving_ns", ctypes.c_uint64),  # Time the last tick took to receive its messages [ns].
        # Time the last tick took for checks, policy and limits [ns].
        ("evaluation_ns", ctypes.c_uint64),
        ("publishing_ns", ctypes.c_uint64),  # Time the last tick took to publish its command [ns].
        ("goal_distance_m", ctypes.c_double),  # Distance of the tool from the goal [m].
        ("goal_angle_rad", ctypes.c_double),  # Angle of the tool from the goal [rad].
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
        ("verb", ctypes.c_uint32),  # A `ControlVerb`.
        ("padding", ctypes.c_uint32),  # Explicit padding, zero.
        ("value", ctypes.c_double),  # For `ControlVerb::Set`, in the unit of the setting.
        ("text", ctypes.c_uint8 * 1000),  # The path of a model, or the name of a setting.
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
        ("accepted", ctypes.c_uint32),  # 1 when the request was taken, 0 when it was refused.
        ("life_cycle", ctypes.c_uint32),  # A `LifeCycle`.
        ("reason", ctypes.c_uint32),  # A `Reason`.
        ("padding", ctypes.c_uint32),  # Explicit padding, zero.
        ("text", ctypes.c_uint8 * 1000),  # For people: what was done, or why it was not.
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
