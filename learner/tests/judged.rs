//! What people get wrong in demonstrations is told: which file, where, by how much.

use crate::common::{arcs, skill, skill_file};
use glam::{DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tprmp_learner::alignment::{align, consistency};
use tprmp_learner::demonstration::{Demonstration, read_folder};
use tprmp_learner::skill::Skill;
use tprmp_learner::train::learn;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

/// The shipped pick.
fn pick() -> (Skill, Vec<Demonstration>) {
    let file = skill_file("pick.ron");
    let mut skill = Skill::read(&file).unwrap();
    skill.certification.random_starts = 2;
    skill.certification.displaced_starts = 2;
    let folder = file.parent().unwrap().join(&skill.demonstrations);
    let demonstrations =
        read_folder(&folder, "pick", Manifold::R3S3, "ee_start", "object", &[]).unwrap();
    (skill, demonstrations)
}

/// The warnings of the pick after a change to some of its demonstrations.
fn warnings(change: impl Fn(usize, &mut Demonstration)) -> Vec<String> {
    let (skill, mut demonstrations) = pick();
    demonstrations.iter_mut().enumerate().for_each(|(i, d)| change(i, d));
    consistency::warnings(&skill, &demonstrations)
}

#[track_caller]
fn one(warnings: &[String], parts: &[&str]) {
    let [warning] = warnings else { panic!("{warnings:?}") };
    assert!(parts.iter().all(|part| warning.contains(part)), "{warning}");
}

/// A quaternion of which somebody wrote x y z w where w x y z is read.
fn misread(pose: &mut Pose) {
    let DQuat { x, y, z, w } = pose.orientation;
    pose.orientation = DQuat::from_xyzw(y, z, w, x);
}

#[test]
fn quaternions_in_another_order_are_told() {
    let samples = |d: &mut Demonstration| d.poses.iter_mut().for_each(misread);
    let frames =
        |d: &mut Demonstration| [&mut d.start, &mut d.goal_frame].into_iter().for_each(misread);
    one(&warnings(|_, d| samples(d)), &["in all files", "of the samples were x y z w"]);
    one(&warnings(|_, d| frames(d)), &["in all files", "of the frames were x y z w"]);
    let both = |_, d: &mut Demonstration| {
        samples(d);
        frames(d);
    };
    one(&warnings(both), &["of samples and frames were x y z w"]);
    let in_one = |i, d: &mut Demonstration| {
        if i == 3 {
            samples(d);
        }
    };
    one(&warnings(in_one), &["`04.json`", "of the samples were x y z w"]);
}

#[test]
fn a_rotated_tool_or_frame_is_told() {
    assert_eq!(warnings(|_, _| ()), Vec::<String>::new());
    let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let tool = |i, d: &mut Demonstration| {
        if i == 2 {
            d.poses.iter_mut().for_each(|pose| pose.orientation *= quarter);
        }
    };
    one(&warnings(tool), &["`03.json` starts and ends rotated", "by 90°", "tool frame"]);
    let goal = |i, d: &mut Demonstration| {
        if i == 2 {
            d.goal_frame.orientation *= quarter;
        }
    };
    one(&warnings(goal), &["`03.json` ends rotated by 90°", "`object`"]);
    let start = |i, d: &mut Demonstration| {
        if i == 2 {
            d.start.orientation *= quarter;
        }
    };
    one(&warnings(start), &["`03.json` starts rotated by 90°", "`ee_start`"]);
}

#[test]
fn ends_that_do_not_fit_are_told() {
    let cut = |i, d: &mut Demonstration| {
        if i == 5 {
            d.poses.truncate(d.poses.len() * 6 / 10);
        }
    };
    one(&warnings(cut), &["`06.json` ends", "mm beside", "in motion: was it cut short?"]);
    let stale = |i, d: &mut Demonstration| {
        if i == 5 {
            d.goal_frame.position.x += 0.05;
        }
    };
    one(&warnings(stale), &["`06.json` ends 50 mm beside", "stale"]);
    // Each ends elsewhere.
    let scatter = |i: usize, d: &mut Demonstration| {
        let angle = 2.4 * i as f64;
        d.goal_frame.position += DVec3::new(angle.cos(), angle.sin(), 0.0) * 0.03;
    };
    one(&warnings(scatter), &["scatter in `object`", "30 mm"]);
    let grasp = |i: usize, d: &mut Demonstration| {
        let yaw = if i.is_multiple_of(2) { 1.4 } else { -1.4 };
        let count = d.poses.len() as f64;
        for (k, pose) in d.poses.iter_mut().enumerate() {
            pose.orientation *= DQuat::from_rotation_z(yaw * k as f64 / (count - 1.0));
        }
    };
    one(&warnings(grasp), &["two groups", "160°", "`01.json`", "`08.json`"]);
}

#[test]
fn two_ways_between_the_same_ends_are_told() {
    let mut demonstrations = arcs(Manifold::R2);
    let mut mirrored = demonstrations.clone();
    for (i, demonstration) in mirrored.iter_mut().enumerate() {
        demonstration.name = format!("mirrored_{i}.json");
        let start = demonstration.poses[0].position;
        let along = (demonstration.goal_frame.position - start).normalize();
        for pose in &mut demonstration.poses {
            let from_start = pose.position - start;
            pose.position = start + 2.0 * along * along.dot(from_start) - from_start;
        }
    }
    demonstrations.extend(mirrored);
    let trained = learn(&skill("planar.ron"), &demonstrations, 1, &mut |_| {}).unwrap();
    let told =
        |w: &String| w.contains("take two paths") && w.contains("`mirrored_0.json`, `mirrored_1");
    assert!(trained.warnings.iter().any(told), "{:?}", trained.warnings);
    // Each of them alone is one.
    let trained = learn(&skill("planar.ron"), &demonstrations[..3], 1, &mut |_| {}).unwrap();
    assert!(!trained.warnings.iter().any(|w| w.contains("take two")), "{:?}", trained.warnings);
}

#[test]
fn pauses_that_all_make_are_kept_and_others_are_not() {
    let (skill, demonstrations) = pick();
    let duration_s = |demonstrations: &[Demonstration]| {
        let aligned = align(&skill, demonstrations).unwrap();
        let first = &aligned.demonstrations[0];
        (first.duration_s(), aligned)
    };
    let (plain_s, _) = duration_s(&demonstrations);
    // A second of rest in the middle.
    let pause = |d: &mut Demonstration| {
        let (middle, dt) = (d.poses.len() / 2, d.sampling_time_s);
        let rest = vec![d.poses[middle]; (1.0 / dt).round() as usize];
        d.poses.splice(middle..middle, rest);
    };
    let mut one = demonstrations.clone();
    pause(&mut one[2]);
    let (one_s, aligned) = duration_s(&one);
    assert!((one_s - plain_s).abs() < 0.1 && aligned.pauses.is_empty(), "{one_s} {plain_s}");
    assert!(
        (aligned.alignments[2].pauses_s - 1.0).abs() < 0.2,
        "{:?}",
        aligned.alignments[2].pauses_s
    );
    let mut all = demonstrations.clone();
    all.iter_mut().for_each(pause);
    let (all_s, aligned) = duration_s(&all);
    let [[_, length_s]] = aligned.pauses[..] else { panic!("{:?}", aligned.pauses) };
    assert!(
        (length_s - 1.0).abs() < 0.2 && (all_s - plain_s - 1.0).abs() < 0.25,
        "{all_s} {plain_s}"
    );
}

#[test]
fn a_turn_without_a_motion_is_a_skill() {
    let (skill, mut demonstrations) = pick();
    for demonstration in &mut demonstrations {
        let first = demonstration.poses[0];
        let count = demonstration.poses.len() as f64;
        for (k, pose) in demonstration.poses.iter_mut().enumerate() {
            let t = k as f64 / (count - 1.0);
            let angle = 2.9 * t * t * (3.0 - 2.0 * t);
            *pose =
                Pose { orientation: first.orientation * DQuat::from_rotation_z(angle), ..first };
        }
        demonstration.goal_frame = first;
    }
    let trained = learn(&skill, &demonstrations, 1, &mut |_| {}).unwrap();
    assert!(trained.model.certificate.holds(), "{:?}", trained.model.certificate.failures);
    for row in &trained.model.fit.demonstrations {
        assert!(row.end_error_rad < 0.01 && row.path_rms_rad < 0.05, "{row:?}");
        assert!(row.end_error_m < 1e-4 && row.path_rms_m < 1e-3, "{row:?}");
    }
}

#[test]
fn noisy_rests_at_the_ends_are_no_pauses() {
    let (skill, mut demonstrations) = pick();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let (mut first_s, mut last_s) = (Vec::new(), Vec::new());
    for d in &mut demonstrations {
        for (rest_s, at_end) in [(&mut first_s, false), (&mut last_s, true)] {
            let seconds = random.random_range(0.7..1.4);
            rest_s.push(seconds);
            let place = if at_end { d.poses.len() } else { 0 };
            let pose = d.poses[place.min(d.poses.len() - 1)];
            let rest = vec![pose; (seconds / d.sampling_time_s) as usize];
            d.poses.splice(place..place, rest);
        }
        for pose in &mut d.poses {
            // A sum of twelve is nearly normal: 1 mm.
            let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            pose.position += 1e-3 * DVec3::new(normal(), normal(), normal());
        }
    }
    let trained = learn(&skill, &demonstrations, 1, &mut |_| {}).unwrap();
    assert!(!trained.warnings.iter().any(|w| w.contains("pauses")), "{:?}", trained.warnings);
    let aligned = align(&skill, &demonstrations).unwrap();
    for (i, alignment) in aligned.alignments.iter().enumerate() {
        let dt = demonstrations[i].sampling_time_s;
        let (begins, ends) = (alignment.samples[0], alignment.samples[alignment.samples.len() - 1]);
        assert!((begins * dt - first_s[i]).abs() < 0.35, "{i}: {begins}");
        let rest_s = (demonstrations[i].poses.len() as f64 - ends) * dt;
        assert!((rest_s - last_s[i]).abs() < 0.35, "{i}: {ends}");
    }
}
