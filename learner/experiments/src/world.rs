//! The world of an experiment: a free body that follows a policy while its goal moves, it is pushed,
//! and an obstacle is in the way.

use glam::{DQuat, DVec3};
use nalgebra::{Cholesky, Matrix6, SVector, Vector6};
use tprmp_model::skill_model::Manifold;
use tprmp_rmpflow::leaves::{
    Avoidance, AvoidanceState, Barrier, Free, FreeBall, Obstacle, Side, Steering, Task, Tick,
};
use tprmp_rmpflow::natural::Natural;
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration, Twist};

use super::follower::{Follower, INERTIA_KG, Moment, SPEED_MAX_M_S, Wish};
use super::metric::{STOP_SPEED_M_S, STOP_STEPS};

/// A body that is farther away has diverged [m].
const DIVERGED_M: f64 = 1e5;
/// A rollout ends when the body rests at its goal, nearer than this [m, rad] and slower [m/s, rad/s].
const AT_REST: f64 = 1e-7;

/// A sum of some ten terms is known no better than this, relative to its value.
const ENERGY_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// How the goal frame moves until the body is near the goal; then it stops.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GoalMotion {
    /// Radius of its circle around where it was shown [m].
    pub radius_m: f64,
    /// Angular speed on the circle [rad/s].
    pub speed_rad_s: f64,
    /// How far it turns about z to either side [rad].
    pub turn_rad: f64,
    /// Angular frequency of that [rad/s].
    pub turn_speed_rad_s: f64,
    /// It stops when the body is so near [m].
    pub stops_within_m: f64,
}

impl GoalMotion {
    /// On a circle.
    #[must_use]
    pub fn circle(radius_m: f64, speed_rad_s: f64, stops_within_m: f64) -> Self {
        Self { radius_m, speed_rad_s, stops_within_m, ..Self::default() }
    }

    /// The frame shown at `shown`, as it has moved at a time.
    #[must_use]
    pub fn at(&self, shown: &Pose, time_s: f64) -> MovingPose {
        let (sin, cos) = (self.speed_rad_s * time_s).sin_cos();
        let out = DVec3::new(cos, sin, 0.0) * self.radius_m;
        let along = DVec3::new(-sin, cos, 0.0) * (self.radius_m * self.speed_rad_s);
        let (turn_sin, turn_cos) = (self.turn_speed_rad_s * time_s).sin_cos();
        let (a, w) = (self.turn_rad, self.turn_speed_rad_s);
        MovingPose {
            pose: Pose {
                position: shown.position + out,
                orientation: DQuat::from_rotation_z(a * turn_sin) * shown.orientation,
            },
            velocity: Twist { linear: along, angular: DVec3::Z * (a * w * turn_cos) },
            acceleration: SpatialAcceleration {
                linear: -out * self.speed_rad_s.powi(2),
                angular: DVec3::Z * (-a * w * w * turn_sin),
            },
        }
    }
}

/// A force for a while, across the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Push {
    /// Size [N].
    pub force_n: f64,
    /// When it begins and ends [s].
    pub during_s: [f64; 2],
    /// With the direction (v_y, v_x), which is not orthogonal, as in the thesis' code.
    pub as_published: bool,
}

impl Push {
    fn force(&self, time_s: f64, velocity: DVec3) -> DVec3 {
        let [from, to] = self.during_s;
        if time_s < from - 1e-9 || time_s > to + 1e-9 {
            return DVec3::ZERO;
        }
        let v = velocity.normalize_or_zero();
        let direction = if self.as_published {
            DVec3::new(v.y, v.x, 0.0)
        } else {
            DVec3::new(-v.y, v.x, 0.0).normalize_or_zero()
        };
        direction * self.force_n
    }
}

/// A ball (in the plane: a disc) that goes along with half the goal's transforms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Centre when the goal is where it was shown [m].
    pub center: DVec3,
    /// Radius [m].
    pub radius_m: f64,
}

impl Ball {
    /// Where it is when the goal frame, shown at `shown`, is as it is.
    #[must_use]
    pub fn at(&self, goal_frame: &MovingPose, shown: &Pose) -> Obstacle {
        let centre = self.center + (goal_frame.pose.position - shown.position) * 0.5;
        Obstacle::sphere(centre, self.radius_m, goal_frame.velocity.linear * 0.5)
    }

    /// Whether the task can be done: while the goal goes round, neither the goal nor the start is in
    /// the ball or nearer to it than `room_m`.
    #[must_use]
    pub fn leaves_room(&self, course: &Course, room_m: f64) -> bool {
        let goal_frame = course.frames[1];
        let lever = course.goal(&MovingPose::at_rest(goal_frame)).position;
        (0..24).all(|i| {
            let angle = std::f64::consts::TAU * f64::from(i) / 24.0;
            let out = DVec3::new(angle.cos(), angle.sin(), 0.0) * course.goal_motion.radius_m;
            let center = self.center + out * 0.5;
            let free = |p: DVec3| (p - center).length() > self.radius_m + room_m;
            free(lever + out) && (i > 0 || free(course.start.position))
        })
    }
}

/// What keeps clear of the ball and leads around it, as in the planar controller, for the inertia of
/// the compared policies.
const CLEAR: Barrier = Barrier {
    activation_distance: 0.3,
    distance_min: 0.005,
    inertia: INERTIA_KG,
    rest_fraction: 0.1,
    approach_speed: 1.0,
    repulsion: 0.0,
    damping_1_s: 8.0,
};
const STEERING: Steering = Steering {
    range_m: 0.4,
    gain: 4.0,
    response_1_s: 8.0,
    approach_1_s: 1.0,
    speed_max_m_s: SPEED_MAX_M_S,
    side: Side::Plane,
};
const MARGIN_M: f64 = 0.02;

/// Adds what keeps the body clear of obstacles, in the N linear coordinates in which it moves. Returns the
/// fraction of the wanted velocity that leads into them.
fn avoid<const N: usize>(
    ball: &FreeBall,
    obstacle: &Obstacle,
    wish: &Wish,
    free: DVec3,
    natural: &mut Natural<6>,
    (state, step_s): (&mut AvoidanceState, f64),
) -> f64 {
    let side = if N == 2 { Side::Plane } else { Side::Space(DVec3::Z) };
    let avoidance = Avoidance {
        leaf: CLEAR,
        steering: Some(Steering { side, ..STEERING }),
        margin_m: MARGIN_M,
    };
    let mut root = Natural::<N> {
        force: natural.force.fixed_rows::<N>(0).into_owned(),
        metric: natural.metric.fixed_view::<N, N>(0, 0).into_owned(),
    };
    let Ok(factor) = root.factor() else { return 0.0 };
    let linear = |v: DVec3| SVector::<f64, N>::from_fn(|i, _| v[i]);
    let tick = Tick {
        task: Task { natural: root, energy: wish.energy },
        position: linear(ball.position),
        velocity: linear(ball.velocity),
        body: ball,
        obstacles: std::slice::from_ref(obstacle),
        dt_s: step_s,
    };
    let free = Free { acceleration: linear(free), factor };
    let seen = avoidance.add(&tick, &free, &mut root, state);
    natural.force.fixed_rows_mut::<N>(0).copy_from(&root.force);
    natural.metric.fixed_view_mut::<N, N>(0, 0).copy_from(&root.metric);
    seen.obstructed_fraction
}

/// What happens to the body.
#[derive(Clone, Debug)]
pub struct Course {
    /// Space in which it moves.
    pub manifold: Manifold,
    /// Frames of the skill; the second is the goal's.
    pub frames: Vec<Pose>,
    /// The goal seen from the goal frame.
    pub grasp: Pose,
    /// Where the body starts.
    pub start: Pose,
    /// How fast [m/s].
    pub start_velocity: DVec3,
    /// As in the thesis, the goal stops when the body is near the goal that the policy itself has.
    pub own_goal: bool,
    /// Step [s].
    pub step_s: f64,
    /// Longest duration [s].
    pub duration_s: f64,
    /// How the goal frame moves.
    pub goal_motion: GoalMotion,
    /// What pushes.
    pub push: Option<Push>,
    /// What is in the way.
    pub ball: Option<Ball>,
}

impl Course {
    /// The goal for a pose of the goal frame.
    #[must_use]
    pub fn goal(&self, goal_frame: &MovingPose) -> Pose {
        goal_frame.pose.compose(&self.grasp)
    }
}

/// How it went.
#[derive(Clone, Debug)]
pub struct Trace {
    /// Poses, one a step, the first one included.
    pub path: Vec<Pose>,
    /// Poses of the goal, as many.
    pub goals: Vec<DVec3>,
    /// Distance to the true goal at the end [m].
    pub goal_error_m: f64,
    /// Angle to it [rad]; zero in the plane.
    pub goal_error_rad: f64,
    /// Largest acceleration [m/s²].
    pub acceleration_max_m_s2: f64,
    /// Largest distance between the surfaces' least, negative when it touched [m].
    pub clearance_min_m: Option<f64>,
    /// Largest rise of V in a step beyond rounding, as a fraction of what V falls by on the way.
    pub energy_rise_max: f64,
    /// Poses up to the thesis' stop.
    pub stopped_at: usize,
    /// Whether the body came so near to the goal that it stopped.
    pub touched: bool,
    /// Distance to the policy's own goal at the thesis' stop, as the thesis measures it [m].
    pub own_goal_error_m: f64,
}

/// M a = f in the directions in which the manifold moves; `None` when M is not positive definite or
/// a number not finite.
#[must_use]
pub fn resolve(natural: &Natural<6>, manifold: Manifold) -> Option<SpatialAcceleration> {
    let moving = manifold.position_dimension();
    let turns = manifold.has_orientation();
    // What does not move gets an inertia and no force.
    let (mut metric, mut force): (Matrix6<f64>, Vector6<f64>) = (natural.metric, natural.force);
    for i in (0..6).filter(|i| if *i < 3 { *i >= moving } else { !turns }) {
        metric.row_mut(i).fill(0.0);
        metric.column_mut(i).fill(0.0);
        metric[(i, i)] = 1.0;
        force[i] = 0.0;
    }
    let acceleration = SpatialAcceleration::from(Cholesky::new(metric)?.solve(&force));
    acceleration.is_finite().then_some(acceleration)
}

/// Lets a body follow a policy by the semi-implicit Euler rule.
pub fn run(follower: &mut dyn Follower, course: &Course) -> Trace {
    let manifold = course.manifold;
    let still = course.goal_motion == GoalMotion::default();
    let mut frames: Vec<MovingPose> =
        course.frames.iter().map(|pose| MovingPose::at_rest(*pose)).collect();
    let shown = course.frames[1];
    let mut pose = course.start;
    let mut velocity = Twist { linear: course.start_velocity, ..Twist::ZERO };
    let steps = (course.duration_s / course.step_s).ceil() as usize;
    let (mut started, mut slow, mut stopped) = (false, 0, None);
    let mut moving = !still;
    let mut trace = Trace {
        path: Vec::with_capacity(steps + 1),
        goals: Vec::with_capacity(steps + 1),
        goal_error_m: f64::INFINITY,
        goal_error_rad: f64::INFINITY,
        acceleration_max_m_s2: 0.0,
        clearance_min_m: course.ball.map(|_| f64::INFINITY),
        energy_rise_max: 0.0,
        stopped_at: 0,
        touched: false,
        own_goal_error_m: f64::INFINITY,
    };
    let mut sides = AvoidanceState::default();
    // V at the start, at the last step, and the least.
    let mut energies: Option<[f64; 3]> = None;
    for step in 0..=steps {
        let time_s = step as f64 * course.step_s;
        if moving {
            let goal = course.goal(&frames[1]);
            let own = course.own_goal.then(|| follower.goal(&frames)).flatten().unwrap_or(goal);
            let near = (pose.position - own.position).length() < course.goal_motion.stops_within_m;
            if near && step > 0 {
                moving = false;
                trace.touched = true;
                frames[1] = MovingPose::at_rest(frames[1].pose);
            } else {
                frames[1] = course.goal_motion.at(&shown, time_s);
            }
        }
        let goal = course.goal(&frames[1]);
        trace.path.push(pose);
        trace.goals.push(goal.position);
        trace.goal_error_m = (pose.position - goal.position).length();
        trace.goal_error_rad =
            if manifold.has_orientation() { pose.rotation_from(&goal).length() } else { 0.0 };
        // A start from rest is no stop.
        started |= velocity.linear.length() >= STOP_SPEED_M_S;
        slow = if started && velocity.linear.length() < STOP_SPEED_M_S { slow + 1 } else { 0 };
        if stopped.is_none() && slow >= STOP_STEPS {
            stopped = Some(own_error(follower, &frames, &pose, &goal));
            trace.stopped_at = step + 1;
        }
        let pushed = course.push.is_some_and(|push| time_s <= push.during_s[1]);
        let at_rest = trace.goal_error_m.max(trace.goal_error_rad) < AT_REST
            && velocity.linear.length().max(velocity.angular.length()) < AT_REST;
        if step == steps || (at_rest && !moving && !pushed) {
            break;
        }
        let moment = Moment { time_s, frames: &frames, pose, velocity };
        let wish = follower.evaluate(&moment);
        if still {
            let [first, before, least] = energies.unwrap_or([wish.energy; 3]);
            let rounding = ENERGY_ROUNDING * before.abs();
            trace.energy_rise_max = trace.energy_rise_max.max(wish.energy - before - rounding);
            energies = Some([first, wish.energy, least.min(wish.energy)]);
        }
        let mut natural = wish.natural;
        if let Some(push) = &course.push {
            let force = push.force(time_s, velocity.linear);
            for i in 0..3 {
                natural.force[i] += force[i];
            }
        }
        if let Some(ball) = &course.ball {
            let obstacle = ball.at(&frames[1], &shown);
            let clearance = obstacle.clearance(pose.position, velocity.linear, 0.0);
            let least = trace.clearance_min_m.unwrap_or(f64::INFINITY);
            trace.clearance_min_m = Some(least.min(clearance.distance));
            let body = FreeBall {
                position: pose.position,
                velocity: velocity.linear,
                radius: 0.0,
                goal: goal.position,
            };
            let free = resolve(&natural, manifold).map_or(DVec3::ZERO, |a| a.linear);
            let sides = (&mut sides, course.step_s);
            follower.set_obstructed(if manifold == Manifold::R2 {
                avoid::<2>(&body, &obstacle, &wish, free, &mut natural, sides)
            } else {
                avoid::<3>(&body, &obstacle, &wish, free, &mut natural, sides)
            });
        }
        let Some(acceleration) = resolve(&natural, manifold) else {
            trace.goal_error_m = f64::INFINITY;
            break;
        };
        trace.acceleration_max_m_s2 = trace.acceleration_max_m_s2.max(acceleration.linear.length());
        follower.advance(&wish, &acceleration, course.step_s);
        velocity = velocity.advanced(&acceleration, course.step_s);
        pose = pose.advanced(&velocity, course.step_s);
        if !(pose.position.length() < DIVERGED_M && pose.orientation.is_finite()) {
            trace.goal_error_m = f64::INFINITY;
            break;
        }
    }
    trace.own_goal_error_m = stopped.unwrap_or_else(|| {
        trace.stopped_at = trace.path.len();
        let goal = course.goal(&frames[1]);
        own_error(follower, &frames, &pose, &goal)
    });
    let fall = energies.map_or(0.0, |[first, _, least]| first - least);
    trace.energy_rise_max /= fall.max(f64::MIN_POSITIVE);
    trace
}

/// Distance to where the policy itself wants to rest.
fn own_error(follower: &mut dyn Follower, frames: &[MovingPose], pose: &Pose, goal: &Pose) -> f64 {
    let own = follower.goal(frames).unwrap_or(*goal);
    (pose.position - own.position).length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::follower::point_wish;

    /// A critically damped spring to the goal frame's origin.
    struct Spring;

    impl Follower for Spring {
        fn evaluate(&mut self, now: &Moment) -> Wish {
            let goal = now.frames[1];
            let away = now.pose.position - goal.pose.position;
            let rate = now.velocity.linear - goal.velocity.linear;
            let wish = point_wish(goal.acceleration.linear - away * 25.0 - rate * 10.0);
            let energy = INERTIA_KG * (12.5 * away.length_squared() + 0.5 * rate.length_squared());
            Wish { energy, ..wish }
        }
    }

    fn course() -> Course {
        let at = |x, y| Pose { position: DVec3::new(x, y, 0.0), orientation: DQuat::IDENTITY };
        Course {
            manifold: Manifold::R2,
            frames: vec![at(0.0, 0.0), at(1.0, 0.0)],
            grasp: at(0.0, 0.0),
            start: at(0.0, 0.0),
            start_velocity: DVec3::ZERO,
            own_goal: false,
            step_s: 0.01,
            duration_s: 10.0,
            goal_motion: GoalMotion::default(),
            push: None,
            ball: None,
        }
    }

    #[test]
    fn a_spring_arrives_and_its_energy_falls() {
        let trace = run(&mut Spring, &course());
        assert!(trace.goal_error_m < 1e-6 && trace.path.len() < 1000);
        assert!(trace.energy_rise_max <= 0.0, "{}", trace.energy_rise_max);
        assert!((trace.acceleration_max_m_s2 - 25.0).abs() < 1e-9);
        assert!(trace.own_goal_error_m < 1.0);
    }

    #[test]
    fn a_goal_on_a_circle_stops_when_the_body_is_near() {
        let goal_motion = GoalMotion::circle(0.5, 3.0, 0.1);
        let trace = run(&mut Spring, &Course { goal_motion, ..course() });
        assert!(trace.goal_error_m < 1e-6 && trace.touched);
        let center = DVec3::new(1.0, 0.0, 0.0);
        assert!(trace.goals.iter().all(|goal| ((*goal - center).length() - 0.5).abs() < 1e-9));
        assert_eq!(trace.goals.last(), trace.goals.get(trace.goals.len() - 2));
    }

    #[test]
    fn an_orthogonal_push_does_no_work_and_a_published_one_does() {
        let velocity = DVec3::new(0.6, 0.8, 0.0);
        let push = Push { force_n: 10.0, during_s: [0.5, 1.5], as_published: false };
        assert!(push.force(1.0, velocity).dot(velocity).abs() < 1e-12);
        assert!((push.force(1.0, velocity).length() - 10.0).abs() < 1e-12);
        assert_eq!(push.force(0.4, velocity), DVec3::ZERO);
        let published = Push { as_published: true, ..push };
        assert!((published.force(1.0, velocity).dot(velocity) - 9.6).abs() < 1e-12);
    }

    #[test]
    fn a_touched_ball_is_seen() {
        let center = DVec3::new(0.5, 0.05, 0.0);
        let ball = Ball { center, radius_m: 0.2 };
        let with = Course { ball: Some(ball), ..course() };
        assert!(ball.leaves_room(&with, 0.05));
        let trace = run(&mut Spring, &with);
        assert!(trace.clearance_min_m.unwrap() > 0.0);
        assert!(trace.path.iter().all(|p| (p.position - center).length() > 0.2));
        assert!(!Ball { radius_m: 0.5, ..ball }.leaves_room(&with, 0.05));
    }
}
