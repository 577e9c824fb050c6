//! Where the gripper does something: its changes in the demonstrations become events at phases.
//!
//! In each demonstration the changes are found by themselves: a word that changes, or a width that
//! changes by more than a fifth of what all widths span; an opening or closing that takes a while
//! is one change, in its middle. What is undone at once is chatter. The demonstrations that agree on the
//! order of changes, most of them, give each event's phase by their median.

use tprmp_drawing::quantile;
use tprmp_model::skill_model::{GRIPPER_EVENTS_MAX, GripperAction, GripperEvent};

use crate::alignment::Alignment;
use crate::canonical::PhaseProfile;
use crate::demonstration::plausibility::with_others;
use crate::demonstration::{Demonstration, Grip, Gripper};

/// A change that is undone within this time is chatter \[s\]: no gripper is so fast.
const CHATTER_S: f64 = 0.05;
/// Times are compared with this tolerance \[s\].
const TIME_TOLERANCE_S: f64 = 1e-9;
/// A width has changed when it has by more than this fraction of what the widths of all demonstrations span:
/// what a held object gives way is less.
const WIDTH_FRACTION: f64 = 0.2;
/// … and than this: less is noise, or play \[m\].
const WIDTH_MIN_M: f64 = 0.005;
/// Widths that span less do not change \[m\]: that is noise.
const WIDTH_SPAN_MIN_M: f64 = 1e-3;
/// A gripper that goes on by less than this fraction within [`RAMP_S`] has arrived.
const ARRIVED_FRACTION: f64 = 0.02;
/// See [`ARRIVED_FRACTION`] \[s\].
const RAMP_S: f64 = 0.2;
/// … or, where the change takes longer, within this fraction of the time that it has taken.
const STILL_FRACTION: f64 = 1.0 / 3.0;
/// Demonstrations whose events lie farther from the median phase than this are warned of.
const SPREAD_MAX: f64 = 0.2;

/// The events of a skill, and what is to be said of them.
#[derive(Debug, Default)]
pub struct Found {
    /// In order of their phases.
    pub events: Vec<GripperEvent>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// A change in a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Change {
    /// The sample, with its fraction.
    sample: f64,
    kind: Kind,
    /// The width after it \[m\], where it is known.
    width_m: f64,
}

/// In what changes of several demonstrations are the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Opens,
    Closes,
    Widens,
    Narrows,
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Opens => "opens",
            Self::Closes => "closes",
            Self::Widens => "gets wider",
            Self::Narrows => "gets narrower",
        })
    }
}

/// What a demonstration says.
struct Row<'a> {
    name: &'a str,
    alignment: &'a Alignment,
    changes: Vec<Change>,
}

impl Row<'_> {
    fn kinds(&self) -> impl Iterator<Item = Kind> + '_ {
        self.changes.iter().map(|change| change.kind)
    }
}

/// The events of demonstrations as they were recorded, with what was done to each and how the phase runs.
#[must_use]
pub fn find(recorded: &[Demonstration], alignments: &[Alignment], profile: &PhaseProfile) -> Found {
    let mut found = Found::default();
    let with: Vec<_> =
        recorded.iter().zip(alignments).filter(|(d, _)| d.gripper.is_some()).collect();
    if with.is_empty() {
        return found;
    }
    let without: Vec<&Demonstration> = recorded.iter().filter(|d| d.gripper.is_none()).collect();
    if let Some(first) = without.first() {
        found.warnings.push(format!(
            "{} says nothing of the gripper: its events are learned from the other demonstrations",
            with_others(&first.name, without.len())
        ));
    }
    let span_m = width_span_m(recorded);
    let (mut rows, mut chatter) = (Vec::new(), 0);
    for (demonstration, alignment) in with {
        let dt = demonstration.sampling_time_s;
        let gripper = demonstration.gripper.as_ref().expect("it has one");
        let (changes, undone) = changes(gripper, dt, span_m);
        if undone > 0 {
            chatter += 1;
            found.warnings.push(format!(
                "the gripper of `{}` chatters: {undone} change{} undone within {CHATTER_S} s, ignored",
                demonstration.name,
                if undone == 1 { " is" } else { "s are" }
            ));
        }
        rows.push(Row { name: &demonstration.name, alignment, changes });
    }
    if chatter > 1 {
        let first = found.warnings.len() - chatter;
        let more = found.warnings.len() - first - 1;
        found.warnings.truncate(first + 1);
        found.warnings[first].push_str(&format!("; so are those of {more} more"));
    }
    let agreed = agreeing(&rows, &mut found.warnings);
    let count = agreed[0].changes.len();
    if count > GRIPPER_EVENTS_MAX {
        found.warnings.push(format!(
            "the gripper changes {count} times, and a skill has at most {GRIPPER_EVENTS_MAX} events of it: none \
             is learned"
        ));
        return found;
    }
    for i in 0..count {
        let phases = phases(&agreed, i, profile);
        let event = event(&agreed, i, &phases);
        if event.spread > SPREAD_MAX {
            found.warnings.push(scattered(&agreed, i, &phases));
        }
        found.events.push(event);
    }
    found
}

/// That the phases of an event scatter.
fn scattered(agreed: &[&Row], i: usize, phases: &[f64]) -> String {
    let order = |a: &usize, b: &usize| phases[*a].total_cmp(&phases[*b]);
    let first = (0..phases.len()).min_by(order).expect("there are demonstrations");
    let last = (0..phases.len()).max_by(order).expect("there are demonstrations");
    format!(
        "the gripper {} at phases from {:.2} in `{}` to {:.2} in `{}`: the skill does it at their median; was the \
         gripper recorded with the same clock as the tool?",
        agreed[0].changes[i].kind,
        phases[first],
        agreed[first].name,
        phases[last],
        agreed[last].name
    )
}

/// How much the widths of all demonstrations span \[m\].
fn width_span_m(recorded: &[Demonstration]) -> f64 {
    let widths = recorded.iter().filter_map(|d| match &d.gripper {
        Some(Gripper::Widths(widths_m)) => Some(without_spikes(widths_m)),
        _ => None,
    });
    let (low, high) = widths
        .flatten()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), w| (low.min(w), high.max(w)));
    (high - low).max(0.0)
}

/// The largest group of demonstrations whose grippers do the same in the same order, the first of several;
/// a warning names the others.
fn agreeing<'a>(rows: &'a [Row<'a>], warnings: &mut Vec<String>) -> Vec<&'a Row<'a>> {
    let group =
        |of: &Row| -> Vec<&Row> { rows.iter().filter(|r| r.kinds().eq(of.kinds())).collect() };
    let mut agreed: Vec<&Row> = group(&rows[0]);
    for row in &rows[1..] {
        let own = group(row);
        if own.len() > agreed.len() {
            agreed = own;
        }
    }
    if agreed.len() < rows.len() {
        let others = rows.iter().filter(|row| !row.kinds().eq(agreed[0].kinds()));
        let others: Vec<String> =
            others.map(|row| format!("`{}` {}", row.name, sequence(row))).collect();
        let names: Vec<String> = agreed.iter().map(|row| format!("`{}`", row.name)).collect();
        warnings.push(format!(
            "the demonstrations contradict each other in what the gripper does: in {} it {}; but in {}: events \
             are learned from the former",
            names.join(", "),
            sequence(agreed[0]),
            others.iter().map(|other| other.replacen("` ", "` it ", 1)).collect::<Vec<_>>().join("; in ")
        ));
    }
    agreed
}

/// What a gripper does, for people.
fn sequence(row: &Row) -> String {
    let kinds: Vec<String> = row.kinds().map(|kind| kind.to_string()).collect();
    if kinds.is_empty() { "does nothing".into() } else { kinds.join(", then ") }
}

/// Fractions of the common time at which event `i` happens in each demonstration.
fn fractions(agreed: &[&Row], i: usize) -> Vec<f64> {
    agreed.iter().map(|row| fraction(row.alignment, row.changes[i].sample)).collect()
}

/// The phases there.
fn phases(agreed: &[&Row], i: usize, profile: &PhaseProfile) -> Vec<f64> {
    fractions(agreed, i).iter().map(|t| profile.at(*t)[0].clamp(0.0, 1.0)).collect()
}

/// Event `i` of demonstrations that agree, which happens at these phases.
fn event(agreed: &[&Row], i: usize, phases: &[f64]) -> GripperEvent {
    let median = |values: &[f64]| quantile(values, 0.5).expect("there are demonstrations");
    let phase = median(phases);
    let widths: Vec<f64> = agreed.iter().map(|row| row.changes[i].width_m).collect();
    GripperEvent {
        phase,
        time_fraction: median(&fractions(agreed, i)),
        action: match agreed[0].changes[i].kind {
            Kind::Opens => GripperAction::Opens,
            Kind::Closes => GripperAction::Closes,
            Kind::Widens | Kind::Narrows => GripperAction::WidthM(median(&widths)),
        },
        spread: phases.iter().map(|p| (p - phase).abs()).fold(0.0, f64::max),
        demonstrations: agreed.len() as u32,
    }
}

/// The fraction of the common time at a sample of the recording; what the gripper does while the tool rests
/// at an end happens there.
fn fraction(alignment: &Alignment, sample: f64) -> f64 {
    let samples = &alignment.samples;
    let last = samples.len() - 1;
    let after = samples.partition_point(|s| *s < sample);
    if after == 0 || after > last {
        return if after == 0 { 0.0 } else { 1.0 };
    }
    let (a, b) = (samples[after - 1], samples[after]);
    let part = if b > a { (sample - a) / (b - a) } else { 0.0 };
    (after as f64 - 1.0 + part) / last as f64
}

/// The changes of a gripper, and how many were undone at once; `span_m` is what widths span \[m\].
fn changes(gripper: &Gripper, sampling_time_s: f64, span_m: f64) -> (Vec<Change>, usize) {
    match gripper {
        Gripper::Grips(grips) => grip_changes(grips, sampling_time_s),
        Gripper::Widths(_) if span_m < WIDTH_SPAN_MIN_M => (Vec::new(), 0),
        Gripper::Widths(widths_m) => width_changes(widths_m, sampling_time_s, span_m),
    }
}

fn grip_changes(grips: &[Grip], dt: f64) -> (Vec<Change>, usize) {
    let mut kept: Vec<Change> = Vec::new();
    let mut undone = 0;
    for (i, pair) in grips.windows(2).enumerate().filter(|(_, pair)| pair[0] != pair[1]) {
        let kind = if pair[1] == Grip::Open { Kind::Opens } else { Kind::Closes };
        let change = Change { sample: i as f64 + 0.5, kind, width_m: 0.0 };
        // Of two words a change is always undone by the next one.
        if kept.last().is_some_and(|before| is_chatter(before, &change, dt)) {
            kept.pop();
            undone += 1;
        } else {
            kept.push(change);
        }
    }
    (kept, undone)
}

fn is_chatter(before: &Change, change: &Change, dt: f64) -> bool {
    (change.sample - before.sample) * dt <= CHATTER_S + TIME_TOLERANCE_S
}

/// Widths without what only one sample says: the middle of three.
fn without_spikes(widths_m: &[f64]) -> Vec<f64> {
    let last = widths_m.len() - 1;
    let middle = |i: usize| {
        let mut three = [widths_m[i.saturating_sub(1)], widths_m[i], widths_m[(i + 1).min(last)]];
        three.sort_by(f64::total_cmp);
        three[1]
    };
    (0..widths_m.len()).map(middle).collect()
}

fn width_changes(raw_m: &[f64], dt: f64, span_m: f64) -> (Vec<Change>, usize) {
    let (most, arrived) = ((WIDTH_FRACTION * span_m).max(WIDTH_MIN_M), ARRIVED_FRACTION * span_m);
    let widths_m = &without_spikes(raw_m)[..];
    let mut undone = raw_m.iter().zip(widths_m).filter(|(a, b)| (*a - *b).abs() > most).count();
    let mut kept: Vec<(Change, f64)> = Vec::new();
    let (mut settled_m, mut from, mut i) = (widths_m[0], 0, 1);
    while i < widths_m.len() {
        if (widths_m[i] - settled_m).abs() <= most {
            i += 1;
            continue;
        }
        let sign = (widths_m[i] - settled_m).signum();
        let stood = |width_m: &f64| (width_m - settled_m).abs() <= arrived;
        let leaves = from + widths_m[from..i].iter().rposition(stood).unwrap_or(0);
        let farthest = farthest(widths_m, leaves, i, [sign * arrived, -sign * most], dt);
        let after_m = widths_m[farthest];
        let middle_m = 0.5 * (settled_m + after_m);
        let is_before = |width_m: &f64| sign * (width_m - middle_m) < 0.0;
        let last_before = from + widths_m[from..farthest].iter().rposition(is_before).unwrap_or(0);
        let (a, b) = (widths_m[last_before], widths_m[last_before + 1]);
        let part = if b == a { 0.5 } else { ((middle_m - a) / (b - a)).clamp(0.0, 1.0) };
        let kind = if sign > 0.0 { Kind::Widens } else { Kind::Narrows };
        let change = Change { sample: last_before as f64 + part, kind, width_m: after_m };
        match kept.last() {
            Some((before, before_m))
                if is_chatter(before, &change, dt) && (before_m - after_m).abs() <= most =>
            {
                kept.pop();
                undone += 1;
            }
            _ => kept.push((change, settled_m)),
        }
        (settled_m, from, i) = (after_m, farthest, farthest + 1);
    }
    (kept.into_iter().map(|(change, _)| change).collect(), undone)
}

/// How far a change that leaves its width at one sample, and has been seen at another, goes: until it stands still for
/// a while, or for a part of the time that it has taken, or turns back. It goes on by more than `[on_m, _]`, and
/// turns back by more than `[_, back_m]`, both with their signs \[m\].
fn farthest(
    widths_m: &[f64],
    leaves: usize,
    seen: usize,
    [on_m, back_m]: [f64; 2],
    dt: f64,
) -> usize {
    let mut farthest = seen;
    for next in seen + 1..widths_m.len() {
        let taken_s = (farthest - leaves) as f64 * dt;
        if (next - 1 - farthest) as f64 * dt >= RAMP_S.max(STILL_FRACTION * taken_s) {
            break;
        }
        let further = widths_m[next] - widths_m[farthest];
        if further * on_m.signum() > on_m.abs() {
            farthest = next;
        } else if further * back_m.signum() > back_m.abs() {
            break;
        }
    }
    farthest
}

#[cfg(test)]
mod tests;
