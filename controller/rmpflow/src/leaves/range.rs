//! Ranges of parameters.

use core::fmt::Debug;

/// Receives each parameter that is outside its range: its key, what was expected, what was found.
pub type Report<'a> = dyn FnMut(&str, &'static str, &dyn Debug) + 'a;

/// Reports what is not a finite number above zero.
pub fn positive(key: &str, value: f64, report: &mut Report<'_>) {
    if !(value.is_finite() && value > 0.0) {
        report(key, "a finite number above zero", &value);
    }
}

/// Reports what is not a finite number of at least zero.
pub fn not_negative(key: &str, value: f64, report: &mut Report<'_>) {
    if !(value.is_finite() && value >= 0.0) {
        report(key, "a finite number of at least zero", &value);
    }
}

/// Reports what has no direction.
pub fn direction(key: &str, value: glam::DVec3, report: &mut Report<'_>) {
    if !(value.is_finite() && value.length() > 0.0 && value.length().is_finite()) {
        report(key, "three finite numbers, not all zero", &value.to_array());
    }
}
