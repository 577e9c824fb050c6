//! Mesh files of all kinds, where they are looked for, and what is said of those that are none.

use std::fmt::Write;
use std::path::PathBuf;

use crate::common::{Robot, Triangle, ascii_stl, assert_covered, collision, cuboid};
use glam::DVec3;
use tprmp_cover::{Options, Packages, cover};

/// A box without symmetries in place and size [m], as numbers that are exact in single precision.
fn shape() -> Vec<Triangle> {
    cuboid(DVec3::new(-0.125, 0.0, 0.0625), DVec3::new(0.25, 0.0625, 0.375))
}

fn binary_stl(triangles: &[Triangle]) -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes.extend(u32::to_le_bytes(triangles.len() as u32));
    for triangle in triangles {
        bytes.extend([0_u8; 12]);
        bytes.extend(
            triangle.iter().flat_map(DVec3::to_array).flat_map(|x| (x as f32).to_le_bytes()),
        );
        bytes.extend([0_u8; 2]);
    }
    bytes
}

fn obj(triangles: &[Triangle]) -> String {
    let mut text = String::from("mtllib none.mtl\no shape\n");
    for corner in triangles.iter().flatten() {
        writeln!(text, "v {} {} {}", corner.x, corner.y, corner.z).unwrap();
    }
    text += "vn 0 0 1\nusemtl none\n";
    for i in 0..triangles.len() {
        writeln!(text, "f {}//1 {}//1 {}//1", 3 * i + 1, 3 * i + 2, 3 * i + 3).unwrap();
    }
    text
}

/// COLLADA whose scene has `nodes`, with the corners times `factor`.
fn dae(asset: &str, nodes: &str, triangles: &[Triangle], map: impl Fn(DVec3) -> DVec3) -> String {
    let corners: Vec<DVec3> = triangles.iter().flatten().map(|corner| map(*corner)).collect();
    let numbers: String = corners.iter().map(|v| format!("{} {} {} ", v.x, v.y, v.z)).collect();
    let indices: String = (0..corners.len()).map(|i| format!("{i} 0 ")).collect();
    let counts = "3 ".repeat(triangles.len());
    format!(
        "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n\
         <COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" version=\"1.4.1\"><asset>{asset}</asset>\n\
         <library_geometries><geometry id=\"g\"><mesh>\n\
         <source id=\"p\"><float_array id=\"a\" count=\"{}\">{numbers}</float_array><technique_common>\
         <accessor source=\"#a\" count=\"{}\" stride=\"3\"/></technique_common></source>\n\
         <vertices id=\"v\"><input semantic=\"POSITION\" source=\"#p\"/></vertices>\n\
         <polylist count=\"{}\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/>\
         <input semantic=\"NORMAL\" source=\"#v\" offset=\"1\"/><vcount>{counts}</vcount><p>{indices}</p></polylist>\n\
         </mesh></geometry></library_geometries>\n\
         <library_visual_scenes><visual_scene id=\"s\">{nodes}</visual_scene></library_visual_scenes>\n\
         <scene><instance_visual_scene url=\"#s\"/></scene></COLLADA>\n",
        3 * corners.len(),
        corners.len(),
        triangles.len(),
    )
}

const INSTANCE: &str = "<node><instance_geometry url=\"#g\"/></node>";

fn assert_same(found: &[Triangle], expected: &[Triangle], case: &str) {
    assert_eq!(found.len(), expected.len(), "{case}");
    for (one, other) in found.iter().flatten().zip(expected.iter().flatten()) {
        assert!((*one - *other).length() < 1e-6, "{case}: {one}, expected {other}");
    }
}

#[test]
fn the_same_shape_is_read_from_every_format() {
    let shape = shape();
    let [x, y, z] = DVec3::AXES;
    let metres = "<unit meter=\"1\"/><up_axis>Z_UP</up_axis>";
    let moved = "<node><translate>0 0 0.5</translate><rotate>0 0 1 90</rotate><scale>2 2 2</scale>\
                 <node><matrix>0.5 0 0 0 0 0.5 0 0 0 0 0.5 0.25 0 0 0 1</matrix><instance_node url=\"#n\"/></node></node>";
    let library = "<node id=\"n\"><instance_geometry url=\"#g\"/></node>";
    let nodes = format!(
        "{moved}</visual_scene></library_visual_scenes><library_nodes>{library}</library_nodes>\
                         <library_visual_scenes><visual_scene id=\"other\">"
    );
    // p = T R S M q + …: q is where the corner has to be before.
    let before = |p: DVec3| {
        let p = p - z * 0.5;
        let p = (x * p.y - y * p.x + z * p.z) / 2.0;
        (p - z * 0.25) / 0.5
    };
    let files: Vec<(&str, Vec<u8>)> = vec![
        ("shape.stl", ascii_stl(&shape).into()),
        ("binary.STL", binary_stl(&shape)),
        ("shape.obj", obj(&shape).into()),
        ("shape.OBJ", obj(&shape).into()),
        ("metres.dae", dae(metres, INSTANCE, &shape, |v| v).into()),
        (
            "millimetres.DAE",
            dae("<unit meter=\"0.001\"/><up_axis>Z_UP</up_axis>", INSTANCE, &shape, |v| v * 1e3)
                .into(),
        ),
        // The up axis is left alone.
        ("y_up.dae", dae("<up_axis>Y_UP</up_axis>", INSTANCE, &shape, |v| v).into()),
        ("nodes.dae", dae(metres, &nodes, &shape, before).into()),
    ];
    for (name, content) in files {
        let robot = Robot::new(&[&collision(name)]);
        robot.file(name, content);
        let cover = robot.cover(&Options::default());
        assert!(cover.links[0].missing.is_empty(), "{name}: {:?}", cover.links[0].missing);
        assert_same(&cover.links[0].triangles, &shape, name);
        assert_covered(&cover.links[0]);
    }
}

/// What is read of a file, and what is said where it is none.
fn read(name: &str, content: impl AsRef<[u8]>) -> Result<Vec<Triangle>, String> {
    let robot = Robot::new(&[&collision(name)]);
    robot.file(name, content);
    let mut cover = robot.cover(&Options { protrusion_m: 0.2, ..Options::default() });
    let link = cover.links.remove(0);
    link.missing.first().map_or(Ok(link.triangles), |missing| Err(missing.to_string()))
}

#[test]
fn binary_stl_is_told_by_its_size_and_never_read_in_part() {
    let plain = binary_stl(&shape());
    let headed = |head: &[u8], count: u32| {
        let mut bytes = plain.clone();
        bytes[..head.len()].copy_from_slice(head);
        bytes[80..84].copy_from_slice(&count.to_le_bytes());
        bytes
    };
    for (case, content) in [
        ("solid", headed(b"solid", 12)),
        ("solid, facet", headed(b"solid name\nfacet normal 0 0 1\n", 12)),
        ("followed", [plain.clone(), vec![0; 37]].concat()),
        ("solid, followed", [headed(b"solid name\nfacet", 12), vec![b' '; 1000]].concat()),
        ("number left out", headed(b"solid", 0)),
        ("number not known", headed(b"", u32::MAX)),
    ] {
        assert_same(&read("a.stl", content).expect(case), &shape(), case);
    }
    for (content, found) in [
        (plain[..plain.len() - 100].to_vec(), "found 10"),
        (plain[..plain.len() - 1].to_vec(), "found 11"),
        (headed(b"solid", 900), "found 12"),
        (headed(b"solid name\nfacet normal", 900), "found 12"),
        ([plain.clone(), vec![0; 5000]].concat(), "found 112"),
    ] {
        let told = read("a.stl", &content).unwrap_err();
        let says = u32::from_le_bytes(content[80..84].try_into().unwrap());
        let expected =
            format!("expected binary STL of {says} triangles, as its head says, {found}");
        assert!(told.contains(&expected), "{told}");
    }
    let told = read("a.stl", &plain[..50]).unwrap_err();
    assert!(told.contains("expected STL of 84 bytes or more, found 50"), "{told}");
}

#[test]
fn text_is_read_however_it_is_written() {
    let upper = ascii_stl(&shape()).to_uppercase().replace('\n', "\r\n");
    assert_same(&read("A.STL", upper).unwrap(), &shape(), "upper case");
    for end in ["\n", "\r\n", " \n"] {
        // Lines go on behind `\`, but not those of comments and names.
        let lines = obj(&shape()).replace("//1 ", &format!("//1 \\{end}  "));
        let lines = format!("# from C:\\meshes\\\nmtllib C:\\none\\\n{lines}");
        assert_same(&read("a.obj", lines).unwrap(), &shape(), "continued");
    }
}

#[test]
fn comments_between_numbers_hide_none() {
    let plain = dae("", INSTANCE, &shape(), |v| v);
    let noted = plain
        .replace("<p>0 0 1 0 ", "<p><!-- one -->0 0 <!-- two --> 1 0 ")
        .replace("<vcount>3 ", "<vcount>3<!-- a --> ")
        .replace("count=\"108\">-0.125 ", "count=\"108\"><!-- corners -->-0.125 <!-- x -->");
    assert_eq!(noted.matches("<!--").count(), 5);
    assert_same(&read("a.dae", noted).unwrap(), &shape(), "comments");
}

#[test]
fn a_geometry_that_is_instanced_twice_is_there_twice() {
    let twice = "<node><instance_geometry url=\"#g\"/></node>\
                 <node><translate>1 0 0</translate><instance_geometry url=\"#g\"/></node>";
    let robot = Robot::new(&[&collision("a.dae")]);
    robot.file("a.dae", dae("<up_axis>Z_UP</up_axis>", twice, &shape(), |v| v));
    let there: Vec<_> = shape().iter().map(|t| t.map(|v| v + DVec3::X)).collect();
    assert_same(
        &robot.cover(&Options::default()).links[0].triangles,
        &[shape(), there].concat(),
        "twice",
    );
}

#[test]
fn scale_and_origin_are_applied() {
    let robot = Robot::new(&[
        "<collision><origin xyz=\"1 2 3\" rpy=\"0 0 1.5707963267948966\"/><geometry>\
        <mesh filename=\"a.stl\" scale=\"0.001 -0.001 0.002\"/></geometry></collision>",
    ]);
    let large: Vec<_> = shape().iter().map(|t| t.map(|v| v * 1e3)).collect();
    robot.file("a.stl", ascii_stl(&large));
    let place = |v: DVec3| DVec3::new(v.y, v.x, 2.0 * v.z) + DVec3::new(1.0, 2.0, 3.0);
    let expected: Vec<_> = shape().iter().map(|t| t.map(place)).collect();
    let cover = robot.cover(&Options::default());
    assert_same(&cover.links[0].triangles, &expected, "scaled");
    assert_covered(&cover.links[0]);
}

#[test]
fn packages_are_found_by_name_by_root_and_above_the_robot() {
    let packages = |named: &[(&str, PathBuf)], roots: &[PathBuf]| Packages {
        named: named.iter().map(|(name, folder)| ((*name).to_owned(), folder.clone())).collect(),
        roots: roots.to_vec(),
    };
    let is_found = |robot: &Robot, packages: &Packages| {
        cover(&robot.urdf, None, packages, &Options::default()).unwrap().links[0].missing.is_empty()
    };
    for scheme in ["package", "model"] {
        let robot = Robot::new(&[&collision(&format!("{scheme}://my_arm/meshes/a.stl"))]);
        assert!(!is_found(&robot, &Packages::default()));
        let elsewhere = tempfile::tempdir().unwrap();
        let folder = elsewhere.path().join("my_arm/meshes");
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("a.stl"), ascii_stl(&shape())).unwrap();
        let package = elsewhere.path().join("my_arm");
        assert!(is_found(&robot, &packages(&[("my_arm", package.clone())], &[])));
        assert!(!is_found(&robot, &packages(&[("other", package.clone())], &[])));
        assert!(is_found(&robot, &packages(&[], &[elsewhere.path().to_owned()])));
        assert!(is_found(&robot, &packages(&[], &[package])));
        // A child of a folder above the robot.
        robot.file("my_arm/meshes/a.stl", ascii_stl(&shape()));
        assert!(is_found(&robot, &Packages::default()));
        // A folder above the robot itself.
        let urdf = robot.path().join("my_arm/urdf/robot.urdf");
        std::fs::create_dir_all(urdf.parent().unwrap()).unwrap();
        std::fs::rename(&robot.urdf, &urdf).unwrap();
        assert!(
            cover(&urdf, None, &Packages::default(), &Options::default()).unwrap().links[0]
                .missing
                .is_empty()
        );
    }
    let robot = Robot::new(&[""]);
    robot.file("a.stl", ascii_stl(&shape()));
    let absolute = Robot::new(&[&collision(&format!("file://{}/a.stl", robot.path().display()))]);
    assert!(is_found(&absolute, &Packages::default()));
}

#[test]
fn the_nearest_folder_above_of_the_name_is_the_package() {
    let robot = Robot::new(&[&collision("package://foo/meshes/a.stl")]);
    let moved = |size: f64| ascii_stl(&cuboid(DVec3::ZERO, DVec3::splat(size)));
    // A folder of the package has its name too.
    robot.file("ws/foo/urdf/foo/meshes/a.stl", moved(0.1));
    robot.file("ws/foo/meshes/a.stl", moved(0.2));
    robot.file("foo/meshes/a.stl", moved(0.3));
    let urdf = robot.path().join("ws/foo/urdf/r.urdf");
    std::fs::rename(&robot.urdf, &urdf).unwrap();
    let size = || {
        let options = Options { protrusion_m: 0.2, ..Options::default() };
        let cover = cover(&urdf, None, &Packages::default(), &options).unwrap();
        let [a, .., c] = cover.links[0].triangles[11];
        a.max(c).max_element()
    };
    assert!((size() - 0.2).abs() < 1e-6, "{}", size());
    std::fs::remove_file(robot.path().join("ws/foo/meshes/a.stl")).unwrap();
    assert!((size() - 0.1).abs() < 1e-6, "{}", size());
}

#[test]
fn urls_of_files_are_read_however_they_are_written() {
    let there = tempfile::tempdir().unwrap();
    std::fs::create_dir(there.path().join("a ü")).unwrap();
    for name in ["a.stl", "a ü/b c.stl", "100%.stl", "d%20.stl"] {
        std::fs::write(there.path().join(name), ascii_stl(&shape())).unwrap();
    }
    let folder = there.path().display();
    for (url, is_found) in [
        (format!("file://{folder}/a.stl"), true),
        (format!("file://localhost{folder}/a.stl"), true),
        (format!("file:{folder}/a.stl"), true),
        (format!("file://{folder}/a%20%C3%BC/b%20c.stl"), true),
        (format!("file://{folder}/a ü/b c.stl"), true),
        (format!("file://{folder}/100%.stl"), true),
        (format!("file://{folder}/d%20.stl"), true),
        (format!("file://elsewhere{folder}/a.stl"), false),
        (format!("file://{folder}/%ff%zz%2.stl"), false),
    ] {
        let cover = Robot::new(&[&collision(&url)]).cover(&Options::default());
        assert_eq!(cover.links[0].missing.is_empty(), is_found, "{url}");
    }
}

#[test]
fn what_is_no_mesh_is_named_for_what_it_is() {
    let fault = |name: &str, content: &[u8]| {
        let robot = Robot::new(&[&collision(name)]);
        robot.file(name, content);
        robot.fault()
    };
    let millimetres: Vec<_> = shape().iter().map(|t| t.map(|v| v * 1e3)).collect();
    let lfs = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n";
    let cut = binary_stl(&shape());
    let bad_index = dae("", INSTANCE, &shape(), |v| v).replace("<p>0 0 ", "<p>999 0 ");
    let bad_number =
        dae("", INSTANCE, &shape(), |v| v).replace("count=\"108\">-", "count=\"108\">x");
    let line = [[DVec3::ZERO, DVec3::X, DVec3::X * 0.5]; 2];
    let no_unit = |metre| dae(&format!("<unit meter=\"{metre}\"/>"), INSTANCE, &shape(), |v| v);
    let deep = "<a>".repeat(40_000);
    for (name, content, parts) in [
        ("a.stl", lfs.as_bytes(), &["pointer of Git LFS", "git lfs pull"][..]),
        ("a.stl", b"", &["empty file"]),
        ("a.stl", b"solid nothing\nendsolid nothing\n", &["found none"]),
        ("a.stl", &cut[..cut.len() - 7], &["STL"]),
        ("a.stl", ascii_stl(&millimetres).as_bytes(), &["375.0 m", "scale=\"0.001 0.001 0.001\""]),
        ("a.stl", ascii_stl(&[[DVec3::X; 3]]).as_bytes(), &["with an area, found 1 without"]),
        ("a.stl", ascii_stl(&line).as_bytes(), &["with an area, found 2 without"]),
        (
            "a.dae",
            no_unit("0").as_bytes(),
            &["line 2, <unit>", "above 0 m as unit, found meter=\"0\""],
        ),
        ("a.dae", no_unit("-1").as_bytes(), &["found meter=\"-1\""]),
        ("a.dae", no_unit("inf").as_bytes(), &["found meter=\"inf\""]),
        ("a.stl", ascii_stl(&[[DVec3::X, DVec3::NAN, DVec3::Y]]).as_bytes(), &["a.stl"]),
        ("a.obj", b"v 1 2 x\n", &["a.obj"]),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n", &["a.obj"]),
        ("a.dae", b"<html><body>404</body></html>", &["expected <COLLADA>, found <html>"]),
        ("a.dae", b"<COLLADA><asset>", &["XML that does not parse"]),
        ("a.dae", b"\xff\xfe", &["UTF-8"]),
        ("a.dae", bad_index.as_bytes(), &["line 6, <p>", "one of 36 positions, found 999"]),
        (
            "a.dae",
            bad_number.as_bytes(),
            &["line 4, <float_array>", "expected a number, found \"x0.125\""],
        ),
        ("a.dae", deep.as_bytes(), &["nested"]),
        ("a.ply", b"ply\n", &["name with .stl, .obj or .dae, found `ply`"]),
    ] {
        let told = fault(name, content);
        for part in parts {
            assert!(told.contains(part), "{name}: {told}: no {part}");
        }
        assert!(told.contains(&format!("mesh `{name}`")), "{told}");
    }
    let flat = Robot::new(&[&collision("a.stl").replace("/></geo", " scale=\"1 0 1\"/></geo")]);
    flat.file("a.stl", ascii_stl(&shape()));
    assert!(flat.fault().contains("without a 0, found scale=\"1 0 1\""), "{}", flat.fault());
    let missing = Robot::new(&[&collision("package://my_arm/a.stl")]).fault();
    assert!(
        missing.contains("not found") && missing.contains("--package my_arm=FOLDER"),
        "{missing}"
    );
    let folder = Robot::new(&[&collision("a.stl")]);
    folder.file("a.stl/x", "");
    assert!(folder.fault().contains("found a folder"), "{}", folder.fault());
}

#[test]
fn all_faults_are_told_and_what_is_there_is_covered() {
    let both = collision("there.stl") + &collision("gone.stl");
    let robot = Robot::new(&[&both, &collision("gone_too.obj"), &collision("there.stl")]);
    robot.file("there.stl", ascii_stl(&shape()));
    let cover = robot.cover(&Options::default());
    let names: Vec<_> = cover.not_kept_clear().map(|link| link.link.as_str()).collect();
    assert_eq!(names, ["arm0", "arm1"]);
    assert!(cover.links[0].has_shape() && !cover.links[1].has_shape());
    assert_covered(&cover.links[0]);
    let html = cover.page("Spheres");
    assert!(html.contains("gone_too.obj") && html.contains("<canvas"), "{html}");
}
