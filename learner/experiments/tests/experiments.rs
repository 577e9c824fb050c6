//! `experiments` as a user meets it: errors, and that data sets of every layout are read.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tprmp_experiments::baselines::dmp::Dmp;
use tprmp_experiments::baselines::lqr::Lqr;
use tprmp_experiments::baselines::pd::Pd;
use tprmp_experiments::conditions::Conditions;
use tprmp_experiments::dataset::{SkillSet, read_dataset};
use tprmp_experiments::world::run;
use tprmp_learner::skill::Skill;
use tprmp_learner::train::learn;

use crate::folder::Folder;

const CONFIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config");

fn config(path: &str) -> PathBuf {
    Path::new(CONFIG).join(path)
}

fn experiments(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_experiments"));
    command.args(arguments).args(["--config", CONFIG]).output().unwrap()
}

fn skill(name: &str) -> SkillSet {
    read_dataset(&config("demonstrations/drawings").join(name)).unwrap().remove(0)
}

#[test]
fn a_bad_data_set_is_an_error_that_names_it() {
    let empty = Folder::new("experiments-empty");
    let broken = Folder::new("experiments-broken");
    broken.write("a.json", "{\"demonstrations\": 7}");
    let mixed = Folder::new("experiments-mixed");
    for (skill, file) in [("C", "01.json"), ("S", "02.json")] {
        let from = config("demonstrations/drawings").join(skill).join(file);
        std::fs::copy(from, mixed.path().join(file)).unwrap();
    }
    for (path, expected) in [
        (Path::new("no/such/folder"), "found nothing"),
        (&config("drawings.json"), "found a file"),
        (empty.path(), "LASA"),
        (broken.path(), "a.json"),
        (mixed.path(), "expected `C`, found `S`"),
    ] {
        let output = experiments(&["--dataset", path.to_str().unwrap()]);
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success());
        assert!(message.contains(expected), "{}: {message}", path.display());
    }
}

#[test]
fn the_shipped_data_set_has_skills_with_frames_that_differ() {
    let skills = read_dataset(&config("demonstrations/drawings")).unwrap();
    assert!(skills.len() >= 15);
    for set in &skills {
        assert!(set.demonstrations.len() >= 3, "{}", set.name);
        let [a, b] = [&set.demonstrations[0], &set.demonstrations[1]];
        assert!((a.start.position - b.start.position).length() > 1e-3);
        assert!(a.start.rotation_from(&b.start).length() > 1e-4);
        assert!(a.goal_frame.rotation_from(&b.goal_frame).length() > 1e-4);
    }
}

#[test]
fn frames_with_which_the_thesis_learned_are_taken_where_a_file_has_them() {
    let folder = Folder::new("experiments-reference");
    let file = |reference: &str| {
        let points: Vec<_> = (0..20).map(|i| format!("[0.0{i:02}, 3.5]")).collect();
        let text = r#"{"name": "arc", "dt": 0.01, "manifold": "R2", "quaternion_order": "wxyz",
            "demonstrations": [{"tag": "arc", REFERENCE
              "frames": {"start": {"A": [[0.0, -1.0], [1.0, 0.0]], "b": [0.5, 1.0]},
                         "end": {"A": [[1.0, 0.0], [0.0, 1.0]], "b": [1.9, 2.0]}},
              "positions": [POINTS]}]}"#;
        text.replace("REFERENCE", reference).replace("POINTS", &points.join(", "))
    };
    let frame = |x: f64| format!(r#"{{"A": [[1.0, 0.0], [0.0, 1.0]], "b": [{x}, 8.0]}}"#);
    let both =
        format!(r#""reference_frames": {{"start": {}, "end": {}}},"#, frame(7.0), frame(9.0));
    for (reference, expected) in
        [(both.as_str(), true), (r#""reference_frames": {},"#, false), ("", false)]
    {
        folder.write("C.json", &file(reference));
        let skills = read_dataset(folder.path()).unwrap();
        assert_eq!(skills[0].has_reference_frames(), expected, "{reference}");
    }
}

#[test]
fn baselines_reach_the_demonstrated_goal() {
    let set = skill("S");
    let demonstration = &set.demonstrations[0];
    let conditions = Conditions::demonstrated(&set, 0);
    let positions: Vec<_> = demonstration.poses.iter().map(|pose| pose.position).collect();
    let end = positions[positions.len() - 1];
    // The published gains leave a damping ratio of 0.05: it swings for minutes.
    for (as_published, duration_s) in [(false, 20.0), (true, 400.0)] {
        let conditions = Conditions { duration_s, ..conditions.clone() };
        let mut pd = Pd::new(positions.clone(), demonstration.sampling_time_s, as_published);
        let outcome = run(&mut pd, &conditions);
        let last = outcome.path[outcome.path.len() - 1].position;
        assert!((last - end).length() < 1e-3, "PD, as published: {as_published}, ends at {last}");
    }
    let dmp = Dmp::learn(&set.demonstrations);
    let goal = conditions.frames[1].compose(&conditions.grasp).position;
    let offset = goal - conditions.frames[1].position;
    let outcome = run(&mut dmp.instance(conditions.start.pose.position, offset), &conditions);
    assert!(outcome.goal_error_m < 1e-3, "DMP ends {} m away", outcome.goal_error_m);
    // A displaced goal too.
    let mut displaced = conditions.clone();
    displaced.frames[1].position.x += 0.5;
    let outcome = run(&mut dmp.instance(conditions.start.pose.position, offset), &displaced);
    assert!(outcome.goal_error_m < 1e-3, "DMP ends {} m away", outcome.goal_error_m);
}

#[test]
fn the_regulator_comes_to_rest_in_its_last_gaussian() {
    let set = skill("C");
    let mut file = Skill::read(&config("skills/planar_thesis.ron")).unwrap();
    file.skill.clone_from(&set.name);
    file.certification.random_starts = 0;
    file.certification.displaced_starts = 0;
    let model = learn(&file, &set.demonstrations, 1, &mut |_| {}).unwrap().model;
    let lqr = Lqr::new(&model, file.mixture.covariance_scale, 6.0, 1.0);
    let outcome = run(&mut lqr.instance(), &Conditions::demonstrated(&set, 0));
    assert!(outcome.goal_error_m < 0.25, "{}", outcome.goal_error_m);
    assert!(outcome.own_goal_error_m < 0.02, "{}", outcome.own_goal_error_m);
}
