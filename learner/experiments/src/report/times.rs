//! Figure 5.12: time of a control iteration.

use glam::DVec2;
use tprmp_drawing::{Figure, Panel, Picture, Sign, Stroke, quantile};

use crate::experiment::{Experiment, PolicyKind};
use crate::published::{Published, at, of, published};
use crate::report::content::Run;
use crate::report::style::{INK_DOT, SIZE, colour, legend};

/// Distribution of the times of each policy.
pub(crate) fn picture(run: &Run) -> Option<Picture> {
    let figures = published();
    let mut caption = String::from("Medians here: ");
    let panels: Vec<Panel> =
        [(Experiment::IterationTime, "planar"), (Experiment::PickIterationTime, "pick")]
            .into_iter()
            .filter_map(|(experiment, name)| panel(run, &figures, experiment, name, &mut caption))
            .collect();
    if panels.is_empty() {
        return None;
    }
    caption += "one core of this machine, goal moving in every iteration.";
    let [canonical, thesis, .., dmp, lqr] = PolicyKind::ALL;
    let mut legend = legend(&[canonical, thesis, dmp, lqr]);
    legend.push(("published medians, Python".into(), Sign::Dot(INK_DOT)));
    let title = "Figure 5.12: time of a control iteration, K = 5 … 15";
    let figure = Figure { title: title.into(), legend, rows: vec![panels], bar: None };
    Some(Picture { name: title.into(), svg: figure.svg(), caption })
}

/// `None` when nothing was timed.
fn panel(
    run: &Run,
    figures: &[Published],
    experiment: Experiment,
    name: &str,
    words: &mut String,
) -> Option<Panel> {
    let mut panel = Panel::graph(
        &format!("{name}: fraction of iterations below a time"),
        ["log10 of the time [µs]", "fraction"],
        [DVec2::new(-1.0, -0.02), DVec2::new(5.5, 1.02)],
        SIZE,
    );
    let mut any = false;
    for (row, times) in run.timed.iter().filter(|(row, _)| row.experiment == experiment) {
        any = true;
        let points = (0..=100).map(|i| {
            let fraction = f64::from(i) / 100.0;
            let time = quantile(times, fraction).unwrap_or(f64::NAN);
            DVec2::new(time.max(0.1).log10(), fraction)
        });
        panel.line(points, &Stroke::solid(colour(row.policy), 1.6));
        if let Some([median, ..]) = row.iteration_us {
            let theirs =
                at(figures, experiment, row.x).filter(|_| row.policy == PolicyKind::Thesis);
            let theirs = theirs.map_or(String::new(), |ms| format!(" (published {ms:.0} ms)"));
            *words += &format!("{} {} {name} {median:.1} µs{theirs}; ", row.policy, row.setting);
        }
    }
    for median in of(figures, experiment).iter().flat_map(|figure| &figure.median) {
        panel.dot(DVec2::new((median * 1e3).log10(), 0.5), 4.0, INK_DOT);
    }
    any.then_some(panel)
}
