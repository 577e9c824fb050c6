//! A skill that goes round, on the planar robot: over real ports in lockstep, and its policy alone.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use nalgebra::SVector;
use tprmp_controller::control::server::Shared;
use tprmp_controller::policy::{RobotPolicy, Task, TaskParameters};
use tprmp_controller::startup;
use tprmp_controller::timing::pacing::Pacing;
use tprmp_messages::{Instance, JointCommand, LifeCycle};
use tprmp_model::controller_config::ControllerConfig;
use tprmp_rmpflow::leaves::PoseAttractor;
use tprmp_spatial::{MovingPose, Pose};

use crate::common::{Controller, Setting, answer, file};

const N: usize = 2;
const MS: u64 = 1_000_000;
/// The first states confirm each other: nothing is commanded before.
const CONFIRMING: u64 = 2;
/// The model wipes an ellipse around its frame \[m\].
const AXES: [f64; 2] = [0.15, 0.08];
/// A round lasts so long \[s\].
const PERIOD_S: f64 = 3.0;
const CENTRE: [f64; 3] = [0.1, -0.2, 0.0];
const ROUND: Setting = Setting {
    config: "config/controllers/planar.ron",
    model: "learner/tests/golden/periodic_plane.ron",
    rest: &[0.4, 0.1],
    frames: [("end", CENTRE), ("another", [0.6, 0.3, 0.0])],
};

/// How far a place is from the ellipse, and its angle on it.
fn on_ellipse(position: &[f64]) -> (f64, f64) {
    let [x, y] = [0, 1].map(|i| (position[i] - CENTRE[i]) / AXES[i]);
    ((x.hypot(y) - 1.0).abs() * AXES[0], y.atan2(x))
}

/// How many rounds an angle makes.
fn rounds(angles: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut before) = (0.0, None);
    for angle in angles {
        if let Some(before) = before.replace(angle) {
            let change: f64 = angle - before;
            sum += change - (change / std::f64::consts::TAU).round() * std::f64::consts::TAU;
        }
    }
    sum / std::f64::consts::TAU
}

/// Runs in lockstep with an arm that does exactly what it is commanded. The commands, and how it ended.
fn run(name: &str, ticks: u64) -> (Vec<JointCommand>, LifeCycle) {
    let instance = Instance::new(&format!("{name}-{}", std::process::id())).unwrap();
    let ports = instance.open_state_publisher().unwrap();
    let controller = Controller::start(&ROUND, &instance, Pacing::Lockstep, |_| {});
    let (mut state, mut frames) = (ROUND.state(), ROUND.frames());
    let mut commands: Vec<JointCommand> = Vec::new();
    for tick in 1..=ticks + CONFIRMING {
        if let Some(command) = commands.last() {
            (state.position, state.velocity) = (command.position, command.velocity);
        }
        (state.sequence, frames.sequence) = (tick, tick);
        let time_ns = 1000 * MS + tick * MS;
        (state.time_ns, frames.time_ns) = (time_ns, time_ns);
        assert!(ports.frames.publish(frames) && ports.state.publish(state));
        let command = answer(&ports, tick);
        if tick > CONFIRMING {
            commands.push(command);
        }
    }
    let outcome = controller.stop(|| {
        state.sequence += 1;
        state.time_ns += MS;
        assert!(ports.state.publish(state));
    });
    assert_eq!(outcome.run.allocations, 0);
    (commands, outcome.run.life_cycle)
}

#[test]
fn the_controller_goes_round_and_round_without_a_jump_and_is_never_done() {
    let (commands, life_cycle) = run("round", 14_000);
    assert_eq!(life_cycle, LifeCycle::Running);
    assert!(commands.iter().all(|command| command.reason == 0), "no stall is reported");
    // It comes to its cycle within a round …
    let settled = &commands[3000..];
    let most = settled.iter().map(|c| on_ellipse(&c.position).0).fold(0.0, f64::max);
    assert!(most < 6e-3, "{most}");
    // … and goes round more than three times, at its pace.
    let rounds = rounds(settled.iter().map(|command| on_ellipse(&command.position).1));
    let expected = settled.len() as f64 * 1e-3 / PERIOD_S;
    assert!(rounds > 3.0 && (rounds / expected - 1.0).abs() < 0.1, "{rounds} {expected}");
    // Where a round ends nothing jumps.
    let change = |pair: &[JointCommand]| {
        (0..N)
            .map(|i| (pair[1].acceleration[i] - pair[0].acceleration[i]).abs())
            .fold(0.0, f64::max)
    };
    let most = settled.windows(2).map(change).fold(0.0, f64::max);
    assert!(most < 0.02, "{most} m/s² from a tick to the next");
}

fn policy() -> RobotPolicy<N> {
    let config = file(ROUND.config);
    let loaded = startup::load(&config, &[file(ROUND.model)], false).unwrap();
    let (chain, points) = startup::robot::<N>(&config, &loaded.config).unwrap();
    RobotPolicy::new(chain, loaded.policies(), &points, &loaded.config)
}

/// Follows the policy for some steps. The largest step of the acceleration, the distance from where it should be at the
/// end, and rounds and energy after each step.
fn follow(
    policy: &RobotPolicy<N>,
    mut q: SVector<f64, N>,
    steps: usize,
) -> (f64, f64, Vec<(f64, f64)>) {
    let frame = Pose { position: CENTRE.into(), ..Pose::IDENTITY };
    let frames = [MovingPose::at_rest(frame)];
    let parameters = TaskParameters {
        frames: &frames,
        goal_frame: 0,
        obstacles: &[],
        external: None,
        dt_s: 1e-3,
    };
    let (mut workspace, mut qd) = (policy.workspace(), SVector::<f64, N>::zeros());
    let (mut jump, mut beside, mut told) = (0.0_f64, 0.0, Vec::new());
    let mut before = None;
    for step in 0..steps {
        let decision = policy.evaluate(&q, &qd, &Task::Skill, &parameters, &mut workspace).unwrap();
        if let Some(before) = before.replace(decision.acceleration).filter(|_| step > 3000) {
            let change: SVector<f64, N> = decision.acceleration - before;
            jump = jump.max(change.amax());
        }
        beside = (decision.tool.position - decision.goal.position).length();
        told.push((decision.rounds.unwrap(), decision.energy));
        qd += decision.acceleration * 1e-3;
        q += qd * 1e-3;
        workspace.advance(&decision.acceleration, 1e-3);
    }
    (jump, beside, told)
}

#[test]
fn the_policy_counts_its_rounds_and_its_energy_falls_for_ever() {
    let policy = policy();
    assert!(policy.is_periodic());
    let (jump, beside, told) = follow(&policy, SVector::from([0.4, 0.1]), 13_000);
    assert!(jump < 0.02, "{jump}");
    assert!(beside < 0.015, "it is about where it should be: {beside}");
    let (first, last) = (told[0].0, told[told.len() - 1].0);
    assert!(last - first > 3.5, "{first} {last}");
    assert!(told.windows(2).skip(1000).all(|w| w[1].0 > w[0].0), "on and on");
    assert!(told.windows(2).all(|w| w[1].1 <= w[0].1), "V falls");
}

#[test]
fn it_starts_at_the_nearest_place_of_the_round() {
    let policy = policy();
    let mut phases = Vec::new();
    for k in 0..16 {
        let (sin, cos) = (f64::from(k) / 16.0 * std::f64::consts::TAU).sin_cos();
        let q = SVector::from([CENTRE[0] + 1.1 * AXES[0] * cos, CENTRE[1] + 1.1 * AXES[1] * sin]);
        let (_, beside, told) = follow(&policy, q, 1);
        assert!(beside < 0.03, "from {k}: {beside}");
        phases.push(told[0].0);
    }
    assert!(phases.iter().all(|phase| (0.0..1.0).contains(phase)));
    let turned = rounds(phases.iter().chain(&phases[..1]).map(|s| s * std::f64::consts::TAU));
    assert!((turned - 1.0).abs() < 1e-9, "once round: {phases:?}");
}

#[test]
fn what_needs_a_goal_is_refused_beside_a_skill_that_goes_round() {
    let config = file(ROUND.config);
    let attractor = PoseAttractor {
        linear_inertia_kg: 1.0,
        angular_inertia_kg_m2: 0.0,
        stiffness_1_s2: 4.0,
        damping_1_s: 4.0,
        saturation_m: 0.5,
    };
    let edit = |config: &mut ControllerConfig| config.goal_attractor = Some(attractor);
    let models = [file(ROUND.model)];
    let error = startup::load_with(&config, edit, &models, false).unwrap_err().to_string();
    assert!(error.contains("goal_attractor") && error.contains("goes round"), "{error}");
    let loaded = startup::load(&config, &models, false).unwrap();
    let instance = Instance::new(&format!("until-done-{}", std::process::id())).unwrap();
    let shared = Shared::new(Arc::new(AtomicBool::new(false)));
    let cycle = startup::cycle::<N>(&config, &loaded, Pacing::Lockstep, true, &instance, shared);
    let error = cycle.err().unwrap().to_string();
    assert!(error.contains("--until-done") && error.contains("a periodic one"), "{error}");
}
