//! A state publisher, whole: an ideal robot in the plane that moves as it is commanded, and the two
//! frames of the planar skill. `controller run config/controllers/planar.ron` connects to it. The same
//! in Python: `sim-bridge/examples/state_publisher.py`.

use std::{env, error::Error, sync::atomic::Ordering, thread, time::Duration};

use rustix::time::{ClockId, clock_gettime};
use tprmp_messages::{
    Bounds, CommandGuard, Frame, Instance, JointBounds, RobotState, TaskFrames, joint_names_hash,
    stop_flag,
};

fn main() -> Result<(), Box<dyn Error>> {
    let instance = env::args().nth(1).unwrap_or_else(|| "default".into());
    let ports = Instance::new(&instance)?.open_state_publisher()?;
    let stop = stop_flag()?;
    let joint_names_hash = joint_names_hash(&["x_joint", "y_joint"]);
    let mut state = RobotState { joint_count: 2, joint_names_hash, ..Default::default() };
    let mut frames = TaskFrames { frame_count: 2, ..Default::default() };
    frames.frames[0] = Frame::at("start", [0.0, 0.0, 0.0])?;
    frames.frames[1] = Frame::at("end", [2.0, 1.0, 0.0])?;
    // 20 m/s and 60 m/s² are what this robot can do; it brakes with 30 m/s².
    let joints = Some(JointBounds::same(20.0, 60.0, 30.0));
    let mut guard = CommandGuard::new(2, Bounds { joints, ..Bounds::default() });
    while !stop.load(Ordering::Relaxed) {
        let new = ports.command.receive();
        let now = clock_gettime(ClockId::Monotonic);
        let now_ns = now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64;
        // Where it obeys and where it brakes, this robot is where it shall be.
        let action = guard.judge(now_ns, new.as_deref(), &state);
        (state.position, state.velocity) = (action.setpoint().position, action.setpoint().velocity);
        (state.sequence, frames.sequence) = (state.sequence + 1, state.sequence + 1);
        (state.time_ns, frames.time_ns) = (now_ns, now_ns);
        // The frames first, so that whoever waits for the state finds both.
        let sent = ports.frames.publish(frames) && ports.state.publish(state);
        assert!(sent, "shared memory refuses a message");
        thread::sleep(Duration::from_millis(1));
    }
    if let Some(fault) = guard.last_fault() {
        eprintln!("the last fault of a command: {fault}");
    }
    Ok(())
}
