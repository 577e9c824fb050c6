//! The arm as the leaves see it: control points on its links, in a posture.

use core::cell::Cell;
use core::ops::Range;

use glam::DVec3;
use nalgebra::SVector;
use tprmp_model::controller_config::{ControllerConfig, ExemptObstacle, Exemption, Gripped};
use tprmp_rmpflow::leaves::{Body, Obstacle, Part, Shape};
use tprmp_robot::{
    CONTROL_POINT_CAPACITY, Chain, ControlPoint, ControlPoints, Kinematics, SelfPairs,
    point_motion, point_position,
};
use tprmp_spatial::{PointMotion, Pose};

use crate::motion::limits::working_range;

/// An arm with its control points: immutable.
#[derive(Debug)]
pub struct Arm<const N: usize> {
    /// Its joints and links.
    pub chain: Chain<N>,
    /// Least and greatest positions of its working range \[rad or m\].
    pub range: [SVector<f64, N>; 2],
    /// Those of the links, then those of what the gripper holds.
    points: Vec<AvoidingPoint>,
    parts: Vec<LinkPart>,
    gripped_points: usize,
}

/// Where its control points are in the last posture.
#[derive(Debug)]
pub struct PointPlaces<const N: usize> {
    part_centres: Vec<DVec3>,
    centres: OnDemand<DVec3>,
    motions: OnDemand<PointMotion<N>>,
    /// Whether the gripper holds what has points of its own.
    holds: bool,
}

impl<const N: usize> PointPlaces<N> {
    /// Whether the gripper holds something from now on.
    pub fn hold(&mut self, holds: bool) {
        self.holds = holds;
    }
}

impl<const N: usize> Arm<N> {
    /// Puts the control points of a configuration on an arm. Allocates: at start-up only.
    #[must_use]
    pub fn new(chain: Chain<N>, control_points: &ControlPoints, config: &ControllerConfig) -> Self {
        let avoiding = |point: &ControlPoint, link: &str| {
            let exempt = config.collision.iter().flat_map(|collision| &collision.exempt);
            let of_link = |e: &&Exemption| e.link == link;
            let from_axis = point.centre.x.hypot(point.centre.y);
            let within = |e: &Exemption| e.extent.acts_within(from_axis).map(|w| (e.obstacle, w));
            AvoidingPoint {
                point: *point,
                exempt: exempt.filter(of_link).filter_map(within).collect(),
            }
        };
        let avoids = config.collision.is_some() || config.self_collision.is_some();
        let own = if avoids { control_points.as_slice() } else { &[] };
        let gripped = config.gripped.as_ref().filter(|_| config.collision.is_some());
        let gripped = gripped.map_or(vec![], |gripped| gripped_points(&chain, gripped));
        let links = own.iter().map(|point| &*chain.moving_links()[point.link].0);
        let mut points: Vec<_> = own.iter().zip(links).map(|(p, link)| avoiding(p, link)).collect();
        points.extend(gripped.iter().map(|point| avoiding(point, &config.robot.tool_link)));
        let mut parts = LinkPart::of(own);
        parts.extend((!gripped.is_empty()).then(|| LinkPart::around(&gripped, own.len())));
        let (range, gripped_points) = (working_range(&chain, &config.robot), gripped.len());
        Self { range, points, parts, gripped_points, chain }
    }

    /// Room for a posture. Allocates: at start-up only.
    #[must_use]
    pub fn places(&self) -> PointPlaces<N> {
        PointPlaces {
            part_centres: vec![DVec3::NAN; self.parts.len()],
            centres: OnDemand::new(self.points.len(), DVec3::NAN),
            motions: OnDemand::new(self.points.len(), PointMotion::UNDEFINED),
            holds: false,
        }
    }

    /// The control points in a posture, on the way to a goal of the tool.
    #[inline]
    pub fn links<'a>(
        &'a self,
        kinematics: &'a Kinematics<N>,
        places: &'a mut PointPlaces<N>,
        [tool, tool_goal]: [&'a Pose; 2],
    ) -> Links<'a, N> {
        places.centres.forget();
        places.motions.forget();
        for (centre, part) in places.part_centres.iter_mut().zip(&self.parts) {
            *centre = point_position(kinematics, part.joint, part.centre);
        }
        Links { arm: self, kinematics, places, tool, tool_goal }
    }
}

#[derive(Debug)]
struct AvoidingPoint {
    point: ControlPoint,
    /// Clearances from which on it keeps clear of kinds of obstacles \[m\].
    exempt: Vec<(ExemptObstacle, f64)>,
}

/// The control points of a link, and a ball around them.
#[derive(Debug)]
struct LinkPart {
    points: Range<usize>,
    joint: usize,
    /// Centre in that joint's frame \[m\].
    centre: DVec3,
    radius: f64,
}

impl LinkPart {
    /// The parts of control points, of which those of a link follow one another.
    fn of(points: &[ControlPoint]) -> Vec<Self> {
        let mut first = 0;
        let runs = points.chunk_by(|a, b| a.link == b.link);
        runs.map(|run| {
            let part = Self::around(run, first);
            first = part.points.end;
            part
        })
        .collect()
    }

    /// A part of these points of one link, the first of which has this number.
    fn around(run: &[ControlPoint], first: usize) -> Self {
        let corner = |f: fn(DVec3, DVec3) -> DVec3| {
            run.iter().map(|point| point.centre).reduce(f).unwrap_or(DVec3::NAN)
        };
        let centre = 0.5 * (corner(DVec3::min) + corner(DVec3::max));
        let reach = |point: &ControlPoint| point.centre.distance(centre) + point.radius;
        let radius = run.iter().map(reach).fold(0.0, f64::max);
        Self { points: first..first + run.len(), joint: run[0].joint, centre, radius }
    }
}

/// The spheres of what the gripper holds, fixed to the last joint.
fn gripped_points<const N: usize>(chain: &Chain<N>, gripped: &Gripped) -> Vec<ControlPoint> {
    let link = chain.moving_links().iter().position(|(name, _)| name == chain.tool_link());
    let spheres = gripped.spheres.iter().map(|sphere| ControlPoint {
        link: link.unwrap_or(0),
        joint: N - 1,
        centre: chain.of_tool(sphere.position_m.into()),
        radius: sphere.radius_m,
    });
    spheres.collect()
}

/// A point that may come near an obstacle does so at its goal; elsewhere it keeps clear within this fraction
/// of the distance to its goal besides, so that it can come down on its goal steeply, 30° or more.
const GOAL_FRACTION: f64 = 0.5;

/// A value for each control point, computed when it is first asked for.
#[derive(Debug)]
struct OnDemand<T: Copy> {
    /// A bit for each value that is there.
    known: Cell<u64>,
    values: Box<[Cell<T>]>,
}

impl<T: Copy> OnDemand<T> {
    fn new(count: usize, undefined: T) -> Self {
        const { assert!(CONTROL_POINT_CAPACITY <= u64::BITS as usize, "a bit for each point") };
        Self { known: Cell::new(0), values: vec![Cell::new(undefined); count].into() }
    }

    fn forget(&mut self) {
        self.known.set(0);
    }

    #[inline]
    fn get(&self, i: usize, compute: impl FnOnce() -> T) -> T {
        let (bit, known) = (1 << i, self.known.get());
        if known & bit == 0 {
            self.known.set(known | bit);
            self.values[i].set(compute());
        }
        self.values[i].get()
    }
}

/// The control points of the arm in its present posture; where a point is and how it moves is computed
/// when it is first asked for.
pub struct Links<'a, const N: usize> {
    arm: &'a Arm<N>,
    kinematics: &'a Kinematics<N>,
    places: &'a PointPlaces<N>,
    tool: &'a Pose,
    tool_goal: &'a Pose,
}

impl<const N: usize> Links<'_, N> {
    /// The least distance of a control point's ball from an obstacle that it has to keep clear of \[m\].
    #[must_use]
    pub fn clearance(&self, obstacles: &[Obstacle]) -> f64 {
        let to = |obstacle: &Obstacle| {
            let each = (0..self.count()).map(|i| {
                let (centre, radius) = self.ball(i);
                let distance = obstacle.distance(centre, radius);
                // What may come near is in the way only where it is inside.
                let may_be_near = self.acts_within(i, &obstacle.shape) < f64::INFINITY;
                if may_be_near && distance >= 0.0 { f64::INFINITY } else { distance }
            });
            each.fold(f64::INFINITY, f64::min)
        };
        obstacles.iter().map(to).fold(f64::INFINITY, f64::min)
    }
}

impl<const N: usize> Body<N> for Links<'_, N> {
    fn count(&self) -> usize {
        let left_out = if self.places.holds { 0 } else { self.arm.gripped_points };
        self.arm.points.len() - left_out
    }

    fn part_count(&self) -> usize {
        let left_out = !self.places.holds && self.arm.gripped_points > 0;
        self.places.part_centres.len() - usize::from(left_out)
    }

    fn part(&self, k: usize) -> Part {
        let LinkPart { points, radius, .. } = &self.arm.parts[k];
        Part { position: self.places.part_centres[k], radius: *radius, points: points.clone() }
    }

    fn ball(&self, i: usize) -> (DVec3, f64) {
        let ControlPoint { joint, centre, radius, .. } = self.arm.points[i].point;
        (self.places.centres.get(i, || point_position(self.kinematics, joint, centre)), radius)
    }

    fn motion(&self, i: usize) -> PointMotion<N> {
        self.places.motions.get(i, || {
            let ControlPoint { joint, centre, .. } = self.arm.points[i].point;
            point_motion(&self.arm.chain, self.kinematics, joint, centre)
        })
    }

    fn acts_within(&self, i: usize, shape: &Shape) -> f64 {
        let kind = match shape {
            Shape::Sphere { .. } => ExemptObstacle::Sphere,
            Shape::Capsule { .. } => ExemptObstacle::Capsule,
            Shape::Box { .. } => ExemptObstacle::Box,
            Shape::HalfSpace => ExemptObstacle::HalfSpace,
        };
        let exempt = self.arm.points[i].exempt.iter();
        let within = exempt
            .filter(|(of, _)| *of == kind)
            .map(|(_, within)| *within)
            .fold(f64::INFINITY, f64::min);
        if within <= 0.0 || within == f64::INFINITY {
            return within;
        }
        // Near only where the task asks for it: it must be able to brake elsewhere.
        let left = self.at_goal(i).map_or(0.0, |goal| (goal - self.ball(i).0).length());
        within + left * GOAL_FRACTION
    }

    /// Known of the points that move with the tool.
    fn at_goal(&self, i: usize) -> Option<DVec3> {
        if self.arm.points[i].point.joint + 1 != N {
            return None;
        }
        let from_tool = self.tool.orientation.conjugate() * (self.ball(i).0 - self.tool.position);
        Some(self.tool_goal.transform_point(from_tool))
    }
}

/// Which links keep clear of each other: of two links either all pairs of points are watched or none.
pub(crate) fn part_pairs(points: &ControlPoints, pairs: &SelfPairs) -> Box<[(usize, usize)]> {
    let parts = LinkPart::of(points.as_slice());
    let part = |i: usize| parts.iter().position(|part| part.points.contains(&i));
    let mut found: Vec<_> =
        pairs.watched.iter().filter_map(|&(i, j)| Some((part(i)?, part(j)?))).collect();
    found.dedup();
    found.into()
}
