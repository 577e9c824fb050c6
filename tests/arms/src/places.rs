//! Four places for the object, where the arm can go.

use core::f64::consts::TAU;

use glam::{DQuat, DVec3};
use nalgebra::{DMatrix, DVector, SVector};
use tprmp_model::skill_model::SkillModel;
use tprmp_robot::{
    Chain, ControlPoint, ControlPoints, Kinematics, SelfPairs, forward_kinematics, point_position,
};
use tprmp_spatial::Pose;

/// Directions from the first joint, beside that of the tool at home \[rad\].
const DIRECTIONS: [f64; 4] = [-0.9, -0.45, 0.45, 0.9];
/// Distances that are tried, as factors of the tool's at home, and heights beside its, as factors of the same.
const DISTANCES: [f64; 6] = [1.0, 0.85, 1.15, 0.7, 1.3, 0.55];
const HEIGHTS: [f64; 6] = [-0.2, -0.35, 0.0, -0.5, 0.2, 0.4];
/// Rotations of the object about the vertical that are tried, beside the one that keeps the tool as it is at home.
const YAWS: [f64; 5] = [0.35, -0.35, 0.0, 1.57, -1.57];
/// The joints are so far from their limits, as factors of the distance at which these act; more is tried first.
const CLEAR_OF_LIMITS: [f64; 3] = [1.0, 0.5, 0.1];
/// The tool comes from this far above \[m\].
const ABOVE_M: f64 = 0.08;
const STEPS_MAX: usize = 300;
/// Spheres are so far apart there \[m\] …
const APART_M: f64 = 0.03;
/// … and so far above the table: those of links that may come near it, and all others \[m\].
const ABOVE_TABLE_M: [f64; 2] = [0.03, 0.105];

/// What a place is looked for with.
pub(crate) struct Search<'a, const N: usize> {
    pub(crate) chain: &'a Chain<N>,
    pub(crate) model: &'a SkillModel,
    /// Posture in which the arm begins.
    pub(crate) home: SVector<f64, N>,
    /// Positions that the joints may have \[rad or m\].
    pub(crate) range: [SVector<f64, N>; 2],
    /// The distance from their ends at which they act on a joint \[rad or m\].
    pub(crate) limits_act: f64,
    /// The table \[m\].
    pub(crate) table_m: f64,
    /// The arm's spheres, and which of them keep clear of each other.
    pub(crate) points: &'a ControlPoints,
    pub(crate) pairs: &'a SelfPairs,
    /// Links that may come near the table.
    pub(crate) may_be_low: Vec<String>,
}

impl<const N: usize> Search<'_, N> {
    /// Poses of the goal frame, one a direction; the first that the arm can follow by inverse kinematics, straight
    /// from above.
    pub(crate) fn goals(&self) -> Vec<Option<Pose>> {
        let mut kinematics = Kinematics::new();
        forward_kinematics(self.chain, &self.home, &mut kinematics);
        let tool = kinematics.tool_pose();
        let goal = |direction: &f64| {
            CLEAR_OF_LIMITS
                .iter()
                .find_map(|clear| self.goal(&tool, *direction, clear * self.limits_act))
        };
        DIRECTIONS.iter().map(goal).collect()
    }

    fn goal(&self, tool: &Pose, direction: f64, clear: f64) -> Option<Pose> {
        let in_goal = self.tool_in_goal();
        let out = tool.position.truncate().length();
        // Where the tool is as at home, the object is turned like this.
        let kept = yaw(tool.orientation * in_goal.orientation.inverse());
        for height in HEIGHTS {
            for distance in DISTANCES {
                let at = DQuat::from_rotation_z(direction)
                    * DVec3::new(tool.position.x * distance, tool.position.y * distance, 0.0);
                let z = tool.position.z + height * out;
                if z - in_goal.position.length() < self.table_m + 0.06 {
                    continue;
                }
                for turned in YAWS {
                    let turn = (kept + direction + turned) % TAU;
                    let goal = Pose {
                        position: at + z * DVec3::Z,
                        orientation: DQuat::from_rotation_z(turn),
                    };
                    let ends = [goal.compose(&in_goal), raised(&goal).compose(&in_goal)];
                    let mut from = Some(self.home);
                    for end in ends.iter().rev() {
                        let near = from.and_then(|from| self.inverse(from, end, clear));
                        from = near.filter(|q| self.is_free(q));
                    }
                    if from.is_some() {
                        return Some(goal);
                    }
                }
            }
        }
        None
    }

    /// Where the tool is in the goal frame at the end.
    pub(crate) fn tool_in_goal(&self) -> Pose {
        let canonical = &self.model.canonical;
        pose(&canonical.goal_frame).inverse().compose(&pose(&canonical.goal))
    }

    /// Whether the arm's spheres keep clear of the table and of each other there; but for those that do not at home.
    fn is_free(&self, q: &SVector<f64, N>) -> bool {
        let [here, home] = [q, &self.home].map(|q| {
            let mut kinematics = Kinematics::new();
            forward_kinematics(self.chain, q, &mut kinematics);
            kinematics
        });
        let points = self.points.as_slice();
        let height = |kinematics: &Kinematics<N>, point: &ControlPoint| {
            point_position(kinematics, point.joint, point.centre).z - point.radius - self.table_m
        };
        let apart = |at: &Kinematics<N>, &(i, j): &(usize, usize)| {
            let [a, b] = [i, j].map(|i| point_position(at, points[i].joint, points[i].centre));
            a.distance(b) - points[i].radius - points[j].radius
        };
        let is_apart =
            |pair: &(usize, usize)| apart(&here, pair) > APART_M || apart(&home, pair) < APART_M;
        let is_above = |point: &ControlPoint| {
            let name = &self.chain.moving_links()[point.link].0;
            let least = ABOVE_TABLE_M[usize::from(!self.may_be_low.contains(name))];
            height(&here, point) > least || height(&home, point) < least
        };
        points.iter().all(is_above) && self.pairs.watched.iter().all(is_apart)
    }

    /// Damped least squares, within the range but for its ends.
    fn inverse(&self, from: SVector<f64, N>, goal: &Pose, clear: f64) -> Option<SVector<f64, N>> {
        let rows = self.model.manifold.moved();
        let mut kinematics = Kinematics::new();
        let mut q = from;
        for _ in 0..STEPS_MAX {
            forward_kinematics(self.chain, &q, &mut kinematics);
            let tool = kinematics.tool_pose();
            let aside = goal.position - tool.position;
            let turned = goal.rotation_from(&tool);
            let aside = [aside.to_array(), turned.to_array()];
            let error = DVector::from_fn(rows.len(), |i, _| aside.as_flattened()[rows[i]]);
            if error.norm() < 1e-4 {
                return Some(q);
            }
            let jacobian =
                DMatrix::from_fn(rows.len(), N, |i, j| kinematics.tool_jacobian[(rows[i], j)]);
            let square =
                &jacobian * jacobian.transpose() + DMatrix::identity(rows.len(), rows.len()) * 1e-4;
            let step = jacobian.transpose() * square.lu().solve(&error)?;
            let size = (0.2 / step.amax().max(1e-9)).min(1.0);
            for i in 0..N {
                let [lower, upper] = [self.range[0][i] + clear, self.range[1][i] - clear];
                q[i] = (q[i] + size * step[i]).clamp(lower.min(upper), upper.max(lower));
            }
        }
        None
    }
}

fn raised(goal: &Pose) -> Pose {
    Pose { position: goal.position + ABOVE_M * DVec3::Z, ..*goal }
}

/// A model's pose.
pub(crate) fn pose(of: &tprmp_model::skill_model::Pose) -> Pose {
    let [w, x, y, z] = of.quaternion_wxyz;
    Pose { position: of.position_m.into(), orientation: DQuat::from_xyzw(x, y, z, w) }
}

/// The rotation about the vertical of what is upright \[rad\].
fn yaw(q: DQuat) -> f64 {
    let x = q * DVec3::X;
    x.y.atan2(x.x)
}
