//! The reference motion: along the policy's accelerations, faded in, or to rest; always within the
//! limits.

use glam::DVec3;
use nalgebra::SVector;
use tprmp_messages::Reason;
use tprmp_model::controller_config::{ControllerConfig, Impedance, Stop};
use tprmp_robot::Chain;

use crate::inputs::state::JointState;
use crate::motion::disturbance::DisturbanceObserver;
use crate::motion::limits::JointLimits;
use crate::motion::tracking::{Reference, Torques, braking, torques};

/// A reference slower than this is at rest \[rad/s or m/s\].
const REFERENCE_REST: f64 = 1e-9;
/// A measured arm slower than this is at rest \[rad/s or m/s\].
const MEASURED_REST: f64 = 1e-2;

/// What a command asks of the joints: finite and within the limits.
#[derive(Debug, Clone, Copy)]
pub struct Setpoint<const N: usize> {
    /// q \[rad or m\].
    pub position: SVector<f64, N>,
    /// q̇ \[rad/s or m/s\].
    pub velocity: SVector<f64, N>,
    /// q̈ \[rad/s² or m/s²\].
    pub acceleration: SVector<f64, N>,
    /// Torques \[N m or N\].
    pub torques: Torques<N>,
}

/// The reference that the arm follows, and what becomes of it when the policy may not be followed.
#[derive(Debug)]
pub struct MotionGenerator<const N: usize> {
    limits: JointLimits<N>,
    impedance: Impedance,
    stop: Stop,
    gravity_m_s2: DVec3,
    reference: Option<Reference<N>>,
    /// Whether the policy was not followed in the last tick.
    holding: bool,
    /// Whether the arm may be elsewhere than the reference, because it was not measured.
    stale: bool,
    fade_s: f64,
    disturbance: Option<DisturbanceObserver<N>>,
}

impl<const N: usize> MotionGenerator<N> {
    /// Nothing is known of the arm yet.
    #[must_use]
    pub fn new(limits: JointLimits<N>, config: &ControllerConfig) -> Self {
        Self {
            limits,
            impedance: config.impedance,
            stop: config.stop,
            gravity_m_s2: config.robot.gravity_m_s2.into(),
            reference: None,
            holding: true,
            stale: true,
            fade_s: 0.0,
            disturbance: config.disturbance.map(DisturbanceObserver::new),
        }
    }

    /// Updates with a measured state and its time \[ns\], before [`MotionGenerator::follow`] or [`MotionGenerator::brake`];
    /// the same one again changes nothing.
    pub fn observe(&mut self, state: &JointState<N>, time_ns: u64) {
        if let Some(disturbance) = &mut self.disturbance {
            disturbance.observe(&state.velocity, time_ns);
        }
    }

    /// Whether nothing was commanded since the start.
    #[must_use]
    pub fn is_new(&self) -> bool {
        self.reference.is_none()
    }

    /// Whether the policy was not followed in the last tick.
    #[must_use]
    pub fn is_holding(&self) -> bool {
        self.holding
    }

    /// Whether the arm may be elsewhere than the reference.
    #[must_use]
    pub fn is_stale(&self) -> bool {
        self.stale
    }

    /// From now on the arm may be elsewhere than the reference, which begins anew where the arm is
    /// measured to be.
    pub fn mark_stale(&mut self) {
        self.stale = true;
        self.holding = true;
    }

    /// Follows the policy's acceleration `wanted` over `dt` \[s\]; after a start or a stop from the
    /// measured state, faded in.
    ///
    /// # Errors
    /// When it is not finite. The caller brakes.
    pub fn follow(
        &mut self,
        chain: &Chain<N>,
        state: &JointState<N>,
        wanted: &SVector<f64, N>,
        dt: f64,
    ) -> Result<Setpoint<N>, Reason> {
        if !wanted.iter().all(|a| a.is_finite()) {
            return Err(Reason::CommandNotFinite);
        }
        if core::mem::take(&mut self.holding) {
            self.reference = None;
            self.fade_s = 0.0;
        }
        self.stale = false;
        let mut reference = self.reference.unwrap_or(Reference::at(state, &self.limits));
        let fade = (self.fade_s / self.stop.fade_in_s).min(1.0);
        self.fade_s += dt;
        let brake = braking(&reference.velocity, &self.limits, self.stop.deceleration_fraction, dt);
        let faded = wanted * fade + brake * (1.0 - fade);
        let acceleration =
            self.limits.acceleration(&faded, &reference.position, &reference.velocity, dt);
        reference.integrate(&acceleration, dt);
        let setpoint = self.setpoint(chain, state, &reference, &acceleration, dt)?;
        reference.follow(state, &self.limits, self.impedance.reference_time_constant_s, dt);
        self.reference = Some(reference);
        Ok(setpoint)
    }

    /// Decelerates the reference to rest and holds it there, by feedback from the measured state.
    /// Without one there is no feedback, and once the reference is at rest the robot has to brake:
    /// `None`.
    pub fn brake(
        &mut self,
        chain: &Chain<N>,
        measured: Option<JointState<N>>,
        dt: f64,
    ) -> Option<Setpoint<N>> {
        self.holding = true;
        if let (None, Some(disturbance)) = (&measured, &mut self.disturbance) {
            disturbance.forget();
        }
        let measured_again = self.stale.then_some(measured).flatten();
        self.stale = measured.is_none();
        let mut reference = match measured_again {
            Some(state) => Reference::at(&state, &self.limits),
            None => self.reference.or(measured.map(|state| Reference::at(&state, &self.limits)))?,
        };
        let fraction = self.stop.deceleration_fraction;
        let wanted = braking(&reference.velocity, &self.limits, fraction, dt);
        let acceleration =
            self.limits.acceleration(&wanted, &reference.position, &reference.velocity, dt);
        reference.integrate(&acceleration, dt);
        self.reference = Some(reference);
        if measured.is_none() && self.reference_rests() {
            return None;
        }
        let blind = JointState { position: reference.position, velocity: reference.velocity };
        self.setpoint(chain, &measured.unwrap_or(blind), &reference, &acceleration, dt).ok()
    }

    /// Whether the reference is at rest.
    #[must_use]
    pub fn reference_rests(&self) -> bool {
        self.reference.is_none_or(|r| r.velocity.amax() < REFERENCE_REST)
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

    /// The torques, and the limits as the last thing. Nothing that is not finite gets out.
    fn setpoint(
        &mut self,
        chain: &Chain<N>,
        state: &JointState<N>,
        reference: &Reference<N>,
        acceleration: &SVector<f64, N>,
        dt: f64,
    ) -> Result<Setpoint<N>, Reason> {
        let compensation = self.disturbance.as_ref().map_or(SVector::zeros(), |disturbance| {
            let most = &self.limits.velocity_max;
            disturbance.compensation(&state.velocity, &reference.velocity, most)
        });
        let torques = torques(
            chain,
            &self.limits,
            &self.impedance,
            self.gravity_m_s2,
            state,
            reference,
            acceleration,
            &compensation,
        );
        if let Some(disturbance) = &mut self.disturbance {
            disturbance.asked(&torques.wanted, torques.saturated, dt);
        }
        let setpoint = Setpoint {
            position: self.limits.position(&reference.position),
            velocity: reference.velocity,
            acceleration: *acceleration,
            torques,
        };
        let parts = [
            &reference.position,
            &setpoint.velocity,
            &setpoint.acceleration,
            &torques.motion,
            &torques.gravity,
        ];
        if parts.iter().all(|part| part.iter().all(|v| v.is_finite())) {
            Ok(setpoint)
        } else {
            Err(Reason::CommandNotFinite)
        }
    }
}
