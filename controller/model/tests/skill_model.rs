//! Model files: what is written comes back, and what is wrong is refused by name.

use std::path::PathBuf;

use nalgebra::Vector3;
use proptest::prelude::*;
use tprmp_model::skill_model::{
    ActiveConstraints, Adaptation, BlockCertificate, COORDINATES, Canonical, Certificate,
    Component, Constraints, DemonstrationRollout, FieldModel, Figure, Fit, FrameGaussian,
    FrameMixture, GRIPPER_EVENTS_MAX, Gaussian, GripperAction, GripperEvent, Manifold, ModelError,
    Motion, PolicyModel, Pose, Program, ProgramFit, ProgramStatus, Provenance, Remarks, Rollouts,
    SPLINES, SkillModel, Source, ThesisModel, ValleyCertificate, Waypoint, read, to_text, write,
};

/// A folder of this test alone, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("tprmp-model-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn file(&self) -> PathBuf {
        self.0.join("skill.model.ron")
    }

    /// What reading this text says.
    fn error_of(&self, text: &str) -> ModelError {
        std::fs::write(self.file(), text).unwrap();
        let error = read(&self.file()).unwrap_err();
        let message = error.to_string();
        assert!(message.contains("skill.model.ron"), "`{message}` names the file");
        error
    }

    /// What reading this model, with a right checksum, says.
    fn invalid(&self, change: impl FnOnce(&mut SkillModel)) -> (String, String) {
        let mut model = model();
        change(&mut model);
        match self.error_of(&to_text(&model)) {
            ModelError::Invalid { key, problem, .. } => (key, problem),
            other => panic!("expected an invalid value, found: {other}"),
        }
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).unwrap();
    }
}

#[expect(clippy::too_many_lines, reason = "a whole model, key by key")]
fn model() -> SkillModel {
    let pose = |x: f64| Pose { position_m: [x, 0.0, 0.0], quaternion_wxyz: [1.0, 0.0, 0.0, 0.0] };
    let component = |x: f64, size: f64, potential: f64| Component {
        mean: vec![x, 0.0, x],
        metric: vec![vec![size, 0.0, 0.0], vec![0.0, size, 0.0], vec![0.0, 0.0, 0.7]],
        potential,
        gradient: vec![-potential, 0.0, 0.0],
        hessian: vec![vec![1.0, 0.2, 0.1], vec![0.2, 1.0, 0.0], vec![0.1, 0.0, 2.0]],
    };
    let frame = |name: &str| FrameMixture {
        name: name.into(),
        agreement: vec![[0.01, 0.1], [0.02, 0.2]],
        agreement_fraction: (name == "way").then_some(0.3),
        gaussians: vec![FrameGaussian {
            position_m: vec![0.5, 0.0],
            quaternion_wxyz: None,
            covariance: vec![vec![0.1, 0.01], vec![0.01, 0.1]],
        }],
    };
    let rollouts = |energy_rise_max| Rollouts {
        starts: 10,
        reached: 10,
        goal_error_max_m: 1e-4,
        goal_error_max_rad: 0.0,
        energy_rise_max,
        on_their_way: 0,
    };
    SkillModel {
        skill: "line".into(),
        manifold: Manifold::R2,
        motion: Motion::Discrete,
        tool_frame: "point".into(),
        start_frame: "start".into(),
        goal_frame: "end".into(),
        canonical: Canonical {
            start: pose(0.0),
            goal_frame: pose(1.0),
            goal: pose(1.0),
            rotate_positions: true,
            start_phase: 0.1,
            goal_phase: 1.0,
            waypoints: vec![Waypoint {
                frame: "way".into(),
                pose: pose(0.4),
                point_m: [0.4, 0.1, 0.0],
                phase: 0.4,
            }],
            adaptation: None,
        },
        gripper: Vec::new(),
        gaussians: vec![Gaussian {
            prior: 1.0,
            phase: 0.5,
            mean: vec![0.5, 0.0],
            covariance: vec![vec![0.1, 0.01], vec![0.01, 0.1]],
        }],
        frames: ["start", "end", "way"].map(frame).to_vec(),
        policy: PolicyModel::Canonical {
            position: FieldModel {
                damping_1_s: 8.0,
                phase_width: 0.15,
                components: vec![component(0.3, 1.7, 4.0 / 3.0), component(1.0, 1.0, 0.0)],
                fall_per_round: None,
            },
            orientation: None,
        },
        fit: Fit {
            em_iterations: 15,
            em_log_likelihood: 1.5,
            programs: vec![ProgramFit {
                name: Program::PositionField,
                status: ProgramStatus::Solved,
                iterations: 17,
                objective: 0.02,
                residual: 0.01,
                active: vec![ActiveConstraints {
                    name: Constraints::Descent,
                    active: 3,
                    count: 99,
                }],
                figures: vec![(Figure::Hinge, 0.1)],
            }],
            duration_s: 2.0,
            agreement: vec![[0.01, 0.1], [0.02, 0.2]],
            demonstrations: vec![DemonstrationRollout {
                name: "line_01.json".into(),
                goal_error_m: 1e-9,
                goal_error_rad: 0.0,
                tracking_rms_m: 0.001,
                tracking_rms_rad: 0.0,
                path_rms_m: 0.0005,
                path_rms_rad: 0.01,
                end_error_m: 0.002,
                end_error_rad: 0.02,
                predicted_rms_m: 0.003,
                predicted_rms_rad: 0.03,
                execution_s: 2.5,
                duration_s: 2.0,
                recorded_s: vec![0.1, 1.2, 2.1],
            }],
        },
        certificate: Certificate {
            failures: Vec::new(),
            blocks: vec![BlockCertificate {
                name: "position".into(),
                metric_eigenvalue_min: 0.9,
                metric_eigenvalue_max: 1.7,
                goal_gradient: 1e-15,
                goal_hessian_min_1_s2: 6.0,
                valley: Some(ValleyCertificate {
                    phases: 1000,
                    stiffness_min_1_s2: 6.0,
                    descent_min: 0.2,
                    intervals: 100,
                    unproved: None,
                }),
            }],
            demonstrated_frames: rollouts(1e-17),
            displaced_frames: rollouts(0.0),
            step_s: 0.01,
            cycle: None,
        },
        other_modes: Vec::new(),
        provenance: Provenance {
            tool_version: "0.1.0".into(),
            seed: 1,
            demonstrations: vec![Source {
                file: "line_01.json".into(),
                sha256: "00".into(),
                remarks: Remarks { operator: Some("somebody".into()), notes: None },
            }],
            hyper_parameters: vec![("mixture.components".into(), "1".into())],
        },
    }
}

/// The position field of a canonical model.
fn position(model: &mut SkillModel) -> &mut FieldModel {
    match &mut model.policy {
        PolicyModel::Canonical { position, .. } => position,
        PolicyModel::Thesis(_) => panic!("a canonical model"),
    }
}

fn thesis() -> SkillModel {
    let policy = ThesisModel {
        metric_scale: 0.25,
        huber_threshold: 2.0,
        potentials: vec![0.0],
        damping: vec![1.5],
    };
    SkillModel { policy: PolicyModel::Thesis(policy), ..model() }
}

#[test]
fn what_is_written_comes_back_and_always_as_the_same_bytes() {
    let folder = Folder::new("round");
    write(&model(), &folder.file()).unwrap();
    assert_eq!(read(&folder.file()).unwrap(), model());
    let text = std::fs::read_to_string(folder.file()).unwrap();
    assert_eq!(text, to_text(&model()));
    assert!(text.contains("schema: \"tprmp-model/7\""));
    let left: Vec<_> = std::fs::read_dir(&folder.0).unwrap().collect();
    assert_eq!(left.len(), 1, "no half-written file stays");
}

#[test]
fn layout_and_comments_are_free() {
    let folder = Folder::new("layout");
    let text = to_text(&model()).replace("body: (", "// the skill\nbody:\n (");
    std::fs::write(folder.file(), text).unwrap();
    assert_eq!(read(&folder.file()).unwrap(), model());
}

#[test]
fn missing_and_truncated_files_are_named() {
    let folder = Folder::new("truncated");
    let missing = read(&folder.file()).unwrap_err();
    assert!(matches!(missing, ModelError::Read { .. }));
    assert!(missing.to_string().contains("skill.model.ron"));
    let text = to_text(&model());
    for fraction in [0.0, 0.01, 0.3, 0.9] {
        let cut = (text.len() as f64 * fraction) as usize;
        let error = folder.error_of(&text[..cut]);
        assert!(matches!(error, ModelError::Syntax { .. }), "{error}");
        assert!(error.to_string().contains("truncated"), "{error}");
    }
}

#[test]
fn a_changed_number_breaks_the_checksum() {
    let folder = Folder::new("checksum");
    let text = to_text(&model());
    let changed = text.replacen("1.7", "1.8", 1);
    assert_ne!(changed, text);
    assert!(matches!(folder.error_of(&changed), ModelError::Checksum { .. }));
}

#[test]
fn another_schema_is_reported_before_its_body_is_looked_at() {
    let folder = Folder::new("schema");
    let error = folder.error_of("(schema: \"tprmp-model/9\", checksum: \"\", body: (new: [1, 2]))");
    match error {
        ModelError::Schema { found, .. } => assert_eq!(found, "tprmp-model/9"),
        other => panic!("{other}"),
    }
}

#[test]
fn unknown_keys_are_refused() {
    let folder = Folder::new("unknown");
    let text = to_text(&model()).replacen("damping_1_s:", "dampening: 1.0, damping_1_s:", 1);
    let error = folder.error_of(&text);
    assert!(matches!(error, ModelError::Syntax { .. }));
    assert!(error.to_string().contains("dampening"), "{error}");
}

#[test]
fn numbers_that_are_not_finite_are_named() {
    let folder = Folder::new("finite");
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let (key, problem) = folder.invalid(|m| position(m).components[0].gradient[1] = bad);
        assert_eq!(key, "policy.position.components[0].gradient");
        assert!(problem.contains("finite"));
        assert_eq!(
            folder.invalid(|m| m.canonical.goal.position_m[2] = bad).0,
            "canonical.goal.position_m"
        );
        assert_eq!(
            folder.invalid(|m| position(m).phase_width = bad).0,
            "policy.position.phase_width"
        );
        assert_eq!(folder.invalid(|m| m.gaussians[0].mean[0] = bad).0, "gaussians[0].mean");
    }
}

/// Whoever changes a model can make its checksum fit; `learner plot` reads the files it names.
#[test]
fn names_of_a_model_are_names() {
    let folder = Folder::new("names");
    for bad in ["", "../../secret.json", "/etc/passwd", "a/b", "..", "\u{1b}[2J", "a\nb", "a\0b"] {
        let (key, problem) =
            folder.invalid(|m| m.provenance.demonstrations[0].file = bad.to_owned());
        assert_eq!(key, "provenance.demonstrations[0].file");
        assert!(problem.contains("expected a name of 1 to 100 bytes"), "{problem}");
        assert!(!problem.contains(|c: char| c.is_control()), "{problem:?}");
        assert_eq!(folder.invalid(|m| m.skill = bad.to_owned()).0, "skill");
        assert_eq!(folder.invalid(|m| m.goal_frame = bad.to_owned()).0, "goal_frame");
    }
}

#[test]
fn metrics_that_are_not_positive_definite_are_named() {
    let folder = Folder::new("definite");
    let (key, problem) =
        folder.invalid(|m| position(m).components[0].metric[0] = vec![-1.0, 0.0, 0.0]);
    assert_eq!(key, "policy.position.components[0].metric");
    assert!(problem.contains("positive definite"));
    let (key, problem) = folder.invalid(|m| position(m).components[0].metric[0][1] = 0.5);
    assert_eq!(key, "policy.position.components[0].metric");
    assert!(problem.contains("symmetric"));
    assert_eq!(
        folder.invalid(|m| m.gaussians[0].covariance[1][1] = -1.0).0,
        "gaussians[0].covariance"
    );
}

#[test]
fn the_goal_s_component_is_normalised_and_at_the_goal() {
    let folder = Folder::new("goal");
    let goal = |key: &str| format!("policy.position.components[1].{key}");
    assert_eq!(folder.invalid(|m| position(m).components[1].metric[0][0] = 2.0).0, goal("metric"));
    assert_eq!(folder.invalid(|m| position(m).components[1].potential = 1.0).0, goal("potential"));
    assert_eq!(folder.invalid(|m| position(m).components[1].gradient[0] = 1.0).0, goal("gradient"));
    assert_eq!(
        folder.invalid(|m| position(m).components[1].mean[0] = 0.9).0,
        "policy.position.components"
    );
}

#[test]
fn dimensions_names_and_poses_are_checked() {
    let folder = Folder::new("shape");
    assert_eq!(folder.invalid(|m| m.tool_frame.clear()).0, "tool_frame");
    assert_eq!(folder.invalid(|m| m.manifold = Manifold::R3).0, "gaussians[0].mean");
    assert_eq!(folder.invalid(|m| position(m).damping_1_s = 0.0).0, "policy.position.damping_1_s");
    assert_eq!(folder.invalid(|m| m.gaussians.clear()).0, "gaussians");
    assert_eq!(
        folder.invalid(|m| m.canonical.start.quaternion_wxyz[0] = 0.9).0,
        "canonical.start.quaternion_wxyz"
    );
    let way = |key: &str| format!("canonical.waypoints[0].{key}");
    let changed = |f: fn(&mut Waypoint)| folder.invalid(|m| f(&mut m.canonical.waypoints[0])).0;
    assert_eq!(changed(|w| w.frame = "end".into()), way("frame"));
    assert_eq!(changed(|w| w.frame = "none".into()), way("frame"));
    assert_eq!(changed(|w| w.point_m[1] = f64::NAN), way("point_m"));
    assert_eq!(changed(|w| w.phase = 0.99), "canonical.waypoints");
    let start = |m: &mut SkillModel| m.canonical.start_phase = -0.1;
    assert_eq!(folder.invalid(start).0, "canonical.start_phase");
    let goal = |m: &mut SkillModel| m.canonical.goal_phase = f64::NAN;
    assert_eq!(folder.invalid(goal).0, "canonical.goal_phase");
    let many = |m: &mut SkillModel| {
        let one = position(m).components[0].clone();
        position(m).components = vec![one; 99];
    };
    assert_eq!(folder.invalid(many).0, "policy.position.components");
}

#[test]
fn an_adaptation_is_checked_and_evaluated() {
    let folder = Folder::new("adaptation");
    let mut coefficients = vec![[[0.0; COORDINATES]; COORDINATES]; SPLINES];
    coefficients[3][1][0] = 0.2;
    let whole = Adaptation { reach_m: 0.1, reach_rad: 0.0, coefficients };
    let with = |change: &dyn Fn(&mut SkillModel, &mut Adaptation)| {
        folder.invalid(|m| {
            let mut adaptation = whole.clone();
            m.canonical.waypoints.clear();
            change(m, &mut adaptation);
            m.canonical.adaptation = Some(adaptation);
        })
    };
    assert_eq!(with(&|_, a| a.reach_m = -0.1).0, "canonical.adaptation.reach_m");
    assert_eq!(with(&|_, a| a.reach_rad = f64::NAN).0, "canonical.adaptation.reach_rad");
    assert_eq!(with(&|_, a| a.coefficients.truncate(2)).0, "canonical.adaptation.coefficients");
    let infinite = with(&|_, a| a.coefficients[4][5][5] = f64::INFINITY);
    assert_eq!(infinite.0, "canonical.adaptation.coefficients[4]");
    let between = with(&|m, _| m.canonical.waypoints = model().canonical.waypoints);
    assert_eq!(between.0, "canonical.adaptation");

    let mut valid = model();
    valid.canonical.waypoints.clear();
    assert!(valid.frame_map().unwrap().adaptation().is_none());
    valid.canonical.adaptation = Some(whole.clone());
    let map = valid.frame_map().unwrap();
    assert_eq!(Adaptation::from(map.adaptation().unwrap()), whole);
}

#[test]
fn frames_are_checked() {
    let folder = Folder::new("frames");
    assert_eq!(folder.invalid(|m| m.frames.truncate(1)).0, "frames");
    assert_eq!(folder.invalid(|m| m.frames.swap(0, 1)).0, "frames[0].name");
    let twice = |m: &mut SkillModel| m.frames.push(m.frames[0].clone());
    assert_eq!(folder.invalid(twice).0, "frames[3].name");
    assert_eq!(folder.invalid(|m| m.frames[1].gaussians.clear()).0, "frames[1].gaussians");
    let key = |rest: &str| format!("frames[0].gaussians[0].{rest}");
    assert_eq!(
        folder.invalid(|m| m.frames[0].gaussians[0].position_m[1] = f64::NAN).0,
        key("position_m")
    );
    assert_eq!(
        folder.invalid(|m| m.frames[0].gaussians[0].covariance[0][0] = -1.0).0,
        key("covariance")
    );
    assert_eq!(
        folder.invalid(|m| m.frames[0].gaussians[0].quaternion_wxyz = Some([1.0, 0.0, 0.0, 0.0])).0,
        key("quaternion_wxyz")
    );
    // One frame for start and goal is enough.
    let mut single = model();
    single.start_frame = "end".into();
    single.frames.remove(0);
    write(&single, &folder.file()).unwrap();
}

#[test]
fn which_frame_speaks_when_is_said_and_what_the_skill_file_named_in_vain() {
    let mut model = model();
    assert_eq!(model.fewer_frames(), None);
    let roles = |model: &SkillModel| -> Vec<String> {
        model.frames.iter().map(|frame| model.frame_role(frame)).collect()
    };
    model.frames[2].agreement_fraction = Some(0.25);
    let passed = "acts at phase 0.40 (fraction 0.25)";
    assert_eq!(roles(&model), ["rules to phase 0.10", "rules from phase 1.00", passed]);
    assert!(!model.is_left_out(&model.frames[2]));
    let names = ("other_frames".to_owned(), r#"["way","lid"]"#.to_owned());
    model.provenance.hyper_parameters.push(names);
    assert_eq!(model.named_but_unused(), ["lid"]);
    model.canonical.waypoints.clear();
    assert_eq!(roles(&model)[2], "left out (fraction 0.25)");
    assert!(model.is_left_out(&model.frames[2]));
    let said = model.fewer_frames().unwrap();
    assert!(said.contains("`line`") && said.ends_with("without `way`, `lid`"), "{said}");
    // In the map the demonstrations lie apart where the goal frame sees them agree.
    let apart = |m: f64| vec![[m, 0.0]; 9];
    assert!(model.lost_agreement().is_empty());
    model.fit.agreement = apart(0.1);
    for (frame, m) in model.frames.iter_mut().zip([0.09, 0.01, 0.3]) {
        frame.agreement = apart(m);
    }
    let lost = model.lost_agreement();
    assert!(lost.len() == 1 && lost[0].contains("seen from `end`"), "{lost:?}");
}

#[test]
fn events_of_the_gripper_are_stored_and_checked() {
    let folder = Folder::new("gripper");
    assert!(!to_text(&model()).contains("gripper"), "a model without events has no such key");
    let event = |phase, action| GripperEvent {
        phase,
        time_fraction: 0.4,
        action,
        spread: 0.02,
        demonstrations: 1,
    };
    let mut good = model();
    good.gripper =
        vec![event(0.25, GripperAction::Closes), event(1.0, GripperAction::WidthM(0.04))];
    write(&good, &folder.file()).unwrap();
    assert_eq!(read(&folder.file()).unwrap(), good);
    let invalid = |edit: fn(&mut Vec<GripperEvent>)| {
        folder.invalid(|m| {
            m.gripper.clone_from(&good.gripper);
            edit(&mut m.gripper);
        })
    };
    assert_eq!(invalid(|g| g.swap(0, 1)).0, "gripper[1].phase");
    assert_eq!(invalid(|g| g[0].phase = f64::NAN).0, "gripper[0].phase");
    assert_eq!(invalid(|g| g[1].phase = 1.5).0, "gripper[1].phase");
    assert_eq!(invalid(|g| g[0].spread = -0.1).0, "gripper[0].spread");
    assert_eq!(invalid(|g| g[0].time_fraction = f64::INFINITY).0, "gripper[0].time_fraction");
    let (key, problem) = invalid(|g| g[1].action = g[0].action);
    assert!(key == "gripper[1].action" && problem.contains("closes twice in a row"), "{problem}");
    assert_eq!(invalid(|g| g[0].demonstrations = 0).0, "gripper[0].demonstrations");
    assert_eq!(invalid(|g| g[0].demonstrations = 99).0, "gripper[0].demonstrations");
    assert_eq!(invalid(|g| g[1].action = GripperAction::WidthM(-0.1)).0, "gripper[1].action");
    assert_eq!(invalid(|g| *g = vec![g[0]; GRIPPER_EVENTS_MAX + 1]).0, "gripper");
}

#[test]
fn the_thesis_policy_is_stored_too_and_checked() {
    let folder = Folder::new("thesis");
    write(&thesis(), &folder.file()).unwrap();
    assert_eq!(read(&folder.file()).unwrap(), thesis());
    let invalid = |change: &dyn Fn(&mut ThesisModel)| {
        folder.invalid(|m| {
            *m = thesis();
            if let PolicyModel::Thesis(policy) = &mut m.policy {
                change(policy);
            }
        })
    };
    assert_eq!(invalid(&|p| p.metric_scale = 0.0).0, "policy.metric_scale");
    assert_eq!(invalid(&|p| p.huber_threshold = f64::NAN).0, "policy.huber_threshold");
    assert_eq!(invalid(&|p| p.potentials.push(1.0)).0, "policy.potentials");
    assert_eq!(invalid(&|p| p.damping[0] = 0.0).0, "policy.damping[0]");
}

#[test]
fn an_invalid_model_is_not_written() {
    let folder = Folder::new("write");
    let mut broken = model();
    position(&mut broken).phase_width = -1.0;
    let error = write(&broken, &folder.file()).unwrap_err();
    assert!(matches!(error, ModelError::Invalid { .. }));
    assert!(!folder.file().exists());
    let nowhere = folder.0.join("missing/skill.model.ron");
    assert!(matches!(write(&model(), &nowhere).unwrap_err(), ModelError::Write(_)));
}

#[test]
fn the_field_is_the_one_that_is_stored() {
    let mut model = model();
    let stored = position(&mut model);
    let field = stored.field::<3>();
    assert_eq!(field.goal(), Vector3::new(1.0, 0.0, 1.0));
    let parts = FieldModel::from_parts(field.components(), stored.phase_width, 8.0);
    assert_eq!(parts, *stored);
    assert_eq!(field.damping_1_s(), 8.0);
}

/// What stands in place of a number of a spoiled file.
const WORDS: [&str; 12] =
    ["NaN", "-inf", "1e308", "1e-320", "-1.0", "0.0", "[]", "[[0.0]]", "()", "\"\"", "None", ","];

/// A model's file with some numbers replaced, and, where it can still be parsed, the same with the
/// checksum that belongs to it.
fn spoiled(model: &SkillModel, places: &[(prop::sample::Index, &str)]) -> (String, Option<String>) {
    let text = to_text(model);
    let between = [' ', ',', '\n', '(', ')', '[', ']'];
    let mut parts: Vec<&str> = text.split_inclusive(between).collect();
    let is_number = |part: &str| part.starts_with(|c: char| c == '-' || c.is_ascii_digit());
    let numbers: Vec<usize> = (0..parts.len()).filter(|i| is_number(parts[*i])).collect();
    let mut changed = Vec::new();
    for (place, word) in places {
        let place = numbers[place.index(numbers.len())];
        let separator = &parts[place][parts[place].len() - 1..];
        changed.push((place, [word, separator].concat()));
    }
    for (place, word) in &changed {
        parts[*place] = word;
    }
    let spoiled = parts.concat();
    let body = spoiled.split_once("body: ").and_then(|(_, rest)| rest.strip_suffix(",\n)\n"));
    let parsed = body.and_then(|body| ron::from_str::<SkillModel>(body).ok());
    let summed = parsed.map(|model| to_text(&model));
    (spoiled, summed)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..Default::default() })]

    #[test]
    fn random_bytes_are_refused(
        bytes in prop::collection::vec(any::<u8>(), 0..400), kept in any::<prop::sample::Index>(),
    ) {
        let folder = Folder::new("random");
        let good = to_text(&model());
        for beginning in ["", &good[..kept.index(good.len())]] {
            std::fs::write(folder.file(), [beginning.as_bytes(), &bytes].concat()).unwrap();
            prop_assert!(read(&folder.file()).unwrap_err().to_string().contains("skill.model.ron"));
        }
    }

    #[test]
    fn spoiled_models_never_panic(
        is_thesis in any::<bool>(),
        bytes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
        words in prop::collection::vec(
            (any::<prop::sample::Index>(), prop::sample::select(WORDS.to_vec())), 1..4,
        ),
    ) {
        let folder = Folder::new("spoiled");
        let good = if is_thesis { thesis() } else { model() };
        let (changed, summed) = spoiled(&good, &words);
        let mut flipped = to_text(&good).into_bytes();
        for (place, byte) in &bytes {
            let place = place.index(flipped.len());
            flipped[place] = *byte;
        }
        let texts = [Some(changed.into_bytes()), summed.map(String::into_bytes), Some(flipped)];
        for text in texts.into_iter().flatten() {
            std::fs::write(folder.file(), text).unwrap();
            match read(&folder.file()) {
                // What is valid can be evaluated, or says why not.
                Ok(model) => drop(model.policy()),
                Err(error) => prop_assert!(error.to_string().contains("skill.model.ron")),
            }
        }
    }
}
