//! A learned skill as a leaf on the tool, and the mode in which it is done.
//!
//! A model may hold several modes: different ways of doing the same skill. Which one is taken is decided once,
//! when the skill starts or goes on: the nearest one among those that the arm can follow and that are free.

use core::ops::Range;

use nalgebra::{SMatrix, SVector, Vector6};
use tprmp_model::controller_config::SkillLeaf as Settings;
use tprmp_model::skill_model::MODE_CAPACITY;
use tprmp_rmpflow::leaves::Obstacle;
use tprmp_rmpflow::policy::{PolicyState, SkillInertia, SkillPolicy, SkillValue, SpeedGovernor};
use tprmp_robot::{Kinematics, forward_kinematics};
use tprmp_spatial::{MovingPose, Pose};

use crate::arm::{Arm, PointPlaces};

/// Places of a path that are compared with where the tool is, and that the arm is sent along in thought.
const PLACES: usize = 49;
/// Steps of the inverse kinematics at the first place, and at each of the others.
const STEPS: [usize; 2] = [30, 4];
/// λ² of the damped least squares, relative to a unit Jacobian.
const DAMPING: f64 = 1e-4;
/// Largest change of a joint in a step \[rad or m\].
const STEP_MAX: f64 = 0.3;
/// The arm reaches a pose that it comes so near to \[m\] …
const REACHED_M: f64 = 0.01;
/// … and \[rad\].
const REACHED_RAD: f64 = 0.1;
/// Paths are as near as another that is nearer by less than this fraction of its length: where all begin at the same
/// place, the first one is taken.
const ALIKE_FRACTION: f64 = 0.02;
/// A path is free when everything keeps so far from obstacles on it \[m\].
const FREE_M: f64 = 0.02;

/// A learned skill as a leaf on the tool.
#[derive(Debug)]
pub struct SkillLeaf {
    /// At least one.
    modes: Vec<SkillPolicy>,
    /// Which of the scene's frames are its own, in its order.
    pub frames: Range<usize>,
    /// By which its metric is multiplied.
    pub inertia: SkillInertia,
    /// What bounds the velocities that it asks for.
    pub governor: SpeedGovernor,
}

/// What a skill needs between ticks.
#[derive(Debug, Default)]
pub struct SkillState {
    /// Of the policy of its mode.
    pub state: PolicyState,
    /// Of the last evaluation, if it was followed.
    pub value: Option<SkillValue>,
    /// The mode that was decided on; none before the skill starts.
    mode: Option<Choice>,
}

/// The mode that was decided on, and why.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// Which one, from 0.
    pub mode: usize,
    /// Of how many.
    pub modes: usize,
    /// What following it looks like from where the arm is.
    pub prospect: Prospect,
    /// Of all modes, how many the arm cannot follow, …
    pub out_of_reach: usize,
    /// … and how many others an obstacle is in the way of.
    pub blocked: usize,
}

/// What following a mode from its nearest place to its end looks like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prospect {
    /// Length of the path \[m\].
    pub length_m: f64,
    /// Distance of the tool from its path, an angle counted by the ratio of the inertias \[m\].
    pub distance_m: f64,
    /// How far the arm stays from the path where it can follow it least \[m, rad\].
    pub beside: [f64; 2],
    /// The least distance of the arm from obstacles \[m\].
    pub clearance_m: f64,
}

impl Prospect {
    /// Whether the arm can follow the path within the working range of its joints.
    #[must_use]
    pub fn is_reachable(&self) -> bool {
        self.beside[0] <= REACHED_M && self.beside[1] <= REACHED_RAD
    }

    /// Whether no obstacle is in the way.
    #[must_use]
    pub fn is_free(&self) -> bool {
        self.clearance_m >= FREE_M
    }

    /// Whether it is to be preferred: what can be followed before what is free, then what is near. What cannot be
    /// followed is judged by how far it is left, what is not free by what it clears.
    fn is_better_than(&self, other: &Self) -> bool {
        let rank = |of: &Self| (of.is_reachable(), of.is_free());
        if rank(self) != rank(other) {
            return rank(self) > rank(other);
        }
        match rank(self) {
            (true, true) => self.distance_m + ALIKE_FRACTION * other.length_m < other.distance_m,
            (true, false) => self.clearance_m > other.clearance_m,
            _ => self.beside[0] < other.beside[0],
        }
    }
}

impl SkillState {
    /// Forgets phase and mode: the skill goes on from where the tool is.
    pub fn restart(&mut self) {
        self.state.restart();
        self.value = None;
        self.mode = None;
    }

    /// The mode that was decided on.
    #[must_use]
    pub fn choice(&self) -> Option<Choice> {
        self.mode
    }
}

/// From where, and among what, a mode is decided on.
pub struct Posture<'a, const N: usize> {
    /// The arm.
    pub arm: &'a Arm<N>,
    /// Its joint positions \[rad or m\].
    pub q: &'a SVector<f64, N>,
    /// The leaf's frames.
    pub frames: &'a [MovingPose],
    /// What to keep away from.
    pub obstacles: &'a [Obstacle],
}

impl SkillLeaf {
    /// A leaf of a skill with these modes.
    ///
    /// # Panics
    /// When there is none, or there are more than [`MODE_CAPACITY`].
    #[must_use]
    pub fn new(modes: Vec<SkillPolicy>, first_frame: usize, settings: &Settings) -> Self {
        assert!((1..=MODE_CAPACITY).contains(&modes.len()), "1 to {MODE_CAPACITY} modes");
        let frames = modes.iter().map(SkillPolicy::frame_count).max().unwrap_or(0);
        Self {
            modes,
            frames: first_frame..first_frame + frames,
            inertia: settings.inertia(),
            governor: settings.governor,
        }
    }

    /// The policy of the mode that was decided on; before that, of the first.
    #[inline]
    #[must_use]
    pub fn policy(&self, state: &SkillState) -> &SkillPolicy {
        &self.modes[state.mode.map_or(0, |choice| choice.mode)]
    }

    /// Whether it goes round, and does not end by itself.
    #[must_use]
    pub fn is_periodic(&self) -> bool {
        self.modes[0].is_periodic()
    }

    /// Which coordinates of the tool it moves, displacement before rotation: 1, or 0.
    #[must_use]
    pub fn moved(&self) -> Vector6<f64> {
        self.modes[0].moved()
    }

    /// Decides on a mode where none was decided on. Kinematics and places are overwritten.
    ///
    /// No allocation; where there are several modes it takes as long as a hundred ticks.
    pub fn decide<const N: usize>(
        &self,
        posture: &Posture<'_, N>,
        kinematics: &mut Kinematics<N>,
        places: &mut PointPlaces<N>,
        state: &mut SkillState,
    ) {
        if state.mode.is_some() || posture.frames.len() < self.frames.len() {
            return;
        }
        let modes = self.modes.len();
        let none = Prospect {
            length_m: 0.0,
            distance_m: 0.0,
            beside: [0.0; 2],
            clearance_m: f64::INFINITY,
        };
        let mut best = Choice { mode: 0, modes, prospect: none, out_of_reach: 0, blocked: 0 };
        if modes > 1 {
            for (mode, policy) in self.modes.iter().enumerate() {
                state.state.restart();
                let state = &mut state.state;
                let prospect = self.prospect(policy, posture, kinematics, places, state);
                match (prospect.is_reachable(), prospect.is_free()) {
                    (false, _) => best.out_of_reach += 1,
                    (true, false) => best.blocked += 1,
                    (true, true) => {}
                }
                if mode == 0 || prospect.is_better_than(&best.prospect) {
                    (best.mode, best.prospect) = (mode, prospect);
                }
            }
            state.state.restart();
        }
        state.mode = Some(best);
    }

    /// Follows a mode in thought, by inverse kinematics from where the arm is.
    fn prospect<const N: usize>(
        &self,
        policy: &SkillPolicy,
        posture: &Posture<'_, N>,
        kinematics: &mut Kinematics<N>,
        places: &mut PointPlaces<N>,
        state: &mut PolicyState,
    ) -> Prospect {
        let Posture { arm, q, frames, obstacles } = *posture;
        let mut path = [Pose::UNDEFINED; PLACES];
        for (i, place) in path.iter_mut().enumerate() {
            *place = policy.on_path(frames, i as f64 / (PLACES - 1) as f64, state);
        }
        let moved = policy.moved();
        let radius = (self.inertia.angular_kg_m2 / self.inertia.linear_kg).sqrt();
        forward_kinematics(&arm.chain, q, kinematics);
        let tool = kinematics.tool_pose();
        let distance = |place: &Pose| {
            let error = offset(&tool, place, &moved);
            let linear = error.fixed_rows::<3>(0).norm();
            linear.hypot(radius * error.fixed_rows::<3>(3).norm())
        };
        let (mut nearest, mut distance_m) = (0, f64::INFINITY);
        for (i, place) in path.iter().enumerate() {
            let here = distance(place);
            if here < distance_m {
                (nearest, distance_m) = (i, here);
            }
        }
        let goal = path[PLACES - 1];
        let steps = path.windows(2).map(|step| step[1].position.distance(step[0].position));
        let length_m = steps.sum();
        let mut prospect =
            Prospect { length_m, distance_m, beside: [0.0; 2], clearance_m: f64::INFINITY };
        let mut q = *q;
        for (i, place) in path.iter().enumerate().skip(nearest) {
            let steps = STEPS[usize::from(i > nearest)];
            let beside = approach(arm, place, &moved, steps, &mut q, kinematics);
            for (most, error) in prospect.beside.iter_mut().zip(beside) {
                *most = most.max(error);
            }
            let tool = kinematics.tool_pose();
            let links = arm.links(kinematics, places, [&tool, &goal]);
            prospect.clearance_m = prospect.clearance_m.min(links.clearance(obstacles));
        }
        prospect
    }
}

/// From a pose to another in the coordinates that a skill moves: displacement, rotation \[m, rad\].
fn offset(from: &Pose, to: &Pose, moved: &Vector6<f64>) -> Vector6<f64> {
    let (linear, angular) = (to.position - from.position, to.rotation_from(from));
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z).component_mul(moved)
}

/// Brings the joints nearer to a pose of the tool by damped least squares, within their range. What is left
/// \[m, rad\]; the kinematics are those of the joints.
fn approach<const N: usize>(
    arm: &Arm<N>,
    goal: &Pose,
    moved: &Vector6<f64>,
    steps: usize,
    q: &mut SVector<f64, N>,
    kinematics: &mut Kinematics<N>,
) -> [f64; 2] {
    let [lower, upper] = &arm.range;
    for _ in 0..steps {
        forward_kinematics(&arm.chain, q, kinematics);
        let error = offset(&kinematics.tool_pose(), goal, moved);
        let mut jacobian = kinematics.tool_jacobian;
        for (mut row, moved) in jacobian.row_iter_mut().zip(moved.iter()) {
            row *= *moved;
        }
        let damped = jacobian.transpose() * jacobian + SMatrix::identity() * DAMPING;
        let Some(factor) = damped.cholesky() else { break };
        let step: SVector<f64, N> = factor.solve(&(jacobian.transpose() * error));
        *q += step * (STEP_MAX / step.amax().max(STEP_MAX));
        for i in 0..N {
            q[i] = q[i].clamp(lower[i], upper[i]);
        }
    }
    forward_kinematics(&arm.chain, q, kinematics);
    let error = offset(&kinematics.tool_pose(), goal, moved);
    [error.fixed_rows::<3>(0).norm(), error.fixed_rows::<3>(3).norm()]
}
