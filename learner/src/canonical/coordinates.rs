//! Brings demonstrations into canonical coordinates.
//!
//! The canonical frames are the means of the demonstrations' frames; the goal is the mean final
//! pose of the tool relative to the goal frame. The demonstrations are [aligned](crate::alignment), and
//! the phase follows from their common time by the [profile](PhaseProfile). Each demonstration is pulled back
//! through the [map](tprmp_rmpflow::policy::canonical::frame_map) of its own frames, then smoothed.

use glam::{DQuat, DVec3};
use tprmp_rmpflow::policy::canonical::frame_map::{Canonical, FrameMap, FrameTransforms};
use tprmp_spatial::Pose;

use crate::alignment::rest::DemonstrationError;
use crate::canonical::frame_map::{self, Moving};
use crate::canonical::means::mean_frames;
use crate::canonical::path::Path;
use crate::canonical::phase_profile::PhaseProfile;
use crate::canonical::savitzky_golay::smooth;
use crate::canonical::scales::{scales, span};
use crate::demonstration::{Demonstration, mean_duration_s};
use crate::skill::{FitSettings, Skill};

/// Largest angle between a demonstrated orientation and the goal's \[rad\]: the chart ends at π, and its
/// derivatives grow without bound before.
pub const ANGLE_MAX_RAD: f64 = 0.95 * std::f64::consts::PI;

/// Demonstrations in canonical coordinates.
#[derive(Clone, Debug)]
pub struct CanonicalSet {
    /// The map of the frames.
    pub map: FrameMap,
    /// For each further frame, how far the demonstrations lie apart seen from it, at best, as a fraction of
    /// what start and goal frame see.
    pub fractions: Vec<Option<f64>>,
    /// The start frame in canonical coordinates.
    pub start: Pose,
    /// s in ŷ = s y, of the positions [1/m] and of the rotations [1/rad].
    pub scales: [f64; 2],
    /// One a demonstration, in their order.
    pub demonstrations: Vec<CanonicalDemonstration>,
}

/// A demonstration in canonical coordinates.
#[derive(Clone, Debug)]
pub struct CanonicalDemonstration {
    /// Its frames, ready to map with.
    pub transforms: FrameTransforms,
    /// Fraction of the duration at which each sample is taken.
    pub times: Vec<f64>,
    /// Phase of each sample, with its first two derivatives in time [1, 1/s, 1/s²].
    pub phases: Vec<[f64; 3]>,
    /// Positions \[m\].
    pub position: Path,
    /// Rotation vectors at the goal \[rad\]; all zero for skills without an orientation.
    pub rotation: Path,
}

/// Brings aligned demonstrations into canonical coordinates.
///
/// # Errors
/// [`DemonstrationError`]: one rotates by almost 180° or more against the goal.
///
/// # Panics
/// When there is no demonstration, or one lacks a frame of the skill.
pub fn canonicalise(
    skill: &Skill,
    demonstrations: &[Demonstration],
) -> Result<CanonicalSet, DemonstrationError> {
    let mean = mean_frames(demonstrations);
    let moving: Vec<Moving> = demonstrations
        .iter()
        .map(|d| Moving { frames: skill.frames(d), poses: &d.poses })
        .collect();
    let profile = PhaseProfile::of(&skill.fit, mean_duration_s(demonstrations));
    let (map, fractions) = frame_map::choose(skill, &mean, &moving, &profile).map_err(|error| {
        DemonstrationError { name: demonstrations[0].name.clone(), problem: format!("{error:?}") }
    })?;
    let mut all = Vec::with_capacity(demonstrations.len());
    for (demonstration, moving) in demonstrations.iter().zip(&moving) {
        let mut canonical = pulled_back(skill, demonstration, moving, &map, &profile)?;
        canonical.position.end_at(mean.goal.position, demonstration.sampling_time_s);
        canonical.rotation.end_at(DVec3::ZERO, demonstration.sampling_time_s);
        all.push(canonical);
    }
    let scales = scales(
        &skill.scale,
        span(all.iter().map(|d| &d.position), mean.goal_frame.orientation),
        span(all.iter().map(|d| &d.rotation), DQuat::IDENTITY),
    );
    Ok(CanonicalSet { map, fractions, start: mean.start, scales, demonstrations: all })
}

/// A demonstration through the map of its frames, smoothed, and from rest where the policy starts so.
fn pulled_back(
    skill: &Skill,
    demonstration: &Demonstration,
    moving: &Moving,
    map: &FrameMap,
    profile: &PhaseProfile,
) -> Result<CanonicalDemonstration, DemonstrationError> {
    let transforms = moving.transforms(map);
    let (count, sampling_time_s) = (moving.poses.len(), demonstration.sampling_time_s);
    let times: Vec<f64> = (0..count).map(|i| i as f64 / (count - 1) as f64).collect();
    let duration_s = (count - 1) as f64 * sampling_time_s;
    let in_time = |time: &f64| {
        let [phase, rate, second] = profile.at(*time);
        [phase, rate / duration_s, second / (duration_s * duration_s)]
    };
    let phases: Vec<_> = times.iter().map(in_time).collect();
    let mut positions = Vec::with_capacity(count);
    let mut rotations = Vec::with_capacity(count);
    for (i, (pose, [phase, ..])) in moving.poses.iter().zip(&phases).enumerate() {
        let mut point = map.inverse(&transforms, *phase, pose);
        if !demonstration.manifold.has_orientation() {
            point.rotation = DVec3::ZERO;
        }
        let angle = point.rotation.length();
        if angle > ANGLE_MAX_RAD {
            let problem = format!(
                "{:.0} % of its motion on, it is rotated by {:.0}° against the goal; at most {:.0}° can \
                 be learned",
                100.0 * times[i],
                angle.to_degrees(),
                ANGLE_MAX_RAD.to_degrees()
            );
            return Err(DemonstrationError { name: demonstration.name.clone(), problem });
        }
        positions.push(point.position);
        rotations.push(point.rotation);
    }
    let smoothed = |samples: &[DVec3]| {
        let mut path =
            smooth(samples, sampling_time_s, skill.smoothing.window_s, skill.smoothing.degree);
        if let FitSettings::Canonical(settings) = &skill.fit {
            let rate_1_s = settings.catch_up_ratio * settings.damping_1_s;
            path.start_from_rest(rate_1_s, sampling_time_s);
        }
        path
    };
    let (position, rotation) = (smoothed(&positions), smoothed(&rotations));
    Ok(CanonicalDemonstration { transforms, times, phases, position, rotation })
}

/// A demonstration without its rests in canonical coordinates, for its frames.
#[must_use]
pub fn canonical_path(
    map: &FrameMap,
    transforms: &FrameTransforms,
    profile: &PhaseProfile,
    poses: &[Pose],
) -> Vec<Canonical> {
    let last = (poses.len() - 1) as f64;
    let at = |(i, pose)| map.inverse(transforms, profile.at(i as f64 / last)[0], pose);
    poses.iter().enumerate().map(at).collect()
}
