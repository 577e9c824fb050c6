//! What the learner tells people.

use std::fmt::Write as _;

use tprmp_model::skill_model::{FieldFit, FieldModel, Fit, Pose, SkillModel};

use crate::components::Choice;
use crate::train::Trained;

/// What `learner train` prints.
#[must_use]
pub fn trained(trained: &Trained) -> String {
    let model = &trained.model;
    let mut text = trained.choice.as_ref().map(choice).unwrap_or_default();
    let count = model.provenance.demonstrations.len();
    line(
        &mut text,
        "skill",
        &format!(
            "{} ({}), {count} demonstrations, {} samples, K = {}",
            model.skill,
            model.manifold,
            trained.samples,
            model.gaussians.len()
        ),
    );
    fit(&mut text, &model.fit);
    let times: Vec<_> = trained
        .times
        .iter()
        .map(|(step, time)| format!("{step} {:.2}", time.as_secs_f64()))
        .collect();
    line(&mut text, "time [s]", &times.join(", "));
    for warning in &trained.warnings {
        line(&mut text, "warning", warning);
    }
    text
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
        writeln!(
            text,
            "{:>3}  {:>20.1}  {:>10}  {:>12.1}{mark}",
            candidate.components, candidate.log_likelihood, candidate.parameters, candidate.bic
        )
        .expect("a string grows");
    }
    text.push('\n');
    text
}

/// What `learner inspect` prints.
#[must_use]
pub fn inspected(model: &SkillModel) -> String {
    let mut text = String::new();
    line(&mut text, "skill", &format!("{} ({})", model.skill, model.manifold));
    line(&mut text, "moves", &format!("link `{}`", model.tool_frame));
    line(
        &mut text,
        "frames",
        &format!("from `{}` to a goal fixed to `{}`", model.start_frame, model.goal_frame),
    );
    text.push_str(
        "\ncanonical pose              x       y       z [m]      w      x      y      z\n",
    );
    pose(&mut text, "start frame", &model.canonical.start);
    pose(&mut text, "goal frame", &model.canonical.goal_frame);
    pose(&mut text, "goal", &model.canonical.goal);
    field(&mut text, "position", "m", &model.position);
    if let Some(orientation) = &model.orientation {
        field(&mut text, "orientation", "rad", orientation);
    }
    text.push_str("\nGaussian  prior  phase  mean (position [m], rotation [rad])\n");
    for (k, gaussian) in model.gaussians.iter().enumerate() {
        let mean: Vec<_> = gaussian.mean.iter().map(|x| format!("{x:7.3}")).collect();
        writeln!(
            text,
            "{:>8}  {:.3}  {:.3}  {}",
            k + 1,
            gaussian.prior,
            gaussian.phase,
            mean.join(" ")
        )
        .expect("a string grows");
    }
    text.push('\n');
    fit(&mut text, &model.fit);
    let provenance = &model.provenance;
    line(
        &mut text,
        "learned",
        &format!("by version {}, seed {}, from", provenance.tool_version, provenance.seed),
    );
    for source in &provenance.demonstrations {
        writeln!(text, "  {}  sha256 {}", source.file, source.sha256).expect("a string grows");
    }
    line(&mut text, "with", "the skill file's values");
    for (key, value) in &provenance.hyper_parameters {
        writeln!(text, "  {key} = {value}").expect("a string grows");
    }
    text
}

fn line(text: &mut String, label: &str, value: &str) {
    writeln!(text, "{label:<10} {value}").expect("a string grows");
}

fn pose(text: &mut String, label: &str, pose: &Pose) {
    let [x, y, z] = pose.position_m;
    let [w, qx, qy, qz] = pose.quaternion_wxyz;
    writeln!(text, "{label:<20} {x:8.4}{y:8.4}{z:8.4}       {w:6.3} {qx:6.3} {qy:6.3} {qz:6.3}")
        .expect("a string grows");
}

fn field(text: &mut String, block: &str, unit: &str, field: &FieldModel) {
    writeln!(
        text,
        "\n{block} field, d = {} 1/s\ncomponent  potential [{unit}²/s²]  mean [{unit}]",
        field.damping_1_s
    )
    .expect("a string grows");
    for (k, component) in field.components.iter().enumerate() {
        let name =
            if k + 1 == field.components.len() { "goal".into() } else { (k + 1).to_string() };
        let mean: Vec<_> = component.mean.iter().map(|x| format!("{x:8.4}")).collect();
        writeln!(text, "{name:>9}  {:>18.4}  {}", component.potential, mean.join(" "))
            .expect("a string grows");
    }
}

fn fit(text: &mut String, fit: &Fit) {
    line(
        text,
        "mixture",
        &format!("{} iterations, log-likelihood {:.4}", fit.em_iterations, fit.em_log_likelihood),
    );
    field_fit(text, "position", &fit.position);
    if let Some(orientation) = &fit.orientation {
        field_fit(text, "rotation", orientation);
    }
    let rollouts = &fit.rollouts;
    text.push_str("\nrollout from the start of        goal error [mm]    [°]   tracking rms [mm]    [°]   path rms [mm]\n");
    for row in &rollouts.demonstrations {
        writeln!(
            text,
            "{:<32} {:>15.5} {:>6.4} {:>19.2} {:>6.3} {:>15.2}",
            row.name,
            row.goal_error_m * 1e3,
            row.goal_error_rad.to_degrees(),
            row.tracking_rms_m * 1e3,
            row.tracking_rms_rad.to_degrees(),
            row.path_rms_m * 1e3
        )
        .expect("a string grows");
    }
    text.push('\n');
    line(
        text,
        "rollouts",
        &format!(
            "{} of {} random starts reach the goal; largest rise of energy in a step {:.1e}",
            rollouts.random_starts_reached, rollouts.random_starts, rollouts.energy_rise_max
        ),
    );
}

fn field_fit(text: &mut String, block: &str, fit: &FieldFit) {
    line(
        text,
        block,
        &format!(
            "{} after {} iterations: residual {:.5}, hinge {:.5}, against the demonstrations at \
             {:.1} % of the points, Hessian at the goal ≥ {:.2} M, {} repairs",
            fit.status,
            fit.iterations,
            fit.residual,
            fit.hinge,
            fit.hinge_violated_share * 100.0,
            fit.goal_hessian_min_1_s2,
            fit.repairs
        ),
    );
}
