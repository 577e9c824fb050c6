//! What a fit is warned of.

use tprmp_model::skill_model::{DemonstrationRollout, Fit, ProgramFit, ProgramStatus};

use crate::demonstration::plausibility::with_others;

/// A demonstration is warned of when it is left by more than this fraction of the skill's span.
const PATH_FRACTION_MAX: f64 = 0.05;

/// … or by more than this angle \[rad\].
const PATH_MAX_RAD: f64 = 0.1;
/// An execution that lasts another fraction of the demonstration is warned of.
const PACE_RANGE: [f64; 2] = [0.5, 2.0];

/// The programs that were solved to a reduced accuracy only: a sentence each.
pub(crate) fn reduced(programs: &[ProgramFit]) -> impl Iterator<Item = String> {
    let reduced = programs.iter().filter(|program| program.status != ProgramStatus::Solved);
    reduced.map(|program| {
        format!("the {} was solved to a reduced accuracy only ({})", program.name, program.status)
    })
}

/// What people should know of a fit; `span_m` is what the demonstrations span.
pub(crate) fn fit_warnings(fit: &Fit, span_m: f64) -> Vec<String> {
    let Fit { programs, demonstrations, .. } = fit;
    let mut warnings: Vec<String> = reduced(programs).collect();
    warnings.extend(left(
        demonstrations,
        |row| row.path_rms_m,
        PATH_FRACTION_MAX * span_m,
        |most| {
            format!(
                "{:.1} mm (rms) where {span_m:.2} m are spanned: does it contradict the others?",
                1e3 * most
            )
        },
    ));
    warnings.extend(left(
        demonstrations,
        |row| row.path_rms_rad,
        PATH_MAX_RAD,
        |most| {
            format!("{:.1}° (rms): do its orientations contradict the others'?", most.to_degrees())
        },
    ));
    let pace = |row: &&DemonstrationRollout| {
        let ratio = row.execution_s / row.duration_s;
        !(PACE_RANGE[0]..=PACE_RANGE[1]).contains(&ratio)
    };
    if let Some(row) = demonstrations.iter().find(pace) {
        warnings.push(format!(
            "the motion of `{}` took {:.1} s, and is executed in {:.1} s",
            row.name, row.duration_s, row.execution_s
        ));
    }
    warnings
}

/// The demonstration that is left farthest, and how many others are left too.
fn left(
    demonstrations: &[DemonstrationRollout],
    by: fn(&DemonstrationRollout) -> f64,
    most: f64,
    text: impl Fn(f64) -> String,
) -> Option<String> {
    let far = demonstrations.iter().filter(|row| by(row) > most);
    let worst = far.clone().max_by(|a, b| by(a).total_cmp(&by(b)))?;
    Some(format!("{} is left by {}", with_others(&worst.name, far.count()), text(by(worst))))
}
