//! The field's measures against PyPI's `similaritymeasures`: `measures_oracle.py` makes
//! `measures_oracle.json` of curves and values.

use glam::DVec3;
use serde::Deserialize;
use tprmp_experiments::measures::{dtw, frechet, mean_square, swept_area, velocity_rmse};

/// Rust and Python may differ by this, relative to the value, and absolutely.
const TOLERANCE: f64 = 1e-9;

#[derive(Deserialize)]
struct Oracle {
    step_s: f64,
    pairs: Vec<Pair>,
}

#[derive(Deserialize)]
struct Pair {
    a: Vec<Vec<f64>>,
    b: Vec<Vec<f64>>,
    dtw: f64,
    frechet: f64,
    mean_square: Option<f64>,
    velocity_rmse: Option<f64>,
    swept_area: Option<f64>,
}

fn points(curve: &[Vec<f64>]) -> Vec<DVec3> {
    curve.iter().map(|p| DVec3::new(p[0], p[1], p.get(2).copied().unwrap_or(0.0))).collect()
}

#[test]
fn measures_agree_with_similaritymeasures() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/measures_oracle.json");
    let oracle: Oracle = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let mut compared = [0; 5];
    for (number, pair) in oracle.pairs.iter().enumerate() {
        let (a, b) = (points(&pair.a), points(&pair.b));
        let same = a.len() == b.len();
        assert_eq!(pair.mean_square.is_some(), same);
        let found = [
            (Some(pair.dtw), dtw(&a, &b)),
            (Some(pair.frechet), frechet(&a, &b)),
            (pair.mean_square, mean_square(&a, &b)),
            (pair.velocity_rmse, velocity_rmse(&a, &b, oracle.step_s)),
            (pair.swept_area, if same { swept_area(&a, &b) } else { f64::NAN }),
        ];
        for (i, (expected, found)) in found.into_iter().enumerate() {
            let Some(expected) = expected else { continue };
            compared[i] += 1;
            assert!(
                (found - expected).abs() <= TOLERANCE * expected.abs().min(1.0),
                "pair {number}, measure {i}: found {found}, expected {expected}"
            );
        }
    }
    assert!(compared.iter().all(|count| *count >= 8), "{compared:?}");
}
