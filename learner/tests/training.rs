//! The whole path from demonstrations to a model, on made-up demonstrations.

use std::path::PathBuf;
use std::process::{Command, Output};

use crate::common::{Folder, arcs, skill, skill_text};
use glam::{DQuat, DVec3};
use tprmp_learner::demonstration::{Demonstration, Grip, Gripper};
use tprmp_learner::mixture::components::Components;
use tprmp_learner::report;
use tprmp_learner::skill::Initialisation;
use tprmp_learner::train::{TrainError, Trained, learn, train};
use tprmp_model::skill_model::{
    self, FieldModel, Figure, Manifold, PolicyModel, ProgramStatus, to_text,
};
use tprmp_spatial::Pose;

fn learned(template: &str, demonstrated: &[Demonstration]) -> Result<Trained, TrainError> {
    learn(&skill(template), demonstrated, 1, &mut |_| {})
}

/// The orientation field of a canonical model.
fn orientation(trained: &Trained) -> Option<&FieldModel> {
    match &trained.model.policy {
        PolicyModel::Canonical { orientation, .. } => orientation.as_ref(),
        PolicyModel::Thesis(_) => panic!("a canonical model"),
    }
}

#[track_caller]
fn check(trained: &Trained, rms_max_m: f64, rms_max_rad: f64) {
    let (fit, certificate) = (&trained.model.fit, &trained.model.certificate);
    assert!(certificate.holds(), "{:?}", certificate.failures);
    for (program, block) in fit.programs.iter().zip(&certificate.blocks) {
        assert_eq!(program.status, ProgramStatus::Solved);
        assert!(block.goal_hessian_min_1_s2 > 5.99 && block.goal_gradient < 1e-9, "{block:?}");
        assert!(block.metric_eigenvalue_min > 0.0);
        let valley = block.valley.unwrap();
        assert!(valley.stiffness_min_1_s2 > 5.99 && valley.descent_min > 0.0, "{valley:?}");
    }
    for row in &fit.demonstrations {
        assert!(row.goal_error_m < 1e-5 && row.goal_error_rad < 1e-4, "{row:?}");
        assert!(row.tracking_rms_m < rms_max_m && row.tracking_rms_rad < rms_max_rad, "{row:?}");
        assert!(row.path_rms_m < 0.004, "{row:?}");
    }
    for rollouts in [&certificate.demonstrated_frames, &certificate.displaced_frames] {
        assert_eq!((rollouts.starts, rollouts.reached), (20, 20));
        assert!(rollouts.energy_rise_max < 1e-12, "{}", rollouts.energy_rise_max);
    }
}

#[test]
fn a_planar_skill_is_learned() {
    let trained = learned("planar.ron", &arcs(Manifold::R2)).unwrap();
    check(&trained, 0.0125, 0.0_f64.next_up());
    assert!(orientation(&trained).is_none());
    assert_eq!(trained.model.gaussians.len(), 9);
}

#[test]
fn frames_of_a_planar_skill_may_point_anywhere() {
    let mut demonstrated = arcs(Manifold::R2);
    for demonstration in &mut demonstrated {
        // Half a rotation of everything about the origin.
        let half = DQuat::from_rotation_z(std::f64::consts::PI);
        for frame in [&mut demonstration.start, &mut demonstration.goal_frame] {
            frame.orientation = half * frame.orientation;
            frame.position = half * frame.position * DVec3::new(1.0, 1.0, 0.0);
        }
        for pose in &mut demonstration.poses {
            pose.position = half * pose.position;
        }
    }
    check(&learned("planar.ron", &demonstrated).unwrap(), 0.0125, 0.0_f64.next_up());
}

#[test]
fn a_skill_of_poses_is_learned() {
    let trained = learned("pick.ron", &arcs(Manifold::R3S3)).unwrap();
    check(&trained, 0.024, 0.016);
    assert_eq!(
        orientation(&trained).unwrap().components.last().unwrap().mean,
        [0.0, 0.0, 0.0, 1.0]
    );
    assert_eq!(trained.model.gaussians[0].mean.len(), 6);
}

#[test]
fn an_orientation_that_hardly_moves_still_has_a_strict_attractor() {
    let mut demonstrated = arcs(Manifold::R3S3);
    for (i, demonstration) in demonstrated.iter_mut().enumerate() {
        for (k, pose) in demonstration.poses.iter_mut().enumerate() {
            let shake = 1e-4 * (i as f64 + 37.0 * k as f64).sin();
            pose.orientation =
                demonstration.goal_frame.orientation * DQuat::from_scaled_axis(DVec3::X * shake);
        }
    }
    let trained = learned("pick.ron", &demonstrated).unwrap();
    check(&trained, 0.02, 0.05);
    let scale = trained.model.fit.programs[1].figure(Figure::LengthScale).unwrap();
    assert!(scale < 3.0, "noise is not blown up: {scale}");
}

#[test]
fn demonstrations_that_contradict_each_other_are_warned_of() {
    let mut demonstrated = arcs(Manifold::R2);
    let along = demonstrated[1].goal_frame.position.normalize();
    for pose in &mut demonstrated[1].poses {
        // The arc bulges to the other side.
        pose.position = 2.0 * along * along.dot(pose.position) - pose.position;
    }
    let trained = learned("planar.ron", &demonstrated).unwrap();
    let warned = trained.warnings.join("; ");
    assert!(warned.contains("made_up_02.json") && warned.contains("contradict"), "{warned}");
}

#[test]
fn quaternions_of_either_sign_give_the_same_model() {
    let mut demonstrated = arcs(Manifold::R3S3);
    let before = learned("pick.ron", &demonstrated).unwrap();
    for pose in &mut demonstrated[1].poses {
        pose.orientation = -pose.orientation;
    }
    demonstrated[2].goal_frame.orientation = -demonstrated[2].goal_frame.orientation;
    let after = learned("pick.ron", &demonstrated).unwrap();
    let mean = |t: &Trained| orientation(t).unwrap().components[0].mean.clone();
    for (a, b) in mean(&before).iter().zip(mean(&after)) {
        assert!((a - b).abs() < 1e-9);
    }
}

#[test]
fn the_same_input_and_seed_give_the_same_bytes() {
    let folder = Folder::new("bytes");
    folder.demonstrations("demonstrated", &arcs(Manifold::R3S3));
    let file = folder.write("skill.ron", &skill_text("pick.ron"));
    let text =
        |seed| to_text(&train(&file, Components::SkillFile, seed, &mut |_| {}).unwrap().model);
    let first = text(1);
    assert_eq!(first, text(1));
    assert_ne!(first, text(2));
}

#[test]
fn k_means_learns_too_and_depends_on_the_seed_only() {
    let mut skill = skill("planar.ron");
    skill.mixture.initialisation = Initialisation::KMeans;
    let demonstrated = arcs(Manifold::R2);
    let trained = |seed| learn(&skill, &demonstrated, seed, &mut |_| {}).unwrap();
    let first = trained(1);
    check(&first, 0.0125, 0.0_f64.next_up());
    assert_eq!(to_text(&first.model), to_text(&trained(1).model));
    assert_ne!(first.model.gaussians, trained(2).model.gaussians);
}

#[test]
fn the_number_of_gaussians_is_chosen_by_the_criterion() {
    let folder = Folder::new("components");
    folder.demonstrations("demonstrated", &arcs(Manifold::R2));
    let file = folder.write("skill.ron", &skill_text("planar.ron"));
    let auto = |least, most| train(&file, Components::Auto { least, most }, 1, &mut |_| {});
    let trained = auto(2, 12).unwrap();
    let choice = trained.choice.as_ref().unwrap();
    let numbers: Vec<_> = choice.candidates.iter().map(|c| c.components).collect();
    assert_eq!(numbers, (2..=12).collect::<Vec<_>>());
    let least = choice.candidates.iter().map(|c| c.bic).fold(f64::INFINITY, f64::min);
    for candidate in &choice.candidates {
        // Three coordinates with the phase: 3 of the mean, 6 of the covariance, the prior.
        assert_eq!(candidate.parameters, 10 * candidate.components - 1);
        assert_eq!(candidate.bic == least, candidate.components == choice.components);
    }
    // The chosen mixture is the trained one, and the model says so.
    let model = &trained.model;
    assert_eq!(model.gaussians.len(), choice.components);
    let value = |key: &str| {
        let values = &model.provenance.hyper_parameters;
        values.iter().find(|(name, _)| name == key).map(|(_, value)| value.clone())
    };
    assert_eq!(value("mixture.components"), Some(choice.components.to_string()));
    assert_eq!(value("mixture.components_origin").unwrap(), "BIC among 2 to 12");
    let again = train(&file, Components::Count(choice.components), 1, &mut |_| {}).unwrap();
    assert_eq!((&model.policy, &model.gaussians), (&again.model.policy, &again.model.gaussians));
    assert!(again.choice.is_none());
    assert_eq!(to_text(model), to_text(&auto(2, 12).unwrap().model));
    let said = report::trained(&trained);
    let marked = said.lines().find(|line| line.contains("< least, chosen")).unwrap();
    assert!(marked.trim_start().starts_with(&choice.components.to_string()), "{said}");
    assert!(report::trained(&auto(2, 3).unwrap()).contains("--components-range"));

    for components in [Components::Count(900), Components::Auto { least: 0, most: 5 }] {
        let message = train(&file, components, 1, &mut |_| {}).unwrap_err().to_string();
        assert!(message.contains("--components") && message.contains("expected 1 to"), "{message}");
    }
}

/// Frames may lie in opposite directions, and start and goal frame at the same place.
#[test]
fn goals_on_the_other_side_of_the_start_are_learned_together() {
    let mut opposite = arcs(Manifold::R2);
    let half = DQuat::from_rotation_z(std::f64::consts::PI);
    opposite[1].goal_frame.position = half * opposite[1].goal_frame.position;
    opposite[1].poses.iter_mut().for_each(|pose| pose.position = half * pose.position);
    let rotated = |frame: Pose| Pose {
        orientation: DQuat::from_rotation_z(3.0) * frame.orientation,
        ..frame
    };
    opposite[1].start = rotated(opposite[1].start);
    opposite[1].goal_frame = rotated(opposite[1].goal_frame);
    let trained = learned("planar.ron", &opposite).unwrap();
    assert!(trained.model.certificate.holds(), "{:?}", trained.model.certificate.failures);

    let mut same = arcs(Manifold::R2);
    for demonstration in &mut same {
        demonstration.start.position = demonstration.goal_frame.position;
    }
    let trained = learned("planar.ron", &same).unwrap();
    assert!(trained.model.certificate.holds(), "{:?}", trained.model.certificate.failures);
}

/// A closed path, and one that crosses itself: no field of the place alone follows them.
#[test]
fn closed_and_crossing_paths_are_followed() {
    let along = |point: &dyn Fn(f64) -> DVec3| {
        let mut demonstrated = arcs(Manifold::R2);
        for demonstration in &mut demonstrated {
            let (start, last) = (demonstration.start.position, demonstration.poses.len() - 1);
            for (k, pose) in demonstration.poses.iter_mut().enumerate() {
                let t = ((k as f64 - 25.0) / (last as f64 - 30.0)).clamp(0.0, 1.0);
                pose.position = start + point(t * t * t * (10.0 - 15.0 * t + 6.0 * t * t));
            }
            demonstration.goal_frame.position = demonstration.poses[last].position;
        }
        demonstrated
    };
    let full = std::f64::consts::TAU;
    let circle = |u: f64| DVec3::new((full * u).sin(), 1.0 - (full * u).cos(), 0.0) * 0.2;
    // An eight that begins at the top of a loop: it crosses itself elsewhere than at its goal.
    let eight = |u: f64| {
        let at = |u: f64| DVec3::new((full * u).sin(), 0.5 * (2.0 * full * u).sin(), 0.0) * 0.3;
        at(u + 0.125) - at(0.125)
    };
    check(&learned("planar.ron", &along(&circle)).unwrap(), 0.03, 0.0_f64.next_up());
    let trained = learned("planar.ron", &along(&eight)).unwrap();
    assert!(trained.model.certificate.holds(), "{:?}", trained.model.certificate.failures);
    for row in &trained.model.fit.demonstrations {
        assert!(row.goal_error_m < 1e-5 && row.path_rms_m < 0.02, "{row:?}");
    }
}

#[test]
fn demonstrations_that_cannot_be_learned_from_are_named() {
    let message = |demonstrated: &[Demonstration]| match learned("pick.ron", demonstrated) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("the demonstrations were learned from"),
    };

    let mut rotated = arcs(Manifold::R3S3);
    for demonstration in &mut rotated {
        let end = demonstration.goal_frame.orientation * DQuat::from_rotation_x(2.5);
        for pose in &mut demonstration.poses[50..60] {
            pose.orientation = end * DQuat::from_rotation_y(3.1);
        }
    }
    let text = message(&rotated);
    assert!(text.contains("made_up_01.json") && text.contains("171°"), "{text}");

    let mut still = arcs(Manifold::R3S3);
    let rest = still[1].poses[0];
    still[1].poses.fill(rest);
    let text = message(&still);
    assert!(text.contains("made_up_02.json") && text.contains("does not move"), "{text}");

    let mut short = arcs(Manifold::R3S3);
    short.truncate(1);
    short[0].poses = short[0].poses.iter().copied().skip(30).step_by(9).collect();
    assert!(message(&short).contains("mixture.components"));
}

#[test]
fn the_demonstration_with_which_a_program_cannot_be_solved_is_named() {
    // The canonical policy sees a common time; the thesis' the recordings' own.
    let mut demonstrated = arcs(Manifold::R2);
    demonstrated[1].sampling_time_s = 1e-200;
    let message = learned("planar_thesis.ron", &demonstrated).unwrap_err().to_string();
    assert!(message.contains("`made_up_02.json` causes it"), "{message}");
}

#[test]
fn a_broken_sample_is_warned_of_and_its_model_fails_the_certificate() {
    let mut demonstrated = arcs(Manifold::R2);
    demonstrated[1].poses[70].position = DVec3::new(5e5, -5e5, 0.0);
    let trained = learned("planar_thesis.ron", &demonstrated).unwrap();
    let warned = |word: &str| {
        trained.warnings.iter().any(|w| w.contains("`made_up_02.json`") && w.contains(word))
    };
    assert!(warned("jumps by") && warned("millimetres"), "{:?}", trained.warnings);
    let failures = &trained.model.certificate.failures;
    assert!(failures.iter().any(|failure| failure.contains("`made_up_01.json`")), "{failures:?}");
    assert!(failures.iter().all(|failure| failure.len() < 200), "{failures:?}");
}

fn learner(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_learner")).args(arguments).output().unwrap()
}

/// A folder with demonstrations, their skill file, and the path of the model to be.
fn to_train(name: &str) -> (Folder, PathBuf, PathBuf) {
    let folder = Folder::new(name);
    folder.demonstrations("demonstrated", &arcs(Manifold::R2));
    let file = folder.write("skill.ron", &skill_text("planar.ron"));
    let model = folder.path().join("model.ron");
    (folder, file, model)
}

#[test]
fn the_command_trains_inspects_and_says_what_is_wrong() {
    let (folder, file, model) = to_train("command");
    let [file, out] = [&file, &model].map(|path| path.to_str().unwrap());

    let trained = learner(&["train", file, "--out", out, "--seed", "3"]);
    let said = String::from_utf8(trained.stdout).unwrap();
    assert!(trained.status.success(), "{}", String::from_utf8_lossy(&trained.stderr));
    assert!(said.contains("made_up_02.json") && said.contains("20 of 20 reach the goal"), "{said}");

    let inspected = learner(&["inspect", out]);
    let said = String::from_utf8(inspected.stdout).unwrap();
    assert!(inspected.status.success());
    for part in ["made_up (R2)", "position field", "seed 3", "mixture.components = 9", "sha256"] {
        assert!(said.contains(part), "`{part}` is missing in\n{said}");
    }
    let mut read = skill_model::read(&model).unwrap();
    assert_eq!(said, report::inspected(&read));
    let mut coefficients = vec![[[0.0; skill_model::COORDINATES]; skill_model::COORDINATES]; 9];
    coefficients[2][1][0] = -0.025;
    read.canonical.adaptation =
        Some(skill_model::Adaptation { reach_m: 0.125, reach_rad: 0.0, coefficients });
    let said = report::inspected(&read);
    assert!(said.contains("up to 0.125 m and 0.0°: coefficients up to 25.0 mm"), "{said}");

    std::fs::remove_file(&model).unwrap();
    folder.write("demonstrated/made_up_02.json", "{");
    let failed = learner(&["train", file, "--out", out]);
    let said = String::from_utf8(failed.stderr).unwrap();
    assert_eq!(failed.status.code(), Some(1));
    assert!(said.contains("made_up_02.json"), "{said}");
    assert!(!model.exists());
    assert!(!learner(&["inspect", out]).status.success());
}

#[test]
fn remarks_come_into_the_provenance_and_are_printed_without_their_control_characters() {
    let (folder, file, model) = to_train("remarks");
    let [file, out] = [&file, &model].map(|path| path.to_str().unwrap());
    let second = folder.path().join("demonstrated/made_up_02.json");
    let good = std::fs::read_to_string(&second).unwrap();
    let with = |operator: &str| {
        let keys =
            format!("\"operator\": \"{operator}\", \"notes\": \"left hand\", \"sampling_time_s\"");
        folder.write("demonstrated/made_up_02.json", &good.replace("\"sampling_time_s\"", &keys))
    };
    with("Ada\\u001b[2J");
    assert!(learner(&["train", file, "--out", out]).status.success());
    let said = String::from_utf8(learner(&["inspect", out]).stdout).unwrap();
    assert!(said.contains("operator  Ada\\u{1b}[2J\n    notes  left hand"), "{said}");
    let read = skill_model::read(&model).unwrap();
    assert_eq!(read.provenance.demonstrations[1].remarks.notes.as_deref(), Some("left hand"));
    assert!(read.provenance.demonstrations[0].remarks.is_empty());
    with(&"x".repeat(2001));
    let said = String::from_utf8(learner(&["train", file, "--out", out]).stderr).unwrap();
    assert!(said.contains("key `operator`") && said.contains("found 2001"), "{said}");
}

#[test]
fn the_gripper_s_closing_is_an_event_of_the_model_and_nothing_else_changes() {
    let (folder, file, model) = to_train("gripper");
    let mut demonstrated = arcs(Manifold::R2);
    let count = demonstrated.len();
    for demonstration in &mut demonstrated[..count - 1] {
        // In the last samples, in which the point has all but arrived.
        let samples = demonstration.poses.len();
        let grip = |i| if i + 2 < samples { Grip::Open } else { Grip::Closed };
        demonstration.gripper = Some(Gripper::Grips((0..samples).map(grip).collect()));
    }
    folder.demonstrations("demonstrated", &demonstrated);
    let [file, out] = [&file, &model].map(|path| path.to_str().unwrap());
    let said = String::from_utf8(learner(&["train", file, "--out", out]).stdout).unwrap();
    let line =
        format!("gripper closes at phase 1.00 ({} of {count} demonstrations, within", count - 1);
    assert!(said.contains(&line), "{said}");
    assert!(said.contains("says nothing of the gripper"), "{said}");
    let inspected = String::from_utf8(learner(&["inspect", out]).stdout).unwrap();
    assert!(inspected.contains(&line), "{inspected}");
    let found = skill_model::read(&model).unwrap();
    let pictures = folder.path().join("pictures");
    let drawn = ["plot", out, "--demonstrations", "demonstrated", "--out", "pictures"];
    let drawn = drawn.map(|name| match name {
        "demonstrated" => folder.path().join(name).to_str().unwrap().to_owned(),
        "pictures" => pictures.to_str().unwrap().to_owned(),
        other => other.to_owned(),
    });
    assert!(learner(&drawn.each_ref().map(String::as_str)).status.success());
    let picture = std::fs::read_to_string(pictures.join("gaussians.svg")).unwrap();
    assert!(picture.contains("gripper changes"));
    let page = std::fs::read_to_string(pictures.join("index.html")).unwrap();
    assert!(page.contains(&line));
    // Without the channel: the same model, but for its events and its sources' checksums.
    folder.demonstrations("demonstrated", &arcs(Manifold::R2));
    assert!(learner(&["train", file, "--out", out]).status.success());
    let mut without = skill_model::read(&model).unwrap();
    assert!(without.gripper.is_empty());
    without.gripper.clone_from(&found.gripper);
    without.provenance.demonstrations.clone_from(&found.provenance.demonstrations);
    assert_eq!(without, found);
}

#[test]
fn more_components_than_samples_fill_say_how_many_fit() {
    let demonstrated = arcs(Manifold::R2);
    let mut asked = skill("planar.ron");
    asked.mixture.components = 60;
    let message = learn(&asked, &demonstrated, 1, &mut |_| {}).unwrap_err().to_string();
    let fit: usize =
        message.split(" fit").next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    asked.mixture.components = fit;
    assert!(fit > 9 && learn(&asked, &demonstrated, 1, &mut |_| {}).is_ok(), "{message}");
}
