//! Demonstrations that can be read but not meant: learning from them ends in a model that can be
//! read again or in an error, never in a panic.

use crate::common::{Folder, arcs, skill_text};
use glam::DVec3;
use proptest::prelude::*;
use tprmp_learner::demonstration::Demonstration;
use tprmp_learner::mixture::components::Components;
use tprmp_learner::train::train;
use tprmp_model::skill_model::{self, Manifold};

/// How a demonstration is spoiled.
#[derive(Clone, Debug)]
enum Damage {
    /// One coordinate of one sample.
    Sample(prop::sample::Index, usize, f64),
    /// All samples from one on.
    Rest(prop::sample::Index, f64),
    /// Every position.
    Scale(f64),
    SamplingTime(f64),
    StartFrame(usize, f64),
    GoalFrame(usize, f64),
    /// The frames lie at the same place.
    SameFrames,
    /// It rests from a sample on.
    Stops(prop::sample::Index),
    Backwards,
    /// Only so many samples are left.
    Short(usize),
}

/// Numbers of all sizes.
fn number() -> impl Strategy<Value = f64> {
    (any::<bool>(), -9..10_i32).prop_map(|(minus, exponent)| {
        let size = 10.0_f64.powi(exponent);
        if minus { -size } else { size }
    })
}

fn damage() -> impl Strategy<Value = Damage> {
    let sample = any::<prop::sample::Index>;
    prop_oneof![
        (sample(), 0..2_usize, number()).prop_map(|(i, axis, x)| Damage::Sample(i, axis, x)),
        (sample(), number()).prop_map(|(i, x)| Damage::Rest(i, x)),
        number().prop_map(Damage::Scale),
        number().prop_map(|x| Damage::SamplingTime(x.abs())),
        (0..2_usize, number()).prop_map(|(axis, x)| Damage::StartFrame(axis, x)),
        (0..2_usize, number()).prop_map(|(axis, x)| Damage::GoalFrame(axis, x)),
        Just(Damage::SameFrames),
        sample().prop_map(Damage::Stops),
        Just(Damage::Backwards),
        (10..20_usize).prop_map(Damage::Short),
    ]
}

fn spoil(demonstrated: &mut Demonstration, damage: &Damage) {
    let count = demonstrated.poses.len();
    match damage {
        Damage::Sample(i, axis, x) => demonstrated.poses[i.index(count)].position[*axis] = *x,
        Damage::Rest(i, x) => {
            demonstrated.poses[i.index(count)..].iter_mut().for_each(|pose| pose.position.x += x);
        }
        Damage::Scale(factor) => {
            demonstrated.poses.iter_mut().for_each(|pose| pose.position *= *factor);
        }
        Damage::SamplingTime(time_s) => demonstrated.sampling_time_s = *time_s,
        Damage::StartFrame(axis, x) => demonstrated.start.position[*axis] = *x,
        Damage::GoalFrame(axis, x) => demonstrated.goal_frame.position[*axis] = *x,
        Damage::SameFrames => demonstrated.goal_frame = demonstrated.start,
        Damage::Stops(i) => {
            let last = demonstrated.poses[i.index(count)];
            demonstrated.poses[i.index(count)..].fill(last);
        }
        Damage::Backwards => demonstrated.poses.reverse(),
        Damage::Short(left) => demonstrated.poses.truncate(*left),
    }
}

/// A skill file with which learning takes little time.
fn small_skill(template: &str) -> String {
    let mut text = skill_text(template);
    for (key, value) in [
        ("components:", "3"),
        ("iterations:", "3"),
        ("descent_points_random:", "60"),
        ("refinement_rounds_max:", "1"),
        ("horizon_s:", "0.5"),
        ("random_starts:", "2"),
        ("displaced_starts:", "2"),
    ] {
        let Some(place) = text.find(&format!(" {key}")) else { continue };
        let end = place + text[place..].find(',').unwrap();
        text.replace_range(place..end, &format!(" {key} {value}"));
    }
    text
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..Default::default() })]

    #[test]
    fn spoiled_demonstrations_never_panic(
        template in prop::sample::select(vec![
            ("planar.ron", Manifold::R2), ("planar_thesis.ron", Manifold::R2),
            ("pick.ron", Manifold::R3S3), ("pick_thesis.ron", Manifold::R3S3),
        ]),
        damages in prop::collection::vec((0..3_usize, damage()), 1..3),
        moved in any::<bool>(),
    ) {
        let (template, manifold) = template;
        let folder = Folder::new("extremes");
        let mut demonstrated = arcs(manifold);
        for demonstration in &mut demonstrated {
            demonstration.poses = demonstration.poses.iter().copied().step_by(4).collect();
            demonstration.sampling_time_s *= 4.0;
            if moved {
                demonstration.start.position -= DVec3::new(0.02, 0.01, 0.0);
            }
        }
        for (which, damage) in &damages {
            spoil(&mut demonstrated[*which], damage);
        }
        folder.demonstrations("demonstrated", &demonstrated);
        let file = folder.write("skill.ron", &small_skill(template));
        match train(&file, Components::SkillFile, 1, &mut |_| {}) {
            Ok(trained) => {
                let path = folder.path().join("model.ron");
                skill_model::write(&trained.model, &path).unwrap();
                prop_assert_eq!(skill_model::read(&path).unwrap(), trained.model);
            }
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }

    #[test]
    fn settings_of_all_sizes_never_panic(
        template in prop::sample::select(vec![
            ("planar.ron", Manifold::R2), ("planar_thesis.ron", Manifold::R2),
            ("pick.ron", Manifold::R3S3),
        ]),
        changes in prop::collection::vec((any::<prop::sample::Index>(), number()), 1..3),
    ) {
        let (template, manifold) = template;
        let folder = Folder::new("settings");
        let mut demonstrated = arcs(manifold);
        for demonstration in &mut demonstrated {
            demonstration.poses = demonstration.poses.iter().copied().step_by(4).collect();
            demonstration.sampling_time_s *= 4.0;
        }
        folder.demonstrations("demonstrated", &demonstrated);
        let mut text = small_skill(template);
        for (which, number) in &changes {
            // Values with a point are numbers that are no counts.
            let places: Vec<_> = text.match_indices(": ").map(|(at, _)| at + 2).filter(|at| {
                let value = text[*at..].split([',', ')']).next().unwrap_or("");
                value.parse::<f64>().is_ok() && value.contains(['.', 'e'])
            }).collect();
            let at = places[which.index(places.len())];
            let end = at + text[at..].find([',', ')']).unwrap();
            text.replace_range(at..end, &format!("{:e}", number.abs()));
        }
        let file = folder.write("skill.ron", &text);
        match train(&file, Components::SkillFile, 1, &mut |_| {}) {
            Ok(trained) => {
                let path = folder.path().join("model.ron");
                if let Err(error) = skill_model::write(&trained.model, &path) {
                    prop_assert!(error.to_string().contains("key `"), "{}", error);
                }
            }
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }
}
