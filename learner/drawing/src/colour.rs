//! Colours: a perceptually uniform map for numbers, and a few that any eye tells apart for lines.

use glam::DVec3;

use crate::ticks::nice_step;

/// Text.
pub const INK: &str = "#22303c";
/// Lines; any eye tells this one and the following apart [Okabe and Ito].
pub const BLUE: &str = "#0072b2";
/// Lines.
pub const RED: &str = "#c2291f";
/// Lines.
pub const ORANGE: &str = "#d98200";
/// Lines.
pub const GREEN: &str = "#009e73";
/// Lines.
pub const PURPLE: &str = "#8a4fa3";
/// Lines on areas.
pub const BLACK: &str = "#1a1a1a";
/// Axes, and lines in the background.
pub const GREY: &str = "#8a97a2";
/// Axes of a frame: x, y, z.
pub const AXES: [&str; 3] = ["#d62728", "#2ca02c", "#1f5fd6"];

/// The colour map viridis in equal steps [van der Walt and Smith].
const VIRIDIS: [[u8; 3]; 9] = [
    [0x44, 0x01, 0x54],
    [0x47, 0x2d, 0x7b],
    [0x3b, 0x52, 0x8b],
    [0x2c, 0x72, 0x8e],
    [0x21, 0x91, 0x8c],
    [0x28, 0xae, 0x80],
    [0x5e, 0xc9, 0x62],
    [0xad, 0xdc, 0x30],
    [0xfd, 0xe7, 0x25],
];
/// How much white is in the colours of areas, so that lines stand out on them.
const PALE: f64 = 0.3;
/// About how many bands an area has.
const BANDS: f64 = 16.0;
/// Most bands of roots.
const ROOT_BANDS: f64 = 24.0;
/// Values that span a larger ratio are put on a logarithmic scale, where that is allowed.
const RATIO_MAX: f64 = 30.0;

/// The colour at a fraction from 0 (dark) to 1 (light), mixed with a fraction of white.
fn viridis(fraction: f64, white: f64) -> String {
    let last = VIRIDIS.len() - 1;
    let at = fraction.clamp(0.0, 1.0) * last as f64;
    let i = (at as usize).min(last - 1);
    let colour = |i: usize| DVec3::from_array(VIRIDIS[i].map(f64::from));
    let mixed = colour(i).lerp(colour(i + 1), at - i as f64).lerp(DVec3::splat(255.0), white);
    let [r, g, b] = mixed.to_array().map(|x| x.round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// The colour of a phase from 0 to 1, dark to light but never too light for a line.
pub fn of_phase(phase: f64) -> String {
    viridis(0.88 * phase.clamp(0.0, 1.0), 0.0)
}

/// The colour of a phase for areas, on which lines stand out.
pub fn pale_of_phase(phase: f64) -> String {
    viridis(0.88 * phase.clamp(0.0, 1.0), 0.55)
}

/// Bands of values and their colours: the larger, the darker.
#[derive(Debug, Clone)]
pub struct Scale {
    levels: Vec<f64>,
    label: String,
    kind: Kind,
}

/// What is coloured.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Areas,
    Lines,
    Phases,
}

impl Scale {
    /// For areas of these values, which have a minimum at zero: equal steps of their roots.
    pub fn areas_of_roots(values: impl IntoIterator<Item = f64>, label: &str) -> Self {
        let (low, high) = extent(values);
        Self { levels: squares(low, high), label: label.into(), kind: Kind::Areas }
    }

    /// For areas of these positive values: equal ratios where they span a large one.
    pub fn areas_of_ratios(values: impl IntoIterator<Item = f64>, label: &str) -> Self {
        let (low, high) = extent(values);
        Self { levels: ratios(low, high), label: label.into(), kind: Kind::Areas }
    }

    /// For lines of these magnitudes.
    pub fn lines(values: impl IntoIterator<Item = f64>, label: &str) -> Self {
        let (low, high) = extent(values);
        // What is smaller than this looks the same.
        let low = low.max(1e-2 * high);
        Self { levels: ratios(low, high), label: label.into(), kind: Kind::Lines }
    }

    /// For phases from 0 to 1.
    pub fn phases() -> Self {
        let levels = (0..=20).map(|i| f64::from(i) / 20.0).collect();
        Self { levels, label: "phase".into(), kind: Kind::Phases }
    }

    /// Ends of the bands, ascending.
    pub fn levels(&self) -> &[f64] {
        &self.levels
    }

    /// What the values are.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// How many bands there are.
    pub fn bands(&self) -> usize {
        self.levels.len() - 1
    }

    /// The band of a value; the outermost ones reach to infinity.
    pub fn band(&self, value: f64) -> usize {
        let inner = &self.levels[1..self.levels.len() - 1];
        inner.partition_point(|level| *level <= value)
    }

    /// The colour of a band.
    pub fn colour(&self, band: usize) -> String {
        let fraction = (band as f64 + 0.5) / self.bands() as f64;
        match self.kind {
            Kind::Areas => viridis(1.0 - fraction, PALE),
            // The lightest of the map are lost on white.
            Kind::Lines => viridis(0.93 * (1.0 - fraction), 0.0),
            Kind::Phases => of_phase(fraction),
        }
    }
}

/// Least and largest value.
fn extent(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let ends = (f64::INFINITY, f64::NEG_INFINITY);
    let finite = values.into_iter().filter(|value| value.is_finite());
    let (low, high) = finite.fold(ends, |(low, high), x| (low.min(x), high.max(x)));
    if low <= high { (low, high) } else { (0.0, 1.0) }
}

/// Round levels in equal steps around two ends.
fn linear(low: f64, high: f64) -> Vec<f64> {
    let step = nice_step(((high - low) / BANDS).max(1e-9 * high.abs()).max(1e-12));
    let first = (low / step + 1e-6).floor() as i64;
    let last = ((high / step - 1e-6).ceil() as i64).max(first + 1);
    (first..=last).map(|i| i as f64 * step).collect()
}

/// Levels u i² for whole i, those below zero −u i², around zero and two ends.
fn squares(low: f64, high: f64) -> Vec<f64> {
    let farthest = high.max(-low).max(1e-12);
    let unit = nice_step(farthest / (ROOT_BANDS * ROOT_BANDS));
    let steps = |x: f64| (x.max(0.0) / unit).sqrt();
    // A rounding error below zero is none.
    let (below, above) = ((steps(-low) - 1e-3).ceil() as i32, (steps(high) - 1e-6).ceil() as i32);
    (-below.max(0)..=above.max(1)).map(|i| f64::from(i * i.abs()) * unit).collect()
}

/// Levels 1, 1.5, 2, 3, 5, 7 times powers of ten around two ends, or equal steps when their ratio is
/// small.
fn ratios(low: f64, high: f64) -> Vec<f64> {
    if low <= 0.0 || high / low < RATIO_MAX {
        return linear(low, high);
    }
    let first = low.log10().floor() as i32;
    let last = high.log10().ceil() as i32;
    let all = (first..=last)
        .flat_map(|power| [1.0, 1.5, 2.0, 3.0, 5.0, 7.0].map(|f| f * 10_f64.powi(power)));
    let all: Vec<f64> = all.collect();
    let from = all.partition_point(|level| *level <= low).max(1) - 1;
    let to = all.partition_point(|level| *level < high).min(all.len() - 1);
    all[from..=to].to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_hold_their_values() {
        for values in [[0.13, 7.9], [-3.0, 5.0], [2.0, 2.0], [0.0, 0.0], [0.02, 90.0]] {
            for scale in [Scale::areas_of_roots(values, ""), Scale::areas_of_ratios(values, "")] {
                let levels = scale.levels();
                assert!(levels[0] <= values[0] && values[1] <= levels[levels.len() - 1]);
                assert!(levels.windows(2).all(|pair| pair[0] < pair[1]), "{levels:?}");
                assert!((2..60).contains(&levels.len()), "{levels:?}");
                assert_eq!(scale.band(f64::NEG_INFINITY), 0);
                assert_eq!(scale.band(f64::INFINITY), scale.bands() - 1);
            }
        }
    }

    #[test]
    fn the_map_runs_from_dark_to_light() {
        assert_eq!(viridis(0.0, 0.0), "#440154");
        assert_eq!(viridis(1.0, 0.0), "#fde725");
        assert_eq!(viridis(0.5, 1.0), "#ffffff");
    }
}
