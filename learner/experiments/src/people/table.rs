//! Learned from hand-like recordings: how well the paths are followed, whatever the pace.

use rayon::prelude::*;
use tprmp_drawing::quantile;
use tprmp_learner::skill::{AlignmentMethod, Skill};
use tprmp_learner::train::learn;

use crate::people::hand::{Hand, Timing};
use crate::people::scene::{GATE, Scene};
use crate::verdict::Verdict;

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
        Scene::Gate | Scene::Place => 6,
    }
}

/// The skill of a scene, with every number of a shipped skill file.
#[must_use]
pub fn skill(shipped: &Skill, scene: Scene, method: AlignmentMethod) -> Skill {
    let mut skill = shipped.clone();
    skill.alignment.method = method;
    skill.other_frames = match scene {
        Scene::Insertion | Scene::Place => Vec::new(),
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

/// Median and largest path error of the rows of a scene, timing and method \[mm\].
fn median_and_max(rows: &[Row], of: (Scene, Timing, AlignmentMethod)) -> [f64; 2] {
    let some = rows.iter().filter(|row| (row.scene, row.timing, row.method) == of);
    let all: Vec<f64> = some.flat_map(|row| &row.path_rms_m).map(|error| 1e3 * error).collect();
    [0.5, 1.0].map(|fraction| quantile(&all, fraction).unwrap_or(f64::NAN))
}

/// How often the gate is part of the model, of how many.
fn gate_used(rows: &[Row], timing: Timing, method: AlignmentMethod) -> [usize; 2] {
    let some = || {
        rows.iter()
            .filter(move |row| (row.scene, row.timing, row.method) == (Scene::Gate, timing, method))
    };
    [some().filter(|row| row.frame_used).count(), some().count()]
}

/// The table: a row a method and timing.
#[must_use]
pub fn cells(rows: &[Row]) -> Vec<Vec<String>> {
    let mut methods: Vec<AlignmentMethod> = rows.iter().map(|row| row.method).collect();
    methods.dedup();
    let mut seen = Vec::new();
    methods.retain(|method| {
        !seen.contains(method) && {
            seen.push(*method);
            true
        }
    });
    let row = |method: AlignmentMethod, timing: Timing| {
        let of = |scene| {
            let [median, most] = median_and_max(rows, (scene, timing, method));
            format!("{median:.1} / {most:.1}")
        };
        let [used, count] = gate_used(rows, timing, method);
        let gate = format!("{used} of {count}");
        vec![format!("{method:?}"), timing.to_string(), of(Scene::Insertion), of(Scene::Gate), gate]
    };
    methods.into_iter().flat_map(|method| Timing::ALL.map(|timing| row(method, timing))).collect()
}

/// Heads of the table's columns.
pub const HEADS: [&str; 5] = [
    "alignment",
    "recordings",
    "insertion, path rms median / max [mm]",
    "gate, path rms median / max [mm]",
    "gate used",
];

/// The table as text.
#[must_use]
pub fn text(rows: &[Row]) -> String {
    let mut text = format!(
        "learned from a hand's recordings\n{:<12} {:<42} {:>16} {:>16}  {}\n",
        "alignment", "recordings", "insertion [mm]", "gate [mm]", "gate used"
    );
    for row in cells(rows) {
        text +=
            &format!("{:<12} {:<42} {:>16} {:>16}  {}\n", row[0], row[1], row[2], row[3], row[4]);
    }
    text
}

/// At a pace of its own a recording is followed as one that keeps time is, up to this factor.
const PACE_FACTOR_MAX: f64 = 1.2;

/// What has to hold of the default alignment; nothing where nothing was learned from such recordings.
pub(crate) fn verdicts(rows: &[Row]) -> Vec<Verdict> {
    if rows.is_empty() {
        return Vec::new();
    }
    let method = AlignmentMethod::Joint;
    let (mut measured, mut failures) = (Vec::new(), Vec::new());
    for scene in [Scene::Insertion, Scene::Gate] {
        let [at_pace, in_time] = [Timing::PaceAndDuration, Timing::KeepingTime]
            .map(|timing| median_and_max(rows, (scene, timing, method)));
        for (name, at_pace, in_time) in
            [("median", at_pace[0], in_time[0]), ("largest", at_pace[1], in_time[1])]
        {
            let text = format!("{scene:?}, {name}: {at_pace:.1} mm, {in_time:.1} mm in time");
            if at_pace.is_nan() || at_pace > PACE_FACTOR_MAX * in_time {
                failures.push(text.clone());
            }
            measured.push(text);
        }
    }
    let unused: Vec<String> = rows
        .iter()
        .filter(|row| row.scene == Scene::Gate && row.method == method && !row.frame_used)
        .map(|row| format!("{}, seed {}", row.timing, row.seed))
        .collect();
    let uncertified = rows.iter().filter(|row| row.method == method && !row.certified);
    let uncertified: Vec<String> = uncertified
        .map(|row| format!("{:?}, {}, seed {}", row.scene, row.timing, row.seed))
        .collect();
    vec![
        Verdict {
            requirement: format!(
                "hand-like recordings: at a pace of their own, path rms at most {PACE_FACTOR_MAX} times that \
                 of recordings that keep time"
            ),
            measured: measured.join("; "),
            holds: Some(failures.is_empty()),
            failures,
        },
        Verdict {
            requirement:
                "hand-like recordings: the gate between start and goal is part of every model"
                    .into(),
            measured: format!("not in {}", unused.len()),
            holds: Some(unused.is_empty()),
            failures: unused,
        },
        Verdict {
            requirement: "hand-like recordings: every certificate holds".into(),
            measured: format!("fails in {}", uncertified.len()),
            holds: Some(uncertified.is_empty()),
            failures: uncertified,
        },
    ]
}
