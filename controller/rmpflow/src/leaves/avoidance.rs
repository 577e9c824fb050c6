//! Avoidance of obstacles by the points of a body: a leaf that keeps the clearance, and a steering that
//! leads around.

use tprmp_spatial::PointMotion;

use crate::leaves::barrier::{Barrier, Clearance};
use crate::leaves::body::Body;
use crate::leaves::obstacle::{Obstacle, Shape};
use crate::leaves::steering::{
    AvoidanceState, Detour, DetourSum, Free, Obstruction, SteeredPoint, Steering,
};
use crate::leaves::tick::Tick;
use crate::natural::Natural;

/// Avoidance of obstacles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Avoidance {
    /// What keeps the clearance.
    pub leaf: Barrier,
    /// What leads around; `None` where the body shall wait.
    pub steering: Option<Steering>,
    /// Added to the radius of every point \[m\].
    pub margin_m: f64,
}

/// How near obstacles are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Proximity {
    /// Least clearance, margin taken off; infinite where there is nothing \[m\].
    pub clearance_min_m: f64,
    /// Largest fraction of the desired velocity that is obstructed, β p/|u|: 0 to 1.
    pub obstructed_fraction: f64,
    /// How fast the body itself closes clearances: the largest −nᵀẋ/d of a point; 0 where it closes none \[1/s\].
    pub closing_1_s: f64,
}

impl Proximity {
    /// Where there is nothing.
    pub const NONE: Self =
        Self { clearance_min_m: f64::INFINITY, obstructed_fraction: 0.0, closing_1_s: 0.0 };
}

/// A point within the reach of the avoidance.
struct NearPoint<const N: usize> {
    motion: PointMotion<N>,
    clearance: Clearance,
    /// Clearance within which it keeps clear \[m\].
    within: f64,
}

impl Avoidance {
    /// Adds the leaves of all close pairs of a point and an obstacle, and the steering.
    ///
    /// * `root`  everything but obstacles; `free` its acceleration
    ///
    /// Hot path: no allocation; O(points × obstacles).
    pub fn add<B: Body<N>, const N: usize>(
        &self,
        tick: &Tick<'_, B, N>,
        free: &Free<N>,
        root: &mut Natural<N>,
        state: &mut AvoidanceState,
    ) -> Proximity {
        let Tick { body, obstacles, .. } = *tick;
        let range = self.steering.map_or(0.0, |steering| steering.range_m);
        let reach = range.max(self.leaf.activation_distance);
        let mut nearest = f64::INFINITY;
        let mut obstruction = Obstruction::default();
        let mut closing_1_s: f64 = 0.0;
        for (index, obstacle) in obstacles.iter().enumerate() {
            let mut detour = self.steering.as_ref().map(|steering| Detour {
                steering,
                obstacle,
                index,
                body,
                margin_m: self.margin_m,
                free,
                task_energy: tick.task.energy,
                sum: DetourSum::zero(),
            });
            for part in (0..body.part_count()).map(|k| body.part(k)) {
                // Nothing of a part is nearer than the ball around it.
                let limit = reach.max(nearest);
                if obstacle.distance(part.position, part.radius + self.margin_m) >= limit {
                    continue;
                }
                for i in part.points {
                    let Some(near) = self.near_point(body, i, obstacle, reach, &mut nearest) else {
                        continue;
                    };
                    let NearPoint { motion, clearance, within } = &near;
                    let own_rate = clearance.normal.dot(motion.velocity);
                    closing_1_s = closing_1_s.max(clearance.closing_1_s(own_rate));
                    self.leaf.within(*within).add(clearance, motion, root);
                    if let Some(detour) = &mut detour
                        && clearance.distance < range
                        && obstacle.shape != Shape::HalfSpace
                    {
                        let point = SteeredPoint { motion, clearance };
                        detour.add_point(&point, &mut obstruction, state);
                    }
                }
            }
            if let Some(detour) = detour {
                detour.finish(root, state);
            }
        }
        state.finish(obstacles.len(), &obstruction, tick.dt_s);
        let obstructed_fraction = obstruction.fraction_max;
        Proximity { clearance_min_m: nearest, obstructed_fraction, closing_1_s }
    }

    /// Point `i` of a body, if it is near an obstacle; `nearest` becomes its distance, if that is less.
    fn near_point<const N: usize>(
        &self,
        body: &impl Body<N>,
        i: usize,
        obstacle: &Obstacle,
        reach: f64,
        nearest: &mut f64,
    ) -> Option<NearPoint<N>> {
        let (position, radius) = body.ball(i);
        let radius = radius + self.margin_m;
        let within = body.acts_within(i, &obstacle.shape);
        if within <= 0.0 {
            return None;
        }
        let distance = obstacle.distance(position, radius);
        *nearest = nearest.min(distance);
        if distance >= reach.min(within) {
            return None;
        }
        let motion = body.motion(i);
        let clearance = obstacle.clearance(motion.position, motion.velocity, radius);
        Some(NearPoint { motion, clearance, within })
    }
}
