//! What the policies must do, and whether they did.

use super::metric::quantile;
use super::models::{Kind, Models};
use super::published::Published;
use super::results::Row;

/// Longest training of a planar skill and of the pick [s].
const TRAINING_MAX_S: [f64; 2] = [1.0, 3.0];

/// How far medians of the thesis' policy may be from the published ones, as a fraction of them.
const REPRODUCED_FRACTION: f64 = 0.1;

/// One demand and what was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// What is demanded.
    pub demand: String,
    /// What was measured, with n.
    pub measured: String,
    /// Whether it holds; `None` when nothing was measured.
    pub holds: Option<bool>,
    /// Who failed: skill, setting and seed.
    pub failures: Vec<String>,
}

/// Rows of the default policy, with the number of Gaussians of its skill file where that is varied.
fn own<'a>(rows: &'a [Row], experiments: &[&str], components: [usize; 2]) -> Vec<&'a Row> {
    rows.iter()
        .filter(|row| {
            row.policy == Kind::Canonical.name()
                && experiments.contains(&row.experiment.as_str())
                && row.components == components[usize::from(row.experiment.starts_with("pick"))]
        })
        .collect()
}

fn named(row: &Row) -> String {
    format!("{} ({}, {} {}, seed {})", row.skill, row.setting, "run", row.instance + 1, row.seed)
}

/// All of these rows must hold.
fn all(
    demand: &str,
    rows: &[&Row],
    measured: impl Fn(&[&Row]) -> String,
    holds: impl Fn(&Row) -> bool,
) -> Verdict {
    let failures: Vec<String> =
        rows.iter().filter(|row| !holds(row)).map(|row| named(row)).collect();
    let n = rows.len();
    Verdict {
        demand: demand.into(),
        measured: if n == 0 {
            "not measured on this data set".into()
        } else {
            format!("{} of n = {n}; {}", n - failures.len(), measured(rows))
        },
        holds: (n > 0).then_some(failures.is_empty()),
        failures,
    }
}

fn worst(rows: &[&Row], value: impl Fn(&Row) -> Option<f64>) -> f64 {
    rows.iter().map(|row| value(row).unwrap_or(f64::INFINITY)).fold(0.0, f64::max)
}

fn median(rows: &[&Row], value: impl Fn(&Row) -> Option<f64>) -> f64 {
    let values: Vec<f64> = rows.iter().map(|row| value(row).unwrap_or(f64::INFINITY)).collect();
    quantile(&values, 0.5).unwrap_or(f64::NAN)
}

/// A length in millimetres, or that it diverged.
fn mm(metres: f64) -> String {
    if metres.is_finite() { format!("{:.3} mm", metres * 1e3) } else { "diverged".into() }
}

/// Whether the thesis' policy does on the thesis' own skills what was published (figure 5.3a): medians
/// of the tracking metric, from the start of the first demonstration.
#[must_use]
pub fn reproduction(rows: &[Row], figures: &[Published]) -> Verdict {
    let (mut measured, mut failures, mut n) = (Vec::new(), Vec::new(), 0);
    for figure in figures.iter().filter(|figure| figure.experiment == "tracking") {
        for (k, published) in figure.x.iter().zip(&figure.median) {
            let own: Vec<&Row> = rows
                .iter()
                .filter(|row| row.policy == Kind::Thesis.name() && row.experiment == "tracking")
                .filter(|row| row.x == *k && row.instance == 0)
                .collect();
            n += own.len();
            let found = median(&own, |row| row.thesis_metric);
            let text = format!("K = {k}: {found:.3} m, published {published:.3}");
            // Not a number is not near.
            let near = (found / published - 1.0).abs() <= REPRODUCED_FRACTION;
            if !near {
                failures.push(text.clone());
            }
            measured.push(text);
        }
    }
    Verdict {
        demand: "the thesis' policy: medians of its tracking within 10 % of the published".into(),
        measured: format!("{}; n = {n}", measured.join("; ")),
        holds: (n > 0).then_some(failures.is_empty()),
        failures,
    }
}

/// The table of what the default policy must do. `components`: its number of Gaussians, planar and
/// in space.
#[must_use]
pub fn verdicts(rows: &[Row], models: &Models, components: [usize; 2]) -> Vec<Verdict> {
    let of = |experiments: &[&str]| own(rows, experiments, components);
    let goal = |row: &Row| row.goal_error_m;
    let worst_goal = |rows: &[&Row]| format!("worst {}", mm(worst(rows, goal)));
    let within = |row: &Row, metres: f64| row.goal_error_m.is_some_and(|error| error <= metres);
    let tracking = of(&["tracking"]);
    let mut table = vec![all("tracking: every goal within 1 mm", &tracking, worst_goal, |row| {
        within(row, 0.001)
    })];
    let mut summary = |demand: &str, rows: &[&Row], value: f64, most: f64, unit: &str| {
        table.push(Verdict {
            demand: demand.into(),
            measured: if rows.is_empty() {
                "not measured on this data set".into()
            } else {
                format!("{value:.4}{unit}, n = {}", rows.len())
            },
            holds: (!rows.is_empty()).then_some(value <= most),
            failures: Vec::new(),
        });
    };
    let shown: Vec<&Row> = tracking.iter().copied().filter(|row| row.instance == 0).collect();
    let thesis = median(&shown, |row| row.thesis_metric);
    summary("tracking: median of the thesis' metric at most 0.02 m", &shown, thesis, 0.02, " m");
    // As in the thesis from the start of the first demonstration; then from all of them, which also
    // says how alike they are.
    for (whose, rows) in [("first demonstration", &shown), ("all demonstrations", &tracking)] {
        let mse = median(rows, |row| row.time_aligned_mse_m2);
        let demand = format!("tracking, {whose}: median time-aligned MSE at most 0.003 m²");
        summary(&demand, rows, mse, 0.003, " m²");
        let mse = worst(rows, |row| row.time_aligned_mse_m2);
        let demand = format!("tracking, {whose}: largest time-aligned MSE at most 0.02 m²");
        summary(&demand, rows, mse, 0.02, " m²");
    }
    for (demand, experiments) in [
        ("moving goal, r = 0.1 … 0.9 m: every goal within 5 mm", vec!["radius", "adaptation"]),
        ("static displaced goals: every goal within 5 mm", vec!["static_goal"]),
        ("noisy starts: every goal within 5 mm", vec!["start_noise"]),
        (
            "frames turned and turning by up to ±90°: every goal within 5 mm",
            vec!["turned_frames", "turning_frames"],
        ),
        ("orthogonal push, 10 … 90 N: every goal within 5 mm", vec!["disturbance"]),
    ] {
        table.push(all(demand, &of(&experiments), worst_goal, |row| within(row, 0.005)));
    }
    let feasible: Vec<&Row> = of(&["obstacle"]).into_iter().filter(|row| row.feasible).collect();
    let clearance = |rows: &[&Row]| {
        let least = rows.iter().filter_map(|row| row.clearance_min_m).fold(f64::INFINITY, f64::min);
        format!("least clearance {}", mm(least))
    };
    table.push(all(
        "obstacle, R = 0.1 … 0.9 m, feasible cases: no contact",
        &feasible,
        clearance,
        |row| !row.collided,
    ));
    table.push(all(
        "obstacle, feasible cases: every goal within 1 cm",
        &feasible,
        worst_goal,
        |row| within(row, 0.01),
    ));
    let acceleration = |row: &Row| row.acceleration_max_m_s2;
    let fastest = |rows: &[&Row]| format!("largest {:.1} m/s²", worst(rows, acceleration));
    table.push(all(
        "obstacle, feasible cases: acceleration under 40 m/s²",
        &feasible,
        fastest,
        |row| acceleration(row).is_some_and(|a| a < 40.0),
    ));
    let still =
        |row: &Row| within(row, 0.001) && row.goal_error_deg.is_none_or(|degrees| degrees <= 0.1);
    let with_angle = |rows: &[&Row]| {
        let degrees = worst(rows, |row| row.goal_error_deg);
        format!("worst {}, {degrees:.4}°", mm(worst(rows, goal)))
    };
    table.push(all(
        "pick, object at rest, moving, turning, arm pushed: every goal within 1 mm and 0.1°",
        &of(&[
            "pick_tracking",
            "pick_adaptation",
            "pick_radius",
            "pick_turning",
            "pick_disturbance",
        ]),
        with_angle,
        still,
    ));
    let rms = |rows: &[&Row]| {
        let most = |i: usize| worst(rows, |row| row.tracking_rms.map(|rms| rms[i]));
        format!("worst {}, {:.3}°", mm(most(0)), most(1))
    };
    table.push(all(
        "pick: tracking rms under 6 mm and 0.5°",
        &of(&["pick_tracking"]),
        rms,
        |row| row.tracking_rms.is_some_and(|[metres, degrees]| metres < 0.006 && degrees < 0.5),
    ));
    let stable: Vec<&Row> = rows
        .iter()
        .filter(|row| row.policy == Kind::Canonical.name())
        .filter(|row| ["energy", "random_starts"].contains(&row.experiment.as_str()))
        .collect();
    let rise = |rows: &[&Row]| format!("largest {:.1e}", worst(rows, |row| row.energy_rise_max));
    table.push(all(
        "V, frames at rest, 100 Hz and 1 kHz: rise in a step under 1e-9 of its fall",
        &stable,
        rise,
        |row| row.energy_rise_max.is_some_and(|rise| rise < 1e-9),
    ));
    let starts: Vec<&Row> =
        stable.into_iter().filter(|row| row.experiment == "random_starts").collect();
    let reached = |rows: &[&Row]| {
        let sum =
            |i: usize| rows.iter().filter_map(|r| r.starts_reached).map(|s| s[i]).sum::<u32>();
        format!("{} of {} starts", sum(0), sum(1))
    };
    table.push(all("random starts: all reach the goal, every skill", &starts, reached, |row| {
        row.reached
    }));
    table.push(training(models, components));
    table
}

/// Training time, certificate included.
fn training(models: &Models, components: [usize; 2]) -> Verdict {
    let own: Vec<_> = models
        .trained
        .iter()
        .filter(|((kind, count, _), trained)| {
            let pick = trained.model.manifold.has_orientation();
            *kind == Kind::Canonical && *count == components[usize::from(pick)] && trained.examined
        })
        .collect();
    let most = |trained: &super::models::Trained| {
        TRAINING_MAX_S[usize::from(trained.model.manifold.has_orientation())]
    };
    let failures: Vec<String> = own
        .iter()
        .filter(|(_, trained)| trained.training_s > most(trained))
        .map(|((_, _, skill), trained)| format!("{skill} ({:.2} s)", trained.training_s))
        .collect();
    let times: Vec<f64> = own.iter().map(|(_, trained)| trained.training_s).collect();
    Verdict {
        demand: "training: a planar skill under 1 s, the pick under 3 s, certificate included"
            .into(),
        measured: format!(
            "median {:.2} s, longest {:.2} s, n = {}, one after the other on all cores",
            quantile(&times, 0.5).unwrap_or(f64::NAN),
            times.iter().copied().fold(0.0, f64::max),
            times.len()
        ),
        holds: (!times.is_empty()).then_some(failures.is_empty()),
        failures,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(experiment: &str, error: Option<f64>) -> Row {
        Row {
            experiment: experiment.into(),
            policy: "canonical".into(),
            skill: "S".into(),
            components: 9,
            feasible: true,
            goal_error_m: error,
            thesis_metric: Some(0.01),
            time_aligned_mse_m2: Some(0.001),
            ..Row::default()
        }
    }

    #[test]
    fn published_medians_are_reproduced_within_a_tenth() {
        let figure = Published {
            figure: "5.3a".into(),
            experiment: "tracking".into(),
            x: vec![5.0, 9.0],
            median: vec![0.1, 0.2],
        };
        let rows = |metrics: [f64; 2]| -> Vec<Row> {
            std::iter::zip([5.0, 9.0], metrics)
                .map(|(x, metric)| Row {
                    policy: "thesis".into(),
                    experiment: "tracking".into(),
                    x,
                    thesis_metric: Some(metric),
                    ..Row::default()
                })
                .collect()
        };
        let figures = [figure];
        let verdict = |metrics| reproduction(&rows(metrics), &figures);
        assert_eq!(verdict([0.109, 0.181]).holds, Some(true));
        let far = verdict([0.109, 0.179]);
        assert!(far.holds == Some(false) && far.failures.len() == 1, "{far:?}");
        assert_eq!(verdict([f64::NAN, 0.2]).holds, Some(false));
        assert_eq!(reproduction(&[], &figures).holds, None);
    }

    #[test]
    fn a_failure_is_named_and_a_diverged_row_fails() {
        let rows =
            vec![row("tracking", Some(1e-6)), row("radius", Some(0.004)), row("radius", None)];
        let table = verdicts(&rows, &Models::default(), [9, 15]);
        let of = |start: &str| table.iter().find(|v| v.demand.starts_with(start)).unwrap();
        assert_eq!(of("tracking: every").holds, Some(true));
        let moving = of("moving goal");
        assert_eq!(moving.holds, Some(false));
        assert_eq!(moving.failures.len(), 1);
        assert!(moving.failures[0].contains('S') && moving.measured.contains("diverged"));
        assert_eq!(of("static displaced").holds, None);
    }

    #[test]
    fn rows_of_other_policies_do_not_count() {
        let other = Row { policy: "thesis".into(), ..row("tracking", None) };
        let table = verdicts(&[other, row("tracking", Some(0.0))], &Models::default(), [9, 15]);
        assert_eq!(table[0].holds, Some(true));
    }
}
