//! Which links need not keep clear of each other, or of what the arm stands on.

use std::collections::BTreeSet;

use glam::DVec3;
use nalgebra::SVector;
use tprmp_robot::{
    Chain, ControlPoints, Kinematics, SelfPairs, forward_kinematics, point_position, spread_posture,
};

/// Postures that are tried.
const POSTURE_COUNT: usize = 1000;
/// Spheres of two links that touch in this fraction of the postures stick out too far to tell anything.
const TOUCHING_FRACTION: f64 = 0.3;
/// A sphere that comes no higher than this above the ground stands on it \[m\].
const GROUND_M: f64 = 0.02;

/// Spheres that are near the ground, z = 0 of the base, in every posture.
pub(super) fn grounded<const N: usize>(
    chain: &Chain<N>,
    points: &ControlPoints,
    range: &[SVector<f64, N>; 2],
) -> Vec<bool> {
    let mut grounded = vec![true; points.as_slice().len()];
    let mut kinematics = Kinematics::new();
    for k in 1..=POSTURE_COUNT {
        forward_kinematics(chain, &spread_posture(&range[0], &range[1], k), &mut kinematics);
        for (point, stands) in points.as_slice().iter().zip(&mut grounded) {
            let lowest = point_position(&kinematics, point.joint, point.centre).z - point.radius;
            *stands &= lowest < GROUND_M;
        }
    }
    grounded
}

/// Of a link that stands on the ground: how far from its joint's axis \[m\], or wholly.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Grounded {
    /// The link.
    pub link: String,
    /// `None` for all of it.
    pub near_axis_m: Option<f64>,
}

/// The links of grounded spheres.
pub(super) fn grounded_links<const N: usize>(
    chain: &Chain<N>,
    points: &ControlPoints,
    grounded: &[bool],
) -> Vec<Grounded> {
    let mut found = Vec::new();
    for (link, (name, _)) in chain.moving_links().iter().enumerate() {
        let of_link =
            points.as_slice().iter().zip(grounded).filter(|(point, _)| point.link == link);
        let (mut low, mut all) = (None::<f64>, true);
        for (point, stands) in of_link {
            let from_axis = DVec3::new(point.centre.x, point.centre.y, 0.0).length();
            if *stands {
                low = Some(low.unwrap_or(0.0).max(from_axis));
            }
            all &= *stands;
        }
        if let Some(far) = low {
            // To the millimetre above, so that the farthest one is meant.
            let near_axis_m = (!all).then_some((far * 1e3 + 1.0).floor() * 1e-3);
            found.push(Grounded { link: name.clone(), near_axis_m });
        }
    }
    found
}

/// Pairs of links that the arm's own avoidance would only keep from moving: whose spheres touch at home, or in
/// three of ten postures of the working range. With the fraction of the postures in which they do.
pub(super) fn touching<const N: usize>(
    chain: &Chain<N>,
    points: &ControlPoints,
    home: &SVector<f64, N>,
    range: &[SVector<f64, N>; 2],
) -> Vec<(String, String, f64)> {
    let pairs = SelfPairs::new(chain, points, &[]);
    let points = points.as_slice();
    let mut kinematics = Kinematics::new();
    let mut touched = |q: &SVector<f64, N>| -> BTreeSet<(usize, usize)> {
        forward_kinematics(chain, q, &mut kinematics);
        let centre = |i: usize| point_position(&kinematics, points[i].joint, points[i].centre);
        let touch = |&&(i, j): &&(usize, usize)| {
            centre(i).distance(centre(j)) <= points[i].radius + points[j].radius
        };
        let watched = pairs.watched.iter().filter(touch);
        watched.map(|&(i, j)| (points[i].link, points[j].link)).collect()
    };
    let at_home = touched(home);
    let mut counts = std::collections::BTreeMap::<_, usize>::new();
    for k in 1..=POSTURE_COUNT {
        for pair in touched(&spread_posture(&range[0], &range[1], k)) {
            *counts.entry(pair).or_default() += 1;
        }
    }
    let name = |link: usize| chain.moving_links()[link].0.clone();
    let fraction =
        |pair| counts.get(&pair).map_or(0.0, |count| *count as f64 / POSTURE_COUNT as f64);
    let all: BTreeSet<_> = counts.keys().copied().chain(at_home.iter().copied()).collect();
    all.into_iter()
        .map(|pair| (pair, fraction(pair)))
        .filter(|(pair, fraction)| at_home.contains(pair) || *fraction >= TOUCHING_FRACTION)
        .map(|((a, b), fraction)| (name(a), name(b), fraction))
        .collect()
}
