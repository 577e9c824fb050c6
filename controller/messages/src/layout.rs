//! Size and offset of every field, asserted at compile time against the implicit rules of
//! `repr(C)` (no hidden padding) and given as a table, against which the Python mirror is tested.

use crate::control::{ControlAnswer, ControlRequest};
use crate::messages::{
    ControllerStatus, Frame, JointCommand, Obstacle, RobotState, TaskFrames, ToolCommand,
};

/// Where a field lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FieldLayout {
    /// Name of the message's type.
    pub message: &'static str,
    /// Name of the field.
    pub field: &'static str,
    /// Offset from the start of the message \[bytes\].
    pub offset: usize,
    /// Size of the field \[bytes\].
    pub size: usize,
}

const fn size_of_field<T, F>(_: fn(&T) -> &F) -> usize {
    size_of::<F>()
}

macro_rules! layout {
    ($($message:ident { $($field:ident),+ $(,)? })+) => {
        /// Every field of every message, in order; the fields of a message fill it completely.
        pub const LAYOUT: &[FieldLayout] = &[$($(FieldLayout {
            message: stringify!($message),
            field: stringify!($field),
            offset: core::mem::offset_of!($message, $field),
            size: size_of_field::<$message, _>(|m| &m.$field),
        }),+),+];
        $(const _: () = {
            let mut end = 0;
            $(
                assert!(core::mem::offset_of!($message, $field) == end, "hidden padding");
                end += size_of_field::<$message, _>(|m| &m.$field);
            )+
            assert!(size_of::<$message>() == end, "a field is missing, or hidden padding");
            assert!(align_of::<$message>() <= 8);
        };)+
    };
}

layout! {
    RobotState {
        sequence, time_ns, joint_count, gripper_state, robot_mode, safety_stop, joint_names_hash,
        position, velocity, torque
    }
    TaskFrames { sequence, time_ns, source, frame_count, obstacle_count, frames, obstacles }
    Frame { name, valid, padding, position, quaternion, linear_velocity, angular_velocity }
    Obstacle { kind, valid, position, quaternion, linear_velocity, angular_velocity, size }
    JointCommand {
        sequence, state_sequence, time_ns, expiry_ns, mode, gripper_command, joint_count, reason,
        position, velocity, acceleration, torque, gravity_torque
    }
    ControlRequest { verb, padding, value, text }
    ControlAnswer { accepted, life_cycle, reason, padding, text }
    ToolCommand { sequence, time_ns, linear_velocity, angular_velocity }
    ControllerStatus {
        sequence, time_ns, life_cycle, reason, ticks, deadline_misses, skipped_periods, states_lost,
        allocations, connections, period_ns, wake_up_ns, state_age_ns, receiving_ns, evaluation_ns,
        publishing_ns, goal_distance_m, goal_angle_rad, energy_j
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_those_other_languages_were_told() {
        assert_eq!(size_of::<RobotState>(), 232);
        assert_eq!(size_of::<Frame>(), 136);
        assert_eq!(size_of::<Obstacle>(), 136);
        assert_eq!(size_of::<TaskFrames>(), 48 + 8 * 136 + 32 * 136);
        assert_eq!(size_of::<JointCommand>(), 368);
        assert_eq!(size_of::<ToolCommand>(), 64);
        assert_eq!(size_of::<ControllerStatus>(), 144);
        assert_eq!(LAYOUT.iter().filter(|f| f.message == "RobotState").count(), 10);
    }
}
