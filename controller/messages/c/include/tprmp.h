/* State publishers and sources of frames in C, over `libtprmp.so`: `examples/state_publisher.c` is one.
 *
 * A function that returns int gives 0 for success and -1 for a failure, one that returns a pointer NULL for a
 * failure; tprmp_error() then says why. A publisher and a source belong to one thread at a time. A null pointer is
 * only permitted where it is said. */
#ifndef TPRMP_H
#define TPRMP_H

#include "tprmp_messages.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct tprmp_publisher tprmp_publisher;
typedef struct tprmp_source tprmp_source;

/* What each joint can do [rad/s or m/s, rad/s2 or m/s2], and how the guard brakes it [rad/s2 or m/s2]. */
typedef struct tprmp_joint_bounds {
    double speed_max[TPRMP_JOINT_CAPACITY];
    double acceleration_max[TPRMP_JOINT_CAPACITY];
    double deceleration[TPRMP_JOINT_CAPACITY];
    /* 1: it rotates without an end, and may be reported within one turn. */
    uint32_t continuous[TPRMP_JOINT_CAPACITY];
} tprmp_joint_bounds;

/* What the robot shall do until it is asked again. */
typedef struct tprmp_action {
    /* 1: obey `command`; 0: brake, along `position` and `velocity`. */
    uint32_t obey;
    uint32_t padding;
    /* Set point of a position or velocity interface [rad or m, rad/s or m/s]. */
    double position[TPRMP_JOINT_CAPACITY];
    double velocity[TPRMP_JOINT_CAPACITY];
    /* The command, for its torques and its gripper. */
    tprmp_joint_command command;
} tprmp_action;

/* The present on CLOCK_MONOTONIC [ns]. */
uint64_t tprmp_now_ns(void);

/* Why the last function of this thread has failed, UTF-8; valid until the next one fails. */
const char *tprmp_error(void);

/* Opens the state publisher of an instance, for joints of these names in this order. A torque interface, which
 * brakes by itself, gives NULL for `bounds`. */
tprmp_publisher *tprmp_open(const char *instance, const char *const *joints, uint32_t joint_count,
                            const tprmp_joint_bounds *bounds);

/* What the robot, which is in `state`, shall do at the time now_ns [ns]. */
void tprmp_command(tprmp_publisher *publisher, uint64_t now_ns, const tprmp_robot_state *state,
                   tprmp_action *action);

/* Publishes frames, if not NULL, then the state, both measured at the time now_ns [ns]. Sets their count and
 * stamp, and the state's joint_count and joint_names_hash. */
int tprmp_publish(tprmp_publisher *publisher, uint64_t now_ns, tprmp_task_frames *frames,
                  tprmp_robot_state *state);

/* Closes it; NULL is nothing. */
void tprmp_close(tprmp_publisher *publisher);

/* Opens a source of frames beside the state publisher; set `source` of its messages. */
tprmp_source *tprmp_open_source(const char *instance);

/* Publishes frames and obstacles measured at the time now_ns [ns]. Sets their count and stamp. */
int tprmp_publish_source(tprmp_source *source, uint64_t now_ns, tprmp_task_frames *frames);

/* Closes it; NULL is nothing. */
void tprmp_close_source(tprmp_source *source);

#ifdef __cplusplus
}
#endif

#endif
