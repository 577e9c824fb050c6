//! One pair of axes and what is drawn on them.

use glam::{BVec2, DMat2, DVec2};

use crate::colour::{GREY, INK};
use crate::projection::principal_axes;
use crate::text::{escape, number};
use crate::ticks;

const GRID: &str = "#e3e8ec";
/// Room around the axes \[px\].
pub(crate) const LEFT: f64 = 76.0;
const RIGHT: f64 = 22.0;
const TITLE: f64 = 30.0;
const NO_TITLE: f64 = 16.0;
pub(crate) const BOTTOM: f64 = 52.0;
/// Points of a line that are nearer to each other are left out \[px\].
const POINT_STEP_PX: f64 = 1.2;

/// How a line is drawn.
#[derive(Debug, Clone, Copy)]
pub struct Stroke {
    /// Colour.
    pub colour: &'static str,
    /// Width \[px\].
    pub width: f64,
    /// SVG dash array; empty for a solid line.
    pub dashes: &'static str,
    /// A white rim sets it off from what is below.
    pub rim: bool,
}

impl Stroke {
    /// A solid line of a width \[px\].
    pub const fn solid(colour: &'static str, width: f64) -> Self {
        Self { colour, width, dashes: "", rim: false }
    }

    /// A dashed line of a width \[px\].
    pub const fn dashed(colour: &'static str, width: f64) -> Self {
        Self { dashes: "5 4", ..Self::solid(colour, width) }
    }

    /// The same with a white rim.
    pub const fn rimmed(self) -> Self {
        Self { rim: true, ..self }
    }
}

/// Which part of a text stands at its point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// Its beginning.
    Start,
    /// Its middle.
    Middle,
    /// Its end.
    End,
}

/// One pair of axes. What is drawn later covers what was drawn before; areas lie below all else.
#[derive(Debug, Clone)]
pub struct Panel {
    title: String,
    labels: [String; 2],
    /// Ends of the axes; their decimal logarithms on a logarithmic axis.
    low: DVec2,
    high: DVec2,
    /// Pixels in a unit, or in a decade.
    scale: DVec2,
    logarithmic: BVec2,
    /// Axes with ticks are drawn.
    ticks: bool,
    /// Elements below the grid lines.
    areas: String,
    /// Elements above them.
    lines: String,
    /// Elements above all, also outside the axes.
    words: String,
}

impl Panel {
    /// Axes of equal scale, `pixels` in a unit.
    pub fn map(title: &str, labels: [&str; 2], [low, high]: [DVec2; 2], pixels: f64) -> Self {
        Self {
            title: title.into(),
            labels: labels.map(Into::into),
            low,
            high,
            scale: DVec2::splat(pixels),
            logarithmic: BVec2::FALSE,
            ticks: true,
            areas: String::new(),
            lines: String::new(),
            words: String::new(),
        }
    }

    /// Axes of a size \[px\], each with its own scale.
    pub fn graph(title: &str, labels: [&str; 2], [low, high]: [DVec2; 2], size: DVec2) -> Self {
        Self { scale: size / (high - low), ..Self::map(title, labels, [low, high], 1.0) }
    }

    /// Makes the chosen axes logarithmic. Their ends must be positive; what is smaller than the low one is
    /// drawn there.
    pub fn logarithmic(mut self, x: bool, y: bool) -> Self {
        let (size, chosen) = (self.size(), BVec2::new(x, y));
        let logarithm = |end: DVec2| DVec2::select(chosen, end.map(f64::log10), end);
        (self.low, self.high) = (logarithm(self.low), logarithm(self.high));
        Self { scale: size / (self.high - self.low), logarithmic: chosen, ..self }
    }

    /// Leaves ticks, grid and labels away.
    pub fn without_ticks(mut self) -> Self {
        self.ticks = false;
        self
    }

    /// Size of the axes \[px\].
    pub fn size(&self) -> DVec2 {
        (self.high - self.low) * self.scale
    }

    /// Lower left and upper right end of the axes; decimal logarithms where an axis is logarithmic.
    pub fn range(&self) -> [DVec2; 2] {
        [self.low, self.high]
    }

    /// Pixels in a unit.
    pub fn scale(&self) -> DVec2 {
        self.scale
    }

    /// Where a point lies, from the upper left corner of the axes \[px\].
    pub fn at(&self, point: DVec2) -> DVec2 {
        let lowest = self.low.map(|end| 10_f64.powf(end));
        let decades = point.max(lowest).map(f64::log10);
        let p = (DVec2::select(self.logarithmic, decades, point) - self.low) * self.scale;
        DVec2::new(p.x, self.size().y - p.y)
    }

    /// An area inside closed rings by the even-odd rule, below everything else.
    pub fn area<'a>(
        &mut self,
        rings: impl IntoIterator<Item = &'a [DVec2]>,
        fill: &str,
        edge: &str,
    ) {
        let rings = rings.into_iter().map(|ring| self.thinned(ring.iter().copied()));
        let rings = rings.filter(|points| points.len() > 2);
        let path: String = rings.map(|points| format!("M{}Z", joined(&points))).collect();
        if !path.is_empty() {
            self.areas += &format!(
                "<path d=\"{path}\" fill=\"{fill}\" fill-rule=\"evenodd\" stroke=\"{edge}\" \
                 stroke-width=\"0.6\"/>\n"
            );
        }
    }

    /// A line through points.
    pub fn line(&mut self, points: impl IntoIterator<Item = DVec2>, stroke: &Stroke) {
        let points = joined(&self.thinned(points));
        let mut draw = |colour: &str, width: f64, more: &str| {
            self.lines += &format!(
                "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" \
                 stroke-width=\"{width}\" stroke-linejoin=\"round\"{more}/>\n"
            );
        };
        if stroke.rim {
            draw("white", stroke.width + 2.2, " stroke-opacity=\"0.75\"");
        }
        draw(stroke.colour, stroke.width, &dash_array(stroke.dashes));
    }

    /// A closed band, filled faintly.
    pub fn band(&mut self, points: impl IntoIterator<Item = DVec2>, colour: &str) {
        let points = joined(&self.thinned(points));
        self.lines +=
            &format!("<polygon points=\"{points}\" fill=\"{colour}\" fill-opacity=\"0.2\"/>\n");
    }

    /// Bars, each from its lower left to its upper right corner; `fill` from 0 to 1.
    pub fn bars(&mut self, bars: impl IntoIterator<Item = [DVec2; 2]>, colour: &str, fill: f64) {
        let bar = |corners: [DVec2; 2]| {
            let [low, high] = corners.map(|corner| self.at(corner));
            format!("M{:.1} {:.1}V{:.1}H{:.1}V{:.1}Z", low.x, low.y, high.y, high.x, low.y)
        };
        let path: String = bars.into_iter().map(bar).collect();
        self.lines += &format!(
            "<path d=\"{path}\" fill=\"{colour}\" fill-opacity=\"{fill}\" stroke=\"{colour}\"/>\n"
        );
    }

    /// The ellipse {c + v : vᵀ C⁻¹ v ≤ n²} of a covariance C on axes of equal scale, `fill` from 0 to 1.
    pub fn ellipse(
        &mut self,
        centre: DVec2,
        covariance: DMat2,
        deviations: f64,
        colour: &str,
        fill: f64,
    ) {
        let (axes, angle) = principal_axes(covariance);
        let DVec2 { x, y } = self.at(centre);
        let DVec2 { x: rx, y: ry } = axes * deviations * self.scale.x;
        let degrees = -angle.to_degrees();
        self.lines += &format!(
            "<ellipse rx=\"{rx:.2}\" ry=\"{ry:.2}\" transform=\"translate({x:.2} {y:.2}) \
             rotate({degrees:.2})\" fill=\"{colour}\" fill-opacity=\"{fill}\" stroke=\"{colour}\" \
             stroke-width=\"1.2\"/>\n"
        );
    }

    /// A circle of a radius in units of axes of equal scale, `fill` from 0 to 1.
    pub fn circle(&mut self, centre: DVec2, radius: f64, colour: &str, fill: f64) {
        let covariance = DMat2::from_diagonal(DVec2::splat(radius * radius));
        self.ellipse(centre, covariance, 1.0, colour, fill);
    }

    /// A dot of a radius \[px\].
    pub fn dot(&mut self, centre: DVec2, radius: f64, colour: &str) {
        self.lines += &dot(self.at(centre), radius, colour);
    }

    /// The sign of the goal.
    pub fn star(&mut self, centre: DVec2) {
        self.lines += &star(self.at(centre));
    }

    /// An arrow around a point, `vector` to the right and up \[px\].
    pub fn arrow(&mut self, centre: DVec2, vector: DVec2, colour: &str) {
        let half = DVec2::new(vector.x, -vector.y) * 0.5;
        let c = self.at(centre);
        let (tail, tip, side) = (c - half, c + half, half.perp() * 0.42);
        let [left, right] = [tip - half * 0.75 + side, tip - half * 0.75 - side];
        let (shaft, head) = (joined(&[tail, tip]), joined(&[left, tip, right]));
        self.lines += &format!(
            "<path d=\"M{shaft}M{head}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>\n"
        );
    }

    /// Words at a point, moved `offset` to the right and down \[px\], on a white rim; they may lie outside
    /// the axes.
    pub fn words(&mut self, point: DVec2, offset: DVec2, anchor: Anchor, words: &str) {
        self.label(self.at(point) + offset, anchor, INK, words);
    }

    /// Words in a colour, at a place from the upper left corner of the axes \[px\].
    pub fn label(&mut self, p: DVec2, anchor: Anchor, colour: &str, words: &str) {
        let (DVec2 { x, y }, anchor, words) = (p, anchor.attribute(), escape(words));
        self.words += &format!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\"{anchor} fill=\"{colour}\" stroke=\"white\" \
             stroke-width=\"3\" stroke-linejoin=\"round\" paint-order=\"stroke\">{words}</text>\n"
        );
    }

    /// The points in pixels, without those that nobody could tell apart.
    fn thinned(&self, points: impl IntoIterator<Item = DVec2>) -> Vec<DVec2> {
        let mut kept: Vec<DVec2> = Vec::new();
        let mut skipped = None;
        for point in points {
            let p = self.at(point);
            skipped = match kept.last() {
                Some(last) if (p - *last).length() < POINT_STEP_PX => Some(p),
                _ => {
                    kept.push(p);
                    None
                }
            };
        }
        kept.extend(skipped);
        kept
    }

    /// Room above the axes \[px\].
    pub(crate) fn top(&self) -> f64 {
        if self.title.is_empty() { NO_TITLE } else { TITLE }
    }

    /// With the room for title, ticks and labels \[px\].
    pub(crate) fn outer(&self) -> DVec2 {
        self.size() + DVec2::new(LEFT + RIGHT, self.top() + BOTTOM)
    }

    /// The SVG group, the upper left corner of the axes at a point \[px\].
    pub(crate) fn svg(&self, at: DVec2) -> String {
        let DVec2 { x: w, y: h } = self.size();
        // A nested picture clips what it holds.
        let clipped = |elements: &str| {
            let attributes = format!("width=\"{w:.1}\" height=\"{h:.1}\" overflow=\"hidden\"");
            format!("<svg {attributes} viewBox=\"0 0 {w:.1} {h:.1}\">\n{elements}</svg>\n")
        };
        let mut svg = format!("<g transform=\"translate({:.1} {:.1})\">\n", at.x, at.y);
        if !self.areas.is_empty() {
            svg += &clipped(&self.areas);
        }
        if self.ticks {
            svg += &self.ticks_svg();
        }
        svg += &clipped(&self.lines);
        if self.ticks {
            svg += &format!(
                "<rect width=\"{w:.1}\" height=\"{h:.1}\" fill=\"none\" stroke=\"{GREY}\"/>\n"
            );
        }
        svg += &self.words;
        svg += &text(DVec2::new(0.5 * w, -10.0), Anchor::Middle, &self.title);
        svg + "</g>\n"
    }

    /// Grid lines, ticks, their numbers, and the labels.
    fn ticks_svg(&self) -> String {
        let size = self.size();
        let corner = DVec2::select(self.logarithmic, self.low.map(|e| 10_f64.powf(e)), self.low);
        let ticks = |axis: usize, linear: fn(f64, f64, f64) -> Vec<f64>| {
            let (low, high) = (self.low[axis], self.high[axis]);
            if self.logarithmic.test(axis) {
                ticks::logarithmic(low, high)
            } else {
                linear(low, high, size[axis])
            }
        };
        // Over a filled area there are no grid lines.
        let filled = !self.areas.is_empty();
        let mark = |from: DVec2, to: DVec2, tick: DVec2| {
            let grid = if filled { String::new() } else { line(from, to, GRID, 1.0, "") };
            grid + &line(to, to + tick, GREY, 1.0, "")
        };
        let mut svg = String::new();
        for tick in ticks(0, ticks::side_by_side) {
            let foot = self.at(corner.with_x(tick)).with_y(size.y);
            svg += &mark(foot.with_y(0.0), foot, DVec2::Y * 5.0);
            svg += &text(foot + DVec2::Y * 19.0, Anchor::Middle, &number(tick));
        }
        for tick in ticks(1, ticks::above_each_other) {
            let foot = self.at(corner.with_y(tick)).with_x(0.0);
            svg += &mark(foot.with_x(size.x), foot, DVec2::X * -5.0);
            svg += &text(foot + DVec2::new(-9.0, 4.5), Anchor::End, &number(tick));
        }
        svg += &text(DVec2::new(0.5 * size.x, size.y + 41.0), Anchor::Middle, &self.labels[0]);
        svg + &format!(
            "<text transform=\"translate(-58 {:.1}) rotate(-90)\"{}>{}</text>\n",
            0.5 * size.y,
            Anchor::Middle.attribute(),
            escape(&self.labels[1])
        )
    }
}

impl Anchor {
    fn attribute(self) -> &'static str {
        match self {
            Self::Start => "",
            Self::Middle => " text-anchor=\"middle\"",
            Self::End => " text-anchor=\"end\"",
        }
    }
}

/// A text at a point \[px\].
pub(crate) fn text(p: DVec2, anchor: Anchor, words: &str) -> String {
    let (anchor, words) = (anchor.attribute(), escape(words));
    format!("<text x=\"{:.1}\" y=\"{:.1}\"{anchor}>{words}</text>\n", p.x, p.y)
}

pub(crate) fn line(a: DVec2, b: DVec2, colour: &str, width: f64, dashes: &str) -> String {
    let (DVec2 { x: x1, y: y1 }, DVec2 { x: x2, y: y2 }, dashes) = (a, b, dash_array(dashes));
    format!(
        "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"{colour}\" \
         stroke-width=\"{width}\"{dashes}/>\n"
    )
}

pub(crate) fn dot(DVec2 { x, y }: DVec2, radius: f64, colour: &str) -> String {
    format!(
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{colour}\" stroke=\"white\" \
         stroke-width=\"0.8\"/>\n"
    )
}

pub(crate) fn star(c: DVec2) -> String {
    let corner = |i: u32| {
        let angle = std::f64::consts::PI * (0.2 * f64::from(i) - 0.5);
        c + DVec2::from_angle(angle) * if i.is_multiple_of(2) { 10.0 } else { 4.2 }
    };
    let corners = joined(&(0..10).map(corner).collect::<Vec<_>>());
    format!(
        "<polygon class=\"goal\" points=\"{corners}\" fill=\"#ffd23f\" stroke=\"{INK}\" \
         stroke-width=\"1.2\" stroke-linejoin=\"round\"/>\n"
    )
}

fn dash_array(dashes: &str) -> String {
    if dashes.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{dashes}\"") }
}

fn joined(points: &[DVec2]) -> String {
    let points: Vec<String> = points.iter().map(|p| format!("{:.1},{:.1}", p.x, p.y)).collect();
    points.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_has_equal_scales_and_y_points_up() {
        let panel = Panel::map("", ["", ""], [DVec2::new(-1.0, 0.0), DVec2::new(3.0, 1.0)], 50.0);
        let unit = panel.at(DVec2::ONE) - panel.at(DVec2::ZERO);
        assert_eq!(unit, DVec2::new(50.0, -50.0));
        assert_eq!(panel.at(DVec2::new(-1.0, 1.0)), DVec2::ZERO);
    }

    #[test]
    fn a_logarithmic_axis_has_equal_decades_and_holds_what_is_too_small() {
        let range = [DVec2::new(0.0, 0.1), DVec2::new(1.0, 1000.0)];
        let panel = Panel::graph("", ["", ""], range, DVec2::new(100.0, 80.0));
        let panel = panel.logarithmic(false, true);
        assert_eq!(panel.size(), DVec2::new(100.0, 80.0));
        assert!((panel.at(DVec2::new(0.5, 10.0)) - DVec2::new(50.0, 40.0)).length() < 1e-9);
        assert!((panel.at(DVec2::ZERO) - DVec2::new(0.0, 80.0)).length() < 1e-9);
        assert!(panel.svg(DVec2::ZERO).contains(">1000</text>"));
    }
}
