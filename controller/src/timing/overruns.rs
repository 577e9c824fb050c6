//! What happens when the loop is late. A late tick is counted, the periods it skipped too, and
//! never caught up with in a burst. After so many missed periods in a row, the arm is brought to
//! rest; it goes on when it rests and as many ticks in a row were in time.

/// Counts missed periods in a row.
#[derive(Debug)]
pub struct Overruns {
    in_a_row_max: u32,
    in_a_row: u32,
    in_time: u32,
    stopped: bool,
}

impl Overruns {
    /// `in_a_row_max` missed periods in a row stop the arm.
    #[must_use]
    pub fn new(in_a_row_max: u32) -> Self {
        Self { in_a_row_max, in_a_row: 0, in_time: 0, stopped: false }
    }

    /// A tick begins after `skipped` periods without one.
    pub fn begin(&mut self, skipped: u64) {
        let skipped = u32::try_from(skipped).unwrap_or(u32::MAX);
        self.miss(skipped);
    }

    /// A tick ends, in time or not, with the arm at rest or not.
    pub fn end(&mut self, missed: bool, at_rest: bool) {
        if missed {
            self.miss(1);
        } else {
            self.in_a_row = 0;
            self.in_time = self.in_time.saturating_add(1);
            if at_rest && self.in_time >= self.in_a_row_max {
                self.stopped = false;
            }
        }
    }

    fn miss(&mut self, periods: u32) {
        if periods > 0 {
            self.in_time = 0;
        }
        self.in_a_row = self.in_a_row.saturating_add(periods);
        self.stopped |= self.in_a_row >= self.in_a_row_max;
    }

    /// Whether the arm has to be at rest.
    #[must_use]
    pub fn stop(&self) -> bool {
        self.stopped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn so_many_late_ticks_in_a_row_stop_and_fewer_do_not() {
        let mut overruns = Overruns::new(3);
        for _ in 0..10 {
            overruns.end(true, false);
            overruns.end(true, false);
            assert!(!overruns.stop());
            overruns.end(false, false);
        }
        for _ in 0..3 {
            overruns.end(true, false);
        }
        assert!(overruns.stop());
    }

    #[test]
    fn a_long_gap_counts_each_period_that_it_skipped() {
        let mut overruns = Overruns::new(50);
        overruns.begin(49);
        assert!(!overruns.stop());
        overruns.end(true, false);
        assert!(overruns.stop());
        let mut overruns = Overruns::new(50);
        overruns.begin(u64::MAX);
        assert!(overruns.stop());
    }

    #[test]
    fn it_goes_on_at_rest_once_as_many_ticks_were_in_time() {
        let mut overruns = Overruns::new(3);
        overruns.begin(3);
        for _ in 0..100 {
            overruns.end(false, false);
            assert!(overruns.stop(), "the arm still moves");
        }
        overruns.end(true, true);
        for _ in 0..2 {
            overruns.end(false, true);
            assert!(overruns.stop(), "not yet in time for long enough");
        }
        overruns.end(false, true);
        assert!(!overruns.stop());
    }
}
