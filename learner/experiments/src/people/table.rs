//! Learned from hand-like recordings: how well the paths are followed, whatever the pace.

use rayon::prelude::*;
use tprmp_learner::skill::{AlignmentMethod, Skill};
use tprmp_learner::train::learn;

use crate::people::hand::{Hand, Timing};
use crate::people::scene::{GATE, Scene};

/// What one training gave.
#[derive(Clone, Debug)]
pub struct Row {
    /// What was demonstrated.
    pub scene: Scene,
    /// In which timing.
    pub timing: Timing,
    /// How it was aligned.
    pub method: AlignmentMethod,
    /// Seed of the recordings.
    pub seed: u64,
    /// Root of the mean square distance of each recording from the learned path \[m\].
    pub path_rms_m: Vec<f64>,
    /// Whether the frame between start and goal is part of the model.
    pub frame_used: bool,
    /// Whether the certificate holds.
    pub certified: bool,
}

/// Demonstrations of a scene.
#[must_use]
pub fn count(scene: Scene) -> usize {
    match scene {
        Scene::Insertion => 5,
        Scene::Gate => 6,
    }
}

/// The skill of a scene, with every number of a shipped skill file.
#[must_use]
pub fn skill(shipped: &Skill, scene: Scene, method: AlignmentMethod) -> Skill {
    let mut skill = shipped.clone();
    skill.alignment.method = method;
    skill.other_frames = match scene {
        Scene::Insertion => Vec::new(),
        Scene::Gate => vec![GATE.into()],
    };
    skill
}

/// Trains on recordings of every timing and seed.
#[must_use]
pub fn rows(shipped: &Skill, hand: &Hand, methods: &[AlignmentMethod], seeds: u64) -> Vec<Row> {
    let mut cases = Vec::new();
    for scene in [Scene::Insertion, Scene::Gate] {
        for method in methods {
            for timing in Timing::ALL {
                cases.extend((1..=seeds).map(|seed| (scene, *method, timing, seed)));
            }
        }
    }
    let row = |(scene, method, timing, seed): (Scene, AlignmentMethod, Timing, u64)| {
        let demonstrations = hand.demonstrate(scene, timing, count(scene), seed);
        let skill = skill(shipped, scene, method);
        let (path_rms_m, frame_used, certified) =
            match learn(&skill, &demonstrations, 1, &mut |_| {}) {
                Ok(trained) => {
                    let model = trained.model;
                    let used = model.canonical.waypoints.iter().any(|w| w.frame == GATE);
                    let rows = model.fit.demonstrations.iter().map(|row| row.path_rms_m);
                    (rows.collect(), used, model.certificate.holds())
                }
                Err(_) => (vec![f64::INFINITY], false, false),
            };
        Row { scene, timing, method, seed, path_rms_m, frame_used, certified }
    };
    cases.into_par_iter().map(row).collect()
}

/// Median and largest path error of rows \[m\].
#[must_use]
pub fn median_and_max(rows: &[&Row]) -> [f64; 2] {
    let mut all: Vec<f64> = rows.iter().flat_map(|row| &row.path_rms_m).copied().collect();
    all.sort_by(f64::total_cmp);
    match all.len() {
        0 => [f64::NAN; 2],
        count => [0.5 * (all[(count - 1) / 2] + all[count / 2]), all[count - 1]],
    }
}
