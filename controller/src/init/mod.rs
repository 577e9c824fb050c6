//! From the URDF of an arm to a whole configuration, each number with the reason for it.
//!
//! [`init`] looks at the description, finds the arm in it, covers its links with spheres, and chooses what the
//! description does not say: accelerations, a posture, working ranges, pairs of links. All of it is written down;
//! nothing is chosen when the controller runs.

mod arm;
mod limits;
mod notes;
mod pairs;
mod posture;
mod semantic;
mod text;
mod write;

use std::path::PathBuf;

use nalgebra::SVector;
use thiserror::Error;
use tprmp_cover::{Cover, CoverError, Packages, cover_document};
use tprmp_files::{Existing, WriteError};
use tprmp_model::controller_config::{self, ConfigError};
use tprmp_model::skill_model::{self, ModelError, SkillModel};
use tprmp_robot::{
    Chain, ControlPoints, Document, Interface, Selection, SelfPairs, UrdfError, spread_posture,
};

use crate::startup::{self, StartError, WithRobot};
use crate::tool_axis;
use arm::{Arm, Asked};
pub use notes::{Note, NoteKind};
use posture::Criteria;
pub use semantic::SemanticError;

/// What a robot is commanded by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Commands {
    /// Joint positions.
    Position,
    /// Joint velocities.
    Velocity,
    /// Joint torques.
    Torque,
}

/// What the arm is to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// The skill itself.
    Reach,
    /// The skill, then to grip and to lift, from above.
    Pick,
}

/// What to look at, and how.
#[derive(Debug, Clone)]
pub struct Options {
    /// Description of the arm.
    pub urdf: PathBuf,
    /// Link that is the base; found where `None`.
    pub base: Option<String>,
    /// Link that is the tool; found where `None`.
    pub tool: Option<String>,
    /// Model of the skill that the arm is to follow.
    pub model: Option<PathBuf>,
    /// XRDF: spheres, ignored pairs, limits and a posture.
    pub xrdf: Option<PathBuf>,
    /// SRDF: disabled pairs and named postures.
    pub srdf: Option<PathBuf>,
    /// Where the meshes are.
    pub packages: Packages,
    /// How the spheres are chosen.
    pub cover: tprmp_cover::Options,
    /// What the robot is commanded by.
    pub commands: Commands,
    /// What the arm is to do.
    pub task: Task,
    /// Folder for the configuration.
    pub out: PathBuf,
    /// Whether a configuration that is there is replaced.
    pub force: bool,
}

/// What was written.
#[derive(Debug, Clone)]
pub struct Initialised {
    /// The configuration.
    pub config: PathBuf,
    /// Names of the joints.
    pub joints: Vec<String>,
    /// A posture to begin from \[rad or m\].
    pub home: Vec<f64>,
    /// The spheres, for a picture.
    pub cover: Option<Cover>,
    /// What was found, and what a person has to look at.
    pub notes: Vec<Note>,
}

/// Why nothing was written.
#[derive(Debug, Error)]
pub enum InitError {
    /// The description cannot be read, or is not usable.
    #[error(transparent)]
    Urdf(#[from] UrdfError),
    /// There is no arm in it.
    #[error("`{urdf}`: {text}")]
    Arm {
        /// The description.
        urdf: PathBuf,
        /// What was expected and found.
        text: String,
    },
    /// Its links cannot be covered.
    #[error(transparent)]
    Cover(#[from] CoverError),
    /// The model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// An XRDF or SRDF.
    #[error(transparent)]
    Semantic(#[from] SemanticError),
    /// The configuration cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// What was written is not what the controller accepts.
    #[error("what was written is not accepted: {0}")]
    Refused(#[from] StartError),
    /// As [`Self::Refused`].
    #[error("what was written is not accepted: {0}")]
    Config(#[from] ConfigError),
}

/// What is the same for any number of joints.
struct Plan<'a> {
    options: &'a Options,
    document: &'a Document,
    model: Option<&'a SkillModel>,
    semantic: semantic::Semantic,
    arm: Arm,
    selection: Selection,
    notes: Vec<Note>,
}

/// What was chosen for an arm of N joints, in the form in which it is written.
struct Chosen {
    home: Vec<f64>,
    working_range: Vec<Option<[f64; 2]>>,
    rates: limits::Rates,
    position_margin: f64,
    smallest_range: f64,
    control_points: Spheres,
    cover: Option<Cover>,
    grounded: Vec<pairs::Grounded>,
    harmless: Vec<pairs::Harmless>,
    known: limits::Known,
    tool_axis: glam::DVec3,
    on_tool: Vec<String>,
}

impl Chosen {
    fn self_activation_m(&self) -> f64 {
        self_activation_m(self.cover.as_ref())
    }
}

/// Spheres of the arm act on each other from here on \[m\]: where both stick out, the shapes in them are 0.05 apart.
fn self_activation_m(cover: Option<&Cover>) -> f64 {
    let protrusion = cover.map_or(0.0, |cover| cover.protrusion_m);
    ((0.05 - 2.0 * protrusion).clamp(0.01, 0.05) * 1e3).round() / 1e3
}

/// Writes a configuration for the arm of a URDF.
///
/// # Errors
/// [`InitError`]; nothing is written, but in the last two cases.
pub fn init(options: &Options) -> Result<Initialised, InitError> {
    let document = Document::read(&options.urdf)?;
    let model = options.model.as_deref().map(skill_model::read).transpose()?;
    let semantic = semantic::read(options.xrdf.as_deref(), options.srdf.as_deref())?;
    let mut notes = Vec::new();
    let asked = Asked {
        base: options.base.as_deref().or(semantic.base.as_deref()),
        tool: options.tool.as_deref().or(semantic.tool.as_deref()),
        model_tool: model.as_ref().map(|model| model.tool_frame.as_str()),
    };
    let wrong = |text| InitError::Arm { urdf: options.urdf.clone(), text };
    let mut arm = arm::find(&document, asked, &mut notes).map_err(wrong)?;
    semantic.hold(&mut arm);
    let selection = Selection {
        base_link: arm.base_link.clone(),
        tool_link: arm.tool_link.clone(),
        held_joints: arm.held_joints.clone(),
        limits: limits::missing(&document, &arm.joints, &mut notes),
        interface: match options.commands {
            Commands::Torque => Interface::Effort,
            Commands::Position | Commands::Velocity => Interface::Motion,
        },
        ignores_shapes: true,
        ..Selection::default()
    };
    let count = document.count_joints(&selection)?;
    let plan = Plan {
        options,
        document: &document,
        model: model.as_ref(),
        semantic,
        arm,
        selection,
        notes,
    };
    let joints = plan.arm.joints.clone();
    let urdf = options.urdf.clone();
    let (chosen, mut plan) = startup::with_joints(count, plan).ok_or_else(|| InitError::Arm {
        urdf,
        text: format!("expected an arm of 2 to 8 joints, found {count}: --base and --tool name a part of it"),
    })??;
    tprmp_files::make_folder(&options.out)?;
    let text = write::configuration(&mut plan, &chosen);
    let stem = options.urdf.file_stem().unwrap_or_default().to_string_lossy();
    let config = options.out.join(format!("{stem}.ron"));
    tprmp_files::write(&config, text, Existing::unless(options.force))?;
    accept(&config)?;
    let Chosen { home, cover, .. } = chosen;
    Ok(Initialised { config, joints, home, cover, notes: plan.notes })
}

/// Reads what was written, as the controller does.
fn accept(config_path: &std::path::Path) -> Result<(), InitError> {
    let config = controller_config::read(config_path)?;
    startup::check_names(config_path, &config)?;
    Ok(())
}

impl<'a> WithRobot for Plan<'a> {
    type Output = Result<(Chosen, Plan<'a>), InitError>;

    fn call<const N: usize>(mut self) -> Self::Output {
        let chain = Chain::<N>::from_document(self.document, &self.selection)?;
        let known = limits::known::<N>(self.document, &self.selection);
        let mut rates = limits::rates(&chain, known, [0.0, 0.0, -9.81]);
        self.semantic.replace_rates(chain.joint_names(), &mut rates);
        self.note_limits(chain.joint_names(), &rates, known);
        let (control_points, cover) = self.control_points()?;
        let points = ControlPoints::listed(&chain, &control_points).map_err(|source| {
            StartError::ControlPoints { urdf: self.options.urdf.clone(), source }
        })?;
        let position_margin = position_margin(&chain);
        let ends = [
            chain.position_lower().add_scalar(position_margin),
            chain.position_upper().add_scalar(-position_margin),
        ];
        let middle = spread_posture(&ends[0], &ends[1], 7);
        let tool_axis = tool_axis::approach_axis(&chain, &middle);
        let all = pairs::grounded(&chain, &points, &ends);
        let mut exempt = self.semantic.ignored.clone();
        let near_m = self_activation_m(cover.as_ref());
        let meshes = cover.as_ref().map(|cover| (cover.meshes(), cover));
        let shapes = meshes.as_ref().map(|(meshes, cover)| (meshes, *cover));
        let look = pairs::Look { chain: &chain, points: &points, shapes, near_m };
        let mut harmless = pairs::harmless(&look, &exempt, &ends);
        exempt.extend(harmless.iter().map(|pair| pair.links.clone().into()));
        let watched = SelfPairs::new(&chain, &points, &exempt);
        let criteria = Criteria {
            chain: &chain,
            points: &points,
            pairs: &watched,
            range: ends,
            approach_axis: tool_axis,
            moved: self.model.map_or(&[0, 1, 2, 3, 4, 5], |model| model.manifold.moved()),
            grounded: &all,
        };
        let home = self.semantic.home(chain.joint_names()).unwrap_or_else(|| criteria.home());
        let working_range = criteria.working_range(&home);
        let within = [0, 1].map(|end| {
            SVector::from_fn(|i, _| working_range[i].map_or(ends[end][i], |range| range[end]))
        });
        harmless.extend(pairs::harmless(&look, &exempt, &within));
        let last = N - 1;
        let is_on_tool = |(_, joint): &&(String, usize)| *joint == last;
        let chosen = Chosen {
            harmless,
            grounded: pairs::grounded_links(&chain, &points, &all),
            home: home.iter().copied().collect(),
            working_range: working_range.to_vec(),
            on_tool: chain
                .moving_links()
                .iter()
                .filter(is_on_tool)
                .map(|(link, _)| link.clone())
                .collect(),
            rates,
            position_margin,
            smallest_range: (within[1] - within[0]).min(),
            control_points,
            cover,
            known,
            tool_axis,
        };
        Ok((chosen, self))
    }
}

/// Spheres: link, centre in its frame \[m\], radius \[m\].
type Spheres = Vec<(String, glam::DVec3, f64)>;

impl Plan<'_> {
    /// Tells what the torque limits and masses of the description are not good for.
    fn note_limits(&mut self, joints: &[String], rates: &limits::Rates, known: limits::Known) {
        for (i, limit, gravity) in &rates.too_weak {
            self.notes.push(Note::lack(format!(
                "joint `{}`: its effort limit of {limit} does not hold the arm, which takes {gravity:.1}: likely a \
                 placeholder; see its data sheet, and set `robot.limits`",
                joints[*i]
            )));
        }
        if !known.dynamics {
            self.notes.push(Note::lack(
                "the URDF does not have all masses and effort limits: accelerations are defaults, and torques \
                 cannot be commanded"
                    .into(),
            ));
        }
    }

    /// The spheres: those of an XRDF, or found from the shapes.
    fn control_points(&mut self) -> Result<(Spheres, Option<Cover>), InitError> {
        if let Some(spheres) = self.semantic.spheres.clone() {
            self.notes.push(Note::found(format!("{} control points of the XRDF", spheres.len())));
            return Ok((spheres, None));
        }
        let Options { packages, cover: asked, .. } = self.options;
        let found = cover_document(self.document, Some(&self.selection), packages, asked)?;
        let bare: Vec<_> = found.links.iter().filter(|link| !link.has_shape()).collect();
        self.notes.push(Note::found(found.summary()));
        for link in found.not_kept_clear() {
            let meshes: Vec<_> = link.missing.iter().map(ToString::to_string).collect();
            self.notes.push(Note::lack(format!(
                "link `{}` is not kept clear: {}",
                link.link,
                meshes.join("; ")
            )));
        }
        if bare.len() == found.links.len() {
            self.notes.push(Note::lack(
                "no link has a collision shape: the arm keeps clear of nothing".into(),
            ));
        }
        let spheres = found.links.iter().flat_map(|link| {
            link.spheres.iter().map(|sphere| (link.link.clone(), sphere.centre, sphere.radius))
        });
        Ok((spheres.collect(), Some(found)))
    }
}

/// Kept from the position limits \[rad or m\]: 0.05, and a fiftieth of the smallest range at most.
fn position_margin<const N: usize>(chain: &Chain<N>) -> f64 {
    let ranges = chain.position_upper() - chain.position_lower();
    text::rounded((0.02 * ranges.min()).clamp(1e-4, 0.05))
}
