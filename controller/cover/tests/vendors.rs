//! Arms of vendors, from pybullet's data package, where `make venv` has put it.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::common::{assert_covered, points_on_spheres};
use glam::DVec3;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::ConvexPolyhedron;
use tprmp_cover::{LinkCover, Options, Packages, cover};

/// The folder of the data package; `None` in a clone that has none.
fn data() -> Option<PathBuf> {
    let lib = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/venv/lib");
    let pythons = std::fs::read_dir(lib).ok()?.flatten();
    pythons.map(|entry| entry.path().join("site-packages/pybullet_data")).find(|path| path.is_dir())
}

/// A sphere reaches no farther out of the convex hull of a link than is stated.
fn assert_protrusion_beyond_hull(link: &LinkCover) {
    let vertices: Vec<DVec3> = link.triangles.iter().flatten().copied().collect();
    let hull = ConvexPolyhedron::from_convex_hull(&vertices).unwrap();
    for point in points_on_spheres(link) {
        let beyond = hull.distance_to_local_point(point, true);
        assert!(beyond <= link.protrusion_m + 1e-6, "{}: {beyond} beyond its hull", link.link);
    }
}

#[test]
fn vendors_arms_are_covered_by_what_an_arm_may_have() {
    let Some(data) = data() else {
        // Past what hides the output of tests.
        let _ = writeln!(
            std::io::stderr(),
            "skipped: target/venv has no pybullet_data, which `make venv` puts there"
        );
        return;
    };
    for (urdf, links, protrusion_most_m) in [
        ("kuka_iiwa/model.urdf", 7, 0.035),
        ("franka_panda/panda.urdf", 10, 0.027),
        ("xarm/xarm6_robot.urdf", 6, 0.03),
    ] {
        let begin = Instant::now();
        let cover =
            cover(&data.join(urdf), None, &Packages::default(), &Options::default()).unwrap();
        eprintln!("{urdf}: {}, {:.1} s", cover.summary(), begin.elapsed().as_secs_f64());
        assert_eq!(cover.not_kept_clear().count(), 0, "{urdf}");
        assert_eq!(cover.links.iter().filter(|link| link.has_shape()).count(), links, "{urdf}");
        assert!(
            cover.sphere_count() <= Options::default().spheres_max,
            "{urdf}: {}",
            cover.summary()
        );
        assert!(cover.protrusion_m <= protrusion_most_m, "{urdf}: {}", cover.summary());
        for link in cover.links.iter().filter(|link| link.has_shape()) {
            assert_covered(link);
            assert_protrusion_beyond_hull(link);
        }
    }
}
