//! What the gripper does among the samples of a motion.

use super::rest::Sample;
use crate::demonstration::{Grip, Gripper};

/// So much is kept after the gripper's last change, in sampling times: a sample that tells of it.
const AFTER_CHANGE: f64 = 1.5;

/// The end of the samples that are kept, at least `end`: the gripper often closes when the tool rests
/// already, and that is part of the motion.
pub(super) fn end(samples: &[Sample], end: usize, sampling_time_s: f64) -> usize {
    let known = samples.iter().enumerate().filter_map(|(i, s)| Some((i, s.grip?)));
    let mut changed = None;
    let mut before = None;
    for (i, grip) in known {
        if before.is_some_and(|before| before != grip) {
            changed = Some(i);
        }
        before = Some(grip);
    }
    let Some(changed) = changed else { return end };
    let kept_ns = samples[changed].time_ns + (AFTER_CHANGE * sampling_time_s * 1e9) as u64;
    end.max(samples.partition_point(|s| s.time_ns <= kept_ns))
}

/// The gripper at places between samples, that of the nearest sample; `None` where it was never known. Where it
/// was not known in between it stays what it was before, and that is to be said.
pub(super) fn at(samples: &[Sample], places: &[(usize, f64)]) -> (Option<Gripper>, Option<String>) {
    let Some(first) = samples.iter().find_map(|s| s.grip) else { return (None, None) };
    let unknown = samples.iter().filter(|s| s.grip.is_none()).count();
    let mut newest = first;
    let mut known: Vec<Grip> = Vec::with_capacity(samples.len());
    for sample in samples {
        newest = sample.grip.unwrap_or(newest);
        known.push(newest);
    }
    let last = known.len() - 1;
    let nearest =
        |(i, fraction): &(usize, f64)| known[(i + usize::from(*fraction > 0.5)).min(last)];
    let note = (unknown > 0).then(|| {
        format!(
            "the gripper was not known in {unknown} of {} states; it was taken to stay as it was",
            samples.len()
        )
    });
    (Some(Gripper::Grips(places.iter().map(nearest).collect())), note)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tprmp_spatial::Pose;

    /// Samples at 100 Hz; `-` is not known, `o` open, `c` closed.
    fn samples(text: &str) -> Vec<Sample> {
        let sample = |(i, c): (usize, char)| Sample {
            time_ns: i as u64 * 10_000_000,
            pose: Pose::IDENTITY,
            grip: match c {
                'o' => Some(Grip::Open),
                'c' => Some(Grip::Closed),
                _ => None,
            },
        };
        text.chars().enumerate().map(sample).collect()
    }

    #[test]
    fn what_is_kept_reaches_to_the_last_change() {
        assert_eq!(end(&samples("oooooooooo"), 4, 0.01), 4);
        assert_eq!(end(&samples("----------"), 4, 0.01), 4);
        assert_eq!(end(&samples("ooooooocccc"), 4, 0.01), 9);
        assert_eq!(end(&samples("oooooo-cccc"), 4, 0.02), 11);
        assert_eq!(end(&samples("occccccccc"), 8, 0.01), 8);
    }

    #[test]
    fn the_nearest_sample_tells_and_what_is_not_known_stays() {
        let places: Vec<(usize, f64)> = (0..9).map(|i| (i, 0.4)).chain([(8, 1.0)]).collect();
        assert_eq!(at(&samples("----------"), &places), (None, None));
        let (gripper, note) = at(&samples("--oo-ccccc"), &places);
        let expected = "oooooccccc".chars();
        let expected = expected.map(|c| if c == 'o' { Grip::Open } else { Grip::Closed });
        assert_eq!(gripper, Some(Gripper::Grips(expected.collect())));
        assert!(note.unwrap().contains("not known in 3 of 10 states"));
        let (_, none) = at(&samples("oooooooooc"), &places);
        assert_eq!(none, None);
    }
}
