//! Frames as a task map: where the frames go, the space goes.
//!
//! The canonical space is the one in which all demonstrations share their frames. The map into the
//! world is a field of rigid displacements g(α) ∈ SE(3), with α a smooth ramp of the phase t along
//! the canonical axis from start to goal:
//!
//! ```text
//! t   = uᵀ(y_p − c_s)/D                 u = (c_g − c_s)/D,  D = |c_g − c_s|
//! c(α) = c_s + α (c_g − c_s)            p(α) = x_s + α (x_g − x_s)
//! R(α) = exp(α φ) Q_s                   φ = log(Q_g Q_s⁻¹)
//! x_p = p(α) + R(α) (y_p − c(α))        x_q = R(α) q_g exp(y_r)
//! ```
//!
//! c_s, c_g are the start frame's origin and the goal in canonical coordinates, x_s, x_g their
//! images in the world, Q_s, Q_g the rotations of the start and the goal frame against their
//! canonical orientation. At α = 0 it is the start frame's displacement, at α = 1 the goal frame's.
//! Positions need not turn with the frames: a tool that comes down on an object from above does so
//! wherever the object points. [`CanonicalFrames::positions_turn`] tells; without it R = I in the
//! line of x_p, while the line of x_q, and with it the grasp, still turns.
//! Orientation is charted by the full-angle rotation vector y_r at the canonical goal orientation.
//!
//! The map is a diffeomorphism where det = 1 + ∇αᵀ R(α)ᵀ ∂x/∂α > 0, i.e. unless the goal moves
//! back towards the start by more than 0.8 D, or space is twisted hard far from the axis. Below
//! [`DETERMINANT_MIN`] the Jacobian is evaluated with that value instead: the motion is no longer
//! exact there, but bounded, and [`Mapped::determinant`] tells.
//!
//! It is rheonomic: velocities and accelerations of the frames enter the velocity and the bias.

use glam::{DMat3, DQuat, DVec3};
use nalgebra::Vector6;

use crate::jet::{Jet, Quat, Real, Vec3};
use crate::rotation::{inverse_left_jacobian, rotation_vector};

/// Least determinant with which the map is inverted.
pub const DETERMINANT_MIN: f64 = 0.1;
/// Bound on the iterations of the inverse; Newton's method takes some five.
const INVERSE_ITERATIONS_MAX: usize = 60;
/// The inverse stops at this change of the phase.
const PHASE_TOLERANCE: f64 = 1e-13;

/// Position \[m\] and orientation (unit quaternion).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Origin \[m\].
    pub position: DVec3,
    /// Orientation.
    pub orientation: DQuat,
}

impl Pose {
    /// No displacement.
    pub const IDENTITY: Self = Self { position: DVec3::ZERO, orientation: DQuat::IDENTITY };
    /// No pose at all: equal to none, not even to itself.
    pub(crate) const UNDEFINED: Self = Self { position: DVec3::NAN, orientation: DQuat::NAN };

    /// X_AC = X_AB X_BC.
    #[must_use]
    pub fn compose(&self, other: &Self) -> Self {
        Self {
            position: self.position + self.orientation * other.position,
            orientation: self.orientation * other.orientation,
        }
    }

    /// X_BA from X_AB.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let orientation = self.orientation.conjugate();
        Self { position: -(orientation * self.position), orientation }
    }

    /// Rotation vector of `self` relative to `other`, expressed in the common base \[rad\].
    #[must_use]
    pub fn rotation_from(&self, other: &Self) -> DVec3 {
        rotation_vector(self.orientation * other.orientation.conjugate())
    }
}

/// A frame with its motion, all expressed in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameMotion {
    /// Pose.
    pub pose: Pose,
    /// Velocity of the origin \[m/s\].
    pub linear_velocity: DVec3,
    /// Angular velocity \[rad/s\].
    pub angular_velocity: DVec3,
    /// Acceleration of the origin \[m/s²\].
    pub linear_acceleration: DVec3,
    /// Angular acceleration \[rad/s²\].
    pub angular_acceleration: DVec3,
}

impl FrameMotion {
    /// A frame at rest.
    #[must_use]
    pub fn at_rest(pose: Pose) -> Self {
        Self {
            pose,
            linear_velocity: DVec3::ZERO,
            angular_velocity: DVec3::ZERO,
            linear_acceleration: DVec3::ZERO,
            angular_acceleration: DVec3::ZERO,
        }
    }

    /// The motion of a frame that is fixed to this one, `offset` as seen from it.
    #[must_use]
    pub fn carrying(&self, offset: &Pose) -> Self {
        let lever = self.pose.orientation * offset.position;
        let (rate, bend) = (self.angular_velocity, self.angular_acceleration);
        Self {
            pose: self.pose.compose(offset),
            linear_velocity: self.linear_velocity + rate.cross(lever),
            linear_acceleration: self.linear_acceleration
                + bend.cross(lever)
                + rate.cross(rate.cross(lever)),
            ..*self
        }
    }
}

/// The frames all demonstrations share in canonical coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CanonicalFrames {
    /// Start frame; its origin is c_s.
    pub start: Pose,
    /// Goal frame, e.g. that of the object.
    pub goal_frame: Pose,
    /// The goal, e.g. the grasp; its position is c_g and its orientation q_g.
    pub goal: Pose,
    /// Whether the way to the goal turns with the frames.
    pub positions_turn: bool,
}

/// Why the canonical frames make no map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameMapError {
    /// Start and goal coincide, so that there is no axis between them.
    NoAxis,
}

/// A point in canonical coordinates: position \[m\] and orientation chart \[rad\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Canonical {
    /// y_p, or its time derivative.
    pub position: DVec3,
    /// y_r, or its time derivative.
    pub rotation: DVec3,
}

/// What the map says about a moving pose in the world.
#[derive(Debug, Clone, Copy)]
pub struct Mapped {
    /// y.
    pub point: Canonical,
    /// ẏ.
    pub velocity: Canonical,
    /// ∂y_p/∂x_p, the upper left block of J = ∂y/∂x.
    pub position_jacobian: DMat3,
    /// ∂y_r/∂x_p, its lower left block; the upper right is zero.
    pub cross_jacobian: DMat3,
    /// ∂y_r/∂(angular displacement), its lower right block.
    pub rotation_jacobian: DMat3,
    /// Linear part of b, the acceleration of x for ÿ = 0 \[m/s²\].
    pub linear_bias: DVec3,
    /// Angular part of b \[rad/s²\].
    pub angular_bias: DVec3,
    /// Determinant of the map's position part, before [`DETERMINANT_MIN`].
    pub determinant: f64,
}

impl Mapped {
    /// b on \[linear; angular\].
    #[must_use]
    pub fn bias(&self) -> Vector6<f64> {
        let (l, a) = (self.linear_bias, self.angular_bias);
        Vector6::new(l.x, l.y, l.z, a.x, a.y, a.z)
    }
}

/// The map of a skill: canonical frames, axis and ramp. Immutable.
#[derive(Debug, Clone, Copy)]
pub struct FrameMap {
    canonical: CanonicalFrames,
    axis: DVec3,
    length: f64,
}

/// The frames as they are now, ready to map with.
#[derive(Debug, Clone, Copy)]
pub struct Displacement {
    start_image: Vec3<Jet>,
    goal_image: Vec3<Jet>,
    start_rotation: Quat<Jet>,
    twist: Vec3<Jet>,
    moving: bool,
}

/// The ramp α and its first two derivatives: 0 at t = 0, 1 at t = 1, slope at most 1.25.
fn ramp(t: f64) -> [f64; 3] {
    const LOWER: f64 = 0.1;
    const UPPER: f64 = 0.9;
    const WIDTH: f64 = 0.08;
    let soft_plus = |z: f64| z.max(0.0) + (-z.abs()).exp().ln_1p();
    let integral = |t: f64| {
        0.5 * WIDTH * (soft_plus(2.0 * (t - LOWER) / WIDTH) - soft_plus(2.0 * (t - UPPER) / WIDTH))
    };
    let (lower, upper) = (((t - LOWER) / WIDTH).tanh(), ((t - UPPER) / WIDTH).tanh());
    let scale = 1.0 / (integral(1.0) - integral(0.0));
    [
        (integral(t) - integral(0.0)) * scale,
        0.5 * (lower - upper) * scale,
        0.5 * (upper * upper - lower * lower) / WIDTH * scale,
    ]
}

/// a bᵀ.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

impl FrameMap {
    /// The map of these canonical frames.
    ///
    /// # Errors
    /// When start and goal coincide.
    pub fn new(canonical: CanonicalFrames) -> Result<Self, FrameMapError> {
        let axis = canonical.goal.position - canonical.start.position;
        let length = axis.length();
        if length.is_nan() || length <= 1e-6 {
            return Err(FrameMapError::NoAxis);
        }
        Ok(Self { canonical, axis: axis / length, length })
    }

    /// Its canonical frames.
    #[must_use]
    pub fn canonical(&self) -> &CanonicalFrames {
        &self.canonical
    }

    /// Takes in where the frames are and how they move.
    #[must_use]
    pub fn displace(&self, start: &FrameMotion, goal_frame: &FrameMotion) -> Displacement {
        let rotation = |frame: &FrameMotion, canonical: &Pose| {
            Quat::moving(
                frame.pose.orientation * canonical.orientation.conjugate(),
                frame.angular_velocity,
                frame.angular_acceleration,
            )
        };
        let origin = |frame: &FrameMotion| {
            Vec3::moving(frame.pose.position, frame.linear_velocity, frame.linear_acceleration)
        };
        let start_rotation = rotation(start, &self.canonical.start);
        let goal_rotation = rotation(goal_frame, &self.canonical.goal_frame);
        let lever = self.canonical.goal.position - self.canonical.goal_frame.position;
        let motions = [start, goal_frame].map(|f| {
            f.linear_velocity.length_squared()
                + f.angular_velocity.length_squared()
                + f.linear_acceleration.length_squared()
                + f.angular_acceleration.length_squared()
        });
        Displacement {
            start_image: origin(start),
            goal_image: origin(goal_frame).plus(goal_rotation.rotate(Vec3::constant(lever))),
            start_rotation,
            twist: goal_rotation.times(start_rotation.conjugate()).log(),
            moving: motions != [0.0, 0.0],
        }
    }

    /// Takes in where the only frame of a skill is and how it moves: the start is fixed to it, and
    /// the whole space moves with it.
    #[must_use]
    pub fn displace_rigidly(&self, frame: &FrameMotion) -> Displacement {
        let start = self.canonical.goal_frame.inverse().compose(&self.canonical.start);
        self.displace(&frame.carrying(&start), frame)
    }

    /// Where a canonical point lies in the world.
    #[must_use]
    pub fn forward(&self, displacement: &Displacement, y: &Canonical) -> Pose {
        let (x, q) =
            self.forward_in(displacement, Vec3(y.position.to_array()), Vec3(y.rotation.to_array()));
        Pose {
            position: DVec3::from_array(x.0),
            orientation: DQuat::from_xyzw(q.v.0[0], q.v.0[1], q.v.0[2], q.w),
        }
    }

    fn forward_in<S: Real + FromJet>(
        &self,
        d: &Displacement,
        position: Vec3<S>,
        rotation: Vec3<S>,
    ) -> (Vec3<S>, Quat<S>) {
        let start = Vec3::<S>::constant(self.canonical.start.position);
        let along = Vec3::<S>::constant(self.axis / self.length);
        let phase = along.dot(position.minus(start));
        let alpha = phase.chain(ramp(phase.value()));
        let (start_image, goal_image) = (S::vector(d.start_image), S::vector(d.goal_image));
        let image = start_image.plus(goal_image.minus(start_image).times(alpha));
        let turn =
            Quat::exp(S::vector(d.twist).times(alpha)).times(S::quaternion(d.start_rotation));
        let axis = Vec3::<S>::constant(self.axis * self.length);
        let center = start.plus(axis.times(alpha));
        let goal = Quat::<S>::constant(self.canonical.goal.orientation);
        let arm = position.minus(center);
        let arm = if self.canonical.positions_turn { turn.rotate(arm) } else { arm };
        (image.plus(arm), turn.times(goal).times(Quat::exp(rotation)))
    }

    /// The canonical point of a pose in the world; `phase` is the phase of the last call, from
    /// which the search starts, and is replaced by the new one.
    #[must_use]
    pub fn inverse(&self, d: &Displacement, pose: &Pose, phase: &mut f64) -> Canonical {
        let (t, position, turn) = self.invert_position(d, pose.position, *phase);
        *phase = t;
        let chart = self.canonical.goal.orientation.conjugate() * turn.conjugate();
        Canonical { position, rotation: rotation_vector(chart * pose.orientation) }
    }

    /// R(α) and φ in the line of x_p.
    fn turn_of_positions(&self, turn: DQuat, twist: DVec3) -> (DQuat, DVec3) {
        if self.canonical.positions_turn { (turn, twist) } else { (DQuat::IDENTITY, DVec3::ZERO) }
    }

    /// Solves t = uᵀ(y_p(t) − c_s)/D by Newton's method, safeguarded by bisection.
    fn invert_position(&self, d: &Displacement, x: DVec3, guess: f64) -> (f64, DVec3, DQuat) {
        let (start_image, goal_image, twist, start_rotation) = d.values();
        let span = goal_image - start_image;
        let reach = ((x - start_image).length() + span.length()) / self.length;
        let (mut lower, mut upper) = (-reach - 1.2, reach + 1.2);
        let mut t = if guess > lower && guess < upper { guess } else { 0.5 };
        let at = |t: f64| {
            let [alpha, slope, _] = ramp(t);
            let turn = DQuat::from_scaled_axis(twist * alpha) * start_rotation;
            let arm = x - start_image - span * alpha;
            let (turning, twisting) = self.turn_of_positions(turn, twist);
            let local = turning.conjugate() * arm;
            let residual = t - alpha - self.axis.dot(local) / self.length;
            let change = turning.conjugate() * (twisting.cross(arm) + span);
            let derivative = 1.0 - slope * (1.0 - self.axis.dot(change) / self.length);
            (residual, derivative, alpha, local, turn)
        };
        let mut now = at(t);
        for _ in 0..INVERSE_ITERATIONS_MAX {
            if now.0 > 0.0 {
                upper = t;
            } else {
                lower = t;
            }
            let newton = t - now.0 / now.1;
            let next =
                if newton > lower && newton < upper { newton } else { 0.5 * (lower + upper) };
            let change = (next - t).abs();
            t = next;
            now = at(t);
            if change < PHASE_TOLERANCE {
                break;
            }
        }
        let (_, _, alpha, local, turn) = now;
        (t, self.canonical.start.position + self.axis * (alpha * self.length) + local, turn)
    }

    /// Maps a moving pose: point, velocity, Jacobian and bias.
    ///
    /// * `linear`, `angular`  velocity of the pose in the world \[m/s, rad/s\]
    /// * `phase`  as in [`FrameMap::inverse`]
    ///
    /// With ẋ = F ẏ + ∂x/∂t and J = F⁻¹: ẏ = J (ẋ − ∂x/∂t) and ẍ = F ÿ + b.
    ///
    /// Hot path: no allocation. Input that is not finite gives output that is not finite.
    #[must_use]
    pub fn map(
        &self,
        d: &Displacement,
        pose: &Pose,
        linear: DVec3,
        angular: DVec3,
        phase: &mut f64,
    ) -> Mapped {
        let point = self.inverse(d, pose, phase);
        let [alpha, slope, _] = ramp(*phase);
        let (start_image, goal_image, twist, start_rotation) = d.values();
        let turn = DQuat::from_scaled_axis(twist * alpha) * start_rotation;
        let (turning, twisting) = self.turn_of_positions(turn, twist);
        let turn_back = DMat3::from_quat(turn.conjugate());
        let turning_back = DMat3::from_quat(turning.conjugate());
        let arm = pose.position - start_image - (goal_image - start_image) * alpha;
        // ∂x/∂α at fixed y, in the world and in canonical orientation.
        let along =
            goal_image - start_image + twisting.cross(arm) - turning * (self.axis * self.length);
        let along_canonical = turning_back * along;
        let gradient = self.axis * (slope / self.length);
        let determinant = 1.0 + gradient.dot(along_canonical);
        // Sherman–Morrison on F_pp = R (I + along ∇αᵀ).
        let floored = determinant.max(DETERMINANT_MIN);
        let position_jacobian =
            (DMat3::IDENTITY - outer(along_canonical, gradient) * (1.0 / floored)) * turning_back;
        let to_chart = DMat3::from_quat(self.canonical.goal.orientation.conjugate()) * turn_back;
        let rotation_jacobian = inverse_left_jacobian(point.rotation) * to_chart;
        let cross_jacobian = -(rotation_jacobian * outer(twist, gradient)) * position_jacobian;

        let (mut linear_left, mut angular_left) = (linear, angular);
        if d.moving {
            let still = (
                Vec3::moving(point.position, DVec3::ZERO, DVec3::ZERO),
                Vec3::moving(point.rotation, DVec3::ZERO, DVec3::ZERO),
            );
            let (x, q) = self.forward_in(d, still.0, still.1);
            linear_left -= x.first();
            angular_left -= q.angular_motion().0;
        }
        let velocity = Canonical {
            position: position_jacobian * linear_left,
            rotation: rotation_jacobian * angular_left + cross_jacobian * linear_left,
        };
        let (x, q) = self.forward_in(
            d,
            Vec3::moving(point.position, velocity.position, DVec3::ZERO),
            Vec3::moving(point.rotation, velocity.rotation, DVec3::ZERO),
        );
        Mapped {
            point,
            velocity,
            position_jacobian,
            cross_jacobian,
            rotation_jacobian,
            linear_bias: x.second(),
            angular_bias: q.angular_motion().1,
            determinant,
        }
    }
}

impl Displacement {
    fn values(&self) -> (DVec3, DVec3, DVec3, DQuat) {
        let vector = |v: Vec3<Jet>| DVec3::from_array(v.0.map(Real::value));
        let [x, y, z] = self.start_rotation.v.0.map(Real::value);
        let rotation = DQuat::from_xyzw(x, y, z, self.start_rotation.w.value());
        (vector(self.start_image), vector(self.goal_image), vector(self.twist), rotation)
    }
}

/// Jets as they are, or only their values.
trait FromJet: Sized {
    fn from_jet(jet: Jet) -> Self;
    fn vector(v: Vec3<Jet>) -> Vec3<Self> {
        Vec3(v.0.map(Self::from_jet))
    }
    fn quaternion(q: Quat<Jet>) -> Quat<Self> {
        Quat { w: Self::from_jet(q.w), v: Self::vector(q.v) }
    }
}

impl FromJet for Jet {
    fn from_jet(jet: Jet) -> Self {
        jet
    }
}

impl FromJet for f64 {
    fn from_jet(jet: Jet) -> Self {
        jet.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(position: [f64; 3], rotation: [f64; 3]) -> Pose {
        Pose { position: position.into(), orientation: DQuat::from_scaled_axis(rotation.into()) }
    }

    fn maps() -> [FrameMap; 2] {
        [true, false].map(map_that_turns)
    }

    fn map_that_turns(positions_turn: bool) -> FrameMap {
        FrameMap::new(CanonicalFrames {
            positions_turn,
            start: pose([0.4, 0.1, 0.3], [0.0, 0.2, 0.1]),
            goal_frame: pose([0.5, -0.25, 0.03], [0.0, 0.0, 0.3]),
            goal: pose([0.505, -0.248, 0.058], [3.0, 0.1, 0.2]),
        })
        .unwrap()
    }

    /// Frames on a curve in time, with their exact motion by construction.
    fn frames(t: f64) -> (FrameMotion, FrameMotion) {
        let start = FrameMotion {
            pose: Pose {
                position: DVec3::new(0.42 + 0.05 * t, 0.12 - 0.1 * t * t, 0.31),
                orientation: DQuat::from_scaled_axis(
                    DVec3::new(0.0, 0.1, 0.2) + DVec3::Z * 0.3 * t,
                ),
            },
            linear_velocity: DVec3::new(0.05, -0.2 * t, 0.0),
            angular_velocity: DVec3::ZERO,
            linear_acceleration: DVec3::new(0.0, -0.2, 0.0),
            angular_acceleration: DVec3::ZERO,
        };
        let spin = 0.8 * t + 0.1 * t * t;
        let goal = FrameMotion {
            pose: Pose {
                position: DVec3::new(0.5 + 0.15 * t.sin(), -0.25 + 0.15 * t.cos(), 0.03 + 0.02 * t),
                orientation: DQuat::from_rotation_z(spin) * DQuat::from_rotation_x(0.2),
            },
            linear_velocity: DVec3::new(0.15 * t.cos(), -0.15 * t.sin(), 0.02),
            angular_velocity: DVec3::Z * (0.8 + 0.2 * t),
            linear_acceleration: DVec3::new(-0.15 * t.sin(), -0.15 * t.cos(), 0.0),
            angular_acceleration: DVec3::Z * 0.2,
        };
        // The start frame's rotation vector moves: take its motion from its quaternion.
        let h = 1e-4;
        let q = |t: f64| DQuat::from_scaled_axis(DVec3::new(0.0, 0.1, 0.2) + DVec3::Z * 0.3 * t);
        let omega = |t: f64| rotation_vector(q(t + h) * q(t - h).conjugate()) / (2.0 * h);
        let start = FrameMotion {
            angular_velocity: omega(t),
            angular_acceleration: (omega(t + h) - omega(t - h)) / (2.0 * h),
            ..start
        };
        (start, goal)
    }

    fn points() -> impl Iterator<Item = Canonical> {
        (0..60).map(|i| {
            let s = f64::from(i);
            Canonical {
                position: DVec3::new(
                    0.45 + 0.2 * (s * 1.7).sin(),
                    -0.1 + 0.35 * (s * 0.9).cos(),
                    0.2 + 0.15 * (s * 0.37).sin(),
                ),
                rotation: DVec3::new((s * 0.3).sin(), 0.8 * (s * 0.7).cos(), 0.5 - 0.01 * s),
            }
        })
    }

    #[test]
    fn ramp_is_flat_outside_and_its_derivatives_are_right() {
        assert!(ramp(0.0)[0].abs() < 1e-15 && (ramp(1.0)[0] - 1.0).abs() < 1e-15);
        assert!(ramp(-2.0)[1].abs() < 1e-9 && ramp(3.0)[1].abs() < 1e-9);
        let h = 1e-6;
        for i in -10..30 {
            let t = 0.07 * f64::from(i);
            let [_, slope, bend] = ramp(t);
            assert!((slope - (ramp(t + h)[0] - ramp(t - h)[0]) / (2.0 * h)).abs() < 1e-8);
            assert!((bend - (ramp(t + h)[1] - ramp(t - h)[1]) / (2.0 * h)).abs() < 1e-7);
            assert!((-1e-12..=1.26).contains(&slope));
        }
    }

    #[test]
    fn canonical_frames_map_to_themselves_and_moved_ones_move_their_points() {
        maps().iter().for_each(check_images);
    }

    fn check_images(map: &FrameMap) {
        let canonical = *map.canonical();
        let still = map.displace(
            &FrameMotion::at_rest(canonical.start),
            &FrameMotion::at_rest(canonical.goal_frame),
        );
        for y in points() {
            assert!((map.forward(&still, &y).position - y.position).length() < 1e-14);
        }
        let (start, goal) = frames(0.3);
        let moved = map.displace(&start, &goal);
        let goal_point = Canonical { position: canonical.goal.position, rotation: DVec3::ZERO };
        let image = map.forward(&moved, &goal_point);
        let expected = goal.pose.compose(&canonical.goal_frame.inverse().compose(&canonical.goal));
        assert!((image.position - expected.position).length() < 1e-12);
        assert!(image.rotation_from(&expected).length() < 1e-12);
        assert!((moved.values().1 - expected.position).length() < 1e-12);
    }

    #[test]
    fn inverse_undoes_forward_from_any_guess() {
        maps().iter().for_each(check_inverse);
    }

    fn check_inverse(map: &FrameMap) {
        let (start, goal) = frames(0.5);
        let d = map.displace(&start, &goal);
        for y in points() {
            let pose = map.forward(&d, &y);
            for guess in [-3.0, 0.0, 0.5, 1.0, 4.0, f64::NAN] {
                let mut phase = guess;
                let back = map.inverse(&d, &pose, &mut phase);
                assert!((back.position - y.position).length() < 1e-11);
                assert!((back.rotation - y.rotation).length() < 1e-11);
            }
        }
    }

    /// Follows x(t) = forward(frames(t), y(t)) for a straight y(t) and compares what the map says
    /// at t = 0.4 with finite differences: velocity, Jacobian and bias at once.
    #[test]
    fn velocity_and_bias_agree_with_finite_differences() {
        maps().iter().for_each(check_derivatives);
    }

    fn check_derivatives(map: &FrameMap) {
        let t0 = 0.4;
        for (i, y) in points().enumerate() {
            let s = i as f64;
            let rate = Canonical {
                position: DVec3::new((s * 0.8).cos(), 0.7 * (s * 0.3).sin(), -0.4),
                rotation: DVec3::new(0.5, (s * 0.45).sin(), -0.8 * (s * 0.2).cos()),
            };
            let at = |t: f64| {
                let (start, goal) = frames(t0 + t);
                let moved = Canonical {
                    position: y.position + rate.position * t,
                    rotation: y.rotation + rate.rotation * t,
                };
                map.forward(&map.displace(&start, &goal), &moved)
            };
            let h = 1e-4;
            let (before, now, after) = (at(-h), at(0.0), at(h));
            let linear = (after.position - before.position) / (2.0 * h);
            let angular = after.rotation_from(&before) / (2.0 * h);
            let linear_acceleration =
                (after.position - 2.0 * now.position + before.position) / (h * h);
            let angular_acceleration =
                (after.rotation_from(&now) - now.rotation_from(&before)) / (h * h);
            let (start, goal) = frames(t0);
            let mapped = map.map(&map.displace(&start, &goal), &now, linear, angular, &mut 0.5);
            assert!(mapped.determinant > DETERMINANT_MIN);
            let velocity_error = (mapped.velocity.position - rate.position).length()
                + (mapped.velocity.rotation - rate.rotation).length();
            assert!(velocity_error < 1e-6, "{velocity_error:e}");
            let bias_error = (mapped.linear_bias - linear_acceleration).length()
                + (mapped.angular_bias - angular_acceleration).length();
            assert!(bias_error < 1e-5, "{bias_error:e}");
        }
    }

    #[test]
    fn no_axis_is_refused() {
        let mut frames = *map_that_turns(true).canonical();
        frames.goal.position = frames.start.position;
        assert_eq!(FrameMap::new(frames).unwrap_err(), FrameMapError::NoAxis);
    }
}
