//! Limits on what is commanded: the last thing before publishing. Pure functions.

use nalgebra::SVector;
use tprmp_model::controller_config::Robot;
use tprmp_robot::Chain;

/// The limits of a robot. All positive.
#[derive(Debug, Clone, Copy)]
pub struct JointLimits<const N: usize> {
    /// Least position of the working range \[rad or m\].
    pub position_lower: SVector<f64, N>,
    /// Greatest position of the working range \[rad or m\].
    pub position_upper: SVector<f64, N>,
    /// Greatest speed \[rad/s or m/s\].
    pub velocity_max: SVector<f64, N>,
    /// Greatest acceleration \[rad/s² or m/s²\].
    pub acceleration_max: SVector<f64, N>,
    /// Greatest change of the acceleration \[rad/s³ or m/s³\].
    pub jerk_max: SVector<f64, N>,
    /// Greatest torque or force \[N m or N\].
    pub effort_max: SVector<f64, N>,
    /// Greatest change of it \[N m/s or N/s\].
    pub effort_rate_max: SVector<f64, N>,
    /// Least and greatest position of the robot's description, without the margin \[rad or m\].
    pub position_end: [SVector<f64, N>; 2],
    /// From so far outside of the robot's description a joint is moved back \[rad or m\].
    pub return_max: f64,
}

impl<const N: usize> JointLimits<N> {
    /// The limits of the robot's description, reduced as configured.
    #[must_use]
    pub fn new(chain: &Chain<N>, robot: &Robot) -> Self {
        let [position_lower, position_upper] = working_range(chain, robot);
        Self {
            position_lower,
            position_upper,
            velocity_max: chain.velocity_max() * robot.velocity_fraction,
            acceleration_max: SVector::from_column_slice(&robot.acceleration_max),
            jerk_max: SVector::from_column_slice(&robot.jerk_max),
            effort_max: chain.effort_max() * robot.effort_fraction,
            effort_rate_max: SVector::from_column_slice(&robot.effort_rate_max),
            position_end: [*chain.position_lower(), *chain.position_upper()],
            return_max: robot.position_margin,
        }
    }

    /// An acceleration no larger than the largest: the whole vector is scaled, so that the direction of
    /// the motion is kept \[rad/s² or m/s²\].
    #[must_use]
    pub fn scaled(&self, wanted: &SVector<f64, N>) -> SVector<f64, N> {
        let excess =
            wanted.iter().zip(self.acceleration_max.iter()).map(|(a, most)| a.abs() / most);
        wanted / excess.fold(1.0_f64, f64::max)
    }

    /// Whether every joint is within the robot's description.
    #[must_use]
    pub fn contain(&self, position: &SVector<f64, N>) -> bool {
        self.contain_but(position, 0.0)
    }

    /// Whether every joint is within the robot's description, or so little outside that it is moved back.
    #[must_use]
    pub fn permit_return(&self, position: &SVector<f64, N>) -> bool {
        self.contain_but(position, self.return_max)
    }

    fn contain_but(&self, position: &SVector<f64, N>, outside: f64) -> bool {
        let [lower, upper] = &self.position_end;
        (0..N).all(|i| (lower[i] - outside..=upper[i] + outside).contains(&position[i]))
    }

    /// The torque that may be commanded.
    #[must_use]
    pub fn effort(&self, wanted: &SVector<f64, N>) -> SVector<f64, N> {
        wanted.zip_map(&self.effort_max, |w, limit| w.clamp(-limit, limit))
    }
}

/// Least and greatest position that joints are moved to: the description's, less the margin, where
/// the configuration does not narrow it further \[rad or m\].
#[must_use]
pub fn working_range<const N: usize>(chain: &Chain<N>, robot: &Robot) -> [SVector<f64, N>; 2] {
    let margin = robot.position_margin;
    let narrower = |i: usize| robot.working_range.get(&chain.joint_names()[i]);
    let lower = chain.position_lower().map_with_location(|i, _, end| {
        narrower(i).map_or(end + margin, |range| range[0].max(end + margin))
    });
    let upper = chain.position_upper().map_with_location(|i, _, end| {
        narrower(i).map_or(end - margin, |range| range[1].min(end - margin))
    });
    [lower, upper]
}

#[cfg(test)]
mod tests {
    use super::*;
    use tprmp_model::controller_config;

    #[test]
    fn the_working_range_is_the_narrower_of_description_and_configuration() {
        let ur5 = concat!(env!("CARGO_MANIFEST_DIR"), "/../config/controllers/ur5_pick.ron");
        let mut config = controller_config::read(ur5.as_ref()).unwrap();
        let chain = Chain::<6>::from_urdf(&config.robot.urdf, config.robot.selection()).unwrap();
        config.robot.working_range =
            [("elbow_joint".to_string(), [0.1, 9.0]), ("wrist_1_joint".to_string(), [-9.0, 1.0])]
                .into();
        let [lower, upper] = working_range(&chain, &config.robot);
        let margin = config.robot.position_margin;
        let own =
            |i: usize| [chain.position_lower()[i] + margin, chain.position_upper()[i] - margin];
        assert_eq!([lower[2], upper[2]], [0.1, own(2)[1]]);
        assert_eq!([lower[3], upper[3]], [own(3)[0], 1.0]);
        assert_eq!([lower[4], upper[4]], own(4));
    }
}
