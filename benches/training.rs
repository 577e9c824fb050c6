//! How long learning takes: a planar skill (3 × 675 samples, K = 9), a pick (3 × 380, K = 15), and
//! the choice of K. Prints a table, and writes it to `target/bench/results.json`.
//!
//! The samples are those of the repository's demonstrations, brought to these numbers.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use tprmp_bench::results::{self, Verdict};
use tprmp_learner::demonstration::{Demonstration, read_folder};
use tprmp_learner::mixture::components::choose;
use tprmp_learner::modes::Mode;
use tprmp_learner::skill::Skill;
use tprmp_learner::train::{Step, learn};

/// Times each is measured.
const RUNS: usize = 10;
const SEED: u64 = 1;

struct Row {
    name: String,
    /// What the project asks for [s].
    must_s: f64,
    /// In order [s].
    times_s: Vec<f64>,
}

impl Row {
    fn new(name: &str, must_s: f64, mut times: Vec<Duration>) -> Self {
        times.sort();
        let times_s = times.iter().map(Duration::as_secs_f64).collect();
        Self { name: name.into(), must_s, times_s }
    }

    fn at(&self, fraction: f64) -> f64 {
        self.times_s[((self.times_s.len() - 1) as f64 * fraction).round() as usize]
    }
}

/// The first three demonstrations of a skill, at `count` even times.
fn demonstrations(file: &Path, skill: &Skill, count: usize) -> Vec<Demonstration> {
    let folder = file.parent().expect("a file has a folder").join(&skill.demonstrations);
    let (start, goal) = (&skill.start_frame, &skill.goal_frame);
    let mut all =
        read_folder(&folder, &skill.skill, skill.manifold, start, goal, &skill.other_frames)
            .expect("the shipped demonstrations are valid");
    all.truncate(3);
    for demonstration in &mut all {
        let last = demonstration.poses.len() - 1;
        let at = |i: usize| {
            let place = i as f64 * last as f64 / (count - 1) as f64;
            let k = (place.floor() as usize).min(last - 1);
            let (a, b) = (demonstration.poses[k], demonstration.poses[k + 1]);
            let fraction = place - k as f64;
            a.interpolate(&b, fraction)
        };
        let poses = (0..count).map(at).collect();
        demonstration.sampling_time_s *= last as f64 / (count - 1) as f64;
        demonstration.poses = poses;
    }
    all
}

fn measure(
    rows: &mut Vec<Row>,
    file: &str,
    label: &str,
    [samples, components]: [usize; 2],
    musts: [f64; 3],
) {
    let file = PathBuf::from("config/skills").join(file);
    let skill = Skill::read(&file).expect("the shipped skill files are valid");
    let demonstrations = demonstrations(&file, &skill, samples);
    let skill = skill.with_components(components).expect("a number of components in range");
    let (mut fits, mut wholes, mut choices) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..RUNS {
        let since = Instant::now();
        let trained =
            learn(&skill, &demonstrations, SEED, &mut |_| {}).expect("the skill is learned");
        wholes.push(since.elapsed());
        let fitting = trained
            .times
            .iter()
            .filter(|(step, _)| ![Step::DemonstratedStarts, Step::Certificate].contains(step));
        fits.push(fitting.map(|(_, time)| *time).sum());
        let since = Instant::now();
        let mode = Mode::of_all(&skill, &demonstrations).expect("they can be aligned");
        choose(&skill, (&mode.aligned, &mode.set), SEED, 2..=20, &mut |_| {})
            .expect("some number can be learned");
        choices.push(since.elapsed());
    }
    let what = format!("{label}, 3 × {samples} samples, K = {components}");
    rows.push(Row::new(&format!("{what}: EM and fit"), musts[0], fits));
    rows.push(Row::new(&format!("{what}: certificate too"), musts[1], wholes));
    rows.push(Row::new(&format!("{label}: BIC over K = 2 … 20"), musts[2], choices));
}

/// Largest memory of this process so far [MB].
fn memory_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = peak.and_then(|text| text.trim().trim_end_matches(" kB").parse::<f64>().ok());
    kilobytes.unwrap_or(f64::NAN) / 1024.0
}

fn main() {
    let mut rows = Vec::new();
    measure(&mut rows, "planar.ron", "planar", [675, 9], [0.3, 0.5, 3.0]);
    measure(&mut rows, "planar_thesis.ron", "planar, thesis", [675, 9], [0.3, 1.0, 10.0]);
    measure(&mut rows, "pick.ron", "pick", [380, 15], [1.0, 1.0, 3.0]);
    println!("{:<58} {:>8} {:>8} {:>8} {:>8}", "training [s]", "min", "p50", "max", "must");
    for row in &rows {
        let [least, middle, most] = [0.0, 0.5, 1.0].map(|fraction| row.at(fraction));
        println!("{:<58} {least:>8.3} {middle:>8.3} {most:>8.3} {:>8.1}", row.name, row.must_s);
    }
    let memory_mb = memory_mb();
    println!("{:<58} {memory_mb:>26.0} {:>8.0}", "largest memory [MB]", 200.0);
    let mut json: Vec<_> = rows
        .iter()
        .map(|row| {
            serde_json::json!({
                "name": row.name, "seed": SEED, "runs": RUNS,
                "min_s": row.at(0.0), "p50_s": row.at(0.5), "max_s": row.at(1.0),
                "must_s": row.must_s,
                "verdict": Verdict::at_most(row.at(0.5), row.must_s, "s"),
            })
        })
        .collect();
    json.push(serde_json::json!({
        "name": "largest memory", "max_mb": memory_mb, "must_mb": 200.0,
        "verdict": Verdict::at_most(memory_mb, 200.0, "MB"),
    }));
    results::replace("training", &json).unwrap_or_else(|e| panic!("{e}"));
}
