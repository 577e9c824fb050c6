//! Triangles of a mesh file: STL, OBJ and COLLADA, read within bounds.

use std::ffi::OsStr;
use std::io;
use std::path::Path;

use glam::DVec3;
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;

use crate::collada;
use crate::scene::of_scene;
use crate::stl;
use crate::triangle::{TRIANGLES_MAX, Triangle, ends, has_area};

/// Largest mesh file \[bytes\].
const BYTES_MAX: u64 = 256 << 20;
/// A link is smaller \[m\]: what is larger is in millimetres.
const EXTENT_MAX_M: f64 = 10.0;

/// Why a mesh gives no shape.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MeshFault {
    /// No file of this name in any place that was looked at.
    #[error("not found; looked at {}; {}", listed(looked_at), remedy.as_str())]
    NotFound {
        /// Where it was looked for.
        looked_at: Vec<String>,
        /// What to do.
        remedy: String,
    },
    /// Something is there, and it is no mesh that is read.
    #[error("{0}")]
    NotAMesh(String),
    /// It has no triangles.
    #[error("expected triangles, found none; export the mesh anew")]
    Empty,
    /// Its triangles are lines and points.
    #[error(
        "expected triangles with an area, found {found} without one, lines or points; export the mesh anew, and \
         look at its scale"
    )]
    NoArea {
        /// How many there are.
        found: usize,
    },
    /// The URDF makes it flat, or nothing.
    #[error("expected a scale without a 0, found scale=\"{found}\" in its <mesh>; correct it")]
    ScaleZero {
        /// The scale.
        found: String,
    },
    /// It is not in metres.
    #[error(
        "expected a link smaller than {EXTENT_MAX_M} m, found {found} m; a mesh in millimetres needs \
         scale=\"0.001 0.001 0.001\" in its <mesh>"
    )]
    TooLarge {
        /// Its longest side \[m\], rounded.
        found: String,
    },
}

fn listed(places: &[String]) -> String {
    let quoted: Vec<_> = places.iter().map(|place| format!("`{place}`")).collect();
    if quoted.is_empty() { "no place".into() } else { quoted.join(", ") }
}

/// The triangles of a mesh file, in its own frame \[m\]; of COLLADA with the file's unit and placements.
///
/// # Errors
///
/// [`MeshFault`]: what the file is instead, with the line where there is one. Sizes are looked at by [`checked`].
pub(crate) fn load(path: &Path) -> Result<Vec<Triangle>, MeshFault> {
    let no_mesh = |text: String| MeshFault::NotAMesh(tprmp_files::shortened(&text));
    let bytes = tprmp_files::read(path, BYTES_MAX).map_err(|error| no_mesh(error.to_string()))?;
    let extension = path.extension().map(OsStr::to_ascii_lowercase);
    if bytes.is_empty() {
        return Err(no_mesh("expected a mesh, found an empty file".into()));
    }
    if bytes.starts_with(b"version https://git-lfs") {
        let remedy =
            "expected a mesh, found a pointer of Git LFS; run `git lfs pull` in its repository";
        return Err(no_mesh(remedy.into()));
    }
    let triangles = match extension.as_ref().and_then(|extension| extension.to_str()) {
        Some("stl") => stl::triangles(&bytes),
        Some("obj") => {
            // Materials are not needed.
            let nothing = |_: &Path| io::Result::<Vec<u8>>::Err(io::ErrorKind::NotFound.into());
            of_scene(mesh_loader::obj::from_slice(&joined(bytes), None, nothing))
        }
        Some("dae") => collada::triangles(&bytes),
        other => Err(format!(
            "expected a file name with .stl, .obj or .dae, found `{}`",
            other.unwrap_or("")
        )),
    };
    let triangles = triangles.map_err(no_mesh)?;
    if triangles.is_empty() {
        return Err(MeshFault::Empty);
    }
    Ok(triangles)
}

/// Looks at the size of a mesh in its link's frame.
///
/// # Errors
///
/// [`MeshFault`]: a corner that is not finite, too many triangles, none with an area, or a link larger than any.
pub(crate) fn checked(triangles: Vec<Triangle>) -> Result<Vec<Triangle>, MeshFault> {
    if triangles.len() > TRIANGLES_MAX {
        let found = triangles.len();
        let text =
            format!("expected at most {TRIANGLES_MAX} triangles, found {found}; simplify the mesh");
        return Err(MeshFault::NotAMesh(text));
    }
    let corners = || triangles.iter().flatten();
    if !corners().all(|corner| corner.is_finite()) {
        return Err(MeshFault::NotAMesh(
            "expected finite coordinates, found one that is not".into(),
        ));
    }
    let (low, high) = ends(corners().copied());
    let extent = (high - low).max_element();
    if extent > EXTENT_MAX_M {
        return Err(MeshFault::TooLarge { found: format!("{extent:.1}") });
    }
    if !triangles.iter().any(has_area) {
        return Err(MeshFault::NoArea { found: triangles.len() });
    }
    Ok(triangles)
}

/// An OBJ file in which lines of numbers that go on, by a `\` at their end, are joined. A `\` that
/// ends a comment or a name, such as that of a folder, stays.
fn joined(mut bytes: Vec<u8>) -> Vec<u8> {
    if !bytes.contains(&b'\\') {
        return bytes;
    }
    let mut goes_on = false;
    let mut start = 0;
    while let Some(length) = bytes.iter().skip(start).position(|byte| *byte == b'\n') {
        let end = start + length;
        let line = bytes[start..end].trim_ascii();
        let word = line.split(u8::is_ascii_whitespace).next().unwrap_or(&[]);
        let is_of_numbers =
            goes_on || [&b"v"[..], b"vt", b"vn", b"vp", b"f", b"l", b"p"].contains(&word);
        goes_on = is_of_numbers && line.ends_with(b"\\");
        if goes_on {
            // The `\` and all behind it.
            let last = bytes[start..end].iter().rposition(|byte| *byte == b'\\').unwrap_or(0);
            bytes[start + last..=end].fill(b' ');
        }
        start = end + 1;
    }
    bytes
}

/// The surface of the convex hull; `None` where the triangles have none, as those in a line.
pub(crate) fn hull(triangles: &[Triangle]) -> Option<Vec<Triangle>> {
    let corners: Vec<_> =
        triangles.iter().flatten().map(|at| Vector::new(at.x, at.y, at.z)).collect();
    let (corners, faces) = try_convex_hull(&corners).ok()?;
    let corner = |i: u32| corners.get(i as usize).map(|at| DVec3::new(at.x, at.y, at.z));
    faces.iter().map(|&[a, b, c]| Some([corner(a)?, corner(b)?, corner(c)?])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const OBJ: &str = "mtllib a.mtl\no a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nvt 0 1\nf 1//1 2//1 3//1\nf -1//1 -2//1 -3//1 -4//-1\n";
    const STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1e0 .5\nendloop\n\
                       endfacet\nendsolid a\n";
    const DAE: &str = "<COLLADA><asset><unit meter=\"0.1\"/></asset><library_geometries><geometry id=\"g\"><mesh><source \
                       id=\"p\"><float_array>0 0 0 1 0 0 0 1 0 1 1 1</float_array><technique_common><accessor stride=\"3\" \
                       offset=\"0\"/></technique_common></source><vertices id=\"v\"><input semantic=\"POSITION\" \
                       source=\"#p\"/></vertices><polylist><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/><vcount>3 4\
                       </vcount><p>0 1 2 0 1 2 3</p></polylist></mesh></geometry></library_geometries>\
                       <library_visual_scenes><visual_scene id=\"s\"><node id=\"n\"><rotate>0 0 1 90</rotate>\
                       <instance_geometry url=\"#g\"/></node></visual_scene></library_visual_scenes><scene>\
                       <instance_visual_scene url=\"#s\"/></scene></COLLADA>";

    /// Whatever a file says, there are triangles or a fault: bytes are changed, cut out and doubled, by a fixed seed.
    #[test]
    fn damaged_meshes_never_panic() {
        let folder = tempfile::tempdir().unwrap();
        let binary = [&[0; 80][..], &2_u32.to_le_bytes(), &[63; 100]].concat();
        let (mut seed, mut whole) = (18_u64, 0);
        let mut random = |below: usize| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
            (seed >> 33) as usize % below
        };
        for (name, content) in [
            ("a.obj", OBJ.as_bytes()),
            ("a.stl", STL.as_bytes()),
            ("b.stl", &binary),
            ("a.dae", DAE.as_bytes()),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, content).unwrap();
            assert!(!load(&path).unwrap().is_empty(), "{name}");
            for _ in 0..500 {
                let mut damaged = content.to_vec();
                for _ in 0..=random(4) {
                    let at = random(damaged.len());
                    let end = (at + random(12)).min(damaged.len());
                    match random(4) {
                        0 => damaged[at] = random(256) as u8,
                        1 => damaged[at] = b"0123456789-./<> \n"[random(17)],
                        2 => drop(damaged.drain(at..end)),
                        _ => damaged.extend_from_within(at..),
                    }
                    damaged.push(b'\n');
                }
                std::fs::write(&path, damaged).unwrap();
                whole += usize::from(load(&path).and_then(checked).is_ok());
            }
        }
        assert!((50..1950).contains(&whole), "{whole} of 2000 are meshes all the same");
    }
}
