//! Few spheres around a surface.
//!
//! A centre c of depth d may have a sphere of radius d + p: the ball of radius d lies inside, so that the
//! sphere sticks out by at most the protrusion p. A patch x of the surface then *needs* the protrusion
//! |x − c| − d of a centre c. For a protrusion, patches are covered greedily, the sphere that covers most of what
//! is left first; then centres and patches are assigned to each other in turns, as in Lloyd's algorithm, so that
//! the largest protrusion falls.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use crate::primitives::cuboid;
use crate::solid::{Centre, Solid};
use crate::triangle::{Triangle, ends};

/// About so many patches has the surface of a link.
const PATCHES: f64 = 2400.0;
/// Patches are no smaller than this \[m\].
const PATCH_MIN_M: f64 = 0.003;
/// Slivers are cut into no more than about so many pieces.
const CUTS_MAX: f64 = 4e6;
/// Cutting adds no more pieces than this: to usual links it adds a third of that.
const PIECES_MAX: usize = 300_000;
/// No link has more patches than this; usual ones have half as many.
const PATCHES_MAX: usize = 6000;
/// So many centres are chosen from.
const CENTRES_MAX: usize = 3000;
/// Rounds in which centres and patches are assigned to each other.
const ROUNDS_MAX: usize = 30;
/// So many spheres are tried to be left out before a number of them is final.
const TRIES: usize = 6;
/// What a configuration says of a centre \[m\].
const DIGIT_M: f64 = 1e-4;

/// A sphere on a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre in the link's frame \[m\].
    pub centre: DVec3,
    /// Radius \[m\].
    pub radius: f64,
}

/// A surface in patches, and centres to cover it from.
pub(crate) struct Coverable {
    solid: Solid,
    /// Corners of the triangles of each patch: a ball that holds them holds the triangles, as it is convex.
    patches: Vec<Vec<DVec3>>,
    centres: Vec<Centre>,
    /// The protrusion that each patch needs of each centre \[m\], row by row for the centres.
    needs: Vec<f32>,
    /// The surface itself sticks out so far \[m\].
    excess: f64,
}

impl Coverable {
    /// Cuts the surface of a link into patches. `None` where it has no triangles.
    pub(crate) fn new(triangles: &[Triangle], excess: f64) -> Option<Self> {
        Self::of_surface(triangles, excess).or_else(|| {
            // Too thin to have an area: the box around it has one.
            let (low, high) = ends(triangles.iter().flatten().copied());
            let size = (high - low) + 2.0 * DIGIT_M;
            let around = cuboid(size).into_iter();
            let around: Vec<_> =
                around.map(|t| t.map(|corner| corner + (low + high) / 2.0)).collect();
            size.is_finite().then(|| Self::of_surface(&around, excess + size.length())).flatten()
        })
    }

    /// `None` where the surface has no area.
    fn of_surface(triangles: &[Triangle], excess: f64) -> Option<Self> {
        let (patches, cut) = patches(triangles);
        let solid = Solid::new(&cut)?;
        let medial = solid.medial_centres();
        // Every so many of them, in an order that no row of the grid repeats: multiples of the golden ratio.
        let fraction = CENTRES_MAX as f64 / medial.len().max(1) as f64;
        let is_kept = |i: &usize| (*i as f64 * 0.618_033_988_749_895).fract() < fraction;
        let mut centres: Vec<Centre> =
            (0..medial.len()).filter(is_kept).map(|i| medial[i]).collect();
        let needs_of = |centre: &Centre| {
            let (at, depth) = (centre.at, centre.depth);
            patches.iter().map(move |patch| (farthest(patch, at) - depth) as f32)
        };
        let mut needs: Vec<f32> = centres.iter().flat_map(needs_of).collect();
        // A thin part has no inside on the grid: its patches are centres themselves.
        let mut least = vec![f32::INFINITY; patches.len()];
        for row in needs.chunks_exact(patches.len()) {
            least.iter_mut().zip(row).for_each(|(least, need)| *least = least.min(*need));
        }
        for (patch, least) in patches.iter().zip(&least) {
            let centre = Centre { at: middle(patch), depth: 0.0 };
            if farthest(patch, centre.at) as f32 <= *least {
                needs.extend(needs_of(&centre));
                centres.push(centre);
            }
        }
        Some(Self { solid, patches, centres, needs, excess })
    }

    fn row(&self, centre: usize) -> &[f32] {
        &self.needs[centre * self.patches.len()..][..self.patches.len()]
    }

    /// Centres whose spheres cover the surface within a protrusion \[m\], or nothing where they are more than `most`.
    pub(crate) fn chosen(&self, protrusion: f64, most: usize) -> Option<Vec<usize>> {
        let limit = protrusion as f32;
        let words = self.patches.len().div_ceil(64);
        let mut sets = vec![0_u64; self.centres.len() * words];
        for (centre, set) in sets.chunks_exact_mut(words).enumerate() {
            for (patch, need) in self.row(centre).iter().enumerate() {
                set[patch / 64] |= u64::from(*need <= limit) << (patch % 64);
            }
        }
        let gain = |centre: usize, left: &[u64]| {
            let set = &sets[centre * words..][..words];
            set.iter().zip(left).map(|(a, b)| (a & b).count_ones()).sum::<u32>()
        };
        let mut left = vec![u64::MAX; words];
        if let (Some(last), rest @ 1..) = (left.last_mut(), self.patches.len() % 64) {
            *last = (1 << rest) - 1;
        }
        // Gains only fall, so a centre whose old gain is the largest of all is looked at again first.
        let mut queue: BTreeSet<(u32, usize)> =
            (0..self.centres.len()).map(|c| (gain(c, &left), c)).collect();
        let mut chosen = Vec::new();
        while left.iter().any(|word| *word != 0) {
            let (old, centre) = queue.pop_last()?;
            let new = gain(centre, &left);
            if new < old {
                queue.insert((new, centre));
                continue;
            }
            if new == 0 || chosen.len() == most {
                return None;
            }
            chosen.push(centre);
            for (word, set) in left.iter_mut().zip(&sets[centre * words..]) {
                *word &= !set;
            }
        }
        self.drop_redundant(&mut chosen, limit);
        Some(chosen)
    }

    /// Takes away what others cover too, what was chosen last first.
    fn drop_redundant(&self, chosen: &mut Vec<usize>, limit: f32) {
        for at in (0..chosen.len()).rev() {
            let others =
                || chosen.iter().enumerate().filter(|(other, _)| *other != at).map(|(_, c)| *c);
            let covered =
                (0..self.patches.len()).all(|patch| others().any(|c| self.row(c)[patch] <= limit));
            if covered {
                chosen.remove(at);
            }
        }
    }

    /// Which patches each centre covers with the least protrusion.
    fn assigned(&self, chosen: &[usize]) -> Vec<Vec<usize>> {
        let mut assigned = vec![Vec::new(); chosen.len()];
        for patch in 0..self.patches.len() {
            let need = |at: &usize| self.row(chosen[*at])[patch];
            let best = (0..chosen.len()).min_by(|a, b| need(a).total_cmp(&need(b)));
            if let Some(best) = best {
                assigned[best].push(patch);
            }
        }
        assigned
    }

    /// Moves centres, in at most so many rounds, until the largest protrusion no longer falls; returns it \[m\].
    pub(crate) fn settle(&self, chosen: &mut [usize], rounds: usize) -> f64 {
        let need = |centre: usize, patch: &usize| self.row(centre)[*patch];
        let worst = |centre: usize, patches: &[usize]| {
            patches.iter().map(|patch| need(centre, patch)).fold(f32::NEG_INFINITY, f32::max)
        };
        for _ in 0..rounds {
            let mut is_settled = true;
            for (mut patches, centre) in self.assigned(chosen).into_iter().zip(chosen.iter_mut()) {
                // The worst first: most other centres fail at one of the first.
                patches.sort_by(|a, b| need(*centre, b).total_cmp(&need(*centre, a)));
                let mut least = worst(*centre, &patches);
                for other in 0..self.centres.len() {
                    if patches.iter().all(|patch| need(other, patch) < least) && !patches.is_empty()
                    {
                        (least, *centre) = (worst(other, &patches), other);
                        is_settled = false;
                    }
                }
            }
            if is_settled {
                break;
            }
        }
        let assigned = self.assigned(chosen);
        let worsts =
            assigned.iter().zip(chosen.iter()).map(|(patches, centre)| worst(*centre, patches));
        f64::from(worsts.fold(0.0, f32::max))
    }

    /// Fewer centres for the same protrusion \[m\]: those of the fewest patches are left out, as long as the others
    /// can move to where they were.
    pub(crate) fn reduced(&self, mut chosen: Vec<usize>, protrusion: f64) -> Vec<usize> {
        'fewer: loop {
            self.settle(&mut chosen, ROUNDS_MAX);
            let counts: Vec<usize> = self.assigned(&chosen).iter().map(Vec::len).collect();
            let mut order: Vec<usize> = (0..chosen.len()).collect();
            order.sort_by_key(|at| counts[*at]);
            for at in order.into_iter().take(TRIES) {
                let mut fewer = chosen.clone();
                fewer.remove(at);
                if !fewer.is_empty() && self.settle(&mut fewer, ROUNDS_MAX / 3) <= protrusion {
                    chosen = fewer;
                    continue 'fewer;
                }
            }
            return chosen;
        }
    }

    /// The spheres of centres, and the largest protrusion of them \[m\].
    pub(crate) fn spheres(&self, chosen: &[usize]) -> (Vec<Sphere>, f64) {
        let mut spheres = Vec::new();
        let mut protrusion = 0.0_f64;
        for (patches, centre) in self.assigned(chosen).iter().zip(chosen) {
            if patches.is_empty() {
                continue;
            }
            let points: Vec<DVec3> =
                patches.iter().flat_map(|patch| self.patches[*patch].iter().copied()).collect();
            let centre = self.moved(self.centres[*centre], &points);
            let at = (centre.at / DIGIT_M).round() * DIGIT_M;
            // Rounded upwards, so that every corner stays inside.
            let radius = (farthest(&points, at) / DIGIT_M + 1e-6).ceil() * DIGIT_M;
            // Where rounding moved the centre: the depth changes by no more than that.
            let depth = if centre.depth > 2.0 * DIGIT_M { self.solid.distance(at) } else { 0.0 };
            let outside = if centre.depth > 2.0 * DIGIT_M { 0.0 } else { self.solid.distance(at) };
            protrusion = protrusion.max(radius - depth + outside);
            spheres.push(Sphere { centre: at, radius });
        }
        (spheres, protrusion + self.excess)
    }

    /// The centre after small moves that make its protrusion over points smaller.
    fn moved(&self, mut centre: Centre, points: &[DVec3]) -> Centre {
        let mut least = farthest(points, centre.at) - centre.depth;
        let mut step = self.solid.step();
        while step > DIGIT_M {
            let moves = DVec3::AXES.into_iter().flat_map(|axis| [axis * step, axis * -step]);
            // A move within the depth stays inside.
            let moves = moves.filter(|by| by.length() < centre.depth).map(|by| centre.at + by);
            let candidates = moves.map(|at| Centre { at, depth: self.solid.distance(at) });
            let best = candidates
                .map(|moved| (farthest(points, moved.at) - moved.depth, moved))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            match best {
                Some((found, moved)) if found < least - 1e-7 => (least, centre) = (found, moved),
                _ => step /= 2.0,
            }
        }
        centre
    }
}

/// Distance from a centre to the farthest of points \[m\].
fn farthest(points: &[DVec3], centre: DVec3) -> f64 {
    points.iter().map(|point| point.distance_squared(centre)).fold(0.0, f64::max).sqrt()
}

fn middle(points: &[DVec3]) -> DVec3 {
    points.iter().sum::<DVec3>() / points.len() as f64
}

/// Cuts triangles until each is no longer than a patch, and gathers them by where they are. The second value is
/// the cut triangles.
fn patches(triangles: &[Triangle]) -> (Vec<Vec<DVec3>>, Vec<Triangle>) {
    let area = |t: &Triangle| (t[1] - t[0]).cross(t[2] - t[0]).length() / 2.0;
    let total: f64 = triangles.iter().map(area).sum();
    let longest = {
        let (low, high) = ends(triangles.iter().flatten().copied());
        (high - low).max_element()
    };
    let perimeter: f64 =
        triangles.iter().map(|[a, b, c]| a.distance(*b) + b.distance(*c) + c.distance(*a)).sum();
    let mut size =
        (total / PATCHES).sqrt().max(longest / PATCHES).max(perimeter / CUTS_MAX).max(PATCH_MIN_M);
    // Slivers all over the place: coarser, as long as they would take too long. No size is beyond the longest side.
    while size <= 2.0 * longest {
        let found = cut(triangles, size).map(|cut| (gathered(&cut, size), cut));
        match found {
            Some((patches, cut)) if patches.len() <= PATCHES_MAX => return (patches, cut),
            _ => size *= 1.5,
        }
    }
    (gathered(triangles, size), triangles.iter().rev().copied().collect())
}

/// Triangles none of whose sides is longer than a size \[m\]; `None` where they are too many.
fn cut(triangles: &[Triangle], size: f64) -> Option<Vec<Triangle>> {
    let most = triangles.len() + PIECES_MAX;
    let mut cut = Vec::with_capacity(triangles.len());
    let mut open = triangles.to_vec();
    while let Some([a, b, c]) = open.pop() {
        if cut.len() + open.len() > most {
            return None;
        }
        let sides = [a.distance(b), b.distance(c), c.distance(a)];
        let most = sides.into_iter().fold(0.0, f64::max);
        if most <= size {
            cut.push([a, b, c]);
        } else {
            // The longest side in halves.
            let [a, b, c] = if most == sides[0] {
                [a, b, c]
            } else if most == sides[1] {
                [b, c, a]
            } else {
                [c, a, b]
            };
            let half = (a + b) / 2.0;
            open.extend([[a, half, c], [half, b, c]]);
        }
    }
    Some(cut)
}

/// Triangles by where they are: the corners of those in each cell of a size \[m\].
fn gathered(cut: &[Triangle], size: f64) -> Vec<Vec<DVec3>> {
    let mut cells: BTreeMap<[i32; 3], BTreeSet<[u64; 3]>> = BTreeMap::new();
    for triangle in cut {
        let cell = (middle(triangle) / size).floor().as_ivec3().to_array();
        cells
            .entry(cell)
            .or_default()
            .extend(triangle.map(|corner| corner.to_array().map(f64::to_bits)));
    }
    let points = |set: BTreeSet<[u64; 3]>| {
        set.into_iter().map(|bits| DVec3::from_array(bits.map(f64::from_bits)))
    };
    cells.into_values().map(|set| points(set).collect()).collect()
}
