//! The frames and obstacles of a publisher.

use tprmp_messages::{Frame, NAME_CAPACITY, Reason, TaskFrames, name_str};
use tprmp_model::controller_config::ControllerConfig;

use crate::conformance::recording::Received;
use crate::conformance::table::{Check, Table, Verdict};
use crate::detail::{About, Detail, Snapshot, explain};
use crate::inputs::offender;

/// Judges frames and obstacles, where these frames are needed.
pub(super) fn judge(
    table: &mut Table,
    config: &ControllerConfig,
    frames: &[Received<TaskFrames>],
    needed: &[[u8; NAME_CAPACITY]],
) {
    let Some(last) = frames.last() else {
        table.add(Check::Frames, Verdict::Failed("none".into()));
        return;
    };
    let message = last.message;
    table.add(Check::Frames, Verdict::Passed(format!("{} messages", frames.len())));
    table.judge(Check::FrameClock, clock(config, frames));
    table.judge(Check::FramePoses, poses(&message, needed));
    table.judge(Check::Obstacles, obstacles(&message));
}

fn text(name: &[u8; NAME_CAPACITY]) -> String {
    name_str(name).unwrap_or("(no UTF-8)").to_owned()
}

fn say(message: &TaskFrames, needed: &[[u8; NAME_CAPACITY]], reason: Reason) -> String {
    let listed = message.listed().unwrap_or(&[]);
    let snapshot = Snapshot {
        detail: offender::of_scene(message, needed, reason),
        joints: Vec::new(),
        needed: needed.iter().map(text).collect(),
        found: listed.iter().map(|frame| text(&frame.name)).collect(),
    };
    explain(&snapshot).unwrap_or_else(|| format!("{reason:?}"))
}

fn clock(config: &ControllerConfig, frames: &[Received<TaskFrames>]) -> Result<String, String> {
    let most_ns = config.cycle.frames_age_max_ns as f64;
    let mut ages: Vec<f64> =
        frames.iter().map(|f| f.at_ns as f64 - f.message.time_ns as f64).collect();
    ages.sort_by(f64::total_cmp);
    let median = ages[ages.len() / 2];
    let newest = frames[frames.len() - 1];
    if median.abs() <= most_ns {
        let (median, most) = (1e-6 * median, 1e-6 * most_ns);
        return Ok(format!("received {median:.2} ms after the stamp, at most {most:.0} ms"));
    }
    let seen = newest.message.time_ns as f64;
    let detail = Detail::new(Reason::FramesStale, About::Clock, seen, [seen + median, most_ns]);
    let snapshot = Snapshot { detail, ..Snapshot::default() };
    Err(explain(&snapshot).unwrap_or_default().replace("states arrive", "frames arrive"))
}

fn poses(message: &TaskFrames, needed: &[[u8; NAME_CAPACITY]]) -> Result<String, String> {
    let say = |reason| say(message, needed, reason);
    let listed = message.listed().map_err(say)?;
    for (i, frame) in listed.iter().enumerate() {
        let name = name_str(&frame.name).filter(|name| !name.is_empty());
        let name = name.ok_or_else(|| format!("`frames[{i}]` has no name of UTF-8"))?;
        if listed[..i].iter().any(|other| other.name == frame.name) {
            return Err(format!("frame `{name}` is published twice"));
        }
        if frame.valid > 1 {
            return Err(format!("frame `{name}` has `valid` {}, expected 0 or 1", frame.valid));
        }
    }
    for frame in listed.iter().filter(|frame| frame.valid == 1) {
        frame.check().map_err(say)?;
    }
    if needed.iter().any(|name| Frame::find(listed, name).is_none_or(|found| found.valid != 1)) {
        return Err(say(Reason::FrameMissing));
    }
    let names: Vec<_> = listed.iter().map(|frame| text(&frame.name)).collect();
    let note =
        if needed.is_empty() { "; --model compares them with what a skill needs" } else { "" };
    Ok(format!("{}{note}", names.join(", ")))
}

fn obstacles(message: &TaskFrames) -> Result<String, String> {
    let say = |reason| say(message, &[], reason);
    let mut count = 0;
    for obstacle in message.present().map_err(say)? {
        obstacle.check().map_err(say)?;
        count += 1;
    }
    Ok(format!("{count}"))
}
