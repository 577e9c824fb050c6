//! State publishers and sources of frames in C: `include/tprmp.h` documents each function, and its callers keep
//! what it asks for. Nothing is done here but to call `tprmp_messages`.

#![expect(unsafe_code, reason = "C passes pointers")]

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_int};
use std::fmt::Display;
use std::ptr;

use tprmp_messages::{
    Action, Bounds, FrameSourcePort, Instance, JOINT_CAPACITY, JointBounds, JointCommand,
    RobotState, StatePublisher, TaskFrames,
};

type Joints = [f64; JOINT_CAPACITY];

/// `tprmp_joint_bounds`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct CBounds {
    speed_max: Joints,
    acceleration_max: Joints,
    deceleration: Joints,
    continuous: [u32; JOINT_CAPACITY],
}

/// `tprmp_action`.
#[derive(Debug)]
#[repr(C)]
pub struct CAction {
    obey: u32,
    padding: u32,
    position: Joints,
    velocity: Joints,
    command: JointCommand,
}

thread_local! {
    static ERROR: RefCell<CString> = RefCell::default();
}

/// Keeps why something has failed.
fn note(error: &dyn Display) {
    let text = error.to_string().replace('\0', "?");
    ERROR.with(|kept| *kept.borrow_mut() = CString::new(text).unwrap_or_default());
}

/// What C gets of something that was opened.
fn pointer<T>(opened: Result<T, Box<dyn std::error::Error>>) -> *mut T {
    opened.map_or_else(
        |error| {
            note(&error);
            ptr::null_mut()
        },
        |value| Box::into_raw(Box::new(value)),
    )
}

fn code(result: Result<(), impl Display>) -> c_int {
    result.map_or_else(
        |error| {
            note(&error);
            -1
        },
        |()| 0,
    )
}

/// A text of C, which has to be UTF-8.
///
/// # Safety
/// `text` ends with a zero and stays as it is for `'a`.
unsafe fn text<'a>(text: *const c_char) -> Result<&'a str, Box<dyn std::error::Error>> {
    // SAFETY: as this function's caller promises.
    Ok(unsafe { CStr::from_ptr(text) }.to_str()?)
}

/// See `tprmp.h`.
#[unsafe(no_mangle)]
pub extern "C" fn tprmp_now_ns() -> u64 {
    tprmp_messages::monotonic_ns()
}

/// See `tprmp.h`.
#[unsafe(no_mangle)]
pub extern "C" fn tprmp_error() -> *const c_char {
    ERROR.with(|kept| kept.borrow().as_ptr())
}

/// See `tprmp.h`.
///
/// # Safety
/// `instance` and the `joint_count` texts of `joints` end with a zero; `bounds` is null or points to bounds.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tprmp_open(
    instance: *const c_char,
    joints: *const *const c_char,
    joint_count: u32,
    bounds: *const CBounds,
) -> *mut StatePublisher {
    let open = || -> Result<_, Box<dyn std::error::Error>> {
        // SAFETY: as the caller promises; the same below.
        let joints = unsafe { std::slice::from_raw_parts(joints, joint_count as usize) };
        let names: Vec<_> =
            joints.iter().map(|name| unsafe { text(*name) }).collect::<Result<_, _>>()?;
        let joints = unsafe { bounds.as_ref() }.map(|bounds| JointBounds {
            speed_max: bounds.speed_max,
            acceleration_max: bounds.acceleration_max,
            deceleration: bounds.deceleration,
            continuous: bounds.continuous.map(|is| is != 0),
        });
        let instance = Instance::new(unsafe { text(instance) }?)?;
        Ok(StatePublisher::open(&instance, &names, Bounds { joints, ..Bounds::default() })?)
    };
    pointer(open())
}

/// See `tprmp.h`.
///
/// # Safety
/// `publisher` comes from [`tprmp_open`] and is used by this thread alone; the others point to what they say.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tprmp_command(
    publisher: *mut StatePublisher,
    now_ns: u64,
    state: *const RobotState,
    action: *mut CAction,
) {
    // SAFETY: as the caller promises.
    let (publisher, state) = unsafe { (&mut *publisher, &*state) };
    (publisher.state.position, publisher.state.velocity) = (state.position, state.velocity);
    let judged = publisher.command(now_ns);
    let (setpoint, command) = (*judged.setpoint(), *publisher.guard().command());
    let obey = u32::from(matches!(judged, Action::Obey(_)));
    let (position, velocity) = (setpoint.position, setpoint.velocity);
    // SAFETY: as the caller promises.
    unsafe { action.write(CAction { obey, padding: 0, position, velocity, command }) }
}

/// See `tprmp.h`.
///
/// # Safety
/// As [`tprmp_command`]; `frames` is null or points to frames.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tprmp_publish(
    publisher: *mut StatePublisher,
    now_ns: u64,
    frames: *mut TaskFrames,
    state: *mut RobotState,
) -> c_int {
    // SAFETY: as the caller promises.
    let (publisher, frames, state) = unsafe { (&mut *publisher, frames.as_mut(), &mut *state) };
    let RobotState { sequence, joint_count, joint_names_hash, .. } = publisher.state;
    publisher.state = RobotState { sequence, joint_count, joint_names_hash, ..*state };
    let sent = match frames {
        Some(frames) => publisher.publish(now_ns, frames),
        None => publisher.publish_state(now_ns),
    };
    *state = publisher.state;
    code(sent)
}

/// See `tprmp.h`.
///
/// # Safety
/// `publisher` is null or comes from [`tprmp_open`], and is used no more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tprmp_close(publisher: *mut StatePublisher) {
    if !publisher.is_null() {
        // SAFETY: as the caller promises.
        drop(unsafe { Box::from_raw(publisher) });
    }
}

/// See `tprmp.h`.
///
/// # Safety
/// `instance` ends with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tprmp_open_source(instance: *const c_char) -> *mut FrameSourcePort {
    // SAFETY: as the caller promises.
    let open = || Ok(Instance::new(unsafe { text(instance) }?)?.open_frame_source()?);
    pointer(open())
}

/// See `tprmp.h`.
///
/// # Safety
/// `source` comes from [`tprmp_open_source`] and is used by this thread alone; `frames` points to frames.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tprmp_publish_source(
    source: *mut FrameSourcePort,
    now_ns: u64,
    frames: *mut TaskFrames,
) -> c_int {
    // SAFETY: as the caller promises.
    let (source, frames) = unsafe { (&*source, &mut *frames) };
    code(source.publish(now_ns, frames))
}

/// See `tprmp.h`.
///
/// # Safety
/// `source` is null or comes from [`tprmp_open_source`], and is used no more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tprmp_close_source(source: *mut FrameSourcePort) {
    if !source.is_null() {
        // SAFETY: as the caller promises.
        drop(unsafe { Box::from_raw(source) });
    }
}
