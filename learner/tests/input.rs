//! Demonstrations, skill files and foreign files: what is wrong is refused by file and key.

use std::path::Path;

use crate::common::{Folder, arcs, skill, skill_file, skill_text};
use proptest::prelude::*;
use tprmp_files::Existing;
use tprmp_learner::demonstration::{self, Grip, Gripper, read, read_folder, to_text};
use tprmp_learner::import::{Selection, import};
use tprmp_learner::skill::Skill;
use tprmp_model::skill_model::Manifold;

fn text(manifold: Manifold) -> String {
    to_text(&arcs(manifold)[0], "start", "end")
}

/// What reading this text as a demonstration says; it names the file and `expected`.
#[track_caller]
fn refused(text: &str, expected: &[&str]) {
    let folder = Folder::new(&format!("refused-{}", std::panic::Location::caller().line()));
    let path = folder.write("demonstrated.json", text);
    let message = read(&path, "start", "end").unwrap_err().to_string();
    for part in expected.iter().chain(&["demonstrated.json"]) {
        assert!(message.contains(part), "`{message}` does not say `{part}`");
    }
}

/// The text with one sample replaced.
fn with_sample(manifold: Manifold, sample: &str) -> String {
    let text = text(manifold);
    let mut lines: Vec<&str> = text.lines().collect();
    let first = lines.iter().position(|line| line.contains("samples")).unwrap() + 1;
    let row = format!("{sample},");
    lines[first + 3] = &row;
    lines.join("\n")
}

#[test]
fn a_written_demonstration_comes_back() {
    for manifold in [Manifold::R2, Manifold::R3S3] {
        let folder = Folder::new(&format!("back-{manifold}"));
        let written = &arcs(manifold)[0];
        let path = folder.write("made_up_01.json", &to_text(written, "start", "end"));
        let back = read(&path, "start", "end").unwrap();
        assert_eq!((&back.name, &back.skill), (&written.name, &written.skill));
        assert_eq!((back.manifold, back.sampling_time_s), (manifold, 0.02));
        assert_eq!(back.poses.len(), written.poses.len());
        for (a, b) in back.poses.iter().zip(&written.poses) {
            assert!((a.position - b.position).length() < 2e-6);
            assert!(a.rotation_from(b).length() < 1e-5);
            assert!((a.orientation.length() - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn numbers_that_are_not_finite_are_named() {
    for bad in ["NaN", "Infinity", "-Infinity", "null"] {
        refused(&with_sample(Manifold::R2, &format!("[0.1, {bad}]")), &["samples[3][1]", "finite"]);
    }
    refused(&with_sample(Manifold::R2, "[0.1, 1e999]"), &["line", "out of range"]);
    let text =
        text(Manifold::R2).replacen("\"sampling_time_s\": 0.02", "\"sampling_time_s\": NaN", 1);
    refused(&text, &["sampling_time_s"]);
}

#[test]
fn numbers_beyond_all_reason_are_named() {
    refused(&with_sample(Manifold::R2, "[0.1, -1e160]"), &["samples[3]", "within 1000000 m"]);
    let far = text(Manifold::R3S3).replacen("\"position_m\": [0.600000", "\"position_m\": [6e9", 1);
    refused(&far, &["frames.end.position_m", "within 1000000 m"]);
    let slow =
        text(Manifold::R2).replacen("\"sampling_time_s\": 0.02", "\"sampling_time_s\": 1e9", 1);
    refused(&slow, &["sampling_time_s", "140 points last at most 600 s", "1000000000"]);
}

#[test]
fn rows_of_another_length_are_named() {
    refused(&with_sample(Manifold::R2, "[0.1]"), &["samples[3]", "expected 2 numbers, found 1"]);
    refused(&with_sample(Manifold::R3S3, "[0.1, 0.2, 0.3]"), &["samples[3]", "7 numbers"]);
}

#[test]
fn quaternions_that_are_not_unit_are_named_and_nearly_unit_ones_normalised() {
    refused(
        &with_sample(Manifold::R3S3, "[0, 0, 0, 0.5, 0, 0, 0]"),
        &["samples[3]", "unit quaternion", "0.5"],
    );
    let folder = Folder::new("nearly");
    let path = folder
        .write("demonstrated.json", &with_sample(Manifold::R3S3, "[0, 0, 0, 1.0005, 0, 0, 0]"));
    let demonstrated = read(&path, "start", "end").unwrap();
    assert!((demonstrated.poses[3].orientation.length() - 1.0).abs() < 1e-12);
    let frame =
        text(Manifold::R2).replacen("\"quaternion_wxyz\": [1", "\"quaternion_wxyz\": [2", 1);
    refused(&frame, &["frames.start.quaternion_wxyz", "unit"]);
}

#[test]
fn frames_that_are_missing_or_unknown_are_named() {
    let missing = text(Manifold::R2).replace("\"end\":", "\"box\":");
    refused(&missing, &["frames.end", "found only [box, start]"]);
    let lines: Vec<_> = text(Manifold::R2)
        .lines()
        .filter(|line| !line.starts_with("\"end\""))
        .map(|line| line.strip_suffix("]},").map_or(line.into(), |l| format!("{l}]}}")))
        .collect();
    refused(&lines.join("\n"), &["frames.end", "found only [start]"]);
    let tilted = text(Manifold::R2).replacen("[1.000000, 0.000000,", "[0.8, 0.6,", 1);
    refused(&tilted, &["frames.start.quaternion_wxyz", "about z"]);
}

#[test]
fn a_gripper_channel_comes_back_and_what_is_wrong_with_it_is_named() {
    let folder = Folder::new("gripper");
    let mut written = arcs(Manifold::R2)[0].clone();
    let count = written.poses.len();
    assert!(!to_text(&written, "start", "end").contains("gripper"));
    let grip = |i: usize| if i < 30 { Grip::Open } else { Grip::Closed };
    let widths_m = (0..count).map(|i| 0.08 * (i as f64 / count as f64).powi(2));
    for gripper in
        [Gripper::Grips((0..count).map(grip).collect()), Gripper::Widths(widths_m.collect())]
    {
        written.gripper = Some(gripper.clone());
        let path = folder.write("made_up_01.json", &to_text(&written, "start", "end"));
        match (read(&path, "start", "end").unwrap().gripper.unwrap(), gripper) {
            (Gripper::Widths(back), Gripper::Widths(written)) => {
                assert!(back.iter().zip(&written).all(|(a, b)| (a - b).abs() < 1e-6));
            }
            (back, written) => assert_eq!(back, written),
        }
    }
    let with =
        |keys: &str| text(Manifold::R2).replace("\"columns\"", &format!("{keys}, \"columns\""));
    let list = |entry: &str, count: usize| format!("[{}]", vec![entry; count].join(", "));
    let words = |entry: &str| format!("\"gripper\": {}", list(entry, count));
    let widths = |entry: &str| format!("\"gripper_width_m\": {}", list(entry, count));
    let short = format!("\"gripper\": {}", list("\"open\"", 3));
    refused(&with(&short), &["key `gripper`", &format!("expected {count} entries"), "found 3"]);
    let short = format!("\"gripper_width_m\": {}", list("0.1", 3));
    refused(&with(&short), &["key `gripper_width_m`", "one a sample", "found 3"]);
    let one_wrong = words("\"open\"").replacen("open", "ajar", 2).replacen("ajar", "open", 1);
    refused(&with(&one_wrong), &["gripper[1]", "\"open\" or \"closed\"", "ajar"]);
    refused(&with(&words("null")), &["gripper[0]", "null"]);
    refused(&with(&words("1")), &["expected a string"]);
    for (bad, said) in [
        ("-0.01", "from 0 to 1 m, found -0.01"),
        ("80", "are these millimetres?"),
        ("null", "finite number"),
        ("NaN", "finite number"),
    ] {
        refused(&with(&widths(bad)), &["gripper_width_m[0]", said]);
    }
    let both = format!("{}, {}", words("\"open\""), widths("0.1"));
    refused(&with(&both), &["key `gripper`", "`gripper_width_m`, found both"]);
}

#[test]
fn too_few_points_are_named() {
    for count in [0, 1, 9] {
        let mut demonstrated = arcs(Manifold::R2)[0].clone();
        demonstrated.poses.truncate(count);
        let found = format!("at least 10 points, found {count}");
        refused(&to_text(&demonstrated, "start", "end"), &["samples", &found]);
    }
    let mut still = arcs(Manifold::R2)[0].clone();
    still.poses = vec![still.poses[0]; 30];
    refused(&to_text(&still, "start", "end"), &["samples", "never moves"]);
}

#[test]
fn wrong_manifolds_columns_times_and_schemas_are_named() {
    let good = text(Manifold::R2);
    refused(&good.replace("\"R2\"", "\"R7\""), &["manifold", "R7"]);
    refused(&good.replace("\"R2\"", "\"R3\""), &["columns", "z_m"]);
    refused(&good.replace("\"y_m\"", "\"z_m\""), &["columns"]);
    for time in ["0", "-0.02"] {
        refused(
            &good.replace("\"sampling_time_s\": 0.02", &format!("\"sampling_time_s\": {time}")),
            &["sampling_time_s", "positive"],
        );
    }
    refused(&good.replace("demonstration/1", "demonstration/2"), &["schema", "demonstration/2"]);
    refused("{\"name\": \"C\", \"dt\": 0.01}", &["schema", "found `none`"]);
    refused(&good.replace("\"skill\"", "\"skil\""), &["skil", "line"]);
}

#[test]
fn truncated_and_corrupted_files_are_named() {
    let good = text(Manifold::R2);
    refused(&good[..good.len() / 2], &["line", "truncated"]);
    refused("", &["truncated"]);
    refused(&good.replacen("[0.", "[zero.", 1), &["line"]);
    let missing =
        read(Path::new("/nowhere/demonstrated.json"), "start", "end").unwrap_err().to_string();
    assert!(missing.contains("/nowhere/demonstrated.json"));
}

#[test]
fn demonstrations_of_a_folder_belong_together() {
    let folder = Folder::new("together");
    let path = folder.path().to_owned();
    let say = |skill: &str, manifold| {
        read_folder(&path, skill, manifold, "start", "end", &[]).unwrap_err().to_string()
    };
    assert!(say("made_up", Manifold::R2).contains("at least one"));
    folder.demonstrations(".", &arcs(Manifold::R2));
    let all = read_folder(&path, "made_up", Manifold::R2, "start", "end", &[]).unwrap();
    let names: Vec<_> = all.iter().map(|d| d.name.as_str()).collect();
    assert_eq!(names, ["made_up_01.json", "made_up_02.json", "made_up_03.json"]);
    assert!(all.iter().all(|d| d.sha256.len() == 64));
    assert!(say("other", Manifold::R2).contains("key `skill`"));
    assert!(say("made_up", Manifold::R3S3).contains("key `manifold`"));
    // Frames are just those of the skill.
    let mut demonstrated = arcs(Manifold::R2);
    for demonstration in &mut demonstrated {
        demonstration.other_frames.insert("box".into(), demonstration.goal_frame);
    }
    folder.demonstrations("more", &demonstrated);
    let more = path.join("more");
    let read =
        |others: &[String]| read_folder(&more, "made_up", Manifold::R2, "start", "end", others);
    let unknown = read(&[]).unwrap_err().to_string();
    assert!(unknown.contains("frames.box") && unknown.contains("other_frames"), "{unknown}");
    assert_eq!(read(&["box".into()]).unwrap()[0].other_frames.len(), 1);
    let missing = read(&["box".into(), "lid".into()]).unwrap_err().to_string();
    assert!(missing.contains("frames.lid"), "{missing}");
    assert!(demonstration::read_folder(&path.join("no"), "", Manifold::R2, "a", "b", &[]).is_err());
}

#[test]
fn the_repository_s_skill_files_are_valid() {
    assert_eq!(Skill::read(&skill_file("pick.ron")).unwrap().manifold, Manifold::R3S3);
    assert_eq!(Skill::read(&skill_file("planar.ron")).unwrap().manifold, Manifold::R2);
    for (name, manifold) in [
        ("planar_thesis.ron", Manifold::R2),
        ("planar_published.ron", Manifold::R2),
        ("pick_thesis.ron", Manifold::R3S3),
    ] {
        assert_eq!(Skill::read(&skill_file(name)).unwrap().manifold, manifold);
    }
    // Those that the tests make of them are for other demonstrations.
    assert_eq!(skill("planar_thesis.ron").skill, "made_up");
}

#[test]
fn skill_files_of_the_schema_before_are_read_with_the_shipped_alignment() {
    let folder = Folder::new("schema-4");
    for template in ["planar.ron", "planar_thesis.ron"] {
        let text = skill_text(template);
        let begin = text.find("  alignment: (").unwrap();
        let end = begin + text[begin..].find("\n  ),\n").unwrap() + "\n  ),\n".len();
        let without = format!("{}{}", &text[..begin], &text[end..]);
        let older = without.replace("tprmp-skill/5", "tprmp-skill/4");
        let read = |text: &str| Skill::read(&folder.write("skill.ron", text));
        assert_eq!(read(&older).unwrap().alignment, read(&text).unwrap().alignment, "{template}");
        let missing = read(&without).unwrap_err().to_string();
        assert!(missing.contains("key `alignment`"), "{missing}");
    }
}

#[test]
fn wrong_skill_files_are_refused_by_key_and_place() {
    let folder = Folder::new("skill");
    let good = skill_text("planar.ron");
    let say = |text: String| {
        let path = folder.write("skill.ron", &text);
        let message = Skill::read(&path).unwrap_err().to_string();
        assert!(message.contains("skill.ron"), "{message}");
        message
    };
    let unknown = say(good.replace("damping_1_s: 8.0", "dampening: 8.0"));
    assert!(unknown.contains("dampening") && unknown.contains("line"), "{unknown}");
    let missing = say(good.replace("damping_1_s: 8.0,", ""));
    assert!(missing.contains("damping_1_s"), "{missing}");
    let negative = say(good.replace("damping_1_s: 8.0", "damping_1_s: -8.0"));
    assert!(negative.contains("fit.damping_1_s") && negative.contains("-8"), "{negative}");
    let many = say(good.replace("components: 9", "components: 900"));
    assert!(many.contains("mixture.components") && many.contains("900"), "{many}");
    for (key, value) in [("horizon_s: 20.0", "horizon_s: 1e9"), ("step_s: 0.01", "step_s: 1e-9")] {
        let endless = say(good.replace(key, value));
        assert!(endless.contains("certification.horizon_s"), "{endless}");
        assert!(endless.contains("at most 600 s, and 1000000 steps"), "{endless}");
    }
    for value in ["0.0", "0.04", "1.5"] {
        let text = good.replace("change_phase_min: 0.25", &format!("change_phase_min: {value}"));
        assert!(say(text).contains("frame_map.change_phase_min"), "{value}");
    }
    let huge = say(good.replace("span: 2.75", "span: 1e150"));
    assert!(huge.contains("scale.span") && huge.contains("to 1e6"), "{huge}");
    let published = skill_text("planar_published.ron");
    let narrow = say(published.replace("shape: 14.0", "shape: 800.0"));
    assert!(narrow.contains("fit.kaiser_smoothing.shape") && narrow.contains("800"), "{narrow}");
    let twice = say(good.replace("other_frames: []", "other_frames: [\"end\"]"));
    assert!(twice.contains("other_frames") && twice.contains("`end`"), "{twice}");
    let model = say(good.replace("TimeDrivenGmm,", "Hmm,"));
    assert!(model.contains("Hmm") && model.contains("TpLeftRightHmm"), "{model}");
    for version in ["tprmp-skill/0", "tprmp-skill/3"] {
        // Before any key that is missing there.
        let older = good.replace("tprmp-skill/5", version).replace("frame_map: (", "map: (");
        let schema = say(older);
        assert!(schema.contains("key `schema`") && schema.contains("tprmp-skill/5"), "{schema}");
        assert!(schema.contains(version) && schema.contains("`frame_map`"), "{schema}");
    }
    let fraction = say(good.replace("error_fraction_max: 0.8", "error_fraction_max: 1.8"));
    assert!(fraction.contains("fit.adaptation.error_fraction_max"), "{fraction}");
    let text = say(good.replace("components: 9", "components: nine"));
    assert!(text.contains("line"), "{text}");
    assert!(say(good[..200].into()).contains("line"));
}

const FOREIGN_PLANAR: &str = r#"{"name": "C", "dt": 0.01, "manifold": "R2", "demonstrations": [
 {"frames": {"start": {"A": [[0.0, -1.0], [1.0, 0.0]], "b": [0.5, 1.0]},
             "end": {"A": [[1.0, 0.0], [0.0, 1.0]], "b": [2.0, 3.0]}},
  "reference_frames": {}, "positions": [POSITIONS]}]}"#;

#[test]
fn keys_of_the_last_version_are_refused_with_the_new_name() {
    let folder = Folder::new("renamed");
    for (old, new) in tprmp_model::RENAMED_KEYS {
        let text =
            skill_text("planar.ron").replace("smoothing: (", &format!("smoothing: (\n{old}: 1,"));
        let message = Skill::read(&folder.write("skill.ron", &text)).unwrap_err().to_string();
        assert!(message.contains(&format!("`{old}` is now `{new}`")), "{message}");
        assert!(message.contains("skill.ron") && message.contains("line "), "{message}");
    }
    // All in one message.
    let old = skill_text("planar.ron")
        .replace("refinement_rounds_max", "repairs_max") // the old names
        .replace("rest_speed_fraction", "rest_speed_share"); // the old names
    let message = Skill::read(&folder.write("skill.ron", &old)).unwrap_err().to_string();
    for (old, new) in [
        ("repairs_max", "refinement_rounds_max"),    // the old names
        ("rest_speed_share", "rest_speed_fraction"), // the old names
    ] {
        assert!(message.contains(&format!("`{old}` is now `{new}`")), "{message}");
    }
}

fn foreign_planar() -> String {
    let rows: Vec<_> = (0..20).map(|i| format!("[0.{i:02}, {i}.5]")).collect();
    FOREIGN_PLANAR.replace("POSITIONS", &rows.join(", "))
}

#[test]
fn planar_foreign_files_are_imported_with_their_frames() {
    let folder = Folder::new("foreign-planar");
    let foreign = folder.write("C.json", &foreign_planar());
    let selection = Selection { skill: Some("arc".into()), ..Selection::default() };
    let written = import(&[&foreign], &folder.path().join("out/deep"), &selection, Existing::Keep)
        .unwrap()
        .written;
    assert_eq!(written.len(), 1);
    let demonstrated = read(&written[0], "start", "end").unwrap();
    assert_eq!((demonstrated.skill.as_str(), demonstrated.manifold), ("arc", Manifold::R2));
    assert_eq!(demonstrated.poses.len(), 20);
    assert_eq!(demonstrated.poses[3].position.to_array(), [0.03, 3.5, 0.0]);
    assert_eq!(demonstrated.start.position.to_array(), [0.5, 1.0, 0.0]);
    let rotated = demonstrated.start.orientation * glam::DVec3::X;
    assert!((rotated - glam::DVec3::Y).length() < 1e-5);
}

#[test]
fn reference_frames_are_taken_where_they_are_asked_for() {
    let folder = Folder::new("foreign-reference");
    let empty = foreign_planar();
    let frame = |x: f64| format!(r#"{{"A": [[1.0, 0.0], [0.0, 1.0]], "b": [{x}, 8.0]}}"#);
    let reference = format!(r#"{{"start": {}, "end": {}}}"#, frame(7.0), frame(9.0));
    let foreign = folder.write("C.json", &empty.replace("{}", &reference));
    let out = folder.path().join("out");
    let start = |reference_frames: bool| {
        let selection = Selection { reference_frames, ..Selection::default() };
        let written = import(&[&foreign], &out, &selection, Existing::Keep)
            .map_err(|e| e.to_string())?
            .written;
        let demonstrated = read(&written[0], "start", "end").unwrap();
        std::fs::remove_dir_all(&out).unwrap();
        Ok::<_, String>(demonstrated.start.position.to_array())
    };
    assert_eq!(start(false), Ok([0.5, 1.0, 0.0]));
    assert_eq!(start(true), Ok([7.0, 8.0, 0.0]));
    folder.write("C.json", &empty.replace("{}", &format!(r#"{{"end": {}}}"#, frame(9.0))));
    let message = start(true).unwrap_err();
    assert!(message.contains("demonstrations[0].reference_frames.start"), "{message}");
    // Where there are none, the demonstration's own are the thesis'.
    for none in [empty.clone(), empty.replace("\"reference_frames\": {},", "")] {
        folder.write("C.json", &none);
        assert_eq!(start(true), Ok([0.5, 1.0, 0.0]));
    }
}

#[test]
fn poses_are_imported_by_their_tag() {
    let frame = r#"{"position": [0.1, 0.2, 0.3], "quaternion": [0.6, 0.0, 0.8, 0.0]}"#;
    let one = |tag: &str| {
        let rows: Vec<_> =
            (0..12).map(|i| format!("[0.{i:02}, 0, 0, 1.0, 0.0, 0.0, 0.0]")).collect();
        format!(
            r#"{{"tag": "{tag}", "frames": {{"ee_frame": {frame}, "obj_frame": {frame}}}, "positions": [{}]}}"#,
            rows.join(", ")
        )
    };
    let text = format!(
        r#"{{"name": "grasp", "dt": 0.005, "manifold": "R3xS3", "quaternion_order": "wxyz",
        "demonstrations": [{}, {}, {}]}}"#,
        one("top"),
        one("side"),
        one("top")
    );
    let folder = Folder::new("foreign-poses");
    let foreign = folder.write("grasp.json", &text);
    let out = folder.path().join("out");
    let tagged =
        |tag: Option<&str>| Selection { tag: tag.map(String::from), ..Selection::default() };
    let message =
        |tag| import(&[&foreign], &out, &tagged(tag), Existing::Keep).unwrap_err().to_string();
    assert!(message(None).contains("`side`, `top`"));
    assert!(message(Some("bottom")).contains("bottom"));
    let written = import(&[&foreign], &out, &tagged(Some("top")), Existing::Keep).unwrap().written;
    assert_eq!(written.len(), 2);
    let demonstrated = read(&written[1], "ee_start", "object").unwrap();
    assert_eq!((demonstrated.skill.as_str(), demonstrated.sampling_time_s), ("grasp", 0.005));
    assert!((demonstrated.goal_frame.orientation.y - 0.8).abs() < 1e-6);

    folder.write("grasp.json", &text.replace("\"wxyz\"", "\"xyzw\""));
    assert!(message(Some("top")).contains("quaternion_order"));
}

#[test]
fn wrong_foreign_files_are_refused_by_key() {
    let folder = Folder::new("foreign-wrong");
    let say = |text: String| {
        let foreign = folder.write("C.json", &text);
        import(&[&foreign], &folder.path().join("out"), &Selection::default(), Existing::Keep)
            .unwrap_err()
            .to_string()
    };
    let good = foreign_planar();
    let sheared = say(good.replace("[[0.0, -1.0], [1.0, 0.0]]", "[[1.0, 0.5], [0.0, 1.0]]"));
    assert!(sheared.contains("demonstrations[0].frames.start"), "{sheared}");
    assert!(say(good.replace("[0.03, 3.5]", "[0.03]")).contains("positions[3]"));
    assert!(say(good.replace("\"dt\": 0.01", "\"dt\": 0")).contains("`dt`"));
    assert!(say(good.replace("\"R2\"", "\"R9\"")).contains("manifold"));
    assert!(say(good[..100].into()).contains("line"));
    assert!(say(good.replace("\"end\"", "\"stop\"")).contains("frames.end"));
}

/// What stands in place of a number of a spoiled file.
const WORDS: [&str; 9] =
    ["NaN", "-inf", "1e999", "-1", "0", "18446744073709551616", "[]", "\"\"", "None"];

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..Default::default() })]

    #[test]
    fn random_bytes_as_a_skill_file_are_refused(
        bytes in prop::collection::vec(any::<u8>(), 0..400), kept in any::<prop::sample::Index>(),
    ) {
        let folder = Folder::new("skill-random");
        let good = skill_text("planar.ron").into_bytes();
        let end = good.len() - 200;
        for kept in [0, kept.index(end)] {
            let path = folder.path().join("skill.ron");
            std::fs::write(&path, [&good[..kept], &bytes].concat()).unwrap();
            prop_assert!(Skill::read(&path).unwrap_err().to_string().contains("skill.ron"));
        }
    }

    #[test]
    fn spoiled_skill_files_never_panic(
        template in prop::sample::select(vec!["planar.ron", "pick.ron", "planar_published.ron"]),
        bytes in prop::collection::vec((any::<prop::sample::Index>(), 0..128_u8), 0..2),
        words in prop::collection::vec(
            (any::<prop::sample::Index>(), prop::sample::select(WORDS.to_vec())), 0..3,
        ),
    ) {
        let folder = Folder::new("skill-spoiled");
        // Without the comments, in which nothing would be spoiled.
        let text = skill_text(template);
        let lines = text.lines().map(|line| line.split("//").next().unwrap());
        let text = lines.collect::<Vec<_>>().join("\n");
        let mut parts: Vec<&str> = text.split_inclusive([' ', ',', '[', ']']).collect();
        let is_number = |part: &str| part.starts_with(|c: char| c.is_ascii_digit());
        let numbers: Vec<usize> = (0..parts.len()).filter(|i| is_number(parts[*i])).collect();
        let changed: Vec<_> = words
            .iter()
            .map(|(place, word)| {
                let place = numbers[place.index(numbers.len())];
                (place, [word, &parts[place][parts[place].len() - 1..]].concat())
            })
            .collect();
        for (place, word) in &changed {
            parts[*place] = word;
        }
        let mut spoiled = parts.concat().into_bytes();
        for (place, byte) in &bytes {
            let place = place.index(spoiled.len());
            spoiled[place] = *byte;
        }
        let path = folder.path().join("skill.ron");
        std::fs::write(&path, &spoiled).unwrap();
        if let Err(error) = Skill::read(&path) {
            prop_assert!(error.to_string().contains("skill.ron"), "{error}");
        }
    }
}
