//! The tree on a planar arm of three joints: its energy falls, limits hold, nothing touches.

#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    clippy::disallowed_macros,
    reason = "tests may do what the crate never does"
)]

use glam::{DQuat, DVec2, DVec3};
use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};
use proptest::prelude::*;
use tprmp_rmpflow::leaves::{
    Avoidance, Barrier, Body, JointDamping, JointLimits, JointSpeedLimits, Obstacle, Part, Posture,
    Proximity, SelfCollision, Shape, Side, SpeedBarrier, Steering, Task, Tick,
};
use tprmp_rmpflow::natural::Natural;
use tprmp_rmpflow::tree::{Resolved, Tree, TreeState};
use tprmp_spatial::{PointMotion, Pose, Twist};

const LEAF: Barrier = Barrier {
    activation_distance: 0.15,
    distance_min: 0.002,
    inertia: 1.0,
    rest_fraction: 0.1,
    approach_speed: 0.5,
    repulsion: 0.02,
    damping_1_s: 8.0,
};

const STEERING: Steering = Steering {
    range_m: 0.15,
    gain: 4.0,
    response_1_s: 8.0,
    approach_1_s: 1.0,
    speed_max_m_s: 1.5,
    side: Side::Plane,
};

/// Three links of half a metre in the plane, with balls at the links' ends and middles.
struct Arm {
    q: Vector3<f64>,
    qd: Vector3<f64>,
}

const LENGTH: f64 = 0.5;
const RADIUS: f64 = 0.06;

impl Body<3> for Arm {
    fn count(&self) -> usize {
        6
    }

    fn ball(&self, i: usize) -> (DVec3, f64) {
        (self.motion(i).position, RADIUS)
    }

    fn motion(&self, i: usize) -> PointMotion<3> {
        let (mut angle, mut rate) = (0.0, 0.0);
        let mut motion = PointMotion {
            position: DVec3::ZERO,
            velocity: DVec3::ZERO,
            jacobian: SMatrix::zeros(),
            drift: Vector3::zeros(),
        };
        for link in 0..=i / 2 {
            angle += self.q[link];
            rate += self.qd[link];
            let length = if link == i / 2 && i.is_multiple_of(2) { 0.5 * LENGTH } else { LENGTH };
            let along = DVec2::from_angle(angle) * length;
            motion.position += along.extend(0.0);
            motion.velocity += along.perp().extend(0.0) * rate;
            motion.drift -= Vector3::new(along.x, along.y, 0.0) * (rate * rate);
            for joint in 0..=link {
                motion.jacobian[(0, joint)] -= along.y;
                motion.jacobian[(1, joint)] += along.x;
            }
        }
        motion
    }

    fn acts_within(&self, _: usize, _: &Shape) -> f64 {
        f64::INFINITY
    }

    fn at_goal(&self, _: usize) -> Option<DVec3> {
        None
    }
}

/// The same arm, which knows that two balls each make up a link.
struct Links<'a>(&'a Arm);

impl Body<3> for Links<'_> {
    fn count(&self) -> usize {
        self.0.count()
    }

    fn part_count(&self) -> usize {
        3
    }

    fn part(&self, k: usize) -> Part {
        let ends = [2 * k, 2 * k + 1].map(|i| self.0.motion(i).position);
        Part {
            position: 0.5 * (ends[0] + ends[1]),
            radius: 0.25 * LENGTH + RADIUS,
            points: 2 * k..2 * k + 2,
        }
    }

    fn ball(&self, i: usize) -> (DVec3, f64) {
        self.0.ball(i)
    }

    fn motion(&self, i: usize) -> PointMotion<3> {
        self.0.motion(i)
    }

    fn acts_within(&self, i: usize, shape: &Shape) -> f64 {
        self.0.acts_within(i, shape)
    }

    fn at_goal(&self, i: usize) -> Option<DVec3> {
        self.0.at_goal(i)
    }
}

fn tree(steering: Option<Steering>) -> Tree<3> {
    Tree {
        joint_damping: JointDamping { inertia: 0.1, damping_1_s: 8.0 },
        joint_limits: Some(JointLimits {
            lower: Vector3::repeat(-2.4),
            upper: Vector3::new(2.4, 2.4, f64::INFINITY),
            leaf: Barrier { activation_distance: 0.3, ..LEAF },
        }),
        joint_speed_limits: Some(JointSpeedLimits {
            speed_max: Vector3::repeat(1.5),
            leaf: SpeedBarrier { free_fraction: 0.6, inertia: 0.1, damping_1_s: 8.0 },
        }),
        posture: Some(Posture {
            position: Vector3::new(0.5, 0.5, 0.5),
            inertia: 0.02,
            stiffness_1_s2: 4.0,
            damping_1_s: 4.0,
            saturation: 0.5,
        }),
        self_collision: Some(SelfCollision {
            leaf: LEAF,
            margin_m: 0.01,
            pairs: vec![(0, 4), (0, 5), (1, 5)].into(),
        }),
        avoidance: Some(Avoidance { leaf: LEAF, steering, margin_m: 0.01 }),
        obstacle_jerk_max: None,
    }
}

/// A spring on the tip with saturated pull, and its energy.
struct Pull {
    goal: DVec3,
}

impl Pull {
    const INERTIA: f64 = 1.0;
    const STIFFNESS: f64 = 16.0;
    const DAMPING: f64 = 8.0;
    const SATURATION: f64 = 0.3;

    fn leaf(&self, tip: &PointMotion<3>) -> Task<3> {
        let away = tip.position - self.goal;
        let pull =
            away * (Self::STIFFNESS * Self::SATURATION / away.length().hypot(Self::SATURATION));
        let force = (pull + tip.velocity * Self::DAMPING) * -Self::INERTIA;
        let leaf = Natural::<2> {
            force: Vector2::new(force.x, force.y),
            metric: SMatrix::identity() * Self::INERTIA,
        };
        let mut root = Natural::zero();
        let rows = tip.jacobian.fixed_rows::<2>(0).into_owned();
        root.add_pullback(&leaf, &rows, &tip.drift.fixed_rows::<2>(0).into_owned());
        Task { natural: root, energy: self.energy(tip) }
    }

    fn energy(&self, tip: &PointMotion<3>) -> f64 {
        let s = Self::SATURATION;
        let potential = (tip.position - self.goal).length().hypot(s) - s;
        Self::INERTIA * (Self::STIFFNESS * s * potential + 0.5 * tip.velocity.length_squared())
    }
}

fn resolved<B: Body<3>>(
    tree: &Tree<3>,
    task: Task<3>,
    (arm, body): (&Arm, &B),
    obstacles: &[Obstacle],
    state: &mut TreeState<3>,
) -> Resolved<3> {
    let (position, velocity) = (arm.q, arm.qd);
    let tick = Tick { task, position, velocity, body, obstacles, dt_s: 1e-3 };
    tree.evaluate(&tick, state).unwrap()
}

/// V of the whole tree.
fn energy(tree: &Tree<3>, pull: &Pull, arm: &Arm, obstacles: &[Obstacle]) -> f64 {
    let (q, qd) = (&arm.q, &arm.qd);
    let mut total = pull.energy(&arm.motion(5));
    total += 0.5 * tree.joint_damping.inertia * qd.norm_squared();
    total += tree.joint_limits.unwrap().energy(q, qd);
    total += tree.joint_speed_limits.unwrap().energy(qd);
    total += tree.posture.unwrap().energy(q, qd);
    let pairs = tree.self_collision.as_ref().unwrap();
    for &(i, j) in &pairs.pairs {
        let (a, b) = (arm.motion(i), arm.motion(j));
        let between = a.position - b.position;
        let rate = between.normalize().dot(a.velocity - b.velocity);
        let distance = between.length() - 2.0 * RADIUS - pairs.margin_m;
        total += pairs.leaf.energy(distance, rate);
    }
    let avoidance = tree.avoidance.unwrap();
    for obstacle in obstacles {
        for i in 0..arm.count() {
            let m = arm.motion(i);
            let c = obstacle.clearance(m.position, m.velocity, RADIUS + avoidance.margin_m);
            total += avoidance.leaf.energy(c.distance, c.rate);
        }
    }
    total
}

fn obstacles() -> [Obstacle; 3] {
    [
        Obstacle::sphere(DVec3::new(0.9, 1.0, 0.0), 0.12, DVec3::ZERO),
        Obstacle {
            shape: Shape::Capsule { radius: 0.05, half_length: 0.2 },
            pose: Pose {
                position: DVec3::new(-0.4, 0.9, 0.0),
                orientation: DQuat::from_rotation_x(1.3),
            },
            velocity: Twist::ZERO,
        },
        Obstacle {
            shape: Shape::HalfSpace,
            pose: Pose {
                position: DVec3::Y * -0.5,
                orientation: DQuat::from_rotation_arc(DVec3::Z, DVec3::Y),
            },
            velocity: Twist::ZERO,
        },
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn the_energy_of_the_whole_tree_never_rises_and_every_limit_holds(
        q in [-0.6..1.4_f64, -1.5..1.5_f64, -1.5..1.5_f64],
        goal in [-1.4..1.4_f64, -0.4..1.4_f64],
    ) {
        let tree = tree(None);
        let obstacles = obstacles();
        let pull = Pull { goal: DVec3::new(goal[0], goal[1], 0.0) };
        let mut arm = Arm { q: Vector3::from(q), qd: Vector3::zeros() };
        prop_assume!(obstacles.iter().all(|o| {
            (0..arm.count()).all(|i| o.distance(arm.motion(i).position, RADIUS) > 0.03)
        }));
        let mut state = TreeState::default();
        let dt = 2e-4;
        let start = energy(&tree, &pull, &arm, &obstacles);
        let mut before = start;
        for step in 0..15_000 {
            let task = pull.leaf(&arm.motion(5));
            let solved = resolved(&tree, task, (&arm, &arm), &obstacles, &mut state);
            // The midpoint rule: the energy error of a step is of third order.
            let middle = Arm {
                q: arm.q + arm.qd * (0.5 * dt),
                qd: arm.qd + solved.acceleration * (0.5 * dt),
            };
            let task = pull.leaf(&middle.motion(5));
            let solved = resolved(&tree, task, (&middle, &middle), &obstacles, &mut state);
            arm.q += middle.qd * dt;
            arm.qd += solved.acceleration * dt;
            let now = energy(&tree, &pull, &arm, &obstacles);
            prop_assert!(now <= before + 1e-6 * start.max(1.0), "step {}: {} > {}", step, now, before);
            before = now;
            prop_assert!(solved.proximity.clearance_min_m > -0.01);
            prop_assert!(solved.self_clearance_min_m > 0.0);
            prop_assert!(solved.conditioning > 0.0 && solved.conditioning <= 1.0);
            prop_assert!(arm.q[0] < 2.4 && arm.q.min() > -2.4);
            prop_assert!(arm.qd.amax() < 1.5, "{}", arm.qd);
        }
    }

    /// Parts that are passed over as a whole change no bit.
    #[test]
    fn what_is_passed_over_with_its_part_would_not_have_counted(
        q in [-2.4..2.4_f64, -2.4..2.4_f64, -2.4..2.4_f64],
        qd in [-1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64],
        place in [-1.5..1.5_f64, -0.4..1.5_f64],
        shape in 0..3_usize,
    ) {
        let arm = Arm { q: Vector3::from(q), qd: Vector3::from(qd) };
        let position = DVec3::new(place[0], place[1], 0.0);
        let mut obstacle = obstacles()[shape];
        obstacle.pose.position = position;
        let task = Pull { goal: DVec3::new(0.7, 1.0, 0.0) }.leaf(&arm.motion(5));
        fn found<B: Body<3>>(
            (arm, body): (&Arm, &B), task: Task<3>, obstacle: Obstacle, pairs: &[(usize, usize)],
        ) -> (SVector<f64, 3>, Proximity, f64) {
            let mut tree = tree(Some(STEERING));
            if let Some(own) = &mut tree.self_collision {
                own.pairs = pairs.into();
            }
            let state = &mut TreeState::default();
            let found = resolved(&tree, task, (arm, body), &[obstacle], state);
            (found.acceleration, found.proximity, found.self_clearance_min_m)
        }
        let points = found((&arm, &arm), task, obstacle, &[(0, 4), (0, 5), (1, 4), (1, 5)]);
        let links = found((&arm, &Links(&arm)), task, obstacle, &[(0, 2)]);
        prop_assert_eq!(points, links);
    }

    #[test]
    fn the_metric_of_the_leaves_is_symmetric_and_positive_semi_definite(
        q in [-2.3..2.3_f64, -2.3..2.3_f64, -2.3..2.3_f64],
        qd in [-2.0..2.0_f64, -2.0..2.0_f64, -2.0..2.0_f64],
    ) {
        let tree = tree(None);
        let arm = Arm { q: Vector3::from(q), qd: Vector3::from(qd) };
        let check = |root: &Natural<3>| {
            let m: Matrix3<f64> = root.metric;
            (m - m.transpose()).norm() < 1e-9 * (1.0 + m.norm())
                && m.symmetric_eigenvalues().min() > -1e-9 * (1.0 + m.norm())
                && root.force.iter().all(|f| f.is_finite())
        };
        let mut root = Natural::zero();
        tree.joint_limits.unwrap().add(&arm.q, &arm.qd, &mut root);
        prop_assert!(check(&root));
        let mut root = Natural::zero();
        tree.joint_speed_limits.unwrap().add(&arm.qd, &mut root);
        prop_assert!(check(&root));
        prop_assert!(check(&tree.posture.unwrap().evaluate(&arm.q, &arm.qd)));
        let mut state = TreeState::default();
        let natural = Natural { force: Vector3::zeros(), metric: Matrix3::identity() };
        let task = Task { natural, energy: 0.0 };
        let solved = resolved(&tree, task, (&arm, &arm), &obstacles(), &mut state);
        prop_assert!(solved.acceleration.iter().all(|a| a.is_finite()));
    }

    /// Force and curvature of each leaf are those of its energy: without damping V̇ = 0, by finite
    /// differences along q̈ = M⁻¹f.
    #[test]
    fn without_damping_the_energy_of_joint_leaves_stays(
        q in [-2.35..2.35_f64, -2.35..2.35_f64, -2.35..2.35_f64],
        qd in [-1.4..1.4_f64, -1.4..1.4_f64, -1.4..1.4_f64],
    ) {
        let tree = tree(None);
        let (q, qd) = (Vector3::from(q), Vector3::from(qd));
        let free = |leaf: Barrier| Barrier { damping_1_s: 0.0, ..leaf };
        let limits = tree.joint_limits.map(|l| JointLimits { leaf: free(l.leaf), ..l }).unwrap();
        let mut speeds = tree.joint_speed_limits.unwrap();
        speeds.leaf.damping_1_s = 0.0;
        let posture = tree.posture.map(|p| Posture { damping_1_s: 0.0, ..p }).unwrap();
        let mut root = Natural { force: Vector3::zeros(), metric: Matrix3::identity() };
        limits.add(&q, &qd, &mut root);
        speeds.add(&qd, &mut root);
        root.add(&posture.evaluate(&q, &qd));
        let a = root.resolve().unwrap();
        let h = 1e-6;
        let at = |t: f64| {
            let (q, qd): (SVector<f64, 3>, _) = (q + qd * t + a * (0.5 * t * t), qd + a * t);
            limits.energy(&q, &qd) + speeds.energy(&qd) + posture.energy(&q, &qd)
                + 0.5 * qd.norm_squared()
        };
        // Not across the edge of a leaf, where the second derivative jumps.
        let change = (at(h) - at(-h)) / (2.0 * h);
        prop_assert!(change.abs() < 1e-4 * (1.0 + root.force.norm() * qd.norm()), "{}", change);
    }
}

#[test]
fn a_link_that_is_blocked_goes_around_the_obstacle() {
    // Balls in the path of the outermost link: each holds it, or hardly, without the steering.
    let pull = Pull { goal: DVec3::new(0.7, 1.0, 0.0) };
    let run = |steering: Option<Steering>, ball: DVec3| {
        let ball = [Obstacle::sphere(ball, 0.1, DVec3::ZERO)];
        let tree = tree(steering);
        let mut arm = Arm { q: Vector3::new(-0.2, 0.2, 0.2), qd: Vector3::zeros() };
        let mut state = TreeState::default();
        for _ in 0..10_000 {
            let task = pull.leaf(&arm.motion(5));
            let solved = resolved(&tree, task, (&arm, &arm), &ball, &mut state);
            assert!(solved.proximity.clearance_min_m > -0.01);
            assert!(solved.acceleration.amax() < 400.0, "{}", solved.acceleration);
            arm.qd += solved.acceleration * 1e-3;
            arm.q += arm.qd * 1e-3;
        }
        (arm.motion(5).position - pull.goal).length()
    };
    let mut held = 0;
    for (x, y) in [(1.15, 0.4), (1.15, 0.5), (1.15, 0.6), (1.25, 0.5)] {
        let ball = DVec3::new(x, y, 0.0);
        held += usize::from(run(None, ball) > 0.1);
        let with = run(Some(STEERING), ball);
        assert!(with < 0.05, "{ball}: {with}");
    }
    assert!(held > 0, "no ball is in the way");
}

/// The pull leads the last link onto the first. Damping alone lets it creep on; repulsion stops it.
#[test]
fn links_that_are_pushed_together_never_touch() {
    let after = |repulsion: f64| {
        let leaf = Barrier { activation_distance: 0.05, rest_fraction: 0.005, repulsion, ..LEAF };
        let pairs = vec![(0, 4), (0, 5), (1, 5)].into();
        let tree = Tree {
            self_collision: Some(SelfCollision { leaf, margin_m: 0.0, pairs }),
            joint_limits: None,
            posture: None,
            ..tree(None)
        };
        let pull = Pull { goal: DVec3::new(0.3, 0.0, 0.0) };
        let mut arm = Arm { q: Vector3::new(0.2, 1.6, 1.6), qd: Vector3::zeros() };
        let (mut state, mut least) = (TreeState::default(), f64::INFINITY);
        for _ in 0..20_000 {
            let task = pull.leaf(&arm.motion(5));
            let solved = resolved(&tree, task, (&arm, &arm), &[], &mut state);
            arm.qd += solved.acceleration * 1e-3;
            arm.q += arm.qd * 1e-3;
            least = least.min(solved.self_clearance_min_m);
        }
        least
    };
    let kept = after(0.002);
    assert!(kept > LEAF.distance_min && kept < 0.1, "{kept}");
    let lost = after(0.0);
    assert!(lost < 0.0, "the pull does push: {lost}");
}
