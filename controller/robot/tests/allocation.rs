//! Evaluation allocates nothing.

#[expect(unreachable_pub, reason = "a module of the controller, whose allocator counts here too")]
#[path = "../../src/timing/allocation.rs"]
mod counting;

use crate::common::{GRAVITY, states, ur5};
use tprmp_robot::{
    ControlPoints, Kinematics, forward_dynamics, forward_kinematics,
    forward_kinematics_with_velocity, gravity_torques, inverse_dynamics, mass_matrix, point_motion,
    point_position,
};

#[global_allocator]
static ALLOCATOR: counting::CountingAllocator = counting::CountingAllocator;

#[test]
fn evaluation_allocates_nothing() {
    let chain = ur5();
    let points = ControlPoints::new(&chain).unwrap();
    let mut kinematics = Kinematics::new();
    let states: Vec<_> = states::<6>(31).collect();
    let before = counting::counted();
    assert!(before > 0, "the counter works");
    let mut sum = 0.0;
    for [q, q_d, q_dd] in &states {
        forward_kinematics(&chain, q, &mut kinematics);
        forward_kinematics_with_velocity(&chain, q, q_d, &mut kinematics);
        for point in points.as_slice() {
            sum += point_position(&kinematics, point.joint, point.centre).x;
            sum += point_motion(&chain, &kinematics, point.joint, point.centre).drift.x;
        }
        let torques = inverse_dynamics(&chain, q, q_d, q_dd, GRAVITY);
        sum += gravity_torques(&chain, q, GRAVITY).sum() + mass_matrix(&chain, q).sum();
        sum += forward_dynamics(&chain, q, q_d, &torques, GRAVITY).map_or(f64::NAN, |a| a.sum());
    }
    assert_eq!(counting::counted(), before);
    assert!(sum.is_finite());
}
