//! Evaluation allocates nothing.

#![allow(unsafe_code, reason = "a global allocator that counts is an unsafe trait")]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::{GRAVITY, states, ur5};
use tprmp_robot::{
    ControlPoints, Kinematics, forward_dynamics, forward_kinematics,
    forward_kinematics_with_velocity, gravity_torques, inverse_dynamics, mass_matrix,
    point_kinematics, point_position,
};

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

/// Counts the allocations of each thread.
struct Counting;

// SAFETY: every call is passed on unchanged to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the contract of `dealloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn evaluation_allocates_nothing() {
    let chain = ur5();
    let points = ControlPoints::new(&chain).unwrap();
    let mut kinematics = Kinematics::new();
    let states: Vec<_> = states::<6>(31).collect();
    let before = ALLOCATIONS.with(Cell::get);
    assert!(before > 0, "the counter works");
    let mut sum = 0.0;
    for [q, q_d, q_dd] in &states {
        forward_kinematics(&chain, q, &mut kinematics);
        forward_kinematics_with_velocity(&chain, q, q_d, &mut kinematics);
        for point in points.as_slice() {
            sum += point_position(&kinematics, point.joint, point.centre).x;
            sum += point_kinematics(&chain, &kinematics, point.joint, point.centre).jd_qd.x;
        }
        let torques = inverse_dynamics(&chain, q, q_d, q_dd, GRAVITY);
        sum += gravity_torques(&chain, q, GRAVITY).sum() + mass_matrix(&chain, q).sum();
        sum += forward_dynamics(&chain, q, q_d, &torques, GRAVITY).map_or(f64::NAN, |a| a.sum());
    }
    assert_eq!(ALLOCATIONS.with(Cell::get), before);
    assert!(sum.is_finite());
}
