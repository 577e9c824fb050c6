//! Pictures of measurements, as SVG that stands in a page.

use std::fmt::Write;

use crate::statistics::Buckets;

/// Colours that people with any colour vision can tell apart [Okabe and Ito].
pub const COLOURS: [&str; 6] = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#6c757d"];
const INK: &str = "#22303c";
const FAINT: &str = "#dfe5ea";
const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 250.0;
/// Room around the axes \[px\].
const LEFT: f64 = 58.0;
const RIGHT: f64 = 26.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 44.0;
/// Bars an octave of a histogram.
const BARS: f64 = 4.0;
const LEGEND_ROW: f64 = 17.0;
const BAR_ROW: f64 = 22.0;

/// Text that may stand in HTML and SVG.
#[must_use]
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

struct Picture {
    svg: String,
    height: f64,
}

impl Picture {
    fn new(title: &str, height: f64) -> Self {
        let mut svg = format!(
            "<svg viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" \
             role=\"img\" font-family=\"system-ui, sans-serif\" font-size=\"12\">"
        );
        let title = escape(title);
        let _ = write!(
            svg,
            "<text x=\"{LEFT}\" y=\"17\" fill=\"{INK}\" font-weight=\"600\">{title}</text>"
        );
        Self { svg, height }
    }

    fn text(&mut self, x: f64, y: f64, anchor: &str, text: &str) {
        let text = escape(text);
        let _ = write!(
            self.svg,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"{INK}\">{text}</text>"
        );
    }

    fn line(&mut self, [x1, y1, x2, y2]: [f64; 4], colour: &str) {
        let _ = write!(
            self.svg,
            "<path d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" stroke=\"{colour}\" fill=\"none\"/>"
        );
    }

    fn rectangle(&mut self, [x, y, width, height]: [f64; 4], colour: &str) {
        let _ = write!(
            self.svg,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" \
             fill=\"{colour}\"/>"
        );
    }

    fn legend(&mut self, labels: &[(&str, &str)]) {
        let mut y = self.height - LEGEND_ROW * labels.len() as f64 + 8.0;
        for (label, colour) in labels {
            self.rectangle([LEFT, y - 9.0, 12.0, 10.0], colour);
            self.text(LEFT + 18.0, y, "start", label);
            y += LEGEND_ROW;
        }
    }

    fn finish(mut self) -> String {
        self.svg.push_str("</svg>");
        self.svg
    }
}

fn x_of(fraction: f64) -> f64 {
    LEFT + fraction * (WIDTH - LEFT - RIGHT)
}

fn y_of(fraction: f64) -> f64 {
    HEIGHT - BOTTOM - fraction * (HEIGHT - TOP - BOTTOM)
}

/// A number with three digits, without noise.
#[must_use]
pub fn short(value: f64) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    let digits = if value.abs() >= 100.0 { 0 } else { usize::from(value.abs() < 10.0) + 1 };
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

/// Counts by bar: bar `i` ends at 2^(i / BARS) µs.
fn bars(buckets: &Buckets) -> Vec<(i32, u64)> {
    let mut bars: Vec<(i32, u64)> = Vec::new();
    for (upper, count) in buckets.pairs() {
        let bar = (upper.log2() * BARS - 1e-6).ceil() as i32;
        match bars.last_mut() {
            Some((last, sum)) if *last == bar => *sum += count,
            _ => bars.push((bar, *count)),
        }
    }
    bars
}

/// Several histograms over each other: times on a logarithmic axis, fractions of all times on another,
/// so that one in 10⁵ is still seen. Empty when there is nothing to show.
#[must_use]
pub fn histograms(title: &str, series: &[(&str, Buckets)]) -> String {
    let shown: Vec<_> = series.iter().filter(|(_, buckets)| buckets.total() > 0).collect();
    let all = shown.iter().map(|(_, buckets)| bars(buckets));
    let all: Vec<_> = all.collect();
    let every = || all.iter().flatten().map(|(bar, _)| *bar);
    let (Some(low), Some(high)) = (every().min(), every().max()) else { return String::new() };
    // Whole decades.
    let decade = |bar: f64| (bar / BARS).exp2().log10();
    let low = decade(f64::from(low - 1)).floor();
    let high = decade(f64::from(high)).ceil().max(low + 1.0);
    let largest = shown.iter().map(|(_, buckets)| buckets.total()).max().unwrap_or(1);
    let least = -(largest as f64).log10().ceil().max(1.0);
    let x = |decades: f64| x_of((decades - low) / (high - low));
    let y = |fraction: f64| y_of((fraction.log10().max(least) - least) / -least);

    let mut picture = Picture::new(title, HEIGHT + LEGEND_ROW * shown.len() as f64);
    for k in 0..=(high - low) as i32 {
        let decades = low + f64::from(k);
        picture.line([x(decades), y_of(0.0), x(decades), y_of(1.0)], FAINT);
        picture.text(x(decades), y_of(0.0) + 16.0, "middle", &short(10_f64.powf(decades)));
    }
    for k in 0..=(-least) as i32 {
        let height = y(10_f64.powi(-k));
        picture.line([x_of(0.0), height, x_of(1.0), height], FAINT);
        let label = if k < 3 { short(100.0 * 10_f64.powi(-k)) } else { format!("1e-{}", k - 2) };
        picture.text(LEFT - 6.0, height + 4.0, "end", &format!("{label} %"));
    }
    picture.text(x_of(0.5), y_of(0.0) + 32.0, "middle", "µs");
    for (((_, buckets), bars), colour) in shown.iter().zip(&all).zip(COLOURS) {
        let total = buckets.total() as f64;
        let mut path = String::new();
        for (bar, count) in bars {
            let (left, right) = (x(decade(f64::from(bar - 1))), x(decade(f64::from(*bar))));
            let (top, floor) = (y(*count as f64 / total), y_of(0.0));
            let _ = write!(path, "M{left:.1} {floor:.1}V{top:.1}H{right:.1}V{floor:.1}Z");
        }
        let _ = write!(
            picture.svg,
            "<path d=\"{path}\" fill=\"{colour}\" fill-opacity=\"0.25\" stroke=\"{colour}\"/>"
        );
    }
    let labels: Vec<_> = shown.iter().zip(COLOURS).map(|((label, _), c)| (*label, c)).collect();
    picture.legend(&labels);
    picture.finish()
}

/// A line through points, both axes from zero.
#[must_use]
pub fn line(title: &str, x_label: &str, y_label: &str, points: &[(f64, f64)]) -> String {
    let top = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max).max(1e-9);
    let (x_max, y_max) =
        (top(&mut points.iter().map(|p| p.0)), 1.1 * top(&mut points.iter().map(|p| p.1)));
    let mut picture = Picture::new(title, HEIGHT);
    for k in 0..=4 {
        let fraction = f64::from(k) / 4.0;
        picture.line([x_of(0.0), y_of(fraction), x_of(1.0), y_of(fraction)], FAINT);
        picture.text(LEFT - 6.0, y_of(fraction) + 4.0, "end", &short(fraction * y_max));
        picture.text(x_of(fraction), y_of(0.0) + 16.0, "middle", &short(fraction * x_max));
    }
    picture.text(x_of(0.5), y_of(0.0) + 32.0, "middle", x_label);
    picture.text(x_of(1.0), 17.0, "end", y_label);
    let place = |(x, y): &(f64, f64)| (x_of(x / x_max), y_of(y / y_max));
    let mut path = String::new();
    for (i, (x, y)) in points.iter().map(place).enumerate() {
        let _ = write!(path, "{}{x:.1} {y:.1}", if i == 0 { 'M' } else { 'L' });
        let _ = write!(
            picture.svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"{}\"/>",
            COLOURS[0]
        );
    }
    let _ = write!(
        picture.svg,
        "<path d=\"{path}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2\"/>",
        COLOURS[0]
    );
    picture.finish()
}

/// A bar a row, made of parts one after the other; `parts` names them.
#[must_use]
pub fn stacked(title: &str, unit: &str, parts: &[&str], rows: &[(String, Vec<f64>)]) -> String {
    let longest = rows.iter().map(|(_, row)| row.iter().sum::<f64>()).fold(1e-9, f64::max);
    let floor = TOP + BAR_ROW * rows.len() as f64;
    let height = floor + BOTTOM + LEGEND_ROW * parts.len() as f64;
    let mut picture = Picture::new(title, height);
    for k in 0..=4 {
        let fraction = f64::from(k) / 4.0;
        picture.line([x_of(fraction), TOP, x_of(fraction), floor], FAINT);
        picture.text(x_of(fraction), floor + 16.0, "middle", &short(fraction * longest));
    }
    picture.text(x_of(0.5), floor + 32.0, "middle", unit);
    for (i, (label, row)) in rows.iter().enumerate() {
        let y = TOP + BAR_ROW * i as f64;
        picture.text(LEFT - 6.0, y + 14.0, "end", label);
        let mut before = 0.0;
        for (value, colour) in row.iter().zip(COLOURS) {
            let (left, right) = (x_of(before / longest), x_of((before + value) / longest));
            picture.rectangle([left, y + 3.0, right - left, BAR_ROW - 6.0], colour);
            before += value;
        }
    }
    let labels: Vec<_> = parts.iter().copied().zip(COLOURS).collect();
    picture.legend(&labels);
    picture.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_of_any_width_become_bars_of_one() {
        let buckets = Buckets::new(vec![(1.0, 1), (1.1, 2), (1.18, 3), (2.0, 4), (64.0, 5)]);
        assert_eq!(bars(&buckets), [(0, 1), (1, 5), (4, 4), (24, 5)]);
    }

    #[test]
    fn numbers_are_short() {
        let shown = [0.0, 0.123, 1.5, 20.0, 99.96, 1234.5, f64::NAN].map(short);
        assert_eq!(shown, ["0", "0.12", "1.5", "20", "100", "1234", "–"]);
    }

    #[test]
    fn a_picture_shows_each_series_and_escapes_its_title() {
        let series = [("a", Buckets::new(vec![(1.0, 9)])), ("none", Buckets::default())];
        let svg = histograms("p < q", &series);
        assert!(svg.contains("p &lt; q") && svg.contains(">a<") && !svg.contains(">none<"));
        assert_eq!(histograms("", &[]), "");
    }
}
