//! `controller frames`: publishes frames and obstacles that stand still, as a source of its own beside the state
//! publisher.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use clap::Args;
use thiserror::Error;
use tprmp_files::outln;
use tprmp_messages::{
    FRAME_CAPACITY, Frame, Instance, NameFault, OBSTACLE_CAPACITY, Obstacle, ObstacleKind,
    PublishedFrames, Reason, ServiceError, TaskFrames, name_bytes, stop_flag,
};
use tprmp_model::fixed_frames::{self, FixedFrames, FixedFramesError, FixedObstacle};

use crate::detail::{Snapshot, explain};
use crate::inputs::offender;
use crate::timing::realtime::{monotonic_ns, sleep_until};

/// Why nothing is published.
#[derive(Debug, Error)]
pub enum FramesError {
    /// The file.
    #[error(transparent)]
    File(#[from] FixedFramesError),
    /// Shared memory.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The signal handlers.
    #[error("signal handlers cannot be installed: {0}")]
    Signals(io::Error),
    /// A message was not sent.
    #[error("instance `{0}`: shared memory refuses a message; `controller clean`, then try again")]
    Refused(String),
}

/// What to publish, and where.
#[derive(Debug, Args)]
pub struct Frames {
    /// File of frames and obstacles, e.g. config/frames/table.ron.
    file: PathBuf,
    /// Name that publisher and controller share.
    #[arg(long, default_value = "default")]
    instance: String,
    /// Stamp with the time of the newest state, where that is simulated.
    #[arg(long)]
    lockstep: bool,
}

impl Frames {
    /// Publishes until a signal comes.
    ///
    /// # Errors
    /// [`FramesError`].
    pub fn run(&self) -> Result<(), FramesError> {
        let fixed = fixed_frames::read(&self.file)?;
        let mut message = message(&self.file, &fixed)?;
        let instance = Instance::new(&self.instance)?;
        let port = instance.open_frame_source()?;
        let observer = self.lockstep.then(|| instance.open_observer()).transpose()?;
        let stop = stop_flag().map_err(FramesError::Signals)?;
        outln!(
            "instance `{}`: source `{}` publishes {} frames and {} obstacles",
            self.instance,
            fixed.source,
            message.frame_count,
            message.obstacle_count
        );
        let period_ns = (1e9 * fixed.period_s) as u64;
        let mut next_ns = monotonic_ns();
        while !stop.load(Ordering::Relaxed) {
            message.time_ns = match &observer {
                None => monotonic_ns(),
                Some(observer) => {
                    let states = std::iter::from_fn(|| observer.state.receive());
                    states.last().map_or(message.time_ns, |state| state.time_ns)
                }
            };
            message.sequence += 1;
            if !port.frames.publish(message) {
                return Err(FramesError::Refused(self.instance.clone()));
            }
            // Late or not: nothing is caught up with.
            next_ns = (next_ns + period_ns).max(monotonic_ns());
            sleep_until(next_ns);
        }
        Ok(())
    }
}

/// The message of a file, as its receivers check it.
fn message(path: &Path, fixed: &FixedFrames) -> Result<TaskFrames, FixedFramesError> {
    let refused =
        |key: String, problem: String| FixedFramesError::Value { path: path.into(), key, problem };
    let named = |key: String, name: &str| {
        name_bytes(name)
            .map_err(|fault: NameFault| refused(key, format!("{fault}, found `{name}`")))
    };
    for (key, count, most) in [
        ("frames", fixed.frames.len(), FRAME_CAPACITY),
        ("obstacles", fixed.obstacles.len(), OBSTACLE_CAPACITY),
    ] {
        if count > most {
            return Err(refused(key.into(), format!("expected at most {most}, found {count}")));
        }
    }
    let mut message = TaskFrames {
        source: named("source".into(), &fixed.source)?,
        frame_count: fixed.frames.len() as u32,
        obstacle_count: fixed.obstacles.len() as u32,
        ..Default::default()
    };
    for (i, (place, frame)) in message.frames.iter_mut().zip(&fixed.frames).enumerate() {
        *place = Frame {
            name: named(format!("frames[{i}].name"), &frame.name)?,
            valid: 1,
            position: frame.position_m,
            quaternion: frame.quaternion_wxyz,
            ..Default::default()
        };
    }
    for (place, obstacle) in message.obstacles.iter_mut().zip(&fixed.obstacles) {
        *place = of_obstacle(obstacle);
    }
    check(&message).map_err(|(key, problem)| refused(key.into(), problem))?;
    Ok(message)
}

/// Looks at a message as a controller does; which part it refuses, and why.
fn check(message: &TaskFrames) -> Result<(), (&'static str, String)> {
    let say = |key, reason: Reason| {
        let published = PublishedFrames::of(&[message], 0, 0);
        let detail = offender::of_scene(&published, &[], reason);
        let text = explain(&Snapshot { detail, ..Snapshot::default() });
        (key, text.unwrap_or_else(|| format!("{reason:?}")))
    };
    for frame in message.listed().map_err(|reason| say("frames", reason))? {
        frame.check().map_err(|reason| say("frames", reason))?;
    }
    for obstacle in message.present().map_err(|reason| say("obstacles", reason))? {
        obstacle.check().map_err(|reason| say("obstacles", reason))?;
    }
    Ok(())
}

fn of_obstacle(obstacle: &FixedObstacle) -> Obstacle {
    let upright = [1.0, 0.0, 0.0, 0.0];
    let (kind, position, quaternion, size) = match *obstacle {
        FixedObstacle::Sphere { position_m, radius_m } => {
            (ObstacleKind::Sphere, position_m, upright, [radius_m, 0.0, 0.0])
        }
        FixedObstacle::HalfSpace { position_m, quaternion_wxyz } => {
            (ObstacleKind::HalfSpace, position_m, quaternion_wxyz, [0.0; 3])
        }
        FixedObstacle::Capsule { position_m, quaternion_wxyz, radius_m, length_m } => {
            (ObstacleKind::Capsule, position_m, quaternion_wxyz, [radius_m, length_m, 0.0])
        }
        FixedObstacle::Box { position_m, quaternion_wxyz, size_m } => {
            (ObstacleKind::Box, position_m, quaternion_wxyz, size_m)
        }
    };
    let kind = kind.to_wire();
    Obstacle { kind, valid: 1, position, quaternion, size, ..Default::default() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shipped() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/frames/table.ron")
    }

    #[test]
    fn the_shipped_file_is_a_source() {
        let fixed = fixed_frames::read(&shipped()).unwrap();
        let message = message(&shipped(), &fixed).unwrap();
        assert_eq!(message.source, name_bytes("table").unwrap());
        assert_eq!((message.frame_count, message.obstacle_count), (1, 1));
        assert_eq!(message.obstacles[0].kind, ObstacleKind::HalfSpace.to_wire());
    }

    #[test]
    fn what_no_controller_would_believe_is_refused_with_its_key() {
        let said = |edit: &dyn Fn(&mut FixedFrames)| {
            let mut fixed = fixed_frames::read(&shipped()).unwrap();
            edit(&mut fixed);
            message(Path::new("my.ron"), &fixed).unwrap_err().to_string()
        };
        for (text, parts) in [
            (said(&|f| f.source = String::new()), ["`source`", "1 to 24 bytes"]),
            (
                said(&|f| f.frames = vec![f.frames[0].clone(); 9]),
                ["`frames`", "at most 8, found 9"],
            ),
            (said(&|f| f.frames[0].quaternion_wxyz[0] = 1.5), ["`frames`", "length 1.5"]),
            (said(&|f| f.frames[0].name = "a".repeat(25)), ["`frames[0].name`", "1 to 24"]),
            (
                said(&|f| {
                    f.obstacles[0] = FixedObstacle::Sphere { position_m: [0.0; 3], radius_m: -0.1 };
                }),
                ["`obstacles`", "`obstacles[0]` of source `table` has `size[0]` -0.1"],
            ),
        ] {
            assert!(text.contains("my.ron") && parts.iter().all(|p| text.contains(p)), "{text}");
        }
    }
}
