//! What each component of a planar product of Gaussians contributes to the force at a point  [thesis fig. 4.3b].
//!
//! −∇Φ = Σ_k (−w_k ∇φ_k) + Σ_k (−φ_k ∇w_k): attraction to the means of the nearest Gaussians, and the
//! nominal force along the order of the Gaussians  [thesis eq. 4.12–4.14].

use glam::DVec2;
use nalgebra::Vector2;
use tprmp_rmpflow::policy::SkillPolicy;
use tprmp_rmpflow::policy::thesis::{GaussianField, ThesisState};
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
pub(super) struct Forces(Box<GaussianField<2>>);

impl Forces {
    /// The components with these frames. `None` when the policy is not a product in the plane, whose
    /// components differ by place and not by phase, or there is no product of the Gaussians.
    pub(super) fn new(policy: &SkillPolicy, frames: &[Pose]) -> Option<Self> {
        let SkillPolicy::Plane(policy) = policy else { return None };
        let frames: Vec<_> = frames.iter().copied().map(MovingPose::at_rest).collect();
        let mut state = ThesisState::default();
        policy.update(&frames, &mut state);
        Some(Self(Box::new(state.field()?.clone())))
    }

    /// w_k of each component.
    pub(super) fn weights(&self, point: DVec2) -> Vec<f64> {
        let terms = self.0.terms(&Vector2::new(point.x, point.y));
        terms[..self.0.components().len()].iter().map(|term| term.weight).collect()
    }

    /// What all components contribute to the force at a point.
    pub(super) fn contributions(&self, point: DVec2) -> Vec<Contribution> {
        let plain = |v: Vector2<f64>| DVec2::new(v.x, v.y);
        let terms = self.0.terms(&Vector2::new(point.x, point.y));
        let components = self.0.components().zip(terms);
        components
            .map(|((mean, _), term)| Contribution {
                mean: plain(mean),
                attraction: plain(-term.attraction),
                nominal: plain(term.weight_gradient * -term.potential),
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix2;
    use tprmp_rmpflow::policy::thesis::{PoseGaussian, ThesisComponent, ThesisPolicy};

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
            let position = DVec2::new(0.2 * s, 0.1 * (s - 1.0).powi(2)).extend(0.0);
            let gaussian = PoseGaussian {
                mean: Pose { position, ..Pose::IDENTITY },
                precision: Matrix2::new(60.0 + s, 5.0 * s, 5.0 * s, 40.0),
            };
            ThesisComponent { gaussians: Box::new([gaussian]), potential: 3.0 - s, damping: 1.0 }
        };
        let policy = ThesisPolicy::new((0..4).map(component).collect(), 0.25, 1.3).unwrap();
        let forces = Forces::new(&SkillPolicy::Plane(policy), &[Pose::IDENTITY]).unwrap();
        for point in points() {
            let y = Vector2::new(point.x, point.y);
            let gradient = forces.0.evaluate(&y, &Vector2::zeros()).gradient;
            adds_up(&forces, point, -DVec2::new(gradient.x, gradient.y));
        }
    }
}
