//! Skill files: what to learn, and every number the learning depends on.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tprmp_model::skill_model::Manifold;
use tprmp_rmpflow::field::COMPONENT_CAPACITY;

use crate::error::{LearnerError, read_text};

/// Schema version this module reads.
pub const SCHEMA: &str = "tprmp-skill/1";

/// A skill to be learned. There are no defaults: what is missing is an error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Skill {
    /// Schema version.
    pub schema: String,
    /// Name of the skill, as in its demonstrations.
    pub skill: String,
    /// Space in which it moves.
    pub manifold: Manifold,
    /// Frame of the robot that moves.
    pub tool_frame: String,
    /// Frame at which the skill starts.
    pub start_frame: String,
    /// Frame to which the goal is fixed.
    pub goal_frame: String,
    /// Folder of demonstrations, relative to the skill file.
    pub demonstrations: PathBuf,
    /// Smoothing of the demonstrations.
    pub smoothing: Smoothing,
    /// Lengths in which the field is fitted.
    pub scale: Scale,
    /// Gaussian mixture.
    pub mixture: Mixture,
    /// Field of each block.
    pub field: FieldSettings,
    /// Rollouts after the fit.
    pub verification: Verification,
}

/// Savitzky–Golay smoothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Smoothing {
    /// Length of the window [s].
    pub window_s: f64,
    /// Degree of the polynomial.
    pub degree: usize,
    /// Share of the largest speed below which the start and the end count as rest, and are cut.
    pub rest_speed_share: f64,
}

/// Each block is fitted in coordinates ŷ = s y in which the demonstrations have a given span
/// (diagonal of their bounding box), because all lengths of [`FieldSettings`] refer to it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scale {
    /// Span of the demonstrations in ŷ.
    pub span: f64,
    /// A smaller span of the positions is taken as this [m].
    pub position_span_min_m: f64,
    /// A smaller span of the orientations is taken as this [rad].
    pub orientation_span_min_rad: f64,
}

/// Expectation maximisation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mixture {
    /// Gaussians K, without the goal's component.
    pub components: usize,
    /// Where the iterations start.
    pub initialisation: Initialisation,
    /// Iterations.
    pub iterations: u32,
    /// Added to the covariances' diagonal in each iteration [ŷ²].
    pub regularisation: f64,
}

/// Where expectation maximisation starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Initialisation {
    /// Each path is cut into K pieces of equal arc length.
    ArcLength,
    /// Clusters of (phase, coordinates) by k-means, from seeded centres.
    KMeans,
}

/// Field of a block. Lengths are in ŷ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldSettings {
    /// Damping d in B = d M [1/s].
    pub damping_1_s: f64,
    /// σ₀: Λ_k = (C_k + σ₀² I)⁻¹ [ŷ].
    pub activation_width: f64,
    /// σ_G: Λ_G = I/σ_G² [ŷ].
    pub goal_width: f64,
    /// q₀: the background has the density exp(−q₀²/2) [standard deviations].
    pub background_distance: f64,
    /// γ: M_k = γ Λ_k.
    pub metric_scale: f64,
    /// Rounding a of the background's cone [ŷ].
    pub softening: f64,
    /// Least slope k₀ of the background, in units of m̄ d [ŷ/s].
    pub background_slope_min: f64,
    /// Offsets of the tube points from the demonstrations [ŷ].
    pub tube_offsets: Vec<f64>,
    /// Every how many samples there are tube points.
    pub tube_stride: usize,
    /// Weight of all tube points together.
    pub tube_weight: f64,
    /// Speed towards the demonstration per offset [1/s].
    pub tube_attraction_1_s: f64,
    /// Slower samples show no direction [ŷ/s].
    pub tube_speed_min: f64,
    /// ρ: weight of the demanded descent.
    pub descent_weight: f64,
    /// ε: speed of descent demanded along the demonstrations [ŷ/s].
    pub descent_speed: f64,
    /// Distance to the goal below which the demanded speed falls [ŷ].
    pub descent_slowdown: f64,
    /// Distance over which the demanded direction bends towards the demonstration [ŷ].
    pub descent_attraction: f64,
    /// Distance within which the demanded direction is the goal's [ŷ].
    pub descent_goal_radius: f64,
    /// Every how many samples descent is demanded.
    pub descent_stride: usize,
    /// Points per axis of the grid on which descent is demanded, plane.
    pub grid_points_per_axis: usize,
    /// Seeded random points in place of the grid, space.
    pub grid_points_random: usize,
    /// Margin of the grid around the demonstrations [ŷ].
    pub grid_margin: f64,
    /// Radii of rings around the goal on which descent is demanded, plane [ŷ].
    pub goal_rings: Vec<f64>,
    /// Points per ring.
    pub goal_ring_points: usize,
    /// Least Hessian at the goal, relative to the metric [1/s²].
    pub goal_hessian_min_1_s2: f64,
    /// λ: weight of ‖C p‖².
    pub regularisation: f64,
    /// Length at which the parameters are compared by C [ŷ].
    pub regularisation_length: f64,
}

/// Rollouts after the fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verification {
    /// Longest rollout [s].
    pub horizon_s: f64,
    /// Random starts.
    pub random_starts: u32,
    /// Radius around the demonstrated points in which they lie [ŷ].
    pub random_start_radius: f64,
    /// A rollout reached the goal when it ends this near [m].
    pub goal_tolerance_m: f64,
    /// … and this near [rad].
    pub goal_tolerance_rad: f64,
}

impl Skill {
    /// Reads and validates a skill file.
    ///
    /// # Errors
    /// [`LearnerError`], naming the file and the key or line: missing, not RON, an unknown or
    /// missing key, or a value outside its range.
    pub fn read(path: &Path) -> Result<Self, LearnerError> {
        let text = read_text(path)?;
        let skill: Self = ron::from_str(&text).map_err(|e| {
            LearnerError::syntax(path, e.span.start.line, e.span.start.col, e.code.to_string())
        })?;
        skill
            .validate()
            .map_err(|(key, problem)| LearnerError::key(path, key, problem))
            .map(|()| skill)
    }

    /// The same skill with another number of Gaussians.
    ///
    /// # Errors
    /// What was expected, when the number is outside the range of `mixture.components`.
    pub fn with_components(mut self, components: usize) -> Result<Self, String> {
        self.mixture.components = components;
        self.validate_counts().map_err(|(_, problem)| problem).map(|()| self)
    }

    /// Every value as `section.key` and text, in order of the keys.
    #[must_use]
    pub fn values(&self) -> Vec<(String, String)> {
        let value = serde_json::to_value(self).expect("plain numbers and strings serialise");
        let mut values = Vec::new();
        flatten("", &value, &mut values);
        values
    }

    fn validate(&self) -> Result<(), (&'static str, String)> {
        if self.schema != SCHEMA {
            return Err(("schema", format!("expected `{SCHEMA}`, found `{}`", self.schema)));
        }
        for (key, name) in [
            ("skill", &self.skill),
            ("tool_frame", &self.tool_frame),
            ("start_frame", &self.start_frame),
            ("goal_frame", &self.goal_frame),
        ] {
            if name.is_empty() {
                return Err((key, "expected a name, found an empty one".into()));
            }
        }
        if self.start_frame == self.goal_frame {
            let problem = format!("expected another frame than the start's, `{}`", self.goal_frame);
            return Err(("goal_frame", problem));
        }
        self.validate_positive()?;
        self.validate_counts()
    }

    fn validate_positive(&self) -> Result<(), (&'static str, String)> {
        let (f, v) = (&self.field, &self.verification);
        let mut positive = vec![
            ("smoothing.window_s", self.smoothing.window_s),
            ("smoothing.rest_speed_share", self.smoothing.rest_speed_share),
            ("scale.span", self.scale.span),
            ("scale.position_span_min_m", self.scale.position_span_min_m),
            ("scale.orientation_span_min_rad", self.scale.orientation_span_min_rad),
            ("mixture.regularisation", self.mixture.regularisation),
            ("field.damping_1_s", f.damping_1_s),
            ("field.activation_width", f.activation_width),
            ("field.goal_width", f.goal_width),
            ("field.background_distance", f.background_distance),
            ("field.metric_scale", f.metric_scale),
            ("field.softening", f.softening),
            ("field.background_slope_min", f.background_slope_min),
            ("field.tube_weight", f.tube_weight),
            ("field.tube_attraction_1_s", f.tube_attraction_1_s),
            ("field.tube_speed_min", f.tube_speed_min),
            ("field.descent_weight", f.descent_weight),
            ("field.descent_speed", f.descent_speed),
            ("field.descent_slowdown", f.descent_slowdown),
            ("field.descent_attraction", f.descent_attraction),
            ("field.descent_goal_radius", f.descent_goal_radius),
            ("field.grid_margin", f.grid_margin),
            ("field.goal_hessian_min_1_s2", f.goal_hessian_min_1_s2),
            ("field.regularisation", f.regularisation),
            ("field.regularisation_length", f.regularisation_length),
            ("verification.horizon_s", v.horizon_s),
            ("verification.random_start_radius", v.random_start_radius),
            ("verification.goal_tolerance_m", v.goal_tolerance_m),
            ("verification.goal_tolerance_rad", v.goal_tolerance_rad),
        ];
        if self.smoothing.rest_speed_share >= 0.5 {
            let problem =
                format!("expected a share below 0.5, found {}", self.smoothing.rest_speed_share);
            return Err(("smoothing.rest_speed_share", problem));
        }
        positive.extend(f.tube_offsets.iter().map(|x| ("field.tube_offsets", *x)));
        positive.extend(f.goal_rings.iter().map(|x| ("field.goal_rings", *x)));
        match positive.iter().find(|(_, x)| !(x.is_finite() && *x > 0.0)) {
            None => Ok(()),
            Some((key, x)) => Err((key, format!("expected a positive number, found {x}"))),
        }
    }

    fn validate_counts(&self) -> Result<(), (&'static str, String)> {
        let f = &self.field;
        for (key, count, least, most) in [
            ("smoothing.degree", self.smoothing.degree, 2, 5),
            ("mixture.components", self.mixture.components, 1, COMPONENT_CAPACITY - 1),
            ("mixture.iterations", self.mixture.iterations as usize, 1, 1000),
            ("field.tube_stride", f.tube_stride, 1, 1000),
            ("field.descent_stride", f.descent_stride, 1, 1000),
            ("field.grid_points_per_axis", f.grid_points_per_axis, 2, 100),
            ("field.grid_points_random", f.grid_points_random, 1, 10_000),
            ("field.goal_ring_points", f.goal_ring_points, 3, 100),
            ("verification.random_starts", self.verification.random_starts as usize, 0, 10_000),
        ] {
            if !(least..=most).contains(&count) {
                return Err((key, format!("expected {least} to {most}, found {count}")));
            }
        }
        Ok(())
    }
}

fn flatten(prefix: &str, value: &serde_json::Value, values: &mut Vec<(String, String)>) {
    match value {
        serde_json::Value::Object(map) => {
            for (key, value) in map {
                let dot = if prefix.is_empty() { "" } else { "." };
                flatten(&format!("{prefix}{dot}{key}"), value, values);
            }
        }
        serde_json::Value::String(text) => values.push((prefix.into(), text.clone())),
        other => values.push((prefix.into(), other.to_string())),
    }
}
