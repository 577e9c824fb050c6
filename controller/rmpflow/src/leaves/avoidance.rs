//! Avoidance of obstacles by points of a body: a leaf that keeps the clearance, and a steering that
//! leads around.
//!
//! The leaf alone keeps points out of obstacles, but where the way leads head-on into one, or where
//! the task's potential has a hollow in front of it, the body would wait there. The steering sees
//! what the task wants of a point near an obstacle: the velocity
//!
//! ```text
//! u = ẋ + ẍ₀/d − v          ẍ₀: acceleration without obstacles, v: the obstacle's velocity there
//! ```
//!
//! that a policy of damping d tends to, cut to a largest speed. What of it is faster than the clearance
//! c permits, p = −nᵀu − ν c > 0, presses on the obstacle. It is turned aside, into a direction that is
//! latched when the point comes near:
//!
//! ```text
//! u′ = u + β p (n + κ t),  |u′| ≤ |u|        β: 0 at the edge of the range, 1 at contact
//! t = a × n                                  a: the latched axis of turning
//! f += Jᵀ Λ d (u′ − u),  Λ = (J M⁻¹Jᵀ)⁻¹    at every point, weighted by β p
//! ```
//!
//! So at contact nothing presses any more, the point follows the surface, and leaves it where the
//! task leads away. It is always turned in the same sense, also by neighbouring obstacles, so that it
//! leaves a hollow of the potential. But where the energy of the task is well below that at the choice
//! of the side, and the task leads back, κ fades away: the goal has been passed, and there is no going
//! around it. So it does at an obstacle that covers the goal: the body waits beside it. A side on which the body comes to rest, in a low hollow or because its
//! joints let it go no further, is given up for another. At a goal at rest u = 0 and nothing presses, however near
//! the obstacle. The steering does work: the energy of the
//! tree falls where nothing presses on an obstacle.

use core::ops::Range;

use glam::{DQuat, DVec3};
use nalgebra::{ArrayStorage, Matrix3, SMatrix, SVector, Vector1, Vector3};

use crate::leaves::CollisionAvoidance;
use crate::leaves::obstacle::{Clearance, Obstacle, Shape};
use crate::natural::{Factor, Natural};

/// Most obstacles that are steered around; the clearance is kept from any number.
pub const STEERED_CAPACITY: usize = 32;

/// β below which a point does not yet choose a side.
const LATCH_FRACTION: f64 = 0.02;
/// Sine of the angle to the normal below which a velocity does not tell a side.
const HEAD_ON: f64 = 0.15;
/// Sine of that angle at which a velocity the other way leads back.
const BACK: f64 = 0.3;
/// The energy of the task is well below that at the choice of the side from this fraction of it on; from
/// twice this fraction on it begins to be.
const LOW: f64 = 0.25;
/// A body that presses and moves by less than this fraction of |u| …
const REST_FRACTION: f64 = 0.05;
/// … for so long tries another side [s].
const REST_S: f64 = 0.5;
/// Clearance of the goal from an obstacle above which the obstacle is gone around; at none it covers
/// the goal [m].
const GOAL_CLEARANCE_M: f64 = 0.02;
/// Part of the mean of J M⁻¹Jᵀ's diagonal that is added to it: a point that cannot move in some
/// direction is not pushed there.
const TASK_DAMPING: f64 = 3e-3;

/// Motion of a point that is fixed to a body with N coordinates.
#[derive(Debug, Clone, Copy)]
pub struct PointMotion<const N: usize> {
    /// x \[m\].
    pub position: DVec3,
    /// ẋ \[m/s\].
    pub velocity: DVec3,
    /// J, 3×N.
    pub jacobian: SMatrix<f64, 3, N>,
    /// J̇q̇ \[m/s²\].
    pub drift: Vector3<f64>,
}

impl<const N: usize> PointMotion<N> {
    /// Not yet known.
    pub const UNDEFINED: Self = Self {
        position: DVec3::NAN,
        velocity: DVec3::NAN,
        jacobian: SMatrix::from_array_storage(ArrayStorage([[f64::NAN; 3]; N])),
        drift: Vector3::new(f64::NAN, f64::NAN, f64::NAN),
    };
}

/// Points of a body that stay where they are among each other, and a ball around their balls.
#[derive(Debug, Clone)]
pub struct Part {
    /// Centre \[m\].
    pub position: DVec3,
    /// Radius \[m\].
    pub radius: f64,
    /// Which points; they follow one another.
    pub points: Range<usize>,
}

/// The points of a body that keep clear, each the centre of a ball.
pub trait Body<const N: usize> {
    /// How many there are.
    fn count(&self) -> usize;
    /// How many parts the points make up: each its own, unless the body knows better.
    fn part_count(&self) -> usize {
        self.count()
    }
    /// Part `k`, below [`Body::part_count`]. A whole part is passed over where it is far from all.
    fn part(&self, k: usize) -> Part {
        let (position, radius) = self.ball(k);
        Part { position, radius, points: k..k + 1 }
    }
    /// Position \[m\] and radius \[m\] of point `i`, below [`Body::count`].
    fn ball(&self, i: usize) -> (DVec3, f64);
    /// Motion of point `i`.
    fn motion(&self, i: usize) -> PointMotion<N>;
    /// Clearance within which point `i` keeps clear of an obstacle of this shape, where that is less
    /// than the leaf's; 0 where it does not \[m\].
    fn acts_within(&self, i: usize, shape: &Shape) -> f64;
    /// Where point `i` is once the task is done, as far as that is known \[m\].
    fn at_goal(&self, i: usize) -> Option<DVec3>;
}

/// A ball that moves freely: its first coordinates are x, y and, where there are three, z.
#[derive(Debug, Clone, Copy)]
pub struct FreeBall {
    /// Centre \[m\].
    pub position: DVec3,
    /// Velocity \[m/s\].
    pub velocity: DVec3,
    /// Radius \[m\].
    pub radius: f64,
    /// Goal \[m\].
    pub goal: DVec3,
}

impl<const N: usize> Body<N> for FreeBall {
    fn count(&self) -> usize {
        1
    }

    fn ball(&self, _: usize) -> (DVec3, f64) {
        (self.position, self.radius)
    }

    fn motion(&self, _: usize) -> PointMotion<N> {
        PointMotion {
            position: self.position,
            velocity: self.velocity,
            jacobian: SMatrix::identity(),
            drift: Vector3::zeros(),
        }
    }

    fn acts_within(&self, _: usize, _: &Shape) -> f64 {
        f64::INFINITY
    }

    fn at_goal(&self, _: usize) -> Option<DVec3> {
        Some(self.goal)
    }
}

/// In which directions a body may go around an obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Side {
    /// In the plane: left or right.
    Plane,
    /// In space: where the task leads; if it leads nowhere, towards this direction.
    Space(DVec3),
}

/// How a body is led around obstacles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steering {
    /// Clearance within which it acts \[m\].
    pub range_m: f64,
    /// κ: how much faster than it pressed the body goes aside. It leaves hollows of the potential
    /// whose walls rise against it by up to arctan κ from the normal.
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

/// Avoidance of obstacles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Avoidance {
    /// What keeps the clearance.
    pub leaf: CollisionAvoidance,
    /// What leads around; `None` where the body shall wait.
    pub steering: Option<Steering>,
    /// Added to the radius of every point \[m\].
    pub margin_m: f64,
}

/// What the avoidance needs between ticks: the sides chosen at the obstacles nearby, and how the
/// body has fared since the last choice.
#[derive(Debug, Clone, Copy, Default)]
pub struct AvoidanceState {
    /// a for each obstacle.
    axes: [Option<DVec3>; STEERED_CAPACITY],
    /// V of the task when the first of them was chosen, or one was chosen anew.
    energy: f64,
    /// How long the body has been at rest though it presses \[s\].
    rest_s: f64,
}

/// What the avoidance saw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Proximity {
    /// Least clearance, margin taken off; infinite where there is nothing \[m\].
    pub clearance_min_m: f64,
    /// Largest fraction of the wanted velocity that pressed on an obstacle near it, β p/|u|: 0 to 1.
    pub obstructed_fraction: f64,
}

pub(crate) fn vector(v: DVec3) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

fn dvec(v: Vector3<f64>) -> DVec3 {
    DVec3::new(v.x, v.y, v.z)
}

impl Avoidance {
    /// Adds the leaves of all close pairs of a point and an obstacle, and the steering.
    ///
    /// * `root`  everything but obstacles
    /// * `free`  its acceleration; `factor` the decomposition of its metric
    /// * `task_energy`  V of the task, which falls towards its goal
    /// * `dt`  time since the last tick \[s\]
    ///
    /// Hot path: no allocation.
    #[expect(clippy::too_many_arguments, reason = "what a tick consists of")]
    pub fn add<const N: usize>(
        &self,
        body: &impl Body<N>,
        obstacles: &[Obstacle],
        free: &SVector<f64, N>,
        factor: &Factor<N>,
        task_energy: f64,
        dt: f64,
        root: &mut Natural<N>,
        state: &mut AvoidanceState,
    ) -> Proximity {
        let range = self.steering.map_or(0.0, |steering| steering.range_m);
        let reach = range.max(self.leaf.activation_distance_m);
        let mut seen = Proximity { clearance_min_m: f64::INFINITY, obstructed_fraction: 0.0 };
        // Of what presses: Σw, Σw |ẋ|/|u|.
        let (mut obstructed_sum, mut motion_sum) = (0.0, 0.0);
        for (k, obstacle) in obstacles.iter().enumerate() {
            let mut near = false;
            let mut open = None;
            let (mut sum, mut weight_sum) = (SVector::<f64, N>::zeros(), 0.0);
            for part in (0..body.part_count()).map(|k| body.part(k)) {
                // Nothing of a part is nearer than the ball around it.
                let limit = reach.max(seen.clearance_min_m);
                if obstacle.distance(part.position, part.radius + self.margin_m) >= limit {
                    continue;
                }
                for i in part.points {
                    let (position, radius) = body.ball(i);
                    let within = body.acts_within(i, &obstacle.shape);
                    if within <= 0.0 {
                        continue;
                    }
                    let distance = obstacle.distance(position, radius + self.margin_m);
                    seen.clearance_min_m = seen.clearance_min_m.min(distance);
                    if distance >= reach.min(within) {
                        continue;
                    }
                    let motion = body.motion(i);
                    let clearance = obstacle.clearance(
                        motion.position,
                        motion.velocity,
                        radius + self.margin_m,
                    );
                    add_clearance(&self.leaf.within(within), &clearance, &motion, root);
                    let Some(steering) = self.steering.filter(|s| distance < s.range_m) else {
                        continue;
                    };
                    if obstacle.shape == Shape::HalfSpace {
                        continue;
                    }
                    let relative = motion.velocity - obstacle.velocity_at(motion.position);
                    let wanted = steering.wanted(&motion, relative, free);
                    let beta = steering.fraction(distance);
                    near |= beta > 0.0;
                    let Some(speed) = steering.obstructed_speed(&clearance, wanted) else {
                        continue;
                    };
                    let weight = beta * speed;
                    obstructed_sum += weight;
                    motion_sum += weight * relative.length() / wanted.length();
                    let normal = clearance.normal;
                    let chosen = state.axis(k, &steering, normal, wanted, beta, task_energy);
                    let Some(axis) = chosen else { continue };
                    let open = *open.get_or_insert_with(|| self.goal_fraction(body, obstacle));
                    let persistence = state.persistence(normal, wanted, axis, task_energy);
                    let gain = steering.gain * persistence * open;
                    let aside = normal + axis.cross(normal) * gain;
                    let turned = (wanted + aside * weight).clamp_length_max(wanted.length());
                    let change = turned - wanted;
                    seen.obstructed_fraction =
                        seen.obstructed_fraction.max(weight / wanted.length());
                    let mut mobility = factor.mobility(&motion.jacobian);
                    mobility += Matrix3::identity() * (TASK_DAMPING * mobility.trace() / 3.0);
                    if let Some(task) = Factor::new(&mobility) {
                        let force = task.solve(&vector(change * steering.response_1_s));
                        sum += motion.jacobian.tr_mul(&force) * weight;
                        weight_sum += weight;
                    }
                }
            }
            if weight_sum > 0.0 {
                root.force += sum / weight_sum;
            }
            if let (Some(axis), false) = (state.axes.get_mut(k), near) {
                *axis = None;
            }
        }
        state.axes.iter_mut().skip(obstacles.len()).for_each(|axis| *axis = None);
        let rests = obstructed_sum > 0.0 && motion_sum < REST_FRACTION * obstructed_sum;
        state.rest_s = if rests { state.rest_s + dt } else { 0.0 };
        seen
    }
}

impl Avoidance {
    /// 0 where the obstacle covers the goal, 1 where the goal is well clear of it.
    fn goal_fraction<const N: usize>(&self, body: &impl Body<N>, obstacle: &Obstacle) -> f64 {
        let clearance = |i: usize| {
            let goal = body.at_goal(i).filter(|_| body.acts_within(i, &obstacle.shape) > 0.0)?;
            Some(obstacle.distance(goal, body.ball(i).1 + self.margin_m))
        };
        let least = (0..body.count()).filter_map(clearance).fold(f64::INFINITY, f64::min);
        (least / GOAL_CLEARANCE_M).clamp(0.0, 1.0)
    }
}

impl AvoidanceState {
    /// The axis of turning at obstacle `k`; `None` far from it or beyond [`STEERED_CAPACITY`].
    fn axis(
        &mut self,
        k: usize,
        steering: &Steering,
        normal: DVec3,
        wanted: DVec3,
        beta: f64,
        task_energy: f64,
    ) -> Option<DVec3> {
        let (turn, size) = (normal.cross(wanted), wanted.length());
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
            || (beta >= LATCH_FRACTION).then(|| steering.axis(normal, turn, size, inherited));
        self.axes[k] = anew.or(latched).or_else(first);
        self.axes[k]
    }

    /// Fraction of κ that remains: 0 where the energy is low and the task leads back, else 1.
    fn persistence(&self, normal: DVec3, wanted: DVec3, axis: DVec3, task_energy: f64) -> f64 {
        let size = wanted.length().max(f64::MIN_POSITIVE);
        let back = -normal.cross(wanted).dot(axis) / (BACK * size);
        let low = 2.0 - task_energy / (LOW * self.energy).max(f64::MIN_POSITIVE);
        1.0 - back.clamp(0.0, 1.0) * low.clamp(0.0, 1.0)
    }
}

impl Steering {
    /// u: the velocity a point tends to, relative to the obstacle, as `relative` is.
    fn wanted<const N: usize>(
        &self,
        motion: &PointMotion<N>,
        relative: DVec3,
        free: &SVector<f64, N>,
    ) -> DVec3 {
        let acceleration = dvec(motion.jacobian * free + motion.drift);
        (relative + acceleration / self.response_1_s).clamp_length_max(self.speed_max_m_s)
    }

    /// β.
    fn fraction(&self, distance: f64) -> f64 {
        let fraction = (1.0 - distance / self.range_m).clamp(0.0, 1.0);
        fraction * fraction * (3.0 - 2.0 * fraction)
    }

    /// p, `None` where nothing presses.
    fn obstructed_speed(&self, clearance: &Clearance, wanted: DVec3) -> Option<f64> {
        let permitted = self.approach_1_s * clearance.distance.max(0.0);
        let speed = -clearance.normal.dot(wanted) - permitted;
        (speed > 0.0 && speed.is_finite()).then_some(speed)
    }

    /// Another axis than this one: the opposite in the plane; in space, in four steps all around.
    fn other(&self, axis: DVec3, normal: DVec3) -> DVec3 {
        match self.side {
            Side::Plane => -axis,
            Side::Space(_) => DQuat::from_axis_angle(normal, core::f64::consts::FRAC_PI_2) * axis,
        }
    }

    /// The axis of turning for a velocity of length `size` with `turn` = n × u.
    fn axis(&self, normal: DVec3, turn: DVec3, size: f64, inherited: Option<DVec3>) -> DVec3 {
        let tells = turn.length() > HEAD_ON * size;
        match (self.side, inherited) {
            (_, Some(inherited)) if inherited.cross(normal).length() > 0.5 => inherited,
            (Side::Plane, _) if tells => DVec3::Z * turn.z.signum(),
            (Side::Plane, _) => DVec3::Z,
            (Side::Space(_), _) if tells => turn.normalize(),
            (Side::Space(preferred), _) => normal
                .cross(preferred)
                .try_normalize()
                .unwrap_or_else(|| normal.any_orthonormal_vector()),
        }
    }
}

/// Pulls a leaf on a clearance back to the body's coordinates, through the point whose clearance it
/// is.
pub fn add_clearance<const N: usize>(
    leaf: &CollisionAvoidance,
    clearance: &Clearance,
    motion: &PointMotion<N>,
    root: &mut Natural<N>,
) {
    if let Some(leaf) = leaf.evaluate(clearance.distance, clearance.rate) {
        let normal = vector(clearance.normal);
        let drift = normal.dot(&motion.drift) + clearance.curvature;
        let row = normal.transpose() * motion.jacobian;
        root.add_pullback(&leaf, &row, &Vector1::new(drift));
    }
}
