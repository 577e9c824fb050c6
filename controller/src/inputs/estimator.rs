//! Which state of the robot is believed.
//!
//! Position, velocity and time stamp of a state are judged together, against the state that was believed
//! last, by what the joints can do. What is new is told from what is old by sequence and stamp. A state that
//! contradicts the last one is not believed, whatever its numbers: those that follow have to confirm it, for
//! a time. A joint without limits that is reported within a turn is counted on in whole turns.

use nalgebra::SVector;
use tprmp_messages::{Reason, RobotState};

use crate::detail::{About, Detail};
pub use crate::inputs::measured::JointState;
use crate::inputs::measured::Measured;
use crate::inputs::offender;
use crate::inputs::turns::ContinuousJoints;
use crate::inputs::velocity::VelocityWatch;

/// A measured speed beyond this multiple of the joint's limit is not believed.
const SPEED_MULTIPLE_MAX: f64 = 2.0;
/// A joint is believed to reach its largest speed from rest in this time: 40 N on the tool of a UR5 accelerate
/// its wrist by 400 rad/s² \[s\].
const SPEED_UP_S: f64 = 0.005;
/// Noise of a velocity, as a fraction of the largest speed.
const VELOCITY_NOISE: f64 = 0.1;
/// Noise of a position and of its time stamp, as the time in which the largest speed covers it \[s\].
const POSITION_NOISE_S: f64 = 0.01;
/// A contradicting state is believed once states have confirmed it for so long \[ns\] …
const CONFIRMED_NS: u64 = 50_000_000;
/// … and at least so many: a first state too.
const CONFIRMED_BY: u32 = 3;
/// A sequence number that goes back twice within this time has two sources \[ns\].
const AGAIN_NS: u64 = 1_000_000_000;

/// States that agree with each other, but not with the one that is believed.
#[derive(Debug, Clone, Copy)]
struct Candidate<const N: usize> {
    last: Measured<N>,
    since_ns: u64,
    count: u32,
    detail: Detail,
}

/// Judges the robot's states.
#[derive(Debug)]
pub struct StateEstimator<const N: usize> {
    /// Largest speeds of the joints \[rad/s or m/s\].
    speed_max: SVector<f64, N>,
    /// How far a stamp may be from the time of reception \[ns\].
    age_max_ns: u64,
    /// More states that are missing in a row are a fault.
    lost_in_a_row_max: u64,
    continuous: ContinuousJoints<N>,
    believed: Option<Measured<N>>,
    candidate: Option<Candidate<N>>,
    velocities: VelocityWatch<N>,
    /// Of the newest state.
    verdict: Result<(), Detail>,
    /// Hash of the joints' names in order; `None` where it is not compared.
    names: Option<u64>,
    /// The number of the newest state, whatever was thought of it.
    sequence: Option<u64>,
    /// Its stamp \[ns\].
    stamp_ns: Option<u64>,
    /// When the sequence number went back \[ns\].
    went_back_ns: Option<u64>,
    lost: u64,
    /// How many publishers were believed, one after the other.
    publishers: u32,
}

impl<const N: usize> StateEstimator<N> {
    /// No state has arrived yet.
    ///
    /// * `speed_max`  of the robot's description \[rad/s or m/s\]
    /// * `age_max_ns`  how far a stamp may be from the time of reception \[ns\]
    /// * `lost_in_a_row_max`  more missing states in a row are a fault
    #[must_use]
    pub fn new(speed_max: SVector<f64, N>, age_max_ns: u64, lost_in_a_row_max: u64) -> Self {
        Self {
            speed_max,
            age_max_ns,
            lost_in_a_row_max,
            continuous: ContinuousJoints::NONE,
            believed: None,
            candidate: None,
            velocities: VelocityWatch::default(),
            verdict: Err(Detail::plain(Reason::StateStale)),
            names: None,
            sequence: None,
            stamp_ns: None,
            went_back_ns: None,
            lost: 0,
            publishers: 0,
        }
    }

    /// Compares the hash of the joints' names with this one.
    #[must_use]
    pub fn of_joints(self, names_hash: u64) -> Self {
        Self { names: Some(names_hash), ..self }
    }

    /// Counts the turns of these joints.
    #[must_use]
    pub fn counting(self, continuous: ContinuousJoints<N>) -> Self {
        Self { continuous, ..self }
    }

    /// Judges a state that was received at the time `now_ns` \[ns\]. No allocation.
    pub fn update(&mut self, state: &RobotState, now_ns: u64) {
        let before = self.sequence.replace(state.sequence);
        let stamp_before_ns = self.stamp_ns.replace(state.time_ns);
        // The very same message again is no news; but in lockstep each one is new.
        let in_lockstep = now_ns == state.time_ns;
        let same =
            |last: &Measured<N>| (last.sequence, last.time_ns) == (state.sequence, state.time_ns);
        let newest = self.candidate.map(|candidate| candidate.last).or(self.believed);
        if before == Some(state.sequence) && !in_lockstep && newest.as_ref().is_some_and(same) {
            return;
        }
        self.verdict = self.judge(state, now_ns, stamp_before_ns);
        let missing =
            before.map_or(0, |last| state.sequence.saturating_sub(last).saturating_sub(1));
        self.lost = self.lost.saturating_add(missing);
        if self.verdict.is_ok() && missing > self.lost_in_a_row_max {
            let most = self.lost_in_a_row_max as f64;
            let detail = Detail::new(Reason::StatesLost, About::Lost, missing as f64, [most, 0.0]);
            self.verdict = Err(detail);
        }
    }

    /// The joints as measured, where the newest state can be believed at the time `now_ns` \[ns\], and
    /// when they were \[ns\].
    ///
    /// # Errors
    /// Why it cannot be believed.
    pub fn measured(&self, now_ns: u64) -> Result<(JointState<N>, u64), Reason> {
        self.verdict.map_err(|detail| detail.reason)?;
        let Measured { joints, time_ns, .. } = self.believed.ok_or(Reason::StateStale)?;
        if now_ns.abs_diff(time_ns) > self.age_max_ns {
            return Err(Reason::StateStale);
        }
        Ok((joints, time_ns))
    }

    /// Why the newest state cannot be believed at the time `now_ns` \[ns\], with what was seen.
    #[must_use]
    pub fn detail(&self, now_ns: u64) -> Option<Detail> {
        if let Err(detail) = self.verdict {
            return Some(detail);
        }
        let age_ns = now_ns.abs_diff(self.believed?.time_ns);
        let expected = [self.age_max_ns as f64, 0.0];
        let stale = Detail::new(Reason::StateStale, About::Age, age_ns as f64, expected);
        (age_ns > self.age_max_ns).then_some(stale)
    }

    /// Whole turns by which the positions of the state that is believed exceed those that were reported.
    #[must_use]
    pub fn turns(&self) -> SVector<f64, N> {
        self.believed.map_or_else(SVector::zeros, |believed| believed.turns)
    }

    /// How many states are missing between those that arrived, by their numbers.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// How many publishers were believed, one after the other: one that is started again counts from one.
    #[must_use]
    pub fn publishers(&self) -> u32 {
        self.publishers
    }

    fn judge(
        &mut self,
        state: &RobotState,
        now_ns: u64,
        stamp_before_ns: Option<u64>,
    ) -> Result<(), Detail> {
        // What contradicts it, or itself, ends the confirmation of a candidate.
        let candidate = self.candidate.take();
        let checked = state.check(N).map_err(|reason| offender::of_state(state, N, reason))?;
        let [position, velocity] = checked.map(SVector::from_column_slice);
        if self.names.is_some_and(|names| ![0, names].contains(&state.joint_names_hash)) {
            return Err(offender::of_state(state, N, Reason::JointOrder));
        }
        let joints = JointState { position, velocity };
        let now = Measured::new(joints, state.sequence, state.time_ns);
        // A stamp from the future is as wrong as an old one.
        if now_ns.abs_diff(state.time_ns) > self.age_max_ns {
            let stands = stamp_before_ns == Some(state.time_ns) && state.time_ns > 0;
            return Err(if stands {
                now.stuck(state.time_ns)
            } else {
                self.other_clock(&now, now_ns)
            });
        }
        if let Some(i) =
            (0..N).find(|&i| velocity[i].abs() > SPEED_MULTIPLE_MAX * self.speed_max[i])
        {
            let most = SPEED_MULTIPLE_MAX * self.speed_max[i];
            let reason = Reason::StateUnbelievable;
            return Err(Detail::new(reason, About::Speed, velocity[i], [most, 0.0]).at(i));
        }
        let Some(believed) = self.believed else {
            let first = Detail::plain(Reason::StateUnconfirmed);
            return self.confirm(candidate, &now, (first, 0), now_ns);
        };
        let now = now.continuing(&believed, &self.continuous);
        if let Err(detail) = self.follows(&believed, &now) {
            return self.confirm(candidate, &now, (detail, CONFIRMED_NS), now_ns);
        }
        self.accept(&believed, &now);
        self.velocities.find(&self.speed_max).map_or(Ok(()), Err)
    }

    fn other_clock(&self, now: &Measured<N>, now_ns: u64) -> Detail {
        let expected = [now_ns as f64, self.age_max_ns as f64];
        Detail::new(Reason::StateClock, About::Clock, now.time_ns as f64, expected)
    }

    /// Whether the robot can have gone from one state to the other.
    fn follows(&self, last: &Measured<N>, now: &Measured<N>) -> Result<(), Detail> {
        if now.sequence <= last.sequence {
            let reason = if now.sequence == last.sequence {
                Reason::SequenceStuck
            } else {
                Reason::SequenceWentBack
            };
            let expected = [last.sequence as f64, 0.0];
            return Err(Detail::new(reason, About::Sequence, now.sequence as f64, expected));
        }
        if now.time_ns <= last.time_ns {
            return Err(now.stuck(last.time_ns));
        }
        let elapsed_s = now.elapsed_s(last);
        let beside = now.beside(last);
        for i in 0..N {
            let most = self.speed_max[i];
            let [before, velocity] = [last, now].map(|state| state.joints.velocity[i]);
            // It may have sped up in between, by no more than its largest speed, and slowed down again.
            let sped_up_s = elapsed_s.min(SPEED_UP_S);
            let between = 0.25 * most / SPEED_UP_S * sped_up_s * sped_up_s;
            let change_max = most * (VELOCITY_NOISE + sped_up_s / SPEED_UP_S);
            let beside_max = most * POSITION_NOISE_S + between;
            let reason = Reason::StateUnbelievable;
            if beside[i].abs() > beside_max {
                let position = now.joints.position[i];
                let expected = [position - beside[i], beside_max];
                return Err(Detail::new(reason, About::PositionJump, position, expected).at(i));
            }
            if (velocity - before).abs() > change_max {
                let expected = [before, change_max];
                return Err(Detail::new(reason, About::VelocityJump, velocity, expected).at(i));
            }
        }
        Ok(())
    }

    fn accept(&mut self, last: &Measured<N>, now: &Measured<N>) {
        let elapsed_s = now.elapsed_s(last);
        let moved = now.joints.position - last.joints.position;
        self.velocities.update(&moved, &now.beside(last), elapsed_s);
        self.believed = Some(*now);
    }

    /// A state that does not follow the believed one, and the candidate so far: believed after `confirmed_ns`
    /// \[ns\] of states that agree with it.
    fn confirm(
        &mut self,
        candidate: Option<Candidate<N>>,
        now: &Measured<N>,
        (detail, confirmed_ns): (Detail, u64),
        now_ns: u64,
    ) -> Result<(), Detail> {
        let again = candidate.and_then(|candidate| {
            let next = now.continuing(&candidate.last, &self.continuous);
            let elapsed_ns = now.time_ns.saturating_sub(candidate.last.time_ns);
            let agrees = elapsed_ns <= CONFIRMED_NS && self.follows(&candidate.last, &next).is_ok();
            let count = candidate.count + 1;
            agrees.then_some(Candidate { last: next, count, ..candidate })
        });
        let candidate = match (again, candidate) {
            (Some(again), _) => again,
            (None, before) => {
                let stands = before.and_then(|before| self.stands(&before.last, now));
                let detail = self.doubled(stands.unwrap_or(detail), now_ns);
                Candidate { last: *now, since_ns: now_ns, count: 1, detail }
            }
        };
        let agreed_ns = now_ns.saturating_sub(candidate.since_ns);
        if candidate.count >= CONFIRMED_BY && agreed_ns >= confirmed_ns {
            let is_new = matches!(
                candidate.detail.reason,
                Reason::StateUnconfirmed | Reason::SequenceWentBack | Reason::TwoSources
            );
            self.publishers = self.publishers.saturating_add(is_new.into());
            self.believed = Some(candidate.last);
            self.velocities = VelocityWatch::default();
            return Ok(());
        }
        self.candidate = Some(candidate);
        Err(candidate.detail)
    }

    /// Where no state is believed yet: whether numbers or stamps of the first ones stand still.
    fn stands(&self, last: &Measured<N>, now: &Measured<N>) -> Option<Detail> {
        let detail = self.follows(last, now).err()?;
        let stands = matches!(detail.reason, Reason::SequenceStuck | Reason::StateTimeStuck);
        (self.believed.is_none() && stands).then_some(detail)
    }

    /// A publisher that is started again counts from one, once. What goes back again soon has two sources.
    fn doubled(&mut self, detail: Detail, now_ns: u64) -> Detail {
        if detail.reason != Reason::SequenceWentBack {
            return detail;
        }
        let last_ns = self.went_back_ns.replace(now_ns);
        match last_ns {
            Some(last_ns) if now_ns.abs_diff(last_ns) < AGAIN_NS => {
                Detail { reason: Reason::TwoSources, ..detail }
            }
            _ => detail,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::{PI, TAU};
    use nalgebra::Vector2;

    const MS: u64 = 1_000_000;
    const SPEED_MAX: f64 = 3.0;

    fn estimator() -> StateEstimator<2> {
        StateEstimator::new(Vector2::repeat(SPEED_MAX), 50 * MS, 100)
    }

    /// Joints that move at 0.5 and −0.2 rad/s, as state number `k` of 500 a second.
    fn state(k: u64) -> RobotState {
        let t = k as f64 * 2e-3;
        let mut state =
            RobotState { sequence: k, time_ns: k * 2 * MS, joint_count: 2, ..Default::default() };
        state.position[..2].copy_from_slice(&[0.5 * t, 1.0 - 0.2 * t]);
        state.velocity[..2].copy_from_slice(&[0.5, -0.2]);
        state
    }

    fn judged(estimator: &mut StateEstimator<2>, state: &RobotState) -> Result<(), Reason> {
        // On the clock: a moment after it was measured.
        let now_ns = state.time_ns + 1;
        estimator.update(state, now_ns);
        estimator.measured(now_ns).map(|_| ())
    }

    fn running(until: u64) -> StateEstimator<2> {
        let mut estimator = estimator();
        for k in 1..until {
            let expected = if k < 3 { Err(Reason::StateUnconfirmed) } else { Ok(()) };
            assert_eq!(judged(&mut estimator, &state(k)), expected, "{k}");
        }
        estimator
    }

    #[test]
    fn one_wrong_state_is_not_believed_however_often_it_is_looked_at() {
        type Fault = fn(&mut RobotState);
        let faults: [(Fault, Reason); 9] = [
            (|s| s.position[0] += 2.0, Reason::StateUnbelievable),
            (|s| s.position[0] = 1e6, Reason::StateUnbelievable),
            (|s| s.velocity[1] = 5.0, Reason::StateUnbelievable),
            (|s| s.velocity[1] = 60.0, Reason::StateUnbelievable),
            (|s| s.position[1] = f64::NAN, Reason::StateNotFinite),
            (|s| s.sequence = 3, Reason::SequenceWentBack),
            (|s| s.sequence -= 1, Reason::SequenceStuck),
            (|s| s.time_ns -= 2 * MS, Reason::StateTimeStuck),
            (|s| s.joint_count = 3, Reason::JointCount),
        ];
        for (fault, reason) in faults {
            let mut estimator = running(100);
            let mut wrong = state(100);
            fault(&mut wrong);
            for _ in 0..10 {
                assert_eq!(judged(&mut estimator, &wrong), Err(reason));
            }
            assert_eq!(judged(&mut estimator, &state(101)), Ok(()), "{reason:?}");
        }
    }

    /// Reported in [−π, π), with a state that is missing where it leaps.
    #[test]
    fn a_continuous_joint_goes_on_where_its_report_leaps_and_another_does_not() {
        let joints = |is_continuous| ContinuousJoints::from([is_continuous, false]);
        for (is_continuous, direction) in [(true, 1.0), (true, -1.0), (false, 1.0)] {
            let mut estimator = estimator().counting(joints(is_continuous));
            let reasons: Vec<_> = (1..6000)
                .filter(|k| k % 7 > 0)
                .filter_map(|k| {
                    let mut state = state(k);
                    let position = direction * (2.0 * k as f64 * 2e-3 - 2.0);
                    state.velocity[0] = 2.0 * direction;
                    state.position[0] = (position + PI).rem_euclid(TAU) - PI;
                    let reason = judged(&mut estimator, &state).err();
                    let believed = estimator.believed?.joints.position[0];
                    let counted = state.position[0] + TAU * estimator.turns()[0];
                    let both = [counted, believed].map(|q| (q - position).abs() < 1e-9);
                    assert!(!is_continuous || both == [true; 2], "{k}: {counted}, {believed}");
                    reason
                })
                .collect();
            assert_eq!(reasons.is_empty(), is_continuous, "{reasons:?}");
            assert!(reasons.iter().all(|reason| *reason == Reason::StateUnbelievable));
        }
    }

    #[test]
    fn a_larger_jump_of_a_continuous_joint_is_one() {
        for jump in [2.0, -2.0, 2.5 * TAU, 1e6] {
            let mut estimator = running(100).counting(ContinuousJoints::from([true, false]));
            let mut wrong = state(100);
            wrong.position[0] += jump;
            assert_eq!(judged(&mut estimator, &wrong), Err(Reason::StateUnbelievable), "{jump}");
            assert_eq!(judged(&mut estimator, &state(101)), Ok(()), "{jump}");
        }
    }

    #[test]
    fn what_is_refused_is_named_with_what_was_expected() {
        let mut estimator = running(100).of_joints(7);
        let mut wrong = state(100);
        wrong.position[1] += 2.0;
        assert_eq!(judged(&mut estimator, &wrong), Err(Reason::StateUnbelievable));
        let detail = estimator.detail(wrong.time_ns).unwrap();
        assert_eq!((detail.about, detail.index), (About::PositionJump, 1));
        assert!((detail.seen - detail.expected[0] - 2.0).abs() < 1e-9, "{detail:?}");
        let mut other = state(101);
        other.joint_names_hash = 8;
        assert_eq!(judged(&mut estimator, &other), Err(Reason::JointOrder));
        let mut named = state(102);
        named.joint_names_hash = 7;
        assert_eq!(judged(&mut estimator, &named), Ok(()));
        let late_ns = named.time_ns + 63 * MS;
        assert_eq!(estimator.measured(late_ns).unwrap_err(), Reason::StateStale);
        let detail = estimator.detail(late_ns).unwrap();
        assert_eq!((detail.about, detail.seen), (About::Age, 63e6));
    }

    #[test]
    fn first_states_that_stand_still_are_told_from_one_that_is_not_confirmed() {
        type Edit = fn(&mut RobotState);
        let cases: [(Edit, Reason); 2] = [
            (|s| s.sequence = 1, Reason::SequenceStuck),
            (|s| s.time_ns = MS, Reason::StateTimeStuck),
        ];
        for (edit, reason) in cases {
            let mut estimator = estimator();
            let reasons: Vec<_> = (1..9)
                .map(|k| {
                    let mut wrong = state(k);
                    edit(&mut wrong);
                    // In lockstep: each one is new.
                    estimator.update(&wrong, wrong.time_ns);
                    estimator.measured(wrong.time_ns).unwrap_err()
                })
                .collect();
            assert_eq!(reasons[0], Reason::StateUnconfirmed);
            assert!(reasons[1..].iter().all(|r| *r == reason), "{reasons:?}");
        }
    }

    #[test]
    fn a_stamp_makes_no_room_for_a_jump() {
        let mut estimator = running(100);
        let mut wrong = state(100);
        wrong.time_ns += 3_600_000 * MS;
        wrong.position[0] += 10.0;
        assert_eq!(judged(&mut estimator, &wrong), Err(Reason::StateUnbelievable));
        estimator.update(&wrong, state(100).time_ns);
        assert_eq!(estimator.measured(state(100).time_ns).unwrap_err(), Reason::StateUnbelievable);
        let mut other_clock = state(101);
        other_clock.time_ns += 1_000 * MS;
        estimator.update(&other_clock, state(101).time_ns);
        assert_eq!(estimator.measured(state(101).time_ns).unwrap_err(), Reason::StateClock);
    }

    #[test]
    fn a_jump_is_believed_once_states_have_confirmed_it_for_a_time() {
        let mut estimator = running(100);
        let moved = |k| {
            let mut state = state(k);
            state.position[0] += 2.0;
            state
        };
        for k in 100..125 {
            assert_eq!(judged(&mut estimator, &moved(k)), Err(Reason::StateUnbelievable), "{k}");
        }
        assert_eq!(judged(&mut estimator, &moved(125)), Ok(()));
        // Three at once are no confirmation.
        for k in 126..130 {
            estimator.update(&state(k), 126 * 2 * MS);
            assert!(estimator.measured(126 * 2 * MS).is_err());
        }
        // Jumps that contradict each other are never believed.
        for k in 130..400 {
            let wrong = if k % 2 == 0 { state(k) } else { moved(k + 1_000_000) };
            assert!(judged(&mut estimator, &wrong).is_err() || k % 2 == 1, "{k}");
        }
    }

    /// Nor does the time that passes while others are refused.
    #[test]
    fn what_contradicts_itself_is_not_believed_however_long_it_lasts() {
        let mut estimator = running(100);
        for k in 100..600 {
            let mut wrong = state(k);
            wrong.position = state(99).position;
            wrong.velocity[0] = if k % 2 == 0 { 5.0 } else { -5.0 };
            assert!(judged(&mut estimator, &wrong).is_err(), "{k}");
        }
    }

    #[test]
    fn a_velocity_that_is_not_the_derivative_of_the_position_is_found() {
        let faults: [fn(f64) -> f64; 3] = [|_| 0.0, |v| -v, f64::to_degrees];
        for fault in faults {
            let mut estimator = running(3);
            let found = (3..200).find(|&k| {
                let mut state = state(k);
                state.velocity[0] = fault(state.velocity[0] * 0.1);
                state.velocity[1] = fault(state.velocity[1] * 0.1);
                judged(&mut estimator, &state).is_err()
            });
            assert!(found.is_some());
        }
    }

    #[test]
    fn a_publisher_that_is_started_again_is_believed_and_two_sources_are_not() {
        let mut estimator = running(1_000);
        let again = |k| RobotState { sequence: k - 999, ..state(k) };
        for k in 1_000..1_025 {
            assert_eq!(judged(&mut estimator, &again(k)), Err(Reason::SequenceWentBack), "{k}");
        }
        assert_eq!(judged(&mut estimator, &again(1_025)), Ok(()));
        // Another one beside it, that counts from elsewhere.
        let mut reasons = Vec::new();
        for k in 1_026..1_126 {
            let from = if k % 2 == 0 { 5_000_000 } else { 0 };
            let source = RobotState { sequence: from + k, ..state(k) };
            reasons.push(judged(&mut estimator, &source));
        }
        assert_eq!(*reasons.last().unwrap(), Err(Reason::TwoSources));
    }

    #[test]
    fn what_is_missing_is_counted_and_much_of_it_is_a_fault() {
        let mut estimator = running(100);
        assert_eq!(judged(&mut estimator, &state(110)), Ok(()));
        assert_eq!(estimator.lost(), 10);
        let mut later = state(111);
        later.sequence += 200;
        assert_eq!(judged(&mut estimator, &later), Err(Reason::StatesLost));
        assert_eq!(estimator.lost(), 210);
    }

    #[test]
    fn hard_pushes_noise_and_slow_publishers_are_believed() {
        for period_ms in [1, 2, 4, 8, 20] {
            let mut estimator = estimator();
            let (mut position, mut velocity) = (0.0, 0.0_f64);
            let mut seed = 1_u64;
            for k in 1..2000 {
                let dt = f64::from(period_ms) * 1e-3;
                // 100 rad/s² for 30 ms, to and fro, as far as the joint's speed goes.
                let push = match (k * u64::from(period_ms as u32) / 30) % 8 {
                    1 => 100.0,
                    3 => -100.0,
                    _ => 0.0,
                };
                let before = velocity;
                velocity = (velocity + push * dt).clamp(-SPEED_MAX, SPEED_MAX);
                position += 0.5 * (before + velocity) * dt;
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let noise = (seed >> 33) as f64 / f64::from(1_u32 << 31) - 0.5;
                let mut state = RobotState {
                    sequence: k,
                    time_ns: k * u64::from(period_ms as u32) * MS,
                    joint_count: 2,
                    ..Default::default()
                };
                state.position[0] = position + 2e-3 * noise;
                state.velocity[0] = velocity + 0.1 * noise;
                let judged = judged(&mut estimator, &state);
                assert!(judged.is_ok() || k < 3, "{period_ms} ms, {k}: {judged:?}");
            }
        }
    }
}
