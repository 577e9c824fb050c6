use std::collections::BTreeMap;

use tprmp_model::skill_model::{Manifold, Remarks};
use tprmp_spatial::Pose;

use super::*;

const DT: f64 = 0.02;

fn grips(text: &str) -> Gripper {
    let grip = |c| if c == 'c' { Grip::Closed } else { Grip::Open };
    Gripper::Grips(text.chars().map(grip).collect())
}

fn demonstration(name: &str, gripper: Option<Gripper>, count: usize) -> Demonstration {
    Demonstration {
        name: name.into(),
        sha256: String::new(),
        skill: "made_up".into(),
        manifold: Manifold::R3,
        sampling_time_s: DT,
        start: Pose::IDENTITY,
        goal_frame: Pose::IDENTITY,
        other_frames: BTreeMap::new(),
        remarks: Remarks::default(),
        poses: vec![Pose::IDENTITY; count],
        gripper,
    }
}

/// The motion lies between these samples.
fn alignment(from: usize, to: usize) -> Alignment {
    Alignment {
        samples: (from..=to).map(|i| i as f64).collect(),
        sampling_time_s: DT,
        pauses_s: 0.0,
        duration_s: (to - from) as f64 * DT,
    }
}

fn found(grippers: Vec<Option<Gripper>>) -> Found {
    let named = grippers.into_iter().enumerate();
    let all: Vec<_> =
        named.map(|(i, g)| demonstration(&format!("0{}.json", i + 1), g, 141)).collect();
    let alignments = vec![alignment(20, 120); all.len()];
    find(&all, &alignments, &PhaseProfile::linear())
}

/// Open, and closed from this sample on.
fn closing(sample: usize) -> Option<Gripper> {
    Some(grips(&("o".repeat(sample) + &"c".repeat(141 - sample))))
}

#[test]
fn the_median_phase_of_the_closings_is_an_event_and_the_farthest_its_spread() {
    let Found { events, warnings } = found(vec![closing(60), closing(70), closing(74)]);
    assert!(warnings.is_empty(), "{warnings:?}");
    let [event] = events[..] else { panic!("one event, not {events:?}") };
    assert_eq!((event.action, event.demonstrations), (GripperAction::Closes, 3));
    assert!((event.phase - 0.495).abs() < 1e-12 && (event.spread - 0.1).abs() < 1e-12);
    assert_eq!(
        event.described(3),
        "gripper closes at phase 0.49 (3 of 3 demonstrations, within 0.10)"
    );
}

#[test]
fn what_happens_while_the_tool_rests_happens_at_the_end() {
    let Found { events, .. } = found(vec![closing(3), closing(20)]);
    assert_eq!((events[0].phase, events[0].spread), (0.0, 0.0));
    let Found { events, .. } = found(vec![closing(130), closing(140)]);
    assert_eq!((events[0].phase, events[0].spread), (1.0, 0.0));
    // Closed on the object and opened above the box: both are there, in their order.
    let twice = || Some(grips(&("o".repeat(70) + &"c".repeat(60) + &"o".repeat(11))));
    let Found { events, .. } = found(vec![twice(), twice()]);
    let actions: Vec<_> = events.iter().map(|event| event.action).collect();
    assert_eq!(actions, [GripperAction::Closes, GripperAction::Opens]);
}

#[test]
fn events_are_placed_by_the_phase_of_the_policy() {
    let demonstrations = [demonstration("01.json", closing(70), 141)];
    let profile = PhaseProfile::damped(2.0, 8.0);
    let events = find(&demonstrations, &[alignment(20, 120)], &profile).events;
    let expected = profile.at(events[0].time_fraction)[0];
    assert!((events[0].time_fraction - 0.495).abs() < 1e-12);
    assert!(events[0].phase == expected && (expected - 0.495).abs() > 0.02, "{expected}");
}

#[test]
fn a_pause_that_was_cut_keeps_its_event() {
    let mut cut = alignment(20, 120);
    cut.samples = (20..60).chain(90..=120).map(f64::from).collect();
    let demonstrations = [demonstration("01.json", closing(75), 141)];
    let events = find(&demonstrations, &[cut], &PhaseProfile::linear()).events;
    assert!((39.0 / 70.0..=40.0 / 70.0).contains(&events[0].phase), "{}", events[0].phase);
}

#[test]
fn chatter_is_ignored_and_told() {
    let chatters = "o".repeat(50) + "cc" + &"o".repeat(30) + "coc" + &"c".repeat(56);
    let Found { events, warnings } = found(vec![Some(grips(&chatters)), closing(85)]);
    assert_eq!(events.len(), 1);
    assert_eq!(events[0].demonstrations, 2);
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    assert!(warning.contains("`01.json` chatters: 2 changes are undone"), "{warning}");
    let all = found(vec![Some(grips(&chatters)); 4]);
    assert!(all.warnings[0].ends_with("so are those of 3 more"), "{:?}", all.warnings);
    assert_eq!(all.warnings.len(), 1);
}

#[test]
fn contradicting_orders_are_told_by_name_and_most_decide() {
    let opening = Some(grips(&("c".repeat(70) + &"o".repeat(71))));
    let Found { events, warnings } = found(vec![opening, closing(70), closing(71), None]);
    assert_eq!((events[0].action, events[0].demonstrations), (GripperAction::Closes, 2));
    assert!(warnings[0].contains("`04.json` says nothing of the gripper"), "{warnings:?}");
    for part in ["`02.json`, `03.json` it closes", "in `01.json` it opens"] {
        assert!(warnings[1].contains(part), "{warnings:?}");
    }
    // Words and widths are not the same either.
    let widths = Some(Gripper::Widths((0..141).map(|i| 0.08 - 0.0005 * f64::from(i)).collect()));
    let Found { events, warnings } = found(vec![widths, closing(70), closing(71)]);
    assert_eq!(events.len(), 1);
    assert!(warnings[0].contains("in `01.json` it gets narrower"), "{warnings:?}");
}

#[test]
fn nothing_is_said_where_nothing_is_known_or_nothing_happens() {
    for grippers in [vec![None, None], vec![Some(grips(&"c".repeat(141)))]] {
        let Found { events, warnings } = found(grippers);
        assert!(events.is_empty() && warnings.is_empty(), "{warnings:?}");
    }
    let still = Gripper::Widths((0..141).map(|i| 0.04 + 4e-4 * f64::from(i % 2)).collect());
    assert!(found(vec![Some(still)]).events.is_empty());
}

#[test]
fn more_changes_than_a_skill_has_are_told() {
    let text: String = (0..141 * 4).map(|i| if i / 4 % 2 == 0 { 'o' } else { 'c' }).collect();
    let count = text.len();
    let demonstrations = [demonstration("01.json", Some(grips(&text)), count)];
    let found = find(&demonstrations, &[alignment(0, count - 1)], &PhaseProfile::linear());
    assert!(found.events.is_empty());
    assert!(found.warnings[0].contains("changes 140 times"), "{:?}", found.warnings);
}

/// 80 mm, over `ramp` samples from sample 50 on to 30 mm, and at sample 100 back.
fn ramp(ramp: f64, noise_m: f64) -> Gripper {
    let width_m = |i: i32| {
        let t = f64::from(i);
        let closed = ((t - 50.0) / ramp).clamp(0.0, 1.0) - ((t - 100.0) / 5.0).clamp(0.0, 1.0);
        0.08 - 0.05 * closed + noise_m * (12.9 * t).sin()
    };
    Gripper::Widths((0..141).map(width_m).collect())
}

#[test]
fn a_ramp_is_one_event_in_its_middle_with_the_width_after_it() {
    for (length, noise_m) in [(1.0, 0.0), (5.0, 0.0), (30.0, 0.0), (30.0, 3e-4), (5.0, 1e-3)] {
        let Found { events, warnings } = found(vec![Some(ramp(length, noise_m)); 2]);
        assert!(warnings.is_empty(), "{warnings:?}");
        let [closes, opens] = events[..] else { panic!("{length}: {events:?}") };
        let at = (50.0 + 0.5 * length - 20.0) / 100.0;
        assert!((closes.phase - at).abs() < 0.015, "{length}: {} for {at}", closes.phase);
        assert!((opens.phase - 0.825).abs() < 0.015, "{}", opens.phase);
        for (event, expected) in [(closes, 0.03), (opens, 0.08)] {
            let GripperAction::WidthM(width_m) = event.action else { panic!("{event:?}") };
            assert!((width_m - expected).abs() < 2.5e-3, "{width_m} for {expected}");
        }
    }
    let text = found(vec![Some(ramp(5.0, 0.0))]).events[0].described(1);
    assert_eq!(text, "gripper goes to 30.0 mm at phase 0.33 (1 of 1 demonstration, within 0.00)");
}

#[test]
fn a_width_that_gives_way_a_little_or_for_a_moment_is_no_event() {
    let Gripper::Widths(mut widths_m) = ramp(5.0, 0.0) else { unreachable!() };
    // What is held gives way; and one sample is wrong.
    widths_m[70..80].iter_mut().for_each(|w| *w -= 0.006);
    widths_m[30] = 0.05;
    let Found { events, warnings } = found(vec![Some(Gripper::Widths(widths_m))]);
    assert_eq!(events.len(), 2, "{events:?}");
    assert!(warnings[0].contains("1 change is undone"), "{warnings:?}");
}

#[test]
fn a_slow_ramp_is_one_event_and_a_long_rest_on_the_way_makes_two() {
    // Over 14 s and over 40 s, from 80 mm to nothing.
    for count in [700_usize, 2000] {
        let width = |i: usize| 0.08 * (1.0 - (i as f64 / count as f64 - 0.1).clamp(0.0, 0.8) / 0.8);
        let slow = Gripper::Widths((0..count).map(width).collect());
        let (found, undone) = changes(&slow, DT, 0.08);
        let [change] = found[..] else { panic!("one change, not {found:?}") };
        assert_eq!((change.kind, undone), (Kind::Narrows, 0));
        assert!(
            (change.sample - 0.5 * count as f64).abs() < 2.0 + 0.03 * count as f64,
            "{change:?}"
        );
        assert!(change.width_m < 0.003, "{change:?}");
    }
    let twice = |i: usize| {
        if i < 50 {
            0.08
        } else if i < 90 {
            0.04
        } else {
            0.0
        }
    };
    let (found, _) = changes(&Gripper::Widths((0..141).map(twice).collect()), DT, 0.08);
    assert_eq!(found.len(), 2, "{found:?}");
}

#[test]
fn one_wrong_width_hides_no_event() {
    let width = |i: usize| {
        if i == 30 {
            0.9
        } else if i < 70 {
            0.08
        } else {
            0.01
        }
    };
    let wrong = Some(Gripper::Widths((0..141).map(width).collect()));
    let Found { events, warnings } = found(vec![wrong.clone(), wrong]);
    assert_eq!((events.len(), warnings.len()), (1, 1), "{events:?} {warnings:?}");
}

#[test]
fn phases_that_scatter_are_told_by_name() {
    let Found { events, warnings } = found(vec![closing(30), closing(60), closing(110)]);
    assert_eq!(events.len(), 1);
    let [warning] = &warnings[..] else { panic!("one warning, not {warnings:?}") };
    for part in ["closes", "0.10", "`01.json`", "0.90", "`03.json`"] {
        assert!(warning.contains(part), "{warning}");
    }
}
