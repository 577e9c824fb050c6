//! Joints of a robot, arrays of several demonstrations and LeRobot data sets: their poses are those of the
//! robot's kinematics and of the numbers written, and no bytes make a reader panic.

use std::path::{Path, PathBuf};

use crate::common::Folder;
use glam::DQuat;
use nalgebra::SVector;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tprmp_files::Existing;
use tprmp_learner::demonstration::{Demonstration, Grip, Gripper, read};
use tprmp_learner::import::{AngleUnit, Closed, Imported, Selection, Space, import, load};
use tprmp_model::controller_config;
use tprmp_model::skill_model::Manifold;
use tprmp_robot::{Chain, Kinematics, forward_kinematics};
use tprmp_spatial::Pose;

const JOINTS: [&str; 6] = [
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
];
const START: [f64; 6] = [-2.4, -1.2, 1.4, -1.6, -1.5, 0.2];
const FRAMES: &str = r#""frames": {
    "object": {"position_m": [0.6, -0.1, 0.1], "quaternion_wxyz": [1, 0, 0, 0]}}"#;

fn config(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/controllers").join(name)
}

fn ur5() -> Selection {
    let robot = Some(config("ur5_pick.ron"));
    Selection { skill: Some("made_up".into()), robot, ..Selection::default() }
}

/// The tool of the UR5 by the kinematics themselves.
fn tool(joints: [f64; 6]) -> Pose {
    let robot = controller_config::read(&config("ur5_pick.ron")).unwrap().robot;
    let chain = Chain::<6>::from_urdf(&robot.urdf, robot.selection()).unwrap();
    let mut kinematics = Kinematics::new();
    forward_kinematics(&chain, &SVector::from(joints), &mut kinematics);
    kinematics.tool_pose()
}

fn same(a: &Pose, b: &Pose) -> bool {
    (a.position - b.position).length() < 2e-6 && a.orientation.dot(b.orientation).abs() > 1.0 - 1e-9
}

fn imported(path: &Path, selection: &Selection) -> Result<Imported, String> {
    let out = path.parent().unwrap().join("out");
    import(&[path], &out, selection, Existing::Replace).map_err(|e| e.to_string())
}

fn all(imported: &Imported) -> Vec<Demonstration> {
    imported.written.iter().map(|path| read(path, "ee_start", "object").unwrap()).collect()
}

/// Joints [rad] at sample i of 50.
fn joints(i: usize) -> [f64; 6] {
    let s = i as f64 / 49.0;
    std::array::from_fn(|k| START[k] + 0.4 * s * s * (3.0 - 2.0 * s) * (k as f64).cos())
}

fn joint_table(names: &[String], unit: f64) -> String {
    let row = |i: usize| {
        let joints = joints(i).map(|q| (q * unit).to_string());
        format!("{:.2},{}", i as f64 * 0.02, joints.join(","))
    };
    let rows: Vec<String> = (0..50).map(row).collect();
    format!("time_s,{}\n{}\n", names.join(","), rows.join("\n"))
}

#[test]
fn joints_become_poses_of_the_tool() {
    let folder = Folder::new("robots-joints");
    folder.write("rec.frames.json", &format!("{{{FRAMES}}}"));
    let names = |end: &str| JOINTS.map(|joint| format!("{joint}{end}"));
    let degrees = Selection { joint_unit: Some(AngleUnit::Deg), ..ur5() };
    for (names, unit, selection) in [
        (names(""), 1.0, ur5()),
        (names("_rad"), 1.0, ur5()),
        (names(".pos"), 1.0, ur5()),
        (names("_deg"), f64::to_degrees(1.0), degrees.clone()),
        (names(""), f64::to_degrees(1.0), degrees.clone()),
    ] {
        let path = folder.write("rec.csv", &joint_table(&names, unit));
        let found = imported(&path, &selection).unwrap();
        let demonstration = &all(&found)[0];
        assert_eq!(demonstration.manifold, Manifold::R3S3);
        for (i, pose) in demonstration.poses.iter().enumerate() {
            assert!(same(pose, &tool(joints(i))), "{i}");
        }
        assert!(same(&demonstration.start, &demonstration.poses[0]));
        let said = "by the joints of ur5_pick.ron, frame ee_start is the tool's pose at the start";
        assert!(found.summary[0].contains(said), "{}", found.summary[0]);
    }
    let say = |text: &str, selection: &Selection, expected: &[&str]| {
        let path = folder.write("rec.csv", text);
        let message = imported(&path, selection).unwrap_err();
        for part in expected {
            assert!(message.contains(part), "`{message}` does not say `{part}`");
        }
    };
    let good = joint_table(&names(""), 1.0);
    say(&good.replace("elbow", "Elbow"), &ur5(), &["column `elbow_joint`", "rename `Elbow_joint`"]);
    let in_degrees = joint_table(&names("_deg"), f64::to_degrees(1.0));
    say(&in_degrees, &ur5(), &["column `shoulder_pan_joint`", "--joint-unit deg"]);
    let unsaid = joint_table(&names(""), f64::to_degrees(1.0));
    say(&unsaid, &ur5(), &["line 2, column `shoulder_pan_joint`", "limits", "--joint-unit deg"]);
    let without = Selection { robot: None, ..ur5() };
    say(&good, &without, &["column `x_m`", "--robot"]);
    let missing = Selection { robot: Some(folder.path().join("none.ron")), ..ur5() };
    say(&good, &missing, &["none.ron"]);
}

#[test]
fn a_point_in_the_plane_is_a_robot_too() {
    let folder = Folder::new("robots-plane");
    folder.write(
        "rec.frames.json",
        &format!("{{{}}}", FRAMES.replace("0.1]", "0]").replace("object", "end")),
    );
    let robot = controller_config::read(&config("planar.ron")).unwrap().robot;
    let rows: Vec<String> = (0..50)
        .map(|i| format!("{:.2},{},{}", 0.02 * f64::from(i), 0.01 * f64::from(i), 0.2))
        .collect();
    let text = format!("time_s,{}\n{}\n", robot.joints.join(","), rows.join("\n"));
    let path = folder.write("rec.csv", &text);
    let robot = Some(config("planar.ron"));
    let selection = Selection { robot, space: Some(Space::R2), ..ur5() };
    let found = imported(&path, &selection).unwrap();
    let demonstration = read(&found.written[0], "start", "end").unwrap();
    assert_eq!(demonstration.manifold, Manifold::R2);
    assert!((demonstration.poses[30].position - glam::DVec3::new(0.3, 0.2, 0.0)).length() < 1e-6);
}

/// An array of two demonstrations of 50 and 40 samples, filled up with NaN.
fn array(columns: usize, number: impl Fn(usize, usize, usize) -> f64) -> Vec<u8> {
    let header =
        format!("{{'descr': '<f8', 'fortran_order': False, 'shape': (2, 50, {columns}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    for (i, sample) in (0..2).flat_map(|i| (0..50).map(move |sample| (i, sample))) {
        for column in 0..columns {
            let is_filled = i == 1 && sample >= 40;
            let number = if is_filled { f64::NAN } else { number(i, sample, column) };
            bytes.extend(number.to_le_bytes());
        }
    }
    bytes
}

#[test]
fn arrays_of_three_axes_hold_several_demonstrations() {
    let folder = Folder::new("robots-npy");
    let number = |i: usize, sample: usize, column: usize| {
        let t = sample as f64 * 0.02;
        [0.3 + i as f64 * 0.1 + t, 0.2 * t * t, 0.1 * t, 7.0][column]
    };
    let path = folder.path().join("rec.npy");
    std::fs::write(&path, array(4, number)).unwrap();
    let frame =
        |x: f64| format!(r#"{{"position_m": [{x}, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}}"#);
    let own = |x: f64, samples: usize| {
        format!(r#"{{"frames": {{"ee_start": {}}}, "samples": {samples}}}"#, frame(x))
    };
    let layout = format!(
        "{{\"columns\": [\"x_m\", \"y_m\", \"z_m\", \"force\"], \"sampling_time_s\": 0.02, {FRAMES},\n\
         \"demonstrations\": [{}, {}]}}",
        own(0.3, 50),
        own(0.4, 40)
    );
    let plain = Selection { robot: None, ..ur5() };
    let say = |layout: &str, selection: &Selection, expected: &[&str]| {
        folder.write("rec.array.json", layout);
        let message = imported(&path, selection).unwrap_err();
        for part in expected {
            assert!(message.contains(part), "`{message}` does not say `{part}`");
        }
    };
    say(&layout.replace("z_m", "Z"), &plain, &["rec.array.json", "column `Z`", "`z_m`"]);
    say(&layout.replace(", \"force\"", ""), &plain, &["`columns`", "4 names", "found 3"]);
    say(&layout.replace("\"samples\": 40", "\"samples\": 51"), &plain, &["array[1]", "at most 50"]);
    say(&layout.replace(", \"samples\": 40", ""), &plain, &["array[1, 40]", "finite", "samples"]);
    say(&layout.replace("0.02", "0"), &plain, &["`sampling_time_s`", "positive"]);
    say(&layout.replace("\"sampling_time_s\": 0.02, ", ""), &plain, &["times once"]);
    say(&layout.replace("\"sampling_time_s\": 0.02", "\"times_s\": [0, 1]"), &plain, &["50 times"]);
    say(&layout.replace("ee_start", "begin"), &plain, &["frames.ee_start", "rec.array.json"]);
    say(&layout.replace("frames", "frame"), &plain, &["rec.array.json", "line"]);
    folder.write("rec.array.json", &layout);
    let found = imported(&path, &plain).unwrap();
    let demonstrations = all(&found);
    assert_eq!(demonstrations.iter().map(|d| d.poses.len()).collect::<Vec<_>>(), [50, 40]);
    assert!(found.summary[1].ends_with("R3, 40 samples at 50 Hz, ignored: force"));
    for (i, demonstration) in demonstrations.iter().enumerate() {
        assert!((demonstration.start.position.x - [0.3, 0.4][i]).abs() < 1e-9);
        for (sample, pose) in demonstration.poses.iter().enumerate() {
            let expected = [0, 1, 2].map(|column| number(i, sample, column));
            assert!((pose.position - glam::DVec3::from(expected)).length() < 2e-6, "{sample}");
        }
    }
    // Joints, and times of each sample.
    let number = |_, sample: usize, column: usize| {
        if column == 0 { 5.0 + sample as f64 * 0.02 } else { joints(sample)[column - 1] }
    };
    std::fs::write(&path, array(7, number)).unwrap();
    let names: Vec<String> = JOINTS.iter().map(|joint| format!("\"{joint}\"")).collect();
    let layout = layout.replace(
        "\"x_m\", \"y_m\", \"z_m\", \"force\"",
        &format!("\"time_s\", {}", names.join(", ")),
    );
    folder.write("rec.array.json", &layout.replace("\"sampling_time_s\": 0.02, ", ""));
    let demonstrations = all(&imported(&path, &ur5()).unwrap());
    assert!(same(&demonstrations[1].poses[39], &tool(joints(39))));
}

/// A copy of the data set that `tests/data/lerobot.py` made, to be changed.
fn lerobot(folder: &Folder) -> PathBuf {
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/lerobot");
    let to = folder.path().join("set");
    for name in
        ["meta/info.json", "data/chunk-000/file-000.parquet", "data/chunk-000/file-001.parquet"]
    {
        std::fs::create_dir_all(to.join(name).parent().unwrap()).unwrap();
        std::fs::copy(from.join(name), to.join(name)).unwrap();
    }
    to
}

/// Joints [rad] of an episode as the script has them.
fn episode_joints(episode: usize, i: usize) -> [f64; 6] {
    let s = i as f64 / (f64::from([31, 25, 28][episode]) - 1.0);
    let bow = s * s * (3.0 - 2.0 * s);
    std::array::from_fn(|k| START[k] + (0.3 + 0.05 * episode as f64) * bow * (k as f64).cos())
}

fn near(a: &Pose, b: &Pose) -> bool {
    // The state has floats of 4 bytes.
    (a.position - b.position).length() < 1e-5 && a.orientation.dot(b.orientation).abs() > 1.0 - 1e-9
}

#[test]
fn lerobot_data_sets_become_demonstrations_by_the_robots_kinematics() {
    let folder = Folder::new("robots-lerobot");
    let set = lerobot(&folder);
    let found = imported(&set, &ur5()).unwrap();
    let demonstrations = all(&found);
    assert!(found.written[2].ends_with("out/made_up_03.json"));
    for (episode, demonstration) in demonstrations.iter().enumerate() {
        assert_eq!(demonstration.poses.len(), [31, 25, 28][episode]);
        assert!((demonstration.sampling_time_s - 0.05).abs() < 1e-6);
        for (i, pose) in demonstration.poses.iter().enumerate() {
            assert!(near(pose, &tool(episode_joints(episode, i))), "{episode}, {i}");
        }
        // The frame stands in columns.
        let goal = demonstration.goal_frame;
        assert!((goal.position.x - 0.3 - 0.1 * episode as f64).abs() < 1e-6);
        assert!(goal.orientation.dot(DQuat::from_rotation_z(0.4)).abs() > 1.0 - 1e-9);
    }
    for part in ["R3xS3, 25 samples at 20 Hz", "frame object of columns", "ignored: gripper.pos"] {
        assert!(found.summary[1].contains(part), "{}", found.summary[1]);
    }
}

#[test]
fn frames_of_lerobot_come_from_a_file_or_from_the_gripper() {
    let folder = Folder::new("robots-lerobot-frames");
    let set = lerobot(&folder);
    let goal = Some("target".to_owned());
    // Where the gripper closes: past the middle of the episode.
    let closing = Selection {
        goal_frame: goal.clone(),
        frame_at_closing: goal.clone(),
        closed: Some(Closed::Low),
        gripper: Some("gripper".into()),
        ..ur5()
    };
    let found = imported(&set, &closing).unwrap();
    for (episode, path) in found.written.iter().enumerate() {
        let demonstration = read(path, "ee_start", "target").unwrap();
        let at = [15, 12, 14][episode];
        let said = format!("frame target where the gripper closes first, sample {at}");
        assert!(found.summary[episode].contains(&said), "{}", found.summary[episode]);
        assert!(near(&demonstration.goal_frame, &tool(episode_joints(episode, at))));
        assert!(demonstration.other_frames.contains_key("object"));
        let Some(Gripper::Grips(grips)) = &demonstration.gripper else { panic!("it is read") };
        assert_eq!(grips.iter().position(|grip| *grip == Grip::Closed), Some(at));
        assert!(found.summary[episode].contains("gripper closed in"), "{}", found.summary[episode]);
    }
    let never = Selection { closed: Some(Closed::High), ..closing.clone() };
    assert!(imported(&set, &never).unwrap_err().contains("--closed"));
    let unsaid = Selection { closed: None, ..closing };
    assert!(imported(&set, &unsaid).unwrap_err().contains("option --closed"));
    // A file of frames, of each episode.
    let own = |x: f64| {
        let frame = format!(r#"{{"position_m": [{x}, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}}"#);
        format!(r#"{{"frames": {{"target": {frame}}}}}"#)
    };
    let text = format!("{{\"demonstrations\": [{}, {}, {}]}}", own(0.1), own(0.2), own(0.3));
    let frames = Some(folder.write("frames.json", &text));
    let by_file = Selection { goal_frame: goal, frames, ..ur5() };
    let found = imported(&set, &by_file).unwrap();
    let third = read(&found.written[2], "ee_start", "target").unwrap();
    assert_eq!(third.goal_frame.position.to_array(), [0.3, 0.0, 0.0]);
    folder.write("frames.json", &text.replace(&format!(", {}", own(0.3)), ""));
    assert!(imported(&set, &by_file).unwrap_err().contains("frames.target"));
    folder.write("frames.json", &text.replace(&own(0.3), &format!("{}, {}", own(0.3), own(0.4))));
    let message = imported(&set, &by_file).unwrap_err();
    assert!(message.contains("3 episodes") && message.contains("found 4"), "{message}");
}

#[test]
fn wrong_lerobot_data_sets_are_refused_by_file_and_key() {
    let folder = Folder::new("robots-lerobot-wrong");
    let set = lerobot(&folder);
    let info = std::fs::read_to_string(set.join("meta/info.json")).unwrap();
    let say = |info: &str, selection: &Selection, expected: &[&str]| {
        std::fs::write(set.join("meta/info.json"), info).unwrap();
        let message = imported(&set, selection).unwrap_err();
        for part in expected {
            assert!(message.contains(part), "`{message}` does not say `{part}`");
        }
    };
    say(&info.replace("v3.0", "v2.1"), &ur5(), &["info.json", "codebase_version", "v2.1"]);
    say(&info.replace("elbow.pos", "motor_3"), &ur5(), &["column `elbow_joint`", "motor_3"]);
    say(&info.replace("elbow.pos", "Elbow.pos"), &ur5(), &["rename `Elbow.pos`"]);
    let other = Selection { state: Some("state".into()), ..ur5() };
    say(&info, &other, &["feature `state`", "observation.state", "--state"]);
    let few = Selection { columns: vec!["a".into()], ..ur5() };
    say(&info, &few, &["features.observation.state.names", "7 names", "found 1", "--columns"]);
    let seven = info.replacen("7\n", "8\n", 1);
    say(&seven, &ur5(), &["names"]);
    say(&info[..100], &ur5(), &["info.json", "line"]);
    let unskilled = Selection { skill: None, ..ur5() };
    say(&info, &unskilled, &["--skill"]);
    let without = Selection { robot: None, ..ur5() };
    say(&info, &without, &["column `x_m`"]);
    std::fs::remove_dir_all(set.join("data/chunk-000")).unwrap();
    say(&info, &ur5(), &["file-000.parquet"]);
}

#[test]
fn damaged_parquet_files_and_arrays_never_panic() {
    let folder = Folder::new("robots-damaged");
    let set = lerobot(&folder);
    let path = set.join("data/chunk-000/file-000.parquet");
    let good = std::fs::read(&path).unwrap();
    let layout = format!(
        "{{\"columns\": [\"x_m\", \"y_m\", \"z_m\", \"a\"], \"sampling_time_s\": 1, {FRAMES}}}"
    );
    folder.write("rec.array.json", &layout);
    let npy = folder.path().join("rec.npy");
    let good_array = array(4, |i, sample, column| (i + sample * column) as f64);
    let (mut refused, cases) = (0, 400);
    for seed in 0..cases {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let damaged = |good: &[u8], random: &mut ChaCha8Rng| {
            let mut bytes = good.to_vec();
            for _ in 0..random.random_range(1..4) {
                // The end of a Parquet file holds its structure.
                let from = if random.random() { bytes.len().saturating_sub(1500) } else { 0 };
                let at = random.random_range(from..bytes.len());
                match random.random_range(0..4) {
                    0 => bytes[at] ^= 1 << random.random_range(0..8),
                    1 => bytes[at] = random.random(),
                    2 => bytes.truncate(at.max(1)),
                    _ => drop(bytes.drain(at..(at + 3).min(bytes.len()))),
                }
                if bytes.is_empty() {
                    break;
                }
            }
            bytes
        };
        std::fs::write(&path, damaged(&good, &mut random)).unwrap();
        let outcome = std::panic::catch_unwind(|| load(&set, &ur5()).is_err());
        assert!(outcome.is_ok(), "seed {seed}: it panicked");
        refused += usize::from(outcome.unwrap_or(false));
        std::fs::write(&npy, damaged(&good_array, &mut random)).unwrap();
        let plain = Selection { robot: None, ..ur5() };
        assert!(std::panic::catch_unwind(|| load(&npy, &plain)).is_ok(), "seed {seed}");
    }
    assert!(refused > cases as usize / 2, "{refused} of {cases} were refused");
}
