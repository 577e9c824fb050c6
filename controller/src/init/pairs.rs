//! Which links need not keep clear of each other, or of what the arm stands on.

use std::collections::BTreeSet;

use glam::DVec3;
use nalgebra::SVector;
use rayon::prelude::*;
use tprmp_cover::{Cover, LinkMeshes};
use tprmp_robot::{
    Chain, ControlPoints, Kinematics, SelfPairs, forward_kinematics, link_pose, point_position,
    spread_posture,
};
use tprmp_spatial::Pose;

/// Postures that are tried.
const POSTURE_COUNT: usize = 400;
/// Postures of the joints between two links that are tried before they are said not to meet.
const BETWEEN_COUNT: usize = 4000;
/// Spheres of two links that touch in this fraction of the postures stick out too far to tell anything.
const TOUCHING_FRACTION: f64 = 0.3;
/// In fewer postures two links are too seldom near each other to tell what their shapes can do.
const NEAR_FRACTION: f64 = 0.05;
/// What links can do that more joints lie between is not told by so few postures.
const JOINTS_BETWEEN_MAX: usize = 3;
/// A sphere that comes no higher than this above the ground stands on it: it could never leave the range in which it
/// would be kept away, of 0.09 m and a margin of 0.015 \[m\].
const GROUND_M: f64 = 0.105;

/// Spheres that are near the ground in every posture, which is at the height `ground_m` of the base \[m\]; none where
/// that is not known.
pub(super) fn grounded<const N: usize>(
    chain: &Chain<N>,
    points: &ControlPoints,
    ground_m: Option<f64>,
    range: &[SVector<f64, N>; 2],
) -> Vec<bool> {
    let mut grounded = vec![ground_m.is_some(); points.as_slice().len()];
    let ground_m = ground_m.unwrap_or_default();
    let mut kinematics = Kinematics::new();
    for k in 1..=POSTURE_COUNT {
        forward_kinematics(chain, &spread_posture(&range[0], &range[1], k), &mut kinematics);
        for (point, stands) in points.as_slice().iter().zip(&mut grounded) {
            let lowest = point_position(&kinematics, point.joint, point.centre).z - point.radius;
            // What hangs far below stands on nothing.
            *stands &= (lowest - ground_m).abs() < GROUND_M;
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

/// A posture in which the joints between two links are spread over their range, and the others in the middle of theirs.
fn between<const N: usize>(
    [a, b]: [usize; 2],
    range: &[SVector<f64, N>; 2],
    k: usize,
) -> SVector<f64, N> {
    let moving = a.min(b) + 1..=a.max(b);
    let middle = |i: usize| {
        let [lower, upper] = [range[0][i], range[1][i]];
        if (upper - lower).is_finite() { 0.5 * (lower + upper) } else { 0.0 }
    };
    // The first numbers of a sequence are spread best: those between come first.
    let mut order: Vec<usize> = moving.clone().collect();
    order.extend((0..N).filter(|i| !moving.contains(i)));
    let ends = [0, 1].map(|end| SVector::<f64, N>::from_fn(|i, _| range[end][order[i]]));
    let spread = spread_posture(&ends[0], &ends[1], k);
    let mut q = SVector::<f64, N>::from_fn(|i, _| middle(i));
    for (place, joint) in order.iter().enumerate().take(moving.count()) {
        q[*joint] = spread[place];
    }
    q
}

/// A pair of links that need not keep clear of each other, and why.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Harmless {
    pub(super) links: [String; 2],
    pub(super) reason: String,
}

/// What pairs of links are looked at with.
#[derive(Clone, Copy)]
pub(super) struct Look<'a, const N: usize> {
    pub(super) chain: &'a Chain<N>,
    pub(super) points: &'a ControlPoints,
    /// Of the links, where they are known.
    pub(super) shapes: Option<(&'a LinkMeshes, &'a Cover)>,
    /// Spheres are near where avoidance acts on them \[m\].
    pub(super) near_m: f64,
}

/// Pairs of links that are near each other in one of twenty postures or more, by their spheres, and whose shapes touch in
/// none: they cannot meet. Of links whose shapes are not known, those that are near in three of ten.
pub(super) fn harmless<const N: usize>(
    look: &Look<'_, N>,
    exempt: &[(String, String)],
    range: &[SVector<f64, N>; 2],
) -> Vec<Harmless> {
    let Look { chain, points, shapes, near_m } = *look;
    let watched = SelfPairs::new(chain, points, exempt).watched;
    let points = points.as_slice();
    let pairs: BTreeSet<_> =
        watched.iter().map(|&(i, j)| (points[i].link, points[j].link)).collect();
    let postures: Vec<Kinematics<N>> = (1..=POSTURE_COUNT)
        .map(|k| {
            let mut kinematics = Kinematics::new();
            forward_kinematics(chain, &spread_posture(&range[0], &range[1], k), &mut kinematics);
            kinematics
        })
        .collect();
    let in_cover = |link: usize| {
        let name = &chain.moving_links()[link].0;
        shapes.and_then(|(_, cover)| cover.links.iter().position(|of| of.link == *name))
    };
    let judge = |&(a, b): &(usize, usize)| {
        let are_near = |at: &&Kinematics<N>| {
            let of_pair =
                watched.iter().filter(|&&(i, j)| points[i].link == a && points[j].link == b);
            of_pair.into_iter().any(|&(i, j)| {
                let [x, y] = [i, j].map(|i| point_position(at, points[i].joint, points[i].centre));
                x.distance(y) <= points[i].radius + points[j].radius + near_m
            })
        };
        let joint = |link: usize| chain.moving_links()[link].1;
        if joint(a).abs_diff(joint(b)) > JOINTS_BETWEEN_MAX {
            return None;
        }
        let near: Vec<_> = postures.iter().filter(are_near).collect();
        let fraction = near.len() as f64 / POSTURE_COUNT as f64;
        let shapes_touch = |at: &Kinematics<N>| match (shapes, in_cover(a), in_cover(b)) {
            (Some((meshes, _)), Some(one), Some(other)) => {
                let [x, y] =
                    [a, b].map(|link| link_pose(chain, at, link).unwrap_or(Pose::IDENTITY));
                meshes.touch((one, &x), (other, &y))
            }
            _ => fraction < TOUCHING_FRACTION,
        };
        let name = |link: usize| chain.moving_links()[link].0.clone();
        let touches = |k: usize| {
            let mut kinematics = Kinematics::new();
            let q = between([joint(a), joint(b)], range, k);
            forward_kinematics(chain, &q, &mut kinematics);
            are_near(&&kinematics) && shapes_touch(&kinematics)
        };
        let apart = fraction >= NEAR_FRACTION
            && !near.iter().any(|at| shapes_touch(at))
            && !(1..=BETWEEN_COUNT).into_par_iter().any(touches);
        apart.then(|| Harmless {
            links: [name(a), name(b)],
            reason: format!("near in {:.0} %, touching in none", 100.0 * fraction),
        })
    };
    pairs.iter().collect::<Vec<_>>().par_iter().filter_map(|pair| judge(pair)).collect()
}
