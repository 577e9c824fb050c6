//! Holes in time: samples that a recorder lost.

use std::fmt;
use std::path::Path;

use tprmp_spatial::Pose;

/// Samples so many times as far apart as usual have a hole between them.
const RATIO: f64 = 4.0;

/// The longest time without a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hole {
    /// The sample before it.
    sample: usize,
    /// When that is \[s\].
    from_s: f64,
    /// How long it takes to the next \[s\].
    size_s: f64,
    /// How far the tool is then \[m\].
    distance_m: f64,
}

impl fmt::Display for Hole {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { sample, from_s, size_s, distance_m } = self;
        write!(
            f,
            "no samples for {size_s:.3} s after sample {sample} at {from_s:.3} s, while the tool moved by \
             {distance_m:.3} m"
        )
    }
}

/// All holes of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Holes {
    count: usize,
    pub(super) worst: Option<Hole>,
}

impl Holes {
    /// Finds the holes; the times [s] grow.
    pub(super) fn find(times_s: &[f64], poses: &[Pose]) -> Self {
        let steps_s: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let mut sorted_s = steps_s.clone();
        sorted_s.sort_by(f64::total_cmp);
        let usual_s = sorted_s.get(sorted_s.len() / 2).copied().unwrap_or(0.0);
        let holes = steps_s.iter().enumerate().filter(|(_, step_s)| **step_s > RATIO * usual_s);
        let count = holes.clone().count();
        let worst = holes.max_by(|a, b| a.1.total_cmp(b.1)).map(|(i, size_s)| Hole {
            sample: i,
            from_s: times_s[i],
            size_s: *size_s,
            distance_m: poses[i].position.distance(poses[i + 1].position),
        });
        Self { count, worst }
    }

    /// What is said of them.
    pub(super) fn warning(&self, path: &Path) -> Option<String> {
        let worst = self.worst?;
        let others = match self.count {
            1 => String::new(),
            count => format!(" (and {} more such holes)", count - 1),
        };
        let file = path.display();
        Some(format!(
            "`{file}`: {worst}{others}; the path there is made up, record it again if it matters"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn the_longest_hole_is_found_and_the_others_counted() {
        let mut times_s: Vec<f64> = (0..50).map(|i| 0.02 * f64::from(i)).collect();
        let at = |t: &f64| Pose { position: DVec3::X * *t, ..Pose::IDENTITY };
        let poses = |times_s: &[f64]| times_s.iter().map(at).collect::<Vec<_>>();
        assert_eq!(Holes::find(&times_s, &poses(&times_s)), Holes { count: 0, worst: None });
        times_s[20..].iter_mut().for_each(|t| *t += 0.58);
        times_s[40..].iter_mut().for_each(|t| *t += 0.08);
        // A late sample is none.
        times_s[30] += 0.015;
        let found = Holes::find(&times_s, &poses(&times_s));
        assert_eq!(found.count, 2);
        let text = found.warning(Path::new("a.csv")).unwrap();
        for part in ["`a.csv`", "0.600 s after sample 19 at 0.380 s", "by 0.600 m", "1 more"] {
            assert!(text.contains(part), "{text}");
        }
        assert_eq!(Holes::find(&[], &[]).worst, None);
    }
}
