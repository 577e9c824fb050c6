//! Loads a model and rolls it out: its policy moves a tool from the start to a goal that has been
//! shifted.
//!
//! `cargo run -p tprmp-model --example rollout -- my/skill.model.ron`

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use nalgebra::Vector6;
use tprmp_model::skill_model;
use tprmp_rmpflow::PolicyState;
use tprmp_rmpflow::leaves::JointDamping;
use tprmp_rmpflow::policy::SkillInertia;
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration, Twist};

/// Time between two evaluations [s].
const DT_S: f64 = 0.005;

/// How far the tool is from its goal after ten seconds [m].
pub(crate) fn rollout(path: &Path) -> Result<f64, Box<dyn std::error::Error>> {
    let model = skill_model::read(path)?;
    let policy = model.policy()?;
    let mut frames = [model.canonical.start, model.canonical.goal_frame].map(Pose::from);
    frames[1].position += DVec3::new(0.05, -0.02, 0.0);
    let frames = frames.map(MovingPose::at_rest);
    let inertia = SkillInertia { linear_kg: 1.0, angular_kg_m2: 0.1 };
    // Decides where the skill leaves the tool free.
    let damping = JointDamping { inertia: 1e-9, damping_1_s: 8.0 };
    let (mut tool, mut velocity, mut state) = (frames[0].pose, Twist::ZERO, PolicyState::default());
    for _ in 0..2000 {
        let value = policy.evaluate(&inertia, &frames, &tool, &velocity, &mut state);
        let mut root = damping.evaluate(&Vector6::from(velocity));
        root.add(&value.natural);
        let acceleration = SpatialAcceleration::from(root.resolve()?);
        state.advance(&value, &acceleration, DT_S);
        velocity.linear += acceleration.linear * DT_S;
        velocity.angular += acceleration.angular * DT_S;
        tool.position += velocity.linear * DT_S;
        tool.orientation = DQuat::from_scaled_axis(velocity.angular * DT_S) * tool.orientation;
    }
    Ok(tool.position.distance(policy.goal(&frames, &mut state).position))
}

/// Rolls out the model that is named, or one that lies beside the tests.
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/tprmp-model-5.ron");
    let path = std::env::args().nth(1).map_or_else(|| own.into(), PathBuf::from);
    println!("{:.3} mm from the goal after 10 s", 1e3 * rollout(&path)?);
    Ok(())
}
