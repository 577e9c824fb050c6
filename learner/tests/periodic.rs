//! Periodic skills: rounds are found in recordings, and the limit cycle that is learned from them is certified.

use crate::common::rounds::{PERIOD_S, Shape, all, clean, periodic, recorded, stirring, wiping};
use crate::common::{Folder, arcs, skill, skill_text};
use glam::{DQuat, DVec3};
use tprmp_learner::certify::policy::{Body, LearnedPolicy, MotionPolicy};
use tprmp_learner::certify::rollout::resolve;
use tprmp_learner::demonstration::to_text;
use tprmp_learner::mixture::components::Components;
use tprmp_learner::periodic::{Learned, learn};
use tprmp_learner::skill::Skill;
use tprmp_learner::train::{Trained, train};
use tprmp_learner::{plot, report};
use tprmp_model::skill_model::{self, Manifold, PolicyModel};
use tprmp_rmpflow::policy::{Phase, PolicyState, SkillInertia};
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration, Twist};

/// The certificate holds, all complete rounds are found, and the cycle is the demonstrated one.
#[track_caller]
fn assert_learned(learned: &Learned, rounds: &[u32]) {
    let certificate = &learned.model.certificate;
    let cycle = certificate.cycle.as_ref().unwrap();
    assert!(certificate.holds(), "{:?}", certificate.failures);
    assert_eq!(cycle.rounds, rounds);
    assert!((cycle.period_s / cycle.demonstrated_period_s - 1.0).abs() < 0.05, "{cycle:?}");
    assert!((cycle.demonstrated_period_s / PERIOD_S - 1.0).abs() < 0.1, "{cycle:?}");
    assert!(cycle.beside_max_m < 3e-3 && cycle.beside_max_rad < 0.02, "{cycle:?}");
    for block in &certificate.blocks {
        let valley = block.valley.unwrap();
        assert!(valley.intervals > 10 && valley.unproved.is_none() && valley.descent_min > 0.0);
    }
    for rollouts in [&certificate.demonstrated_frames, &certificate.displaced_frames] {
        assert!(rollouts.starts == 20 && rollouts.energy_rise_max <= 1e-9, "{rollouts:?}");
    }
}

fn learned(template: &str, manifold: Manifold, shape: Shape, rounds: &[f64]) -> Learned {
    learn(&periodic(skill(template)), &all(manifold, shape, rounds), 1).unwrap()
}

#[test]
fn wiping_is_learned_from_one_to_five_rounds() {
    let wiped = learned("planar.ron", Manifold::R2, wiping, &[2.2, 3.4, 5.3, 1.15]);
    assert_learned(&wiped, &[2, 3, 5, 1]);
    assert_learned(&learned("planar.ron", Manifold::R2, wiping, &[2.3]), &[2]);
}

#[test]
fn stirring_is_learned_with_its_orientation() {
    assert_learned(&learned("pick.ron", Manifold::R3S3, stirring, &[3.3, 2.4, 4.2]), &[3, 2, 4]);
}

/// A motion to and fro, and one that crosses itself, are rounds as well.
#[test]
fn a_round_may_cross_itself_or_return_as_it_came() {
    let eight: Shape = |rounds| {
        let (sin, cos) = (std::f64::consts::TAU * rounds).sin_cos();
        Pose { position: DVec3::new(0.15 * cos, 0.1 * sin * cos, 0.0), ..Pose::IDENTITY }
    };
    let flat: Shape = |rounds| {
        let (sin, cos) = (std::f64::consts::TAU * rounds).sin_cos();
        Pose { position: DVec3::new(0.15 * cos, 0.004 * sin, 0.0), ..Pose::IDENTITY }
    };
    for shape in [eight, flat] {
        assert_learned(&learned("planar.ron", Manifold::R2, shape, &[2.2, 3.4, 1.15]), &[2, 3, 1]);
    }
}

/// Goes round from a pose, and gives the pose after each step. A push accelerates it for a while.
fn follow(
    policy: &LearnedPolicy,
    (frame, start): (Pose, Pose),
    seconds: f64,
    push: impl Fn(f64) -> DVec3,
) -> Vec<Pose> {
    let (frames, dt) = ([MovingPose::at_rest(frame)], 0.005);
    let mut instance = policy.instance();
    let mut body = Body::at_rest(start);
    let mut path = Vec::new();
    for step in 0..(seconds / dt) as usize {
        let time_s = step as f64 * dt;
        let desired = instance.evaluate(&frames, &body);
        let mut acceleration: SpatialAcceleration =
            resolve(&desired.natural, Manifold::R2).unwrap();
        acceleration.linear += push(time_s);
        body.velocity = body.velocity.advanced(&acceleration, dt);
        body.pose = body.pose.advanced(&body.velocity, dt);
        instance.advance(&acceleration, dt);
        path.push(body.pose);
    }
    path
}

#[test]
fn after_a_push_it_comes_back_to_its_cycle_and_goes_on() {
    let Learned { model, .. } = learned("planar.ron", Manifold::R2, wiping, &[2.2, 3.4]);
    let policy = LearnedPolicy::new(&model).unwrap();
    let frame = Pose { position: DVec3::new(1.0, 2.0, 0.0), ..Pose::IDENTITY };
    let start = frame.compose(&Pose { position: DVec3::new(0.3, -0.2, 0.0), ..Pose::IDENTITY });
    let pushed =
        |time_s: f64| if (9.0..9.4).contains(&time_s) { DVec3::X * 6.0 } else { DVec3::ZERO };
    let path = follow(&policy, (frame, start), 24.0, pushed);
    let from_ellipse = |pose: &Pose| {
        let [x, y, _] = (pose.position - frame.position).to_array();
        ((x / 0.15).hypot(y / 0.08) - 1.0).abs() * 0.1
    };
    let most = |seconds: std::ops::Range<f64>| {
        let steps = (seconds.start * 200.0) as usize..(seconds.end * 200.0) as usize;
        path[steps].iter().map(from_ellipse).fold(0.0, f64::max)
    };
    assert!(most(0.0..0.5) > 0.1, "it starts beside");
    assert!(
        most(5.0..9.0) < 4e-3 && most(15.0..24.0) < 4e-3,
        "{} {}",
        most(5.0..9.0),
        most(15.0..24.0)
    );
    assert!(most(9.0..10.0) > 0.03, "the push carries it away");
    // It never stops.
    let slowest = path.windows(2).skip(400).map(|w| (w[1].position - w[0].position).length());
    assert!(slowest.fold(f64::INFINITY, f64::min) > 1e-4);
}

#[test]
fn where_a_round_ends_and_the_next_one_begins_nothing_jumps() {
    let Learned { model, .. } = learned("pick.ron", Manifold::R3S3, stirring, &[3.3]);
    let policy = model.policy().unwrap();
    assert!(policy.is_periodic());
    let frames = [MovingPose::at_rest(Pose::IDENTITY)];
    let inertia = SkillInertia { linear_kg: 2.0, angular_kg_m2: 0.1 };
    let velocity =
        Twist { linear: DVec3::new(0.1, -0.2, 0.05), angular: DVec3::new(0.3, 0.1, 0.2) };
    let mut state = PolicyState::default();
    let on_path = policy.on_path(&frames, 0.0, &mut state);
    assert!((on_path.position - policy.on_path(&frames, 1.0, &mut state).position).length() < 1e-9);
    let pose = Pose {
        position: on_path.position + DVec3::new(0.02, 0.01, -0.01),
        orientation: on_path.orientation * DQuat::from_rotation_y(0.1),
    };
    let mut at = |value: f64| {
        state.resume(Phase { value, rate_1_s: 0.4 });
        let value = policy.evaluate(&inertia, &frames, &pose, &velocity, &mut state);
        let goal = policy.goal(&frames, &mut state);
        (value, goal)
    };
    let epsilon = 1e-9;
    let ((before, goal_before), (after, goal_after)) = (at(1.0 - epsilon), at(epsilon));
    let [a, b] = [&before, &after].map(|value| value.natural.resolve().unwrap());
    assert!((a - b).norm() < 1e-6 * a.norm(), "{a} {b}");
    assert!((before.phase.free - after.phase.free).abs() < 1e-6 * before.phase.free.abs());
    assert!((before.natural.metric - after.natural.metric).norm() < 1e-6);
    assert!((goal_before.position - goal_after.position).length() < 1e-8);
    assert!((goal_before.position - on_path.position).length() < 1e-8, "where it should be");
    // On the cover, V goes on: a round later it is lower by what it falls in a round.
    let PolicyModel::Canonical { position, orientation } = &model.policy else { unreachable!() };
    let fall = 2.0 * position.fall_per_round.unwrap()
        + 0.1 * orientation.as_ref().unwrap().fall_per_round.unwrap();
    assert!((after.energy - before.energy - fall).abs() < 1e-6 * fall);
}

/// A skill file of a periodic skill.
fn file(folder: &Folder, edit: impl Fn(String) -> String) -> std::path::PathBuf {
    let text = skill_text("planar.ron").replace("start_frame: \"start\"", "start_frame: \"end\"");
    let text = text.replace("motion: Discrete", "motion: Periodic");
    folder.write("skill.ron", &edit(text))
}

fn trained(folder: &Folder) -> Trained {
    for demonstration in all(Manifold::R2, wiping, &[2.2, 3.4, 1.15]) {
        let name = format!("demonstrated/{}", demonstration.name);
        folder.write(&name, &to_text(&demonstration, "end", "end"));
    }
    let file = file(folder, |text| text);
    train(&file, Components::Count(10), 1, &mut |_| {}).unwrap()
}

#[test]
fn a_periodic_model_is_written_read_verified_printed_and_drawn() {
    let folder = Folder::new("periodic-files");
    let trained = trained(&folder);
    let model = &trained.model;
    let path = folder.path().join("wiping.model.ron");
    skill_model::write(model, &path).unwrap();
    let read = skill_model::read(&path).unwrap();
    assert_eq!(read, *model);
    skill_model::verify(&read, &read.policy().unwrap(), &path).unwrap();
    for text in [report::trained(&trained), report::inspected(&read)] {
        for part in
            ["limit cycle", "never stops by itself", "demonstrated in", "2 in `round_00.json`"]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(!text.contains("reach the goal") && !text.contains("at the goal"), "{text}");
    }
    let out = folder.path().join("pictures");
    let written = plot::plot(&path, &folder.path().join("demonstrated"), &out).unwrap();
    assert!(written.iter().any(|path| path.ends_with("potential.svg")));
    let page = std::fs::read_to_string(out.join("index.html")).unwrap();
    assert!(page.contains("It has a limit cycle in place of a goal"));
    // The same input gives the same model.
    let file = folder.path().join("skill.ron");
    assert_eq!(train(&file, Components::Count(10), 1, &mut |_| {}).unwrap().model, *model);
}

#[test]
fn a_periodic_model_that_is_not_what_it_claims_is_refused() {
    let folder = Folder::new("periodic-claims");
    let trained = trained(&folder);
    let path = folder.path().join("wiping.model.ron");
    let mut model = trained.model.clone();
    let PolicyModel::Canonical { position, .. } = &mut model.policy else { unreachable!() };
    // A heap on its way: it would stop there.
    position.components[3].potential += 20.0;
    skill_model::write(&model, &path).unwrap();
    let error = skill_model::verify(&model, &model.policy().unwrap(), &path).unwrap_err();
    assert!(error.to_string().contains("falls all along a round"), "{error}");
    type Edit = fn(&mut skill_model::SkillModel);
    let edits: [(Edit, &str); 10] = [
        (|m| field(m).fall_per_round = None, "fall_per_round"),
        (|m| field(m).fall_per_round = Some(-1.0), "fall_per_round"),
        (|m| field(m).components.swap(0, 1), "components[1].mean"),
        (|m| field(m).phase_width = 0.3, "components"),
        (|m| m.certificate.cycle = None, "certificate.cycle"),
        (|m| m.motion = skill_model::Motion::Discrete, "certificate.cycle"),
        (|m| m.motion = skill_model::Motion::Periodic { period_s: 2.0 }, "motion.period_s"),
        (|m| m.certificate.cycle.as_mut().unwrap().demonstrated_period_s *= 1.01, "period_s"),
        (|m| m.certificate.cycle.as_mut().unwrap().period_s = 9.0, "certificate.cycle.period_s"),
        (|m| m.fit.duration_s = 9.0, "fit.duration_s"),
    ];
    for (edit, key) in edits {
        let mut model = trained.model.clone();
        edit(&mut model);
        let error = skill_model::write(&model, &path).unwrap_err().to_string();
        assert!(error.contains(key), "{key}: {error}");
    }
}

fn field(model: &mut skill_model::SkillModel) -> &mut skill_model::FieldModel {
    let PolicyModel::Canonical { position, .. } = &mut model.policy else { unreachable!() };
    position
}

#[test]
fn demonstrations_without_rounds_are_named() {
    let skill = periodic(skill("planar.ron"));
    let error = |demonstrations: &[_]| learn(&skill, demonstrations, 1).unwrap_err().to_string();
    let once = error(&arcs(Manifold::R2));
    assert!(once.contains("made_up_01.json") && once.contains("does not come again"), "{once}");
    let round = error(&all(Manifold::R2, wiping, &[1.15]));
    assert!(round.contains("round_00.json") && round.contains("complete round"), "{round}");
    let mut all = all(Manifold::R2, wiping, &[3.3, 2.4, 2.2]);
    all[1].poses.reverse();
    let other = error(&all);
    assert!(other.contains("round_01.json") && other.contains("the other way round"), "{other}");
    all[1].poses.reverse();
    all[1].poses.truncate(170);
    let short = error(&all);
    assert!(short.contains("round_01.json") && short.contains("no complete round"), "{short}");
    let turning: Shape = |rounds| Pose {
        orientation: DQuat::from_rotation_z(std::f64::consts::TAU * rounds),
        ..stirring(rounds)
    };
    let turning = recorded(0, Manifold::R3S3, turning, 3.4);
    let skill = periodic(crate::common::skill("pick.ron"));
    let turns = learn(&skill, &[turning], 1).unwrap_err().to_string();
    assert!(turns.contains("round_00.json") && turns.contains("turns on and on"), "{turns}");
}

#[test]
fn what_a_periodic_skill_cannot_have_is_refused_in_its_file() {
    let folder = Folder::new("periodic-keys");
    type Edit = fn(String) -> String;
    let edits: [(Edit, &str); 4] = [
        (|text| text.replace("start_frame: \"end\"", "start_frame: \"elsewhere\""), "goal_frame"),
        (|text| text.replace("other_frames: []", "other_frames: [\"bowl\"]"), "other_frames"),
        (|text| text.replace("other_frames: []", "other_frames: Auto"), "other_frames"),
        (|text| text.replace("phase_overlap: 0.6", "phase_overlap: 3.0"), "mixture.components"),
    ];
    for (edit, key) in edits {
        let error = Skill::read(&file(&folder, edit)).unwrap_err().to_string();
        assert!(error.contains(key) && error.contains("periodic"), "{key}: {error}");
    }
    let skill = Skill::read(&file(&folder, |text| text)).unwrap();
    for count in [2, 60] {
        let error = skill.clone().with_components(count).unwrap_err();
        assert!(error.contains("copies in the rounds before and after"), "{error}");
    }
}

/// However many rounds a recording has, its period is found: 30 minutes of them, too.
#[test]
fn many_rounds_in_one_recording_have_the_period_of_one() {
    for rounds in [60_u16, 130, 190, 600] {
        let many = clean(0, |at| wiping(at).position, f64::from(rounds), PERIOD_S);
        let learned = learn(&periodic(skill("planar.ron")), &[many], 1).unwrap();
        assert_learned(&learned, &[u32::from(rounds)]);
        let period_s = learned.model.motion.period_s().unwrap();
        assert!((period_s / PERIOD_S - 1.0).abs() < 0.01, "{rounds}: {period_s}");
    }
}

#[test]
fn fast_rounds_keep_their_size_and_their_period() {
    let place = |at: f64, x: f64, twice: f64| {
        let (sin, cos) = (std::f64::consts::TAU * at).sin_cos();
        DVec3::new(x * cos, x * sin * (1.0 + twice * (cos - 1.0)), 0.0)
    };
    for (radius_m, eight) in [(0.025, 0.0), (0.1, 0.0), (0.025, 1.0), (0.1, 1.0)] {
        for period_s in [0.4, 0.7, 1.1, 1.6] {
            let file = |i, rounds| clean(i, |at| place(at, radius_m, eight), rounds, period_s);
            let all = [file(0, 8.0), file(1, 5.3)];
            let learned = learn(&periodic(skill("planar.ron")), &all, 1).unwrap();
            let certificate = &learned.model.certificate;
            let cycle = certificate.cycle.as_ref().unwrap();
            let told = format!("{radius_m} {eight} {period_s}: {cycle:?}");
            assert!(certificate.holds(), "{told} {:?}", certificate.failures);
            assert_eq!(cycle.rounds, [8, 5]);
            assert!((cycle.period_s / period_s - 1.0).abs() < 0.05, "{told}");
            for row in &learned.model.fit.demonstrations {
                assert!(row.path_rms_m < 0.02 * 2.0 * radius_m, "{told} {row:?}");
            }
            let slowly = learned.warnings.iter().find(|text| text.contains("slow motion"));
            assert!(slowly.unwrap().contains("`fit.damping_1_s`"), "{:?}", learned.warnings);
        }
    }
}

/// Several recordings of one round each are rounds, though none comes again; one alone is not.
#[test]
fn one_closed_round_a_file_is_learned_from_several_files() {
    let skill = periodic(skill("planar.ron"));
    let files = |rounds: &[f64]| -> Vec<_> {
        let one =
            |(i, rounds): (usize, &f64)| clean(i, |at| wiping(at).position, *rounds, PERIOD_S);
        rounds.iter().enumerate().map(one).collect()
    };
    assert_learned(&learn(&skill, &files(&[1.0, 1.0]), 1).unwrap(), &[1, 1]);
    assert_learned(&learn(&skill, &files(&[1.0, 1.03, 0.985, 1.06]), 1).unwrap(), &[1, 1, 1, 1]);
    let alone = learn(&skill, &files(&[1.0]), 1).unwrap_err().to_string();
    for part in ["clean_00.json", "1 complete round", "at least 2", "further files"] {
        assert!(alone.contains(part), "{alone}");
    }
    let open = learn(&skill, &files(&[0.7, 0.7]), 1).unwrap_err().to_string();
    for part in ["clean_00.json", "does not come again", "one closed round each"] {
        assert!(open.contains(part), "{open}");
    }
}

#[test]
fn rounds_that_drift_and_files_beside_the_others_are_named_with_how_far() {
    let skill = periodic(skill("planar.ron"));
    let wiped = |i: usize, moved: DVec3, each: DVec3, rounds: f64| {
        let shape = move |at: f64| wiping(at).position + moved + each * at;
        clean(i, shape, rounds, PERIOD_S)
    };
    let millimetres = |text: &str, after: &str| -> f64 {
        let (_, rest) = text.split_once(after).unwrap_or_else(|| panic!("{text}"));
        rest.split_whitespace().next().unwrap().parse().unwrap()
    };
    let still = |i, rounds| wiped(i, DVec3::ZERO, DVec3::ZERO, rounds);
    for drift_mm in [10.0, 15.0, 30.0] {
        let drift = DVec3::new(1e-3 * drift_mm, 0.0, 0.0);
        let drifts = wiped(1, DVec3::ZERO, drift, 6.0);
        for all in [vec![still(0, 4.0), drifts.clone(), still(2, 4.0)], vec![drifts.clone()]] {
            let error = learn(&skill, &all, 1).map(|_| drift_mm).unwrap_err().to_string();
            assert!(error.contains("clean_01.json") && error.contains("in `end`"), "{error}");
            let found = millimetres(&error, "its rounds move by ");
            assert!((found / drift_mm - 1.0).abs() < 0.2, "{error}");
        }
    }
    // What a hand moves by is no drift.
    let moves = wiped(1, DVec3::ZERO, DVec3::new(0.002, 0.0, 0.0), 4.0);
    learn(&skill, &[still(0, 4.0), moves], 1).unwrap();
    for beside in [DVec3::new(0.05, 0.03, 0.0), DVec3::new(0.0, -0.4, 0.0)] {
        for rounds in [3.0, 1.1] {
            let mut all = vec![still(0, 4.0), wiped(1, beside, DVec3::ZERO, rounds), still(2, 2.5)];
            all[1].name = "beside.json".into();
            let error = learn(&skill, &all, 1).unwrap_err().to_string();
            assert!(error.contains("beside.json") && error.contains("others in `end`"), "{error}");
            let found = millimetres(&error, "runs ");
            assert!((found - 1e3 * beside.length()).abs() < 4.0, "{error}");
        }
    }
}

#[test]
fn the_shipped_periodic_skill_is_learned() {
    let trained =
        train(&crate::common::skill_file("wipe.ron"), Components::Count(10), 1, &mut |_| {})
            .unwrap();
    let certificate = &trained.model.certificate;
    assert!(certificate.holds(), "{:?}", certificate.failures);
    let cycle = certificate.cycle.as_ref().unwrap();
    assert_eq!(cycle.rounds, [3, 4, 2, 3]);
    assert!((cycle.period_s / cycle.demonstrated_period_s - 1.0).abs() < 0.05, "{cycle:?}");
    assert!(cycle.beside_max_m < 4e-3, "{cycle:?}");
    assert!(trained.warnings.is_empty(), "{:?}", trained.warnings);
}
