//! Tables as other programs write them: columns that are nearly known are refused and not dropped, and what
//! was read is said.

use std::path::PathBuf;

use crate::common::Folder;
use tprmp_files::Existing;
use tprmp_learner::demonstration::{Demonstration, Grip, Gripper, read, read_folder};
use tprmp_learner::import::{Closed, Imported, LengthUnit, Selection, Space, TimeUnit, import};
use tprmp_model::skill_model::Manifold;

const SAMPLES: usize = 101;
const STEP_S: f64 = 0.02;
const HEADER: &str = "time_s,x_m,y_m,z_m,qw,qx,qy,qz";
const FRAMES: &str = r#"{"frames": {
    "ee_start": {"position_m": [0.4, 0, 0.3], "quaternion_wxyz": [1, 0, 0, 0]},
    "object": {"position_m": [0.6, -0.1, 0.1], "quaternion_wxyz": [1, 0, 0, 0]}}}"#;

fn selection() -> Selection {
    Selection { skill: Some("made_up".into()), ..Selection::default() }
}

/// A table in metres or another unit: rows at these times, written by `stamp`.
fn table(header: &str, unit: f64, stamp: impl Fn(usize) -> String) -> String {
    let row = |i: usize| {
        let s = i as f64 / (SAMPLES - 1) as f64;
        let bow = s * s * (3.0 - 2.0 * s);
        let [x, y, z] = [0.4 + 0.2 * bow, -0.1 * bow, 0.3 - 0.2 * bow].map(|x| x * unit);
        let (sin, cos) = (0.25 * bow).sin_cos();
        format!("{},{x},{y},{z},{cos},0,0,{sin}", stamp(i))
    };
    let rows: Vec<String> = (0..SAMPLES).map(row).collect();
    format!("{header}\n{}\n", rows.join("\n"))
}

fn seconds(i: usize) -> String {
    format!("{:.6}", i as f64 * STEP_S)
}

fn good() -> String {
    table(HEADER, 1.0, seconds)
}

fn named(name: &str) -> Folder {
    let folder = Folder::new(&format!("tables-{name}"));
    folder.write("rec.frames.json", FRAMES);
    folder
}

fn out(folder: &Folder) -> PathBuf {
    folder.path().join("out")
}

fn imported(folder: &Folder, text: &str, selection: &Selection) -> Result<Imported, String> {
    let path = folder.write("rec.csv", text);
    import(&[path], &out(folder), selection, Existing::Replace).map_err(|e| e.to_string())
}

fn demonstrated(imported: &Imported) -> Demonstration {
    read(&imported.written[0], "ee_start", "object").unwrap()
}

#[track_caller]
fn refused(text: &str, selection: &Selection, expected: &[&str]) {
    let folder = named(&format!("refused-{}", std::panic::Location::caller().line()));
    let message = imported(&folder, text, selection).unwrap_err();
    for part in expected.iter().chain(&["rec.csv"]) {
        assert!(message.contains(part), "`{message}` does not say `{part}`");
    }
    assert!(!out(&folder).exists(), "nothing is written");
}

#[test]
fn what_was_read_is_said() {
    let folder = named("said");
    let rows: Vec<String> = good().lines().skip(1).map(|row| format!("{row},a,1")).collect();
    let text = format!("{HEADER},note,force_z\n{}\n", rows.join("\n"));
    let found = imported(&folder, &text, &selection()).unwrap();
    assert_eq!(found.summary.len(), 1);
    let end = "rec.csv: R3xS3, 101 samples at 50 Hz, ignored: note, force_z";
    assert!(found.summary[0].ends_with(end), "{}", found.summary[0]);
    assert_eq!(found.warnings, Vec::<String>::new());
}

#[test]
fn columns_that_differ_by_case_unit_or_underscore_are_refused() {
    let with = |names: &[(&str, &str)]| {
        let header = names.iter().fold(HEADER.to_owned(), |h, (old, new)| h.replace(old, new));
        good().replace(HEADER, &header)
    };
    let all_q = [("qw", "QW"), ("qx", "QX"), ("qy", "QY"), ("qz", "QZ")];
    refused(&with(&all_q), &selection(), &["column `QW`", "`qw`", "--ignore QW"]);
    let all_q = [("qw", "q_w"), ("qx", "q_x"), ("qy", "q_y"), ("qz", "q_z")];
    refused(&with(&all_q), &selection(), &["column `q_w`", "`qw`"]);
    let all_q = [("qw", "quat_w"), ("qx", "quat_x"), ("qy", "quat_y"), ("qz", "quat_z")];
    refused(&with(&all_q), &selection(), &["column `quat_w`", "`qw`"]);
    refused(&with(&[("qw", "a")]), &selection(), &["column `qw`", "found time_s"]);
    refused(&with(&[("z_m", "z")]), &selection(), &["column `z_m`", "rename `z`"]);
    let plane = with(&[("z_m", "z"), ("qw", "a"), ("qx", "b"), ("qy", "c"), ("qz", "d")]);
    refused(&plane, &selection(), &["column `z`", "`z_m`", "left out"]);
    refused(&with(&[("z_m", "z_mm")]), &selection(), &["column `z_m`", "--unit mm"]);
    refused(&with(&[("time_s", "Time")]), &selection(), &["column `time_s`", "rename `Time`"]);
    refused(&with(&[("time_s", "Time_s"), ("x_m", "X_m")]), &selection(), &["column `time_s`"]);
    refused(&with(&[("x_m", "X_m")]), &selection(), &["column `x_m`", "rename `X_m`"]);
    let speeds = good().replace(HEADER, &format!("{HEADER},vx")).replace('\n', ",1\n");
    let speeds = speeds.replace(",vx,1", ",vx");
    refused(&speeds, &selection(), &["column `vx`", "`vx_m_s`"]);
    let bare = good().split_once('\n').unwrap().1.to_owned();
    refused(&bare, &selection(), &["line 1", "a header", "numbers"]);
}

#[test]
fn columns_are_left_out_on_purpose_only() {
    let folder = named("left-out");
    let header = HEADER.replace("qw,qx,qy,qz", "QW,QX,QY,QZ");
    let ignore = ["QW", "QX", "QY", "QZ"].map(String::from).to_vec();
    let chosen = Selection { ignore, ..selection() };
    let found = imported(&folder, &good().replace(HEADER, &header), &chosen).unwrap();
    assert_eq!(demonstrated(&found).manifold, Manifold::R3);
    assert!(found.summary[0].ends_with("R3, 101 samples at 50 Hz, ignored: QW, QX, QY, QZ"));
    let chosen = Selection { space: Some(Space::R3), ..selection() };
    let found = imported(&folder, &good(), &chosen).unwrap();
    assert_eq!(demonstrated(&found).manifold, Manifold::R3);
    let chosen = Selection { space: Some(Space::R3S3), ..selection() };
    refused(&good().replace("qw", "a"), &chosen, &["column `qw`"]);
}

#[test]
fn semicolons_tabs_and_byte_order_marks_are_read() {
    let folder = named("separators");
    folder.write("rec.frames.json", &format!("\u{feff}{FRAMES}"));
    for (separator, name) in [(";", "semicolons"), ("\t", "tabs")] {
        let text = format!("\u{feff}{}", good().replace(',', separator));
        let found = imported(&folder, &text, &selection()).unwrap();
        assert_eq!(demonstrated(&found).poses.len(), SAMPLES);
        let said = format!("columns separated by {name}");
        assert!(found.summary[0].contains(&said), "{}", found.summary[0]);
    }
    // Excel where decimals have commas.
    let commas = good().replace(',', ";").replace("0.", "0,");
    refused(&commas, &selection(), &["line 2, column `time_s`", "decimal points"]);
    let utf16: Vec<u8> = std::iter::once(0xfeff_u16)
        .chain(good().encode_utf16())
        .flat_map(u16::to_le_bytes)
        .collect();
    let path = folder.path().join("rec.csv");
    std::fs::write(&path, utf16).unwrap();
    let error = import(&[path], &out(&folder), &selection(), Existing::Replace).unwrap_err();
    assert!(error.to_string().contains("UTF-16"), "{error}");
}

#[test]
fn stamps_of_any_unit_are_read_and_seconds_that_are_none_refused() {
    let folder = named("stamps");
    let since_1970 = |i: usize| (1_717_171_717_000_000_000_i64 + 20_000_000 * i as i64).to_string();
    let text = table(HEADER, 1.0, since_1970);
    refused(&text, &selection(), &["line 2, column `time_s`", "`time_ns`", "--time-unit ns"]);
    let chosen = Selection { time_unit: Some(TimeUnit::Ns), ..selection() };
    for (text, selection) in
        [(text.replace("time_s", "time_ns"), selection()), (text.clone(), chosen)]
    {
        let found = imported(&folder, &text, &selection).unwrap();
        assert_eq!(demonstrated(&found).sampling_time_s, STEP_S);
        assert!(found.summary[0].contains("times since 1970, from 1717171717.000 s"));
    }
    let milliseconds = table(&HEADER.replace("time_s", "time_ms"), 1.0, |i| (20 * i).to_string());
    let found = imported(&folder, &milliseconds, &selection()).unwrap();
    assert_eq!(demonstrated(&found).sampling_time_s, STEP_S);
    let seconds = table(HEADER, 1.0, |i| format!("{:.3}", 1_717_171_717.0 + STEP_S * i as f64));
    let found = imported(&folder, &seconds, &selection()).unwrap();
    assert!((demonstrated(&found).sampling_time_s - STEP_S).abs() < 1e-6);
    let twice = good().replace(HEADER, &format!("{HEADER},time_ns")).replace('\n', ",1\n");
    let twice = twice.replace("time_ns,1", "time_ns");
    refused(&twice, &selection(), &["column `time_ns`", "--ignore"]);
}

#[test]
fn duplicate_stamps_are_refused_or_dropped() {
    let rows: Vec<String> = good().lines().map(str::to_owned).collect();
    let mut repeated = rows.clone();
    repeated.insert(50, rows[49].replacen(',', ",9", 1));
    let text = repeated.join("\n");
    refused(&text, &selection(), &["sample 49", "--drop-duplicate-stamps"]);
    let folder = named("duplicates");
    let dropping = Selection { drop_duplicate_stamps: true, ..selection() };
    let found = imported(&folder, &text, &dropping).unwrap();
    assert!(
        found.summary[0].contains("101 samples at 50 Hz, 1 samples of duplicate stamps dropped")
    );
    // The first of them is kept.
    let expected = demonstrated(&imported(&folder, &good(), &selection()).unwrap());
    assert_eq!(demonstrated(&found).poses, expected.poses);
    let mut back = rows;
    back.swap(50, 51);
    refused(&back.join("\n"), &dropping, &["sample 50", "sort"]);
}

#[test]
fn holes_in_time_are_warned_of_by_file_sample_and_size() {
    let rows: Vec<String> = good().lines().map(str::to_owned).collect();
    // The header, and 41 samples before the hole.
    let text = [&rows[..42], &rows[71..]].concat().join("\n");
    let hole = "no samples for 0.600 s after sample 40 at 0.800 s";
    refused(&text, &selection(), &[hole, "--sampling-time-s"]);
    let folder = named("holes");
    let resampled = Selection { sampling_time_s: Some(STEP_S), ..selection() };
    let found = imported(&folder, &text, &resampled).unwrap();
    assert_eq!(found.warnings.len(), 1, "{:?}", found.warnings);
    for part in ["rec.csv", hole, "moved by 0.13"] {
        assert!(found.warnings[0].contains(part), "{}", found.warnings[0]);
    }
    assert!(found.summary[0].contains("72 samples at 35.5 Hz resampled to 101 at 50 Hz"));
}

#[test]
fn millimetres_stop_the_import_unless_they_are_asked_for() {
    let millimetres = table(HEADER, 1e3, seconds);
    refused(&millimetres, &selection(), &["rows", "found samples and frames", "--unit mm"]);
    let folder = named("millimetres");
    let in_mm = Selection { unit: Some(LengthUnit::Mm), ..selection() };
    let named_mm = millimetres.replace("x_m,y_m,z_m", "x_mm,y_mm,z_mm");
    let expected = demonstrated(&imported(&folder, &good(), &selection()).unwrap());
    for text in [&millimetres, &named_mm] {
        let found = demonstrated(&imported(&folder, text, &in_mm).unwrap());
        let farthest = std::iter::zip(&found.poses, &expected.poses)
            .map(|(a, b)| (a.position - b.position).length())
            .fold(0.0, f64::max);
        assert!(farthest < 2e-6, "{farthest}");
        assert_eq!(found.goal_frame, expected.goal_frame, "frames are metres by their key");
    }
    // On purpose: a crane.
    let metres = Selection { unit: Some(LengthUnit::M), ..selection() };
    assert!(imported(&folder, &millimetres, &metres).is_ok());
}

#[test]
fn fast_recordings_are_thinned_with_a_word() {
    let folder = named("thinned");
    let rows: Vec<String> = (0..=30_000)
        .map(|i| {
            let t = f64::from(i) / 500.0;
            format!("{t:.3},{:.9},{:.9},0.1", 0.3 * (0.3 * t).sin(), 0.01 * t)
        })
        .collect();
    let text = format!("time_s,x_m,y_m,z_m\n{}\n", rows.join("\n"));
    let usual = Selection { rate_max_hz: Some(100.0), ..selection() };
    let found = imported(&folder, &text, &usual).unwrap();
    let said = "R3, 30001 samples at 500 Hz thinned to 6001 at 100 Hz";
    assert!(found.summary[0].ends_with(said), "{}", found.summary[0]);
    let thin = demonstrated(&found);
    for (i, pose) in thin.poses.iter().enumerate() {
        let t = i as f64 * 0.01;
        assert!((pose.position.x - 0.3 * (0.3 * t).sin()).abs() < 2e-6, "{i}");
    }
    let few = Selection { samples_max: Some(2001), ..usual.clone() };
    let found = imported(&folder, &text, &few).unwrap();
    let said = "30001 samples at 500 Hz thinned to 2001 at 33.3 Hz";
    assert!(found.summary[0].ends_with(said), "{}", found.summary[0]);
    let chosen = Selection { sampling_time_s: Some(0.005), ..few.clone() };
    assert_eq!(demonstrated(&imported(&folder, &text, &chosen).unwrap()).poses.len(), 12_001);
    assert_eq!(demonstrated(&imported(&folder, &text, &selection()).unwrap()).poses.len(), 30_001);
    // At the rate itself nothing is done.
    let slow = imported(&folder, &good(), &Selection { rate_max_hz: Some(50.0), ..selection() });
    assert!(slow.unwrap().summary[0].ends_with("101 samples at 50 Hz"));
}

#[test]
fn frames_come_from_columns_too() {
    let folder = Folder::new("tables-frame-columns");
    let names = ["x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"].map(|part| format!(",object.{part}"));
    let with = |names: &[String], values: &str| {
        let rows: Vec<String> =
            good().lines().skip(1).map(|row| format!("{row}{values}")).collect();
        format!("{HEADER}{}\n{}\n", names.concat(), rows.join("\n"))
    };
    let text = with(&names, ",0.6,-0.1,0.1,0,0,0,1");
    let found = imported(&folder, &text, &selection()).unwrap();
    let demonstration = demonstrated(&found);
    assert_eq!(demonstration.goal_frame.position.to_array(), [0.6, -0.1, 0.1]);
    assert_eq!(demonstration.goal_frame.orientation.z, 1.0);
    assert_eq!(demonstration.start, demonstration.poses[0]);
    for part in ["frame object of columns", "frame ee_start is the tool's pose at the start"] {
        assert!(found.summary[0].contains(part), "{}", found.summary[0]);
    }
    let short = with(&names[..6], ",0.6,-0.1,0.1,1,0,0");
    let message = imported(&folder, &short, &selection()).unwrap_err();
    assert!(message.contains("column `object.qz`"), "{message}");
    let mut loud = names.to_vec();
    loud[3] = ",object.QW".into();
    let message = imported(&folder, &with(&loud, ",0.6,-0.1,0.1,1,0,0,0"), &selection());
    assert!(message.unwrap_err().contains("object.qw"));
    folder.write("rec.frames.json", FRAMES);
    let message = imported(&folder, &text, &selection()).unwrap_err();
    assert!(message.contains("frames.object") && message.contains("once"), "{message}");
}

/// The good table with a column more.
fn with_column(name: &str, cell: impl Fn(usize) -> String) -> String {
    let text = good();
    let rows = text.lines().skip(1).enumerate().map(|(i, row)| format!("{row},{}", cell(i)));
    format!("{HEADER},{name}\n{}\n", rows.collect::<Vec<_>>().join("\n"))
}

#[test]
fn a_column_of_the_gripper_is_read_and_said() {
    let folder = named("gripper");
    let closed = |i: usize| i >= 60;
    let expected: Vec<Grip> =
        (0..SAMPLES).map(|i| if closed(i) { Grip::Closed } else { Grip::Open }).collect();
    let said = "gripper closed in 41 samples of 101";
    for words in [["open", "closed"], ["0", "1"], ["0.0", "1.0"]] {
        let text = with_column("gripper", |i| words[usize::from(closed(i))].into());
        let found = imported(&folder, &text, &selection()).unwrap();
        assert!(found.summary[0].ends_with(said), "{}", found.summary[0]);
        assert_eq!(demonstrated(&found).gripper, Some(Gripper::Grips(expected.clone())));
    }
    // Positions of a gripper, by its end that is closed.
    let text = with_column("jaw", |i| if closed(i) { "12.5" } else { "80" }.into());
    let by_position =
        Selection { gripper: Some("jaw".into()), closed: Some(Closed::Low), ..selection() };
    let found = imported(&folder, &text, &by_position).unwrap();
    assert!(found.summary[0].ends_with(said), "{}", found.summary[0]);
    assert_eq!(demonstrated(&found).gripper, Some(Gripper::Grips(expected)));
    let still = imported(&folder, &with_column("jaw", |_| "80".into()), &by_position).unwrap();
    assert!(still.summary[0].ends_with("the gripper does not move"), "{}", still.summary[0]);
    assert_eq!(demonstrated(&still).gripper, None);
    // Thinned to half as many samples, the nearest tells.
    let text = with_column("gripper", |i| if closed(i) { "closed" } else { "open" }.into());
    let thinned = Selection { sampling_time_s: Some(0.04), ..selection() };
    let demonstration = demonstrated(&imported(&folder, &text, &thinned).unwrap());
    let Some(Gripper::Grips(grips)) = demonstration.gripper else { panic!("it is read") };
    assert_eq!((grips.len(), grips.iter().position(|g| *g == Grip::Closed)), (51, Some(30)));
}

#[test]
fn a_column_of_widths_is_read_and_resampled_on_straight_lines() {
    let folder = named("gripper-width");
    let width_mm = |i: usize| 80.0 - 0.6 * i as f64;
    let text = with_column("gripper_width_m", |i| format!("{:.4}", 1e-3 * width_mm(i)));
    let slow = Selection { sampling_time_s: Some(0.05), ..selection() };
    let found = imported(&folder, &text, &slow).unwrap();
    assert!(found.summary[0].ends_with("gripper 20.0 to 80.0 mm wide"), "{}", found.summary[0]);
    let Some(Gripper::Widths(widths_m)) = demonstrated(&found).gripper else { panic!("widths") };
    assert_eq!(widths_m.len(), 41);
    for (k, width_m) in widths_m.iter().enumerate() {
        assert!((width_m - 1e-3 * (80.0 - 1.5 * k as f64)).abs() < 2e-6, "{k}: {width_m}");
    }
}

#[test]
fn wrong_columns_of_the_gripper_are_refused() {
    let bad = |name: &str, cell: &str| {
        with_column(name, |i| if i == 4 { cell.into() } else { "0".into() })
    };
    refused(&bad("gripper", "0.37"), &selection(), &["line 6", "`gripper`", "--closed", "0.37"]);
    refused(&bad("gripper", "ajar"), &selection(), &["line 6", "`gripper`", "ajar"]);
    refused(&bad("gripper_width_m", "-0.1"), &selection(), &["line 6", "gripper_width_m", "-0.1"]);
    refused(&bad("gripper_width_m", "80"), &selection(), &["line 6", "millimetres"]);
    refused(&bad("gripper_width_m", "wide"), &selection(), &["line 6", "`wide`"]);
    refused(&bad("gripper_width", "0"), &selection(), &["`gripper_width`", "`gripper_width_m`"]);
    refused(&bad("gripper_width_m,gripper", "0,0"), &selection(), &["one column of the gripper"]);
    let closed = Selection { closed: Some(Closed::Low), ..selection() };
    refused(&good(), &closed, &["`gripper`", "--gripper names another"]);
    let folder = named("gripper-ignored");
    let left_out = Selection { ignore: vec!["gripper".into()], ..selection() };
    let found = imported(&folder, &bad("gripper", "0.37"), &left_out).unwrap();
    assert!(found.summary[0].ends_with("ignored: gripper"), "{}", found.summary[0]);
}

#[test]
fn several_files_and_folders_are_imported_at_once() {
    let folder = Folder::new("tables-several");
    for name in ["a/one.csv", "a/two.csv", "b/three.csv"] {
        folder.write(name, &good());
        folder.write(&name.replace(".csv", ".frames.json"), FRAMES);
    }
    for name in ["a/.one.csv", "a/.DS_Store", "a/._two.csv", "a/readme.txt", "a/other.json"] {
        folder.write(name, "\0\0");
    }
    std::fs::create_dir(folder.path().join("a/deeper.csv")).unwrap();
    let at = |name: &str| folder.path().join(name);
    let all = [at("a"), at("b/three.csv")];
    let found = import(&all, &out(&folder), &selection(), Existing::Keep).unwrap();
    let names: Vec<_> = found.written.iter().map(|path| path.file_name().unwrap()).collect();
    assert_eq!(names, ["one.json", "two.json", "three.json"]);
    assert!(found.summary[0].contains("skipped 3 hidden and 3 foreign"), "{:?}", found.summary);
    assert_eq!(found.summary.len(), 4);
    // Hidden files beside demonstrations are nobody's.
    std::fs::write(out(&folder).join("._one.json"), "\0").unwrap();
    let read =
        read_folder(&out(&folder), "made_up", Manifold::R3S3, "ee_start", "object", &[]).unwrap();
    assert_eq!(read.len(), 3);

    // Nothing is replaced, and of two files of one name none is written.
    let again = import(&all, &out(&folder), &selection(), Existing::Keep).unwrap_err();
    assert!(again.to_string().contains("--force"), "{again}");
    folder.write("b/one.csv", &good());
    folder.write("b/one.frames.json", FRAMES);
    let other = at("elsewhere");
    let same = [at("a/one.csv"), at("b/one.csv")];
    let message = import(&same, &other, &selection(), Existing::Keep).unwrap_err().to_string();
    for part in ["b/one.csv", "a/one.csv", "`one.json`", "rename"] {
        assert!(message.contains(part), "{message}");
    }
    assert!(!other.exists());
    folder.write("c/readme.txt", "");
    let message = import(&[at("c")], &other, &selection(), Existing::Keep).unwrap_err();
    assert!(message.to_string().contains("found none"), "{message}");
}
