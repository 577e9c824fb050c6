//! Monotone maps of the unit interval onto itself, and the search for the best one.

/// Steps of the demonstration (first) and of the template (second) that a warp is made of: slopes from
/// a third to three, the bound of a warp, and finer ones about one.
const STEPS: [[usize; 2]; 15] = [
    [1, 1],
    [7, 8],
    [8, 7],
    [4, 5],
    [5, 4],
    [3, 4],
    [4, 3],
    [2, 3],
    [3, 2],
    [1, 2],
    [2, 1],
    [2, 5],
    [5, 2],
    [1, 3],
    [3, 1],
];
/// A warp leaves the diagonal by no more than this part of the path.
const BAND: f64 = 0.25;

/// A strictly increasing map of [0, 1] onto itself, linear between equal steps.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Warp {
    values: Vec<f64>,
    places: Vec<f64>,
}

impl Warp {
    /// The map through these values at equal steps, from 0 to 1 and strictly increasing.
    fn new(values: Vec<f64>) -> Self {
        let last = (values.len() - 1) as f64;
        let places = (0..values.len()).map(|i| i as f64 / last).collect();
        Self { values, places }
    }

    pub(crate) fn identity(count: usize) -> Self {
        Self::new((0..count).map(|i| i as f64 / (count - 1) as f64).collect())
    }

    pub(crate) fn at(&self, x: f64) -> f64 {
        interpolated(&self.places, &self.values, x)
    }

    pub(crate) fn inverse_at(&self, y: f64) -> f64 {
        interpolated(&self.values, &self.places, y)
    }

    /// Values at equal steps.
    pub(crate) fn values(&self) -> &[f64] {
        &self.values
    }

    /// With slopes smoothed by a Gaussian of this width.
    fn smoothed(&self, width: f64) -> Self {
        let cells = self.values.len() - 1;
        let slopes: Vec<f64> = self.values.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let reach = (3.0 * width * cells as f64).ceil() as isize;
        let smooth = |i: usize| {
            let (mut sum, mut weights) = (0.0, 0.0);
            for offset in -reach..=reach {
                let Ok(j) = usize::try_from(i as isize + offset) else { continue };
                if j < cells {
                    let x = offset as f64 / (width * cells as f64);
                    let weight = (-0.5 * x * x).exp();
                    sum += weight * slopes[j];
                    weights += weight;
                }
            }
            sum / weights
        };
        let slopes: Vec<f64> = (0..cells).map(smooth).collect();
        Self::of_slopes(&slopes)
    }

    /// The map with these slopes, up to a factor.
    fn of_slopes(slopes: &[f64]) -> Self {
        let mut values = vec![0.0];
        for slope in slopes {
            values.push(values[values.len() - 1] + slope);
        }
        let whole = values[values.len() - 1];
        values.iter_mut().for_each(|value| *value /= whole);
        Self::new(values)
    }
}

/// Maps whose mean is the identity: each after the inverse of their mean.
pub(crate) fn centred(warps: &[Warp]) -> Vec<Warp> {
    let count = warps[0].values.len();
    let mean = |k: usize| warps.iter().map(|w| w.values[k]).sum::<f64>() / warps.len() as f64;
    let mean = Warp::new((0..count).map(mean).collect());
    let after =
        |warp: &Warp| Warp::new(mean.places.iter().map(|b| warp.at(mean.inverse_at(*b))).collect());
    warps.iter().map(after).collect()
}

/// The map γ of a template's coordinate to a demonstration's with the least ∫ c(γ(b), b) + λ (γ′ − 1)² db,
/// by dynamic programming on `count` places of each, then smoothed.
///
/// * `cost`       of a place of the demonstration at a place of the template
/// * `stiffness`  λ
/// * `width`      of the Gaussian that smooths the slopes, as a fraction of the path
pub(crate) fn best(
    count: usize,
    cost: impl Fn(usize, usize) -> f64,
    stiffness: f64,
    width: f64,
) -> Warp {
    let last = count - 1;
    let cell = 1.0 / last as f64;
    let band = (BAND * last as f64) as usize;
    let mut totals = vec![f64::INFINITY; count * count];
    let mut steps = vec![usize::MAX; count * count];
    let costs: Vec<f64> = (0..count * count)
        .map(|i| {
            let (a, b) = (i / count, i % count);
            if a.abs_diff(b) <= band { cost(a, b) } else { f64::INFINITY }
        })
        .collect();
    totals[0] = 0.0;
    for a in 1..count {
        for b in a.saturating_sub(band).max(1)..=(a + band).min(last) {
            let here = a * count + b;
            for (k, [da, db]) in STEPS.iter().enumerate() {
                if *da > a || *db > b {
                    continue;
                }
                let before = (a - da) * count + b - db;
                let slope = *da as f64 / *db as f64;
                let bending = stiffness * (slope - 1.0) * (slope - 1.0);
                let between = 0.5 * (costs[here] + costs[before]) + bending;
                let total = totals[before] + between * *db as f64 * cell;
                if total < totals[here] {
                    totals[here] = total;
                    steps[here] = k;
                }
            }
        }
    }
    let mut slopes = vec![1.0; last];
    let (mut a, mut b) = (last, last);
    while let Some([da, db]) = STEPS.get(steps[a * count + b]) {
        slopes[b - db..b].fill(*da as f64 / *db as f64);
        (a, b) = (a - da, b - db);
    }
    Warp::of_slopes(&slopes).smoothed(width)
}

/// The value at x of what is linear between points with increasing abscissae.
pub(crate) fn interpolated(abscissae: &[f64], values: &[f64], x: f64) -> f64 {
    let last = abscissae.len() - 1;
    let end = abscissae.partition_point(|other| *other < x).clamp(1, last);
    let (a, b) = (abscissae[end - 1], abscissae[end]);
    let part = if b > a { ((x - a) / (b - a)).clamp(0.0, 1.0) } else { 1.0 };
    values[end - 1] + part * (values[end] - values[end - 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_warp_is_found_and_undone() {
        let count = 101;
        // A curve that tells where it is, walked along at another pace.
        let pace = |b: f64| b + 0.08 * (std::f64::consts::TAU * b).sin();
        let curve = |x: f64| [(3.0 * x).sin(), (2.0 * x).cos(), x];
        let at = |i: usize| i as f64 / 100.0;
        let cost = |a: usize, b: usize| {
            let (p, q) = (curve(at(a)), curve(pace(at(b))));
            (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>() / 1e-4
        };
        let warp = best(count, cost, 1.0, 0.03);
        for i in 0..count {
            assert!((warp.at(at(i)) - pace(at(i))).abs() < 0.02, "{i}");
            assert!((warp.inverse_at(warp.at(at(i))) - at(i)).abs() < 1e-12);
        }
        assert!(warp.values().windows(2).all(|pair| pair[1] > pair[0]));
        // Where nothing tells the places apart, nothing is warped.
        let warp = best(count, |_, _| 1.0, 1.0, 0.03);
        assert!((0..count).all(|i| (warp.at(at(i)) - at(i)).abs() < 1e-12));
    }

    #[test]
    fn centred_maps_have_the_identity_as_mean() {
        let map = |size: f64| {
            Warp::new(
                (0..51).map(|i| f64::from(i) / 50.0).map(|x| x + size * x * (1.0 - x)).collect(),
            )
        };
        let centred = centred(&[map(0.5), map(0.1), map(-0.2)]);
        for i in 0..51 {
            let mean = centred.iter().map(|w| w.values()[i]).sum::<f64>() / 3.0;
            assert!((mean - i as f64 / 50.0).abs() < 5e-3, "{i} {mean}");
        }
    }
}
