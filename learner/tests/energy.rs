//! V falls where frames rest, also where the governor acts: on demonstrations of several groups of starts, faster than the
//! governor lets them be, and on tight loops.

use crate::common::skill;
use glam::{DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tprmp_learner::certify::policy::{Body, LearnedPolicy};
use tprmp_learner::certify::rollout::{RolloutSpec, Target, follow};
use tprmp_learner::demonstration::Demonstration;
use tprmp_learner::train::learn;
use tprmp_model::skill_model::Manifold;
use tprmp_rmpflow::policy::{SkillInertia, SpeedGovernor};
use tprmp_spatial::{MovingPose, Pose};

const GOAL: Pose = Pose { position: DVec3::ZERO, orientation: DQuat::IDENTITY };
const START: Pose = Pose { position: DVec3::new(0.5, 0.0, 0.0), orientation: DQuat::IDENTITY };
const STEP_S: f64 = 1e-3;

/// Points of a smooth curve through these, at rest at both ends.
fn through(points: &[DVec3], samples: usize) -> Vec<Pose> {
    let tangent = |i: usize| {
        let (before, after) = (i.saturating_sub(1), (i + 1).min(points.len() - 1));
        (points[after] - points[before]) / (after - before) as f64
    };
    let at = |i: usize| {
        let t = i as f64 / (samples - 1) as f64;
        let along = t.powi(3) * (10.0 - 15.0 * t + 6.0 * t * t) * (points.len() - 1) as f64;
        let k = (along as usize).min(points.len() - 2);
        let f = along - k as f64;
        let position = points[k] * (1.0 + 2.0 * f) * (1.0 - f).powi(2)
            + tangent(k) * f * (1.0 - f).powi(2)
            + points[k + 1] * f * f * (3.0 - 2.0 * f)
            - tangent(k + 1) * f * f * (1.0 - f);
        Pose { position, orientation: DQuat::IDENTITY }
    };
    (0..samples).map(at).collect()
}

fn demonstration(name: String, poses: Vec<Pose>) -> Demonstration {
    let template = crate::common::arcs(Manifold::R2).remove(0);
    Demonstration {
        name,
        poses,
        gripper: None,
        sampling_time_s: 0.005,
        start: START,
        goal_frame: GOAL,
        ..template
    }
}

/// Three demonstrations from each of several places, which go on alike.
fn groups(random: &mut ChaCha8Rng) -> Vec<Demonstration> {
    let mut point = |most: f64| {
        DVec3::new(random.random_range(-most..most), random.random_range(-most..most), 0.0)
    };
    let (first, second) = (point(0.25), point(0.25));
    let mut demonstrations = Vec::new();
    for group in 0..3 {
        let start = point(1.0);
        for number in 0..3 {
            let begin = start + point(0.03);
            let middle = (begin + first) * 0.5 + point(0.05);
            let path = [begin, middle, first + point(0.02), second + point(0.02), DVec3::ZERO];
            demonstrations.push(demonstration(format!("{group}-{number}"), through(&path, 180)));
        }
    }
    demonstrations
}

/// Loops of some millimetres on the way through 5 cm.
fn loops(random: &mut ChaCha8Rng) -> Vec<Demonstration> {
    let rounds = random.random_range(2..4);
    (0..4)
        .map(|number| {
            let radius = 0.006 + 0.001 * random.random::<f64>();
            let turn = |i: usize| {
                let left = 1.0 - i as f64 / (8 * rounds) as f64;
                let angle = f64::from(i as u32) * core::f64::consts::FRAC_PI_4;
                DVec3::new(
                    0.05 * left + radius * left * angle.sin(),
                    radius * left * (angle.cos() - 1.0),
                    0.0,
                )
            };
            let points: Vec<DVec3> = (0..=8 * rounds).map(turn).collect();
            demonstration(format!("{number}"), through(&points, 400))
        })
        .collect()
}

/// The largest rise of V in a step, beside what it falls by, of rollouts from random starts.
fn rise(demonstrations: &[Demonstration], linear_max_m_s: f64, random: &mut ChaCha8Rng) -> f64 {
    let trained = learn(&skill("planar.ron"), demonstrations, 1, &mut |_| {}).unwrap();
    let governor = SpeedGovernor { linear_max_m_s, angular_max_rad_s: 4.0, response_1_s: 8.0 };
    let inertia = SkillInertia { linear_kg: 1.0, angular_kg_m2: 1.0 };
    let policy = LearnedPolicy::with(&trained.model, inertia, Some(governor)).unwrap();
    let frames = [START, GOAL].map(MovingPose::at_rest);
    let radius = demonstrations[0].poses[0].position.length();
    let mut most: f64 = 0.0;
    for i in 0..60 {
        let demonstrated = &demonstrations[i % demonstrations.len()].poses;
        let mut start = demonstrated[random.random_range(0..demonstrated.len() / 2)];
        for axis in 0..2 {
            start.position[axis] += radius * random.random_range(-0.3..0.3);
        }
        let spec = RolloutSpec {
            manifold: Manifold::R2,
            start: Body::at_rest(start),
            step_s: STEP_S,
            steps: 20_000,
        };
        let target = Target { goal: GOAL, arrived: None };
        let outcome = follow(&mut policy.instance(), &frames, &target, &spec, |_| {});
        assert!(outcome.goal_error_m < 0.002, "start {i} ends {} m away", outcome.goal_error_m);
        most = most.max(outcome.energy_rise_max / outcome.energy_at_start);
    }
    most
}

/// Learns from demonstrations that `drawn` makes of each seed.
fn v_falls(seeds: u64, drawn: fn(&mut ChaCha8Rng) -> Vec<Demonstration>, linear_max_m_s: f64) {
    for seed in 0..seeds {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let demonstrations = drawn(&mut random);
        let rise = rise(&demonstrations, linear_max_m_s, &mut random);
        assert!(rise < 1e-9, "seed {seed}: V rises by {rise:e} of its fall");
    }
}

#[test]
fn v_falls_where_the_governor_slows_demonstrations_from_several_places() {
    v_falls(4, groups, 0.6);
}

#[test]
fn v_falls_on_tight_loops() {
    v_falls(2, loops, 0.1);
}
