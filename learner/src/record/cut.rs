//! Where a motion begins and ends among its samples, and where the tool rested before and after.
//!
//! The tool has left its rest when the mean over [`SMOOTHING_NS`] is farther from it than
//! [`SETTLED`] and what noise explains; it has arrived when it is within that for good. What noise
//! hides of a slow beginning is made up for by keeping more of the rest.

use std::ops::Range;

use tprmp_model::skill_model::Manifold;
use tprmp_spatial::Pose;

use super::bounds::Bounds;
use super::rest::{Sample, offset};
use super::statistics::{Extent, Offset, mean_pose};

/// Of the rest before and after the motion so much is kept at least [ns].
const MARGIN_NS: u64 = 200_000_000;
/// Distances from the rest are means over this time [ns].
const SMOOTHING_NS: u64 = 100_000_000;
/// The tool rests while it is this near to where it began or ended.
pub(super) const SETTLED: Extent = Extent { m: 2e-4, rad: 1e-3 };

/// One motion among the samples of a recording.
#[derive(Debug)]
pub(super) struct Cut {
    /// The samples of the motion and of some rest before and after.
    pub(super) kept: Range<usize>,
    /// X_BE, the mean over the rest before.
    pub(super) start: Pose,
    /// How far the tool went from there at most, beyond what noise explains [m], [rad].
    pub(super) moved: Extent,
}

/// The samples of a recording, and what is known of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion<'a> {
    pub(super) samples: &'a [Sample],
    /// When the tool was first seen to move [ns].
    pub(super) begun_ns: u64,
    /// Standard deviation of the samples [m], [rad].
    pub(super) noise: Extent,
    pub(super) manifold: Manifold,
    pub(super) bounds: Bounds,
}

impl Motion<'_> {
    /// Cuts the motion out; `None` without samples.
    pub(super) fn cut(&self) -> Option<Cut> {
        let (first, last) = (self.samples.first()?, self.samples.last()?);
        let window_ns = self.bounds.window_ns();
        // The window in which the motion was noticed is the first that may hold some of it.
        let rested_ns = self.begun_ns.saturating_sub(window_ns);
        let start = self.rest(rested_ns.saturating_sub(window_ns)..rested_ns).unwrap_or(first.pose);
        let goal = self.rest(last.time_ns.saturating_sub(window_ns)..last.time_ns);
        let from_start = self.distances(&start);
        let to_goal = self.distances(&goal.unwrap_or(last.pose));

        let begun = self.samples.partition_point(|s| s.time_ns < self.begun_ns);
        let leaves = from_start[..begun].iter().rposition(Distance::is_settled).unwrap_or(0);
        let arrives = to_goal.iter().rposition(|d| !d.is_settled()).unwrap_or(0);
        let [begin_ns, end_ns] = [leaves, arrives].map(|i| self.samples[i].time_ns);
        let begin_ns = begin_ns.saturating_sub(self.margin_ns(&from_start[leaves]));
        let end_ns = end_ns + self.margin_ns(&to_goal[arrives]);
        let begin = self.samples.partition_point(|s| s.time_ns < begin_ns);
        let end = self.samples.partition_point(|s| s.time_ns <= end_ns);
        let moved = from_start.iter().map(Distance::certain).fold(Extent::default(), Extent::max);
        Some(Cut { kept: begin.min(end)..end, start, moved })
    }

    /// Where the tool rested in this time [ns]: the mean of what is near the median.
    fn rest(&self, times_ns: Range<u64>) -> Option<Pose> {
        let first = self.samples.partition_point(|s| s.time_ns < times_ns.start);
        let end = self.samples.partition_point(|s| s.time_ns <= times_ns.end);
        let poses: Vec<Pose> = self.samples[first..end].iter().map(|s| s.pose).collect();
        mean_pose(&poses, self.noise, SETTLED)
    }

    /// How far the tool is from this pose at each sample, as a mean over [`SMOOTHING_NS`] about it.
    fn distances(&self, from: &Pose) -> Vec<Distance> {
        let offset = |s: &Sample| offset(self.manifold, from, &s.pose);
        let offsets: Vec<Offset> = self.samples.iter().map(offset).collect();
        let (mut first, mut end, mut sum) = (0, 0, Offset::default());
        let mut distances = Vec::with_capacity(offsets.len());
        for sample in self.samples {
            let newest_ns = sample.time_ns + SMOOTHING_NS / 2;
            while self.samples.get(end).is_some_and(|s| s.time_ns <= newest_ns) {
                sum = sum.plus(offsets[end]);
                end += 1;
            }
            while self.samples[first].time_ns + SMOOTHING_NS / 2 < sample.time_ns {
                sum = sum.minus(offsets[first]);
                first += 1;
            }
            let count = end - first;
            let explained = Bounds::explained(self.noise, [count, usize::MAX]);
            let mean = sum.scaled(1.0 / count as f64).extent();
            distances.push(Distance { mean, explained });
        }
        distances
    }

    /// How much of the rest is kept: the tool may have gone as far as noise hides at the speed at
    /// which it counts as resting [ns].
    fn margin_ns(&self, at: &Distance) -> u64 {
        let (explained, speed) = (at.explained, self.bounds.rest_speed());
        let hidden_s = (explained.m / speed.m).max(explained.rad / speed.rad);
        MARGIN_NS + (hidden_s.min(0.5 * self.bounds.rest_s) * 1e9) as u64
    }
}

/// From a pose of rest.
#[derive(Debug, Clone, Copy)]
struct Distance {
    /// Mean over some samples [m], [rad].
    mean: Extent,
    /// What noise explains of it [m], [rad].
    explained: Extent,
}

impl Distance {
    fn is_settled(&self) -> bool {
        self.mean.is_within(SETTLED.plus(self.explained))
    }

    fn certain(&self) -> Extent {
        self.mean.plus(self.explained.scaled(-1.0))
    }
}
