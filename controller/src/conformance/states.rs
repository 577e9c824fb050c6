//! The states of a publisher, judged without a motion.

use nalgebra::SVector;
use tprmp_messages::{GripperState, Reason, RobotMode, RobotState, joint_names_hash};
use tprmp_model::controller_config::ControllerConfig;
use tprmp_robot::{Chain, gravity_torques};

use crate::conformance::recording::Received;
use crate::conformance::table::{Check, Table, Verdict};
use crate::detail::{About, Detail, Snapshot, explain};
use crate::inputs::offender;

/// At least so many states come in the time in which one becomes too old.
const STATES_AN_AGE: f64 = 3.0;
/// Gravity that is less than this fraction of the effort is not told from noise.
const GRAVITY_MIN: f64 = 0.03;
/// Torques agree within this fraction.
const AGREE: f64 = 0.3;

/// What judges states.
pub(super) struct States<'a, const N: usize> {
    pub(super) config: &'a ControllerConfig,
    pub(super) chain: &'a Chain<N>,
    pub(super) states: &'a [Received<RobotState>],
}

impl<const N: usize> States<'_, N> {
    /// Judges them all, line by line.
    pub(super) fn judge(&self, table: &mut Table) {
        if let Err(text) = self.arrive() {
            table.add(Check::States, Verdict::Failed(text));
            return;
        }
        table.add(Check::States, Verdict::Passed(format!("{} states", self.states.len())));
        table.judge(Check::JointCount, self.joint_count());
        table.judge(Check::JointNames, self.joint_names());
        table.judge(Check::Numbers, self.numbers());
        table.judge(Check::Positions, self.positions());
        table.judge(Check::Clock, self.clock());
        table.judge(Check::Rate, self.rate());
        table.judge(Check::Sequence, self.sequence());
        table.judge(Check::Stamps, self.stamps());
        table.judge(Check::Rest, self.rest());
        table.add(Check::Gravity, self.gravity());
        table.judge(Check::Modes, self.modes());
    }

    fn say(&self, detail: Detail) -> String {
        let joints = self.config.robot.joints.clone();
        let snapshot = Snapshot { detail, joints, ..Snapshot::default() };
        explain(&snapshot).unwrap_or_else(|| format!("{:?}", detail.reason))
    }

    fn arrive(&self) -> Result<(), String> {
        match self.states.len() {
            0 => Err("none within 5 s".into()),
            1 | 2 => {
                Err("a first one, and then no more: likely the publisher waits for commands, in \
                          lockstep"
                    .into())
            }
            _ => Ok(()),
        }
    }

    fn each(&self) -> impl Iterator<Item = &RobotState> {
        self.states.iter().map(|received| &received.message)
    }

    fn joint_count(&self) -> Result<String, String> {
        let wrong = self.each().find(|state| state.joint_count as usize != N);
        wrong.map_or(Ok(format!("{N}")), |state| {
            Err(self.say(offender::of_state(state, N, Reason::JointCount)))
        })
    }

    fn joint_names(&self) -> Result<String, String> {
        let hash = joint_names_hash(&self.config.robot.joints);
        let wrong = self.each().find(|state| ![0, hash].contains(&state.joint_names_hash));
        if let Some(state) = wrong {
            return Err(self.say(offender::of_state(state, N, Reason::JointOrder)));
        }
        Ok(if self.each().all(|state| state.joint_names_hash == hash) {
            self.config.robot.joints.join(", ")
        } else {
            "not given (`joint_names_hash` is 0): another order would not be noticed before the arm moves"
                .into()
        })
    }

    fn numbers(&self) -> Result<String, String> {
        let wrong = self.each().find(|state| {
            let lists = [state.position, state.velocity, state.torque];
            !lists.iter().all(|list| list[..N].iter().all(|value| value.is_finite()))
        });
        wrong.map_or(Ok("all".into()), |state| {
            Err(self.say(offender::of_state(state, N, Reason::StateNotFinite)))
        })
    }

    fn positions(&self) -> Result<String, String> {
        let [lower, upper] = [self.chain.position_lower(), self.chain.position_upper()];
        let [lower, upper] = [lower, upper].map(SVector::as_slice);
        let wrong = self
            .each()
            .map(|state| Detail::beyond(Reason::JointLimit, &state.position[..N], lower, upper))
            .find(|detail| detail.about != About::Nothing);
        wrong.map_or(Ok("inside the URDF's limits".into()), |detail| Err(self.say(detail)))
    }

    fn clock(&self) -> Result<String, String> {
        let most_ns = self.config.cycle.state_age_max_ns as f64;
        let mut ages: Vec<f64> =
            self.states.iter().map(|s| s.at_ns as f64 - s.message.time_ns as f64).collect();
        ages.sort_by(f64::total_cmp);
        let [median, p99] = [0.5, 0.99].map(|q| ages[((ages.len() - 1) as f64 * q) as usize]);
        if (-most_ns..=most_ns).contains(&median) {
            let [median, p99] = [median, p99].map(|age| 1e-6 * age);
            let most = 1e-6 * most_ns;
            return Ok(format!(
                "received {median:.2} ms after the stamp, p99 {p99:.2} ms, at most {most:.0} ms"
            ));
        }
        let last = self.states[self.states.len() / 2];
        let expected = [last.message.time_ns as f64 + median, most_ns];
        let seen = last.message.time_ns as f64;
        Err(self.say(Detail::new(Reason::StateClock, About::Clock, seen, expected)))
    }

    fn rate(&self) -> Result<String, String> {
        let mut gaps: Vec<f64> =
            self.states.windows(2).map(|w| (w[1].at_ns - w[0].at_ns) as f64 * 1e-6).collect();
        gaps.sort_by(f64::total_cmp);
        let first = self.states[0].at_ns;
        let elapsed_s = (self.states[self.states.len() - 1].at_ns - first) as f64 * 1e-9;
        let rate = gaps.len() as f64 / elapsed_s;
        let p99 = gaps[((gaps.len() - 1) as f64 * 0.99) as usize];
        let most_ms = self.config.cycle.state_age_max_ns as f64 * 1e-6;
        let least = STATES_AN_AGE * 1e3 / most_ms;
        let text = format!("{rate:.0} Hz, 99 of 100 gaps below {p99:.1} ms");
        if rate < least || p99 > most_ms {
            return Err(format!(
                "{text}; expected {least:.0} Hz or more, gaps below {most_ms:.0} ms"
            ));
        }
        Ok(text)
    }

    fn sequence(&self) -> Result<String, String> {
        let pairs = || self.states.windows(2).map(|w| [w[0].message, w[1].message]);
        if let Some([last, now]) = pairs().find(|[last, now]| now.sequence <= last.sequence) {
            let expected = [last.sequence as f64, 0.0];
            let seen = now.sequence as f64;
            return Err(self.say(Detail::new(
                Reason::SequenceStuck,
                About::Sequence,
                seen,
                expected,
            )));
        }
        let missing: u64 = pairs().map(|[last, now]| now.sequence - last.sequence - 1).sum();
        let text = format!("{missing} missing of {}", self.states.len() as u64 + missing);
        if 2 * missing > self.states.len() as u64 { Err(text) } else { Ok(text) }
    }

    fn stamps(&self) -> Result<String, String> {
        let wrong = self.states.windows(2).find(|w| w[1].message.time_ns <= w[0].message.time_ns);
        let stuck = |w: &[Received<RobotState>]| {
            let [last, now] = [w[0].message.time_ns as f64, w[1].message.time_ns as f64];
            Detail::new(Reason::StateTimeStuck, About::Stamp, now, [last, 0.0])
        };
        wrong.map_or(Ok("grow".into()), |pair| Err(self.say(stuck(pair))))
    }

    fn rest(&self) -> Result<String, String> {
        let most = self.chain.velocity_max() * 0.02;
        let mut drift = SVector::<f64, N>::zeros();
        for pair in self.states.windows(2) {
            let [a, b] = [pair[0].message, pair[1].message];
            let dt = b.time_ns.saturating_sub(a.time_ns) as f64 * 1e-9;
            for i in 0..N {
                let mean = 0.5 * (a.velocity[i] + b.velocity[i]);
                drift[i] += b.position[i] - a.position[i] - mean * dt.min(0.1);
            }
        }
        let wrong = (0..N).find(|&i| drift[i].abs() > most[i]);
        wrong.map_or(Ok("agrees with the position".into()), |i| {
            let (reason, expected) = (Reason::VelocityUnbelievable, [most[i], 0.0]);
            Err(self.say(Detail::new(reason, About::Drift, drift[i], expected).at(i)))
        })
    }

    fn gravity(&self) -> Verdict {
        let count = self.states.len() as f64;
        let mean = SVector::<f64, N>::from_fn(|i, _| {
            self.each().map(|state| state.torque[i]).sum::<f64>() / count
        });
        if mean.amax() == 0.0 {
            return Verdict::NotTried("no torque is measured: all are zero".into());
        }
        let last = self.states[self.states.len() - 1].message;
        let q = SVector::from_column_slice(&last.position[..N]);
        let gravity = gravity_torques(self.chain, &q, self.config.robot.gravity_m_s2.into());
        let i = gravity.iamax();
        if self.chain.effort_max()[i].is_infinite() {
            return Verdict::NotTried("the joints have no effort limits to compare it with".into());
        }
        if gravity[i].abs() < GRAVITY_MIN * self.chain.effort_max()[i] {
            return Verdict::Passed("gravity hardly loads the joints here".into());
        }
        let near = |value: f64| (mean[i] - value).abs() < AGREE * gravity[i].abs();
        let joint = &self.config.robot.joints[i];
        let text =
            format!("joint {} `{joint}` {:.2}, gravity {:.2} N m or N", i + 1, mean[i], gravity[i]);
        if near(gravity[i]) {
            Verdict::Failed(format!("{text}: gravity is part of it"))
        } else if near(-gravity[i]) {
            Verdict::Failed(format!("{text}: gravity is part of it, and the sign is the other"))
        } else {
            Verdict::Passed(text)
        }
    }

    fn modes(&self) -> Result<String, String> {
        let state = self.states[self.states.len() - 1].message;
        let RobotState { robot_mode, safety_stop, gripper_state, .. } = state;
        let text = format!(
            "`robot_mode` {robot_mode}, `safety_stop` {safety_stop}, `gripper_state` {gripper_state}"
        );
        let gripper = GripperState::from_wire(gripper_state);
        if RobotMode::from_wire(robot_mode) != Some(RobotMode::Running) || safety_stop != 0 {
            return Err(format!("{text}; expected mode 0 and no safety stop"));
        }
        match (gripper, &self.config.lift) {
            (None, _) => Err(format!("{text}; expected a gripper state of 0 to 2")),
            (Some(GripperState::None), Some(_)) => Err(format!(
                "{text}: there is no gripper, and the task of this configuration grips; expected 1 or 2"
            )),
            _ => Ok(text),
        }
    }
}
