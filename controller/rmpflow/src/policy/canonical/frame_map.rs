//! Frames as a task map: where the frames go, the space goes.
//!
//! The canonical space is the one in which all demonstrations share their frames. The map into the
//! world is a field of rigid displacements over the phase s of the skill. Each frame p rules at a phase
//! s_p of its own, the start frame at 0, the goal frame at 1; in between its displacement passes smoothly
//! into the next one's:
//!
//! ```text
//! α_p  = ramp((s − s_p)/(s_{p+1} − s_p))
//! c(s) = c_1 + Σ α_p (c_{p+1} − c_p)          p(s) = x_1 + Σ α_p (x_{p+1} − x_p)
//! R(s) = exp(α_{P−1} φ_{P−1}) … exp(α_1 φ_1) Q_1        φ_p = log(Q_{p+1} Q_p⁻¹)
//! x_p  = p(s) + R(s) (y_p − c(s))              x_q = R(s) q_g exp(y_r)
//! ```
//!
//! c_p is a point fixed to frame p in canonical coordinates, x_p its image in the world, Q_p the
//! rotation of the frame against its canonical orientation. Where all α before p are 1 and all others
//! 0, this is the displacement of frame p. Positions need not turn with the frames: a tool that comes
//! down on an object from above does so wherever the object points.
//! [`FrameMap::rotate_positions`] tells; without it R = I in the line of x_p, while the line of x_q, and
//! with it the grasp, still turns. Orientation is charted by the full-angle rotation vector y_r at the
//! canonical goal orientation.
//!
//! Because the phase is a coordinate and not a function of the place, (y, s) ↦ (x, s) is a
//! diffeomorphism for any displacement and any turn, with determinant one in the lines of x_p: for a
//! given phase it is a rigid motion, and nothing folds.
//!
//! Where demonstrations show how the way changes with its goal, y bends with it: see
//! [`crate::policy::canonical::adaptation`].
//!
//! It is rheonomic: velocities and accelerations of the frames enter the velocity and the drift.

use glam::{DMat3, DQuat, DVec3};

use crate::policy::canonical::adaptation::Adaptation;
use crate::policy::value::FRAME_CAPACITY;
use tprmp_spatial::jet::{Jet, Quat, Real, Vec3};
use tprmp_spatial::rotation::inverse_left_jacobian;
use tprmp_spatial::{MovingPose, Pose};

/// Frames rule at phases that lie at least this far apart: between them space moves with the change of
/// phase.
pub const PHASE_DISTANCE_MIN: f64 = 0.05;
/// Fraction of the phase between two frames in which one's displacement begins to fade into the other's.
const RISE: f64 = 0.2;

/// A frame of a skill in canonical coordinates, and when it rules.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anchor {
    /// Which of the skill's frames it is.
    pub index: usize,
    /// The frame.
    pub frame: Pose,
    /// c_p, fixed to the frame \[m\].
    pub point: DVec3,
    /// s_p.
    pub phase: f64,
}

/// Why the anchors make no map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameMapError {
    /// There is no anchor, or there are more than [`FRAME_CAPACITY`].
    AnchorCount(usize),
    /// The anchor rules less than [`PHASE_DISTANCE_MIN`] after the one before it, or not at a finite
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

/// What the map says about a moving position or orientation in the world at a moving phase; y is its
/// position \[m\] or its orientation chart \[rad\] in canonical coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Mapped {
    /// y.
    pub point: DVec3,
    /// ẏ.
    pub velocity: DVec3,
    /// ÿ for ẍ = 0 and s̈ = 0.
    pub drift: DVec3,
    /// ∂y/∂(linear or angular transforms).
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
    /// The goal as seen from the frame that carries it.
    grasp: Pose,
    rotate_positions: bool,
    adaptation: Option<Adaptation>,
}

/// The frames as they are now, ready to map with.
#[derive(Debug, Clone, Copy)]
pub struct FrameTransforms {
    /// x_p.
    images: [Vec3<Jet>; FRAME_CAPACITY],
    /// φ_p.
    twists: [Vec3<Jet>; FRAME_CAPACITY],
    /// Q_1.
    rotation: Quat<Jet>,
    /// u.
    shift: [Vec3<Jet>; 2],
}

/// A smooth way from 0 at t = 0 to 1 at t = 1, and its first two derivatives: at rest outside, its
/// slope rises within `rise` of either end to 1/(1 − rise) and is constant between.
///
/// * `rise`  above 0, at most ½
#[must_use]
pub fn ramp(t: f64, rise: f64) -> [f64; 3] {
    let speed = 1.0 / (1.0 - rise);
    if t > 0.5 {
        let [value, slope, bend] = ramp(1.0 - t, rise);
        return [1.0 - value, slope, -bend];
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

/// p(s), c(s) and R(s): how the frames carry the space at a phase, see [`FrameMap::at`].
#[derive(Debug, Clone, Copy)]
pub struct Transported<'a, S> {
    image: Vec3<S>,
    centre: Vec3<S>,
    turn: Quat<S>,
    /// p′, c′, and the rate of R over the phase as a rotation vector in the world.
    rates: [DVec3; 3],
    /// The rotation from the world to canonical axes where positions turn, otherwise none.
    positions_back: Option<Quat<S>>,
    /// From the world into the axes of q_g.
    to_goal: Quat<S>,
    /// What the way bends by, u and the phase.
    adaptation: Option<(&'a Adaptation, [Vec3<S>; 2], S)>,
}

impl FrameMap {
    /// The map of these anchors in the order of their phases; the last one's frame carries the goal.
    ///
    /// * `goal`  in canonical coordinates, e.g. the grasp; its orientation is q_g
    /// * `rotate_positions`  whether the way to the goal turns with the frames
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

    /// The same map, whose way bends with its goal; it should have two anchors, since what bends does
    /// not pass a frame in between.
    #[must_use]
    pub fn adapting(mut self, adaptation: Option<Adaptation>) -> Self {
        self.adaptation = adaptation;
        self
    }

    /// How the way bends with its goal.
    #[must_use]
    pub fn adaptation(&self) -> Option<&Adaptation> {
        self.adaptation.as_ref()
    }

    /// Its anchors in the order of their phases; the last one's frame carries the goal.
    #[must_use]
    pub fn anchors(&self) -> &[Anchor] {
        &self.anchors[..self.count]
    }

    /// The frame that carries the goal, in canonical coordinates.
    #[must_use]
    pub fn goal_frame(&self) -> Pose {
        self.anchors[self.count - 1].frame
    }

    /// The goal in canonical coordinates.
    #[must_use]
    pub fn goal(&self) -> Pose {
        self.goal
    }

    /// Whether the way to the goal turns with the frames.
    #[must_use]
    pub fn rotate_positions(&self) -> bool {
        self.rotate_positions
    }

    /// How many frames it takes.
    #[must_use]
    pub fn frame_count(&self) -> usize {
        self.anchors().iter().map(|anchor| anchor.index + 1).max().unwrap_or(0)
    }

    /// Where the goal is for these frames; `None` when there are too few.
    #[must_use]
    pub fn goal_among(&self, frames: &[MovingPose]) -> Option<Pose> {
        let anchor = &self.anchors[self.count - 1];
        Some(frames.get(anchor.index)?.pose.compose(&self.grasp))
    }

    /// Takes in where the frames are and how they move; `None` when there are too few.
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
            let turn = frame.pose.orientation * anchor.frame.orientation.conjugate();
            let arm = turn * (anchor.point - anchor.frame.position);
            transforms.images[p] = frame.fixed_point(arm);
            let rotation = Quat::moving(turn, frame.velocity.angular, frame.acceleration.angular);
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

    /// δ_p, δ_r: displacement and turn of the goal frame against the start frame, seen from the latter.
    ///
    /// * `last`  the rotation of the goal frame
    fn shift(&self, d: &FrameTransforms, last: Quat<Jet>) -> [Vec3<Jet>; 2] {
        let back = d.rotation.conjugate();
        let [from, to] = [0, self.count - 1].map(|p| (d.images[p], self.anchors[p].point));
        let between = to.0.minus(from.0);
        let between = if self.rotate_positions { back.rotate(between) } else { between };
        [between.minus(Vec3::constant(to.1 - from.1)), back.times(last).log()]
    }

    /// FrameTransforms \[m\] and turn \[rad\] of the goal frame against the start frame, as they count for
    /// [`Adaptation`]; zero in canonical coordinates. `None` when there are too few frames.
    #[must_use]
    pub fn goal_shift(&self, frames: &[MovingPose]) -> Option<[DVec3; 2]> {
        let transforms = self.transforms(frames)?;
        let goal = self.anchors[self.count - 1];
        let turn = frames[goal.index].pose.orientation * goal.frame.orientation.conjugate();
        Some(self.shift(&transforms, Quat::constant(turn)).map(Vec3::value))
    }

    /// α_p as a function of the phase.
    fn ramp_at(&self, p: usize, phase: f64) -> [f64; 3] {
        let (from, to) = (self.anchors[p].phase, self.anchors[p + 1].phase);
        let rate = 1.0 / (to - from);
        let [value, slope, bend] = ramp((phase - from) * rate, RISE);
        [value, slope * rate, bend * rate * rate]
    }

    /// How the space is carried at a moving phase s with the rate ṡ \[1/s\].
    ///
    /// Hot path: no allocation. Input that is not finite gives output that is not finite.
    #[must_use]
    pub fn at(&self, transforms: &FrameTransforms, phase: f64, rate: f64) -> Transported<'_, Jet> {
        self.carried(transforms, Jet(phase, rate, 0.0))
    }

    #[inline]
    fn carried<S: Real + FromJet>(&self, d: &FrameTransforms, phase: S) -> Transported<'_, S> {
        let mut image = S::vector(d.images[0]);
        let mut centre = Vec3::constant(self.anchors[0].point);
        let mut turn = S::quaternion(d.rotation);
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
            turn = further.times(turn);
            rates[2] = twist.value() * slope + further.value() * rates[2];
        }
        let back = turn.conjugate();
        Transported {
            image,
            centre,
            turn,
            rates,
            positions_back: self.rotate_positions.then_some(back),
            to_goal: back.times_constant_left(self.goal.orientation.conjugate()),
            adaptation: self.adaptation.as_ref().map(|a| (a, d.shift.map(S::vector), phase)),
        }
    }

    /// Where a canonical point lies in the world at a phase.
    #[must_use]
    pub fn forward(&self, transforms: &FrameTransforms, phase: f64, y: &Canonical) -> Pose {
        let transported = self.carried::<f64>(transforms, phase);
        let [(bend_p, _), (bend_r, _)] = [0, 3].map(|first| transported.bend(first));
        let arm = Vec3(y.position.to_array()).plus(bend_p).minus(transported.centre);
        let arm = if self.rotate_positions { transported.turn.rotate(arm) } else { arm };
        let orientation = transported.turn.value() * self.goal.orientation;
        Pose {
            position: transported.image.plus(arm).value(),
            orientation: orientation * DQuat::from_scaled_axis(y.rotation + bend_r.value()),
        }
    }

    /// The canonical point of a pose in the world at a phase.
    #[must_use]
    pub fn inverse(&self, transforms: &FrameTransforms, phase: f64, pose: &Pose) -> Canonical {
        let transported = self.carried::<f64>(transforms, phase);
        let position = transported.canonical_position(Vec3(pose.position.to_array()));
        let rotation = transported.canonical_rotation(Quat::constant(pose.orientation));
        Canonical {
            position: position.minus(transported.bend(0).0).value(),
            rotation: rotation.minus(transported.bend(3).0).value(),
        }
    }
}

impl<S: Real> Transported<'_, S> {
    /// Three rows of E(s) u, and of its derivative by the phase.
    #[inline]
    fn bend(&self, first: usize) -> (Vec3<S>, DVec3) {
        match &self.adaptation {
            Some((adaptation, shift, phase)) => adaptation.bend(first, shift, *phase),
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
        let [image, centre, turn] = self.rates;
        let (jacobian, away) = match &self.positions_back {
            Some(back) => {
                let arm = position - self.image.value();
                (DMat3::from_quat(back.value()), image + turn.cross(arm))
            }
            None => (DMat3::IDENTITY, image),
        };
        Mapped::new(y, self.bend(0), jacobian, centre - jacobian * away)
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
        Mapped::new(y, self.bend(3), jacobian, -(jacobian * self.rates[2]))
    }
}

impl Mapped {
    /// From y° with its derivatives, and what it bends by.
    fn new(
        y: Vec3<Jet>,
        (bend, bend_rate): (Vec3<Jet>, DVec3),
        jacobian: DMat3,
        phase_derivative: DVec3,
    ) -> Self {
        let y = y.minus(bend);
        let phase_derivative = phase_derivative - bend_rate;
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
mod tests {
    use super::*;
    use tprmp_spatial::{SpatialAcceleration, Twist};

    fn pose(position: [f64; 3], rotation: [f64; 3]) -> Pose {
        Pose { position: position.into(), orientation: DQuat::from_scaled_axis(rotation.into()) }
    }

    fn anchors() -> [Anchor; 3] {
        let start = pose([0.4, 0.1, 0.3], [0.0, 0.2, 0.1]);
        let way = pose([0.7, -0.1, 0.1], [0.1, 0.0, -0.4]);
        let goal_frame = pose([0.5, -0.25, 0.03], [0.0, 0.0, 0.3]);
        [
            Anchor { index: 0, frame: start, point: start.position, phase: 0.0 },
            Anchor { index: 2, frame: way, point: DVec3::new(0.72, -0.1, 0.2), phase: 0.4 },
            Anchor { index: 1, frame: goal_frame, point: goal().position, phase: 1.0 },
        ]
    }

    fn goal() -> Pose {
        pose([0.505, -0.248, 0.058], [3.0, 0.1, 0.2])
    }

    /// With and without a frame on the way, with and without positions that turn.
    fn maps() -> Vec<FrameMap> {
        let [start, way, goal_frame] = anchors();
        let mut maps = Vec::new();
        for turn in [true, false] {
            maps.push(FrameMap::new(&[start, goal_frame], goal(), turn).unwrap());
            maps.push(FrameMap::new(&[start, way, goal_frame], goal(), turn).unwrap());
            maps.push(FrameMap::new(&[goal_frame], goal(), turn).unwrap());
            maps.push(maps[maps.len() - 3].adapting(Some(adaptation())));
        }
        maps
    }

    /// Bends by some millimetres and tenths of degrees.
    fn adaptation() -> Adaptation {
        let entry = |k: usize| 0.01 * (k as f64 * 1.37).sin();
        let bends = core::array::from_fn(|j| {
            core::array::from_fn(|a| core::array::from_fn(|b| entry(36 * j + 6 * a + b)))
        });
        Adaptation { reach: [0.3, 0.5], bends }
    }

    /// A frame on a curve in time: its pose, and its exact motion by construction.
    fn moving(t: f64, speed: f64, origin: DVec3) -> MovingPose {
        let spin = speed * t + 0.1 * t * t;
        MovingPose {
            pose: Pose {
                position: origin
                    + DVec3::new(0.15 * (speed * t).sin(), 0.1 * t * t, -0.2 * speed * t),
                orientation: DQuat::from_rotation_z(spin) * DQuat::from_rotation_x(0.2 * speed),
            },
            velocity: Twist {
                linear: DVec3::new(0.15 * speed * (speed * t).cos(), 0.2 * t, -0.2 * speed),
                angular: DVec3::Z * (speed + 0.2 * t),
            },
            acceleration: SpatialAcceleration {
                linear: DVec3::new(-0.15 * speed * speed * (speed * t).sin(), 0.2, 0.0),
                angular: DVec3::Z * 0.2,
            },
        }
    }

    /// Far from their canonical places: the goal on the other side of the start.
    fn frames(t: f64) -> [MovingPose; 3] {
        [
            moving(t, -0.3, DVec3::new(0.42, 0.12, 0.31)),
            moving(t, 0.8, DVec3::new(0.3, 0.6, 0.5)),
            moving(t, 1.4, DVec3::new(0.1, 0.1, 0.3)),
        ]
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

    fn phases() -> impl Iterator<Item = f64> {
        (0..60).map(|i| -0.2 + 1.4 * f64::from(i) / 59.0)
    }

    #[test]
    fn ramp_is_flat_outside_and_its_derivatives_are_right() {
        for rise in [0.1, RISE, 0.5] {
            for t in [-2.0, 0.0] {
                assert_eq!(ramp(t, rise), [0.0; 3]);
                assert_eq!(ramp(1.0 - t, rise).map(f64::abs), [1.0, 0.0, 0.0]);
            }
            let h = 1e-6;
            for i in -10..30 {
                let t = 0.07 * f64::from(i) + 0.001;
                let [_, slope, bend] = ramp(t, rise);
                let (before, after) = (ramp(t - h, rise), ramp(t + h, rise));
                assert!((slope - (after[0] - before[0]) / (2.0 * h)).abs() < 1e-8);
                assert!((bend - (after[1] - before[1]) / (2.0 * h)).abs() < 1e-4);
                assert!((0.0..=1.0 / (1.0 - rise)).contains(&slope));
            }
        }
    }

    #[test]
    fn canonical_frames_map_to_themselves_and_moved_ones_carry_what_they_rule() {
        for map in maps() {
            let still = [0, 1, 2].map(|index| {
                let anchor = anchors().into_iter().find(|anchor| anchor.index == index).unwrap();
                MovingPose::at_rest(anchor.frame)
            });
            let d = map.transforms(&still).unwrap();
            for (y, phase) in points().zip(phases()) {
                assert!((map.forward(&d, phase, &y).position - y.position).length() < 1e-14);
            }
            let moved = frames(0.3);
            let d = map.transforms(&moved).unwrap();
            for anchor in map.anchors() {
                let y = Canonical { position: anchor.point, rotation: DVec3::ZERO };
                let image = map.forward(&d, anchor.phase, &y);
                let held = Pose { position: anchor.point, ..goal() };
                let expected =
                    moved[anchor.index].pose.compose(&anchor.frame.inverse().compose(&held));
                assert!((image.position - expected.position).length() < 1e-12);
                assert!(image.rotation_from(&expected).length() < 1e-12);
            }
            let y = Canonical { position: goal().position, rotation: DVec3::ZERO };
            let image = map.forward(&d, 1.0, &y);
            let expected = map.goal_among(&moved).unwrap();
            assert!((image.position - expected.position).length() < 1e-12);
            assert!(image.rotation_from(&expected).length() < 1e-12);
        }
    }

    #[test]
    fn with_one_frame_the_whole_space_moves_rigidly() {
        let map = FrameMap::new(&anchors()[2..], goal(), true).unwrap();
        assert_eq!(map.frame_count(), 2);
        let moved = frames(0.3);
        let d = map.transforms(&moved).unwrap();
        for (y, phase) in points().zip(phases()) {
            let expected = moved[1]
                .pose
                .compose(&map.goal_frame().inverse())
                .compose(&Pose { position: y.position, orientation: DQuat::IDENTITY });
            let image = map.forward(&d, phase, &y);
            assert!((image.position - expected.position).length() < 1e-12);
        }
    }

    #[test]
    fn inverse_undoes_forward_at_any_phase() {
        for map in maps() {
            let d = map.transforms(&frames(0.5)).unwrap();
            for (y, phase) in points().zip(phases()) {
                let back = map.inverse(&d, phase, &map.forward(&d, phase, &y));
                assert!((back.position - y.position).length() < 1e-12);
                assert!((back.rotation - y.rotation).length() < 1e-12);
            }
        }
    }

    /// Follows x(t) = forward(frames(t), s(t), y(t)) for straight y(t) and s(t), so that ÿ = s̈ = 0,
    /// and compares what the map says at t = 0.4 with finite differences.
    #[test]
    fn velocity_drift_and_jacobian_agree_with_finite_differences() {
        let t0 = 0.4;
        for map in maps() {
            for (i, (y, phase)) in points().zip(phases()).enumerate() {
                let s = i as f64;
                let phase_rate = 0.6 * (s * 0.21).cos();
                let rate = Canonical {
                    position: DVec3::new((s * 0.8).cos(), 0.7 * (s * 0.3).sin(), -0.4),
                    rotation: DVec3::new(0.5, (s * 0.45).sin(), -0.8 * (s * 0.2).cos()),
                };
                let at = |t: f64| {
                    let moved = Canonical {
                        position: y.position + rate.position * t,
                        rotation: y.rotation + rate.rotation * t,
                    };
                    let d = map.transforms(&frames(t0 + t)).unwrap();
                    map.forward(&d, phase + phase_rate * t, &moved)
                };
                let h = 1e-4;
                let (before, now, after) = (at(-h), at(0.0), at(h));
                let linear = (after.position - before.position) / (2.0 * h);
                let angular = after.rotation_from(&before) / (2.0 * h);
                let linear_acceleration =
                    (after.position - 2.0 * now.position + before.position) / (h * h);
                let angular_acceleration =
                    (after.rotation_from(&now) - now.rotation_from(&before)) / (h * h);
                let d = map.transforms(&frames(t0)).unwrap();
                let transported = map.at(&d, phase, phase_rate);
                let position = transported.position(now.position, linear);
                let rotation = transported.rotation(now.orientation, angular);
                let velocity_error = (position.velocity - rate.position).length()
                    + (rotation.velocity - rate.rotation).length();
                assert!(velocity_error < 5e-6, "{velocity_error:e}");
                // ÿ = 0 = J ẍ + drift.
                let drift_error = (position.jacobian * linear_acceleration + position.drift)
                    .length()
                    + (rotation.jacobian * angular_acceleration + rotation.drift).length();
                assert!(drift_error < 3e-5, "{drift_error:e}");

                let h = 1e-6;
                let [low, high] = [-h, h].map(|step| map.inverse(&d, phase + step, &now));
                let along = (high.position - low.position) / (2.0 * h);
                assert!((along - position.phase_derivative).length() < 1e-7);
                let along = (high.rotation - low.rotation) / (2.0 * h);
                assert!((along - rotation.phase_derivative).length() < 1e-7);
                for axis in DVec3::AXES {
                    let [low, high] = [-h, h].map(|step| {
                        let turn = DQuat::from_scaled_axis(axis * step);
                        let moved = Pose {
                            position: now.position + axis * step,
                            orientation: turn * now.orientation,
                        };
                        map.inverse(&d, phase, &moved)
                    });
                    let column = (high.position - low.position) / (2.0 * h);
                    assert!((column - position.jacobian * axis).length() < 1e-8);
                    let column = (high.rotation - low.rotation) / (2.0 * h);
                    assert!((column - rotation.jacobian * axis).length() < 1e-7);
                }
            }
        }
    }

    #[test]
    fn too_few_frames_and_anchors_out_of_order_are_refused() {
        let [start, way, goal_frame] = anchors();
        let map = |anchors: &[Anchor]| FrameMap::new(anchors, goal(), true);
        assert_eq!(map(&[]).unwrap_err(), FrameMapError::AnchorCount(0));
        let many = [start; FRAME_CAPACITY + 1];
        assert_eq!(map(&many).unwrap_err(), FrameMapError::AnchorCount(FRAME_CAPACITY + 1));
        let error = map(&[start, goal_frame, way]).unwrap_err();
        assert_eq!(error, FrameMapError::PhasesTooClose(2));
        let late = Anchor { phase: f64::NAN, ..way };
        assert_eq!(map(&[start, late]).unwrap_err(), FrameMapError::PhasesTooClose(1));
        let three = map(&[start, way, goal_frame]).unwrap();
        assert!(three.transforms(&frames(0.0)[..2]).is_none());
        assert_eq!(three.frame_count(), 3);
    }
}
