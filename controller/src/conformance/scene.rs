//! The frames and obstacles of a publisher.

use tprmp_messages::{
    NAME_CAPACITY, OBSTACLE_CAPACITY, PublishedFrames, Reason, TaskFrames, name_str, source_text,
};
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
    let mut newest: Vec<&TaskFrames> = Vec::new();
    for received in frames {
        match newest.iter_mut().find(|other| other.source == received.message.source) {
            Some(other) => *other = &received.message,
            None => newest.push(&received.message),
        }
    }
    let published = PublishedFrames::of(&newest, last.at_ns, config.cycle.frames_age_max_ns);
    table.add(Check::Frames, Verdict::Passed(counted(frames, &newest)));
    table.judge(Check::FrameClock, clock(config, frames, &newest));
    table.judge(Check::FramePoses, poses(&published, needed));
    table.judge(Check::Obstacles, obstacles(&published));
}

/// How many messages there are; of several sources, of each of them.
fn counted(frames: &[Received<TaskFrames>], newest: &[&TaskFrames]) -> String {
    let of = |name| frames.iter().filter(|received| received.message.source == name).count();
    let counts = newest.iter().map(|message| {
        let source = source_text(&message.source);
        format!("{} of {source}", of(message.source))
    });
    match newest {
        [_] => format!("{} messages", frames.len()),
        _ => format!("messages: {}", counts.collect::<Vec<_>>().join(", ")),
    }
}

fn text(name: &[u8; NAME_CAPACITY]) -> String {
    name_str(name).unwrap_or("(no UTF-8)").to_owned()
}

fn say(published: &PublishedFrames<'_>, needed: &[[u8; NAME_CAPACITY]], reason: Reason) -> String {
    let listed = published.messages().flat_map(|message| message.listed().unwrap_or(&[]));
    let snapshot = Snapshot {
        detail: offender::of_scene(published, needed, reason),
        joints: Vec::new(),
        needed: needed.iter().map(text).collect(),
        found: listed.map(|frame| text(&frame.name)).collect(),
    };
    explain(&snapshot).unwrap_or_else(|| format!("{reason:?}"))
}

/// The clock of each source: the worst counts.
fn clock(
    config: &ControllerConfig,
    frames: &[Received<TaskFrames>],
    newest: &[&TaskFrames],
) -> Result<String, String> {
    let most_ns = config.cycle.frames_age_max_ns as f64;
    let median = |message: &&TaskFrames| {
        let own = frames.iter().filter(|received| received.message.source == message.source);
        let mut ages: Vec<f64> = own.map(|f| f.at_ns as f64 - f.message.time_ns as f64).collect();
        ages.sort_by(f64::total_cmp);
        (ages[ages.len() / 2], message.time_ns as f64, message.source)
    };
    let worst = newest.iter().map(median).max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    let (median, seen, source) = worst.ok_or("none")?;
    if median.abs() <= most_ns {
        let (median, most) = (1e-6 * median, 1e-6 * most_ns);
        return Ok(format!("received {median:.2} ms after the stamp, at most {most:.0} ms"));
    }
    let detail = Detail::new(Reason::FramesStale, About::Clock, seen, [seen + median, most_ns]);
    let snapshot = Snapshot { detail, ..Snapshot::default() };
    let said = explain(&snapshot).unwrap_or_default().replace("states arrive", "frames arrive");
    Err(if newest.len() == 1 { said } else { format!("{}: {said}", source_text(&source)) })
}

fn poses(
    published: &PublishedFrames<'_>,
    needed: &[[u8; NAME_CAPACITY]],
) -> Result<String, String> {
    let say = |reason| say(published, needed, reason);
    let mut names: Vec<String> = Vec::new();
    for message in published.messages() {
        for (i, frame) in message.listed().map_err(say)?.iter().enumerate() {
            let name = name_str(&frame.name).filter(|name| !name.is_empty());
            let name = name.ok_or_else(|| format!("`frames[{i}]` has no name of UTF-8"))?;
            if names.iter().any(|other| other == name) {
                return Err(format!("frame `{name}` is published twice"));
            }
            if frame.valid > 1 {
                return Err(format!("frame `{name}` has `valid` {}, expected 0 or 1", frame.valid));
            }
            if frame.valid == 1 {
                frame.check().map_err(say)?;
            }
            names.push(name.to_owned());
        }
    }
    let unusable = |name| published.claims(name).next().is_none_or(|found| found.frame.valid != 1);
    if needed.iter().any(unusable) {
        return Err(say(Reason::FrameMissing));
    }
    let note =
        if needed.is_empty() { "; --model compares them with what a skill needs" } else { "" };
    Ok(format!("{}{note}", names.join(", ")))
}

fn obstacles(published: &PublishedFrames<'_>) -> Result<String, String> {
    let say = |reason| say(published, &[], reason);
    let mut count = 0;
    for message in published.messages() {
        for obstacle in message.present().map_err(say)? {
            obstacle.check().map_err(say)?;
            count += 1;
        }
    }
    if count > OBSTACLE_CAPACITY { Err(say(Reason::ObstacleCount)) } else { Ok(format!("{count}")) }
}
