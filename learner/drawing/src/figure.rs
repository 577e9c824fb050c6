//! Panels with what they have in common: a title, a legend, a colour bar.

use glam::DVec2;

use crate::colour::{GREY, INK, Scale};
use crate::panel::{Anchor, BOTTOM, LEFT, Panel, Stroke, dot, line, star, text};
use crate::text::{escape, number};
use crate::ticks::LETTER_PX;

/// Room around a figure, and its rows of text \[px\].
const MARGIN: f64 = 14.0;
const TITLE: f64 = 34.0;
const LEGEND_ROW: f64 = 24.0;
/// Room for a colour bar, its width and its largest height \[px\].
const BAR_ROOM: f64 = 128.0;
const BAR_WIDTH: f64 = 18.0;
const BAR_HEIGHT_MAX: f64 = 420.0;
/// Least distance of the numbers beside a colour bar \[px\].
const BAR_NUMBERS_APART: f64 = 22.0;

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

/// Panels in rows, with what they share.
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
    /// A figure of one panel.
    pub fn single<'a>(
        title: &str,
        legend: impl IntoIterator<Item = (&'a str, Sign)>,
        panel: Panel,
    ) -> Self {
        let legend = legend.into_iter().map(|(label, sign)| (label.into(), sign)).collect();
        Self { title: title.into(), legend, rows: vec![vec![panel]], bar: None }
    }

    /// The SVG document.
    pub fn svg(&self) -> String {
        let outer = |panel: &Panel| panel.outer();
        let heights = self.rows.iter().map(|row| row.iter().map(outer).map(|o| o.y));
        let heights: Vec<f64> = heights.map(|row| row.fold(0.0, f64::max)).collect();
        let column = |i: usize| {
            let widths = self.rows.iter().filter_map(|row| row.get(i)).map(outer).map(|o| o.x);
            widths.fold(0.0, f64::max)
        };
        let columns: Vec<f64> =
            (0..self.rows.iter().map(Vec::len).max().unwrap_or(0)).map(column).collect();
        let panels = DVec2::new(columns.iter().sum(), heights.iter().sum());
        let bar = if self.bar.is_some() { BAR_ROOM } else { 0.0 };
        let title = LETTER_PX * 1.5 * self.title.chars().count() as f64;
        let width = (panels.x + bar).max(title) + 2.0 * MARGIN;
        let (legend, legend_rows) = self.legend_svg(width - 2.0 * MARGIN);
        let top = MARGIN + TITLE + LEGEND_ROW * legend_rows as f64;
        let height = top + panels.y + MARGIN;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" \
             width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\" aria-label=\"{title}\" \
             font-family=\"'Helvetica Neue', Helvetica, Arial, 'Liberation Sans', sans-serif\" \
             font-size=\"13\" fill=\"{INK}\">\n<rect width=\"100%\" height=\"100%\" \
             fill=\"white\"/>\n<text x=\"{MARGIN}\" y=\"{:.1}\" font-size=\"16\" \
             font-weight=\"600\">{title}</text>\n{legend}",
            MARGIN + 16.0,
            title = escape(&self.title),
        );
        let mut y = top;
        for (row, height) in self.rows.iter().zip(heights) {
            let mut x = MARGIN;
            for (panel, width) in row.iter().zip(&columns) {
                // In the middle of its column, at the bottom of its row.
                let room = DVec2::new(*width, height) - panel.outer();
                svg += &panel.svg(DVec2::new(x + LEFT + 0.5 * room.x, y + panel.top() + room.y));
                x += width;
            }
            y += height;
        }
        if let Some(scale) = &self.bar {
            let above = self.rows.iter().flatten().next().map_or(0.0, Panel::top);
            let height = (panels.y - above - BOTTOM).min(BAR_HEIGHT_MAX);
            svg += &bar_svg(scale, DVec2::new(MARGIN + panels.x + 26.0, top + above), height);
        }
        svg + "</svg>\n"
    }

    /// The legend within a width \[px\], and how many rows it takes.
    fn legend_svg(&self, width_max: f64) -> (String, usize) {
        let (mut svg, mut x, mut row) = (String::new(), 0.0, 0);
        for (label, sign) in &self.legend {
            let width = 54.0 + LETTER_PX * label.chars().count() as f64;
            if x > 0.0 && x + width - 16.0 > width_max {
                (x, row) = (0.0, row + 1);
            }
            let at = DVec2::new(MARGIN + x, MARGIN + TITLE + LEGEND_ROW * row as f64 + 4.0);
            svg += &sign_svg(*sign, at);
            svg += &text(at + DVec2::new(36.0, 4.5), Anchor::Start, label);
            x += width;
        }
        (svg, if self.legend.is_empty() { 0 } else { row + 1 })
    }
}

/// A sign, 28 px wide, the middle of its left edge at a point \[px\].
fn sign_svg(sign: Sign, at: DVec2) -> String {
    let middle = at + DVec2::X * 14.0;
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

/// The bar of a scale from an upper left corner, with numbers at its steps.
fn bar_svg(scale: &Scale, at: DVec2, height: f64) -> String {
    let bands = scale.bands();
    let step = height / bands as f64;
    let mut svg = format!("<g transform=\"translate({:.1} {:.1})\">\n", at.x, at.y);
    for band in 0..bands {
        svg += &format!(
            "<rect y=\"{:.2}\" width=\"{BAR_WIDTH}\" height=\"{:.2}\" fill=\"{}\"/>\n",
            height - (band + 1) as f64 * step,
            step + 0.3,
            scale.colour(band)
        );
    }
    let stride = (BAR_NUMBERS_APART / step).ceil() as usize;
    for (i, level) in scale.levels().iter().enumerate().step_by(stride) {
        let y = height - i as f64 * step;
        let at = |x| DVec2::new(x, y);
        svg += &line(at(BAR_WIDTH), at(BAR_WIDTH + 4.0), GREY, 1.0, "");
        svg += &text(at(BAR_WIDTH + 8.0) + DVec2::Y * 4.5, Anchor::Start, &number(*level));
    }
    svg += &format!(
        "<rect width=\"{BAR_WIDTH}\" height=\"{height:.1}\" fill=\"none\" stroke=\"{GREY}\"/>\n"
    );
    svg += &text(DVec2::new(-4.0, -14.0), Anchor::Start, scale.label());
    svg + "</g>\n"
}
