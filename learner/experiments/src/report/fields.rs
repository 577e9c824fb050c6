//! Figures of Gaussians and fields, drawn by [`plot`](tprmp_learner::plot).

use glam::DMat2;
use rayon::prelude::*;
use tprmp_drawing::{
    BLACK, Ellipsoid, Panel, Picture, Scale, Sign, Stroke, View, of_phase, principal_axes, quantile,
};
use tprmp_learner::canonical::PhaseProfile;
use tprmp_learner::plot::field::Grid;
use tprmp_learner::plot::scene::{Scene, Skill, position_part};
use tprmp_learner::plot::{frame_of, gallery, gaussians};
use tprmp_model::skill_model::SkillModel;

use crate::dataset::SkillSet;
use crate::experiment::{PolicyKind, Space};
use crate::report::content::Run;
use crate::report::paths::{flat_path, grid, panel, points};

/// Which pictures of a model make a figure, by their names.
const OF_PLANE: [(&str, &[&str]); 3] = [
    (
        "Figure 4.2: Gaussians, gradient, natural gradient",
        &["gaussians", "gradient", "natural-gradient"],
    ),
    ("Figure 4.3: potential, and the forces of the components", &["potential", "forces"]),
    (
        "Figure 4.4: potential and dissipation as the frames move",
        &[
            "potential",
            "dissipation",
            "start-moved-potential",
            "start-moved-dissipation",
            "goal-moved-potential",
            "goal-moved-dissipation",
        ],
    ),
];
const OF_SPACE: [(&str, &[&str]); 1] = [(
    "Figure 3.2: the mixture of the pick",
    &["demonstrations", "seen-from-frame-1", "seen-from-frame-2", "gaussians"],
)];
/// Numbers of Gaussians of figure 5.4.
const COUNTS: [usize; 3] = [5, 9, 15];
const PATH: Stroke = Stroke::dashed(BLACK, 1.2).rimmed();

/// All of these figures.
pub(crate) fn pictures(run: &Run) -> Vec<Picture> {
    let mut pictures = Vec::new();
    let first = |space| run.bench.skills.iter().find(move |set| set.space() == space);
    if let Some(set) = first(Space::Planar) {
        pictures.extend(of_model(run, set, &OF_PLANE));
        pictures.extend(shapes(run, set));
    }
    if let Some(set) = first(Space::Pick) {
        pictures.extend(of_model(run, set, &OF_SPACE));
    }
    for policy in PolicyKind::LEARNED {
        pictures.extend(fields(run, policy));
    }
    pictures
}

/// Figures made from the pictures of the default policy's model of a skill.
fn of_model(run: &Run, set: &SkillSet, figures: &[(&str, &[&str])]) -> Vec<Picture> {
    let components = run.bench.count(set, PolicyKind::Canonical);
    let Some(trained) = run.bench.models.get(PolicyKind::Canonical, components, &set.name) else {
        return Vec::new();
    };
    let Ok(gallery) = gallery(&trained.model, &set.demonstrations) else { return Vec::new() };
    let figure = |(title, names): &(&str, &[&str])| {
        let own: Vec<_> =
            names.iter().filter_map(|name| gallery.iter().find(|own| own.name == *name)).collect();
        let svg = own.iter().map(|picture| picture.svg.as_str()).collect();
        let captions = own.iter().map(|picture| picture.caption.as_str()).collect::<Vec<_>>();
        (!own.is_empty()).then(|| Picture {
            name: (*title).into(),
            svg,
            caption: format!(
                "{title}. Skill “{}”, default policy. {}",
                set.name,
                captions.join(" ")
            ),
        })
    };
    figures.iter().filter_map(figure).collect()
}

/// A model among the frames of its first demonstration.
fn with_scene<T>(model: &SkillModel, set: &SkillSet, draw: impl FnOnce(&Scene) -> T) -> Option<T> {
    let position = position_part(model);
    let skill = Skill::new(model, &position).ok()?;
    let demonstration = &set.demonstrations[0];
    let frames = model
        .frames
        .iter()
        .map(|frame| frame_of(model, demonstration, &frame.name))
        .collect::<Option<Vec<_>>>()?;
    let gaussians = gaussians(model);
    Some(draw(&Scene::new(&skill, frames, &[], &gaussians, &PhaseProfile::linear())))
}

fn background(panel: &mut Panel, scene: &Scene, dissipation: bool) {
    let mut sampler = scene.sampler();
    let field = Grid::new(panel, |p| {
        let sample = sampler(p.extend(0.0));
        if dissipation { sample.damping } else { sample.potential }
    });
    let scale = if dissipation {
        Scale::areas_of_ratios(field.values(), "")
    } else {
        Scale::areas_of_roots(field.values(), "")
    };
    field.draw(panel, &scale);
}

/// The covariance in the plane.
fn flat(g: &Ellipsoid) -> DMat2 {
    View::Along([0, 1]).covariance(g.covariance)
}

fn ellipses(panel: &mut Panel, scene: &Scene) {
    for g in &scene.gaussians {
        panel.ellipse(g.mean.truncate(), flat(g), 1.0, &of_phase(g.phase), 0.2);
    }
}

fn path(panel: &mut Panel, set: &SkillSet) {
    let poses = &set.demonstrations[0].poses;
    panel.line(flat_path(poses), &PATH);
    flat_path(poses).last().into_iter().for_each(|goal| panel.star(goal));
}

/// Figures A.1 and A.2: all skills, on their potential and their dissipation.
fn fields(run: &Run, policy: PolicyKind) -> Vec<Picture> {
    let planar: Vec<&SkillSet> =
        run.bench.skills.iter().filter(|set| set.space() == Space::Planar).collect();
    let name =
        if policy == PolicyKind::Canonical { "default policy" } else { "the thesis' policy" };
    let figure = |dissipation: bool| -> Option<Picture> {
        let drawn: Vec<(Panel, bool)> = planar
            .par_iter()
            .filter_map(|set| {
                let components = run.bench.count(set, policy);
                let model = &run.bench.models.get(policy, components, &set.name)?.model;
                with_scene(model, set, |scene| {
                    let mut panel = panel(&set.name, points(set));
                    background(&mut panel, scene, dissipation);
                    ellipses(&mut panel, scene);
                    path(&mut panel, set);
                    (panel, model.certificate.failures.is_empty())
                })
            })
            .collect();
        let (count, certified) = (drawn.len(), drawn.iter().filter(|d| d.1).count());
        if count == 0 {
            return None;
        }
        let what = if dissipation { "dissipation" } else { "potential" };
        let title =
            format!("Figure A.{}: {what} of all skills, {name}", if dissipation { 2 } else { 1 });
        let caption = format!(
            "{name}: the darker, the larger; each panel has its own scale. Gaussians at one standard \
             deviation, light at the end, and the first demonstration. {certified} of these {count} models hold their \
             certificate."
        );
        let panels = drawn.into_iter().map(|(panel, _)| panel).collect();
        let legend = vec![("demonstration".into(), Sign::Line(PATH)), ("goal".into(), Sign::Star)];
        Some(Picture { svg: grid(&title, legend, panels), name: title, caption })
    };
    [false, true].into_iter().filter_map(figure).collect()
}

/// Figure 5.4: how the Gaussians' shape goes with their number.
fn shapes(run: &Run, set: &SkillSet) -> Vec<Picture> {
    let (mut panels, mut ratios) = (Vec::new(), Vec::new());
    for count in COUNTS {
        let Some(trained) = run.bench.models.get(PolicyKind::Thesis, count, &set.name) else {
            continue;
        };
        let drawn = with_scene(&trained.model, set, |scene| {
            let mut panel = panel(&format!("K = {count}"), points(set));
            background(&mut panel, scene, false);
            ellipses(&mut panel, scene);
            path(&mut panel, set);
            let ratio = |g: &Ellipsoid| {
                let (axes, _) = principal_axes(flat(g));
                axes.x / axes.y.max(1e-9)
            };
            let all: Vec<f64> = scene.gaussians.iter().map(ratio).collect();
            (panel, quantile(&all, 0.5).unwrap_or(f64::NAN))
        });
        if let Some((panel, ratio)) = drawn {
            panels.push(panel);
            ratios.push(format!("{ratio:.1} for K = {count}"));
        }
    }
    if panels.is_empty() {
        return Vec::new();
    }
    let title = "Figure 5.4: shape of the Gaussians by their number, the thesis' policy";
    let caption = format!(
        "Skill “{}”. Median ratio of the long to the short axis: {}.",
        set.name,
        ratios.join(", ")
    );
    let legend = vec![("demonstration".into(), Sign::Line(PATH))];
    vec![Picture { name: title.into(), svg: grid(title, legend, panels), caption }]
}
