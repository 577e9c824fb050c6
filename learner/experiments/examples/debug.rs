use clap::Parser;
use glam as _;
use tprmp_experiments::people::hand::{Hand, Timing};
use tprmp_experiments::people::scene::Scene;
use tprmp_experiments::people::table::{count, skill as sk};
use tprmp_learner::certify::policy::{Body, LearnedPolicy};
use tprmp_learner::certify::rollout::{RolloutSpec, Target, follow};
use tprmp_learner::skill::{AlignmentMethod, Skill};
use tprmp_learner::train::learn;
use tprmp_spatial::MovingPose;
#[derive(Parser)]
struct A {
    #[command(flatten)]
    hand: Hand,
    #[arg(long, default_value_t = 3)]
    seeds: u64,
    #[arg(long)]
    window: Option<f64>,
    #[arg(long)]
    degree: Option<usize>,
    #[arg(long)]
    components: Option<usize>,
    #[arg(long)]
    method: Option<String>,
}
fn main() {
    let a = A::parse();
    let mut skill = Skill::read("config/skills/pick.ron".as_ref()).unwrap();
    skill.certification.random_starts = 1;
    skill.certification.displaced_starts = 1;
    if let Some(x) = a.components {
        skill.mixture.components = x
    }
    if let Some(x) = a.window {
        skill.smoothing.window_s = x
    }
    if let Some(x) = a.degree {
        skill.smoothing.degree = x
    }
    for scene in [Scene::Insertion, Scene::Gate] {
        for timing in [Timing::KeepingTime, Timing::PaceAndDuration] {
            let (mut all, mut raw): (Vec<f64>, Vec<f64>) = (vec![], vec![]);
            for seed in 1..=a.seeds {
                let method = match a.method.as_deref() {
                    Some("c") => AlignmentMethod::Clock,
                    Some("a") => AlignmentMethod::ArcLength,
                    _ => AlignmentMethod::Joint,
                };
                let skill = sk(&skill, scene, method);
                let demos = a.hand.demonstrate(scene, timing, count(scene), seed);
                let clean = Hand { tremor_mm: 0.0, tremor_deg: 0.0, ..a.hand }.demonstrate(
                    scene,
                    timing,
                    count(scene),
                    seed,
                );
                let t = learn(&skill, &demos, 1, &mut |_| {}).unwrap();
                let p = LearnedPolicy::new(&t.model).unwrap();
                for (d, noisy) in clean.iter().zip(&demos) {
                    let frames: Vec<_> =
                        skill.frames(d).iter().copied().map(MovingPose::at_rest).collect();
                    let spec = RolloutSpec {
                        manifold: d.manifold,
                        start: Body::at_rest(d.poses[0]),
                        step_s: 0.005,
                        steps: 2400,
                    };
                    let target = Target { goal: *d.poses.last().unwrap(), arrived: None };
                    let mut path = vec![];
                    follow(&mut p.instance(), &frames, &target, &spec, |x| path.push(*x));
                    let rms = |poses: &[tprmp_spatial::Pose]| {
                        let sq: f64 = poses
                            .iter()
                            .map(|x| {
                                path.iter()
                                    .map(|y| (y.position - x.position).length_squared())
                                    .fold(1e9, f64::min)
                            })
                            .sum();
                        1e3 * (sq / poses.len() as f64).sqrt()
                    };
                    all.push(rms(&d.poses));
                    raw.push(rms(&noisy.poses));
                }
            }
            all.sort_by(f64::total_cmp);
            raw.sort_by(f64::total_cmp);
            println!(
                "  {scene:?} {timing:<42} truth median {:.2} max {:.2}; recorded median {:.2} max {:.2}",
                all[all.len() / 2],
                all[all.len() - 1],
                raw[raw.len() / 2],
                raw[raw.len() - 1]
            );
        }
    }
}
