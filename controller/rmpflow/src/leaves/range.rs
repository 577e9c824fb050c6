//! Ranges of parameters.

use core::fmt::Debug;

/// Receives each parameter that is outside its range: its key, what was expected, what was found.
pub type Report<'a> = dyn FnMut(&str, &'static str, &dyn Debug) + 'a;

/// No parameter in SI units is larger: products and squares of such stay finite.
const NUMBER_MAX: f64 = 1e9;

/// Reports what is not a number above zero, or larger than any parameter.
pub fn positive(key: &str, value: f64, report: &mut Report<'_>) {
    if !(value > 0.0 && value <= NUMBER_MAX) {
        report(key, "a finite number above zero, at most 1e9", &value);
    }
}

/// Reports what is not a number of at least zero, or larger than any parameter.
pub fn not_negative(key: &str, value: f64, report: &mut Report<'_>) {
    if !(0.0..=NUMBER_MAX).contains(&value) {
        report(key, "a finite number of at least zero, at most 1e9", &value);
    }
}

/// Reports what has no direction.
pub fn direction(key: &str, value: glam::DVec3, report: &mut Report<'_>) {
    if !(value.length() > 0.0 && value.length() <= NUMBER_MAX) {
        report(key, "three finite numbers, not all zero", &value.to_array());
    }
}
