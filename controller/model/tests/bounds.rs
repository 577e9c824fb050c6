//! Files that are made to hurt: each is refused with its name, before it takes memory or time, and a
//! certificate that is not the model's is found, whatever the checksum says.

use std::path::{Path, PathBuf};

use tprmp_model::controller_config;
use tprmp_model::skill_model::{self, PolicyModel, SkillModel, read, to_text, verify};

fn file(name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, content).unwrap();
    path
}

/// A learned model of the plane, or of poses.
fn learned(name: &str) -> SkillModel {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../learner/tests/golden");
    read(&golden.join(name)).unwrap()
}

/// What reading the changed model, with a right checksum, and looking at it again says.
fn refused(name: &str, model: &SkillModel) -> String {
    let path = file(name, to_text(model));
    let message = read(&path)
        .and_then(|model| verify(&model, &model.policy().unwrap(), &path))
        .unwrap_err()
        .to_string();
    assert!(message.contains(name), "file not named: {message}");
    message
}

#[test]
fn certificates_of_learned_models_are_theirs() {
    for name in ["canonical_plane.ron", "canonical_poses.ron"] {
        let mut model = learned(name);
        verify(&model, &model.policy().unwrap(), Path::new(name)).unwrap();
        model.certificate.failures = vec!["nothing is claimed".into()];
        verify(&model, &model.policy().unwrap(), Path::new(name)).unwrap();
    }
}

#[test]
fn a_certificate_of_another_model_is_found() {
    type Change = fn(&mut SkillModel);
    let changes: [(&str, Change); 9] = [
        ("valley.descent_min", |m| {
            m.certificate.blocks[0].valley.as_mut().unwrap().descent_min *= 1.1;
        }),
        ("goal_hessian_min_1_s2", |m| m.certificate.blocks[0].goal_hessian_min_1_s2 = 1.0),
        ("metric_eigenvalue_max", |m| {
            m.certificate.blocks[0].metric_eigenvalue_max = f64::INFINITY;
        }),
        ("valley", |m| m.certificate.blocks[0].valley = None),
        ("certificate.blocks", |m| m.certificate.blocks.clear()),
        ("energy_rise_max", |m| m.certificate.displaced_frames.energy_rise_max = f64::INFINITY),
        ("reached", |m| m.certificate.demonstrated_frames.reached -= 1),
        ("step_s", |m| m.certificate.step_s = f64::NAN),
        ("certificate.blocks[0].", |m| {
            let PolicyModel::Canonical { position, .. } = &mut m.policy else { unreachable!() };
            for row in &mut position.components[1].hessian {
                row.iter_mut().for_each(|x| *x *= -1.0);
            }
        }),
    ];
    for (i, (key, change)) in changes.into_iter().enumerate() {
        let mut model = learned("canonical_plane.ron");
        change(&mut model);
        let message = refused(&format!("claim_{i}.ron"), &model);
        assert!(message.contains("key `certificate.") && message.contains(key), "{message}");
    }
}

#[test]
fn numbers_beyond_any_model() {
    let mut model = learned("canonical_plane.ron");
    let PolicyModel::Canonical { position, .. } = &mut model.policy else { unreachable!() };
    position.components[0].metric[0][0] = 1e30;
    let message = refused("metric.ron", &model);
    assert!(message.contains("policy.position.components[0].metric"), "{message}");
    assert!(message.contains("expected numbers within 1e15, found 1e30"), "{message}");
}

#[test]
fn devices_and_large_files_are_no_models_or_configurations() {
    let zeros = vec![b' '; 3 << 20];
    let large = file("large.ron", &zeros);
    for (path, expected) in [
        (Path::new("/dev/zero"), "expected a file, found a device"),
        (Path::new("/"), "expected a file, found a folder"),
        (large.as_path(), "bytes, found 3145728"),
    ] {
        for message in [
            skill_model::read(path).unwrap_err().to_string(),
            controller_config::read(path).unwrap_err().to_string(),
        ] {
            assert!(message.contains(&path.display().to_string()), "{message}");
            assert!(message.contains(expected), "{message}");
        }
    }
    let based = file("based.ron", "(base: \"/dev/zero\")");
    let message = controller_config::read(&based).unwrap_err().to_string();
    assert!(message.contains("key `base`") && message.contains("a device"), "{message}");
}

#[test]
fn text_that_is_nested_repeated_or_not_utf_8() {
    let long_key = format!("({}: ({}))", "a".repeat(100_000), "b: 1, ".repeat(20_000));
    for (i, text) in [
        "(a:".repeat(50_000).into_bytes(),
        "[".repeat(200_000).into_bytes(),
        "(schema: Some(".repeat(10_000).into_bytes(),
        format!("({})", "onset_s: 1, ".repeat(20_000)).into_bytes(),
        format!("({})", "a: 1, ".repeat(40_000)).into_bytes(),
        long_key.into_bytes(),
        format!("(base: \"ur5.ron\", {})", "cycle: (), ".repeat(1500)).into_bytes(),
        "/*".repeat(100_000).into_bytes(),
        b"(schema: \"\xff\")".to_vec(),
    ]
    .into_iter()
    .enumerate()
    {
        let path = file(&format!("hurt_{i}.ron"), text);
        for message in [
            read(&path).unwrap_err().to_string(),
            controller_config::read(&path).unwrap_err().to_string(),
        ] {
            assert!(message.contains(&format!("hurt_{i}.ron")), "{message}");
            assert!(message.lines().count() <= 50, "{i}: {} lines", message.lines().count());
        }
    }
}
