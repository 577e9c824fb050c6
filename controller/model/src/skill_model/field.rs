//! A model's parts in the form in which they are evaluated.

use glam::{DQuat, DVec3};
use nalgebra::{SMatrix, SVector};
use tprmp_rmpflow::policy::canonical::field::{self, Field};
use tprmp_rmpflow::policy::canonical::rounds::in_round;

use crate::skill_model::model::{Component, FieldModel, Pose};
use crate::skill_model::rounds::{RoundCopy, copies};

impl From<Pose> for tprmp_spatial::Pose {
    fn from(pose: Pose) -> Self {
        let [w, x, y, z] = pose.quaternion_wxyz;
        Self {
            position: DVec3::from_array(pose.position_m),
            orientation: DQuat::from_xyzw(x, y, z, w),
        }
    }
}

impl From<tprmp_spatial::Pose> for Pose {
    fn from(pose: tprmp_spatial::Pose) -> Self {
        let q = pose.orientation;
        Self { position_m: pose.position.to_array(), quaternion_wxyz: [q.w, q.x, q.y, q.z] }
    }
}

impl FieldModel {
    /// The field, ready to be evaluated: of a periodic skill, with the copies of its components in the rounds
    /// before and after.
    ///
    /// # Panics
    /// When N is not the field's dimension, the phase included, which the manifold tells.
    #[must_use]
    pub fn field<const N: usize>(&self) -> Field<N> {
        let mut components: Vec<_> =
            self.components.iter().map(Component::evaluated::<N>).collect();
        if let Some(fall) = self.fall_per_round {
            let one =
                |copy: &RoundCopy| in_round(&components[copy.component], copy.round, 1.0, fall);
            components = self.copies().iter().map(one).collect();
        }
        Field::new(&components, self.phase_width, self.damping_1_s)
            .expect("a valid model has between two and as many components as a field holds")
    }

    /// The copies of the components of a periodic skill that have a weight in a round.
    ///
    /// # Panics
    /// When a component has no mean.
    #[must_use]
    pub fn copies(&self) -> Vec<RoundCopy> {
        let phase = |component: &Component| *component.mean.last().expect("it has a phase");
        let phases: Vec<f64> = self.components.iter().map(phase).collect();
        copies(&phases, self.phase_width)
    }

    /// The form in which a field is stored.
    #[must_use]
    pub fn from_parts<const D: usize>(
        components: &[field::Component<D>],
        phase_width: f64,
        damping_1_s: f64,
    ) -> Self {
        Self {
            damping_1_s,
            phase_width,
            components: components.iter().map(Component::stored).collect(),
            fall_per_round: None,
        }
    }
}

impl Component {
    fn evaluated<const D: usize>(&self) -> field::Component<D> {
        field::Component {
            mean: vector(&self.mean),
            metric: matrix(&self.metric),
            potential: self.potential,
            gradient: vector(&self.gradient),
            hessian: matrix(&self.hessian),
        }
    }

    fn stored<const D: usize>(component: &field::Component<D>) -> Self {
        Self {
            mean: component.mean.as_slice().to_vec(),
            metric: rows(&component.metric),
            potential: component.potential,
            gradient: component.gradient.as_slice().to_vec(),
            hessian: rows(&component.hessian),
        }
    }
}

fn vector<const D: usize>(values: &[f64]) -> SVector<f64, D> {
    assert_eq!(values.len(), D, "dimension of the field");
    SVector::from_column_slice(values)
}

fn matrix<const D: usize>(rows: &[Vec<f64>]) -> SMatrix<f64, D, D> {
    assert_eq!(rows.len(), D, "dimension of the field");
    SMatrix::from_fn(|i, j| rows[i][j])
}

fn rows<const D: usize>(matrix: &SMatrix<f64, D, D>) -> Vec<Vec<f64>> {
    (0..D).map(|i| (0..D).map(|j| matrix[(i, j)]).collect()).collect()
}
