//! From the samples of one motion to a demonstration: cut where the tool rests, and brought to even
//! times.

use glam::DQuat;
use tprmp_model::skill_model::{FRAME_CAPACITY, Manifold, Remarks};
use tprmp_spatial::Pose;

use super::bounds::Bounds;
use super::cut::{Cut, Motion};
use super::frame_rest::RestingFrame;
use super::grips;
use super::intake::Frames;
use super::rest::Sample;
use super::statistics::Extent;
use crate::demonstration::{Demonstration, POINTS_MIN};
use crate::skill::Skill;

/// The length of a path is measured in steps of this size, so that noise lengthens it by little [m].
const PATH_STEP_M: f64 = 0.01;
/// Less of a rotation about z than this is none.
const ROTATION_MIN: f64 = 1e-3;
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
    pub(super) bounds: Bounds,
}

impl Task {
    pub(super) fn new(skill: &Skill, sampling_time_s: f64, bounds: Bounds) -> Self {
        let required = std::iter::once(&skill.goal_frame).chain(&skill.other_frames);
        let own_start = skill.has_start_frame();
        Self {
            skill: skill.skill.clone(),
            // What is part of a pose is recorded as poses.
            manifold: if skill.manifold.is_part_of_pose() {
                Manifold::R3S3
            } else {
                skill.manifold
            },
            required_frames: required.cloned().collect(),
            start_frame: own_start.then(|| skill.start_frame.clone()),
            sampling_time_s,
            bounds,
        }
    }

    /// The names of all frames: those that have to be usable, then the start frame.
    pub(super) fn frames(&self) -> impl Iterator<Item = &String> {
        self.required_frames.iter().chain(&self.start_frame)
    }

    /// A tool's pose in the place of a start frame.
    fn as_frame(&self, tool: &Pose) -> Pose {
        let mut frame = *tool;
        if self.manifold == Manifold::R2 {
            frame.position.z = 0.0;
            // The rotation about z; none for a tool that points down.
            let about_z = DQuat::from_xyzw(0.0, 0.0, tool.orientation.z, tool.orientation.w);
            let is_defined = about_z.length() > ROTATION_MIN;
            frame.orientation = if is_defined { about_z.normalize() } else { DQuat::IDENTITY };
        }
        frame
    }
}

/// One motion, from rest to rest.
#[derive(Debug)]
pub(super) struct Recording {
    /// In order of time, with some rest before and after.
    pub(super) samples: Vec<Sample>,
    /// When the tool was first seen to move [ns].
    pub(super) begun_ns: u64,
    /// Standard deviation of the samples on the noisiest axis [m], [rad].
    pub(super) noise: Extent,
    /// The frames, in the order of [`Task::frames`], as they rested when the motion began; the start
    /// frame only where one is published.
    pub(super) frames: [Option<RestingFrame>; FRAME_CAPACITY],
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
        let (mut path_m, mut passed) = (0.0, recorded.poses[0].position);
        for pose in &recorded.poses {
            let step_m = (pose.position - passed).length();
            if step_m > PATH_STEP_M {
                (path_m, passed) = (path_m + step_m, pose.position);
            }
        }
        let count = recorded.poses.len();
        let duration_s = (count - 1) as f64 * recorded.sampling_time_s;
        format!("{count} samples, {duration_s:.2} s, path {path_m:.3} m")
    }
}

impl Recording {
    /// Handles the next sample, `elapsed_ns` after the one before [ns], what is known of the frames
    /// then, and how many states are missing before it.
    pub(super) fn add(&mut self, sample: Sample, frames: &Frames, elapsed_ns: u64, skipped: u64) {
        self.samples.push(sample);
        self.skipped += skipped;
        for (missing_ns, status) in self.missing_ns.iter_mut().zip(frames) {
            if status.is_err() {
                *missing_ns += elapsed_ns;
            }
        }
    }

    /// From its first sample to its last [ns].
    pub(super) fn duration_ns(&self) -> u64 {
        let ends = self.samples.first().zip(self.samples.last());
        ends.map_or(0, |(first, last)| last.time_ns - first.time_ns)
    }

    /// The motion among the samples; why there is none.
    fn cut(&self, task: &Task) -> Result<Cut, String> {
        let (samples, begun_ns, noise) = (&self.samples[..], self.begun_ns, self.noise);
        let (manifold, bounds) = (task.manifold, task.bounds);
        let motion = Motion { samples, begun_ns, noise, manifold, bounds };
        let cut = motion.cut().ok_or("it has no samples")?;
        if cut.moved.is_within(bounds.motion_min()) {
            return Err(format!(
                "the tool moved by {:.1} mm and {:.1}° only",
                cut.moved.m * 1e3,
                cut.moved.rad.to_degrees()
            ));
        }
        Ok(cut)
    }

    /// The demonstration; what is missing for one, when there is none.
    pub(super) fn finish(self, task: &Task) -> Result<Recorded, String> {
        let Cut { kept, start, .. } = self.cut(task)?;
        let kept = kept.start..grips::end(&self.samples, kept.end, task.sampling_time_s);
        let samples = &self.samples[kept];
        let places = places(samples, task.sampling_time_s);
        let mut poses = resample(samples, &places);
        let (gripper, unknown) = grips::at(samples, &places);
        if poses.len() < POINTS_MIN {
            return Err(format!(
                "it has {} samples, at least {POINTS_MIN} are needed",
                poses.len()
            ));
        }
        let mut required = task.required_frames.iter().zip(self.frames).map(|(name, frame)| {
            let frame = frame.expect("a motion begins when the required frames are usable");
            (name.clone(), frame.pose)
        });
        let (_, goal_frame) = required.next().expect("the goal frame is required");
        let other_frames = required.collect();
        let start = match &task.start_frame {
            None => goal_frame,
            Some(_) => {
                let published = self.frames[task.required_frames.len()];
                published.map_or_else(|| task.as_frame(&start), |frame| frame.pose)
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
        let mut notes = self.notes(task, (poses[0].position - start.position).length());
        notes.extend(unknown);
        let demonstration = Demonstration {
            name: String::new(),
            sha256: String::new(),
            skill: task.skill.clone(),
            manifold: task.manifold,
            sampling_time_s: task.sampling_time_s,
            start,
            goal_frame,
            other_frames,
            remarks: Remarks::default(),
            poses,
            gripper,
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

/// Even times from the first sample on, as far as the samples go: the sample before each, and what fraction of
/// the way to the next one it lies.
fn places(samples: &[Sample], sampling_time_s: f64) -> Vec<(usize, f64)> {
    let [first, .., last] = samples else { return samples.iter().map(|_| (0, 0.0)).collect() };
    let step_ns = (sampling_time_s * 1e9).round() as u64;
    let mut i = 0;
    let place = |time_ns: u64| {
        while i + 2 < samples.len() && samples[i + 1].time_ns <= time_ns {
            i += 1;
        }
        let (a, b) = (&samples[i], &samples[i + 1]);
        (i, (time_ns - a.time_ns) as f64 / (b.time_ns - a.time_ns) as f64)
    };
    (first.time_ns..=last.time_ns).step_by(step_ns as usize).map(place).collect()
}

/// Poses at places between samples: on straight lines and at a constant angular velocity. Neighbouring
/// quaternions are on one side of the sphere.
fn resample(samples: &[Sample], places: &[(usize, f64)]) -> Vec<Pose> {
    if samples.len() < 2 {
        return samples.iter().map(|s| s.pose).collect();
    }
    let mut poses: Vec<Pose> = Vec::with_capacity(places.len());
    for (i, fraction) in places {
        let (a, b) = (&samples[*i], &samples[i + 1]);
        let Pose { position, orientation } = a.pose.interpolate(&b.pose, *fraction);
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
    use crate::record::cut::SETTLED;
    use crate::record::rest::offset;
    use glam::DVec3;
    use proptest::prelude::*;

    fn task(manifold: Manifold) -> Task {
        Task {
            skill: "made_up".into(),
            manifold,
            required_frames: vec!["end".into()],
            start_frame: Some("start".into()),
            sampling_time_s: 0.01,
            bounds: Bounds::default(),
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

    /// A frame where the tool is at a time.
    fn rested(time_s: f64) -> RestingFrame {
        RestingFrame { pose: at(time_s), noise: Extent::default(), count: 1 }
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
                    Sample { time_ns, pose: Pose { position, orientation }, grip: None }
                })
                .collect(),
            begun_ns: 700_000_000,
            noise: Extent::default(),
            frames: std::array::from_fn(|i| (i == 0).then(|| rested(3.0))),
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
        assert!((210..=242).contains(&poses.len()), "{}", poses.len());
        assert!(offset(task.manifold, &poses[0], &at(0.0)).extent().is_within(SETTLED));
        let start = offset(task.manifold, &recorded.demonstration.start, &poses[0]).extent();
        assert!(start.m < 1e-12 && start.rad < 1e-12, "{start:?}");
        let left = offset(task.manifold, &poses[poses.len() - 1], &at(3.3)).extent();
        assert!(left.is_within(SETTLED), "{left:?}");
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
        recording.frames[1] = Some(rested(1.0));
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
            let kept = recording.cut(&task).unwrap().kept;
            let begin_s = recording.samples[kept.start].time_ns as f64 * 1e-9;
            let last_s = recording.samples[recording.samples.len() - 1].time_ns as f64 * 1e-9;
            let recorded = recording.finish(&task).unwrap().demonstration;
            prop_assert!(recorded.poses.len() >= POINTS_MIN);
            for (k, pose) in recorded.poses.iter().enumerate() {
                let time_s = begin_s + k as f64 * sampling_time_s;
                prop_assert!(time_s < last_s + 1e-6);
                // Two samples are at most 20 ms apart: ⅛ (0.02 s)² × the largest acceleration.
                let Extent { m, rad } = offset(task.manifold, pose, &at(time_s)).extent();
                prop_assert!(m < 1e-4 && rad < 5e-4, "{} m, {} rad at {}", m, rad, time_s);
            }
        }
    }
}
