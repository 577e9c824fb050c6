//! Skills that a hand demonstrates: paths through via poses of frames that lie differently every time.

use glam::{DQuat, DVec3};
use rand::Rng;
use tprmp_spatial::Pose;

/// Points of the table that turns a spline into its length.
const TABLE: usize = 2000;

/// A skill to be demonstrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Scene {
    /// From a start frame into a slot: straight along the slot's axis in the last 10 cm.
    Insertion,
    /// From a start frame through a gate, which lies elsewhere each time, to a goal.
    Gate,
    /// From the tool onto a place that is turned about the vertical, elsewhere each time; the tool points down.
    Place,
}

/// Name of the frame that the gate scene has besides start and goal.
pub const GATE: &str = "gate";

/// Frames, as they lie for one demonstration.
#[derive(Clone, Copy, Debug)]
pub struct Frames {
    /// The start frame.
    pub start: Pose,
    /// The goal frame.
    pub goal: Pose,
    /// The gate, where the scene has one.
    pub gate: Option<Pose>,
}

/// A path from rest to rest, by its length.
#[derive(Clone, Debug)]
pub struct TruePath {
    poses: Vec<Pose>,
    /// Fraction of the length at each of them.
    fractions: Vec<f64>,
}

impl Scene {
    /// Frames at random places and in random orientations around fixed ones.
    pub fn frames(self, random: &mut impl Rng) -> Frames {
        let mut near = |position: [f64; 3], by_m: f64, yaw_rad: f64, tilt_rad: f64| {
            let mut within = |most: f64| most * random.random_range(-1.0..=1.0);
            let by = DVec3::new(within(by_m), within(by_m), within(0.5 * by_m));
            let (yaw, x, y) = (within(yaw_rad), within(tilt_rad), within(tilt_rad));
            let tilt = DQuat::from_scaled_axis(DVec3::new(x, y, 0.0));
            let orientation = tilt * DQuat::from_rotation_z(yaw);
            Pose { position: DVec3::from_array(position) + by, orientation }
        };
        if self == Self::Place {
            let mut start = near([0.4, -0.2, 0.3], 0.06, 0.5, 0.0);
            start.orientation *= DQuat::from_rotation_x(std::f64::consts::PI);
            return Frames { start, goal: near([0.4, 0.2, 0.2], 0.08, 2.1, 0.0), gate: None };
        }
        let start = near([0.35, -0.3, 0.35], 0.08, 0.3, 0.1);
        let goal = near([0.45, 0.3, 0.08], 0.12, 0.6, 0.15);
        let gate = (self == Self::Gate).then(|| near([0.5, 0.0, 0.3], 0.1, 0.5, 0.0));
        Frames { start, goal, gate }
    }

    /// The path of the tool among these frames.
    #[must_use]
    pub fn path(self, frames: &Frames) -> TruePath {
        let down = DQuat::from_rotation_x(std::f64::consts::PI);
        let in_frame = |frame: &Pose, x: f64, y: f64, z: f64, pitch: f64| {
            let orientation = down * DQuat::from_rotation_y(pitch);
            frame.compose(&Pose { position: DVec3::new(x, y, z), orientation })
        };
        let mut vias = match self {
            Self::Place => {
                let up = Pose { position: frames.start.position + DVec3::Z * 0.05, ..frames.start };
                vec![frames.start, up]
            }
            Self::Insertion | Self::Gate => vec![
                in_frame(&frames.start, 0.0, 0.0, 0.0, 0.4),
                in_frame(&frames.start, 0.03, 0.06, 0.06, 0.35),
            ],
        };
        if let Some(gate) = &frames.gate {
            vias.push(in_frame(gate, -0.02, -0.07, 0.0, 0.1));
            vias.push(in_frame(gate, 0.0, 0.0, 0.0, 0.0));
            vias.push(in_frame(gate, 0.02, 0.07, 0.0, -0.1));
        }
        let above = if self == Self::Place { 0.5 } else { 1.0 };
        vias.push(in_frame(&frames.goal, 0.0, 0.0, 0.2 * above, 0.0));
        vias.push(in_frame(&frames.goal, 0.0, 0.0, 0.1 * above, 0.0));
        vias.push(in_frame(&frames.goal, 0.0, 0.0, 0.0, 0.0));
        TruePath::through(&vias)
    }
}

impl TruePath {
    /// A Catmull–Rom spline by chord length.
    fn through(vias: &[Pose]) -> Self {
        let chord = |pair: &[Pose]| (pair[1].position - pair[0].position).length().max(0.02);
        let mut knots = vec![0.0];
        for pair in vias.windows(2) {
            knots.push(knots[knots.len() - 1] + chord(pair));
        }
        let last = vias.len() - 1;
        // Four coordinates of the quaternion, in one hemisphere, and three of the position.
        let mut values: Vec<[f64; 7]> = Vec::with_capacity(vias.len());
        for via in vias {
            let mut q = via.orientation;
            if let Some(before) = values.last() {
                let dot = q.x * before[3] + q.y * before[4] + q.z * before[5] + q.w * before[6];
                if dot < 0.0 {
                    q = -q;
                }
            }
            let p = via.position;
            values.push([p.x, p.y, p.z, q.x, q.y, q.z, q.w]);
        }
        let slope = |i: usize, c: usize| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(last));
            (values[b][c] - values[a][c]) / (knots[b] - knots[a])
        };
        let at = |x: f64| {
            let i = knots.partition_point(|knot| *knot <= x).clamp(1, last) - 1;
            let h = knots[i + 1] - knots[i];
            let t = (x - knots[i]) / h;
            let value: [f64; 7] = std::array::from_fn(|c| {
                let (a, b) = (values[i][c], values[i + 1][c]);
                let (ma, mb) = (slope(i, c) * h, slope(i + 1, c) * h);
                let (t2, t3) = (t * t, t * t * t);
                (2.0 * t3 - 3.0 * t2 + 1.0) * a
                    + (t3 - 2.0 * t2 + t) * ma
                    + (3.0 * t2 - 2.0 * t3) * b
                    + (t3 - t2) * mb
            });
            let [x, y, z, qx, qy, qz, qw] = value;
            let orientation = DQuat::from_xyzw(qx, qy, qz, qw).normalize();
            Pose { position: DVec3::new(x, y, z), orientation }
        };
        let poses: Vec<Pose> =
            (0..=TABLE).map(|k| at(knots[last] * k as f64 / TABLE as f64)).collect();
        let mut fractions = vec![0.0];
        for pair in poses.windows(2) {
            let step = (pair[1].position - pair[0].position).length();
            fractions.push(fractions[fractions.len() - 1] + step);
        }
        let length = fractions[TABLE];
        fractions.iter_mut().for_each(|fraction| *fraction /= length);
        Self { poses, fractions }
    }

    /// The pose at a fraction of the length.
    #[must_use]
    pub fn at(&self, fraction: f64) -> Pose {
        let end = self.fractions.partition_point(|other| *other < fraction).clamp(1, TABLE);
        let (a, b) = (self.fractions[end - 1], self.fractions[end]);
        let part = if b > a { ((fraction - a) / (b - a)).clamp(0.0, 1.0) } else { 1.0 };
        self.poses[end - 1].interpolate(&self.poses[end], part)
    }
}
