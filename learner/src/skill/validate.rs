//! What the values of a skill file have to be.

use tprmp_files::name;
use tprmp_model::skill_model::{FRAME_CAPACITY, copies};
use tprmp_rmpflow::policy::canonical::field::COMPONENT_CAPACITY;
use tprmp_rmpflow::policy::canonical::frame_map::PHASE_DISTANCE_MIN;

use crate::demonstration::DURATION_MAX_S;
use crate::skill::settings::{Certification, FitSettings, MotionSettings, Skill};

/// Largest shape of a Kaiser window: I₀ of a larger one is no number, and the window of this one is a few
/// samples wide.
const SHAPE_MAX: f64 = 100.0;
/// Most steps of a rollout of the certificate: some seconds each.
const ROLLOUT_STEPS_MAX: f64 = 1e6;
/// Fewer components make no round.
const PERIODIC_COMPONENTS_MIN: usize = 4;

/// A key, and what was expected and found there.
type Wrong = (&'static str, String);

/// Values of a section with their keys.
macro_rules! keys {
    ($section:literal $of:expr => $($key:ident)+) => {
        [$((concat!($section, ".", stringify!($key)), $of.$key)),+]
    };
}

/// Counts of a section with their keys and ranges.
macro_rules! counts {
    ($section:literal $of:expr => $($key:ident in $least:literal ..= $most:expr),+) => {
        [$((concat!($section, ".", stringify!($key)), $of.$key as usize, $least, $most)),+]
    };
}

/// Checks all values of a skill file.
///
/// # Errors
/// The first that is outside its range.
pub(crate) fn validate(skill: &Skill) -> Result<(), Wrong> {
    validate_names(skill)?;
    validate_positive(skill)?;
    validate_ranges(skill)?;
    validate_motion(skill)?;
    validate_part(skill)?;
    validate_counts(skill)
}

/// What moves part of a pose ends, and has a canonical policy.
fn validate_part(skill: &Skill) -> Result<(), Wrong> {
    if !skill.manifold.is_part_of_pose() {
        return Ok(());
    }
    let part = format!("since the skill moves part of a pose, {}", skill.manifold);
    if !matches!(skill.fit, FitSettings::Canonical(_)) {
        let problem =
            format!("expected `Canonical`, {part}, found `Thesis`, whose policy moves all of one");
        return Err(("fit", problem));
    }
    if skill.motion != MotionSettings::Discrete {
        return Err(("motion", format!("expected `Discrete`, {part}, found `Periodic`")));
    }
    Ok(())
}

/// What goes round has one frame and a canonical policy.
fn validate_motion(skill: &Skill) -> Result<(), Wrong> {
    if skill.motion == MotionSettings::Discrete {
        return Ok(());
    }
    let (start, goal) = (&skill.start_frame, &skill.goal_frame);
    if start != goal {
        let problem = format!(
            "expected `{start}`, the start frame, since a periodic skill is fixed to one frame, found `{goal}`"
        );
        return Err(("goal_frame", problem));
    }
    if skill.proposes_frames || !skill.other_frames.is_empty() {
        let problem = "expected none, since a periodic skill is fixed to one frame, found some";
        return Err(("other_frames", problem.into()));
    }
    if !matches!(skill.fit, FitSettings::Canonical(_)) {
        let problem =
            "expected `Discrete`: of the thesis' policy none goes round, found `Periodic`";
        return Err(("motion", problem.into()));
    }
    Ok(())
}

/// Whether the components of a skill that goes round fit a field together with their copies.
fn validate_copies(skill: &Skill) -> Result<(), Wrong> {
    let (FitSettings::Canonical(fit), MotionSettings::Periodic) = (&skill.fit, skill.motion) else {
        return Ok(());
    };
    let count = skill.mixture.components;
    let phases: Vec<f64> = (0..count).map(|k| k as f64 / count as f64).collect();
    let found = copies(&phases, fit.phase_overlap / count as f64).len();
    if count < PERIODIC_COMPONENTS_MIN || !(count..=COMPONENT_CAPACITY).contains(&found) {
        let problem = format!(
            "expected at least {PERIODIC_COMPONENTS_MIN} for a periodic skill, and at most {COMPONENT_CAPACITY} \
             together with their copies in the rounds before and after, found {count} with {found}"
        );
        return Err(("mixture.components", problem));
    }
    Ok(())
}

fn validate_names(skill: &Skill) -> Result<(), Wrong> {
    for (key, name) in [
        ("skill", &skill.skill),
        ("tool_frame", &skill.tool_frame),
        ("start_frame", &skill.start_frame),
        ("goal_frame", &skill.goal_frame),
    ] {
        name::check(name).map_err(|error| (key, error.to_string()))?;
    }
    let mut frames = vec![&skill.start_frame, &skill.goal_frame];
    frames.dedup();
    for name in &skill.other_frames {
        name::check(name).map_err(|error| ("other_frames", error.to_string()))?;
        if frames.contains(&name) {
            let problem = format!(
                "expected names that differ from each other and those of start and goal, found `{name}`"
            );
            return Err(("other_frames", problem));
        }
        frames.push(name);
    }
    if frames.len() > FRAME_CAPACITY {
        let found = frames.len();
        let problem = format!("expected at most {FRAME_CAPACITY} frames together, found {found}");
        return Err(("other_frames", problem));
    }
    Ok(())
}

/// No number of a skill is larger: squares and sums of it stay finite.
const NUMBER_MAX: f64 = 1e6;
/// Nor is one that has to be positive smaller: quotients stay finite.
const NUMBER_MIN: f64 = 1e-9;
/// ŷ spanned by the demonstrations: all other constants are chosen for 2.75. With larger ones a program takes
/// minutes, and finds nothing.
const SPAN_RANGE: [f64; 2] = [0.1, 100.0];
/// 1/d is the time in which a skill forgets its velocity: longer than ten seconds no arm follows, and
/// no loop is as short as two milliseconds.
const DAMPING_RANGE_1_S: [f64; 2] = [0.1, 500.0];

fn validate_positive(skill: &Skill) -> Result<(), Wrong> {
    let mut positive = Vec::new();
    positive.extend(keys! { "smoothing" skill.smoothing => window_s rest_speed_fraction });
    positive.extend(keys! {
        "scale" skill.scale => span position_span_min_m orientation_span_min_rad
    });
    positive.extend(keys! {
        "alignment" skill.alignment => pause_min_s stiffness width agreement_floor
    });
    positive.extend(keys! { "mixture" skill.mixture => regularisation covariance_scale });
    positive.extend(keys! {
        "certification" skill.certification =>
        horizon_s demonstration_step_s step_s random_start_radius goal_tolerance_m goal_tolerance_rad
        goal_gradient_max
    });
    match &skill.fit {
        FitSettings::Canonical(fit) => {
            positive.extend(keys! {
                "fit" fit =>
                damping_1_s catch_up_ratio activation_width phase_overlap phase_weight metric_scale
                tube_weight tube_attraction_1_s tube_speed_min
                descent_weight descent_speed descent_slowdown descent_attraction descent_goal_radius
                descent_radius descent_phase_radius refinement_weight refinement_radius
                stiffness_min_1_s2 stiffness_max_1_s2 goal_hessian_min_1_s2 regularisation regularisation_length
            });
            positive.extend(fit.tube_offsets.iter().map(|x| ("fit.tube_offsets", *x)));
            let ridges = fit.adaptation.ridges.iter();
            positive.extend(ridges.map(|ridge| ("fit.adaptation.ridges", *ridge)));
        }
        FitSettings::Thesis(fit) => {
            positive.extend(keys! { "fit" fit => metric_scale huber_threshold damping_min });
        }
    }
    if let Some(kaiser) = skill.fit.kaiser_smoothing() {
        positive.extend(keys! { "fit.kaiser_smoothing" kaiser => window_s shape });
    }
    check(positive.iter().copied(), |x| x > 0.0, "a positive number")?;
    // The certificate's own bounds come after these.
    let learning = positive.into_iter().filter(|(key, _)| !key.starts_with("certification."));
    let sane = |x| (NUMBER_MIN..=NUMBER_MAX).contains(&x);
    check(learning, sane, &format!("a number from {NUMBER_MIN:e} to {NUMBER_MAX:e}"))
}

fn validate_ranges(skill: &Skill) -> Result<(), Wrong> {
    let certification = &skill.certification;
    let mut not_negative = keys! {
        "certification" certification =>
        frame_translation_fraction frame_rotation_rad energy_rise_max
    }
    .to_vec();
    let mut fractions = keys! {
        "frame_map" skill.frame_map =>
        upright_error_fraction_max change_spread_fraction_max change_phase_min
        agreement_fraction_max agreement_floor_fraction
    }
    .to_vec();
    fractions.extend(keys! { "certification" certification => arrival_fraction });
    match &skill.fit {
        FitSettings::Canonical(fit) => {
            not_negative.extend(keys! { "fit" fit => descent_goal_distance_min });
            not_negative.extend(keys! { "fit.adaptation" fit.adaptation => shift_min });
            fractions.extend(keys! { "fit" fit => tube_clearance_fraction });
            fractions.extend(keys! {
                "fit.adaptation" fit.adaptation => error_fraction_max end_spread_fraction_max
            });
        }
        FitSettings::Thesis(fit) => fractions.extend(keys! { "fit" fit => speed_fraction_min }),
    }
    check(not_negative, |x| x >= 0.0, "a number from zero on")?;
    check(fractions, |x| (0.0..=1.0).contains(&x), "a fraction from 0 to 1")?;
    let change = keys! { "frame_map" skill.frame_map => change_phase_min };
    let least = PHASE_DISTANCE_MIN;
    check(change, |x| x >= least, &format!("a fraction of at least {least}"))?;
    let rest = keys! { "smoothing" skill.smoothing => rest_speed_fraction };
    check(rest, |x| x < 0.5, "a fraction below 0.5")?;
    let [least, most] = SPAN_RANGE;
    let span = keys! { "scale" skill.scale => span };
    check(span, |x| (least..=most).contains(&x), &format!("a number from {least} to {most}"))?;
    if let FitSettings::Canonical(fit) = &skill.fit {
        validate_damping(fit.damping_1_s, certification)?;
        let least = 2.0 * fit.stiffness_min_1_s2;
        let stiffest = keys! { "fit" fit => stiffness_max_1_s2 };
        let expected = format!("at least {least}, twice `fit.stiffness_min_1_s2`");
        check(stiffest, |x| x >= least, &expected)?;
    }
    let width = keys! { "alignment" skill.alignment => width };
    check(width, |x| x <= 0.2, "a fraction of at most 0.2")?;
    let shape = skill.fit.kaiser_smoothing().map(|kaiser| kaiser.shape);
    let shape = shape.map(|shape| ("fit.kaiser_smoothing.shape", shape));
    check(shape, |x| x <= SHAPE_MAX, &format!("at most {SHAPE_MAX}"))?;
    let (horizon_s, step_s) = (certification.horizon_s, certification.step_s);
    if !(horizon_s <= DURATION_MAX_S && horizon_s / step_s <= ROLLOUT_STEPS_MAX) {
        let problem = format!(
            "expected at most {DURATION_MAX_S} s, and {ROLLOUT_STEPS_MAX} steps of \
             `certification.step_s`, found {horizon_s} s and steps of {step_s} s"
        );
        return Err(("certification.horizon_s", problem));
    }
    let step_s = certification.demonstration_step_s;
    if horizon_s / step_s > ROLLOUT_STEPS_MAX {
        let problem = format!(
            "expected a step of which {ROLLOUT_STEPS_MAX} last at least \
             `certification.horizon_s`, {horizon_s} s, found {step_s} s"
        );
        return Err(("certification.demonstration_step_s", problem));
    }
    Ok(())
}

/// A step of a rollout has to be shorter than the time in which the velocity is forgotten.
fn validate_damping(damping_1_s: f64, certification: &Certification) -> Result<(), Wrong> {
    let [least, most] = DAMPING_RANGE_1_S;
    let step_s = certification.step_s.max(certification.demonstration_step_s);
    let most = most.min(1.0 / step_s);
    check(
        [("fit.damping_1_s", damping_1_s)],
        |x| (least..=most).contains(&x),
        &format!(
            "a number from {least} to {most:.4}, the most that the certificate can roll out in steps of {step_s} s"
        ),
    )
}

/// Checks the counts; each has a least and a largest value.
///
/// # Errors
/// The first that is outside its range.
pub(crate) fn validate_counts(skill: &Skill) -> Result<(), Wrong> {
    let mut counts = Vec::new();
    counts.extend(counts! { "smoothing" skill.smoothing => degree in 2..=5 });
    counts.extend(counts! {
        "alignment" skill.alignment => places in 20..=1000, rounds in 1..=100
    });
    counts.extend(counts! {
        "mixture" skill.mixture =>
        components in 1..=COMPONENT_CAPACITY - 1, iterations in 1..=1000
    });
    counts.extend(counts! {
        "frame_map" skill.frame_map => phases_compared in 2..=1000, changes_compared in 2..=100
    });
    counts.extend(counts! {
        "certification" skill.certification =>
        random_starts in 0..=10_000, displaced_starts in 0..=10_000
    });
    match &skill.fit {
        FitSettings::Canonical(fit) => counts.extend(counts! {
            "fit" fit =>
            tube_stride in 1..=1000, descent_stride in 1..=1000, stride_samples_min in 1..=1000,
            descent_points_random in 1..=10_000,
            refinement_rounds_max in 0..=100, refinement_points in 0..=1000
        }),
        FitSettings::Thesis(fit) => counts.extend(counts! { "fit" fit => stride in 1..=1000 }),
    }
    match counts.iter().find(|(_, count, least, most)| !(least..=most).contains(&count)) {
        None => validate_copies(skill),
        Some((key, found, least, most)) => {
            Err((key, format!("expected {least} to {most}, found {found}")))
        }
    }
}

/// Refuses the first value that is not finite or not as expected.
fn check(
    values: impl IntoIterator<Item = (&'static str, f64)>,
    is_valid: impl Fn(f64) -> bool,
    expected: &str,
) -> Result<(), Wrong> {
    match values.into_iter().find(|(_, x)| !(x.is_finite() && is_valid(*x))) {
        None => Ok(()),
        Some((key, x)) => Err((key, format!("expected {expected}, found {x}"))),
    }
}
