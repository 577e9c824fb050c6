//! Which commands are obeyed, how the robot comes to rest, and that no bits of a command get around it.

use core::f64::consts::TAU;

use proptest::prelude::*;
use tprmp_messages::{
    Action, Bounds, Cause, CommandGuard, CommandMode, GripperCommand, JointBounds, JointCommand,
    Reason, RobotState,
};

#[expect(unreachable_pub, reason = "a module of the controller, whose allocator counts here too")]
#[path = "../../src/timing/allocation.rs"]
mod allocation;

#[global_allocator]
static ALLOCATOR: allocation::CountingAllocator = allocation::CountingAllocator;

const MS: u64 = 1_000_000;
const T0: u64 = 1000 * MS;
const NEWEST: u64 = 500;

fn guard() -> CommandGuard {
    let joints = Some(JointBounds::same(2.0, 20.0, 10.0));
    CommandGuard::new(2, Bounds { joints, ..Bounds::default() })
}

fn state(position: [f64; 2]) -> RobotState {
    let mut state = RobotState { sequence: NEWEST, joint_count: 2, ..Default::default() };
    state.position[..2].copy_from_slice(&position);
    state
}

fn command(sequence: u64, time_ns: u64) -> JointCommand {
    JointCommand {
        sequence,
        state_sequence: NEWEST,
        time_ns,
        expiry_ns: time_ns + 50 * MS,
        mode: CommandMode::Track.to_wire(),
        joint_count: 2,
        ..Default::default()
    }
}

fn obeys(action: &Action) -> bool {
    matches!(action, Action::Obey(_))
}

/// A guard that obeys a command from the time `T0` on, and the tick that it was given in.
fn obeying() -> CommandGuard {
    let mut guard = guard();
    assert!(obeys(&guard.judge(T0, Some(&command(7, T0)), &state([0.0; 2]))));
    guard
}

/// In either direction; a joint that ends somewhere does not, nor is another jump one.
#[test]
fn a_continuous_joint_may_leap_by_a_turn_and_by_nothing_else() {
    let mut joints = JointBounds::same(2.0, 20.0, 10.0);
    joints.continuous[0] = true;
    for (joint, leap, is_obeyed) in [
        (0, TAU, true),
        (0, -TAU, true),
        (0, 2.0 * TAU, false),
        (0, TAU - 0.5, false),
        (0, 0.5 * TAU, false),
        (1, TAU, false),
    ] {
        // From the last command, and from the measured state.
        for is_obeying in [true, false] {
            let mut guard =
                CommandGuard::new(2, Bounds { joints: Some(joints), ..Bounds::default() });
            if is_obeying {
                assert!(obeys(&guard.judge(T0, Some(&command(7, T0)), &state([0.0; 2]))));
            }
            let mut next = command(8, T0 + MS);
            next.position[joint] = leap + 0.001;
            let action = guard.judge(T0 + MS, Some(&next), &state([0.0; 2]));
            assert_eq!(obeys(&action), is_obeyed, "{joint} {leap} {is_obeying}");
        }
    }
}

#[test]
fn each_fault_brakes_and_is_counted_and_named() {
    type Edit = fn(&mut JointCommand);
    let edits: [(Edit, Cause, &str); 17] = [
        (|c| c.joint_count = 6, Cause::JointCount, "is for 6 joints, this robot has 2"),
        (|c| c.joint_count = u32::MAX, Cause::JointCount, "4294967295"),
        (|c| c.mode = 77, Cause::Mode, "unknown mode 77"),
        (|c| c.time_ns += 2 * MS, Cause::Ahead, "0.002 s in the future"),
        (|c| c.time_ns = u64::MAX, Cause::Ahead, "CLOCK_MONOTONIC"),
        (|c| c.expiry_ns = 0, Cause::Expired, "expired 1.001 s ago"),
        (|c| c.time_ns -= 100 * MS, Cause::Expired, "expired"),
        (|c| c.sequence = 7, Cause::Sequence, "after command 7"),
        (|c| c.sequence = 1, Cause::Sequence, "two controllers"),
        (|c| c.state_sequence += 1, Cause::StateAhead, "answers state 501, the newest is 500"),
        (|c| c.state_sequence -= 101, Cause::StateOld, "101 states before the newest"),
        (|c| c.state_sequence = 0, Cause::StateOld, "receives no states"),
        (|c| c.acceleration[1] = f64::NAN, Cause::NotFinite, "joint 1"),
        (|c| c.gravity_torque[0] = f64::INFINITY, Cause::NotFinite, "joint 0"),
        (|c| c.position[1] = 0.0041, Cause::Step, "steps by 0.0041 at joint 1"),
        (|c| c.velocity[0] = -0.041, Cause::Step, "at most 0.0400"),
        (|c| c.velocity[0] = f64::MAX, Cause::Step, "joint 0"),
    ];
    for (edit, cause, words) in edits {
        let mut guard = obeying();
        let mut bad = command(8, T0 + MS);
        edit(&mut bad);
        assert!(!obeys(&guard.judge(T0 + MS, Some(&bad), &state([0.0; 2]))), "{cause:?}");
        let found: Vec<_> = guard.counts().found().collect();
        assert_eq!(found, [(cause, 1)]);
        let text = guard.last_fault().unwrap().to_string();
        assert!(text.contains(words), "{text}");
        assert_eq!(guard.command().sequence, 7, "what was refused leaves nothing behind");
        assert!(obeys(&guard.judge(T0 + MS, Some(&command(9, T0 + MS)), &state([0.0; 2]))));
    }
    assert_eq!(Cause::ALL.len(), 12, "each cause has its case here or below");
}

#[test]
fn what_is_unknown_and_harmless_is_only_counted() {
    let mut guard = obeying();
    let mut grip = command(8, T0);
    grip.gripper_command = GripperCommand::Grip.to_wire();
    assert!(obeys(&guard.judge(T0, Some(&grip), &state([0.0; 2]))));
    let mut odd = command(9, T0);
    (odd.reason, odd.gripper_command) = (40_000, 77);
    odd.position[2] = f64::NAN; // not in use
    assert!(obeys(&guard.judge(T0, Some(&odd), &state([0.0; 2]))));
    assert_eq!((guard.counts().of(Cause::Reason), guard.counts().of(Cause::Gripper)), (1, 1));
    assert_eq!(guard.gripper(), GripperCommand::Grip);
    assert_eq!(Reason::from_wire(guard.command().reason), None);
}

#[test]
fn a_command_counts_for_a_bounded_time_whatever_its_expiry() {
    for (expiry_ns, counts_ns) in [(u64::MAX, 100 * MS), (T0 + 30 * MS, 30 * MS)] {
        let mut guard = guard();
        let command = JointCommand { expiry_ns, ..command(1, T0) };
        assert!(obeys(&guard.judge(T0, Some(&command), &state([0.0; 2]))));
        assert!(obeys(&guard.judge(T0 + counts_ns - 1, None, &state([0.0; 2]))));
        for later_ns in [0, 1, u64::MAX - T0 - counts_ns] {
            assert!(!obeys(&guard.judge(T0 + counts_ns + later_ns, None, &state([0.0; 2]))));
        }
        assert_eq!(guard.counts().of(Cause::Expired), 1, "once, not in each tick");
    }
    // By the receiver's clock, too: one that is stamped a little ahead counts no longer.
    let mut guard = guard();
    let ahead = JointCommand { expiry_ns: u64::MAX, ..command(1, T0 + MS) };
    assert!(obeys(&guard.judge(T0, Some(&ahead), &state([0.0; 2]))));
    assert!(!obeys(&guard.judge(T0 + 100 * MS, None, &state([0.0; 2]))));
}

#[test]
fn a_controller_that_was_started_again_is_obeyed_once_the_old_command_has_expired() {
    let mut guard = obeying();
    for ms in 10..50 {
        let again = command(1 + ms - 10, T0 + ms * MS);
        let action = guard.judge(T0 + ms * MS, Some(&again), &state([0.0; 2]));
        let below = again.sequence <= 7;
        assert_eq!(obeys(&action), !below, "sequence {} after {ms} ms", again.sequence);
    }
    let mut guard = obeying();
    assert!(obeys(&guard.judge(T0 + 50 * MS, Some(&command(1, T0 + 50 * MS)), &state([0.0; 2]))));
}

#[test]
fn braking_goes_along_the_last_velocity_to_rest_and_holds_there() {
    let mut guard = guard();
    let mut moving = command(1, T0);
    moving.velocity[..2].copy_from_slice(&[1.0, -0.5]);
    assert!(obeys(&guard.judge(T0, Some(&moving), &state([0.0; 2]))));
    // Between two commands it goes on.
    let Action::Obey(on) = guard.judge(T0 + 40 * MS, None, &state([0.0; 2])) else { panic!() };
    assert!((on.position[0] - 0.04).abs() < 1e-12 && (on.position[1] + 0.02).abs() < 1e-12);
    let (mut before, mut speed) = (on, 1.0);
    for ms in 41..200 {
        let bad = JointCommand { mode: 9, ..command(ms, T0 + ms * MS) };
        let action = guard.judge(T0 + ms * MS, Some(&bad), &state([9.0; 2]));
        let Action::Brake(now) = action else { panic!("{ms}") };
        // 10 rad/s² on joint 0, half of it on joint 1: a straight line, and no jump.
        assert!(
            (now.velocity[0] - f64::max(1.0 - 10.0 * (ms - 40) as f64 * 1e-3, 0.0)).abs() < 1e-12
        );
        assert!((now.velocity[1] + 0.5 * now.velocity[0]).abs() < 1e-12);
        let mean = 0.5 * (now.velocity[0] + before.velocity[0]);
        assert!((now.position[0] - before.position[0] - mean * 1e-3).abs() < 1e-12);
        assert!(now.velocity[0] <= speed);
        (before, speed) = (now, now.velocity[0]);
    }
    assert!((before.position[0] - 0.09).abs() < 1e-12, "1²/(2·10) m after 0.04: {before:?}");
    assert_eq!(before.velocity[0], 0.0);
}

#[test]
fn obeying_begins_anew_only_where_the_robot_is() {
    let mut guard = guard();
    // 2 rad/s and 20 rad/s² for 0.1 s.
    for (position, velocity, begins) in
        [(1.25, 0.0, false), (1.0, 2.1, false), (1.15, 1.9, true), (f64::NAN, 0.0, false)]
    {
        guard.judge(T0, Some(&JointCommand { mode: 9, ..command(1, T0) }), &state([0.0; 2]));
        let mut first = command(guard.command().sequence + 1, T0);
        (first.position[0], first.velocity[0]) = (position, velocity);
        let measured = state([1.0, 0.0]);
        assert_eq!(
            obeys(&guard.judge(T0, Some(&first), &measured)),
            begins,
            "{position} {velocity}"
        );
    }
    assert_eq!(guard.counts().of(Cause::Elsewhere), 2);
    // A robot that does not know where it is begins nothing; one with torques needs not to.
    let mut guard = self::guard();
    assert!(!obeys(&guard.judge(T0, Some(&command(1, T0)), &state([f64::NAN, 0.0]))));
    let mut torque = CommandGuard::new(2, Bounds::default());
    assert!(obeys(&torque.judge(T0, Some(&command(1, T0)), &state([5.0, 0.0]))));
    let stop = JointCommand { mode: CommandMode::Stop.to_wire(), ..command(2, T0) };
    let braked = torque.judge(T0, Some(&stop), &state([5.0, 0.0]));
    assert!(!obeys(&braked) && braked.setpoint().position[0] == 5.0);
    assert_eq!(torque.counts().found().count(), 0, "a stop is no fault");
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![any::<u64>().prop_map(f64::from_bits), -0.1..0.1_f64, Just(0.0)]
}

fn any_numbers() -> impl Strategy<Value = [f64; 8]> {
    proptest::array::uniform8(any_number())
}

prop_compose! {
    /// Any bits, and some that are nearly right.
    fn any_command()(
        words in proptest::array::uniform4(prop_oneof![any::<u64>(), 1_u64..600, T0..T0 + 80 * MS]),
        kinds in proptest::array::uniform4(prop_oneof![any::<u32>(), 0_u32..3]),
        numbers in proptest::array::uniform5(any_numbers()),
    ) -> JointCommand {
        let [sequence, state_sequence, time_ns, expiry_ns] = words;
        let [mode, gripper_command, joint_count, reason] = kinds;
        let [position, velocity, acceleration, torque, gravity_torque] = numbers;
        JointCommand {
            sequence, state_sequence, time_ns, expiry_ns, mode, gripper_command, joint_count, reason,
            position, velocity, acceleration, torque, gravity_torque,
        }
    }
}

proptest! {
    /// Among good commands, any bits: nothing panics or allocates, setpoints stay finite, no faster than
    /// the bounds, and from tick to tick no further apart than they allow.
    #[test]
    fn no_bits_get_around_the_guard(
        hostile in proptest::collection::vec((any_command(), 0_u64..120 * MS, any::<bool>()), 1..20),
    ) {
        let mut guard = guard();
        let mut now_ns = T0;
        let (mut at, mut obeyed) = (state([0.0; 2]), false);
        let before = allocation::counted();
        assert!(before > 0, "the counter works");
        for (bits, pause_ns, good) in &hostile {
            now_ns += pause_ns;
            let command = if *good {
                JointCommand { position: at.position, ..command(guard.command().sequence + 1, now_ns) }
            } else {
                *bits
            };
            let action = guard.judge(now_ns, Some(&command), &at);
            let setpoint = *action.setpoint();
            for joint in 0..2 {
                let (p, v) = (setpoint.position[joint], setpoint.velocity[joint]);
                assert!(p.is_finite() && v.abs() <= 4.0);
                let reach = 4.0 * (*pause_ns as f64 * 1e-9).max(1e-3);
                let most = if obeys(&action) && !obeyed { 0.2 } else { reach + 0.4 };
                assert!((p - at.position[joint]).abs() <= most + 1e-9);
            }
            obeyed = obeys(&action);
            at.position[..2].copy_from_slice(&setpoint.position[..2]);
            at.velocity[..2].copy_from_slice(&setpoint.velocity[..2]);
        }
        assert_eq!(allocation::counted(), before);
    }
}
