//! The state of a task: the skill, then, once the gripper holds, the lift.

use glam::DVec3;
use nalgebra::Vector6;
use tprmp_messages::{GripperCommand, GripperState, LifeCycle, Reason};
use tprmp_model::controller_config::{Done, Lift};
use tprmp_spatial::Pose;

use crate::control::journal::Entry;
use crate::policy::Task;

/// Where the task stands.
#[derive(Debug, Clone, Copy)]
pub struct TaskState {
    lift: Option<Lift>,
    done: Done,
    /// Whether the skill acts on the orientation too.
    /// Which coordinates of the tool the skill moves, displacement before rotation: 1, or 0.
    moved: Vector6<f64>,
    /// Whether it goes round, and never ends by itself.
    is_periodic: bool,
    stage: Stage,
    gripper: GripperCommand,
    /// The gripper held something before the task began, that nobody is known to have gripped.
    found_holding: bool,
    /// For how long the gripper has not held what is being lifted \[s\].
    lost_s: f64,
    life_cycle: LifeCycle,
    /// Since when the task has been done \[ns\].
    done_since_ns: Option<u64>,
}

/// A gripper that reports nothing held for less than this has not lost the object \[s\].
const LOST_S: f64 = 0.1;

#[derive(Debug, Clone, Copy)]
enum Stage {
    Skill,
    Lift { goal: Pose },
}

/// Distance of a tool from its goal.
#[derive(Debug, Clone, Copy)]
pub struct Remaining {
    /// \[m\]
    pub distance_m: f64,
    /// \[rad\]
    pub angle_rad: f64,
}

impl Remaining {
    /// Between two poses, in the coordinates that are decided about, displacement before rotation: 1, or 0.
    #[must_use]
    pub fn between(tool: &Pose, goal: &Pose, decided: &Vector6<f64>) -> Self {
        let part =
            |first: usize| DVec3::new(decided[first], decided[first + 1], decided[first + 2]);
        Self {
            distance_m: ((tool.position - goal.position) * part(0)).length(),
            angle_rad: (tool.rotation_from(goal) * part(3)).length(),
        }
    }
}

impl TaskState {
    /// A task that begins with its skill.
    ///
    /// * `moved`  which coordinates of the tool that skill moves, displacement before rotation: 1, or 0
    #[must_use]
    pub fn new(lift: Option<Lift>, done: Done, moved: Vector6<f64>) -> Self {
        Self {
            lift,
            done,
            moved,
            is_periodic: false,
            stage: Stage::Skill,
            gripper: GripperCommand::Release,
            found_holding: false,
            lost_s: 0.0,
            life_cycle: LifeCycle::Waiting,
            done_since_ns: None,
        }
    }

    /// Begins with what the gripper senses before the first command, and what the controller before this one
    /// was doing where it did not end by itself. An object that is held is not let go: where it was gripped
    /// by that controller, its lift goes on.
    pub fn begin(&mut self, gripper: GripperState, last: Option<&Entry>) {
        let gripped = last.filter(|entry| entry.gripping);
        if self.lift.is_none() || (gripper != GripperState::Holding && gripped.is_none()) {
            return;
        }
        self.gripper = GripperCommand::Grip;
        match gripped {
            Some(entry) => {
                // Gripped, but not yet noted where to: the first tick says.
                self.stage = entry.goal().map_or(Stage::Skill, |goal| Stage::Lift { goal });
            }
            None => self.found_holding = true,
        }
    }

    /// Whether what the gripper senses, `dt` \[s\] after it was asked the last time, lets the task go on.
    ///
    /// # Errors
    /// When it holds something that nobody is known to have gripped, or there is none and the task grips.
    pub fn check_gripper(&mut self, gripper: GripperState, dt: f64) -> Result<(), Reason> {
        if self.lift.is_some() && gripper == GripperState::None {
            return Err(Reason::GripperNone);
        }
        if !self.found_holding {
            return Ok(());
        }
        self.lost_s = if gripper == GripperState::Holding { 0.0 } else { self.lost_s + dt };
        if self.lost_s <= LOST_S {
            return Err(Reason::GripperHolds);
        }
        (self.found_holding, self.gripper) = (false, GripperCommand::Release);
        Ok(())
    }

    /// The policy is not followed, or another one: from when on the task is done is judged anew.
    pub fn interrupt(&mut self) {
        self.done_since_ns = None;
    }

    /// Whether the gripper was asked to grip and what it grips is not yet lifted.
    #[must_use]
    pub fn awaits_gripper(&self) -> bool {
        matches!(self.stage, Stage::Skill) && self.gripper == GripperCommand::Grip
    }

    /// Where what the gripper holds is lifted to.
    #[must_use]
    pub fn lift_goal(&self) -> Option<&Pose> {
        match &self.stage {
            Stage::Skill => None,
            Stage::Lift { goal } => Some(goal),
        }
    }

    /// The skill may be another one from now on.
    ///
    /// * `moved`  which coordinates of the tool it moves
    /// * `is_periodic`  whether it goes round: the task is never done
    pub fn set_skill(&mut self, moved: Vector6<f64>, is_periodic: bool) {
        (self.moved, self.is_periodic) = (moved, is_periodic);
    }

    /// What the tool should do now.
    #[must_use]
    pub fn task(&self) -> Task {
        match self.stage {
            Stage::Skill => Task::Skill,
            Stage::Lift { goal } => Task::Reach(goal),
        }
    }

    /// What the gripper should do.
    #[must_use]
    pub fn gripper(&self) -> GripperCommand {
        self.gripper
    }

    /// Where the task stood when the policy was followed the last time.
    #[must_use]
    pub fn life_cycle(&self) -> LifeCycle {
        self.life_cycle
    }

    /// For how long the task has been done at the time `now_ns`; 0 when it is not \[ns\].
    #[must_use]
    pub fn done_for_ns(&self, now_ns: u64) -> u64 {
        self.done_since_ns.map_or(0, |since_ns| now_ns.saturating_sub(since_ns))
    }

    /// Updates the state after `dt` \[s\], at the time `now_ns` \[ns\]: from the skill to the lift when the gripper was asked to grip and
    /// holds, and back when it has lost the object. Returns the life cycle and what remains to the present goal.
    pub fn advance(
        &mut self,
        gripper: GripperState,
        tool: &Pose,
        skill_goal: &Pose,
        now_ns: u64,
        dt: f64,
    ) -> (LifeCycle, Remaining) {
        let holding = gripper == GripperState::Holding;
        self.lost_s = if holding { 0.0 } else { self.lost_s + dt };
        let asked = self.gripper == GripperCommand::Grip;
        self.stage = match (self.stage, self.lift) {
            (Stage::Skill, Some(lift)) if holding && asked => {
                let position = tool.position + DVec3::Z * lift.height_m;
                Stage::Lift { goal: Pose { position, ..*tool } }
            }
            (Stage::Lift { .. }, _) if self.lost_s > LOST_S => Stage::Skill,
            (stage, _) => stage,
        };
        let (goal, underway) = match &self.stage {
            Stage::Skill => (skill_goal, LifeCycle::Running),
            Stage::Lift { goal } => (goal, LifeCycle::Lifting),
        };
        let mut decided = self.moved;
        if matches!(self.stage, Stage::Lift { .. }) {
            decided.fixed_rows_mut::<3>(0).fill(1.0);
        }
        let remaining = Remaining::between(tool, goal, &decided);
        self.gripper = match (&self.stage, &self.lift) {
            (Stage::Lift { .. }, _) => GripperCommand::Grip,
            (Stage::Skill, Some(lift))
                if remaining.distance_m < lift.grip_distance_m
                    && remaining.angle_rad < lift.grip_angle_rad =>
            {
                GripperCommand::Grip
            }
            _ => GripperCommand::Release,
        };
        let arrived = remaining.distance_m < self.done.distance_m
            && remaining.angle_rad < self.done.angle_rad;
        // With a gripper, reaching the skill's goal is not yet the task.
        let last = self.lift.is_none() || matches!(self.stage, Stage::Lift { .. });
        let ends = !self.is_periodic || matches!(self.stage, Stage::Lift { .. });
        self.life_cycle = if arrived && last && ends { LifeCycle::Done } else { underway };
        self.done_since_ns =
            (self.life_cycle == LifeCycle::Done).then(|| self.done_since_ns.unwrap_or(now_ns));
        (self.life_cycle, remaining)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use tprmp_rmpflow::leaves::PoseAttractor;

    const DONE: Done = Done { distance_m: 0.01, angle_rad: 0.05 };
    const LIFT: Lift = Lift {
        grip_distance_m: 0.005,
        grip_angle_rad: 0.05,
        height_m: 0.1,
        attractor: PoseAttractor {
            linear_inertia_kg: 1.0,
            angular_inertia_kg_m2: 0.1,
            stiffness_1_s2: 30.0,
            damping_1_s: 10.0,
            saturation_m: 0.05,
        },
    };

    fn at(x: f64, z: f64) -> Pose {
        Pose { position: DVec3::new(x, 0.0, z), orientation: DQuat::IDENTITY }
    }

    #[test]
    fn a_pick_lifts_once_the_gripper_holds_and_starts_over_when_it_loses_the_object() {
        let mut task = TaskState::new(Some(LIFT), DONE, Vector6::repeat(1.0));
        let goal = at(0.5, 0.0);
        let step =
            |task: &mut TaskState, gripper, tool| task.advance(gripper, &tool, &goal, 0, 0.06).0;
        assert_eq!(step(&mut task, GripperState::Open, at(0.4, 0.0)), LifeCycle::Running);
        assert_eq!(task.gripper(), GripperCommand::Release, "far from the goal");
        assert_eq!(step(&mut task, GripperState::Open, at(0.5, 0.0)), LifeCycle::Running);
        assert_eq!(task.gripper(), GripperCommand::Grip, "at the goal");
        assert_eq!(step(&mut task, GripperState::Holding, at(0.5, 0.0)), LifeCycle::Lifting);
        assert_eq!(step(&mut task, GripperState::Holding, at(0.5, 0.05)), LifeCycle::Lifting);
        assert_eq!(step(&mut task, GripperState::Holding, at(0.5, 0.099)), LifeCycle::Done);
        assert!(matches!(task.task(), Task::Reach(p) if (p.position.z - 0.1).abs() < 1e-12));
        assert_eq!(task.gripper(), GripperCommand::Grip, "while it lifts");
        assert_eq!(step(&mut task, GripperState::Open, at(0.5, 0.09)), LifeCycle::Lifting);
        assert_eq!(task.gripper(), GripperCommand::Grip, "one report is not yet a loss");
        assert_eq!(step(&mut task, GripperState::Open, at(0.5, 0.09)), LifeCycle::Running);
        assert_eq!(task.gripper(), GripperCommand::Release, "the object is lost");
    }

    #[test]
    fn a_gripper_that_was_not_asked_lifts_nothing_and_one_that_holds_at_the_start_is_reported() {
        let (tool, goal) = (at(0.3, 0.2), at(0.5, 0.0));
        let mut task = TaskState::new(Some(LIFT), DONE, Vector6::repeat(1.0));
        task.begin(GripperState::Open, None);
        let (cycle, _) = task.advance(GripperState::Holding, &tool, &goal, 0, 0.001);
        assert_eq!((cycle, task.gripper()), (LifeCycle::Running, GripperCommand::Release));
        // Whose grip it is nobody knows: it is kept, and reported.
        let mut task = TaskState::new(Some(LIFT), DONE, Vector6::repeat(1.0));
        task.begin(GripperState::Holding, None);
        assert_eq!(task.gripper(), GripperCommand::Grip);
        let holds = Err(Reason::GripperHolds);
        assert_eq!(task.check_gripper(GripperState::Holding, 0.06), holds);
        assert_eq!(task.gripper(), GripperCommand::Grip);
        assert_eq!(task.check_gripper(GripperState::Open, 0.06), holds, "not yet a loss");
        assert_eq!(task.check_gripper(GripperState::Open, 0.06), Ok(()), "somebody took it out");
        assert_eq!(task.gripper(), GripperCommand::Release);
    }

    #[test]
    fn a_controller_that_is_started_again_in_mid_lift_goes_on_with_it() {
        let (tool, goal) = (at(0.5, 0.04), at(0.5, 0.0));
        let last = Entry { gripping: true, lift_goal: Some([0.5, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0]) };
        let mut task = TaskState::new(Some(LIFT), DONE, Vector6::repeat(1.0));
        task.begin(GripperState::Holding, Some(&last));
        assert_eq!(task.check_gripper(GripperState::Holding, 0.001), Ok(()));
        let (cycle, remaining) = task.advance(GripperState::Holding, &tool, &goal, 0, 0.001);
        assert_eq!((cycle, task.gripper()), (LifeCycle::Lifting, GripperCommand::Grip));
        assert!((remaining.distance_m - 0.06).abs() < 1e-12, "to where it was being lifted");
        // It had gripped, and had not noted a goal yet: the whole lift, from here.
        let last = Entry { gripping: true, lift_goal: None };
        let mut task = TaskState::new(Some(LIFT), DONE, Vector6::repeat(1.0));
        task.begin(GripperState::Holding, Some(&last));
        let (cycle, remaining) = task.advance(GripperState::Holding, &tool, &goal, 0, 0.001);
        assert_eq!(cycle, LifeCycle::Lifting);
        assert!((remaining.distance_m - 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_task_that_goes_round_is_never_done() {
        let mut task = TaskState::new(None, DONE, Vector6::repeat(1.0));
        task.set_skill(Vector6::repeat(1.0), true);
        for now_ns in [0, 1, 2_000_000_000] {
            let here = at(0.5, 0.0);
            let (cycle, remaining) = task.advance(GripperState::None, &here, &here, now_ns, 0.001);
            assert_eq!((cycle, task.done_for_ns(now_ns)), (LifeCycle::Running, 0));
            assert_eq!(remaining.distance_m, 0.0, "on its path");
        }
        task.set_skill(Vector6::repeat(1.0), false);
        let (cycle, _) = task.advance(GripperState::None, &at(0.5, 0.0), &at(0.5, 0.0), 3, 0.001);
        assert_eq!(cycle, LifeCycle::Done);
    }

    #[test]
    fn without_a_lift_the_skill_s_goal_is_the_task() {
        let mut task = TaskState::new(None, DONE, Vector6::new(1.0, 1.0, 1.0, 0.0, 0.0, 0.0));
        let (cycle, remaining) =
            task.advance(GripperState::None, &at(0.3, 0.0), &at(0.5, 0.0), 0, 0.001);
        assert_eq!(cycle, LifeCycle::Running);
        assert!((remaining.distance_m - 0.2).abs() < 1e-12);
        // A skill of positions does not wait for an orientation.
        let goal = Pose { orientation: DQuat::from_rotation_z(1.0), ..at(0.5, 0.0) };
        let (cycle, _) = task.advance(GripperState::None, &at(0.495, 0.0), &goal, 0, 0.001);
        assert_eq!(cycle, LifeCycle::Done);
        assert_eq!(task.gripper(), GripperCommand::Release);
    }
}
