//! The pictures of a model, one after the other.

use glam::{DQuat, DVec3};
use tprmp_drawing::{Ellipsoid, Figure, Picture, Scale};
use tprmp_model::skill_model::{self, EvaluationError, GripperEvent, Manifold, SkillModel};
use tprmp_rmpflow::policy::canonical::frame_map::Canonical;
use tprmp_spatial::Pose;

use super::figures::{self, OrientationBand, SceneFigures, SeenFromFrame};
use super::scene::{Scene, Skill, position_part};
use crate::alignment::resample::between;
use crate::canonical::{self, PhaseProfile, mean_pose};
use crate::demonstration::Demonstration;

/// How far frames are moved in the pictures of adaptation, in fractions of the distance from start to goal:
/// the start frame to the side, the goal frame on and to the other side.
const START_ASIDE: f64 = 0.25;
const GOAL_ON: f64 = 0.15;
const GOAL_ASIDE: f64 = -0.25;
/// How far the goal frame is rotated about z \[°\].
const GOAL_ROTATION_DEG: f64 = 30.0;
/// A demonstration is at rest within this fraction of its extent around its first and last point.
const REST_FRACTION: f64 = 1e-3;

/// Steps of a demonstration at the common times.
const ALIGNED_STEPS: usize = 200;

/// What the pictures of a model are made of, and those made so far.
struct Gallery<'a> {
    skill: &'a Skill<'a>,
    demonstrations: &'a [Demonstration],
    /// The model's frames in its order, each with its poses in all demonstrations.
    frames: Vec<(&'a str, Vec<Pose>)>,
    /// The demonstrations in canonical coordinates.
    paths: Vec<Vec<Canonical>>,
    gaussians: Vec<Ellipsoid>,
    profile: PhaseProfile,
    pictures: Vec<Picture>,
}

/// The pictures of a model.
///
/// # Errors
/// When the model cannot be evaluated.
pub fn gallery(
    model: &SkillModel,
    demonstrations: &[Demonstration],
) -> Result<Vec<Picture>, EvaluationError> {
    let position = position_part(model);
    let skill = Skill::new(model, &position)?;
    let mut gallery = Gallery::new(&skill, demonstrations);
    let mean_frames = mean_frames(&skill, &gallery.frames);
    if model.manifold == Manifold::S3 {
        // Nothing moves but the orientation.
        let scene = gallery.scene(mean_frames);
        let starts: Vec<Pose> = scene.demonstrations.iter().map(|path| path[0]).collect();
        gallery.add_orientation(&scene, &scene.rollouts(&starts));
        return Ok(gallery.pictures);
    }
    gallery.add_demonstrations();
    if !model.motion.is_discrete() {
        gallery.add_round(&mean_frames);
        return Ok(gallery.pictures);
    }
    gallery.add_alignment();
    gallery.add_mixture(&mean_frames);
    gallery.add_policy(&mean_frames);
    for (name, frames, moved) in displaced(&skill, &mean_frames) {
        let scene = gallery.scene(frames);
        let (file, title) = (format!("{name}-moved-"), format!(", {name} frame moved"));
        gallery.add_fields(&file, &title, &moved, &SceneFigures::new(&scene));
    }
    Ok(gallery.pictures)
}

/// The demonstrations of all modes, seen from the goal frame.
pub(super) fn modes(model: &SkillModel, demonstrations: &[Vec<Demonstration>]) -> Picture {
    let paths: Vec<Vec<Vec<DVec3>>> = demonstrations
        .iter()
        .map(|mode| mode.iter().map(|d| from_frame(d, &d.goal_frame)).collect())
        .collect();
    let figure = figures::modes(model.manifold == Manifold::R2, &model.goal_frame, &paths);
    let caption = format!(
        "The demonstrations seen from the frame “{}”: each colour is a mode of its own.",
        model.goal_frame
    );
    Picture { name: "modes".into(), svg: figure.svg(), caption }
}

/// The position parts of a model's Gaussians in canonical coordinates.
pub fn gaussians(model: &SkillModel) -> Vec<Ellipsoid> {
    let dimension = model.manifold.position_dimension();
    let ellipsoid =
        |g: &skill_model::Gaussian| Ellipsoid::new(dimension, &g.mean, &g.covariance, g.phase);
    model.gaussians.iter().map(ellipsoid).collect()
}

/// The named frame of a demonstration.
pub fn frame_of(model: &SkillModel, demonstration: &Demonstration, name: &str) -> Option<Pose> {
    match name {
        _ if name == model.goal_frame => Some(demonstration.goal_frame),
        _ if name == model.start_frame => Some(demonstration.start),
        _ => demonstration.other_frames.get(name).copied(),
    }
}

impl<'a> Gallery<'a> {
    fn new(skill: &'a Skill<'a>, demonstrations: &'a [Demonstration]) -> Self {
        let model = skill.model;
        let poses = |name| demonstrations.iter().filter_map(|d| frame_of(model, d, name)).collect();
        let frames: Vec<(&str, Vec<Pose>)> =
            model.frames.iter().map(|frame| (frame.name.as_str(), poses(&frame.name))).collect();
        let profile = profile(model, demonstrations);
        let path = |(i, demonstration): (usize, &Demonstration)| {
            let frames: Vec<Pose> = frames.iter().map(|(_, poses)| poses[i]).collect();
            canonical_path(skill, &profile, demonstration, &frames)
        };
        let paths = demonstrations.iter().enumerate().map(path).collect();
        let (gaussians, pictures) = (gaussians(model), Vec::new());
        Self { skill, demonstrations, frames, paths, gaussians, profile, pictures }
    }

    fn add(&mut self, name: &str, figure: &Figure, caption: String) {
        self.pictures.push(Picture { name: name.into(), svg: figure.svg(), caption });
    }

    fn scene(&self, frames: Vec<Pose>) -> Scene<'a> {
        Scene::new(self.skill, frames, &self.paths, &self.gaussians, &self.profile)
    }

    fn add_demonstrations(&mut self) {
        let names: Vec<String> = self.frames.iter().map(|(name, _)| format!("“{name}”")).collect();
        let caption = format!(
            "The {} demonstrations and their {} {}, in the robot's base frame.",
            self.demonstrations.len(),
            if names.len() == 1 { "frame" } else { "frames" },
            names.join(", ")
        );
        let planar = self.skill.planar();
        let figure = figures::demonstrations(planar, self.demonstrations, &self.frames);
        self.add("demonstrations", &figure, caption);
    }

    /// The common time, and which frame speaks when: for models that know them.
    fn add_alignment(&mut self) {
        let SkillModel { fit, frames, .. } = self.skill.model;
        let known = fit.demonstrations.iter().all(|row| row.recorded_s.len() > 1);
        if !known || fit.agreement.is_empty() {
            return;
        }
        let caption = format!(
            "Time in each recording over the time that all have in common, {:.2} s; steep where \
             somebody was slower than the others, or paused.",
            fit.duration_s
        );
        self.add("alignment", &figures::alignment(&fit.demonstrations, fit.duration_s), caption);
        let caption = "How far the demonstrations lie apart at the same time, seen from each frame: where a \
                       frame's line is the lowest, the motion belongs to it. The map of all frames should lie \
                       near the lowest of them everywhere.";
        self.add("agreement", &figures::agreement(frames, &fit.agreement), caption.into());
    }

    /// Of a skill that goes round: how the rounds agree, its mixture, and its potential with rollouts that come to the
    /// limit cycle.
    fn add_round(&mut self, mean_frames: &[Pose]) {
        let SkillModel { fit, frames, .. } = self.skill.model;
        let caption =
            "How far the demonstrated rounds lie apart at the same phase, seen from the frame.";
        self.add("agreement", &figures::agreement(frames, &fit.agreement), caption.into());
        self.add_mixture(mean_frames);
        let scene = self.scene(mean_frames.to_vec());
        let figures = SceneFigures::new(&scene);
        let potential = figures.contours(
            "Potential Φ of a round",
            |sample| sample.potential,
            |values| Scale::areas_of_roots(values, "Φ [J]"),
        );
        let told = self.skill.model.cycle_line().unwrap_or_default();
        let caption = format!(
            "The potential Φ at the phase at which each point is most at home, for a mean inertia of 1 kg, and rollouts \
             from rest, which come to the limit cycle: {told}. Where a round ends and the next one begins the potential \
             goes on a step lower."
        );
        self.add("potential", &potential, caption);
    }

    /// The mixture in canonical coordinates, and as each frame sees it.
    fn add_mixture(&mut self, mean_frames: &[Pose]) {
        let (model, planar) = (self.skill.model, self.skill.planar());
        let names = self.frames.iter().map(|(name, _)| *name);
        let placed: Vec<(&str, Pose)> = names.zip(mean_frames.iter().copied()).collect();
        let figure = figures::gaussians(
            planar,
            &placed,
            &self.paths,
            &self.gaussians,
            &self.gripper_marks(),
        );
        let caption = format!(
            "The K = {} Gaussians of the mixture in canonical coordinates, in which all \
             demonstrations have their frames in common: ellipses at two standard deviations{}.{}",
            self.gaussians.len(),
            if planar { "" } else { ", the outlines of the ellipsoids" },
            self.gripper_text()
        );
        self.add("gaussians", &figure, caption);
        let dimension = model.manifold.position_dimension();
        for (i, mixture) in model.frames.iter().enumerate() {
            let (name, poses) = &self.frames[i];
            let paths = self.demonstrations.iter().zip(poses);
            let gaussians = mixture.gaussians.iter().zip(&self.gaussians).map(|(g, same)| {
                Ellipsoid::new(dimension, &g.position_m, &g.covariance, same.phase)
            });
            let seen = SeenFromFrame {
                name: (*name).into(),
                paths: paths.map(|(d, frame)| from_frame(d, frame)).collect(),
                gaussians: gaussians.collect(),
            };
            let caption = format!(
                "What the frame “{name}” sees, demonstrations and Gaussians at two standard \
                 deviations: where they are narrow the skill is fixed to it, where they are wide to \
                 another frame."
            );
            let figure = figures::seen_from(planar, &seen);
            self.add(&format!("seen-from-frame-{}", i + 1), &figure, caption);
        }
    }

    /// Where the gripper does something, on each demonstration.
    fn gripper_marks(&self) -> Vec<DVec3> {
        let at = |event: &GripperEvent| {
            let fraction = event.time_fraction;
            let place = move |path: &Vec<Canonical>| {
                path[(fraction * (path.len() - 1) as f64).round() as usize].position
            };
            self.paths.iter().map(place)
        };
        self.skill.model.gripper.iter().flat_map(at).collect()
    }

    /// What it does there.
    fn gripper_text(&self) -> String {
        let count = self.skill.model.provenance.demonstrations.len();
        let events = self.skill.model.gripper.iter();
        events.map(|event| format!(" The {}.", event.described(count))).collect()
    }

    /// The policy with the frames at their mean poses.
    fn add_policy(&mut self, mean_frames: &[Pose]) {
        let planar = self.skill.planar();
        let scene = self.scene(mean_frames.to_vec());
        let figures = SceneFigures::new(&scene);
        self.add_fields("", "", "with the frames at their mean poses", &figures);
        let in_slice = if planar { "" } else { "; the part of it that lies in the slice" };
        let label = if planar { "|M⁻¹∇Φ| [m/s²]" } else { "in the slice [m/s²]" };
        let figure =
            figures.arrows("Natural gradient −M⁻¹∇Φ", label, |sample| sample.acceleration);
        let caption = format!(
            "The acceleration at rest: the negative gradient of Φ warped by the Riemannian metric \
             M{in_slice}."
        );
        self.add("natural-gradient", &figure, caption);
        let label = if planar { "|∇Φ| [N]" } else { "in the slice [N]" };
        let figure = figures.arrows("Plain gradient −∇Φ", label, |sample| sample.force);
        let caption = format!(
            "The force at rest for an inertia of 1 kg at the goal, before the metric warps it{in_slice}."
        );
        self.add("gradient", &figure, caption);
        if let Some(forces) = scene.forces() {
            let caption = "Coloured by phase: where one component weighs more than all others. Arrows \
                           at the means: what each component adds to −∇Φ at the dot, attraction to \
                           its own minimum and the nominal force along the order of the components; \
                           at the dot their sums.";
            self.add("forces", &figures.forces(&forces), caption.into());
        }
        self.add_orientation(&scene, figures.rollouts());
    }

    fn add_orientation(&mut self, scene: &Scene, rollouts: &[Vec<Pose>]) {
        if let Some(figure) = self.orientation(scene, rollouts) {
            let caption = "Components of the rotation vector r at the goal, q = q_goal exp(r), over \
                           the phase: demonstrations from their first to their last motion, rollouts \
                           from their starts, and the Gaussians with two standard deviations.";
            self.add("orientation", &figure, caption.into());
        }
    }

    /// Potential and dissipation in a scene.
    fn add_fields(&mut self, file: &str, title: &str, scene: &str, figures: &SceneFigures) {
        let manifold = self.skill.model.manifold;
        let dimension = manifold.position_dimension();
        let slices = match manifold {
            Manifold::R2 => "",
            Manifold::R3 => "; slices through the goal, paths projected onto them",
            Manifold::R3S1 | Manifold::S3 | Manifold::R3S3 => {
                "; slices through the goal with the tool rotated as there, paths projected onto them"
            }
        };
        let potential = figures.contours(
            &format!("Potential Φ{title}"),
            |sample| sample.potential,
            |values| Scale::areas_of_roots(values, "Φ [J]"),
        );
        let caption = format!(
            "The potential Φ above that of the goal, in steps that grow with it, for an inertia of \
             1 kg there, {scene}, and rollouts from rest{slices}."
        );
        self.add(&format!("{file}potential"), &potential, caption);
        let dissipation = figures.contours(
            &format!("Dissipation B{title}"),
            |sample| sample.damping,
            |values| Scale::areas_of_ratios(values, &format!("tr B / {dimension} [kg/s]")),
        );
        let caption = format!(
            "The mean eigenvalue of the damping matrix B, for an inertia of 1 kg at the goal, \
             {scene}: the power ẋᵀBẋ that is taken out at 1 m/s, in the mean of all \
             directions{slices}."
        );
        self.add(&format!("{file}dissipation"), &dissipation, caption);
    }

    /// Orientation over phase, for skills that have one.
    fn orientation(&self, scene: &Scene, rollouts: &[Vec<Pose>]) -> Option<Figure> {
        let model = self.skill.model;
        if !model.manifold.has_orientation() {
            return None;
        }
        let duration_s = duration_s(model, self.demonstrations);
        let first = model.manifold.position_dimension();
        let band = |g: &skill_model::Gaussian| OrientationBand {
            phase: g.phase,
            mean: DVec3::from_slice(&g.mean[first..]),
            deviations: DVec3::from_array(std::array::from_fn(|i| {
                g.covariance[first + i][first + i].sqrt()
            })),
        };
        let bands: Vec<_> = model.gaussians.iter().map(band).collect();
        Some(figures::orientation(&self.paths, rollouts, &scene.goal, &bands, duration_s))
    }
}

/// The poses of a demonstration at the common times, with these frames, in canonical coordinates.
fn canonical_path(
    skill: &Skill,
    profile: &PhaseProfile,
    demonstration: &Demonstration,
    frames: &[Pose],
) -> Vec<Canonical> {
    let transforms = skill.displacement(frames);
    let poses = aligned(skill.model, demonstration);
    let mut path = canonical::canonical_path(&skill.map, &transforms, profile, &poses);
    if !demonstration.manifold.has_orientation() {
        path.iter_mut().for_each(|y| y.rotation = DVec3::ZERO);
    }
    path
}

/// The poses of a demonstration at equal steps of the common time, as the model knows it; between its
/// rests, when it does not.
fn aligned(model: &SkillModel, demonstration: &Demonstration) -> Vec<Pose> {
    let row = model.fit.demonstrations.iter().find(|row| row.name == demonstration.name);
    let Some(row) = row.filter(|row| row.recorded_s.len() > 1) else {
        return demonstration.poses[moving(&demonstration.poses)].to_vec();
    };
    let table = &row.recorded_s;
    let pose = |k: usize| {
        let place = k as f64 / ALIGNED_STEPS as f64 * (table.len() - 1) as f64;
        let i = (place as usize).min(table.len() - 2);
        let time_s = table[i] + (place - i as f64) * (table[i + 1] - table[i]);
        between(&demonstration.poses, time_s / demonstration.sampling_time_s)
    };
    (0..=ALIGNED_STEPS).map(pose).collect()
}

/// Duration of the demonstrations [s]: what they have in common, or in the mean.
fn duration_s(model: &SkillModel, demonstrations: &[Demonstration]) -> f64 {
    if model.fit.duration_s > 0.0 {
        return model.fit.duration_s;
    }
    let duration = |d: &Demonstration| (moving(&d.poses).len() - 1) as f64 * d.sampling_time_s;
    demonstrations.iter().map(duration).sum::<f64>() / demonstrations.len() as f64
}

/// How the phase runs in these demonstrations.
fn profile(model: &SkillModel, demonstrations: &[Demonstration]) -> PhaseProfile {
    match &model.policy {
        skill_model::PolicyModel::Canonical { position, .. } => {
            PhaseProfile::damped(duration_s(model, demonstrations), position.damping_1_s)
        }
        skill_model::PolicyModel::Thesis(_) => PhaseProfile::linear(),
    }
}

/// The poses between the rests before and after a motion.
fn moving(poses: &[Pose]) -> std::ops::Range<usize> {
    let last = poses.len() - 1;
    let apart = |a: &Pose, b: &Pose| (a.position - b.position).length();
    let far = poses.iter().map(|pose| apart(pose, &poses[0])).fold(0.0, f64::max) * REST_FRACTION;
    let first = poses.iter().position(|pose| apart(pose, &poses[0]) > far).unwrap_or(1) - 1;
    let end = poses.iter().rposition(|pose| apart(pose, &poses[last]) > far);
    let end = end.map_or(last, |i| i + 1).max(first + 1);
    first..end + 1
}

/// Positions of a demonstration in a frame [m].
fn from_frame(demonstration: &Demonstration, frame: &Pose) -> Vec<DVec3> {
    let inverse = frame.inverse();
    demonstration.poses.iter().map(|pose| inverse.compose(pose).position).collect()
}

/// The frames where all demonstrations share them: in canonical coordinates, or in the mean.
fn mean_frames(skill: &Skill, frames: &[(&str, Vec<Pose>)]) -> Vec<Pose> {
    let anchors = skill.map.anchors();
    let place = |(index, (_, poses)): (usize, &(&str, Vec<Pose>))| {
        let anchor = anchors.iter().find(|anchor| anchor.index == index);
        anchor.map_or_else(|| mean_pose(poses), |anchor| anchor.frame)
    };
    frames.iter().enumerate().map(place).collect()
}

/// Frames to adapt to, each with its name and what it is: the start frame moved, where there is one,
/// and the goal frame moved and rotated.
fn displaced(skill: &Skill, mean_frames: &[Pose]) -> Vec<(&'static str, Vec<Pose>, String)> {
    let start = DVec3::from_array(skill.model.canonical.start.position_m);
    let forward = skill.map.goal().position - start;
    // Level, so that nothing is moved into the table.
    let on = forward.with_z(0.0).normalize_or(DVec3::X);
    let extent = skill.way();
    let aside = DVec3::Z.cross(on);
    let start_shift = aside * START_ASIDE * extent;
    let goal_shift = (on * GOAL_ON + aside * GOAL_ASIDE) * extent;
    let rotation = DQuat::from_rotation_z(GOAL_ROTATION_DEG.to_radians());
    let metres = |shift: DVec3| format!("({:.2}, {:.2}) m in x and y", shift.x, shift.y);
    let goal_frame = usize::from(!skill.single_frame());
    let mut moved = Vec::new();
    if goal_frame > 0 {
        let mut frames = mean_frames.to_vec();
        frames[0].position += start_shift;
        let what = format!("with the start frame moved by {}", metres(start_shift));
        moved.push(("start", frames, what));
    }
    let mut frames = mean_frames.to_vec();
    frames[goal_frame].position += goal_shift;
    frames[goal_frame].orientation = rotation * frames[goal_frame].orientation;
    let what = format!(
        "with the goal frame moved by {} and rotated by {GOAL_ROTATION_DEG}° about z",
        metres(goal_shift)
    );
    moved.push(("goal", frames, what));
    moved
}
