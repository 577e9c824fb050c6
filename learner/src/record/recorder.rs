//! Decides what is a demonstration: a motion of the tool between two rests, with frames that rest.
//!
//! ```text
//! Unsettled ── the arm rests ──► Ready ── it moves, frames are seen ──► Showing
//!     ▲                            ▲                                       │
//!     │                            └──────── it rests: a demonstration ────┤
//!     └──── a fault, a frame that moves, a motion without frames ──────────┘
//! ```
//!
//! The tool moves when it is displaced or turned, over a window of time, faster than noise; so
//! nothing depends on velocities that a publisher may not measure. After a refusal the arm has to
//! rest first, so that no second half of a motion is taken for a whole one.

use std::collections::VecDeque;

use tprmp_rmpflow::frame_map::Pose;

use super::intake::{Frames, Sight};
use super::take::{Sample, Shown, Take, Task};
use crate::plausibility::angle;

/// Speeds are means over this time [ns].
const WINDOW_NS: u64 = 100_000_000;
/// The tool moves when it is faster than this [m/s] …
const MOVING_M_S: f64 = 0.01;
/// … or turns faster than this [rad/s].
const MOVING_RAD_S: f64 = 0.05;
/// A motion has ended when the tool has rested for so long; so much of the rest before a motion is
/// looked at, too [ns].
const REST_NS: u64 = 1_000_000_000;
/// A frame that has gone farther than this has moved [m]; an object gives way by less when it is
/// touched.
const FRAME_MOVED_M: f64 = 0.005;
/// … or turned farther than this [rad].
const FRAME_MOVED_RAD: f64 = 0.05;
/// Longer motions are given up [ns].
const DURATION_MAX_NS: u64 = 600_000_000_000;

/// What has come of a sample.
#[derive(Debug)]
pub(super) enum Event {
    /// A demonstration has begun; whether a start frame is published.
    Begun { start_shown: bool },
    /// A demonstration has ended.
    Shown(Box<Shown>),
    /// A motion is no demonstration, for this reason.
    Refused(String),
}

/// What the recorder waits for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Stage {
    /// For the arm to rest.
    Unsettled,
    /// For a usable start frame: one is published, but it cannot be used.
    StartUnseen(Sight),
    /// For a usable goal frame.
    GoalUnseen(Sight),
    /// For the arm to move.
    Ready,
    /// For the arm to rest again: a demonstration is under way.
    Showing,
}

#[derive(Debug)]
enum Phase {
    Unsettled,
    Ready,
    Showing(Take),
}

/// The state machine. It is fed with samples whose times grow, and knows no clock.
#[derive(Debug)]
pub(super) struct Recorder {
    task: Task,
    phase: Phase,
    frames: Frames,
    /// The newest samples, those of the last [`REST_NS`].
    recent: VecDeque<Sample>,
    /// Since when the tool rests [ns].
    rests_since: Option<u64>,
}

impl Recorder {
    pub(super) fn new(task: Task) -> Self {
        Self {
            task,
            phase: Phase::Unsettled,
            frames: Frames { start: Sight::Nothing, goal: Sight::Nothing },
            recent: VecDeque::new(),
            rests_since: None,
        }
    }

    /// What is waited for.
    pub(super) fn stage(&self) -> Stage {
        match (&self.phase, self.frames) {
            (Phase::Unsettled, _) => Stage::Unsettled,
            (Phase::Showing(_), _) => Stage::Showing,
            (
                Phase::Ready,
                Frames { start: Sight::Seen(_) | Sight::Absent, goal: Sight::Seen(_) },
            ) => Stage::Ready,
            (Phase::Ready, Frames { start, goal: Sight::Seen(_) }) => Stage::StartUnseen(start),
            (Phase::Ready, Frames { goal, .. }) => Stage::GoalUnseen(goal),
        }
    }

    /// Takes in where the tool was at `time_ns` [ns], later than the sample before, and what was
    /// seen of the frames; `skipped` states are missing before it.
    pub(super) fn observe(
        &mut self,
        time_ns: u64,
        pose: Pose,
        frames: Frames,
        skipped: u64,
    ) -> Option<Event> {
        let elapsed_ns = self.recent.back().map_or(0, |last| time_ns - last.time_ns);
        self.frames = frames;
        let sample = Sample { time_ns, pose };
        self.recent.push_back(sample);
        while self.recent.get(1).is_some_and(|s| time_ns - s.time_ns >= REST_NS) {
            self.recent.pop_front();
        }
        let moves = self.moves(&sample)?;
        let since = (!moves).then(|| self.rests_since.unwrap_or(time_ns));
        self.rests_since = since;
        let rested = since.is_some_and(|since| time_ns - since >= REST_NS);
        match &mut self.phase {
            Phase::Unsettled => {
                if rested {
                    self.phase = Phase::Ready;
                }
                None
            }
            Phase::Ready => moves.then(|| self.begin()),
            Phase::Showing(take) => {
                take.samples.push(sample);
                take.skipped += skipped;
                if !matches!(frames.goal, Sight::Seen(_)) {
                    take.unseen_ns += elapsed_ns;
                }
                if moves && let Some(moved) = moved_frame(take, &frames, &self.task) {
                    return self.interrupt(&moved);
                }
                if time_ns - take.samples[0].time_ns > DURATION_MAX_NS {
                    let minutes = DURATION_MAX_NS / 60_000_000_000;
                    return self.interrupt(&format!("it takes longer than {minutes} minutes"));
                }
                if rested { self.finish(Phase::Ready) } else { None }
            }
        }
    }

    /// Something happened that no demonstration survives; the next sample may be any.
    pub(super) fn interrupt(&mut self, why: &str) -> Option<Event> {
        self.recent.clear();
        self.rests_since = None;
        match std::mem::replace(&mut self.phase, Phase::Unsettled) {
            Phase::Showing(_) => Some(Event::Refused(why.into())),
            Phase::Unsettled | Phase::Ready => None,
        }
    }

    /// No more samples follow: what is under way is finished as it is.
    pub(super) fn end(&mut self) -> Option<Event> {
        self.finish(Phase::Unsettled)
    }

    /// Whether the tool moves; `None` while too little is known.
    fn moves(&self, now: &Sample) -> Option<bool> {
        let within = |s: &Sample| now.time_ns - s.time_ns >= WINDOW_NS;
        let before = &self.recent[self.recent.partition_point(within).checked_sub(1)?];
        let elapsed_s = (now.time_ns - before.time_ns) as f64 * 1e-9;
        let (m, rad) = self.task.apart(&before.pose, &now.pose);
        Some(m > MOVING_M_S * elapsed_s || rad > MOVING_RAD_S * elapsed_s)
    }

    /// The arm begins to move.
    fn begin(&mut self) -> Event {
        let (name, sight) = match self.stage() {
            Stage::StartUnseen(sight) => (&self.task.start_frame, sight),
            Stage::GoalUnseen(sight) => (&self.task.goal_frame, sight),
            _ => {
                let pose = |sight| match sight {
                    Sight::Seen(pose) => Some(pose),
                    _ => None,
                };
                let start = pose(self.frames.start);
                let goal = pose(self.frames.goal).expect("a goal that is not seen is a stage");
                let samples = self.recent.iter().copied().collect();
                self.phase =
                    Phase::Showing(Take { samples, start, goal, unseen_ns: 0, skipped: 0 });
                return Event::Begun { start_shown: start.is_some() };
            }
        };
        self.phase = Phase::Unsettled;
        Event::Refused(format!("the arm moves, but frame `{name}` {sight}"))
    }

    /// Ends the demonstration under way.
    fn finish(&mut self, next: Phase) -> Option<Event> {
        let Phase::Showing(take) = std::mem::replace(&mut self.phase, next) else { return None };
        Some(match take.finish(&self.task) {
            Ok(shown) => Event::Shown(Box::new(shown)),
            Err(why) => Event::Refused(why),
        })
    }
}

/// Says which frame is no longer where it was when the motion began.
fn moved_frame(take: &Take, frames: &Frames, task: &Task) -> Option<String> {
    let pairs = [
        (&task.start_frame, take.start, frames.start),
        (&task.goal_frame, Some(take.goal), frames.goal),
    ];
    pairs.into_iter().find_map(|(name, before, now)| {
        let (Some(before), Sight::Seen(now)) = (before, now) else { return None };
        let (m, rad) = ((now.position - before.position).length(), angle(&before, &now));
        (m > FRAME_MOVED_M || rad > FRAME_MOVED_RAD).then(|| {
            format!(
                "frame `{name}` moved by {:.1} mm and {:.1}° while the arm did; the frames of a \
                 demonstration rest",
                m * 1e3,
                rad.to_degrees()
            )
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;
    use tprmp_model::skill_model::Manifold;

    const STEP_NS: u64 = 2_000_000;

    fn at(position: DVec3) -> Pose {
        Pose { position, orientation: DQuat::IDENTITY }
    }

    /// A recorder, its clock, and what it said.
    struct Bench {
        recorder: Recorder,
        time_ns: u64,
        pose: Pose,
        frames: Frames,
        events: Vec<Event>,
    }

    impl Bench {
        fn new(manifold: Manifold) -> Self {
            let task = Task {
                skill: "made_up".into(),
                manifold,
                start_frame: "start".into(),
                goal_frame: "end".into(),
                sampling_time_s: 0.01,
            };
            let start = at(DVec3::ZERO);
            let goal = at(DVec3::new(0.5, 0.2, 0.0));
            Self {
                recorder: Recorder::new(task),
                time_ns: 7_000_000_000,
                pose: start,
                frames: Frames { start: Sight::Seen(start), goal: Sight::Seen(goal) },
                events: Vec::new(),
            }
        }

        fn sample(&mut self, pose: Pose) {
            self.time_ns += STEP_NS;
            self.pose = pose;
            let event = self.recorder.observe(self.time_ns, pose, self.frames, 0);
            self.events.extend(event);
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
                let share = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
                each(self, t);
                self.sample(Pose { position: from.lerp(to, share), ..self.pose });
            }
        }

        fn shown(&self) -> Vec<&Shown> {
            let shown = self.events.iter().filter_map(|event| match event {
                Event::Shown(shown) => Some(&**shown),
                _ => None,
            });
            shown.collect()
        }

        fn refusals(&self) -> Vec<&str> {
            let refusals = self.events.iter().filter_map(|event| match event {
                Event::Refused(why) => Some(why.as_str()),
                _ => None,
            });
            refusals.collect()
        }
    }

    fn steps(duration_s: f64) -> u32 {
        (duration_s * 1e9 / STEP_NS as f64).round() as u32
    }

    const GOAL: DVec3 = DVec3::new(0.5, 0.2, 0.0);

    #[test]
    fn two_motions_between_rests_are_two_demonstrations() {
        let mut bench = Bench::new(Manifold::R3S3);
        assert_eq!(bench.recorder.stage(), Stage::Unsettled);
        bench.rest(1.2);
        assert_eq!(bench.recorder.stage(), Stage::Ready);
        bench.go(GOAL, 2.0, |_, _| {});
        assert_eq!(bench.recorder.stage(), Stage::Showing);
        bench.rest(1.2);
        assert_eq!(bench.recorder.stage(), Stage::Ready);
        bench.go(DVec3::ZERO, 3.0, |_, _| {});
        bench.rest(1.2);
        let shown = bench.shown();
        assert_eq!((shown.len(), bench.events.len()), (2, 4));
        for (shown, (from, to, duration_s)) in
            shown.iter().zip([(DVec3::ZERO, GOAL, 2.0), (GOAL, DVec3::ZERO, 3.0)])
        {
            let poses = &shown.demonstration.poses;
            assert!((poses[0].position - from).length() < 1e-6);
            assert!((poses[poses.len() - 1].position - to).length() < 2.5e-4);
            let shown_s = (poses.len() - 1) as f64 * 0.01;
            assert!(shown_s > 0.85 * duration_s && shown_s < duration_s + 0.21, "{shown_s}");
        }
        // The second one starts elsewhere than the frame that is published for it.
        assert!(shown[0].notes.is_empty());
        assert!(shown[1].notes[0].contains("away from frame `start`"), "{:?}", shown[1].notes);
    }

    #[test]
    fn an_arm_that_moves_when_it_is_first_seen_has_to_rest_first() {
        let mut bench = Bench::new(Manifold::R3);
        bench.go(GOAL, 2.0, |_, _| {});
        bench.rest(0.5);
        bench.go(DVec3::ZERO, 2.0, |_, _| {});
        assert!(bench.events.is_empty());
        bench.rest(1.2);
        assert_eq!(bench.recorder.stage(), Stage::Ready);
    }

    #[test]
    fn a_short_rest_ends_nothing() {
        let mut bench = Bench::new(Manifold::R2);
        bench.rest(1.2);
        bench.go(0.5 * GOAL, 1.0, |_, _| {});
        bench.rest(0.7);
        bench.go(GOAL, 1.0, |_, _| {});
        bench.rest(1.2);
        assert_eq!(bench.shown().len(), 1);
        assert!(bench.shown()[0].demonstration.poses.len() > 240);
    }

    #[test]
    fn a_start_frame_that_nobody_publishes_is_the_tool_at_the_start() {
        let mut bench = Bench::new(Manifold::R3S3);
        bench.pose.orientation = DQuat::from_rotation_y(0.7);
        bench.frames.start = Sight::Absent;
        bench.rest(1.2);
        let from = bench.pose;
        bench.go(GOAL, 2.0, |_, _| {});
        bench.rest(1.2);
        assert!(matches!(bench.events[0], Event::Begun { start_shown: false }));
        assert_eq!(bench.shown()[0].demonstration.start, from);
    }

    #[test]
    fn a_motion_without_a_goal_is_refused_by_its_name_until_the_arm_rests_again() {
        for (start, goal, name) in [
            (Sight::Seen(Pose::IDENTITY), Sight::Absent, "`end`"),
            (Sight::Nothing, Sight::Nothing, "`end`"),
            (Sight::Invalid, Sight::Seen(at(GOAL)), "`start`"),
        ] {
            let mut bench = Bench::new(Manifold::R3);
            let good = std::mem::replace(&mut bench.frames, Frames { start, goal });
            bench.rest(1.2);
            assert!(matches!(
                bench.recorder.stage(),
                Stage::GoalUnseen(_) | Stage::StartUnseen(Sight::Invalid)
            ));
            bench.go(GOAL, 2.0, |bench, t| {
                if t > 0.5 {
                    bench.frames = good;
                }
            });
            bench.rest(1.2);
            assert_eq!(bench.refusals().len(), 1);
            assert!(bench.refusals()[0].contains(name), "{:?}", bench.refusals());
            assert!(bench.shown().is_empty());
            bench.go(DVec3::ZERO, 2.0, |_, _| {});
            bench.rest(1.2);
            assert_eq!(bench.shown().len(), 1);
        }
    }

    #[test]
    fn a_frame_that_moves_while_the_arm_does_is_refused_and_afterwards_it_is_not() {
        let mut bench = Bench::new(Manifold::R3S3);
        bench.rest(1.2);
        bench.go(GOAL, 2.0, |bench, t| {
            bench.frames.goal = Sight::Seen(at(GOAL + DVec3::new(0.0, 0.1 * t, 0.0)));
        });
        bench.rest(1.2);
        assert_eq!(bench.refusals().len(), 1);
        assert!(bench.refusals()[0].contains("`end` moved by"), "{:?}", bench.refusals());
        bench.go(DVec3::ZERO, 2.0, |bench, _| {
            // Noise of a camera.
            let side = if bench.time_ns % (2 * STEP_NS) == 0 { 1e-3 } else { 0.0 };
            bench.frames.goal = Sight::Seen(at(GOAL + DVec3::new(side, 0.0, 0.0)));
        });
        // While the arm rests the object is put elsewhere.
        bench.rest(0.3);
        bench.frames.goal = Sight::Seen(at(2.0 * GOAL));
        bench.rest(1.0);
        assert_eq!((bench.refusals().len(), bench.shown().len()), (1, 1));
        bench.frames.start = Sight::Seen(at(DVec3::ZERO));
        bench.go(GOAL, 2.0, |bench, t| {
            let turn = DQuat::from_rotation_z(0.1 * t);
            bench.frames.start = Sight::Seen(Pose { orientation: turn, ..Pose::IDENTITY });
        });
        assert!(bench.refusals()[1].contains("`start` moved by"), "{:?}", bench.refusals());
    }

    #[test]
    fn a_goal_that_is_hidden_for_a_while_is_a_note() {
        let mut bench = Bench::new(Manifold::R3);
        bench.rest(1.2);
        let goal = bench.frames.goal;
        bench.go(GOAL, 2.0, |bench, t| {
            bench.frames.goal = if t > 0.5 && t <= 0.75 { Sight::Invalid } else { goal };
        });
        bench.rest(1.2);
        let notes = &bench.shown()[0].notes;
        assert!(notes.len() == 1 && notes[0].contains("out of sight for 0.50 s"), "{notes:?}");
    }

    #[test]
    fn a_fault_ends_the_demonstration_unsaved_with_its_reason() {
        let mut bench = Bench::new(Manifold::R3);
        bench.rest(1.2);
        assert!(bench.recorder.interrupt("nothing was under way").is_none());
        bench.rest(1.3);
        bench.go(GOAL, 1.0, |bench, t| {
            if t == 0.5 {
                let event = bench.recorder.interrupt("a reason");
                bench.events.extend(event);
            }
        });
        bench.rest(1.2);
        assert_eq!(bench.refusals(), ["a reason"]);
        assert!(bench.shown().is_empty());
        assert_eq!(bench.recorder.stage(), Stage::Ready);
    }

    #[test]
    fn the_end_keeps_what_was_shown_and_no_nudge() {
        let mut bench = Bench::new(Manifold::R3);
        assert!(bench.recorder.end().is_none());
        bench.rest(1.3);
        bench.go(GOAL, 2.0, |bench, t| {
            if t == 0.5 {
                let event = bench.recorder.end();
                bench.events.extend(event);
            }
        });
        let poses = &bench.shown()[0].demonstration.poses;
        assert!((poses[poses.len() - 1].position - 0.5 * GOAL).length() < 0.02);
        bench.rest(1.3);
        bench.go(GOAL + DVec3::new(0.003, 0.0, 0.0), 0.1, |_, _| {});
        assert_eq!(bench.recorder.stage(), Stage::Showing);
        bench.events.clear();
        let event = bench.recorder.end();
        bench.events.extend(event);
        assert!(bench.refusals()[0].contains("moved by 3.0 mm"), "{:?}", bench.refusals());
    }

    #[test]
    fn a_motion_without_end_is_given_up() {
        let mut bench = Bench::new(Manifold::R3);
        bench.rest(1.2);
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
            bench.rest(1.2);
            for (to, duration_s, rest_s, accident) in legs {
                bench.go(to.into(), duration_s, |bench, t| {
                    if accident == 0 && t > 0.4 && t < 0.41 {
                        bench.recorder.interrupt("accident");
                    }
                    bench.frames.goal = match accident {
                        1 => Sight::Stale,
                        2 => Sight::Seen(at(GOAL * t)),
                        _ => Sight::Seen(at(GOAL)),
                    };
                });
                bench.frames.goal = Sight::Seen(at(GOAL));
                bench.rest(rest_s);
            }
            let event = bench.recorder.end();
            bench.events.extend(event);
            let begun = bench.events.iter().filter(|e| matches!(e, Event::Begun { .. })).count();
            prop_assert!(bench.shown().len() <= begun);
            for shown in bench.shown() {
                let poses = &shown.demonstration.poses;
                prop_assert!(poses.len() >= crate::demonstration::POINTS_MIN);
                prop_assert!(poses.iter().all(|p| p.position.is_finite()));
                let step = (poses[1].position - poses[0].position).length();
                prop_assert!(step < 3e-4, "it starts with a step of {} m", step);
            }
        }
    }
}
