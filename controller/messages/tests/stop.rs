//! What signals do to a process that asked for the flag. They go to a process of the test's own:
//! this program again, in which only [`asked`] runs.

use std::io::{BufRead, BufReader, Lines};
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::atomic::Ordering;
use std::thread::sleep;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};
use tprmp_messages::stop_flag;

const CHILD: &str = "TPRMP_TEST_STOP_CHILD";

/// The other process: reports the flag, and goes on.
#[test]
fn asked() {
    if std::env::var_os(CHILD).is_none() {
        return;
    }
    let stop = stop_flag().unwrap();
    println!("\nready");
    while !stop.load(Ordering::Relaxed) {
        sleep(Duration::from_millis(1));
    }
    println!("stop");
    // It ends by a signal, or when the test is gone.
    let _ = std::io::stdin().read_line(&mut String::new());
    println!("goes on");
}

fn start() -> (Child, Lines<BufReader<ChildStdout>>) {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "asked", "--nocapture"])
        .env(CHILD, "1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    wait_for(&mut lines, "ready");
    (child, lines)
}

fn wait_for(lines: &mut Lines<BufReader<ChildStdout>>, text: &str) {
    assert!(lines.any(|line| line.unwrap() == text), "it ended before `{text}`");
}

fn send(child: &Child, signal: Signal) {
    kill_process(Pid::from_child(child), signal).unwrap();
}

/// Launchers and supervisors send theirs to a process and to its group.
#[test]
fn signals_at_once_are_one() {
    let (mut child, mut lines) = start();
    for signal in [Signal::TERM, Signal::INT, Signal::HUP, Signal::TERM] {
        send(&child, signal);
    }
    wait_for(&mut lines, "stop");
    drop(child.stdin.take());
    wait_for(&mut lines, "goes on");
    assert!(child.wait().unwrap().success());
}

/// As by somebody at a keyboard, who presses Ctrl-C until it helps.
#[test]
fn a_later_signal_leaves_at_once() {
    for signal in [Signal::INT, Signal::TERM, Signal::HUP] {
        let (mut child, mut lines) = start();
        send(&child, signal);
        wait_for(&mut lines, "stop");
        let status = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break status;
            }
            sleep(Duration::from_millis(300));
            send(&child, signal);
        };
        assert_eq!((status.code(), status.signal()), (Some(1), None), "{signal:?}");
    }
}
