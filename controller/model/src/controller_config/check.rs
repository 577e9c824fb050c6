//! Ranges of values.

use std::fmt::Debug;

use tprmp_rmpflow::leaves::range::{self, Report};

use crate::controller_config::error::Problem;

/// Collects the values that are outside their ranges.
#[derive(Debug, Default)]
pub(super) struct Check {
    group: String,
    /// Keys, from the outermost, and what is wrong with their values.
    pub(super) found: Vec<(String, Problem)>,
}

impl Check {
    /// Checks what stands under a key.
    pub(super) fn within(&mut self, key: &str, check: impl FnOnce(&mut Self)) {
        let outside = self.group.len();
        self.group += key;
        self.group += ".";
        check(self);
        self.group.truncate(outside);
    }

    pub(super) fn fail(&mut self, key: &str, expected: &'static str, found: &dyn Debug) {
        let problem = Problem::Value { expected, found: format!("{found:?}") };
        self.found.push((format!("{}{key}", self.group), problem));
    }

    pub(super) fn require(
        &mut self,
        holds: bool,
        key: &str,
        expected: &'static str,
        found: &dyn Debug,
    ) {
        if !holds {
            self.fail(key, expected, found);
        }
    }

    /// Checks a leaf that stands under a key.
    pub(super) fn leaf(&mut self, key: &str, check: impl FnOnce(&mut Report<'_>)) {
        self.within(key, |within| {
            check(&mut |key, expected, found| within.fail(key, expected, found));
        });
    }

    pub(super) fn positive(&mut self, key: &str, value: f64) {
        range::positive(key, value, &mut |key, expected, found| self.fail(key, expected, found));
    }

    pub(super) fn not_negative(&mut self, key: &str, value: f64) {
        range::not_negative(key, value, &mut |key, expected, found| {
            self.fail(key, expected, found);
        });
    }

    pub(super) fn fraction(&mut self, key: &str, value: f64) {
        let holds = value > 0.0 && value <= 1.0;
        self.require(holds, key, "a fraction above 0 and at most 1", &value);
    }

    pub(super) fn time(&mut self, key: &str, value: u64) {
        let holds = (1_000..=10_000_000_000).contains(&value);
        self.require(holds, key, "1000 to 10000000000 nanoseconds", &value);
    }
}
