//! A recorded demonstration: checked, and brought to even times.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;
use tprmp_files::name;
use tprmp_model::skill_model::{Manifold, Remarks};
use tprmp_spatial::Pose;

use super::holes::Holes;
use super::resampling::{even_places, resample};
use super::selection::Selection;
use crate::demonstration::{
    DURATION_MAX_S, Demonstration, Gripper, POINTS_MIN, POSITION_MAX_M, SAMPLES_MAX,
    SAMPLING_TIME_MIN_S, diagonal, plausibility::SPAN_MAX_M,
};
use crate::file_error::FileError;

/// Times farther away are refused [s].
const TIME_MAX_S: f64 = 1e12;
/// Fraction of the sampling time by which a sample may be early or late and still count as even.
const JITTER_MAX: f64 = 0.1;
/// A rate may be exceeded by this fraction without being thinned: times are rounded.
const RATE_TOLERANCE: f64 = 1e-3;
/// The sampling time by the velocities may differ from the declared one by this factor: noise and
/// filters pass, a factor of two does not.
const VELOCITY_FACTOR_MAX: f64 = 1.5;

/// One demonstration as it was recorded.
#[derive(Clone, Debug)]
pub(super) struct Recording {
    /// Where it is in the file, for errors, e.g. ``key `demonstrations[2]` ``.
    pub(super) place: String,
    /// Space of the poses.
    pub(super) manifold: Manifold,
    /// Start frame.
    pub(super) start: Pose,
    /// Goal frame.
    pub(super) goal_frame: Pose,
    /// Further frames by name.
    pub(super) other_frames: BTreeMap<String, Pose>,
    /// When [s].
    pub(super) times_s: Vec<f64>,
    /// Where; as many.
    pub(super) poses: Vec<Pose>,
    /// Recorded velocities of the position [m/s]; as many.
    pub(super) velocities: Option<Vec<DVec3>>,
    /// What the gripper does; as many.
    pub(super) gripper: Option<Gripper>,
    /// What else is to be said of it.
    pub(super) notes: Vec<String>,
    /// What was not read.
    pub(super) ignored: Option<String>,
    /// Whether its format says the unit of length, or has none.
    pub(super) has_own_unit: bool,
}

/// A recording that was brought to even times, and what is to be said of it.
#[derive(Debug)]
pub(super) struct Finished {
    pub(super) demonstration: Demonstration,
    /// What was read, in a line.
    pub(super) summary: String,
    /// Holes in time.
    pub(super) warning: Option<String>,
}

impl Recording {
    /// Checks the recording and brings it to even times.
    ///
    /// # Errors
    /// [`FileError::Input`]: too few samples, numbers that are not finite or too large, times that
    /// do not grow, that are uneven, or that contradict the velocities, motions in millimetres.
    pub(super) fn finish(
        mut self,
        path: &Path,
        skill: &str,
        name: &str,
        selection: &Selection,
    ) -> Result<Finished, FileError> {
        let place = self.place.clone();
        let fail = |problem| FileError::input(path, &place, problem);
        if let Some(step) = selection.recorded_at_s {
            self.times_s = (0..self.poses.len()).map(|i| i as f64 * step).collect();
        }
        if selection.drop_duplicate_stamps {
            self.drop_duplicates();
        }
        let duration_s = self.check(selection.recorded_at_s.is_some()).map_err(fail)?;
        let even_s = self.even_step_s(duration_s);
        let holes = Holes::find(&self.times_s, &self.poses);
        let warning = holes.warning(path);
        let recorded = self.poses.len();
        let steps = self.steps(path, duration_s, selection)?;
        let (sampling_time_s, poses, gripper) = match steps {
            Some(steps) => {
                let poses = resample(&self.times_s, &self.poses, steps, selection.interpolation);
                let gripper = self.gripper.map(|g| g.at(&even_places(&self.times_s, steps)));
                (duration_s / steps as f64, poses, gripper)
            }
            None => (even_s, self.poses, self.gripper),
        };
        let summary = summary(
            self.manifold,
            [recorded, poses.len()],
            [even_s, sampling_time_s],
            &self.notes,
            self.ignored,
        );
        let demonstration = Demonstration {
            name: name.into(),
            sha256: String::new(),
            skill: skill.into(),
            manifold: self.manifold,
            sampling_time_s,
            start: self.start,
            goal_frame: self.goal_frame,
            other_frames: self.other_frames,
            remarks: Remarks::default(),
            poses,
            gripper,
        };
        if selection.unit.is_none() && !self.has_own_unit {
            check_unit(&demonstration).map_err(fail)?;
        }
        Ok(Finished { demonstration, summary, warning })
    }

    /// Keeps the first of several samples with one time.
    fn drop_duplicates(&mut self) {
        let pairs = self.times_s.windows(2).map(|pair| pair[1] != pair[0]);
        let is_new: Vec<bool> = std::iter::once(true).chain(pairs).collect();
        let dropped = is_new.iter().filter(|is_new| !**is_new).count();
        if dropped > 0 {
            keep(&mut self.times_s, &is_new);
            keep(&mut self.poses, &is_new);
            if let Some(velocities) = &mut self.velocities {
                keep(velocities, &is_new);
            }
            match &mut self.gripper {
                Some(Gripper::Grips(grips)) => keep(grips, &is_new),
                Some(Gripper::Widths(widths_m)) => keep(widths_m, &is_new),
                None => {}
            }
            self.notes.push(format!("{dropped} samples of duplicate stamps dropped"));
        }
    }

    /// Into how many steps the recording is resampled; `None` where it stays as it is.
    fn steps(
        &self,
        path: &Path,
        duration_s: f64,
        selection: &Selection,
    ) -> Result<Option<usize>, FileError> {
        let even_s = self.even_step_s(duration_s);
        let Some(wanted_s) = selection.sampling_time_s else {
            let fail = |problem| FileError::input(path, &self.place, problem);
            self.check_even_times(even_s).map_err(fail)?;
            let by_rate = selection.rate_max_hz.map(|rate_hz| rate_hz * duration_s);
            let by_count = selection.samples_max.map(|count| count.saturating_sub(1) as f64);
            let most = by_rate.unwrap_or(f64::INFINITY).min(by_count.unwrap_or(f64::INFINITY));
            // A recording at the rate itself has it but for rounding.
            let is_fast = (self.poses.len() - 1) as f64 > most * (1.0 + RATE_TOLERANCE);
            let steps = most.min(SAMPLES_MAX as f64 - 1.0).floor().max(POINTS_MIN as f64 - 1.0);
            if is_fast || self.poses.len() > SAMPLES_MAX {
                if most.is_infinite() {
                    let found = self.poses.len();
                    return Err(fail(format!(
                        "expected at most {SAMPLES_MAX} samples, found {found}; --sampling-time-s makes fewer"
                    )));
                }
                return Ok(Some(steps as usize));
            }
            return Ok(None);
        };
        // The ends stay where they are: the step gives way.
        let steps = (duration_s / wanted_s).round();
        if !(steps >= POINTS_MIN as f64 - 1.0 && steps < SAMPLES_MAX as f64) {
            let problem = format!(
                "expected a time that makes {POINTS_MIN} to {SAMPLES_MAX} samples of {duration_s} s, found \
                 {wanted_s} s"
            );
            return Err(FileError::input(path, "option --sampling-time-s", problem));
        }
        Ok(Some(steps as usize))
    }

    /// The duration [s] of a sound recording. Who says how the samples were recorded has decided
    /// between times and velocities.
    fn check(&self, step_is_known: bool) -> Result<f64, String> {
        let count = self.poses.len();
        if count < POINTS_MIN {
            return Err(format!("expected at least {POINTS_MIN} samples, found {count}"));
        }
        self.check_names_and_numbers()?;
        let duration_s = self.times_s[count - 1] - self.times_s[0];
        let hint = "are its times in seconds? --time-unit says another unit";
        if duration_s > DURATION_MAX_S {
            return Err(format!(
                "expected at most {DURATION_MAX_S} s, found {duration_s} s: {hint}"
            ));
        }
        let even_s = self.even_step_s(duration_s);
        if even_s < SAMPLING_TIME_MIN_S {
            return Err(format!(
                "expected samples at least {SAMPLING_TIME_MIN_S:e} s apart, found {even_s:e} s: {hint}"
            ));
        }
        if !step_is_known {
            self.check_velocities(even_s)?;
        }
        Ok(duration_s)
    }

    /// Time between even samples [s].
    fn even_step_s(&self, duration_s: f64) -> f64 {
        duration_s / (self.poses.len() - 1) as f64
    }

    fn check_even_times(&self, even_s: f64) -> Result<(), String> {
        for (i, found) in self.times_s.iter().enumerate() {
            let expected = self.times_s[0] + i as f64 * even_s;
            if (found - expected).abs() > JITTER_MAX * even_s {
                let hole = Holes::find(&self.times_s, &self.poses);
                let hole =
                    hole.worst.map_or(String::new(), |hole| format!(", and there are {hole}"));
                return Err(format!(
                    "expected even times {even_s:.6} s apart, but sample {i} is at {found:.6} s \
                     instead of {expected:.6} s{hole}; --sampling-time-s makes them even"
                ));
            }
        }
        Ok(())
    }

    fn check_names_and_numbers(&self) -> Result<(), String> {
        for name in self.other_frames.keys() {
            name::check(name).map_err(|error| format!("frames: {error}"))?;
        }
        assert_eq!(self.times_s.len(), self.poses.len(), "readers check the lengths");
        let near = format!("expected finite positions below {POSITION_MAX_M} m");
        let known = [("start", &self.start), ("goal", &self.goal_frame)].into_iter();
        let others = self.other_frames.iter().map(|(name, frame)| (name.as_str(), frame));
        for (name, frame) in known.chain(others) {
            if !is_near(&frame.position) {
                return Err(format!("{near}, found {} of the {name} frame", frame.position));
            }
        }
        if let Some(i) = self.poses.iter().position(|pose| !is_near(&pose.position)) {
            return Err(format!("{near}, found {} at sample {i}", self.poses[i].position));
        }
        if let Some(i) = self.times_s.iter().position(|t| !t.is_finite() || t.abs() > TIME_MAX_S) {
            return Err(format!("expected a finite time, found {} at sample {i}", self.times_s[i]));
        }
        if let Some(i) = self.times_s.windows(2).position(|pair| pair[1] <= pair[0]) {
            let (before, after) = (self.times_s[i], self.times_s[i + 1]);
            let remedy = if after == before {
                "--drop-duplicate-stamps keeps the first of such samples"
            } else {
                "sort the samples by their times"
            };
            return Err(format!(
                "expected times that grow, found {after} s at sample {} after {before} s; {remedy}",
                i + 1
            ));
        }
        if self.poses.iter().all(|p| (p.position - self.poses[0].position).length() < 1e-9) {
            return Err("expected a motion, found a point that never moves".into());
        }
        Ok(())
    }

    /// Least squares of Δx = s v Δt: s is by how much longer a sample lasted than declared.
    fn check_velocities(&self, declared_s: f64) -> Result<(), String> {
        let Some(velocities) = &self.velocities else { return Ok(()) };
        assert_eq!(velocities.len(), self.poses.len(), "readers check the lengths");
        if let Some(i) = velocities.iter().position(|v| !is_near(v)) {
            let found = velocities[i];
            return Err(format!("expected finite velocities, found {found} at sample {i}"));
        }
        let (mut along, mut square) = (0.0, 0.0);
        for i in 1..self.poses.len() {
            let step = (velocities[i - 1] + velocities[i])
                * (0.5 * (self.times_s[i] - self.times_s[i - 1]));
            along += step.dot(self.poses[i].position - self.poses[i - 1].position);
            square += step.length_squared();
        }
        // Velocities that are all zero were not recorded.
        let factor = along / square;
        if square == 0.0 || (1.0 / VELOCITY_FACTOR_MAX..VELOCITY_FACTOR_MAX).contains(&factor) {
            return Ok(());
        }
        Err(format!(
            "the declared sampling time is {declared_s:.6} s, but by the recorded velocities it is \
             {:.6} s; say the right one by --recorded-at-s",
            factor * declared_s
        ))
    }
}

/// The values that are to be kept.
fn keep<T>(values: &mut Vec<T>, is_kept: &[bool]) {
    let mut is_kept = is_kept.iter();
    values.retain(|_| is_kept.next().copied().unwrap_or(true));
}

/// Refuses motions that are millimetres if anything.
fn check_unit(demonstration: &Demonstration) -> Result<(), String> {
    let frames = [&demonstration.start, &demonstration.goal_frame];
    let span_m = diagonal(demonstration.poses.iter().chain(frames).map(|pose| pose.position));
    if span_m <= SPAN_MAX_M {
        return Ok(());
    }
    Err(format!(
        "expected metres, found samples and frames {span_m:.0} m apart: --unit mm reads millimetres, --unit m \
         takes them as they are"
    ))
}

/// What was read, in a line; counts of samples and times between them [s] before and after resampling.
fn summary(
    manifold: Manifold,
    counts: [usize; 2],
    steps_s: [f64; 2],
    notes: &[String],
    ignored: Option<String>,
) -> String {
    let rate = |step_s: f64| {
        let rate_hz = format!("{:.1}", 1.0 / step_s);
        rate_hz.strip_suffix(".0").unwrap_or(&rate_hz).to_owned()
    };
    let [before, after] =
        [0, 1].map(|i| format!("{} samples at {} Hz", counts[i], rate(steps_s[i])));
    let mut parts = vec![manifold.to_string(), before.clone()];
    if after != before {
        let how = if counts[1] < counts[0] { "thinned" } else { "resampled" };
        parts[1] = format!("{before} {how} to {} at {} Hz", counts[1], rate(steps_s[1]));
    }
    parts.extend(notes.iter().cloned());
    parts.extend(ignored);
    parts.join(", ")
}

/// Finite and not far away: no coordinate is NaN.
fn is_near(vector: &DVec3) -> bool {
    vector.to_array().iter().all(|x| x.abs() <= POSITION_MAX_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::selection::Interpolation;
    use glam::DQuat;

    fn uneven() -> Recording {
        let times_s: Vec<f64> =
            (0..40).map(|i| 0.05 * f64::from(i) + 0.02 * f64::from(i).sin()).collect();
        let poses = times_s
            .iter()
            .enumerate()
            .map(|(i, t)| {
                let rotation = DQuat::from_rotation_z(0.8 * t);
                let position = DVec3::new(t * t, 1.0 - t, 0.3 * t);
                // Every third quaternion is on the other side.
                Pose { position, orientation: if i % 3 == 0 { -rotation } else { rotation } }
            })
            .collect();
        let still = Pose { position: DVec3::ZERO, orientation: DQuat::IDENTITY };
        Recording {
            place: "here".into(),
            manifold: Manifold::R3S3,
            start: still,
            goal_frame: still,
            other_frames: BTreeMap::new(),
            times_s,
            poses,
            velocities: None,
            gripper: None,
            notes: Vec::new(),
            ignored: None,
            has_own_unit: false,
        }
    }

    fn finish(recording: Recording, selection: &Selection) -> Result<Demonstration, String> {
        let path = Path::new("demonstration.csv");
        recording
            .finish(path, "made_up", "demonstration.json", selection)
            .map(|finished| finished.demonstration)
            .map_err(|e| e.to_string())
    }

    #[test]
    fn cubics_keep_parabolas_and_rotations_and_both_ends() {
        let recording = uneven();
        let (first, last) = (recording.times_s[0], recording.times_s[39]);
        for (interpolation, error_max) in
            [(Interpolation::Cubic, 1e-9), (Interpolation::Linear, 2e-3)]
        {
            let selection =
                Selection { sampling_time_s: Some(0.017), interpolation, ..Selection::default() };
            let even = finish(recording.clone(), &selection).unwrap();
            let count = even.poses.len() - 1;
            assert_eq!(even.poses[0], recording.poses[0]);
            assert_eq!(even.poses[count], recording.poses[39]);
            assert!((even.sampling_time_s * count as f64 - (last - first)).abs() < 1e-12);
            assert!((even.sampling_time_s / 0.017 - 1.0).abs() < 0.01);
            for (k, pose) in even.poses.iter().enumerate() {
                let t = first + k as f64 * even.sampling_time_s;
                let expected = DVec3::new(t * t, 1.0 - t, 0.3 * t);
                assert!((pose.position - expected).length() < error_max, "{k}");
                let rotation = DQuat::from_rotation_z(0.8 * t);
                assert!(rotation.dot(pose.orientation).abs() > 1.0 - 1e-9, "{k}");
            }
        }
    }

    #[test]
    fn uneven_times_ask_for_resampling() {
        let message = finish(uneven(), &Selection::default()).unwrap_err();
        assert!(message.contains("--sampling-time-s") && message.contains("here"), "{message}");
        let tiny = Selection { sampling_time_s: Some(1e-9), ..Selection::default() };
        assert!(finish(uneven(), &tiny).unwrap_err().contains("--sampling-time-s"));
        let mut back = uneven();
        back.times_s.swap(3, 4);
        assert!(finish(back, &tiny).unwrap_err().contains("times that grow"));
        let mut milliseconds = uneven();
        milliseconds.times_s.iter_mut().for_each(|t| *t *= 1e3);
        let even = Selection { sampling_time_s: Some(20.0), ..Selection::default() };
        let message = finish(milliseconds, &even).unwrap_err();
        assert!(message.contains("at most 600 s") && message.contains("in seconds"), "{message}");
    }

    #[test]
    fn a_sampling_time_off_by_two_is_found_by_the_velocities() {
        let mut recording = uneven();
        recording.times_s = (0..40).map(|i| 0.05 * f64::from(i)).collect();
        let speeds = |factor: f64| Some(vec![DVec3::new(0.2, -0.1, 0.3) * factor; 40]);
        for (i, pose) in recording.poses.iter_mut().enumerate() {
            pose.position = DVec3::new(0.2, -0.1, 0.3) * (0.05 * i as f64);
        }
        for (factor, found) in [(0.5, "0.100000 s"), (2.0, "0.025000 s"), (-1.0, "-0.050000 s")] {
            recording.velocities = speeds(factor);
            let message = finish(recording.clone(), &Selection::default()).unwrap_err();
            assert!(message.contains("0.050000 s") && message.contains(found), "{message}");
        }
        for factor in [0.0, 0.8, 1.0, 1.2] {
            recording.velocities = speeds(factor);
            assert!(finish(recording.clone(), &Selection::default()).is_ok(), "{factor}");
        }
        recording.velocities = speeds(0.5);
        for step_s in [0.05, 0.1] {
            let said = Selection { recorded_at_s: Some(step_s), ..Selection::default() };
            let even = finish(recording.clone(), &said).unwrap();
            assert!((even.sampling_time_s - step_s).abs() < 1e-12);
        }
    }
}
