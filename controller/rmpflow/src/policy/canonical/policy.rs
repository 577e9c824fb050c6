//! The leaf of a learned skill: fields on canonical coordinates and the phase, pulled back through the
//! frame map to the pose of the tool.
//!
//! The phase s is a coordinate of the policy alone: no other leaf acts on it. So it is eliminated from
//! the natural form before that meets other leaves. With x the pose,
//!
//! ```text
//! [M_xx M_xs] [ẍ]   [f_x]          (M_xx − M_xs M_ss⁻¹ M_sx) ẍ = f_x − M_xs M_ss⁻¹ f_s
//! [M_sx M_ss] [s̈] = [f_s]          s̈ = M_ss⁻¹ (f_s − M_sx ẍ)
//! ```
//!
//! The first line on the right is the leaf. Once the root is resolved, the second one tells how the phase
//! goes on for the acceleration that the tool really gets ([`Phase::advance`]): it waits for a tool
//! that is held back, and follows one that is pushed.

use glam::{DMat3, DVec3};
use nalgebra::{Matrix6, SVector, Vector6};
use tprmp_spatial::rotation::rotation_vector;
use tprmp_spatial::{MovingPose, Pose, Twist, Wrench};

use crate::natural::Natural;
use crate::policy::canonical::field::Field;
use crate::policy::canonical::frame_map::{FrameMap, FrameTransforms, Mapped};
use crate::policy::value::{Phase, PhaseResponse, SkillInertia, SkillValue};

/// Phases that are compared to find the one to start with.
const PHASES_COMPARED: usize = 97;
/// A pose is at the start when it lies so much farther from it than from the nearest phase at most, as
/// a fraction of the distance that does not tell.
const AT_START: f64 = 0.25;
/// Sections between neighbours of the best one: to 1e-8, the root of the precision.
const SECTIONS: usize = 30;
/// Fraction of the golden section.
const GOLDEN: f64 = 0.618_033_988_749_894_8;

/// The field of the position: in the plane z = const, or in space; the phase is its last coordinate.
#[derive(Debug, Clone)]
pub enum PositionField {
    /// In the plane: x and y.
    Plane(Box<Field<3>>),
    /// In space.
    Space(Box<Field<4>>),
}

/// A learned policy on canonical coordinates and the phase: immutable.
#[derive(Debug, Clone)]
pub struct CanonicalPolicy {
    /// How the frames move the space.
    pub map: FrameMap,
    /// Position, with unit inertia at the goal.
    pub position: PositionField,
    /// Orientation chart, with unit inertia at the goal; `None` when orientation is free.
    pub orientation: Option<Box<Field<4>>>,
}

/// The field of one block, position or orientation, pulled back to its displacement x and the phase.
struct Block {
    /// f_x, f_s.
    force: (DVec3, f64),
    /// M_xx, M_xs, M_ss.
    metric: (DMat3, DVec3, f64),
    energy: f64,
}

impl Block {
    /// Nothing.
    const NONE: Self =
        Self { force: (DVec3::ZERO, 0.0), metric: (DMat3::ZERO, DVec3::ZERO, 0.0), energy: 0.0 };

    /// Evaluates a field, the first N − 1 coordinates of which are those of `mapped`.
    ///
    /// * `scale`  by which the field's force and metric are multiplied
    fn new<const N: usize>(field: &Field<N>, scale: f64, phase: &Phase, mapped: &Mapped) -> Self {
        let last = N - 1;
        let lifted = |v: DVec3, last: f64| {
            SVector::<f64, N>::from_fn(|i, _| if i + 1 < N { v[i] } else { last })
        };
        let velocity = lifted(mapped.velocity, phase.rate_1_s);
        let value = field.evaluate(&lifted(mapped.point, phase.value), &velocity);
        let (force, metric) = (value.force(&velocity), &value.metric);
        let vector = |entry: &dyn Fn(usize) -> f64| {
            DVec3::new(entry(0), entry(1), if N > 3 { entry(2) } else { 0.0 })
        };
        let column = |j: usize| vector(&|i| metric[(i, j)]) * scale;
        let own =
            DMat3::from_cols(column(0), column(1), if N > 3 { column(2) } else { DVec3::ZERO });
        let (with_phase, of_phase) = (column(last), metric[(last, last)] * scale);
        // J̇ẋ is the drift; the phase is a coordinate as it is.
        let Mapped { jacobian, phase_derivative: along, drift, .. } = mapped;
        let residual = vector(&|i| force[i]) * scale - own * *drift;
        let back = jacobian.transpose();
        let mixed = own * *along + with_phase;
        Self {
            force: (
                back * residual,
                force[last] * scale - with_phase.dot(*drift) + along.dot(residual),
            ),
            metric: (
                back * (own * *jacobian),
                back * mixed,
                of_phase + along.dot(with_phase) + along.dot(mixed),
            ),
            energy: value.energy(&velocity) * scale,
        }
    }
}

/// A skill of these blocks, with the phase eliminated: the Schur complement of its row and column.
fn without_phase(position: &Block, rotation: &Block) -> SkillValue {
    let inverse = 1.0 / (position.metric.2 + rotation.metric.2);
    let free = (position.force.1 + rotation.force.1) * inverse;
    let pair = |force: DVec3, torque: DVec3| Vector6::from(Wrench { force, torque });
    let column = pair(position.metric.1, rotation.metric.1);
    let coupling = column * inverse;
    let mut metric = Matrix6::zeros();
    for j in 0..3 {
        let (above, below) = (position.metric.0.col(j), rotation.metric.0.col(j));
        for i in 0..3 {
            metric[(i, j)] = above[i];
            metric[(i + 3, j + 3)] = below[i];
        }
    }
    for j in 0..6 {
        for i in 0..6 {
            metric[(i, j)] -= column[i] * coupling[j];
        }
    }
    SkillValue {
        natural: Natural {
            force: pair(position.force.0, rotation.force.0) - column * free,
            metric,
        },
        energy: position.energy + rotation.energy,
        phase: PhaseResponse { free, coupling, least: f64::NEG_INFINITY },
    }
}

impl CanonicalPolicy {
    /// How many frames it takes.
    #[must_use]
    pub fn frame_count(&self) -> usize {
        self.map.frame_count()
    }

    /// Takes in where the frames are and how they move; `None` when there are too few.
    #[inline]
    #[must_use]
    pub fn transforms(&self, frames: &[MovingPose]) -> Option<FrameTransforms> {
        self.map.transforms(frames)
    }

    /// Evaluates the skill for a moving pose, at a phase.
    ///
    /// * `transforms`  the frames as they are now
    /// * `velocity`  of the pose, in the world
    ///
    /// Hot path: no allocation. Input that is not finite gives output that is not finite.
    #[must_use]
    pub fn evaluate(
        &self,
        inertia: &SkillInertia,
        transforms: &FrameTransforms,
        pose: &Pose,
        velocity: &Twist,
        phase: &Phase,
    ) -> SkillValue {
        let transported = self.map.at(transforms, phase.value, phase.rate_1_s);
        let mapped = transported.position(pose.position, velocity.linear);
        let position = match &self.position {
            PositionField::Plane(field) => Block::new(field, inertia.linear_kg, phase, &mapped),
            PositionField::Space(field) => Block::new(field, inertia.linear_kg, phase, &mapped),
        };
        let rotation = self.orientation.as_ref().map_or(Block::NONE, |field| {
            let mapped = transported.rotation(pose.orientation, velocity.angular);
            Block::new(field, inertia.angular_kg_m2, phase, &mapped)
        });
        without_phase(&position, &rotation)
    }

    /// The phase at which a pose is most at home, at rest: where it lies nearest to the demonstrations
    /// in the metric of the skill. Of several such places, as where a path crosses itself or ends where
    /// it began, the earliest one.
    ///
    /// Not for every tick: it compares a hundred phases. No allocation.
    #[must_use]
    pub fn nearest_phase(
        &self,
        inertia: &SkillInertia,
        transforms: &FrameTransforms,
        pose: &Pose,
    ) -> Phase {
        let far = self.home(inertia).sqrt();
        let from_start = self.distance_from_start(inertia, transforms, pose).map(f64::sqrt);
        let start = Phase { value: 0.0, rate_1_s: 0.0 };
        // Whatever is nearest: the others need not be compared.
        if from_start.is_some_and(|d| d <= AT_START * far) {
            return start;
        }
        let distance = |phase: f64| self.distance(inertia, transforms, pose, phase);
        let step = 1.0 / (PHASES_COMPARED - 1) as f64;
        let mut distances = [0.0; PHASES_COMPARED];
        for (i, entry) in distances.iter_mut().enumerate() {
            *entry = distance(i as f64 * step);
        }
        let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
        if from_start.is_some_and(|d| d <= least.sqrt() + AT_START * far) {
            return start;
        }
        let home = (least.sqrt() + far).powi(2);
        let at = |i: usize| distances.get(i).copied().unwrap_or(f64::INFINITY);
        let is_home =
            |i: &usize| at(*i) <= home && at(*i) <= at(i + 1) && (*i == 0 || at(*i) <= at(i - 1));
        let best = (0..PHASES_COMPARED).find(is_home).unwrap_or(0);
        // Between its neighbours the distance is taken to fall and rise.
        let (mut low, mut high) = (
            (best as f64 - 1.0).max(0.0) * step,
            (best as f64 + 1.0).min((PHASES_COMPARED - 1) as f64) * step,
        );
        // The golden section: of two places between low and high one is known from before.
        let inner = |low: f64, high: f64| high - GOLDEN * (high - low);
        let outer = |low: f64, high: f64| low + GOLDEN * (high - low);
        let (mut a, mut b) = (distance(inner(low, high)), distance(outer(low, high)));
        for _ in 0..SECTIONS {
            if a <= b {
                high = outer(low, high);
                (a, b) = (distance(inner(low, high)), a);
            } else {
                low = inner(low, high);
                (a, b) = (b, distance(outer(low, high)));
            }
        }
        Phase { value: 0.5 * (low + high), rate_1_s: 0.0 }
    }

    fn distance(
        &self,
        inertia: &SkillInertia,
        transforms: &FrameTransforms,
        pose: &Pose,
        phase: f64,
    ) -> f64 {
        let y = self.map.inverse(transforms, phase, pose);
        let (p, r) = (y.position, y.rotation);
        let mut distance = inertia.linear_kg
            * match &self.position {
                PositionField::Plane(field) => field.distance(&SVector::from([p.x, p.y, phase])),
                PositionField::Space(field) => {
                    field.distance(&SVector::from([p.x, p.y, p.z, phase]))
                }
            };
        if let Some(field) = &self.orientation {
            let z = SVector::from([r.x, r.y, r.z, phase]);
            distance += inertia.angular_kg_m2 * field.distance(&z);
        }
        distance
    }

    /// How far a pose lies from that of the start frame, in the metric at phase 0; `None` when the skill
    /// has no start frame.
    ///
    /// Towards its ends [`Self::distance`] draws to the mean of the outermost component.
    fn distance_from_start(
        &self,
        inertia: &SkillInertia,
        transforms: &FrameTransforms,
        pose: &Pose,
    ) -> Option<f64> {
        let [start, _, ..] = self.map.anchors() else { return None };
        let y = self.map.inverse(transforms, 0.0, pose);
        let p = y.position - start.point;
        let mut distance = inertia.linear_kg
            * match &self.position {
                PositionField::Plane(field) => field.size(0.0, &SVector::from([p.x, p.y, 0.0])),
                PositionField::Space(field) => {
                    field.size(0.0, &SVector::from([p.x, p.y, p.z, 0.0]))
                }
            };
        if let Some(field) = &self.orientation {
            let turn = self.map.goal().orientation.conjugate() * start.frame.orientation;
            let r = y.rotation - rotation_vector(turn);
            let r = SVector::from([r.x, r.y, r.z, 0.0]);
            distance += inertia.angular_kg_m2 * field.size(0.0, &r);
        }
        Some(distance)
    }

    /// The acceleration with which the phase goes on at `fraction` of its own pull, as if the tool lay in
    /// the valley: s̈ = −fraction U′/M_ss − d ṡ \[1/s²\]. −∞ where there is no valley.
    ///
    /// Where an obstacle holds the tool back, the valley's pull on the tool holds the phase back too:
    /// what is wanted would wait in the obstacle for good, and the tool go round it for ever.
    pub(crate) fn pull(&self, inertia: &SkillInertia, phase: &Phase, fraction: f64) -> f64 {
        fn of<const N: usize>(field: &Field<N>, phase: f64) -> Option<[f64; 3]> {
            let slope = field.valley(phase)?.slope;
            let mut along = SVector::zeros();
            along[N - 1] = 1.0;
            let mass = 2.0 * field.size(phase, &along);
            Some([slope, mass, mass * field.damping_1_s()])
        }
        let position = match &self.position {
            PositionField::Plane(field) => of(field, phase.value),
            PositionField::Space(field) => of(field, phase.value),
        };
        let orientation = match &self.orientation {
            Some(field) => of(field, phase.value),
            None => Some([0.0; 3]),
        };
        let (Some(p), Some(r)) = (position, orientation) else { return f64::NEG_INFINITY };
        let [slope, mass, damping] =
            [0, 1, 2].map(|i| inertia.linear_kg * p[i] + inertia.angular_kg_m2 * r[i]);
        let pull = (-fraction * slope - damping * phase.rate_1_s) / mass;
        if pull.is_finite() { pull } else { f64::NEG_INFINITY }
    }

    /// A difference of distances that does not tell: that of half a component's fraction of the way.
    fn home(&self, inertia: &SkillInertia) -> f64 {
        fn of<const N: usize>(field: &Field<N>) -> f64 {
            let components = field.components();
            let goal = components[components.len() - 1].metric[(N - 1, N - 1)];
            let fraction = 0.5 / components.len() as f64;
            0.5 * goal * fraction * fraction
        }
        let mut home = inertia.linear_kg
            * match &self.position {
                PositionField::Plane(field) => of(field),
                PositionField::Space(field) => of(field),
            };
        if let Some(field) = &self.orientation {
            home += inertia.angular_kg_m2 * of(field);
        }
        home
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::canonical::field::Component;
    use crate::policy::canonical::frame_map::Anchor;
    use crate::policy::skill_policy::{PolicyState, SkillPolicy};
    use glam::DQuat;
    use nalgebra::{Matrix3, Matrix4, SMatrix, Vector3, Vector4};
    use tprmp_spatial::SpatialAcceleration;

    /// A straight way from `start` to `goal`: a valley that falls along it.
    fn way(start: Vector3<f64>, goal: Vector3<f64>, stiffness: f64) -> Field<4> {
        let component = |i: i32| {
            let s = f64::from(i) * 0.25;
            let mean = start + (goal - start) * s;
            let along = (goal - start) * -stiffness;
            let mut hessian = Matrix4::from_diagonal_element(stiffness);
            hessian.fixed_view_mut::<3, 1>(0, 3).copy_from(&along);
            hessian.fixed_view_mut::<1, 3>(3, 0).copy_from(&along.transpose());
            hessian[(3, 3)] = stiffness * ((goal - start).norm_squared() + 1.0);
            let mut gradient = Vector4::zeros();
            gradient[3] = stiffness * (s - 1.0);
            // Across the way ten times the inertia along it, but for the goal.
            let direction = (goal - start).push(1.0).normalize();
            let across = Matrix4::identity() - direction * direction.transpose();
            Component {
                mean: mean.push(s),
                metric: Matrix4::identity() + across * if i == 4 { 0.0 } else { 9.0 },
                potential: 0.5 * stiffness * (s - 1.0).powi(2),
                gradient,
                hessian,
            }
        };
        let components: Vec<_> = (0..5).map(component).collect();
        Field::new(&components, 0.15, 8.0).unwrap()
    }

    fn skill() -> CanonicalPolicy {
        let pose = |p: [f64; 3], r: [f64; 3]| Pose {
            position: p.into(),
            orientation: DQuat::from_scaled_axis(r.into()),
        };
        let goal = pose([0.5, -0.25, 0.06], [3.0, 0.1, 0.2]);
        let start = pose([0.4, 0.1, 0.3], [0.0, 0.2, 0.1]);
        let goal_frame = pose([0.5, -0.25, 0.03], [0.0, 0.0, 0.3]);
        let anchors = [
            Anchor { index: 0, frame: start, point: start.position, phase: 0.0 },
            Anchor { index: 1, frame: goal_frame, point: goal.position, phase: 1.0 },
        ];
        let position = way(start.position.into(), goal.position.into(), 16.0);
        let orientation = way(Vector3::new(-0.6, 0.2, 0.1), Vector3::zeros(), 12.0);
        CanonicalPolicy {
            map: FrameMap::new(&anchors, goal, true).unwrap(),
            position: PositionField::Space(Box::new(position)),
            orientation: Some(Box::new(orientation)),
        }
    }

    const INERTIA: SkillInertia = SkillInertia { linear_kg: 2.0, angular_kg_m2: 0.1 };

    /// Integrates the resolved acceleration of the pose: a free rigid body that obeys the skill.
    fn rollout(
        frames: impl Fn(f64) -> [MovingPose; 2],
        seconds: f64,
        mut each: impl FnMut(&SkillValue, &Phase),
    ) -> (Pose, Pose) {
        let policy = SkillPolicy::Canonical(skill());
        let dt = 1e-3;
        let mut pose = Pose {
            position: DVec3::new(0.35, 0.2, 0.4),
            orientation: DQuat::from_scaled_axis(DVec3::new(2.0, -0.4, 0.9)),
        };
        let mut velocity =
            Twist { linear: DVec3::new(0.2, 0.1, -0.1), angular: DVec3::new(0.3, 0.0, 0.5) };
        let mut state = PolicyState::default();
        let steps = (seconds / dt) as usize;
        for step in 0..steps {
            let t = step as f64 * dt;
            let value = policy.evaluate(&INERTIA, &frames(t), &pose, &velocity, &mut state);
            each(&value, &state.phase().unwrap());
            let acceleration = value.natural.resolve().unwrap().into();
            state.advance(&value, &acceleration, dt);
            velocity = velocity.advanced(&acceleration, dt);
            pose = pose.advanced(&velocity, dt);
        }
        (pose, policy.goal(&frames(seconds), &mut state))
    }

    fn at(position: [f64; 3], yaw: f64) -> MovingPose {
        MovingPose::at_rest(Pose {
            position: position.into(),
            orientation: DQuat::from_rotation_z(yaw),
        })
    }

    #[test]
    fn the_goal_is_reached_and_the_energy_never_rises_wherever_the_frames_are() {
        for (goal, yaw) in [([0.58, -0.2, 0.08], -0.7), ([0.37, 0.4, 0.3], 1.6)] {
            let mut last = f64::INFINITY;
            let (pose, goal) = rollout(
                |_| [at([0.37, 0.2, 0.33], 0.4), at(goal, yaw)],
                40.0,
                |value, _| {
                    assert!(value.energy <= last + 1e-9, "{} > {last}", value.energy);
                    last = value.energy;
                },
            );
            let error = (pose.position - goal.position).length();
            assert!(error < 1e-6, "{error:e}");
            assert!(pose.rotation_from(&goal).length() < 1e-6);
        }
    }

    #[test]
    fn a_goal_on_a_circle_that_turns_is_caught() {
        let omega = 0.9;
        let (pose, goal) = rollout(
            |t| {
                let (s, c) = (omega * t).sin_cos();
                let mut goal = at([0.5 + 0.15 * c, -0.25 + 0.15 * s, 0.03], 0.4 * (0.5 * t).sin());
                goal.velocity.linear = DVec3::new(-s, c, 0.0) * (0.15 * omega);
                goal.acceleration.linear = DVec3::new(-c, -s, 0.0) * (0.15 * omega * omega);
                goal.velocity.angular = DVec3::Z * (0.2 * (0.5 * t).cos());
                goal.acceleration.angular = DVec3::Z * (-0.1 * (0.5 * t).sin());
                [at([0.4, 0.1, 0.3], 0.1), goal]
            },
            14.0,
            |_, _| {},
        );
        // The semi-implicit rule itself leaves some dt v behind.
        assert!((pose.position - goal.position).length() < 2e-4);
        assert!(pose.rotation_from(&goal).length() < 2e-4);
    }

    #[test]
    fn eliminating_the_phase_changes_nothing_but_hides_it() {
        let skill = skill();
        let d = skill.transforms(&[at([0.37, 0.2, 0.33], 0.4), at([0.58, -0.2, 0.08], -0.7)]);
        let d = d.unwrap();
        let pose = Pose {
            position: DVec3::new(0.45, -0.05, 0.2),
            orientation: DQuat::from_scaled_axis(DVec3::new(2.5, 0.3, 0.4)),
        };
        let phase = Phase { value: 0.4, rate_1_s: 0.3 };
        let velocity = Twist { linear: DVec3::X, angular: DVec3::Y };
        let value = skill.evaluate(&INERTIA, &d, &pose, &velocity, &phase);
        let metric = value.natural.metric;
        assert!((metric - metric.transpose()).norm() < 1e-12);
        assert!(metric.cholesky().is_some());

        // The same from the form of pose and phase together, with all zeros written out.
        let transported = skill.map.at(&d, 0.4, 0.3);
        let PositionField::Space(position) = &skill.position else { panic!("in space") };
        let blocks = [
            (position, INERTIA.linear_kg, transported.position(pose.position, DVec3::X)),
            (
                skill.orientation.as_ref().unwrap(),
                INERTIA.angular_kg_m2,
                transported.rotation(pose.orientation, DVec3::Y),
            ),
        ];
        let (mut joint, mut energy) = (Natural::<7>::zero(), 0.0);
        for (k, (field, scale, mapped)) in blocks.into_iter().enumerate() {
            let lifted = |v: DVec3, last: f64| Vector4::new(v.x, v.y, v.z, last);
            let rate = lifted(mapped.velocity, phase.rate_1_s);
            let value = field.evaluate(&lifted(mapped.point, phase.value), &rate);
            let leaf = Natural { force: value.force(&rate) * scale, metric: value.metric * scale };
            let mut rows = SMatrix::<f64, 4, 7>::zeros();
            for i in 0..3 {
                for j in 0..3 {
                    rows[(i, 3 * k + j)] = mapped.jacobian.col(j)[i];
                }
            }
            rows.set_column(6, &lifted(mapped.phase_derivative, 1.0));
            joint.add_pullback(&leaf, &rows, &lifted(mapped.drift, 0.0));
            energy += value.energy(&rate) * scale;
        }
        let both = joint.resolve().unwrap();
        let tool = value.natural.resolve().unwrap();
        assert!((both.fixed_rows::<6>(0) - tool).norm() < 1e-9 * (1.0 + tool.norm()));
        let acceleration = value.phase.free - value.phase.coupling.dot(&tool);
        assert!((both[6] - acceleration).abs() < 1e-9 * (1.0 + acceleration.abs()));
        assert!((energy - value.energy).abs() < 1e-12);
    }

    #[test]
    fn the_phase_waits_for_a_tool_that_is_held_and_finds_one_that_is_set_down() {
        let skill = skill();
        let frames = [skill.map.anchors()[0].frame, skill.map.goal_frame()];
        let d = skill.transforms(&frames.map(MovingPose::at_rest)).unwrap();
        let on_the_way = |s: f64| {
            let (start, goal) = (skill.map.anchors()[0].point, skill.map.goal());
            let r = DVec3::new(-0.6, 0.2, 0.1) * (1.0 - s);
            Pose {
                position: start.lerp(goal.position, s),
                orientation: goal.orientation * DQuat::from_scaled_axis(r),
            }
        };
        for s in [0.0, 0.3, 0.62, 1.0] {
            let phase = skill.nearest_phase(&INERTIA, &d, &on_the_way(s));
            assert!((phase.value - s).abs() < 0.05, "{s} {}", phase.value);
            assert_eq!(phase.rate_1_s, 0.0);
        }
        let pose = on_the_way(0.5);
        let mut phase = skill.nearest_phase(&INERTIA, &d, &pose);
        for _ in 0..20_000 {
            let value = skill.evaluate(&INERTIA, &d, &pose, &Twist::ZERO, &phase);
            phase.advance(&value.phase, &SpatialAcceleration::ZERO, 1e-3);
        }
        assert!((0.5..0.98).contains(&phase.value) && phase.rate_1_s.abs() < 1e-6, "{phase:?}");
    }

    #[test]
    fn a_phase_waits_for_a_tool_that_is_held_but_not_for_an_obstacle() {
        let skill = skill();
        let frames = [skill.map.anchors()[0].frame, skill.map.goal_frame()];
        let frames = frames.map(MovingPose::at_rest);
        let pose = Pose {
            position: skill.map.anchors()[0].point,
            orientation: skill.map.goal().orientation,
        };
        let policy = SkillPolicy::Canonical(skill);
        let value_after = |obstructed_fraction: f64| {
            let mut state = PolicyState::default();
            for _ in 0..40_000 {
                let value = policy.evaluate(&INERTIA, &frames, &pose, &Twist::ZERO, &mut state);
                state.set_obstructed(obstructed_fraction);
                state.advance(&value, &SpatialAcceleration::ZERO, 1e-3);
            }
            state.phase().unwrap().value
        };
        let (held, obstructed) = (value_after(0.0), value_after(0.5));
        assert!(held < 0.9 && obstructed > 0.97, "{held} {obstructed}");
    }

    #[test]
    fn a_planar_field_leaves_height_and_orientation_alone() {
        let mut skill = skill();
        let plane = Component::<3> {
            mean: Vector3::new(0.5, -0.25, 1.0),
            metric: Matrix3::identity(),
            potential: 0.0,
            gradient: Vector3::zeros(),
            hessian: Matrix3::identity() * 16.0,
        };
        skill.position = PositionField::Plane(Box::new(Field::new(&[plane], 0.1, 8.0).unwrap()));
        skill.orientation = None;
        let frames = [skill.map.anchors()[0].frame, skill.map.goal_frame()];
        let d = skill.transforms(&frames.map(MovingPose::at_rest)).unwrap();
        let phase = Phase { value: 0.1, rate_1_s: 0.0 };
        let velocity = Twist { linear: DVec3::X, angular: DVec3::ZERO };
        let value = skill.evaluate(&INERTIA, &d, &frames[0], &velocity, &phase);
        assert!(value.natural.force.fixed_rows::<3>(3).norm() == 0.0);
        assert!(value.natural.metric.fixed_view::<3, 3>(3, 3).norm() == 0.0);
        assert!(value.natural.metric[(0, 0)] > 0.5);
    }
}
