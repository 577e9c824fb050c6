//! How a periodic skill goes round: its rounds, how long they take, and how far beside its path the tool is.

/// A complete round.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Round {
    /// How long it took \[s\].
    pub period_s: f64,
    /// Largest distance of the tool from where it should have been \[m\].
    pub beside_max_m: f64,
}

/// What came of the rounds so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RoundsReport {
    /// Complete ones, from where a round begins to where the next one does.
    pub done: u64,
    /// The last complete one.
    pub last: Option<Round>,
}

/// Counts rounds.
#[derive(Debug, Default)]
pub struct RoundCounter {
    report: Option<RoundsReport>,
    /// Rounds at the last tick.
    rounds: Option<f64>,
    /// The round under way; `None` before one has begun at its beginning.
    current: Option<Round>,
}

impl RoundCounter {
    /// Counts a tick. No allocation.
    ///
    /// * `rounds`  of the skill, its phase with them; `None` when it goes to a goal
    /// * `beside_m`  distance of the tool from where it should be \[m\]
    /// * `dt`  \[s\]
    pub fn update(&mut self, rounds: Option<f64>, beside_m: f64, dt: f64) {
        let before = core::mem::replace(&mut self.rounds, rounds);
        let Some(rounds) = rounds else { return };
        let report = self.report.get_or_insert_default();
        if let Some(current) = &mut self.current {
            current.period_s += dt;
            current.beside_max_m = current.beside_max_m.max(beside_m);
        }
        let Some(before) = before else { return };
        // Where it goes on after an interruption, its rounds are counted anew.
        if (rounds - before).abs() > 0.5 {
            self.current = None;
        } else if rounds.floor() > before.floor() {
            let begins = Round { period_s: 0.0, beside_max_m: beside_m };
            if let Some(round) = self.current.replace(begins) {
                (report.done, report.last) = (report.done + 1, Some(round));
            }
        }
    }

    /// What came of the rounds so far; `None` for a skill that goes to a goal.
    #[must_use]
    pub fn report(&self) -> Option<RoundsReport> {
        self.report
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_complete_rounds_count_and_an_interrupted_one_does_not() {
        let mut counter = RoundCounter::default();
        counter.update(None, 0.1, 0.01);
        assert_eq!(counter.report(), None);
        let mut go = |from: f64, to: f64| {
            let steps = ((to - from) * 200.0).round() as u32;
            for i in 0..=steps {
                let rounds = from + f64::from(i) / 200.0;
                counter.update(Some(rounds + 1e-9), 0.001 * rounds, 0.01);
            }
            counter.report().unwrap()
        };
        assert_eq!(go(0.3, 1.5), RoundsReport::default());
        let RoundsReport { done, last } = go(1.505, 3.5);
        let last = last.unwrap();
        assert_eq!(done, 2);
        assert!((last.period_s - 2.0).abs() < 1e-9 && (last.beside_max_m - 0.003).abs() < 1e-9);
        assert_eq!(go(0.2, 1.9).done, 2);
        assert_eq!(go(1.905, 2.1).done, 3);
    }
}
