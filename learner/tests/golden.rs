//! Models of made-up demonstrations against those that were stored when the learner was last meant
//! to change. `TPRMP_RENEW_GOLDEN=1 cargo test -p tprmp-learner --test all golden` stores them anew.

use std::path::Path;

use crate::common::rounds::{all, periodic, wiping};
use crate::common::{Folder, arcs, skill_text};
use tprmp_learner::periodic::learn as learn_periodic;
use tprmp_learner::skill::Skill;
use tprmp_learner::train::learn;
use tprmp_model::skill_model::{Manifold, PolicyModel, to_text};

/// Numbers may differ by so much, relatively and for numbers near zero: another machine's
/// logarithms do, and what is computed from them.
const TOLERANCE: f64 = 1e-4;
const TOLERANCE_NEAR_ZERO: f64 = 1e-6;
/// Gaussians of the models: few, so that the files stay small.
const COMPONENTS: usize = 4;

/// A model's text in words and numbers. How many steps a solver took is nobody's promise, and the
/// checksum is that of the last digit.
fn tokens(text: &str) -> Vec<&str> {
    text.lines()
        .filter(|line| !["checksum:", "iterations:"].iter().any(|key| line.contains(key)))
        .flat_map(|line| line.split(|c: char| c.is_whitespace() || "[](),:".contains(c)))
        .filter(|token| !token.is_empty())
        .collect()
}

fn same(a: &str, b: &str) -> bool {
    match (a.parse::<f64>(), b.parse::<f64>()) {
        (Ok(a), Ok(b)) => {
            a == b || (a - b).abs() <= TOLERANCE_NEAR_ZERO + TOLERANCE * a.abs().max(b.abs())
        }
        _ => a == b,
    }
}

#[track_caller]
fn check(name: &str, template: &str, manifold: Manifold) {
    let folder = Folder::new(&format!("golden-{name}"));
    let skill = Skill::read(&folder.write("skill.ron", &skill_text(template))).unwrap();
    let skill = skill.with_components(COMPONENTS).unwrap();
    let trained = learn(&skill, &arcs(manifold), 1, &mut |_| {}).unwrap();
    let mut text = to_text(&trained.model);
    if matches!(trained.model.policy, PolicyModel::Thesis(_)) {
        // Its rollouts pass between attractors: they are not for comparing.
        text.truncate(text.find("\n    fit: (").expect("a model has its fit"));
    }
    compare(name, &text);
}

#[track_caller]
fn compare(name: &str, text: &str) {
    let stored = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/{name}.ron"));
    if std::env::var_os("TPRMP_RENEW_GOLDEN").is_some() {
        std::fs::write(&stored, text).unwrap();
    }
    let golden = std::fs::read_to_string(&stored).unwrap();
    let (found, expected) = (tokens(text), tokens(&golden));
    assert_eq!(found.len(), expected.len(), "{name}: another structure than the stored model's");
    for (i, (token, stored)) in found.iter().zip(&expected).enumerate() {
        let before = expected[i.saturating_sub(6)..i].join(" ");
        assert!(same(token, stored), "{name}, after `{before}`: {token}, stored {stored}");
    }
}

#[test]
fn a_canonical_model_in_the_plane_is_the_stored_one() {
    check("canonical_plane", "planar.ron", Manifold::R2);
}

#[test]
fn a_canonical_model_of_poses_is_the_stored_one() {
    check("canonical_poses", "pick.ron", Manifold::R3S3);
}

#[test]
fn a_thesis_model_in_the_plane_is_the_stored_one() {
    check("thesis_plane", "planar_thesis.ron", Manifold::R2);
}

#[test]
fn a_model_learned_as_published_is_the_stored_one() {
    check("published_plane", "planar_published.ron", Manifold::R2);
}

#[test]
fn a_thesis_model_of_poses_is_the_stored_one() {
    check("thesis_poses", "pick_thesis.ron", Manifold::R3S3);
}

#[test]
fn a_periodic_model_in_the_plane_is_the_stored_one() {
    let skill =
        periodic(crate::common::skill("planar.ron")).with_components(2 * COMPONENTS).unwrap();
    let demonstrations = all(Manifold::R2, wiping, &[2.2, 3.4]);
    let learned = learn_periodic(&skill, &demonstrations, 1).unwrap();
    compare("periodic_plane", &to_text(&learned.model));
}
