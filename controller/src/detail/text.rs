//! A detail as a sentence: which joint or frame, what was seen, what was expected, the likely cause, the remedy.

use core::fmt::Write;

use tprmp_messages::{
    FRAME_CAPACITY, FRAME_SOURCES_MAX, NAME_CAPACITY, NUMBER_MAX, OBSTACLE_CAPACITY,
    joint_names_hash, name_str, source_text,
};

use crate::detail::seen::{About, Detail};
use crate::detail::shared::Snapshot;

/// An age below this is latency, above it another clock \[ns\].
const LATENCY_MAX_NS: f64 = 2e9;
/// Frames are older than this where their source stopped long ago, or has another clock \[ns\].
const FRAMES_GONE_NS: f64 = 1e10;
/// Stamps of simulated clocks begin near zero \[ns\].
const SIMULATED_MAX_NS: f64 = 3.6e12;
/// CLOCK_REALTIME counts from 1970: later than this \[ns\].
const REALTIME_MIN_NS: f64 = 1.0e18;
/// A joint that is reported modulo a turn leaps by one but for less than this \[rad\].
const TURN_NEAR_RAD: f64 = 0.1;

/// What was seen, in words; `None` where there is nothing to add to the reason.
#[must_use]
pub fn explain(snapshot: &Snapshot) -> Option<String> {
    let detail = &snapshot.detail;
    joint_text(snapshot)
        .or_else(|| message_text(snapshot))
        .or_else(|| source_of_frames_text(snapshot))
        .or_else(|| frame_text(snapshot))
        .or_else(|| obstacle_text(detail))
}

fn joint(snapshot: &Snapshot) -> String {
    let index = snapshot.detail.index as usize;
    let name = snapshot.joints.get(index).map_or("?", String::as_str);
    format!("joint {} `{name}`", index + 1)
}

fn joint_text(snapshot: &Snapshot) -> Option<String> {
    let Detail { about, seen, expected: [least, most], .. } = snapshot.detail;
    let joint = joint(snapshot);
    Some(match about {
        About::Position => {
            let cause = if within(seen.to_radians(), least, most) && seen.abs() > 1.0 {
                format!(
                    "; in degrees it would be {:.3} rad, which is inside: publish radians",
                    seen.to_radians()
                )
            } else if within(1e-3 * seen, least, most) && seen.abs() > 10.0 {
                "; in millimetres it would be inside: publish rad or m".into()
            } else {
                "; likely another zero or sign of the joint, or joints in another order".into()
            };
            format!("{joint} is at {seen:.4}, expected {least:.4} to {most:.4} rad or m{cause}")
        }
        About::PositionNotFinite => not_finite(&joint, "position", seen),
        About::VelocityNotFinite => not_finite(&joint, "velocity", seen),
        About::TorqueNotFinite => not_finite(&joint, "torque", seen),
        About::Speed => format!(
            "{joint} has a velocity of {seen:.3}, at most {least:.3} rad/s or m/s is believed: \
             likely another unit, or the difference of two readings"
        ),
        About::PositionJump => {
            let cause = if (seen.to_radians() - least).abs() < 0.05 {
                "it is where it was if these are degrees: publish radians"
            } else if (least.to_radians() - seen).abs() < 0.05 {
                "it was in degrees before"
            } else if ((seen - least).abs() - core::f64::consts::TAU).abs() < TURN_NEAR_RAD {
                "it jumped by 2π: the robot reports this joint modulo a turn; unwrap it in the publisher, or \
                 make the joint `continuous` in the URDF"
            } else {
                "likely a reading that is wrong, or another source of states"
            };
            format!(
                "{joint} is at {seen:.4}, expected {least:.4} ± {most:.4} rad or m by the state before: {cause}"
            )
        }
        About::VelocityJump => format!(
            "{joint} has a velocity of {seen:.4}, expected {least:.4} ± {most:.4} rad/s or m/s by the state \
             before: likely a velocity that is not filtered, or of another unit"
        ),
        About::Drift => format!(
            "{joint} has moved by {seen:.4} beside what its velocities say, at most {least:.4} rad or m is \
             believed: measure the velocity, in rad/s or m/s and with the position's sign"
        ),
        About::Frozen => format!(
            "{joint} stays at {seen:.5} to the last digit, commanded is {least:.5} rad or m, for {:.0} ms \
             now: likely the same reading again with a new stamp, or a drive that does not obey; after a \
             second try it waits for a position that changes, or a reset",
            1e3 * most
        ),
        _ => return None,
    })
}

fn within(value: f64, least: f64, most: f64) -> bool {
    (least..=most).contains(&value)
}

fn not_finite(what: &str, field: &str, seen: f64) -> String {
    let expected =
        if seen.is_finite() { format!("at most {NUMBER_MAX:e}") } else { "a number".to_owned() };
    format!("{what}: {field} is {seen:e}, expected {expected}: likely a reading that failed")
}

fn message_text(snapshot: &Snapshot) -> Option<String> {
    let detail = &snapshot.detail;
    let Detail { about, seen, expected: [one, other], .. } = *detail;
    Some(match about {
        About::JointCount => {
            let names = snapshot.joints.join(", ");
            format!("`joint_count` is {seen}, expected {one}: {names}")
        }
        About::JointNames => joint_order(snapshot),
        About::Sequence => format!(
            "`sequence` is {seen}, expected more than {one}: count up by one from state to state, in \
             one publisher"
        ),
        About::Stamp => format!(
            "`time_ns` is {seen:.0} as before, expected more than {one:.0}: stamp each state when it is \
             measured"
        ),
        About::Clock => clock(seen, one, other),
        About::Age => format!(
            "the newest is {:.1} ms old, at most {:.1} ms is permitted: likely the publisher has stopped, \
             was held up, or publishes fewer than {:.0} states a second",
            1e-6 * seen,
            1e-6 * one,
            (1e9 / one).ceil()
        ),
        About::Lost => format!("{seen} states are missing in a row, at most {one} may be"),
        About::Unanswered => format!(
            "{seen} states came while the first one was not answered yet: this controller runs in lockstep \
             and the publisher in real time; start both with --lockstep, or both without"
        ),
        About::RobotMode => format!("`robot_mode` is {seen}"),
        About::Gripper => format!("`gripper_state` is {seen}, expected 1 (open) or 2 (holding)"),
        _ => return None,
    })
}

/// Which order the publisher has, where it is one of the robot's joints.
fn joint_order(snapshot: &Snapshot) -> String {
    let expected = snapshot.joints.join(", ");
    let hash = hash_of(&snapshot.detail);
    let found = order_of(hash, &snapshot.joints).map_or_else(
        || format!("other names (their hash is {hash:#018x})"),
        |order| order.join(", "),
    );
    format!(
        "expected the joints in the order {expected}; found {found}: publish them in this order"
    )
}

fn hash_of(detail: &Detail) -> u64 {
    let mut bytes = [0; 8];
    bytes.copy_from_slice(&detail.name[..8]);
    u64::from_ne_bytes(bytes)
}

/// The order of these joints that has this hash; `None` where none has.
#[must_use]
pub(crate) fn order_of(hash: u64, joints: &[String]) -> Option<Vec<&str>> {
    let mut order: Vec<&str> = joints.iter().map(String::as_str).collect();
    permuted(&mut order, 0, hash).then_some(order)
}

/// Tries all orders of what comes after `fixed`.
fn permuted(order: &mut [&str], fixed: usize, hash: u64) -> bool {
    if fixed + 1 >= order.len() {
        return joint_names_hash(order) == hash;
    }
    for i in fixed..order.len() {
        order.swap(fixed, i);
        if permuted(order, fixed + 1, hash) {
            return true;
        }
        order.swap(fixed, i);
    }
    false
}

/// A stamp that is not about now.
fn clock(stamp_ns: f64, now_ns: f64, most_ns: f64) -> String {
    let age_ns = now_ns - stamp_ns;
    let near = |scaled: f64| (scaled - now_ns).abs() < 1e-2 * now_ns;
    if (0.0..LATENCY_MAX_NS).contains(&age_ns) {
        return format!(
            "states arrive {:.1} ms after they were measured, at most {:.1} ms is permitted \
             (`loop.state_age_max_ns`): likely the way from the robot to the publisher takes so long; \
             stamp when it was measured, and read the robot more often",
            1e-6 * age_ns,
            1e-6 * most_ns
        );
    }
    let cause = if stamp_ns == 0.0 {
        "it is not set"
    } else if stamp_ns > REALTIME_MIN_NS {
        "this is CLOCK_REALTIME; use CLOCK_MONOTONIC"
    } else if near(stamp_ns * 1e3) {
        "these are microseconds; publish nanoseconds"
    } else if near(stamp_ns * 1e6) {
        "these are milliseconds; publish nanoseconds"
    } else if near(stamp_ns * 1e9) {
        "these are seconds; publish nanoseconds"
    } else if stamp_ns < SIMULATED_MAX_NS {
        "likely simulated time: start both sides with --lockstep, or both without"
    } else {
        "likely the clock of another machine; use CLOCK_MONOTONIC of this one"
    };
    let direction = if age_ns < 0.0 { "ahead of" } else { "behind" };
    format!(
        "`time_ns` is {stamp_ns:.0}, {:.3} s {direction} now ({now_ns:.0}): {cause}",
        1e-9 * age_ns.abs()
    )
}

/// What is about several sources, or about when one was heard.
fn source_of_frames_text(snapshot: &Snapshot) -> Option<String> {
    let detail = &snapshot.detail;
    let Detail { about, seen, expected: [most, stamp_ns], .. } = *detail;
    let frame = name(&detail.name);
    let [one, other] = [0, 1].map(|i| source_text(&detail.sources[i]));
    let what =
        if frame.is_empty() { "the newest obstacles".into() } else { format!("frame `{frame}`") };
    Some(match about {
        // So old nothing is that was ever fresh on this clock, or the source has long gone: the stamp tells.
        About::FrameAge if !(0.0..FRAMES_GONE_NS).contains(&seen) => {
            format!("{what}{}: {}", of_source(detail), clock(stamp_ns, stamp_ns + seen, most))
        }
        About::FrameAge => format!(
            "{what}{} {} {:.1} ms old, at most {:.1} ms is permitted: likely its source has stopped, or was \
             held up",
            of_source(detail),
            if frame.is_empty() { "are" } else { "is" },
            1e-6 * seen,
            1e-6 * most
        ),
        About::FrameTwice => format!(
            "{what} is published by {one} and by {other}: let one of them publish it, or rename one"
        ),
        About::SourceTwice => {
            format!(
                "two publishers of frames have one `source`, {one}: give each a name of its own"
            )
        }
        About::SourceCount => {
            format!("{one} is one too many, at most {FRAME_SOURCES_MAX} are followed: end one")
        }
        About::ObstacleTotal => format!(
            "{seen} obstacles are published, at most {most} are followed; {one} goes beyond: publish the \
             nearest ones"
        ),
        _ => return None,
    })
}

/// Which source a message is of, where that has a name.
fn of_source(detail: &Detail) -> String {
    let source = &detail.sources[0];
    if source[0] == 0 { String::new() } else { format!(" of {}", source_text(source)) }
}

fn frame_text(snapshot: &Snapshot) -> Option<String> {
    let detail = &snapshot.detail;
    let Detail { about, seen, expected: [one, _], index, .. } = *detail;
    let frame = format!("frame `{}`{}", name(&detail.name), of_source(detail));
    Some(match about {
        About::FrameMissing => missing(snapshot, name(&detail.name)),
        About::FrameInvalid => {
            format!("{frame} has `valid` {seen}, expected 1: likely it is not seen at the moment")
        }
        About::FrameNotFinite => {
            let field = ["position", "quaternion", "linear_velocity", "angular_velocity"];
            not_finite(&frame, field[index.min(3) as usize], seen)
        }
        About::FrameQuaternion => format!(
            "{frame} has a quaternion of length {seen:.4}, expected 1: normalise it, w x y z"
        ),
        About::FrameFar => format!(
            "{frame} is {seen:.1} m from the base, at most {one:.0} m is believed: {}",
            if 1e-3 * seen < one {
                "likely millimetres; publish metres"
            } else {
                "publish it in the base's frame"
            }
        ),
        About::FrameOrder => format!(
            "{frame} is turned by {:.0}° from the tool that is there, and by {:.1}° with its \
             quaternion in the other order: likely x y z w; publish w x y z",
            seen.to_degrees(),
            one.to_degrees()
        ),
        About::StartElsewhere => format!(
            "{frame} is {seen:.3} m and {:.0}° from the tool that starts: publish where the tool is then, in the \
             base's frame, or leave it out, since `start_frame: Tool` needs none",
            one.to_degrees(),
        ),
        About::FrameCount => {
            let of = of_source(detail);
            format!("`frame_count`{of} is {seen}, at most {FRAME_CAPACITY} are carried")
        }
        _ => return None,
    })
}

fn name(bytes: &[u8; NAME_CAPACITY]) -> &str {
    name_str(bytes).unwrap_or("(no UTF-8)")
}

fn missing(snapshot: &Snapshot, frame: &str) -> String {
    let list = |names: &[String]| match names {
        [] => "none".to_owned(),
        names => names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", "),
    };
    let mut text = format!("frame `{frame}` is not published");
    // What was seen at that time is not kept of a reason that has passed.
    if !snapshot.needed.is_empty() {
        let [needed, found] = [&snapshot.needed, &snapshot.found].map(|names| list(names));
        let _ = write!(text, "; needed {needed}, found {found}");
    }
    let alike = snapshot.found.iter().find(|found| found.eq_ignore_ascii_case(frame));
    if let Some(alike) = alike {
        let _ = write!(text, ": `{alike}` differs by its case only");
    }
    text
}

fn obstacle_text(detail: &Detail) -> Option<String> {
    let Detail { about, seen, expected: [one, _], index, .. } = *detail;
    let of = of_source(detail);
    let obstacle = format!("`obstacles[{index}]`{of}");
    Some(match about {
        About::ObstacleKind => format!("{obstacle} has `kind` {seen}, expected 0 to 3"),
        About::ObstacleMark => format!("{obstacle} has `valid` {seen}, expected 0 or 1"),
        About::ObstacleSize => format!(
            "{obstacle} has `size[{one}]` {seen} m, expected more than 0, and a radius of at most 20: publish \
             metres; one that is not there has `valid` 0"
        ),
        About::ObstacleQuaternion => format!(
            "{obstacle} has a quaternion of length {seen:.4}, expected 1: normalise it, w x y z"
        ),
        About::ObstacleNotFinite => not_finite(&obstacle, "a field", seen),
        About::ObstacleCount => format!(
            "`obstacle_count`{of} is {seen}, at most {OBSTACLE_CAPACITY} are carried: publish the nearest ones"
        ),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use tprmp_messages::Reason;

    fn snapshot(detail: Detail) -> Snapshot {
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        Snapshot {
            detail,
            joints: names(&["a", "b", "c"]),
            needed: names(&["object"]),
            found: names(&["Object", "table"]),
        }
    }

    fn said(about: About, seen: f64, expected: [f64; 2]) -> String {
        let detail = Detail::new(Reason::JointLimit, about, seen, expected).at(1);
        explain(&snapshot(detail)).unwrap()
    }

    #[test]
    fn degrees_millimetres_and_clocks_are_told_by_their_numbers() {
        let now = 4.2e14;
        for (text, part) in [
            (said(About::Position, -157.0, [-6.3, 6.3]), "joint 2 `b` is at -157.0000"),
            (said(About::Position, -157.0, [-6.3, 6.3]), "publish radians"),
            (
                said(About::PositionJump, 90.0, [core::f64::consts::FRAC_PI_2, 0.1]),
                "publish radians",
            ),
            (said(About::PositionJump, -3.1, [3.15, 0.1]), "jumped by 2π"),
            (said(About::PositionJump, 6.2, [-0.03, 0.1]), "jumped by 2π"),
            (said(About::PositionJump, -3.1, [2.9, 0.1]), "a reading that is wrong"),
            (said(About::Clock, 1.7e18, [now, 5e7]), "CLOCK_REALTIME"),
            (said(About::Clock, now * 1e-3, [now, 5e7]), "microseconds"),
            (said(About::Clock, now * 1e-9, [now, 5e7]), "seconds"),
            (said(About::Clock, 1.1e9, [now, 5e7]), "--lockstep"),
            (said(About::Clock, 0.0, [now, 5e7]), "not set"),
            (said(About::Clock, now - 6.3e7, [now, 5e7]), "63.0 ms after"),
            (said(About::FrameFar, 512.0, [20.0, 0.0]), "millimetres"),
        ] {
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn sources_of_frames_are_named() {
        let name = |name| tprmp_messages::name_bytes(name).unwrap();
        let detail = |about, seen| {
            let mut detail = Detail::new(Reason::FrameTwice, about, seen, [1e8, 0.0]);
            detail.sources = [name("camera"), name("tracker")];
            detail
        };
        let said = |detail: Detail| explain(&snapshot(detail)).unwrap();
        let object = name("object");
        for (text, part) in [
            (
                said(detail(About::FrameTwice, 0.0).named(&object)),
                "`camera` and by source `tracker`",
            ),
            (
                said(detail(About::FrameAge, 5.32e8).named(&object)),
                "frame `object` of source `camera` is 532.0 ms old, at most 100.0 ms",
            ),
            (
                explain(&snapshot(Detail {
                    expected: [1e8, 1.79e18],
                    ..detail(About::FrameAge, 1e13 - 1.79e18).named(&object)
                }))
                .unwrap(),
                "frame `object` of source `camera`: `time_ns` is 1790000000000000000, 1789990000.000 s ahead of now \
                 (10000000000000): this is CLOCK_REALTIME",
            ),
            (said(detail(About::FrameAge, 5e8)), "obstacles of source `camera` are 500.0 ms old"),
            (
                said(detail(About::FrameFar, 512.0).named(&object)),
                "`object` of source `camera` is 512",
            ),
            (said(detail(About::ObstacleSize, 0.0)), "`obstacles[0]` of source `camera`"),
            (said(detail(About::SourceTwice, 0.0)), "one `source`, source `camera`"),
        ] {
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn an_order_of_joints_is_found_by_its_hash() {
        let told = |names: &[&str]| {
            let mut detail = Detail::new(Reason::JointOrder, About::JointNames, 0.0, [0.0; 2]);
            detail.name[..8].copy_from_slice(&joint_names_hash(names).to_ne_bytes());
            explain(&snapshot(detail)).unwrap()
        };
        assert!(told(&["c", "a", "b"]).contains("order a, b, c; found c, a, b"));
        assert!(told(&["c", "a", "x"]).contains("found other names"));
    }

    #[test]
    fn frames_that_are_needed_and_found_are_listed() {
        let object = tprmp_messages::name_bytes("object").unwrap();
        let detail = Detail::new(Reason::FrameMissing, About::FrameMissing, 0.0, [0.0; 2]);
        let text = explain(&snapshot(detail.named(&object))).unwrap();
        assert!(text.contains("needed `object`, found `Object`, `table`"), "{text}");
        assert!(text.contains("by its case only"), "{text}");
        assert!(explain(&snapshot(Detail::plain(Reason::FrameMissing))).is_none());
    }
}
