//! The pictures of a skill. A planar skill is seen from above; a spatial one along the three axes
//! and from a corner, its fields on slices through the goal.

use glam::{DVec2, DVec3};
use tprmp_model::skill_model::{DemonstrationRollout, FrameMixture};
use tprmp_rmpflow::policy::canonical::frame_map::Canonical;
use tprmp_spatial::Pose;
use tprmp_spatial::rotation::rotation_vector;

use super::field::{Arrows, Grid, lattice};
use super::forces::{Contribution, Forces};
use super::scene::{SAMPLE_S, Sample, Scene};
use crate::demonstration::Demonstration;
use crate::mixture::components::Choice;
use tprmp_drawing::{
    Anchor, BLACK, BLUE, Canvas, Ellipsoid, Figure, GREEN, GREY, INK, ORANGE, PURPLE, Panel, RED,
    Scale, Sign, Stroke, View, of_phase, pale_of_phase, principal_axes,
};

/// Standard deviations at which Gaussians are drawn.
const DEVIATIONS: f64 = 2.0;
/// Room around what is drawn, and around the demonstrations of a field, in fractions of the longest
/// side.
const MARGIN: f64 = 0.1;
const FIELD_MARGIN: f64 = 0.18;
/// Distance of the lattice of starts [px].
const STARTS_PX: [f64; 2] = [105.0, 75.0];
/// A component weighs more than all others together.
const MOST: f64 = 0.5;
/// Lengths of the shortest force that is drawn and of the longest [px].
const FORCE_PX: [f64; 2] = [4.0, 70.0];
/// How far from its path the point lies at which forces are drawn, in fractions of the distance from
/// start to end.
const ASIDE: f64 = 0.08;
/// Where the gripper does something: colour and radius [px].
const GRIPPER: &str = "#d62728";
const GRIPPER_RADIUS_PX: f64 = 4.0;
/// Outline of a Gaussian on a field.
const OUTLINE: &str = "#3c4650";
const DEMONSTRATION: Stroke = Stroke::solid(GREY, 1.3);
const DEMONSTRATION_ON_FIELD: Stroke = Stroke::dashed(BLACK, 1.2);
const ROLLOUT: Stroke = Stroke::solid(RED, 2.0).rimmed();
const ROLLOUT_FROM_LATTICE: Stroke = Stroke::solid(BLUE, 1.1).rimmed();

/// Demonstrations and their frames, in the robot's base frame.
pub(super) fn demonstrations(
    planar: bool,
    demonstrations: &[Demonstration],
    frames: &[(&str, Vec<Pose>)],
) -> Figure {
    const PATH: Stroke = Stroke { colour: INK, ..DEMONSTRATION };
    let poses = demonstrations.iter().flat_map(|d| &d.poses);
    let poses = poses.chain(frames.iter().flat_map(|(_, poses)| poses));
    let canvas = Canvas::new(planar, poses.map(|pose| pose.position), MARGIN);
    let mut panels = canvas.panels(None);
    for (panel, view) in panels.iter_mut().zip(canvas.views) {
        let mut in_the_way: Vec<DVec2> = Vec::new();
        for d in demonstrations {
            panel.line(seen(*view, &d.poses), &PATH);
            in_the_way.extend(seen(*view, &d.poses));
        }
        for frame in frames.iter().flat_map(|(_, poses)| poses) {
            canvas.frame(panel, *view, frame);
            in_the_way.extend(canvas.axes(*view, frame));
        }
        for (name, poses) in frames {
            canvas.name(panel, *view, name, poses, &in_the_way);
        }
    }
    let legend =
        [("demonstration", Sign::Line(PATH)), ("frame of a demonstration", canvas.frame_sign())];
    canvas.figure("Demonstrations".into(), &legend, panels, None)
}

/// Demonstrations in colours of their modes, seen from a frame.
pub(super) fn modes(planar: bool, frame: &str, modes: &[Vec<Vec<DVec3>>]) -> Figure {
    const COLOURS: [&str; 6] = [BLUE, RED, GREEN, ORANGE, PURPLE, BLACK];
    let stroke = |mode: usize| Stroke::solid(COLOURS[mode % COLOURS.len()], 1.4);
    let points = modes.iter().flatten().flatten().copied().chain([DVec3::ZERO]);
    let canvas = Canvas::new(planar, points, MARGIN);
    let mut panels = canvas.panels(None);
    for (panel, view) in panels.iter_mut().zip(canvas.views) {
        let mut in_the_way: Vec<DVec2> = Vec::new();
        for (i, mode) in modes.iter().enumerate() {
            for path in mode {
                panel.line(path.iter().map(|p| view.point(*p)), &stroke(i));
                in_the_way.extend(path.iter().map(|p| view.point(*p)));
            }
        }
        canvas.frame(panel, *view, &Pose::IDENTITY);
        in_the_way.extend(canvas.axes(*view, &Pose::IDENTITY));
        canvas.name(panel, *view, frame, &[Pose::IDENTITY], &in_the_way);
    }
    let names: Vec<String> = (1..=modes.len()).map(|mode| format!("mode {mode}")).collect();
    let signs = names.iter().enumerate().map(|(i, name)| (name.as_str(), Sign::Line(stroke(i))));
    let legend: Vec<(&str, Sign)> = signs.collect();
    canvas.figure("Modes".into(), &legend, panels, None)
}

/// Gaussians in canonical coordinates, with the demonstrations there, and marks where the gripper does
/// something.
pub(super) fn gaussians(
    planar: bool,
    frames: &[(&str, Pose)],
    demonstrations: &[Vec<Canonical>],
    gaussians: &[Ellipsoid],
    marks: &[DVec3],
) -> Figure {
    let positions = |path: &Vec<Canonical>| path.iter().map(|y| y.position).collect();
    let paths: Vec<Vec<DVec3>> = demonstrations.iter().map(positions).collect();
    mixture(planar, "Gaussians in canonical coordinates", frames, &paths, gaussians, marks)
}

/// What a frame sees: the demonstrations, and the mixture in its coordinates.
pub(super) struct SeenFromFrame {
    /// Name of the frame.
    pub(super) name: String,
    /// Positions of each demonstration in the frame [m].
    pub(super) paths: Vec<Vec<DVec3>>,
    /// The mixture in the frame.
    pub(super) gaussians: Vec<Ellipsoid>,
}

/// Demonstrations and Gaussians seen from a frame  [thesis fig. 3.2b].
pub(super) fn seen_from(planar: bool, seen: &SeenFromFrame) -> Figure {
    let title = format!("Seen from the frame “{}”", seen.name);
    mixture(planar, &title, &[(&seen.name, Pose::IDENTITY)], &seen.paths, &seen.gaussians, &[])
}

fn mixture(
    planar: bool,
    title: &str,
    frames: &[(&str, Pose)],
    paths: &[Vec<DVec3>],
    gaussians: &[Ellipsoid],
    marks: &[DVec3],
) -> Figure {
    let ends = gaussians.iter().flat_map(|g| g.ends(DEVIATIONS));
    let origins = frames.iter().map(|(_, frame)| frame.position);
    let points = paths.iter().flatten().copied().chain(ends).chain(origins);
    let canvas = Canvas::new(planar, points, MARGIN);
    let mut panels = canvas.panels(None);
    for (panel, view) in panels.iter_mut().zip(canvas.views) {
        for path in paths {
            panel.line(path.iter().map(|p| view.point(*p)), &DEMONSTRATION);
        }
        for g in gaussians {
            let (mean, seen) = (view.point(g.mean), view.covariance(g.covariance));
            panel.ellipse(mean, seen, DEVIATIONS, &of_phase(g.phase), 0.16);
        }
        for g in gaussians {
            panel.dot(view.point(g.mean), 3.0, &of_phase(g.phase));
        }
        for mark in marks {
            panel.dot(view.point(*mark), GRIPPER_RADIUS_PX, GRIPPER);
        }
        let mut in_the_way: Vec<DVec2> = paths.iter().flatten().map(|p| view.point(*p)).collect();
        for g in gaussians {
            in_the_way.extend(outline(*view, g));
        }
        for (_, frame) in frames {
            canvas.frame(panel, *view, frame);
            in_the_way.extend(canvas.axes(*view, frame));
        }
        for (name, frame) in frames {
            canvas.name(panel, *view, name, &[*frame], &in_the_way);
        }
    }
    let mut legend =
        vec![("demonstration", Sign::Line(DEMONSTRATION)), ("frame", canvas.frame_sign())];
    if !marks.is_empty() {
        legend.push(("gripper changes", Sign::Dot(GRIPPER)));
    }
    let mut bar = None;
    if !gaussians.is_empty() {
        legend.insert(1, ("Gaussian, 2σ", Sign::Ellipse("#21918c")));
        bar = Some(Scale::phases());
    }
    canvas.figure(title.into(), &legend, panels, bar)
}

/// Draws the figures of a scene, with the same rollouts in all of them.
pub(super) struct SceneFigures<'a> {
    scene: &'a Scene<'a>,
    canvas: Canvas,
    /// From the demonstrated starts.
    rollouts: Vec<Vec<Pose>>,
    /// From a lattice on the slice of each view.
    from_lattice: Vec<Vec<Vec<Pose>>>,
}

impl<'a> SceneFigures<'a> {
    /// Computes the rollouts from all demonstrated starts and from a lattice around.
    pub(super) fn new(scene: &'a Scene<'a>) -> Self {
        let points = scene.demonstrations.iter().flatten().map(|pose| pose.position);
        let others = scene.frames.iter().map(|frame| frame.position);
        let others = others.chain([scene.goal.position]);
        let canvas = Canvas::new(scene.skill.planar(), points.chain(others), FIELD_MARGIN);
        let starts: Vec<Pose> = scene.demonstrations.iter().map(|path| path[0]).collect();
        let slice = scene.goal.position;
        let panels = canvas.panels(None);
        let from_lattice = canvas.views.iter().zip(&panels).map(|(view, panel)| {
            if view.depth().is_none() {
                return Vec::new();
            }
            let count = (panel.size() / canvas.choose(STARTS_PX)).round().max(DVec2::splat(2.0));
            let place = |seen| Pose { position: view.on_slice(seen, slice), ..starts[0] };
            scene.rollouts(&lattice(panel, count).map(place).collect::<Vec<_>>())
        });
        let from_lattice = from_lattice.collect();
        Self { scene, canvas, rollouts: scene.rollouts(&starts), from_lattice }
    }

    /// The rollouts from the demonstrated starts.
    pub(super) fn rollouts(&self) -> &[Vec<Pose>] {
        &self.rollouts
    }

    /// A number as filled contours, with everything over it.
    pub(super) fn contours(
        &self,
        title: &str,
        value: impl Fn(&Sample) -> f64,
        scale: impl Fn(&mut dyn Iterator<Item = f64>) -> Scale,
    ) -> Figure {
        let mut panels = self.canvas.panels(Some(self.scene.goal.position));
        let mut sample = self.scene.sampler();
        let grids = self.slices(&panels, |view, panel| {
            Grid::new(panel, |p| value(&sample(self.on_slice(view, p))))
        });
        let scale = scale(&mut grids.iter().flatten().flat_map(Grid::values));
        for (i, (panel, view)) in panels.iter_mut().zip(self.canvas.views).enumerate() {
            if let Some(grid) = &grids[i] {
                grid.draw(panel, &scale);
            }
            for g in &self.scene.gaussians {
                let (mean, seen) = (view.point(g.mean), view.covariance(g.covariance));
                panel.ellipse(mean, seen, DEVIATIONS, OUTLINE, 0.0);
            }
            for path in &self.from_lattice[i] {
                panel.line(seen(*view, path), &ROLLOUT_FROM_LATTICE);
                panel.dot(view.point(path[0].position), 3.0, BLUE);
            }
            self.paths(panel, *view, &self.rollouts);
        }
        let legend = [
            ("rollout from a demonstrated start", Sign::Line(ROLLOUT)),
            ("rollout from a lattice of starts", Sign::Line(ROLLOUT_FROM_LATTICE)),
            ("demonstration", Sign::Line(DEMONSTRATION_ON_FIELD)),
            ("Gaussian, 2σ", Sign::Ellipse(OUTLINE)),
            ("goal", Sign::Star),
            ("frame", self.canvas.frame_sign()),
        ];
        self.canvas.figure(title.into(), &legend, panels, Some(scale))
    }

    /// A vector as arrows in the slices, with one rollout.
    pub(super) fn arrows(
        &self,
        title: &str,
        label: &str,
        vector: impl Fn(&Sample) -> DVec3,
    ) -> Figure {
        let mut panels = self.canvas.panels(Some(self.scene.goal.position));
        let mut sample = self.scene.sampler();
        let fields = self.slices(&panels, |view, panel| {
            Arrows::new(panel, |p| view.point(vector(&sample(self.on_slice(view, p)))))
        });
        let scale = Scale::lines(fields.iter().flatten().flat_map(Arrows::magnitudes), label);
        for (i, (panel, view)) in panels.iter_mut().zip(self.canvas.views).enumerate() {
            if let Some(arrows) = &fields[i] {
                arrows.draw(panel, &scale);
            }
            self.paths(panel, *view, &self.rollouts[..1]);
        }
        let legend = [
            ("rollout", Sign::Line(ROLLOUT)),
            ("demonstration", Sign::Line(DEMONSTRATION_ON_FIELD)),
            ("goal", Sign::Star),
            ("frame", self.canvas.frame_sign()),
        ];
        self.canvas.figure(title.into(), &legend, panels, Some(scale))
    }

    /// Where each component weighs most, and its part in the force at a point beside the first
    /// demonstration  [thesis fig. 4.3b].
    pub(super) fn forces(&self, forces: &Forces) -> Figure {
        let mut panels = self.canvas.panels(None);
        let panel = &mut panels[0];
        let view = self.canvas.views[0];
        let phases: Vec<f64> = self.scene.gaussians.iter().map(|g| g.phase).collect();
        for (k, phase) in phases.iter().enumerate() {
            let weight = |p| forces.weights(p).get(k).copied().unwrap_or(0.0);
            Grid::new(panel, weight).draw_above(panel, MOST, &pale_of_phase(*phase));
        }
        for g in &self.scene.gaussians {
            let (mean, seen) = (view.point(g.mean), view.covariance(g.covariance));
            panel.ellipse(mean, seen, DEVIATIONS, OUTLINE, 0.0);
        }
        self.paths(panel, view, &[]);
        let state = beside(&self.scene.demonstrations[0]);
        let contributions = forces.contributions(state);
        let sum = |part: fn(&Contribution) -> DVec2| contributions.iter().map(part).sum::<DVec2>();
        let (attraction, nominal) = (sum(|c| c.attraction), sum(|c| c.nominal));
        let at_state = [(attraction, BLUE), (nominal, RED), (attraction + nominal, BLACK)];
        let all = contributions.iter().flat_map(|c| [c.attraction, c.nominal]);
        let largest = all.chain(at_state.map(|(force, _)| force)).map(DVec2::length);
        let pixels = FORCE_PX[1] / largest.fold(f64::MIN_POSITIVE, f64::max);
        let mut arrow = |from: DVec2, force: DVec2, colour: &str| {
            let vector = force * pixels;
            if vector.length() > FORCE_PX[0] {
                panel.arrow(from + vector * 0.5 / panel.scale(), vector, colour);
            }
        };
        for contribution in &contributions {
            arrow(contribution.mean, contribution.attraction, BLUE);
            arrow(contribution.mean, contribution.nominal, RED);
        }
        for (force, colour) in at_state {
            arrow(state, force, colour);
        }
        panel.dot(state, 4.0, BLACK);
        let line = |colour| Stroke::solid(colour, 1.5);
        let legend = [
            ("attraction −w∇φ", Sign::Line(line(BLUE))),
            ("nominal −φ∇w", Sign::Line(line(RED))),
            ("sum, at the point", Sign::Line(line(BLACK))),
            ("demonstration", Sign::Line(DEMONSTRATION_ON_FIELD)),
            ("Gaussian, 2σ", Sign::Ellipse(OUTLINE)),
            ("goal", Sign::Star),
        ];
        self.canvas.figure(
            "Forces of the components".into(),
            &legend,
            panels,
            Some(Scale::phases()),
        )
    }

    /// What `make` makes of each view that is a slice.
    fn slices<T>(
        &self,
        panels: &[Panel],
        mut make: impl FnMut(View, &Panel) -> T,
    ) -> Vec<Option<T>> {
        let views = self.canvas.views.iter().zip(panels);
        views.map(|(view, panel)| view.depth().map(|_| make(*view, panel))).collect()
    }

    fn on_slice(&self, view: View, seen: DVec2) -> DVec3 {
        view.on_slice(seen, self.scene.goal.position)
    }

    /// Demonstrations, these rollouts, frames and goal.
    fn paths(&self, panel: &mut Panel, view: View, rollouts: &[Vec<Pose>]) {
        for path in &self.scene.demonstrations {
            panel.line(seen(view, path), &DEMONSTRATION_ON_FIELD);
        }
        for path in rollouts {
            panel.line(seen(view, path), &ROLLOUT);
        }
        for path in rollouts {
            panel.dot(view.point(path[0].position), 3.6, RED);
        }
        for frame in &self.scene.frames {
            self.canvas.frame(panel, view, frame);
        }
        panel.star(view.point(self.scene.goal.position));
    }
}

/// A point beside the middle of a planar path.
fn beside(path: &[Pose]) -> DVec2 {
    let at =
        |fraction: f64| path[((path.len() - 1) as f64 * fraction) as usize].position.truncate();
    let along = (at(0.55) - at(0.45)).normalize_or(DVec2::X);
    at(0.5) + along.perp() * (ASIDE * (at(1.0) - at(0.0)).length())
}

/// Points of the ellipse of a Gaussian as it is seen.
fn outline(view: View, gaussian: &Ellipsoid) -> impl Iterator<Item = DVec2> {
    let (axes, angle) = principal_axes(view.covariance(gaussian.covariance));
    let mean = view.point(gaussian.mean);
    (0..24).map(move |i| {
        let on_circle = DVec2::from_angle(std::f64::consts::TAU * f64::from(i) / 24.0);
        mean + DVec2::from_angle(angle).rotate(on_circle * axes * DEVIATIONS)
    })
}

fn seen(view: View, path: &[Pose]) -> impl Iterator<Item = DVec2> {
    path.iter().map(move |pose| view.point(pose.position))
}

/// A Gaussian of the orientation chart: phase, mean and standard deviations [rad].
pub(super) struct OrientationBand {
    /// Mean phase.
    pub(super) phase: f64,
    /// Mean rotation vector [rad].
    pub(super) mean: DVec3,
    /// Standard deviations of its components [rad].
    pub(super) deviations: DVec3,
}

/// Rotation vectors at the goal over the phase: demonstrations without rest, rollouts, Gaussians.
///
/// * `demonstrations`  in canonical coordinates
/// * `duration_s`  the time that phase one stands for
pub(super) fn orientation(
    demonstrations: &[Vec<Canonical>],
    rollouts: &[Vec<Pose>],
    goal: &Pose,
    bands: &[OrientationBand],
    duration_s: f64,
) -> Figure {
    const PHASE_MAX: f64 = 1.2;
    const SIZE: DVec2 = DVec2::new(560.0, 190.0);
    let demonstrated = |path: &Vec<Canonical>| -> Vec<(f64, DVec3)> {
        let last = (path.len() - 1) as f64;
        path.iter().enumerate().map(|(i, y)| (i as f64 / last, y.rotation)).collect()
    };
    let followed = |path: &Vec<Pose>| -> Vec<(f64, DVec3)> {
        let vectors = path.iter().enumerate().map(|(i, pose)| {
            let rotation = rotation_vector(goal.orientation.conjugate() * pose.orientation);
            (i as f64 * SAMPLE_S / duration_s, rotation)
        });
        vectors.take_while(|(phase, _)| *phase <= PHASE_MAX).collect()
    };
    let demonstrated: Vec<_> = demonstrations.iter().map(demonstrated).collect();
    let followed: Vec<_> = rollouts.iter().map(followed).collect();
    let panels = (0..3).map(|axis| {
        let bounds = bands.iter().flat_map(|band| {
            [-DEVIATIONS, DEVIATIONS].map(|n| band.mean[axis] + n * band.deviations[axis])
        });
        let paths = demonstrated.iter().chain(&followed).flatten().map(|(_, r)| r[axis]);
        let (low, high) = bounds
            .chain(paths)
            .fold((-0.05, 0.05_f64), |(low, high): (f64, f64), r| (low.min(r), high.max(r)));
        let room = 0.06 * (high - low);
        let label = format!("{} of r [rad]", ["x", "y", "z"][axis]);
        let range = [DVec2::new(-0.03, low - room), DVec2::new(PHASE_MAX, high + room)];
        let x_label =
            format!("phase (one: the mean duration of a demonstration, {duration_s:.2} s)");
        let mut panel = Panel::graph("", [&x_label, &label], range, SIZE);
        let edge = |n: f64| {
            move |band: &OrientationBand| {
                DVec2::new(band.phase, band.mean[axis] + n * band.deviations[axis])
            }
        };
        let upper = bands.iter().map(edge(DEVIATIONS));
        panel.band(upper.chain(bands.iter().rev().map(edge(-DEVIATIONS))), BLUE);
        for path in &demonstrated {
            let points = path.iter().map(|(phase, r)| DVec2::new(*phase, r[axis]));
            panel.line(points, &DEMONSTRATION);
        }
        for path in &followed {
            let points = path.iter().map(|(phase, r)| DVec2::new(*phase, r[axis]));
            panel.line(points, &Stroke { width: 1.3, rim: false, ..ROLLOUT });
        }
        for band in bands {
            panel.dot(edge(0.0)(band), 4.0, BLUE);
        }
        vec![panel]
    });
    let legend = [
        ("demonstration", Sign::Line(DEMONSTRATION)),
        ("rollout from a demonstrated start", Sign::Line(ROLLOUT)),
        ("mean of a Gaussian", Sign::Dot(BLUE)),
        ("2σ", Sign::Ellipse(BLUE)),
    ];
    Figure {
        title: "Orientation: rotation vector at the goal".into(),
        legend: legend.map(|(label, sign)| (label.into(), sign)).to_vec(),
        rows: panels.collect(),
        bar: None,
    }
}

/// Colours of frames, in the skill's order.
const FRAMES: [&str; 8] = [BLUE, ORANGE, GREEN, PURPLE, RED, INK, GREY, BLACK];
const TIME_SIZE: DVec2 = DVec2::new(560.0, 240.0);

/// Time in each recording, from its first motion on, over the common time.
pub(super) fn alignment(rows: &[DemonstrationRollout], duration_s: f64) -> Figure {
    let recorded = |row: &DemonstrationRollout| -> Vec<DVec2> {
        let last = (row.recorded_s.len() - 1) as f64;
        let point = |(i, time): (usize, &f64)| {
            DVec2::new(i as f64 / last * duration_s, time - row.recorded_s[0])
        };
        row.recorded_s.iter().enumerate().map(point).collect()
    };
    let paths: Vec<_> = rows.iter().map(recorded).collect();
    let longest = paths.iter().flatten().map(|point| point.y).fold(duration_s, f64::max);
    let range = [DVec2::ZERO, DVec2::new(duration_s, 1.05 * longest)];
    let labels = ["common time [s]", "time in the recording [s]"];
    let mut panel = Panel::graph("", labels, range, TIME_SIZE);
    for path in &paths {
        panel.line(path.iter().copied(), &DEMONSTRATION);
    }
    let even = [DVec2::ZERO, DVec2::splat(duration_s)];
    panel.line(even, &Stroke::dashed(BLACK, 1.2));
    let legend = [
        ("demonstration", Sign::Line(DEMONSTRATION)),
        ("at the common pace", Sign::Line(Stroke::dashed(BLACK, 1.2))),
    ];
    Figure {
        title: "Alignment: which times of the recordings belong together".into(),
        legend: legend.map(|(label, sign)| (label.into(), sign)).to_vec(),
        rows: vec![vec![panel]],
        bar: None,
    }
}

/// How far the demonstrations lie apart over the common time, seen from each frame and in the map of all.
pub(super) fn agreement(frames: &[FrameMixture], map: &[[f64; 2]]) -> Figure {
    let all = frames.iter().flat_map(|frame| &frame.agreement).chain(map);
    let most = all.map(|[metres, _]| 1e3 * metres).fold(1.0, f64::max);
    let range = [DVec2::ZERO, DVec2::new(100.0, 1.05 * most)];
    let labels = ["common time [%]", "rms distance from the mean [mm]"];
    let mut panel = Panel::graph("", labels, range, TIME_SIZE);
    let points = |all: &[[f64; 2]]| -> Vec<DVec2> {
        let last = (all.len() - 1) as f64;
        let point = |(i, [metres, _]): (usize, &[f64; 2])| {
            DVec2::new(100.0 * i as f64 / last, 1e3 * metres)
        };
        all.iter().enumerate().map(point).collect()
    };
    let mut legend = Vec::new();
    for (frame, colour) in frames.iter().zip(FRAMES) {
        let stroke = Stroke::solid(colour, 1.6);
        panel.line(points(&frame.agreement), &stroke);
        legend.push((format!("seen from “{}”", frame.name), Sign::Line(stroke)));
    }
    let stroke = Stroke::dashed(BLACK, 1.6);
    panel.line(points(map), &stroke);
    legend.push(("in the map of all frames".into(), Sign::Line(stroke)));
    Figure {
        title: "Which frame speaks when: how far the demonstrations lie apart".into(),
        legend,
        rows: vec![vec![panel]],
        bar: None,
    }
}

/// The Bayesian information criterion over the number of Gaussians, the chosen one marked.
pub(super) fn choice(choice: &Choice) -> Figure {
    const EMPTY: &str = "#c9d1d8";
    let finite = choice.candidates.iter().filter(|candidate| candidate.bic.is_finite());
    let points: Vec<_> = finite.map(|c| (c, DVec2::new(c.components as f64, c.bic))).collect();
    let low = points.iter().map(|(_, p)| *p).fold(DVec2::INFINITY, DVec2::min);
    let high = points.iter().map(|(_, p)| *p).fold(DVec2::NEG_INFINITY, DVec2::max);
    // An axis of five or more has whole numbers at its ticks.
    let room =
        DVec2::new((0.5 * (5.0 - high.x + low.x)).max(0.6), 0.14 * (high.y - low.y).max(1.0));
    let labels = ["number of Gaussians K", "BIC [nat]"];
    let size = DVec2::new(620.0, 340.0);
    let mut panel = Panel::graph("", labels, [low - room, high + room], size);
    panel.line(points.iter().map(|(_, p)| *p), &Stroke::solid(BLUE, 1.6));
    for (candidate, p) in &points {
        if candidate.components == choice.components {
            panel.dot(*p, 8.0, RED);
            panel.words(
                *p,
                DVec2::new(0.0, 24.0),
                Anchor::Middle,
                &format!("K = {}", choice.components),
            );
        } else {
            panel.dot(*p, 4.5, if candidate.empty { EMPTY } else { BLUE });
        }
    }
    let mut legend =
        vec![("tried".into(), Sign::Dot(BLUE)), ("least, chosen".into(), Sign::Dot(RED))];
    if choice.candidates.iter().any(|candidate| candidate.empty) {
        legend.push(("a component holds no samples".into(), Sign::Dot(EMPTY)));
    }
    let title = "Bayesian information criterion".into();
    Figure { title, legend, rows: vec![vec![panel]], bar: None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_sees_each_gaussian_in_each_view() {
        let covariance = vec![vec![0.04, 0.01, 0.0], vec![0.01, 0.02, 0.0], vec![0.0, 0.0, 0.01]];
        let gaussian = |x| Ellipsoid::new(3, &[x, 0.1, 0.2], &covariance, x);
        for (planar, views) in [(true, 1), (false, 4)] {
            let seen = SeenFromFrame {
                name: "a<b".into(),
                paths: vec![vec![DVec3::ZERO, DVec3::ONE]],
                gaussians: vec![gaussian(0.0), gaussian(0.7)],
            };
            let svg = seen_from(planar, &seen).svg();
            assert_eq!(svg.matches("<ellipse").count(), 2 * views);
            assert!(svg.contains("a&lt;b") && !svg.contains("NaN"));
        }
    }
}
