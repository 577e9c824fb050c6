//! Spheres cover the collision shapes, and not much more.

use std::path::PathBuf;

use crate::common::{point2d, robot_file, skew, ur5};
use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tprmp_robot::{
    CONTROL_POINT_CAPACITY, Chain, CollisionGeometry, CollisionShape, ControlPoints, INFLATION_MAX,
    Interface, Kinematics, Selection, forward_kinematics, point_position,
};

/// Points tried on each shape.
const SAMPLES: usize = 4000;
/// Room for rounding [m].
const ROUNDING_M: f64 = 1e-12;

/// A random point on the surface of a shape, in the shape's frame.
fn surface_point(geometry: CollisionGeometry, rng: &mut ChaCha8Rng) -> DVec3 {
    let mut unit = || rng.random_range(-1.0..=1.0_f64);
    let (a, b, c) = (unit(), unit(), unit());
    let angle = a * std::f64::consts::PI;
    let around = DVec3::new(angle.cos(), angle.sin(), 0.0);
    let sphere = DVec3::new(a, b, c).try_normalize().unwrap_or(DVec3::X);
    match geometry {
        // A third each on the side, the ends and the rims.
        CollisionGeometry::Cylinder { radius, length } if c < -0.3 => {
            around * radius + DVec3::Z * (b * length / 2.0)
        }
        CollisionGeometry::Cylinder { radius, length } if c < 0.3 => {
            around * radius * c.abs().sqrt() + DVec3::Z * (b.signum() * length / 2.0)
        }
        CollisionGeometry::Cylinder { radius, length } => {
            around * radius + DVec3::Z * (b.signum() * length / 2.0)
        }
        CollisionGeometry::Capsule { radius, length } if c < 0.0 => {
            around * radius + DVec3::Z * (b * length / 2.0)
        }
        CollisionGeometry::Capsule { radius, length } => {
            sphere * radius + DVec3::Z * (sphere.z.signum() * length / 2.0)
        }
        CollisionGeometry::Sphere { radius } => sphere * radius,
        CollisionGeometry::Box { size } => {
            let mut point = DVec3::new(a, b, c);
            let face = rng.random_range(0..3);
            point[face] = point[face].signum();
            point * size / 2.0
        }
        CollisionGeometry::Mesh => panic!("no mesh here"),
    }
}

fn is_covered<const N: usize>(chain: &Chain<N>, shapes: usize) {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let points = ControlPoints::new(chain).unwrap();
    assert_eq!(chain.collision_shapes().len(), shapes);
    assert!(points.as_slice().len() <= CONTROL_POINT_CAPACITY);
    for shape in chain.collision_shapes() {
        let (CollisionShape { link, joint, geometry, .. }, pose) = (shape, shape.pose());
        assert_eq!(chain.moving_links()[*link].1, *joint);
        for _ in 0..SAMPLES {
            let point = pose.transform_point(surface_point(*geometry, &mut rng));
            let covered = points.as_slice().iter().any(|sphere| {
                sphere.link == *link
                    && sphere.joint == *joint
                    && sphere.centre.distance(point) <= sphere.radius + ROUNDING_M
            });
            assert!(covered, "{geometry:?} of {link}: {point} is bare");
        }
    }
}

#[test]
fn the_ur5_is_covered() {
    is_covered(&ur5(), 10);
    assert_eq!(ControlPoints::new(&ur5()).unwrap().as_slice().len(), 40);
}

#[test]
fn boxes_spheres_and_rotated_cylinders_are_covered() {
    is_covered(&skew(), 4);
    is_covered(&point2d(), 1);
}

#[test]
fn capsules_are_covered() {
    is_covered(&one_link("capsule", r#"<capsule radius="0.05" length="0.23"/>"#), 1);
}

#[test]
fn spheres_exceed_the_shape_by_the_documented_inflation() {
    let chain = ur5();
    let points = ControlPoints::new(&chain).unwrap();
    for shape in chain.collision_shapes() {
        let CollisionGeometry::Cylinder { radius, length } = shape.geometry else {
            panic!("the UR5 is made of cylinders")
        };
        let mut on_axis: Vec<(f64, f64)> = points
            .as_slice()
            .iter()
            .filter(|sphere| sphere.link == shape.link)
            .map(|sphere| (shape.pose().inverse().transform_point(sphere.centre), sphere.radius))
            .filter(|(centre, _)| {
                centre.truncate().length() < ROUNDING_M && centre.z.abs() < length / 2.0
            })
            .map(|(centre, inflated)| (centre.z, inflated))
            .collect();
        on_axis.sort_by(|a, b| a.0.total_cmp(&b.0));
        assert!(!on_axis.is_empty());
        for pair in on_axis.windows(2) {
            assert!(pair[1].0 - pair[0].0 <= radius + ROUNDING_M, "more than a radius apart");
        }
        for (z, inflated) in on_axis {
            assert!(inflated <= INFLATION_MAX * radius + ROUNDING_M);
            assert!(z.abs() + inflated <= length / 2.0 + radius + ROUNDING_M);
        }
    }
}

#[test]
fn spheres_move_with_their_link() {
    let chain = point2d();
    let points = ControlPoints::new(&chain).unwrap();
    let [sphere] = points.as_slice() else { panic!("one sphere") };
    assert_eq!(chain.moving_links()[sphere.link].0, "point");
    assert_eq!(sphere.radius, 0.05);
    let mut kinematics = Kinematics::new();
    forward_kinematics(&chain, &[3.0, -4.0].into(), &mut kinematics);
    let centre = point_position(&kinematics, sphere.joint, sphere.centre);
    assert_eq!(centre, DVec3::new(3.0, -4.0, 0.0));
}

/// The UR5's wrist does not move against its tool: the tip stays at the same place among the
/// spheres of the suction tool.
#[test]
fn folded_links_keep_their_place() {
    let chain = ur5();
    let points = ControlPoints::new(&chain).unwrap();
    let mut kinematics = Kinematics::new();
    forward_kinematics(&chain, &[0.3, -1.2, 1.1, 0.4, -0.7, 2.0].into(), &mut kinematics);
    let to_tool = kinematics.tool_pose().inverse();
    let mut found = 0;
    for sphere in points.as_slice() {
        if chain.moving_links()[sphere.link].0 == "suction_tool" {
            let centre = point_position(&kinematics, sphere.joint, sphere.centre);
            let in_tool = to_tool.transform_point(centre);
            assert!(in_tool.truncate().length() < ROUNDING_M);
            assert!((-0.12..0.0).contains(&in_tool.z), "behind the tip");
            found += 1;
        }
    }
    assert_eq!(found, 7);
}

/// A chain of two joints whose last link has one collision shape.
fn one_link(test: &str, geometry: &str) -> Chain<2> {
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{test}.urdf"));
    let joint = |name: &str, parent: &str, child: &str| {
        format!(
            r#"<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
            <axis xyz="0 1 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>"#
        )
    };
    let text = format!(
        r#"<robot name="one"><link name="a"/><link name="b"/><link name="c"><collision>
        <origin xyz="0.1 0 0" rpy="0.3 0.2 0.1"/><geometry>{geometry}</geometry></collision></link>
        {}{}</robot>"#,
        joint("ab", "a", "b"),
        joint("bc", "b", "c")
    );
    std::fs::write(&file, text).unwrap();
    // Its links have no masses.
    let interface = Interface::Motion;
    Chain::from_urdf(file, Selection { interface, .."c".into() }).unwrap()
}

#[test]
fn too_many_spheres() {
    // 64 cells fit, 65 do not.
    let fits = one_link("fits", r#"<cylinder radius="0.01" length="0.635"/>"#);
    assert_eq!(ControlPoints::new(&fits).unwrap().as_slice().len(), CONTROL_POINT_CAPACITY);
    for geometry in [
        r#"<cylinder radius="0.01" length="0.645"/>"#,
        r#"<cylinder radius="1e-6" length="1000"/>"#,
        r#"<box size="1 1 0.05"/>"#,
    ] {
        let chain = one_link("too_many", geometry);
        let message = ControlPoints::new(&chain).unwrap_err().to_string();
        assert!(message.contains("link `c`: expected"), "{message}");
        assert!(message.contains("64 spheres"), "{message}");
    }
}

#[test]
fn meshes_cannot_be_covered() {
    let chain = one_link("mesh", r#"<mesh filename="package://somewhere/link.dae"/>"#);
    let message = ControlPoints::new(&chain).unwrap_err().to_string();
    assert!(message.contains("link `c`: expected collision shapes of cylinders"), "{message}");
    assert!(message.contains("found a mesh"), "{message}");
}

#[test]
fn listed_spheres_lie_where_their_links_are() {
    let chain = ur5();
    let list = [
        ("suction_tool".to_owned(), DVec3::new(0.0, 0.0, 0.05), 0.03),
        ("forearm_link".to_owned(), DVec3::new(0.2, 0.0, 0.0), 0.06),
    ];
    let points = ControlPoints::listed(&chain, &list).unwrap();
    let names: Vec<_> =
        points.as_slice().iter().map(|p| &chain.moving_links()[p.link].0[..]).collect();
    assert_eq!(names, ["forearm_link", "suction_tool"]);
    // The tool frame of a chain that ends at the link is the link's frame.
    let file = robot_file("ur5.urdf");
    let to_tool = tprmp_robot::Chain::<6>::from_urdf(file, "suction_tool").unwrap();
    let q = [0.3, -1.2, 1.4, -1.8, -1.5, 0.7].into();
    let mut kinematics = tprmp_robot::Kinematics::new();
    tprmp_robot::forward_kinematics(&to_tool, &q, &mut kinematics);
    let expected = kinematics.tool_pose().transform_point(DVec3::Z * 0.05);
    let tool = points.as_slice()[1];
    let found = tprmp_robot::point_position(&kinematics, tool.joint, tool.centre);
    assert!((found - expected).length() < 1e-12, "{found} {expected}");

    let refused = |link: &str, radius: f64| {
        ControlPoints::listed(&chain, &[(link.to_owned(), DVec3::ZERO, radius)])
            .unwrap_err()
            .to_string()
    };
    assert!(refused("hand", 0.1).contains("found `hand`"));
    assert!(refused("forearm_link", 0.0).contains("radius above zero"));
}
