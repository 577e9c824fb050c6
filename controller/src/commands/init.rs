//! `controller init`: from the URDF of an arm to a configuration.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use tprmp_cover::Packages;
use tprmp_files::{Existing, outln, write};

use crate::commands::cover::package;
use crate::init::{self, Commands, InitError, Options, Task};

/// What the robot takes.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Interface {
    Position,
    Velocity,
    Torque,
}

/// What the arm does.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Does {
    Reach,
    Pick,
}

/// Which arm, and what for.
#[derive(Debug, Args)]
pub struct Init {
    /// Description of the arm.
    urdf: PathBuf,
    /// Link that the skill moves; without it the end of the longest chain.
    #[arg(long, value_name = "LINK")]
    tool: Option<String>,
    /// Link that is the base; without it the root, or what is below a joint that floats.
    #[arg(long, value_name = "LINK")]
    base: Option<String>,
    /// Model that the arm is to follow: its tool is looked for, and its approach axis compared.
    #[arg(long)]
    model: Option<PathBuf>,
    /// XRDF of the arm: its spheres, ignored pairs, limits and default posture are used.
    #[arg(long, value_name = "FILE")]
    xrdf: Option<PathBuf>,
    /// SRDF of the arm: its disabled pairs and a named posture are used.
    #[arg(long, value_name = "FILE")]
    srdf: Option<PathBuf>,
    /// Where a package of `package://NAME/…` is. May be given several times; ROS_PACKAGE_PATH and the folders above
    /// the URDF are looked at too.
    #[arg(long, value_name = "NAME=FOLDER", value_parser = package)]
    package: Vec<(String, PathBuf)>,
    /// What the robot is commanded by.
    #[arg(long, value_enum, default_value = "position")]
    interface: Interface,
    /// What the arm does: the skill alone, or to grip at its end and lift.
    #[arg(long, value_enum, default_value = "reach")]
    task: Does,
    /// Spheres may stick out of a link by so much [m].
    #[arg(long, value_name = "M", default_value_t = tprmp_cover::Options::default().protrusion_m)]
    protrusion: f64,
    /// So many spheres may the arm have.
    #[arg(long, value_name = "N", default_value_t = 48)]
    spheres: usize,
    /// Cover the convex hulls of the meshes, which is what most simulators collide with.
    #[arg(long)]
    hulls: bool,
    /// Folder for the configuration.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Write a page of the links and their spheres, which can be turned.
    #[arg(long, value_name = "FILE.html")]
    picture: Option<PathBuf>,
    /// Replace files that are there already.
    #[arg(long)]
    force: bool,
}

impl Init {
    /// Writes the configuration and says what a person has to look at.
    ///
    /// # Errors
    /// [`InitError`].
    pub fn run(self) -> Result<(), InitError> {
        let cover = tprmp_cover::Options {
            protrusion_m: self.protrusion,
            spheres_max: self.spheres,
            hulls: self.hulls,
        };
        let options = Options {
            urdf: self.urdf,
            base: self.base,
            tool: self.tool,
            model: self.model,
            xrdf: self.xrdf,
            srdf: self.srdf,
            packages: Packages::with_environment(self.package),
            cover,
            commands: match self.interface {
                Interface::Position => Commands::Position,
                Interface::Velocity => Commands::Velocity,
                Interface::Torque => Commands::Torque,
            },
            task: match self.task {
                Does::Reach => Task::Reach,
                Does::Pick => Task::Pick,
            },
            out: self.out,
            force: self.force,
        };
        let made = init::init(&options)?;
        if let (Some(path), Some(cover)) = (&self.picture, &made.cover) {
            let stem = options.urdf.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let title = format!("Spheres of {}", tprmp_files::printable(&stem));
            write(path, cover.page(&title), Existing::unless(options.force))?;
        }
        for note in &made.notes {
            outln!("{:>4}  {}", note.kind, note.text);
        }
        outln!("  ok  {} joints: {}", made.joints.len(), made.joints.join(", "));
        outln!("written: {}", made.config.display());
        let model = options.model.as_ref();
        let model = model.map_or("MODEL".into(), |model| model.display().to_string());
        outln!("next: controller check {} --model {model}", made.config.display());
        Ok(())
    }
}
