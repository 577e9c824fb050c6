//! The motion that is published: along the policy's accelerations, faded in, or to rest. Every command passes
//! through here, in every mode: each continues the one before within the limits.

use nalgebra::SVector;
use tprmp_messages::{CommandMode, JointCommand, Reason};
use tprmp_model::controller_config::{
    Actuators, ControllerConfig, Gripped, Impedance, PointLimits, Stop,
};
use tprmp_robot::{Chain, Payload};

use crate::inputs::estimator::JointState;
use crate::motion::caution::{Ahead, Caution, Slowed};
use crate::motion::disturbance::DisturbanceObserver;
use crate::motion::limits::JointLimits;
use crate::motion::load::{LoadObserver, Wanted};
use crate::motion::profile::JointMotion;
use crate::motion::servo::ServoModel;
use crate::motion::tracking::{Drives, Torques, Tracking};

/// A measured arm slower than this is at rest \[rad/s or m/s\].
const MEASURED_REST: f64 = 1e-2;
/// In motion the arm is where the reference is when it is as near as the largest speed takes it in this time
/// \[s\] …
const NEAR_S: f64 = 0.02;
/// … at rest when the reference has come there \[rad or m\] …
const NEAR_REST: f64 = 1e-9;
/// … and as fast, up to this fraction of the largest speed.
const NEAR_SPEED: f64 = 0.1;

/// What the gripper holds gains its weight in this time, and loses it again \[s\].
const HOLD_FADE_S: f64 = 0.05;

/// What a command asks of the joints: finite, within the limits, and a continuation of the last one.
#[derive(Debug, Clone, Copy)]
pub struct Setpoint<const N: usize> {
    /// Position, velocity and acceleration.
    pub motion: JointMotion<N>,
    /// Torques \[N m or N\].
    pub torques: Torques<N>,
    /// The acceleration that the arm is asked for: the motion's, without what the reference yields by
    /// \[rad/s² or m/s²\].
    pub asked: SVector<f64, N>,
}

impl<const N: usize> Setpoint<N> {
    /// Writes it into a command.
    pub fn write(&self, command: &mut JointCommand) {
        for (from, to) in [
            (&self.motion.position, &mut command.position),
            (&self.motion.velocity, &mut command.velocity),
            (&self.motion.acceleration, &mut command.acceleration),
            (&self.torques.motion, &mut command.torque),
            (&self.torques.gravity, &mut command.gravity_torque),
        ] {
            to[..N].copy_from_slice(from.as_slice());
        }
    }
}

/// What is known of the arm in relation to the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tie {
    /// It was measured in the last tick, and follows.
    Follows,
    /// It was not measured, and was commanded.
    Unseen,
    /// It was told to brake on its own, or did so because a command had expired.
    Braked,
}

/// What moves an arm that was brought to rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum MovedBy {
    /// It goes to a posture.
    Retreat,
    /// It gives way.
    Others,
}

/// The impedance, whose reference yields to a servo as the servo's own key says.
fn impedance(config: &ControllerConfig) -> Impedance {
    let yields_s = config.robot.actuators.servo().map(|servo| servo.reference_time_constant_s);
    let mut impedance = config.impedance;
    impedance.reference_time_constant_s = yields_s.unwrap_or(impedance.reference_time_constant_s);
    impedance
}

/// The reference that the arm follows, and what becomes of it when the policy may not be followed.
#[derive(Debug)]
pub struct MotionGenerator<const N: usize> {
    limits: JointLimits<N>,
    tracking: Tracking<N>,
    stop: Stop,
    /// What was published last.
    published: Option<Setpoint<N>>,
    tie: Tie,
    /// Whether the robot brakes on its own in this tick.
    own_stop: bool,
    /// Whether the policy was not followed in the last tick.
    holding: bool,
    /// What has moved the arm from rest since then, where it was not the policy.
    moved_by: Option<MovedBy>,
    fade_s: f64,
    disturbance: Option<DisturbanceObserver<N>>,
    caution: Caution<N>,
    load: Option<LoadObserver<N>>,
    /// Of a servo with a lag.
    servo: Option<ServoModel<N>>,
    obeys_torques: bool,
    /// What the gripper holds when it holds, and how much of it counts now, 0 to 1.
    gripped: Payload,
    gripped_fraction: f64,
}

impl<const N: usize> MotionGenerator<N> {
    /// Nothing is known of the arm yet.
    #[must_use]
    pub fn new(limits: JointLimits<N>, config: &ControllerConfig) -> Self {
        Self {
            limits,
            tracking: Tracking {
                impedance: impedance(config),
                drives: Drives::new(&config.robot.actuators),
                gravity_m_s2: config.robot.gravity_m_s2.into(),
                payload: Payload::NONE,
            },
            stop: config.stop,
            published: None,
            tie: Tie::Unseen,
            own_stop: false,
            holding: true,
            moved_by: None,
            fade_s: 0.0,
            disturbance: config.disturbance.map(DisturbanceObserver::new),
            caution: Caution::new(config.robot.point_limits),
            load: config.disturbance.and_then(|settings| settings.load).map(LoadObserver::new),
            servo: ServoModel::new(config.robot.actuators.lag_s()),
            obeys_torques: matches!(config.robot.actuators, Actuators::Torque(_)),
            gripped: Payload::NONE,
            gripped_fraction: 0.0,
        }
    }

    /// When the gripper holds, it holds what the configuration says.
    #[must_use]
    pub fn gripping(self, chain: &Chain<N>, config: &ControllerConfig) -> Self {
        let payload = |gripped: &Gripped| chain.payload(&gripped.body());
        Self { gripped: config.gripped.as_ref().map_or(Payload::NONE, payload), ..self }
    }

    /// Whether the gripper `holds`, `dt` \[s\] after that was asked the last time: its payload is faded in and out. Where
    /// nothing was commanded yet, it has held before.
    pub fn hold(&mut self, holds: bool, dt: f64) {
        let step = if self.is_new() { 1.0 } else { dt / HOLD_FADE_S };
        let change = f64::from(u8::from(holds)) - self.gripped_fraction;
        self.gripped_fraction += change.clamp(-step, step);
        self.tracking.payload = self.gripped.scaled(self.gripped_fraction);
    }

    /// The limits that every command keeps.
    #[must_use]
    pub fn limits(&self) -> &JointLimits<N> {
        &self.limits
    }

    /// The limits of points of the arm, to be changed smoothly.
    pub fn point_limits(&mut self) -> Option<&mut PointLimits> {
        self.caution.limits()
    }

    /// In how many ticks limits have slowed the arm down.
    #[must_use]
    pub fn slowed(&self) -> &Slowed {
        self.caution.slowed()
    }

    /// Updates with a measured state and its time \[ns\], before [`MotionGenerator::follow`] or
    /// [`MotionGenerator::brake`]; the same one again changes nothing.
    pub fn observe(&mut self, state: &JointState<N>, time_ns: u64) {
        if let Some(disturbance) = &mut self.disturbance {
            disturbance.observe(&state.velocity, time_ns);
        }
    }

    /// Accelerations that the torques were to cause and that were not measured \[rad/s² or m/s²\]; zero of an arm
    /// that does not obey torques.
    #[must_use]
    pub fn missing_acceleration(&self) -> SVector<f64, N> {
        let disturbance = self.disturbance.as_ref().filter(|_| self.obeys_torques);
        disturbance.map_or_else(SVector::zeros, |disturbance| -disturbance.estimate())
    }

    /// The states were wrong: the robot brakes on its own, and what was learned of a load is forgotten.
    pub fn was_misled(&mut self) {
        self.load = self.load.map(LoadObserver::forgotten);
        self.robot_brakes();
    }

    /// The arm as it will be when it has come to where it is told to be: after the lag of its servo.
    #[must_use]
    pub fn ahead(&self, state: &JointState<N>) -> JointState<N> {
        match (&self.servo, &self.published) {
            (Some(servo), Some(last)) if self.tie == Tie::Follows => {
                servo.ahead(state, &last.motion, &self.limits.position_end)
            }
            _ => *state,
        }
    }

    /// Whether arm and reference are within the robot's description.
    #[must_use]
    pub fn is_inside(&self, state: &JointState<N>) -> bool {
        [state.position, self.reference(state).position].iter().all(|q| self.limits.contain(q))
    }

    /// Whether nothing was commanded since the start.
    #[must_use]
    pub fn is_new(&self) -> bool {
        self.published.is_none()
    }

    /// Whether the policy was not followed in the last tick.
    #[must_use]
    pub fn is_holding(&self) -> bool {
        self.holding
    }

    /// Whether the arm may be elsewhere than the reference.
    #[must_use]
    pub fn is_stale(&self) -> bool {
        self.tie != Tie::Follows
    }

    /// The robot brakes on its own, or has done so because a command expired before its successor came.
    pub fn robot_brakes(&mut self) {
        self.tie = Tie::Braked;
        self.own_stop = true;
        self.holding = true;
    }

    /// Whether the policy may be followed from this measured state: after a stop the reference has to be at
    /// rest where the arm is.
    #[must_use]
    pub fn may_follow(&self, state: &JointState<N>) -> bool {
        match &self.published {
            None => {
                self.limits.contain(&state.position) && self.is_near(&self.reference(state), state)
            }
            Some(_) => self.tie == Tie::Follows && (!self.holding || self.reference_rests()),
        }
    }

    /// Follows the policy's acceleration `wanted` over `dt` \[s\]; after a start or a stop faded in. Where
    /// [`Caution`] says so it brakes instead; the arm closes clearances by `closing_1_s` \[1/s\].
    ///
    /// # Errors
    /// When it is not finite. The caller brakes.
    pub fn follow(
        &mut self,
        chain: &Chain<N>,
        state: &JointState<N>,
        wanted: &SVector<f64, N>,
        closing_1_s: f64,
        dt: f64,
    ) -> Result<Setpoint<N>, Reason> {
        if !wanted.iter().all(|a| a.is_finite()) {
            return Err(Reason::CommandNotFinite);
        }
        if core::mem::take(&mut self.holding) {
            self.fade_s = 0.0;
        }
        let state = &self.ahead(state);
        let mut motion = self.reference(state);
        let fraction = self.stop.deceleration_fraction;
        let torque = self
            .published
            .map_or_else(SVector::zeros, |last| last.torques.motion + last.torques.gravity);
        let ahead =
            Ahead { motion: &motion, closing_1_s, torque, deceleration_fraction: fraction, dt };
        let left = self.caution.left(chain, &self.limits, &ahead);
        let fade = (self.fade_s / self.stop.fade_in_s).min(1.0).min(left);
        self.fade_s += dt;
        let brake = motion.braking(&self.limits, fraction, dt);
        let wanted = self.caution.scaled(chain, &motion, *wanted);
        let faded = self.limits.scaled(&(wanted * fade + brake * (1.0 - fade)));
        // What the limits leave of the yielding is no acceleration that the arm is asked for.
        let mut unyielding = motion;
        unyielding.advance(&faded, &self.limits, dt);
        let yielding = self.tracking.yielding(&motion, state, dt) * left;
        motion.advance(&(faded + yielding), &self.limits, dt);
        let yielded = motion.acceleration - unyielding.acceleration;
        self.tie = Tie::Follows;
        let torques = self.torques(chain, state, &motion, Some(&yielded));
        self.publish(motion, torques, yielded, dt).ok_or(Reason::CommandNotFinite)
    }

    /// Decelerates the reference to rest and holds it there, by feedback from the measured state. Without
    /// one there is no feedback, and once the reference is at rest the robot has to brake. An arm that may be
    /// elsewhere brakes on its own until the reference rests where it is measured to be.
    ///
    /// A joint that is a little outside its limits goes back where it `returns`, and is held elsewhere.
    ///
    /// `None` where nothing is known of the arm: it has to brake.
    pub fn brake(
        &mut self,
        chain: &Chain<N>,
        measured: Option<JointState<N>>,
        returns: bool,
        dt: f64,
    ) -> Option<(Setpoint<N>, CommandMode)> {
        self.holding = true;
        self.moved_by = None;
        // What lies far beyond the robot's description is no place to hold.
        let inside = measured.filter(|state| self.limits.permit_return(&state.position));
        if self.published.is_none() && inside.is_none() {
            return None;
        }
        if let (None, Some(disturbance)) = (&measured, &mut self.disturbance) {
            disturbance.forget();
        }
        let blind = self.published.map_or(SVector::zeros(), |last| last.motion.position);
        let at = measured.unwrap_or(JointState { position: blind, velocity: SVector::zeros() });
        let mut motion = self.reference(&at);
        let fraction = self.stop.deceleration_fraction;
        let wanted = if returns && inside.is_some() && self.tie == Tie::Follows {
            motion.returning(&self.limits, fraction, dt)
        } else {
            motion.braking(&self.limits, fraction, dt)
        };
        let rested = motion.rests();
        motion.advance(&wanted, &self.limits, dt);
        if let (Tie::Braked, true, Some(state)) = (self.tie, rested, inside) {
            // No faster than the arm could have moved there.
            let most = self.limits.velocity_max * dt;
            motion.position += (state.position - motion.position)
                .zip_map(&most, |offset, most| offset.clamp(-most, most));
        }
        let own_stop = core::mem::take(&mut self.own_stop);
        self.tie = match (self.tie, inside) {
            _ if own_stop => Tie::Braked,
            (Tie::Follows | Tie::Unseen, None) if measured.is_none() && !motion.rests() => {
                Tie::Unseen
            }
            (Tie::Follows, _) if measured.is_some() => Tie::Follows,
            (_, Some(state)) if self.is_near(&motion, &state) => Tie::Follows,
            _ => Tie::Braked,
        };
        if self.tie != Tie::Braked {
            let state = measured
                .unwrap_or(JointState { position: motion.position, velocity: motion.velocity });
            let torques = self.torques(chain, &state, &motion, None);
            return Some((self.publish(motion, torques, SVector::zeros(), dt)?, CommandMode::Hold));
        }
        let torques = self.tracking.resting((chain, &self.limits), &at.position);
        Some((self.publish(motion, torques, SVector::zeros(), dt)?, CommandMode::Stop))
    }

    /// Whether the arm was brought to rest and is measured, so that it may be moved by something else than the
    /// policy.
    #[must_use]
    pub fn may_leave_rest(&self) -> bool {
        self.tie == Tie::Follows && self.is_settled()
    }

    /// As [`MotionGenerator::follow`], while the policy is not followed.
    pub fn retreat(
        &mut self,
        chain: &Chain<N>,
        state: &JointState<N>,
        wanted: &SVector<f64, N>,
        closing_1_s: f64,
        dt: f64,
    ) -> Option<Setpoint<N>> {
        self.holding = self.moved_by != Some(MovedBy::Retreat);
        let setpoint = self.follow(chain, state, wanted, closing_1_s, dt).ok();
        self.holding = true;
        self.moved_by = setpoint.as_ref().map(|_| MovedBy::Retreat);
        setpoint
    }

    /// Gives way: the reference goes where the arm is moved to, and torques hold gravity only. For an arm
    /// that was brought to rest, in place of [`MotionGenerator::brake`].
    pub fn give_way(
        &mut self,
        chain: &Chain<N>,
        state: &JointState<N>,
        dt: f64,
    ) -> Option<Setpoint<N>> {
        self.holding = true;
        self.moved_by = Some(MovedBy::Others);
        let mut motion = self.reference(state);
        let yielded = self.tracking.yielding(&motion, state, dt);
        motion.advance(&yielded, &self.limits, dt);
        let torques = self.tracking.resting((chain, &self.limits), &state.position);
        self.publish(motion, torques, yielded, dt)
    }

    /// What feeds back, where it changes while the loop runs.
    pub fn impedance(&mut self) -> &mut Impedance {
        &mut self.tracking.impedance
    }

    /// The reference so far: at first where the arm is measured to be, at rest.
    fn reference(&self, state: &JointState<N>) -> JointMotion<N> {
        self.published.map_or(JointMotion::at_rest(state.position), |last| last.motion)
    }

    /// Whether the arm is where the reference is, and as fast.
    fn is_near(&self, motion: &JointMotion<N>, state: &JointState<N>) -> bool {
        let rests = motion.rests();
        (0..N).all(|i| {
            let most = self.limits.velocity_max[i];
            let near = if rests { NEAR_REST } else { most * NEAR_S };
            (state.position[i] - motion.position[i]).abs() <= near
                && (state.velocity[i] - motion.velocity[i]).abs() <= most * NEAR_SPEED
        })
    }

    /// Whether the reference is at rest.
    #[must_use]
    pub fn reference_rests(&self) -> bool {
        self.published.is_none_or(|last| last.motion.rests())
    }

    /// Whether the reference was brought to rest, also where something else than the policy moves it since.
    #[must_use]
    pub fn is_settled(&self) -> bool {
        self.moved_by.is_some() || self.reference_rests()
    }

    /// Whether reference and arm are at rest.
    #[must_use]
    pub fn rests(&self, measured: Option<JointState<N>>) -> bool {
        self.reference_rests() && measured.is_none_or(|m| m.velocity.amax() < MEASURED_REST)
    }

    /// Whether reference and arm are at rest after `stopping_s` \[s\], or the longest time for it has
    /// passed.
    #[must_use]
    pub fn has_stopped(&self, measured: Option<JointState<N>>, stopping_s: f64) -> bool {
        stopping_s > self.stop.duration_max_s || self.rests(measured)
    }

    fn torques(
        &mut self,
        chain: &Chain<N>,
        state: &JointState<N>,
        motion: &JointMotion<N>,
        yielded: Option<&SVector<f64, N>>,
    ) -> Torques<N> {
        let compensation = self.disturbance.as_ref().map_or(SVector::zeros(), |disturbance| {
            let most = &self.limits.velocity_max;
            disturbance.compensation(&state.velocity, &motion.velocity, most)
        });
        let load = self.observe_load(chain, state, motion, yielded.is_some());
        let robot = (chain, &self.limits);
        self.tracking.torques(robot, state, motion, yielded, &compensation, &load)
    }

    /// What cancels the load, after the newest state \[N m or N\].
    fn observe_load(
        &mut self,
        chain: &Chain<N>,
        state: &JointState<N>,
        motion: &JointMotion<N>,
        yields: bool,
    ) -> SVector<f64, N> {
        let Self { tracking, disturbance, load, limits, .. } = self;
        let Some(load) = load else { return SVector::zeros() };
        let fresh = disturbance.as_mut().and_then(DisturbanceObserver::take_fresh);
        if let Some((acceleration, elapsed_s)) = fresh {
            let beside = tracking.inertial(chain, &state.position, &acceleration);
            let wanted_velocity = &tracking.wanted_velocity(motion, state, yields);
            let joint = Wanted { velocity: &state.velocity, wanted_velocity };
            load.advance(&beside, &joint, &limits.effort_max, elapsed_s);
        }
        *load.torque()
    }

    /// The last stage of every command: it continues the one before. Nothing that is not finite gets out.
    fn publish(
        &mut self,
        motion: JointMotion<N>,
        torques: Torques<N>,
        yielded: SVector<f64, N>,
        dt: f64,
    ) -> Option<Setpoint<N>> {
        // Before the first command the arm holds itself against gravity.
        let before = self
            .published
            .map_or(Torques { motion: SVector::zeros(), ..torques }, |last| last.torques);
        let torques = torques.after(&before, &self.limits, dt);
        let JointMotion { position, velocity, acceleration } = &motion;
        let parts = [position, velocity, acceleration, &torques.motion, &torques.gravity];
        if !parts.iter().all(|part| part.iter().all(|v| v.is_finite())) {
            return None;
        }
        if let (Some(disturbance), Some(wanted)) = (&mut self.disturbance, &torques.wanted) {
            disturbance.asked(wanted, torques.saturated, dt);
        }
        if let Some(servo) = &mut self.servo {
            servo.advance(&motion, dt);
        }
        let setpoint = Setpoint { motion, torques, asked: acceleration - yielded };
        self.published = Some(setpoint);
        Some(setpoint)
    }
}
