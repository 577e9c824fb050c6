//! `controller cover`: spheres that cover the links of an arm, from the meshes of its URDF.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::Args;
use thiserror::Error;
use tprmp_cover::{Cover, CoverError, LinkCover, Options, Packages, cover};
use tprmp_files::{Existing, WriteError, errln, outln, printable, write};
use tprmp_robot::{CONTROL_POINT_CAPACITY, Selection};

/// Which arm, and how it is covered.
#[derive(Debug, Args)]
pub struct CoverLinks {
    /// Description of the arm.
    urdf: PathBuf,
    /// Link at the end of the arm; without it all links below any joint that moves are covered.
    #[arg(long)]
    tool: Option<String>,
    /// Link that is the base; without it the root of the URDF.
    #[arg(long, requires = "tool")]
    base: Option<String>,
    /// Joint that is held: links that it alone moves are fixed. May be given several times.
    #[arg(long, value_name = "JOINT", requires = "tool")]
    held: Vec<String>,
    /// Where a package of `package://NAME/…` is. May be given several times; ROS_PACKAGE_PATH and the folders above
    /// the URDF are looked at too.
    #[arg(long, value_name = "NAME=FOLDER", value_parser = package)]
    package: Vec<(String, PathBuf)>,
    /// Spheres may stick out of a link by so many metres.
    #[arg(long, value_name = "M", default_value_t = Options::default().protrusion_m)]
    protrusion: f64,
    /// So many spheres may the arm have; where they do not suffice, they stick out farther.
    #[arg(long, value_name = "N", default_value_t = CONTROL_POINT_CAPACITY)]
    spheres: usize,
    /// Cover the convex hulls of the meshes, which is what most simulators collide with.
    #[arg(long)]
    hulls: bool,
    /// Link that need not be kept clear: that its mesh is missing is no fault. May be given several times.
    #[arg(long, value_name = "LINK")]
    exempt: Vec<String>,
    /// Write the control points into this file instead of standard output.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Write a page of the links and their spheres, which can be turned.
    #[arg(long, value_name = "FILE.html")]
    picture: Option<PathBuf>,
    /// Replace files that are there already.
    #[arg(long)]
    force: bool,
}

/// Why there is no cover, or not of all links.
#[derive(Debug, Error)]
pub enum CoverLinksError {
    /// No cover at all.
    #[error(transparent)]
    Cover(#[from] CoverError),
    /// A file that cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// An exempt link that is not there.
    #[error("--exempt: expected one of the moving links {}, found `{link}`", .found.join(", "))]
    Exempt {
        /// The link that was named.
        link: String,
        /// The moving links.
        found: Vec<String>,
    },
    /// Links whose meshes give no shape.
    #[error("not kept clear: {}; find their meshes, or accept it with --exempt LINK", .links.join(", "))]
    NotKeptClear {
        /// Their names.
        links: Vec<String>,
    },
}

/// `NAME=FOLDER`.
///
/// # Errors
/// With what was expected.
pub(crate) fn package(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, folder)) if !name.is_empty() && !folder.is_empty() => {
            Ok((name.into(), folder.into()))
        }
        _ => Err("expected NAME=FOLDER, e.g. ur_description=/opt/ur_description".into()),
    }
}

impl CoverLinks {
    /// Covers the links, says what came out, and writes it.
    ///
    /// # Errors
    /// [`CoverLinksError`]; where a link is not kept clear the others are written all the same.
    pub fn run(&self) -> Result<(), CoverLinksError> {
        let selection = self.tool.as_ref().map(|tool| Selection {
            base_link: self.base.clone(),
            tool_link: tool.clone(),
            held_joints: self.held.iter().map(|joint| (joint.clone(), 0.0)).collect(),
            ..Selection::default()
        });
        let packages = Packages::with_environment(self.package.clone());
        let options =
            Options { protrusion_m: self.protrusion, spheres_max: self.spheres, hulls: self.hulls };
        let found = cover(&self.urdf, selection.as_ref(), &packages, &options)?;
        if let Some(link) =
            self.exempt.iter().find(|link| found.links.iter().all(|l| l.link != **link))
        {
            let found = found.links.iter().map(|link| link.link.clone()).collect();
            return Err(CoverLinksError::Exempt { link: link.clone(), found });
        }
        self.write(&found)?;
        self.judge(&found)
    }

    fn write(&self, found: &Cover) -> Result<(), WriteError> {
        let existing = Existing::unless(self.force);
        // Where the control points go to standard output, the table must not be among them.
        for line in table(found) {
            match &self.out {
                Some(_) => outln!("{line}"),
                None => errln!("{line}"),
            }
        }
        let urdf = self.urdf.file_name().map_or_else(OsString::new, OsString::from);
        let urdf = printable(&urdf.to_string_lossy()).replace('\n', " ");
        if let Some(path) = &self.picture {
            write(path, found.page(&format!("Spheres of {urdf}")), existing)?;
        }
        let text = format!(
            "// robot.control_points of a configuration, by `controller cover {urdf}`.\n// {}\n{}",
            found.summary(),
            found.control_points_ron()
        );
        match &self.out {
            Some(path) => write(path, text, existing)?,
            None => outln!("{}", text.trim_end()),
        }
        Ok(())
    }

    fn judge(&self, found: &Cover) -> Result<(), CoverLinksError> {
        let not_exempt = found.not_kept_clear().filter(|link| !self.exempt.contains(&link.link));
        let links: Vec<String> = not_exempt.map(|link| link.link.clone()).collect();
        if links.is_empty() { Ok(()) } else { Err(CoverLinksError::NotKeptClear { links }) }
    }
}

/// What came out for each link, and of all.
fn table(found: &Cover) -> Vec<String> {
    let width = found.links.iter().map(|link| link.link.chars().count()).max().unwrap_or(0);
    let row = |link: &LinkCover| {
        let meshes = counted(link.meshes, "mesh", "meshes");
        let others = counted(link.primitives, "other shape", "other shapes");
        let shapes = match (link.meshes, link.primitives) {
            (0, 0) => "no collision shape".into(),
            (_, 0) => meshes,
            (0, _) => others,
            _ => format!("{meshes}, {others}"),
        };
        let mut text = format!("{:width$}  {shapes}", link.link);
        if link.has_shape() {
            let spheres = counted(link.spheres.len(), "sphere", "spheres");
            text += &format!(": {spheres}, protrusion at most {:.1} mm", link.protrusion_m * 1e3);
        }
        if !link.missing.is_empty() {
            text += "; not kept clear:";
        }
        for missing in &link.missing {
            text += &format!("\n{:width$}  {missing}", "");
        }
        text
    };
    found.links.iter().map(row).chain([found.summary()]).collect()
}

fn counted(count: usize, one: &str, more: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { more })
}
