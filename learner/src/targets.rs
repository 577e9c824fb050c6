//! What the field is asked for: accelerations on and beside the demonstrations, and descent along
//! them everywhere around.

use nalgebra::SVector;
use rand::Rng;

use crate::basis::axis;
use crate::skill::FieldSettings;

/// A demonstration of one block in normalised coordinates ŷ.
#[derive(Clone, Debug)]
pub struct BlockPath<const D: usize> {
    /// Points [ŷ].
    pub points: Vec<SVector<f64, D>>,
    /// Velocities [ŷ/s].
    pub velocities: Vec<SVector<f64, D>>,
    /// Accelerations [ŷ/s²].
    pub accelerations: Vec<SVector<f64, D>>,
}

/// The field is asked for this acceleration at this point and velocity.
#[derive(Clone, Copy, Debug)]
pub struct Target<const D: usize> {
    /// Point [ŷ].
    pub point: SVector<f64, D>,
    /// Velocity [ŷ/s].
    pub velocity: SVector<f64, D>,
    /// Acceleration [ŷ/s²].
    pub acceleration: SVector<f64, D>,
    /// Weight; those of the demonstrations sum to one.
    pub weight: f64,
}

/// The field is asked to descend at this point in this direction.
#[derive(Clone, Copy, Debug)]
pub struct Descent<const D: usize> {
    /// Point [ŷ].
    pub point: SVector<f64, D>,
    /// Unit direction.
    pub direction: SVector<f64, D>,
    /// Share of the demanded speed, which falls towards the goal.
    pub share: f64,
}

/// Fewest samples of a demonstration that a stride leaves, so that sparsely sampled
/// demonstrations count as well.
const SAMPLES_MIN: usize = 10;
/// Points nearer to the goal have no direction to it [ŷ].
const AT_GOAL: f64 = 1e-6;
/// Grid points nearer to the goal are left to the rings and the Hessian [ŷ].
const GRID_GOAL_DISTANCE_MIN: f64 = 0.02;
/// A tube point is dropped when another part of the path is nearer than this share of its offset.
const TUBE_CLEARANCE: f64 = 0.75;

/// A point and a velocity of a demonstration.
type Sample<const D: usize> = (SVector<f64, D>, SVector<f64, D>);

impl<const D: usize> BlockPath<D> {
    /// Every so many samples, from the first on.
    fn every(&self, stride: usize) -> impl Iterator<Item = Sample<D>> + '_ {
        let stride = stride.min((self.points.len() / SAMPLES_MIN).max(1));
        self.points.iter().copied().zip(self.velocities.iter().copied()).step_by(stride)
    }
}

/// Samples of the demonstrations, and of the tube beside them, from which the field leads back.
#[must_use]
pub fn targets<const D: usize>(paths: &[BlockPath<D>], settings: &FieldSettings) -> Vec<Target<D>> {
    let shown: Vec<_> = sparse_samples(paths, settings);
    let mut targets = Vec::new();
    for path in paths {
        let weight = 1.0 / (path.points.len() * paths.len()) as f64;
        for ((point, velocity), acceleration) in
            path.points.iter().zip(&path.velocities).zip(&path.accelerations)
        {
            targets.push(Target {
                point: *point,
                velocity: *velocity,
                acceleration: *acceleration,
                weight,
            });
        }
        let tube: Vec<_> = path.every(settings.tube_stride).collect();
        let count = tube.len() * paths.len() * 2 * (D - 1) * settings.tube_offsets.len();
        let weight = settings.tube_weight / count as f64;
        for (point, velocity) in tube {
            if velocity.norm() <= settings.tube_speed_min {
                continue;
            }
            for normal in normals(&velocity) {
                for offset in &settings.tube_offsets {
                    let beside = point + normal * *offset;
                    let nearest = shown
                        .iter()
                        .map(|(p, _)| (p - beside).norm())
                        .fold(f64::INFINITY, f64::min);
                    if nearest > TUBE_CLEARANCE * offset {
                        targets.push(Target {
                            point: beside,
                            velocity: velocity - normal * (settings.tube_attraction_1_s * offset),
                            acceleration: SVector::zeros(),
                            weight,
                        });
                    }
                }
            }
        }
    }
    targets
}

fn sparse_samples<const D: usize>(
    paths: &[BlockPath<D>],
    settings: &FieldSettings,
) -> Vec<Sample<D>> {
    paths.iter().flat_map(|path| path.every(settings.descent_stride)).collect()
}

/// Unit vectors across a velocity: two in the plane, four in space.
fn normals<const D: usize>(velocity: &SVector<f64, D>) -> Vec<SVector<f64, D>> {
    let along = velocity.normalize();
    let mut across: Vec<SVector<f64, D>> = Vec::with_capacity(2 * (D - 1));
    // Gram–Schmidt, each time from the axis that lies best across what there is: never degenerate,
    // whichever way the demonstration runs.
    while across.len() < 2 * (D - 1) {
        let best = (0..D)
            .map(|index| {
                let unit = axis::<D>(index, 1.0);
                let mut rest = unit - along * along.dot(&unit);
                for n in across.iter().step_by(2) {
                    rest -= n * n.dot(&unit);
                }
                rest
            })
            .reduce(|a, b| if b.norm() > a.norm() + 1e-12 { b } else { a })
            .expect("there is at least one axis");
        let normal = best.normalize();
        across.push(normal);
        across.push(-normal);
    }
    across
}

/// Knows in which direction the field must descend at any point.
#[derive(Clone, Debug)]
pub struct Guide<'a, const D: usize> {
    shown: Vec<Sample<D>>,
    goal: SVector<f64, D>,
    low: SVector<f64, D>,
    high: SVector<f64, D>,
    settings: &'a FieldSettings,
}

impl<'a, const D: usize> Guide<'a, D> {
    /// A guide along these demonstrations.
    #[must_use]
    pub fn new(
        paths: &[BlockPath<D>],
        goal: &SVector<f64, D>,
        settings: &'a FieldSettings,
    ) -> Self {
        let shown = sparse_samples(paths, settings);
        let mut low = SVector::<f64, D>::repeat(f64::INFINITY);
        let mut high = -low;
        for (point, _) in &shown {
            low = low.inf(point);
            high = high.sup(point);
        }
        Self { shown, goal: *goal, low, high, settings }
    }

    /// A random point in the box around the demonstrations, widened by a margin.
    pub fn random_point(&self, margin: f64, random: &mut impl Rng) -> SVector<f64, D> {
        let (low, high) = (self.low.add_scalar(-margin), self.high.add_scalar(margin));
        SVector::from_fn(|a, _| low[a] + (high[a] - low[a]) * random.random_range(0.0..1.0))
    }

    /// Where descent is demanded: a grid (seeded random points in space) around the
    /// demonstrations, samples of them, and in the plane rings around the goal.
    pub fn descents(&self, random: &mut impl Rng) -> Vec<Descent<D>> {
        let settings = self.settings;
        let margin = settings.grid_margin;
        let mut points = Vec::new();
        if D == 2 {
            let (low, high) = (self.low.add_scalar(-margin), self.high.add_scalar(margin));
            let count = settings.grid_points_per_axis;
            for i in 0..count * count {
                let share = [i / count, i % count].map(|j| j as f64 / (count - 1) as f64);
                points.push(SVector::from_fn(|a, _| low[a] + (high[a] - low[a]) * share[a]));
            }
        } else {
            points.extend(
                (0..settings.grid_points_random).map(|_| self.random_point(margin, random)),
            );
        }
        points.retain(|y| (y - self.goal).norm() > GRID_GOAL_DISTANCE_MIN);
        points.extend(self.shown.iter().map(|(point, _)| *point));
        if D == 2 {
            for radius in &settings.goal_rings {
                for i in 0..settings.goal_ring_points {
                    let angle = std::f64::consts::TAU * i as f64 / settings.goal_ring_points as f64;
                    let unit = [angle.cos(), angle.sin()];
                    points.push(self.goal + SVector::from_fn(|a, _| radius * unit[a]));
                }
            }
        }
        points.retain(|y| (y - self.goal).norm() > AT_GOAL);
        points.into_iter().map(|point| self.descent(point)).collect()
    }

    /// The demonstrated direction of the nearest sample, bent towards it, and near the goal
    /// towards the goal.
    #[must_use]
    pub fn descent(&self, point: SVector<f64, D>) -> Descent<D> {
        let settings = self.settings;
        let (near_point, near_velocity) = self
            .shown
            .iter()
            .min_by(|a, b| (a.0 - point).norm_squared().total_cmp(&(b.0 - point).norm_squared()))
            .expect("there are demonstrations");
        let to_goal = self.goal - point;
        let distance = to_goal.norm();
        let goal_direction = to_goal / distance;
        let speed = near_velocity.norm();
        // A sample at rest shows no direction: its noise must not become one.
        let forward =
            if speed > settings.tube_speed_min { near_velocity / speed } else { goal_direction };
        let bent = forward + (near_point - point) / settings.descent_attraction;
        let bent = bent.try_normalize(1e-9).unwrap_or(goal_direction);
        let near = (-(distance / settings.descent_goal_radius).powi(2)).exp();
        let direction = bent * (1.0 - near) + goal_direction * near;
        Descent {
            point,
            direction: direction.try_normalize(1e-9).unwrap_or(goal_direction),
            share: (distance / settings.descent_slowdown).min(1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn normals_stand_across_the_velocity_and_each_other() {
        for velocity in [
            Vector3::z() * -0.3,
            Vector3::x(),
            Vector3::new(1.0, 1.0, 1.0),
            Vector3::new(0.1, -2.0, 0.5),
        ] {
            let across = normals(&velocity);
            assert_eq!(across.len(), 4);
            for n in &across {
                assert!((n.norm() - 1.0).abs() < 1e-14 && n.dot(&velocity).abs() < 1e-14);
            }
            assert!(across[0].dot(&across[2]).abs() < 1e-14);
            assert_eq!(across[0], -across[1]);
        }
    }
}
