//! From the samples of one motion to a demonstration: cut where the tool rests, and brought to even
//! times.

use glam::DQuat;
use tprmp_model::skill_model::{FRAME_CAPACITY, Manifold};
use tprmp_spatial::Pose;

use super::intake::Frames;
use crate::demonstration::plausibility::angle;
use crate::demonstration::{Demonstration, POINTS_MIN};
use crate::skill::Skill;

/// Of the rest before and after the motion so much is kept [ns].
const MARGIN_NS: u64 = 100_000_000;
/// The tool rests while it is this near to where it began or ended [m].
const SETTLED_M: f64 = 2e-4;
/// … and rotated by no more than this [rad].
const SETTLED_RAD: f64 = 1e-3;
/// A tool that went no farther than this [m] …
const MOVED_MIN_M: f64 = 0.01;
/// … and rotated no farther than this has been nudged, not moved [rad].
const MOVED_MIN_RAD: f64 = 0.1;
/// A frame that has gone farther than this has moved [m]; an object gives way by less when it is
/// touched.
const FRAME_MOVED_M: f64 = 0.005;
/// … or rotated farther than this [rad].
const FRAME_MOVED_RAD: f64 = 0.05;
/// A start frame farther than this from where the tool starts is worth a word [m].
const START_DISTANCE_MAX_M: f64 = 0.02;

/// What is recorded, and how it is stored.
#[derive(Debug, Clone)]
pub(super) struct Task {
    pub(super) skill: String,
    pub(super) manifold: Manifold,
    /// Frames that have to be usable: the goal frame, then the further ones.
    pub(super) required_frames: Vec<String>,
    /// The start frame, where it is another than the goal frame. The tool's pose can serve as such.
    pub(super) start_frame: Option<String>,
    pub(super) sampling_time_s: f64,
}

impl Task {
    pub(super) fn new(skill: &Skill, sampling_time_s: f64) -> Self {
        let required = std::iter::once(&skill.goal_frame).chain(&skill.other_frames);
        let own_start = skill.start_frame != skill.goal_frame;
        Self {
            skill: skill.skill.clone(),
            manifold: skill.manifold,
            required_frames: required.cloned().collect(),
            start_frame: own_start.then(|| skill.start_frame.clone()),
            sampling_time_s,
        }
    }

    /// The names of all frames: those that have to be usable, then the start frame.
    pub(super) fn frames(&self) -> impl Iterator<Item = &String> {
        self.required_frames.iter().chain(&self.start_frame)
    }

    /// How far two poses are apart, by what the skill moves [m], [rad].
    pub(super) fn apart(&self, a: &Pose, b: &Pose) -> (f64, f64) {
        let mut displacement = b.position - a.position;
        if self.manifold == Manifold::R2 {
            displacement.z = 0.0;
        }
        let rotation = if self.manifold.has_orientation() { angle(a, b) } else { 0.0 };
        (displacement.length(), rotation)
    }

    /// A tool's pose in the place of a start frame.
    fn as_frame(&self, tool: &Pose) -> Pose {
        let mut frame = *tool;
        if self.manifold == Manifold::R2 {
            frame.position.z = 0.0;
            // The rotation about z; none for a tool that points down.
            let about_z = DQuat::from_xyzw(0.0, 0.0, tool.orientation.z, tool.orientation.w);
            let is_defined = about_z.length() > SETTLED_RAD;
            frame.orientation = if is_defined { about_z.normalize() } else { DQuat::IDENTITY };
        }
        frame
    }
}

/// Where the tool was.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// When the state was measured [ns].
    pub(super) time_ns: u64,
    /// X_BE.
    pub(super) pose: Pose,
}

/// One motion, from rest to rest.
#[derive(Debug)]
pub(super) struct Recording {
    /// In order of time, with some rest before and after.
    pub(super) samples: Vec<Sample>,
    /// The frames, in the order of [`Task::frames`], as they were when the motion began; the start
    /// frame only where one is published.
    pub(super) frames: [Option<Pose>; FRAME_CAPACITY],
    /// How long each of them was not usable [ns].
    pub(super) missing_ns: [u64; FRAME_CAPACITY],
    /// Sequence numbers of states that never came.
    pub(super) skipped: u64,
}

/// A finished demonstration; it has no file name yet.
#[derive(Debug)]
pub(super) struct Recorded {
    pub(super) demonstration: Demonstration,
    /// What the user should know.
    pub(super) notes: Vec<String>,
}

impl Recorded {
    /// How much was recorded.
    pub(super) fn summary(&self) -> String {
        let recorded = &self.demonstration;
        let pairs = recorded.poses.windows(2);
        let path_m: f64 = pairs.map(|p| (p[1].position - p[0].position).length()).sum();
        let count = recorded.poses.len();
        let duration_s = (count - 1) as f64 * recorded.sampling_time_s;
        format!("{count} samples, {duration_s:.2} s, path {path_m:.3} m")
    }
}

impl Recording {
    /// Reports a frame that is no longer where it was when the motion began.
    pub(super) fn moved_frame(&self, frames: Frames, task: &Task) -> Option<String> {
        task.frames().zip(self.frames).zip(frames).find_map(|((name, before), now)| {
            let (before, now) = (before?, now.ok()?);
            let (m, rad) = ((now.position - before.position).length(), angle(&before, &now));
            (m > FRAME_MOVED_M || rad > FRAME_MOVED_RAD).then(|| {
                format!(
                    "frame `{name}` moved by {:.1} mm and {:.1}° while the arm did; the frames of \
                     a demonstration rest",
                    m * 1e3,
                    rad.to_degrees()
                )
            })
        })
    }

    /// The demonstration; what is missing for one, when there is none.
    pub(super) fn finish(self, task: &Task) -> Result<Recorded, String> {
        let samples = &self.samples[..];
        let first = samples.first().ok_or("it has no samples")?.pose;
        let (mut distance, mut rotation) = (0.0_f64, 0.0_f64);
        for sample in samples {
            let (m, rad) = task.apart(&first, &sample.pose);
            (distance, rotation) = (distance.max(m), rotation.max(rad));
        }
        if distance < MOVED_MIN_M && rotation < MOVED_MIN_RAD {
            return Err(format!(
                "the tool moved by {:.1} mm and {:.1}° only",
                distance * 1e3,
                rotation.to_degrees()
            ));
        }
        let mut poses = resample(cut(samples, task), task.sampling_time_s);
        if poses.len() < POINTS_MIN {
            return Err(format!(
                "it has {} samples, at least {POINTS_MIN} are needed",
                poses.len()
            ));
        }
        let mut required = task.required_frames.iter().zip(self.frames).map(|(name, frame)| {
            (name.clone(), frame.expect("a motion begins when the required frames are usable"))
        });
        let (_, goal_frame) = required.next().expect("the goal frame is required");
        let other_frames = required.collect();
        let start = match task.start_frame {
            None => goal_frame,
            Some(_) => {
                self.frames[task.required_frames.len()].unwrap_or_else(|| task.as_frame(&poses[0]))
            }
        };
        if task.manifold == Manifold::R2 {
            for pose in &mut poses {
                pose.position.z = 0.0;
            }
        }
        if !task.manifold.has_orientation() {
            for pose in &mut poses {
                pose.orientation = DQuat::IDENTITY;
            }
        }
        let notes = self.notes(task, (poses[0].position - start.position).length());
        let demonstration = Demonstration {
            name: String::new(),
            sha256: String::new(),
            skill: task.skill.clone(),
            manifold: task.manifold,
            sampling_time_s: task.sampling_time_s,
            start,
            goal_frame,
            other_frames,
            poses,
        };
        Ok(Recorded { demonstration, notes })
    }

    fn notes(&self, task: &Task, start_distance_m: f64) -> Vec<String> {
        let mut notes = Vec::new();
        if let Some(name) = &task.start_frame
            && start_distance_m > START_DISTANCE_MAX_M
        {
            notes.push(format!(
                "the tool starts {start_distance_m:.3} m away from frame `{name}`, as published"
            ));
        }
        for (name, missing_ns) in task.required_frames.iter().zip(self.missing_ns) {
            if missing_ns > 0 {
                notes.push(format!(
                    "frame `{name}` was out of sight for {:.2} s; it was taken to rest",
                    missing_ns as f64 * 1e-9
                ));
            }
        }
        if self.skipped > 0 {
            notes.push(format!(
                "{} sequence numbers of states were skipped; the motion between was interpolated",
                self.skipped
            ));
        }
        notes
    }
}

/// The motion with little of the rest before and after.
fn cut<'a>(samples: &'a [Sample], task: &Task) -> &'a [Sample] {
    let [first, .., last] = samples else { return samples };
    let settled = |at: &Sample, sample: &Sample| {
        let (m, rad) = task.apart(&at.pose, &sample.pose);
        m <= SETTLED_M && rad <= SETTLED_RAD
    };
    let leaves = samples.iter().find(|s| !settled(first, s)).unwrap_or(last).time_ns;
    let arrives = samples.iter().rfind(|s| !settled(last, s)).unwrap_or(first).time_ns;
    let begin = samples.partition_point(|s| s.time_ns < leaves.saturating_sub(MARGIN_NS));
    let end = samples.partition_point(|s| s.time_ns <= arrives + MARGIN_NS);
    &samples[begin.min(end)..end]
}

/// Poses at even times from the first sample on, as far as the samples go: on straight lines and
/// at a constant angular velocity in between. Neighbouring quaternions are on one side of the sphere.
fn resample(samples: &[Sample], sampling_time_s: f64) -> Vec<Pose> {
    let [first, .., last] = samples else { return samples.iter().map(|s| s.pose).collect() };
    let step_ns = (sampling_time_s * 1e9).round() as u64;
    let mut poses: Vec<Pose> = Vec::new();
    let mut i = 0;
    for time_ns in (first.time_ns..=last.time_ns).step_by(step_ns as usize) {
        while i + 2 < samples.len() && samples[i + 1].time_ns <= time_ns {
            i += 1;
        }
        let (a, b) = (&samples[i], &samples[i + 1]);
        let fraction = (time_ns - a.time_ns) as f64 / (b.time_ns - a.time_ns) as f64;
        let Pose { position, orientation } = a.pose.interpolate(&b.pose, fraction);
        let orientation = orientation.normalize();
        let far_side = poses.last().is_some_and(|before| before.orientation.dot(orientation) < 0.0);
        let orientation = if far_side { -orientation } else { orientation };
        poses.push(Pose { position, orientation });
    }
    poses
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    fn task(manifold: Manifold) -> Task {
        Task {
            skill: "made_up".into(),
            manifold,
            required_frames: vec!["end".into()],
            start_frame: Some("start".into()),
            sampling_time_s: 0.01,
        }
    }

    /// At rest for 0.5 s, two seconds of smooth motion, at rest for 0.8 s.
    fn at(time_s: f64) -> Pose {
        let t = ((time_s - 0.5) / 2.0).clamp(0.0, 1.0);
        let s = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
        Pose {
            position: DVec3::new(0.4 * s, 0.1 - 0.2 * s, 0.3 + 0.1 * s * s),
            orientation: DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.0 + 2.5 * s),
        }
    }

    fn recording(times_ns: impl Iterator<Item = u64>) -> Recording {
        let pose = |ns| at(ns as f64 * 1e-9);
        Recording {
            // Every other quaternion is on the other side of the sphere.
            samples: times_ns
                .enumerate()
                .map(|(i, time_ns)| {
                    let Pose { position, orientation } = pose(time_ns);
                    let orientation = if i % 2 == 0 { orientation } else { -orientation };
                    Sample { time_ns, pose: Pose { position, orientation } }
                })
                .collect(),
            frames: std::array::from_fn(|i| (i == 0).then(|| at(3.0))),
            missing_ns: [0; FRAME_CAPACITY],
            skipped: 0,
        }
    }

    #[test]
    fn rest_is_cut_to_its_margin_and_the_ends_are_where_the_tool_rested() {
        let task = task(Manifold::R3S3);
        let recorded = recording((0..3300).map(|i| i * 1_000_000)).finish(&task).unwrap();
        assert!(recorded.notes.is_empty());
        let poses = &recorded.demonstration.poses;
        // Smooth motion is within a fraction of a millimetre for its first and last 0.1 s or so.
        assert!((190..=222).contains(&poses.len()), "{}", poses.len());
        assert_eq!(poses[0], at(0.0));
        assert_eq!(recorded.demonstration.start, poses[0]);
        let (m, rad) = task.apart(&poses[poses.len() - 1], &at(3.3));
        assert!(m <= SETTLED_M && rad <= SETTLED_RAD, "{m} m, {rad} rad");
        assert!(poses.windows(2).all(|p| p[0].orientation.dot(p[1].orientation) > 0.0));
        assert!(recorded.summary().contains("path 0.4"), "{}", recorded.summary());
    }

    #[test]
    fn a_planar_skill_keeps_the_plane_only() {
        let task = task(Manifold::R2);
        let recording = recording((0..3300).map(|i| i * 1_000_000));
        let recorded = recording.finish(&task).unwrap().demonstration;
        assert!(recorded.poses.iter().all(|p| p.position.z == 0.0));
        assert!(recorded.poses.iter().all(|p| p.orientation == DQuat::IDENTITY));
        assert_eq!(recorded.start.position.z, 0.0);
        assert_eq!(recorded.start.orientation.x.hypot(recorded.start.orientation.y), 0.0);
        let down = Pose { orientation: DQuat::from_rotation_x(std::f64::consts::PI), ..at(0.0) };
        assert_eq!(task.as_frame(&down).orientation, DQuat::IDENTITY);
    }

    #[test]
    fn a_skill_without_a_start_frame_has_the_goal_frame_only_and_further_ones_by_name() {
        let mut task = task(Manifold::R3S3);
        task.start_frame = None;
        task.required_frames.push("box".into());
        let mut recording = recording((0..3300).map(|i| i * 1_000_000));
        recording.frames[1] = Some(at(1.0));
        recording.missing_ns[1] = 250_000_000;
        let Recorded { demonstration, notes } = recording.finish(&task).unwrap();
        assert_eq!((demonstration.start, demonstration.goal_frame), (at(3.0), at(3.0)));
        assert_eq!(demonstration.other_frames, [("box".to_owned(), at(1.0))].into());
        // It starts far from the goal frame, as it should.
        assert_eq!(notes, ["frame `box` was out of sight for 0.25 s; it was taken to rest"]);
    }

    #[test]
    fn a_nudge_and_a_glimpse_are_no_demonstrations() {
        let task = task(Manifold::R3);
        let nudge = recording((0..700).map(|i| i * 1_000_000)).finish(&task).unwrap_err();
        assert!(nudge.contains("moved by"), "{nudge}");
        let glimpse = recording((1200..1260).map(|i| i * 1_000_000)).finish(&task).unwrap_err();
        assert!(glimpse.contains("at least 10"), "{glimpse}");
        assert!(recording(std::iter::empty()).finish(&task).is_err());
    }

    proptest! {
        /// Whatever the times of the states are, the samples lie on the motion, at even times.
        #[test]
        fn uneven_states_give_even_samples(
            steps_ns in prop::collection::vec(400_000_u64..20_000_000, 400..500),
            sampling_time_s in prop::sample::select(vec![0.001, 0.004, 0.01, 0.033, 0.1]),
        ) {
            let mut time_ns = 0;
            let times: Vec<u64> = steps_ns
                .into_iter()
                .map(|step| { time_ns += step; time_ns })
                .filter(|ns| *ns < 3_300_000_000)
                .collect();
            let recording = recording(times.into_iter());
            let mut task = task(Manifold::R3S3);
            task.sampling_time_s = sampling_time_s;
            let begin_s = cut(&recording.samples, &task)[0].time_ns as f64 * 1e-9;
            let last_s = recording.samples[recording.samples.len() - 1].time_ns as f64 * 1e-9;
            let recorded = recording.finish(&task).unwrap().demonstration;
            prop_assert!(recorded.poses.len() >= POINTS_MIN);
            for (k, pose) in recorded.poses.iter().enumerate() {
                let time_s = begin_s + k as f64 * sampling_time_s;
                prop_assert!(time_s < last_s + 1e-6);
                // Two samples are at most 20 ms apart: ⅛ (0.02 s)² × the largest acceleration.
                let (m, rad) = task.apart(pose, &at(time_s));
                prop_assert!(m < 1e-4 && rad < 5e-4, "{} m, {} rad at {}", m, rad, time_s);
            }
        }
    }
}
