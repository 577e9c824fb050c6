//! Pictures: well-formed, complete, the same again; wrong demonstrations are refused by their names.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::common::{Folder, arcs, skill_text};
use tprmp_learner::mixture::components::{Candidate, Choice, Components};
use tprmp_learner::plot;
use tprmp_learner::train::train;
use tprmp_model::skill_model::{self, Manifold};
use xml::reader::{EventReader, XmlEvent};

const SIZE_MAX: usize = 1_500_000;

/// The skill file of a manifold.
fn skill_of(manifold: Manifold) -> String {
    let text = skill_text(if manifold == Manifold::R2 { "planar.ron" } else { "pick.ron" });
    text.replace("manifold: R3xS3", &format!("manifold: {manifold}"))
}

/// A model of made-up demonstrations, `demonstrated` beside it.
fn trained(manifold: Manifold, text: &str, folder: &Folder) -> PathBuf {
    folder.demonstrations("demonstrated", &arcs(manifold));
    let text = text
        .replace("random_starts: 20", "random_starts: 1")
        .replace("displaced_starts: 20", "displaced_starts: 1")
        .replace("descent_points_random: 300", "descent_points_random: 150");
    let skill = folder.write("skill.ron", &text);
    let trained = train(&skill, Components::Count(5), 1, &mut |_| ()).unwrap();
    let path = folder.path().join("made_up.ron");
    skill_model::write(&trained.model, &path).unwrap();
    path
}

/// How often each element is there, and each class as `.class`, when the text is well-formed XML.
#[track_caller]
fn elements(name: &str, text: &str) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    for event in EventReader::from_str(text) {
        let event = event.unwrap_or_else(|error| panic!("{name}: {error}"));
        if let XmlEvent::StartElement { name, attributes, .. } = event {
            *counts.entry(name.local_name).or_default() += 1;
            for class in attributes.iter().filter(|a| a.name.local_name == "class") {
                *counts.entry(format!(".{}", class.value)).or_default() += 1;
            }
        }
    }
    counts
}

fn texts(paths: &[PathBuf]) -> BTreeMap<String, String> {
    let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    paths.iter().map(|path| (name(path), std::fs::read_to_string(path).unwrap())).collect()
}

/// Draws a skill and looks at what any skill's pictures have in common.
fn drawn(name: &str, manifold: Manifold, skill: &str) -> BTreeMap<String, BTreeMap<String, usize>> {
    let folder = Folder::new(&format!("plot-{name}"));
    let model = trained(manifold, skill, &folder);
    let demonstrations = folder.path().join("demonstrated");
    let draw = |name: &str| {
        texts(&plot::plot(&model, &demonstrations, &folder.path().join(name)).unwrap())
    };
    let pictures = draw("pictures");
    assert!(pictures == draw("again"), "the same input gave other bytes");
    let page = &pictures["index.html"];
    assert!(page.starts_with("<!DOCTYPE html>"));
    for (name, text) in &pictures {
        for bad in ["NaN", "inf\"", "inf,", "inf "] {
            assert!(!text.contains(bad), "{name} has `{bad}`");
        }
        let id = name.strip_suffix(".svg");
        assert!(id.is_none_or(|id| page.contains(&format!("id=\"{id}\""))), "{name}");
        assert!(id.is_none() || text.len() < SIZE_MAX, "{name}: {}", text.len());
    }
    pictures.iter().map(|(name, text)| (name.clone(), elements(name, text))).collect()
}

const FIELDS: [&str; 6] = [
    "potential.svg",
    "dissipation.svg",
    "start-moved-potential.svg",
    "start-moved-dissipation.svg",
    "goal-moved-potential.svg",
    "goal-moved-dissipation.svg",
];

#[test]
fn pictures_of_a_planar_skill() {
    let pictures = drawn("plane", Manifold::R2, &skill_of(Manifold::R2));
    assert_eq!(pictures.len(), 15);
    // Three demonstrations and the common pace; two frames and their map.
    assert!(
        pictures["alignment.svg"]["polyline"] >= 4 && pictures["agreement.svg"]["polyline"] >= 3
    );
    // Three paths; the two axes of two frames of each.
    assert_eq!(pictures["demonstrations.svg"]["polyline"], 3 + 12);
    for name in ["gaussians.svg", "seen-from-frame-1.svg", "seen-from-frame-2.svg"] {
        assert_eq!(pictures[name]["ellipse"], 5, "{name}");
    }
    for name in FIELDS {
        let picture = &pictures[name];
        assert_eq!((picture["ellipse"], picture[".goal"]), (5, 2), "{name}");
        assert!(picture["path"] > 5, "{name} has no contours");
    }
    for name in ["natural-gradient.svg", "gradient.svg"] {
        assert!(pictures[name]["path"] > 100, "{name} has no arrows");
    }
    assert!(!pictures.contains_key("orientation.svg"));
}

#[test]
fn pictures_of_a_planar_product() {
    let pictures = drawn("product", Manifold::R2, &skill_text("planar_thesis.ron"));
    assert_eq!(pictures.len(), 16);
    // The sum at the point, two forces of the nearest components, and where they weigh most.
    let forces = &pictures["forces.svg"];
    assert_eq!((forces["ellipse"], forces[".goal"]), (5, 2));
    assert!(forces["path"] > 8, "{forces:?}");
}

#[test]
fn pictures_of_poses() {
    let pictures = drawn("poses", Manifold::R3S3, &skill_of(Manifold::R3S3));
    assert_eq!(pictures.len(), 16);
    // Four views; the isometric one has nine edges of its box.
    assert_eq!(pictures["demonstrations.svg"]["polyline"], 4 * (3 + 18) + 9);
    assert_eq!(pictures["gaussians.svg"]["ellipse"], 4 * 5);
    for name in FIELDS {
        assert_eq!((pictures[name]["ellipse"], pictures[name][".goal"]), (20, 5), "{name}");
    }
    // A band in each graph.
    assert_eq!(pictures["orientation.svg"]["polygon"], 3);
}

#[test]
fn pictures_of_positions_in_space() {
    let pictures = drawn("space", Manifold::R3, &skill_of(Manifold::R3));
    assert_eq!(pictures.len(), 15);
    assert!(!pictures.contains_key("orientation.svg"));
}

#[test]
fn pictures_of_products_of_gaussians() {
    let pictures = drawn("products", Manifold::R2, &skill_text("planar_thesis.ron"));
    assert_eq!(pictures.len(), 16);
    for name in FIELDS {
        assert_eq!((pictures[name]["ellipse"], pictures[name][".goal"]), (5, 2), "{name}");
    }
}

#[test]
fn pictures_of_a_skill_with_one_frame_and_one_beside_it() {
    let text = skill_of(Manifold::R2)
        .replace("start_frame: \"start\"", "start_frame: \"end\"")
        .replace("other_frames: []", "other_frames: [\"start\"]");
    let pictures = drawn("single", Manifold::R2, &text);
    // There is no start frame to move.
    assert_eq!(pictures.len(), 13);
    assert_eq!(pictures["demonstrations.svg"]["polyline"], 3 + 12);
    assert_eq!(pictures["potential.svg"][".goal"], 2);
}

#[test]
fn other_demonstrations_are_refused() {
    let folder = Folder::new("plot-refused");
    let model = trained(Manifold::R2, &skill_of(Manifold::R2), &folder);
    let refused = |demonstrations: &str, expected: &[&str]| {
        let out = folder.path().join("pictures");
        let error = plot::plot(&model, &folder.path().join(demonstrations), &out).unwrap_err();
        let message = error.to_string();
        for part in expected {
            assert!(message.contains(part), "`{message}` does not say `{part}`");
        }
        assert!(!out.exists());
    };
    refused("nowhere", &["made_up_01.json", "expected this file", "`made_up`"]);
    folder.demonstrations("others", &arcs(Manifold::R2)[..1]);
    refused("others", &["made_up_02.json", "expected this file"]);
    let path = folder.path().join("demonstrated/made_up_03.json");
    let changed = std::fs::read_to_string(&path).unwrap() + " ";
    std::fs::write(&path, changed).unwrap();
    refused("demonstrated", &["made_up_03.json", "SHA-256", "changed"]);
}

#[test]
fn the_choice_of_components_is_drawn() {
    let candidate = |components: usize, bic: f64, empty| Candidate {
        components,
        log_likelihood: 0.0,
        parameters: 1,
        bic,
        empty,
    };
    let candidates = vec![
        candidate(2, -50.0, false),
        candidate(3, -80.0, false),
        candidate(4, -90.0, true),
        candidate(5, f64::NAN, true),
    ];
    let svg = plot::choice(&Choice { components: 3, candidates });
    // Three candidates, and three signs of the legend.
    assert_eq!(elements("bic", &svg)["circle"], 3 + 3);
    assert!(svg.contains("K = 3") && !svg.contains("NaN"));
}
