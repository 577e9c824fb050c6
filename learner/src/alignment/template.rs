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

/// Coordinates of a pose: position, and twice the quaternion, whose distances are angles.
const COORDINATES: usize = 7;
/// Maps are found again until no place moves by more than this part of the path.
const CHANGE_MIN: f64 = 1e-3;

type Point = [f64; COORDINATES];

/// Demonstrations at equal steps of their paths, as frames see them.
pub(crate) struct Views {
    /// For each frame and demonstration, its points \[ŷ\].
    points: Vec<Vec<Vec<Point>>>,
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
        let of = |p: usize| -> Vec<Vec<Point>> {
            let seen = |i: usize| -> Vec<Point> {
                let from = skill.frames(&demonstrations[i])[p].inverse();
                let fraction = |k: usize| k as f64 / (count - 1) as f64;
                let pose = |k| between(&demonstrations[i].poses, tracks[i].sample_at(fraction(k)));
                (0..count)
                    .map(|k| point(&from.compose(&pose(k)), motions[i].scales, skill))
                    .collect()
            };
            let mut all: Vec<Vec<Point>> = (0..demonstrations.len()).map(seen).collect();
            one_hemisphere(&mut all);
            all
        };
        Self { points: frames.iter().map(|p| of(*p)).collect() }
    }

    fn demonstrations(&self) -> usize {
        self.points[0].len()
    }

    fn places(&self) -> usize {
        self.points[0][0].len()
    }
}

fn point(pose: &Pose, scales: [f64; 2], skill: &Skill) -> Point {
    let p = pose.position * scales[0];
    let rotates = if skill.manifold.has_orientation() { 2.0 * scales[1] } else { 0.0 };
    let DQuat { x, y, z, w } = pose.orientation;
    [p.x, p.y, p.z, w * rotates, x * rotates, y * rotates, z * rotates]
}

/// Quaternions of either sign are the same rotation: the signs in which neighbours are near each other,
/// and demonstrations the first one.
fn one_hemisphere(demonstrations: &mut [Vec<Point>]) {
    let dot = |a: &Point, b: &Point| (3..COORDINATES).map(|i| a[i] * b[i]).sum::<f64>();
    let flip = |a: &mut Point| a[3..].iter_mut().for_each(|x| *x = -*x);
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
/// the demonstrations are most likely to be samples of one Gaussian a place and frame.
///
/// Alternating: means and variances from the maps, then each map from means and variances.
pub(crate) fn warps(views: &Views, settings: &AlignmentSettings) -> Vec<Warp> {
    let count = views.places();
    let mut warps = vec![Warp::identity(count); views.demonstrations()];
    for _ in 0..settings.rounds {
        let template = means(views, &warps, settings.agreement_floor);
        let cost = |i: usize, a: usize, b: usize| -> f64 {
            let frames = views.points.iter().zip(&template);
            let each = frames.map(|(points, means)| {
                distance(&points[i][a], &means[b].point) / means[b].variance
            });
            each.sum()
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

/// For each frame the means of the demonstrations under their maps.
fn means(views: &Views, warps: &[Warp], floor: f64) -> Vec<Vec<Mean>> {
    let count = views.places();
    let of = |demonstrations: &Vec<Vec<Point>>| -> Vec<Mean> {
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
    };
    views.points.iter().map(of).collect()
}
