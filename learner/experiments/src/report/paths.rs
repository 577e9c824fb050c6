//! Figures of paths: demonstrations, rollouts under every condition, Gaussians and fields.

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::MovingPose;

use super::Run;
use crate::dataset::SkillSet;
use crate::models::Kind;
use crate::protocol::{Bench, Case, Compared};
use crate::world::Trace;
use tprmp_drawing::{BLUE, Figure, GREY, Panel, Picture, RED, Sign, Stroke};

/// Skills in a row, and the side of a panel [px].
const COLUMNS: usize = 5;
const SIDE_PX: f64 = 190.0;
const SHOWN: Stroke = Stroke { colour: GREY, width: 1.4, dashes: "4 3", rim: false };
const CIRCLE: Stroke = Stroke { colour: "#d98200", width: 1.0, dashes: "2 3", rim: false };

fn stroke(kind: Kind) -> Stroke {
    let colour = if kind == Kind::Canonical { BLUE } else { RED };
    Stroke { colour, width: 2.0, dashes: "", rim: false }
}

fn flat(p: DVec3) -> DVec2 {
    DVec2::new(p.x, p.y)
}

/// Which cases a figure shows.
type Chosen = Box<dyn Fn(&Case) -> bool>;

/// All of these figures.
pub(super) fn pictures(run: &Run) -> Vec<Picture> {
    let planar: Vec<usize> = (0..run.bench.skills.len())
        .filter(|i| run.bench.skills[*i].manifold == Manifold::R2)
        .collect();
    let mut pictures = Vec::new();
    if planar.is_empty() {
        return pictures;
    }
    pictures.push(demonstrations(run.bench, &planar));
    let own = Kind::ALL.map(|kind| run.bench.count(Manifold::R2, kind));
    let ball = if run.bench.extent.radii_m.contains(&0.2) { 0.2 } else { 0.1 };
    let radius = if run.bench.extent.radii_m.contains(&0.5) { 0.5 } else { 0.1 };
    let wanted: [(&str, &str, &str, Chosen); 4] = [
        (
            "Figure 5.5: rollouts with the demonstrated frames",
            "tracking",
            "as demonstrated",
            Box::new(move |case| {
                case.instance == 0
                    && matches!(case.compared, Compared::Learned(kind, count) if count == own[usize::from(kind == Kind::Thesis)])
            }),
        ),
        (
            "Figure 5.10: goal on a circle of 0.5 m",
            "radius",
            "circle",
            Box::new(move |case| case.x == radius),
        ),
        (
            "Figure 5.11: goal on a circle, and a push of 10 N",
            "disturbance",
            "pushed",
            Box::new(|case| case.x == 10.0),
        ),
        (
            "Figure 5.15: obstacle in the way",
            "obstacle",
            "obstacle",
            Box::new(move |case| case.x == ball),
        ),
    ];
    for (title, experiment, what, chosen) in wanted {
        let cases: Vec<&Case> =
            run.cases.iter().filter(|case| case.experiment == experiment && chosen(case)).collect();
        pictures.extend(rollouts(run, title, what, &planar, &cases));
    }
    pictures
}

/// A small panel around points.
pub(super) fn panel(title: &str, points: impl Iterator<Item = DVec2>) -> Panel {
    let (low, high) = points
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    let middle = 0.5 * (low + high);
    let half = 0.56 * (high - low).max_element().max(1e-3);
    let range = [middle - half, middle + half];
    Panel::map(title, ["", ""], range, SIDE_PX / (2.0 * half)).without_ticks()
}

/// All demonstrated points.
pub(super) fn points(set: &SkillSet) -> impl Iterator<Item = DVec2> + '_ {
    set.demonstrations.iter().flat_map(|d| d.poses.iter().map(|pose| flat(pose.position)))
}

/// Panels in rows.
pub(super) fn grid(title: &str, legend: Vec<(String, Sign)>, panels: Vec<Panel>) -> String {
    let rows = panels.chunks(COLUMNS).map(<[Panel]>::to_vec).collect();
    Figure { title: title.into(), legend, rows, bar: None }.svg()
}

/// Figure 5.1.
fn demonstrations(bench: &Bench, planar: &[usize]) -> Picture {
    let panels = planar
        .iter()
        .map(|i| {
            let set = &bench.skills[*i];
            let mut panel = panel(&set.name, points(set));
            for shown in &set.demonstrations {
                let line = Stroke { dashes: "", ..stroke(Kind::Canonical) };
                panel.line(shown.poses.iter().map(|pose| flat(pose.position)), &line);
                frame(&mut panel, &shown.start);
                frame(&mut panel, &shown.goal_frame);
                panel.star(flat(shown.poses[shown.poses.len() - 1].position));
            }
            panel
        })
        .collect();
    let sets = || planar.iter().map(|i| &bench.skills[*i]);
    let turning = |set: &SkillSet| {
        let path: Vec<DVec2> =
            set.demonstrations[0].poses.iter().map(|pose| flat(pose.position)).collect();
        let every = (path.len() / 40).max(1);
        let coarse: Vec<DVec2> = path.into_iter().step_by(every).collect();
        coarse
            .windows(3)
            .map(|p| (p[1] - p[0]).angle_to(p[2] - p[1]))
            .filter(|angle| angle.is_finite())
            .map(f64::abs)
            .sum::<f64>()
    };
    let turns: Vec<f64> = sets().map(turning).collect();
    let least = turns.iter().copied().fold(f64::INFINITY, f64::min);
    let most = turns.iter().copied().fold(0.0, f64::max);
    let title = "Figure 5.1: the demonstrations";
    let caption = format!(
        "{} planar skills with {} demonstrations in all; their ways turn by {least:.1} to {most:.1} rad in \
         all. Frames: x red, y green; each star is a goal.",
        planar.len(),
        sets().map(|set| set.demonstrations.len()).sum::<usize>()
    );
    let legend = vec![
        ("demonstration".into(), Sign::Line(stroke(Kind::Canonical))),
        ("goal".into(), Sign::Star),
    ];
    Picture { name: title.into(), svg: grid(title, legend, panels), caption }
}

fn frame(panel: &mut Panel, pose: &tprmp_spatial::Pose) {
    let [low, high] = panel.range();
    let arm = 0.08 * (high - low).x;
    for (axis, colour) in [(DVec3::X, "#d62728"), (DVec3::Y, "#2ca02c")] {
        let tip = pose.position + pose.orientation * axis * arm;
        let line = Stroke { colour, width: 1.6, dashes: "", rim: false };
        panel.line([flat(pose.position), flat(tip)], &line);
    }
}

/// Rollouts of both learned policies under one condition.
fn rollouts(
    run: &Run,
    title: &str,
    what: &str,
    planar: &[usize],
    cases: &[&Case],
) -> Option<Picture> {
    if cases.is_empty() {
        return None;
    }
    let traces: Vec<Option<Trace>> = cases.par_iter().map(|case| run.bench.follow(case)).collect();
    let mut reached = [(0, 0); 2];
    let panels = planar
        .iter()
        .map(|i| {
            let set = &run.bench.skills[*i];
            let own = || cases.iter().zip(&traces).filter(|(case, _)| case.skill == *i);
            let goals = own()
                .filter_map(|(_, trace)| trace.as_ref())
                .flat_map(|t| t.goals.iter().map(|goal| flat(*goal)).collect::<Vec<_>>());
            let shown = || set.demonstrations[0].poses.iter().map(|pose| flat(pose.position));
            let mut panel = panel(&set.name, shown().chain(goals));
            panel.line(shown(), &SHOWN);
            for (case, trace) in own() {
                let (Compared::Learned(kind, _), Some(trace)) = (case.compared, trace) else {
                    continue;
                };
                let count = &mut reached[usize::from(kind == Kind::Thesis)];
                count.1 += 1;
                let touched = trace.clearance_min_m.is_some_and(|c| c <= 0.0);
                count.0 += usize::from(trace.goal_error_m <= case.tolerance[0] && !touched);
                if kind == Kind::Canonical {
                    panel.line(trace.goals.iter().map(|goal| flat(*goal)), &CIRCLE);
                    if let (Some(ball), Some(last)) = (case.course.ball, trace.goals.last()) {
                        let shown = case.course.frames[1];
                        let goal = case.course.goal(&MovingPose::at_rest(shown)).position;
                        let center = flat(ball.center + (*last - goal) * 0.5);
                        let ring = (0..=60).map(|i| {
                            center
                                + DVec2::from_angle(f64::from(i) / 60.0 * std::f64::consts::TAU)
                                    * ball.radius_m
                        });
                        panel.line(
                            ring,
                            &Stroke { colour: "#1a1a1a", width: 1.4, dashes: "", rim: false },
                        );
                    }
                    if let Some(goal) = trace.goals.last() {
                        panel.star(flat(*goal));
                    }
                }
                panel.line(trace.path.iter().map(|pose| flat(pose.position)), &stroke(kind));
                if let Some(end) = trace.path.last() {
                    panel.dot(flat(end.position), 3.0, stroke(kind).colour);
                }
            }
            panel
        })
        .collect();
    let [own, thesis] = reached;
    let caption = format!(
        "{what}: the default policy reaches the true goal in {} of {} cases, the thesis' policy in {} of {}. The \
         demonstration is dashed; the goal's way dotted; dots show where a rollout ended.",
        own.0, own.1, thesis.0, thesis.1
    );
    let legend = vec![
        ("canonical".into(), Sign::Line(stroke(Kind::Canonical))),
        ("thesis".into(), Sign::Line(stroke(Kind::Thesis))),
        ("demonstration".into(), Sign::Line(SHOWN)),
        ("goal's way".into(), Sign::Line(CIRCLE)),
    ];
    Some(Picture { name: title.into(), svg: grid(title, legend, panels), caption })
}
