//! Step 1, alignment: a common time for demonstrations that people gave at their own pace.
//!
//! Nobody repeats a motion at the same pace. What the demonstrations have in common is therefore found by
//! where they are, seen from their frames, and not by the clock:
//!
//! 1. rests at the ends and pauses are [found](rest), with the recording's noise in mind, and cut,
//! 2. each demonstration gets a coordinate σ, the length of its path in position and orientation,
//!    which is regular where nothing moves,
//! 3. a monotone map of σ onto that of a common template (`template`) is found for all of them
//!    together, by dynamic programming (`warp`): where the demonstrations agree, seen from a frame, that
//!    frame speaks,
//! 4. the common timing (`timing`) is the mean of theirs, lasts as long as they do at the median, and
//!    pauses where all of them do.
//!
//! Each demonstration is then sampled anew at the common times: all that follows sees demonstrations of
//! the same duration, which are at the same place of the skill at the same time.
//!
//! ```text
//! t_i(b) = σ_i⁻¹(γ_i(b))     T(b) = median_j T_j · mean_i t_i(b)/T_i     x_i(t) = X_i(t_i(T⁻¹(t)))
//! ```

pub mod consistency;
pub(crate) mod groups;
pub(crate) mod resample;
pub mod rest;
mod template;
mod timing;
mod warp;

use tprmp_spatial::Pose;

use crate::alignment::rest::{DemonstrationError, Motion};
use crate::alignment::template::Views;
use crate::alignment::timing::{CommonTime, Track};
use crate::canonical::kaiser_smoothing::kaiser_smoothing;
use crate::canonical::means::{mean_pose, mean_start};
use crate::demonstration::Demonstration;
use crate::skill::{AlignmentMethod, FitSettings, Skill};

/// Demonstrations as they are learned from.
#[derive(Clone, Debug)]
pub struct Aligned {
    /// The demonstrations at the common times: without rests, of one duration.
    pub demonstrations: Vec<Demonstration>,
    /// What was done to each.
    pub alignments: Vec<Alignment>,
    /// Where the common motion pauses: its beginning and its duration \[s\].
    pub pauses: Vec<[f64; 2]>,
}

/// What was done to a demonstration.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    /// Sample of the recording, with its fraction, at each common time.
    pub samples: Vec<f64>,
    /// Time between the samples of the recording \[s\].
    pub sampling_time_s: f64,
    /// Pauses that the others do not make, which were cut \[s\].
    pub pauses_s: f64,
    /// Duration of the motion, without them \[s\].
    pub duration_s: f64,
}

/// Steps of the table of an alignment.
const TABLE_STEPS: usize = 50;

impl Alignment {
    /// The samples of the recording that move, pauses included.
    #[must_use]
    pub fn moving(&self) -> std::ops::Range<usize> {
        let last = self.samples[self.samples.len() - 1];
        self.samples[0].round() as usize..last.round() as usize + 1
    }

    /// Times in the recording at equal steps of the common time \[s\].
    #[must_use]
    pub fn table_s(&self) -> Vec<f64> {
        let last = (self.samples.len() - 1) as f64;
        let time = |step: usize| {
            let place = step as f64 / TABLE_STEPS as f64 * last;
            let i = (place as usize).min(self.samples.len() - 2);
            let (a, b) = (self.samples[i], self.samples[i + 1]);
            (a + (place - i as f64) * (b - a)) * self.sampling_time_s
        };
        (0..=TABLE_STEPS).map(time).collect()
    }
}

/// Cuts rests, and brings the demonstrations to a common time, as the skill's `alignment` says.
///
/// # Errors
/// [`DemonstrationError`]: one does not move.
///
/// # Panics
/// When there is no demonstration, or one lacks a frame of the skill.
pub fn align(skill: &Skill, recorded: &[Demonstration]) -> Result<Aligned, DemonstrationError> {
    Ok(Prepared::new(skill, recorded)?.aligned(skill.alignment.method))
}

/// Demonstrations of which it is known when they move. What the fit smooths before anything else is
/// smoothed; the start frame of a skill that has no other is fixed to its goal frame.
pub(crate) struct Prepared<'a> {
    skill: &'a Skill,
    demonstrations: Vec<Demonstration>,
    motions: Vec<Motion>,
}

impl<'a> Prepared<'a> {
    /// # Errors
    /// [`DemonstrationError`]: one does not move.
    pub(crate) fn new(
        skill: &'a Skill,
        recorded: &[Demonstration],
    ) -> Result<Self, DemonstrationError> {
        let demonstrations = with_start_frame(skill, smoothed(skill, recorded));
        let motions = rest::motions(&demonstrations, &skill.smoothing, &skill.scale)?;
        Ok(Self { skill, demonstrations, motions })
    }

    /// Brought to a common time by a method.
    pub(crate) fn aligned(&self, method: AlignmentMethod) -> Aligned {
        let Self { skill, demonstrations, motions } = self;
        let settings = &skill.alignment;
        if matches!(skill.fit, FitSettings::Thesis(_)) && method == AlignmentMethod::Clock {
            return as_recorded(demonstrations.clone(), motions);
        }
        let track = |motion: &Motion| match method {
            AlignmentMethod::Clock => Track::by_clock(motion),
            _ => Track::new(motion, settings.pause_min_s),
        };
        let tracks: Vec<Track> = motions.iter().map(track).collect();
        let warped = |frames: &[usize]| {
            let views = Views::new(skill, demonstrations, motions, &tracks, frames);
            template::warps(&views, settings)
        };
        let warps = match method {
            AlignmentMethod::Clock | AlignmentMethod::ArcLength => Vec::new(),
            // The goal's view alone, in which every demonstration ends alike.
            AlignmentMethod::Barycentre => warped(&[skill.goal_index()]),
            AlignmentMethod::Joint => {
                warped(&(0..skill.frames(&demonstrations[0]).len()).collect::<Vec<_>>())
            }
        };
        let common = CommonTime::new(&tracks, &warps);
        at_common_times(demonstrations.clone(), motions, &tracks, &common)
    }
}

/// Without the rests, each at its own times, as the thesis does it.
fn as_recorded(mut demonstrations: Vec<Demonstration>, motions: &[Motion]) -> Aligned {
    let mut alignments = Vec::with_capacity(motions.len());
    for (demonstration, motion) in demonstrations.iter_mut().zip(motions) {
        let (moving, dt) = (motion.moving.clone(), motion.sampling_time_s);
        let last = demonstration.poses.len() - 1;
        let samples: Vec<f64> = moving.clone().map(|sample| sample as f64).collect();
        demonstration.gripper = demonstration.gripper.take().map(|g| g.between_ends(&samples));
        alignments.push(Alignment {
            samples,
            sampling_time_s: dt,
            pauses_s: 0.0,
            duration_s: (moving.len() - 1) as f64 * dt,
        });
        let (first, end) = (demonstration.poses[0], demonstration.poses[last]);
        demonstration.poses = demonstration.poses[moving].to_vec();
        // Without its rests it still begins and ends where it did.
        demonstration.poses[0] = first;
        *demonstration.poses.last_mut().expect("it moves") = end;
    }
    Aligned { demonstrations, alignments, pauses: Vec::new() }
}

/// Each demonstration sampled at the common times.
fn at_common_times(
    mut demonstrations: Vec<Demonstration>,
    motions: &[Motion],
    tracks: &[Track],
    common: &CommonTime,
) -> Aligned {
    let mut alignments = Vec::with_capacity(tracks.len());
    for (i, demonstration) in demonstrations.iter_mut().enumerate() {
        let (samples, dt) = (common.samples(i), motions[i].sampling_time_s);
        let mut poses: Vec<Pose> = resample::poses(&demonstration.poses, &samples);
        demonstration.gripper = demonstration.gripper.take().map(|g| g.between_ends(&samples));
        let last = demonstration.poses.len() - 1;
        let moving = &motions[i].moving;
        // It begins and ends where it rests: at first, and at last.
        poses[0] = mean_pose(&demonstration.poses[..=moving.start / 2]);
        let end = (moving.end - 1 + last).div_ceil(2);
        *poses.last_mut().expect("there are some") = mean_pose(&demonstration.poses[end..]);
        alignments.push(Alignment {
            pauses_s: tracks[i].pauses_s() - common.kept_pauses_s(i),
            duration_s: tracks[i].duration_s() + common.kept_pauses_s(i),
            samples,
            sampling_time_s: dt,
        });
        demonstration.poses = poses;
        demonstration.sampling_time_s = common.sampling_time_s;
    }
    Aligned { demonstrations, alignments, pauses: common.pauses() }
}

/// Smoothed by a Kaiser window where the fit asks for it.
fn smoothed(skill: &Skill, recorded: &[Demonstration]) -> Vec<Demonstration> {
    let mut demonstrations = recorded.to_vec();
    if let Some(settings) = skill.fit.kaiser_smoothing() {
        for demonstration in &mut demonstrations {
            let (poses, dt) = (&demonstration.poses, demonstration.sampling_time_s);
            demonstration.poses = kaiser_smoothing(poses, dt, settings);
        }
    }
    demonstrations
}

/// With a start frame that is fixed to the goal frame for skills that have no other.
fn with_start_frame(skill: &Skill, mut demonstrations: Vec<Demonstration>) -> Vec<Demonstration> {
    if !skill.has_start_frame() {
        let start = mean_start(&demonstrations);
        for demonstration in &mut demonstrations {
            demonstration.start = demonstration.goal_frame.compose(&start);
        }
    }
    demonstrations
}
