//! Whether the frames rest, and where: means over a window of what is published of them.
//!
//! A camera sees a frame less often than states arrive. What is published again without a change is
//! no other measurement: it counts for how long it stood, but not for the noise.

use std::collections::VecDeque;

use tprmp_model::skill_model::FRAME_CAPACITY;

use super::bounds::Bounds;
use super::intake::Frames;
use super::rest::Sample;
use super::statistics::{Extent, Offset, centre, mean_pose, pose_noise};

/// A frame at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RestingFrame {
    /// X_BF, the mean.
    pub(super) pose: tprmp_spatial::Pose,
    /// Standard deviation of one measurement, of the noisiest axis [m], [rad].
    pub(super) noise: Extent,
    /// Number of measurements.
    pub(super) count: usize,
}

/// How far a frame has gone, and how far it may.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Drift {
    /// [m], [rad].
    pub(super) moved: Extent,
    /// The bound, and what noise explains [m], [rad].
    pub(super) bound: Extent,
}

impl Drift {
    pub(super) fn moves(&self) -> bool {
        !self.moved.is_within(self.bound)
    }
}

/// What was published of each frame of a skill in the last [`Bounds::rest_s`].
#[derive(Debug)]
pub(super) struct FramesRest {
    bounds: Bounds,
    recent: [VecDeque<Sample>; FRAME_CAPACITY],
    now_ns: u64,
}

impl FramesRest {
    pub(super) fn new(bounds: Bounds) -> Self {
        Self { bounds, recent: std::array::from_fn(|_| VecDeque::new()), now_ns: 0 }
    }

    /// The next state may be of any time.
    pub(super) fn forget(&mut self) {
        self.recent.iter_mut().for_each(VecDeque::clear);
    }

    /// Handles the frames as they are at the time of a state [ns].
    pub(super) fn update(&mut self, now_ns: u64, frames: &Frames) {
        self.now_ns = now_ns;
        for (recent, status) in self.recent.iter_mut().zip(frames) {
            recent.extend(status.ok().map(|pose| Sample { time_ns: now_ns, pose, grip: None }));
            while recent.front().is_some_and(|s| now_ns - s.time_ns > self.bounds.rest_ns()) {
                recent.pop_front();
            }
        }
    }

    /// Where frame `i` was in the last [`Bounds::rest_s`]; `None` when it was not usable.
    pub(super) fn resting(&self, i: usize) -> Option<RestingFrame> {
        let poses: Vec<_> = self.recent[i].iter().map(|s| s.pose).collect();
        let offsets = self.offsets(i);
        let (noise, count) = measured(&offsets);
        Some(RestingFrame { pose: mean_pose(&poses, noise, self.bounds.frame())?, noise, count })
    }

    /// How far frame `i` has gone from one half of the last [`Bounds::rest_s`] to the other; `None`
    /// when it was not usable in both.
    pub(super) fn drift(&self, i: usize) -> Option<Drift> {
        let offsets = self.offsets(i);
        let (before, after) = offsets.split_at(self.newer_than(i, self.bounds.rest_ns() / 2));
        let ((noise, _), radius) = (measured(&offsets), self.bounds.frame());
        let moved = centre(after, noise, radius)?.minus(centre(before, noise, radius)?);
        let counts = [measured(before).1, measured(after).1];
        Some(self.against(moved, noise, counts))
    }

    /// How far frame `i` has gone from where it rested, as a mean over [`Bounds::rest_window_s`];
    /// `None` when it was not usable.
    pub(super) fn drift_from(&self, i: usize, rested: &RestingFrame) -> Option<Drift> {
        let window = self.recent[i].range(self.newer_than(i, self.bounds.window_ns())..);
        let offsets: Vec<_> = window.map(|s| Offset::between(&rested.pose, &s.pose)).collect();
        let moved = centre(&offsets, rested.noise, self.bounds.frame())?;
        Some(self.against(moved, rested.noise, [rested.count, measured(&offsets).1]))
    }

    fn against(&self, moved: Offset, noise: Extent, counts: [usize; 2]) -> Drift {
        let bound = self.bounds.frame().plus(Bounds::explained(noise, counts));
        Drift { moved: moved.extent(), bound }
    }

    /// The place of the first sample of frame `i` that is not older than this [ns].
    fn newer_than(&self, i: usize, age_ns: u64) -> usize {
        self.recent[i].partition_point(|s| self.now_ns - s.time_ns > age_ns)
    }

    /// The samples of frame `i`, from the first of them on.
    fn offsets(&self, i: usize) -> Vec<Offset> {
        let Some(from) = self.recent[i].front() else { return Vec::new() };
        self.recent[i].iter().map(|s| Offset::between(&from.pose, &s.pose)).collect()
    }
}

/// Noise and number of the measurements among offsets: of those that follow each other and are equal,
/// only one was measured.
fn measured(offsets: &[Offset]) -> (Extent, usize) {
    let mut distinct = offsets.to_vec();
    distinct.dedup();
    (pose_noise(&distinct), distinct.len())
}
