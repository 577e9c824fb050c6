//! Numbers that can be read but are hardly meant: other units, a wrong sampling time, a sensor that
//! lost its way. They are warned of, not refused.

use tprmp_spatial::Pose;

use crate::demonstration::bounds::diagonal;
use crate::demonstration::recorded::Demonstration;

/// No tool is faster [m/s].
const SPEED_MAX_M_S: f64 = 20.0;
/// … or rotates faster [rad/s].
const SPEED_MAX_RAD_S: f64 = 50.0;
/// No arm reaches farther \[m\].
pub const SPAN_MAX_M: f64 = 20.0;
/// A step so many times as long as those beside it is a jump.
const JUMP_RATIO: f64 = 4.0;
/// … unless it is shorter than this fraction of the span [1] …
const JUMP_FRACTION: f64 = 0.01;
/// … or this angle [rad].
const JUMP_MIN_RAD: f64 = 0.1;

/// What is implausible in these demonstrations: a sentence each, which names the worst file.
#[must_use]
pub fn warnings(demonstrations: &[Demonstration]) -> Vec<String> {
    let mut warnings = Vec::new();
    let mut warn = |measure: fn(&Demonstration) -> Option<Found>, text: fn(&Found) -> String| {
        let found = demonstrations.iter().filter_map(|d| Some((d, measure(d)?)));
        let found: Vec<_> = found.collect();
        let Some((worst, most)) = found.iter().max_by(|a, b| a.1.size.total_cmp(&b.1.size)) else {
            return;
        };
        warnings.push(format!("{} {}", with_others(&worst.name, found.len()), text(most)));
    };
    warn(span, |f| {
        format!("spans {:.0} m: expected positions in metres, are they millimetres?", f.size)
    });
    warn(jump, |f| format!("jumps by {:.3} m at sample {}: is a sample broken?", f.size, f.sample));
    warn(rotation_jump, |f| {
        format!("jumps by {:.2} rad at sample {}: is a sample broken?", f.size, f.sample)
    });
    warn(speed, |f| {
        format!(
            "moves at {:.0} m/s at sample {}: are `sampling_time_s` and the unit right?",
            f.size, f.sample
        )
    });
    warn(angular_speed, |f| {
        format!(
            "rotates at {:.0} rad/s at sample {}: is `sampling_time_s` right?",
            f.size, f.sample
        )
    });
    warnings
}

/// The worst of so many demonstrations, and how many others there are.
pub(crate) fn with_others(worst: &str, count: usize) -> String {
    match count {
        1 => format!("`{worst}`"),
        2 => format!("`{worst}` (and 1 other)"),
        _ => format!("`{worst}` (and {} others)", count - 1),
    }
}

/// Something implausible, and where.
struct Found {
    size: f64,
    sample: usize,
}

/// Diagonal of the box around samples and frames [m], when it is too large.
fn span(demonstration: &Demonstration) -> Option<Found> {
    let size = extent(demonstration);
    (size > SPAN_MAX_M).then_some(Found { size, sample: 0 })
}

fn extent(demonstration: &Demonstration) -> f64 {
    let frames = [&demonstration.start, &demonstration.goal_frame];
    diagonal(demonstration.poses.iter().chain(frames).map(|pose| pose.position))
}

/// Distance between neighbouring samples [m].
fn steps(demonstration: &Demonstration) -> Vec<f64> {
    let pairs = demonstration.poses.windows(2);
    pairs.map(|p| (p[1].position - p[0].position).length()).collect()
}

/// Angle between two orientations \[rad\].
pub fn angle(a: &Pose, b: &Pose) -> f64 {
    let rotation = a.orientation.conjugate() * b.orientation;
    2.0 * rotation.xyz().length().atan2(rotation.w.abs())
}

/// Angle between neighbouring samples [rad].
fn rotations(demonstration: &Demonstration) -> Vec<f64> {
    demonstration.poses.windows(2).map(|p| angle(&p[0], &p[1])).collect()
}

fn jump(demonstration: &Demonstration) -> Option<Found> {
    lone(&steps(demonstration), JUMP_FRACTION * extent(demonstration))
}

fn rotation_jump(demonstration: &Demonstration) -> Option<Found> {
    lone(&rotations(demonstration), JUMP_MIN_RAD)
}

fn speed(demonstration: &Demonstration) -> Option<Found> {
    fastest(&steps(demonstration), demonstration.sampling_time_s, SPEED_MAX_M_S)
}

fn angular_speed(demonstration: &Demonstration) -> Option<Found> {
    fastest(&rotations(demonstration), demonstration.sampling_time_s, SPEED_MAX_RAD_S)
}

/// The longest step that is far longer than those two and three places away from it: a sample that
/// is off makes two long steps in a row, a smooth start or stop has long ones on one side.
fn lone(steps: &[f64], least: f64) -> Option<Found> {
    let far = |i: usize| {
        let beside = [i.wrapping_sub(3), i.wrapping_sub(2), i + 2, i + 3];
        let beside = beside.iter().filter_map(|j| steps.get(*j)).fold(0.0, |a: f64, b| a.max(*b));
        steps[i] > least && steps[i] > JUMP_RATIO * beside
    };
    let mut found = longest((0..steps.len()).filter(|i| far(*i)).map(|i| (i, steps[i])))?;
    // The step back to the path, from the sample that is off it.
    if found.sample >= 2 && far(found.sample - 2) {
        found.sample -= 1;
    }
    Some(found)
}

/// The fastest step, when it is too fast.
fn fastest(steps: &[f64], sampling_time_s: f64, most: f64) -> Option<Found> {
    let speeds = steps.iter().map(|step| step / sampling_time_s).enumerate();
    longest(speeds.filter(|(_, speed)| *speed > most))
}

fn longest(steps: impl Iterator<Item = (usize, f64)>) -> Option<Found> {
    let longest = steps.max_by(|a, b| a.1.total_cmp(&b.1));
    longest.map(|(i, size)| Found { size, sample: i + 1 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use std::path::Path;
    use tprmp_model::skill_model::{Manifold, Remarks};

    use crate::demonstration::file::read_folder;

    /// A rotation and a bow of half a metre in two seconds, at rest at both ends.
    fn demonstrated() -> Demonstration {
        let poses = (0..=100).map(|i| {
            let t = f64::from(i) / 100.0;
            let s = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
            let (sin, cos) = (2.0 * s).sin_cos();
            let orientation = DQuat::from_rotation_z(1.5 * s);
            Pose { position: DVec3::new(0.3 * cos, 0.3 * sin, 0.1), orientation }
        });
        Demonstration {
            name: "03.json".into(),
            sha256: String::new(),
            skill: "made_up".into(),
            manifold: Manifold::R3S3,
            sampling_time_s: 0.02,
            start: Pose::IDENTITY,
            goal_frame: Pose::IDENTITY,
            other_frames: std::collections::BTreeMap::new(),
            remarks: Remarks::default(),
            poses: poses.collect(),
            gripper: None,
        }
    }

    #[track_caller]
    fn warned(edit: impl Fn(&mut Demonstration), expected: &[&str]) {
        let mut demonstration = demonstrated();
        edit(&mut demonstration);
        let warnings = warnings(&[demonstrated(), demonstration]);
        assert_eq!(warnings.len(), expected.len(), "{warnings:?}");
        for (warning, expected) in warnings.iter().zip(expected) {
            assert!(warning.contains(expected), "{warning}");
        }
    }

    #[test]
    fn what_is_plausible_is_not_warned_of() {
        warned(|_| {}, &[]);
        // A motion that starts and stops at full speed.
        warned(|d| d.poses = d.poses[40..60].to_vec(), &[]);
        // One that rests in between.
        warned(|d| d.poses.splice(50..50, [d.poses[50]; 30]).for_each(drop), &[]);
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config");
        for (skill, manifold, [start, goal]) in [
            ("pick", Manifold::R3S3, ["ee_start", "object"]),
            ("planar", Manifold::R2, ["start", "end"]),
        ] {
            let folder = config.join("demonstrations").join(skill);
            let read = read_folder(&folder, skill, manifold, start, goal, &[]);
            assert_eq!(warnings(&read.unwrap()), Vec::<String>::new());
        }
    }

    #[test]
    fn other_units_are_found() {
        let millimetres = |d: &mut Demonstration| {
            d.poses.iter_mut().for_each(|pose| pose.position *= 1e3);
        };
        warned(millimetres, &["`03.json` spans", "m/s"]);
        warned(|d| d.goal_frame.position.x = 400.0, &["spans 400 m"]);
        warned(|d| d.sampling_time_s = 2e-5, &["m/s", "rad/s"]);
        let mut large = demonstrated();
        millimetres(&mut large);
        let all = [large.clone(), demonstrated(), large.clone(), large];
        assert!(warnings(&all)[0].contains("(and 2 others)"), "{:?}", warnings(&all));
    }

    #[test]
    fn a_broken_sample_is_found_by_its_number() {
        warned(|d| d.poses[57].position.x += 0.1, &["m at sample 57"]);
        warned(|d| d.poses[3].position.y -= 0.05, &["m at sample 3"]);
        let later = |d: &mut Demonstration| {
            d.poses[30..].iter_mut().for_each(|pose| pose.position.z += 0.2);
        };
        warned(later, &["jumps by 0.20"]);
        let turned = DQuat::from_rotation_x(0.8);
        warned(|d| d.poses[70].orientation *= turned, &["rad at sample 70"]);
    }
}
