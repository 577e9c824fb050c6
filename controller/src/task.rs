//! The course of a task: the skill, then, once the gripper holds, the lift.

use glam::DVec3;
use tprmp_messages::{GripperCommand, GripperState, LifeCycle};
use tprmp_model::controller_config::{Done, Lift};
use tprmp_rmpflow::frame_map::Pose;

use crate::policy::Task;

/// Where the task stands.
#[derive(Debug, Clone, Copy)]
pub struct Course {
    lift: Option<Lift>,
    done: Done,
    /// Whether the skill has a say in the orientation.
    turns: bool,
    stage: Stage,
    gripper: GripperCommand,
}

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
    /// Between two poses.
    #[must_use]
    pub fn between(tool: &Pose, goal: &Pose) -> Self {
        Self {
            distance_m: (tool.position - goal.position).length(),
            angle_rad: tool.rotation_from(goal).length(),
        }
    }
}

impl Course {
    /// A task that begins with its skill; `turns` when that skill leads the orientation too.
    #[must_use]
    pub fn new(lift: Option<Lift>, done: Done, turns: bool) -> Self {
        Self { lift, done, turns, stage: Stage::Skill, gripper: GripperCommand::Release }
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

    /// Moves on: from the skill to the lift when the gripper holds, and back when it has lost the
    /// object. Returns the life cycle and what remains to the present goal.
    pub fn advance(
        &mut self,
        gripper: GripperState,
        tool: &Pose,
        skill_goal: &Pose,
    ) -> (LifeCycle, Remaining) {
        self.stage = match (self.stage, self.lift, gripper) {
            (Stage::Skill, Some(lift), GripperState::Holding) => {
                let position = tool.position + DVec3::Z * lift.height_m;
                Stage::Lift { goal: Pose { position, ..*tool } }
            }
            (Stage::Lift { .. }, _, GripperState::Open | GripperState::None) => Stage::Skill,
            (stage, ..) => stage,
        };
        let (goal, underway) = match &self.stage {
            Stage::Skill => (skill_goal, LifeCycle::Running),
            Stage::Lift { goal } => (goal, LifeCycle::Lifting),
        };
        let mut remaining = Remaining::between(tool, goal);
        if !self.turns {
            remaining.angle_rad = 0.0;
        }
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
        (if arrived && last { LifeCycle::Done } else { underway }, remaining)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    const DONE: Done = Done { distance_m: 0.01, angle_rad: 0.05 };
    const LIFT: Lift = Lift {
        grip_distance_m: 0.005,
        grip_angle_rad: 0.05,
        height_m: 0.1,
        linear_inertia_kg: 1.0,
        angular_inertia_kg_m2: 0.1,
        stiffness_1_s2: 30.0,
        damping_1_s: 10.0,
        saturation_m: 0.05,
    };

    fn at(x: f64, z: f64) -> Pose {
        Pose { position: DVec3::new(x, 0.0, z), orientation: DQuat::IDENTITY }
    }

    #[test]
    fn a_pick_lifts_once_the_gripper_holds_and_starts_over_when_it_loses_the_object() {
        let mut course = Course::new(Some(LIFT), DONE, true);
        let goal = at(0.5, 0.0);
        let step = |course: &mut Course, gripper, tool| course.advance(gripper, &tool, &goal).0;
        assert_eq!(step(&mut course, GripperState::Open, at(0.4, 0.0)), LifeCycle::Running);
        assert_eq!(course.gripper(), GripperCommand::Release, "far from the goal");
        assert_eq!(step(&mut course, GripperState::Open, at(0.5, 0.0)), LifeCycle::Running);
        assert_eq!(course.gripper(), GripperCommand::Grip, "at the goal");
        assert_eq!(step(&mut course, GripperState::Holding, at(0.5, 0.0)), LifeCycle::Lifting);
        assert_eq!(step(&mut course, GripperState::Holding, at(0.5, 0.05)), LifeCycle::Lifting);
        assert_eq!(step(&mut course, GripperState::Holding, at(0.5, 0.099)), LifeCycle::Done);
        assert!(matches!(course.task(), Task::Reach(p) if (p.position.z - 0.1).abs() < 1e-12));
        assert_eq!(course.gripper(), GripperCommand::Grip, "while it lifts");
        assert_eq!(step(&mut course, GripperState::Open, at(0.5, 0.09)), LifeCycle::Running);
        assert_eq!(course.gripper(), GripperCommand::Release, "the object is lost");
    }

    #[test]
    fn without_a_lift_the_skill_s_goal_is_the_task() {
        let mut course = Course::new(None, DONE, false);
        let (cycle, remaining) = course.advance(GripperState::None, &at(0.3, 0.0), &at(0.5, 0.0));
        assert_eq!(cycle, LifeCycle::Running);
        assert!((remaining.distance_m - 0.2).abs() < 1e-12);
        // A skill of positions does not wait for an orientation.
        let goal = Pose { orientation: DQuat::from_rotation_z(1.0), ..at(0.5, 0.0) };
        let (cycle, _) = course.advance(GripperState::None, &at(0.495, 0.0), &goal);
        assert_eq!(cycle, LifeCycle::Done);
        assert_eq!(course.gripper(), GripperCommand::Release);
    }
}
