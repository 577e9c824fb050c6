//! A learned policy of either kind, and the workspace that serves them all.

use nalgebra::Vector6;
use tprmp_spatial::{MovingPose, Pose, SpatialAcceleration, Twist};

use crate::policy::canonical::policy::{CanonicalPolicy, PositionField};
use crate::policy::canonical::restriction::Restriction;
use crate::policy::thesis::{ThesisPolicy, ThesisState};
use crate::policy::value::{Phase, SkillInertia, SkillValue};

/// A learned policy: immutable.
#[derive(Debug, Clone)]
#[expect(clippy::large_enum_variant, reason = "there is one policy, and it lies close together")]
pub enum SkillPolicy {
    /// Fields on canonical coordinates and the phase, behind a frame map.
    Canonical(CanonicalPolicy),
    /// Products of Gaussians in the plane.
    Plane(ThesisPolicy<2>),
    /// Products of Gaussians in space.
    Space(ThesisPolicy<3>),
    /// Products of Gaussians on poses.
    Pose(ThesisPolicy<6>),
}

/// A tool is held back when more than this fraction of its desired velocity is obstructed; its phase then
/// has at least …
const OBSTRUCTED_MIN: f64 = 0.1;
/// … this fraction of its own pull.
const HELD_FRACTION: f64 = 0.3;

/// What acts beside a policy disturbs it when it is more than this fraction of what acts in all.
const DISTURBED: f64 = 1e-6;

/// What a policy needs between calls. It serves a policy of any kind, and belongs to one policy.
#[derive(Debug, Clone, Default)]
pub struct PolicyState {
    /// How far a canonical skill has progressed; found anew when there is none.
    phase: Option<Phase>,
    /// How many rounds were completed since the start, of a skill that goes round.
    rounds: f64,
    /// Where the tool was when it was evaluated last.
    tool: Option<Pose>,
    /// Whether an obstacle holds the tool back.
    held: bool,
    /// Whether something beside the policy acted on the tool.
    disturbed: bool,
    plane: ThesisState<2>,
    space: ThesisState<3>,
    pose: ThesisState<6>,
}

impl PolicyState {
    /// Forgets how far the skill has progressed: the next [`SkillPolicy::evaluate`] finds the phase nearest to
    /// the pose. For after the tool was moved by something else.
    pub fn restart(&mut self) {
        self.phase = None;
        self.rounds = 0.0;
        self.held = false;
        self.disturbed = false;
    }

    /// Goes on from a phase.
    pub fn resume(&mut self, phase: Phase) {
        self.phase = Some(phase);
        self.rounds = 0.0;
    }

    /// How far a canonical skill has progressed, once it was evaluated.
    #[must_use]
    pub fn phase(&self) -> Option<Phase> {
        self.phase
    }

    /// How many rounds were completed since the start; below zero when it was pushed backwards. 0 of a skill that
    /// does not go round.
    #[must_use]
    pub fn rounds(&self) -> f64 {
        self.rounds
    }

    /// Whether nothing beside the policy acted on the tool in the step before.
    #[must_use]
    pub fn acts_alone(&self) -> bool {
        !self.disturbed
    }

    /// Sets which fraction of the tool's desired velocity is obstructed, 0 to 1
    /// ([`Proximity::obstructed_fraction`](crate::leaves::Proximity::obstructed_fraction)). A phase that is held back goes on
    /// nonetheless, slower, so that the tool leaves the obstacle sooner or later.
    pub fn set_obstructed(&mut self, fraction: f64) {
        self.held = fraction > OBSTRUCTED_MIN;
    }

    /// Goes on for `dt_s` \[s\] with the acceleration that the tool gets, forces of others included.
    ///
    /// * `value`  of the last [`SkillPolicy::evaluate`], within its speeds where a governor acts
    /// * `acceleration`  of the pose, in the world
    ///
    /// Hot path: no allocation. Numbers that are not finite change nothing.
    pub fn advance(&mut self, value: &SkillValue, acceleration: &SpatialAcceleration, dt_s: f64) {
        if let Some(phase) = &mut self.phase {
            self.rounds += phase.advance(&value.phase, acceleration, dt_s);
        }
        let moved = value.natural.metric * Vector6::from(*acceleration);
        let beside = (moved - value.natural.force).norm_squared();
        let most = DISTURBED * DISTURBED * moved.norm_squared() + f64::MIN_POSITIVE;
        self.disturbed = beside.is_nan() || beside > most;
    }
}

impl SkillPolicy {
    /// Whether it goes round for ever, on a limit cycle.
    #[must_use]
    pub fn is_periodic(&self) -> bool {
        matches!(self, Self::Canonical(skill) if skill.cycle.is_some())
    }

    /// How many frames it needs.
    #[must_use]
    pub fn frame_count(&self) -> usize {
        match self {
            Self::Canonical(skill) => skill.frame_count(),
            Self::Plane(skill) => skill.frame_count(),
            Self::Space(skill) => skill.frame_count(),
            Self::Pose(skill) => skill.frame_count(),
        }
    }

    /// Whether it moves the orientation too.
    #[must_use]
    pub fn has_orientation(&self) -> bool {
        match self {
            Self::Canonical(skill) => skill.orientation.is_some(),
            Self::Plane(_) | Self::Space(_) => false,
            Self::Pose(_) => true,
        }
    }

    /// The policy of its position alone, which leaves the orientation to others: its blocks have the phase in common
    /// only. `None` where it moves no whole pose, or in one piece (MATHEMATICS 6).
    #[must_use]
    pub fn position_only(&self) -> Option<Self> {
        match self {
            Self::Canonical(skill) => skill.position_only().map(Self::Canonical),
            _ => None,
        }
    }

    /// Evaluates the policy for a moving pose  [thesis algorithm 4.1].
    ///
    /// * `frames`  in the order of the policy's frames, at least [`SkillPolicy::frame_count`] of them
    /// * `velocity`  of the pose, in the world
    /// * `state`  of the last call, which [`PolicyState::advance`] lets go on; until then the same
    ///   arguments give the same value
    ///
    /// Hot path: no allocation. Input that is not finite, or fewer frames than the policy has, gives
    /// output that is not finite, which [`resolve`](crate::natural::Natural::resolve) refuses.
    #[must_use]
    pub fn evaluate(
        &self,
        inertia: &SkillInertia,
        frames: &[MovingPose],
        pose: &Pose,
        velocity: &Twist,
        state: &mut PolicyState,
    ) -> SkillValue {
        match self {
            Self::Canonical(skill) => {
                state.tool = Some(*pose);
                let Some(transforms) = skill.transforms(frames) else {
                    return SkillValue::undefined();
                };
                let phase = state
                    .phase
                    .get_or_insert_with(|| skill.nearest_phase(inertia, &transforms, pose));
                let mut value = skill.evaluate(inertia, &transforms, pose, velocity, phase);
                // On the cover, where it falls for ever.
                value.energy -= state.rounds * skill.fall_per_round(inertia);
                if state.held {
                    value.phase.least = skill.pull(inertia, phase, HELD_FRACTION);
                }
                value
            }
            Self::Plane(skill) => skill.evaluate(inertia, frames, pose, velocity, &mut state.plane),
            Self::Space(skill) => skill.evaluate(inertia, frames, pose, velocity, &mut state.space),
            Self::Pose(skill) => skill.evaluate(inertia, frames, pose, velocity, &mut state.pose),
        }
    }

    /// Which coordinates of the tool it moves, displacement before rotation: 1, or 0.
    #[must_use]
    pub fn moved(&self) -> Vector6<f64> {
        let planar = match self {
            Self::Canonical(skill) => matches!(skill.position, PositionField::Plane(_)),
            Self::Plane(_) => true,
            Self::Space(_) | Self::Pose(_) => false,
        };
        let restriction = match self {
            Self::Canonical(skill) => skill.restriction,
            _ => None,
        };
        let (height, rotation) = (f64::from(!planar), f64::from(self.has_orientation()));
        match restriction {
            None => Vector6::new(1.0, 1.0, height, rotation, rotation, rotation),
            Some(Restriction::Yaw { .. }) => Vector6::new(1.0, 1.0, 1.0, 0.0, 0.0, 1.0),
            Some(Restriction::Rotation) => Vector6::new(0.0, 0.0, 0.0, 1.0, 1.0, 1.0),
        }
    }

    /// A place of the skill's path for these frames, in the world: of fields the valley at a phase, of products
    /// the mean of a component; of what goes round, the demonstrated path. Not finite for fewer frames than the policy has.
    ///
    /// * `fraction`  0 at the start of the path, 1 at its end
    ///
    /// No allocation.
    #[must_use]
    pub fn on_path(&self, frames: &[MovingPose], fraction: f64, state: &mut PolicyState) -> Pose {
        match self {
            Self::Canonical(skill) => skill.on_path(frames, fraction),
            Self::Plane(skill) => skill.on_path(frames, fraction, &mut state.plane),
            Self::Space(skill) => skill.on_path(frames, fraction, &mut state.space),
            Self::Pose(skill) => skill.on_path(frames, fraction, &mut state.pose),
        }
        .unwrap_or(Pose::UNDEFINED)
    }

    /// The goal for these frames, in the world; not finite for fewer frames than the policy has. Of what it does not
    /// move, it is where the tool was when the policy was evaluated last. A skill that goes
    /// round has none: the place of its path at the present phase.
    ///
    /// Hot path: no allocation; after [`SkillPolicy::evaluate`] with the same frames it costs nothing, or the weights of
    /// one phase.
    #[must_use]
    pub fn goal(&self, frames: &[MovingPose], state: &mut PolicyState) -> Pose {
        match self {
            Self::Canonical(skill) if skill.cycle.is_some() => {
                let phase = state.phase.map_or(0.0, |phase| phase.value);
                skill.on_path(frames, phase).unwrap_or(Pose::UNDEFINED)
            }
            Self::Canonical(skill) => {
                skill.goal(frames, state.tool.as_ref()).unwrap_or(Pose::UNDEFINED)
            }
            Self::Plane(skill) => {
                skill.update(frames, &mut state.plane);
                state.plane.goal()
            }
            Self::Space(skill) => {
                skill.update(frames, &mut state.space);
                state.space.goal()
            }
            Self::Pose(skill) => {
                skill.update(frames, &mut state.pose);
                state.pose.goal()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::canonical::field::{Component, Field};
    use crate::policy::canonical::frame_map::{Anchor, FrameMap};
    use crate::policy::canonical::policy::PositionField;
    use crate::policy::thesis::{PoseGaussian, ThesisComponent};
    use glam::{DQuat, DVec3};
    use nalgebra::{Matrix4, SMatrix, Vector4};

    const INERTIA: SkillInertia = SkillInertia { linear_kg: 2.0, angular_kg_m2: 0.1 };

    fn pose(position: [f64; 3], yaw: f64) -> Pose {
        Pose { position: position.into(), orientation: DQuat::from_rotation_z(yaw) }
    }

    fn canonical() -> SkillPolicy {
        let goal = pose([0.5, -0.25, 0.06], 0.4);
        let start = pose([0.4, 0.1, 0.3], 0.1);
        let goal_frame = pose([0.5, -0.25, 0.03], 0.3);
        let anchors = [
            Anchor { index: 0, frame: start, point: start.position, phase: 0.0 },
            Anchor { index: 1, frame: goal_frame, point: goal.position, phase: 1.0 },
        ];
        let component = Component {
            mean: Vector4::new(goal.position.x, goal.position.y, goal.position.z, 1.0),
            metric: Matrix4::identity(),
            potential: 0.0,
            gradient: Vector4::zeros(),
            hessian: Matrix4::identity() * 16.0,
        };
        let field = Field::new(&[component], 0.1, 8.0).unwrap();
        SkillPolicy::Canonical(CanonicalPolicy {
            map: FrameMap::new(&anchors, goal, true).unwrap(),
            position: PositionField::Space(Box::new(field)),
            orientation: None,
            restriction: None,
            cycle: None,
        })
    }

    fn products<const D: usize>() -> ThesisPolicy<D> {
        let gaussian = PoseGaussian {
            mean: pose([0.1, 0.2, 0.3], 0.2),
            precision: SMatrix::identity() * 50.0,
        };
        let component =
            ThesisComponent { gaussians: Box::new([gaussian; 2]), potential: 0.0, damping: 20.0 };
        ThesisPolicy::new(Box::new([component]), 0.1, 1.0).unwrap()
    }

    #[test]
    fn one_state_serves_every_kind_and_the_goal_is_where_the_policy_rests() {
        let policies = [
            canonical(),
            SkillPolicy::Plane(products()),
            SkillPolicy::Space(products()),
            SkillPolicy::Pose(products()),
        ];
        let frames =
            [pose([0.35, 0.1, 0.3], 0.2), pose([0.55, -0.2, 0.03], 0.5)].map(MovingPose::at_rest);
        let mut state = PolicyState::default();
        for policy in policies {
            state.restart();
            let goal = policy.goal(&frames, &mut state);
            let evaluate = |frames: &[MovingPose], pose: &Pose, state: &mut PolicyState| {
                policy.evaluate(&INERTIA, frames, pose, &Twist::ZERO, state)
            };
            let at_goal = evaluate(&frames, &goal, &mut state);
            assert!(at_goal.natural.force.norm() < 1e-9 && at_goal.energy.abs() < 1e-9);
            let beside = Pose { position: goal.position + DVec3::X * 0.1, ..goal };
            assert!(evaluate(&frames, &beside, &mut state).natural.force[0] < -0.1);
            let inertia = at_goal.natural.metric;
            assert_eq!(inertia[(5, 5)] > 0.0, policy.has_orientation());
            assert!((inertia[(0, 0)] / INERTIA.linear_kg - 1.0).abs() < 0.3);
            let too_few = &frames[..policy.frame_count() - 1];
            assert!(evaluate(too_few, &goal, &mut state).natural.resolve().is_err());
            assert!(!policy.goal(too_few, &mut state).position.is_finite());
        }
    }
}
