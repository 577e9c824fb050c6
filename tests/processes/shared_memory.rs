//! Shared memory that is full or missing, and what killed processes leave in it. Each test runs in a mount
//! namespace of its own: nothing here touches the machine's shared memory.

use std::io::{BufRead, BufReader};
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::fs::{FallocateFlags, fallocate, statvfs};
use tprmp_messages::{Instance, RobotState};

use crate::common::{Place, file, finish, program, run, skip, text};
use crate::robot::{Robot, signal};

const INSIDE: &str = "TPRMP_TEST_IN_PRIVATE_MEMORY";
const PLANAR: &str = "config/controllers/planar.ron";
/// Killed processes.
const KILLED: usize = 50;

/// Runs a test of this file once more, with so much shared memory and instances' folders of its own. `true`
/// there.
fn in_private_memory(test: &str, size: &str) -> bool {
    if std::env::var_os(INSIDE).is_some() {
        return true;
    }
    let mount = format!(
        "folder=/tmp/tprmp-$(id -u) && mkdir -p -m 700 $folder && \
         mount -t tmpfs -o mode=700 tmpfs $folder && \
         mount -t tmpfs -o size={size},mode=1777 tmpfs /dev/shm"
    );
    let root = rustix::process::getuid().is_root();
    let inside = |script: &str, arguments: &[&str]| {
        let mut command = Command::new("unshare");
        command.arg(if root { "-m" } else { "-rm" }).args(["sh", "-c", script]);
        command.args(arguments).env(INSIDE, "1").output()
    };
    match inside(&mount, &[]) {
        Ok(output) if output.status.success() => {}
        other => {
            skip(&format!("a /dev/shm of a test's own cannot be mounted: {other:?}"));
            return false;
        }
    }
    let program = std::env::current_exe().expect("a test has a path");
    let script = format!("{mount} && exec \"$0\" --exact --nocapture shared_memory::{test}");
    let output = inside(&script, &[program.to_str().expect("the path is UTF-8")]).unwrap();
    assert!(output.status.success(), "{}: {}", output.status, text(&output));
    assert!(text(&output).contains("1 passed"), "{test} is not the name of a test");
    false
}

/// Fills shared memory up to this many free bytes; an error where somebody else was faster.
fn try_fill(leave_bytes: u64) -> rustix::io::Result<()> {
    let file = std::fs::File::create("/dev/shm/fill").unwrap();
    let system = statvfs("/dev/shm")?;
    let length = (system.f_bavail * system.f_frsize).saturating_sub(leave_bytes);
    fallocate(&file, FallocateFlags::empty(), 0, length.max(1))
}

fn fill(leave_bytes: u64) {
    try_fill(leave_bytes).unwrap();
}

/// A process that says nothing, or only on its standard error.
fn start(command: &mut Command) -> Child {
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts")
}

fn controller(model: &str, instance: &str) -> Child {
    let arguments = ["run", &file(PLANAR), "--model", model, "--instance", instance];
    start(program("controller").args(arguments))
}

/// Waits until a process has said this on its standard error.
fn has_said(child: &mut Child, wanted: &str) {
    let mut lines = BufReader::new(child.stderr.take().expect("it is piped")).lines();
    assert!(lines.any(|line| line.unwrap().contains(wanted)), "it did not say `{wanted}`");
}

fn clean(arguments: &[&str]) -> Output {
    let output = run(program("controller").arg("clean").args(arguments));
    assert!(output.status.success(), "{}", text(&output));
    output
}

#[test]
fn every_program_ends_with_an_error_in_full_memory() {
    if !in_private_memory("every_program_ends_with_an_error_in_full_memory", "8m") {
        return;
    }
    let place = Place::new("full");
    let model = place.train("planar");
    fill(1 << 20);
    let scene = |name: &str| file(&format!("config/scenes/{name}.json"));
    let bridge = |program_name: &str, name: &str| {
        let mut command = program(program_name);
        command.args(["run", "--scene", &scene(name), "--seed", "1", "--out", &place.path(name)]);
        command
    };
    let mut controller = program("controller");
    controller.args(["run", &file(PLANAR), "--model", &model]);
    let mut top = program("controller");
    top.args(["top", "--once"]);
    for mut command in
        [controller, top, bridge("planar-sim", "planar"), bridge("sim-bridge", "pick")]
    {
        let output = run(command.args(["--instance", &place.instance]));
        assert!(output.status.code().is_some_and(|code| code > 0), "{command:?}: {output:?}");
        let said = text(&output);
        assert!(said.contains("/dev/shm has 1048576 bytes free"), "{command:?}: {said}");
    }
    assert_eq!(place.leftovers(), Vec::<std::path::PathBuf>::new());
}

/// Somebody fills shared memory and empties it again while processes start: none of them dies.
#[test]
fn memory_that_fills_at_any_time_of_a_start_is_an_error() {
    if !in_private_memory("memory_that_fills_at_any_time_of_a_start_is_an_error", "16m") {
        return;
    }
    let place = Place::new("filling");
    let model = place.train("planar");
    let done = AtomicBool::new(false);
    let mut outcomes = Vec::new();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                let _ = try_fill(0);
                std::fs::remove_file("/dev/shm/fill").unwrap();
            }
        });
        for round in 0..40 {
            let instance = format!("filling-{round}");
            let scene = file("config/scenes/planar.json");
            let simulator = start(
                program("planar-sim")
                    .args(["run", "--scene", &scene, "--seed", "1", "--instance", &instance])
                    .args(["--out", &place.path(&instance)]),
            );
            let controller = controller(&model, &instance);
            std::thread::sleep(std::time::Duration::from_millis(50));
            for mut child in [controller, simulator] {
                if child.try_wait().unwrap().is_none() {
                    signal(&child, "-INT");
                }
                let output = finish(child);
                // One that is interrupted before it listens to signals ends by that.
                let ended_by = output.status.signal().filter(|signal| *signal != 2);
                assert_eq!(ended_by, None, "round {round}: {}", text(&output));
                outcomes.push(text(&output).contains("bytes free"));
            }
        }
        done.store(true, Ordering::Relaxed);
    });
    assert!(outcomes.contains(&true), "shared memory was never full");
}

/// A controller and a robot that run are not concerned when memory is full and observers come and stand still.
#[test]
fn a_running_controller_outlives_full_memory() {
    if !in_private_memory("a_running_controller_outlives_full_memory", "16m") {
        return;
    }
    let place = Place::new("outlives");
    let (mut robot, mut controller) = crate::robot::start(&place, &[]);
    let instance = Instance::new(&place.instance).unwrap();
    let (observer, reader) = (instance.open_observer().unwrap(), instance.open_status().unwrap());
    robot.run_up_live();
    fill(0);
    for round in 0..1500 {
        robot.live();
        if round % 100 == 0 {
            let error = instance.open_observer().unwrap_err().to_string();
            assert!(error.contains("/dev/shm has 0 bytes free"), "{error}");
            assert_eq!(controller.try_wait().unwrap(), None, "the controller has ended");
        }
    }
    assert!(observer.state.receive().is_some() && reader.status.receive().is_some());
    std::fs::remove_file("/dev/shm/fill").unwrap();
    let late = instance.open_status().unwrap();
    robot.until("a late reader gets the status", Robot::live, |_, _| {
        late.status.receive().is_some()
    });
    crate::robot::stop_live(robot, controller);
}

#[test]
fn fifty_killed_processes_are_cleaned_beside_a_living_one() {
    if !in_private_memory("fifty_killed_processes_are_cleaned_beside_a_living_one", "256m") {
        return;
    }
    assert_eq!(text(&clean(&[])), "nothing to remove\n");
    let place = Place::new("killed");
    let model = place.train("planar");
    let living = Instance::new("killed-0").unwrap();
    let publisher = living.open_state_publisher().unwrap();
    let observer = living.open_observer().unwrap();
    let mut sequence = 0;
    let mut goes_on = || {
        sequence += 1;
        assert!(publisher.state.publish(RobotState { sequence, ..Default::default() }));
        assert_eq!(observer.state.receive().map(|state| state.sequence), Some(sequence));
    };
    for number in 0..KILLED {
        let mut killed = controller(&model, &format!("killed-{number}"));
        has_said(&mut killed, "waiting for state and frames");
        killed.kill().unwrap();
        killed.wait().unwrap();
        goes_on();
    }
    let files = || std::fs::read_dir("/dev/shm").unwrap().count();
    let before = files();
    assert!(before > 5 * KILLED, "{before} files");
    let two = [0, 1].map(|_| start(program("controller").arg("clean")));
    let said = two.map(finish).map(|output| {
        assert!(output.status.success(), "{}", text(&output));
        text(&output)
    });
    goes_on();
    for number in 1..KILLED {
        let line = format!("instance `killed-{number}`: ");
        let by = said.iter().filter(|said| said.contains(&line)).count();
        assert_eq!(by, 1, "instance {number} was cleaned {by} times: {said:?}");
    }
    assert!(said.iter().all(|said| said.contains("2 in use, left alone")), "{said:?}");
    assert!(files() < 15, "{} files", files());
    assert_eq!(text(&clean(&["--instance", "killed-1"])), "nothing to remove\n");
    let left = text(&clean(&["--instance", "killed-0"]));
    assert_eq!(left, "instance `killed-0`: 2 in use, left alone\nnothing to remove\n");
    // Where the killed one was, another one runs.
    let mut again = controller(&model, "killed-0");
    has_said(&mut again, "waiting for state and frames");
    again.kill().unwrap();
    again.wait().unwrap();
    drop((publisher, observer));
    clean(&[]);
    assert_eq!((files(), Instance::all().len()), (0, 0));
}

/// Files in /tmp are removed from under a process by those who clean /tmp; its memory stays its own.
#[test]
fn a_process_whose_folder_was_removed_keeps_its_memory() {
    if !in_private_memory("a_process_whose_folder_was_removed_keeps_its_memory", "16m") {
        return;
    }
    let instance = Instance::new("folderless").unwrap();
    let publisher = instance.open_state_publisher().unwrap();
    let user = rustix::process::getuid().as_raw();
    std::fs::remove_dir_all(format!("/tmp/tprmp-{user}/folderless")).unwrap();
    let files = || std::fs::read_dir("/dev/shm").unwrap().count();
    let before = files();
    clean(&[]);
    assert_eq!(files(), before);
    drop(publisher);
    clean(&[]);
    assert_eq!(files(), 0);
}

/// Processes of another version may name their files otherwise.
#[test]
fn a_folder_in_which_somebody_locks_a_file_stays() {
    if !in_private_memory("a_folder_in_which_somebody_locks_a_file_stays", "16m") {
        return;
    }
    let user = rustix::process::getuid().as_raw();
    let nodes = format!("/tmp/tprmp-{user}/other/nodes");
    std::fs::create_dir_all(&nodes).unwrap();
    let file = std::fs::File::create(format!("{nodes}/otherwise.node_monitor")).unwrap();
    file.lock().unwrap();
    assert!(text(&clean(&[])).contains("instance `other`: 1 in use, left alone"));
    assert!(std::fs::exists(&nodes).unwrap());
    drop(file);
    assert!(text(&clean(&[])).contains("instance `other`: 0 files in shared memory"));
    assert!(!std::fs::exists(&nodes).unwrap());
}

/// What `controller check` says of shared memory, in one line.
fn checked() -> String {
    let output = run(program("controller").args(["check", &file(PLANAR)]));
    let said = text(&output);
    assert!(output.status.success(), "{said}");
    let line = said.lines().find(|line| line.contains("shared memory"));
    line.unwrap_or_else(|| panic!("nothing about shared memory: {said}")).trim().to_string()
}

fn shell(script: &str) {
    let output = run(Command::new("sh").args(["-c", script]));
    assert!(output.status.success(), "{script}: {}", text(&output));
}

#[test]
fn a_check_tells_what_shared_memory_lacks() {
    if !in_private_memory("a_check_tells_what_shared_memory_lacks", "16m") {
        return;
    }
    let starts = |expected: &str| {
        let line = checked();
        let words: Vec<_> = line.split_whitespace().collect();
        assert!(words.join(" ").starts_with(expected), "{line}");
    };
    starts("ok shared memory 16 MiB free in /dev/shm");
    fill(1 << 20);
    starts("lack shared memory /dev/shm has 1048576 bytes free, at least 4194304 are needed");
    shell("mount -o remount,size=0 /dev/shm");
    starts("ok shared memory /dev/shm has no limit");
    shell("mount -t tmpfs -o nr_inodes=20 tmpfs /dev/shm");
    starts("lack shared memory /dev/shm has room for 19 files, at least 64 are needed");
    shell("mount -o remount,ro /dev/shm");
    starts("lack shared memory /dev/shm is not writable by this user");
    shell("mount -t proc proc /dev/shm || mount --rbind /proc /dev/shm");
    starts("lack shared memory /dev/shm is not a tmpfs");
    // Another /dev, with what the programs need of it.
    shell(
        "exec 3<>/dev/null && mount -t tmpfs tmpfs /dev && touch /dev/null && \
         mount --bind /proc/self/fd/3 /dev/null",
    );
    starts("lack shared memory /dev/shm is missing: `mount -t tmpfs");
    let output = run(program("controller").args(["top", "--once"]));
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output).contains("/dev/shm is missing"), "{}", text(&output));
}
