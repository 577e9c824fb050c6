//! What is said of a cover holds: all of the surface is inside, and nothing sticks out farther than stated.

use crate::common::{
    Robot, Triangle, ascii_stl, assert_covered, assert_protrusion, collision, cuboid, to_boxes,
    tube,
};
use glam::DVec3;
use tprmp_cover::{CoverError, LinkMeshes, Options, Packages, cover};
use tprmp_robot::Selection;
use tprmp_spatial::Pose;

/// An L of two boxes, which overlap.
fn elbow() -> (Vec<Triangle>, impl Fn(DVec3) -> f64) {
    let boxes = [
        [DVec3::new(-0.05, -0.04, 0.0), DVec3::new(0.05, 0.04, 0.4)],
        [DVec3::new(-0.05, -0.04, 0.3), DVec3::new(0.35, 0.04, 0.4)],
    ];
    let triangles = boxes.iter().flat_map(|[low, high]| cuboid(*low, *high)).collect();
    (triangles, move |p: DVec3| to_boxes(&boxes, p))
}

#[test]
fn every_point_of_the_surface_is_covered_and_nothing_sticks_out_farther_than_stated() {
    let options = Options::default();
    let (triangles, distance) = elbow();
    let cover = Robot::of_mesh(&triangles).cover(&options);
    assert_covered(&cover.links[0]);
    assert_protrusion(&cover.links[0], distance);
    let to_tube = |p: DVec3| {
        let (across, along) = ((p.truncate().length() - 0.06).max(0.0), p.z - p.z.clamp(0.0, 0.3));
        // The tube has flat sides.
        across.hypot(along) - 0.0002
    };
    // Open where links meet, turned inside out, with each face from both sides, in two shells: always the same body.
    let closed = tube(0.06, 0.3, true);
    let flipped: Vec<_> = closed.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    let both = [closed.clone(), flipped.clone()].concat();
    let inner: Vec<_> =
        tube(0.03, 0.2, true).iter().map(|t| t.map(|p| p + DVec3::Z * 0.05)).collect();
    let shells = [closed.clone(), inner].concat();
    for (case, triangles) in [
        ("closed", closed),
        ("open", tube(0.06, 0.3, false)),
        ("flipped", flipped),
        ("both", both),
        ("shells", shells),
    ] {
        let cover = Robot::of_mesh(&triangles).cover(&options);
        let count = cover.sphere_count();
        assert!((4..=40).contains(&count), "{case}: {count}");
        assert_covered(&cover.links[0]);
        assert_protrusion(&cover.links[0], to_tube);
        assert!(cover.is_within() && cover.protrusion_m <= 0.015, "{case}: {}", cover.summary());
    }
}

#[test]
fn a_channel_and_a_plate_are_not_filled() {
    // A fork of two plates on a block.
    let parts = [
        [DVec3::new(-0.1, -0.1, 0.0), DVec3::new(0.1, 0.1, 0.04)],
        [DVec3::new(-0.1, -0.1, 0.0), DVec3::new(-0.07, 0.1, 0.3)],
        [DVec3::new(0.07, -0.1, 0.0), DVec3::new(0.1, 0.1, 0.3)],
    ];
    let triangles: Vec<_> = parts.iter().flat_map(|[low, high]| cuboid(*low, *high)).collect();
    let cover =
        Robot::of_mesh(&triangles).cover(&Options { protrusion_m: 0.03, ..Options::default() });
    assert!(cover.is_within(), "{}", cover.summary());
    assert_covered(&cover.links[0]);
    assert_protrusion(&cover.links[0], |p| to_boxes(&parts, p));
    // What is between the plates belongs to the hull, whose spheres are around it all.
    let hulls = Options { protrusion_m: 0.03, hulls: true, ..Options::default() };
    let hull = Robot::of_mesh(&triangles).cover(&hulls);
    assert_covered(&hull.links[0]);
    let is_inside = |link: &tprmp_cover::LinkCover, at: DVec3| {
        link.spheres.iter().any(|sphere| sphere.centre.distance(at) <= sphere.radius)
    };
    let between = DVec3::new(0.0, 0.0, 0.29);
    assert!(is_inside(&hull.links[0], between) && !is_inside(&cover.links[0], between));
    assert_protrusion(&hull.links[0], |p| to_boxes(&[[parts[0][0], parts[2][1]]], p));
    // Thinner than any grid.
    let (low, high) = (DVec3::ZERO, DVec3::new(0.1, 0.1, 0.0005));
    let plate = cuboid(low, high);
    let cover = Robot::of_mesh(&plate).cover(&Options { protrusion_m: 0.02, ..Options::default() });
    assert_covered(&cover.links[0]);
    assert_protrusion(&cover.links[0], |p| to_boxes(&[[low, high]], p));
}

#[test]
fn slivers_all_over_the_place_are_covered_in_no_time() {
    // Nine metres by a micrometre each, along all three axes.
    let sliver = |i: u32| {
        let at = |k: u32| f64::from(i * k % 1009) / 1009.0 * 9.0;
        let along = |x: f64, y: f64, z: f64| match i % 3 {
            0 => DVec3::new(x, y, z),
            1 => DVec3::new(y, z, x),
            _ => DVec3::new(z, x, y),
        };
        let (y, z) = (at(37), at(101));
        [along(0.0, y, z), along(9.0, y, z), along(9.0, y + 1e-6, z)]
    };
    let slivers: Vec<Triangle> = (0..2000).map(sliver).collect();
    let begin = std::time::Instant::now();
    let cover = Robot::of_mesh(&slivers).cover(&Options::default());
    let seconds = begin.elapsed().as_secs_f64();
    assert!(seconds < 60.0, "{seconds} s");
    assert!(cover.links[0].missing.is_empty());
    assert_covered(&cover.links[0]);
    // So thin that no piece has an area of its own.
    let thin = [[DVec3::ZERO, DVec3::X * 9.0, DVec3::new(9.0, 1e-12, 0.0)]];
    let cover = Robot::of_mesh(&thin).cover(&Options::default());
    assert!(cover.links[0].missing.is_empty() && cover.links[0].has_shape());
    assert_covered(&cover.links[0]);
}

#[test]
fn where_the_spheres_do_not_suffice_they_stick_out_farther_and_it_is_said() {
    let (triangles, distance) = elbow();
    let robot = Robot::new(&[&collision("a.stl"), &collision("b.stl")]);
    robot.file("a.stl", ascii_stl(&triangles));
    robot.file("b.stl", ascii_stl(&cuboid(DVec3::splat(-0.02), DVec3::splat(0.02))));
    let mut before = 0.0;
    for spheres_max in [40, 20, 10, 5, 2] {
        let cover = robot.cover(&Options { spheres_max, ..Options::default() });
        assert!(cover.sphere_count() <= spheres_max, "{}", cover.summary());
        assert!(cover.protrusion_m >= before, "{}", cover.summary());
        before = cover.protrusion_m;
        for link in &cover.links {
            assert_covered(link);
        }
        assert_protrusion(&cover.links[0], &distance);
        let is_enough = cover.protrusion_m <= 0.015;
        assert_eq!(
            cover.summary().contains("would take more than"),
            !is_enough,
            "{}",
            cover.summary()
        );
        // The elbow needs more of them than the cube.
        assert!(cover.links[0].spheres.len() >= cover.links[1].spheres.len());
    }
    assert!(before > 0.05);
    let options = Options { spheres_max: 1, ..Options::default() };
    let few = cover(&robot.urdf, None, &Packages::default(), &options).unwrap_err();
    assert!(matches!(few, CoverError::TooFewSpheres { least: 2, links: 2, found: 1, .. }), "{few}");
    let few = few.to_string();
    for part in ["robot.urdf`: expected", "up to 64: `--spheres 2`", "`--base LINK`"] {
        assert!(few.contains(part), "{few}");
    }
    // More than an arm may have; a link without a shape is none of those with one.
    let ball = "<collision><geometry><sphere radius=\"0.05\"/></geometry></collision>";
    let many = Robot::new(&[&[ball; 65][..], &[""]].concat());
    let many = cover(&many.urdf, None, &Packages::default(), &Options::default()).unwrap_err();
    let many = many.to_string();
    for part in ["at least 65 spheres for 65 links", "at most 64; where", "`--base LINK`"] {
        assert!(many.contains(part) && !many.contains("--spheres"), "{many}");
    }
}

#[test]
fn the_same_files_give_the_same_bits() {
    let (triangles, _) = elbow();
    let robot = Robot::of_mesh(&triangles);
    let cover = || robot.cover(&Options { spheres_max: 12, ..Options::default() });
    let first = cover();
    let bits = |cover: &tprmp_cover::Cover| -> Vec<u64> {
        let spheres = cover.links.iter().flat_map(|link| &link.spheres);
        spheres
            .flat_map(|s| [s.centre.x, s.centre.y, s.centre.z, s.radius].map(f64::to_bits))
            .collect()
    };
    assert_eq!(bits(&first), bits(&cover()));
}

#[test]
fn primitives_are_covered_too_and_a_ball_is_its_own_sphere() {
    let at = "<origin xyz=\"0.1 0 0.2\" rpy=\"0.3 -0.2 1\"/>";
    let shape = |text: &str| format!("<collision>{at}<geometry>{text}</geometry></collision>");
    let robot = Robot::new(&[
        &shape("<sphere radius=\"0.07\"/>"),
        &shape("<box size=\"0.1 0.2 0.05\"/>"),
        &shape("<cylinder radius=\"0.05\" length=\"0.3\"/>"),
        &shape("<capsule radius=\"0.05\" length=\"0.3\"/>"),
        "",
    ]);
    let cover = robot.cover(&Options { protrusion_m: 0.02, ..Options::default() });
    assert!(cover.is_within(), "{}", cover.summary());
    let ball = &cover.links[0];
    assert_eq!((ball.spheres.len(), ball.spheres[0].radius, ball.protrusion_m), (1, 0.07, 0.0));
    assert!((ball.spheres[0].centre - DVec3::new(0.1, 0.0, 0.2)).length() < 1e-12);
    for link in &cover.links[1..4] {
        assert_covered(link);
        assert_eq!((link.meshes, link.primitives), (0, 1));
    }
    // The round ones themselves, not only the triangles around them.
    let placement = glam::DAffine3::from_mat3_translation(
        glam::DMat3::from_rotation_z(1.0)
            * glam::DMat3::from_rotation_y(-0.2)
            * glam::DMat3::from_rotation_x(0.3),
        DVec3::new(0.1, 0.0, 0.2),
    );
    for i in 0..500 {
        let angle = f64::from(i);
        let z = 0.15 - 0.3 * f64::from(i) / 499.0;
        let p = placement.transform_point3(DVec3::new(0.05 * angle.cos(), 0.05 * angle.sin(), z));
        for link in &cover.links[2..4] {
            assert!(
                link.spheres.iter().any(|s| s.centre.distance(p) <= s.radius + 1e-9),
                "{}: {p}",
                link.link
            );
        }
    }
    assert!(cover.links[3].spheres.len() < cover.links[2].spheres.len(), "a capsule has no rims");
    assert!(!cover.links[4].has_shape() && cover.links[4].missing.is_empty());
}

#[test]
fn links_that_move_are_covered_and_no_others() {
    let ball = "<collision><geometry><sphere radius=\"0.05\"/></geometry></collision>";
    let robot = Robot::new(&[ball, ball, ball]);
    let names = |selection: Option<&Selection>| -> Result<Vec<String>, CoverError> {
        let cover = cover(&robot.urdf, selection, &Packages::default(), &Options::default())?;
        Ok(cover.links.into_iter().map(|link| link.link).collect())
    };
    assert_eq!(names(None).unwrap(), ["arm0", "arm1", "arm2"]);
    let to = |tool: &str| Selection::from(tool);
    assert_eq!(names(Some(&to("arm2"))).unwrap(), ["arm0", "arm1", "arm2"]);
    let based = Selection { base_link: Some("arm0".into()), ..to("arm2") };
    assert_eq!(names(Some(&based)).unwrap(), ["arm1", "arm2"]);
    let held = Selection { held_joints: [("j0".into(), 0.0)].into(), ..to("arm2") };
    assert_eq!(names(Some(&held)).unwrap(), ["arm1", "arm2"]);
    let all_held = Selection { held_joints: [("j0".into(), 0.0)].into(), ..to("arm0") };
    assert!(matches!(names(Some(&all_held)), Err(CoverError::NothingMoves { .. })));
    let unknown = names(Some(&to("flange"))).unwrap_err().to_string();
    assert!(unknown.contains("found `flange`") && unknown.contains("arm1"), "{unknown}");
}

#[test]
fn options_out_of_their_range_are_refused() {
    let robot = Robot::of_mesh(&cuboid(DVec3::ZERO, DVec3::ONE * 0.1));
    for (options, part) in [
        (Options { protrusion_m: 0.0, ..Options::default() }, "found 0 m"),
        (Options { protrusion_m: f64::NAN, ..Options::default() }, "found NaN m"),
        (Options { protrusion_m: 2.0, ..Options::default() }, "at most 1 m"),
        (Options { spheres_max: 0, ..Options::default() }, "found 0"),
        (Options { spheres_max: 1000, ..Options::default() }, "found 1000"),
    ] {
        let error =
            cover(&robot.urdf, None, &Packages::default(), &options).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
    let nowhere =
        cover(&robot.path().join("no.urdf"), None, &Packages::default(), &Options::default());
    assert!(nowhere.unwrap_err().to_string().contains("no.urdf`: expected a URDF"));
}

#[test]
fn links_touch_where_their_shapes_do_and_not_where_their_spheres_do() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots/ur5.urdf");
    let found = cover(file.as_ref(), None, &Packages::default(), &Options::default()).unwrap();
    let meshes = found.meshes();
    let index = |name| found.links.iter().position(|link| link.link == name).unwrap();
    let [arm, tool] = [index("upper_arm_link"), index("suction_tool")];
    let at = |m| Pose { position: DVec3::new(0.0, m, 0.0), ..Pose::IDENTITY };
    let touch = |m| meshes.touch((arm, &at(0.0)), (tool, &at(m)));
    // The cup is in the arm's end, 5 mm beside its side of 60 mm radius, and far away.
    assert!(touch(0.0) && !touch(0.5));
}

/// Two links of one shape each, at their frames.
fn pair(shapes: [&str; 2]) -> Robot {
    let shape = |text: &str| format!("<collision><geometry>{text}</geometry></collision>");
    Robot::new(&shapes.map(shape).each_ref().map(String::as_str))
}

/// The shapes of its links. As few spheres as are quick to find.
fn meshes(robot: &Robot) -> LinkMeshes {
    robot.cover(&Options { protrusion_m: 0.2, ..Options::default() }).meshes()
}

/// Whether the two links touch, the second so far along x from the first [m].
fn touch_at(meshes: &LinkMeshes, x: f64) -> bool {
    let at = |x| Pose { position: DVec3::X * x, ..Pose::IDENTITY };
    let found = meshes.touch((0, &at(0.0)), (1, &at(x)));
    assert_eq!(found, meshes.touch((1, &at(x)), (0, &at(0.0))), "{x}: the other way around");
    found
}

#[test]
fn balls_touch_where_they_meet() {
    for shapes in [
        ["<sphere radius=\"0.11\"/>", "<sphere radius=\"0.09\"/>"],
        ["<sphere radius=\"0.11\"/>", "<box size=\"0.18 0.01 0.01\"/>"],
    ] {
        let meshes = meshes(&pair(shapes));
        assert!(touch_at(&meshes, 0.199) && touch_at(&meshes, -0.1999), "{shapes:?}");
        assert!(!touch_at(&meshes, 0.203), "{shapes:?}: more than 1 % apart");
    }
    let link = &pair(["<sphere radius=\"0.11\"/>", "<box size=\"0.1 0.1 0.1\"/>"])
        .cover(&Options::default())
        .links[0];
    assert_eq!(link.spheres.len(), 1, "it is not covered twice");
    for corner in link.triangles.iter().flatten() {
        assert!((0.11..=0.1111).contains(&corner.length()), "{corner}");
    }
    for [a, b, c] in &link.triangles {
        let nearest = (*b - *a).cross(*c - *a).normalize().dot(*a).abs();
        assert!(nearest >= 0.11 - 1e-12, "{a} {b} {c}: cuts the ball");
    }
}

#[test]
fn a_shape_inside_another_touches_it() {
    for shapes in [
        ["<sphere radius=\"0.2\"/>", "<sphere radius=\"0.05\"/>"],
        ["<box size=\"0.4 0.4 0.4\"/>", "<cylinder radius=\"0.05\" length=\"0.1\"/>"],
    ] {
        let meshes = meshes(&pair(shapes));
        assert!([0.0, 0.04, -0.1, 0.2].into_iter().all(|x| touch_at(&meshes, x)), "{shapes:?}");
        assert!(!touch_at(&meshes, 0.26), "{shapes:?}");
    }
    // A housing that is closed, open where it ends, inside out, drawn from both sides, of overlapping parts one of
    // which is inside out.
    let closed = tube(0.1, 0.4, true);
    let flipped: Vec<_> = closed.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    let block = cuboid(DVec3::new(-0.07, -0.07, 0.1), DVec3::new(0.07, 0.07, 0.3));
    let inner = cuboid(DVec3::new(-0.02, -0.02, 0.17), DVec3::new(0.02, 0.02, 0.23));
    for (case, housing) in [
        ("open", tube(0.1, 0.4, false)),
        ("both", [closed.clone(), flipped.clone()].concat()),
        ("overlapping", [flipped.clone(), block].concat()),
        ("closed", closed),
        ("flipped", flipped),
    ] {
        // What lies inside is not all there is of its link.
        let far: Vec<_> = inner.iter().map(|t| t.map(|p| p + DVec3::Y)).collect();
        let robot = Robot::new(&[&collision("a.stl"), &collision("b.stl")]);
        robot.file("a.stl", ascii_stl(&housing));
        robot.file("b.stl", ascii_stl(&[far, inner.clone()].concat()));
        let meshes = meshes(&robot);
        assert!(touch_at(&meshes, 0.0) && touch_at(&meshes, 0.03), "{case}");
        assert!(!touch_at(&meshes, 0.13) && !touch_at(&meshes, -0.5), "{case}");
    }
    // In the bore of a thick tube there is room.
    let walls = [
        [DVec3::new(-0.1, -0.1, 0.0), DVec3::new(0.1, -0.05, 0.4)],
        [DVec3::new(-0.1, 0.05, 0.0), DVec3::new(0.1, 0.1, 0.4)],
        [DVec3::new(-0.1, -0.1, 0.0), DVec3::new(-0.05, 0.1, 0.4)],
        [DVec3::new(0.05, -0.1, 0.0), DVec3::new(0.1, 0.1, 0.4)],
    ];
    let walls: Vec<_> = walls.iter().flat_map(|[low, high]| cuboid(*low, *high)).collect();
    let robot = Robot::new(&[&collision("a.stl"), &collision("b.stl")]);
    robot.file("a.stl", ascii_stl(&walls));
    robot.file("b.stl", ascii_stl(&inner));
    let meshes = meshes(&robot);
    assert!(!touch_at(&meshes, 0.0) && touch_at(&meshes, 0.04));
}

#[test]
fn a_shape_that_cannot_be_read_is_an_error_and_no_link_without_a_shape() {
    let robot =
        Robot::new(&["<collision><geometry><sphere radius=\"0.1 m\"/></geometry></collision>"]);
    let error = cover(&robot.urdf, None, &Packages::default(), &Options::default()).unwrap_err();
    let said = error.to_string();
    assert!(said.contains("line ") && said.contains("radius"), "{said}");
}
