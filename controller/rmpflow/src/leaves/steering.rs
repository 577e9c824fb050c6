//! Steering: what leads a body around obstacles.
//!
//! The collision leaf alone keeps points out of obstacles. But where the path runs straight into an
//! obstacle, or where the task's potential has a hollow in front of it, the body would wait there. The
//! steering starts from the velocity that a point near an obstacle tends to,
//!
//! ```text
//! u = ẋ + ẍ₀/d − v          ẍ₀: acceleration without obstacles, v: the obstacle's velocity there
//! ```
//!
//! for a policy of damping d, bounded by a largest speed. Of it the part that is faster than the
//! clearance c permits, p = −nᵀu − ν c > 0, is obstructed. It is deflected into a direction that is
//! latched when the point comes near:
//!
//! ```text
//! u′ = u + β p (n + κ t),  |u′| ≤ |u|        β: 0 at the edge of the range, 1 at contact
//! t = a × n                                  a: the latched axis of rotation
//! f += Jᵀ Λ d (u′ − u),  Λ = (J M⁻¹Jᵀ)⁻¹    at every point, weighted by β p
//! ```
//!
//! So at contact nothing of u′ is obstructed: the point follows the surface, and leaves it where the
//! task leads away. It is always deflected in the same sense, also by neighbouring obstacles, so that it
//! leaves a hollow of the potential. But κ fades away where the energy of the task is well below that at
//! the choice of the side and the task leads back: the goal has been passed, and there is no going around
//! it. It fades too at an obstacle that covers the goal: the body waits beside it. A side on which the
//! body comes to rest, in a low hollow or at the limits of its joints, is given up for another. At a goal
//! at rest u = 0 and nothing is obstructed, however near the obstacle. The steering does work: the energy
//! of the tree falls where nothing is obstructed.

use glam::{DQuat, DVec3};
use nalgebra::{Matrix3, SVector, Vector3};
use tprmp_spatial::PointMotion;

use crate::leaves::barrier::Clearance;
use crate::leaves::body::Body;
use crate::leaves::obstacle::Obstacle;
use crate::leaves::range::{Report, direction, not_negative, positive};
use crate::natural::{Factor, Natural};

/// Most obstacles that are steered around; the clearance is kept from any number.
pub const STEERED_CAPACITY: usize = 32;

/// β below which a point does not yet choose a side.
const LATCH_FRACTION: f64 = 0.02;
/// Sine of the angle to the normal below which a velocity prefers no side.
const HEAD_ON: f64 = 0.15;
/// Sine of that angle at which a velocity to the other side leads back.
const BACK: f64 = 0.3;
/// The energy of the task is well below that at the choice of the side from this fraction of it on; from
/// twice this fraction on it begins to be.
const LOW: f64 = 0.25;
/// A body that is obstructed and moves by less than this fraction of |u| …
const REST_FRACTION: f64 = 0.05;
/// … for so long tries another side [s].
const REST_S: f64 = 0.5;
/// Clearance of the goal from an obstacle above which the obstacle is gone around; at none it covers
/// the goal [m].
const GOAL_CLEARANCE_M: f64 = 0.02;
/// Part of the mean of J M⁻¹Jᵀ's diagonal that is added to it: a point that cannot move in some
/// direction is not pushed there.
const TASK_DAMPING: f64 = 3e-3;

/// In which directions a body may go around an obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize))]
pub enum Side {
    /// In the plane: left or right.
    Plane,
    /// In space: where the task leads; if it leads nowhere, towards this direction.
    Space(
        #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::leaves::keys::vector"))]
        DVec3,
    ),
}

/// How a body is led around obstacles.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
pub struct Steering {
    /// Clearance within which it acts \[m\].
    pub range_m: f64,
    /// κ: speed of the deflection, as a factor of the obstructed speed. The body leaves hollows of the
    /// potential whose walls rise against it by up to arctan κ from the normal.
    pub gain: f64,
    /// d: damping of the policy that is steered \[1/s\].
    pub response_1_s: f64,
    /// ν: speed of approach that is permitted for each metre of clearance \[1/s\].
    pub approach_1_s: f64,
    /// Largest |u| \[m/s\].
    pub speed_max_m_s: f64,
    /// Where it may lead.
    pub side: Side,
}

impl Steering {
    /// Reports parameters outside their ranges.
    pub fn check(&self, report: &mut Report<'_>) {
        positive("range_m", self.range_m, report);
        not_negative("gain", self.gain, report);
        positive("response_1_s", self.response_1_s, report);
        not_negative("approach_1_s", self.approach_1_s, report);
        positive("speed_max_m_s", self.speed_max_m_s, report);
        if let Side::Space(towards) = self.side {
            direction("side", towards, report);
        }
    }
}

/// What the steering keeps between ticks: the sides chosen at the obstacles nearby, and the progress
/// since the last choice.
#[derive(Debug, Clone, Copy, Default)]
pub struct AvoidanceState {
    /// a for each obstacle.
    axes: [Option<DVec3>; STEERED_CAPACITY],
    /// V of the task when the first of them was chosen, or one was chosen anew.
    energy: f64,
    /// How long the body has been at rest though it is obstructed \[s\].
    rest_s: f64,
}

/// A root without obstacles.
#[derive(Debug, Clone, Copy)]
pub struct Free<const N: usize> {
    /// Its acceleration.
    pub acceleration: SVector<f64, N>,
    /// The decomposition of its metric.
    pub factor: Factor<N>,
}

/// What is obstructed in a tick.
#[derive(Debug, Default)]
pub(super) struct Obstruction {
    /// Σ w with w = β p.
    weight: f64,
    /// Σ w |ẋ|/|u|.
    motion: f64,
    /// Largest β p/|u|.
    pub(super) fraction_max: f64,
}

/// A point in the range of the steering.
pub(super) struct SteeredPoint<'a, const N: usize> {
    pub(super) motion: &'a PointMotion<N>,
    pub(super) clearance: &'a Clearance,
}

/// The steering at one obstacle.
pub(super) struct Detour<'a, B, const N: usize> {
    pub(super) steering: &'a Steering,
    pub(super) obstacle: &'a Obstacle,
    /// Which of the obstacles it is.
    pub(super) index: usize,
    pub(super) body: &'a B,
    /// Added to the radius of every point \[m\].
    pub(super) margin_m: f64,
    pub(super) free: &'a Free<N>,
    pub(super) task_energy: f64,
    pub(super) sum: DetourSum<N>,
}

/// What the points near an obstacle add up to.
pub(super) struct DetourSum<const N: usize> {
    /// Σ w Jᵀ Λ d (u′ − u).
    force: SVector<f64, N>,
    /// Σ w.
    weight: f64,
    /// Whether a point is within the range.
    is_near: bool,
    /// How clear the goal is of the obstacle, once it was asked for.
    goal_fraction: Option<f64>,
}

impl<const N: usize> DetourSum<N> {
    pub(super) fn zero() -> Self {
        Self { force: SVector::zeros(), weight: 0.0, is_near: false, goal_fraction: None }
    }
}

impl<B: Body<N>, const N: usize> Detour<'_, B, N> {
    /// Adds a point.
    pub(super) fn add_point(
        &mut self,
        point: &SteeredPoint<'_, N>,
        obstruction: &mut Obstruction,
        state: &mut AvoidanceState,
    ) {
        let SteeredPoint { motion, clearance } = *point;
        let (steering, sum) = (self.steering, &mut self.sum);
        let relative = motion.velocity - self.obstacle.velocity_at(motion.position);
        let desired = steering.desired(motion, relative, &self.free.acceleration);
        let beta = steering.fraction(clearance.distance);
        sum.is_near |= beta > 0.0;
        let Some(speed) = steering.obstructed_speed(clearance, desired) else { return };
        let weight = beta * speed;
        obstruction.weight += weight;
        obstruction.motion += weight * relative.length() / desired.length();
        let approach = Approach { normal: clearance.normal, desired, beta };
        let chosen = state.axis(self.index, steering, &approach, self.task_energy);
        let Some(axis) = chosen else { return };
        let goal_fraction = *sum
            .goal_fraction
            .get_or_insert_with(|| goal_fraction(self.body, self.obstacle, self.margin_m));
        let persistence = state.persistence(&approach, axis, self.task_energy);
        let gain = steering.gain * persistence * goal_fraction;
        let aside = approach.normal + axis.cross(approach.normal) * gain;
        let deflected = (desired + aside * weight).clamp_length_max(desired.length());
        let change = deflected - desired;
        obstruction.fraction_max = obstruction.fraction_max.max(weight / desired.length());
        let mut mobility = self.free.factor.mobility(&motion.jacobian);
        mobility += Matrix3::identity() * (TASK_DAMPING * mobility.trace() / 3.0);
        if let Some(task) = Factor::new(&mobility) {
            let force = task.solve(&Vector3::from(change * steering.response_1_s));
            sum.force += motion.jacobian.tr_mul(&force) * weight;
            sum.weight += weight;
        }
    }

    /// Adds the mean over the points to the root.
    pub(super) fn finish(self, root: &mut Natural<N>, state: &mut AvoidanceState) {
        let sum = self.sum;
        if sum.weight > 0.0 {
            root.force += sum.force / sum.weight;
        }
        if let (Some(axis), false) = (state.axes.get_mut(self.index), sum.is_near) {
            *axis = None;
        }
    }
}

/// 0 where the obstacle covers the goal, 1 where the goal is well clear of it.
fn goal_fraction<const N: usize>(body: &impl Body<N>, obstacle: &Obstacle, margin_m: f64) -> f64 {
    let clearance = |i: usize| {
        let goal = body.at_goal(i).filter(|_| body.acts_within(i, &obstacle.shape) > 0.0)?;
        Some(obstacle.distance(goal, body.ball(i).1 + margin_m))
    };
    let least = (0..body.count()).filter_map(clearance).fold(f64::INFINITY, f64::min);
    (least / GOAL_CLEARANCE_M).clamp(0.0, 1.0)
}

/// A point that approaches an obstacle.
struct Approach {
    /// n.
    normal: DVec3,
    /// u.
    desired: DVec3,
    /// β.
    beta: f64,
}

impl AvoidanceState {
    /// Ends a tick among `count` obstacles.
    pub(super) fn finish(&mut self, count: usize, obstruction: &Obstruction, dt_s: f64) {
        self.axes.iter_mut().skip(count).for_each(|axis| *axis = None);
        let Obstruction { weight, motion, .. } = *obstruction;
        let rests = weight > 0.0 && motion < REST_FRACTION * weight;
        self.rest_s = if rests { self.rest_s + dt_s } else { 0.0 };
    }

    /// The axis of rotation at obstacle `k`; `None` far from it or beyond [`STEERED_CAPACITY`].
    fn axis(
        &mut self,
        k: usize,
        steering: &Steering,
        approach: &Approach,
        task_energy: f64,
    ) -> Option<DVec3> {
        let normal = approach.normal;
        // Obstacles side by side are passed on the same side.
        let inherited = self.axes.iter().flatten().next().copied();
        let latched = *self.axes.get(k)?;
        let anew =
            latched.filter(|_| self.rest_s > REST_S).map(|axis| steering.other(axis, normal));
        if anew.is_some() {
            self.axes = [None; STEERED_CAPACITY];
        }
        if anew.is_some() || inherited.is_none() {
            self.energy = task_energy;
            self.rest_s = 0.0;
        }
        let first =
            || (approach.beta >= LATCH_FRACTION).then(|| steering.axis(approach, inherited));
        self.axes[k] = anew.or(latched).or_else(first);
        self.axes[k]
    }

    /// Fraction of κ that remains: 0 where the energy is low and the task leads back, else 1.
    fn persistence(&self, approach: &Approach, axis: DVec3, task_energy: f64) -> f64 {
        let Approach { normal, desired, .. } = *approach;
        let speed = desired.length().max(f64::MIN_POSITIVE);
        let back = -normal.cross(desired).dot(axis) / (BACK * speed);
        let low = 2.0 - task_energy / (LOW * self.energy).max(f64::MIN_POSITIVE);
        1.0 - back.clamp(0.0, 1.0) * low.clamp(0.0, 1.0)
    }
}

impl Steering {
    /// u: the velocity a point tends to, relative to the obstacle, as `relative` is.
    fn desired<const N: usize>(
        &self,
        motion: &PointMotion<N>,
        relative: DVec3,
        free: &SVector<f64, N>,
    ) -> DVec3 {
        let acceleration = DVec3::from(motion.jacobian * free + motion.drift);
        (relative + acceleration / self.response_1_s).clamp_length_max(self.speed_max_m_s)
    }

    /// β.
    fn fraction(&self, distance: f64) -> f64 {
        let fraction = (1.0 - distance / self.range_m).clamp(0.0, 1.0);
        fraction * fraction * (3.0 - 2.0 * fraction)
    }

    /// p, `None` where nothing is obstructed.
    fn obstructed_speed(&self, clearance: &Clearance, desired: DVec3) -> Option<f64> {
        let permitted = self.approach_1_s * clearance.distance.max(0.0);
        let speed = -clearance.normal.dot(desired) - permitted;
        (speed > 0.0 && speed.is_finite()).then_some(speed)
    }

    /// Another axis than this one: the opposite in the plane; in space, in four steps all around.
    fn other(&self, axis: DVec3, normal: DVec3) -> DVec3 {
        match self.side {
            Side::Plane => -axis,
            Side::Space(_) => DQuat::from_axis_angle(normal, core::f64::consts::FRAC_PI_2) * axis,
        }
    }

    /// The axis of rotation for an approach.
    fn axis(&self, approach: &Approach, inherited: Option<DVec3>) -> DVec3 {
        let Approach { normal, desired, .. } = *approach;
        let across = normal.cross(desired);
        let has_side = across.length() > HEAD_ON * desired.length();
        match (self.side, inherited) {
            (_, Some(inherited)) if inherited.cross(normal).length() > 0.5 => inherited,
            (Side::Plane, _) if has_side => DVec3::Z * across.z.signum(),
            (Side::Plane, _) => DVec3::Z,
            (Side::Space(_), _) if has_side => across.normalize(),
            (Side::Space(preferred), _) => normal
                .cross(preferred)
                .try_normalize()
                .unwrap_or_else(|| normal.any_orthonormal_vector()),
        }
    }
}
