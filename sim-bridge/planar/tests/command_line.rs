//! The command line as a user meets it: exit codes, errors, a run beside a small controller.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use tprmp_messages::{
    CommandMode, ControllerStatus, Instance, JointCommand, LifeCycle, Reason, RobotState,
    TaskFrames, name_str,
};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/scenes/planar.json");
/// A peer that does not answer fails the test after this time.
const PATIENCE: Duration = Duration::from_secs(60);

/// A folder of its own for a test, gone with it.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("planar-{test}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).unwrap();
    }
}

fn planar_sim(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_planar-sim")).args(arguments).output().unwrap()
}

fn start_run(out: &Path, instance: &str, more: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_planar-sim"))
        .args(["run", "--seed", "4", "--scene", SCENE, "--instance", instance, "--out"])
        .arg(out)
        .args(more)
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

fn instance(test: &str) -> String {
    format!("{test}-{}", std::process::id())
}

/// What a small controller sees of a run.
#[derive(Default)]
struct Seen {
    states: Vec<RobotState>,
    frames: Option<TaskFrames>,
}

/// A controller that answers every state in lockstep: it draws the point to the goal frame with a
/// spring, says Done from the state `done_at` on, and leaves at `leave_at`. `wanted` may change a
/// command before it is sent.
fn control(
    instance: &str,
    done_at: u64,
    leave_at: u64,
    wanted: impl Fn(u64, &mut JointCommand),
) -> Seen {
    let ports = Instance::new(instance).unwrap().open_controller().unwrap();
    let mut seen = Seen::default();
    let begun = Instant::now();
    let (mut sequence, mut state) = (0, None);
    while sequence < leave_at {
        assert!(begun.elapsed() < PATIENCE, "no state after state {sequence}");
        if !(ports.command.update_connections() & ports.status.update_connections()) {
            continue;
        }
        state = ports.state.receive().map(|state| *state).or(state);
        seen.frames = ports.frames.receive().map(|frames| *frames).or(seen.frames);
        // Of a run that is just starting, the state may be seen before the frames.
        let (Some(newest), Some(frames)) = (state, seen.frames) else {
            std::thread::yield_now();
            continue;
        };
        state = None;
        let goal = frames.frames[1].position;
        sequence += 1;
        let mut command = JointCommand {
            sequence,
            state_sequence: newest.sequence,
            time_ns: newest.time_ns,
            expiry_ns: newest.time_ns + 50_000_000,
            mode: CommandMode::Track.to_wire(),
            joint_count: 2,
            ..Default::default()
        };
        for (i, goal) in goal.iter().enumerate().take(2) {
            command.torque[i] = 20.0 * (goal - newest.position[i]) - 10.0 * newest.velocity[i];
        }
        if sequence == leave_at {
            command.mode = CommandMode::Stop.to_wire();
            command.reason = Reason::StopRequested.to_wire();
        }
        wanted(sequence, &mut command);
        seen.states.push(newest);
        assert!(ports.command.publish(command));
        let life_cycle = if sequence < done_at { LifeCycle::Running } else { LifeCycle::Done };
        assert!(ports.status.publish(ControllerStatus {
            sequence,
            ticks: sequence,
            life_cycle: life_cycle.to_wire(),
            ..Default::default()
        }));
    }
    seen
}

#[test]
fn bad_input_is_refused_with_file_and_key() {
    let folder = Folder::new("bad-input");
    let text = std::fs::read_to_string(SCENE).unwrap();
    let scene = folder.0.join("scene.json");
    std::fs::write(&scene, text.replace("\"swing_m\"", "\"swing_cm\"")).unwrap();
    let scene = scene.display().to_string();
    let out = folder.0.join("out").display().to_string();
    let run = planar_sim(&["run", "--seed", "1", "--scene", &scene, "--out", &out]);
    let error = String::from_utf8(run.stderr).unwrap();
    assert_eq!(run.status.code(), Some(1));
    for part in [scene.as_str(), "obstacle.swing_cm", "expected"] {
        assert!(error.contains(part), "{error}");
    }
    let report = planar_sim(&["report", &out]);
    assert_eq!(report.status.code(), Some(1));
    assert!(String::from_utf8(report.stderr).unwrap().contains("bridge.json"));
    let nobody = planar_sim(&["run", "--seed", "1", "--scene", "none.json", "--out", &out]);
    assert!(String::from_utf8(nobody.stderr).unwrap().contains("none.json"));
    let bare = planar_sim(&["run", "--seed", "1", "--out", &out, "--record-commands", "x"]);
    assert_eq!(bare.status.code(), Some(2), "commands are recorded in lockstep only");
}

#[test]
fn recorded_demonstrations_are_those_in_the_repository() {
    let folder = Folder::new("record");
    let out = folder.0.display().to_string();
    assert!(planar_sim(&["record", "--scene", SCENE, "--out", &out]).status.success());
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/demonstrations/planar");
    let names = |folder: &Path| {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name()).collect();
        names.sort();
        names
    };
    assert_eq!(names(&folder.0), names(&kept));
    for name in names(&kept) {
        let same = std::fs::read(folder.0.join(&name)).unwrap()
            == std::fs::read(kept.join(&name)).unwrap();
        assert!(same, "{name:?}");
    }
}

#[test]
fn a_lockstep_run_is_the_same_twice_and_ends_when_the_controller_leaves() {
    let folder = Folder::new("lockstep");
    let mut recordings = Vec::new();
    for name in ["a", "b"] {
        let (out, name) = (folder.0.join(name), instance(name));
        let commands = out.join("commands.bin").display().to_string();
        let mut run = start_run(&out, &name, &["--lockstep", "--record-commands", &commands]);
        let seen = control(&name, 500, 1400, |_, _| {});
        assert!(run.wait().unwrap().success());
        let frames = seen.frames.unwrap();
        assert_eq!(name_str(&frames.frames[0].name), Some("start"));
        assert_eq!(name_str(&frames.frames[1].name), Some("end"));
        assert_eq!((frames.frame_count, frames.obstacle_count), (2, 1));
        assert_eq!(seen.states[0].position[..2], frames.frames[0].position[..2]);
        assert_eq!(seen.states[0].time_ns, 1_000_000_000);
        assert_eq!(seen.states[1].time_ns, 1_001_000_000);
        let recorded = std::fs::read(commands).unwrap();
        assert_eq!(recorded.len(), 1400 * size_of::<JointCommand>());
        recordings.push(recorded);
        let bridge = std::fs::read_to_string(out.join("bridge.json")).unwrap();
        assert!(bridge.contains("\"outcome\": \"done\""), "{bridge}");
        let left = std::fs::read_dir("/dev/shm").unwrap().flatten().any(|entry| {
            let file = entry.file_name().to_string_lossy().into_owned();
            file.contains(&format!("_{name}_"))
        });
        assert!(!left, "shared memory files are left");
    }
    assert!(recordings[0] == recordings[1]);
}

#[test]
fn another_runs_files_stay_without_force() {
    let folder = Folder::new("force");
    let out = folder.0.display().to_string();
    let log = folder.0.join("log.csv");
    std::fs::write(&log, "theirs").unwrap();
    for arguments in [&["run", "--seed", "1"][..], &["record"]] {
        std::fs::write(folder.0.join("06.json"), "theirs").unwrap();
        let output = planar_sim(&[arguments, &["--scene", SCENE, "--out", &out]].concat());
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains("is there already") && said.contains("--force"), "{said}");
        let mut names: Vec<_> =
            std::fs::read_dir(&folder.0).unwrap().map(|e| e.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["06.json", "log.csv"]);
    }
    assert_eq!(std::fs::read_to_string(&log).unwrap(), "theirs");
    let forced = planar_sim(&["record", "--scene", SCENE, "--out", &out, "--force"]);
    assert!(forced.status.success());
    assert_ne!(std::fs::read_to_string(folder.0.join("06.json")).unwrap(), "theirs");
}

/// The point moves on, and the end tells.
#[test]
fn a_log_that_cannot_be_written_at_the_end_is_told() {
    let folder = Folder::new("lost");
    let (name, out) = (instance("lost"), folder.0.join("out"));
    let mut run = start_run(&out, &name, &["--lockstep"]);
    let seen = control(&name, 300, 1400, |sequence, _| {
        if sequence == 100 {
            std::fs::remove_dir_all(&out).unwrap();
            std::fs::write(&out, "a file in the way").unwrap();
        }
    });
    assert_eq!(seen.states.len(), 1400);
    assert_eq!(run.wait().unwrap().code(), Some(1));
}

#[test]
fn expired_commands_and_stops_brake() {
    let folder = Folder::new("brake");
    let name = instance("brake");
    let mut run = start_run(&folder.0, &name, &["--lockstep"]);
    let seen = control(&name, u64::MAX, 700, |sequence, command| {
        if (301..400).contains(&sequence) {
            command.expiry_ns = command.time_ns;
        }
        if (501..600).contains(&sequence) {
            command.mode = CommandMode::Stop.to_wire();
        }
    });
    // The controller left before the task was done.
    assert_eq!(run.wait().unwrap().code(), Some(1));
    let speed = |i: usize| seen.states[i].velocity[0].hypot(seen.states[i].velocity[1]);
    assert!(speed(300) > 0.5 && speed(500) > 0.1);
    for i in [310, 350, 400, 510, 599] {
        assert!(speed(i - 1) < 1e-12, "state {i}: {}", speed(i - 1));
    }
    let most = seen.states.iter().flat_map(|s| s.torque).fold(0.0, |m: f64, f| m.max(f.abs()));
    assert!(most <= 400.0, "{most}");
}

#[test]
fn in_real_time_the_clock_waits_for_the_controller_and_a_signal_ends_the_run() {
    let folder = Folder::new("signal");
    let name = instance("signal");
    let mut run = start_run(&folder.0, &name, &[]);
    let ports = Instance::new(&name).unwrap().open_controller().unwrap();
    let begun = Instant::now();
    let mut states = 0;
    while states < 50 {
        assert!(begun.elapsed() < PATIENCE, "no states");
        if let (Some(state), Some(frames)) = (ports.state.receive(), ports.frames.receive()) {
            states += 1;
            assert_eq!(state.velocity, [0.0; 8]);
            assert_eq!(frames.frames[1].linear_velocity, [0.0; 3]);
        }
    }
    let process = rustix::process::Pid::from_child(&run);
    rustix::process::kill_process(process, rustix::process::Signal::INT).unwrap();
    assert!(run.wait().unwrap().success());
    let bridge = std::fs::read_to_string(folder.0.join("bridge.json")).unwrap();
    assert!(bridge.contains("\"outcome\": \"interrupted\""), "{bridge}");
    assert!(bridge.contains("\"simulated_s\": 0.0"), "{bridge}");
}

/// Their expiry says for ever; it counts for a tenth of a second after the last one.
#[test]
fn in_real_time_no_command_moves_the_point_for_ever() {
    let folder = Folder::new("for-ever");
    let name = instance("for-ever");
    let mut run = start_run(&folder.0, &name, &[]);
    let ports = Instance::new(&name).unwrap().open_controller().unwrap();
    let begun = Instant::now();
    let (mut sequence, mut moved) = (0, false);
    loop {
        assert!(begun.elapsed() < PATIENCE, "{sequence} commands, and it does not come to rest");
        assert!(ports.command.update_connections());
        let Some(state) = ports.state.receive() else { continue };
        let moving = state.velocity[0].abs() > 1e-9;
        if !moving && !moved {
            sequence += 1;
            let mut command = JointCommand {
                sequence,
                state_sequence: state.sequence,
                time_ns: state.time_ns,
                expiry_ns: u64::MAX,
                mode: CommandMode::Track.to_wire(),
                joint_count: 2,
                ..Default::default()
            };
            command.torque[0] = 10.0;
            assert!(ports.command.publish(command));
        }
        if moved && !moving {
            break;
        }
        moved |= moving;
    }
    let process = rustix::process::Pid::from_child(&run);
    rustix::process::kill_process(process, rustix::process::Signal::INT).unwrap();
    assert!(run.wait().unwrap().success());
    let bridge = std::fs::read_to_string(folder.0.join("bridge.json")).unwrap();
    assert!(bridge.contains("\"expired\""), "{bridge}");
}
