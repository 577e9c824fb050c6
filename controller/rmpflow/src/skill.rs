//! The leaf of a learned skill: fields in canonical coordinates, pulled back through the frame map
//! to the pose of the tool.

use glam::{DMat3, DVec3};
use nalgebra::{Matrix6, SMatrix, SVector, Vector6};

use crate::field::{Field, FieldValue};
use crate::frame_map::{DETERMINANT_MIN, Displacement, FrameMap, FrameMotion, Mapped, Pose};
use crate::natural::Natural;

/// The field of the position: in the plane z = const, or in space.
#[derive(Debug, Clone)]
pub enum PositionField {
    /// In the plane: x and y.
    Plane(Box<Field<2>>),
    /// In space.
    Space(Box<Field<3>>),
}

/// A learned skill: immutable.
#[derive(Debug, Clone)]
pub struct Skill {
    /// How the frames move the space.
    pub map: FrameMap,
    /// Position, with unit inertia at the goal.
    pub position: PositionField,
    /// Orientation chart, with unit inertia at the goal; `None` when orientation is free.
    pub orientation: Option<Box<Field<3>>>,
    /// Whether the start is fixed to the goal frame: then that is the only frame of the map.
    pub single_frame: bool,
}

/// How strongly a skill speaks where it meets other leaves: its inertia at the goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkillInertia {
    /// \[kg\]
    pub linear_kg: f64,
    /// \[kg m²\]
    pub angular_kg_m2: f64,
}

/// A skill at a moving pose.
#[derive(Debug, Clone, Copy)]
pub struct SkillValue {
    /// M ẍ = f on \[linear; angular\] of the pose, drift of the map included.
    pub natural: Natural<6>,
    /// V = Φ + ½ ẏᵀMẏ \[J\]: never rises while the frames stand still and the map of the frames
    /// does not fold.
    pub energy: f64,
    /// Whether the map of the frames folds here, so that it is evaluated with a larger determinant
    /// ([`DETERMINANT_MIN`](crate::frame_map::DETERMINANT_MIN)).
    pub folds: bool,
}

impl SkillValue {
    /// No policy yet.
    pub(crate) fn zero() -> Self {
        Self { natural: Natural::zero(), energy: 0.0, folds: false }
    }

    /// What comes of frames or parameters with which there is nothing to evaluate: not finite, so
    /// that [`Natural::resolve`] refuses it.
    pub(crate) fn undefined() -> Self {
        let natural =
            Natural { force: Vector6::repeat(f64::NAN), metric: Matrix6::repeat(f64::NAN) };
        Self { natural, energy: f64::NAN, folds: false }
    }

    /// Adds a field on coordinates y of the pose x, with ẏ = J ẋ and ÿ = J (ẍ − b):
    /// f += s Jᵀ (f_y + M_y J b), M += s JᵀM_yJ, V += s V_y  [thesis eq. 3.2].
    ///
    /// * `velocity`  ẏ, K
    /// * `scale`  s, by which the field's force and metric are multiplied
    /// * `jacobian`, `bias`  J, K×6 and b, 6 on \[linear; angular\]
    pub(crate) fn add<const K: usize>(
        &mut self,
        field: &FieldValue<K>,
        velocity: &SVector<f64, K>,
        scale: f64,
        jacobian: &SMatrix<f64, K, 6>,
        bias: &Vector6<f64>,
    ) {
        let leaf = Natural { force: field.force(velocity) * scale, metric: field.metric * scale };
        self.natural.add_pullback(&leaf, jacobian, &-(jacobian * bias));
        self.energy += field.energy(velocity) * scale;
    }

    fn add_position<const K: usize>(&mut self, field: &Field<K>, mapped: &Mapped, scale: f64) {
        let (y, v) = (head(mapped.point.position), head(mapped.velocity.position));
        let jacobian = rows(mapped.position_jacobian, DMat3::ZERO);
        self.add(&field.evaluate(&y, &v), &v, scale, &jacobian, &mapped.bias());
    }
}

/// The first K components.
fn head<const K: usize>(v: DVec3) -> SVector<f64, K> {
    SVector::from_fn(|i, _| v[i])
}

/// The first K rows of \[linear angular\].
fn rows<const K: usize>(linear: DMat3, angular: DMat3) -> SMatrix<f64, K, 6> {
    SMatrix::from_fn(|i, j| if j < 3 { linear.col(j)[i] } else { angular.col(j - 3)[i] })
}

impl Skill {
    /// How many frames the map takes: start and goal, or the goal's alone.
    #[must_use]
    pub fn frame_count(&self) -> usize {
        if self.single_frame { 1 } else { 2 }
    }

    /// Takes in where the frames are and how they move; `None` when there are too few.
    #[must_use]
    pub fn displace(&self, frames: &[FrameMotion]) -> Option<Displacement> {
        if self.single_frame {
            return Some(self.map.displace_rigidly(frames.first()?));
        }
        let [start, goal_frame, ..] = frames else { return None };
        Some(self.map.displace(start, goal_frame))
    }

    /// Evaluates the skill for a moving pose.
    ///
    /// * `displacement`  the frames as they are now
    /// * `linear`, `angular`  velocity of the pose in the world \[m/s, rad/s\]
    /// * `phase`  phase of the last call, replaced by the new one
    ///
    /// Hot path: no allocation. Input that is not finite gives output that is not finite.
    #[must_use]
    pub fn evaluate(
        &self,
        inertia: &SkillInertia,
        displacement: &Displacement,
        pose: &Pose,
        linear: DVec3,
        angular: DVec3,
        phase: &mut f64,
    ) -> SkillValue {
        let mapped = self.map.map(displacement, pose, linear, angular, phase);
        let mut value = SkillValue::zero();
        value.folds = mapped.determinant < DETERMINANT_MIN;
        match &self.position {
            PositionField::Plane(field) => value.add_position(field, &mapped, inertia.linear_kg),
            PositionField::Space(field) => value.add_position(field, &mapped, inertia.linear_kg),
        }
        if let Some(field) = &self.orientation {
            let (y, v) = (head(mapped.point.rotation), head(mapped.velocity.rotation));
            let jacobian = rows(mapped.cross_jacobian, mapped.rotation_jacobian);
            let scale = inertia.angular_kg_m2;
            value.add(&field.evaluate(&y, &v), &v, scale, &jacobian, &mapped.bias());
        }
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{Background, Component};
    use crate::frame_map::CanonicalFrames;
    use glam::DQuat;
    use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

    fn attractor(goal: Vector3<f64>, stiffness: f64) -> Field<3> {
        let component = |mean: Vector3<f64>, potential: f64| Component {
            mean,
            precision: Matrix3::identity() * 20.0,
            metric: Matrix3::new(1.2, 0.1, 0.0, 0.1, 0.9, 0.05, 0.0, 0.05, 1.1),
            potential,
            gradient: (mean - goal) * stiffness,
            hessian: Matrix3::identity() * stiffness,
        };
        let offset = Vector3::new(-0.2, 0.3, 0.2);
        let away = component(goal + offset, 0.5 * stiffness * offset.norm_squared());
        let background =
            Background { exponent: -10.0, metric: 1.0, offset: 0.0, slope: 20.0, softening: 0.05 };
        Field::new(&[away, component(goal, 0.0)], background, 8.0).unwrap()
    }

    fn skill() -> Skill {
        let pose = |p: [f64; 3], r: [f64; 3]| Pose {
            position: p.into(),
            orientation: DQuat::from_scaled_axis(r.into()),
        };
        let goal = pose([0.5, -0.25, 0.06], [3.0, 0.1, 0.2]);
        let map = FrameMap::new(CanonicalFrames {
            positions_turn: true,
            start: pose([0.4, 0.1, 0.3], [0.0, 0.2, 0.1]),
            goal_frame: pose([0.5, -0.25, 0.03], [0.0, 0.0, 0.3]),
            goal,
        })
        .unwrap();
        Skill {
            map,
            position: PositionField::Space(Box::new(attractor(head(goal.position), 16.0))),
            orientation: Some(Box::new(attractor(Vector3::zeros(), 12.0))),
            single_frame: false,
        }
    }

    const INERTIA: SkillInertia = SkillInertia { linear_kg: 2.0, angular_kg_m2: 0.1 };

    /// Integrates the resolved acceleration of the pose: a free rigid body that obeys the skill.
    fn rollout(
        frames: impl Fn(f64) -> (FrameMotion, FrameMotion),
        seconds: f64,
        mut each: impl FnMut(&SkillValue),
    ) -> (Pose, Pose) {
        let skill = skill();
        let dt = 1e-3;
        let mut pose = Pose {
            position: DVec3::new(0.35, 0.2, 0.4),
            orientation: DQuat::from_scaled_axis(DVec3::new(2.0, -0.4, 0.9)),
        };
        let (mut linear, mut angular) = (DVec3::new(0.2, 0.1, -0.1), DVec3::new(0.3, 0.0, 0.5));
        let mut phase = 0.0;
        let steps = (seconds / dt) as usize;
        let mut evaluate = |t: f64, pose: &Pose, linear: DVec3, angular: DVec3| {
            let (start, goal) = frames(t);
            let d = skill.map.displace(&start, &goal);
            let value = skill.evaluate(&INERTIA, &d, pose, linear, angular, &mut phase);
            let a = value.natural.resolve().unwrap();
            (value, DVec3::new(a[0], a[1], a[2]), DVec3::new(a[3], a[4], a[5]))
        };
        let moved = |pose: &Pose, linear: DVec3, angular: DVec3, h: f64| Pose {
            position: pose.position + linear * h,
            orientation: (DQuat::from_scaled_axis(angular * h) * pose.orientation).normalize(),
        };
        for step in 0..steps {
            let t = step as f64 * dt;
            let (value, a, alpha) = evaluate(t, &pose, linear, angular);
            each(&value);
            let (v2, w2) = (linear + a * (dt / 2.0), angular + alpha * (dt / 2.0));
            let middle = moved(&pose, (linear + v2) * 0.5, (angular + w2) * 0.5, dt / 2.0);
            let (_, a, alpha) = evaluate(t + dt / 2.0, &middle, v2, w2);
            pose = moved(&pose, linear + a * (dt / 2.0), angular + alpha * (dt / 2.0), dt);
            linear += a * dt;
            angular += alpha * dt;
        }
        let canonical = skill.map.canonical();
        let (_, goal) = frames(seconds);
        let grasp = canonical.goal_frame.inverse().compose(&canonical.goal);
        (pose, goal.pose.compose(&grasp))
    }

    fn at(position: [f64; 3], yaw: f64) -> FrameMotion {
        FrameMotion::at_rest(Pose {
            position: position.into(),
            orientation: DQuat::from_rotation_z(yaw),
        })
    }

    #[test]
    fn the_goal_is_reached_and_the_energy_never_rises_for_displaced_and_turned_frames() {
        let mut last = f64::INFINITY;
        let (pose, goal) = rollout(
            |_| (at([0.37, 0.2, 0.33], 0.4), at([0.58, -0.2, 0.08], -0.7)),
            14.0,
            |value| {
                assert!(value.energy <= last + 1e-7, "{} > {last}", value.energy);
                last = value.energy;
            },
        );
        assert!((pose.position - goal.position).length() < 1e-6);
        assert!(pose.rotation_from(&goal).length() < 1e-6);
    }

    #[test]
    fn a_goal_on_a_circle_that_turns_is_caught() {
        let omega = 0.9;
        let (pose, goal) = rollout(
            |t| {
                let (s, c) = (omega * t).sin_cos();
                let mut goal = at([0.5 + 0.15 * c, -0.25 + 0.15 * s, 0.03], 0.4 * (0.5 * t).sin());
                goal.linear_velocity = DVec3::new(-s, c, 0.0) * (0.15 * omega);
                goal.linear_acceleration = DVec3::new(-c, -s, 0.0) * (0.15 * omega * omega);
                goal.angular_velocity = DVec3::Z * (0.2 * (0.5 * t).cos());
                goal.angular_acceleration = DVec3::Z * (-0.1 * (0.5 * t).sin());
                (at([0.4, 0.1, 0.3], 0.1), goal)
            },
            10.0,
            |_| {},
        );
        assert!((pose.position - goal.position).length() < 1e-6);
        assert!(pose.rotation_from(&goal).length() < 1e-6);
    }

    #[test]
    fn with_a_single_frame_the_whole_space_moves_rigidly() {
        let skill = Skill { single_frame: true, ..skill() };
        let canonical = *skill.map.canonical();
        let mut frame = at([0.2, 0.4, 0.1], 2.0);
        let y = crate::frame_map::Canonical {
            position: DVec3::new(0.45, 0.0, 0.2),
            rotation: DVec3::new(0.3, -0.2, 0.1),
        };
        let displacement = skill.displace(&[frame]).unwrap();
        let seen = skill.map.forward(&displacement, &y);
        let shown = skill.displace(&[FrameMotion::at_rest(canonical.goal_frame)]).unwrap();
        let before = skill.map.forward(&shown, &y);
        let relative = |frame: &Pose, pose: &Pose| frame.inverse().compose(pose);
        let (a, b) = (relative(&frame.pose, &seen), relative(&canonical.goal_frame, &before));
        assert!((a.position - b.position).length() < 1e-12);
        assert!(a.rotation_from(&b).length() < 1e-12);
        // A tool that is carried along rests in canonical coordinates.
        frame.angular_velocity = DVec3::new(0.1, 0.4, -0.3);
        frame.linear_velocity = DVec3::new(0.2, 0.1, 0.0);
        let carried = frame.carrying(&a);
        let displacement = skill.displace(&[frame]).unwrap();
        let (linear, angular) = (carried.linear_velocity, carried.angular_velocity);
        let mapped = skill.map.map(&displacement, &seen, linear, angular, &mut 0.5);
        assert!(mapped.velocity.position.length() < 1e-12);
        assert!(mapped.velocity.rotation.length() < 1e-12);
        assert!((mapped.linear_bias - carried.linear_acceleration).length() < 1e-11);
        assert!(skill.displace(&[]).is_none());
    }

    #[test]
    fn metric_is_symmetric_and_positive_definite() {
        let skill = skill();
        let d = skill.map.displace(&at([0.37, 0.2, 0.33], 0.4), &at([0.58, -0.2, 0.08], -0.7));
        let pose = Pose {
            position: DVec3::new(0.45, -0.05, 0.2),
            orientation: DQuat::from_scaled_axis(DVec3::new(2.5, 0.3, 0.4)),
        };
        let value = skill.evaluate(&INERTIA, &d, &pose, DVec3::X, DVec3::Y, &mut 0.5);
        let metric = value.natural.metric;
        assert!((metric - metric.transpose()).norm() < 1e-12);
        assert!(metric.cholesky().is_some());
    }

    #[test]
    fn a_planar_field_leaves_height_and_orientation_alone() {
        let mut skill = skill();
        let plane = Component::<2> {
            mean: Vector2::new(0.5, -0.25),
            precision: Matrix2::identity() * 20.0,
            metric: Matrix2::identity(),
            potential: 0.0,
            gradient: Vector2::zeros(),
            hessian: Matrix2::identity() * 16.0,
        };
        let background =
            Background { exponent: -10.0, metric: 1.0, offset: 0.0, slope: 20.0, softening: 0.05 };
        skill.position =
            PositionField::Plane(Box::new(Field::new(&[plane], background, 8.0).unwrap()));
        skill.orientation = None;
        let canonical = *skill.map.canonical();
        let d = skill.map.displace(
            &FrameMotion::at_rest(canonical.start),
            &FrameMotion::at_rest(canonical.goal_frame),
        );
        let pose = canonical.start;
        let value = skill.evaluate(&INERTIA, &d, &pose, DVec3::X, DVec3::ZERO, &mut 0.0);
        assert!(value.natural.force.fixed_rows::<3>(3).norm() == 0.0);
        assert!(value.natural.metric.fixed_view::<3, 3>(3, 3).norm() == 0.0);
        assert!(value.natural.metric[(0, 0)] > 0.5);
    }
}
