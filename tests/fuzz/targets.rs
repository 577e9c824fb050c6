//! What is done with bytes that may be anything: each reader, and the messages. A reader refuses them by
//! name, or gives something that can be used; nothing panics.

use std::path::{Path, PathBuf};

use tprmp_learner::demonstration;
use tprmp_learner::import::{Selection, load};
use tprmp_learner::skill::Skill;
use tprmp_messages::{
    Frame, NAME_CAPACITY, Obstacle, Reason, RobotState, TaskFrames, ToolCommand, name_str,
};
use tprmp_model::{controller_config, fixed_frames, skill_model};
use tprmp_robot::{Chain, ControlPoints, count_joints};

/// A reader, and where good files for it are.
pub(crate) struct Target {
    /// Its name, and that of its folder in `corpus`.
    pub(crate) name: &'static str,
    /// What is done with the bytes.
    pub(crate) run: fn(&[u8]),
    /// A folder of the repository with good files …
    #[allow(dead_code, reason = "for the ordinary test")]
    pub(crate) seeds: &'static str,
    /// … of this extension.
    #[allow(dead_code, reason = "for the ordinary test")]
    pub(crate) extension: &'static str,
}

/// All of them.
pub(crate) const TARGETS: [Target; 11] = [
    Target { name: "urdf", run: urdf, seeds: "config/robots", extension: "urdf" },
    Target { name: "model", run: model, seeds: "learner/tests/golden", extension: "ron" },
    Target {
        name: "configuration",
        run: configuration,
        seeds: "config/controllers",
        extension: "ron",
    },
    Target { name: "frames", run: frames, seeds: "config/frames", extension: "ron" },
    Target { name: "skill", run: skill, seeds: "config/skills", extension: "ron" },
    Target {
        name: "demonstration",
        run: demonstration,
        seeds: "config/demonstrations/pick",
        extension: "json",
    },
    Target {
        name: "csv",
        run: |data| import(data, "csv"),
        seeds: "tests/fuzz/corpus/csv",
        extension: "csv",
    },
    Target {
        name: "npz",
        run: |data| import(data, "npz"),
        seeds: "tests/fuzz/corpus/npz",
        extension: "npz",
    },
    Target {
        name: "mat",
        run: |data| import(data, "mat"),
        seeds: "tests/fuzz/corpus/mat",
        extension: "mat",
    },
    Target {
        name: "thesis",
        run: |data| import(data, "json"),
        seeds: "tests/fuzz/corpus/thesis",
        extension: "json",
    },
    Target { name: "messages", run: messages, seeds: "config/robots", extension: "urdf" },
];

/// A file of this process and thread with these bytes.
fn file(data: &[u8], extension: &str) -> PathBuf {
    let thread =
        format!("{:?}", std::thread::current().id()).replace(|c: char| !c.is_alphanumeric(), "");
    let path = std::env::temp_dir()
        .join(format!("tprmp-fuzz-{}-{thread}.{extension}", std::process::id()));
    std::fs::write(&path, data).expect("the folder for temporary files can be written");
    path
}

/// A refusal names the file, and can be read at a glance.
fn refused(path: &Path, error: &dyn std::error::Error) {
    let message = error.to_string();
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    assert!(message.contains(&*name), "it does not name the file: {message}");
}

fn urdf(data: &[u8]) {
    let path = file(data, "urdf");
    match count_joints(&path, "suction_tip") {
        Err(error) => refused(&path, &error),
        Ok(6) => match Chain::<6>::from_urdf(&path, "suction_tip") {
            Err(error) => refused(&path, &error),
            Ok(chain) => drop(ControlPoints::new(&chain)),
        },
        Ok(_) => {}
    }
}

fn model(data: &[u8]) {
    let path = file(data, "ron");
    let read = skill_model::read(&path);
    match &read {
        Err(error) => refused(&path, error),
        Ok(model) => {
            if let Ok(policy) = model.policy() {
                // That it is another model's certificate is an answer too.
                let _ = skill_model::verify(model, &policy, &path);
            }
        }
    }
}

fn configuration(data: &[u8]) {
    let path = file(data, "ron");
    if let Err(error) = controller_config::read(&path) {
        refused(&path, &error);
    }
}

fn frames(data: &[u8]) {
    let path = file(data, "ron");
    if let Err(error) = fixed_frames::read(&path) {
        refused(&path, &error);
    }
}

fn skill(data: &[u8]) {
    let path = file(data, "ron");
    if let Err(error) = Skill::read(&path) {
        refused(&path, &error);
    }
}

fn demonstration(data: &[u8]) {
    let path = file(data, "json");
    match demonstration::read(&path, "ee_start", "object") {
        Err(error) => refused(&path, &error),
        Ok(read) => drop(demonstration::to_text(&read, "ee_start", "object")),
    }
}

fn import(data: &[u8], extension: &str) {
    let path = file(data, extension);
    let frames = r#"{"frames": {
        "start": {"position_m": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]},
        "end": {"position_m": [1, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}}}"#;
    std::fs::write(path.with_extension("frames.json"), frames).expect("the folder can be written");
    for sampling_time_s in [None, Some(0.01)] {
        let selection =
            Selection { skill: Some("fuzz".into()), sampling_time_s, ..Selection::default() };
        if let Err(error) = load(&path, &selection) {
            refused(&path, &error);
        }
    }
}

/// Numbers made of bytes, zeros at their end.
struct Numbers<'a>(&'a [u8]);

impl Numbers<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (now, rest) = self.0.split_at(self.0.len().min(N));
        self.0 = rest;
        let mut bytes = [0; N];
        bytes[..now.len()].copy_from_slice(now);
        bytes
    }

    fn word(&mut self) -> u32 {
        // Mostly small: the counts and marks that there are.
        let [first, second] = self.bytes();
        if first > 250 { u32::from_le_bytes(self.bytes()) } else { u32::from(second % 40) }
    }

    fn floats<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| f64::from_le_bytes(self.bytes()))
    }
}

fn messages(data: &[u8]) {
    let mut from = Numbers(data);
    let state = RobotState {
        joint_count: from.word(),
        position: from.floats(),
        velocity: from.floats(),
        torque: from.floats(),
        ..Default::default()
    };
    for joints in 0..=8 {
        if let Ok(checked) = state.check(joints) {
            assert!(checked.iter().all(|values| values.len() == joints));
            assert!(checked.concat().iter().all(|value| value.is_finite()));
        }
    }
    let mut frames =
        TaskFrames { frame_count: from.word(), obstacle_count: from.word(), ..Default::default() };
    for frame in &mut frames.frames {
        *frame = Frame {
            name: from.bytes::<NAME_CAPACITY>(),
            valid: from.word(),
            position: from.floats(),
            quaternion: from.floats(),
            linear_velocity: from.floats(),
            ..Default::default()
        };
    }
    for obstacle in &mut frames.obstacles {
        *obstacle = Obstacle {
            kind: from.word(),
            valid: from.word(),
            position: from.floats(),
            quaternion: from.floats(),
            size: from.floats(),
            ..Default::default()
        };
    }
    for frame in frames.listed().unwrap_or_default() {
        let is_named = name_str(&frame.name).is_some();
        assert!(Frame::find(&frames.frames, &frame.name).is_some() || !is_named);
        if frame.check().is_ok() {
            assert!(frame.position.iter().chain(&frame.quaternion).all(|x| x.is_finite()));
        }
    }
    if let Ok(present) = frames.present() {
        for obstacle in present {
            if obstacle.check().is_ok() {
                assert!(obstacle.position.iter().all(|x| x.is_finite()));
            }
        }
    }
    let command = ToolCommand { linear_velocity: from.floats(), ..Default::default() };
    assert_eq!(command.is_finite(), command.linear_velocity.iter().all(|x| x.is_finite()));
    let _ = Reason::from_wire(from.word());
}
