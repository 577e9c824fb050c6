//! The field's measures: tables for the page and the terminal, and the figure of what follows a push.

use std::fmt::Write as _;

use glam::DVec2;
use tprmp_drawing::{
    Cell, Figure, GREY, Page, Panel, Picture, Sign, Stroke, decades, number, quantile,
};

use crate::case::Extent;
use crate::experiment::{Experiment, PolicyKind, Setting};
use crate::grid::REACHED_FRACTION;
use crate::measures::{Measures, SAMPLES};
use crate::report::content::Run;
use crate::report::style::{SIZE, colour, legend};
use crate::results::{AFTER_PUSH_S, Row};

/// A measure of a rollout, by its name, its unit and how many of them are an SI unit.
type Column = (&'static str, &'static str, f64, fn(&Measures) -> Option<f64>);

const COLUMNS: [Column; 5] = [
    ("RMSE", "mm", 1e3, |m| Some(m.rmse_m)),
    ("DTW a sample", "mm", 1e3, |m| Some(m.dtw_m)),
    ("Fréchet", "mm", 1e3, |m| Some(m.frechet_m)),
    ("swept area", "cm²", 1e4, |m| m.swept_area_m2),
    ("velocity error", "mm/s", 1e3, |m| Some(m.velocity_rmse_m_s)),
];
/// Median, 95th percentile, maximum.
const LIKENESS: [f64; 3] = [0.5, 0.95, 1.0];
/// Median and 90th percentile.
const TUBE: [f64; 2] = [0.5, 0.9];
/// What is drawn of the distances to the path, as fractions of the size [%].
const DRAWN_PERCENT: [f64; 2] = [0.01, 100.0];

/// A table: its title, what to know of it, its head and its rows.
struct Table {
    title: &'static str,
    note: String,
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

/// Puts the tables on the page.
pub(crate) fn tables(page: &mut Page, run: &Run) {
    for table in all(&own_rows(run)).into_iter().filter(|table| !table.rows.is_empty()) {
        page.subsection(table.title);
        page.paragraph(&table.note);
        let head: Vec<&str> = table.head.iter().map(String::as_str).collect();
        page.table(&head, table.rows.iter().map(|row| row.iter().map(Cell::from).collect()));
    }
}

/// The tables as text.
pub(crate) fn text(run: &Run) -> String {
    let mut text = String::new();
    for table in all(&own_rows(run)).into_iter().filter(|table| !table.rows.is_empty()) {
        writeln!(text, "{}", table.title).expect("a string grows");
        for row in &table.rows {
            let named = std::iter::zip(&table.head, row).skip(1);
            let cells: Vec<String> = named.map(|(head, cell)| format!("{head} {cell}")).collect();
            writeln!(text, "      {}: {}", row[0], cells.join(", ")).expect("a string grows");
        }
    }
    text
}

/// Rows of policies with the number of Gaussians of their skill file.
fn own_rows<'a>(run: &Run<'a>) -> Vec<&'a Row> {
    let own = |row: &&Row| {
        let count = run.bench.files.count(row.experiment.space(), row.policy);
        !PolicyKind::LEARNED.contains(&row.policy) || row.components == count
    };
    run.rows.iter().filter(own).collect()
}

fn all(rows: &[&Row]) -> [Table; 4] {
    [
        likeness(rows, Experiment::Tracking, "Like the demonstrations, in the plane"),
        likeness(rows, Experiment::PickTracking, "Like the demonstrations, the pick"),
        grid(rows),
        tube(rows),
    ]
}

/// The rows of each policy in an experiment, of those that have some.
fn by_policy<'a>(rows: &[&'a Row], experiment: Experiment) -> Vec<(PolicyKind, Vec<&'a Row>)> {
    let of = |policy| {
        let own = |row: &&&Row| row.experiment == experiment && row.policy == policy;
        let own: Vec<&Row> = rows.iter().filter(own).copied().collect();
        (!own.is_empty()).then_some((policy, own))
    };
    PolicyKind::ALL.into_iter().filter_map(of).collect()
}

/// A figure, or that more rollouts diverged than it leaves out.
fn or_diverged(value: Option<f64>) -> String {
    match value {
        None => "–".into(),
        Some(value) if value.is_finite() => number(value),
        Some(_) => "diverged".into(),
    }
}

/// How like their demonstrations rollouts are, a row a policy.
fn likeness(rows: &[&Row], experiment: Experiment, title: &'static str) -> Table {
    let mut head: Vec<String> = ["policy", "n"].map(Into::into).into();
    head.extend(COLUMNS.map(|(name, unit, ..)| format!("{name} [{unit}]")));
    let row = |(policy, own): (PolicyKind, Vec<&Row>)| {
        let cell = |(_, _, units, of): Column| {
            // What is measured nowhere, as areas in space, is no divergence.
            if own.iter().all(|row| row.measures.is_some_and(|m| of(&m).is_none())) {
                return or_diverged(None);
            }
            let value = |row: &&Row| row.measures.as_ref().and_then(of).unwrap_or(f64::INFINITY);
            let values: Vec<f64> = own.iter().map(|row| value(row) * units).collect();
            LIKENESS.map(|fraction| or_diverged(quantile(&values, fraction))).join(" / ")
        };
        let mut cells = vec![policy.words(), own.len().to_string()];
        cells.extend(COLUMNS.map(cell));
        cells
    };
    Table {
        title,
        note: format!(
            "Rollouts from each demonstration's start, at rest, with its frames: median / 95th percentile / \
               maximum. Root mean square and velocity error at the same times; dynamic time warping (over the \
               number of samples), discrete Fréchet distance and swept area of the paths, both sampled at \
               {SAMPLES} points of equal distance."
        ),
        head,
        rows: by_policy(rows, experiment).into_iter().map(row).collect(),
    }
}

/// Which part of the starts all over the workspace end at the goal, a row a policy.
fn grid(rows: &[&Row]) -> Table {
    let policies = by_policy(rows, Experiment::GridStarts);
    let setting = policies.first().map_or(String::new(), |(_, own)| own[0].setting.clone());
    let full = Setting::Grid(Extent::full().grid).to_string();
    let look =
        if setting == full { String::new() } else { format!(" (a quick look; in full {full})") };
    let percent = |[reached, all]: [u32; 2]| 100.0 * f64::from(reached) / f64::from(all);
    let row = |(policy, own): (PolicyKind, Vec<&Row>)| {
        let starts = || own.iter().filter_map(|row| Some((row.starts_reached?, row)));
        let sum = |i: usize| starts().map(|(starts, _)| starts[i]).sum::<u32>();
        let least = starts().min_by(|a, b| percent(a.0).total_cmp(&percent(b.0)));
        let least = least.map_or(String::new(), |(starts, row)| {
            format!("{} ({})", number(percent(starts)), row.skill)
        });
        let complete = own.iter().filter(|row| row.reached).count();
        vec![
            policy.words(),
            format!("{} of {}", sum(0), sum(1)),
            number(percent([sum(0), sum(1)])),
            least,
            format!("{complete} of {}", own.len()),
        ]
    };
    Table {
        title: "Starts all over the workspace",
        note: format!(
            "{setting} a skill{look}, at rest, on the box around the demonstrations with sides longer by 30 %, with the \
             frames of the first demonstration: how many end within 2 mm of the goal for 50 mm of the skill's size \
             ({} % of it).",
            number(100.0 * REACHED_FRACTION)
        ),
        head: [
            "policy",
            "starts at the goal",
            "fraction [%]",
            "least of a skill [%]",
            "skills with all",
        ]
        .map(Into::into)
        .into(),
        rows: policies.into_iter().map(row).collect(),
    }
}

const PUSHED: [(Experiment, &str); 3] = [
    (Experiment::DisturbanceStill, "goal at rest"),
    (Experiment::ObstacleStill, "obstacle, goal at rest"),
    (Experiment::Disturbance, "goal on its circle"),
];

/// Quantile of the distance to the path at one of [`AFTER_PUSH_S`] [% of the size].
fn tube_percent(own: &[&Row], time: usize, fraction: f64) -> Option<f64> {
    let value = |row: &&Row| row.tube_distances.map_or(f64::INFINITY, |all| 100.0 * all[time]);
    quantile(&own.iter().map(value).collect::<Vec<_>>(), fraction)
}

/// How far from the demonstrated path bodies are after a push or an obstacle.
fn tube(rows: &[&Row]) -> Table {
    let mut head: Vec<String> = ["policy", "n"].map(Into::into).into();
    head.extend(AFTER_PUSH_S.map(|after_s| format!("{after_s} s after [%]")));
    let row = |words: &str, (policy, own): (PolicyKind, Vec<&Row>)| {
        let mut cells = vec![format!("{}, {words}", policy.words()), own.len().to_string()];
        cells.extend((0..AFTER_PUSH_S.len()).map(|time| {
            TUBE.map(|fraction| or_diverged(tube_percent(&own, time, fraction))).join(" / ")
        }));
        cells
    };
    let rows = PUSHED.into_iter().flat_map(|(experiment, words)| {
        by_policy(rows, experiment).into_iter().map(move |own| row(words, own))
    });
    Table {
        title: "Distance to the demonstrated path after a push or an obstacle",
        note: "After the end of a push across the motion, all forces, and after an obstacle on the path is passed, all radii: median / 90th percentile of the distance to the \
               path of the first demonstration, of the skill's size. A goal on its circle moves the path that \
               a policy should take away from the demonstrated one; with the goal at rest it is the same."
            .into(),
        head,
        rows: rows.collect(),
    }
}

/// The distances to the demonstrated path over time.
pub(crate) fn picture(run: &Run) -> Option<Picture> {
    let rows = own_rows(run);
    let panel = |(experiment, words): (Experiment, &str)| {
        let policies = by_policy(&rows, experiment);
        (!policies.is_empty()).then(|| draw_tube(words, &policies))
    };
    let panels: Vec<Panel> = PUSHED.into_iter().filter_map(panel).collect();
    if panels.is_empty() {
        return None;
    }
    let drawn = |policy: &PolicyKind| {
        let own = |row: &&Row| row.policy == *policy && row.tube_distances.is_some();
        rows.iter().copied().any(|row| own(&row))
    };
    let policies: Vec<PolicyKind> = PolicyKind::ALL.into_iter().filter(drawn).collect();
    let mut legend = legend(&policies);
    legend.push(("90th percentile".into(), Sign::Line(Stroke::dashed(GREY, 1.6))));
    let title = "Distance to the demonstrated path after a push or an obstacle";
    let figure = Figure { title: title.into(), legend, rows: vec![panels], bar: None };
    let caption = "Solid: median; dashed: 90th percentile, over all skills and forces. What diverged lies at \
                   the upper edge.";
    Some(Picture { name: title.into(), svg: figure.svg(), caption: caption.into() })
}

fn draw_tube(title: &str, policies: &[(PolicyKind, Vec<&Row>)]) -> Panel {
    let [low, high] = decades(DRAWN_PERCENT[0], DRAWN_PERCENT[1]);
    let last_s = AFTER_PUSH_S[AFTER_PUSH_S.len() - 1];
    let range = [DVec2::new(0.0, low), DVec2::new(last_s, high)];
    let labels = ["time after the push [s]", "distance, of the skill's size [%]"];
    let mut panel = Panel::graph(title, labels, range, SIZE).logarithmic(false, true);
    for (policy, own) in policies.iter().rev() {
        let strokes = [Stroke::solid(colour(*policy), 2.2), Stroke::dashed(colour(*policy), 1.6)];
        for (fraction, stroke) in TUBE.into_iter().zip(&strokes) {
            let point = |(time, after_s): (usize, f64)| {
                let percent = tube_percent(own, time, fraction).unwrap_or(f64::INFINITY);
                DVec2::new(after_s, percent.clamp(low, high))
            };
            panel.line(AFTER_PUSH_S.into_iter().enumerate().map(point), stroke);
        }
    }
    panel
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(experiment: Experiment, policy: PolicyKind) -> Row {
        Row { skill: "S".into(), ..Row::new(experiment, policy) }
    }

    #[test]
    fn a_table_has_quantiles_in_its_units() {
        let of = |rmse_m: f64| {
            let area = Some(0.01);
            let measures = Measures {
                rmse_m,
                dtw_m: 0.002,
                frechet_m: 0.003,
                swept_area_m2: area,
                velocity_rmse_m_s: 0.1,
            };
            Row { measures: Some(measures), ..row(Experiment::Tracking, PolicyKind::Canonical) }
        };
        let lost = row(Experiment::Tracking, PolicyKind::Thesis);
        let rows = [of(0.001), of(0.003), lost];
        let table = likeness(&rows.iter().collect::<Vec<_>>(), Experiment::Tracking, "");
        let expected = [
            "canonical",
            "2",
            "2 / 2.9 / 3",
            "2 / 2 / 2",
            "3 / 3 / 3",
            "100 / 100 / 100",
            "100 / 100 / 100",
        ];
        assert_eq!(table.rows[0], expected);
        assert_eq!(table.rows[1][2], "diverged / diverged / diverged");
        assert_eq!(table.rows[1].len(), table.head.len());
    }

    #[test]
    fn starts_add_up_over_the_skills() {
        let of = |skill: &str, reached| Row {
            skill: skill.into(),
            setting: Setting::Grid(2).to_string(),
            reached: reached == 4,
            starts_reached: Some([reached, 4]),
            ..row(Experiment::GridStarts, PolicyKind::Dmp)
        };
        let rows = [of("S", 4), of("U", 1)];
        let table = grid(&rows.iter().collect::<Vec<_>>());
        assert_eq!(table.rows, [["dmp", "5 of 8", "62.5", "25 (U)", "1 of 2"]]);
        assert!(
            table.note.starts_with("2 × 2 starts a skill (a quick look; in full 35 × 35 starts)")
        );
    }

    #[test]
    fn distances_after_a_push_are_percents_of_the_size() {
        let of = |first| Row {
            tube_distances: Some([first, 0.04, 0.03, 0.02, 0.01]),
            ..row(Experiment::DisturbanceStill, PolicyKind::Pd)
        };
        let rows = [of(0.1), of(0.2), row(Experiment::DisturbanceStill, PolicyKind::Pd)];
        let table = tube(&rows.iter().collect::<Vec<_>>());
        let expected = ["pd, goal at rest", "3", "20 / diverged", "4 / diverged"];
        assert_eq!(table.rows[0][..4], expected);
    }
}
