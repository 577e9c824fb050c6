//! From files to a loop that is ready to run, or a clear error.

use std::path::{Path, PathBuf};

use thiserror::Error;
use tprmp_messages::{
    ControllerPorts, FRAME_CAPACITY, Instance, NAME_CAPACITY, Reason, ServiceError, name_bytes,
};
use tprmp_model::controller_config::{
    self, ConfigError, ControlPoint, ControllerConfig, Moves, Robot, StartFrame, Supervision,
};
use tprmp_model::skill_model::{self, Manifold, ModelError, SkillModel};
use tprmp_rmpflow::policy::SkillPolicy;
use tprmp_robot::{
    CONTROL_POINT_CAPACITY, Chain, ControlPointError, ControlPoints, Document, UrdfError,
};

use crate::control::requests::Setting;
use crate::control::server::{Replacement, Shared};
use crate::control::supervisor::{can_latch, named};
use crate::cycle::Cycle;
use crate::freedom::Freedom;
use crate::inputs::scene::Scene;
use crate::motion::limits::working_range;
use crate::policy::RobotPolicy;
use crate::timing::pacing::Pacing;

/// Why the controller does not start.
#[derive(Debug, Error)]
pub enum StartError {
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The robot's description.
    #[error(transparent)]
    Urdf(#[from] UrdfError),
    /// The robot's collision shapes.
    #[error("`{urdf}`: {source}")]
    ControlPoints {
        /// The robot's description.
        urdf: PathBuf,
        /// What is wrong.
        source: ControlPointError,
    },
    /// Shared memory.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// A key of the configuration does not fit the robot or the models.
    #[error("configuration `{config}`, key `{key}`: expected {expected}, found {found}")]
    Key {
        /// The configuration.
        config: PathBuf,
        /// The key.
        key: &'static str,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// The model failed its certificate.
    #[error(
        "model `{model}`, key `certificate.failures`: expected none, found {failure}; learn it again, \
         or run it all the same with --allow-uncertified"
    )]
    Uncertified {
        /// The model.
        model: PathBuf,
        /// The first failure.
        failure: String,
    },
    /// The model was learned for something else.
    #[error(
        "model `{model}`, key `{key}`: the skill was learned for {found}, this robot's configuration \
         `{config}` has {expected}"
    )]
    Mismatch {
        /// The model.
        model: PathBuf,
        /// The key that does not fit.
        key: &'static str,
        /// What the model has.
        found: String,
        /// The configuration.
        config: PathBuf,
        /// What the robot has.
        expected: String,
    },
}

impl StartError {
    fn key(
        config: &Path,
        key: &'static str,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        let (expected, found) = (expected.into(), found.to_string());
        Self::Key { config: config.into(), key, expected, found }
    }
}

/// A skill as it was learned, and in the form in which it is evaluated.
#[derive(Debug)]
pub struct LoadedSkill {
    /// Its file.
    pub path: PathBuf,
    /// The model.
    pub model: SkillModel,
    /// The policies of its modes, the first one's first.
    pub modes: Vec<SkillPolicy>,
    /// What they move of the tool.
    pub manifold: Manifold,
}

impl LoadedSkill {
    /// How many of the model's frames its modes need, the first ones.
    #[must_use]
    pub fn frame_count(&self) -> usize {
        self.modes.iter().map(SkillPolicy::frame_count).max().unwrap_or(0)
    }

    /// The frames that its modes need, and whether each of them is where the tool is when the skill starts.
    pub fn frames(
        &self,
        start_frame: StartFrame,
    ) -> impl Iterator<Item = ([u8; NAME_CAPACITY], bool)> {
        let Self { model, .. } = self;
        let own_start = start_frame == StartFrame::Tool && model.start_frame != model.goal_frame;
        model.frames.iter().take(self.frame_count()).map(move |frame| {
            let name = name_bytes(&frame.name).expect("checked by `load`");
            (name, own_start && frame.name == model.start_frame)
        })
    }
}

/// Everything a run needs, validated.
#[derive(Debug)]
pub struct Loaded {
    /// The configuration.
    pub config: ControllerConfig,
    /// The skills; the first is the task.
    pub skills: Vec<LoadedSkill>,
}

impl Loaded {
    /// The policies of the skills' modes, for [`RobotPolicy::new`].
    #[must_use]
    pub fn policies(&self) -> Vec<Vec<SkillPolicy>> {
        self.skills.iter().map(|skill| skill.modes.clone()).collect()
    }
}

/// Reads and validates configuration and models, the task's first, and checks that they fit. A model
/// that failed its certificate is refused, unless `allow_uncertified`.
///
/// # Errors
/// [`StartError`]; nothing has moved.
pub fn load(
    config_path: &Path,
    model_paths: &[impl AsRef<Path>],
    allow_uncertified: bool,
) -> Result<Loaded, StartError> {
    load_with(config_path, |_| {}, model_paths, allow_uncertified)
}

/// As [`load`], with a configuration that `edit` changes.
///
/// # Errors
/// As [`load`].
pub fn load_with(
    config_path: &Path,
    edit: impl FnOnce(&mut ControllerConfig),
    model_paths: &[impl AsRef<Path>],
    allow_uncertified: bool,
) -> Result<Loaded, StartError> {
    let config = controller_config::read_with(config_path, edit)?;
    check_names(config_path, &config)?;
    load_skills(config_path, config, model_paths, allow_uncertified)
}

/// Reads and validates models for a configuration, the task's first.
///
/// # Errors
/// As [`load`].
pub fn load_skills(
    config_path: &Path,
    config: ControllerConfig,
    model_paths: &[impl AsRef<Path>],
    allow_uncertified: bool,
) -> Result<Loaded, StartError> {
    let further = config.additional_skills.len();
    if model_paths.len() != 1 + further {
        let expected = format!(
            "`--model` once for the task and once for each of the {further} further leaves"
        );
        let found = format!("it {} times", model_paths.len());
        return Err(StartError::key(config_path, "additional_skills", expected, found));
    }
    let leaves = core::iter::once(&config.skill).chain(&config.additional_skills);
    let skills: Vec<_> = (model_paths.iter().zip(leaves))
        .map(|(path, leaf)| {
            load_skill(config_path, &config, leaf.moves, path.as_ref(), allow_uncertified)
        })
        .collect::<Result<_, _>>()?;
    let frames: usize = skills.iter().map(LoadedSkill::frame_count).sum();
    if frames > FRAME_CAPACITY {
        let expected = format!("models of at most {FRAME_CAPACITY} frames together");
        return Err(StartError::key(config_path, "additional_skills", expected, frames));
    }
    if skills[0].model.motion.period_s().is_some() {
        // What follows upon a goal, or leads to it.
        for (key, is_set) in [
            ("approach", config.approach.is_some()),
            ("goal_attractor", config.goal_attractor.is_some()),
            ("lift", config.lift.is_some()),
        ] {
            if is_set {
                let expected = "none for a periodic skill, which goes round and has no goal";
                return Err(StartError::key(config_path, key, expected, "one"));
            }
        }
    }
    let joints = config.robot.joints.len();
    let dimension = skills.iter().map(|skill| skill.manifold.moved().len()).max().unwrap_or(0);
    if dimension < joints && config.joint_damping.inertia <= 0.0 {
        let expected = format!(
            "a number above zero, since the robot has {joints} joints and the skill decides about only \
             {dimension} of their freedoms"
        );
        return Err(StartError::key(config_path, "joint_damping.inertia", expected, "zero"));
    }
    Ok(Loaded { config, skills })
}

/// Reads a model and checks that it fits the configuration.
fn load_skill(
    config_path: &Path,
    config: &ControllerConfig,
    moves: Moves,
    model_path: &Path,
    allow_uncertified: bool,
) -> Result<LoadedSkill, StartError> {
    let model = skill_model::read(model_path)?;
    if let (Some(first), false) = (model.failures().first(), allow_uncertified) {
        return Err(StartError::Uncertified { model: model_path.into(), failure: first.clone() });
    }
    let mismatch = |key, found: String, expected: String| StartError::Mismatch {
        model: model_path.into(),
        key,
        found,
        config: config_path.into(),
        expected,
    };
    if model.tool_frame != config.robot.tool_frame() {
        return Err(mismatch(
            "tool_frame",
            format!("the tool frame `{}`", model.tool_frame),
            format!(
                "`{}`; where the URDF has no link for that tool, `robot.tool_offset` says where it is",
                config.robot.tool_frame()
            ),
        ));
    }
    for name in model.frames.iter().map(|frame| &frame.name) {
        if name_bytes(name).is_err() {
            return Err(mismatch(
                "frames",
                format!("a frame named `{name}`"),
                format!("messages with names of 1 to {NAME_CAPACITY} bytes"),
            ));
        }
    }
    let mut modes = Vec::new();
    for mode in model.modes() {
        let policy = mode.policy().map_err(|error| {
            mismatch("policy", format!("a policy where {error}"), "a loop that evaluates it".into())
        })?;
        skill_model::verify(mode, &policy, model_path)?;
        modes.push(match moves {
            Moves::Whole => policy,
            Moves::Position => policy.position_only().ok_or_else(|| {
                let found = format!("a skill on {}", model.manifold);
                let expected = "Whole: `skill.moves: Position` is for canonical skills on R3xS3";
                mismatch("manifold", found, expected.into())
            })?,
        });
    }
    let manifold = match moves {
        Moves::Whole => model.manifold,
        Moves::Position => Manifold::R3,
    };
    Ok(LoadedSkill { path: model_path.into(), model, modes, manifold })
}

/// The robot of a configuration.
///
/// # Errors
/// When the URDF is wrong, or is not of the joints and links that the configuration names.
pub fn robot<const N: usize>(
    config_path: &Path,
    config: &ControllerConfig,
) -> Result<(Chain<N>, ControlPoints), StartError> {
    robot_of(config_path, config, &Document::read(&config.robot.urdf)?)
}

/// As [`robot`], of a description that was read.
///
/// # Errors
/// As [`robot`].
pub fn robot_of<const N: usize>(
    config_path: &Path,
    config: &ControllerConfig,
    document: &Document,
) -> Result<(Chain<N>, ControlPoints), StartError> {
    let urdf = &config.robot.urdf;
    let chain = Chain::<N>::from_document(document, &config.selection())?;
    if chain.joint_names()[..] != config.robot.joints[..] {
        return Err(joints_error(config_path, &config.robot, format!("{:?}", chain.joint_names())));
    }
    let [lower, upper] = working_range(&chain, &config.robot);
    for (i, joint) in chain.joint_names().iter().enumerate() {
        let (lower, upper) = (lower[i], upper[i]);
        if lower >= upper {
            let keys = "robot.position_margin` and `robot.working_range";
            let found = format!("[{lower}, {upper}] for joint `{joint}`");
            return Err(StartError::key(config_path, keys, "room for every joint", found));
        }
    }
    let links: Vec<_> = chain.moving_links().iter().map(|(name, _)| name).collect();
    for exemption in config.collision.iter().flat_map(|c| &c.exempt) {
        if !links.contains(&&exemption.link) {
            let expected = format!("a moving link of `{}`, {links:?}", urdf.display());
            let found = format!("`{}`", exemption.link);
            return Err(StartError::key(config_path, "collision.exempt", expected, found));
        }
    }
    let points = match &config.robot.control_points {
        None => ControlPoints::new(&chain),
        Some(list) => {
            let sphere = |p: &ControlPoint| (p.link.clone(), p.position_m.into(), p.radius_m);
            ControlPoints::listed(&chain, &list.iter().map(sphere).collect::<Vec<_>>())
        }
    };
    let points =
        points.map_err(|source| StartError::ControlPoints { urdf: urdf.clone(), source })?;
    let gripped = config.gripped.as_ref().map_or(0, |gripped| gripped.spheres.len());
    let room = CONTROL_POINT_CAPACITY - points.as_slice().len();
    if gripped > room {
        let expected = format!("at most {room}, so many as the arm's own spheres leave");
        return Err(StartError::key(config_path, "gripped.spheres", expected, gripped));
    }
    check_kept_clear(config_path, config, &uncovered_links(&chain, document, &points), &links)?;
    Ok((chain, points))
}

/// The moving links that have collision shapes and no control points.
#[must_use]
pub fn uncovered_links<'a, const N: usize>(
    chain: &'a Chain<N>,
    document: &Document,
    points: &ControlPoints,
) -> Vec<&'a str> {
    let links = chain.moving_links().iter().enumerate();
    // Those of the file: the chain does not have them where it has control points.
    let has_shape = |name: &str| {
        document.links.iter().any(|link| link.name == name && !link.collisions.is_empty())
    };
    let has_points = |link: usize| points.as_slice().iter().any(|point| point.link == link);
    let uncovered = links.filter(|(link, (name, _))| has_shape(name) && !has_points(*link));
    uncovered.map(|(_, (name, _))| name.as_str()).collect()
}

/// Where the arm keeps clear of anything, each link does that has a shape, or is exempt.
fn check_kept_clear(
    config_path: &Path,
    config: &ControllerConfig,
    uncovered: &[&str],
    links: &[&String],
) -> Result<(), StartError> {
    let exempt = &config.robot.not_kept_clear;
    let wrong: Vec<_> = exempt.iter().filter(|name| !links.contains(name)).collect();
    if !wrong.is_empty() {
        let expected = format!("moving links, {links:?}");
        return Err(StartError::key(
            config_path,
            "robot.not_kept_clear",
            expected,
            format!("{wrong:?}"),
        ));
    }
    let found: Vec<_> =
        uncovered.iter().filter(|link| !exempt.iter().any(|e| e == *link)).collect();
    if found.is_empty() || (config.collision.is_none() && config.self_collision.is_none()) {
        return Ok(());
    }
    let expected = "control points for each link that has collision shapes (`controller cover` finds them), or the \
                    links that need none in `robot.not_kept_clear`";
    let found = format!("none for {found:?}: not kept clear");
    Err(StartError::key(config_path, "robot.control_points", expected, found))
}

fn joints_error(config: &Path, robot: &Robot, described: String) -> StartError {
    let expected = format!(
        "the joints that `{}` has between its root and `{}`, {described}",
        robot.urdf.display(),
        robot.tool_link
    );
    StartError::key(config, "robot.joints", expected, format!("{:?}", robot.joints))
}

/// What is done with a robot of N joints: lets a number of joints that is read at run time choose
/// among compile-time sizes.
pub trait WithRobot {
    /// What comes out.
    type Output;
    /// Does it.
    fn call<const N: usize>(self) -> Self::Output;
}

/// Calls `work` with the number of joints of the configuration's robot.
///
/// # Errors
/// When the URDF is wrong or has another number of joints than the configuration names.
pub fn with_robot<W: WithRobot>(
    config_path: &Path,
    config: &ControllerConfig,
    work: W,
) -> Result<W::Output, StartError> {
    with_robot_of(config_path, config, &Document::read(&config.robot.urdf)?, work)
}

/// As [`with_robot`], of a description that was read.
///
/// # Errors
/// As [`with_robot`].
pub fn with_robot_of<W: WithRobot>(
    config_path: &Path,
    config: &ControllerConfig,
    document: &Document,
    work: W,
) -> Result<W::Output, StartError> {
    let count = document.count_joints(&config.selection())?;
    with_joints(count, work)
        .ok_or_else(|| joints_error(config_path, &config.robot, format!("{count} joints")))
}

/// Calls `work` with a number of joints; `None` where it is out of range.
pub fn with_joints<W: WithRobot>(count: usize, work: W) -> Option<W::Output> {
    Some(match count {
        2 => work.call::<2>(),
        3 => work.call::<3>(),
        4 => work.call::<4>(),
        5 => work.call::<5>(),
        6 => work.call::<6>(),
        7 => work.call::<7>(),
        8 => work.call::<8>(),
        _ => return None,
    })
}

/// Builds the policy of skills on a robot, with all that belongs to it.
///
/// # Errors
/// [`StartError`].
pub fn replacement<const N: usize>(
    config_path: &Path,
    loaded: &Loaded,
) -> Result<Replacement<N>, StartError> {
    let Loaded { config, skills } = loaded;
    let (chain, points) = robot::<N>(config_path, config)?;
    check_freedom(config_path, &chain, loaded)?;
    let policy = RobotPolicy::new(chain, loaded.policies(), &points, config);
    let frames = skills.iter().flat_map(|skill| skill.frames(config.start_frame));
    let (names, at_tool) = frames.unzip();
    let task = &skills[0].model;
    let goal_frame = usize::from(task.goal_frame != task.start_frame);
    let ahead_s = config.robot.actuators.lag_s();
    let scene = Scene::new(names, goal_frame).starting_at_tool(at_tool).seen_ahead(ahead_s);
    Ok(Replacement { workspace: policy.workspace(), policy, scene })
}

/// Checks that the arm can do the skills.
///
/// # Errors
/// [`StartError::Mismatch`] of the first one for which its joints do not suffice, with what they suffice for.
pub fn check_freedom<const N: usize>(
    config_path: &Path,
    chain: &Chain<N>,
    loaded: &Loaded,
) -> Result<(), StartError> {
    let freedom = Freedom::of(chain, &working_range(chain, &loaded.config.robot));
    let beyond = |skill: &&LoadedSkill| !freedom.can_do(skill.manifold);
    let Some(skill) = loaded.skills.iter().find(beyond) else { return Ok(()) };
    Err(StartError::Mismatch {
        model: skill.path.clone(),
        key: "manifold",
        found: skill.manifold.to_string(),
        config: config_path.into(),
        expected: match skill.manifold {
            Manifold::R3S3 if freedom.can_do(Manifold::R3) => format!(
                "an arm that cannot do it: {freedom}; `skill.moves: Position` leaves the orientation to the arm"
            ),
            _ => format!("an arm that cannot do it: {freedom}"),
        },
    })
}

/// Builds the loop. The services are opened last: a controller that cannot run shows up nowhere.
///
/// # Errors
/// [`StartError`]; nothing has moved.
pub fn cycle<const N: usize>(
    config_path: &Path,
    loaded: &Loaded,
    pacing: Pacing,
    until_done: bool,
    instance: &Instance,
    shared: Shared,
) -> Result<Cycle<N>, StartError> {
    let config = &loaded.config;
    if until_done && loaded.skills[0].model.motion.period_s().is_some() {
        let expected = "a skill that ends, to leave once it is done";
        return Err(StartError::key(config_path, "--until-done", expected, "a periodic one"));
    }
    let replacement = replacement::<N>(config_path, loaded)?;
    shared.detail.name_joints(&config.robot.joints);
    let mut ports: ControllerPorts = instance.open_controller()?;
    if config.external.is_some() {
        ports.listen(instance)?;
    }
    Ok(Cycle::new(replacement, config, pacing, until_done, ports, shared))
}

/// Checks the names in a configuration that only this process knows.
///
/// # Errors
/// [`StartError::Key`].
pub fn check_names(config_path: &Path, config: &ControllerConfig) -> Result<(), StartError> {
    let Supervision { latching, settable, .. } = &config.supervision;
    let unknown = latching.iter().find(|name| !named(name).is_some_and(can_latch));
    if let Some(name) = unknown {
        let names = Reason::ALL.iter().filter(|reason| can_latch(**reason));
        let names: Vec<_> = names.map(|reason| format!("{reason:?}")).collect();
        let expected = format!("names among {}", names.join(", "));
        return Err(StartError::key(config_path, "supervision.latching", expected, name));
    }
    if let Some(key) = settable.keys().find(|key| Setting::of_key(key).is_none()) {
        let keys = Setting::ALL.map(Setting::key).join(", ");
        let expected = format!("keys among {keys}");
        return Err(StartError::key(config_path, "supervision.settable", expected, key));
    }
    let speed = Setting::PointSpeedMax.key();
    if settable.contains_key(speed) && config.robot.point_limits.is_none() {
        let expected = "limits, since `supervision.settable` names its speed";
        return Err(StartError::key(config_path, "robot.point_limits", expected, "None"));
    }
    Ok(())
}
