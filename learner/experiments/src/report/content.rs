//! What the report is made from.

use std::time::Duration;

use crate::bench::Bench;
use crate::case::Case;
use crate::people;
use crate::results::Row;
use crate::verdict::Verdict;

/// All that a run gave.
pub(crate) struct Run<'a> {
    pub(crate) bench: &'a Bench<'a>,
    pub(crate) cases: &'a [Case],
    /// What they gave, then stability and times.
    pub(crate) rows: &'a [Row],
    /// Times of control iterations.
    pub(crate) timed: &'a [(Row, Vec<f64>)],
    pub(crate) verdicts: &'a [Verdict],
    /// What was learned from hand-like recordings.
    pub(crate) people: &'a [people::table::Row],
    pub(crate) trained: Duration,
    pub(crate) elapsed: Duration,
}
