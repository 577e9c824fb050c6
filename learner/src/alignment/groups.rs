//! Whether points fall into groups.

use std::ops::Range;

/// The distance between the means of two groups is so many times their standard deviation: with eight
/// points of one normal distribution it is 2.7 on average, and 6 once in thousands.
const SEPARATION_MIN: f64 = 6.0;
/// Scatter that counts as none, as a fraction of the distance.
const SCATTER_MIN: f64 = 1e-3;

/// Two groups of points.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Groups {
    /// For each point, whether it is of the second group.
    pub second: Vec<bool>,
    /// Distance between their means.
    pub distance: f64,
}

impl Groups {
    /// Points of the smaller group.
    pub(crate) fn smaller(&self) -> usize {
        let second = self.second.iter().filter(|is| **is).count();
        second.min(self.second.len() - second)
    }
}

fn squared(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Points along the line between the two that are farthest from each other.
struct Sorted<'a> {
    points: &'a [Vec<f64>],
    order: Vec<usize>,
}

impl<'a> Sorted<'a> {
    fn new(points: &'a [Vec<f64>]) -> Option<Self> {
        let count = points.len();
        let pairs = (0..count).flat_map(|i| (0..i).map(move |j| (i, j)));
        let (a, b) = pairs.max_by(|x, y| {
            squared(&points[x.0], &points[x.1]).total_cmp(&squared(&points[y.0], &points[y.1]))
        })?;
        let along = |i: usize| squared(&points[i], &points[a]) - squared(&points[i], &points[b]);
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|i, j| along(*i).total_cmp(&along(*j)));
        Some(Self { points, order })
    }

    fn mean(&self, group: Range<usize>) -> Vec<f64> {
        let n = group.len() as f64;
        let sum = |c: usize| -> f64 {
            self.order[group.clone()].iter().map(|i| self.points[*i][c]).sum()
        };
        (0..self.points[0].len()).map(|c| sum(c) / n).collect()
    }

    fn scatter(&self, group: Range<usize>) -> f64 {
        let mean = self.mean(group.clone());
        self.order[group].iter().map(|i| squared(&self.points[*i], &mean)).sum()
    }

    /// The groups between these places of the order, if neighbours lie far apart against the scatter in all of
    /// them; gives the distance of each from the one before.
    fn separated(&self, bounds: &[usize]) -> Option<Vec<f64>> {
        let groups = bounds.windows(2).map(|b| b[0]..b[1]);
        let within: f64 = groups.clone().map(|group| self.scatter(group)).sum();
        let means: Vec<Vec<f64>> = groups.map(|group| self.mean(group)).collect();
        let distances: Vec<f64> = means.windows(2).map(|m| squared(&m[0], &m[1]).sqrt()).collect();
        let largest = distances.iter().copied().fold(0.0, f64::max);
        // A group of one has no scatter of its own: the degrees of freedom are those of all together.
        let freedom = (self.points.len() - means.len()) as f64;
        let deviation = (within / freedom).sqrt().max(SCATTER_MIN * largest);
        distances.iter().all(|d| *d > SEPARATION_MIN * deviation).then_some(distances)
    }

    /// Those from a place of the order on.
    fn from(&self, place: usize) -> Vec<bool> {
        let mut second = vec![false; self.points.len()];
        self.order[place..].iter().for_each(|i| second[*i] = true);
        second
    }
}

/// The split into two groups with the least scatter, if they lie far apart against it.
pub(crate) fn two_groups(points: &[Vec<f64>]) -> Option<Groups> {
    let count = points.len();
    if count < 3 {
        return None;
    }
    let sorted = Sorted::new(points)?;
    let within = |split: &usize| sorted.scatter(0..*split) + sorted.scatter(*split..count);
    let split = (1..count).min_by(|a, b| within(a).total_cmp(&within(b)))?;
    let distances = sorted.separated(&[0, split, count])?;
    Some(Groups { second: sorted.from(split), distance: distances[0] })
}

/// [`two_groups`]; or where there are three, two or more points in each, the outer one that the first point of
/// those two is not in, and the others.
pub(crate) fn one_group_from_the_others(points: &[Vec<f64>]) -> Option<Groups> {
    let count = points.len();
    if let Some(groups) = two_groups(points) {
        return Some(groups);
    }
    let sorted = Sorted::new(points)?;
    let pairs = (2..count).flat_map(|a| (a + 2..count.saturating_sub(1)).map(move |b| (a, b)));
    let within = |(a, b): &(usize, usize)| {
        sorted.scatter(0..*a) + sorted.scatter(*a..*b) + sorted.scatter(*b..count)
    };
    let (a, b) = pairs.min_by(|x, y| within(x).total_cmp(&within(y)))?;
    let distances = sorted.separated(&[0, a, b, count])?;
    let first = |group: Range<usize>| sorted.order[group].iter().min().copied();
    let last_is_second = first(0..a) < first(b..count);
    let second = sorted.from(if last_is_second { b } else { a });
    Some(if last_is_second {
        Groups { second, distance: distances[1] }
    } else {
        Groups { second: second.iter().map(|is| !is).collect(), distance: distances[0] }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn two_groups_are_found_and_one_is_not_split() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        // A sum of twelve: nearly normal.
        let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        let mut split = 0;
        for count in [4, 6, 8, 14] {
            for _ in 0..200 {
                let one: Vec<Vec<f64>> =
                    (0..count).map(|_| (0..3).map(|_| normal()).collect()).collect();
                split += usize::from(two_groups(&one).is_some_and(|groups| groups.smaller() > 1));
                let mut two = one.clone();
                two[..count / 2].iter_mut().for_each(|p| p[1] += 40.0);
                let groups = two_groups(&two).expect("two groups");
                assert_eq!(groups.smaller(), count / 2);
                assert!((groups.distance - 40.0).abs() < 5.0, "{}", groups.distance);
            }
        }
        assert!(split < 10, "{split} of 800 split");
        let mut wrong = 0;
        for _ in 0..200 {
            let one: Vec<Vec<f64>> = (0..9).map(|_| (0..3).map(|_| normal()).collect()).collect();
            wrong += usize::from(
                one_group_from_the_others(&one).is_some_and(|groups| groups.smaller() > 1),
            );
            let mut three = one.clone();
            three.iter_mut().enumerate().for_each(|(i, p)| p[0] += 30.0 * (i % 3) as f64);
            let groups = one_group_from_the_others(&three).expect("three groups");
            // The first group is i % 3 = 0, the last i % 3 = 2.
            let second: Vec<bool> = (0..9).map(|i| i % 3 == 2).collect();
            assert_eq!(groups.second, second);
        }
        assert!(wrong < 4, "{wrong} of 200 split in two or three");
        assert_eq!(two_groups(&[vec![0.0], vec![1.0]]), None);
    }
}
