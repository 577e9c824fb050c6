//! Demonstrations that contradict each other become modes of one model.

use crate::common::{Folder, arcs, skill, skill_text};
use glam::{DQuat, DVec3};
use tprmp_learner::demonstration::Demonstration;
use tprmp_learner::mixture::components::Components;
use tprmp_learner::modes::split;
use tprmp_learner::report;
use tprmp_learner::skill::{ModeSettings, Skill};
use tprmp_learner::train::{Trained, learn_modes, train};
use tprmp_model::skill_model::{self, Manifold};

/// Demonstrations that keep `by` times as far from the straight line from their start to their end. Where their
/// frames are has nothing to do with it.
fn bent(manifold: Manifold, count: usize, by: impl Fn(usize) -> f64) -> Vec<Demonstration> {
    let arcs = arcs(manifold);
    let bent = |i: usize| {
        let mut demonstration = arcs[(i * 5 / 3) % arcs.len()].clone();
        demonstration.name = format!("{:02}.json", i + 1);
        let start = demonstration.poses[0].position;
        let end = demonstration.poses[demonstration.poses.len() - 1].position;
        let along = (end - start).normalize();
        // Nobody is as exact as a formula.
        let by = by(i) * (1.0 + 0.03 * (2.4 * i as f64).sin());
        for pose in &mut demonstration.poses {
            let from_start = pose.position - start;
            let on_line = along * along.dot(from_start);
            pose.position = start + on_line + (from_start - on_line) * by;
        }
        demonstration
    };
    (0..count).map(bent).collect()
}

/// Which demonstrations each mode has.
fn members(skill: &Skill, demonstrations: &[Demonstration]) -> Vec<Vec<usize>> {
    let modes = split(skill, demonstrations).unwrap().modes;
    modes.into_iter().map(|mode| mode.members).collect()
}

/// The same, and the model of them.
fn learned(template: &str, demonstrations: &[Demonstration]) -> (Vec<Vec<usize>>, Trained) {
    let skill = skill(template);
    let modes = split(&skill, demonstrations).unwrap();
    let trained = learn_modes(&skill, modes, 1, &mut |_| {}).unwrap();
    (members(&skill, demonstrations), trained)
}

/// Each mode holds its certificate, and follows what was demonstrated.
fn assert_followed(trained: &Trained) {
    for mode in trained.model.modes() {
        assert!(mode.certificate.holds(), "{:?}", mode.certificate.failures);
        for row in &mode.fit.demonstrations {
            assert!(row.path_rms_m < 0.01 && row.path_rms_rad < 0.05, "{row:?}");
            assert!(row.end_error_m < 2e-3 && row.end_error_rad < 0.02, "{row:?}");
        }
    }
}

#[test]
fn left_and_right_are_two_modes() {
    for (template, manifold) in [("planar.ron", Manifold::R2), ("pick.ron", Manifold::R3S3)] {
        let side = |i: usize| if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        let (members, trained) = learned(template, &bent(manifold, 7, side));
        assert_eq!(members, [vec![0, 2, 4, 6], vec![1, 3, 5]], "{template}");
        assert!(trained.warnings[0].contains("take two paths"), "{:?}", trained.warnings);
        assert_followed(&trained);
    }
}

#[test]
fn three_ways_are_three_modes() {
    let way = |i: usize| [1.0, 0.1, -1.0][i % 3];
    let (members, trained) = learned("planar.ron", &bent(Manifold::R2, 9, way));
    assert_eq!(members, [vec![0, 3, 6], vec![1, 4, 7], vec![2, 5, 8]]);
    assert_followed(&trained);
}

#[test]
fn ways_spread_evenly_are_modes_each() {
    let skill = skill("planar.ron");
    for ways in [3, 4, 5, 6] {
        // From one side to the other at equal distances.
        let way = |i: usize| 2.0 * (i % ways) as f64 / (ways - 1) as f64 - 1.0;
        let split = split(&skill, &bent(Manifold::R2, 2 * ways, way)).unwrap();
        let members: Vec<_> = split.modes.into_iter().map(|mode| mode.members).collect();
        let expected: Vec<_> = (0..ways).map(|way| vec![way, way + ways]).collect();
        assert_eq!(members, expected, "{:?}", split.told);
    }
    // Once each.
    assert_eq!(members(&skill, &bent(Manifold::R2, 3, |i| i as f64 - 1.0)), [[0], [1], [2]]);
}

#[test]
fn more_ways_than_a_model_holds_are_told() {
    // Three ways in space, each with four ends.
    let mut demonstrations = bent(Manifold::R3S3, 24, |i| (i % 3) as f64 - 1.0);
    for (i, demonstration) in demonstrations.iter_mut().enumerate() {
        let yaw = std::f64::consts::FRAC_PI_2 * (i / 3 % 4) as f64 - 2.2;
        let last = demonstration.poses.len() as f64 - 1.0;
        for (k, pose) in demonstration.poses.iter_mut().enumerate() {
            pose.orientation *= DQuat::from_rotation_z(yaw * k as f64 / last);
        }
    }
    let split = split(&skill("pick.ron"), &demonstrations).unwrap();
    assert_eq!(split.modes.iter().map(|mode| mode.members.len()).sum::<usize>(), 24);
    assert!(split.modes.len() > 4, "{:?}", split.told);
    assert!(split.told.iter().any(|t| t.contains("at most 8 modes")), "{:?}", split.told);
}

#[test]
fn grasps_from_four_sides_are_four_modes() {
    let mut demonstrations = bent(Manifold::R3S3, 8, |_| 1.0);
    for (i, demonstration) in demonstrations.iter_mut().enumerate() {
        let yaw = std::f64::consts::FRAC_PI_2 * (i % 4) as f64 - 2.2;
        let last = demonstration.poses.len() as f64 - 1.0;
        for (k, pose) in demonstration.poses.iter_mut().enumerate() {
            pose.orientation *= DQuat::from_rotation_z(yaw * k as f64 / last);
        }
    }
    assert_eq!(members(&skill("pick.ron"), &demonstrations), [[0, 4], [1, 5], [2, 6], [3, 7]]);
}

#[test]
fn a_bad_demonstration_hides_no_mode_and_is_none() {
    for (template, manifold) in [("planar.ron", Manifold::R2), ("pick.ron", Manifold::R3S3)] {
        let skill = skill(template);
        let side = |i: usize| if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        let changes: [fn(&mut Demonstration); 2] =
            [|d| d.poses.reverse(), |d| d.poses[40].position += DVec3::new(0.3, 0.2, 0.0)];
        for (c, change) in changes.iter().enumerate() {
            let mut demonstrations = bent(manifold, 7, side);
            change(&mut demonstrations[3]);
            let members = members(&skill, &demonstrations);
            assert_eq!(members.len(), 2, "{template}, change {c}: {members:?}");
            let of = |i: usize| members.iter().position(|m| m.contains(&i));
            assert!([2, 4, 6].iter().all(|i| of(*i) == of(0)), "{template}, {c}: {members:?}");
            assert!(of(5) == of(1) && of(0) != of(1), "{template}, change {c}: {members:?}");
        }
        // Nor where all do the same.
        for change in changes {
            let mut demonstrations = bent(manifold, 6, |_| 1.0);
            change(&mut demonstrations[3]);
            let members = members(&skill, &demonstrations);
            assert_eq!(members, [[0, 1, 2, 3, 4, 5]], "{template}");
        }
    }
}

#[test]
fn two_grasps_are_two_modes() {
    // More than half a turn apart, too: their mean would be neither, nor would it be defined.
    for yaw in [1.4, 1.75] {
        let mut demonstrations = bent(Manifold::R3S3, 6, |_| 1.0);
        for (i, demonstration) in demonstrations.iter_mut().enumerate() {
            let yaw = if i < 3 { yaw } else { -yaw };
            let last = demonstration.poses.len() as f64 - 1.0;
            for (k, pose) in demonstration.poses.iter_mut().enumerate() {
                pose.orientation *= DQuat::from_rotation_z(yaw * k as f64 / last);
            }
        }
        let (members, trained) = learned("pick.ron", &demonstrations);
        assert_eq!(members, [[0, 1, 2], [3, 4, 5]], "yaw {yaw}");
        assert!(trained.warnings[0].contains("end in two groups"), "{:?}", trained.warnings);
        assert_followed(&trained);
    }
}

#[test]
fn one_demonstration_may_be_a_mode_and_is_told() {
    for count in [2, 4] {
        let last = |i: usize| if i + 1 == count { -1.0 } else { 1.0 };
        let (members, trained) = learned("planar.ron", &bent(Manifold::R2, count, last));
        assert_eq!(members.last(), Some(&vec![count - 1]), "{count}");
        let told = format!("has one demonstration, `{count:02}.json`");
        assert!(trained.warnings.iter().any(|w| w.contains(&told)), "{:?}", trained.warnings);
        assert_followed(&trained);
    }
}

#[test]
fn what_is_wrong_with_one_demonstration_makes_no_mode() {
    let skill = skill("pick.ron");
    let whole = bent(Manifold::R3S3, 5, |_| 1.0);
    assert_eq!(members(&skill, &whole), [[0, 1, 2, 3, 4]]);
    let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let changes: [fn(&mut Demonstration, DQuat); 4] = [
        |d, _| d.poses.truncate(90),
        |d, quarter| d.poses.iter_mut().for_each(|pose| pose.orientation *= quarter),
        |d, quarter| d.goal_frame.orientation *= quarter,
        |d, _| d.goal_frame.position += DVec3::X * 0.05,
    ];
    for (i, change) in changes.iter().enumerate() {
        let mut one = whole.clone();
        change(&mut one[3], quarter);
        assert_eq!(members(&skill, &one), [[0, 1, 2, 3, 4]], "change {i}");
    }
}

#[test]
fn the_skill_file_keeps_contradicting_demonstrations_in_one() {
    let demonstrations = bent(Manifold::R2, 6, |i| if i < 3 { 1.0 } else { -1.0 });
    let mut skill = skill("planar.ron");
    assert_eq!(members(&skill, &demonstrations), [[0, 1, 2], [3, 4, 5]]);
    skill.modes = ModeSettings::One;
    assert_eq!(members(&skill, &demonstrations), [[0, 1, 2, 3, 4, 5]]);
}

#[test]
fn a_model_of_modes_is_written_read_printed_and_drawn() {
    let folder = Folder::new("modes");
    let demonstrations = bent(Manifold::R2, 6, |i| if i < 3 { 1.0 } else { -1.0 });
    folder.demonstrations("demonstrated", &demonstrations);
    folder.write("demonstrated/.hidden.json", "{");
    folder.write("demonstrated/notes.txt", "left, then right");
    let file = folder.write("skill.ron", &skill_text("planar.ron"));
    let trained = train(&file, Components::Count(8), 1, &mut |_| {}).unwrap();
    let skipped = |w: &String| w.contains("skipped 1 hidden and 1 foreign");
    assert!(trained.warnings.iter().any(skipped), "{:?}", trained.warnings);
    let path = folder.path().join("modes.model.ron");
    skill_model::write(&trained.model, &path).unwrap();
    let read = skill_model::read(&path).unwrap();
    assert_eq!(read, trained.model);
    assert_eq!(read.modes().len(), 2);
    for text in [report::trained(&trained), report::inspected(&read)] {
        let of = |mode: &str| text.contains(&format!("mode        {mode}"));
        assert!(
            of("1 of 2, from 01.json, 02.json, 03.json") && of("2 of 2, from 04.json"),
            "{text}"
        );
    }
    let out = folder.path().join("pictures");
    let demonstrated = folder.path().join("demonstrated");
    let written = tprmp_learner::plot::plot(&path, &demonstrated, &out).unwrap();
    let named = |name: &str| written.iter().any(|path| path.ends_with(name));
    assert!(named("modes.svg") && named("mode-2-alignment.svg") && named("index.html"));
    // The same mode again is refused.
    for (again, key, first) in
        [(0, "other_modes[0]", "the first mode"), (1, "other_modes[1]", "other_modes[0]")]
    {
        let mut twice = read.clone();
        let mut mode = if again == 0 { read.clone() } else { read.other_modes[0].clone() };
        mode.other_modes.clear();
        twice.other_modes.insert(again, mode);
        let refused = skill_model::write(&twice, &path).unwrap_err().to_string();
        let told = format!("found {first} again");
        assert!(refused.contains(key) && refused.contains(&told), "{refused}");
    }
    // What does not belong together is refused.
    let mut other = read.clone();
    other.other_modes[0].goal_frame = "elsewhere".into();
    other.other_modes[0].frames[1].name = "elsewhere".into();
    let refused = skill_model::write(&other, &path).unwrap_err().to_string();
    assert!(
        refused.contains("other_modes[0].goal_frame") && refused.contains("`end`"),
        "{refused}"
    );
}
