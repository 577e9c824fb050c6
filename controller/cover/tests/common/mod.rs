//! Shapes, mesh files and robots of one link for the tests.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use glam::DVec3;
use tprmp_cover::{Cover, LinkCover, Options, Packages, cover};

/// A triangle [m].
pub(crate) type Triangle = [DVec3; 3];

/// A box between two corners [m], its faces outwards.
pub(crate) fn cuboid(low: DVec3, high: DVec3) -> Vec<Triangle> {
    let corner = |i: usize| {
        let pick = |axis: usize| if i >> axis & 1 == 1 { high[axis] } else { low[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    };
    let quads =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    quads
        .iter()
        .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
        .map(|t| t.map(corner))
        .collect()
}

/// A tube along z from 0 [m]; open at both ends, or closed.
pub(crate) fn tube(radius: f64, length: f64, is_closed: bool) -> Vec<Triangle> {
    const SIDES: usize = 40;
    let at = |side: usize, z: f64| {
        let angle = core::f64::consts::TAU * (side % SIDES) as f64 / SIDES as f64;
        DVec3::new(radius * angle.cos(), radius * angle.sin(), z)
    };
    let mut triangles = Vec::new();
    for side in 0..SIDES {
        let [a, b, c, d] =
            [at(side, 0.0), at(side + 1, 0.0), at(side + 1, length), at(side, length)];
        triangles.extend([[a, b, c], [a, c, d]]);
        if is_closed {
            triangles.extend([[DVec3::ZERO, b, a], [DVec3::Z * length, d, c]]);
        }
    }
    triangles
}

/// Text of an STL file.
pub(crate) fn ascii_stl(triangles: &[Triangle]) -> String {
    let mut text = String::from("solid shape\n");
    for triangle in triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        for corner in triangle {
            writeln!(text, "vertex {} {} {}", corner.x, corner.y, corner.z).unwrap();
        }
        text += "endloop\nendfacet\n";
    }
    text + "endsolid shape\n"
}

/// A folder with a robot whose links `arm0`, `arm1` … each have the collision geometries given.
pub(crate) struct Robot {
    folder: tempfile::TempDir,
    pub(crate) urdf: PathBuf,
}

impl Robot {
    pub(crate) fn new(links: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut text = String::from("<robot name=\"r\">\n<link name=\"base\"/>\n");
        for (i, geometries) in links.iter().enumerate() {
            writeln!(text, "<link name=\"arm{i}\">{geometries}</link>").unwrap();
            let parent = if i == 0 { "base".to_owned() } else { format!("arm{}", i - 1) };
            writeln!(
                text,
                "<joint name=\"j{i}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"arm{i}\"/>\
                 <axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/></joint>"
            )
            .unwrap();
        }
        let urdf = folder.path().join("robot.urdf");
        fs::write(&urdf, text + "</robot>\n").unwrap();
        Self { folder, urdf }
    }

    /// A robot of one link with a mesh as ASCII STL.
    pub(crate) fn of_mesh(triangles: &[Triangle]) -> Self {
        let robot = Self::new(&[&collision("shape.stl")]);
        robot.file("shape.stl", ascii_stl(triangles));
        robot
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn file(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    pub(crate) fn cover(&self, options: &Options) -> Cover {
        cover(&self.urdf, None, &Packages::default(), options).unwrap()
    }

    /// What is said of the one mesh of the first link.
    pub(crate) fn fault(&self) -> String {
        let cover = self.cover(&Options::default());
        let missing = &cover.links[0].missing;
        assert_eq!(missing.len(), 1, "{missing:?}");
        missing[0].to_string()
    }
}

/// A collision shape of a mesh file.
pub(crate) fn collision(filename: &str) -> String {
    format!("<collision><geometry><mesh filename=\"{filename}\"/></geometry></collision>")
}

/// Every corner, and points all over the triangles, lie in a sphere.
pub(crate) fn assert_covered(link: &LinkCover) {
    const STEPS: u32 = 6;
    for [a, b, c] in &link.triangles {
        for i in 0..=STEPS {
            for j in 0..=STEPS - i {
                let (u, v) = (f64::from(i) / f64::from(STEPS), f64::from(j) / f64::from(STEPS));
                let point = *a + (*b - *a) * u + (*c - *a) * v;
                let inside =
                    link.spheres.iter().any(|s| s.centre.distance(point) <= s.radius + 1e-9);
                assert!(inside, "{}: {point} is in no sphere", link.link);
            }
        }
    }
}

/// Points all over the spheres of a link.
pub(crate) fn points_on_spheres(link: &LinkCover) -> impl Iterator<Item = DVec3> {
    const POINTS: u32 = 600;
    link.spheres.iter().flat_map(|sphere| {
        (0..POINTS).map(|i| {
            let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(POINTS);
            let angle = f64::from(i) * core::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
            let r = (1.0 - z * z).sqrt();
            sphere.centre + DVec3::new(r * angle.cos(), r * angle.sin(), z) * sphere.radius
        })
    })
}

/// No point of the spheres is farther from the body than the protrusion says; `distance` is that to the body \[m\].
pub(crate) fn assert_protrusion(link: &LinkCover, distance: impl Fn(DVec3) -> f64) {
    let farthest = points_on_spheres(link).map(distance).fold(0.0, f64::max);
    let stated = link.protrusion_m;
    assert!(
        farthest <= stated + 1e-9,
        "{}: {farthest} beyond the surface, {stated} stated",
        link.link
    );
    // Not stated much larger than it is either.
    assert!(
        farthest >= 0.6 * stated,
        "{}: {farthest} beyond the surface, {stated} stated",
        link.link
    );
}

/// Distance from the outside to boxes \[m\].
pub(crate) fn to_boxes(boxes: &[[DVec3; 2]], p: DVec3) -> f64 {
    boxes.iter().map(|[low, high]| p.distance(p.clamp(*low, *high))).fold(f64::INFINITY, f64::min)
}
