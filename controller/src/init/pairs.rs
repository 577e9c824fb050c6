//! Which links need not keep clear of each other, or of what the arm stands on.

use std::collections::BTreeMap;

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
/// Links whose shapes touch in fewer of them can be kept apart by the range of a joint …
const SELDOM_FRACTION: f64 = 0.05;
/// … that loses no more of it than this, …
const LOST_MAX: f64 = 0.35;
/// … ends so long before they touch \[rad or m\], …
const CUT_MARGIN: f64 = 0.05;
/// … and so far from home. So often is it cut at most.
const HOME_ROOM: f64 = 0.2;
const CUTS_MAX: usize = 4;
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

/// Two links that are kept clear of each other, as far as they are looked at.
struct Pair<'a, const N: usize> {
    look: Look<'a, N>,
    links: [usize; 2],
    /// Spheres of the one and of the other.
    spheres: Vec<(usize, usize)>,
    /// Their places in the cover, where both are in it.
    in_cover: Option<[usize; 2]>,
}

impl<'a, const N: usize> Pair<'a, N> {
    /// All that are watched and have few joints between them.
    fn all(look: &Look<'a, N>, exempt: &[(String, String)]) -> Vec<Self> {
        let Look { chain, points, shapes, .. } = *look;
        let mut spheres = BTreeMap::<[usize; 2], Vec<(usize, usize)>>::new();
        for (i, j) in SelfPairs::new(chain, points, exempt).watched {
            let links = [i, j].map(|i| points.as_slice()[i].link);
            spheres.entry(links).or_default().push((i, j));
        }
        let in_cover = |link: usize| {
            let name = &chain.moving_links()[link].0;
            shapes.and_then(|(_, cover)| cover.links.iter().position(|of| of.link == *name))
        };
        let pair = |(links, spheres): ([usize; 2], _)| {
            let in_cover = in_cover(links[0]).zip(in_cover(links[1])).map(<[usize; 2]>::from);
            Self { look: *look, links, spheres, in_cover }
        };
        let has_few = |pair: &Self| {
            let [a, b] = pair.joints();
            a.abs_diff(b) <= JOINTS_BETWEEN_MAX
        };
        spheres.into_iter().map(pair).filter(has_few).collect()
    }

    fn joints(&self) -> [usize; 2] {
        self.links.map(|link| self.look.chain.moving_links()[link].1)
    }

    fn names(&self) -> [String; 2] {
        self.links.map(|link| self.look.chain.moving_links()[link].0.clone())
    }

    fn are_near(&self, at: &Kinematics<N>) -> bool {
        let points = self.look.points.as_slice();
        self.spheres.iter().any(|&(i, j)| {
            let [x, y] = [i, j].map(|i| point_position(at, points[i].joint, points[i].centre));
            x.distance(y) <= points[i].radius + points[j].radius + self.look.near_m
        })
    }

    /// `None` where a shape is not known.
    fn shapes_touch(&self, at: &Kinematics<N>) -> Option<bool> {
        let ((meshes, _), [one, other]) = self.look.shapes.zip(self.in_cover)?;
        let [x, y] =
            self.links.map(|link| link_pose(self.look.chain, at, link).unwrap_or(Pose::IDENTITY));
        Some(meshes.touch((one, &x), (other, &y)))
    }

    /// Of the postures, those in which they are near.
    fn near<'b>(&self, postures: &'b [Kinematics<N>]) -> Vec<&'b Kinematics<N>> {
        postures.iter().filter(|at| self.are_near(at)).collect()
    }

    /// Whether they touch in this posture of the joints between them; the posture.
    fn touches(&self, range: &[SVector<f64, N>; 2], k: usize) -> Option<SVector<f64, N>> {
        let mut kinematics = Kinematics::new();
        let q = between(self.joints(), range, k);
        forward_kinematics(self.look.chain, &q, &mut kinematics);
        let touch = self.are_near(&kinematics) && self.shapes_touch(&kinematics) != Some(false);
        touch.then_some(q)
    }
}

fn postures<const N: usize>(chain: &Chain<N>, range: &[SVector<f64, N>; 2]) -> Vec<Kinematics<N>> {
    let posture = |k| {
        let mut kinematics = Kinematics::new();
        forward_kinematics(chain, &spread_posture(&range[0], &range[1], k), &mut kinematics);
        kinematics
    };
    (1..=POSTURE_COUNT).map(posture).collect()
}

/// Pairs of links that are near each other in one of twenty postures or more, by their spheres, and whose shapes touch in
/// none: they cannot meet. Of links whose shapes are not known, those that are near in three of ten.
pub(super) fn harmless<const N: usize>(
    look: &Look<'_, N>,
    exempt: &[(String, String)],
    range: &[SVector<f64, N>; 2],
) -> Vec<Harmless> {
    let postures = postures(look.chain, range);
    let judge = |pair: &Pair<'_, N>| {
        let near = pair.near(&postures);
        let fraction = near.len() as f64 / POSTURE_COUNT as f64;
        let apart = match pair.in_cover {
            None => fraction >= TOUCHING_FRACTION,
            Some(_) => {
                fraction >= NEAR_FRACTION
                    && !near.iter().any(|at| pair.shapes_touch(at) == Some(true))
                    && !(1..=BETWEEN_COUNT)
                        .into_par_iter()
                        .any(|k| pair.touches(range, k).is_some())
            }
        };
        apart.then(|| Harmless {
            links: pair.names(),
            reason: format!("near in {:.0} %, touching in none", 100.0 * fraction),
        })
    };
    Pair::all(look, exempt).par_iter().filter_map(judge).collect()
}

/// Pairs that touch seldom, and in no posture once the range of a joint between them ends before: `range` is cut so,
/// around `home`. Their spheres would keep the arm from far more.
pub(super) fn kept_apart<const N: usize>(
    look: &Look<'_, N>,
    exempt: &[(String, String)],
    range: &mut [SVector<f64, N>; 2],
    home: &SVector<f64, N>,
) -> Vec<Harmless> {
    let all = postures(look.chain, range);
    let mut found = Vec::new();
    for pair in Pair::all(look, exempt).iter().filter(|pair| pair.in_cover.is_some()) {
        let near = pair.near(&all).len() as f64 / POSTURE_COUNT as f64;
        if near < NEAR_FRACTION {
            continue;
        }
        let (mut tried, mut cuts) = (*range, Vec::new());
        for _ in 0..CUTS_MAX {
            let touching: Vec<_> = (1..=BETWEEN_COUNT)
                .into_par_iter()
                .filter_map(|k| pair.touches(&tried, k))
                .collect();
            if touching.is_empty() {
                let list = cuts.join(", ");
                let reason = format!(
                    "near in {:.0} %, touching in none within the range of {list}",
                    100.0 * near
                );
                found.push(Harmless { links: pair.names(), reason });
                *range = tried;
                break;
            }
            let seldom = (touching.len() as f64) < SELDOM_FRACTION * BETWEEN_COUNT as f64;
            let cut = seldom.then(|| cut(pair.joints(), &touching, &tried, home)).flatten();
            let Some((joint, [lower, upper])) = cut else { break };
            (tried[0][joint], tried[1][joint]) = (lower, upper);
            cuts.push(format!("`{}`", look.chain.joint_names()[joint]));
        }
    }
    found
}

/// The joint between two links whose range is to be cut, and to what, so that none of these postures is in it: the
/// one that loses least.
fn cut<const N: usize>(
    [a, b]: [usize; 2],
    touching: &[SVector<f64, N>],
    range: &[SVector<f64, N>; 2],
    home: &SVector<f64, N>,
) -> Option<(usize, [f64; 2])> {
    let of_joint = |i: usize| {
        let (mut lower, mut upper) = (range[0][i], range[1][i]);
        let width = upper - lower;
        for q in touching {
            if q[i] < home[i] {
                lower = lower.max(q[i] + CUT_MARGIN);
            } else {
                upper = upper.min(q[i] - CUT_MARGIN);
            }
        }
        // To the hundredth inward, as it is written.
        let [lower, upper] = [(lower * 100.0).ceil() / 100.0, (upper * 100.0).floor() / 100.0];
        let lost = 1.0 - (upper - lower) / width;
        let has_room = home[i] - lower > HOME_ROOM && upper - home[i] > HOME_ROOM;
        (has_room && lost <= LOST_MAX).then_some((i, [lower, upper], lost))
    };
    let least = (a.min(b) + 1..=a.max(b)).filter_map(of_joint).min_by(|x, y| x.2.total_cmp(&y.2));
    least.map(|(joint, ends, _)| (joint, ends))
}
