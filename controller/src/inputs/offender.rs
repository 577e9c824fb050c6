//! Which joint, frame or obstacle of a message a check has refused. Called where one has: no allocation.

use tprmp_messages::{
    FRAME_CAPACITY, FRAME_DISTANCE_MAX_M, FRAME_SOURCES_MAX, Frame, NAME_CAPACITY,
    OBSTACLE_CAPACITY, Obstacle, ObstacleKind, PublishedFrames, Reason, RobotState, TaskFrames,
    is_usable, quaternion_length,
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

/// What of the frames and obstacles of all sources is refused for this reason, where these frames are needed.
#[must_use]
pub fn of_scene(
    published: &PublishedFrames<'_>,
    needed: &[[u8; NAME_CAPACITY]],
    reason: Reason,
) -> Detail {
    let of_sources = match reason {
        Reason::FrameMissing => Some(missing(published, needed)),
        Reason::FramesStale => stale(published, needed),
        Reason::FrameTwice => twice(published, needed),
        _ => None,
    };
    let of_message = || {
        published
            .messages()
            .find_map(|message| Some(of_message(message, reason)?.of_source(&message.source)))
    };
    of_sources
        .or_else(of_message)
        .or_else(|| too_many(published, reason))
        .unwrap_or(Detail::plain(reason))
}

/// What of one source's message is refused.
fn of_message(message: &TaskFrames, reason: Reason) -> Option<Detail> {
    let count = |about, seen: u32, most: usize| {
        let beyond = seen as usize > most;
        beyond.then(|| Detail::new(reason, about, f64::from(seen), [most as f64, 0.0]))
    };
    match reason {
        Reason::FrameCount => {
            return count(About::FrameCount, message.frame_count, FRAME_CAPACITY);
        }
        Reason::ObstacleCount => {
            return count(About::ObstacleCount, message.obstacle_count, OBSTACLE_CAPACITY);
        }
        _ => {}
    }
    let frame = message
        .listed()
        .unwrap_or(&[])
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
    frame.or_else(obstacle)
}

/// Which source goes beyond what all of them together may publish.
fn too_many(published: &PublishedFrames<'_>, reason: Reason) -> Option<Detail> {
    if let (Reason::FrameCount, Some(name)) = (reason, published.left_out()) {
        let most = FRAME_SOURCES_MAX as f64;
        return Some(
            Detail::new(reason, About::SourceCount, most + 1.0, [most, 0.0]).of_source(name),
        );
    }
    let mut total = 0;
    let mut beyond = None;
    for message in published.messages().filter(|_| reason == Reason::ObstacleCount) {
        total += message.present().map_or(0, Iterator::count);
        if total > OBSTACLE_CAPACITY {
            beyond.get_or_insert(message.source);
        }
    }
    let (seen, most) = (total as f64, OBSTACLE_CAPACITY as f64);
    Some(Detail::new(reason, About::ObstacleTotal, seen, [most, 0.0]).of_source(&beyond?))
}

/// A frame, or the obstacles of a source, that are too old; where nothing is, whatever is newest.
fn stale(published: &PublishedFrames<'_>, needed: &[[u8; NAME_CAPACITY]]) -> Option<Detail> {
    let (name, message) = published.stale(needed)?;
    let expected = [published.age_max_ns() as f64, message.time_ns as f64];
    let age_ns = published.now_ns() as f64 - message.time_ns as f64;
    let detail = Detail::new(Reason::FramesStale, About::FrameAge, age_ns, expected);
    Some(detail.named(&name.unwrap_or_default()).of_source(&message.source))
}

/// The frame, or the name, that two sources have.
fn twice(published: &PublishedFrames<'_>, needed: &[[u8; NAME_CAPACITY]]) -> Option<Detail> {
    let detail = |about| Detail::new(Reason::FrameTwice, about, 0.0, [0.0; 2]);
    if let Some(name) = published.named_twice() {
        return Some(detail(About::SourceTwice).of_source(name));
    }
    let name = needed.iter().find(|name| published.find(name).is_err_and(is_twice))?;
    let mut fresh = published.claims(name).filter(|claim| published.is_fresh(claim.message));
    let sources = [fresh.next()?.message.source, fresh.next()?.message.source];
    Some(Detail { sources, ..detail(About::FrameTwice).named(name) })
}

fn is_twice(reason: Reason) -> bool {
    reason == Reason::FrameTwice
}

fn missing(published: &PublishedFrames<'_>, needed: &[[u8; NAME_CAPACITY]]) -> Detail {
    let reason = Reason::FrameMissing;
    for name in needed {
        match published.find(name) {
            Err(Reason::FrameMissing) => {
                return Detail::new(reason, About::FrameMissing, 0.0, [0.0; 2]).named(name);
            }
            Ok(found) if found.frame.valid != 1 => {
                let mark = f64::from(found.frame.valid);
                let detail = Detail::new(reason, About::FrameInvalid, mark, [1.0, 0.0]);
                return detail.named(name).of_source(&found.message.source);
            }
            _ => {}
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
                Some((index, *values.iter().find(|value| !is_usable(**value))?))
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
            let seen = numbers.find(|value| !is_usable(**value)).copied().unwrap_or(f64::NAN);
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
        scene.source = name_bytes("camera").unwrap();
        let of_scene = |message: &TaskFrames, needed: &[_], reason| {
            of_scene(&PublishedFrames::of(&[message], 0, 0), needed, reason)
        };
        let far = of_scene(&scene, &[], Reason::FrameFar);
        assert_eq!(far.sources[0], scene.source);
        assert_eq!((far.about, far.seen), (About::FrameFar, 500.0));
        assert_eq!(far.name, name_bytes("b").unwrap());
        scene.obstacles[1] = Obstacle { valid: 1, size: [-0.1, 0.0, 0.0], ..Default::default() };
        let size = of_scene(&scene, &[], Reason::ObstacleSize);
        assert_eq!((size.about, size.index, size.seen), (About::ObstacleSize, 1, -0.1));
        let c = name_bytes("c").unwrap();
        let missing = of_scene(&scene, &[c], Reason::FrameMissing);
        assert_eq!((missing.about, missing.name), (About::FrameMissing, c));
    }

    #[test]
    fn of_several_sources_those_are_named_that_are_the_cause() {
        let source = |name: &str, obstacles| {
            let mut message = TaskFrames::of_source(name).unwrap();
            message.frames[0] = Frame::at("object", [0.0; 3]).unwrap();
            (message.frame_count, message.obstacle_count) = (1, obstacles);
            message.obstacles.iter_mut().for_each(|obstacle| obstacle.valid = 1);
            message
        };
        let [a, b] = [source("a", 20), source("b", 13)];
        let object = name_bytes("object").unwrap();
        let detail =
            |b, now_ns, r| of_scene(&PublishedFrames::of(&[&a, b], now_ns, 100), &[object], r);
        let twice = detail(&b, 0, Reason::FrameTwice);
        assert_eq!((twice.about, twice.name), (About::FrameTwice, object));
        assert_eq!(twice.sources, [a.source, b.source]);
        let total = detail(&b, 0, Reason::ObstacleCount);
        assert_eq!(
            (total.about, total.seen, total.sources[0]),
            (About::ObstacleTotal, 33.0, b.source)
        );
        let b = TaskFrames { time_ns: 500, ..b };
        let old = detail(&b, 500, Reason::FramesStale);
        assert_eq!((old.about, old.seen, old.sources[0]), (About::FrameAge, 500.0, a.source));
        assert_eq!(old.name, [0; NAME_CAPACITY], "its obstacles: the frame is another's by now");
    }
}
