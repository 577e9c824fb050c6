//! What the gripper does in a demonstration: a channel beside the poses, one entry a sample.

use std::path::Path;

use crate::file_error::FileError;

/// Wider grippers are refused \[m\]: what opens farther is said in millimetres.
pub const WIDTH_MAX_M: f64 = 1.0;

/// Whether a gripper is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grip {
    /// It is open, or its vacuum is off.
    Open,
    /// It is closed, or holds something.
    Closed,
}

impl Grip {
    /// As it stands in files.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Closed => "closed",
        }
    }

    /// By its word.
    #[must_use]
    pub fn of_word(word: &str) -> Option<Self> {
        [Self::Open, Self::Closed].into_iter().find(|grip| grip.word() == word)
    }
}

/// What a gripper does, one entry a sample.
#[derive(Clone, Debug, PartialEq)]
pub enum Gripper {
    /// Whether it is open.
    Grips(Vec<Grip>),
    /// How wide it is open \[m\].
    Widths(Vec<f64>),
}

impl Gripper {
    /// Number of samples.
    #[must_use]
    pub fn count(&self) -> usize {
        match self {
            Self::Grips(grips) => grips.len(),
            Self::Widths(widths_m) => widths_m.len(),
        }
    }

    /// At samples with fractions: what it is at the nearest one, or a width on a straight line.
    #[must_use]
    pub fn at(&self, samples: &[f64]) -> Self {
        let last = self.count() - 1;
        let within = |sample: f64| sample.clamp(0.0, last as f64);
        match self {
            Self::Grips(grips) => {
                Self::Grips(samples.iter().map(|s| grips[within(*s).round() as usize]).collect())
            }
            Self::Widths(widths_m) => {
                let width_m = |sample: &f64| {
                    let sample = within(*sample);
                    let i = sample as usize;
                    let (a, b) = (widths_m[i], widths_m[(i + 1).min(last)]);
                    a + (sample - i as f64) * (b - a)
                };
                Self::Widths(samples.iter().map(width_m).collect())
            }
        }
    }

    /// As [`Self::at`], but first what it was at first, and last what it was at last: what it did
    /// while the tool rested stays.
    #[must_use]
    pub fn between_ends(&self, samples: &[f64]) -> Self {
        let mut places = samples.to_vec();
        if let [first, .., last] = &mut places[..] {
            (*first, *last) = (0.0, (self.count() - 1) as f64);
        }
        self.at(&places)
    }

    /// The channel of a file with so many samples, which may hold one of both keys.
    ///
    /// # Errors
    /// [`FileError`], naming file and key: both are there, there are not as many entries as samples, a word
    /// that is not known, a width that is negative, not finite or too large.
    pub(super) fn of_file(
        words: Option<Vec<Option<String>>>,
        widths_m: Option<Vec<Option<f64>>>,
        count: usize,
        path: &Path,
    ) -> Result<Option<Self>, FileError> {
        let check = |key: &str, found: usize| {
            if found == count {
                return Ok(());
            }
            let problem = format!("expected {count} entries, one a sample, found {found}");
            Err(FileError::key(path, key, problem))
        };
        match (words, widths_m) {
            (None, None) => Ok(None),
            (Some(_), Some(_)) => {
                let problem = "expected this key or `gripper_width_m`, found both";
                Err(FileError::key(path, "gripper", problem))
            }
            (Some(words), None) => {
                check("gripper", words.len())?;
                let grip = |(i, word): (usize, &Option<String>)| {
                    let word = word.as_deref().unwrap_or("null");
                    Grip::of_word(word).ok_or_else(|| {
                        let found = tprmp_files::shortened(word);
                        let problem = format!("expected \"open\" or \"closed\", found \"{found}\"");
                        FileError::key(path, format!("gripper[{i}]"), problem)
                    })
                };
                let grips = words.iter().enumerate().map(grip).collect::<Result<_, _>>()?;
                Ok(Some(Self::Grips(grips)))
            }
            (None, Some(widths_m)) => {
                check("gripper_width_m", widths_m.len())?;
                let width_m = |(i, width_m): (usize, &Option<f64>)| {
                    check_width(*width_m).map_err(|problem| {
                        FileError::key(path, format!("gripper_width_m[{i}]"), problem)
                    })
                };
                let widths_m =
                    widths_m.iter().enumerate().map(width_m).collect::<Result<_, _>>()?;
                Ok(Some(Self::Widths(widths_m)))
            }
        }
    }

    /// Its line in a file.
    pub(super) fn line(&self) -> String {
        match self {
            Self::Grips(grips) => {
                let words: Vec<_> = grips.iter().map(|g| format!("\"{}\"", g.word())).collect();
                format!("\"gripper\": [{}],\n", words.join(", "))
            }
            Self::Widths(widths_m) => {
                let numbers: Vec<_> = widths_m.iter().map(|w| format!("{w:.6}")).collect();
                format!("\"gripper_width_m\": [{}],\n", numbers.join(", "))
            }
        }
    }
}

/// A width \[m\] that a gripper can have.
pub(crate) fn check_width(width_m: Option<f64>) -> Result<f64, String> {
    let Some(width_m) = width_m.filter(|width_m| width_m.is_finite()) else {
        return Err("expected a finite number, found none (null, NaN or infinity)".into());
    };
    if (0.0..=WIDTH_MAX_M).contains(&width_m) {
        return Ok(width_m);
    }
    let hint = if width_m > 0.0 { ": are these millimetres?" } else { "" };
    Err(format!("expected a width from 0 to {WIDTH_MAX_M} m, found {width_m}{hint}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_samples_the_nearest_word_and_a_straight_line_of_widths_are_taken() {
        let grips = Gripper::Grips(vec![Grip::Open, Grip::Open, Grip::Closed]);
        let samples = [-1.0, 0.4, 1.4, 1.6, 9.0];
        let found = [Grip::Open, Grip::Open, Grip::Open, Grip::Closed, Grip::Closed];
        assert_eq!(grips.at(&samples), Gripper::Grips(found.to_vec()));
        let widths = Gripper::Widths(vec![0.08, 0.04, 0.0]);
        let Gripper::Widths(found) = widths.at(&samples) else { panic!("widths stay widths") };
        for (found, expected) in found.iter().zip([0.08, 0.064, 0.024, 0.016, 0.0]) {
            assert!((found - expected).abs() < 1e-12, "{found}");
        }
    }

    #[test]
    fn the_ends_are_those_of_the_recording() {
        let grips = Gripper::Grips(vec![Grip::Closed, Grip::Open, Grip::Open, Grip::Closed]);
        let found = vec![Grip::Closed, Grip::Open, Grip::Closed];
        assert_eq!(grips.between_ends(&[1.0, 1.5, 2.0]), Gripper::Grips(found));
    }
}
