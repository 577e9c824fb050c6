//! What the policies must do, and whether they did.

use crate::experiment::{Experiment, PolicyKind, Space};
use crate::models::{Models, Trained};
use crate::published::{self, Published};
use crate::results::{AFTER_PUSH_S, Row};
use tprmp_drawing::{number, quantile};

/// Longest training of a planar skill and of the pick [s].
const TRAINING_MAX_S: [f64; 2] = [1.0, 3.0];
/// How far medians of the thesis' policy may be from the published ones, as a fraction of them.
const REPRODUCED_FRACTION: f64 = 0.1;
/// How near a goal must be reached, at a scale of one: as demonstrated, moving or displaced, beside an obstacle [m].
const STILL_M: f64 = 0.001;
const MOVING_M: f64 = 0.005;
const OBSTACLE_M: f64 = 0.01;
/// Largest median of the thesis' metric, at a scale of one [m], …
const THESIS_METRIC_M: f64 = 0.02;
/// … median and largest time-aligned mean square error [m²], …
const MSE_M2: [f64; 2] = [0.003, 0.02];
/// … root mean square of the pick [m, °] …
const PICK_RMS: [f64; 2] = [0.006, 0.5];
/// Which of the times after a push or an obstacle is a second …
const RETURNED: usize = 3;
/// … after which a body is back within this distance of the path [% of the skill's size].
const RETURNED_PERCENT: f64 = 5.0;
const _: () = assert!(AFTER_PUSH_S[RETURNED] == 1.0);
/// … and acceleration beside an obstacle [m/s²].
const ACCELERATION_M_S2: f64 = 40.0;

/// One requirement and what was measured.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Verdict {
    pub(crate) requirement: String,
    /// What was measured, with n.
    pub(crate) measured: String,
    /// Whether it holds; `None` when nothing was measured.
    pub(crate) holds: Option<bool>,
    /// Who failed: skill, setting and seed.
    pub(crate) failures: Vec<String>,
}

const UNMEASURED: &str = "not measured on this data set";

fn named(row: &Row) -> String {
    format!("{} ({}, {} {}, seed {})", row.skill, row.setting, "run", row.instance + 1, row.seed)
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

/// A length that is required.
fn length(metres: f64) -> String {
    if metres < 0.1 {
        format!("{} mm", number(metres * 1e3))
    } else {
        format!("{} m", number(metres))
    }
}

/// A number of any size with three digits at least.
fn figure(value: f64) -> String {
    if value.abs() < 1e-3 && value != 0.0 { format!("{value:.2e}") } else { number(value) }
}

fn within(row: &Row, metres: f64) -> bool {
    row.goal_error_m.is_some_and(|error| error <= metres * row.scale)
}

fn worst_goal(rows: &[&Row]) -> String {
    format!("worst {}", mm(worst(rows, |row| row.goal_error_m)))
}

/// Whether the thesis' policy does on the thesis' own skills what was published (figure 5.3a): medians
/// of the tracking metric, from the start of the first demonstration.
pub(crate) fn reproduction(rows: &[Row], figures: &[Published]) -> Verdict {
    let (mut measured, mut failures, mut n) = (Vec::new(), Vec::new(), 0);
    if let Some(figure) = published::of(figures, Experiment::Tracking) {
        for (k, published) in figure.x.iter().zip(&figure.median) {
            let own: Vec<&Row> = rows
                .iter()
                .filter(|row| row.policy == figure.policy && row.experiment == figure.experiment)
                .filter(|row| row.x == *k && row.instance == 0)
                .collect();
            n += own.len();
            let found = median(&own, |row| Some(row.thesis_metric? / row.scale));
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
        requirement: "the thesis' policy: medians of its tracking within 10 % of the published"
            .into(),
        measured: format!("{}; n = {n}", measured.join("; ")),
        holds: (n > 0).then_some(failures.is_empty()),
        failures,
    }
}

/// The table of what the default policy must do. `components`: its number of Gaussians, planar and
/// in space.
pub(crate) fn verdicts(rows: &[Row], models: &Models, components: [usize; 2]) -> Vec<Verdict> {
    let own = |row: &&Row| row.policy == PolicyKind::Canonical;
    let scale = |space| {
        rows.iter().find(|row| row.experiment.space() == space).map_or(1.0, |row| row.scale)
    };
    let mut table = Table {
        rows: rows.iter().filter(own).collect(),
        components,
        scales: Space::ALL.map(scale),
        verdicts: Vec::new(),
    };
    table.tracking();
    table.goals();
    table.obstacles();
    table.pick();
    table.stability();
    table.verdicts.push(training(models, components));
    table.verdicts
}

struct Table<'a> {
    /// Of the default policy.
    rows: Vec<&'a Row>,
    components: [usize; 2],
    /// Of the data set, planar and in space.
    scales: [f64; 2],
    verdicts: Vec<Verdict>,
}

impl<'a> Table<'a> {
    /// Rows with the number of Gaussians of the skill file.
    fn of(&self, experiments: &[Experiment]) -> Vec<&'a Row> {
        let own = |row: &&&Row| {
            experiments.contains(&row.experiment)
                && row.components == self.components[row.experiment.space() as usize]
        };
        self.rows.iter().filter(own).copied().collect()
    }

    /// All of these rows must hold.
    fn all(
        &mut self,
        requirement: &str,
        rows: &[&Row],
        measured: impl Fn(&[&Row]) -> String,
        holds: impl Fn(&Row) -> bool,
    ) {
        let failures: Vec<String> =
            rows.iter().filter(|row| !holds(row)).map(|row| named(row)).collect();
        let n = rows.len();
        let count = n - failures.len();
        self.verdicts.push(Verdict {
            requirement: requirement.into(),
            measured: if n == 0 {
                UNMEASURED.into()
            } else {
                format!("{count} of n = {n}; {}", measured(rows))
            },
            holds: (n > 0).then_some(failures.is_empty()),
            failures,
        });
    }

    /// A figure of these rows must not be larger.
    fn at_most(&mut self, requirement: &str, rows: &[&Row], value: f64, most: f64, unit: &str) {
        let n = rows.len();
        self.verdicts.push(Verdict {
            requirement: requirement.into(),
            measured: if n == 0 {
                UNMEASURED.into()
            } else {
                format!("{}{unit}, n = {n}", figure(value))
            },
            holds: (n > 0).then_some(value <= most),
            failures: Vec::new(),
        });
    }

    fn tracking(&mut self) {
        let all = self.of(&[Experiment::Tracking]);
        let scale = self.scales[0];
        let requirement = format!("tracking: every goal within {}", length(STILL_M * scale));
        self.all(&requirement, &all, worst_goal, |row| within(row, STILL_M));
        let first: Vec<&Row> = all.iter().copied().filter(|row| row.instance == 0).collect();
        let thesis = median(&first, |row| row.thesis_metric);
        let most = THESIS_METRIC_M * scale;
        let requirement =
            format!("tracking: median of the thesis' metric at most {}", length(most));
        self.at_most(&requirement, &first, thesis, most, " m");
        // As in the thesis from the start of the first demonstration; then from all of them, which also
        // says how alike they are.
        for (whose, rows) in [("first demonstration", &first), ("all demonstrations", &all)] {
            let value = |row: &Row| row.time_aligned_mse_m2;
            let errors = [median(rows, value), worst(rows, value)];
            for ((which, mse), most) in ["median", "largest"].into_iter().zip(errors).zip(MSE_M2) {
                let most = most * scale * scale;
                let requirement = format!(
                    "tracking, {whose}: {which} time-aligned MSE at most {} m²",
                    figure(most)
                );
                self.at_most(&requirement, rows, mse, most, " m²");
            }
        }
    }

    fn goals(&mut self) {
        use Experiment::{
            Adaptation, Disturbance, DisturbanceStill, Radius, StartNoise, StaticGoal,
            TurnedFrames, TurningFrames,
        };
        let scale = self.scales[0];
        let radii = [0.1, 0.9].map(|radius_m| length(radius_m * scale)).join(" … ");
        let forces = [10.0, 90.0].map(|force_n| number(force_n * scale)).join(" … ");
        let requirements: [(&str, &[Experiment]); 5] = [
            (&format!("moving goal, r = {radii}"), &[Radius, Adaptation]),
            ("static displaced goals", &[StaticGoal]),
            ("noisy starts", &[StartNoise]),
            ("frames turned and turning by up to ±90°", &[TurnedFrames, TurningFrames]),
            (&format!("orthogonal push, {forces} N"), &[Disturbance, DisturbanceStill]),
        ];
        for (what, experiments) in requirements {
            let rows = self.of(experiments);
            let requirement = format!("{what}: every goal within {}", length(MOVING_M * scale));
            self.all(&requirement, &rows, worst_goal, |row| within(row, MOVING_M));
        }
    }

    fn obstacles(&mut self) {
        let mut rows = self.of(&[Experiment::Obstacle]);
        rows.retain(|row| row.feasible);
        let clearance = |rows: &[&Row]| {
            let clearances = rows.iter().filter_map(|row| row.clearance_min_m);
            format!("least clearance {}", mm(clearances.fold(f64::INFINITY, f64::min)))
        };
        let scale = self.scales[0];
        let radii = [0.1, 0.9].map(|radius_m| length(radius_m * scale)).join(" … ");
        let requirement = format!("obstacle, R = {radii}, feasible cases: no contact");
        self.all(&requirement, &rows, clearance, |row| !row.collided);
        let requirement =
            format!("obstacle, feasible cases: every goal within {}", length(OBSTACLE_M * scale));
        self.all(&requirement, &rows, worst_goal, |row| within(row, OBSTACLE_M));
        let fastest = |rows: &[&Row]| {
            format!("largest {} m/s²", number(worst(rows, |row| row.acceleration_max_m_s2)))
        };
        let most = ACCELERATION_M_S2 * scale;
        let requirement =
            format!("obstacle, feasible cases: acceleration under {} m/s²", number(most));
        self.all(&requirement, &rows, fastest, |row| {
            row.acceleration_max_m_s2.is_some_and(|a| a < most)
        });
        for (what, experiment) in
            [("push", Experiment::DisturbanceStill), ("obstacle", Experiment::ObstacleStill)]
        {
            let mut rows = self.of(&[experiment]);
            rows.retain(|row| row.feasible);
            let after = |row: &Row| row.tube_distances.map(|distances| 100.0 * distances[RETURNED]);
            let farthest = |rows: &[&Row]| format!("largest {} %", number(worst(rows, after)));
            let requirement = format!(
                "a second after the {what}, goal at rest: within {} % of the skill's size of the path",
                number(RETURNED_PERCENT)
            );
            self.all(&requirement, &rows, farthest, |row| {
                after(row).is_some_and(|percent| percent < RETURNED_PERCENT)
            });
        }
    }

    fn pick(&mut self) {
        let rows = self.of(&[
            Experiment::PickTracking,
            Experiment::PickAdaptation,
            Experiment::PickRadius,
            Experiment::PickTurning,
            Experiment::PickDisturbance,
        ]);
        let with_angle = |rows: &[&Row]| {
            format!("{}, {:.4}°", worst_goal(rows), worst(rows, |row| row.goal_error_deg))
        };
        let scale = self.scales[1];
        let requirement = format!(
            "pick, object at rest, moving, turning, arm pushed: every goal within {} and 0.1°",
            length(STILL_M * scale)
        );
        self.all(&requirement, &rows, with_angle, |row| {
            within(row, STILL_M) && row.goal_error_deg.is_none_or(|degrees| degrees <= 0.1)
        });
        let rms = |rows: &[&Row]| {
            let most = |i: usize| worst(rows, |row| row.tracking_rms.map(|rms| rms[i]));
            format!("worst {}, {:.3}°", mm(most(0)), most(1))
        };
        let rows = self.of(&[Experiment::PickTracking]);
        let most = [PICK_RMS[0] * scale, PICK_RMS[1]];
        let requirement = format!("pick: tracking rms under {} and {}°", length(most[0]), most[1]);
        self.all(&requirement, &rows, rms, |row| {
            row.tracking_rms.is_some_and(|rms| rms[0] < most[0] && rms[1] < most[1])
        });
    }

    fn stability(&mut self) {
        let of = |experiments: &[Experiment]| -> Vec<&Row> {
            let own = |row: &&&Row| experiments.contains(&row.experiment);
            self.rows.iter().filter(own).copied().collect()
        };
        let (all, starts) =
            (of(&[Experiment::Energy, Experiment::RandomStarts]), of(&[Experiment::RandomStarts]));
        let rise =
            |rows: &[&Row]| format!("largest {:.1e}", worst(rows, |row| row.energy_rise_max));
        let requirement =
            "V, frames at rest, 100 Hz and 1 kHz: rise in a step under 1e-9 of its fall";
        self.all(requirement, &all, rise, |row| row.energy_rise_max.is_some_and(|r| r < 1e-9));
        let reached = |rows: &[&Row]| {
            let sum =
                |i: usize| rows.iter().filter_map(|r| r.starts_reached).map(|s| s[i]).sum::<u32>();
            format!("{} of {} starts", sum(0), sum(1))
        };
        let requirement = "random starts: all reach the goal, every skill";
        self.all(requirement, &starts, reached, |row| row.reached);
    }
}

/// Training time, certificate included.
fn training(models: &Models, components: [usize; 2]) -> Verdict {
    let space = |trained: &Trained| Space::of(trained.model.manifold) as usize;
    let own: Vec<_> = models
        .trained
        .iter()
        .filter(|((policy, count, _), trained)| {
            *policy == PolicyKind::Canonical
                && *count == components[space(trained)]
                && trained.examined
        })
        .collect();
    let failures: Vec<String> = own
        .iter()
        .filter(|(_, trained)| trained.training_s > TRAINING_MAX_S[space(trained)])
        .map(|((_, _, skill), trained)| format!("{skill} ({:.2} s)", trained.training_s))
        .collect();
    let times: Vec<f64> = own.iter().map(|(_, trained)| trained.training_s).collect();
    Verdict {
        requirement: "training: a planar skill under 1 s, the pick under 3 s, certificate included"
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

    fn row(experiment: Experiment, error: Option<f64>) -> Row {
        Row {
            skill: "S".into(),
            components: 9,
            goal_error_m: error,
            thesis_metric: Some(0.01),
            time_aligned_mse_m2: Some(0.001),
            ..Row::new(experiment, PolicyKind::Canonical)
        }
    }

    #[test]
    fn published_medians_are_reproduced_within_a_tenth() {
        let figure = Published {
            figure: "5.3a".into(),
            experiment: Experiment::Tracking,
            policy: PolicyKind::Thesis,
            x: vec![5.0, 9.0],
            median: vec![0.1, 0.2],
        };
        let rows = |metrics: [f64; 2]| -> Vec<Row> {
            std::iter::zip([5.0, 9.0], metrics)
                .map(|(x, metric)| Row {
                    x,
                    thesis_metric: Some(metric),
                    ..Row::new(Experiment::Tracking, PolicyKind::Thesis)
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
        let rows = vec![
            row(Experiment::Tracking, Some(1e-6)),
            row(Experiment::Radius, Some(0.004)),
            row(Experiment::Radius, None),
        ];
        let table = verdicts(&rows, &Models::default(), [9, 15]);
        let of = |start: &str| table.iter().find(|v| v.requirement.starts_with(start)).unwrap();
        assert_eq!(of("tracking: every").holds, Some(true));
        let moving = of("moving goal");
        assert_eq!(moving.holds, Some(false));
        assert_eq!(moving.failures.len(), 1);
        assert!(moving.failures[0].contains('S') && moving.measured.contains("diverged"));
        assert_eq!(of("static displaced").holds, None);
    }

    #[test]
    fn requirements_scale_with_the_data_set() {
        let small = |error| Row { scale: 0.02, ..row(Experiment::Tracking, Some(error)) };
        let table = |error| verdicts(&[small(error)], &Models::default(), [9, 15]);
        let [near, far] = [table(1.9e-5), table(2.1e-5)];
        assert_eq!(near[0].requirement, "tracking: every goal within 0.02 mm");
        assert_eq!((near[0].holds, far[0].holds), (Some(true), Some(false)));
    }

    #[test]
    fn rows_of_other_policies_do_not_count() {
        let other = Row { policy: PolicyKind::Thesis, ..row(Experiment::Tracking, None) };
        let table =
            verdicts(&[other, row(Experiment::Tracking, Some(0.0))], &Models::default(), [9, 15]);
        assert_eq!(table[0].holds, Some(true));
    }
}
