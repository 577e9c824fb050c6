//! From files to a loop that is ready to run, or a clear error.

use std::path::{Path, PathBuf};

use thiserror::Error;
use tprmp_messages::{
    ControllerPorts, FRAME_CAPACITY, Instance, NAME_CAPACITY, ServiceError, name_bytes,
};
use tprmp_model::controller_config::{self, ConfigError, ControlPoint, ControllerConfig};
use tprmp_model::skill_model::{self, ModelError, SkillModel};
use tprmp_rmpflow::policy::SkillPolicy;
use tprmp_robot::{Chain, ControlPointError, ControlPoints, UrdfError, count_joints};

use crate::commands::soak::SoakError;
use crate::cycle::Cycle;
use crate::inputs::scene::Scene;
use crate::motion::limits::working_range;
use crate::policy::Policy;
use crate::timing::pacing::Pace;
use crate::timing::realtime::Refusal;

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
    /// The signal handlers.
    #[error("signal handlers cannot be installed: {0}")]
    Signals(std::io::Error),
    /// A required right is missing.
    #[error("key `real_time.required` names {:?}, which the system refuses: {_0}", _0.grant)]
    Refused(Refusal),
    /// There is nobody to look at.
    #[error("no controller runs on instance `{0}`: start one, or name its --instance")]
    NoController(String),
    /// A soak.
    #[error(transparent)]
    Soak(#[from] SoakError),
    /// The summary.
    #[error("summary `{path}` cannot be written: {source}")]
    Summary {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The joints of the robot are not those of the configuration.
    #[error(
        "configuration `{config}`, key `robot.joints`: expected the joints that `{urdf}` has between its root \
         and `{tool}`, {expected:?}, found {found:?}"
    )]
    Joints {
        /// The configuration.
        config: PathBuf,
        /// The robot's description.
        urdf: PathBuf,
        /// The tool's link.
        tool: String,
        /// Joints of the description.
        expected: Vec<String>,
        /// Joints of the configuration.
        found: Vec<String>,
    },
    /// Nothing says what the spare joints should do.
    #[error(
        "configuration `{config}`, key `joint_damping.inertia`: expected a number above zero, since the \
         robot has {joints} joints and the skill leads only {dimension} of their freedoms, found zero"
    )]
    Undetermined {
        /// The configuration.
        config: PathBuf,
        /// Joints of the robot.
        joints: usize,
        /// Dimension of the skill.
        dimension: usize,
    },
    /// More or fewer models than leaves for them.
    #[error(
        "configuration `{config}`, key `additional_skills`: expected `--model` once for the task and once \
         for each of the {expected} further leaves, found it {found} times"
    )]
    Models {
        /// The configuration.
        config: PathBuf,
        /// Entries of the key.
        expected: usize,
        /// Models.
        found: usize,
    },
    /// More frames than a message carries.
    #[error(
        "configuration `{config}`, key `additional_skills`: expected models of at most {FRAME_CAPACITY} \
         frames together, found {found}"
    )]
    Frames {
        /// The configuration.
        config: PathBuf,
        /// Frames of all models.
        found: usize,
    },
    /// The configuration leaves a joint no room.
    #[error(
        "configuration `{config}`, keys `robot.position_margin` and `robot.working_range`: expected \
         that they leave every joint room, found [{lower}, {upper}] for joint `{joint}`"
    )]
    NoRoom {
        /// The configuration.
        config: PathBuf,
        /// The joint.
        joint: String,
        /// Lower end of what is left \[rad or m\].
        lower: f64,
        /// Upper end of what is left \[rad or m\].
        upper: f64,
    },
    /// A link named in the configuration does not exist.
    #[error(
        "configuration `{config}`, key `collision.exempt`: expected a moving link of `{urdf}`, {expected:?}, \
         found `{found}`"
    )]
    Link {
        /// The configuration.
        config: PathBuf,
        /// The robot's description.
        urdf: PathBuf,
        /// Links of the description.
        expected: Vec<String>,
        /// Link of the configuration.
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

/// A skill as it was learned, and in the form in which it is evaluated.
#[derive(Debug)]
pub struct LoadedSkill {
    /// The model.
    pub model: SkillModel,
    /// The policy of the model.
    pub policy: SkillPolicy,
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
    /// The policies of the skills, for [`Policy::new`].
    #[must_use]
    pub fn policies(&self) -> Vec<SkillPolicy> {
        self.skills.iter().map(|skill| skill.policy.clone()).collect()
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
    if model_paths.len() != 1 + config.additional_skills.len() {
        return Err(StartError::Models {
            config: config_path.into(),
            expected: config.additional_skills.len(),
            found: model_paths.len(),
        });
    }
    let load = |path: &_| load_skill(config_path, &config, AsRef::as_ref(path), allow_uncertified);
    let skills: Vec<_> = model_paths.iter().map(load).collect::<Result<_, _>>()?;
    let frames: usize = skills.iter().map(|skill| skill.policy.frame_count()).sum();
    if frames > FRAME_CAPACITY {
        return Err(StartError::Frames { config: config_path.into(), found: frames });
    }
    let joints = config.robot.joints.len();
    let dimension = skills.iter().map(|skill| skill.model.manifold.dimension()).max().unwrap_or(0);
    if dimension < joints && config.joint_damping.inertia <= 0.0 {
        return Err(StartError::Undetermined { config: config_path.into(), joints, dimension });
    }
    Ok(Loaded { config, skills })
}

/// Reads a model and checks that it fits the configuration.
fn load_skill(
    config_path: &Path,
    config: &ControllerConfig,
    model_path: &Path,
    allow_uncertified: bool,
) -> Result<LoadedSkill, StartError> {
    let model = skill_model::read(model_path)?;
    if let (Some(first), false) = (model.certificate.failures.first(), allow_uncertified) {
        return Err(StartError::Uncertified { model: model_path.into(), failure: first.clone() });
    }
    let mismatch = |key, found: String, expected: String| StartError::Mismatch {
        model: model_path.into(),
        key,
        found,
        config: config_path.into(),
        expected,
    };
    if model.tool_frame != config.robot.tool_link {
        return Err(mismatch(
            "tool_frame",
            format!("the tool frame `{}`", model.tool_frame),
            format!("`{}`", config.robot.tool_link),
        ));
    }
    let joints = config.robot.joints.len();
    if model.manifold.dimension() > joints {
        return Err(mismatch(
            "manifold",
            format!("{} of dimension {}", model.manifold, model.manifold.dimension()),
            format!("{joints} joints"),
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
    let policy = model.policy().map_err(|error| {
        mismatch("policy", format!("a policy where {error}"), "a loop that evaluates it".into())
    })?;
    Ok(LoadedSkill { model, policy })
}

/// The robot of a configuration.
///
/// # Errors
/// When the URDF is wrong, or is not of the joints and links that the configuration names.
pub fn robot<const N: usize>(
    config_path: &Path,
    config: &ControllerConfig,
) -> Result<(Chain<N>, ControlPoints), StartError> {
    let urdf = &config.robot.urdf;
    let chain = Chain::<N>::from_urdf(urdf, config.robot.selection())?;
    if chain.joint_names()[..] != config.robot.joints[..] {
        return Err(StartError::Joints {
            config: config_path.into(),
            urdf: urdf.clone(),
            tool: config.robot.tool_link.clone(),
            expected: chain.joint_names().to_vec(),
            found: config.robot.joints.clone(),
        });
    }
    let [lower, upper] = working_range(&chain, &config.robot);
    for (i, joint) in chain.joint_names().iter().enumerate() {
        let (lower, upper) = (lower[i], upper[i]);
        if lower >= upper {
            let (config, joint) = (config_path.into(), joint.clone());
            return Err(StartError::NoRoom { config, joint, lower, upper });
        }
    }
    let links: Vec<String> = chain.moving_links().iter().map(|(name, _)| name.clone()).collect();
    for exemption in config.collision.iter().flat_map(|c| &c.exempt) {
        if !links.contains(&exemption.link) {
            return Err(StartError::Link {
                config: config_path.into(),
                urdf: urdf.clone(),
                expected: links,
                found: exemption.link.clone(),
            });
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
    Ok((chain, points))
}

/// What is done with a robot of N joints: lets a number of joints that is read at run time choose
/// among compile-time sizes.
pub trait WithRobot {
    /// What comes out.
    type Output;
    /// Does it.
    ///
    /// # Errors
    /// As the work itself.
    fn call<const N: usize>(self) -> Result<Self::Output, StartError>;
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
    let count = count_joints(&config.robot.urdf, config.robot.selection())?;
    match count {
        2 => work.call::<2>(),
        3 => work.call::<3>(),
        4 => work.call::<4>(),
        5 => work.call::<5>(),
        6 => work.call::<6>(),
        7 => work.call::<7>(),
        8 => work.call::<8>(),
        _ => Err(StartError::Joints {
            config: config_path.into(),
            urdf: config.robot.urdf.clone(),
            tool: config.robot.tool_link.clone(),
            expected: vec![format!("{count} joints")],
            found: config.robot.joints.clone(),
        }),
    }
}

/// Builds the loop. The services are opened last: a controller that cannot run shows up nowhere.
///
/// # Errors
/// [`StartError`]; nothing has moved.
pub fn cycle<const N: usize>(
    config_path: &Path,
    loaded: Loaded,
    pace: Pace,
    until_done: bool,
    instance: &Instance,
) -> Result<Cycle<N>, StartError> {
    let policies = loaded.policies();
    let Loaded { config, skills } = loaded;
    let (chain, points) = robot::<N>(config_path, &config)?;
    let policy = Policy::new(chain, policies, &points, &config);
    let frame_name = |name: &str| name_bytes(name).expect("checked by `load`");
    let names = skills.iter().flat_map(|skill| {
        let frames = skill.model.frames.iter().take(skill.policy.frame_count());
        frames.map(|frame| frame_name(&frame.name))
    });
    let task = &skills[0].model;
    let goal_frame = usize::from(task.goal_frame != task.start_frame);
    let scene = Scene::new(names.collect(), goal_frame);
    let mut ports: ControllerPorts = instance.open_controller()?;
    if config.external.is_some() {
        ports.listen()?;
    }
    Ok(Cycle::new(policy, scene, config, pace, until_done, ports))
}

/// Writes a summary of a run.
///
/// # Errors
/// When the file cannot be written.
pub fn write_summary(path: &Path, summary: &serde_json::Value) -> Result<(), StartError> {
    std::fs::write(path, format!("{summary:#}\n"))
        .map_err(|source| StartError::Summary { path: path.into(), source })
}

/// Finds out whether a summary can be written, and leaves none.
///
/// # Errors
/// When the file cannot be written.
pub fn try_summary(path: &Path) -> Result<(), StartError> {
    write_summary(path, &serde_json::Value::Null)?;
    std::fs::remove_file(path).map_err(|source| StartError::Summary { path: path.into(), source })
}
