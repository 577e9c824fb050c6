//! What the thesis reports, to stand beside what is measured here.

use serde::Deserialize;

use crate::experiment::{Experiment, PolicyKind};

#[derive(Deserialize)]
struct File {
    #[serde(rename = "source")]
    _source: String,
    figures: Vec<Published>,
}

/// The medians of a figure.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Published {
    /// Number of the figure.
    pub(crate) figure: String,
    /// The experiment here that repeats it …
    pub(crate) experiment: Experiment,
    /// … with this policy.
    pub(crate) policy: PolicyKind,
    /// What was varied.
    pub(crate) x: Vec<f64>,
    /// Medians.
    pub(crate) median: Vec<f64>,
}

/// All figures with numbers.
///
/// # Panics
/// Never: the file is part of the program and tested.
pub(crate) fn published() -> Vec<Published> {
    let file: File =
        serde_json::from_str(include_str!("published.json")).expect("the file is well formed");
    file.figures
}

/// The figure of the thesis' policy in an experiment.
pub(crate) fn of(figures: &[Published], experiment: Experiment) -> Option<&Published> {
    let own = |figure: &&Published| {
        figure.experiment == experiment && figure.policy == PolicyKind::Thesis
    };
    figures.iter().find(own)
}

/// The published median of the thesis' policy in an experiment, at a value of what was varied.
pub(crate) fn at(figures: &[Published], experiment: Experiment, x: f64) -> Option<f64> {
    let figure = of(figures, experiment)?;
    let i = figure.x.iter().position(|own| (own - x).abs() < 1e-9)?;
    figure.median.get(i).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_figure_has_a_median_for_each_value() {
        let figures = published();
        assert!(figures.len() >= 11);
        assert!(figures.iter().all(|f| f.x.len() == f.median.len() && !f.x.is_empty()));
        assert_eq!(at(&figures, Experiment::Tracking, 9.0), Some(0.088));
        assert_eq!(at(&figures, Experiment::Tracking, 8.0), None);
    }
}
