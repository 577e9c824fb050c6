/* A state publisher in C, whole: an ideal robot in the plane that moves as it is commanded, and the two frames of
 * the planar skill. `controller run config/controllers/planar.ron` connects to it. */
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "tprmp.h"

static volatile sig_atomic_t stopped;

static void stop(int number) {
    (void)number;
    stopped = 1;
}

static tprmp_frame frame(const char *name, double x, double y) {
    tprmp_frame frame = {.valid = 1, .position = {x, y, 0.0}, .quaternion = {1.0, 0.0, 0.0, 0.0}};
    memcpy(frame.name, name, strlen(name));
    return frame;
}

int main(int count, char **arguments) {
    const char *joints[] = {"x_joint", "y_joint"};
    /* 20 m/s and 60 m/s² are what this robot can do; it brakes with 30 m/s². */
    tprmp_joint_bounds bounds = {{20.0, 20.0}, {60.0, 60.0}, {30.0, 30.0}, {0}};
    tprmp_publisher *robot = tprmp_open(count > 1 ? arguments[1] : "default", joints, 2, &bounds);
    if (robot == NULL) {
        fprintf(stderr, "state_publisher: %s\n", tprmp_error());
        return 1;
    }
    signal(SIGINT, stop);
    tprmp_robot_state state = {0};
    tprmp_task_frames frames = {.frame_count = 2};
    frames.frames[0] = frame("start", 0.0, 0.0);
    frames.frames[1] = frame("end", 2.0, 1.0);
    int failed = 0;
    while (!stopped && !failed) {
        uint64_t now_ns = tprmp_now_ns();
        tprmp_action action;
        /* Where it obeys and where it brakes, this robot is where it shall be. */
        tprmp_command(robot, now_ns, &state, &action);
        memcpy(state.position, action.position, sizeof state.position);
        memcpy(state.velocity, action.velocity, sizeof state.velocity);
        failed = tprmp_publish(robot, now_ns, &frames, &state);
        nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
    }
    if (failed) fprintf(stderr, "state_publisher: %s\n", tprmp_error());
    tprmp_close(robot);
    return failed ? 1 : 0;
}
