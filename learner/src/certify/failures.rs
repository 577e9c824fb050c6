//! What a certificate fails in, in words.

use tprmp_model::skill_model::{BlockCertificate, Certificate, DemonstrationRollout, Rollouts};

use crate::skill::Certification;

/// What the certificate fails in. `demonstrations` are the rollouts from the demonstrated starts, `faults`
/// are stretches of the valley that the fit left.
pub(crate) fn failures(
    settings: &Certification,
    certificate: &Certificate,
    demonstrations: &[DemonstrationRollout],
    faults: u32,
) -> Vec<String> {
    let mut failures: Vec<String> = missed(settings, demonstrations)
        .map(|row| {
            format!(
                "from the start of demonstration `{}` it ends {} and {:.2}° from the goal",
                row.name,
                length(row.goal_error_m, 2),
                row.goal_error_rad.to_degrees()
            )
        })
        .collect();
    for block in &certificate.blocks {
        block_failures(settings, block, &mut failures);
    }
    if faults > 0 {
        failures.push(format!(
            "the potential does not fall towards the goal on {faults} stretches of its valley"
        ));
    }
    let Certificate { demonstrated_frames, displaced_frames, .. } = certificate;
    rollout_failures(settings, demonstrated_frames, "around the demonstrations", &mut failures);
    rollout_failures(settings, displaced_frames, "with displaced frames", &mut failures);
    failures
}

/// What the certificate of a skill that goes round fails in. `demonstrations` are the rollouts from the demonstrated
/// starts, `faults` are stretches of the valley that the fit left.
pub(crate) fn cycle_failures(
    settings: &Certification,
    certificate: &Certificate,
    demonstrations: &[DemonstrationRollout],
    faults: u32,
) -> Vec<String> {
    let mut failures: Vec<String> = missed(settings, demonstrations)
        .map(|row| {
            format!(
                "from the start of demonstration `{}` it comes to no limit cycle: its last two rounds are {} and \
                 {:.2}° apart",
                row.name,
                length(row.goal_error_m, 2),
                row.goal_error_rad.to_degrees()
            )
        })
        .collect();
    for block in &certificate.blocks {
        metric_failures(block, &mut failures);
        stiffness_failures(block, &mut failures);
        if let Some([low, high]) = block.valley.and_then(|valley| valley.unproved) {
            failures.push(format!(
                "that the {} potential falls all along a round is not proved between the phases {low:.4} and {high:.4}",
                block.name
            ));
        }
    }
    if faults > 0 {
        failures.push(format!(
            "the potential does not fall along a round on {faults} stretches of its valley"
        ));
    }
    let Certificate { demonstrated_frames, displaced_frames, .. } = certificate;
    for (rollouts, of) in [
        (demonstrated_frames, "around the demonstrations"),
        (displaced_frames, "with displaced frames"),
    ] {
        if rollouts.reached < rollouts.starts {
            failures.push(format!(
                "{} of {} random starts {of} do not come to the limit cycle: the worst ends {} and {:.1}° beside it",
                rollouts.starts - rollouts.reached,
                rollouts.starts,
                length(rollouts.goal_error_max_m, 1),
                rollouts.goal_error_max_rad.to_degrees()
            ));
        }
        energy_failures(settings, rollouts, of, &mut failures);
    }
    failures
}

/// The rollouts from demonstrated starts that end beyond the tolerances.
fn missed<'a>(
    settings: &'a Certification,
    demonstrations: &'a [DemonstrationRollout],
) -> impl Iterator<Item = &'a DemonstrationRollout> {
    demonstrations.iter().filter(|row| {
        !(row.goal_error_m <= settings.goal_tolerance_m
            && row.goal_error_rad <= settings.goal_tolerance_rad)
    })
}

fn metric_failures(block: &BlockCertificate, failures: &mut Vec<String>) {
    let name = &block.name;
    let least = block.metric_eigenvalue_min;
    if !(least > 0.0 && block.metric_eigenvalue_max.is_finite()) {
        failures.push(format!("the {name} metric is not positive definite ({least:.2e})"));
    }
}

fn stiffness_failures(block: &BlockCertificate, failures: &mut Vec<String>) {
    let name = &block.name;
    let stiffness = block.valley.map_or(f64::INFINITY, |valley| valley.stiffness_min_1_s2);
    if stiffness.is_nan() || stiffness <= 0.0 {
        failures.push(format!(
            "the {name} potential has no lowest point at some phase (stiffness {stiffness:.2e}/s²)"
        ));
    }
}

fn energy_failures(
    settings: &Certification,
    rollouts: &Rollouts,
    of: &str,
    failures: &mut Vec<String>,
) {
    if rollouts.energy_rise_max.is_nan() || rollouts.energy_rise_max > settings.energy_rise_max {
        failures.push(format!(
            "the energy rises by a fraction of {:.1e} in a step, from random starts {of}",
            rollouts.energy_rise_max
        ));
    }
}

fn block_failures(settings: &Certification, block: &BlockCertificate, failures: &mut Vec<String>) {
    let name = &block.name;
    metric_failures(block, failures);
    let gradient = block.goal_gradient;
    if gradient.is_nan() || gradient > settings.goal_gradient_max {
        failures.push(format!("the {name} is not at rest at the goal (|M⁻¹∇Φ| = {gradient:.2e})"));
    }
    stiffness_failures(block, failures);
    if let Some([low, high]) = block.valley.and_then(|valley| valley.unproved) {
        failures.push(format!(
            "that the {name} potential falls towards the goal is not proved between the phases {low:.4} and {high:.4}"
        ));
    }
    let hessian = block.goal_hessian_min_1_s2;
    if hessian.is_nan() || hessian <= 0.0 {
        failures.push(format!(
            "the goal is no minimum of the {name} potential (Hessian {hessian:.2e}/s²)"
        ));
    }
}

fn rollout_failures(
    settings: &Certification,
    rollouts: &Rollouts,
    of: &str,
    failures: &mut Vec<String>,
) {
    if rollouts.reached < rollouts.starts {
        let moving = match rollouts.on_their_way {
            0 => String::new(),
            count => format!(
                " ({count} of them were still on their way: `certification.horizon_s` may be too short)"
            ),
        };
        failures.push(format!(
            "{} of {} random starts {of} do not reach the goal{moving}: the worst ends {} and {:.1}° away",
            rollouts.starts - rollouts.reached,
            rollouts.starts,
            length(rollouts.goal_error_max_m, 1),
            rollouts.goal_error_max_rad.to_degrees()
        ));
    }
    energy_failures(settings, rollouts, of, failures);
}

/// A length in words; what diverged has no use for its digits.
fn length(metres: f64, decimals: usize) -> String {
    if metres < 1e4 { format!("{:.decimals$} mm", metres * 1e3) } else { format!("{metres:.0e} m") }
}
