//! What each component of a planar product of Gaussians contributes to the force at a point  [thesis fig. 4.3b].
//!
//! −∇Φ = Σ_k (−w_k ∇φ_k) + Σ_k (−φ_k ∇w_k): attraction to the means of the nearest Gaussians, and the
//! nominal force along the order of the Gaussians  [thesis eq. 4.12–4.14].

use glam::DVec2;
use nalgebra::Vector2;
use tprmp_model::skill_model::{PolicyModel, SkillModel};
use tprmp_rmpflow::policy::SkillPolicy;
use tprmp_rmpflow::policy::thesis::gaussian_field::{GaussianComponent, GaussianField};
use tprmp_rmpflow::policy::thesis::product_skill::ProductState;
use tprmp_spatial::{MovingPose, Pose};

/// What a component contributes to the force at a point. Forces are in proportion to each other.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contribution {
    /// μ [m].
    pub(super) mean: DVec2,
    /// −w ∇φ.
    pub(super) attraction: DVec2,
    /// −φ ∇w.
    pub(super) nominal: DVec2,
}

/// The components of a planar product of Gaussians in the robot's base frame: the products of what the
/// frames see.
pub(super) struct Forces {
    field: Box<GaussianField<2>>,
    /// δ.
    huber_threshold: f64,
}

/// A component at a point.
struct Term {
    mean: Vector2<f64>,
    /// In proportion to its weight.
    activation: f64,
    /// Λ v.
    pull: Vector2<f64>,
    /// φ.
    potential: f64,
    /// ∇φ.
    slope: Vector2<f64>,
}

impl Forces {
    /// The components with these frames. `None` when the policy is not a product in the plane, whose
    /// components differ by place and not by phase, or there is no product of the Gaussians.
    pub(super) fn new(model: &SkillModel, policy: &SkillPolicy, frames: &[Pose]) -> Option<Self> {
        let (PolicyModel::Thesis(thesis), SkillPolicy::Plane(product)) = (&model.policy, policy)
        else {
            return None;
        };
        let frames: Vec<_> = frames.iter().copied().map(MovingPose::at_rest).collect();
        let mut state = ProductState::new();
        product.update(&frames, &mut state);
        let field = Box::new(state.field()?.clone());
        Some(Self { field, huber_threshold: thesis.huber_threshold })
    }

    /// w_k of each component.
    pub(super) fn weights(&self, point: DVec2) -> Vec<f64> {
        let y = Vector2::new(point.x, point.y);
        self.field.weights(&y)[..self.field.components().len()].to_vec()
    }

    /// What all components contribute to the force at a point.
    pub(super) fn contributions(&self, point: DVec2) -> Vec<Contribution> {
        let terms = self.terms(&Vector2::new(point.x, point.y));
        let sum: f64 = terms.iter().map(|t| t.activation).sum();
        let mean_pull: Vector2<f64> = terms.iter().map(|t| t.pull * (t.activation / sum)).sum();
        let plain = |v: Vector2<f64>| DVec2::new(v.x, v.y);
        let contribution = |t: &Term| {
            let weight = t.activation / sum;
            Contribution {
                mean: plain(t.mean),
                attraction: plain(t.slope * -weight),
                // ∇w = w (p̄ − Λ v)
                nominal: plain((mean_pull - t.pull) * (-t.potential * weight)),
            }
        };
        terms.iter().map(contribution).collect()
    }

    fn terms(&self, y: &Vector2<f64>) -> Vec<Term> {
        let field = &self.field;
        let term = |(component, activation): (GaussianComponent<2>, f64)| {
            // The potential of a component is that of a field which has no other.
            let alone = GaussianField::new(
                std::slice::from_ref(&component),
                field.metric_scale(),
                self.huber_threshold,
            );
            let alone = alone.expect("a component of a field").evaluate(y, &Vector2::zeros());
            Term {
                mean: component.mean,
                activation,
                pull: component.precision * (y - component.mean),
                potential: alone.potential,
                slope: alone.gradient,
            }
        };
        field.components().zip(field.weights(y)).map(term).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix2;

    /// The contributions at a point add up to the force, the weights to one.
    #[track_caller]
    fn adds_up(forces: &Forces, point: DVec2, force: DVec2) {
        let contributions = forces.contributions(point);
        let sum: DVec2 = contributions.iter().map(|c| c.attraction + c.nominal).sum();
        assert!((sum - force).length() < 1e-9 * (1.0 + force.length()), "{sum} {force}");
        let weights = forces.weights(point);
        assert_eq!(weights.len(), contributions.len());
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }

    fn points() -> impl Iterator<Item = DVec2> {
        (0..20).map(|i| DVec2::new(0.035 * f64::from(i), 0.2 * (0.4 * f64::from(i)).sin()))
    }

    #[test]
    fn contributions_add_up_to_the_force_of_products() {
        let component = |i: usize| {
            let s = i as f64;
            GaussianComponent {
                mean: Vector2::new(0.2 * s, 0.1 * (s - 1.0).powi(2)),
                precision: Matrix2::new(60.0 + s, 5.0 * s, 5.0 * s, 40.0),
                potential: 3.0 - s,
                damping: 1.0,
            }
        };
        let threshold = 1.3;
        let components: Vec<_> = (0..4).map(component).collect();
        let field = GaussianField::new(&components, 0.25, threshold).unwrap();
        let forces = Forces { field: Box::new(field.clone()), huber_threshold: threshold };
        for point in points() {
            let y = Vector2::new(point.x, point.y);
            let gradient = field.evaluate(&y, &Vector2::zeros()).gradient;
            adds_up(&forces, point, -DVec2::new(gradient.x, gradient.y));
        }
    }
}
