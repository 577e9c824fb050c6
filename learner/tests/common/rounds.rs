//! Recordings of what goes round, made up from formulas.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tprmp_learner::demonstration::Demonstration;
use tprmp_learner::skill::{MotionSettings, Skill};
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

/// Period of the made-up rounds \[s\].
pub(crate) const PERIOD_S: f64 = 3.0;

/// A skill that goes round, fixed to one frame.
pub(crate) fn periodic(mut skill: Skill) -> Skill {
    skill.motion = MotionSettings::Periodic;
    skill.start_frame = skill.goal_frame.clone();
    skill
}

/// A place of the round, seen from the frame: `angle` in rounds.
pub(crate) type Shape = fn(f64) -> Pose;

/// Wiping: an ellipse in the plane.
pub(crate) fn wiping(rounds: f64) -> Pose {
    let (sin, cos) = (TAU * rounds).sin_cos();
    Pose { position: DVec3::new(0.15 * cos, 0.08 * sin, 0.0), orientation: DQuat::IDENTITY }
}

/// Stirring: a circle, the tool tilted outwards, down.
pub(crate) fn stirring(rounds: f64) -> Pose {
    let (sin, cos) = (TAU * rounds).sin_cos();
    let tilt = DQuat::from_scaled_axis(DVec3::new(-sin, cos, 0.0) * 0.25);
    Pose {
        position: DVec3::new(0.06 * cos, 0.06 * sin, 0.1 + 0.01 * cos),
        orientation: tilt * DQuat::from_rotation_x(3.0),
    }
}

/// A recording of some rounds by hand: an approach, rounds of unequal pace and size, a retreat, rests at both ends, noise.
pub(crate) fn recorded(
    index: usize,
    manifold: Manifold,
    shape: Shape,
    rounds: f64,
) -> Demonstration {
    let mut random = ChaCha8Rng::seed_from_u64(index as u64 + 7);
    let dt = 0.01;
    let begin = 0.13 + 0.21 * index as f64;
    let pace = 1.0 + 0.08 * (1.7 * index as f64).sin();
    let frame = Pose {
        position: DVec3::new(0.4 + 0.1 * index as f64, -0.2, 0.0),
        orientation: DQuat::from_rotation_z(0.4 * index as f64 - 0.5),
    };
    let size = |at: f64| 1.0 + 0.015 * (TAU * at * 0.37 + index as f64).sin();
    let on = |at: f64| {
        let mut pose = shape(at);
        pose.position *= size(at);
        pose
    };
    let away = |at: f64| {
        let pose = on(at);
        Pose { position: pose.position * 1.2 + DVec3::new(0.05, 0.12, 0.0), ..pose }
    };
    let blend = |t: f64| t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
    let mut poses = vec![away(begin); 40];
    poses.extend((0..80).map(|i| away(begin).interpolate(&on(begin), blend(f64::from(i) / 80.0))));
    let mut at = begin;
    while at < begin + rounds {
        poses.push(on(at));
        let hand = 1.0 + 0.2 * (TAU * at).sin() + 0.06 * (TAU * 0.41 * at + index as f64).sin();
        at += pace * hand * dt / PERIOD_S;
    }
    let end = at;
    poses.extend((0..80).map(|i| on(end).interpolate(&away(end), blend(f64::from(i) / 80.0))));
    poses.extend(vec![away(end); 30]);
    let mut noise = |most: f64| {
        let mut one = || random.random_range(-most..most);
        DVec3::new(one(), one(), if manifold == Manifold::R2 { 0.0 } else { one() })
    };
    for pose in &mut poses {
        pose.position += noise(0.0015);
        if manifold == Manifold::R3S3 {
            pose.orientation *= DQuat::from_scaled_axis(noise(0.01));
        }
        *pose = frame.compose(pose);
        if manifold == Manifold::R2 {
            pose.orientation = DQuat::IDENTITY;
        }
    }
    let template = super::arcs(manifold).remove(0);
    Demonstration {
        name: format!("round_{index:02}.json"),
        sampling_time_s: dt,
        start: frame,
        goal_frame: frame,
        poses,
        ..template
    }
}

pub(crate) fn all(manifold: Manifold, shape: Shape, rounds: &[f64]) -> Vec<Demonstration> {
    rounds.iter().enumerate().map(|(i, rounds)| recorded(i, manifold, shape, *rounds)).collect()
}

/// A recording without a hand: rounds of a shape, and nothing before and after.
pub(crate) fn clean(
    index: usize,
    shape: impl Fn(f64) -> DVec3,
    rounds: f64,
    period_s: f64,
) -> Demonstration {
    let mut random = ChaCha8Rng::seed_from_u64(index as u64 + 3);
    let dt = 0.01;
    let frame = Pose {
        position: DVec3::new(0.2 * index as f64, 0.1, 0.0),
        orientation: DQuat::from_rotation_z(0.3 * index as f64),
    };
    let count = (rounds * period_s / dt).round() as usize + 1;
    let mut noise = || random.random_range(-0.0002..0.0002);
    let poses = (0..count).map(|i| {
        let noise = DVec3::new(noise(), noise(), 0.0);
        let at = i as f64 * dt / period_s + 0.37 * index as f64;
        let position = frame.position + frame.orientation * (shape(at) + noise);
        Pose { position, orientation: DQuat::IDENTITY }
    });
    Demonstration {
        name: format!("clean_{index:02}.json"),
        sampling_time_s: dt,
        start: frame,
        goal_frame: frame,
        poses: poses.collect(),
        ..super::arcs(Manifold::R2).remove(0)
    }
}
