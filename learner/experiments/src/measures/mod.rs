//! The field's measures of how like a demonstration a rollout is.
//!
//! Root mean square and velocity error compare what is done at the same times, and so see what comes late.
//! The other three compare the paths alone, each sampled anew at [`SAMPLES`] points of equal distance: dynamic
//! time warping, the discrete Fréchet distance, and the swept area. The benchmark of Lemme et al. (2015,
//! “Open-source benchmarking for learned reaching motion generation in robotics”) uses the same kinds.

mod rmse;
mod swept_area;
mod tube;
mod velocity;
mod warping;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::path::by_length;

pub use rmse::mean_square;
pub use swept_area::swept_area;
pub use tube::distance_to_path;
pub use velocity::velocity_rmse;
pub use warping::{dtw, frechet};

/// Points of each path whose shape alone is compared: neighbours are a thousandth of the path apart.
pub const SAMPLES: usize = 1001;

/// How like a demonstration a rollout is; all are zero where they are the same.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measures {
    /// Root mean square of the distance at the same times \[m\].
    pub rmse_m: f64,
    /// Dynamic time warping distance of the paths over the number of their samples \[m\].
    pub dtw_m: f64,
    /// Discrete Fréchet distance of the paths \[m\].
    pub frechet_m: f64,
    /// Swept error area between the paths \[m²\]; in the plane only.
    pub swept_area_m2: Option<f64>,
    /// Root mean square of the difference in velocity at the same times [m/s].
    pub velocity_rmse_m_s: f64,
}

impl Measures {
    /// Compares a rollout with a demonstration, both sampled every `step_s`.
    ///
    /// * `planar`  whether both lie in the plane of x and y
    ///
    /// # Panics
    /// When one of them is empty.
    #[must_use]
    pub fn of(rollout: &[DVec3], demonstration: &[DVec3], step_s: f64, planar: bool) -> Self {
        let [a, b] = [rollout, demonstration].map(|points| by_length(points, SAMPLES));
        Self {
            rmse_m: mean_square(rollout, demonstration).sqrt(),
            dtw_m: dtw(&a, &b) / SAMPLES as f64,
            frechet_m: frechet(&a, &b),
            swept_area_m2: planar.then(|| swept_area(&a, &b)),
            velocity_rmse_m_s: velocity_rmse(rollout, demonstration, step_s),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit of length along x in so many steps, aside by `y`.
    fn line(steps: usize, y: f64) -> Vec<DVec3> {
        (0..=steps).map(|i| DVec3::new(i as f64 / steps as f64, y, 0.0)).collect()
    }

    #[test]
    fn nothing_differs_from_itself() {
        let measures = Measures::of(&line(50, 0.0), &line(50, 0.0), 0.02, true);
        let Measures { rmse_m, dtw_m, frechet_m, swept_area_m2, velocity_rmse_m_s } = measures;
        assert_eq!([rmse_m, dtw_m, frechet_m, velocity_rmse_m_s], [0.0; 4]);
        assert_eq!(swept_area_m2, Some(0.0));
    }

    #[test]
    fn a_path_aside_differs_by_its_distance_at_any_speed() {
        // Twice as fast, and then at rest: the shape is the same, the times are not.
        for steps in [50, 25] {
            let measures = Measures::of(&line(steps, 0.1), &line(50, 0.0), 0.02, true);
            assert!((measures.dtw_m - 0.1).abs() < 1e-12, "{measures:?}");
            assert!((measures.frechet_m - 0.1).abs() < 1e-12, "{measures:?}");
            assert!((measures.swept_area_m2.unwrap() - 0.1).abs() < 1e-12, "{measures:?}");
            assert_eq!(measures.rmse_m < 0.1 + 1e-12, steps == 50, "{measures:?}");
            assert_eq!(measures.velocity_rmse_m_s < 1e-12, steps == 50, "{measures:?}");
        }
        assert_eq!(Measures::of(&line(9, 0.1), &line(9, 0.0), 0.02, false).swept_area_m2, None);
    }

    #[test]
    fn lengths_scale_and_areas_with_their_square() {
        let (a, b) = (line(40, 0.2), line(60, 0.0));
        let small = |points: &[DVec3]| points.iter().map(|p| *p * 0.02).collect::<Vec<_>>();
        let [large, small] =
            [Measures::of(&a, &b, 0.01, true), Measures::of(&small(&a), &small(&b), 0.01, true)];
        for (large, small, scale) in [
            (large.rmse_m, small.rmse_m, 0.02),
            (large.dtw_m, small.dtw_m, 0.02),
            (large.frechet_m, small.frechet_m, 0.02),
            (large.velocity_rmse_m_s, small.velocity_rmse_m_s, 0.02),
            (large.swept_area_m2.unwrap(), small.swept_area_m2.unwrap(), 0.02 * 0.02),
        ] {
            assert!(large > 0.0 && (small / large / scale - 1.0).abs() < 1e-9, "{large} {small}");
        }
    }
}
