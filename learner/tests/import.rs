//! Tables, NumPy archives and LASA shapes: what is good comes back, what is wrong is refused by its
//! place, and no bytes make a reader panic.

use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use crate::common::Folder;
use glam::{DQuat, DVec3};
use proptest::prelude::*;
use tprmp_files::Existing;
use tprmp_learner::demonstration::{Demonstration, Grip, Gripper, read};
use tprmp_learner::file_error::FileError;
use tprmp_learner::import::{Selection, import};
use tprmp_model::skill_model::Manifold;

const SAMPLES: usize = 50;
const STEP_S: f64 = 0.02;

fn position(t: f64) -> DVec3 {
    DVec3::new(0.1 + 0.3 * t, 0.2 * t * t, 0.4 - 0.1 * t)
}

fn velocity(t: f64) -> DVec3 {
    DVec3::new(0.3, 0.4 * t, -0.1)
}

fn orientation(t: f64) -> DQuat {
    DQuat::from_rotation_x(0.5 * t)
}

fn times() -> impl Iterator<Item = f64> {
    (0..SAMPLES).map(|i| i as f64 * STEP_S)
}

fn selection() -> Selection {
    Selection { skill: Some("made_up".into()), ..Selection::default() }
}

fn write(folder: &Folder, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn imported(path: &Path, selection: &Selection) -> Result<Vec<PathBuf>, FileError> {
    let out = path.parent().unwrap().join("out");
    Ok(import(&[path], &out, selection, Existing::Replace)?.written)
}

/// What importing these bytes says; it names the file and `expected`.
#[track_caller]
fn refused(name: &str, bytes: &[u8], selection: &Selection, expected: &[&str]) {
    let line = std::panic::Location::caller().line();
    let folder = Folder::new(&format!("import-refused-{line}"));
    folder.write("demonstration.frames.json", &frames(["ee_start", "object"]));
    let path = write(&folder, name, bytes);
    let message = imported(&path, selection).unwrap_err().to_string();
    for part in expected.iter().chain(&["demonstration"]) {
        assert!(message.contains(part), "`{message}` does not say `{part}`");
    }
    assert!(!folder.path().join("out").exists(), "nothing is written");
}

/// The path of the formulas, whatever its format was.
fn check(demonstration: &Demonstration, step_s: f64) {
    assert_eq!(demonstration.skill, "made_up");
    assert!(
        (demonstration.sampling_time_s - step_s).abs() < 1e-9,
        "{}",
        demonstration.sampling_time_s
    );
    for (i, pose) in demonstration.poses.iter().enumerate() {
        let mut expected = position(i as f64 * step_s);
        if demonstration.manifold == Manifold::R2 {
            expected.z = 0.0;
        }
        assert!((pose.position - expected).length() < 2e-6, "{i}");
        if demonstration.manifold.has_orientation() {
            assert!(pose.orientation.dot(orientation(i as f64 * step_s)).abs() > 1.0 - 1e-9, "{i}");
        }
    }
}

fn frames(names: [&str; 2]) -> String {
    let frame =
        |x: f64| format!(r#"{{"position_m": [{x}, 0.2, 0], "quaternion_wxyz": [0.6, 0, 0, 0.8]}}"#);
    let [start, goal] = names;
    format!(
        r#"{{"frames": {{"{start}": {}, "{goal}": {}, "other": {}}}}}"#,
        frame(0.1),
        frame(0.5),
        frame(0.7)
    )
}

fn table() -> String {
    let mut text = String::from("time_s,x_m,y_m,z_m,qw,qx,qy,qz,vx_m_s,vy_m_s,vz_m_s,note\n");
    for t in times() {
        let (p, q, v) = (position(t), orientation(t), velocity(t));
        text += &format!(
            "{t},{},{},{},{},{},{},{},{},{},{},a\n",
            p.x, p.y, p.z, q.w, q.x, q.y, q.z, v.x, v.y, v.z
        );
    }
    text
}

#[test]
fn tables_are_imported() {
    let folder = Folder::new("import-table");
    folder.write("demonstration.frames.json", &frames(["ee_start", "object"]));
    // A byte order mark, spaces and the line ends of another system.
    let text = format!("\u{feff}{}", table().replace(',', ", ").replace('\n', "\r\n"));
    let path = folder.write("demonstration.csv", &text);
    let written = imported(&path, &selection()).unwrap();
    assert_eq!(written, [folder.path().join("out/demonstration.json")]);
    let demonstration = read(&written[0], "ee_start", "object").unwrap();
    check(&demonstration, STEP_S);
    assert_eq!((demonstration.poses.len(), demonstration.manifold), (SAMPLES, Manifold::R3S3));
    assert_eq!(demonstration.goal_frame.position.to_array(), [0.5, 0.2, 0.0]);

    let halved = Selection { sampling_time_s: Some(0.01), ..selection() };
    let demonstration = read(&imported(&path, &halved).unwrap()[0], "ee_start", "object").unwrap();
    check(&demonstration, 0.01);
    assert_eq!(demonstration.poses.len(), 2 * SAMPLES - 1);

    // In the plane, with frames of other names.
    let planar: Vec<_> =
        times().map(|t| format!("{t},{},{}", position(t).x, position(t).y)).collect();
    let path =
        folder.write("demonstration.csv", &format!("time_s,x_m,y_m\n{}\n", planar.join("\n")));
    let [a, b] = ["ee_start", "object"].map(|name| Some(name.to_owned()));
    let named = Selection { start_frame: a, goal_frame: b, ..selection() };
    let demonstration = read(&imported(&path, &named).unwrap()[0], "ee_start", "object").unwrap();
    check(&demonstration, STEP_S);
    assert_eq!(demonstration.manifold, Manifold::R2);
}

#[test]
fn wrong_tables_are_refused_by_line_and_column() {
    let good = table();
    let say = |text: &str, expected: &[&str]| {
        refused("demonstration.csv", text.as_bytes(), &selection(), expected);
    };
    say(&good.replace("time_s", "time"), &["column `time_s`", "found time, x_m"]);
    say(&good.replace(",qx", ",q1"), &["column `qx`"]);
    say(&good.replace(",qx", ",qw"), &["column `qw`", "again"]);
    say(&good.replace("\n0.04,", "\n0.04,zero"), &["line 4", "column `x_m`", "zero"]);
    say(&good.replace("\n0.04,", "\n0.04,NaN"), &["line 4", "column `x_m`", "finite"]);
    say(&good.replace("\n0.04,", "\n0.04,1,"), &["line 4"]);
    say(&good.replace("\n0.04,", "\n0.01,"), &["times that grow", "sample 2"]);
    say(&good.replace("\n0.04,", "\n0.03,"), &["--sampling-time-s", "sample 2"]);
    let few: Vec<_> = good.lines().take(5).collect();
    say(&few.join("\n"), &["rows", "at least 10 samples, found 4"]);
    say("", &["time_s"]);
    // The same rows said to be half as far apart.
    let fast: String = (good.lines().enumerate())
        .map(|(i, line)| match line.split_once(',') {
            Some((_, rest)) if i > 0 => format!("{},{rest}\n", (i - 1) as f64 * 0.01),
            _ => format!("{line}\n"),
        })
        .collect();
    say(&fast, &["0.010000 s", "0.020000 s", "--recorded-at-s"]);
    let bare = Selection::default();
    refused("demonstration.csv", good.as_bytes(), &bare, &["--skill"]);
    let zero = Selection { sampling_time_s: Some(0.0), ..selection() };
    refused("demonstration.csv", good.as_bytes(), &zero, &["--sampling-time-s", "positive"]);
    let other = Selection { start_frame: Some("tool".into()), ..selection() };
    let found = ["frames.tool", "demonstration.frames.json", "ee_start, object, other"];
    refused("demonstration.csv", good.as_bytes(), &other, &found);
    refused("demonstration.tsv", good.as_bytes(), &selection(), &["extension", ".tsv"]);

    let folder = Folder::new("import-no-frames");
    let path = folder.write("demonstration.csv", &good);
    let message = imported(&path, &selection()).unwrap_err().to_string();
    assert!(message.contains("demonstration.frames.json"), "{message}");
}

/// An array in NumPy's format.
fn npy(kind: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let header =
        format!("{{'descr': '{kind}', 'fortran_order': {fortran}, 'shape': ({shape}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

fn floats(values: impl IntoIterator<Item = f64>) -> Vec<u8> {
    values.into_iter().flat_map(f64::to_le_bytes).collect()
}

fn archive(arrays: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (i, (name, bytes)) in arrays.iter().enumerate() {
        let method = if i % 2 == 0 {
            zip::CompressionMethod::Deflated
        } else {
            zip::CompressionMethod::Stored
        };
        let options = zip::write::SimpleFileOptions::default().compression_method(method);
        zip.start_file(format!("{name}.npy"), options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn arrays() -> Vec<(&'static str, Vec<u8>)> {
    let poses = times().flat_map(|t| {
        let (p, q) = (position(t), orientation(t));
        [p.x, p.y, p.z, q.w, q.x, q.y, q.z]
    });
    let speeds: Vec<DVec3> = times().map(velocity).collect();
    // Column by column, and with an angular part that nobody reads.
    let by_column = (0..6).flat_map(|k| {
        speeds.iter().map(move |v| v.to_array().get(k).copied().unwrap_or(9.0)).collect::<Vec<_>>()
    });
    let frame = || npy("<f8", "False", "7,", &floats([0.1, 0.2, 0.3, 0.6, 0.0, 0.8, 0.0]));
    let n = SAMPLES;
    vec![
        ("poses", npy("<f8", "False", &format!("{n}, 7"), &floats(poses))),
        ("time_s", npy("<f8", "False", &format!("{n},"), &floats(times()))),
        ("velocities", npy("<f8", "True", &format!("{n}, 6"), &floats(by_column))),
        ("frames/ee_start", frame()),
        ("frames/object", frame()),
        ("names", npy("<U4", "False", "1,", &[0; 16])),
    ]
}

#[test]
fn numpy_archives_are_imported() {
    let folder = Folder::new("import-npz");
    let path = write(&folder, "demonstration.npz", &archive(&arrays()));
    let written = imported(&path, &selection()).unwrap();
    let demonstration = read(&written[0], "ee_start", "object").unwrap();
    check(&demonstration, STEP_S);
    assert_eq!(demonstration.poses.len(), SAMPLES);
    assert!((demonstration.start.orientation.y - 0.8).abs() < 1e-6);
}

#[test]
fn grippers_of_numpy_archives_are_read_and_wrong_ones_refused() {
    let folder = Folder::new("import-npz-gripper");
    let with = |name: &'static str, values: Vec<f64>| {
        let mut all = arrays();
        all.push((name, npy("<f8", "False", &format!("{},", values.len()), &floats(values))));
        archive(&all)
    };
    let states: Vec<f64> = (0..SAMPLES).map(|i| f64::from(u8::from(i > 10))).collect();
    let path = write(&folder, "grips.npz", &with("gripper", states.clone()));
    let demonstration =
        read(&imported(&path, &selection()).unwrap()[0], "ee_start", "object").unwrap();
    let Some(Gripper::Grips(grips)) = demonstration.gripper else { panic!("it is read") };
    assert_eq!(grips.iter().position(|grip| *grip == Grip::Closed), Some(11));
    let path = write(&folder, "widths.npz", &with("gripper_width_m", vec![0.05; SAMPLES]));
    let demonstration =
        read(&imported(&path, &selection()).unwrap()[0], "ee_start", "object").unwrap();
    assert_eq!(demonstration.gripper, Some(Gripper::Widths(vec![0.05; SAMPLES])));
    let say = |bytes: &[u8], expected: &[&str]| {
        refused("demonstration.npz", bytes, &selection(), expected);
    };
    say(&with("gripper", vec![0.0; 3]), &["array `gripper`", "one a pose, found 3"]);
    say(&with("gripper", vec![0.5; SAMPLES]), &["array `gripper`", "row 0", "0.5"]);
    say(&with("gripper_width_m", vec![-1.0; SAMPLES]), &["`gripper_width_m`", "row 0", "-1"]);
    say(&with("Gripper", states), &["array `Gripper`", "`gripper`"]);
}

#[test]
fn wrong_numpy_archives_are_refused_by_array() {
    let say = |name: &str, bytes: Option<Vec<u8>>, expected: &[&str]| {
        let mut all = arrays();
        let at = all.iter().position(|(array, _)| *array == name).unwrap();
        match bytes {
            None => drop(all.remove(at)),
            Some(bytes) => all[at].1 = bytes,
        }
        refused("demonstration.npz", &archive(&all), &selection(), expected);
    };
    for name in ["poses", "time_s", "frames/object"] {
        say(name, None, &[&format!("array `{name}`"), "found only ["]);
    }
    let zeros = |n: usize| floats(vec![0.3; n]);
    say("poses", Some(npy("<f8", "False", "50, 4", &zeros(200))), &["`poses`", "50×4"]);
    say("poses", Some(npy("<f8", "False", "50, 7", &zeros(9))), &["`poses`", "50×7", "found 9"]);
    say("poses", Some(npy("<f8", "False", "50, 7", &zeros(350))), &["row 0", "unit quaternion"]);
    say("poses", Some(npy(">f8", "False", "50, 7", &zeros(350))), &["`poses`", ">f8"]);
    let huge = "9223372036854775807, 9223372036854775807";
    say("poses", Some(npy("<f8", "False", huge, &zeros(350))), &["`poses`", "shape"]);
    say("poses", Some(npy("<f8", "False", "1, 2, 3", &zeros(6))), &["[1, 2, 3]"]);
    let nested = "[".repeat(60_000);
    say("poses", Some(npy("<f8", "False", &nested, &zeros(6))), &["`poses`", "of numbers"]);
    let mut other_version = npy("<f8", "False", "50, 7", &zeros(350));
    other_version[6] = 9;
    say("poses", Some(other_version), &["`poses`", "version 1"]);
    say("poses", Some(b"\x93NUMPY\x01\x00\xff\xff{}".to_vec()), &["`poses`", "truncated"]);
    say("time_s", Some(npy("<f8", "False", "9,", &zeros(9))), &["`time_s`", "50 times", "found 9"]);
    say("velocities", Some(npy("<f8", "False", "50, 2", &zeros(100))), &["`velocities`", "50×3"]);
    let infinite = npy("<f8", "False", "7,", &floats([f64::INFINITY; 7]));
    say("frames/object", Some(infinite), &["`frames/object`", "finite", "row 0"]);
    say("frames/object", Some(npy("<f8", "False", "6,", &zeros(6))), &["7 numbers", "found 6"]);
    let fast = npy("<f8", "False", "50,", &floats(times().map(|t| 0.5 * t)));
    say("time_s", Some(fast), &["0.010000 s", "0.020000 s"]);
    let good = archive(&arrays());
    refused("demonstration.npz", &good[..good.len() / 2], &selection(), &["archive", "zip"]);
    refused("demonstration.npz", b"", &selection(), &["archive"]);
}

fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = kind.to_le_bytes().to_vec();
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

fn matrix(class: u32, name: &str, dimensions: [i32; 2], content: &[u8]) -> Vec<u8> {
    let mut bytes = element(6, &[class.to_le_bytes(), [0; 4]].concat());
    bytes.extend(element(5, &dimensions.map(i32::to_le_bytes).concat()));
    bytes.extend(element(1, name.as_bytes()));
    bytes.extend(content);
    element(14, &bytes)
}

fn doubles(rows: i32, values: &[f64]) -> Vec<u8> {
    let columns = values.len() as i32 / rows;
    matrix(6, "", [rows, columns], &element(9, &floats(values.iter().copied())))
}

fn structure(fields: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut content = [5_u16.to_le_bytes(), 4_u16.to_le_bytes()].concat();
    content.extend(8_i32.to_le_bytes());
    let mut names = Vec::new();
    for (name, _) in fields {
        names.extend(name.as_bytes());
        names.resize(names.len().next_multiple_of(8), 0);
    }
    content.extend(element(1, &names));
    fields.iter().for_each(|(_, value)| content.extend(value));
    matrix(2, "", [1, 1], &content)
}

/// Fields of a demonstration as the LASA data set has them, in mm.
fn lasa_fields() -> Vec<(&'static str, Vec<u8>)> {
    let plane = |v: DVec3| [v.x * 1e3, v.y * 1e3];
    let positions: Vec<f64> = times().flat_map(|t| plane(position(t))).collect();
    let velocities: Vec<f64> = times().flat_map(|t| plane(velocity(t))).collect();
    vec![
        ("pos", doubles(2, &positions)),
        ("t", doubles(1, &times().collect::<Vec<_>>())),
        ("vel", doubles(2, &velocities)),
        ("dt", doubles(1, &[STEP_S])),
    ]
}

fn mat(name: &str, fields: &[(&str, Vec<u8>)], compressed: bool) -> Vec<u8> {
    let cells = [structure(fields), structure(fields)].concat();
    let variable = matrix(1, name, [1, 2], &cells);
    let mut bytes = b"MATLAB 5.0 MAT-file, made up".to_vec();
    bytes.resize(124, b' ');
    bytes.extend([0, 1, b'I', b'M']);
    if compressed {
        let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        zlib.write_all(&variable).unwrap();
        let deflated = zlib.finish().unwrap();
        bytes.extend(15_u32.to_le_bytes());
        bytes.extend((deflated.len() as u32).to_le_bytes());
        bytes.extend(deflated);
    } else {
        bytes.extend(variable);
    }
    bytes
}

#[test]
fn lasa_shapes_are_imported() {
    for compressed in [false, true] {
        let folder = Folder::new(&format!("import-mat-{compressed}"));
        let path = write(&folder, "Angle.mat", &mat("demos", &lasa_fields(), compressed));
        let written = imported(&path, &selection()).unwrap();
        assert_eq!(written.len(), 2);
        assert!(written[1].ends_with("out/made_up_02.json"));
        let demonstration = read(&written[1], "start", "end").unwrap();
        check(&demonstration, STEP_S);
        assert_eq!((demonstration.poses.len(), demonstration.manifold), (SAMPLES, Manifold::R2));
        assert_eq!(demonstration.start, demonstration.poses[0]);
        assert_eq!(demonstration.goal_frame, demonstration.poses[SAMPLES - 1]);
    }
}

#[test]
fn wrong_lasa_shapes_are_refused_by_variable() {
    let say = |bytes: &[u8], expected: &[&str]| {
        refused("demonstration.mat", bytes, &selection(), expected);
    };
    let with = |name: &str, value: Option<Vec<u8>>| {
        let mut fields = lasa_fields();
        let at = fields.iter().position(|(field, _)| *field == name).unwrap();
        match value {
            None => drop(fields.remove(at)),
            Some(value) => fields[at].1 = value,
        }
        mat("demos", &fields, true)
    };
    say(&mat("shapes", &lasa_fields(), true), &["variable `demos`", "[shapes]"]);
    say(&with("pos", None), &["`demos{1}.pos`", "a structure of [t, vel, dt]"]);
    say(&with("pos", Some(doubles(3, &[0.0; 150]))), &["`demos{1}.pos`", "2×N", "3×50 numbers"]);
    say(&with("t", Some(doubles(1, &[0.0; 9]))), &["`demos{1}.t`", "50 samples", "found 9"]);
    say(&with("dt", Some(doubles(1, &[0.04]))), &["`demos{1}.t`", "1.960000 s", "0.980000 s"]);
    say(&with("vel", Some(doubles(2, &[1e3; 100]))), &["variable `demos{1}`", "0.020000 s"]);
    for bad in [f64::NAN, f64::INFINITY] {
        for (field, rows) in [("pos", 2), ("vel", 2), ("t", 1)] {
            let spoiled = with(field, Some(doubles(rows, &[bad; 100][..50 * rows as usize])));
            say(&spoiled, &["variable `demos{1}", "finite"]);
        }
    }
    let good = mat("demos", &lasa_fields(), false);
    say(&good[..good.len() / 2], &["truncated"]);
    say(b"MATLAB 7.3 MAT-file", &["version 7.3", "-v7"]);
    say(b"", &["version 5"]);
    let mut big = good;
    big[124..128].copy_from_slice(&[1, 0, b'M', b'I']);
    say(&big, &["little-endian"]);
}

/// Valid files to be spoiled.
fn valid() -> Vec<(&'static str, Vec<u8>)> {
    let rows: Vec<_> = (0..12).map(|i| format!("[0.{i:02}, {i}.5]")).collect();
    let frame = r#"{"A": [[0.0, -1.0], [1.0, 0.0]], "b": [0.5, 1.0]}"#;
    let thesis = format!(
        r#"{{"name": "C", "dt": 0.01, "manifold": "R2", "demonstrations": [
        {{"frames": {{"start": {frame}, "end": {frame}}}, "positions": [{0}]}}]}}"#,
        rows.join(", ")
    );
    vec![
        ("demonstration.json", thesis.into_bytes()),
        ("demonstration.csv", table().into_bytes()),
        ("demonstration.npz", archive(&arrays())),
        ("demonstration.mat", mat("demos", &lasa_fields(), true)),
        ("demonstration.mat", mat("demos", &lasa_fields(), false)),
    ]
}

/// Whatever it says, it says it without a panic; and what it writes can be read.
fn survives(folder: &Folder, name: &str, bytes: &[u8]) {
    let path = write(folder, name, bytes);
    for sampling_time_s in [None, Some(0.01)] {
        let selection = Selection { sampling_time_s, ..selection() };
        for written in imported(&path, &selection).unwrap_or_default() {
            let spatial = std::fs::read_to_string(&written).unwrap().contains("ee_start");
            let [start, goal] = if spatial { ["ee_start", "object"] } else { ["start", "end"] };
            read(&written, start, goal).unwrap();
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..Default::default() })]

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let folder = Folder::new("import-random");
        folder.write("demonstration.frames.json", &frames(["ee_start", "object"]));
        for (name, good) in valid() {
            survives(&folder, name, &bytes);
            // Behind a good beginning, which gets past the magic numbers.
            for kept in [8, 128, 144, good.len() / 2] {
                survives(&folder, name, &[&good[..kept.min(good.len())], &bytes].concat());
            }
        }
        let text = String::from_utf8_lossy(&bytes).into_owned();
        folder.write("demonstration.frames.json", &text);
        survives(&folder, "demonstration.csv", &valid()[1].1);
    }

    #[test]
    fn spoiled_files_never_panic(
        places in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        early in any::<bool>(),
    ) {
        let folder = Folder::new("import-spoiled");
        folder.write("demonstration.frames.json", &frames(["ee_start", "object"]));
        for (name, mut bytes) in valid() {
            // Early bytes hold the structure, late ones mostly numbers.
            let length = if early { bytes.len().min(400) } else { bytes.len() };
            for (place, byte) in &places {
                bytes[place.index(length)] = *byte;
            }
            survives(&folder, name, &bytes);
        }
    }
}
