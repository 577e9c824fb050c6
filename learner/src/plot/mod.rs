//! Pictures of a learned skill, as SVG files and a page that shows them all.
//!
//! Demonstrations are read again and have to be those the model was learned from. Fields are drawn
//! as they act on the robot, in its base frame, for an inertia of 1 kg at the goal: both kinds of
//! policy are asked by [`Learned`](crate::certify::policy::Learned). The canonical coordinates are themselves a
//! place where the frames can be: their mean poses.

pub mod field;
mod figures;
mod forces;
pub mod scene;

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use tprmp_model::skill_model::{
    self, EvaluationError, Manifold, ModelError, SkillModel, sha256_hex,
};
use tprmp_rmpflow::policy::canonical::frame_map::Canonical;
use tprmp_spatial::Pose;

use crate::canonical::PhaseProfile;
use crate::canonical::{self, mean_pose};
use crate::demonstration::{self, Demonstration};
use crate::file_error::FileError;
use crate::mixture::components::Choice;
use figures::{OrientationBand, SeenFromFrame, Shown};
use scene::{Scene, Skill, position_part};
use tprmp_drawing::{Ellipsoid, Figure, Page, Picture, Scale};

/// How far frames are moved in the pictures of adaptation, in fractions of the way from start to goal:
/// the start frame to the side, the goal frame on and to the other side.
const START_ASIDE: f64 = 0.25;
const GOAL_ON: f64 = 0.15;
const GOAL_ASIDE: f64 = -0.25;
/// How far the goal frame is turned about z [°].
const GOAL_TURN_DEG: f64 = 30.0;
/// A demonstration is at rest within this fraction of its extent around its first and last point.
const REST_FRACTION: f64 = 1e-3;

/// Draws a model into a folder, which is made when it is missing. Returns the files: pictures, and
/// last the page that shows them all. The same input gives the same bytes.
///
/// # Errors
/// [`PlotError`]: the model is refused, `demonstrations` lacks a file that the model was learned
/// from or holds another version of it, or the folder cannot be written.
pub fn plot(model: &Path, demonstrations: &Path, out: &Path) -> Result<Vec<PathBuf>, PlotError> {
    let file = model;
    let model = skill_model::read(file)?;
    let shown = read_demonstrations(&model, demonstrations)?;
    let position = position_part(&model);
    let skill = Skill::new(&model, &position)
        .map_err(|error| FileError::key(file, "policy", error.to_string()))?;
    let pictures = pictures(&skill, &shown);

    let write = |name: &str, text: &str| {
        let path = out.join(name);
        std::fs::write(&path, text)
            .map_err(|source| FileError::Write { path: path.clone(), source })?;
        Ok::<_, FileError>(path)
    };
    std::fs::create_dir_all(out).map_err(|source| FileError::Write { path: out.into(), source })?;
    let mut paths = Vec::with_capacity(pictures.len() + 1);
    for picture in &pictures {
        paths.push(write(&format!("{}.svg", picture.name), &picture.svg)?);
    }
    let mut page = page_head(&model);
    page.pictures(&pictures);
    paths.push(write("index.html", &page.html())?);
    Ok(paths)
}

/// The choice of the number of Gaussians as an SVG document.
#[must_use]
pub fn choice(choice: &Choice) -> String {
    figures::choice(choice).svg()
}

/// Why nothing is drawn.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// The demonstrations, or the folder of pictures.
    #[error(transparent)]
    File(#[from] FileError),
    /// The model file.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Reads the demonstrations a model was learned from.
fn read_demonstrations(model: &SkillModel, folder: &Path) -> Result<Vec<Demonstration>, FileError> {
    let read = |source: &skill_model::Source| {
        let path = folder.join(&source.file);
        let fail = |problem: String| FileError::Input {
            path: path.clone(),
            place: format!("from which the model `{}` was learned", model.skill),
            problem,
        };
        if !path.is_file() {
            return Err(fail("expected this file, found none".into()));
        }
        let bytes = std::fs::read(&path)
            .map_err(|source| FileError::Read { path: path.clone(), source })?;
        let found = sha256_hex(&bytes);
        if found != source.sha256 {
            let expected = &source.sha256;
            return Err(fail(format!(
                "expected the SHA-256 {expected}, found {found}: it is not the file the model was \
                 learned from, or it has changed since"
            )));
        }
        let shown = demonstration::read(&path, &model.start_frame, &model.goal_frame)?;
        match model.frames.iter().find(|frame| frame_of(model, &shown, &frame.name).is_none()) {
            Some(frame) => Err(fail(format!("expected a frame `{}`, found none", frame.name))),
            None => Ok(shown),
        }
    };
    model.provenance.demonstrations.iter().map(read).collect()
}

/// The named frame of a demonstration.
pub fn frame_of(model: &SkillModel, shown: &Demonstration, name: &str) -> Option<Pose> {
    match name {
        _ if name == model.goal_frame => Some(shown.goal_frame),
        _ if name == model.start_frame => Some(shown.start),
        _ => shown.other_frames.get(name).copied(),
    }
}

/// A model's frames in its order, each with its poses in all demonstrations.
fn shown_frames<'a>(model: &'a SkillModel, shown: &[Demonstration]) -> Vec<(&'a str, Vec<Pose>)> {
    let poses = |name| shown.iter().filter_map(|d| frame_of(model, d, name)).collect();
    model.frames.iter().map(|frame| (frame.name.as_str(), poses(&frame.name))).collect()
}

/// The pictures of a model.
///
/// # Errors
/// When the model cannot be evaluated.
pub fn gallery(
    model: &SkillModel,
    shown: &[Demonstration],
) -> Result<Vec<Picture>, EvaluationError> {
    let position = position_part(model);
    Ok(pictures(&Skill::new(model, &position)?, shown))
}

/// The position parts of a model's Gaussians in canonical coordinates.
pub fn gaussians(model: &SkillModel) -> Vec<Ellipsoid> {
    let dimension = model.manifold.position_dimension();
    let ellipsoid =
        |g: &skill_model::Gaussian| Ellipsoid::new(dimension, &g.mean, &g.covariance, g.phase);
    model.gaussians.iter().map(ellipsoid).collect()
}

fn pictures(skill: &Skill, shown: &[Demonstration]) -> Vec<Picture> {
    let (model, planar) = (skill.model, skill.planar());
    let frames = shown_frames(model, shown);
    let names: Vec<&str> = frames.iter().map(|(name, _)| *name).collect();
    let profile = profile(model, shown);
    let paths: Vec<Vec<Canonical>> = (0..shown.len())
        .map(|i| {
            let frames: Vec<Pose> = frames.iter().map(|(_, poses)| poses[i]).collect();
            canonical_path(skill, &profile, &shown[i], &frames)
        })
        .collect();
    let dimension = model.manifold.position_dimension();
    let gaussians = gaussians(model);
    let home_frames = home(skill, &frames);
    let scene = |frames| Scene::new(skill, frames, &paths, &gaussians, &profile);
    let at_home = scene(home_frames.clone());

    let mut pictures = Vec::new();
    let mut add = |name: &str, figure: Figure, caption: String| {
        pictures.push(Picture { name: name.into(), svg: figure.svg(), caption });
    };
    add(
        "demonstrations",
        figures::demonstrations(planar, shown, &frames),
        format!(
            "The {} demonstrations and their {} {}, in the robot's base frame.",
            shown.len(),
            if names.len() == 1 { "frame" } else { "frames" },
            names.iter().map(|name| format!("“{name}”")).collect::<Vec<_>>().join(", ")
        ),
    );
    let placed: Vec<(&str, Pose)> = names.iter().copied().zip(home_frames.clone()).collect();
    add(
        "gaussians",
        figures::gaussians(planar, &placed, &paths, &gaussians),
        format!(
            "The K = {} Gaussians of the mixture in canonical coordinates, in which all \
             demonstrations share their frames: ellipses at two standard deviations{}.",
            gaussians.len(),
            if planar { "" } else { ", the outlines of the ellipsoids" }
        ),
    );
    for (i, (mixture, (name, poses))) in model.frames.iter().zip(&frames).enumerate() {
        let gaussians = mixture.gaussians.iter().zip(&gaussians);
        let seen = SeenFromFrame {
            name: (*name).into(),
            paths: shown.iter().zip(poses).map(|(d, frame)| from_frame(d, frame)).collect(),
            gaussians: gaussians
                .map(|(g, same)| {
                    Ellipsoid::new(dimension, &g.position_m, &g.covariance, same.phase)
                })
                .collect(),
        };
        let caption = format!(
            "What the frame “{name}” sees, demonstrations and Gaussians at two standard deviations: \
             where they are narrow the skill is fixed to it, where they are wide to another frame."
        );
        add(&format!("seen-from-frame-{}", i + 1), figures::seen_from(planar, &seen), caption);
    }

    let home = Shown::new(&at_home);
    let in_slice = if planar { "" } else { "; the part of it that lies in the slice" };
    let where_home = "with the frames at their mean poses";
    add_fields(&mut add, "", "", where_home, model.manifold, &home);
    add(
        "natural-gradient",
        home.arrows(
            "Natural gradient −M⁻¹∇Φ",
            if planar { "|M⁻¹∇Φ| [m/s²]" } else { "in the slice [m/s²]" },
            |sample| sample.acceleration,
        ),
        format!(
            "The acceleration at rest: the negative gradient of Φ warped by the Riemannian metric M{in_slice}."
        ),
    );
    add(
        "gradient",
        home.arrows(
            "Plain gradient −∇Φ",
            if planar { "|∇Φ| [N]" } else { "in the slice [N]" },
            |sample| sample.force,
        ),
        format!(
            "The force at rest for an inertia of 1 kg at the goal, before the metric warps it{in_slice}."
        ),
    );
    if let Some(forces) = at_home.forces() {
        let caption = "Coloured by phase: where one component weighs more than all others. Arrows at the \
                       means: what each component adds to −∇Φ at the dot, attraction to \
                       its own minimum and the nominal force along the order of the components; at the \
                       dot their sums.";
        add("forces", home.forces(&forces), caption.into());
    }
    if let Some(figure) = orientation(&at_home, &home, &paths, shown) {
        let caption = "Components of the rotation vector r at the goal, q = q_goal exp(r), over the \
                       phase: demonstrations from their first to their last motion, rollouts from \
                       their starts, and the Gaussians with two standard deviations.";
        add("orientation", figure, caption.into());
    }
    for (name, frames, moved) in displaced(skill, &home_frames) {
        let scene = scene(frames);
        let shown = Shown::new(&scene);
        let (file, title) = (format!("{name}-moved-"), format!(", {name} frame moved"));
        add_fields(&mut add, &file, &title, &moved, model.manifold, &shown);
    }
    pictures
}

/// Potential and dissipation in a scene.
fn add_fields(
    add: &mut impl FnMut(&str, Figure, String),
    file: &str,
    title: &str,
    scene: &str,
    manifold: Manifold,
    shown: &Shown,
) {
    let dimension = manifold.position_dimension();
    let slices = match manifold {
        Manifold::R2 => "",
        Manifold::R3 => "; slices through the goal, paths projected onto them",
        Manifold::R3S3 => {
            "; slices through the goal with the tool turned as there, paths projected onto them"
        }
    };
    add(
        &format!("{file}potential"),
        shown.contours(
            &format!("Potential Φ{title}"),
            |sample| sample.potential,
            |values| Scale::areas_of_roots(values, "Φ [J]"),
        ),
        format!(
            "The potential Φ above that of the goal, in steps that grow with it, for an inertia of 1 kg \
             there, {scene}, and rollouts from rest{slices}."
        ),
    );
    add(
        &format!("{file}dissipation"),
        shown.contours(
            &format!("Dissipation B{title}"),
            |sample| sample.damping,
            |values| Scale::areas_of_ratios(values, &format!("tr B / {dimension} [kg/s]")),
        ),
        format!(
            "The mean eigenvalue of the damping matrix B, for an inertia of 1 kg at the goal, \
             {scene}: the power ẋᵀBẋ that is taken out at 1 m/s, in the mean of all \
             directions{slices}."
        ),
    );
}

/// The poses of a demonstration between its rests, with these frames, in canonical coordinates.
fn canonical_path(
    skill: &Skill,
    profile: &PhaseProfile,
    shown: &Demonstration,
    frames: &[Pose],
) -> Vec<Canonical> {
    let transforms = skill.displacement(frames);
    let moving = moving(&shown.poses);
    let mut path =
        canonical::canonical_path(&skill.map, &transforms, profile, &shown.poses[moving]);
    if !shown.manifold.has_orientation() {
        path.iter_mut().for_each(|y| y.rotation = DVec3::ZERO);
    }
    path
}

/// How the phase runs in these demonstrations.
fn profile(model: &SkillModel, shown: &[Demonstration]) -> PhaseProfile {
    let duration = |d: &Demonstration| (moving(&d.poses).len() - 1) as f64 * d.sampling_time_s;
    let mean_s = shown.iter().map(duration).sum::<f64>() / shown.len() as f64;
    match &model.policy {
        skill_model::Policy::Canonical { position, .. } => {
            PhaseProfile::damped(mean_s, position.damping_1_s)
        }
        skill_model::Policy::Thesis(_) => PhaseProfile::linear(),
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
fn from_frame(shown: &Demonstration, frame: &Pose) -> Vec<DVec3> {
    let inverse = frame.inverse();
    shown.poses.iter().map(|pose| inverse.compose(pose).position).collect()
}

/// The frames where all demonstrations share them: in canonical coordinates, or in the mean.
fn home(skill: &Skill, frames: &[(&str, Vec<Pose>)]) -> Vec<Pose> {
    let anchors = skill.map.anchors();
    let place = |(index, (_, poses)): (usize, &(&str, Vec<Pose>))| {
        let anchor = anchors.iter().find(|anchor| anchor.index == index);
        anchor.map_or_else(|| mean_pose(poses), |anchor| anchor.frame)
    };
    frames.iter().enumerate().map(place).collect()
}

/// Frames to adapt to, each with its name and what it is: the start frame moved, where there is one,
/// and the goal frame moved and turned.
fn displaced(skill: &Skill, home: &[Pose]) -> Vec<(&'static str, Vec<Pose>, String)> {
    let start = DVec3::from_array(skill.model.canonical.start.position_m);
    let way = skill.map.goal().position - start;
    // Level, so that nothing is moved into the table.
    let on = way.with_z(0.0).normalize_or(DVec3::X);
    let way = skill.way();
    let aside = DVec3::Z.cross(on);
    let start_shift = aside * START_ASIDE * way;
    let goal_shift = (on * GOAL_ON + aside * GOAL_ASIDE) * way;
    let turn = DQuat::from_rotation_z(GOAL_TURN_DEG.to_radians());
    let metres = |shift: DVec3| format!("({:.2}, {:.2}) m in x and y", shift.x, shift.y);
    let goal_frame = usize::from(!skill.single_frame());
    let mut moved = Vec::new();
    if goal_frame > 0 {
        let mut frames = home.to_vec();
        frames[0].position += start_shift;
        let what = format!("with the start frame moved by {}", metres(start_shift));
        moved.push(("start", frames, what));
    }
    let mut frames = home.to_vec();
    frames[goal_frame].position += goal_shift;
    frames[goal_frame].orientation = turn * frames[goal_frame].orientation;
    let what = format!(
        "with the goal frame moved by {} and turned by {GOAL_TURN_DEG}° about z",
        metres(goal_shift)
    );
    moved.push(("goal", frames, what));
    moved
}

/// Orientation over phase, for skills that have one.
fn orientation(
    scene: &Scene,
    shown: &Shown,
    paths: &[Vec<Canonical>],
    demonstrations: &[Demonstration],
) -> Option<Figure> {
    let model = scene.skill.model;
    if !model.manifold.has_orientation() {
        return None;
    }
    let durations = paths
        .iter()
        .zip(demonstrations)
        .map(|(path, d)| (path.len() - 1) as f64 * d.sampling_time_s);
    let duration_s = durations.sum::<f64>() / paths.len() as f64;
    let first = model.manifold.position_dimension();
    let bands: Vec<OrientationBand> = model
        .gaussians
        .iter()
        .map(|g| OrientationBand {
            phase: g.phase,
            mean: DVec3::from_slice(&g.mean[first..]),
            deviations: DVec3::from_array(std::array::from_fn(|i| {
                g.covariance[first + i][first + i].sqrt()
            })),
        })
        .collect();
    Some(figures::orientation(paths, shown.rollouts(), &scene.goal, &bands, duration_s))
}

/// What the page says before its pictures.
fn page_head(model: &SkillModel) -> Page {
    let mut page = Page::new(&format!("Skill “{}”", model.skill));
    page.paragraph(&format!(
        "{manifold}, from “{start}” to a goal fixed to “{goal}”; {count} demonstrations, K = \
         {components} Gaussians; learned by version {version}, seed {seed}.",
        manifold = model.manifold,
        start = model.start_frame,
        goal = model.goal_frame,
        count = model.provenance.demonstrations.len(),
        components = model.gaussians.len(),
        version = model.provenance.tool_version,
        seed = model.provenance.seed,
    ));
    let failures = &model.certificate.failures;
    let holds = failures.is_empty();
    page.verdict(
        Some(holds),
        if holds { "Its certificate holds." } else { "Its certificate fails:" },
    );
    page.list(failures);
    page
}
