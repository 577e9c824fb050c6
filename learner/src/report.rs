//! What the learner prints.

use std::fmt::Write as _;

use nalgebra::DMatrix;
use tprmp_drawing::quantile;
use tprmp_model::skill_model::{
    Canonical, Certificate, DemonstrationRollout, FieldModel, Fit, FrameMixture, Gaussian, Motion,
    PolicyModel, Pose, ProgramFit, Remarks, SkillModel, ThesisModel,
};

use crate::mixture::components::Choice;
use crate::train::Trained;

/// Adds a line to a text.
macro_rules! say {
    ($text:expr, $($part:tt)*) => {
        writeln!($text, $($part)*).expect("a string grows")
    };
}

/// Adds a line with a label.
macro_rules! line {
    ($text:expr, $label:expr, $($part:tt)*) => {
        say!($text, "{:<11} {}", $label, format_args!($($part)*))
    };
}

/// What `learner train` prints.
#[must_use]
pub fn trained(trained: &Trained) -> String {
    let model = &trained.model;
    let mut text = trained.choice.as_ref().map(choice).unwrap_or_default();
    let count: usize = model.modes().map(|mode| mode.provenance.demonstrations.len()).sum();
    line!(
        text,
        "skill",
        "{} ({}), {count} demonstrations, {} samples, K = {}",
        model.skill,
        model.manifold,
        trained.samples,
        model.gaussians.len()
    );
    for (i, mode) in model.modes().enumerate() {
        mode_line(&mut text, model, i);
        cycle(&mut text, mode);
        fit(&mut text, mode);
        agreement(&mut text, mode);
        gripper(&mut text, mode);
        certificate(&mut text, &mode.certificate);
    }
    let times: Vec<_> = trained
        .times
        .iter()
        .map(|(step, time)| format!("{step} {:.2}", time.as_secs_f64()))
        .collect();
    line!(text, "time [s]", "{}", times.join(", "));
    for warning in &trained.warnings {
        line!(text, "warning", "{warning}");
    }
    text
}

/// Which mode follows, of a model that has several.
fn mode_line(text: &mut String, model: &SkillModel, index: usize) {
    let mut modes = model.modes();
    let count = modes.len();
    if let Some(mode) = modes.nth(index).filter(|_| count > 1) {
        let files = mode.provenance.demonstrations.iter().map(|source| source.file.as_str());
        let files: Vec<&str> = files.collect();
        line!(text, "mode", "{} of {count}, from {}", index + 1, files.join(", "));
    }
}

/// The mixtures that were tried, the chosen one marked.
fn choice(choice: &Choice) -> String {
    let mut text = String::from("  K  log-likelihood [nat]  parameters     BIC [nat]\n");
    for candidate in &choice.candidates {
        let mark = match (candidate.components == choice.components, candidate.empty) {
            (true, _) => "  < least, chosen",
            (_, true) => "  a component is empty",
            _ => "",
        };
        say!(
            text,
            "{:>3}  {:>20.1}  {:>10}  {:>12.1}{mark}",
            candidate.components,
            candidate.log_likelihood,
            candidate.parameters,
            candidate.bic
        );
    }
    text.push('\n');
    text
}

/// What `learner inspect` prints.
#[must_use]
pub fn inspected(model: &SkillModel) -> String {
    let mut text = String::new();
    line!(text, "skill", "{} ({})", model.skill, model.manifold);
    line!(text, "moves", "link `{}`", model.tool_frame);
    match model.motion {
        Motion::Discrete => {
            line!(
                text,
                "frames",
                "from `{}` to a goal fixed to `{}`",
                model.start_frame,
                model.goal_frame
            );
        }
        Motion::Periodic { .. } => {
            line!(text, "frames", "round for ever, fixed to `{}`", model.goal_frame);
        }
    }
    for (i, mode) in model.modes().enumerate() {
        if i > 0 {
            text.push('\n');
        }
        mode_line(&mut text, model, i);
        inspected_mode(&mut text, mode);
    }
    line!(text, "with", "the skill file's values");
    for (key, value) in &model.provenance.hyper_parameters {
        say!(text, "  {key} = {value}");
    }
    text
}

/// All of a mode.
fn inspected_mode(text: &mut String, model: &SkillModel) {
    cycle(text, model);
    canonical(text, model);
    match &model.policy {
        PolicyModel::Canonical { position, orientation } => {
            field(text, "position", "m", position);
            if let Some(orientation) = orientation {
                field(text, "orientation", "rad", orientation);
            }
        }
        PolicyModel::Thesis(policy) => thesis(text, policy),
    }
    gaussians(text, &model.gaussians);
    frames(text, &model.frames);
    text.push('\n');
    fit(text, model);
    agreement(text, model);
    gripper(text, model);
    certificate(text, &model.certificate);
    text.push('\n');
    let provenance = &model.provenance;
    line!(
        text,
        "learned",
        "by version {}, seed {}, from",
        provenance.tool_version,
        provenance.seed
    );
    for source in &provenance.demonstrations {
        say!(text, "  {}  sha256 {}", source.file, source.sha256);
        let Remarks { operator, notes } = &source.remarks;
        for (key, remark) in [("operator", operator), ("notes", notes)] {
            if let Some(remark) = remark {
                say!(text, "    {key}  {}", remark.escape_debug());
            }
        }
    }
}

/// The limit cycle, and the rounds it was learned from.
fn cycle(text: &mut String, model: &SkillModel) {
    let Some(told) = model.cycle_line() else { return };
    line!(text, "limit cycle", "{told}");
    let Some(cycle) = &model.certificate.cycle else { return };
    let files = model.provenance.demonstrations.iter().zip(&cycle.rounds);
    let rounds: Vec<String> =
        files.map(|(from, count)| format!("{count} in `{}`", from.file)).collect();
    line!(text, "rounds", "{}", rounds.join(", "));
}

/// Frames and goal in canonical coordinates.
fn canonical(text: &mut String, model: &SkillModel) {
    let canonical = &model.canonical;
    text.push_str(
        "\ncanonical pose              x       y       z [m]      w      x      y      z\n",
    );
    let Canonical { start_phase, goal_phase, .. } = canonical;
    if !model.motion.is_discrete() {
        pose(text, "frame", &canonical.goal_frame);
        pose(text, "at phase 0", &canonical.start);
        pose(text, "mean of a round", &canonical.goal);
        return;
    }
    pose(text, &format!("start frame to {start_phase:.2}"), &canonical.start);
    pose(text, &format!("goal frame from {goal_phase:.2}"), &canonical.goal_frame);
    pose(text, "goal", &canonical.goal);
    for waypoint in &canonical.waypoints {
        let label = format!("{} at {:.2}", waypoint.frame, waypoint.phase);
        pose(text, &label, &waypoint.pose);
    }
    if let Some(adaptation) = &canonical.adaptation {
        let most = |rows: std::ops::Range<usize>| -> f64 {
            let rows = adaptation.coefficients.iter().flat_map(|matrix| &matrix[rows.clone()]);
            rows.flatten().copied().map(f64::abs).fold(0.0, f64::max)
        };
        say!(
            text,
            "the path adapts to the goal's shift against the start, demonstrated up to {:.3} m and \
             {:.1}°: coefficients up to {:.1} mm, {:.2}°",
            adaptation.reach_m,
            adaptation.reach_rad.to_degrees(),
            1e3 * most(0..3),
            most(3..6).to_degrees()
        );
    }
}

/// The mixture in canonical coordinates.
fn gaussians(text: &mut String, gaussians: &[Gaussian]) {
    text.push_str("\nGaussian  prior  phase  mean (position [m], rotation [rad])\n");
    for (k, gaussian) in gaussians.iter().enumerate() {
        let mean: Vec<_> = gaussian.mean.iter().map(|x| format!("{x:7.3}")).collect();
        say!(
            text,
            "{:>8}  {:.3}  {:.3}  {}",
            k + 1,
            gaussian.prior,
            gaussian.phase,
            mean.join(" ")
        );
    }
}

fn pose(text: &mut String, label: &str, pose: &Pose) {
    let [x, y, z] = pose.position_m;
    let [w, qx, qy, qz] = pose.quaternion_wxyz;
    say!(text, "{label:<20} {x:8.4}{y:8.4}{z:8.4}       {w:6.3} {qx:6.3} {qy:6.3} {qz:6.3}");
}

fn field(text: &mut String, block: &str, unit: &str, field: &FieldModel) {
    say!(
        text,
        "\n{block} field, d = {} 1/s\ncomponent  potential [{unit}²/s²]  mean [{unit}], phase",
        field.damping_1_s
    );
    let is_goal = |k: usize| field.fall_per_round.is_none() && k + 1 == field.components.len();
    for (k, component) in field.components.iter().enumerate() {
        let name = if is_goal(k) { "goal".into() } else { (k + 1).to_string() };
        let mean: Vec<_> = component.mean.iter().map(|x| format!("{x:8.4}")).collect();
        say!(text, "{name:>9}  {:>18.4}  {}", component.potential, mean.join(" "));
    }
    if let Some(fall) = field.fall_per_round {
        say!(text, "each round later the potentials are lower by {fall:.4} {unit}²/s²");
    }
}

fn thesis(text: &mut String, policy: &ThesisModel) {
    say!(
        text,
        "\nproduct of the frames' Gaussians, γ = {}, δ = {}\ncomponent  potential φ⁰   damping d",
        policy.metric_scale,
        policy.huber_threshold
    );
    for (k, (potential, damping)) in policy.potentials.iter().zip(&policy.damping).enumerate() {
        say!(text, "{:>9}  {potential:>12.4}  {damping:>10.4}", k + 1);
    }
}

/// The Gaussians of each frame.
fn frames(text: &mut String, frames: &[FrameMixture]) {
    for frame in frames {
        say!(
            text,
            "\nseen from `{}`\nGaussian  mean position [m]            2σ along its axes [m]",
            frame.name
        );
        for (k, gaussian) in frame.gaussians.iter().enumerate() {
            let mean: Vec<_> = gaussian.position_m.iter().map(|x| format!("{x:7.3}")).collect();
            let n = gaussian.position_m.len();
            let covariance = DMatrix::from_fn(n, n, |i, j| gaussian.covariance[i][j]);
            let mut axes: Vec<f64> =
                covariance.symmetric_eigenvalues().iter().map(|v| 2.0 * v.sqrt()).collect();
            axes.sort_by(|a, b| b.total_cmp(a));
            let axes: Vec<_> = axes.iter().map(|x| format!("{x:7.3}")).collect();
            say!(text, "{:>8}  {:<26} {}", k + 1, mean.join(" "), axes.join(" "));
        }
    }
}

fn fit(text: &mut String, model: &SkillModel) {
    let fit = &model.fit;
    if !model.motion.is_discrete() {
        fit.programs.iter().for_each(|program| program_fit(text, program));
        followed_rounds(text, fit);
        return;
    }
    line!(
        text,
        "mixture",
        "{} iterations, log-likelihood {:.4}",
        fit.em_iterations,
        fit.em_log_likelihood
    );
    for program in &fit.programs {
        program_fit(text, program);
    }
    text.push_str(
        "\nfrom the start of                  ends beside by     beside its path     in time   left out          takes\n\
         \x20                                    [mm]    [°]     [mm]    [°] rms    [mm] rms   [mm]    [°] rms    [s]    demonstrated [s]\n",
    );
    for row in &fit.demonstrations {
        say!(
            text,
            "{:<32} {:>8.2} {:>6.2}  {:>7.2} {:>6.2} {:>13.2} {:>8.2} {:>6.2} {:>10.2} {:>10.2}",
            row.name,
            row.end_error_m * 1e3,
            row.end_error_rad.to_degrees(),
            row.path_rms_m * 1e3,
            row.path_rms_rad.to_degrees(),
            row.tracking_rms_m * 1e3,
            row.predicted_rms_m * 1e3,
            row.predicted_rms_rad.to_degrees(),
            row.execution_s,
            row.duration_s
        );
    }
    judgement(text, fit);
}

/// How what goes round follows each demonstration.
fn followed_rounds(text: &mut String, fit: &Fit) {
    text.push_str(
        "\nfrom the start of                  comes to a cycle   beside its path     beside the mean   a round takes\n\
         \x20                                    [mm]    [°]     [mm]    [°] rms     [mm]    [°] rms   [s]  demonstrated [s]\n",
    );
    for row in &fit.demonstrations {
        say!(
            text,
            "{:<32} {:>8.4} {:>6.3}  {:>7.2} {:>6.2} {:>12.2} {:>6.2} {:>10.2} {:>8.2}",
            row.name,
            row.goal_error_m * 1e3,
            row.goal_error_rad.to_degrees(),
            row.path_rms_m * 1e3,
            row.path_rms_rad.to_degrees(),
            row.tracking_rms_m * 1e3,
            row.tracking_rms_rad.to_degrees(),
            row.execution_s,
            row.duration_s
        );
    }
}

/// What the figures mean, in one line.
fn judgement(text: &mut String, fit: &Fit) {
    if fit.demonstrations.is_empty() {
        return;
    }
    let median = |of: fn(&DemonstrationRollout) -> f64| {
        let all: Vec<f64> = fit.demonstrations.iter().map(of).collect();
        quantile(&all, 0.5).expect("there are demonstrations")
    };
    let most = |of: fn(&DemonstrationRollout) -> f64| {
        fit.demonstrations.iter().map(of).fold(0.0, f64::max)
    };
    let angle = |radians: f64| {
        if radians > 0.0 { format!(" and {:.1}°", radians.to_degrees()) } else { String::new() }
    };
    // Nothing is left to predict the only one.
    let predicted = if fit.demonstrations.len() < 2 {
        String::new()
    } else {
        format!(
            "one that is left out is predicted to {:.1} mm{}; ",
            1e3 * median(|row| row.predicted_rms_m),
            angle(median(|row| row.predicted_rms_rad))
        )
    };
    line!(
        text,
        "judged",
        "follows the demonstrations to {:.1} mm{} (rms, median); ends within {:.1} mm{} of where they end; \
         {predicted}takes {:.1} s, demonstrated in {:.1} s",
        1e3 * median(|row| row.path_rms_m),
        angle(median(|row| row.path_rms_rad)),
        1e3 * most(|row| row.end_error_m),
        angle(most(|row| row.end_error_rad)),
        median(|row| row.execution_s),
        median(|row| row.duration_s)
    );
}

/// Which frame speaks when: how far the demonstrations lie apart, seen from each.
fn agreement(text: &mut String, model: &SkillModel) {
    let Some(first) = model.frames.first().filter(|frame| !frame.agreement.is_empty()) else {
        return;
    };
    const COLUMNS: usize = 5;
    let steps = first.agreement.len();
    let places: Vec<usize> = (0..COLUMNS).map(|i| i * (steps - 1) / (COLUMNS - 1)).collect();
    let percent = |step: &usize| format!("{:>7.0} %", 100.0 * *step as f64 / (steps - 1) as f64);
    let head: String = places.iter().map(percent).collect();
    say!(text, "\ndemonstrations apart [mm, rms] after{head} of the time");
    let row = |text: &mut String, name: &str, all: &[[f64; 2]], note: &str| {
        let values: String = places.iter().map(|i| format!("{:>9.1}", 1e3 * all[*i][0])).collect();
        say!(text, "{name:<35}{values}  {note}");
    };
    for frame in &model.frames {
        row(
            text,
            &format!("  seen from `{}`", frame.name),
            &frame.agreement,
            &model.frame_role(frame),
        );
    }
    row(text, "  in the map of all frames", &model.fit.agreement, "");
}

/// What the gripper does, in order.
fn gripper(text: &mut String, model: &SkillModel) {
    for event in &model.gripper {
        say!(text, "{}", event.described(model.provenance.demonstrations.len()));
    }
}

fn program_fit(text: &mut String, fit: &ProgramFit) {
    line!(
        text,
        "fit",
        "{}: {} after {} iterations, objective {:.5}, residual {:.5}",
        fit.name,
        fit.status,
        fit.iterations,
        fit.objective,
        fit.residual
    );
    let active: Vec<_> =
        fit.active.iter().map(|a| format!("{} {}/{}", a.name, a.active, a.count)).collect();
    line!(text, "", "active: {}", active.join(", "));
    let figures: Vec<_> =
        fit.figures.iter().map(|(name, value)| format!("{name} {value:.4}")).collect();
    if !figures.is_empty() {
        line!(text, "", "{}", figures.join(", "));
    }
}

fn certificate(text: &mut String, certificate: &Certificate) {
    let verdict = if certificate.holds() { "holds" } else { "FAILS" };
    text.push('\n');
    line!(text, "certificate", "{}", verdict);
    let goes_round = certificate.cycle.is_some();
    for block in &certificate.blocks {
        let (gradient, hessian) = (block.goal_gradient, block.goal_hessian_min_1_s2);
        let goal = match goes_round {
            true => String::new(),
            false => format!("; at the goal |M⁻¹∇Φ| = {gradient:.1e}, Hessian ≥ {hessian:.2} M"),
        };
        line!(
            text,
            format!("  {}", block.name),
            "metric between {:.3e} and {:.3e} everywhere{goal}",
            block.metric_eigenvalue_min,
            block.metric_eigenvalue_max
        );
        if let Some(valley) = &block.valley {
            let valley = format!(
                "valley: stiffness ≥ {:.2} M everywhere, falls {} by at least {:.2e} a {}, {}",
                valley.stiffness_min_1_s2,
                if goes_round { "all along, so that it never stops," } else { "towards the goal" },
                valley.descent_min,
                if goes_round { "round" } else { "phase" },
                match valley.unproved {
                    None if valley.intervals > 0 =>
                        format!("proved for every phase on {} intervals", valley.intervals),
                    Some([low, high]) =>
                        format!("but between {low:.4} and {high:.4} this is not proved"),
                    None => format!("seen at {} phases", valley.phases),
                }
            );
            line!(text, "", "{valley}");
        }
    }
    for (label, rollouts) in [
        ("  starts", &certificate.demonstrated_frames),
        ("  displaced", &certificate.displaced_frames),
    ] {
        line!(
            text,
            label,
            "{} of {} {}, worst end {:.4} mm, {:.4}°; energy rises by {:.1e} in a step of {} s",
            rollouts.reached,
            rollouts.starts,
            if goes_round { "come to the one limit cycle" } else { "reach the goal" },
            rollouts.goal_error_max_m * 1e3,
            rollouts.goal_error_max_rad.to_degrees(),
            rollouts.energy_rise_max,
            certificate.step_s
        );
    }
    for failure in &certificate.failures {
        line!(text, "  failed", "{}", failure);
    }
}
