//! What an arm can do with its tool, whatever its posture: by the ranks of the tool's Jacobian.

use core::fmt;

use nalgebra::{DMatrix, SMatrix, SVector};
use tprmp_model::skill_model::Manifold;
use tprmp_robot::{Chain, Kinematics, forward_kinematics, spread_posture};

/// So many postures are looked at: a direction that exists is lost in few of them.
const POSTURES: usize = 64;
/// A direction is none where the tool moves along it by less than this fraction of what it moves along the best one.
const FRACTION_MIN: f64 = 1e-3;
/// The directions, displacement before rotation.
const AXES: [&str; 3] = ["x", "y", "z"];

/// Which directions the tool of an arm of N joints can be moved in, displacement before rotation.
#[derive(Debug)]
pub struct Freedom<const N: usize> {
    /// Jacobians in some postures, rotations in lengths of the arm \[m\].
    jacobians: Vec<SMatrix<f64, 6, N>>,
}

impl<const N: usize> Freedom<N> {
    /// Of an arm whose joints are in this range \[rad or m\]. Allocates: at start-up only.
    #[must_use]
    pub fn of(chain: &Chain<N>, [lower, upper]: &[SVector<f64, N>; 2]) -> Self {
        let mut kinematics = Kinematics::new();
        let jacobian = |k: usize| {
            let q = spread_posture(lower, upper, k);
            forward_kinematics(chain, &q, &mut kinematics);
            kinematics.tool_jacobian
        };
        let mut jacobians: Vec<SMatrix<f64, 6, N>> = (1..=POSTURES).map(jacobian).collect();
        // How far the tool is moved by a rotation of the joints.
        let length = jacobians.iter().map(|j| j.fixed_rows::<3>(0).amax()).fold(0.0, f64::max);
        for jacobian in &mut jacobians {
            jacobian.fixed_rows_mut::<3>(3).scale_mut(length);
        }
        Self { jacobians }
    }

    /// In how many of these directions the tool can be moved at a time, in the best posture.
    #[must_use]
    pub fn rank(&self, directions: &[usize]) -> usize {
        let most = self.jacobians.iter().map(SMatrix::amax).fold(0.0, f64::max);
        let rank = |jacobian: &SMatrix<f64, 6, N>| {
            let rows = DMatrix::from_fn(directions.len(), N, |i, j| jacobian[(directions[i], j)]);
            rows.rank(FRACTION_MIN * most)
        };
        self.jacobians.iter().map(rank).max().unwrap_or(0)
    }

    /// Whether it can do skills on a manifold.
    #[must_use]
    pub fn can_do(&self, manifold: Manifold) -> bool {
        self.rank(manifold.moved()) == manifold.moved().len()
    }
}

impl<const N: usize> fmt::Display for Freedom<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let along = |first: usize| -> Vec<&str> {
            (0..3).filter(|i| self.rank(&[first + i]) > 0).map(|i| AXES[i]).collect()
        };
        let (moves, rotates) = (along(0).join(", "), along(3).join(", "));
        write!(f, "{N} joints")?;
        match (moves.is_empty(), rotates.is_empty()) {
            (true, true) => return write!(f, " do not move the tool"),
            (false, true) => write!(f, " move the tool along {moves} of the base")?,
            (true, false) => write!(f, " rotate the tool about {rotates} of the base")?,
            (false, false) => {
                write!(
                    f,
                    " move the tool along {moves} and rotate it about {rotates} of the base"
                )?;
            }
        }
        let count = along(0).len() + along(3).len();
        let rank = self.rank(&[0, 1, 2, 3, 4, 5]);
        if rank < count {
            write!(f, ", {rank} of these {count} at a time")?;
        }
        let skills = Manifold::ALL.into_iter().filter(|manifold| self.can_do(*manifold));
        let skills: Vec<_> = skills.map(|manifold| manifold.to_string()).collect();
        match skills.is_empty() {
            true => f.write_str(": no skills"),
            false => write!(f, ": skills on {}", skills.join(", ")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::limits::working_range;
    use tprmp_model::controller_config;

    fn of<const N: usize>(config: &str) -> String {
        let path = format!("{}/../config/controllers/{config}", env!("CARGO_MANIFEST_DIR"));
        let config = controller_config::read(path.as_ref()).unwrap();
        let chain = Chain::<N>::from_urdf(&config.robot.urdf, config.selection()).unwrap();
        Freedom::of(&chain, &working_range(&chain, &config.robot)).to_string()
    }

    #[test]
    fn shipped_arms_are_told_what_they_can_do() {
        assert_eq!(
            of::<6>("ur5_pick.ron"),
            "6 joints move the tool along x, y, z and rotate it about x, y, z of the base: skills on R2, R3, \
             R3xS1, S3, R3xS3"
        );
        assert_eq!(
            of::<2>("planar.ron"),
            "2 joints move the tool along x, y of the base: skills on R2"
        );
        assert_eq!(
            of::<4>("scara.ron"),
            "4 joints move the tool along x, y, z and rotate it about z of the base: skills on R2, R3, R3xS1"
        );
    }
}
