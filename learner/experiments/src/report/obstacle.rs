//! Figure 5.14: how many of the skills pass an obstacle.

use std::collections::BTreeSet;

use glam::DVec2;
use tprmp_drawing::{Figure, Panel, Picture, Sign, Stroke, number};

use crate::experiment::{Experiment, PolicyKind};
use crate::published::{at, published};
use crate::report::boxes::{axes, scaled, step, values};
use crate::report::content::Run;
use crate::report::style::{INK_DOT, MARK, SIZE, colour, legend};
use crate::results::Row;

/// Range of the clearances that are drawn [m], and of the accelerations, log10; at a scale of one, as all here.
const CLEARANCE_M: [f64; 2] = [-0.1, 0.4];
const DECADES: [f64; 2] = [0.0, 4.0];
/// What no obstacle may need [m/s²].
const ACCELERATION_MAX_M_S2: f64 = 40.0;
/// Skills of the thesis.
const PUBLISHED_SKILLS: f64 = 15.0;

/// Fraction of the feasible cases that pass, over the radius; clearances and accelerations.
pub(crate) fn picture(run: &Run) -> Option<Picture> {
    let figures = published();
    let rows: Vec<&Row> =
        run.rows.iter().filter(|row| row.experiment == Experiment::Obstacle).collect();
    if rows.is_empty() {
        return None;
    }
    let (xs, policies) = axes(&rows);
    let scale = rows[0].scale;
    let skills = rows.iter().map(|row| &row.skill).collect::<BTreeSet<_>>().len();
    let step = step(&xs);
    let (first, last) = (xs[0] - 0.6 * step, xs[xs.len() - 1] + 0.6 * step);
    let mut passes = Panel::graph(
        "no contact, and at the true goal",
        [&scaled("obstacle radius [m]", scale), "fraction of the feasible cases [%]"],
        [DVec2::new(first, -4.0), DVec2::new(last, 105.0)],
        SIZE,
    );
    let mut clearances = Panel::graph(
        "least clearance and largest acceleration",
        [
            &scaled("log10 of the largest acceleration [m/s²]", scale),
            &scaled("least clearance [m]", scale),
        ],
        [DVec2::new(DECADES[0], CLEARANCE_M[0]), DVec2::new(DECADES[1], CLEARANCE_M[1])],
        SIZE,
    );
    // The default policy last: on top of the others.
    let drawn = policies.iter().rev().map(|policy| {
        draw_clearances(&mut clearances, &rows, *policy);
        draw_passes(&mut passes, &rows, *policy, &xs, skills)
    });
    let mut words: Vec<String> = drawn.collect();
    words.reverse();
    let mut published = Vec::new();
    for x in &xs {
        if let Some(count) = at(&figures, Experiment::Obstacle, *x) {
            passes.dot(DVec2::new(*x, 100.0 * count / PUBLISHED_SKILLS), 4.0, INK_DOT);
            published.push(format!("{count:.0}"));
        }
    }
    clearances.line(DECADES.map(|x| DVec2::new(x, 0.0)), &MARK);
    clearances.line(CLEARANCE_M.map(|y| DVec2::new(ACCELERATION_MAX_M_S2.log10(), y)), &MARK);
    words.push(format!(
        "Published, of 15, where a touch within 0.2 m of the last Gaussian counted and collisions \
         did not: {}. {skills} skills; a case is feasible when neither goal nor start is ever within \
         {} cm of the obstacle.",
        published.join(", "),
        number(5.0 * scale)
    ));
    let mut legend = legend(&policies);
    legend.push(("published".into(), Sign::Dot(INK_DOT)));
    let title = "Figure 5.14: obstacle that moves with the goal";
    let rows = vec![vec![passes, clearances]];
    let svg = Figure { title: title.into(), legend, rows, bar: None }.svg();
    Some(Picture { name: title.into(), svg, caption: words.concat() })
}

fn feasible<'a>(rows: &'a [&Row], policy: PolicyKind) -> impl Iterator<Item = &'a Row> {
    rows.iter().copied().filter(move |row| row.policy == policy && row.feasible)
}

fn draw_clearances(panel: &mut Panel, rows: &[&Row], policy: PolicyKind) {
    for row in feasible(rows, policy) {
        if let (Some(a), Some(c)) = (row.acceleration_max_m_s2, row.clearance_min_m) {
            let x = (a / row.scale).max(1.0).log10().min(DECADES[1]);
            let y = (c / row.scale).clamp(CLEARANCE_M[0], CLEARANCE_M[1]);
            panel.dot(DVec2::new(x, y), 2.6, colour(policy));
        }
    }
}

/// Returns what is seen, by the numbers.
fn draw_passes(
    panel: &mut Panel,
    rows: &[&Row],
    policy: PolicyKind,
    xs: &[f64],
    skills: usize,
) -> String {
    let (mut points, mut each) = (Vec::new(), Vec::new());
    let (mut feasible_all, mut passed_all) = (0, 0);
    for x in xs {
        let own: Vec<&Row> = feasible(rows, policy).filter(|row| row.x == *x).collect();
        let passed = own.iter().filter(|row| row.reached && !row.collided).count();
        each.push(format!("{passed}/{}", own.len()));
        feasible_all += own.len();
        passed_all += passed;
        if !own.is_empty() {
            points.push(DVec2::new(*x, 100.0 * passed as f64 / own.len() as f64));
        }
    }
    panel.line(points.iter().copied(), &Stroke::solid(colour(policy), 2.4));
    points.iter().for_each(|p| panel.dot(*p, 3.4, colour(policy)));
    let theirs = |x: &f64| {
        let passed = values(rows, policy, *x, |row| row.thesis_metric);
        format!("{:.0}", passed.iter().sum::<f64>())
    };
    format!(
        "{policy}: {passed_all} of {feasible_all} feasible cases (by radius {}); by the thesis' \
         criterion, of all {skills}: {}. ",
        each.join(", "),
        xs.iter().map(theirs).collect::<Vec<_>>().join(", ")
    )
}
