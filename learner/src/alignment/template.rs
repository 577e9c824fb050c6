//! What demonstrations have in common along their paths, seen from each frame, and how each is mapped
//! to it.

use glam::DQuat;
use rayon::prelude::*;
use tprmp_spatial::Pose;

use crate::alignment::resample::between;
use crate::alignment::rest::Motion;
use crate::alignment::timing::Track;
use crate::alignment::warp::{Warp, best, centred};
use crate::demonstration::Demonstration;
use crate::skill::{AlignmentSettings, Skill};

/// Coordinates of a position, and of a rotation: twice the quaternion, whose distances are angles.
const COORDINATES: usize = 4;
/// Maps are found again until no place moves by more than this part of the path.
const CHANGE_MIN: f64 = 1e-3;

type Point = [f64; COORDINATES];

/// Demonstrations at equal steps of their paths, as frames see them. A frame may see their positions agree and
/// not their orientations, or the other way round: these are views of their own.
pub(crate) struct Views {
    /// Positions, and orientations where the skill has them: for each frame and demonstration, its
    /// points \[ŷ\].
    blocks: Vec<Vec<Vec<Vec<Point>>>>,
}

impl Views {
    /// The views from some of the skill's frames.
    pub(crate) fn new(
        skill: &Skill,
        demonstrations: &[Demonstration],
        motions: &[Motion],
        tracks: &[Track],
        frames: &[usize],
    ) -> Self {
        let count = skill.alignment.places;
        let fraction = |k: usize| k as f64 / (count - 1) as f64;
        let poses: Vec<Vec<Pose>> = std::iter::zip(demonstrations, tracks)
            .map(|(d, track)| {
                (0..count).map(|k| between(&d.poses, track.sample_at(fraction(k)))).collect()
            })
            .collect();
        let of = |p: usize, block: usize| -> Vec<Vec<Point>> {
            let seen = |i: usize| -> Vec<Point> {
                let from = skill.frames(&demonstrations[i])[p].inverse();
                let scale = motions[i].scales[block];
                poses[i].iter().map(|pose| point(&from.compose(pose), block, scale)).collect()
            };
            let mut all: Vec<Vec<Point>> = (0..demonstrations.len()).map(seen).collect();
            if block == 1 {
                one_hemisphere(&mut all);
            }
            all
        };
        let blocks = 0..if skill.manifold.has_orientation() { 2 } else { 1 };
        let all = |block| frames.iter().map(|p| of(*p, block)).collect();
        Self { blocks: blocks.map(all).collect() }
    }

    fn demonstrations(&self) -> usize {
        self.blocks[0][0].len()
    }

    fn places(&self) -> usize {
        self.blocks[0][0][0].len()
    }
}

fn point(pose: &Pose, block: usize, scale: f64) -> Point {
    if block == 0 {
        let p = pose.position * scale;
        return [p.x, p.y, p.z, 0.0];
    }
    let DQuat { x, y, z, w } = pose.orientation;
    [w, x, y, z].map(|component| 2.0 * scale * component)
}

/// Quaternions of either sign are the same rotation: the signs in which neighbours are near each other,
/// and demonstrations the first one.
fn one_hemisphere(demonstrations: &mut [Vec<Point>]) {
    let dot = |a: &Point, b: &Point| (0..COORDINATES).map(|i| a[i] * b[i]).sum::<f64>();
    let flip = |a: &mut Point| a.iter_mut().for_each(|x| *x = -*x);
    for i in 0..demonstrations.len() {
        let middle = demonstrations[0].len() / 2;
        if dot(&demonstrations[i][middle], &demonstrations[0][middle]) < 0.0 {
            flip(&mut demonstrations[i][middle]);
        }
        let path = &mut demonstrations[i];
        for k in (0..middle).rev() {
            if dot(&path[k], &path[k + 1]) < 0.0 {
                flip(&mut path[k]);
            }
        }
        for k in middle + 1..path.len() {
            if dot(&path[k], &path[k - 1]) < 0.0 {
                flip(&mut path[k]);
            }
        }
    }
}

/// What a frame sees at a place: the mean, and the mean square distance from it \[ŷ²\].
struct Mean {
    point: Point,
    variance: f64,
}

/// A map for each demonstration, from the common coordinate to that of its track: those under which
/// the demonstrations agree best with their mean, seen from the frames that see them agree.
///
/// ```text
/// c_i(a, b) = Σ_p w_p(b) |x_i^p(a) − m^p(b)|² / V^p(b)     w_p = (1/V^p) / Σ_q 1/V^q
/// ```
///
/// for positions and for orientations, with the mean m^p and the mean square distance V^p from it, of frame
/// p. Alternating: means from the maps, then each map from the means.
pub(crate) fn warps(views: &Views, settings: &AlignmentSettings) -> Vec<Warp> {
    let count = views.places();
    let mut warps = vec![Warp::identity(count); views.demonstrations()];
    for _ in 0..settings.rounds {
        let template: Vec<Vec<Vec<Mean>>> = views
            .blocks
            .iter()
            .map(|frames| {
                frames.iter().map(|all| means(all, &warps, settings.agreement_floor)).collect()
            })
            .collect();
        let cost = |i: usize, a: usize, b: usize| -> f64 {
            let blocks = views.blocks.iter().zip(&template);
            let of_block = |(frames, template): (&Vec<Vec<Vec<Point>>>, &Vec<Vec<Mean>>)| {
                let each = frames.iter().zip(template).map(|(points, means)| {
                    let precision = 1.0 / means[b].variance;
                    let apart = distance(&points[i][a], &means[b].point);
                    [precision, precision * precision * apart]
                });
                let [precisions, weighted] =
                    each.fold([0.0; 2], |sum, x| [sum[0] + x[0], sum[1] + x[1]]);
                weighted / precisions
            };
            blocks.map(of_block).sum()
        };
        let found: Vec<Warp> = (0..warps.len())
            .into_par_iter()
            .map(|i| best(count, |a, b| cost(i, a, b), settings.stiffness, settings.width))
            .collect();
        let found = centred(&found);
        let pairs = found.iter().zip(&warps);
        let changes = pairs.flat_map(|(new, old)| {
            new.values().iter().zip(old.values()).map(|(new, old)| (new - old).abs())
        });
        let change = changes.fold(0.0, f64::max);
        warps = found;
        if change < CHANGE_MIN {
            break;
        }
    }
    warps
}

fn distance(a: &Point, b: &Point) -> f64 {
    (0..COORDINATES).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum()
}

/// The means of demonstrations under their maps, in one view.
fn means(demonstrations: &[Vec<Point>], warps: &[Warp], floor: f64) -> Vec<Mean> {
    let count = demonstrations[0].len();
    let at = |k: usize| {
        let here: Vec<Point> = demonstrations
            .iter()
            .zip(warps)
            .map(|(path, warp)| {
                let place = warp.values()[k] * (count - 1) as f64;
                let i = (place as usize).min(count - 2);
                let part = place - i as f64;
                std::array::from_fn(|c| path[i][c] + part * (path[i + 1][c] - path[i][c]))
            })
            .collect();
        let n = here.len() as f64;
        let point: Point = std::array::from_fn(|c| here.iter().map(|p| p[c]).sum::<f64>() / n);
        let squares = here.iter().map(|p| distance(p, &point)).sum::<f64>() / n;
        Mean { point, variance: squares + floor * floor }
    };
    (0..count).map(at).collect()
}
