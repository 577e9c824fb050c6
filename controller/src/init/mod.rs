//! From the URDF of an arm to a whole configuration, each number with the reason for it.
//!
//! [`init`] looks at the description, finds the arm in it, covers its links with spheres, and chooses what the
//! description does not say: accelerations, a posture, working ranges, pairs of links. All of it is written down;
//! nothing is chosen when the controller runs.

mod arm;
mod limits;
mod mount;
mod notes;
mod pairs;
mod posture;
mod semantic;
mod semantic_files;
mod srdf;
mod text;
mod write;
mod xrdf;

use std::path::PathBuf;

use nalgebra::SVector;
use thiserror::Error;
use tprmp_cover::{Cover, CoverError, Packages, cover_document};
use tprmp_files::{Existing, WriteError};
use tprmp_model::controller_config::{self, ConfigError};
use tprmp_model::skill_model::{self, Manifold, ModelError, SkillModel};
use tprmp_robot::{
    Chain, ControlPoints, Document, Interface, Selection, SelfPairs, UrdfError, remarks,
    spread_posture,
};

use crate::freedom::Freedom;
use crate::startup::{self, StartError, WithRobot};
use crate::tool_axis;
use arm::{Arm, Asked};
use mount::Mount;
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
    mount: Mount,
    selection: Selection,
    notes: Vec<Note>,
}

/// What was chosen for an arm of N joints, in the form in which it is written.
struct Chosen {
    home: Vec<f64>,
    home_reason: String,
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
    /// The skill leaves the tilt of the tool alone, and the arm can change it.
    tilts_freely: bool,
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
    let mut notes = Vec::new();
    let files = [&options.xrdf, &options.srdf].map(|file| file.as_deref());
    let semantic = semantic_files::read(&document, files[0], files[1], &mut notes)?;
    let asked = Asked {
        base: options.base.as_deref().or(semantic.base.as_deref()),
        tool: options.tool.as_deref().or(semantic.tool.as_deref()),
        why: if options.tool.is_some() { "asked for" } else { "of the XRDF or SRDF" },
        model_tool: model.as_ref().map(|model| model.tool_frame.as_str()),
    };
    let wrong = |text| InitError::Arm { urdf: options.urdf.clone(), text };
    let mut arm = arm::find(&document, asked, &mut notes).map_err(wrong)?;
    semantic.hold(&mut arm);
    if !arm.held_joints.is_empty() {
        let at = arm.held_joints.iter().map(|(name, at)| format!("`{name}` at {at}"));
        let list = at.collect::<Vec<_>>().join(", ");
        notes.push(Note::found(format!("held beside the arm: {list}")));
    }
    note_body(&document, &arm, &mut notes);
    let mut selection = Selection {
        base_link: arm.base_link.clone(),
        tool_link: arm.tool_link.clone(),
        held_joints: arm.held_joints.clone(),
        interface: match options.commands {
            Commands::Torque => Interface::Effort,
            Commands::Position | Commands::Velocity => Interface::Motion,
        },
        ignores_shapes: true,
        ..Selection::default()
    };
    selection.limits = limits::missing(&document, &selection, &mut notes);
    let count = document.count_joints(&selection)?;
    let implausible = remarks(&document, &selection)?;
    notes.extend(implausible.into_iter().map(|remark| Note::lack(remark.to_string())));
    let mount = Mount::of(&document, arm.base_link.as_deref());
    if mount.is_turned() {
        notes.push(Note::found("the base is mounted turned: gravity is turned with it".into()));
    }
    let plan = Plan {
        options,
        document: &document,
        model: model.as_ref(),
        semantic,
        arm,
        mount,
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
    tprmp_files::try_out(&config, Existing::unless(options.force))?;
    // Beside it, since paths in it are relative: nothing is left of what is not accepted.
    let tried = options.out.join(format!(".{stem}.ron"));
    tprmp_files::write(&tried, &text, Existing::Replace)?;
    let accepted = accept(&tried);
    let _ = std::fs::remove_file(&tried);
    accepted?;
    tprmp_files::write(&config, text, Existing::unless(options.force))?;
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
        let mut rates = limits::rates(&chain, known, self.mount.gravity_m_s2());
        self.semantic.replace_rates(chain.joint_names(), &mut rates);
        self.note_limits(chain.joint_names(), &rates, known);
        let position_margin = self.position_margin(&chain)?;
        let (control_points, cover) = self.control_points()?;
        let points = ControlPoints::listed(&chain, &control_points).map_err(|source| {
            StartError::ControlPoints { urdf: self.options.urdf.clone(), source }
        })?;
        let ends = [
            chain.position_lower().add_scalar(position_margin),
            chain.position_upper().add_scalar(-position_margin),
        ];
        let middle = spread_posture(&ends[0], &ends[1], 7);
        let tool_axis = tool_axis::approach_axis(&chain, &middle);
        let ground_m = self.mount.ground_m();
        let all = pairs::grounded(&chain, &points, ground_m, &ends);
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
            up: self.mount.up,
            ground_m,
        };
        let limits = [chain.position_lower(), chain.position_upper()];
        let given = self.semantic.home(chain.joint_names(), limits, &ends, &mut self.notes)?;
        let home = given.unwrap_or_else(|| criteria.home());
        self.note_uncovered(&chain, &points);
        let freedom = Freedom::of(&chain, &ends);
        self.note_freedom(&freedom);
        let mut working_range = criteria.working_range(&home);
        let known_pairs = (&mut exempt, &mut harmless);
        let within = keep_apart(&look, known_pairs, &ends, &mut working_range, &home);
        let chosen = Chosen {
            harmless,
            grounded: pairs::grounded_links(&chain, &points, &all),
            home: home.iter().copied().collect(),
            home_reason: self.semantic.home_reason(given.is_some()),
            working_range: working_range.to_vec(),
            on_tool: links_on_tool(&chain),
            rates,
            position_margin,
            smallest_range: (within[1] - within[0]).min(),
            control_points,
            cover,
            known,
            tool_axis,
            tilts_freely: self.model.is_some_and(|model| model.manifold == Manifold::R3S1)
                && freedom.rank(&[3, 4]) > 0,
        };
        Ok((chosen, self))
    }
}

/// A joint of less range is none \[rad or m\].
const RANGE_MIN: f64 = 0.02;
/// Spheres that stick out farther are told \[m\].
const STICKS_OUT_M: f64 = 0.05;

/// Tells which shapes that do not move with the arm it could meet.
fn note_body(document: &Document, arm: &Arm, notes: &mut Vec<Note>) {
    let parent = |link: &str| document.joints.iter().find(|joint| joint.child == link);
    // The links from a link up to the root, bounded: a tree is no deeper than it has links.
    let above = |link: &str| {
        let mut links = vec![link.to_owned()];
        while let Some(joint) = parent(&links[links.len() - 1]) {
            if links.len() > document.links.len() {
                break;
            }
            links.push(joint.parent.clone());
        }
        links
    };
    let moves = |link: &str| {
        above(link).iter().filter_map(|at| parent(at)).any(|joint| arm.joints.contains(&joint.name))
    };
    let first = document.joints.iter().find(|joint| arm.joints.first() == Some(&joint.name));
    let foot = first.map(|joint| joint.parent.as_str());
    let bodies = document.links.iter().filter(|link| !link.collisions.is_empty());
    let names: Vec<_> = bodies
        .map(|link| link.name.as_str())
        .filter(|link| Some(*link) != foot && !moves(link))
        .map(|link| format!("`{link}`"))
        .collect();
    if !names.is_empty() {
        notes.push(Note::lack(format!(
            "{} links have shapes and do not move with the arm, which does not keep clear of them: {}; publish what it can \
             reach as obstacles, for one by `controller frames`",
            names.len(),
            tprmp_files::shortened(&names.join(", "))
        )));
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

    /// Kept from the position limits \[rad or m\]: 0.05, and a fiftieth of the smallest range at most.
    fn position_margin<const N: usize>(&self, chain: &Chain<N>) -> Result<f64, InitError> {
        let ranges = chain.position_upper() - chain.position_lower();
        let least = ranges.min();
        if least < RANGE_MIN {
            let joint = &chain.joint_names()[ranges.imin()];
            let text =
                format!("joint `{joint}` can move by {least} rad or m only: make it a fixed one");
            return Err(InitError::Arm { urdf: self.options.urdf.clone(), text });
        }
        Ok(text::rounded((0.02 * least).clamp(1e-4, 0.05)))
    }

    /// Tells where the skill is beyond the arm.
    fn note_freedom<const N: usize>(&mut self, freedom: &Freedom<N>) {
        let Some(model) = self.model.filter(|model| !freedom.can_do(model.manifold)) else {
            return;
        };
        let remedy = match model.manifold {
            Manifold::R3S3 if freedom.can_do(Manifold::R3) => {
                "; `skill.moves: Position` leaves the orientation to it"
            }
            _ => "",
        };
        self.notes.push(Note::lack(format!(
            "the skill is on {}, which this arm cannot do: {freedom}{remedy}",
            model.manifold
        )));
    }

    /// Tells which links `controller check` asks for.
    fn note_uncovered<const N: usize>(&mut self, chain: &Chain<N>, points: &ControlPoints) {
        let bare = startup::uncovered_links(chain, self.document, points);
        if !bare.is_empty() {
            self.notes.push(Note::lack(format!(
                "no spheres for {}: `controller check` refuses the configuration until there are (--package finds meshes), \
                 or `robot.not_kept_clear` names them",
                bare.iter().map(|link| format!("`{link}`")).collect::<Vec<_>>().join(", ")
            )));
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
        if found.protrusion_m > STICKS_OUT_M {
            self.notes.push(Note::lack(format!(
                "the spheres stick out by {:.0} mm: the arm keeps clear of more than it has to, and may find no way; \
                 name --base and --tool of the part that moves, or more --spheres",
                1e3 * found.protrusion_m
            )));
        }
        let known = found.links.iter().all(|link| link.missing.is_empty());
        if bare.len() == found.links.len() && known {
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

/// Cuts the working range where links would meet, and adds what cannot meet within it to the pairs that are known.
/// The range that is left.
fn keep_apart<const N: usize>(
    look: &pairs::Look<'_, N>,
    (exempt, harmless): (&mut Vec<(String, String)>, &mut Vec<pairs::Harmless>),
    ends: &[SVector<f64, N>; 2],
    working_range: &mut [Option<[f64; 2]>; N],
    home: &SVector<f64, N>,
) -> [SVector<f64, N>; 2] {
    let before = [0, 1].map(|end| {
        SVector::from_fn(|i, _| working_range[i].map_or(ends[end][i], |range| range[end]))
    });
    harmless.extend(pairs::harmless(look, exempt, &before));
    exempt.extend(harmless.iter().map(|pair| pair.links.clone().into()));
    let mut within = before;
    harmless.extend(pairs::kept_apart(look, exempt, &mut within, home));
    for (i, range) in working_range.iter_mut().enumerate() {
        if (0..2).any(|end| within[end][i] != before[end][i]) {
            *range = Some([within[0][i], within[1][i]]);
        }
    }
    within
}

/// The links that move with the tool.
fn links_on_tool<const N: usize>(chain: &Chain<N>) -> Vec<String> {
    let links = chain.moving_links().iter().filter(|(_, joint)| *joint == N - 1);
    links.map(|(link, _)| link.clone()).collect()
}
