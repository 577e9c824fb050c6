//! Poses between the samples of a recording.

use tprmp_spatial::Pose;

use crate::canonical::means::mean_pose;

/// Poses at samples with fractions, in increasing order: each the mean of the samples that are nearer to it
/// than to its neighbours, so that nothing of a faster recording is lost, or interpolated where there
/// is none.
pub(crate) fn poses(recorded: &[Pose], samples: &[f64]) -> Vec<Pose> {
    let last = samples.len() - 1;
    let pose = |i: usize| {
        // The ends stay what they are.
        let reach = if i == 0 || i == last {
            0.0
        } else {
            0.5 * (samples[i] - samples[i - 1]).min(samples[i + 1] - samples[i])
        };
        let first = (samples[i] - reach).ceil() as usize;
        let end = ((samples[i] + reach).floor() as usize + 1).min(recorded.len());
        if first + 1 < end {
            mean_pose(&recorded[first..end])
        } else {
            between(recorded, samples[i])
        }
    };
    (0..samples.len()).map(pose).collect()
}

/// The pose at a sample with a fraction.
pub(crate) fn between(recorded: &[Pose], sample: f64) -> Pose {
    let last = recorded.len() - 1;
    let i = (sample.max(0.0) as usize).min(last);
    recorded[i].interpolate(&recorded[(i + 1).min(last)], (sample - i as f64).clamp(0.0, 1.0))
}
