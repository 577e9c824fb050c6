//! Processes that are killed at random moments, in any order, as shipped: the arm is at rest soon after the
//! last command has expired, nothing is in motion before somebody says so, and then all goes on without
//! anybody cleaning up.
//!
//! `TPRMP_CRASHES` sets how many are killed in the plane; `make crashes` kills 200, and 40 in pybullet.

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use tprmp_controller::timing::realtime::monotonic_ns;
use tprmp_messages::{
    ControlClient, ControlRequest, ControlVerb, ControllerStatus, Instance, LifeCycle,
    ObserverPorts, Reason, StatusPort,
};

use crate::common::{Place, file, finish, program, random};
use crate::robot::signal;

const PATIENCE: Duration = Duration::from_secs(90);
/// A command lives so long, as shipped; and by so much later the arm is at rest \[ns\].
const EXPIRED_NS: u64 = 50_000_000;
const REST_NS: u64 = 50_000_000;
/// At rest \[rad/s or m/s\].
const REST: f64 = 0.02;

/// Who is killed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Victim {
    Controller,
    Publisher,
    Recorder,
    Top,
}

const VICTIMS: [Victim; 4] = [Victim::Controller, Victim::Publisher, Victim::Recorder, Victim::Top];

struct System {
    place: Place,
    simulator: &'static str,
    config: &'static str,
    skill: &'static str,
    model: String,
    observer: ObserverPorts,
    status: StatusPort,
    control: ControlClient,
    last: ControllerStatus,
    runs: u32,
}

impl System {
    fn new(name: &str, simulator: &'static str, config: &'static str, skill: &'static str) -> Self {
        let place = Place::new(name);
        let instance = Instance::new(&place.instance).unwrap();
        Self {
            model: place.train(skill),
            observer: instance.open_observer().unwrap(),
            status: instance.open_status().unwrap(),
            control: instance.open_control_client().unwrap(),
            last: ControllerStatus::default(),
            simulator,
            config,
            skill,
            place,
            runs: 0,
        }
    }

    fn start(&mut self, victim: Victim) -> Child {
        self.runs += 1;
        let (instance, runs) = (&self.place.instance, self.runs);
        let mut command = match victim {
            Victim::Controller => {
                let mut command = program("controller");
                command.args(["run", &file(self.config), "--model", &self.model]);
                command
            }
            Victim::Publisher => {
                let scene = if self.simulator == "planar-sim" { "planar" } else { "pick" };
                let out = self.place.path(&format!("publisher-{runs}"));
                let mut command = program(self.simulator);
                command.args(["run", "--scene", &file(&format!("config/scenes/{scene}.json"))]);
                command.args(["--seed", "1", "--out", &out]);
                command
            }
            Victim::Recorder => {
                let mut command = program("learner");
                command.args(["record", &file(self.config), "--out"]);
                command.arg(self.place.path("recorded"));
                command.args(["--skill", &file(&format!("config/skills/{}.ron", self.skill))]);
                command
            }
            Victim::Top => {
                let mut command = program("controller");
                command.arg("top");
                command
            }
        };
        command.args(["--instance", instance]).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().expect("the program starts")
    }

    /// The newest status, and whether it is a new one.
    fn look(&mut self) -> bool {
        let mut new = false;
        while let Some(status) = self.status.status.receive() {
            self.last = *status;
            new = true;
        }
        new
    }

    fn until(&mut self, what: &str, mut reached: impl FnMut(&mut Self) -> bool) {
        let start = Instant::now();
        while !reached(self) {
            assert!(start.elapsed() < PATIENCE, "{what}: {:?}", self.last);
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn life_cycle(&self) -> LifeCycle {
        LifeCycle::from_wire(self.last.life_cycle).unwrap()
    }

    fn ask(&self, verb: ControlVerb) -> bool {
        let answer = self.control.ask(&ControlRequest::new(verb, "", 0.0), Duration::from_secs(2));
        answer.is_some_and(|answer| answer.accepted == 1)
    }

    /// The greatest speed of a joint in the states since `since_ns` \[ns\], until `until_ns`.
    fn speed_between(&self, since_ns: u64, until_ns: u64) -> f64 {
        let mut most = 0.0_f64;
        while monotonic_ns() < until_ns + 20_000_000 {
            while let Some(state) = self.observer.state.receive() {
                if (since_ns..until_ns).contains(&state.time_ns) {
                    most = state.velocity.iter().fold(most, |most, v| most.max(v.abs()));
                }
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        most
    }

    /// Waits until the policy is followed, looking at each fault as a person would.
    fn followed(&mut self, what: &str) {
        self.look();
        let mut good = 0;
        self.until(what, |system| {
            if system.look() {
                let follows = system.last.reason == Reason::None.to_wire();
                good = if follows { good + 1 } else { 0 };
                if system.life_cycle() == LifeCycle::Fault {
                    system.ask(ControlVerb::Reset);
                }
            }
            good > 10
        });
    }
}

/// Kills `count` processes, the victims chosen by `random`.
fn crashes(system: &mut System, count: u32, mut random: impl FnMut(u64) -> u64) -> [u32; 4] {
    let mut running = VICTIMS.map(|victim| system.start(victim));
    let mut killed = [0; 4];
    system.followed("at first");
    for n in 0..count {
        std::thread::sleep(Duration::from_millis(random(60)));
        // The recorder ends by itself where the publisher has gone, and so does a simulator at its goal.
        for (child, victim) in running.iter_mut().zip(VICTIMS) {
            if child.try_wait().unwrap().is_some() {
                *child = system.start(victim);
                system.followed("after one that has ended");
            }
        }
        let index = random(4) as usize;
        let victim = VICTIMS[index];
        let what = format!("crash {n}, {victim:?}");
        let killed_ns = monotonic_ns();
        running[index].kill().unwrap();
        running[index].wait().unwrap();
        killed[index] += 1;
        if victim == Victim::Controller {
            // At rest soon after the last command has expired, and for as long as nobody says anything else.
            let rest_ns = killed_ns + EXPIRED_NS + REST_NS;
            running[index] = system.start(victim);
            let ended = Reason::EndedUnexpectedly.to_wire();
            system.until(&what, |system| system.look() && system.last.reason == ended);
            assert_eq!(system.life_cycle(), LifeCycle::Fault, "{what}");
            let speed = system.speed_between(rest_ns, monotonic_ns() + 50_000_000);
            assert!(speed < REST, "{what}: {speed}");
        } else {
            running[index] = system.start(victim);
        }
        system.followed(&what);
    }
    for child in running.into_iter().rev() {
        signal(&child, "-INT");
        finish(child);
    }
    killed
}

/// How many are killed: as asked for, or a few.
fn asked(name: &str, few: u32) -> u32 {
    std::env::var(name).map_or(few, |text| text.parse().expect("a whole number"))
}

fn nothing_is_left(system: System) {
    let System { place, observer, status, control, .. } = system;
    drop((observer, status, control));
    assert_eq!(place.leftovers(), Vec::<std::path::PathBuf>::new());
}

#[test]
fn the_point_comes_back_from_every_crash_when_somebody_says_so() {
    let mut system = System::new("crash", "planar-sim", "config/controllers/planar.ron", "planar");
    let killed = crashes(&mut system, asked("TPRMP_CRASHES", 24), random(1));
    assert!(killed.iter().all(|count| *count > 0), "{killed:?}");
    nothing_is_left(system);
}

#[test]
fn the_arm_comes_back_from_every_crash_when_somebody_says_so() {
    let mut system =
        System::new("crash-arm", "sim-bridge", "config/controllers/ur5_pick.ron", "pick");
    crashes(&mut system, asked("TPRMP_CRASHES_ARM", 4), random(2));
    nothing_is_left(system);
}

/// Killed while it lifts: the next one holds what the gripper holds, and lifts it to where it was going.
#[test]
fn a_controller_that_is_killed_in_mid_lift_finishes_the_lift() {
    let mut system =
        System::new("crash-lift", "sim-bridge", "config/controllers/ur5_pick.ron", "pick");
    let publisher = system.start(Victim::Publisher);
    let mut controller = system.start(Victim::Controller);
    system.until("lifting", |system| system.look() && system.life_cycle() == LifeCycle::Lifting);
    std::thread::sleep(Duration::from_millis(100));
    controller.kill().unwrap();
    controller.wait().unwrap();
    let controller = system.start(Victim::Controller);
    let ended = Reason::EndedUnexpectedly.to_wire();
    system.until("started again", |system| system.look() && system.last.reason == ended);
    assert!(system.ask(ControlVerb::Reset));
    system.until("lifting again", |system| {
        system.look() && matches!(system.life_cycle(), LifeCycle::Lifting | LifeCycle::Done)
    });
    let output = finish(publisher);
    assert_eq!(output.status.code(), Some(0), "the box was not lifted");
    signal(&controller, "-INT");
    finish(controller);
    nothing_is_left(system);
}
