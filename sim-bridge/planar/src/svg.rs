//! A small plotting helper: axes with ticks and units, lines, circles, bars and a legend, as SVG.

use std::fmt::Write;

use glam::DVec2;

/// Room around the axes \[px\].
const LEFT: f64 = 66.0;
const RIGHT: f64 = 18.0;
const BOTTOM: f64 = 50.0;
/// Title, and each row of the legend \[px\].
const TITLE: f64 = 34.0;
const LEGEND_ROW: f64 = 20.0;
/// Mean width of a letter of the legend \[px\].
const LETTER: f64 = 6.4;
const INK: &str = "#22303c";
const FAINT: &str = "#e3e8ec";

/// Colours that people with any colour vision can tell apart [Okabe and Ito].
pub(crate) const BLUE: &str = "#0072b2";
pub(crate) const ORANGE: &str = "#e69f00";
pub(crate) const RED: &str = "#c8443c";
pub(crate) const GREEN: &str = "#009e73";
pub(crate) const GREY: &str = "#9aa7b1";

/// An axis: what it shows, from where to where.
#[derive(Debug, Clone)]
pub(crate) struct Axis {
    label: String,
    low: f64,
    high: f64,
    logarithmic: bool,
}

impl Axis {
    /// Equal steps; widened to at least a little where nothing varies.
    pub(crate) fn linear(label: &str, low: f64, high: f64) -> Self {
        let (low, high) = if high - low > 1e-9 { (low, high) } else { (low - 0.5, low + 0.5) };
        Self { label: label.into(), low, high, logarithmic: false }
    }

    /// Equal ratios, out to full powers of ten.
    pub(crate) fn logarithmic(label: &str, low: f64, high: f64) -> Self {
        let low = 10_f64.powf(low.max(1e-12).log10().floor());
        let high = 10_f64.powf(high.max(low * 1.001).log10().ceil());
        Self { label: label.into(), low, high, logarithmic: true }
    }

    /// The same axis from another low end.
    pub(crate) fn from(self, low: f64) -> Self {
        Self { low, ..self }
    }

    /// Where a value lies, from 0 to 1; held inside the axis.
    fn fraction(&self, value: f64) -> f64 {
        let fraction = if self.logarithmic {
            (value.max(1e-300) / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        fraction.clamp(0.0, 1.0)
    }

    fn ticks(&self) -> Vec<f64> {
        if self.logarithmic {
            let low = (self.low.log10() - 1e-9).ceil() as i32;
            let high = self.high.log10().round() as i32;
            let stride = ((high - low) / 8 + 1).max(1) as usize;
            return (low..=high).step_by(stride).map(|e| 10_f64.powi(e)).collect();
        }
        let step = nice_step((self.high - self.low) / 7.0);
        let first = (self.low / step - 1e-9).ceil() as i64;
        let last = (self.high / step + 1e-9).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

/// The next larger of 1, 2 and 5 times a power of ten.
fn nice_step(least: f64) -> f64 {
    let power = 10_f64.powf(least.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= least * 0.999);
    factor.unwrap_or(10.0) * power
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stroke {
    pub(crate) colour: &'static str,
    pub(crate) width: f64,
    pub(crate) dashes: &'static str,
}

impl Stroke {
    pub(crate) fn solid(colour: &'static str, width: f64) -> Self {
        Self { colour, width, dashes: "none" }
    }

    pub(crate) fn dashed(colour: &'static str, width: f64) -> Self {
        Self { colour, width, dashes: "5 4" }
    }
}

enum Key {
    Line(Stroke),
    Disc(&'static str),
}

/// A picture with one pair of axes.
pub(crate) struct Plot {
    title: String,
    x: Axis,
    y: Axis,
    /// Of the axes \[px\].
    size: DVec2,
    body: String,
    legend: Vec<(String, Key)>,
}

impl Plot {
    /// Axes of a size in pixels.
    pub(crate) fn new(title: &str, x: Axis, y: Axis, size: DVec2) -> Self {
        Self { title: title.into(), x, y, size, body: String::new(), legend: Vec::new() }
    }

    /// Axes in metres with equal scales, around all these points.
    pub(crate) fn map(title: &str, labels: [&str; 2], points: &[DVec2], width: f64) -> Self {
        let low = points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let high = points.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        let room = DVec2::splat(0.05 * (high - low).max_element().max(1e-3));
        let (low, high) = (low - room, high + room);
        let height = width * (high.y - low.y) / (high.x - low.x);
        Self::new(
            title,
            Axis::linear(labels[0], low.x, high.x),
            Axis::linear(labels[1], low.y, high.y),
            DVec2::new(width, height.clamp(0.2 * width, 2.0 * width)),
        )
    }

    fn at(&self, point: DVec2) -> DVec2 {
        self.size * DVec2::new(self.x.fraction(point.x), 1.0 - self.y.fraction(point.y))
    }

    /// A line through points; without a label it is not in the legend.
    pub(crate) fn line(
        &mut self,
        points: impl IntoIterator<Item = DVec2>,
        stroke: Stroke,
        label: Option<&str>,
    ) {
        let points: Vec<String> = points
            .into_iter()
            .map(|point| {
                let p = self.at(point);
                format!("{:.1},{:.1}", p.x, p.y)
            })
            .collect();
        self.add(&format!(
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" \
             stroke-dasharray=\"{}\" stroke-linejoin=\"round\" stroke-linecap=\"round\"/>",
            points.join(" "),
            stroke.colour,
            stroke.width,
            stroke.dashes
        ));
        if let Some(label) = label {
            self.legend.push((label.into(), Key::Line(stroke)));
        }
    }

    /// A circle of a radius in units of the x axis.
    pub(crate) fn circle(&mut self, centre: DVec2, radius: f64, colour: &str, opacity: f64) {
        let radius = radius * self.size.x / (self.x.high - self.x.low);
        let c = self.at(centre);
        self.add(&format!(
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius:.1}\" fill=\"{colour}\" \
             fill-opacity=\"{opacity:.2}\" stroke=\"{colour}\" stroke-width=\"1\"/>",
            c.x, c.y
        ));
    }

    /// A dot of a radius in pixels.
    pub(crate) fn dot(&mut self, centre: DVec2, radius: f64, colour: &str) {
        let c = self.at(centre);
        self.add(&format!(
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius}\" fill=\"{colour}\" stroke=\"white\" \
             stroke-width=\"1.2\"/>",
            c.x, c.y
        ));
    }

    /// An entry of the legend for discs.
    pub(crate) fn disc_label(&mut self, colour: &'static str, label: &str) {
        self.legend.push((label.into(), Key::Disc(colour)));
    }

    /// A bar from the bottom up to `height`.
    pub(crate) fn bar(&mut self, left: f64, right: f64, height: f64, colour: &str) {
        let (a, b) = (self.at(DVec2::new(left, height)), self.at(DVec2::new(right, height)));
        self.add(&format!(
            "<rect x=\"{:.2}\" y=\"{:.1}\" width=\"{:.2}\" height=\"{:.1}\" fill=\"{colour}\" \
             fill-opacity=\"0.55\"/>",
            a.x,
            a.y,
            (b.x - a.x).max(0.5),
            self.size.y - a.y
        ));
    }

    /// A few words at a point, `offset` pixels to the right and down, on a white rim.
    pub(crate) fn words(&mut self, point: DVec2, offset: DVec2, colour: &str, words: &str) {
        let p = self.at(point) + offset;
        self.add(&format!(
            "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{colour}\" font-size=\"11\" stroke=\"white\" \
             stroke-width=\"3\" paint-order=\"stroke\">{}</text>",
            p.x,
            p.y,
            escape(words)
        ));
    }

    fn add(&mut self, element: &str) {
        self.body.push_str(element);
        self.body.push('\n');
    }

    /// The SVG element.
    pub(crate) fn svg(&self) -> String {
        let (legend, rows) = self.legend_svg();
        let top = TITLE + LEGEND_ROW * rows as f64 + 6.0;
        let (width, height) = (self.size.x + LEFT + RIGHT, self.size.y + top + BOTTOM);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" \
             width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\" aria-label=\"{title}\" \
             font-family=\"'Helvetica Neue', Helvetica, Arial, sans-serif\" font-size=\"12\" \
             fill=\"{INK}\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
             <text x=\"{LEFT}\" y=\"20\" font-size=\"15\" font-weight=\"600\">{title}</text>\n\
             {legend}<g transform=\"translate({LEFT},{top})\">\n",
            title = escape(&self.title),
        );
        self.axes_svg(&mut svg);
        svg.push_str(&self.body);
        svg.push_str("</g>\n</svg>\n");
        svg
    }

    fn axes_svg(&self, svg: &mut String) {
        let DVec2 { x: w, y: h } = self.size;
        let mut add = |element: String| {
            svg.push_str(&element);
            svg.push('\n');
        };
        let (x_ticks, y_ticks) = (self.x.ticks(), self.y.ticks());
        for &tick in &x_ticks {
            let x = w * self.x.fraction(tick);
            add(format!(
                "<line x1=\"{x:.1}\" y1=\"0\" x2=\"{x:.1}\" y2=\"{h:.1}\" stroke=\"{FAINT}\"/>\
                 <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                h + 17.0,
                number(tick)
            ));
        }
        for &tick in &y_ticks {
            let y = h * (1.0 - self.y.fraction(tick));
            add(format!(
                "<line x1=\"0\" y1=\"{y:.1}\" x2=\"{w:.1}\" y2=\"{y:.1}\" stroke=\"{FAINT}\"/>\
                 <text x=\"-8\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                y + 4.0,
                number(tick)
            ));
        }
        add(format!(
            "<rect width=\"{w:.1}\" height=\"{h:.1}\" fill=\"none\" stroke=\"{GREY}\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
             <text transform=\"translate(-48,{:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            0.5 * w,
            h + 38.0,
            escape(&self.x.label),
            0.5 * h,
            escape(&self.y.label)
        ));
    }

    /// The legend, and how many rows it takes.
    fn legend_svg(&self) -> (String, usize) {
        let (mut svg, mut x, mut row) = (String::new(), 0.0, 0);
        for (label, key) in &self.legend {
            let width = 44.0 + LETTER * label.chars().count() as f64;
            if x > 0.0 && x + width > self.size.x + RIGHT {
                (x, row) = (0.0, row + 1);
            }
            let (left, y) = (LEFT + x, TITLE + LEGEND_ROW * row as f64 + 5.0);
            let mark = match key {
                Key::Line(s) => format!(
                    "<line x1=\"{left:.1}\" y1=\"{y:.1}\" x2=\"{:.1}\" y2=\"{y:.1}\" \
                     stroke=\"{}\" stroke-width=\"{}\" stroke-dasharray=\"{}\"/>",
                    left + 22.0,
                    s.colour,
                    s.width.max(1.5),
                    s.dashes
                ),
                Key::Disc(colour) => format!(
                    "<circle cx=\"{:.1}\" cy=\"{y:.1}\" r=\"6\" fill=\"{colour}\" \
                     fill-opacity=\"0.3\" stroke=\"{colour}\"/>",
                    left + 11.0
                ),
            };
            writeln!(
                svg,
                "{mark}<text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                left + 28.0,
                y + 4.0,
                escape(label)
            )
            .expect("a string grows");
            x += width;
        }
        (svg, if self.legend.is_empty() { 0 } else { row + 1 })
    }
}

/// A tick's number, without noise behind the last digit.
fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        return format!("{value:.0e}");
    }
    let text = format!("{value:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.replace('-', "−") }
}

/// Text for XML and HTML.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::linear("t [s]", -0.13, 6.2);
        assert_eq!(axis.ticks(), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let axis = Axis::logarithmic("error [mm]", 0.07, 2400.0);
        assert_eq!(axis.ticks().len(), 7);
        assert!((axis.fraction(10.0) - 0.5).abs() < 1e-12);
        assert_eq!(number(-0.0), "0");
        assert_eq!(number(-0.25), "−0.25");
        assert_eq!(number(1e6), "1e6");
    }

    #[test]
    fn a_map_has_equal_scales() {
        let points = [DVec2::new(-1.0, 0.0), DVec2::new(3.0, 1.0)];
        let plot = Plot::map("m", ["x [m]", "y [m]"], &points, 600.0);
        let unit = plot.at(DVec2::ONE) - plot.at(DVec2::ZERO);
        assert!((unit.x + unit.y).abs() < 1e-9, "{unit}");
        assert!(plot.svg().contains("y [m]"));
    }
}
