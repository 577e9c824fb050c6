//! Spheres that cover the links of an arm, found offline from the collision shapes of its URDF.
//!
//! A link is covered when every corner and every point of every triangle of its meshes lies in at least one of
//! its spheres. For a sphere of radius r whose centre lies at depth d inside the link, the *protrusion* r − d
//! bounds how far it reaches beyond the surface: the ball of radius d lies inside. What a mesh encloses is looked
//! for on a grid, so that meshes may be open where links meet.
//!
//! [`cover`] takes as few spheres as keep the protrusion below what was asked for. Where these are more than
//! permitted it takes the least protrusion, the same for all links, for which they are not. The same files give
//! the same bits.
//!
//! ```no_run
//! use std::path::Path;
//! use tprmp_cover::{Options, Packages, cover};
//!
//! # fn main() -> Result<(), tprmp_cover::CoverError> {
//! let packages = Packages::with_environment(vec![("panda_description".into(), "/opt/panda".into())]);
//! let cover = cover(Path::new("panda.urdf"), None, &packages, &Options::default())?;
//! for link in &cover.links {
//!     println!("{}: {} spheres", link.link, link.spheres.len());
//! }
//! # Ok(())
//! # }
//! ```

mod collada;
mod contact;
mod error;
mod links;
mod mesh;
mod packages;
mod picture;
mod primitives;
mod scene;
mod solid;
mod spheres;
mod stl;
mod text;
mod triangle;

use std::path::Path;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;
use tprmp_robot::{CONTROL_POINT_CAPACITY, Document, Selection};

pub use contact::LinkMeshes;
pub use error::CoverError;
pub use mesh::MeshFault;
pub use packages::Packages;
pub use spheres::Sphere;

use links::{Description, LinkShapes};
use spheres::Coverable;

/// The least protrusion is found to this \[m\].
const RESOLUTION_M: f64 = 2.5e-4;
/// Protrusions are looked for up to so much \[m\]; a sphere that sticks out farther is no cover.
const PROTRUSION_MAX_M: f64 = 1.0;

/// What is asked of a cover.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Spheres may stick out of a link by so much \[m\]: above 0, at most 1.
    pub protrusion_m: f64,
    /// So many spheres may the arm have.
    pub spheres_max: usize,
    /// Whether the convex hulls of the meshes are covered, which is what simulators collide with, and no dent of them
    /// is left open.
    pub hulls: bool,
}

impl Default for Options {
    /// 15 mm, and as many spheres as an arm can have.
    fn default() -> Self {
        Self { protrusion_m: 0.015, spheres_max: CONTROL_POINT_CAPACITY, hulls: false }
    }
}

/// A mesh of the URDF that gives no shape.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MissingMesh {
    /// As the URDF names it.
    pub filename: String,
    /// What is wrong.
    pub fault: MeshFault,
}

/// The spheres of one link.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkCover {
    /// Name of the link.
    pub link: String,
    /// How many meshes its collision shapes name.
    pub meshes: usize,
    /// How many boxes, cylinders, capsules and spheres there are.
    pub primitives: usize,
    /// Meshes that give no shape: with one of them the link is not kept clear.
    pub missing: Vec<MissingMesh>,
    /// Spheres around the shapes that are there, in the link's frame.
    pub spheres: Vec<Sphere>,
    /// The spheres stick out of the shapes by no more than this \[m\].
    pub protrusion_m: f64,
    /// Triangles of the shapes in the link's frame \[m\], for pictures and checks: what is round lies inside them,
    /// by no more than 1 % of its radius. Those around balls come last.
    pub triangles: Vec<[DVec3; 3]>,
    /// Where the link is in the base with all joints in the middle of their ranges, for pictures.
    pub placement: DAffine3,
}

/// The spheres of an arm.
#[derive(Debug, Clone, PartialEq)]
pub struct Cover {
    /// A part for each link that moves, in the order of the URDF; also for those without a shape.
    pub links: Vec<LinkCover>,
    /// The largest protrusion of all links \[m\].
    pub protrusion_m: f64,
    /// What was asked for.
    pub asked: Options,
}

impl Cover {
    /// Whether the protrusion is what was asked for; otherwise there were too few spheres for it.
    #[must_use]
    pub fn is_within(&self) -> bool {
        self.protrusion_m <= self.asked.protrusion_m
    }

    /// The shapes of the links.
    #[must_use]
    pub fn meshes(&self) -> LinkMeshes {
        LinkMeshes::of(self.links.iter().map(|link| &link.triangles[..]))
    }

    /// How many spheres there are.
    #[must_use]
    pub fn sphere_count(&self) -> usize {
        self.links.iter().map(|link| link.spheres.len()).sum()
    }

    /// Links of which a mesh gives no shape: they are not kept clear, or not wholly.
    pub fn not_kept_clear(&self) -> impl Iterator<Item = &LinkCover> {
        self.links.iter().filter(|link| !link.missing.is_empty())
    }
}

/// Covers the links of a URDF that move.
///
/// * `selection`  chain of the arm; with `None` all links below any movable joint are covered. Joints beside the
///   path to the tool count as held.
/// * `packages`   where the meshes are
///
/// A mesh that is not there or not readable is no error of the whole: its link names it in
/// [`LinkCover::missing`].
///
/// # Errors
///
/// [`CoverError`]: the URDF cannot be read, has no such link or nothing that moves; an option is out of its
/// range; one sphere a link is more than permitted.
pub fn cover(
    urdf: &Path,
    selection: Option<&Selection>,
    packages: &Packages,
    options: &Options,
) -> Result<Cover, CoverError> {
    cover_document(&links::read(urdf)?, selection, packages, options)
}

/// As [`cover`], of a description that was read.
///
/// # Errors
///
/// As [`cover`].
pub fn cover_document(
    document: &Document,
    selection: Option<&Selection>,
    packages: &Packages,
    options: &Options,
) -> Result<Cover, CoverError> {
    check(options)?;
    let urdf = document.file.as_path();
    let description = Description { document };
    let names = description.moving_links(selection)?;
    description.check_shapes(&names)?;
    if names.is_empty() {
        return Err(CoverError::NothingMoves { file: urdf.to_owned() });
    }
    let links: Vec<LinkShapes> =
        names.par_iter().map(|link| description.shapes(link, packages, options.hulls)).collect();
    let coverable: Vec<Option<Coverable>> =
        links.par_iter().map(|link| Coverable::new(&link.triangles, link.excess)).collect();
    let fixed: usize = links.iter().map(|link| link.spheres.len()).sum();
    let surfaces: Vec<&Coverable> = coverable.iter().flatten().collect();
    let Some(most) = options.spheres_max.checked_sub(fixed).filter(|most| *most >= surfaces.len())
    else {
        let least = fixed + surfaces.len();
        let has_shape = |(link, surface): &(&LinkShapes, &Option<Coverable>)| {
            surface.is_some() || !link.spheres.is_empty()
        };
        return Err(CoverError::TooFewSpheres {
            file: urdf.to_owned(),
            least,
            links: links.iter().zip(&coverable).filter(has_shape).count(),
            found: options.spheres_max,
        });
    };
    let mut covers = least_protrusion(&surfaces, options.protrusion_m, most).into_iter();
    let links: Vec<LinkCover> = links
        .into_iter()
        .zip(&coverable)
        .map(|(shapes, coverable)| {
            let found = coverable.as_ref().and_then(|_| covers.next());
            let (spheres, protrusion_m) = found.unwrap_or((Vec::new(), 0.0));
            let LinkShapes { link, meshes, primitives, missing, mut triangles, .. } = shapes;
            triangles.extend(shapes.balls);
            let spheres = shapes.spheres.into_iter().chain(spheres).collect();
            let placement = description.placement(&link, selection);
            LinkCover {
                link,
                meshes,
                primitives,
                missing,
                spheres,
                protrusion_m,
                triangles,
                placement,
            }
        })
        .collect();
    let protrusion_m = links.iter().map(|link| link.protrusion_m).fold(0.0, f64::max);
    Ok(Cover { links, protrusion_m, asked: *options })
}

fn check(options: &Options) -> Result<(), CoverError> {
    let out_of_range =
        |expected: &str, found: String| CoverError::Option { expected: expected.into(), found };
    let p = options.protrusion_m;
    if !(p > 0.0 && p <= PROTRUSION_MAX_M) {
        let expected = "a protrusion above 0 and of at most 1 m";
        return Err(out_of_range(expected, format!("{p} m")));
    }
    if !(1..=CONTROL_POINT_CAPACITY).contains(&options.spheres_max) {
        let expected = format!("1 to {CONTROL_POINT_CAPACITY} spheres");
        return Err(out_of_range(&expected, options.spheres_max.to_string()));
    }
    Ok(())
}

/// Spheres of each surface with the least protrusion, from the one asked for on, for which they are at most `most`.
fn least_protrusion(surfaces: &[&Coverable], asked: f64, most: usize) -> Vec<(Vec<Sphere>, f64)> {
    let choose = |protrusion: f64| -> Option<Vec<Vec<usize>>> {
        let of_one = |surface: &&Coverable| {
            // Half again as many as there may be are too many to be reduced to that.
            let chosen = surface.chosen(protrusion, most + most / 2 + 1)?;
            Some(surface.reduced(chosen, protrusion))
        };
        let chosen: Option<Vec<_>> = surfaces.par_iter().map(of_one).collect();
        chosen.filter(|chosen| chosen.iter().map(Vec::len).sum::<usize>() <= most)
    };
    let (mut low, mut high) = (asked, asked);
    let mut best = choose(asked);
    while best.is_none() && high < 16.0 * PROTRUSION_MAX_M {
        (low, high) = (high, 1.5 * high);
        best = choose(high);
    }
    while high - low > RESOLUTION_M {
        let middle = 0.5 * (low + high);
        match choose(middle) {
            Some(chosen) => (best, high) = (Some(chosen), middle),
            None => low = middle,
        }
    }
    let best = best.unwrap_or_default();
    surfaces.par_iter().zip(&best).map(|(surface, chosen)| surface.spheres(chosen)).collect()
}
