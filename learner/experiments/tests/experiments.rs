//! `experiments` as a user meets it: errors, and that data sets of every layout are read.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tprmp_experiments::baselines::{Dmp, Lqr, Pd};
use tprmp_experiments::dataset::{SkillSet, read_dataset};
use tprmp_experiments::protocol::shown_course;
use tprmp_experiments::world::{Course, run};
use tprmp_learner::skill::Skill;
use tprmp_learner::train::learn;

#[path = "../../tests/common/folder.rs"]
mod folder;
use folder::Folder;

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
        let told = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success());
        assert!(told.contains(expected), "{}: {told}", path.display());
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
fn baselines_reach_the_demonstrated_goal() {
    let set = skill("S");
    let shown = &set.demonstrations[0];
    let course = shown_course(&set, 0);
    let positions: Vec<_> = shown.poses.iter().map(|pose| pose.position).collect();
    let end = positions[positions.len() - 1];
    // The published gains leave a damping ratio of 0.05: it swings for minutes.
    for (as_published, duration_s) in [(false, 20.0), (true, 400.0)] {
        let course = Course { duration_s, ..course.clone() };
        let mut pd = Pd::new(positions.clone(), shown.sampling_time_s, as_published);
        let trace = run(&mut pd, &course);
        let last = trace.path[trace.path.len() - 1].position;
        assert!((last - end).length() < 1e-3, "PD, as published: {as_published}, ends at {last}");
    }
    let dmp = Dmp::learn(&set.demonstrations);
    let goal = course.frames[1].compose(&course.grasp).position;
    let offset = goal - course.frames[1].position;
    let trace = run(&mut dmp.follower(course.start.position, offset), &course);
    assert!(trace.goal_error_m < 1e-3, "DMP ends {} m away", trace.goal_error_m);
    // A displaced goal too.
    let mut displaced = course.clone();
    displaced.frames[1].position.x += 0.5;
    let trace = run(&mut dmp.follower(course.start.position, offset), &displaced);
    assert!(trace.goal_error_m < 1e-3, "DMP ends {} m away", trace.goal_error_m);
}

#[test]
fn the_regulator_comes_to_rest_in_its_last_gaussian() {
    let set = skill("C");
    let mut file = Skill::read(&config("skills/planar_thesis.ron")).unwrap();
    file.skill.clone_from(&set.name);
    file.certification.random_starts = 0;
    file.certification.displaced_starts = 0;
    let model = learn(&file, &set.demonstrations, 1, &mut |_| {}).unwrap().model;
    let lqr = Lqr::new(&model, file.mixture.covariance_scale, 6.0);
    let trace = run(&mut lqr.follower(), &shown_course(&set, 0));
    assert!(trace.goal_error_m < 0.25, "{}", trace.goal_error_m);
    assert!(trace.own_goal_error_m < 0.02, "{}", trace.own_goal_error_m);
}
