//! What is compared under which conditions: the words of `results.json`.

use std::fmt;

use serde::{Deserialize, Serialize};
use tprmp_drawing::number;
use tprmp_model::skill_model::Manifold;

/// Spread of the noisy starts: they lie in a disc of this radius, at a scale of one [m].
pub(crate) const START_NOISE_M: f64 = 0.2;
/// How far frames that turn do so to either side: planar [°], and the object [rad].
pub(crate) const TURNING_DEG: f64 = 90.0;
/// … the object.
pub(crate) const OBJECT_TURNING_RAD: f64 = 0.6;

/// Where skills live: each has skill files and experiments of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Space {
    Planar,
    Pick,
}

impl Space {
    pub(crate) const ALL: [Self; 2] = [Self::Planar, Self::Pick];

    /// Where a manifold belongs.
    pub(crate) fn of(manifold: Manifold) -> Self {
        if manifold == Manifold::R2 { Self::Planar } else { Self::Pick }
    }
}

/// A policy that is compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum PolicyKind {
    /// The default one, with a certificate.
    #[default]
    Canonical,
    Thesis,
    /// PD control, critically damped at full speed.
    Pd,
    /// PD control as the thesis has it.
    PdPublished,
    Dmp,
    /// TP-GMM with a linear quadratic regulator.
    TpgmmLqr,
}

impl PolicyKind {
    pub(crate) const ALL: [Self; 6] =
        [Self::Canonical, Self::Thesis, Self::Pd, Self::PdPublished, Self::Dmp, Self::TpgmmLqr];
    /// Those that are learned by a skill file.
    pub(crate) const LEARNED: [Self; 2] = [Self::Canonical, Self::Thesis];

    /// In words.
    pub(crate) fn words(self) -> String {
        self.to_string().replace('_', " ")
    }
}

/// A policy in one form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Compared {
    pub(crate) policy: PolicyKind,
    /// Its Gaussians; zero where it has none, or none that are varied.
    pub(crate) components: usize,
}

impl From<PolicyKind> for Compared {
    fn from(policy: PolicyKind) -> Self {
        Self { policy, components: 0 }
    }
}

/// An experiment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Experiment {
    /// Demonstrated frames at rest.
    #[default]
    Tracking,
    /// The goal on a circle, over the number of Gaussians.
    Adaptation,
    /// The goal on circles of several radii.
    Radius,
    StaticGoal,
    StartNoise,
    TurnedFrames,
    TurningFrames,
    Disturbance,
    /// A push in the direction that was published.
    DisturbancePublished,
    /// The push of [`Disturbance`](Self::Disturbance) with the goal at rest: the path is the demonstrated one.
    DisturbanceStill,
    /// An obstacle that moves with the goal.
    Obstacle,
    /// The same with the goal at rest: the path is the demonstrated one but for the obstacle.
    ObstacleStill,
    PickTracking,
    PickAdaptation,
    PickRadius,
    PickTurning,
    PickDisturbance,
    PickObstacle,
    /// V along rollouts.
    Energy,
    /// Starts all around the demonstrations.
    RandomStarts,
    /// Starts on a grid over the workspace.
    GridStarts,
    IterationTime,
    PickIterationTime,
}

impl Experiment {
    /// Where its skills live. Energy and random starts are measured in both spaces alike.
    pub(crate) fn space(self) -> Space {
        match self {
            Self::PickTracking
            | Self::PickAdaptation
            | Self::PickRadius
            | Self::PickTurning
            | Self::PickDisturbance
            | Self::PickObstacle
            | Self::PickIterationTime => Space::Pick,
            _ => Space::Planar,
        }
    }

    /// Whether the demonstration is what should come out.
    pub(crate) fn tracks(self) -> bool {
        matches!(self, Self::Tracking | Self::PickTracking)
    }

    /// The goal is reached within this distance [m] and, in space, angle [°].
    pub(crate) fn tolerance(self, scale: f64) -> [f64; 2] {
        let [metres, degrees] = match self {
            Self::Obstacle | Self::ObstacleStill => [0.01, f64::INFINITY],
            _ if self.tracks() || self.space() == Space::Pick => [0.001, 0.1],
            _ => [0.005, f64::INFINITY],
        };
        [metres * scale, degrees]
    }

    /// Whether something leads off the demonstrated path, so that the distance to it tells how fast it is returned to.
    pub(crate) fn disturbs(self) -> bool {
        matches!(self, Self::Disturbance | Self::DisturbanceStill | Self::ObstacleStill)
    }
}

/// What is varied within an experiment; lengths and forces at a scale of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Setting {
    AsDemonstrated,
    Components(usize),
    /// Distance of the goal from where it was demonstrated [m], and its direction [rad].
    Displaced(f64, f64),
    /// Starts within [`START_NOISE_M`].
    NoisyStart,
    /// The start frame's rotation [°].
    TurnedStart(f64),
    /// The end frame's rotation [°].
    TurnedEnd(f64),
    /// The end frame turns by [`TURNING_DEG`].
    TurningEnd,
    /// The object turns by [`OBJECT_TURNING_RAD`].
    TurningObject,
    Force(f64),
    /// Radius of the goal's circle [m].
    Circle(f64),
    /// Radius of the obstacle [m].
    Ball(f64),
    /// Rate of control [Hz].
    Rate(f64),
    Starts(usize),
    /// Starts on a grid of so many a side.
    Grid(usize),
}

impl Setting {
    /// In words, with what its lengths and forces are multiplied by.
    pub(crate) fn words(self, scale: f64) -> String {
        let scaled = matches!(
            self,
            Self::Displaced(..)
                | Self::NoisyStart
                | Self::Force(_)
                | Self::Circle(_)
                | Self::Ball(_)
        );
        if scaled && scale != 1.0 {
            format!("{self}, × {}", number(scale))
        } else {
            self.to_string()
        }
    }

    /// The varied number.
    pub(crate) fn x(self) -> f64 {
        match self {
            Self::AsDemonstrated => 0.0,
            Self::Components(count) | Self::Starts(count) | Self::Grid(count) => count as f64,
            Self::NoisyStart => START_NOISE_M,
            Self::TurningEnd => TURNING_DEG,
            Self::TurningObject => OBJECT_TURNING_RAD,
            Self::Displaced(x, _)
            | Self::TurnedStart(x)
            | Self::TurnedEnd(x)
            | Self::Force(x)
            | Self::Circle(x)
            | Self::Ball(x)
            | Self::Rate(x) => x,
        }
    }
}

impl fmt::Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::AsDemonstrated => write!(f, "as demonstrated"),
            Self::Components(count) => write!(f, "K = {count}"),
            Self::Displaced(metres, angle) => {
                write!(f, "{metres} m at {:.0}°", angle.to_degrees())
            }
            Self::NoisyStart => write!(f, "start within {START_NOISE_M} m"),
            Self::TurnedStart(degrees) => write!(f, "start frame turned by {degrees}°"),
            Self::TurnedEnd(degrees) => write!(f, "end frame turned by {degrees}°"),
            Self::TurningEnd => {
                write!(f, "end frame circles, and turns by ±{TURNING_DEG}° at 1 rad/s")
            }
            Self::TurningObject => {
                let degrees = OBJECT_TURNING_RAD.to_degrees();
                write!(f, "object circles, and turns by ±{degrees:.0}° at 1 rad/s")
            }
            Self::Force(newtons) => write!(f, "{newtons} N"),
            Self::Circle(metres) => write!(f, "r = {metres} m"),
            Self::Ball(metres) => write!(f, "R = {metres} m"),
            Self::Rate(hertz) => write!(f, "{hertz:.0} Hz"),
            Self::Starts(count) => write!(f, "{count} random starts"),
            Self::Grid(count) => write!(f, "{count} × {count} starts"),
        }
    }
}

/// Writes the name that an enum has in files.
macro_rules! display {
    ($($of:ty)+) => {
        $(impl fmt::Display for $of {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.serialize(f)
            }
        })+
    };
}
display!(Space PolicyKind Experiment);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_says_by_what_its_lengths_are_multiplied() {
        assert_eq!(Setting::Circle(0.5).words(1.0), "r = 0.5 m");
        assert_eq!(Setting::Circle(0.5).words(0.02), "r = 0.5 m, × 0.02");
        assert_eq!(Setting::Force(10.0).words(0.02), "10 N, × 0.02");
        assert_eq!(Setting::TurnedEnd(30.0).words(0.02), "end frame turned by 30°");
        assert_eq!(Setting::Grid(35).words(0.02), "35 × 35 starts");
        assert_eq!(Experiment::Obstacle.tolerance(0.02)[0], 0.01 * 0.02);
    }
}
