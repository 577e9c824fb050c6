/* The messages of tprmp. Made by `controller layout --format c`: do not edit.
 *
 * SI units, quaternions w x y z, poses and velocities in the robot's base frame, times in ns on
 * CLOCK_MONOTONIC. Names are UTF-8, padded with zeros. */
#ifndef TPRMP_MESSAGES_H
#define TPRMP_MESSAGES_H

#include <assert.h>
#include <stddef.h>
#include <stdint.h>

/* Versions of iceoryx2 do not talk to each other. */
#define TPRMP_ICEORYX2_VERSION "0.9.3"
/* Names of an instance's files in /dev/shm begin so. */
#define TPRMP_PREFIX "tprmp_<user id>_<instance>_"
#define TPRMP_ROOT "/tmp/tprmp-<user id>/<instance>/"

#define TPRMP_JOINT_CAPACITY 8
#define TPRMP_FRAME_CAPACITY 8
#define TPRMP_OBSTACLE_CAPACITY 32
#define TPRMP_NAME_CAPACITY 24
#define TPRMP_TEXT_CAPACITY 1000
#define TPRMP_FRAME_SOURCES_MAX 8
#define TPRMP_STATE_BUFFER 16
#define TPRMP_OBSERVER_BUFFER 256

/* Of RobotStateV3, from the state publisher to the controller. */
#define TPRMP_SERVICE_ROBOT_STATE "<instance>/robot_state/v1"
#define TPRMP_SERVICE_ROBOT_STATE_MAX_PUBLISHERS 1
#define TPRMP_SERVICE_ROBOT_STATE_MAX_SUBSCRIBERS 8
#define TPRMP_SERVICE_ROBOT_STATE_MAX_NODES 16
#define TPRMP_SERVICE_ROBOT_STATE_HISTORY_SIZE 1
#define TPRMP_SERVICE_ROBOT_STATE_SUBSCRIBER_MAX_BUFFER_SIZE 256
#define TPRMP_SERVICE_ROBOT_STATE_ENABLE_SAFE_OVERFLOW 1

/* Of TaskFramesV3, from the state publisher and other sources of frames to the controller. */
#define TPRMP_SERVICE_TASK_FRAMES "<instance>/task_frames/v1"
#define TPRMP_SERVICE_TASK_FRAMES_MAX_PUBLISHERS 8
#define TPRMP_SERVICE_TASK_FRAMES_MAX_SUBSCRIBERS 8
#define TPRMP_SERVICE_TASK_FRAMES_MAX_NODES 16
#define TPRMP_SERVICE_TASK_FRAMES_HISTORY_SIZE 1
#define TPRMP_SERVICE_TASK_FRAMES_SUBSCRIBER_MAX_BUFFER_SIZE 1
#define TPRMP_SERVICE_TASK_FRAMES_ENABLE_SAFE_OVERFLOW 1

/* Of JointCommandV1, from the controller to the robot. */
#define TPRMP_SERVICE_JOINT_COMMAND "<instance>/joint_command/v1"
#define TPRMP_SERVICE_JOINT_COMMAND_MAX_PUBLISHERS 1
#define TPRMP_SERVICE_JOINT_COMMAND_MAX_SUBSCRIBERS 8
#define TPRMP_SERVICE_JOINT_COMMAND_MAX_NODES 16
#define TPRMP_SERVICE_JOINT_COMMAND_HISTORY_SIZE 1
#define TPRMP_SERVICE_JOINT_COMMAND_SUBSCRIBER_MAX_BUFFER_SIZE 1
#define TPRMP_SERVICE_JOINT_COMMAND_ENABLE_SAFE_OVERFLOW 1

/* Of ControllerStatusV3, from the controller to anyone. */
#define TPRMP_SERVICE_CONTROLLER_STATUS "<instance>/controller_status/v1"
#define TPRMP_SERVICE_CONTROLLER_STATUS_MAX_PUBLISHERS 1
#define TPRMP_SERVICE_CONTROLLER_STATUS_MAX_SUBSCRIBERS 8
#define TPRMP_SERVICE_CONTROLLER_STATUS_MAX_NODES 16
#define TPRMP_SERVICE_CONTROLLER_STATUS_HISTORY_SIZE 1
#define TPRMP_SERVICE_CONTROLLER_STATUS_SUBSCRIBER_MAX_BUFFER_SIZE 256
#define TPRMP_SERVICE_CONTROLLER_STATUS_ENABLE_SAFE_OVERFLOW 1

/* Of ToolCommandV1, from whoever commands the tool to the controller. */
#define TPRMP_SERVICE_TOOL_COMMAND "<instance>/tool_command/v1"
#define TPRMP_SERVICE_TOOL_COMMAND_MAX_PUBLISHERS 1
#define TPRMP_SERVICE_TOOL_COMMAND_MAX_SUBSCRIBERS 8
#define TPRMP_SERVICE_TOOL_COMMAND_MAX_NODES 16
#define TPRMP_SERVICE_TOOL_COMMAND_HISTORY_SIZE 1
#define TPRMP_SERVICE_TOOL_COMMAND_SUBSCRIBER_MAX_BUFFER_SIZE 1
#define TPRMP_SERVICE_TOOL_COMMAND_ENABLE_SAFE_OVERFLOW 1

/* What the gripper senses. */
typedef enum tprmp_gripper_state {
    /* No gripper, or nothing sensed. */
    TPRMP_GRIPPER_STATE_NONE = 0,
    /* The gripper is open or its vacuum is off. */
    TPRMP_GRIPPER_STATE_OPEN = 1,
    /* The gripper holds an object. */
    TPRMP_GRIPPER_STATE_HOLDING = 2,
} tprmp_gripper_state;

/* What the robot itself is doing. */
typedef enum tprmp_robot_mode {
    /* It obeys commands. */
    TPRMP_ROBOT_MODE_RUNNING = 0,
    /* Its own protective stop: it brakes, or stands still. */
    TPRMP_ROBOT_MODE_PROTECTIVE_STOP = 1,
    /* Its emergency stop. */
    TPRMP_ROBOT_MODE_EMERGENCY_STOP = 2,
    /* It is guided by hand. */
    TPRMP_ROBOT_MODE_HAND_GUIDING = 3,
    /* It reports a fault. */
    TPRMP_ROBOT_MODE_FAULT = 4,
} tprmp_robot_mode;

/* What the gripper should do. */
typedef enum tprmp_gripper_command {
    /* Open, vacuum off. */
    TPRMP_GRIPPER_COMMAND_RELEASE = 0,
    /* Close, vacuum on. */
    TPRMP_GRIPPER_COMMAND_GRIP = 1,
} tprmp_gripper_command;

/* What kind of command this is. */
typedef enum tprmp_command_mode {
    /* No motion: brake, whatever the other fields say. Sent as a last command, and while there
     * is no state to move from. */
    TPRMP_COMMAND_MODE_STOP = 0,
    /* Follow the policy. */
    TPRMP_COMMAND_MODE_TRACK = 1,
    /* Decelerate and hold, for the reason given. */
    TPRMP_COMMAND_MODE_HOLD = 2,
} tprmp_command_mode;

/* The controller's life cycle: `controller/LIFECYCLE.md` has every transition. */
typedef enum tprmp_life_cycle {
    /* Waiting for a first valid state and valid frames. */
    TPRMP_LIFE_CYCLE_WAITING = 0,
    /* Following the skill. */
    TPRMP_LIFE_CYCLE_RUNNING = 1,
    /* The object is held: lifting it. */
    TPRMP_LIFE_CYCLE_LIFTING = 2,
    /* The task is done: holding still. */
    TPRMP_LIFE_CYCLE_DONE = 3,
    /* Decelerating or holding because of `ControllerStatus::reason`. */
    TPRMP_LIFE_CYCLE_HOLDING = 4,
    /* Ramping down to leave. */
    TPRMP_LIFE_CYCLE_STOPPING = 5,
    /* All is well; the arm is held until somebody starts it. */
    TPRMP_LIFE_CYCLE_READY = 6,
    /* Decelerating or holding because of `ControllerStatus::reason`, until somebody resets it. */
    TPRMP_LIFE_CYCLE_FAULT = 7,
} tprmp_life_cycle;

/* Why the controller does not follow its policy, or makes no progress with it. Each of the
 * former has one safe action: decelerate to rest in bounded time and hold, then fade in again
 * once the cause has gone. */
typedef enum tprmp_reason {
    /* It follows it. */
    TPRMP_REASON_NONE = 0,
    /* No state arrives any more: the newest is older than its limit. */
    TPRMP_REASON_STATE_STALE = 1,
    /* The state's sequence number went back: the publisher was restarted. */
    TPRMP_REASON_SEQUENCE_WENT_BACK = 2,
    /* A number in the state is not finite. */
    TPRMP_REASON_STATE_NOT_FINITE = 3,
    /* The state has another number of joints than the robot's description. */
    TPRMP_REASON_JOINT_COUNT = 4,
    /* A frame the skill needs is missing or marked invalid. */
    TPRMP_REASON_FRAME_MISSING = 5,
    /* A number in a frame or an obstacle is not finite. */
    TPRMP_REASON_FRAME_NOT_FINITE = 6,
    /* A frame's quaternion is not of unit length. */
    TPRMP_REASON_QUATERNION_NOT_UNIT = 7,
    /* An obstacle is of a kind this controller does not know, or its mark is neither 0 nor 1. */
    TPRMP_REASON_OBSTACLE_UNKNOWN = 8,
    /* The newest frames are older than their limit. */
    TPRMP_REASON_FRAMES_STALE = 9,
    /* The tree could not be resolved: its metric is not positive definite. */
    TPRMP_REASON_RESOLVE_FAILED = 10,
    /* The policy's command was not finite. */
    TPRMP_REASON_COMMAND_NOT_FINITE = 11,
    /* A signal asked for a stop. */
    TPRMP_REASON_STOP_REQUESTED = 12,
    /* A measured joint position is outside the robot's description. */
    TPRMP_REASON_JOINT_LIMIT = 13,
    /* Too many periods were missed in a row. */
    TPRMP_REASON_OVERRUN = 14,
    /* A measured speed is far beyond the joint's limit, or a position or velocity has jumped. */
    TPRMP_REASON_STATE_UNBELIEVABLE = 15,
    /* The gripper reports a state this controller does not know. */
    TPRMP_REASON_GRIPPER_UNKNOWN = 16,
    /* It follows its policy, but the arm stands still before an obstacle or before itself. */
    TPRMP_REASON_BLOCKED = 17,
    /* It follows its policy, but the arm stands still short of the goal. */
    TPRMP_REASON_UNREACHABLE = 18,
    /* A first state has arrived; those that follow have to confirm it. */
    TPRMP_REASON_STATE_UNCONFIRMED = 19,
    /* States arrive, but their sequence number does not grow. */
    TPRMP_REASON_SEQUENCE_STUCK = 20,
    /* States arrive, but their time stamp does not grow. */
    TPRMP_REASON_STATE_TIME_STUCK = 21,
    /* States arrive, but their time stamp is farther from the present than a state may be old:
     * another clock. */
    TPRMP_REASON_STATE_CLOCK = 22,
    /* Positions change by something else than their velocities say. */
    TPRMP_REASON_VELOCITY_UNBELIEVABLE = 23,
    /* Too many states in a row are missing, by their sequence numbers. */
    TPRMP_REASON_STATES_LOST = 24,
    /* The loop was held up for longer than a command lives: the robot has braked on its own. */
    TPRMP_REASON_COMMAND_EXPIRED = 25,
    /* The sequence number of the states went back again within a second: two sources publish. */
    TPRMP_REASON_TWO_SOURCES = 26,
    /* The robot reports a protective stop. */
    TPRMP_REASON_PROTECTIVE_STOP = 27,
    /* The robot reports an emergency stop. */
    TPRMP_REASON_EMERGENCY_STOP = 28,
    /* The robot is guided by hand. */
    TPRMP_REASON_HAND_GUIDING = 29,
    /* The robot reports a fault, or a mode that there is not. */
    TPRMP_REASON_ROBOT_FAULT = 30,
    /* The robot's safety system does not permit motion. */
    TPRMP_REASON_SAFETY_STOP = 31,
    /* Nobody has asked for a start yet. */
    TPRMP_REASON_START_NOT_REQUESTED = 32,
    /* Somebody asked for a hold. */
    TPRMP_REASON_HOLD_REQUESTED = 33,
    /* The controller before this one ended without a stop. */
    TPRMP_REASON_ENDED_UNEXPECTEDLY = 34,
    /* The arm is not at rest, or not where the last commands ended. */
    TPRMP_REASON_ARM_ELSEWHERE = 35,
    /* The gripper holds something that this controller did not grip. */
    TPRMP_REASON_GRIPPER_HOLDS = 36,
    /* The hash of the joints' names is another one: other joints, or another order. */
    TPRMP_REASON_JOINT_ORDER = 37,
    /* The arm is commanded to move, states arrive, and no position changes. */
    TPRMP_REASON_POSITIONS_FROZEN = 38,
    /* The controller runs in lockstep, the publisher does not wait for its commands. */
    TPRMP_REASON_PUBLISHER_NOT_IN_LOCKSTEP = 39,
    /* More frames than a message carries. */
    TPRMP_REASON_FRAME_COUNT = 40,
    /* A frame is farther from the base than any arm reaches. */
    TPRMP_REASON_FRAME_FAR = 41,
    /* The frame of the start is where the tool is, with its quaternion in another order. */
    TPRMP_REASON_QUATERNION_ORDER = 42,
    /* More obstacles than a message carries. */
    TPRMP_REASON_OBSTACLE_COUNT = 43,
    /* A size of an obstacle is zero or negative. */
    TPRMP_REASON_OBSTACLE_SIZE = 44,
    /* An obstacle's quaternion is not of unit length. */
    TPRMP_REASON_OBSTACLE_QUATERNION = 45,
    /* The task grips, and the state says that there is no gripper. */
    TPRMP_REASON_GRIPPER_NONE = 46,
    /* It follows its policy and is at the goal, where it waits for the gripper to hold. */
    TPRMP_REASON_GRIPPER_AWAITED = 47,
    /* Two sources publish the same frame, or have the same name. */
    TPRMP_REASON_FRAME_TWICE = 48,
    /* A joint that is a little outside its position limits is moved back, slowly. */
    TPRMP_REASON_JOINT_RETURNING = 49,
    /* The start frame is published, and the tool that starts there is elsewhere. */
    TPRMP_REASON_START_ELSEWHERE = 50,
} tprmp_reason;

/* Shape of an obstacle. */
typedef enum tprmp_obstacle_kind {
    /* A ball: `position` is its centre, `size[0]` its radius [m]. */
    TPRMP_OBSTACLE_KIND_SPHERE = 0,
    /* Everything below the plane through `position` whose normal is the z axis. */
    TPRMP_OBSTACLE_KIND_HALF_SPACE = 1,
    /* All points within a radius of a stretch of the z axis: `size[0]` is the radius, `size[1]`
     * the length of the stretch, to which the round ends are added [m]. */
    TPRMP_OBSTACLE_KIND_CAPSULE = 2,
    /* A box: `size` are its edges along x, y and z [m]. */
    TPRMP_OBSTACLE_KIND_BOX = 3,
} tprmp_obstacle_kind;

/* What somebody asks of a controller. */
typedef enum tprmp_control_verb {
    /* Nothing: the answer tells how it is. */
    TPRMP_CONTROL_VERB_STATUS = 0,
    /* Go on, from waiting for a start or from a hold. */
    TPRMP_CONTROL_VERB_START = 1,
    /* Decelerate to rest and hold, until a start. */
    TPRMP_CONTROL_VERB_HOLD = 2,
    /* Ramp down and leave. */
    TPRMP_CONTROL_VERB_STOP = 3,
    /* Somebody has looked: forget the fault. */
    TPRMP_CONTROL_VERB_RESET = 4,
    /* Follow the model in the file of the text. */
    TPRMP_CONTROL_VERB_SWAP_MODEL = 5,
    /* Change the setting of the text to the value. */
    TPRMP_CONTROL_VERB_SET = 6,
} tprmp_control_verb;

/* The state of the robot, from a state publisher to the controller. */
typedef struct tprmp_robot_state {
    /* Counts up by one from message to message: what is missing is counted as lost. */
    uint64_t sequence;
    /* When the state was measured [ns]. */
    uint64_t time_ns;
    /* Number of joints in use, the first ones of each array. */
    uint32_t joint_count;
    /* What the gripper senses: a `GripperState`. */
    uint32_t gripper_state;
    /* What the robot itself is doing: a `RobotMode`. */
    uint32_t robot_mode;
    /* 0 while the robot's safety system permits motion, 1 while it does not. */
    uint32_t safety_stop;
    /* `joint_names_hash` of the joints' names, in the order of the arrays; 0 where the publisher
     * does not say. */
    uint64_t joint_names_hash;
    /* Joint positions [rad or m]. */
    double position[8];
    /* Joint velocities [rad/s or m/s]. */
    double velocity[8];
    /* Measured joint torques or forces, without gravity [N m or N]; zero where not measured. */
    double torque[8];
} tprmp_robot_state;
#define TPRMP_ROBOT_STATE_TYPE_NAME "RobotStateV3"
static_assert(sizeof(tprmp_robot_state) == 232, "tprmp_robot_state");
static_assert(offsetof(tprmp_robot_state, sequence) == 0, "sequence");
static_assert(offsetof(tprmp_robot_state, time_ns) == 8, "time_ns");
static_assert(offsetof(tprmp_robot_state, joint_count) == 16, "joint_count");
static_assert(offsetof(tprmp_robot_state, gripper_state) == 20, "gripper_state");
static_assert(offsetof(tprmp_robot_state, robot_mode) == 24, "robot_mode");
static_assert(offsetof(tprmp_robot_state, safety_stop) == 28, "safety_stop");
static_assert(offsetof(tprmp_robot_state, joint_names_hash) == 32, "joint_names_hash");
static_assert(offsetof(tprmp_robot_state, position) == 40, "position");
static_assert(offsetof(tprmp_robot_state, velocity) == 104, "velocity");
static_assert(offsetof(tprmp_robot_state, torque) == 168, "torque");

/* A named task frame in the robot's base frame `B`. */
typedef struct tprmp_frame {
    /* UTF-8, padded with zeros. */
    uint8_t name[24];
    /* 1 when the pose may be used, 0 when it is unknown. */
    uint32_t valid;
    /* Explicit padding, zero. */
    uint32_t padding;
    /* Origin [m]. */
    double position[3];
    /* Orientation, unit quaternion `w, x, y, z`. */
    double quaternion[4];
    /* Velocity of the origin [m/s]. */
    double linear_velocity[3];
    /* Angular velocity, expressed in `B` [rad/s]. */
    double angular_velocity[3];
} tprmp_frame;
#define TPRMP_FRAME_TYPE_NAME "FrameV1"
static_assert(sizeof(tprmp_frame) == 136, "tprmp_frame");
static_assert(offsetof(tprmp_frame, name) == 0, "name");
static_assert(offsetof(tprmp_frame, valid) == 24, "valid");
static_assert(offsetof(tprmp_frame, padding) == 28, "padding");
static_assert(offsetof(tprmp_frame, position) == 32, "position");
static_assert(offsetof(tprmp_frame, quaternion) == 56, "quaternion");
static_assert(offsetof(tprmp_frame, linear_velocity) == 88, "linear_velocity");
static_assert(offsetof(tprmp_frame, angular_velocity) == 112, "angular_velocity");

/* A moving obstacle in the robot's base frame `B`. */
typedef struct tprmp_obstacle {
    /* What `size` means: an `ObstacleKind`. */
    uint32_t kind;
    /* 1 when the obstacle is there, 0 when it is not. One that is not measured any more is still
     * there: publish its last pose. */
    uint32_t valid;
    /* Centre; of a half-space, a point on its surface [m]. */
    double position[3];
    /* Orientation, unit quaternion `w, x, y, z`. */
    double quaternion[4];
    /* Velocity of `position` [m/s]. */
    double linear_velocity[3];
    /* Angular velocity, expressed in `B` [rad/s]. */
    double angular_velocity[3];
    /* What it is depends on the kind; the rest is unused [m]. */
    double size[3];
} tprmp_obstacle;
#define TPRMP_OBSTACLE_TYPE_NAME "ObstacleV2"
static_assert(sizeof(tprmp_obstacle) == 136, "tprmp_obstacle");
static_assert(offsetof(tprmp_obstacle, kind) == 0, "kind");
static_assert(offsetof(tprmp_obstacle, valid) == 4, "valid");
static_assert(offsetof(tprmp_obstacle, position) == 8, "position");
static_assert(offsetof(tprmp_obstacle, quaternion) == 32, "quaternion");
static_assert(offsetof(tprmp_obstacle, linear_velocity) == 64, "linear_velocity");
static_assert(offsetof(tprmp_obstacle, angular_velocity) == 88, "angular_velocity");
static_assert(offsetof(tprmp_obstacle, size) == 112, "size");

/* The task parameters: frames and obstacles, from their sources to the controller. A state
 * publisher may be the only source, or one of several. */
typedef struct tprmp_task_frames {
    /* Counts up by at least one from message to message. */
    uint64_t sequence;
    /* When the frames were measured [ns], on the clock of `RobotState::time_ns`. */
    uint64_t time_ns;
    /* Name of the source, UTF-8, padded with zeros: each of several has one of its own. A state
     * publisher may leave it empty. */
    uint8_t source[24];
    /* Number of frames in use, the first ones of the array. */
    uint32_t frame_count;
    /* Number of obstacles in use, the first ones of the array. */
    uint32_t obstacle_count;
    /* Named frames. */
    tprmp_frame frames[8];
    /* Obstacles. */
    tprmp_obstacle obstacles[32];
} tprmp_task_frames;
#define TPRMP_TASK_FRAMES_TYPE_NAME "TaskFramesV3"
static_assert(sizeof(tprmp_task_frames) == 5488, "tprmp_task_frames");
static_assert(offsetof(tprmp_task_frames, sequence) == 0, "sequence");
static_assert(offsetof(tprmp_task_frames, time_ns) == 8, "time_ns");
static_assert(offsetof(tprmp_task_frames, source) == 16, "source");
static_assert(offsetof(tprmp_task_frames, frame_count) == 40, "frame_count");
static_assert(offsetof(tprmp_task_frames, obstacle_count) == 44, "obstacle_count");
static_assert(offsetof(tprmp_task_frames, frames) == 48, "frames");
static_assert(offsetof(tprmp_task_frames, obstacles) == 1136, "obstacles");

/* What the controller wants the robot to do, from the controller to the robot. A torque
 * interface applies `torque + gravity_torque` (an arm that adds gravity itself only `torque`); a
 * velocity or position interface uses `velocity` or `position`. After `expiry_ns` the command
 * must no longer be obeyed: the robot brakes. `CommandGuard` knows when. */
typedef struct tprmp_joint_command {
    /* Counts up by one from message to message. */
    uint64_t sequence;
    /* `RobotState::sequence` of the state this command answers. */
    uint64_t state_sequence;
    /* When the command was computed [ns]; in lockstep, the state's time. */
    uint64_t time_ns;
    /* When the command expires [ns]. */
    uint64_t expiry_ns;
    /* A `CommandMode`. */
    uint32_t mode;
    /* A `GripperCommand`. */
    uint32_t gripper_command;
    /* Number of joints in use, the first ones of each array. */
    uint32_t joint_count;
    /* A `Reason`: why the controller does not follow its policy, or makes no progress with it. */
    uint32_t reason;
    /* Desired positions, integrated [rad or m]. */
    double position[8];
    /* Desired velocities, integrated [rad/s or m/s]. */
    double velocity[8];
    /* Desired accelerations [rad/s² or m/s²]. */
    double acceleration[8];
    /* Joint torques or forces without gravity [N m or N]. */
    double torque[8];
    /* Joint torques or forces that hold the arm against gravity [N m or N]. */
    double gravity_torque[8];
} tprmp_joint_command;
#define TPRMP_JOINT_COMMAND_TYPE_NAME "JointCommandV1"
static_assert(sizeof(tprmp_joint_command) == 368, "tprmp_joint_command");
static_assert(offsetof(tprmp_joint_command, sequence) == 0, "sequence");
static_assert(offsetof(tprmp_joint_command, state_sequence) == 8, "state_sequence");
static_assert(offsetof(tprmp_joint_command, time_ns) == 16, "time_ns");
static_assert(offsetof(tprmp_joint_command, expiry_ns) == 24, "expiry_ns");
static_assert(offsetof(tprmp_joint_command, mode) == 32, "mode");
static_assert(offsetof(tprmp_joint_command, gripper_command) == 36, "gripper_command");
static_assert(offsetof(tprmp_joint_command, joint_count) == 40, "joint_count");
static_assert(offsetof(tprmp_joint_command, reason) == 44, "reason");
static_assert(offsetof(tprmp_joint_command, position) == 48, "position");
static_assert(offsetof(tprmp_joint_command, velocity) == 112, "velocity");
static_assert(offsetof(tprmp_joint_command, acceleration) == 176, "acceleration");
static_assert(offsetof(tprmp_joint_command, torque) == 240, "torque");
static_assert(offsetof(tprmp_joint_command, gravity_torque) == 304, "gravity_torque");

/* A desired velocity of the tool: from teleoperation, hand guiding or another planner. It is for
 * a controller whose configuration listens. It acts beside the skill and is no state: one that
 * is faulty, or older than the controller permits, is ignored. Zeros ask for a tool at rest; to
 * let go, stop publishing. */
typedef struct tprmp_tool_command {
    /* Counts up by at least one from message to message; a publisher that begins while no other
     * command is fresh may begin anywhere. */
    uint64_t sequence;
    /* When the command was given [ns], on the clock of `RobotState::time_ns`. */
    uint64_t time_ns;
    /* Velocity of the tool's origin, expressed in `B` [m/s]. */
    double linear_velocity[3];
    /* Angular velocity of the tool, expressed in `B` [rad/s]. */
    double angular_velocity[3];
} tprmp_tool_command;
#define TPRMP_TOOL_COMMAND_TYPE_NAME "ToolCommandV1"
static_assert(sizeof(tprmp_tool_command) == 64, "tprmp_tool_command");
static_assert(offsetof(tprmp_tool_command, sequence) == 0, "sequence");
static_assert(offsetof(tprmp_tool_command, time_ns) == 8, "time_ns");
static_assert(offsetof(tprmp_tool_command, linear_velocity) == 16, "linear_velocity");
static_assert(offsetof(tprmp_tool_command, angular_velocity) == 40, "angular_velocity");

/* How the controller is doing, once a tick or every few. */
typedef struct tprmp_controller_status {
    /* Counts up by one from message to message. */
    uint64_t sequence;
    /* When the tick ended [ns]. */
    uint64_t time_ns;
    /* A `LifeCycle`. */
    uint32_t life_cycle;
    /* A `Reason`. */
    uint32_t reason;
    /* Ticks so far. */
    uint64_t ticks;
    /* Ticks that ended after their deadline or came after skipped periods, so far. */
    uint64_t deadline_misses;
    /* Periods that passed without a tick, so far. */
    uint64_t skipped_periods;
    /* States that are missing between those that arrived, by their numbers, so far. */
    uint64_t states_lost;
    /* Heap allocations inside the loop, so far, without those of `connections`. */
    uint64_t allocations;
    /* How often a new peer had to be connected to inside the loop, so far. */
    uint64_t connections;
    /* Period of the loop [ns]. */
    uint64_t period_ns;
    /* How late the last tick woke up [ns]. */
    uint64_t wake_up_ns;
    /* Age of the state the last tick used [ns]. */
    uint64_t state_age_ns;
    /* Time the last tick took to receive its messages [ns]. */
    uint64_t receiving_ns;
    /* Time the last tick took for checks, policy and limits [ns]. */
    uint64_t evaluation_ns;
    /* Time the last tick took to publish its command [ns]. */
    uint64_t publishing_ns;
    /* Distance of the tool from the goal [m]. */
    double goal_distance_m;
    /* Angle of the tool from the goal [rad]. */
    double goal_angle_rad;
    /* Lyapunov value Φ + ½ ẏᵀMẏ of the skill in canonical coordinates [J]. */
    double energy_j;
} tprmp_controller_status;
#define TPRMP_CONTROLLER_STATUS_TYPE_NAME "ControllerStatusV3"
static_assert(sizeof(tprmp_controller_status) == 144, "tprmp_controller_status");
static_assert(offsetof(tprmp_controller_status, sequence) == 0, "sequence");
static_assert(offsetof(tprmp_controller_status, time_ns) == 8, "time_ns");
static_assert(offsetof(tprmp_controller_status, life_cycle) == 16, "life_cycle");
static_assert(offsetof(tprmp_controller_status, reason) == 20, "reason");
static_assert(offsetof(tprmp_controller_status, ticks) == 24, "ticks");
static_assert(offsetof(tprmp_controller_status, deadline_misses) == 32, "deadline_misses");
static_assert(offsetof(tprmp_controller_status, skipped_periods) == 40, "skipped_periods");
static_assert(offsetof(tprmp_controller_status, states_lost) == 48, "states_lost");
static_assert(offsetof(tprmp_controller_status, allocations) == 56, "allocations");
static_assert(offsetof(tprmp_controller_status, connections) == 64, "connections");
static_assert(offsetof(tprmp_controller_status, period_ns) == 72, "period_ns");
static_assert(offsetof(tprmp_controller_status, wake_up_ns) == 80, "wake_up_ns");
static_assert(offsetof(tprmp_controller_status, state_age_ns) == 88, "state_age_ns");
static_assert(offsetof(tprmp_controller_status, receiving_ns) == 96, "receiving_ns");
static_assert(offsetof(tprmp_controller_status, evaluation_ns) == 104, "evaluation_ns");
static_assert(offsetof(tprmp_controller_status, publishing_ns) == 112, "publishing_ns");
static_assert(offsetof(tprmp_controller_status, goal_distance_m) == 120, "goal_distance_m");
static_assert(offsetof(tprmp_controller_status, goal_angle_rad) == 128, "goal_angle_rad");
static_assert(offsetof(tprmp_controller_status, energy_j) == 136, "energy_j");

/* A request. */
typedef struct tprmp_control_request {
    /* A `ControlVerb`. */
    uint32_t verb;
    /* Explicit padding, zero. */
    uint32_t padding;
    /* For `ControlVerb::Set`, in the unit of the setting. */
    double value;
    /* The path of a model, or the name of a setting. */
    uint8_t text[1000];
} tprmp_control_request;
#define TPRMP_CONTROL_REQUEST_TYPE_NAME "ControlRequestV1"
static_assert(sizeof(tprmp_control_request) == 1016, "tprmp_control_request");
static_assert(offsetof(tprmp_control_request, verb) == 0, "verb");
static_assert(offsetof(tprmp_control_request, padding) == 4, "padding");
static_assert(offsetof(tprmp_control_request, value) == 8, "value");
static_assert(offsetof(tprmp_control_request, text) == 16, "text");

/* An answer. */
typedef struct tprmp_control_answer {
    /* 1 when the request was taken, 0 when it was refused. */
    uint32_t accepted;
    /* A `LifeCycle`. */
    uint32_t life_cycle;
    /* A `Reason`. */
    uint32_t reason;
    /* Explicit padding, zero. */
    uint32_t padding;
    /* For people: what was done, or why it was not. */
    uint8_t text[1000];
} tprmp_control_answer;
#define TPRMP_CONTROL_ANSWER_TYPE_NAME "ControlAnswerV1"
static_assert(sizeof(tprmp_control_answer) == 1016, "tprmp_control_answer");
static_assert(offsetof(tprmp_control_answer, accepted) == 0, "accepted");
static_assert(offsetof(tprmp_control_answer, life_cycle) == 4, "life_cycle");
static_assert(offsetof(tprmp_control_answer, reason) == 8, "reason");
static_assert(offsetof(tprmp_control_answer, padding) == 12, "padding");
static_assert(offsetof(tprmp_control_answer, text) == 16, "text");

#endif
