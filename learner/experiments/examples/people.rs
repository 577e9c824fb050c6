use clap::Parser;
use tprmp_experiments::people::hand::{Hand, Timing};
use tprmp_experiments::people::scene::Scene;
use tprmp_experiments::people::table::{median_and_max, rows};
use tprmp_learner::skill::{AlignmentMethod, Skill};
#[derive(Parser)]
struct A {
    #[command(flatten)]
    hand: Hand,
    #[arg(long, default_value_t = 8)]
    seeds: u64,
    #[arg(long)]
    methods: Option<String>,
    #[arg(long)]
    stiffness: Option<f64>,
    #[arg(long)]
    floor: Option<f64>,
    #[arg(long)]
    width: Option<f64>,
    #[arg(long)]
    components: Option<usize>,
    #[arg(long)]
    window: Option<f64>,
}
fn main() {
    let a = A::parse();
    let mut skill = Skill::read("config/skills/pick.ron".as_ref()).unwrap();
    skill.certification.random_starts = 20;
    skill.certification.displaced_starts = 20;
    if let Some(x) = a.stiffness {
        skill.alignment.stiffness = x
    }
    if let Some(x) = a.floor {
        skill.alignment.agreement_floor = x
    }
    if let Some(x) = a.components {
        skill.mixture.components = x
    }
    if let Some(x) = a.window {
        skill.smoothing.window_s = x
    }
    if let Some(x) = a.width {
        skill.alignment.width = x
    }
    let m = a.methods.unwrap_or("cabj".into());
    let methods: Vec<_> = m
        .chars()
        .map(|c| match c {
            'c' => AlignmentMethod::Clock,
            'a' => AlignmentMethod::ArcLength,
            'b' => AlignmentMethod::Barycentre,
            _ => AlignmentMethod::Joint,
        })
        .collect();
    let all = rows(&skill, &a.hand, &methods, a.seeds);
    for method in &methods {
        println!("{method:?}");
        for timing in Timing::ALL {
            let mut line = format!("  {timing:<42}");
            for scene in [Scene::Insertion, Scene::Gate] {
                let some: Vec<_> = all
                    .iter()
                    .filter(|r| r.scene == scene && r.timing == timing && r.method == *method)
                    .collect();
                let [med, max] = median_and_max(&some);
                let used = some.iter().filter(|r| r.frame_used).count();
                let cert = some.iter().filter(|r| r.certified).count();
                line += &format!(
                    " {:6.1} {:6.1} used {used} cert {cert} of {}",
                    med * 1e3,
                    max * 1e3,
                    some.len()
                );
            }
            println!("{line}");
        }
    }
}
