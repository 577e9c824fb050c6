//! The leaf of a learned skill: fields in canonical coordinates, pulled back through the frame map
//! to the pose of the tool.

use glam::{DMat3, DVec3};
use nalgebra::{Matrix3, Matrix6, Vector2, Vector3, Vector6};

use crate::field::Field;
use crate::frame_map::{Displacement, FrameMap, Mapped, Pose};
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
    /// V = Φ + ½ ẏᵀMẏ \[J\]: never rises while the frames stand still.
    pub energy: f64,
    /// Determinant of the frame map.
    pub determinant: f64,
}

fn to_nalgebra(m: DMat3) -> Matrix3<f64> {
    Matrix3::from_column_slice(&m.to_cols_array())
}

fn vector(v: DVec3) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// A field's value as force and metric in space, and its energy.
struct Block {
    force: Vector3<f64>,
    metric: Matrix3<f64>,
    energy: f64,
}

impl Block {
    fn space(field: &Field<3>, y: DVec3, velocity: DVec3, inertia: f64) -> Self {
        let velocity = vector(velocity);
        let value = field.evaluate(&vector(y), &velocity);
        Self {
            force: value.force(&velocity) * inertia,
            metric: value.metric * inertia,
            energy: value.energy(&velocity) * inertia,
        }
    }

    fn plane(field: &Field<2>, y: DVec3, velocity: DVec3, inertia: f64) -> Self {
        let velocity = Vector2::new(velocity.x, velocity.y);
        let value = field.evaluate(&Vector2::new(y.x, y.y), &velocity);
        let mut block = Self {
            force: Vector3::zeros(),
            metric: Matrix3::zeros(),
            energy: value.energy(&velocity) * inertia,
        };
        let (mut force, metric) = (block.force.fixed_rows_mut::<2>(0), value.metric * inertia);
        force.copy_from(&(value.force(&velocity) * inertia));
        block.metric.fixed_view_mut::<2, 2>(0, 0).copy_from(&metric);
        block
    }
}

impl Skill {
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
        let (y, v) = (mapped.point, mapped.velocity);
        let position = match &self.position {
            PositionField::Plane(field) => {
                Block::plane(field, y.position, v.position, inertia.linear_kg)
            }
            PositionField::Space(field) => {
                Block::space(field, y.position, v.position, inertia.linear_kg)
            }
        };
        let orientation = self
            .orientation
            .as_ref()
            .map(|field| Block::space(field, y.rotation, v.rotation, inertia.angular_kg_m2));
        SkillValue {
            natural: pull_to_pose(&mapped, &position, orientation.as_ref()),
            energy: position.energy + orientation.map_or(0.0, |o| o.energy),
            determinant: mapped.determinant,
        }
    }
}

/// f_x = Jᵀ (f_y + M_y J b), M_x = JᵀM_yJ with J = [A 0; C E], since ÿ = J (ẍ − b).
fn pull_to_pose(mapped: &Mapped, position: &Block, orientation: Option<&Block>) -> Natural<6> {
    let a = to_nalgebra(mapped.position_jacobian);
    let (linear_bias, angular_bias) = (vector(mapped.linear_bias), vector(mapped.angular_bias));
    let bias_position = a * linear_bias;
    let force = position.force + position.metric * bias_position;
    let weighted = position.metric * a;
    let mut f = Vector6::zeros();
    let mut m = Matrix6::zeros();
    let mut linear_force = a.tr_mul(&force);
    let mut linear_metric = a.tr_mul(&weighted);
    if let Some(block) = orientation {
        let c = to_nalgebra(mapped.cross_jacobian);
        let e = to_nalgebra(mapped.rotation_jacobian);
        let force = block.force + block.metric * (c * linear_bias + e * angular_bias);
        let (mc, me) = (block.metric * c, block.metric * e);
        linear_force += c.tr_mul(&force);
        linear_metric += c.tr_mul(&mc);
        let cross = c.tr_mul(&me);
        f.fixed_rows_mut::<3>(3).copy_from(&e.tr_mul(&force));
        m.fixed_view_mut::<3, 3>(3, 3).copy_from(&e.tr_mul(&me));
        m.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
        m.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross.transpose());
    }
    f.fixed_rows_mut::<3>(0).copy_from(&linear_force);
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(&linear_metric);
    Natural { force: f, metric: m }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{Background, Component};
    use crate::frame_map::{CanonicalFrames, FrameMotion};
    use glam::DQuat;
    use nalgebra::Matrix2;

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
            position: PositionField::Space(Box::new(attractor(vector(goal.position), 16.0))),
            orientation: Some(Box::new(attractor(Vector3::zeros(), 12.0))),
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
