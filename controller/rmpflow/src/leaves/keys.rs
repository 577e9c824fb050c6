//! Parameters in files, where a field is not written as it is stored.

use glam::DVec3;
use serde::{Deserialize, Deserializer};

use crate::leaves::barrier::Barrier;

/// The keys of a barrier on a length.
#[derive(Deserialize)]
#[serde(remote = "Barrier", deny_unknown_fields)]
struct OnLength {
    #[serde(rename = "activation_distance_m")]
    activation_distance: f64,
    #[serde(rename = "clearance_min_m")]
    distance_min: f64,
    #[serde(rename = "inertia_kg")]
    inertia: f64,
    rest_fraction: f64,
    #[serde(rename = "approach_speed_m_s")]
    approach_speed: f64,
    #[serde(rename = "repulsion_m2_s2")]
    repulsion: f64,
    damping_1_s: f64,
}

impl Barrier {
    /// A barrier on a length, whose keys carry their units.
    ///
    /// # Errors
    /// Those of the deserializer.
    pub fn on_length<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        OnLength::deserialize(deserializer)
    }
}

pub(crate) fn vector<'de, D: Deserializer<'de>>(deserializer: D) -> Result<DVec3, D::Error> {
    <[f64; 3]>::deserialize(deserializer).map(DVec3::from)
}

/// Of length 1, unless it has no direction.
pub(crate) fn unit_vector<'de, D: Deserializer<'de>>(deserializer: D) -> Result<DVec3, D::Error> {
    vector(deserializer).map(|v| v.try_normalize().unwrap_or(v))
}
