//! What several tests share: folders of their own, and demonstrations made up from formulas.
#![allow(dead_code, reason = "each test uses a part of it")]

mod folder;
pub(crate) mod rounds;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use tprmp_learner::demonstration::{Demonstration, to_text};
use tprmp_learner::skill::Skill;
use tprmp_model::skill_model::{Manifold, Remarks};
use tprmp_spatial::Pose;

pub(crate) use folder::Folder;

impl Folder {
    /// Writes demonstrations as files into a folder in this one.
    pub(crate) fn demonstrations(&self, folder: &str, all: &[Demonstration]) {
        for demonstration in all {
            self.write(
                &format!("{folder}/{}", demonstration.name),
                &to_text(demonstration, "start", "end"),
            );
        }
    }
}

/// The skill files of the repository.
pub(crate) fn skill_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/skills").join(name)
}

/// The text of a skill file for the made-up demonstrations.
pub(crate) fn skill_text(template: &str) -> String {
    let text = std::fs::read_to_string(skill_file(template)).unwrap();
    text.replace("\"ee_start\"", "\"start\"")
        .replace("\"object\"", "\"end\"")
        .replace("\"pick\"", "\"made_up\"")
        .replace("\"planar\"", "\"made_up\"")
        .replace("\"../demonstrations/pick\"", "\"demonstrated\"")
        .replace("\"../demonstrations/planar\"", "\"demonstrated\"")
        .replace("random_starts: 100", "random_starts: 20")
        .replace("displaced_starts: 100", "displaced_starts: 20")
}

/// A skill file for the made-up demonstrations, read.
pub(crate) fn skill(template: &str) -> Skill {
    let folder = Folder::new(&format!("skill-{template}-{:?}", std::thread::current().id()));
    Skill::read(&folder.write("skill.ron", &skill_text(template))).unwrap()
}

/// Progress of a motion that starts and ends at rest; half a second of rest before it.
fn progress(time_s: f64, duration_s: f64) -> f64 {
    let t = ((time_s - 0.5) / duration_s).clamp(0.0, 1.0);
    t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
}

/// Three demonstrations of an arc, in the plane or of poses, each with its own place of the goal.
pub(crate) fn arcs(manifold: Manifold) -> Vec<Demonstration> {
    let planar = manifold == Manifold::R2;
    let arc = |i: usize, shift: f64, rotation_rad: f64| {
        let goal = DVec3::new(0.6 + shift, 0.3 - 0.5 * shift, if planar { 0.0 } else { 0.05 });
        let height = if planar { 0.0 } else { 0.3 };
        let start = Pose { position: DVec3::Z * height, orientation: DQuat::IDENTITY };
        let goal_frame = Pose { position: goal, orientation: DQuat::from_rotation_z(rotation_rad) };
        let down = DQuat::from_rotation_x(2.5);
        let poses = (0..140)
            .map(|k| {
                let s = progress(f64::from(k) * 0.02, 2.0);
                let bulge = (std::f64::consts::PI * s).sin() * 0.15;
                let position = start.position.lerp(goal, s)
                    + if planar { DVec3::new(-0.4, 0.8, 0.0) } else { DVec3::Z } * bulge;
                let orientation = if planar {
                    DQuat::IDENTITY
                } else {
                    let end = goal_frame.orientation * down;
                    DQuat::from_rotation_x(2.0).slerp(end, s)
                };
                Pose { position, orientation }
            })
            .collect();
        Demonstration {
            name: format!("made_up_{i:02}.json"),
            sha256: String::new(),
            skill: "made_up".into(),
            manifold,
            sampling_time_s: 0.02,
            start,
            goal_frame,
            other_frames: BTreeMap::new(),
            remarks: Remarks::default(),
            poses,
            gripper: None,
        }
    };
    vec![arc(1, 0.0, 0.0), arc(2, 0.02, 0.05), arc(3, -0.02, -0.04)]
}
