//! What the field is asked for: accelerations on and beside the demonstrations, and descent along
//! them everywhere around.

use nalgebra::SVector;
use rand::Rng;

use crate::fit::basis::axis;
use crate::skill::FieldSettings;

/// A demonstration of one block in normalised coordinates ẑ: ŷ, and last the phase times its length.
#[derive(Clone, Debug)]
pub struct BlockPath<const N: usize> {
    /// Points \[ŷ\].
    pub points: Vec<SVector<f64, N>>,
    /// Velocities [ŷ/s].
    pub velocities: Vec<SVector<f64, N>>,
    /// Accelerations [ŷ/s²].
    pub accelerations: Vec<SVector<f64, N>>,
}

/// The field is asked for this acceleration at this point and velocity.
#[derive(Clone, Copy, Debug)]
pub struct Target<const N: usize> {
    /// Point \[ŷ\].
    pub point: SVector<f64, N>,
    /// Velocity [ŷ/s].
    pub velocity: SVector<f64, N>,
    /// Acceleration [ŷ/s²].
    pub acceleration: SVector<f64, N>,
    /// Weight; those of the demonstrations sum to one.
    pub weight: f64,
}

/// The field is asked to descend at this point in this direction.
#[derive(Clone, Copy, Debug)]
pub struct Descent<const N: usize> {
    /// Point \[ŷ\].
    pub point: SVector<f64, N>,
    /// Unit direction.
    pub direction: SVector<f64, N>,
    /// Fraction of the least speed, which falls towards the goal.
    pub fraction: f64,
}

/// Points nearer to the goal have no direction to it [ŷ]: rounding.
const AT_GOAL: f64 = 1e-6;

/// A point and a velocity of a demonstration.
type Sample<const N: usize> = (SVector<f64, N>, SVector<f64, N>);

impl<const N: usize> BlockPath<N> {
    /// Every so many samples, from the first on, but no fewer than `samples_min` where there are.
    fn every(&self, stride: usize, samples_min: usize) -> impl Iterator<Item = Sample<N>> + '_ {
        let stride = stride.min((self.points.len() / samples_min).max(1));
        self.points.iter().copied().zip(self.velocities.iter().copied()).step_by(stride)
    }
}

/// Samples of the demonstrations, and of the tube beside them, from which the field leads back.
#[must_use]
pub fn targets<const N: usize>(paths: &[BlockPath<N>], settings: &FieldSettings) -> Vec<Target<N>> {
    let demonstrated = sparse_samples(paths, settings);
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
        let tube: Vec<_> = path.every(settings.tube_stride, settings.stride_samples_min).collect();
        let count = tube.len() * paths.len() * 2 * (N - 1) * settings.tube_offsets.len();
        let weight = settings.tube_weight / count as f64;
        for (point, velocity) in tube {
            if velocity.norm() <= settings.tube_speed_min {
                continue;
            }
            for normal in normals(&velocity) {
                for offset in &settings.tube_offsets {
                    let beside = point + normal * *offset;
                    let nearest = demonstrated
                        .iter()
                        .map(|(p, _)| (p - beside).norm())
                        .fold(f64::INFINITY, f64::min);
                    if nearest > settings.tube_clearance_fraction * offset {
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

fn sparse_samples<const N: usize>(
    paths: &[BlockPath<N>],
    settings: &FieldSettings,
) -> Vec<Sample<N>> {
    let (stride, least) = (settings.descent_stride, settings.stride_samples_min);
    paths.iter().flat_map(|path| path.every(stride, least)).collect()
}

/// Unit vectors across a velocity, a pair for each dimension but one.
fn normals<const N: usize>(velocity: &SVector<f64, N>) -> Vec<SVector<f64, N>> {
    let along = velocity.normalize();
    let mut across: Vec<SVector<f64, N>> = Vec::with_capacity(2 * (N - 1));
    // Gram–Schmidt, each time from the axis that lies best across what there is: never degenerate,
    // whichever direction the demonstration has.
    while across.len() < 2 * (N - 1) {
        let best = (0..N)
            .map(|index| {
                let unit = axis::<N>(index, 1.0);
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
pub struct Guide<'a, const N: usize> {
    demonstrated: Vec<Sample<N>>,
    /// Where there is one.
    goal: Option<SVector<f64, N>>,
    /// Of a round in the last coordinate, where there is no goal, and the fraction of the least speed that is
    /// asked for.
    round: [f64; 2],
    settings: &'a FieldSettings,
}

impl<'a, const N: usize> Guide<'a, N> {
    /// A guide along these demonstrations.
    #[must_use]
    pub fn new(
        paths: &[BlockPath<N>],
        goal: &SVector<f64, N>,
        settings: &'a FieldSettings,
    ) -> Self {
        let demonstrated = sparse_samples(paths, settings);
        Self { demonstrated, goal: Some(*goal), round: [0.0, 1.0], settings }
    }

    /// A guide along rounds of a length in the last coordinate \[ŷ\]: there is no goal, and the samples of a round
    /// are those of the rounds beside it, too. No more than half their mean speed is asked for.
    #[must_use]
    pub fn round(paths: &[BlockPath<N>], length: f64, settings: &'a FieldSettings) -> Self {
        let own = sparse_samples(paths, settings);
        let mut demonstrated = Vec::with_capacity(3 * own.len());
        for round in [-1.0, 0.0, 1.0] {
            let shift = axis::<N>(N - 1, round * length);
            demonstrated.extend(own.iter().map(|(point, velocity)| (point + shift, *velocity)));
        }
        let speed: f64 = own.iter().map(|(_, velocity)| velocity.norm()).sum();
        let fraction = (0.5 * speed / own.len() as f64 / settings.descent_speed).min(1.0);
        Self { demonstrated, goal: None, round: [length, fraction], settings }
    }

    /// Where descent is a constraint: seeded random points around the demonstrations, and samples of
    /// them.
    pub fn descents(&self, random: &mut impl Rng) -> Vec<Descent<N>> {
        let settings = self.settings;
        let mut points = Vec::new();
        for _ in 0..settings.descent_points_random {
            let (mut point, _) = self.demonstrated[random.random_range(0..self.demonstrated.len())];
            for i in 0..N {
                let last = i == N - 1;
                let radius =
                    if last { settings.descent_phase_radius } else { settings.descent_radius };
                point[i] += radius * random.random_range(-1.0..1.0);
            }
            points.push(point);
        }
        let [length, _] = self.round;
        match self.goal {
            Some(goal) => {
                points.retain(|z| (z - goal).norm() > settings.descent_goal_distance_min);
                points.extend(self.demonstrated.iter().map(|(point, _)| *point));
                points.retain(|z| (z - goal).norm() > AT_GOAL);
            }
            None => {
                let own = |z: &&SVector<f64, N>| (0.0..length).contains(&z[N - 1]);
                points.extend(self.demonstrated.iter().map(|(point, _)| point).filter(own));
            }
        }
        points.into_iter().map(|point| self.descent(point)).collect()
    }

    /// The point in its round, where a field has no goal.
    fn in_round(&self, mut point: SVector<f64, N>) -> SVector<f64, N> {
        if self.goal.is_none() {
            point[N - 1] = point[N - 1].rem_euclid(self.round[0]);
        }
        point
    }

    /// The demonstrated direction of the nearest sample, turned towards it, and near the goal
    /// towards the goal.
    #[must_use]
    pub fn descent(&self, point: SVector<f64, N>) -> Descent<N> {
        let settings = self.settings;
        let point = self.in_round(point);
        let (near_point, near_velocity) = self
            .demonstrated
            .iter()
            .min_by(|a, b| (a.0 - point).norm_squared().total_cmp(&(b.0 - point).norm_squared()))
            .expect("there are demonstrations");
        let Some(goal) = self.goal else {
            let along = near_velocity.try_normalize(1e-9).unwrap_or(axis(N - 1, 1.0));
            let towards = along + (near_point - point) / settings.descent_attraction;
            let direction = towards.try_normalize(1e-9).unwrap_or(along);
            return Descent { point, direction, fraction: self.round[1] };
        };
        let to_goal = goal - point;
        let distance = to_goal.norm();
        let goal_direction = to_goal / distance;
        let speed = near_velocity.norm();
        // A sample at rest shows no direction: its noise must not become one.
        let forward =
            if speed > settings.tube_speed_min { near_velocity / speed } else { goal_direction };
        let towards = forward + (near_point - point) / settings.descent_attraction;
        let towards = towards.try_normalize(1e-9).unwrap_or(goal_direction);
        let near = (-(distance / settings.descent_goal_radius).powi(2)).exp();
        let direction = towards * (1.0 - near) + goal_direction * near;
        Descent {
            point,
            direction: direction.try_normalize(1e-9).unwrap_or(goal_direction),
            fraction: (distance / settings.descent_slowdown).min(1.0),
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
