//! Why a task makes no progress: the arm stands still short of its goal, or creeps along an obstacle.

use tprmp_messages::{LifeCycle, Reason};
use tprmp_rmpflow::leaves::Proximity;

/// The arm stands still when no joint is faster than this \[rad/s or m/s\] …
const SPEED_MAX: f64 = 0.01;
/// … for so long \[s\].
const DURATION_S: f64 = 1.0;
/// An arm that moves makes no progress when the distance to its goal changes by this fraction of it or less …
const PROGRESS_FRACTION: f64 = 0.2;
/// … for so long \[s\]; far from obstacles, when the energy of its skills does so as well, and their goal
/// rests: an arm may go round its goal, or follow it.
const PROGRESS_S: f64 = 3.0;
/// A skill that goes round makes no progress when it goes on by this fraction of a round or less in that time: the
/// slowest ones that can be demonstrated are three times as fast.
const ROUND_FRACTION: f64 = 0.003;
/// A goal rests that is slower than this \[m/s\].
const GOAL_REST_M_S: f64 = 0.01;
/// An arm that makes no progress is blocked when at least this fraction of its desired velocity is
/// obstructed …
const OBSTRUCTED_MIN: f64 = 0.02;
/// … or when its clearance from an obstacle, or from itself, is less, margins taken off \[m\].
const CLEARANCE_MIN_M: f64 = 0.01;

/// How the arm moves, and what is left to do.
#[derive(Debug, Clone, Copy)]
pub struct Progress {
    /// Speed of the fastest joint \[rad/s or m/s\].
    pub speed: f64,
    /// Distance to the goal \[m\].
    pub distance_m: f64,
    /// How far a skill that goes round has come \[rounds\]; `None` for one that goes to a goal.
    pub rounds: Option<f64>,
    /// V of the skills \[J\].
    pub energy: f64,
    /// Speed of the goal \[m/s\].
    pub goal_speed_m_s: f64,
    /// Whether the arm is at the goal, and the gripper was asked to grip and does not hold.
    pub awaits_gripper: bool,
}

/// For how long the arm has stood still or made no progress.
#[derive(Debug, Clone, Copy, Default)]
pub struct StallDetector {
    /// \[s\]
    still_s: f64,
    distance: Unchanged,
    energy: Unchanged,
    rounds: Unchanged,
}

/// For how long something has been about the same.
#[derive(Debug, Clone, Copy, Default)]
struct Unchanged {
    since_s: f64,
    value: f64,
}

impl Unchanged {
    /// Updates with a value; begins anew where it has changed, or where it is not `watched`. Returns
    /// whether it has been about the same for long.
    fn update(&mut self, value: f64, watched: bool, dt: f64) -> bool {
        self.update_within(value, PROGRESS_FRACTION * self.value.abs(), watched, dt)
    }

    /// The same for what has changed by more than so much.
    fn update_within(&mut self, value: f64, most: f64, watched: bool, dt: f64) -> bool {
        if watched && (value - self.value).abs() <= most {
            self.since_s += dt;
        } else {
            *self = Self { since_s: 0.0, value };
        }
        self.since_s > PROGRESS_S
    }
}

impl StallDetector {
    /// Updates with a tick of `dt` \[s\]. Of an arm that is externally commanded it is not known whether
    /// it would make progress by itself: it can only be blocked.
    ///
    /// [`Reason::Blocked`], [`Reason::Unreachable`] or, at the goal, [`Reason::GripperAwaited`] when a task that is under way makes no progress,
    /// else [`Reason::None`]. The policy is followed all the while: once the obstacle or the goal
    /// moves, the arm does.
    pub fn update(
        &mut self,
        life_cycle: LifeCycle,
        progress: &Progress,
        proximity: &Proximity,
        externally_commanded: bool,
        dt: f64,
    ) -> Reason {
        let blocked = proximity.obstructed_fraction > OBSTRUCTED_MIN
            || proximity.clearance_min_m < CLEARANCE_MIN_M;
        let under_way = matches!(life_cycle, LifeCycle::Running | LifeCycle::Lifting);
        let still = under_way && progress.speed < SPEED_MAX && (blocked || !externally_commanded);
        self.still_s = if still { self.still_s + dt } else { 0.0 };
        let still = self.still_s > DURATION_S;
        let watched = under_way && !externally_commanded;
        let creeps = self.distance.update(progress.distance_m, watched, dt);
        let rests = progress.goal_speed_m_s < GOAL_REST_M_S;
        let stagnates = self.energy.update(progress.energy, watched && rests, dt);
        let (creeps, stagnates) = match progress.rounds {
            None => (creeps, stagnates),
            Some(rounds) => {
                let stays = self.rounds.update_within(rounds, ROUND_FRACTION, watched, dt);
                (stays, stays)
            }
        };
        let stands = still || (creeps && stagnates);
        if stands && progress.awaits_gripper {
            Reason::GripperAwaited
        } else if blocked && (still || creeps) {
            Reason::Blocked
        } else if !blocked && stands {
            Reason::Unreachable
        } else {
            Reason::None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A goal that moves.
    fn progress(speed: f64, distance_m: f64) -> Progress {
        Progress {
            speed,
            distance_m,
            rounds: None,
            energy: 1.0,
            goal_speed_m_s: 0.1,
            awaits_gripper: false,
        }
    }

    #[test]
    fn an_arm_that_stands_still_short_of_its_goal_is_blocked_or_out_of_reach() {
        let free = Proximity::NONE;
        let against = Proximity { obstructed_fraction: 0.5, ..free };
        let close = Proximity { clearance_min_m: 0.001, ..free };
        let after = |life_cycle, speed, proximity: &Proximity| {
            let mut detector = StallDetector::default();
            (0..1500)
                .map(|_| {
                    detector.update(life_cycle, &progress(speed, 0.2), proximity, false, 0.001)
                })
                .last()
        };
        assert_eq!(after(LifeCycle::Running, 0.0, &free), Some(Reason::Unreachable));
        assert_eq!(after(LifeCycle::Running, 0.0, &against), Some(Reason::Blocked));
        assert_eq!(after(LifeCycle::Lifting, 0.0, &close), Some(Reason::Blocked));
        assert_eq!(after(LifeCycle::Running, 0.1, &against), Some(Reason::None));
        assert_eq!(after(LifeCycle::Done, 0.0, &free), Some(Reason::None));
        let mut detector = StallDetector::default();
        assert_eq!(
            detector.update(LifeCycle::Running, &progress(0.0, 0.2), &free, false, 0.9),
            Reason::None
        );
        assert_eq!(
            detector.update(LifeCycle::Running, &progress(0.2, 0.2), &free, false, 0.9),
            Reason::None
        );
        assert_eq!(
            detector.update(LifeCycle::Running, &progress(0.0, 0.2), &free, false, 0.9),
            Reason::None
        );
        assert_eq!(
            detector.update(LifeCycle::Running, &progress(0.0, 0.2), &free, false, 0.9),
            Reason::Unreachable
        );
    }

    #[test]
    fn at_the_goal_it_is_the_gripper_that_is_waited_for() {
        let close = Proximity { clearance_min_m: 0.001, ..Proximity::NONE };
        for proximity in [Proximity::NONE, close] {
            let mut detector = StallDetector::default();
            let at_goal = Progress { awaits_gripper: true, ..progress(0.0, 0.001) };
            let mut after =
                || detector.update(LifeCycle::Running, &at_goal, &proximity, false, 0.6);
            assert_eq!([after(), after()], [Reason::None, Reason::GripperAwaited]);
        }
    }

    #[test]
    fn an_arm_that_creeps_along_an_obstacle_is_blocked_until_it_makes_progress() {
        let free = Proximity::NONE;
        let against = Proximity { obstructed_fraction: 0.5, ..free };
        let after = |seconds: usize, fraction: f64, proximity: &Proximity| {
            let mut detector = StallDetector::default();
            let mut distance = 0.2;
            let mut reason = Reason::None;
            for _ in 0..seconds * 100 {
                distance *= fraction.powf(0.01);
                reason = detector.update(
                    LifeCycle::Running,
                    &progress(0.05, distance),
                    proximity,
                    false,
                    0.01,
                );
            }
            reason
        };
        assert_eq!(after(5, 0.99, &against), Reason::Blocked);
        assert_eq!(after(2, 0.99, &against), Reason::None, "not yet");
        assert_eq!(after(5, 0.8, &against), Reason::None, "it makes progress");
        assert_eq!(after(5, 1.2, &against), Reason::None, "the goal moves away");
        assert_eq!(after(5, 0.99, &free), Reason::None, "it follows what moves");
    }

    #[test]
    fn an_arm_that_goes_round_is_stalled_when_it_goes_on_no_more() {
        let free = Proximity::NONE;
        let close = Proximity { clearance_min_m: 0.001, ..free };
        let after = |period_s: f64, proximity: &Proximity| {
            let mut detector = StallDetector::default();
            let mut reason = Reason::None;
            for tick in 0..3000 {
                // Near its path all the while, and the energy falls on and on.
                let time_s = f64::from(tick) * 0.01;
                let rounds = Some(time_s / period_s);
                let progress = Progress {
                    rounds,
                    energy: 1e3 - time_s,
                    goal_speed_m_s: 0.0,
                    ..progress(0.1, 1e-4)
                };
                reason = detector.update(LifeCycle::Running, &progress, proximity, false, 0.01);
            }
            reason
        };
        for period_s in [0.5, 3.0, 300.0] {
            assert_eq!(after(period_s, &free), Reason::None, "{period_s}");
            assert_eq!(after(period_s, &close), Reason::None, "{period_s}");
        }
        assert_eq!(after(1e6, &free), Reason::Unreachable);
        assert_eq!(after(1e6, &close), Reason::Blocked);
    }

    #[test]
    fn an_externally_commanded_arm_is_blocked_by_obstacles_only() {
        let free = Proximity::NONE;
        let against = Proximity { obstructed_fraction: 0.5, ..free };
        let mut detector = StallDetector::default();
        let mut advance = |proximity, speed, commanded| {
            detector.update(LifeCycle::Running, &progress(speed, 0.2), proximity, commanded, 0.9)
        };
        for _ in 0..9 {
            assert_eq!(advance(&free, 0.0, true), Reason::None, "it is held");
            assert_eq!(advance(&against, 0.1, true), Reason::None, "it is moved along");
        }
        assert_eq!(advance(&free, 0.0, false), Reason::None, "just let go");
        assert_eq!(advance(&free, 0.0, false), Reason::Unreachable);
        assert_eq!(advance(&free, 0.0, true), Reason::None);
        assert_eq!(advance(&against, 0.0, true), Reason::None);
        assert_eq!(
            advance(&against, 0.0, true),
            Reason::Blocked,
            "it is commanded into an obstacle"
        );
    }

    #[test]
    fn an_arm_that_drifts_while_its_goal_rests_is_reported_as_out_of_reach() {
        let free = Proximity::NONE;
        let after = |goal_speed_m_s: f64, energy: f64, seconds: usize| {
            let mut detector = StallDetector::default();
            let mut progress = Progress {
                speed: 0.1,
                distance_m: 0.2,
                rounds: None,
                energy: 1.0,
                goal_speed_m_s,
                awaits_gripper: false,
            };
            let mut reason = Reason::None;
            for _ in 0..seconds * 100 {
                progress.energy *= energy.powf(0.01);
                reason = detector.update(LifeCycle::Running, &progress, &free, false, 0.01);
            }
            reason
        };
        assert_eq!(after(0.0, 0.99, 4), Reason::Unreachable);
        assert_eq!(after(0.0, 0.99, 2), Reason::None, "not yet");
        assert_eq!(after(0.0, 0.9, 9), Reason::None, "it goes round its goal");
        assert_eq!(after(0.1, 0.99, 9), Reason::None, "it follows its goal");
    }
}
