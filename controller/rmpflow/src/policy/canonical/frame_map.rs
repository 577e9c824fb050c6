//! Frames as a task map: where the frames go, the space goes.
//!
//! The canonical space is the one in which all demonstrations share their frames. The map into the
//! world is a field of rigid transforms over the phase s of the skill. Each frame n applies at a phase
//! s_n of its own, the start frame at 0, the goal frame at 1; in between its transform passes smoothly
//! into the next one's:
//!
//! ```text
//! α_n  = ramp((s − s_n)/(s_{n+1} − s_n))
//! c(s) = c_1 + Σ α_n (c_{n+1} − c_n)          p(s) = x_1 + Σ α_n (x_{n+1} − x_n)
//! R(s) = exp(α_{P−1} φ_{P−1}) … exp(α_1 φ_1) Q_1        φ_n = log(Q_{n+1} Q_n⁻¹)
//! x_p  = p(s) + R(s) (y_p − c(s))              x_q = R(s) q_g exp(y_r)
//! ```
//!
//! c_n is a point fixed to frame n in canonical coordinates, x_n its image in the world, Q_n the
//! rotation of the frame against its canonical orientation. Where all α before n are 1 and all others
//! 0, this is the transform of frame n. Positions need not rotate with the frames: a tool that comes
//! down on an object from above does so whatever the object's yaw. Without
//! [`FrameMap::rotate_positions`] R = I in the line of x_p, while the line of x_q, and with it the grasp,
//! still rotates. Orientation is charted by the full-angle rotation vector y_r at the
//! canonical goal orientation.
//!
//! Because the phase is a coordinate and not a function of the place, (y, s) ↦ (x, s) is a
//! diffeomorphism for any translation and any rotation, with determinant one in the lines of x_p: for a
//! given phase it is a rigid motion, and nothing folds.
//!
//! Where demonstrations show how the path changes with its goal, y is shifted: see
//! [`crate::policy::canonical::adaptation`].
//!
//! It is rheonomic: velocities and accelerations of the frames enter the velocity and the drift.

use glam::{DMat3, DQuat, DVec3};

use crate::policy::canonical::adaptation::Adaptation;
use crate::policy::value::FRAME_CAPACITY;
use tprmp_spatial::jet::{Jet, Quat, Real, Vec3};
use tprmp_spatial::rotation::inverse_left_jacobian;
use tprmp_spatial::{MovingPose, Pose};

/// Frames apply at phases that lie at least this far apart: between them space moves with the phase.
pub const PHASE_DISTANCE_MIN: f64 = 0.05;
/// Fraction of the phase between two frames over which the change from one's transform to the other's
/// gains its speed.
const RISE: f64 = 0.2;

/// A frame of a skill in canonical coordinates, and the phase at which it applies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anchor {
    /// Which of the skill's frames it is.
    pub index: usize,
    /// The frame.
    pub frame: Pose,
    /// c_n, fixed to the frame \[m\].
    pub point: DVec3,
    /// s_n.
    pub phase: f64,
}

/// Why the anchors make no map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameMapError {
    /// There is no anchor, or there are more than [`FRAME_CAPACITY`].
    AnchorCount(usize),
    /// The anchor applies less than [`PHASE_DISTANCE_MIN`] after the one before it, or not at a finite
    /// phase.
    PhasesTooClose(usize),
}

/// A point in canonical coordinates: position \[m\] and orientation chart \[rad\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Canonical {
    /// y_p, or its time derivative.
    pub position: DVec3,
    /// y_r, or its time derivative.
    pub rotation: DVec3,
}

/// A moving position or orientation of the world, mapped at a moving phase; y is its position \[m\] or its orientation chart \[rad\] in canonical coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Mapped {
    /// y.
    pub point: DVec3,
    /// ẏ.
    pub velocity: DVec3,
    /// ÿ for ẍ = 0 and s̈ = 0.
    pub drift: DVec3,
    /// ∂y/∂(linear or angular displacement).
    pub jacobian: DMat3,
    /// ∂y/∂s.
    pub phase_derivative: DVec3,
}

/// The map of a skill. Immutable.
#[derive(Debug, Clone, Copy)]
pub struct FrameMap {
    anchors: [Anchor; FRAME_CAPACITY],
    count: usize,
    goal: Pose,
    /// The goal seen from the frame it is fixed to.
    grasp: Pose,
    rotate_positions: bool,
    adaptation: Option<Adaptation>,
}

/// The frames as they are now, ready to map with.
#[derive(Debug, Clone, Copy)]
pub struct FrameTransforms {
    /// x_n.
    images: [Vec3<Jet>; FRAME_CAPACITY],
    /// φ_n.
    twists: [Vec3<Jet>; FRAME_CAPACITY],
    /// Q_1.
    rotation: Quat<Jet>,
    /// u.
    shift: [Vec3<Jet>; 2],
}

/// A smooth step from 0 at t = 0 to 1 at t = 1, and its first two derivatives: constant outside, its
/// slope rises within `rise` of either end to 1/(1 − rise) and is constant between.
///
/// * `rise`  above 0, at most ½
#[must_use]
pub fn ramp(t: f64, rise: f64) -> [f64; 3] {
    let speed = 1.0 / (1.0 - rise);
    if t > 0.5 {
        let [value, first, second] = ramp(1.0 - t, rise);
        return [1.0 - value, first, -second];
    }
    let u = (t / rise).max(0.0);
    if u >= 1.0 {
        return [speed * (t - 0.5 * rise), speed, 0.0];
    }
    // The slope is u² (3 − 2u), so that its own slope is zero at either end of the rise.
    [
        speed * rise * u * u * u * (1.0 - 0.5 * u),
        speed * u * u * (3.0 - 2.0 * u),
        speed / rise * 6.0 * u * (1.0 - u),
    ]
}

/// p(s), c(s) and R(s): the space as the frames transport it to a phase, see [`FrameMap::at`].
#[derive(Debug, Clone, Copy)]
pub struct Transported<'a, S> {
    image: Vec3<S>,
    centre: Vec3<S>,
    rotation: Quat<S>,
    /// p′, c′, and the rate of R over the phase as a rotation vector in the world.
    rates: [DVec3; 3],
    /// The rotation from the world to canonical axes where positions rotate, otherwise none.
    positions_back: Option<Quat<S>>,
    /// From the world into the axes of q_g.
    to_goal: Quat<S>,
    /// How the path adapts, u and the phase.
    adaptation: Option<(&'a Adaptation, [Vec3<S>; 2], S)>,
}

impl FrameMap {
    /// The map of these anchors in the order of their phases; the goal is fixed to the last one's frame.
    ///
    /// * `goal`  in canonical coordinates, e.g. the grasp; its orientation is q_g
    /// * `rotate_positions`  whether the path to the goal rotates with the frames
    ///
    /// # Errors
    /// When there are no anchors or too many, or their phases are not in order.
    pub fn new(
        anchors: &[Anchor],
        goal: Pose,
        rotate_positions: bool,
    ) -> Result<Self, FrameMapError> {
        let count = anchors.len();
        let Some(last) = anchors.last().filter(|_| count <= FRAME_CAPACITY) else {
            return Err(FrameMapError::AnchorCount(count));
        };
        for (i, pair) in anchors.windows(2).enumerate() {
            let distance = pair[1].phase - pair[0].phase;
            if !(distance.is_finite() && distance >= PHASE_DISTANCE_MIN) {
                return Err(FrameMapError::PhasesTooClose(i + 1));
            }
        }
        let mut stored = [*last; FRAME_CAPACITY];
        stored[..count].copy_from_slice(anchors);
        let grasp = last.frame.inverse().compose(&goal);
        Ok(Self { anchors: stored, count, goal, grasp, rotate_positions, adaptation: None })
    }

    /// The same map, whose path adapts to its goal; it should have two anchors, since an adapted path
    /// does not pass a frame in between.
    #[must_use]
    pub fn with_adaptation(mut self, adaptation: Option<Adaptation>) -> Self {
        self.adaptation = adaptation;
        self
    }

    /// How the path adapts to its goal.
    #[must_use]
    pub fn adaptation(&self) -> Option<&Adaptation> {
        self.adaptation.as_ref()
    }

    /// Its anchors in the order of their phases; the goal is fixed to the last one's frame.
    #[must_use]
    pub fn anchors(&self) -> &[Anchor] {
        &self.anchors[..self.count]
    }

    /// The frame to which the goal is fixed, in canonical coordinates.
    #[must_use]
    pub fn goal_frame(&self) -> Pose {
        self.anchors[self.count - 1].frame
    }

    /// The goal in canonical coordinates.
    #[must_use]
    pub fn goal(&self) -> Pose {
        self.goal
    }

    /// Whether the path to the goal rotates with the frames.
    #[must_use]
    pub fn rotate_positions(&self) -> bool {
        self.rotate_positions
    }

    /// How many frames it takes.
    #[must_use]
    pub fn frame_count(&self) -> usize {
        self.anchors().iter().map(|anchor| anchor.index + 1).max().unwrap_or(0)
    }

    /// The goal for these frames, in the world; `None` when there are too few.
    #[must_use]
    pub fn goal_among(&self, frames: &[MovingPose]) -> Option<Pose> {
        let anchor = &self.anchors[self.count - 1];
        Some(frames.get(anchor.index)?.pose.compose(&self.grasp))
    }

    /// The transforms of these moving frames; `None` when there are too few.
    #[inline]
    #[must_use]
    pub fn transforms(&self, frames: &[MovingPose]) -> Option<FrameTransforms> {
        if frames.len() < self.frame_count() {
            return None;
        }
        let zero = Vec3::constant(DVec3::ZERO);
        let mut transforms = FrameTransforms {
            images: [zero; FRAME_CAPACITY],
            twists: [zero; FRAME_CAPACITY],
            rotation: Quat::constant(DQuat::IDENTITY),
            shift: [zero; 2],
        };
        let mut before = transforms.rotation;
        for (p, anchor) in self.anchors().iter().enumerate() {
            let frame = &frames[anchor.index];
            let rotation = frame.pose.orientation * anchor.frame.orientation.conjugate();
            let arm = rotation * (anchor.point - anchor.frame.position);
            transforms.images[p] = frame.fixed_point(arm);
            let rotation =
                Quat::moving(rotation, frame.velocity.angular, frame.acceleration.angular);
            if p == 0 {
                transforms.rotation = rotation;
            } else {
                transforms.twists[p - 1] = rotation.times(before.conjugate()).log();
            }
            before = rotation;
        }
        if let Some(adaptation) = &self.adaptation {
            let shift = self.shift(&transforms, before);
            transforms.shift = Adaptation::bounded(adaptation.reach, shift);
        }
        Some(transforms)
    }

    /// δ_p, δ_r: translation and rotation of the goal frame against the start frame, seen from the
    /// latter.
    ///
    /// * `last`  the rotation of the goal frame
    fn shift(&self, d: &FrameTransforms, last: Quat<Jet>) -> [Vec3<Jet>; 2] {
        let back = d.rotation.conjugate();
        let [from, to] = [0, self.count - 1].map(|p| (d.images[p], self.anchors[p].point));
        let between = to.0.minus(from.0);
        let between = if self.rotate_positions { back.rotate(between) } else { between };
        [between.minus(Vec3::constant(to.1 - from.1)), back.times(last).log()]
    }

    /// Translation \[m\] and rotation \[rad\] of the goal frame against the start frame, the argument of
    /// [`Adaptation`]; zero in canonical coordinates. `None` when there are too few frames.
    #[must_use]
    pub fn goal_shift(&self, frames: &[MovingPose]) -> Option<[DVec3; 2]> {
        let transforms = self.transforms(frames)?;
        let goal = self.anchors[self.count - 1];
        let rotation = frames[goal.index].pose.orientation * goal.frame.orientation.conjugate();
        Some(self.shift(&transforms, Quat::constant(rotation)).map(Vec3::value))
    }

    /// α_p as a function of the phase.
    fn ramp_at(&self, p: usize, phase: f64) -> [f64; 3] {
        let (from, to) = (self.anchors[p].phase, self.anchors[p + 1].phase);
        let rate = 1.0 / (to - from);
        let [value, first, second] = ramp((phase - from) * rate, RISE);
        [value, first * rate, second * rate * rate]
    }

    /// The space as it is transported to a moving phase s with the rate ṡ \[1/s\].
    ///
    /// Hot path: no allocation. Input that is not finite gives output that is not finite.
    #[must_use]
    pub fn at(&self, transforms: &FrameTransforms, phase: f64, rate: f64) -> Transported<'_, Jet> {
        self.transported(transforms, Jet(phase, rate, 0.0))
    }

    #[inline]
    fn transported<S: Real + FromJet>(&self, d: &FrameTransforms, phase: S) -> Transported<'_, S> {
        let mut image = S::vector(d.images[0]);
        let mut centre = Vec3::constant(self.anchors[0].point);
        let mut rotation = S::quaternion(d.rotation);
        let mut rates = [DVec3::ZERO; 3];
        for p in 0..self.count - 1 {
            let ramp = self.ramp_at(p, phase.value());
            let (alpha, slope) = (phase.chain(ramp), ramp[1]);
            let step = S::vector(d.images[p + 1]).minus(S::vector(d.images[p]));
            image = image.plus(step.times(alpha));
            rates[0] += step.value() * slope;
            let step = self.anchors[p + 1].point - self.anchors[p].point;
            centre = centre.plus(Vec3::constant(step).times(alpha));
            rates[1] += step * slope;
            let twist = S::vector(d.twists[p]);
            let further = Quat::exp(twist.times(alpha));
            rotation = further.times(rotation);
            rates[2] = twist.value() * slope + further.value() * rates[2];
        }
        let back = rotation.conjugate();
        Transported {
            image,
            centre,
            rotation,
            rates,
            positions_back: self.rotate_positions.then_some(back),
            to_goal: back.times_constant_left(self.goal.orientation.conjugate()),
            adaptation: self.adaptation.as_ref().map(|a| (a, d.shift.map(S::vector), phase)),
        }
    }

    /// The pose in the world of a canonical point at a phase.
    #[must_use]
    pub fn forward(&self, transforms: &FrameTransforms, phase: f64, y: &Canonical) -> Pose {
        let transported = self.transported::<f64>(transforms, phase);
        let [(shift_p, _), (shift_r, _)] = [0, 3].map(|first| transported.shift(first));
        let arm = Vec3(y.position.to_array()).plus(shift_p).minus(transported.centre);
        let arm = if self.rotate_positions { transported.rotation.rotate(arm) } else { arm };
        let orientation = transported.rotation.value() * self.goal.orientation;
        Pose {
            position: transported.image.plus(arm).value(),
            orientation: orientation * DQuat::from_scaled_axis(y.rotation + shift_r.value()),
        }
    }

    /// The canonical point of a pose in the world at a phase.
    #[must_use]
    pub fn inverse(&self, transforms: &FrameTransforms, phase: f64, pose: &Pose) -> Canonical {
        let transported = self.transported::<f64>(transforms, phase);
        let position = transported.canonical_position(Vec3(pose.position.to_array()));
        let rotation = transported.canonical_rotation(Quat::constant(pose.orientation));
        Canonical {
            position: position.minus(transported.shift(0).0).value(),
            rotation: rotation.minus(transported.shift(3).0).value(),
        }
    }
}

impl<S: Real> Transported<'_, S> {
    /// Three rows of E(s) u, and of its derivative by the phase.
    #[inline]
    fn shift(&self, first: usize) -> (Vec3<S>, DVec3) {
        match &self.adaptation {
            Some((adaptation, u, phase)) => adaptation.shift(first, u, *phase),
            None => (Vec3::constant(DVec3::ZERO), DVec3::ZERO),
        }
    }

    /// y°.
    fn canonical_position(&self, position: Vec3<S>) -> Vec3<S> {
        let arm = position.minus(self.image);
        self.centre.plus(self.positions_back.map_or(arm, |back| back.rotate(arm)))
    }

    /// y°.
    fn canonical_rotation(&self, orientation: Quat<S>) -> Vec3<S> {
        self.to_goal.times(orientation).log()
    }
}

/// With x the position or the orientation: ẏ = J ẋ + ∂y/∂s ṡ + ∂y/∂t and ÿ = J ẍ + ∂y/∂s s̈ + drift.
impl Transported<'_, Jet> {
    /// Maps a moving position.
    ///
    /// * `position`, `linear`  in the world \[m, m/s\]
    ///
    /// Hot path: no allocation. Input that is not finite gives output that is not finite.
    #[must_use]
    pub fn position(&self, position: DVec3, linear: DVec3) -> Mapped {
        let y = self.canonical_position(Vec3::moving(position, linear, DVec3::ZERO));
        let [image, centre, angular] = self.rates;
        let (jacobian, away) = match &self.positions_back {
            Some(back) => {
                let arm = position - self.image.value();
                (DMat3::from_quat(back.value()), image + angular.cross(arm))
            }
            None => (DMat3::IDENTITY, image),
        };
        Mapped::new(y, self.shift(0), jacobian, centre - jacobian * away)
    }

    /// Maps a moving orientation.
    ///
    /// * `orientation`, `angular`  in the world, its angular velocity in \[rad/s\]
    ///
    /// Hot path: no allocation. Input that is not finite gives output that is not finite.
    #[must_use]
    pub fn rotation(&self, orientation: DQuat, angular: DVec3) -> Mapped {
        let y = self.canonical_rotation(Quat::moving(orientation, angular, DVec3::ZERO));
        let to_goal = DMat3::from_quat(self.to_goal.value());
        let jacobian = inverse_left_jacobian(y.value()) * to_goal;
        Mapped::new(y, self.shift(3), jacobian, -(jacobian * self.rates[2]))
    }
}

impl Mapped {
    /// From y° with its derivatives, and the shift of the adaptation.
    fn new(
        y: Vec3<Jet>,
        (shift, shift_rate): (Vec3<Jet>, DVec3),
        jacobian: DMat3,
        phase_derivative: DVec3,
    ) -> Self {
        let y = y.minus(shift);
        let phase_derivative = phase_derivative - shift_rate;
        let (point, velocity, drift) = (y.value(), y.first(), y.second());
        Self { point, velocity, drift, jacobian, phase_derivative }
    }
}

/// Jets as they are, or only their values.
trait FromJet: Sized {
    fn from_jet(jet: Jet) -> Self;
    #[inline]
    fn vector(v: Vec3<Jet>) -> Vec3<Self> {
        let [x, y, z] = v.0;
        Vec3([Self::from_jet(x), Self::from_jet(y), Self::from_jet(z)])
    }
    #[inline]
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
mod tests;
