//! How well a model was fitted.

use serde::{Deserialize, Serialize};

/// An enum whose values stand by name in model files and reports.
macro_rules! named {
    ($(#[$of:meta])* $enum:ident { $($(#[$doc:meta])* $variant:ident = $name:literal,)+ }) => {
        $(#[$of])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(into = "&'static str", try_from = "String")]
        pub enum $enum {
            $($(#[$doc])* $variant,)+
        }

        impl From<$enum> for &'static str {
            fn from(value: $enum) -> Self {
                match value {
                    $($enum::$variant => $name,)+
                }
            }
        }

        impl TryFrom<String> for $enum {
            type Error = String;

            fn try_from(name: String) -> Result<Self, String> {
                match name.as_str() {
                    $($name => Ok(Self::$variant),)+
                    _ => Err(format!("expected one of {:?}, found `{name}`", [$($name),+])),
                }
            }
        }

        impl std::fmt::Display for $enum {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str((*self).into())
            }
        }
    };
}

named! {
    /// A convex program of the fit.
    Program {
        /// The canonical policy's field of positions.
        PositionField = "position field",
        /// The canonical policy's field of orientations.
        OrientationField = "orientation field",
        /// The thesis' potential.
        Potential = "potential",
        /// The thesis' damping.
        Damping = "damping",
    }
}

named! {
    /// How exactly a program was solved.
    ProgramStatus {
        /// To the solver's full tolerances.
        Solved = "Solved",
        /// To its reduced ones.
        AlmostSolved = "AlmostSolved",
    }
}

named! {
    /// What a group of constraints demands.
    Constraints {
        /// The field descends along the demonstrations.
        Descent = "descent along the demonstrations",
        /// The goal is a strict minimum.
        GoalHessian = "Hessian at the goal",
        /// Each phase has one lowest point.
        Stiffness = "stiffness across the path",
        /// The thesis' potentials do not rise [thesis eq. 4.16].
        PotentialOrder = "φ⁰ of neighbours equal",
        /// The thesis' damping is no smaller than its bound [thesis eq. 4.21].
        DampingMin = "d at its least value",
        /// The thesis' damping does not fall [thesis eq. 4.21].
        DampingOrder = "d of neighbours equal",
    }
}

named! {
    /// What else is known of a program.
    Figure {
        /// Mean speed that is missing where descent is demanded, over the damping [ŷ/s].
        Hinge = "hinge",
        /// Fraction of the checked points at which the field rises along the demonstrations.
        AgainstDemonstrations = "fraction against the demonstrations",
        /// How often the program was solved again to take away faults of the valley.
        RefinementRounds = "refinement rounds",
        /// Stretches of the valley that do not fall towards the goal, and are left.
        ValleyFaults = "valley faults",
        /// Normalised units ŷ a unit [1/m or 1/rad].
        LengthScale = "normalised units a unit",
        /// Normalised length of the phase \[ŷ\].
        PhaseLength = "normalised length of the phase",
        /// Samples of the demonstrations that entered.
        Samples = "samples",
    }
}

/// Figures of the fit. No time stands here: same input and seed give the same bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fit {
    /// Expectation maximisation: iterations.
    pub em_iterations: u32,
    /// Mean log-likelihood of a sample after the last iteration [nat, normalised coordinates].
    pub em_log_likelihood: f64,
    /// The convex programs, in the order in which they were solved.
    pub programs: Vec<ProgramFit>,
    /// Duration of the common motion of the demonstrations \[s\]; 0 in files of schemas before 7.
    #[serde(default)]
    pub duration_s: f64,
    /// How far the demonstrations lie apart in canonical coordinates, root of the mean square [m, rad], at
    /// equal fractions of that duration.
    #[serde(default)]
    pub agreement: Vec<[f64; 2]>,
    /// How the demonstrations are followed from their starts, with their frames.
    pub demonstrations: Vec<DemonstrationRollout>,
}

/// Figures of one convex program.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProgramFit {
    /// What was fitted.
    pub name: Program,
    /// How exactly it was solved.
    pub status: ProgramStatus,
    /// Iterations of the interior point method.
    pub iterations: u32,
    /// Optimal value of the whole objective.
    pub objective: f64,
    /// The part of it that compares with the demonstrations.
    pub residual: f64,
    /// Constraints that hold with equality.
    pub active: Vec<ActiveConstraints>,
    /// What else is known.
    pub figures: Vec<(Figure, f64)>,
}

impl ProgramFit {
    /// A figure, where the program has it.
    #[must_use]
    pub fn figure(&self, figure: Figure) -> Option<f64> {
        self.figures.iter().find(|(name, _)| *name == figure).map(|(_, value)| *value)
    }
}

/// How many of a kind of constraints hold with equality.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActiveConstraints {
    /// What is constrained.
    pub name: Constraints,
    /// How many hold with equality.
    pub active: u32,
    /// How many there are.
    pub count: u32,
}

/// A rollout from a demonstrated start, with the demonstration's own frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DemonstrationRollout {
    /// File name of the demonstration.
    pub name: String,
    /// Distance to the goal at the end \[m\].
    pub goal_error_m: f64,
    /// Angle to the goal at the end \[rad\].
    pub goal_error_rad: f64,
    /// Root of the mean square distance to the demonstration at the same time \[m\].
    pub tracking_rms_m: f64,
    /// The same for the angle \[rad\].
    pub tracking_rms_rad: f64,
    /// Root of the mean square distance of the recording to the rollout's nearest point, whatever the time \[m\].
    pub path_rms_m: f64,
    /// The same for the angle, where position and angle together are nearest \[rad\].
    #[serde(default)]
    pub path_rms_rad: f64,
    /// Distance of the rollout's end to where this demonstration ends \[m\].
    #[serde(default)]
    pub end_error_m: f64,
    /// The same for the angle \[rad\].
    #[serde(default)]
    pub end_error_rad: f64,
    /// Root of the mean square distance to what the other demonstrations predict for its frames \[m\].
    #[serde(default)]
    pub predicted_rms_m: f64,
    /// The same for the angle \[rad\].
    #[serde(default)]
    pub predicted_rms_rad: f64,
    /// How long the rollout takes until it stays near its end \[s\].
    #[serde(default)]
    pub execution_s: f64,
    /// How long the demonstration takes, without rests and pauses that the others do not make \[s\].
    #[serde(default)]
    pub duration_s: f64,
    /// Times in the recording at equal steps of the common time \[s\].
    #[serde(default)]
    pub recorded_s: Vec<f64>,
}
