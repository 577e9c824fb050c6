//! What the thesis reports, to stand beside what is measured here.

use serde::Deserialize;

#[derive(Deserialize)]
struct File {
    #[serde(rename = "source")]
    _source: String,
    figures: Vec<Published>,
}

/// The medians of a figure.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Number of the figure.
    pub figure: String,
    /// The experiment here that repeats it.
    pub experiment: String,
    /// What was varied.
    pub x: Vec<f64>,
    /// Medians.
    pub median: Vec<f64>,
}

/// All figures with numbers.
///
/// # Panics
/// Never: the file is part of the program and tested.
#[must_use]
pub fn published() -> Vec<Published> {
    let file: File =
        serde_json::from_str(include_str!("published.json")).expect("the file is well formed");
    file.figures
}

/// The published median of an experiment at a value of what was varied.
#[must_use]
pub fn at(figures: &[Published], experiment: &str, x: f64) -> Option<f64> {
    let figure = figures.iter().find(|figure| figure.experiment == experiment)?;
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
        assert_eq!(at(&figures, "tracking", 9.0), Some(0.088));
        assert_eq!(at(&figures, "tracking", 8.0), None);
    }
}
