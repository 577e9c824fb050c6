//! Limits of joints: those of the file, or in place of them those that are given beside it.

use crate::description::JointLimits;
use crate::document::{Joint, JointType};
use crate::error::{LackingLimits, UrdfErrorKind as Kind};
use crate::ranges::{EFFORT_LIMIT_MAX, POSITION_LIMIT_MAX, SPEED_LIMIT_MAX};
use crate::selection::LimitOverride;

/// No limits at all: where they are and position limits of continuous joints are.
const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// Stands for limits with a fault, so that the rest of the file can be judged.
pub(crate) const UNKNOWN: JointLimits =
    JointLimits { lower: FREE[0], upper: FREE[1], velocity: f64::INFINITY, effort: f64::INFINITY };

/// Joints that lack limits.
#[derive(Debug, Default)]
pub(crate) struct Lacking(Vec<LackingLimits>);

impl Lacking {
    /// One fault of all.
    pub(crate) fn fault(self) -> Option<Kind> {
        (!self.0.is_empty()).then_some(Kind::NoLimits { joints: self.0 })
    }
}

/// The limits of a joint that moves. What is missing is added to `lacking`, unless the element cannot be
/// read (`is_unread`), which is a fault of its own; an effort limit that is missing and not needed is infinite.
///
/// # Errors
/// The line, and what is wrong with the limits that there are.
pub(crate) fn limits(
    joint: &Joint,
    given: &LimitOverride,
    needs_effort: bool,
    is_unread: bool,
    lacking: &mut Lacking,
) -> Result<JointLimits, (usize, Kind)> {
    let line = joint.limit.line.unwrap_or(joint.line);
    let place = |kind| (line, kind);
    let position = match given.position {
        Some([lower, upper]) if lower < upper => Some([lower, upper]),
        Some([lower, upper]) => {
            return Err(place(Kind::LimitOrder { joint: joint.name.clone(), lower, upper }));
        }
        None => position(joint).map_err(place)?,
    };
    let (speed, force) = match joint.joint_type {
        JointType::Prismatic => ("m/s", "N"),
        _ => ("rad/s", "N m"),
    };
    let file = &joint.limit;
    let velocity = or_of_file(given.velocity, file.velocity, SPEED_LIMIT_MAX);
    let velocity = velocity.map_err(|found| not_positive(joint, "velocity", speed, found));
    let effort = or_of_file(given.effort, file.effort, EFFORT_LIMIT_MAX);
    let effort = effort.map_err(|found| not_positive(joint, "effort", force, found));
    let (velocity, effort) = (velocity.map_err(place)?, effort.map_err(place)?);
    let lacks = LackingLimits {
        joint: joint.name.clone(),
        line,
        position: position.is_none(),
        velocity: velocity.is_none(),
        effort: effort.is_none() && needs_effort,
    };
    if (lacks.position || lacks.velocity || lacks.effort) && !is_unread {
        lacking.0.push(lacks);
    }
    let [lower, upper] = position.unwrap_or(FREE);
    Ok(JointLimits {
        lower,
        upper,
        velocity: velocity.unwrap_or(UNKNOWN.velocity),
        effort: effort.unwrap_or(UNKNOWN.effort),
    })
}

/// A limit that has to be above zero: `None` for zero, and where there is none.
fn or_of_file(given: Option<f64>, file: Option<f64>, most: f64) -> Result<Option<f64>, f64> {
    let Some(limit) = given.or(file) else { return Ok(None) };
    if limit < 0.0 || limit.is_nan() {
        return Err(limit);
    }
    Ok((limit > 0.0 && limit <= most).then_some(limit))
}

fn not_positive(joint: &Joint, limit: &'static str, unit: &'static str, found: f64) -> Kind {
    Kind::LimitNotPositive { joint: joint.name.clone(), limit, unit, found }
}

/// Position limits of the file, narrowed by its soft limits [rad or m]; `None` where it has none.
fn position(joint: &Joint) -> Result<Option<[f64; 2]>, Kind> {
    if joint.joint_type == JointType::Continuous {
        return Ok(Some(FREE));
    }
    let Some(hard) = range(joint) else { return Ok(None) };
    let name = || joint.name.clone();
    let quantity = "limit";
    if let Some(found) = hard.into_iter().find(|end| end.is_nan()) {
        return Err(Kind::NotFinite { element: "joint", name: name(), quantity, found });
    }
    let [lower, upper] = hard;
    if lower >= upper {
        return Err(Kind::LimitOrder { joint: name(), lower, upper });
    }
    // Zeros stand for none.
    let Some(soft) = joint.soft_limits.filter(|soft| *soft != [0.0; 2]) else {
        return Ok(Some(hard));
    };
    let narrowed = [lower.max(soft[0]), upper.min(soft[1])];
    if narrowed[0] < narrowed[1] {
        Ok(Some(narrowed))
    } else {
        Err(Kind::SoftLimits { joint: name(), hard, soft })
    }
}

/// The position limits as they stand in the file. One that is missing is zero, as the format says; where
/// both are missing or zero there are none.
fn range(joint: &Joint) -> Option<[f64; 2]> {
    let ends = [joint.limit.lower.unwrap_or(0.0), joint.limit.upper.unwrap_or(0.0)];
    let far = |end: f64| if end.abs() > POSITION_LIMIT_MAX { end * f64::INFINITY } else { end };
    (ends != [0.0; 2]).then_some(ends.map(far))
}

/// Where a joint can be held: of its range the nearest to zero [rad or m].
pub(crate) fn nearest_to_zero(joint: &Joint) -> f64 {
    match range(joint) {
        Some([lower, upper]) if lower <= upper => 0.0_f64.clamp(lower, upper),
        _ => 0.0,
    }
}

/// The range of a joint, if it does not have this position.
pub(crate) fn range_outside(joint: &Joint, position: f64) -> Option<[f64; 2]> {
    let [lower, upper] = match joint.joint_type {
        JointType::Revolute | JointType::Prismatic => range(joint).unwrap_or(FREE),
        JointType::Continuous => FREE,
        // They have no single coordinate, and are held where they are at zero.
        _ => [0.0; 2],
    };
    (!position.is_finite() || position < lower || position > upper).then_some([lower, upper])
}
