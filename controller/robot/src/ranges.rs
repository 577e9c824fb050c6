//! Largest numbers of a description. Larger ones are typing errors, or made to overflow: far beyond any arm,
//! and products of several stay finite.

use crate::error::UrdfErrorKind as Kind;

/// Largest mass of a link [kg].
pub(crate) const MASS_MAX_KG: f64 = 1e5;
/// Largest entry of a link's rotational inertia [kg m²].
pub(crate) const INERTIA_MAX_KG_M2: f64 = 1e7;
/// Largest coordinate and dimension [m].
pub(crate) const LENGTH_MAX_M: f64 = 1e3;
/// Largest angle of an origin [rad]: the sine of a larger one has lost its digits.
pub(crate) const ANGLE_MAX_RAD: f64 = 1e6;
/// A larger speed limit is none: files write 1e30 for that [rad/s or m/s].
pub(crate) const SPEED_LIMIT_MAX: f64 = 1e6;
/// A larger torque or force limit is none [N m or N].
pub(crate) const EFFORT_LIMIT_MAX: f64 = 1e9;
/// Position limits farther away than this are none; files write 1e16 or 1e30 for that [rad or m].
pub(crate) const POSITION_LIMIT_MAX: f64 = 1e12;

/// Refuses what is not finite, or larger than `most`.
pub(crate) fn bounded(
    element: &'static str,
    name: &str,
    quantity: &'static str,
    numbers: &[f64],
    most: f64,
) -> Result<(), Kind> {
    // Not a number is not at most anything.
    let beyond = numbers.iter().find(|number| !number.is_finite() || number.abs() > most);
    beyond.map_or(Ok(()), |&found| {
        let name = name.to_owned();
        Err(if found.is_finite() {
            Kind::TooLarge { element, name, quantity, most, found }
        } else {
            Kind::NotFinite { element, name, quantity, found }
        })
    })
}
