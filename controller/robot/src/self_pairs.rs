//! Which spheres of an arm have to keep clear of each other.

use crate::chain::Chain;
use crate::control_points::{ControlPoint, ControlPoints};
use crate::kinematics::{Kinematics, forward_kinematics, point_position};
use crate::postures::spread_posture;

/// Postures that are tried.
const POSTURE_COUNT: usize = 500;
/// Pairs of links that touch in at least this fraction of them touch by design.
const TOUCHING_FRACTION: f64 = 0.9;

/// Why two links need not keep clear of each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ignored {
    /// One joint, or none, lies between them.
    Adjacent,
    /// Their spheres touch in nearly every posture.
    Touching,
    /// They are exempt by the configuration.
    Exempt,
}

/// Pairs of spheres of an arm. Built at start-up.
#[derive(Debug, Clone)]
pub struct SelfPairs {
    /// Indices into [`ControlPoints::as_slice`] of the spheres that keep clear of each other.
    pub watched: Vec<(usize, usize)>,
    /// Pairs of links, indices into [`Chain::moving_links`], that do not.
    pub ignored: Vec<(usize, usize, Ignored)>,
}

impl SelfPairs {
    /// Finds the pairs of links that have to keep clear: all but those next to each other, those
    /// that touch in nearly every one of a fixed set of postures, and the exempt ones.
    #[must_use]
    pub fn new<const N: usize>(
        chain: &Chain<N>,
        points: &ControlPoints,
        exempt: &[(String, String)],
    ) -> Self {
        let points = points.as_slice();
        let mut links: Vec<usize> = points.iter().map(|point| point.link).collect();
        links.dedup();
        let mut pairs = Self { watched: Vec::new(), ignored: Vec::new() };
        let touching = touching_counts(chain, points, &links);
        for (a, &one) in links.iter().enumerate() {
            for (b, &other) in links.iter().enumerate().skip(a + 1) {
                let joint = |link: usize| chain.moving_links()[link].1;
                let name = |link: usize| &chain.moving_links()[link].0;
                let is_exempt = exempt.iter().any(|(x, y)| {
                    (x == name(one) && y == name(other)) || (x == name(other) && y == name(one))
                });
                let fraction = touching[a * links.len() + b] as f64 / POSTURE_COUNT as f64;
                let ignored = if joint(one).abs_diff(joint(other)) <= 1 {
                    Some(Ignored::Adjacent)
                } else if is_exempt {
                    Some(Ignored::Exempt)
                } else if fraction >= TOUCHING_FRACTION {
                    Some(Ignored::Touching)
                } else {
                    None
                };
                if let Some(why) = ignored {
                    pairs.ignored.push((one, other, why));
                    continue;
                }
                for i in (0..points.len()).filter(|&i| points[i].link == one) {
                    for j in (0..points.len()).filter(|&j| points[j].link == other) {
                        pairs.watched.push((i, j));
                    }
                }
            }
        }
        pairs
    }
}

/// In how many postures spheres of two links touch, for each pair of `links` row by row.
fn touching_counts<const N: usize>(
    chain: &Chain<N>,
    points: &[ControlPoint],
    links: &[usize],
) -> Vec<usize> {
    let mut touching = vec![0_usize; links.len() * links.len()];
    let mut kinematics = Kinematics::new();
    for k in 1..=POSTURE_COUNT {
        let q = spread_posture(chain.position_lower(), chain.position_upper(), k);
        forward_kinematics(chain, &q, &mut kinematics);
        let centre = |i: usize| point_position(&kinematics, points[i].joint, points[i].centre);
        let mut touch = vec![false; touching.len()];
        for i in 0..points.len() {
            for j in i + 1..points.len() {
                let apart = centre(i).distance(centre(j)) - points[i].radius - points[j].radius;
                let at = |k: usize| links.iter().position(|l| *l == points[k].link);
                if let (true, Some(a), Some(b)) = (apart <= 0.0, at(i), at(j)) {
                    touch[a * links.len() + b] = true;
                }
            }
        }
        for (count, touch) in touching.iter_mut().zip(touch) {
            *count += usize::from(touch);
        }
    }
    touching
}
