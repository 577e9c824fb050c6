//! Which joint, frame or obstacle of a message a check has refused. Called where one has: no allocation.

use tprmp_messages::{
    FRAME_CAPACITY, FRAME_DISTANCE_MAX_M, Frame, NAME_CAPACITY, OBSTACLE_CAPACITY, Obstacle,
    ObstacleKind, Reason, RobotState, TaskFrames, quaternion_length,
};

use crate::detail::{About, Detail};

/// What of a state for `joints` joints is refused for this reason.
#[must_use]
pub fn of_state(state: &RobotState, joints: usize, reason: Reason) -> Detail {
    let number =
        |about, seen: f64, expected: f64| Detail::new(reason, about, seen, [expected, 0.0]);
    match reason {
        Reason::JointCount => {
            number(About::JointCount, f64::from(state.joint_count), joints as f64)
        }
        Reason::StateNotFinite => {
            let lists = [
                (About::PositionNotFinite, &state.position),
                (About::VelocityNotFinite, &state.velocity),
                (About::TorqueNotFinite, &state.torque),
            ];
            let bad = |(about, values): (About, &[f64; 8])| {
                let index = values[..joints].iter().position(|value| !value.is_finite())?;
                Some(number(about, values[index], 0.0).at(index))
            };
            lists.into_iter().find_map(bad).unwrap_or(Detail::plain(reason))
        }
        Reason::JointOrder => {
            let mut name = [0; NAME_CAPACITY];
            name[..8].copy_from_slice(&state.joint_names_hash.to_ne_bytes());
            number(About::JointNames, 0.0, 0.0).named(&name)
        }
        Reason::RobotFault => number(About::RobotMode, f64::from(state.robot_mode), 0.0),
        Reason::GripperUnknown | Reason::GripperNone => {
            number(About::Gripper, f64::from(state.gripper_state), 0.0)
        }
        reason => Detail::plain(reason),
    }
}

/// What of a message of frames and obstacles is refused for this reason, where these frames are needed.
#[must_use]
pub fn of_scene(message: &TaskFrames, needed: &[[u8; NAME_CAPACITY]], reason: Reason) -> Detail {
    let number = |about, seen, most| Detail::new(reason, about, seen, [most, 0.0]);
    match reason {
        Reason::FrameCount => {
            let most = FRAME_CAPACITY as f64;
            return number(About::FrameCount, f64::from(message.frame_count), most);
        }
        Reason::ObstacleCount => {
            let most = OBSTACLE_CAPACITY as f64;
            return number(About::ObstacleCount, f64::from(message.obstacle_count), most);
        }
        _ => {}
    }
    let frames = message.listed().unwrap_or(&[]);
    if reason == Reason::FrameMissing {
        return missing(frames, needed);
    }
    let frame = frames
        .iter()
        .filter(|frame| frame.valid == 1)
        .find(|frame| frame.check() == Err(reason))
        .map(|frame| of_frame(frame, reason));
    let obstacles = message.obstacles.iter().take(message.obstacle_count as usize).enumerate();
    let obstacle = || {
        let mut there = obstacles.filter(|(_, obstacle)| obstacle.valid != 0);
        let (index, obstacle) = there.find(|(_, obstacle)| obstacle.check() == Err(reason))?;
        Some(of_obstacle(obstacle, reason).at(index))
    };
    frame.or_else(obstacle).unwrap_or(Detail::plain(reason))
}

fn missing(frames: &[Frame], needed: &[[u8; NAME_CAPACITY]]) -> Detail {
    let reason = Reason::FrameMissing;
    for name in needed {
        match Frame::find(frames, name) {
            None => return Detail::new(reason, About::FrameMissing, 0.0, [0.0; 2]).named(name),
            Some(found) if found.valid != 1 => {
                let mark = f64::from(found.valid);
                return Detail::new(reason, About::FrameInvalid, mark, [1.0, 0.0]).named(name);
            }
            Some(_) => {}
        }
    }
    Detail::plain(reason)
}

fn of_frame(frame: &Frame, reason: Reason) -> Detail {
    let number = |about, seen, most| Detail::new(reason, about, seen, [most, 0.0]);
    let detail = match reason {
        Reason::QuaternionNotUnit => {
            number(About::FrameQuaternion, quaternion_length(frame.quaternion), 1.0)
        }
        Reason::FrameFar => number(About::FrameFar, frame.distance_m(), FRAME_DISTANCE_MAX_M),
        _ => {
            let fields: [&[f64]; 4] = [
                &frame.position,
                &frame.quaternion,
                &frame.linear_velocity,
                &frame.angular_velocity,
            ];
            let bad = |(index, values): (usize, &[f64])| {
                Some((index, *values.iter().find(|value| !value.is_finite())?))
            };
            let (index, seen) = fields.into_iter().enumerate().find_map(bad).unwrap_or_default();
            number(About::FrameNotFinite, seen, 0.0).at(index)
        }
    };
    detail.named(&frame.name)
}

fn of_obstacle(obstacle: &Obstacle, reason: Reason) -> Detail {
    let number = |about, seen, which| Detail::new(reason, about, seen, [which, 0.0]);
    match reason {
        Reason::ObstacleUnknown if obstacle.valid != 1 => {
            number(About::ObstacleMark, f64::from(obstacle.valid), 1.0)
        }
        Reason::ObstacleUnknown => number(About::ObstacleKind, f64::from(obstacle.kind), 0.0),
        Reason::ObstacleSize => {
            let kind = ObstacleKind::from_wire(obstacle.kind).unwrap_or_default();
            let which = obstacle.bad_size(kind).unwrap_or(0);
            number(About::ObstacleSize, obstacle.size[which], which as f64)
        }
        Reason::ObstacleQuaternion => {
            number(About::ObstacleQuaternion, quaternion_length(obstacle.quaternion), 1.0)
        }
        _ => {
            let motion = [obstacle.position, obstacle.linear_velocity, obstacle.angular_velocity];
            let mut numbers =
                motion.as_flattened().iter().chain(&obstacle.quaternion).chain(&obstacle.size);
            let seen = numbers.find(|value| !value.is_finite()).copied().unwrap_or(f64::NAN);
            number(About::ObstacleNotFinite, seen, 0.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tprmp_messages::name_bytes;

    #[test]
    fn the_first_offender_is_found_with_its_value() {
        let mut state = RobotState { joint_count: 2, ..Default::default() };
        state.velocity[1] = f64::INFINITY;
        let detail = of_state(&state, 2, Reason::StateNotFinite);
        assert_eq!((detail.about, detail.index), (About::VelocityNotFinite, 1));
        let mut scene = TaskFrames { frame_count: 2, obstacle_count: 2, ..Default::default() };
        scene.frames[0] = Frame::at("a", [0.0; 3]).unwrap();
        scene.frames[1] = Frame::at("b", [300.0, 400.0, 0.0]).unwrap();
        let far = of_scene(&scene, &[], Reason::FrameFar);
        assert_eq!((far.about, far.seen), (About::FrameFar, 500.0));
        assert_eq!(far.name, name_bytes("b").unwrap());
        scene.obstacles[1] = Obstacle { valid: 1, size: [-0.1, 0.0, 0.0], ..Default::default() };
        let size = of_scene(&scene, &[], Reason::ObstacleSize);
        assert_eq!((size.about, size.index, size.seen), (About::ObstacleSize, 1, -0.1));
        let c = name_bytes("c").unwrap();
        let missing = of_scene(&scene, &[c], Reason::FrameMissing);
        assert_eq!((missing.about, missing.name), (About::FrameMissing, c));
    }
}
