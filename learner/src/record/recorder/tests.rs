use super::*;
use crate::demonstration::{Grip, Gripper};
use crate::record::bounds::Bounds;
use glam::{DQuat, DVec3};
use proptest::prelude::*;
use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

const STEP_NS: u64 = 2_000_000;
const GOAL: DVec3 = DVec3::new(0.5, 0.2, 0.0);
/// Places of the frames of a skill that has no further ones.
const END: usize = 0;
const START: usize = 1;

fn at(position: DVec3) -> Pose {
    Pose { position, orientation: DQuat::IDENTITY }
}

/// A recorder, its clock, and what it said.
struct Bench {
    recorder: Recorder,
    time_ns: u64,
    pose: Pose,
    grip: Option<Grip>,
    frames: Frames,
    events: Vec<Event>,
}

impl Bench {
    fn new(manifold: Manifold) -> Self {
        Self::of(manifold, &["end"], Some("start"))
    }

    /// All frames are usable: the goal's in its place, the others where the tool is.
    fn of(manifold: Manifold, required: &[&str], start_frame: Option<&str>) -> Self {
        let task = Task {
            skill: "made_up".into(),
            manifold,
            required_frames: required.iter().map(|name| (*name).into()).collect(),
            start_frame: start_frame.map(Into::into),
            sampling_time_s: 0.01,
            bounds: Bounds::default(),
        };
        let mut frames = NO_FRAMES;
        let count = task.frames().count();
        frames[..count].fill(Ok(at(DVec3::ZERO)));
        frames[END] = Ok(at(GOAL));
        Self {
            recorder: Recorder::new(task),
            time_ns: 7_000_000_000,
            pose: at(DVec3::ZERO),
            grip: None,
            frames,
            events: Vec::new(),
        }
    }

    fn sample(&mut self, pose: Pose) {
        self.time_ns += STEP_NS;
        self.pose = pose;
        self.events.extend(self.recorder.observe(
            Sample { time_ns: self.time_ns, pose, grip: self.grip },
            self.frames,
            0,
        ));
    }

    fn rest(&mut self, duration_s: f64) {
        for _ in 0..steps(duration_s) {
            self.sample(self.pose);
        }
    }

    /// With minimum jerk to another place; `each` is called in between.
    fn go(&mut self, to: DVec3, duration_s: f64, mut each: impl FnMut(&mut Self, f64)) {
        let from = self.pose.position;
        for i in 1..=steps(duration_s) {
            let t = f64::from(i) / f64::from(steps(duration_s));
            let fraction = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
            each(self, t);
            self.sample(Pose { position: from.lerp(to, fraction), ..self.pose });
        }
    }

    /// With rest behind it.
    fn demonstrate(&mut self, to: DVec3, duration_s: f64) {
        self.go(to, duration_s, |_, _| {});
        self.rest(1.5);
    }

    fn end(&mut self) {
        self.events.extend(self.recorder.end());
    }

    fn recorded(&self) -> Vec<&Recorded> {
        let mut found = Vec::new();
        for event in &self.events {
            if let Event::Recorded(recorded) = event {
                found.push(&**recorded);
            }
        }
        found
    }

    fn refusals(&self) -> Vec<&str> {
        let mut found = Vec::new();
        for event in &self.events {
            if let Event::Refused(why) = event {
                found.push(why.as_str());
            }
        }
        found
    }
}

fn steps(duration_s: f64) -> u32 {
    (duration_s * 1e9 / STEP_NS as f64).round() as u32
}

#[test]
fn two_motions_between_rests_are_two_demonstrations() {
    let mut bench = Bench::new(Manifold::R3S3);
    assert_eq!(bench.recorder.stage(), Stage::Unsettled);
    bench.rest(1.5);
    assert_eq!(bench.recorder.stage(), Stage::Ready);
    bench.go(GOAL, 2.0, |_, _| {});
    assert_eq!(bench.recorder.stage(), Stage::Recording);
    bench.rest(1.5);
    assert_eq!(bench.recorder.stage(), Stage::Ready);
    bench.demonstrate(DVec3::ZERO, 3.0);
    let recorded = bench.recorded();
    assert_eq!((recorded.len(), bench.events.len()), (2, 4));
    for (recorded, (from, to, duration_s)) in
        recorded.iter().zip([(DVec3::ZERO, GOAL, 2.0), (GOAL, DVec3::ZERO, 3.0)])
    {
        let poses = &recorded.demonstration.poses;
        assert!((poses[0].position - from).length() < 1e-6);
        assert!((poses[poses.len() - 1].position - to).length() < 2.5e-4);
        let recorded_s = (poses.len() - 1) as f64 * 0.01;
        assert!(recorded_s > duration_s && recorded_s < duration_s + 0.41, "{recorded_s}");
    }
    // The second one starts elsewhere than the frame that is published for it.
    assert!(recorded[0].notes.is_empty());
    let notes = &recorded[1].notes;
    assert!(notes[0].contains("away from frame `start`"), "{notes:?}");
}

#[test]
fn an_arm_that_moves_when_it_is_first_seen_has_to_rest_first() {
    let mut bench = Bench::new(Manifold::R3);
    bench.go(GOAL, 2.0, |_, _| {});
    bench.rest(0.5);
    bench.go(DVec3::ZERO, 2.0, |_, _| {});
    assert!(bench.events.is_empty());
    bench.rest(1.5);
    assert_eq!(bench.recorder.stage(), Stage::Ready);
}

#[test]
fn a_short_rest_ends_nothing() {
    let mut bench = Bench::new(Manifold::R2);
    bench.rest(1.5);
    bench.go(0.5 * GOAL, 1.0, |_, _| {});
    bench.rest(0.7);
    bench.demonstrate(GOAL, 1.0);
    assert_eq!(bench.recorded().len(), 1);
    assert!(bench.recorded()[0].demonstration.poses.len() > 240);
}

#[test]
fn a_start_frame_that_nobody_publishes_is_the_tool_at_the_start() {
    let mut bench = Bench::new(Manifold::R3S3);
    bench.pose.orientation = DQuat::from_rotation_y(0.7);
    bench.frames[START] = Err(Unusable::Absent);
    bench.rest(1.5);
    let from = bench.pose;
    bench.demonstrate(GOAL, 2.0);
    assert!(matches!(bench.events[0], Event::Begun { tool_as_start: true }));
    assert_eq!(bench.recorded()[0].demonstration.start, from);
}

#[test]
fn a_motion_without_a_goal_is_refused_by_its_name_until_the_arm_rests_again() {
    for (start, goal, name) in [
        (Ok(Pose::IDENTITY), Err(Unusable::Absent), "`end`"),
        (Err(Unusable::Nothing), Err(Unusable::Nothing), "`end`"),
        (Err(Unusable::Invalid), Ok(at(GOAL)), "`start`"),
    ] {
        let mut bench = Bench::new(Manifold::R3);
        let good = bench.frames;
        (bench.frames[END], bench.frames[START]) = (goal, start);
        bench.rest(1.5);
        assert!(matches!(
            bench.recorder.stage(),
            Stage::FrameMissing(END, _) | Stage::FrameMissing(START, Unusable::Invalid)
        ));
        bench.go(GOAL, 2.0, |bench, t| {
            if t > 0.5 {
                bench.frames = good;
            }
        });
        bench.rest(1.5);
        assert_eq!(bench.refusals().len(), 1);
        assert!(bench.refusals()[0].contains(name), "{:?}", bench.refusals());
        assert!(bench.recorded().is_empty());
        bench.demonstrate(DVec3::ZERO, 2.0);
        assert_eq!(bench.recorded().len(), 1);
    }
}

#[test]
fn a_frame_that_moves_while_the_arm_does_is_refused_and_afterwards_it_is_not() {
    let mut bench = Bench::new(Manifold::R3S3);
    bench.rest(1.5);
    bench.go(GOAL, 2.0, |bench, t| {
        bench.frames[END] = Ok(at(GOAL + DVec3::new(0.0, 0.1 * t, 0.0)));
    });
    bench.frames[END] = Ok(at(GOAL));
    bench.rest(1.5);
    assert_eq!(bench.refusals().len(), 1);
    assert!(bench.refusals()[0].contains("`end` moved by"), "{:?}", bench.refusals());
    bench.go(DVec3::ZERO, 2.0, |bench, _| {
        // Noise of a camera.
        let side = if bench.time_ns % (2 * STEP_NS) == 0 { 1e-3 } else { 0.0 };
        bench.frames[END] = Ok(at(GOAL + DVec3::new(side, 0.0, 0.0)));
    });
    // While the arm rests the object is put elsewhere.
    bench.rest(0.3);
    bench.frames[END] = Ok(at(2.0 * GOAL));
    bench.rest(1.0);
    assert_eq!((bench.refusals().len(), bench.recorded().len()), (1, 1));
    bench.frames[START] = Ok(at(DVec3::ZERO));
    bench.go(GOAL, 2.0, |bench, t| {
        let orientation = DQuat::from_rotation_z(0.1 * t);
        bench.frames[START] = Ok(Pose { orientation, ..Pose::IDENTITY });
    });
    assert!(bench.refusals()[1].contains("`start` moved by"), "{:?}", bench.refusals());
}

#[test]
fn further_frames_have_to_be_there_and_to_rest_like_the_goal() {
    let mut bench = Bench::of(Manifold::R3, &["end", "box", "shelf"], Some("start"));
    let good = bench.frames;
    bench.frames[1] = Err(Unusable::Absent);
    bench.rest(1.5);
    assert_eq!(bench.recorder.stage(), Stage::FrameMissing(1, Unusable::Absent));
    bench.demonstrate(GOAL, 2.0);
    bench.frames = good;
    bench.rest(1.1);
    bench.go(DVec3::ZERO, 2.0, |bench, t| {
        bench.frames[2] = Ok(at(DVec3::new(0.0, 0.1 * t, 0.0)));
    });
    bench.rest(1.5);
    let [absent, moved] = bench.refusals()[..] else { panic!("{:?}", bench.refusals()) };
    assert!(absent.contains("frame `box` is not among"), "{absent}");
    assert!(moved.contains("frame `shelf` moved by"), "{moved}");
    assert!(bench.recorded().is_empty());

    bench.frames = good;
    bench.frames[2] = Ok(at(2.0 * GOAL));
    bench.frames[3] = Err(Unusable::Absent);
    bench.rest(1.1);
    bench.go(GOAL, 2.0, |bench, t| {
        bench.frames[1] = if t > 0.5 && t <= 0.75 { Err(Unusable::Stale) } else { good[1] };
    });
    bench.rest(1.5);
    assert!(matches!(bench.events[3], Event::Begun { tool_as_start: true }));
    let Recorded { demonstration, notes } = bench.recorded()[0];
    assert_eq!(demonstration.goal_frame, at(GOAL));
    let others = [("box".to_owned(), at(DVec3::ZERO)), ("shelf".to_owned(), at(2.0 * GOAL))];
    assert_eq!(demonstration.other_frames, others.into());
    assert_eq!(demonstration.start, demonstration.poses[0]);
    assert!(notes.len() == 1 && notes[0].contains("`box` was out of sight"), "{notes:?}");
}

#[test]
fn a_skill_of_one_frame_waits_for_no_start_frame() {
    let mut bench = Bench::of(Manifold::R3S3, &["end"], None);
    assert_eq!(bench.frames[START], Err(Unusable::Nothing));
    bench.rest(1.5);
    assert_eq!(bench.recorder.stage(), Stage::Ready);
    bench.demonstrate(0.9 * GOAL, 2.0);
    assert!(matches!(bench.events[0], Event::Begun { tool_as_start: false }));
    let Recorded { demonstration, notes } = bench.recorded()[0];
    assert_eq!((demonstration.start, demonstration.goal_frame), (at(GOAL), at(GOAL)));
    assert!(notes.is_empty(), "{notes:?}");
}

#[test]
fn a_goal_that_is_hidden_for_a_while_is_a_note() {
    let mut bench = Bench::new(Manifold::R3);
    bench.rest(1.5);
    let goal = bench.frames[END];
    bench.go(GOAL, 2.0, |bench, t| {
        bench.frames[END] = if t > 0.5 && t <= 0.75 { Err(Unusable::Invalid) } else { goal };
    });
    bench.rest(1.5);
    let notes = &bench.recorded()[0].notes;
    assert!(notes.len() == 1 && notes[0].contains("out of sight for 0.50 s"), "{notes:?}");
}

#[test]
fn a_fault_ends_the_demonstration_unsaved_with_its_reason() {
    let mut bench = Bench::new(Manifold::R3);
    bench.rest(1.5);
    assert!(bench.recorder.interrupt("nothing was under way").is_none());
    bench.rest(1.5);
    bench.go(GOAL, 1.0, |bench, t| {
        if t == 0.5 {
            bench.events.extend(bench.recorder.interrupt("a reason"));
        }
    });
    bench.rest(1.5);
    assert_eq!(bench.refusals(), ["a reason"]);
    assert!(bench.recorded().is_empty());
    assert_eq!(bench.recorder.stage(), Stage::Ready);
}

#[test]
fn the_end_keeps_what_was_recorded_and_no_nudge() {
    let mut bench = Bench::new(Manifold::R3);
    assert!(bench.recorder.end().is_none());
    bench.rest(1.5);
    bench.go(GOAL, 2.0, |bench, t| {
        if t == 0.5 {
            bench.end();
        }
    });
    let poses = &bench.recorded()[0].demonstration.poses;
    assert!((poses[poses.len() - 1].position - 0.5 * GOAL).length() < 0.02);
    bench.rest(1.5);
    bench.go(GOAL + DVec3::new(0.006, 0.0, 0.0), 0.1, |_, _| {});
    bench.rest(0.2);
    assert_eq!(bench.recorder.stage(), Stage::Recording);
    bench.events.clear();
    bench.end();
    assert!(bench.refusals()[0].contains("moved by 6.0 mm"), "{:?}", bench.refusals());
}

#[test]
fn a_motion_without_end_is_given_up() {
    let mut bench = Bench::new(Manifold::R3);
    bench.rest(1.5);
    for i in 0..steps(620.0) {
        let (s, c) = (f64::from(i) * 0.002).sin_cos();
        bench.sample(at(DVec3::new(0.2 - 0.2 * c, 0.2 * s, 0.0)));
    }
    assert_eq!(bench.refusals(), ["it takes longer than 10 minutes"]);
}

proptest! {
    /// Whatever is fed, what comes out is finite, long enough and starts from where it rested.
    #[test]
    fn every_demonstration_is_one(
        legs in prop::collection::vec(
            (prop::array::uniform3(-1.0_f64..1.0), 0.3_f64..3.0, 0.0_f64..2.0, 0_u8..8),
            1..8,
        ),
    ) {
        let mut bench = Bench::new(Manifold::R3);
        bench.rest(1.5);
        for (to, duration_s, rest_s, accident) in legs {
            bench.go(to.into(), duration_s, |bench, t| {
                if accident == 0 && t > 0.4 && t < 0.41 {
                    bench.recorder.interrupt("accident");
                }
                bench.frames[END] = match accident {
                    1 => Err(Unusable::Stale),
                    2 => Ok(at(GOAL * t)),
                    _ => Ok(at(GOAL)),
                };
            });
            bench.frames[END] = Ok(at(GOAL));
            bench.rest(rest_s);
        }
        bench.end();
        let begun = bench.events.iter().filter(|e| matches!(e, Event::Begun { .. })).count();
        prop_assert!(bench.recorded().len() <= begun);
        for recorded in bench.recorded() {
            let poses = &recorded.demonstration.poses;
            prop_assert!(poses.len() >= crate::demonstration::POINTS_MIN);
            prop_assert!(poses.iter().all(|p| p.position.is_finite()));
            let step = (poses[1].position - poses[0].position).length();
            prop_assert!(step < 3e-4, "it starts with a step of {} m", step);
        }
    }
}

#[test]
fn a_gripper_that_closes_after_the_motion_is_part_of_the_demonstration() {
    let mut bench = Bench::new(Manifold::R3);
    bench.grip = Some(Grip::Open);
    bench.rest(1.5);
    bench.go(DVec3::new(0.3, 0.1, 0.0), 2.0, |_, _| {});
    bench.rest(0.6);
    bench.grip = Some(Grip::Closed);
    bench.rest(1.0);
    let found = bench.events.iter().find_map(|event| match event {
        Event::Recorded(recorded) => Some(&recorded.demonstration),
        _ => None,
    });
    let demonstration = found.unwrap();
    let Some(Gripper::Grips(grips)) = &demonstration.gripper else { panic!("it is known") };
    assert_eq!(grips.len(), demonstration.poses.len());
    let closed = grips.iter().position(|grip| *grip == Grip::Closed).unwrap();
    assert!(closed + 2 >= grips.len() && closed > 200, "{closed} of {}", grips.len());
}

#[test]
fn a_gripper_that_is_not_known_makes_no_channel() {
    let mut bench = Bench::new(Manifold::R3);
    bench.rest(1.5);
    bench.go(DVec3::new(0.3, 0.1, 0.0), 2.0, |_, _| {});
    bench.rest(1.5);
    let recorded = bench.events.iter().find_map(|event| match event {
        Event::Recorded(recorded) => Some(recorded),
        _ => None,
    });
    assert_eq!(recorded.unwrap().demonstration.gripper, None);
}
