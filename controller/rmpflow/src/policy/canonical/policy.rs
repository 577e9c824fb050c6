//! The leaf of a learned skill: fields on canonical coordinates and the phase, pulled back through the
//! frame map to the pose of the tool.
//!
//! The phase s is a coordinate of the policy alone: no other leaf acts on it. So it is eliminated from
//! the natural form before that meets other leaves. With x the pose,
//!
//! ```text
//! [M_xx M_xs] [ẍ]   [f_x]          (M_xx − M_xs M_ss⁻¹ M_sx) ẍ = f_x − M_xs M_ss⁻¹ f_s
//! [M_sx M_ss] [s̈] = [f_s]          s̈ = M_ss⁻¹ (f_s − M_sx ẍ)
//! ```
//!
//! The first line on the right is the leaf. Once the root is resolved, the second one gives the
//! acceleration of the phase for that of the tool ([`Phase::advance`]): the phase waits for a tool that is
//! held back, and follows one that is pushed.

use glam::{DMat3, DVec3};
use nalgebra::{Matrix6, SVector, Vector6};
use tprmp_spatial::rotation::rotation_vector;
use tprmp_spatial::{MovingPose, Pose, Twist, Wrench};

use crate::natural::Natural;
use crate::policy::canonical::field::Field;
use crate::policy::canonical::frame_map::{Canonical, FrameMap, FrameTransforms, Mapped};
use crate::policy::canonical::restriction::Restriction;
use crate::policy::canonical::rounds::Cycle;
use crate::policy::value::{FRAME_CAPACITY, Phase, PhaseResponse, SkillInertia, SkillValue};

/// Phases that are compared to find the one to start with.
const PHASES_COMPARED: usize = 97;
/// A pose is at the start when it lies at most so much farther from it than from the nearest phase, as
/// a fraction of the tolerance.
const AT_START: f64 = 0.25;
/// Sections between neighbours of the best one: to 1e-8, the root of the precision.
const SECTIONS: usize = 30;
/// Fraction of the golden section.
const GOLDEN: f64 = 0.618_033_988_749_894_8;

/// The field of the position: in the plane z = const, or in space; the phase is its last coordinate.
#[derive(Debug, Clone)]
pub enum PositionField {
    /// In the plane: x and y.
    Plane(Box<Field<3>>),
    /// In space.
    Space(Box<Field<4>>),
}

/// A learned policy on canonical coordinates and the phase: immutable.
#[derive(Debug, Clone)]
pub struct CanonicalPolicy {
    /// How the frames move the space.
    pub map: FrameMap,
    /// Position, with unit inertia at the goal.
    pub position: PositionField,
    /// Orientation chart, with unit inertia at the goal; `None` when orientation is free.
    pub orientation: Option<Box<Field<4>>>,
    /// What of the pose it moves; `None` for all that its fields are functions of.
    pub restriction: Option<Restriction>,
    /// For a skill that goes round, whose fields are on the cover of the circle; its goal is the centre of
    /// its coordinates.
    pub cycle: Option<Cycle>,
}

/// (v, last), of v the first N − 1 components.
fn lifted<const N: usize>(v: DVec3, last: f64) -> SVector<f64, N> {
    SVector::from_fn(|i, _| if i + 1 < N { v[i] } else { last })
}

impl PositionField {
    /// [`Field::distance`] at a phase.
    fn distance(&self, point: DVec3, phase: f64) -> f64 {
        match self {
            Self::Plane(field) => field.distance(&lifted(point, phase)),
            Self::Space(field) => field.distance(&lifted(point, phase)),
        }
    }

    /// [`Field::half_squared_norm`] of an offset at a phase.
    fn half_squared_norm(&self, phase: f64, offset: DVec3) -> f64 {
        match self {
            Self::Plane(field) => field.half_squared_norm(phase, &lifted(offset, 0.0)),
            Self::Space(field) => field.half_squared_norm(phase, &lifted(offset, 0.0)),
        }
    }
}

/// The field of one block, position or orientation, pulled back to its displacement x and the phase.
struct Block {
    /// f_x, f_s.
    force: (DVec3, f64),
    /// M_xx, M_xs, M_ss.
    metric: (DMat3, DVec3, f64),
    energy: f64,
}

impl Block {
    /// Nothing.
    const NONE: Self =
        Self { force: (DVec3::ZERO, 0.0), metric: (DMat3::ZERO, DVec3::ZERO, 0.0), energy: 0.0 };

    /// Evaluates a field, the first N − 1 coordinates of which are those of `mapped`.
    ///
    /// * `scale`  by which the field's force and metric are multiplied
    fn new<const N: usize>(field: &Field<N>, scale: f64, phase: &Phase, mapped: &Mapped) -> Self {
        let last = N - 1;
        let velocity = lifted(mapped.velocity, phase.rate_1_s);
        let value = field.evaluate(&lifted(mapped.point, phase.value), &velocity);
        let (force, metric) = (value.force(&velocity), &value.metric);
        let vector = |entry: &dyn Fn(usize) -> f64| {
            DVec3::new(entry(0), entry(1), if N > 3 { entry(2) } else { 0.0 })
        };
        let column = |j: usize| vector(&|i| metric[(i, j)]) * scale;
        let own =
            DMat3::from_cols(column(0), column(1), if N > 3 { column(2) } else { DVec3::ZERO });
        let (with_phase, of_phase) = (column(last), metric[(last, last)] * scale);
        // J̇ẋ is the drift; the phase is a coordinate as it is.
        let Mapped { jacobian, phase_derivative: along, drift, .. } = mapped;
        let residual = vector(&|i| force[i]) * scale - own * *drift;
        let back = jacobian.transpose();
        let mixed = own * *along + with_phase;
        Self {
            force: (
                back * residual,
                force[last] * scale - with_phase.dot(*drift) + along.dot(residual),
            ),
            metric: (
                back * (own * *jacobian),
                back * mixed,
                of_phase + along.dot(with_phase) + along.dot(mixed),
            ),
            energy: value.energy(&velocity) * scale,
        }
    }
}

/// A skill of these blocks, with the phase eliminated: the Schur complement of its row and column.
fn without_phase(position: &Block, rotation: &Block) -> SkillValue {
    let inverse = 1.0 / (position.metric.2 + rotation.metric.2);
    let free = (position.force.1 + rotation.force.1) * inverse;
    let pair = |force: DVec3, torque: DVec3| Vector6::from(Wrench { force, torque });
    let column = pair(position.metric.1, rotation.metric.1);
    let coupling = column * inverse;
    let mut metric = Matrix6::zeros();
    for (first, block) in [(0, position.metric.0), (3, rotation.metric.0)] {
        metric.fixed_view_mut::<3, 3>(first, first).copy_from(&block.into());
    }
    for j in 0..6 {
        for i in 0..6 {
            metric[(i, j)] -= column[i] * coupling[j];
        }
    }
    SkillValue {
        natural: Natural {
            force: pair(position.force.0, rotation.force.0) - column * free,
            metric,
        },
        energy: position.energy + rotation.energy,
        phase: PhaseResponse { free, coupling, least: f64::NEG_INFINITY, wraps: false },
    }
}

impl CanonicalPolicy {
    /// How many frames it takes.
    #[must_use]
    pub fn frame_count(&self) -> usize {
        self.map.frame_count()
    }

    /// The transforms of these moving frames; `None` when there are too few.
    #[inline]
    #[must_use]
    pub fn transforms(&self, frames: &[MovingPose]) -> Option<FrameTransforms> {
        match &self.restriction {
            None => self.map.transforms(frames),
            Some(restriction) => {
                let count = frames.len().min(FRAME_CAPACITY);
                self.map.transforms(&restriction.frames(frames)[..count])
            }
        }
    }

    /// The goal for these frames, for a tool where there is one; `None` for too few of them.
    #[must_use]
    pub fn goal(&self, frames: &[MovingPose], tool: Option<&Pose>) -> Option<Pose> {
        let Some(restriction) = &self.restriction else { return self.map.goal_among(frames) };
        let count = frames.len().min(FRAME_CAPACITY);
        let goal = self.map.goal_among(&restriction.frames(frames)[..count])?;
        Some(tool.map_or(goal, |tool| restriction.nearest(&goal, tool)))
    }

    /// Evaluates the skill for a moving pose, at a phase.
    ///
    /// * `transforms`  the frames as they are now
    /// * `velocity`  of the pose, in the world
    ///
    /// Hot path: no allocation. Input that is not finite gives output that is not finite.
    #[must_use]
    pub fn evaluate(
        &self,
        inertia: &SkillInertia,
        transforms: &FrameTransforms,
        pose: &Pose,
        velocity: &Twist,
        phase: &Phase,
    ) -> SkillValue {
        let Some(restriction) = &self.restriction else {
            return self.evaluate_whole(inertia, transforms, pose, velocity, phase);
        };
        let seen = restriction.tool(pose, velocity);
        let (pose, velocity) = (&seen.pose, &seen.velocity);
        seen.pulled_back(&self.evaluate_whole(inertia, transforms, pose, velocity, phase))
    }

    /// The same of a policy that moves all of the pose.
    #[inline]
    fn evaluate_whole(
        &self,
        inertia: &SkillInertia,
        transforms: &FrameTransforms,
        pose: &Pose,
        velocity: &Twist,
        phase: &Phase,
    ) -> SkillValue {
        let transported = self.map.at(transforms, phase.value, phase.rate_1_s);
        let mapped = transported.position(pose.position, velocity.linear);
        let position = match &self.position {
            PositionField::Plane(field) => Block::new(field, inertia.linear_kg, phase, &mapped),
            PositionField::Space(field) => Block::new(field, inertia.linear_kg, phase, &mapped),
        };
        let rotation = self.orientation.as_ref().map_or(Block::NONE, |field| {
            let mapped = transported.rotation(pose.orientation, velocity.angular);
            Block::new(field, inertia.angular_kg_m2, phase, &mapped)
        });
        let mut value = without_phase(&position, &rotation);
        value.phase.wraps = self.cycle.is_some();
        value
    }

    /// The policy without its orientation; `None` where it moves less than whole poses.
    #[must_use]
    pub fn position_only(&self) -> Option<Self> {
        if self.orientation.is_none() || self.restriction.is_some() {
            return None;
        }
        let cycle = self
            .cycle
            .map(|Cycle { fall_per_round: [fall, _] }| Cycle { fall_per_round: [fall, 0.0] });
        Some(Self { orientation: None, cycle, ..self.clone() })
    }

    /// By how much the potential falls in a round \[J\]; 0 for a skill that does not go round.
    #[must_use]
    pub fn fall_per_round(&self, inertia: &SkillInertia) -> f64 {
        self.cycle.map_or(0.0, |Cycle { fall_per_round: [position, rotation] }| {
            inertia.linear_kg * position + inertia.angular_kg_m2 * rotation
        })
    }

    /// The phase at which a pose lies nearest to the demonstrations in the metric of the skill, at rest.
    /// Of several that are as near, as where a path crosses itself or ends where it began, the earliest
    /// one. Of a skill that goes round, the nearest one.
    ///
    /// Not for every tick: it compares a hundred phases. No allocation.
    #[must_use]
    pub fn nearest_phase(
        &self,
        inertia: &SkillInertia,
        transforms: &FrameTransforms,
        pose: &Pose,
    ) -> Phase {
        let seen = self.restriction.as_ref().map(|r| r.tool(pose, &Twist::ZERO).pose);
        let pose = seen.as_ref().unwrap_or(pose);
        let tolerance = self.tolerance(inertia).sqrt();
        let from_start = self.distance_from_start(inertia, transforms, pose).map(f64::sqrt);
        let start = Phase { value: 0.0, rate_1_s: 0.0 };
        // It is near enough, whatever the other phases are.
        if from_start.is_some_and(|d| d <= AT_START * tolerance) {
            return start;
        }
        let distance = |phase: f64| self.distance(inertia, transforms, pose, phase);
        let step = 1.0 / (PHASES_COMPARED - 1) as f64;
        let mut distances = [0.0; PHASES_COMPARED];
        for (i, entry) in distances.iter_mut().enumerate() {
            *entry = distance(i as f64 * step);
        }
        let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
        if from_start.is_some_and(|d| d <= least.sqrt() + AT_START * tolerance) {
            return start;
        }
        let bound = (least.sqrt() + tolerance).powi(2);
        let at = |i: usize| distances.get(i).copied().unwrap_or(f64::INFINITY);
        let is_near =
            |i: &usize| at(*i) <= bound && at(*i) <= at(i + 1) && (*i == 0 || at(*i) <= at(i - 1));
        let goes_round = self.cycle.is_some();
        let best = if goes_round {
            (0..PHASES_COMPARED).min_by(|i, j| at(*i).total_cmp(&at(*j)))
        } else {
            (0..PHASES_COMPARED).find(is_near)
        };
        let best = best.unwrap_or(0) as f64;
        // Between its neighbours the distance is assumed to fall and then rise; a round has no ends.
        let (mut low, mut high) = ((best - 1.0) * step, (best + 1.0) * step);
        if !goes_round {
            (low, high) = (low.max(0.0), high.min((PHASES_COMPARED - 1) as f64 * step));
        }
        // The golden section: of two places between low and high one is known from before.
        let inner = |low: f64, high: f64| high - GOLDEN * (high - low);
        let outer = |low: f64, high: f64| low + GOLDEN * (high - low);
        let (mut a, mut b) = (distance(inner(low, high)), distance(outer(low, high)));
        for _ in 0..SECTIONS {
            if a <= b {
                high = outer(low, high);
                (a, b) = (distance(inner(low, high)), a);
            } else {
                low = inner(low, high);
                (a, b) = (b, distance(outer(low, high)));
            }
        }
        let middle = 0.5 * (low + high);
        let value = if goes_round { middle.rem_euclid(1.0) } else { middle };
        Phase { value, rate_1_s: 0.0 }
    }

    /// The valley at a phase, for these frames, in the world; `None` for too few of them, and where there is no
    /// valley. Of a skill that goes round, which never comes to rest in its valley, the demonstrated path. No allocation.
    #[must_use]
    pub fn on_path(&self, frames: &[MovingPose], phase: f64) -> Option<Pose> {
        let goes_round = self.cycle.is_some();
        let valley = |field: &Field<4>| place(field, phase, goes_round);
        fn place<const N: usize>(field: &Field<N>, phase: f64, goes_round: bool) -> Option<DVec3> {
            let y = if goes_round { field.mean(phase) } else { field.valley(phase)?.point };
            Some(DVec3::new(y[0], y[1], if N > 3 { y[2] } else { 0.0 }))
        }
        let transforms = self.transforms(frames)?;
        let position = match &self.position {
            PositionField::Plane(field) => place(field, phase, goes_round),
            PositionField::Space(field) => valley(field),
        }?;
        let rotation = match &self.orientation {
            Some(field) => valley(field)?,
            None => DVec3::ZERO,
        };
        Some(self.map.forward(&transforms, phase, &Canonical { position, rotation }))
    }

    fn distance(
        &self,
        inertia: &SkillInertia,
        transforms: &FrameTransforms,
        pose: &Pose,
        phase: f64,
    ) -> f64 {
        let y = self.map.inverse(transforms, phase, pose);
        let mut distance = inertia.linear_kg * self.position.distance(y.position, phase);
        if let Some(field) = &self.orientation {
            distance += inertia.angular_kg_m2 * field.distance(&lifted(y.rotation, phase));
        }
        distance
    }

    /// The squared distance of a pose from that of the start frame, in the metric at phase 0; `None` when
    /// the skill has no start frame.
    ///
    /// [`Self::distance`] is there that from the mean of the outermost component.
    fn distance_from_start(
        &self,
        inertia: &SkillInertia,
        transforms: &FrameTransforms,
        pose: &Pose,
    ) -> Option<f64> {
        let [start, _, ..] = self.map.anchors() else { return None };
        let y = self.map.inverse(transforms, 0.0, pose);
        let offset = y.position - start.point;
        let mut distance = inertia.linear_kg * self.position.half_squared_norm(0.0, offset);
        if let Some(field) = &self.orientation {
            let at_start = self.map.goal().orientation.conjugate() * start.frame.orientation;
            let r = y.rotation - rotation_vector(at_start);
            distance += inertia.angular_kg_m2 * field.half_squared_norm(0.0, &lifted(r, 0.0));
        }
        Some(distance)
    }

    /// The acceleration of the phase that goes on at `fraction` of its own pull, as if the tool lay in
    /// the valley: s̈ = −fraction U′/M_ss − d ṡ \[1/s²\]. −∞ where there is no valley.
    ///
    /// Where an obstacle holds the tool back, the valley's pull on the tool holds the phase back too: the
    /// desired pose would stay in the obstacle for good, and the tool would go round it for ever.
    pub(crate) fn pull(&self, inertia: &SkillInertia, phase: &Phase, fraction: f64) -> f64 {
        fn of<const N: usize>(field: &Field<N>, phase: f64) -> Option<[f64; 3]> {
            let slope = field.valley(phase)?.slope;
            let mut along = SVector::zeros();
            along[N - 1] = 1.0;
            let mass = 2.0 * field.half_squared_norm(phase, &along);
            Some([slope, mass, mass * field.damping_1_s()])
        }
        let position = match &self.position {
            PositionField::Plane(field) => of(field, phase.value),
            PositionField::Space(field) => of(field, phase.value),
        };
        let orientation = match &self.orientation {
            Some(field) => of(field, phase.value),
            None => Some([0.0; 3]),
        };
        let (Some(p), Some(r)) = (position, orientation) else { return f64::NEG_INFINITY };
        let [slope, mass, damping] =
            [0, 1, 2].map(|i| inertia.linear_kg * p[i] + inertia.angular_kg_m2 * r[i]);
        let pull = (-fraction * slope - damping * phase.rate_1_s) / mass;
        if pull.is_finite() { pull } else { f64::NEG_INFINITY }
    }

    /// A squared distance that counts as none: that of half a component's fraction of the path.
    fn tolerance(&self, inertia: &SkillInertia) -> f64 {
        fn of<const N: usize>(field: &Field<N>) -> f64 {
            let components = field.components();
            let goal = components[components.len() - 1].metric[(N - 1, N - 1)];
            let fraction = 0.5 / components.len() as f64;
            0.5 * goal * fraction * fraction
        }
        let mut tolerance = inertia.linear_kg
            * match &self.position {
                PositionField::Plane(field) => of(field),
                PositionField::Space(field) => of(field),
            };
        if let Some(field) = &self.orientation {
            tolerance += inertia.angular_kg_m2 * of(field);
        }
        tolerance
    }
}

#[cfg(test)]
mod tests;
