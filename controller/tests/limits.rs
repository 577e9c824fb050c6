//! Whatever the policy wants and whatever is measured: no command leaves the limits.

use std::path::{Path, PathBuf};

use nalgebra::SVector;
use proptest::prelude::*;
use tprmp_controller::inputs::JointState;
use tprmp_controller::limits::JointLimits;
use tprmp_controller::motion::{Motion, Setpoint};
use tprmp_model::controller_config::{self, ControllerConfig};
use tprmp_robot::Chain;

const N: usize = 6;
type Joints = SVector<f64, N>;

fn shipped() -> (ControllerConfig, Chain<N>) {
    let root: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let config = controller_config::read(&root.join("config/controllers/ur5_pick.ron")).unwrap();
    let chain = Chain::<N>::from_urdf(&config.robot.urdf, &config.robot.tool_link).unwrap();
    (config, chain)
}

/// What happens in a tick.
#[derive(Debug, Clone)]
enum Event {
    /// The policy wants this, as far as numbers go.
    Follow(Joints),
    /// A fault, with or without a measurement of the arm.
    Brake { seen: bool },
    /// The controller was held up.
    Gap,
}

/// How the measured arm relates to what was commanded.
#[derive(Debug, Clone)]
struct Measured {
    /// Added to the commanded position [rad] and velocity [rad/s].
    position: Joints,
    velocity: Joints,
    /// Put anywhere inside the robot's limits, as a share of their range.
    elsewhere: Option<[f64; N]>,
}

fn joints(range: f64) -> impl Strategy<Value = Joints> {
    prop::array::uniform6(-range..range).prop_map(Joints::from)
}

fn event() -> impl Strategy<Value = Event> {
    // From gentle to absurd: each decade equally likely, and now and then no number at all.
    let size = prop_oneof![40 => (-1.0..18.0_f64).prop_map(|e| 10_f64.powf(e)),
        1 => Just(f64::INFINITY), 1 => Just(f64::NAN)];
    prop_oneof![
        12 => (joints(1.0), size).prop_map(|(direction, size)| Event::Follow(direction * size)),
        2 => any::<bool>().prop_map(|seen| Event::Brake { seen }),
        1 => Just(Event::Gap),
    ]
}

fn measured() -> impl Strategy<Value = Measured> {
    let elsewhere = prop_oneof![30 => Just(None), 1 => prop::array::uniform6(0.0..=1.0).prop_map(Some)];
    (joints(0.02), joints(6.0), elsewhere)
        .prop_map(|(position, velocity, elsewhere)| Measured { position, velocity, elsewhere })
}

fn inside(
    setpoint: &Setpoint<N>,
    limits: &JointLimits<N>,
    chain: &Chain<N>,
) -> Result<(), TestCaseError> {
    let torque = setpoint.torques.motion + setpoint.torques.gravity;
    for i in 0..N {
        let position = setpoint.position[i];
        prop_assert!(position >= chain.position_lower()[i] && position <= chain.position_upper()[i]);
        prop_assert!(setpoint.velocity[i].abs() <= limits.velocity_max[i] * (1.0 + 1e-12));
        prop_assert!(setpoint.acceleration[i].abs() <= limits.acceleration_max[i] * (1.0 + 1e-12));
        prop_assert!(torque[i].abs() <= limits.effort_max[i] * (1.0 + 1e-12));
        prop_assert!(setpoint.torques.gravity[i].abs() <= limits.effort_max[i]);
        prop_assert!(setpoint.torques.motion[i].is_finite());
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn no_command_leaves_the_limits(
        start in prop::array::uniform6(0.0..=1.0_f64),
        dt in 1e-6..0.02_f64,
        ticks in prop::collection::vec((event(), measured()), 1..150),
    ) {
        let (config, chain) = shipped();
        let limits = JointLimits::new(&chain, &config.robot);
        let mut motion = Motion::new(limits, &config);
        let range = chain.position_upper() - chain.position_lower();
        let place = |share: &[f64; N]| chain.position_lower() + range.component_mul(&Joints::from(*share));
        let (mut q, mut qd) = (place(&start), Joints::zeros());
        for (event, measured) in &ticks {
            if let Some(share) = &measured.elsewhere {
                q = place(share);
            }
            let ends = [*chain.position_lower(), *chain.position_upper()];
            let state = JointState {
                position: (q + measured.position).zip_zip_map(&ends[0], &ends[1], f64::clamp),
                velocity: qd + measured.velocity,
            };
            let setpoint = match event {
                Event::Follow(wanted) => {
                    let setpoint = motion.follow(&chain, &state, wanted, dt);
                    let finite = wanted.iter().all(|a| a.is_finite());
                    prop_assert_eq!(setpoint.is_ok(), finite);
                    setpoint.ok().or_else(|| motion.brake(&chain, Some(state), dt))
                }
                Event::Brake { seen } => motion.brake(&chain, seen.then_some(state), dt),
                Event::Gap => {
                    motion.lose_sight();
                    motion.brake(&chain, Some(state), dt)
                }
            };
            if let Some(setpoint) = setpoint {
                inside(&setpoint, &limits, &chain)?;
                (q, qd) = (setpoint.position, setpoint.velocity);
            }
        }
    }

    /// From any speed, seen or blind, the reference is at rest within the time that its largest
    /// deceleration needs.
    #[test]
    fn braking_ends_in_bounded_time(
        start in prop::array::uniform6(0.2..0.8_f64),
        velocity in joints(5.0),
        seen in any::<bool>(),
        dt in 1e-4..5e-3_f64,
    ) {
        let (config, chain) = shipped();
        let limits = JointLimits::new(&chain, &config.robot);
        let mut motion = Motion::new(limits, &config);
        let range = chain.position_upper() - chain.position_lower();
        let position = chain.position_lower() + range.component_mul(&Joints::from(start));
        let state = JointState { position, velocity };
        prop_assert!(motion.follow(&chain, &state, &Joints::zeros(), dt).is_ok());
        let deceleration = config.stop.deceleration_share * limits.acceleration_max.min();
        let longest_s = limits.velocity_max.max() / deceleration;
        let mut passed_s = 0.0;
        while !motion.reference_rests() {
            motion.brake(&chain, seen.then_some(state), dt);
            passed_s += dt;
            prop_assert!(passed_s <= longest_s + 3.0 * dt, "still moving after {passed_s} s");
        }
    }
}
