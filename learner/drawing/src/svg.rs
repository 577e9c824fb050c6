//! Pictures as SVG text: panels with axes in a grid, a legend above them, a colour bar beside them.
//!
//! Text is left to the viewer's fonts, coordinates are fractions of a pixel.

use std::fmt::Write as _;

use glam::{DMat2, DVec2};

use crate::colour::Scale;

/// Colour of text and axes.
pub const INK: &str = "#22303c";
const FAINT: &str = "#e3e8ec";
const AXIS: &str = "#8a97a2";
/// Room around the axes of a panel [px].
const LEFT: f64 = 76.0;
const RIGHT: f64 = 22.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 52.0;
/// Room around a figure, and its rows of text [px].
const MARGIN: f64 = 14.0;
const TITLE: f64 = 34.0;
const LEGEND_ROW: f64 = 24.0;
/// Room for a colour bar, its width and its largest height [px].
const BAR_ROOM: f64 = 128.0;
const BAR_WIDTH: f64 = 18.0;
const BAR_HEIGHT_MAX: f64 = 420.0;
/// Mean width of a letter of 13 px, on the safe side [px].
const LETTER: f64 = 6.2;
/// Points of a line that are nearer to each other are left out [px].
const POINT_STEP: f64 = 1.2;

/// How a line is drawn.
#[derive(Debug, Clone, Copy)]
pub struct Stroke {
    /// Colour.
    pub colour: &'static str,
    /// Width [px].
    pub width: f64,
    /// SVG dash array; empty for a solid line.
    pub dashes: &'static str,
    /// A white rim sets it off from what is below.
    pub rim: bool,
}

/// A sign of the legend.
#[derive(Debug, Clone, Copy)]
pub enum Sign {
    /// A line.
    Line(Stroke),
    /// An outline, filled faintly.
    Ellipse(&'static str),
    /// A dot.
    Dot(&'static str),
    /// The goal.
    Star,
    /// A coordinate frame: its axes' colours.
    Frame(&'static [&'static str]),
}

/// One pair of axes.
#[derive(Debug, Clone)]
pub struct Panel {
    title: String,
    labels: [String; 2],
    low: DVec2,
    high: DVec2,
    /// Pixels in a unit.
    scale: DVec2,
    /// Axes with ticks are drawn.
    ticks: bool,
    /// Elements below the grid lines, above them, and outside the axes.
    parts: [String; 3],
}

impl Panel {
    /// Axes of equal scale, `pixels` in a unit.
    pub fn map(title: &str, labels: [&str; 2], [low, high]: [DVec2; 2], pixels: f64) -> Self {
        let scale = DVec2::splat(pixels);
        let labels = labels.map(Into::into);
        Self { title: title.into(), labels, low, high, scale, ticks: true, parts: <_>::default() }
    }

    /// Axes of a size in pixels, each with its own scale.
    pub fn graph(title: &str, labels: [&str; 2], [low, high]: [DVec2; 2], size: DVec2) -> Self {
        Self { scale: size / (high - low), ..Self::map(title, labels, [low, high], 1.0) }
    }

    /// Leaves ticks, grid and labels away.
    pub fn without_ticks(mut self) -> Self {
        self.ticks = false;
        self
    }

    /// Size of the axes [px].
    pub fn size(&self) -> DVec2 {
        (self.high - self.low) * self.scale
    }

    /// Lower left and upper right end of the axes.
    pub fn range(&self) -> [DVec2; 2] {
        [self.low, self.high]
    }

    /// Pixels in a unit.
    pub fn scale(&self) -> DVec2 {
        self.scale
    }

    /// Where a point lies, from the upper left corner of the axes [px].
    pub fn at(&self, point: DVec2) -> DVec2 {
        let p = (point - self.low) * self.scale;
        DVec2::new(p.x, self.size().y - p.y)
    }

    /// An area inside closed rings by the even-odd rule, below everything else.
    pub fn area<'a>(
        &mut self,
        rings: impl IntoIterator<Item = &'a [DVec2]>,
        fill: &str,
        edge: &str,
    ) {
        let mut path = String::new();
        for ring in rings {
            let points = self.thinned(ring.iter().copied());
            if points.len() > 2 {
                write!(path, "M{}Z", joined(&points)).expect("a string grows");
            }
        }
        if !path.is_empty() {
            writeln!(
                self.parts[0],
                "<path d=\"{path}\" fill=\"{fill}\" fill-rule=\"evenodd\" stroke=\"{edge}\" \
                 stroke-width=\"0.6\"/>"
            )
            .expect("a string grows");
        }
    }

    /// A line through points.
    pub fn line(&mut self, points: impl IntoIterator<Item = DVec2>, stroke: &Stroke) {
        let points = joined(&self.thinned(points));
        let mut draw = |colour: &str, width: f64, dashes: &str, opacity: f64| {
            writeln!(
                self.parts[1],
                "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" \
                 stroke-width=\"{width}\"{} stroke-linejoin=\"round\"{}/>",
                attribute("stroke-dasharray", dashes),
                if opacity < 1.0 {
                    format!(" stroke-opacity=\"{opacity}\"")
                } else {
                    String::new()
                },
            )
            .expect("a string grows");
        };
        if stroke.rim {
            draw("white", stroke.width + 2.2, "", 0.75);
        }
        draw(stroke.colour, stroke.width, stroke.dashes, 1.0);
    }

    /// A closed band, filled faintly.
    pub fn band(&mut self, points: impl IntoIterator<Item = DVec2>, colour: &str) {
        let points = joined(&self.thinned(points));
        self.add(format!("<polygon points=\"{points}\" fill=\"{colour}\" fill-opacity=\"0.2\"/>"));
    }

    /// The ellipse {c + v : vᵀ C⁻¹ v ≤ n²} of a covariance C, `fill` from 0 to 1.
    pub fn ellipse(
        &mut self,
        centre: DVec2,
        covariance: DMat2,
        deviations: f64,
        colour: &str,
        fill: f64,
    ) {
        let (axes, angle) = principal_axes(covariance);
        let (c, r) = (self.at(centre), axes * deviations * self.scale.x);
        self.add(format!(
            "<ellipse rx=\"{:.2}\" ry=\"{:.2}\" transform=\"translate({:.2} {:.2}) \
             rotate({:.2})\" fill=\"{colour}\" fill-opacity=\"{fill}\" stroke=\"{colour}\" \
             stroke-width=\"1.2\"/>",
            r.x,
            r.y,
            c.x,
            c.y,
            -angle.to_degrees()
        ));
    }

    /// A dot of a radius in pixels.
    pub fn dot(&mut self, centre: DVec2, radius: f64, colour: &str) {
        let c = self.at(centre);
        self.add(dot(c, radius, colour));
    }

    /// The sign of the goal.
    pub fn star(&mut self, centre: DVec2) {
        let c = self.at(centre);
        self.add(star(c));
    }

    /// An arrow around a point, `vector` in pixels to the right and up.
    pub fn arrow(&mut self, centre: DVec2, vector: DVec2, colour: &str) {
        let half = DVec2::new(vector.x, -vector.y) * 0.5;
        let c = self.at(centre);
        let (tail, tip, side) = (c - half, c + half, half.perp() * 0.42);
        let [left, right] = [tip - half * 0.75 + side, tip - half * 0.75 - side];
        self.add(format!(
            "<path d=\"M{}M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>",
            joined(&[tail, tip]),
            joined(&[left, tip, right])
        ));
    }

    /// Words, moved `offset` pixels to the right and down, on a white rim; they may lie outside the
    /// axes. `anchor`: `start`, `middle` or `end`.
    pub fn words(&mut self, point: DVec2, offset: DVec2, anchor: &str, words: &str) {
        self.label(self.at(point) + offset, anchor, words);
    }

    /// Words at a point in pixels from the upper left corner of the axes.
    pub fn label(&mut self, p: DVec2, anchor: &str, words: &str) {
        writeln!(
            self.parts[2],
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\" stroke=\"white\" \
             stroke-width=\"3\" stroke-linejoin=\"round\" paint-order=\"stroke\">{}</text>",
            p.x,
            p.y,
            escape(words)
        )
        .expect("a string grows");
    }

    fn add(&mut self, element: impl AsRef<str>) {
        self.parts[1].push_str(element.as_ref());
        self.parts[1].push('\n');
    }

    /// The points in pixels, without those that nobody could tell apart.
    fn thinned(&self, points: impl IntoIterator<Item = DVec2>) -> Vec<DVec2> {
        let mut kept: Vec<DVec2> = Vec::new();
        let mut skipped = None;
        for point in points {
            let p = self.at(point);
            skipped = match kept.last() {
                Some(last) if (p - *last).length() < POINT_STEP => Some(p),
                _ => {
                    kept.push(p);
                    None
                }
            };
        }
        kept.extend(skipped);
        kept
    }

    /// With the room for title, ticks and labels [px].
    fn outer(&self) -> DVec2 {
        self.size() + DVec2::new(LEFT + RIGHT, TOP + BOTTOM)
    }

    fn svg(&self, at: DVec2) -> String {
        let DVec2 { x: w, y: h } = self.size();
        let mut svg = format!("<g transform=\"translate({:.1} {:.1})\">\n", at.x, at.y);
        let mut add = |element: String| {
            svg.push_str(&element);
            svg.push('\n');
        };
        // A nested picture clips what it holds.
        let clipped = |part: &str| {
            format!(
                "<svg width=\"{w:.1}\" height=\"{h:.1}\" viewBox=\"0 0 {w:.1} {h:.1}\" \
                 overflow=\"hidden\">\n{part}</svg>"
            )
        };
        let filled = !self.parts[0].is_empty();
        if filled {
            add(clipped(&self.parts[0]));
        }
        if self.ticks {
            for tick in ticks_that_fit(self.low.x, self.high.x, w) {
                let x = self.at(DVec2::new(tick, self.low.y)).x;
                add(format!(
                    "{}<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                    tick_line(DVec2::new(x, 0.0), DVec2::new(x, h), DVec2::Y * 5.0, filled),
                    h + 19.0,
                    number(tick)
                ));
            }
            for tick in ticks_of_length(self.low.y, self.high.y, h) {
                let y = self.at(DVec2::new(self.low.x, tick)).y;
                add(format!(
                    "{}<text x=\"-9\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                    tick_line(DVec2::new(w, y), DVec2::new(0.0, y), DVec2::X * -5.0, filled),
                    y + 4.5,
                    number(tick)
                ));
            }
            add(format!(
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
                 <text transform=\"translate(-58 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
                0.5 * w,
                h + 41.0,
                escape(&self.labels[0]),
                0.5 * h,
                escape(&self.labels[1])
            ));
        }
        add(clipped(&self.parts[1]));
        if self.ticks {
            add(format!(
                "<rect width=\"{w:.1}\" height=\"{h:.1}\" fill=\"none\" stroke=\"{AXIS}\"/>"
            ));
        }
        svg.push_str(&self.parts[2]);
        writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"-10\" text-anchor=\"middle\">{}</text>\n</g>",
            0.5 * w,
            escape(&self.title)
        )
        .expect("a string grows");
        svg
    }
}

/// A grid line and the tick at its end; over a filled area only the tick.
fn tick_line(from: DVec2, to: DVec2, tick: DVec2, filled: bool) -> String {
    let line = |a: DVec2, b: DVec2, colour: &str| {
        format!(
            "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"{colour}\"/>",
            a.x, a.y, b.x, b.y
        )
    };
    let grid = if filled { String::new() } else { line(from, to, FAINT) };
    grid + &line(to, to + tick, AXIS)
}

/// Panels in rows, with what they fraction.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Title.
    pub title: String,
    /// What the signs mean.
    pub legend: Vec<(String, Sign)>,
    /// Panels, row by row.
    pub rows: Vec<Vec<Panel>>,
    /// What the colours mean.
    pub bar: Option<Scale>,
}

impl Figure {
    /// The SVG document.
    pub fn svg(&self) -> String {
        let column = |i: usize| {
            let widths = self.rows.iter().filter_map(|row| row.get(i)).map(|panel| panel.outer().x);
            widths.fold(0.0, f64::max)
        };
        let height = |row: &Vec<Panel>| row.iter().map(|panel| panel.outer().y).fold(0.0, f64::max);
        let columns: Vec<f64> =
            (0..self.rows.iter().map(Vec::len).max().unwrap_or(0)).map(column).collect();
        let panels = DVec2::new(columns.iter().sum(), self.rows.iter().map(height).sum());
        let bar = if self.bar.is_some() { BAR_ROOM } else { 0.0 };
        let title = LETTER * 1.5 * self.title.chars().count() as f64;
        let width = (panels.x + bar).max(title) + 2.0 * MARGIN;
        let (legend, legend_rows) = self.legend_svg(width - 2.0 * MARGIN);
        let top = MARGIN + TITLE + LEGEND_ROW * legend_rows as f64;
        let height_all = top + panels.y + MARGIN;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height_all:.0}\" \
             width=\"{width:.0}\" height=\"{height_all:.0}\" role=\"img\" aria-label=\"{title}\" \
             font-family=\"'Helvetica Neue', Helvetica, Arial, 'Liberation Sans', sans-serif\" \
             font-size=\"13\" fill=\"{INK}\">\n<rect width=\"100%\" height=\"100%\" \
             fill=\"white\"/>\n<text x=\"{MARGIN}\" y=\"{:.1}\" font-size=\"16\" \
             font-weight=\"600\">{title}</text>\n{legend}",
            MARGIN + 16.0,
            title = escape(&self.title),
        );
        let mut y = top;
        for row in &self.rows {
            let mut x = MARGIN;
            for (panel, width) in row.iter().zip(&columns) {
                // In the middle of its column, at the bottom of its row.
                let room = DVec2::new(*width, height(row)) - panel.outer();
                let at = DVec2::new(x + LEFT + 0.5 * room.x, y + TOP + room.y);
                svg.push_str(&panel.svg(at));
                x += width;
            }
            y += height(row);
        }
        if let Some(scale) = &self.bar {
            let height = (panels.y - TOP - BOTTOM).min(BAR_HEIGHT_MAX);
            svg.push_str(&bar_svg(scale, DVec2::new(MARGIN + panels.x + 26.0, top + TOP), height));
        }
        svg.push_str("</svg>\n");
        svg
    }

    /// The legend within a width [px], and how many rows it takes.
    fn legend_svg(&self, width_max: f64) -> (String, usize) {
        let (mut svg, mut x, mut row) = (String::new(), 0.0, 0);
        for (label, sign) in &self.legend {
            let width = 54.0 + LETTER * label.chars().count() as f64;
            if x > 0.0 && x + width - 16.0 > width_max {
                (x, row) = (0.0, row + 1);
            }
            let at = DVec2::new(MARGIN + x, MARGIN + TITLE + LEGEND_ROW * row as f64 + 4.0);
            writeln!(
                svg,
                "{}<text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                sign_svg(*sign, at),
                at.x + 36.0,
                at.y + 4.5,
                escape(label)
            )
            .expect("a string grows");
            x += width;
        }
        (svg, if self.legend.is_empty() { 0 } else { row + 1 })
    }
}

/// A sign, 28 px wide, the middle of its left edge at a point [px].
fn sign_svg(sign: Sign, at: DVec2) -> String {
    let middle = at + DVec2::X * 14.0;
    let line = |from: DVec2, to: DVec2, colour: &str, width: f64, dashes: &str| {
        format!(
            "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"{colour}\" \
             stroke-width=\"{width}\"{}/>",
            from.x,
            from.y,
            to.x,
            to.y,
            attribute("stroke-dasharray", dashes)
        )
    };
    match sign {
        Sign::Line(s) => line(at, at + DVec2::X * 28.0, s.colour, s.width, s.dashes),
        Sign::Ellipse(colour) => format!(
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"7\" fill=\"{colour}\" fill-opacity=\"0.15\" \
             stroke=\"{colour}\" stroke-width=\"1.2\"/>",
            middle.x, middle.y
        ),
        Sign::Dot(colour) => dot(middle, 3.0, colour),
        Sign::Star => star(middle),
        Sign::Frame(colours) => {
            let origin = at + DVec2::new(7.0, 5.0);
            let ends = [DVec2::new(15.0, 0.0), DVec2::new(0.0, -13.0), DVec2::new(-8.0, 5.0)];
            let axes = colours.iter().zip(ends);
            axes.map(|(colour, end)| line(origin, origin + end, colour, 2.2, "")).collect()
        }
    }
}

fn dot(c: DVec2, radius: f64, colour: &str) -> String {
    format!(
        "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius}\" fill=\"{colour}\" stroke=\"white\" \
         stroke-width=\"0.8\"/>",
        c.x, c.y
    )
}

fn star(c: DVec2) -> String {
    let corner = |i: u32| {
        let angle = std::f64::consts::PI * (0.2 * f64::from(i) - 0.5);
        c + DVec2::from_angle(angle) * if i.is_multiple_of(2) { 10.0 } else { 4.2 }
    };
    let corners: Vec<_> = (0..10).map(corner).collect();
    format!(
        "<polygon class=\"goal\" points=\"{}\" fill=\"#ffd23f\" stroke=\"{INK}\" \
         stroke-width=\"1.2\" stroke-linejoin=\"round\"/>",
        joined(&corners)
    )
}

/// The bar of a scale from an upper left corner, with numbers at its steps.
fn bar_svg(scale: &Scale, at: DVec2, height: f64) -> String {
    let bands = scale.bands();
    let step = height / bands as f64;
    let mut svg = format!("<g transform=\"translate({:.1} {:.1})\">\n", at.x, at.y);
    for band in 0..bands {
        writeln!(
            svg,
            "<rect y=\"{:.2}\" width=\"{BAR_WIDTH}\" height=\"{:.2}\" fill=\"{}\"/>",
            height - (band + 1) as f64 * step,
            step + 0.3,
            scale.colour(band)
        )
        .expect("a string grows");
    }
    // Numbers at least 22 px apart.
    let stride = (22.0 / step).ceil() as usize;
    for (i, level) in scale.levels().iter().enumerate().step_by(stride) {
        let y = height - i as f64 * step;
        writeln!(
            svg,
            "<line x1=\"{BAR_WIDTH}\" y1=\"{y:.1}\" x2=\"{:.1}\" y2=\"{y:.1}\" stroke=\"{AXIS}\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            BAR_WIDTH + 4.0,
            BAR_WIDTH + 8.0,
            y + 4.5,
            number(*level)
        )
        .expect("a string grows");
    }
    writeln!(
        svg,
        "<rect width=\"{BAR_WIDTH}\" height=\"{height:.1}\" fill=\"none\" stroke=\"{AXIS}\"/>\
         <text x=\"-4\" y=\"-14\">{}</text>\n</g>",
        escape(scale.label())
    )
    .expect("a string grows");
    svg
}

/// Standard deviations along the principal axes, and the angle of the first axis [rad].
pub fn principal_axes(covariance: DMat2) -> (DVec2, f64) {
    let (a, b, c) = (covariance.x_axis.x, covariance.x_axis.y, covariance.y_axis.y);
    let (mean, radius) = (0.5 * (a + c), (0.5 * (a - c)).hypot(b));
    let variances = DVec2::new(mean + radius, (mean - radius).max(0.0));
    (DVec2::new(variances.x.sqrt(), variances.y.sqrt()), 0.5 * (2.0 * b).atan2(a - c))
}

/// As many ticks as have room for their numbers side by side on an axis of a length [px].
fn ticks_that_fit(low: f64, high: f64, length: f64) -> Vec<f64> {
    let fits = |ticks: &Vec<f64>| {
        let widest = ticks.iter().map(|tick| number(*tick).chars().count()).max().unwrap_or(0);
        let apart = ticks.get(1).map_or(length, |next| (next - ticks[0]) / (high - low) * length);
        apart >= LETTER * widest as f64 + 14.0
    };
    let mut fewer = (2..=9).rev().map(|count| ticks(low, high, f64::from(count)));
    fewer.find(fits).unwrap_or_default()
}

/// Ticks of an axis of a length [px] whose numbers stand above each other: two at least, where there
/// is room.
pub fn ticks_of_length(low: f64, high: f64, length: f64) -> Vec<f64> {
    let denser = [38.0, 28.0, 18.0].map(|apart| ticks(low, high, length / apart));
    let [sparse, ..] = &denser;
    denser.iter().find(|ticks| ticks.len() > 1).unwrap_or(sparse).clone()
}

/// Round numbers between two ends, at most about `count` of them.
fn ticks(low: f64, high: f64, count: f64) -> Vec<f64> {
    let step = nice_step((high - low) / count.clamp(2.0, 9.0));
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

/// The next larger of 1, 2 and 5 times a power of ten.
pub fn nice_step(least: f64) -> f64 {
    let power = 10_f64.powf(least.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= least * 0.999);
    factor.unwrap_or(10.0) * power
}

/// A number of an axis, without noise behind the last digit.
pub fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-4..1e6).contains(&size) {
        return format!("{value:.0e}").replace('-', "−");
    }
    // Four digits, all of those before the point.
    let digits = if size == 0.0 { 0 } else { (3 - size.log10().floor() as i32).max(0) as usize };
    let text = format!("{value:.digits$}");
    let text =
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".into() } else { text.replace('-', "−") }
}

/// Text for XML and HTML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn attribute(name: &str, value: &str) -> String {
    if value.is_empty() { String::new() } else { format!(" {name}=\"{value}\"") }
}

fn joined(points: &[DVec2]) -> String {
    let mut text = String::with_capacity(points.len() * 12);
    for (i, p) in points.iter().enumerate() {
        let space = if i == 0 { "" } else { " " };
        write!(text, "{space}{:.1},{:.1}", p.x, p.y).expect("a string grows");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(-0.13, 6.2, 7.0), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(number(-0.0), "0");
        assert_eq!(number(-0.25), "−0.25");
        assert_eq!(number(0.30000000000000004), "0.3");
        assert_eq!(number(1200.0), "1200");
        assert_eq!(number(-43000.0), "−43000");
    }

    #[test]
    fn a_map_has_equal_scales_and_y_points_up() {
        let panel = Panel::map("", ["", ""], [DVec2::new(-1.0, 0.0), DVec2::new(3.0, 1.0)], 50.0);
        let unit = panel.at(DVec2::ONE) - panel.at(DVec2::ZERO);
        assert_eq!(unit, DVec2::new(50.0, -50.0));
        assert_eq!(panel.at(DVec2::new(-1.0, 1.0)), DVec2::ZERO);
    }

    #[test]
    fn principal_axes_are_those_of_the_covariance() {
        let turn = DMat2::from_angle(0.7);
        let covariance = turn * DMat2::from_diagonal(DVec2::new(9.0, 4.0)) * turn.transpose();
        let (axes, angle) = principal_axes(covariance);
        assert!((axes - DVec2::new(3.0, 2.0)).length() < 1e-12);
        assert!((angle - 0.7).abs() < 1e-12);
    }
}
