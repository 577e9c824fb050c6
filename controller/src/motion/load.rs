//! Torques that last beside those that the description knows of: masses it does not have, friction that
//! nobody measured.

use nalgebra::SVector;
use tprmp_model::controller_config::Load;

/// What a joint was doing while it was disturbed.
#[derive(Debug, Clone, Copy)]
pub struct Wanted<'a, const N: usize> {
    /// Measured velocity \[rad/s or m/s\].
    pub velocity: &'a SVector<f64, N>,
    /// The velocity that it is asked for \[rad/s or m/s\].
    pub wanted_velocity: &'a SVector<f64, N>,
}

/// An integral of the torques that disturb the joints.
///
/// ```text
/// l̇ = −D / T_i          within ± the largest
/// ```
///
/// D is what acts beside what was asked for, l with it; it vanishes where l cancels it, so that nothing
/// winds up: an arm that does as it is asked leaves l as it is, and what the limits cut is no disturbance.
/// T is long while a joint moves, so that an arm gives way to a push. It is short where friction keeps a
/// joint from a motion that is wanted, and where l itself drives one faster than is wanted: then friction
/// has let go.
#[derive(Debug, Clone, Copy)]
pub struct LoadObserver<const N: usize> {
    settings: Load,
    torque: SVector<f64, N>,
}

impl<const N: usize> LoadObserver<N> {
    /// No load is known.
    #[must_use]
    pub fn new(settings: Load) -> Self {
        Self { settings, torque: SVector::zeros() }
    }

    /// The same, with no load known.
    #[must_use]
    pub fn forgotten(self) -> Self {
        Self::new(self.settings)
    }

    /// What cancels the load \[N m or N\].
    #[must_use]
    pub fn torque(&self) -> &SVector<f64, N> {
        &self.torque
    }

    /// Goes on for `elapsed_s` \[s\] with a disturbance \[N m or N\]; at most the fraction of `effort_max`
    /// \[N m or N\] is made of it.
    pub fn advance(
        &mut self,
        disturbance: &SVector<f64, N>,
        joint: &Wanted<'_, N>,
        effort_max: &SVector<f64, N>,
        elapsed_s: f64,
    ) {
        let Load { time_constant_s, stuck_time_constant_s, stuck_speed, effort_fraction } =
            self.settings;
        for i in 0..N {
            let (velocity, wanted) = (joint.velocity[i], joint.wanted_velocity[i]);
            let (load, disturbance) = (self.torque[i], disturbance[i]);
            let stuck = velocity.abs() < stuck_speed && disturbance * wanted < 0.0;
            let runs_away = (velocity - wanted) * load > 0.0 && disturbance * load > 0.0;
            let time_s = if stuck || runs_away { stuck_time_constant_s } else { time_constant_s };
            let most = effort_fraction * effort_max[i];
            // A step is no longer than what it integrates.
            let fraction = elapsed_s / (elapsed_s + time_s);
            let next = load - disturbance * fraction;
            // What lets go of itself goes no further than to nothing.
            let next = if runs_away && next * load < 0.0 { 0.0 } else { next };
            self.torque[i] = next.clamp(-most, most);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector1;

    const SETTINGS: Load = Load {
        time_constant_s: 0.2,
        stuck_time_constant_s: 0.02,
        stuck_speed: 0.005,
        effort_fraction: 0.25,
    };
    const DT: f64 = 0.002;

    fn advance(observer: &mut LoadObserver<1>, disturbance: f64, velocity: f64, wanted: f64) {
        let (velocity, wanted) = (Vector1::new(velocity), Vector1::new(wanted));
        let joint = Wanted { velocity: &velocity, wanted_velocity: &wanted };
        observer.advance(&Vector1::new(disturbance), &joint, &Vector1::new(100.0), DT);
    }

    /// After so long under a weight, what cancels it, of what there is of it.
    fn known(weight: f64, seconds: f64, velocity: f64, wanted: f64) -> f64 {
        let mut observer = LoadObserver::<1>::new(SETTINGS);
        for _ in 0..(seconds / DT) as usize {
            let left = weight + observer.torque()[0];
            advance(&mut observer, left, velocity, wanted);
        }
        -observer.torque()[0] / weight
    }

    #[test]
    fn a_weight_is_known_after_its_time_and_never_more_than_that() {
        assert!((known(-10.0, 0.2, 0.1, 0.1) - 0.63).abs() < 0.01);
        assert!((known(-10.0, 5.0, 0.1, 0.1) - 1.0).abs() < 1e-6);
        assert!((known(-50.0, 5.0, 0.1, 0.1) - 0.5).abs() < 1e-9, "no more than a quarter of 100");
    }

    #[test]
    fn friction_that_holds_a_joint_is_known_ten_times_as_fast() {
        assert!(known(-10.0, 0.05, 0.0, 0.1) > 0.9);
        assert!(known(-10.0, 0.05, 0.0, 0.0) < 0.25, "where nothing is wanted it is a push");
        assert!(known(10.0, 0.05, 0.0, 0.1) < 0.25, "nor where it pushes the way it should");
    }

    #[test]
    fn what_friction_needed_is_gone_at_once_when_it_has_let_go() {
        let mut observer = LoadObserver::<1>::new(SETTINGS);
        for _ in 0..100 {
            let left = -10.0 + observer.torque()[0];
            advance(&mut observer, left, 0.0, 0.1);
        }
        for _ in 0..50 {
            let left = observer.torque()[0];
            advance(&mut observer, left, 0.5, 0.1);
        }
        assert!(observer.torque()[0] < 0.1, "{}", observer.torque()[0]);
        // A push, beside which there was hardly any load, is no reason to resist it at once.
        advance(&mut observer, 40.0, 0.5, 0.1);
        assert_eq!(observer.torque()[0], 0.0);
    }
}
