//! Why a task makes no progress: the arm stands still short of its goal, or creeps along an obstacle.

use tprmp_messages::{LifeCycle, Reason};

/// The arm stands still when no joint is faster than this [rad/s or m/s] …
const SPEED_MAX: f64 = 0.01;
/// … for so long [s].
const DURATION_S: f64 = 1.0;
/// An arm that moves makes no headway when the distance to its goal changes by this fraction of it or less …
const HEADWAY_FRACTION: f64 = 0.2;
/// … for so long [s]; far from obstacles, when the energy of its skills does so as well, and their goal
/// rests: an arm may go round its goal, or follow it.
const HEADWAY_S: f64 = 3.0;
/// A goal rests that is slower than this [m/s].
const GOAL_REST_M_S: f64 = 0.01;
/// An arm that makes no headway presses on an obstacle when at least this fraction of the velocity it
/// wants leads into one …
const OBSTRUCTED_MIN: f64 = 0.02;
/// … or when it is as close as this to one, or to itself, beyond the margins [m].
const CLEARANCE_MIN_M: f64 = 0.01;

/// What the arm is near to.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings {
    /// Fraction of the wanted velocity that leads into an obstacle.
    pub obstructed_fraction: f64,
    /// Least clearance from obstacles and from itself \[m\].
    pub clearance_min_m: f64,
}

/// How the arm moves, and what is left to do.
#[derive(Debug, Clone, Copy)]
pub struct Headway {
    /// Speed of the fastest joint \[rad/s or m/s\].
    pub speed: f64,
    /// Distance to the goal \[m\].
    pub distance_m: f64,
    /// V of the skills \[J\].
    pub energy: f64,
    /// Speed of the goal \[m/s\].
    pub goal_speed_m_s: f64,
}

/// For how long the arm has stood still or made no headway.
#[derive(Debug, Clone, Copy, Default)]
pub struct Standstill {
    /// \[s\]
    still_s: f64,
    distance: Stagnation,
    energy: Stagnation,
}

/// For how long something has been about the same.
#[derive(Debug, Clone, Copy, Default)]
struct Stagnation {
    since_s: f64,
    value: f64,
}

impl Stagnation {
    /// Takes in a value; begins anew where it has changed, or where it is not `watched`. Returns
    /// whether it has been about the same for long.
    fn advance(&mut self, value: f64, watched: bool, dt: f64) -> bool {
        if watched && (value - self.value).abs() <= HEADWAY_FRACTION * self.value.abs() {
            self.since_s += dt;
        } else {
            *self = Self { since_s: 0.0, value };
        }
        self.since_s > HEADWAY_S
    }
}

impl Standstill {
    /// Takes in a tick of `dt` \[s\]. Of an arm that is `led` from outside it is not known whether it
    /// could get on by itself: it may stand before an obstacle, and nothing else.
    ///
    /// [`Reason::Blocked`] or [`Reason::Unreachable`] when a task that is under way does not get on,
    /// else [`Reason::None`]. The policy is followed all the while: once the obstacle or the goal
    /// moves, the arm does.
    pub fn advance(
        &mut self,
        life_cycle: LifeCycle,
        headway: &Headway,
        surroundings: &Surroundings,
        led: bool,
        dt: f64,
    ) -> Reason {
        let blocked = surroundings.obstructed_fraction > OBSTRUCTED_MIN
            || surroundings.clearance_min_m < CLEARANCE_MIN_M;
        let under_way = matches!(life_cycle, LifeCycle::Running | LifeCycle::Lifting);
        let still = under_way && headway.speed < SPEED_MAX && (blocked || !led);
        self.still_s = if still { self.still_s + dt } else { 0.0 };
        let still = self.still_s > DURATION_S;
        let creeps = self.distance.advance(headway.distance_m, under_way && !led, dt);
        let rests = headway.goal_speed_m_s < GOAL_REST_M_S;
        let stagnates = self.energy.advance(headway.energy, under_way && !led && rests, dt);
        if blocked && (still || creeps) {
            Reason::Blocked
        } else if !blocked && (still || (creeps && stagnates)) {
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
    fn headway(speed: f64, distance_m: f64) -> Headway {
        Headway { speed, distance_m, energy: 1.0, goal_speed_m_s: 0.1 }
    }

    #[test]
    fn an_arm_that_stands_still_short_of_its_goal_is_blocked_or_out_of_reach() {
        let free = Surroundings { obstructed_fraction: 0.0, clearance_min_m: f64::INFINITY };
        let against = Surroundings { obstructed_fraction: 0.5, ..free };
        let close = Surroundings { clearance_min_m: 0.001, ..free };
        let after = |life_cycle, speed, surroundings: &Surroundings| {
            let mut standstill = Standstill::default();
            (0..1500)
                .map(|_| {
                    standstill.advance(life_cycle, &headway(speed, 0.2), surroundings, false, 0.001)
                })
                .last()
        };
        assert_eq!(after(LifeCycle::Running, 0.0, &free), Some(Reason::Unreachable));
        assert_eq!(after(LifeCycle::Running, 0.0, &against), Some(Reason::Blocked));
        assert_eq!(after(LifeCycle::Lifting, 0.0, &close), Some(Reason::Blocked));
        assert_eq!(after(LifeCycle::Running, 0.1, &against), Some(Reason::None));
        assert_eq!(after(LifeCycle::Done, 0.0, &free), Some(Reason::None));
        let mut standstill = Standstill::default();
        assert_eq!(
            standstill.advance(LifeCycle::Running, &headway(0.0, 0.2), &free, false, 0.9),
            Reason::None
        );
        assert_eq!(
            standstill.advance(LifeCycle::Running, &headway(0.2, 0.2), &free, false, 0.9),
            Reason::None
        );
        assert_eq!(
            standstill.advance(LifeCycle::Running, &headway(0.0, 0.2), &free, false, 0.9),
            Reason::None
        );
        assert_eq!(
            standstill.advance(LifeCycle::Running, &headway(0.0, 0.2), &free, false, 0.9),
            Reason::Unreachable
        );
    }

    #[test]
    fn an_arm_that_creeps_along_an_obstacle_is_blocked_until_it_gets_on() {
        let free = Surroundings { obstructed_fraction: 0.0, clearance_min_m: f64::INFINITY };
        let against = Surroundings { obstructed_fraction: 0.5, ..free };
        let after = |seconds: usize, fraction: f64, surroundings: &Surroundings| {
            let mut standstill = Standstill::default();
            let mut distance = 0.2;
            let mut reason = Reason::None;
            for _ in 0..seconds * 100 {
                distance *= fraction.powf(0.01);
                reason = standstill.advance(
                    LifeCycle::Running,
                    &headway(0.05, distance),
                    surroundings,
                    false,
                    0.01,
                );
            }
            reason
        };
        assert_eq!(after(5, 0.99, &against), Reason::Blocked);
        assert_eq!(after(2, 0.99, &against), Reason::None, "not yet");
        assert_eq!(after(5, 0.8, &against), Reason::None, "it gets on");
        assert_eq!(after(5, 1.2, &against), Reason::None, "the goal moves away");
        assert_eq!(after(5, 0.99, &free), Reason::None, "it follows what moves");
    }

    #[test]
    fn an_arm_that_is_led_is_blocked_by_obstacles_only() {
        let free = Surroundings { obstructed_fraction: 0.0, clearance_min_m: f64::INFINITY };
        let against = Surroundings { obstructed_fraction: 0.5, ..free };
        let mut standstill = Standstill::default();
        let mut advance = |surroundings, speed, led| {
            standstill.advance(LifeCycle::Running, &headway(speed, 0.2), surroundings, led, 0.9)
        };
        for _ in 0..9 {
            assert_eq!(advance(&free, 0.0, true), Reason::None, "it is held");
            assert_eq!(advance(&against, 0.1, true), Reason::None, "it is led along");
        }
        assert_eq!(advance(&free, 0.0, false), Reason::None, "just let go");
        assert_eq!(advance(&free, 0.0, false), Reason::Unreachable);
        assert_eq!(advance(&free, 0.0, true), Reason::None);
        assert_eq!(advance(&against, 0.0, true), Reason::None);
        assert_eq!(advance(&against, 0.0, true), Reason::Blocked, "it is led into an obstacle");
    }

    #[test]
    fn an_arm_that_drifts_while_its_goal_rests_is_told_to_be_out_of_reach() {
        let free = Surroundings { obstructed_fraction: 0.0, clearance_min_m: f64::INFINITY };
        let after = |goal_speed_m_s: f64, energy: f64, seconds: usize| {
            let mut standstill = Standstill::default();
            let mut headway = Headway { speed: 0.1, distance_m: 0.2, energy: 1.0, goal_speed_m_s };
            let mut reason = Reason::None;
            for _ in 0..seconds * 100 {
                headway.energy *= energy.powf(0.01);
                reason = standstill.advance(LifeCycle::Running, &headway, &free, false, 0.01);
            }
            reason
        };
        assert_eq!(after(0.0, 0.99, 4), Reason::Unreachable);
        assert_eq!(after(0.0, 0.99, 2), Reason::None, "not yet");
        assert_eq!(after(0.0, 0.9, 9), Reason::None, "it goes round its goal and gets on");
        assert_eq!(after(0.1, 0.99, 9), Reason::None, "it follows its goal");
    }
}
