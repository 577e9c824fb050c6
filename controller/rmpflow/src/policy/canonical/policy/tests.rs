use super::*;
use crate::policy::canonical::field::Component;
use crate::policy::canonical::frame_map::Anchor;
use crate::policy::skill_policy::{PolicyState, SkillPolicy};
use glam::DQuat;
use nalgebra::{Matrix3, Matrix4, SMatrix, Vector3, Vector4};
use tprmp_spatial::SpatialAcceleration;

/// A straight path from `start` to `goal`: a valley that falls along it.
fn path(start: Vector3<f64>, goal: Vector3<f64>, stiffness: f64) -> Field<4> {
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
        // Across the path ten times the inertia along it, but for the goal.
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
    let position = path(start.position.into(), goal.position.into(), 16.0);
    let orientation = path(Vector3::new(-0.6, 0.2, 0.1), Vector3::zeros(), 12.0);
    CanonicalPolicy {
        map: FrameMap::new(&anchors, goal, true).unwrap(),
        position: PositionField::Space(Box::new(position)),
        orientation: Some(Box::new(orientation)),
        restriction: None,
        cycle: None,
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
fn a_rotating_goal_on_a_circle_is_caught() {
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
    let on_the_path = |s: f64| {
        let (start, goal) = (skill.map.anchors()[0].point, skill.map.goal());
        let r = DVec3::new(-0.6, 0.2, 0.1) * (1.0 - s);
        Pose {
            position: start.lerp(goal.position, s),
            orientation: goal.orientation * DQuat::from_scaled_axis(r),
        }
    };
    for s in [0.0, 0.3, 0.62, 1.0] {
        let phase = skill.nearest_phase(&INERTIA, &d, &on_the_path(s));
        assert!((phase.value - s).abs() < 0.05, "{s} {}", phase.value);
        assert_eq!(phase.rate_1_s, 0.0);
    }
    let pose = on_the_path(0.5);
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
    let pose =
        Pose { position: skill.map.anchors()[0].point, orientation: skill.map.goal().orientation };
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

/// The skill on part of a pose, with angles that count from how its frames lie.
fn restricted(restriction: fn(&CanonicalPolicy) -> Restriction) -> SkillPolicy {
    let mut skill = skill();
    // Learned of poses that are turned about the vertical alone.
    let vertical = skill.map.goal().orientation.conjugate() * DVec3::Z;
    let orientation = path((vertical * -0.8).into(), Vector3::zeros(), 12.0);
    skill.orientation = Some(Box::new(orientation));
    skill.restriction = Some(restriction(&skill));
    if skill.restriction == Some(Restriction::Rotation) {
        // Learned of poses at the origin.
        let at_origin = |pose: Pose| Pose { position: DVec3::ZERO, ..pose };
        let anchors = [0, 1].map(|i| {
            let anchor = skill.map.anchors()[i];
            Anchor { frame: at_origin(anchor.frame), point: DVec3::ZERO, ..anchor }
        });
        skill.map = FrameMap::new(&anchors, at_origin(skill.map.goal()), true).unwrap();
        let position = path(Vector3::zeros(), Vector3::zeros(), 16.0);
        skill.position = PositionField::Space(Box::new(position));
    }
    SkillPolicy::Canonical(skill)
}

#[test]
fn on_part_of_a_pose_the_energy_never_rises_however_the_rest_of_it_is_moved() {
    let yaw = |skill: &CanonicalPolicy| {
        let mut frames = [DQuat::IDENTITY; FRAME_CAPACITY];
        for anchor in skill.map.anchors() {
            frames[anchor.index] = anchor.frame.orientation;
        }
        Restriction::Yaw { tool: skill.map.goal().orientation, frames }
    };
    for (policy, moved) in [(restricted(yaw), 4), (restricted(|_| Restriction::Rotation), 3)] {
        let frames = [at([0.37, 0.2, 0.33], 0.4), at([0.58, -0.2, 0.08], -0.7)];
        let mut pose = Pose {
            position: DVec3::new(0.35, 0.2, 0.4),
            orientation: DQuat::from_scaled_axis(DVec3::new(2.6, -0.4, 0.9)),
        };
        let mut velocity = Twist { linear: DVec3::X * 0.2, angular: DVec3::Z * 0.5 };
        let mut state = PolicyState::default();
        let (mut first, mut last) = (None, f64::INFINITY);
        let dt = 2e-4;
        for step in 0..100_000 {
            let value = policy.evaluate(&INERTIA, &frames, &pose, &velocity, &mut state);
            // A step of 0.2 ms leaves some of what the other acceleration does to what is moved.
            assert!(value.energy <= last + 1e-6, "{step}: {} > {last}", value.energy);
            first.get_or_insert(value.energy);
            last = value.energy;
            let svd = value.natural.metric.svd(true, true);
            assert_eq!(svd.rank(1e-9), moved);
            // What it does not move is moved by something else, to and fro.
            let other = Vector6::from_fn(|i, _| 5.0 * ((step * (i + 2)) as f64 * 1e-3).cos());
            let own = svd.pseudo_inverse(1e-9).unwrap() * value.natural.metric;
            let acceleration = svd.solve(&value.natural.force, 1e-9).unwrap() + other - own * other;
            let acceleration = acceleration.into();
            state.advance(&value, &acceleration, dt);
            velocity = velocity.advanced(&acceleration, dt);
            pose = pose.advanced(&velocity, dt);
        }
        let goal = policy.goal(&frames, &mut state);
        let beside = Vector6::from(Twist {
            linear: pose.position - goal.position,
            angular: pose.rotation_from(&goal),
        });
        assert!(first.unwrap() > last + 1.0, "{first:?} {last}");
        let moved = policy.moved();
        assert!(beside.component_mul(&moved).norm() < 1e-3, "{beside}");
    }
}
