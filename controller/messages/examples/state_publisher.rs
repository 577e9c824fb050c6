//! A state publisher, whole: an ideal robot in the plane that moves as it is commanded, and the two
//! frames of the planar skill. `controller run config/controllers/planar.ron` connects to it.

use std::{env, error::Error, sync::atomic::Ordering, thread, time::Duration};

use tprmp_messages::{
    Bounds, Frame, Instance, JointBounds, StatePublisher, TaskFrames, monotonic_ns, stop_flag,
};

fn main() -> Result<(), Box<dyn Error>> {
    let instance = Instance::new(&env::args().nth(1).unwrap_or_else(|| "default".into()))?;
    // 20 m/s and 60 m/s² are what this robot can do; it brakes with 30 m/s².
    let bounds = Bounds { joints: Some(JointBounds::same(20.0, 60.0, 30.0)), ..Bounds::default() };
    let mut robot = StatePublisher::open(&instance, &["x_joint", "y_joint"], bounds)?;
    let mut frames = TaskFrames { frame_count: 2, ..TaskFrames::default() };
    frames.frames[0] = Frame::at("start", [0.0, 0.0, 0.0])?;
    frames.frames[1] = Frame::at("end", [2.0, 1.0, 0.0])?;
    let stop = stop_flag()?;
    while !stop.load(Ordering::Relaxed) {
        let now_ns = monotonic_ns();
        // Where it obeys and where it brakes, this robot is where it shall be.
        let shall_be = *robot.command(now_ns).setpoint();
        (robot.state.position, robot.state.velocity) = (shall_be.position, shall_be.velocity);
        robot.publish(now_ns, &mut frames)?;
        thread::sleep(Duration::from_millis(1));
    }
    Ok(())
}
