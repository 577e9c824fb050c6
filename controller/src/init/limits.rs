//! Limits of the joints: the URDF's, what takes their place where it has none, and what follows from torque limits
//! and inertia.

use std::collections::BTreeMap;

use nalgebra::SVector;
use tprmp_robot::document::JointType;
use tprmp_robot::{
    Chain, Document, Interface, LimitOverride, Selection, UrdfErrorKind, gravity_torques,
    mass_matrix, spread_posture,
};

use crate::init::notes::Note;
use crate::init::text::rounded;

/// Postures in which the inertia is looked at.
const POSTURE_COUNT: usize = 200;
/// Speed where the URDF has none: slow enough for any arm \[rad/s or m/s\].
const SPEEDS: [f64; 2] = [1.0, 0.25];
/// Position limits where a joint that is no continuous one has none \[rad or m\].
const RANGES: [f64; 2] = [core::f64::consts::PI, 0.5];
/// The fraction of the effort limit that may be used.
pub(super) const EFFORT_FRACTION: f64 = 0.95;
/// Of what the torques allow, as much is left for the other joints' motion.
const COUPLING_FRACTION: f64 = 0.5;
/// The permitted speed is reached within this \[s\], or later; where the torques are not known, within twice that.
const SPEED_UP_S: f64 = 0.1;
/// No joint is asked for more, or held to less \[rad/s² or m/s²\].
const ACCELERATIONS: [f64; 2] = [0.5, 25.0];
/// The full acceleration is there within this \[s\], the full torque within half of it.
const JERK_TIME_S: f64 = 0.01;

/// Limits in place of those that the URDF does not have; what is wrong with those that it has is for the reader to say.
pub(super) fn missing(
    document: &Document,
    selection: &Selection,
    notes: &mut Vec<Note>,
) -> BTreeMap<String, LimitOverride> {
    let mut found = BTreeMap::new();
    let Err(error) = document.count_joints(selection) else { return found };
    let lacking = error.faults.iter().filter_map(|fault| match &fault.kind {
        UrdfErrorKind::NoLimits { joints } => Some(joints),
        _ => None,
    });
    for lacks in lacking.flatten() {
        let joint = document.joints.iter().find(|joint| joint.name == lacks.joint);
        let slides = usize::from(joint.is_some_and(|j| j.joint_type == JointType::Prismatic));
        let limit = LimitOverride {
            position: lacks.position.then_some([-RANGES[slides], RANGES[slides]]),
            velocity: lacks.velocity.then_some(SPEEDS[slides]),
            effort: None,
        };
        if limit != LimitOverride::default() {
            notes.push(Note::lack(format!(
                "joint `{}`: a default in place of {}, which the URDF does not have: see its data sheet",
                lacks.joint,
                match (limit.velocity, limit.position) {
                    (Some(_), Some(_)) => "limits of position and speed",
                    (Some(_), None) => "a speed limit",
                    _ => "position limits",
                }
            )));
            found.insert(lacks.joint.clone(), limit);
        }
    }
    found
}

/// What the joints' limits follow from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Known {
    /// Masses and inertias of all links, and effort limits of all joints.
    pub dynamics: bool,
}

/// Limits of N joints that no URDF has, with where they come from.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rates {
    /// Largest accelerations \[rad/s² or m/s²\].
    pub acceleration: Vec<f64>,
    /// Largest jerks \[rad/s³ or m/s³\].
    pub jerk: Vec<f64>,
    /// Largest changes of the efforts \[N m/s or N/s\].
    pub effort_rate: Vec<f64>,
    /// Of the accelerations.
    pub acceleration_reason: String,
    /// Of the jerks.
    pub jerk_reason: String,
    /// Joints whose effort limit does not hold the arm itself, which makes it a placeholder: their index, the
    /// limit, and what gravity asks for \[N m or N\].
    pub too_weak: Vec<(usize, f64, f64)>,
}

/// Accelerations from the torque limits and the mass matrix at 200 postures: half of the least that is left beside
/// gravity, (0.95 τ_max − |g(q)|) / M_ii(q), at most the permitted speed in a tenth of a second.
pub(super) fn rates<const N: usize>(
    chain: &Chain<N>,
    known: Known,
    gravity_m_s2: [f64; 3],
) -> Rates {
    let mut least = SVector::<f64, N>::repeat(f64::INFINITY);
    let mut most_gravity = SVector::<f64, N>::zeros();
    for k in 1..=POSTURE_COUNT {
        let q = spread_posture(chain.position_lower(), chain.position_upper(), k);
        let gravity = gravity_torques(chain, &q, gravity_m_s2.into());
        let inertia = mass_matrix(chain, &q);
        for i in 0..N {
            let left = EFFORT_FRACTION * chain.effort_max()[i] - gravity[i].abs();
            least[i] = least[i].min(left / inertia[(i, i)].max(1e-9));
            most_gravity[i] = most_gravity[i].max(gravity[i].abs());
        }
    }
    let mut too_weak = Vec::new();
    let mut acceleration = Vec::new();
    for i in 0..N {
        let by_speed = chain.velocity_max()[i] / SPEED_UP_S;
        let by_torque = COUPLING_FRACTION * least[i];
        let found = if !known.dynamics {
            0.5 * by_speed
        } else if by_torque > 0.0 {
            by_torque.min(by_speed)
        } else {
            too_weak.push((i, chain.effort_max()[i], most_gravity[i]));
            0.5 * by_speed
        };
        acceleration.push(rounded(found.clamp(ACCELERATIONS[0], ACCELERATIONS[1])));
    }
    let acceleration_reason = if known.dynamics {
        "half of what the torque limits leave beside gravity, by the mass matrix at 200 postures; at most the \
         permitted speed within 0.1 s, 25 rad/s² or m/s²"
    } else {
        "a default: the permitted speed within 0.2 s; the URDF does not have all masses and torque limits"
    };
    let jerk = acceleration.iter().map(|a| rounded(a / JERK_TIME_S)).collect();
    let effort =
        |i: usize| if chain.effort_max()[i].is_finite() { chain.effort_max()[i] } else { 100.0 };
    Rates {
        effort_rate: (0..N).map(|i| rounded(effort(i) / (0.5 * JERK_TIME_S))).collect(),
        jerk,
        acceleration,
        acceleration_reason: acceleration_reason.into(),
        jerk_reason: "a default: the full acceleration within 10 ms".into(),
        too_weak,
    }
}

/// Whether masses and effort limits of a chain are all known: then its torques are.
pub(super) fn known<const N: usize>(
    document: &Document,
    selection: &tprmp_robot::Selection,
) -> Known {
    let selection = tprmp_robot::Selection { interface: Interface::Effort, ..selection.clone() };
    Known { dynamics: Chain::<N>::from_document(document, &selection).is_ok() }
}
