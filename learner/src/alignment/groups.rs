//! Whether points fall into groups.

use tprmp_model::skill_model::MODE_CAPACITY;

/// The distance between the means of two groups is so many times their standard deviation: with eight
/// points of one normal distribution it is 2.7 on average, and 6 once in thousands.
const SEPARATION_MIN: f64 = 6.0;
/// Scatter that counts as none, as a fraction of the distance.
const SCATTER_MIN: f64 = 1e-3;

/// Groups of points.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Groups {
    /// For each point, its group: numbered as their first points are.
    pub labels: Vec<usize>,
    /// Least distance between means of two.
    pub distance: f64,
}

impl Groups {
    fn new(points: &[Vec<f64>], labels: Vec<usize>) -> Self {
        let means = means(points, &labels);
        let pairs = (0..means.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        let nearest =
            pairs.map(|(i, j)| squared(&means[i], &means[j])).fold(f64::INFINITY, f64::min);
        Self { labels, distance: nearest.sqrt() }
    }

    /// Each point a group of its own.
    pub(crate) fn of_one_each(points: &[Vec<f64>]) -> Self {
        Self::new(points, (0..points.len()).collect())
    }

    /// How many.
    pub(crate) fn count(&self) -> usize {
        self.labels.iter().max().map_or(0, |last| last + 1)
    }

    /// Points of one.
    pub(crate) fn members(&self, label: usize) -> Vec<usize> {
        (0..self.labels.len()).filter(|i| self.labels[*i] == label).collect()
    }

    /// Points of the smallest.
    pub(crate) fn smallest(&self) -> usize {
        (0..self.count()).map(|label| self.members(label).len()).min().unwrap_or(0)
    }

    /// Whether each of these groups lies in one of the others.
    pub(crate) fn finer_than(&self, other: &Self) -> bool {
        let one = |label: usize| {
            let members = self.members(label);
            members.iter().all(|i| other.labels[*i] == other.labels[members[0]])
        };
        (0..self.count()).all(one)
    }

    /// Those of some of all points, where the rest has joined the groups that they are nearest to.
    pub(crate) fn joined(&self, some: &[usize], all: &[Vec<f64>]) -> Self {
        let label = |i: usize| {
            let apart = |place: &usize| squared(&all[some[*place]], &all[i]);
            let nearest = (0..some.len()).min_by(|a, b| apart(a).total_cmp(&apart(b)));
            self.labels[some.iter().position(|s| *s == i).or(nearest).unwrap_or(0)]
        };
        let labels: Vec<usize> = (0..all.len()).map(label).collect();
        Self::new(all, numbered(&labels))
    }
}

fn squared(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Labels in the order of their first points.
fn numbered(labels: &[usize]) -> Vec<usize> {
    let mut known = Vec::new();
    let number = |label: &usize| {
        known.iter().position(|k| k == label).unwrap_or_else(|| {
            known.push(*label);
            known.len() - 1
        })
    };
    labels.iter().map(number).collect()
}

fn means(points: &[Vec<f64>], labels: &[usize]) -> Vec<Vec<f64>> {
    let count = labels.iter().max().map_or(0, |last| last + 1);
    let mean = |label: usize| -> Vec<f64> {
        let members = || points.iter().zip(labels).filter(|(_, l)| **l == label);
        let n = members().count() as f64;
        (0..points[0].len()).map(|c| members().map(|(p, _)| p[c]).sum::<f64>() / n).collect()
    };
    (0..count).map(mean).collect()
}

/// The shortest tree through all points: its edges, the longest first.
fn shortest_tree(points: &[Vec<f64>]) -> Vec<(usize, usize)> {
    let mut nearest: Vec<(f64, usize)> =
        points.iter().map(|p| (squared(p, &points[0]), 0)).collect();
    let mut open: Vec<usize> = (1..points.len()).collect();
    let mut edges = Vec::new();
    while let Some(at) =
        (0..open.len()).min_by(|a, b| nearest[open[*a]].0.total_cmp(&nearest[open[*b]].0))
    {
        let new = open.swap_remove(at);
        edges.push((nearest[new].0, (nearest[new].1, new)));
        for i in &open {
            let apart = squared(&points[*i], &points[new]);
            if apart < nearest[*i].0 {
                nearest[*i] = (apart, new);
            }
        }
    }
    edges.sort_by(|a, b| b.0.total_cmp(&a.0));
    edges.into_iter().map(|(_, edge)| edge).collect()
}

/// Groups of points that lie far apart against the scatter in all of them: the fewest. They are what the shortest tree
/// through all points falls into when its longest edges are cut. Three groups or more need two points a group, and
/// three where one has a single one: among few points some lie near each other by chance.
pub(crate) fn groups(points: &[Vec<f64>]) -> Option<Groups> {
    let count = points.len();
    let edges = shortest_tree(points);
    (2..count.min(MODE_CAPACITY + 1)).find_map(|number| {
        let mut labels: Vec<usize> = (0..count).collect();
        for (a, b) in &edges[number - 1..] {
            let (a, b) = (labels[*a], labels[*b]);
            labels.iter_mut().filter(|label| **label == b).for_each(|label| *label = a);
        }
        let groups = Groups::new(points, numbered(&labels));
        let needed = if groups.smallest() > 1 { 2 * number } else { 3 * number };
        if number > 2 && count < needed {
            return None;
        }
        let means = means(points, &groups.labels);
        let within: f64 =
            points.iter().zip(&groups.labels).map(|(p, label)| squared(p, &means[*label])).sum();
        // A group of one has no scatter of its own: the degrees of freedom are those of all together.
        let deviation = (within / (count - number) as f64).sqrt();
        let least = SEPARATION_MIN * deviation.max(SCATTER_MIN * groups.distance);
        (groups.distance > least).then_some(groups)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Points of one normal distribution, nearly: sums of twelve.
    fn scattered(random: &mut ChaCha8Rng, count: usize) -> Vec<Vec<f64>> {
        let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        (0..count).map(|_| (0..3).map(|_| normal()).collect()).collect()
    }

    #[test]
    fn groups_are_found_and_one_is_not_split() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut split = 0;
        for count in [4, 6, 8, 14] {
            for _ in 0..200 {
                let one = scattered(&mut random, count);
                split += usize::from(groups(&one).is_some_and(|groups| groups.smallest() > 1));
                let mut two = one.clone();
                two[..count / 2].iter_mut().for_each(|p| p[1] += 40.0);
                let groups = groups(&two).expect("two groups");
                assert_eq!((groups.count(), groups.smallest()), (2, count / 2));
                assert!((groups.distance - 40.0).abs() < 5.0, "{}", groups.distance);
            }
        }
        assert!(split < 10, "{split} of 800 split");
        assert_eq!(groups(&[vec![0.0], vec![1.0]]), None);
    }

    #[test]
    fn many_groups_are_found_wherever_they_lie() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        for number in 3..=MODE_CAPACITY {
            for _ in 0..50 {
                let mut points = scattered(&mut random, 3 * number);
                let row = |i: usize| [40.0 * (i % number) as f64, 0.0];
                let radius = 40.0 * number as f64 / std::f64::consts::TAU;
                let around = |i: usize| {
                    let (sin, cos) =
                        ((i % number) as f64 / number as f64 * std::f64::consts::TAU).sin_cos();
                    [1.5 * radius * cos, 1.5 * radius * sin]
                };
                let in_row = random.random::<bool>();
                for (i, p) in points.iter_mut().enumerate() {
                    let shift = if in_row { row(i) } else { around(i) };
                    p[0] += shift[0];
                    p[1] += shift[1];
                }
                let groups = groups(&points).expect("groups");
                assert_eq!(groups.labels, (0..3 * number).map(|i| i % number).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn the_rest_joins_the_nearest_groups() {
        let all: Vec<Vec<f64>> = [13.0, 0.0, 10.0, 0.1, 10.2].iter().map(|x| vec![*x]).collect();
        let some = [1, 2, 3, 4];
        let two = groups(&all[1..]).expect("two groups");
        let joined = two.joined(&some, &all);
        assert_eq!(joined.labels, [0, 1, 0, 1, 0]);
        let each = Groups::of_one_each(&all);
        assert!(each.finer_than(&joined) && !joined.finer_than(&each));
    }
}
