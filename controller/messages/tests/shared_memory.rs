//! Shared memory that is full, and files that are not this user's own.

use std::fs;
use std::io::Write;
use std::os::unix::fs::{PermissionsExt, chown, symlink};
use std::path::{self, PathBuf};
use std::process::Command;

use iceoryx2::prelude::*;
use tprmp_messages::{Instance, OBSERVER_BUFFER, RobotState, ServiceError, SharedMemoryFault};

/// A user other than whoever runs the tests.
const OTHER_USER: u32 = 54321;
const PAGE_BYTES: u64 = 4096;

fn user() -> u32 {
    rustix::process::getuid().as_raw()
}

fn instance(test: &str) -> Instance {
    Instance::new(&format!("{test}-{}", std::process::id())).unwrap()
}

fn folder(instance: &Instance) -> PathBuf {
    format!("/tmp/tprmp-{}/{}", user(), instance.name()).into()
}

/// Reports a test that this machine cannot run; where it has to be able to, the test fails.
fn skip(why: &str) {
    let required = std::env::var("TPRMP_REQUIRE_REALTIME").is_ok_and(|value| value == "1");
    assert!(!required, "TPRMP_REQUIRE_REALTIME=1, but {why}");
    let _ = writeln!(std::io::stderr(), "skipped: {why}");
}

/// Runs a test once more in a mount namespace of its own, with 8 MiB of shared memory and an empty folder of
/// instances. `true` there.
fn in_small_memory(test: &str) -> bool {
    if std::env::var_os("TPRMP_TEST_IN_SMALL_MEMORY").is_some() {
        return true;
    }
    let mount = "folder=/tmp/tprmp-$(id -u) && mkdir -p -m 700 $folder && \
                 mount -t tmpfs -o mode=700 tmpfs $folder && \
                 mount -t tmpfs -o size=8m tmpfs /dev/shm";
    let inside = |script: &str, arguments: &[&str]| {
        let mut command = Command::new("unshare");
        command.arg(if user() == 0 { "-m" } else { "-rm" }).args(["sh", "-c", script]);
        command.args(arguments).env("TPRMP_TEST_IN_SMALL_MEMORY", "1").output()
    };
    match inside(mount, &[]) {
        Ok(output) if output.status.success() => {}
        other => {
            skip(&format!("a small /dev/shm cannot be mounted: {other:?}"));
            return false;
        }
    }
    let program = std::env::current_exe().unwrap();
    let script = format!("{mount} && exec \"$0\" --exact --nocapture {test}");
    let output = inside(&script, &[program.to_str().unwrap()]).unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{}: {text}", output.status);
    false
}

/// Fills shared memory up to this many free bytes.
fn fill(leave_bytes: u64) {
    let file = fs::File::create("/dev/shm/fill").unwrap();
    let system = rustix::fs::statvfs("/dev/shm").unwrap();
    let length = system.f_bavail * system.f_frsize - leave_bytes;
    rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, length.max(1)).unwrap();
}

/// What may be free is less than anything that is checked in advance.
#[test]
fn iceoryx2_fails_instead_of_being_ended_wherever_memory_runs_out() {
    if !in_small_memory("iceoryx2_fails_instead_of_being_ended_wherever_memory_runs_out") {
        return;
    }
    set_log_level(LogLevel::Fatal);
    // So that this crate is linked, with its `ftruncate`.
    assert!(instance("linked").open_observer().is_ok());
    let mut outcomes = Vec::new();
    for pages in 1..=200 {
        let name = format!("full-{pages}_");
        let mut config = Config::default();
        config.global.prefix = FileName::new(name.as_bytes()).unwrap();
        let root = format!("/tmp/tprmp-{}/full/", user());
        config.global.set_root_path(&Path::new(root.as_bytes()).unwrap());
        fill(pages * PAGE_BYTES);
        let open = || -> Result<(), Box<dyn core::error::Error>> {
            let node = NodeBuilder::new().config(&config).create::<ipc::Service>()?;
            let service =
                node.service_builder(&"full".try_into()?).publish_subscribe::<RobotState>();
            let service = service.subscriber_max_buffer_size(OBSERVER_BUFFER).open_or_create()?;
            let publisher = service.publisher_builder().create()?;
            let subscriber = service.subscriber_builder().create()?;
            for _ in 0..2 * OBSERVER_BUFFER {
                publisher.loan_uninit()?.write_payload(RobotState::default()).send()?;
            }
            drop(subscriber);
            Ok(())
        };
        outcomes.push(open().is_ok());
        fs::remove_file("/dev/shm/fill").unwrap();
    }
    assert!(outcomes.contains(&false) && outcomes.contains(&true), "{outcomes:?}");
}

#[test]
fn too_little_memory_is_an_error_and_leaves_nothing() {
    if !in_small_memory("too_little_memory_is_an_error_and_leaves_nothing") {
        return;
    }
    fill(2 << 20);
    let robot = instance("little");
    let error = robot.open_state_publisher().unwrap_err();
    let full = SharedMemoryFault::Full { free: 2 << 20 };
    assert_eq!(error.to_string(), full.to_string());
    assert!(!folder(&robot).exists());
    assert_eq!(fs::read_dir("/dev/shm").unwrap().count(), 1, "the one that fills it");
    fs::remove_file("/dev/shm/fill").unwrap();
    // Files are counted, too.
    let mount = ["-t", "tmpfs", "-o", "nr_inodes=40", "tmpfs", "/dev/shm"];
    assert!(Command::new("mount").args(mount).status().unwrap().success());
    let error = robot.open_state_publisher().unwrap_err();
    let fault = ServiceError::SharedMemory(SharedMemoryFault::TooManyFiles { free: 39 });
    assert_eq!(error.to_string(), fault.to_string());
}

#[test]
fn readers_that_stand_still_end_nobody_in_full_memory() {
    if !in_small_memory("readers_that_stand_still_end_nobody_in_full_memory") {
        return;
    }
    let instance = instance("still");
    let robot = instance.open_state_publisher().unwrap();
    let controller = instance.open_controller().unwrap();
    let observer = instance.open_observer().unwrap();
    let reader = instance.open_status().unwrap();
    fill(0);
    for sequence in 1..=4 * OBSERVER_BUFFER as u64 {
        assert!(robot.state.publish(RobotState { sequence, ..Default::default() }));
        assert!(controller.status.publish(Default::default()));
        assert!(controller.command.publish(Default::default()) && controller.update_connections());
        if sequence % 100 == 0 {
            let error = instance.open_observer().unwrap_err();
            assert!(matches!(error, ServiceError::SharedMemory(_)), "{error}");
        }
    }
    let newest = std::iter::from_fn(|| controller.state.receive().map(|s| s.sequence)).last();
    assert_eq!(newest, Some(4 * OBSERVER_BUFFER as u64));
    assert_eq!(observer.state.receive().unwrap().sequence, 3 * OBSERVER_BUFFER as u64 + 1);
    assert!(reader.status.receive().is_some());
    fs::remove_file("/dev/shm/fill").unwrap();
    let late = instance.open_observer().unwrap();
    assert!(robot.state.publish(RobotState { sequence: 7, ..Default::default() }));
    assert!(std::iter::from_fn(|| late.state.receive()).any(|state| state.sequence == 7));
}

/// An error names the file and whoever has to act, and nothing is opened.
fn is_refused(instance: &Instance, path: &path::Path, expected: &str) {
    let error = instance.open_controller().unwrap_err().to_string();
    assert!(error.contains(&format!("`{}`", path.display())), "{error}");
    assert!(error.contains(expected), "{error}");
    // What is not ours is not cleaned either.
    let error = instance.clean().unwrap_err().to_string();
    assert!(error.contains(expected), "{error}");
    assert!(path.symlink_metadata().is_ok());
}

#[test]
fn folders_that_others_can_write_and_links_are_refused() {
    let open = instance("open");
    drop(open.open_observer().unwrap());
    fs::create_dir(folder(&open)).unwrap();
    for mode in [0o770, 0o707, 0o777] {
        fs::set_permissions(folder(&open), fs::Permissions::from_mode(mode)).unwrap();
        is_refused(&open, &folder(&open), &format!("can be written by others (mode {mode:o})"));
    }
    fs::set_permissions(folder(&open), fs::Permissions::from_mode(0o755)).unwrap();
    fs::create_dir(folder(&open).join("nodes")).unwrap();
    let file = folder(&open).join("nodes/file");
    fs::write(&file, "").unwrap();
    fs::set_permissions(&file, fs::Permissions::from_mode(0o666)).unwrap();
    is_refused(&open, &file, "can be written by others (mode 666)");
    fs::remove_dir_all(folder(&open)).unwrap();
    let elsewhere = std::env::temp_dir().join(format!("tprmp-elsewhere-{}", std::process::id()));
    fs::create_dir_all(&elsewhere).unwrap();
    symlink(&elsewhere, folder(&open)).unwrap();
    is_refused(&open, &folder(&open), "is a link or a file in place of a folder: remove it");
    assert_eq!(fs::read_dir(&elsewhere).unwrap().count(), 0, "the link was followed");
    fs::remove_file(folder(&open)).unwrap();
    fs::remove_dir(elsewhere).unwrap();
    assert!(open.open_controller().is_ok());
}

#[test]
fn files_of_another_user_are_refused() {
    if user() != 0 {
        let _ = writeln!(std::io::stderr(), "skipped: only root can give a file to another user");
        return;
    }
    let foreign = instance("foreign");
    drop(foreign.open_observer().unwrap());
    fs::create_dir(folder(&foreign)).unwrap();
    chown(folder(&foreign), Some(OTHER_USER), None).unwrap();
    let expected = format!("belongs to user {OTHER_USER}, not to user 0");
    is_refused(&foreign, &folder(&foreign), &expected);
    chown(folder(&foreign), Some(0), None).unwrap();
    let file = path::Path::new("/dev/shm").join(format!("tprmp_0_{}_some.dynamic", foreign.name()));
    fs::write(&file, "").unwrap();
    fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).unwrap();
    chown(&file, Some(OTHER_USER), None).unwrap();
    is_refused(&foreign, &file, &expected);
    chown(&file, Some(0), None).unwrap();
    let cleaned = foreign.clean().unwrap();
    assert_eq!((cleaned.shared_files, cleaned.paths, cleaned.living), (1, 1, 0));
}

/// Whoever was killed between creating a file and initialising it would be waited for without an end.
#[test]
fn files_that_were_never_initialised_are_in_nobodys_way() {
    let killed = instance("unfinished");
    let names = {
        let _robot = killed.open_state_publisher().unwrap();
        let prefix = format!("tprmp_{}_{}_", user(), killed.name());
        let all = fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().path());
        let of_instance = all.filter(|path| path.to_string_lossy().contains(&prefix));
        of_instance.filter(|path| path.extension().unwrap() != "data").collect::<Vec<_>>()
    };
    assert!(names.len() >= 5, "{names:?}");
    for name in names {
        fs::write(&name, "").unwrap();
        fs::set_permissions(&name, fs::Permissions::from_mode(0o200)).unwrap();
    }
    let _robot = killed.open_state_publisher().unwrap();
    let cleaned = killed.clean().unwrap();
    assert_eq!((cleaned.shared_files, cleaned.living), (0, 1));
}
