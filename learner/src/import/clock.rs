//! Stamps of samples: seconds since the first, exact to the last digit of whole numbers.

use super::selection::TimeUnit;

/// Stamps from here on count from 1970 and not from the start: 2001, in seconds \[s\].
const EPOCH_MIN_S: f64 = 1e9;
/// Least stamps of other units since 1970 (1973); seconds are not so many.
const UNITS: [(f64, &str, &str); 3] =
    [(1e17, "ns", "nanoseconds"), (1e14, "us", "microseconds"), (1e11, "ms", "milliseconds")];

/// A time as it is written.
#[derive(Clone, Copy, Debug)]
pub(super) enum Stamp {
    /// A whole number: nanoseconds since 1970 have more digits than a float.
    Whole(i64),
    /// Another finite number.
    Float(f64),
}

impl Stamp {
    /// The stamp that a text says, if it is a finite number.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let whole = text.parse().ok().map(Self::Whole);
        let float = || text.parse().ok().filter(|x: &f64| x.is_finite()).map(Self::Float);
        whole.or_else(float)
    }

    /// The stamp of a number in a file of numbers.
    pub(super) fn of(number: f64) -> Self {
        Self::Float(number)
    }

    fn value(self) -> f64 {
        match self {
            Self::Whole(stamp) => stamp as f64,
            Self::Float(stamp) => stamp,
        }
    }
}

/// Turns stamps into seconds since the first.
#[derive(Debug)]
pub(super) struct Clock {
    unit: TimeUnit,
    /// Whether somebody said the unit on the command line.
    is_certain: bool,
    first: Option<Stamp>,
}

impl Clock {
    /// `by_name` is the unit that the column's name says, `chosen` the one on the command line.
    pub(super) fn new(by_name: TimeUnit, chosen: Option<TimeUnit>) -> Self {
        Self { unit: chosen.unwrap_or(by_name), is_certain: chosen.is_some(), first: None }
    }

    /// Seconds since the first stamp \[s\], or what is wrong with the first.
    pub(super) fn seconds(&mut self, stamp: Stamp) -> Result<f64, String> {
        let first = match self.first {
            Some(first) => first,
            None => {
                self.check(stamp)?;
                *self.first.insert(stamp)
            }
        };
        let since = match (stamp, first) {
            (Stamp::Whole(now), Stamp::Whole(first)) => {
                (i128::from(now) - i128::from(first)) as f64
            }
            _ => stamp.value() - first.value(),
        };
        Ok(since * self.unit.seconds())
    }

    /// Refuses seconds that are none.
    fn check(&self, first: Stamp) -> Result<(), String> {
        let is_free = self.unit != TimeUnit::S || self.is_certain;
        let found = UNITS.iter().find(|(least, ..)| first.value().abs() >= *least);
        match found.filter(|_| !is_free) {
            None => Ok(()),
            Some((_, unit, name)) => Err(format!(
                "expected seconds, found {} like {name} since 1970: name the column `time_{unit}`, or give \
                 --time-unit {unit}",
                first.value()
            )),
        }
    }

    /// What is to be said of stamps that count from 1970.
    pub(super) fn note(&self) -> Option<String> {
        let first_s = self.first?.value() * self.unit.seconds();
        (first_s >= EPOCH_MIN_S).then(|| format!("times since 1970, from {first_s:.3} s"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nanoseconds_since_1970_are_exact() {
        let mut clock = Clock::new(TimeUnit::Ns, None);
        for (text, expected_s) in [
            ("1717171717000000001", 0.0),
            ("1717171717020000001", 0.02),
            ("1717171717020000002", 0.020000001),
        ] {
            let found_s = clock.seconds(Stamp::parse(text).unwrap()).unwrap();
            assert!((found_s - expected_s).abs() < 1e-15, "{text}: {found_s}");
        }
        assert_eq!(clock.note().unwrap(), "times since 1970, from 1717171717.000 s");
    }

    #[test]
    fn seconds_that_are_none_are_refused_with_their_unit() {
        for (text, unit) in
            [("1717171717000000000", "ns"), ("1717171717000000.5", "us"), ("1717171717000", "ms")]
        {
            let stamp = Stamp::parse(text).unwrap();
            let message = Clock::new(TimeUnit::S, None).seconds(stamp).unwrap_err();
            assert!(message.contains(&format!("--time-unit {unit}")), "{message}");
            assert!(Clock::new(TimeUnit::S, Some(TimeUnit::S)).seconds(stamp).is_ok());
        }
        let mut seconds = Clock::new(TimeUnit::S, None);
        assert_eq!(seconds.seconds(Stamp::parse("1717171717.5").unwrap()), Ok(0.0));
        assert_eq!(seconds.seconds(Stamp::parse("1717171718").unwrap()), Ok(0.5));
        assert!(Stamp::parse("inf").is_none() && Stamp::parse("x").is_none());
        assert!(Stamp::parse("").is_none());
    }
}
