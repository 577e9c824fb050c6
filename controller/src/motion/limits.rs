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
    /// Greatest torque or force \[N m or N\].
    pub effort_max: SVector<f64, N>,
    /// Least and greatest position of the robot's description, without the margin \[rad or m\].
    pub position_end: [SVector<f64, N>; 2],
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
            effort_max: chain.effort_max() * robot.effort_fraction,
            position_end: [*chain.position_lower(), *chain.position_upper()],
        }
    }

    /// The acceleration that may be commanded.
    ///
    /// First the whole vector is scaled so that no joint exceeds its acceleration: the direction of
    /// the motion is kept. Then each joint is held to what keeps the *commanded* velocity, after
    /// `dt` \[s\], inside its limit and slow enough to stop before its position limit with half of
    /// its acceleration. The command is the reference, not the measurement, so that a limit never
    /// drags the arm.
    #[must_use]
    pub fn acceleration(
        &self,
        wanted: &SVector<f64, N>,
        position: &SVector<f64, N>,
        velocity: &SVector<f64, N>,
        dt: f64,
    ) -> SVector<f64, N> {
        let excess = wanted
            .iter()
            .zip(self.acceleration_max.iter())
            .map(|(a, limit)| a.abs() / limit)
            .fold(1.0_f64, f64::max);
        SVector::from_fn(|i, _| {
            let limit = self.acceleration_max[i];
            let stopping = |room: f64| (limit * room.max(0.0)).sqrt();
            let upper = self.velocity_max[i].min(stopping(self.position_upper[i] - position[i]));
            let lower = -self.velocity_max[i].min(stopping(position[i] - self.position_lower[i]));
            let most = ((upper - velocity[i]) / dt).max(-limit);
            let least = ((lower - velocity[i]) / dt).min(limit);
            (wanted[i] / excess).min(most).max(least).clamp(-limit, limit)
        })
    }

    /// The position that may be commanded. The margin is left to [`Self::acceleration`]: an arm that
    /// starts inside it is not commanded to jump out of it.
    #[must_use]
    pub fn position(&self, wanted: &SVector<f64, N>) -> SVector<f64, N> {
        let [lower, upper] = &self.position_end;
        wanted.zip_zip_map(lower, upper, f64::clamp)
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
    use nalgebra::Vector2;
    use tprmp_model::controller_config;

    fn limits() -> JointLimits<2> {
        JointLimits {
            position_lower: Vector2::new(-1.0, -2.0),
            position_upper: Vector2::new(1.0, 2.0),
            velocity_max: Vector2::new(1.5, 3.0),
            acceleration_max: Vector2::new(10.0, 20.0),
            effort_max: Vector2::new(100.0, 50.0),
            position_end: [Vector2::new(-1.1, -2.1), Vector2::new(1.1, 2.1)],
        }
    }

    /// Integrates wild accelerations: no position, velocity or acceleration ever leaves its limit.
    #[test]
    fn no_sequence_of_desired_accelerations_leaves_the_limits() {
        let limits = limits();
        let dt = 1e-3;
        let (mut q, mut qd) = (Vector2::zeros(), Vector2::<f64>::zeros());
        let mut seed = 1_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
            (seed >> 33) as f64 / f64::from(1_u32 << 31) * 2.0 - 1.0
        };
        let mut desired = Vector2::zeros();
        for step in 0..200_000 {
            if step % 97 == 0 {
                desired = Vector2::new(random(), random()) * 10_f64.powf(2.0 * random() + 1.0);
            }
            let a = limits.acceleration(&desired, &q, &qd, dt);
            qd += a * dt;
            q += qd * dt;
            for i in 0..2 {
                assert!(a[i].abs() <= limits.acceleration_max[i] + 1e-9);
                assert!(qd[i].abs() <= limits.velocity_max[i] + 1e-9);
                assert!(q[i] <= limits.position_upper[i] + 1e-3, "{step} {q}");
                assert!(q[i] >= limits.position_lower[i] - 1e-3, "{step} {q}");
            }
        }
    }

    #[test]
    fn a_joint_beyond_its_range_may_only_come_back() {
        let (limits, dt) = (limits(), 1e-3);
        let (mut q, mut qd) = (Vector2::new(1.05, -2.05), Vector2::<f64>::zeros());
        for desired in [Vector2::new(10.0, -20.0), Vector2::new(-5.0, 5.0)] {
            let before = q;
            for _ in 0..300 {
                qd += limits.acceleration(&desired, &q, &qd, dt) * dt;
                q += qd * dt;
            }
            let inwards = desired[0] < 0.0;
            assert_eq!(q != before, inwards, "{q}");
        }
        assert!(q[0] < 1.0 && q[1] > -2.0, "{q}");
    }

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

    #[test]
    fn scaling_keeps_the_direction() {
        let a = limits().acceleration(
            &Vector2::new(100.0, 50.0),
            &Vector2::zeros(),
            &Vector2::zeros(),
            1e-3,
        );
        assert!((a - Vector2::new(10.0, 5.0)).norm() < 1e-12);
    }

    #[test]
    fn efforts_are_clamped() {
        let effort = limits().effort(&Vector2::new(-300.0, 20.0));
        assert_eq!(effort, Vector2::new(-100.0, 20.0));
    }
}
