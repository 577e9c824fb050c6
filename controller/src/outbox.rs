//! What the loop publishes: commands, its status, and the same for a thread that shows it.

use std::sync::Arc;

use tprmp_messages::{
    CommandMode, ControllerStatus, GripperCommand, JointCommand, LifeCycle, Reason,
};
use tprmp_model::controller_config::Loop;

use crate::inputs::turns::add_turns;
use crate::motion::generator::Setpoint;
use crate::peers::Peers;
use crate::task::state::Remaining;
use crate::telemetry::{SharedStatus, Telemetry, TickTimes};

/// The messages of the loop, filled in place.
#[derive(Debug)]
pub struct Outbox {
    command: JointCommand,
    status: ControllerStatus,
    shared: Arc<SharedStatus>,
    command_lifetime_ns: u64,
    /// The status is published once in so many ticks, and when it changes.
    status_every_ticks: u64,
}

impl Outbox {
    /// Nothing was published yet. In lockstep, each tick has its status.
    #[must_use]
    pub fn new(joints: usize, config: &Loop, lockstep: bool, shared: Arc<SharedStatus>) -> Self {
        Self {
            command: JointCommand { joint_count: joints as u32, ..Default::default() },
            status: ControllerStatus {
                period_ns: config.period_ns,
                goal_distance_m: f64::INFINITY,
                goal_angle_rad: f64::INFINITY,
                ..Default::default()
            },
            shared,
            command_lifetime_ns: config.command_lifetime_ns,
            status_every_ticks: if lockstep { 1 } else { config.status_every_ticks.into() },
        }
    }

    /// Whether a command was published and has expired at the time `now_ns` \[ns\].
    #[must_use]
    pub fn has_expired(&self, now_ns: u64) -> bool {
        self.command.sequence > 0 && now_ns > self.command.expiry_ns
    }

    /// When the last command was computed \[ns\].
    #[must_use]
    pub fn command_time_ns(&self) -> u64 {
        self.command.time_ns
    }

    /// The positions and velocities of the last command \[rad or m, rad/s or m/s\]; `None` where it tells the
    /// robot to brake, or there was none.
    #[must_use]
    pub fn commanded(&self) -> Option<(&[f64], &[f64])> {
        let obeyed = self.command.mode != CommandMode::Stop.to_wire();
        obeyed.then_some((&self.command.position, &self.command.velocity))
    }

    /// Puts a setpoint into the next command.
    pub fn set<const N: usize>(&mut self, setpoint: &Setpoint<N>) {
        setpoint.write(&mut self.command);
    }

    /// Puts what remains of the task, and V of its skills \[J\], into the next statuses.
    pub fn set_remaining(&mut self, remaining: &Remaining, energy_j: f64) {
        self.status.goal_distance_m = remaining.distance_m;
        self.status.goal_angle_rad = remaining.angle_rad;
        self.status.energy_j = energy_j;
    }

    /// Publishes the command that answers the state of this sequence number: its positions in the turns of that
    /// state, in which the joints have so many `turns` more here.
    pub fn publish_command(
        &mut self,
        peers: &mut Peers,
        (mode, reason): (CommandMode, Reason),
        gripper: GripperCommand,
        (state_sequence, turns): (u64, &[f64]),
        now_ns: u64,
    ) {
        let command = &mut self.command;
        command.sequence += 1;
        command.state_sequence = state_sequence;
        command.time_ns = now_ns;
        command.expiry_ns = now_ns.saturating_add(self.command_lifetime_ns);
        command.mode = mode.to_wire();
        command.reason = reason.to_wire();
        command.gripper_command = gripper.to_wire();
        let mut published = *command;
        for (position, turns) in published.position.iter_mut().zip(turns) {
            *position = add_turns(*position, -turns);
        }
        // A command that cannot be sent expires: the robot brakes.
        let _ = peers.exchange(|ports| ports.command.publish(published));
    }

    /// Publishes the status where it is due.
    pub fn publish_status(
        &mut self,
        peers: &mut Peers,
        (life_cycle, reason): (LifeCycle, Reason),
        telemetry: &Telemetry,
        (times, states_lost): (&TickTimes, u64),
        now_ns: u64,
    ) {
        self.shared.write(life_cycle, reason);
        let status = &mut self.status;
        let state = (life_cycle.to_wire(), reason.to_wire());
        let changed = (status.life_cycle, status.reason) != state;
        if !changed && !telemetry.ticks.is_multiple_of(self.status_every_ticks) {
            return;
        }
        status.sequence += 1;
        status.time_ns = now_ns;
        (status.life_cycle, status.reason) = state;
        status.ticks = telemetry.ticks;
        status.deadline_misses = telemetry.deadline_misses;
        status.skipped_periods = telemetry.skipped_periods;
        status.states_lost = states_lost;
        status.allocations = peers.allocations();
        status.connections = peers.connections().count;
        status.wake_up_ns = times.wake_up_ns;
        status.state_age_ns = times.state_age_ns.unwrap_or(0);
        status.receiving_ns = times.receiving_ns;
        status.evaluation_ns = times.evaluation_ns;
        status.publishing_ns = times.publishing_ns;
        let _ = peers.exchange(|ports| ports.status.publish(self.status));
    }
}
