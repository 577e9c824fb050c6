//! Box plots over what was varied.

use glam::DVec2;
use tprmp_drawing::{Anchor, Figure, Panel, Picture, Sign, Stroke, number, quantile};

use crate::experiment::{Experiment, PolicyKind};
use crate::published::{Published, at, of, published};
use crate::report::content::Run;
use crate::report::style::{INK_DOT, SIZE, colour, legend};
use crate::results::Row;

/// What is smaller or larger is drawn at the edge: log10 of the axes.
const DECADES: [f64; 2] = [-6.0, 3.0];

/// Experiments as box plots, left what the thesis measured, right the true error: title, what is varied,
/// and its unit.
const BOXES: [(Experiment, &str, &str, &str); 14] = [
    (Experiment::Tracking, "Figure 5.3a: planar tracking over K", "K", ""),
    (Experiment::PickTracking, "Figure 5.3b: tracking of the pick over K", "K", ""),
    (Experiment::Adaptation, "Figure 5.7a: goal on a circle of 0.2 m, over K", "K", ""),
    (Experiment::PickAdaptation, "Figure 5.7b: object on a circle of 0.2 m, over K", "K", ""),
    (
        Experiment::Disturbance,
        "Figure 5.8a: push across the motion, truly orthogonal",
        "force [N]",
        " N",
    ),
    (
        Experiment::DisturbancePublished,
        "Figure 5.8a: push as published, which is not orthogonal",
        "force [N]",
        " N",
    ),
    (Experiment::DisturbanceStill, "Push across the motion, goal at rest", "force [N]", " N"),
    (Experiment::PickDisturbance, "Figure 5.8b: push on the pick", "force [N]", " N"),
    (Experiment::Radius, "Figure 5.9a: goal on circles of growing radius", "radius [m]", " m"),
    (
        Experiment::PickRadius,
        "Figure 5.9b: object on circles of growing radius",
        "radius [m]",
        " m",
    ),
    (Experiment::StaticGoal, "Static displaced goals, in all directions", "displacement [m]", " m"),
    (Experiment::TurnedFrames, "Frames turned at rest", "turn [°]", "°"),
    (Experiment::StartNoise, "Noisy starts", "radius of the noise [m]", " m"),
    (Experiment::PickTurning, "Object that circles and turns", "turn [rad]", " rad"),
];

/// All of these figures.
pub(crate) fn pictures(run: &Run) -> Vec<Picture> {
    let figures = published();
    let picture = |(experiment, title, label, unit): (Experiment, &str, &'static str, _)| {
        let boxes = Boxes::new(run, &figures, experiment, label, unit)?;
        let panels = vec![
            boxes.panel("thesis' metric", |row| row.thesis_metric, &figures),
            boxes.panel("distance to the true goal", |row| row.goal_error_m, &[]),
        ];
        let mut legend = legend(&boxes.policies);
        if let Some(published) = of(&figures, experiment) {
            let words = format!("published median, figure {}", published.figure);
            legend.push((words, Sign::Dot(INK_DOT)));
        }
        let figure = Figure { title: title.into(), legend, rows: vec![panels], bar: None };
        Some(Picture { name: title.into(), svg: figure.svg(), caption: boxes.caption() })
    };
    BOXES.into_iter().filter_map(picture).collect()
}

/// The label of an axis whose lengths or forces were multiplied by a scale.
pub(crate) fn scaled(label: &str, scale: f64) -> String {
    if scale == 1.0 { label.into() } else { format!("{label}, × {}", number(scale)) }
}

/// What was varied, ascending, and the policies, in a fixed order.
pub(crate) fn axes(rows: &[&Row]) -> (Vec<f64>, Vec<PolicyKind>) {
    let mut xs: Vec<f64> = rows.iter().map(|row| row.x).filter(|x| x.is_finite()).collect();
    xs.sort_by(f64::total_cmp);
    xs.dedup();
    let known = |policy: &PolicyKind| rows.iter().any(|row| row.policy == *policy);
    (xs, PolicyKind::ALL.into_iter().filter(known).collect())
}

/// Least distance of neighbours, where there are any.
pub(crate) fn step(xs: &[f64]) -> f64 {
    let own = xs.iter().filter(|x| **x != 0.0).copied().collect::<Vec<_>>();
    own.windows(2).map(|pair| pair[1] - pair[0]).reduce(f64::min).unwrap_or(1.0)
}

/// Values of a policy at a value of what was varied; missing ones are infinite.
pub(crate) fn values(
    rows: &[&Row],
    policy: PolicyKind,
    x: f64,
    of: impl Fn(&Row) -> Option<f64>,
) -> Vec<f64> {
    let own = rows.iter().filter(|row| row.policy == policy && row.x == x);
    own.map(|row| of(row).unwrap_or(f64::INFINITY)).collect()
}

fn decade(value: f64) -> f64 {
    value.max(1e-300).log10().clamp(DECADES[0], DECADES[1])
}

/// The rows of an experiment.
struct Boxes<'a> {
    experiment: Experiment,
    label: &'static str,
    unit: &'static str,
    figures: &'a [Published],
    rows: Vec<&'a Row>,
    xs: Vec<f64>,
    policies: Vec<PolicyKind>,
    /// Whether what is varied scales with the data set.
    scales: bool,
}

impl<'a> Boxes<'a> {
    /// Of the data set.
    fn scale(&self) -> f64 {
        self.rows[0].scale
    }

    /// `None` without rows. Planar tracking is drawn with the first demonstration's frames only, as
    /// it was published.
    fn new(
        run: &Run<'a>,
        figures: &'a [Published],
        experiment: Experiment,
        label: &'static str,
        unit: &'static str,
    ) -> Option<Self> {
        let first_only = experiment == Experiment::Tracking;
        let own = |row: &&Row| row.experiment == experiment && (!first_only || row.instance == 0);
        let rows: Vec<&Row> = run.rows.iter().filter(own).collect();
        let (xs, policies) = axes(&rows);
        let scales = [" m", " N"].contains(&unit);
        (!rows.is_empty()).then_some(Self {
            experiment,
            label,
            unit,
            figures,
            rows,
            xs,
            policies,
            scales,
        })
    }

    fn panel(
        &self,
        title: &str,
        of: impl Fn(&Row) -> Option<f64> + Copy,
        figures: &[Published],
    ) -> Panel {
        let (xs, policies) = (&self.xs, &self.policies);
        // Policies to which the varied number means nothing stand to the left.
        let step = step(xs);
        let smallest = xs.iter().filter(|x| **x != 0.0).copied().reduce(f64::min).unwrap_or(0.0);
        let place = |x: f64| if x == 0.0 { smallest - step } else { x };
        let (first, last) = (place(xs[0]), xs[xs.len() - 1]);
        let low = DVec2::new(first - 0.6 * step, DECADES[0] - 0.3);
        let high = DVec2::new(last + 0.6 * step, DECADES[1] + 0.3);
        let varied = if self.scales { scaled(self.label, self.scale()) } else { self.label.into() };
        let mut panel = Panel::graph(title, [&varied, "log10 of metres"], [low, high], SIZE);
        let width = 0.8 * step / policies.len() as f64;
        for x in xs {
            for (p, policy) in policies.iter().enumerate() {
                let values = values(&self.rows, *policy, *x, of);
                if values.is_empty() {
                    continue;
                }
                let center = place(*x) - 0.4 * step + width * (p as f64 + 0.5);
                draw_box(&mut panel, center, 0.36 * width, &values, colour(*policy));
            }
            if let Some(median) = at(figures, self.experiment, *x) {
                panel.dot(DVec2::new(*x, decade(median * self.scale())), 4.0, INK_DOT);
            }
            if *x == 0.0 {
                let at = DVec2::new(place(*x), DECADES[1]);
                panel.words(at, DVec2::new(0.0, 4.0), Anchor::Middle, "no K");
            }
        }
        panel
    }

    /// What is seen, by the numbers.
    fn caption(&self) -> String {
        let mut words =
            String::from("Boxes from the first to the third quartile, whiskers to the extremes. ");
        for policy in &self.policies {
            let own: Vec<&&Row> = self.rows.iter().filter(|row| row.policy == *policy).collect();
            let reached = own.iter().filter(|row| row.reached).count();
            let errors: Vec<f64> =
                own.iter().map(|row| row.goal_error_m.unwrap_or(f64::INFINITY)).collect();
            let median = quantile(&errors, 0.5).unwrap_or(f64::NAN);
            let diverged = errors.iter().filter(|error| error.is_infinite()).count();
            let diverged =
                if diverged > 0 { format!(", {diverged} diverged") } else { String::new() };
            words += &format!(
                "{}: {reached} of n = {} reach the true goal (median {}{diverged}). ",
                policy.words(),
                own.len(),
                length(median)
            );
        }
        for policy in PolicyKind::LEARNED {
            let pair = |x: &f64| {
                let median = at(self.figures, self.experiment, *x)?;
                let own = values(&self.rows, policy, *x, |row| row.thesis_metric);
                let here = quantile(&own, 0.5)? / self.scale();
                Some(format!("{here:.3} ({median:.3}) at {}{}", number(*x), self.unit))
            };
            let pairs: Vec<String> = self.xs.iter().filter_map(pair).collect();
            if !pairs.is_empty() {
                words += &format!(
                    "Medians of {}, {policy} (published): {}. ",
                    scaled("the thesis' metric", self.scale().recip()),
                    pairs.join(", ")
                );
            }
        }
        words
    }
}

fn length(metres: f64) -> String {
    if metres.is_infinite() {
        "diverged".into()
    } else if metres < 0.01 {
        format!("{:.3} mm", metres * 1e3)
    } else {
        format!("{metres:.3} m")
    }
}

fn draw_box(panel: &mut Panel, x: f64, half: f64, values: &[f64], colour: &'static str) {
    let at = |fraction| decade(quantile(values, fraction).unwrap_or(f64::INFINITY));
    let [least, low, middle, high, most] = [0.0, 0.25, 0.5, 0.75, 1.0].map(at);
    let p = DVec2::new;
    let thin = Stroke::solid(colour, 1.2);
    panel.line([p(x, least), p(x, low)], &thin);
    panel.line([p(x, high), p(x, most)], &thin);
    let corners = [p(x - half, low), p(x + half, low), p(x + half, high), p(x - half, high)];
    panel.band(corners, colour);
    panel.line(corners.into_iter().chain([corners[0]]), &thin);
    panel.line([p(x - half, middle), p(x + half, middle)], &Stroke::solid(colour, 2.6));
}
