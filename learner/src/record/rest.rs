//! Whether the tool rests: its mean speed over a window, against a bound and what noise explains.
//!
//! ```text
//! v = (c₂ − c₁) / Δt        it moves when  |v| > bound + k σ √(1/n₁ + 1/n₂) / Δt
//! ```
//!
//! c₁ and c₂ are the centres of both halves of the window, of n₁ and n₂ states, and Δt lies between
//! their mean times. σ is measured from the states themselves. Nothing depends on velocities, which a
//! publisher may not measure.

use std::collections::VecDeque;

use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

use super::bounds::Bounds;
use super::statistics::{Extent, NOISE_SAMPLES, Offset, centre, pose_noise};
use crate::demonstration::Grip;

/// States are judged no more often than this [ns]: they may follow each other much faster.
const JUDGED_NS: u64 = 20_000_000;

/// Where the tool was.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// When the state was measured [ns].
    pub(super) time_ns: u64,
    /// X_BE.
    pub(super) pose: Pose,
    /// What the gripper senses; `None` where it is not known.
    pub(super) grip: Option<Grip>,
}

/// From one pose to another, in what a skill on this manifold moves.
pub(super) fn offset(manifold: Manifold, from: &Pose, to: &Pose) -> Offset {
    let mut offset = Offset::between(from, to);
    if manifold == Manifold::R2 {
        offset.position.z = 0.0;
    }
    if !manifold.has_orientation() {
        offset.rotation = glam::DVec3::ZERO;
    }
    offset
}

/// What is known of the tool's motion.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion {
    /// Mean over the window [m/s], [rad/s].
    pub(super) speed: Extent,
    /// Below it the tool rests: the bound, and what noise explains [m/s], [rad/s].
    pub(super) bound: Extent,
    /// Standard deviation of the noisiest axis [m], [rad].
    pub(super) noise: Extent,
    /// How long it has rested [ns]; `None` while it moves.
    pub(super) rests_ns: Option<u64>,
    /// Since when it had rested, if this is the first window in which it moves again [ns].
    pub(super) rested_since_ns: Option<u64>,
}

impl Motion {
    pub(super) fn moves(&self) -> bool {
        self.rests_ns.is_none()
    }
}

/// The newest states of the tool, and what they say of its rest.
#[derive(Debug)]
pub(super) struct ToolRest {
    bounds: Bounds,
    manifold: Manifold,
    /// As many as are needed to know where the tool rested before a motion is noticed.
    recent: VecDeque<Sample>,
    /// What is known, and since when [ns].
    judged: Option<(u64, Motion)>,
    rests_since: Option<u64>,
}

impl ToolRest {
    pub(super) fn new(manifold: Manifold, bounds: Bounds) -> Self {
        let (recent, judged, rests_since) = (VecDeque::new(), None, None);
        Self { bounds, manifold, recent, judged, rests_since }
    }

    /// The next sample may be any.
    pub(super) fn forget(&mut self) {
        self.recent.clear();
        (self.judged, self.rests_since) = (None, None);
    }

    /// What is known; `None` until there is a window of samples.
    pub(super) fn motion(&self) -> Option<&Motion> {
        self.judged.as_ref().map(|(_, motion)| motion)
    }

    /// Time of the newest sample [ns].
    pub(super) fn newest_ns(&self) -> Option<u64> {
        self.recent.back().map(|sample| sample.time_ns)
    }

    /// The samples from a time on [ns], as far back as there are any.
    pub(super) fn samples_since(&self, begin_ns: u64) -> Vec<Sample> {
        let first = self.recent.partition_point(|s| s.time_ns < begin_ns);
        self.recent.range(first..).copied().collect()
    }

    /// Handles a sample; its time is later than that of the one before. Whether it was judged.
    pub(super) fn update(&mut self, sample: Sample) -> bool {
        self.recent.push_back(sample);
        let kept_ns = self.bounds.rest_ns() + 2 * self.bounds.window_ns();
        while self.recent.get(1).is_some_and(|s| sample.time_ns - s.time_ns >= kept_ns) {
            self.recent.pop_front();
        }
        if self.judged.is_some_and(|(at_ns, _)| sample.time_ns - at_ns < JUDGED_NS) {
            return false;
        }
        let Some(motion) = self.judge(sample.time_ns) else { return false };
        self.rests_since = motion.rests_ns.map(|rests_ns| sample.time_ns - rests_ns);
        self.judged = Some((sample.time_ns, motion));
        true
    }

    /// The motion over the window before now; `None` while there are no samples for all of it.
    fn judge(&self, now_ns: u64) -> Option<Motion> {
        let window_ns = self.bounds.window_ns();
        let within = |age_ns| move |s: &Sample| now_ns - s.time_ns >= age_ns;
        let first = self.recent.partition_point(within(window_ns)).checked_sub(1)?;
        let middle = self.recent.partition_point(within(window_ns / 2));
        let noisy = first.min(self.recent.len().saturating_sub(NOISE_SAMPLES));
        let from = self.recent[first].pose;
        let offset = |s: &Sample| offset(self.manifold, &from, &s.pose);
        let offsets: Vec<Offset> = self.recent.range(noisy..).map(offset).collect();
        let noise = pose_noise(&offsets);
        let (before, after) = offsets[first - noisy..].split_at(middle - first);
        let elapsed_s = self.mean_time_s(middle..self.recent.len(), now_ns)
            - self.mean_time_s(first..middle, now_ns);
        let radius = self.bounds.rest_speed().scaled(self.bounds.rest_window_s);
        let moved = centre(after, noise, radius)?.minus(centre(before, noise, radius)?);
        let explained = Bounds::explained(noise, [before.len(), after.len()]);
        let speed = moved.extent().scaled(1.0 / elapsed_s);
        let bound = self.bounds.rest_speed().plus(explained.scaled(1.0 / elapsed_s));
        let since = self.rests_since.unwrap_or(now_ns - window_ns / 2);
        let rests_ns = speed.is_within(bound).then(|| now_ns - since);
        let rested_since_ns = self.rests_since.filter(|_| rests_ns.is_none());
        Some(Motion { speed, bound, noise, rests_ns, rested_since_ns })
    }

    /// Mean time of some samples, from `now_ns` on [s].
    fn mean_time_s(&self, which: std::ops::Range<usize>, now_ns: u64) -> f64 {
        let count = which.len() as f64;
        let ages = self.recent.range(which).map(|s| (now_ns - s.time_ns) as f64 * 1e-9);
        -ages.sum::<f64>() / count
    }
}
