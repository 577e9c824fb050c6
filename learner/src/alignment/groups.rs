//! Whether points fall into two groups.

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

/// The split into two groups with the least scatter, if they lie far apart against it. Points are sorted
/// along the line between the two that are farthest from each other.
pub(crate) fn two_groups(points: &[Vec<f64>]) -> Option<Groups> {
    let count = points.len();
    if count < 3 {
        return None;
    }
    let squared =
        |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum() };
    let pairs = (0..count).flat_map(|i| (0..i).map(move |j| (i, j)));
    let (a, b) = pairs.max_by(|x, y| {
        squared(&points[x.0], &points[x.1]).total_cmp(&squared(&points[y.0], &points[y.1]))
    })?;
    let along = |i: usize| squared(&points[i], &points[a]) - squared(&points[i], &points[b]);
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|i, j| along(*i).total_cmp(&along(*j)));
    let mean = |group: &[usize]| -> Vec<f64> {
        let n = group.len() as f64;
        (0..points[0].len()).map(|c| group.iter().map(|i| points[*i][c]).sum::<f64>() / n).collect()
    };
    let scatter = |group: &[usize]| -> f64 {
        let mean = mean(group);
        group.iter().map(|i| squared(&points[*i], &mean)).sum()
    };
    let within = |split: &usize| scatter(&order[..*split]) + scatter(&order[*split..]);
    let split = (1..count).min_by(|a, b| within(a).total_cmp(&within(b)))?;
    let distance = squared(&mean(&order[..split]), &mean(&order[split..])).sqrt();
    // A group of one has no scatter of its own: the degrees of freedom are those of both together.
    let deviation = (within(&split) / (count - 2) as f64).sqrt().max(SCATTER_MIN * distance);
    let mut second = vec![false; count];
    order[split..].iter().for_each(|i| second[*i] = true);
    (distance > SEPARATION_MIN * deviation).then_some(Groups { second, distance })
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
        assert_eq!(two_groups(&[vec![0.0], vec![1.0]]), None);
    }
}
