//! Files that are made to hurt are refused by name before they take memory or time.

use std::io::Write;
use std::path::Path;

use crate::common::Folder;
use tprmp_learner::demonstration;
use tprmp_learner::import::{Selection, load};
use tprmp_learner::skill::Skill;

/// What importing these bytes says.
fn refused(name: &str, bytes: &[u8]) -> String {
    let folder = Folder::new(&format!("bounds-{name}"));
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let selection = Selection { skill: Some("made_up".into()), ..Selection::default() };
    let message = load(&path, &selection).unwrap_err().to_string();
    assert!(message.contains(name), "file not named: {message}");
    message
}

fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// A matrix of a class and its content.
fn matrix(class: u32, count: i32, content: &[u8]) -> Vec<u8> {
    let flags = element(6, &[class.to_le_bytes(), [0; 4]].concat());
    let dimensions = element(5, &[1_i32.to_le_bytes(), count.to_le_bytes()].concat());
    element(14, &[flags, dimensions, element(1, b"demos"), content.to_vec()].concat())
}

/// A MATLAB file of one variable, deflated.
fn mat(variable: &[u8]) -> Vec<u8> {
    let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    zlib.write_all(variable).unwrap();
    let deflated = zlib.finish().unwrap();
    let mut bytes = b"MATLAB 5.0 MAT-file".to_vec();
    bytes.resize(124, b' ');
    bytes.extend([0, 1, b'I', b'M']);
    bytes.extend([15_u32.to_le_bytes(), (deflated.len() as u32).to_le_bytes()].concat());
    bytes.extend(deflated);
    bytes
}

#[test]
fn matlab_files_that_unpack_to_more_than_they_are() {
    let empty_cells = [14_u32.to_le_bytes(), 0_u32.to_le_bytes()].concat().repeat(200_000);
    let message = refused("cells.mat", &mat(&matrix(1, 200_000, &empty_cells)));
    assert!(message.contains("at most 100000 cells and fields"), "{message}");
    // A byte a number, each of which takes eight in memory.
    let bytes = element(2, &vec![0; 20 << 20]);
    let message = refused("uint8.mat", &mat(&matrix(9, 20 << 20, &bytes)));
    assert!(message.contains("at most 8388608 bytes of numbers"), "{message}");
    let message = refused("zeros.mat", &mat(&element(14, &vec![0; 40 << 20])));
    assert!(message.contains("at most 33554432 bytes unpacked"), "{message}");
    let names = [element(5, &1_i32.to_le_bytes()), element(1, &vec![b'a'; 5 << 20])].concat();
    let message = refused("fields.mat", &mat(&matrix(2, 1, &names)));
    assert!(message.contains("at most 100000 fields"), "{message}");
}

#[test]
fn tables_that_are_wide_or_long() {
    let wide: String = (0..100_000).map(|i| format!("c{i},")).collect();
    let message = refused("wide.csv", format!("{wide}\n{wide}\n").as_bytes());
    assert!(message.contains("line 1: expected at most 32768 bytes"), "{message}");
    let some: String = (0..2000).map(|i| format!("c{i},")).collect();
    let message = refused("some.csv", format!("{some}\n").as_bytes());
    assert!(message.contains("at most 1000 columns, found 2001"), "{message}");
    let quoted = format!("time_s,x_m,y_m\n{}", "\"\n\",".repeat(1000));
    let message = refused("quoted.csv", quoted.as_bytes());
    assert!(message.contains("line 2: expected quotes that end in their line"), "{message}");
    let rows: String = (0..600_002).map(|i| format!("{i},1,2\n")).collect();
    let message = refused("long.csv", format!("time_s,x_m,y_m\n{rows}").as_bytes());
    assert!(message.contains("line 600003: expected at most 600001 rows"), "{message}");
    let fast: String = (0..20).map(|i| format!("{i}e-300,{i},2\n")).collect();
    let folder = Folder::new("bounds-fast");
    let path = folder.write("fast.csv", &format!("time_s,x_m,y_m\n{fast}"));
    let frame = r#"{"position_m": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}"#;
    folder.write(
        "fast.frames.json",
        &format!(r#"{{"frames": {{"start": {frame}, "end": {frame}}}}}"#),
    );
    let selection = Selection { skill: Some("made_up".into()), ..Selection::default() };
    let message = load(&path, &selection).unwrap_err().to_string();
    assert!(message.contains("at least 1e-5 s apart, found 1e-300 s"), "{message}");
}

#[test]
fn archives_of_many_or_large_arrays() {
    let archive = |names: usize, content: &[u8]| {
        let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        for i in 0..names {
            let options = zip::write::SimpleFileOptions::default();
            let name = if i == 0 { "poses.npy".into() } else { format!("{i}.npy") };
            zip.start_file(name, options).unwrap();
            zip.write_all(content).unwrap();
        }
        zip.finish().unwrap().into_inner()
    };
    let message = refused("many.npz", &archive(1001, b""));
    assert!(message.contains("at most 1000 arrays, found 1001"), "{message}");
    let message = refused("bomb.npz", &archive(1, &vec![0; 40 << 20]));
    assert!(message.contains("bytes unpacked, found more"), "{message}");
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (9000000000, 7), }\n";
    let mut npy = b"\x93NUMPY\x01\x00".to_vec();
    npy.extend((header.len() as u16).to_le_bytes());
    npy.extend(header.as_bytes());
    let message = refused("shape.npz", &archive(1, &npy));
    assert!(message.contains("by its shape, found 9000000000×7"), "{message}");
}

#[test]
fn json_that_is_nested_long_or_no_text() {
    let folder = Folder::new("bounds-json");
    let start = "{\"schema\": \"tprmp-demonstration/1\", \"skill\": \"a\", \"manifold\": \"R2\", \
                 \"sampling_time_s\": 0.01, \"frames\": {}, \"columns\": [], \"samples\": [";
    for (name, text, expected) in [
        ("deep.json", "[".repeat(100_000), "line 1"),
        ("deep_key.json", "{\"a\":".repeat(100_000), "line 1"),
        ("rows.json", format!("{start}{}[]]}}", "[],".repeat(100_001)), "at most 100000 in a list"),
        ("row.json", format!("{start}[{}0]]}}", "0,".repeat(1_000_000)), "at most 16 in a list"),
        ("large.json", " ".repeat(17 << 20), "at most 16777216 bytes, found 17825792"),
        ("utf8.json", "\u{0}".into(), "line 1"),
    ] {
        let path = folder.write(name, &text);
        for message in [
            demonstration::read(&path, "a", "b").unwrap_err().to_string(),
            load(&path, &Selection::default()).unwrap_err().to_string(),
        ] {
            assert!(message.contains(name), "file not named: {message}");
            if name != "rows.json" && name != "row.json" || message.contains("list") {
                assert!(message.contains(expected), "{message}");
            }
        }
    }
    for path in ["/dev/zero", "/dev/null", "/"] {
        let message = demonstration::read(Path::new(path), "a", "b").unwrap_err().to_string();
        assert!(message.contains("expected a file, found"), "{message}");
        let message = Skill::read(Path::new(path)).unwrap_err().to_string();
        assert!(message.contains("expected a file, found"), "{message}");
    }
}

#[test]
fn skill_files_that_cannot_be_meant() {
    let skills = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/skills");
    let good = std::fs::read_to_string(skills.join("planar.ron")).unwrap();
    let folder = Folder::new("bounds-skill");
    for (from, to, expected) in [
        ("span: 2.75", "span: 1e300", "key `scale.span`: expected a number from 1e-9 to 1e6"),
        ("span: 2.75", "span: 1e-300", "key `scale.span`: expected a number from 1e-9 to 1e6"),
        ("span: 2.75", "span: 1e4", "key `scale.span`: expected a number from 0.1 to 100"),
        (
            "damping_1_s: 8.0",
            "damping_1_s: 1e4",
            "key `fit.damping_1_s`: expected a number from 0.1 to 100",
        ),
        (
            "damping_1_s: 8.0",
            "damping_1_s: 1e-6",
            "key `fit.damping_1_s`: expected a number from 0.1 to 100",
        ),
    ] {
        assert!(good.contains(from));
        let path = folder.write("skill.ron", &good.replacen(from, to, 1));
        let message = Skill::read(&path).unwrap_err().to_string();
        assert!(message.contains("skill.ron") && message.contains(expected), "{message}");
    }
    let renamed = folder.write("renamed.ron", &format!("({})", "onset_s: 1, ".repeat(20_000)));
    let message = Skill::read(&renamed).unwrap_err().to_string();
    assert!(message.matches("`onset_s`").count() <= 20, "{}", message.len());
    let nested = folder.write("nested.ron", &"(a: ".repeat(60_000));
    assert!(Skill::read(&nested).unwrap_err().to_string().contains("nested.ron"));
}
