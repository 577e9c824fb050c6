//! Where a skill is drawn: a panel for each view, with frames and their names.

use glam::{DVec2, DVec3};
use tprmp_spatial::Pose;

use crate::colour::{AXES, GREY, INK, Scale};
use crate::figure::{Figure, Sign};
use crate::panel::{Anchor, Panel, Stroke};
use crate::projection::{Bounds, PLANE, SPACE, View};
use crate::text::number;
use crate::ticks;

/// Longest side of the axes of a planar and of a spatial skill \[px\].
const SIDES_PX: [f64; 2] = [620.0, 360.0];
/// Length of a frame's axes, in fractions of the longest side.
const FRAME_FRACTION: f64 = 0.07;
/// More room around a name is not looked for \[px\].
const ROOM_MAX_PX: f64 = 14.0;

/// A skill's views and the space that they show.
#[derive(Clone, Copy)]
pub struct Canvas {
    /// The views.
    pub views: &'static [View],
    space: Bounds,
}

impl Canvas {
    /// For a planar or a spatial skill, around points, with a margin that is a fraction of the longest
    /// side.
    pub fn new(planar: bool, points: impl IntoIterator<Item = DVec3>, margin: f64) -> Self {
        let views = if planar { PLANE } else { SPACE };
        Self { views, space: Bounds::around(planar, points, margin) }
    }

    fn planar(&self) -> bool {
        self.views.len() == 1
    }

    /// Picks the value for planar or spatial skills.
    pub fn choose(&self, of: [f64; 2]) -> f64 {
        of[usize::from(!self.planar())]
    }

    /// A panel for each view, all with the same scale. `slice`: the point through which fields are
    /// cut.
    pub fn panels(&self, slice: Option<DVec3>) -> Vec<Panel> {
        let sides = self.views.iter().map(|view| {
            let [low, high] = view.range(&self.space);
            (high - low).max_element()
        });
        let pixels = self.choose(SIDES_PX) / sides.fold(0.0, f64::max);
        self.views.iter().map(|view| self.panel(*view, slice, pixels)).collect()
    }

    fn panel(&self, view: View, slice: Option<DVec3>, pixels: f64) -> Panel {
        const LABELS: [&str; 3] = ["x [m]", "y [m]", "z [m]"];
        let range = view.range(&self.space);
        let View::Along([a, b]) = view else {
            let mut panel = Panel::map("isometric", ["", ""], range, pixels).without_ticks();
            corner_axes(&mut panel, &self.space, LABELS);
            return panel;
        };
        let name = |i: usize| ["x", "y", "z"][i];
        let mut title =
            if self.planar() { String::new() } else { format!("{}–{}", name(a), name(b)) };
        if let (Some(plane), false) = (slice, self.planar()) {
            let depth = 3 - a - b;
            title += &format!(" at {} = {} m", name(depth), number(rounded(plane[depth])));
        }
        Panel::map(&title, [LABELS[a], LABELS[b]], range, pixels)
    }

    /// Panels in rows of two.
    pub fn figure(
        &self,
        title: String,
        legend: &[(&str, Sign)],
        panels: Vec<Panel>,
        bar: Option<Scale>,
    ) -> Figure {
        let legend = legend.iter().map(|(label, sign)| ((*label).into(), *sign)).collect();
        let rows = panels.chunks(2).map(<[Panel]>::to_vec).collect();
        Figure { title, legend, rows, bar }
    }

    /// The sign of a frame.
    pub fn frame_sign(&self) -> Sign {
        Sign::Frame(if self.planar() { &AXES[..2] } else { &AXES })
    }

    /// Middle and end of each axis of a frame, as they are seen.
    pub fn axes(&self, view: View, frame: &Pose) -> Vec<DVec2> {
        let side = (self.space.high - self.space.low).max_element();
        let count = if self.planar() { 2 } else { 3 };
        let on_axis = |axis: DVec3| {
            let arm = frame.orientation * axis * (FRAME_FRACTION * side);
            [0.5, 1.0].map(|fraction| view.point(frame.position + arm * fraction))
        };
        DVec3::AXES.into_iter().take(count).flat_map(on_axis).collect()
    }

    /// Draws the axes of a frame.
    pub fn frame(&self, panel: &mut Panel, view: View, frame: &Pose) {
        for (points, colour) in self.axes(view, frame).chunks(2).zip(AXES) {
            panel.line([view.point(frame.position), points[1]], &Stroke::solid(colour, 2.4));
        }
    }

    /// Writes the name of frames beside them, where most room is left between what is in the way.
    pub fn name(
        &self,
        panel: &mut Panel,
        view: View,
        name: &str,
        frames: &[Pose],
        in_the_way: &[DVec2],
    ) {
        const ROOM_PX: DVec2 = DVec2::new(8.0, 12.0);
        let half = DVec2::new(3.4 * name.chars().count() as f64, 6.0);
        let mut in_the_way: Vec<DVec2> = in_the_way.iter().map(|p| panel.at(*p)).collect();
        if view == View::Corner {
            // The numbers of the lower axes.
            let (low, high) = (self.space.low, self.space.high);
            let axes =
                [(low, high.with_y(low.y).with_z(low.z)), (low.with_x(high.x), high.with_z(low.z))];
            for (from, to) in axes {
                let on = |i: i32| panel.at(view.point(from.lerp(to, f64::from(i) / 16.0)));
                in_the_way.extend((0..=16).flat_map(|i| [0.0, 16.0].map(|y| on(i) + DVec2::Y * y)));
            }
        }
        let origins: Vec<DVec2> =
            frames.iter().map(|frame| panel.at(view.point(frame.position))).collect();
        let low = origins.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let high = origins.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        // How far the nearest obstacle, or the panel's edge, is from the box of the words.
        let room = |centre: &DVec2| {
            let apart = |p: &DVec2| ((*p - *centre).abs() - half).max(DVec2::ZERO).length();
            let inside = (*centre - half).min(panel.size() - *centre - half).min_element();
            in_the_way.iter().map(apart).fold(inside, f64::min)
        };
        let reach = 0.5 * (high - low) + half + ROOM_PX;
        let around = (0..32).map(|i| {
            let direction = DVec2::from_angle(std::f64::consts::TAU * f64::from(i % 16) / 16.0);
            // On the edge of a box around the frames, and of one farther out.
            let edge = direction / (direction.abs() / reach).max_element();
            0.5 * (low + high) + edge * if i < 16 { 1.0 } else { 1.0 + 20.0 / reach.length() }
        });
        let best =
            around.max_by(|a, b| room(a).min(ROOM_MAX_PX).total_cmp(&room(b).min(ROOM_MAX_PX)));
        let centre = best.expect("there are directions");
        panel.label(centre + DVec2::Y * 4.5, Anchor::Middle, INK, name);
    }
}

/// Three digits behind the point, as positions are given.
fn rounded(x: f64) -> f64 {
    (x * 1e3).round() / 1e3
}

/// The edges of a box in the isometric view, the lower front ones and the left one with ticks.
fn corner_axes(panel: &mut Panel, space: &Bounds, labels: [&str; 3]) {
    const FAINT: Stroke = Stroke::solid("#d5dce2", 1.0);
    const EDGE: Stroke = Stroke::solid(GREY, 1.0);
    let seen = |p: DVec3| View::Corner.point(p);
    let (low, high) = (space.low, space.high);
    let at = |x: bool, y: bool, z: bool| {
        let pick = |i: usize, up: bool| if up { high[i] } else { low[i] };
        DVec3::new(pick(0, x), pick(1, y), pick(2, z))
    };
    // Behind what is shown: the floor, the back edge, the left and the right one.
    let hidden = [
        [at(false, false, false), at(false, true, false)],
        [at(false, true, false), at(true, true, false)],
        [at(false, true, false), at(false, true, true)],
        [at(true, true, false), at(true, true, true)],
        [at(false, false, true), at(false, true, true)],
        [at(false, true, true), at(true, true, true)],
    ];
    for edge in hidden {
        panel.line(edge.map(seen), &FAINT);
    }
    let pixels = panel.scale().x;
    // Each with its outward direction in the picture, and how its numbers are set.
    let axes = [
        (0, at(false, false, false), DVec2::new(-4.0, 7.0), Anchor::End),
        (1, at(true, false, false), DVec2::new(4.0, 7.0), Anchor::Start),
        (2, at(false, false, false), DVec2::new(-7.0, 0.0), Anchor::End),
    ];
    for (axis, origin, outward, anchor) in axes {
        let on = |value: f64| {
            let mut p = origin;
            p[axis] = value;
            seen(p)
        };
        panel.line([on(low[axis]), on(high[axis])], &EDGE);
        let length = (on(high[axis]) - on(low[axis])).length() * pixels;
        for tick in ticks::above_each_other(low[axis], high[axis], length) {
            panel.dot(on(tick), 2.2, GREY);
            let offset = outward + DVec2::Y * if axis == 2 { 4.5 } else { 8.0 };
            panel.words(on(tick), offset, anchor, &number(tick));
        }
        let middle = on(0.5 * (low[axis] + high[axis]));
        let offset = outward * if axis == 2 { 1.0 } else { 5.5 }
            + if axis == 2 { DVec2::new(-42.0, 4.5) } else { DVec2::new(0.0, 4.0) };
        panel.words(middle, offset, anchor, labels[axis]);
    }
}
