//! Figures of paths: demonstrations, and rollouts under every condition.

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use tprmp_drawing::{AXES, BLACK, Figure, GREY, ORANGE, Panel, Picture, Sign, Stroke};
use tprmp_spatial::{MovingPose, Pose};

use crate::case::Case;
use crate::dataset::SkillSet;
use crate::experiment::{Experiment, PolicyKind, Space};
use crate::report::content::Run;
use crate::report::style::colour;
use crate::world::RunOutcome;

/// Skills in a row, and the side of a panel [px].
const COLUMNS: usize = 5;
const SIDE_PX: f64 = 190.0;
const DEMONSTRATED: Stroke = Stroke::dashed(GREY, 1.4);
const CIRCLE: Stroke = Stroke { dashes: "2 3", ..Stroke::solid(ORANGE, 1.0) };
const BALL: Stroke = Stroke::solid(BLACK, 1.4);

fn stroke(policy: PolicyKind) -> Stroke {
    Stroke::solid(colour(policy), 2.0)
}

pub(crate) fn flat_path(poses: &[Pose]) -> impl Iterator<Item = DVec2> + '_ {
    poses.iter().map(|pose| pose.position.truncate())
}

/// All of these figures.
pub(crate) fn pictures(run: &Run) -> Vec<Picture> {
    let planar: Vec<usize> = (0..run.bench.skills.len())
        .filter(|i| run.bench.skills[*i].space() == Space::Planar)
        .collect();
    if planar.is_empty() {
        return Vec::new();
    }
    // A quick run has few radii.
    let radii_m = &run.bench.extent.radii_m;
    let radius = |wanted| if radii_m.contains(&wanted) { wanted } else { 0.1 };
    let (circle_m, ball_m) = (radius(0.5), radius(0.2));
    let rollouts = |title, what, experiment, chosen: &dyn Fn(&&Case) -> bool| {
        let own = run.cases.iter().filter(|case| case.experiment == experiment);
        Rollouts::new(run, own.filter(chosen).collect())?.picture(title, what, &planar)
    };
    let own = |case: &&Case| {
        let policy = case.compared.policy;
        case.instance == 0
            && PolicyKind::LEARNED.contains(&policy)
            && case.compared.components == run.bench.files.count(Space::Planar, policy)
    };
    let mut pictures = vec![demonstrations(run.bench.skills, &planar)];
    let title = "Figure 5.5: rollouts with the demonstrated frames";
    pictures.extend(rollouts(title, "as demonstrated", Experiment::Tracking, &own));
    let title = "Figure 5.10: goal on a circle of 0.5 m";
    let chosen = |case: &&Case| case.setting.x() == circle_m;
    pictures.extend(rollouts(title, "circle", Experiment::Radius, &chosen));
    let title = "Figure 5.11: goal on a circle, and a push of 10 N";
    let chosen = |case: &&Case| case.setting.x() == 10.0;
    pictures.extend(rollouts(title, "pushed", Experiment::Disturbance, &chosen));
    let title = "Figure 5.15: obstacle in the way";
    let chosen = |case: &&Case| case.setting.x() == ball_m;
    pictures.extend(rollouts(title, "obstacle", Experiment::Obstacle, &chosen));
    pictures
}

/// A small panel around points.
pub(crate) fn panel(title: &str, points: impl Iterator<Item = DVec2>) -> Panel {
    let (low, high) = points
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    let middle = 0.5 * (low + high);
    let half = 0.56 * (high - low).max_element().max(1e-3);
    let range = [middle - half, middle + half];
    Panel::map(title, ["", ""], range, SIDE_PX / (2.0 * half)).without_ticks()
}

/// All demonstrated points.
pub(crate) fn points(set: &SkillSet) -> impl Iterator<Item = DVec2> + '_ {
    set.demonstrations.iter().flat_map(|d| flat_path(&d.poses))
}

/// Panels in rows.
pub(crate) fn grid(title: &str, legend: Vec<(String, Sign)>, panels: Vec<Panel>) -> String {
    let rows = panels.chunks(COLUMNS).map(<[Panel]>::to_vec).collect();
    Figure { title: title.into(), legend, rows, bar: None }.svg()
}

/// Figure 5.1.
fn demonstrations(skills: &[SkillSet], planar: &[usize]) -> Picture {
    let panels = planar
        .iter()
        .map(|i| {
            let set = &skills[*i];
            let mut panel = panel(&set.name, points(set));
            for demonstration in &set.demonstrations {
                let poses = &demonstration.poses;
                panel.line(flat_path(poses), &stroke(PolicyKind::Canonical));
                frame(&mut panel, &demonstration.start);
                frame(&mut panel, &demonstration.goal_frame);
                panel.star(poses[poses.len() - 1].position.truncate());
            }
            panel
        })
        .collect();
    let sets = || planar.iter().map(|i| &skills[*i]);
    let turning = |set: &SkillSet| {
        let poses = &set.demonstrations[0].poses;
        let every = (poses.len() / 40).max(1);
        let coarse: Vec<DVec2> = flat_path(poses).step_by(every).collect();
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
        "{} planar skills with {} demonstrations in all; their paths turn by {least:.1} to {most:.1} rad in \
         all. Frames: x red, y green; each star is a goal.",
        planar.len(),
        sets().map(|set| set.demonstrations.len()).sum::<usize>()
    );
    let legend = vec![
        ("demonstration".into(), Sign::Line(stroke(PolicyKind::Canonical))),
        ("goal".into(), Sign::Star),
    ];
    Picture { name: title.into(), svg: grid(title, legend, panels), caption }
}

fn frame(panel: &mut Panel, pose: &Pose) {
    let [low, high] = panel.range();
    let arm = 0.08 * (high - low).x;
    for (axis, colour) in [(DVec3::X, AXES[0]), (DVec3::Y, AXES[1])] {
        let tip = pose.position + pose.orientation * axis * arm;
        panel.line([pose.position.truncate(), tip.truncate()], &Stroke::solid(colour, 1.6));
    }
}

/// Rollouts of both learned policies under one condition.
struct Rollouts<'a> {
    skills: &'a [SkillSet],
    /// Each with its outcome, where the policy could be trained.
    cases: Vec<(&'a Case, Option<RunOutcome>)>,
}

impl<'a> Rollouts<'a> {
    /// `None` without cases.
    fn new(run: &Run<'a>, cases: Vec<&'a Case>) -> Option<Self> {
        let cases: Vec<_> =
            cases.into_par_iter().map(|case| (case, run.bench.follow(case))).collect();
        (!cases.is_empty()).then_some(Self { skills: run.bench.skills, cases })
    }

    fn picture(&self, title: &str, what: &str, planar: &[usize]) -> Option<Picture> {
        let panels = planar.iter().map(|skill| self.panel(*skill)).collect();
        let [[own, own_all], [thesis, thesis_all]] =
            PolicyKind::LEARNED.map(|policy| self.reached(policy));
        let caption = format!(
            "{what}: the default policy reaches the true goal in {own} of {own_all} cases, the thesis' \
             policy in {thesis} of {thesis_all}. The demonstration is dashed; the goal's path dotted; \
             dots show where a rollout ended.",
        );
        let mut legend: Vec<_> =
            PolicyKind::LEARNED.map(|p| (p.words(), Sign::Line(stroke(p)))).into();
        legend.push(("demonstration".into(), Sign::Line(DEMONSTRATED)));
        legend.push(("goal's path".into(), Sign::Line(CIRCLE)));
        Some(Picture { name: title.into(), svg: grid(title, legend, panels), caption })
    }

    /// The outcomes of the learned policies on a skill, or on all.
    fn outcomes(&self, skill: Option<usize>) -> impl Iterator<Item = (&'a Case, &RunOutcome)> {
        let own = move |case: &Case| skill.is_none_or(|skill| case.skill == skill);
        self.cases
            .iter()
            .filter(move |(case, _)| {
                own(case) && PolicyKind::LEARNED.contains(&case.compared.policy)
            })
            .filter_map(|(case, outcome)| Some((*case, outcome.as_ref()?)))
    }

    /// How many reach the true goal without a contact, of how many.
    fn reached(&self, policy: PolicyKind) -> [usize; 2] {
        let own: Vec<_> =
            self.outcomes(None).filter(|(case, _)| case.compared.policy == policy).collect();
        let reached = own.iter().filter(|(case, outcome)| {
            let [metres, _] = case.experiment.tolerance(case.conditions.scale);
            outcome.goal_error_m <= metres && !outcome.collided()
        });
        [reached.count(), own.len()]
    }

    fn panel(&self, skill: usize) -> Panel {
        let set = &self.skills[skill];
        let demonstrated = || flat_path(&set.demonstrations[0].poses);
        let own: Vec<_> = self.outcomes(Some(skill)).collect();
        let goals = own.iter().flat_map(|(_, outcome)| outcome.goals.iter().map(|p| p.truncate()));
        let mut panel = panel(&set.name, demonstrated().chain(goals));
        panel.line(demonstrated(), &DEMONSTRATED);
        for (case, outcome) in &own {
            let policy = case.compared.policy;
            if policy == PolicyKind::Canonical
                && let Some(last) = outcome.goals.last()
            {
                panel.line(outcome.goals.iter().map(|goal| goal.truncate()), &CIRCLE);
                ball(&mut panel, case, *last);
                panel.star(last.truncate());
            }
            panel.line(flat_path(&outcome.path), &stroke(policy));
            if let Some(end) = outcome.path.last() {
                panel.dot(end.position.truncate(), 3.0, stroke(policy).colour);
            }
        }
        panel
    }
}

/// The ball, when there is one, for where the goal is.
fn ball(panel: &mut Panel, case: &Case, goal: DVec3) {
    let Some(ball) = case.conditions.ball else { return };
    let demonstrated = MovingPose::at_rest(case.conditions.frames[1]);
    let shift = (goal - case.conditions.goal(&demonstrated).position) * 0.5;
    let ring = (0..=60).map(|i| {
        let angle = f64::from(i) / 60.0 * std::f64::consts::TAU;
        (ball.center + shift).truncate() + DVec2::from_angle(angle) * ball.radius_m
    });
    panel.line(ring, &BALL);
}
