//! Learner, model, controller and bridge together, in lockstep: exact whatever the machine's load.

use std::process::{Child, Output};

use tprmp_messages::JointCommand;

use crate::common::{Place, file, finish, json, program, run, text};

/// One run of learner's model, controller and bridge. Returns the bytes of all commands.
fn lockstep(
    place: &Place,
    config: &str,
    model: &str,
    bridge: &mut std::process::Command,
) -> Vec<u8> {
    let controller = place.controller(&file(config), model, &["--lockstep", "--until-done"]);
    let (commands, bridge, controller) = beside(place, controller, bridge);
    assert!(bridge.status.success(), "{}\n{controller}", text(&bridge));
    commands
}

/// Runs a bridge in lockstep beside a controller. Returns the bytes of all commands, how the bridge
/// ended, and what the controller said.
fn beside(
    place: &Place,
    controller: Child,
    bridge: &mut std::process::Command,
) -> (Vec<u8>, Output, String) {
    let commands = place.path("commands.bin");
    let output = run(bridge
        .args(["--instance", &place.instance, "--out", &place.path(""), "--force"])
        .args(["--lockstep", "--record-commands", &commands]));
    let controller = finish_or_stop(controller);
    assert_eq!(place.leftovers(), Vec::<std::path::PathBuf>::new());
    let commands =
        std::fs::read(commands).unwrap_or_else(|e| panic!("{e}: {}\n{controller}", text(&output)));
    (commands, output, controller)
}

/// Whether every number of all commands is finite.
fn finite(commands: &[u8]) -> bool {
    let numbers = ["position", "velocity", "acceleration", "torque", "gravity_torque"];
    let fields: Vec<_> = JointCommand::LAYOUT
        .fields
        .iter()
        .filter(|f| f.message == "JointCommand" && numbers.contains(&f.field))
        .collect();
    assert_eq!(fields.len(), numbers.len());
    let (commands, rest) = commands.as_chunks::<{ size_of::<JointCommand>() }>();
    assert!(!commands.is_empty() && rest.is_empty());
    commands.iter().all(|command| {
        fields.iter().all(|field| {
            let (numbers, _) = command[field.offset..][..field.size].as_chunks();
            numbers.iter().all(|bytes| f64::from_ne_bytes(*bytes).is_finite())
        })
    })
}

/// The controller ends by itself once the task is done; one whose bridge left earlier is asked to.
fn finish_or_stop(controller: std::process::Child) -> String {
    let asked =
        std::process::Command::new("kill").args(["-INT", &controller.id().to_string()]).status();
    assert!(asked.is_ok());
    let output = finish(controller);
    assert!(output.status.success(), "{}", text(&output));
    text(&output)
}

#[test]
fn the_pick_succeeds_and_the_same_seed_gives_the_same_commands_byte_for_byte() {
    let place = Place::new("pick");
    let model = place.train("pick");
    let mut streams = Vec::new();
    for seed in ["1", "1", "2"] {
        let mut bridge = program("sim-bridge");
        bridge.args(["run", "--scene", &file("config/scenes/pick.json"), "--seed", seed]);
        streams.push(lockstep(&place, "config/controllers/ur5_pick.ron", &model, &mut bridge));
        let bridge = json(&place.path("bridge.json"));
        let result = &bridge["result"];
        assert_eq!(result["success"], true, "seed {seed}: {result}");
        assert!(result["position_error_mm"].as_f64().unwrap() < 5.0, "{result}");
        assert!(result["orientation_error_deg"].as_f64().unwrap() < 2.0, "{result}");
        assert!(result["clearance_sphere_m"].as_f64().unwrap() > 0.0, "{result}");
        assert!(result["velocity_limit_used"].as_f64().unwrap() <= 1.0, "{result}");
        let summary = json(&place.path("controller.json"));
        assert_eq!(summary["allocations"], 0, "{summary}");
        assert!(summary["ticks"].as_u64().unwrap() > 1000);
    }
    assert!(!streams[0].is_empty());
    assert!(streams[0] == streams[1], "the same seed gave other commands");
    assert!(streams[0] != streams[2], "another seed gave the same commands");
}

#[test]
fn the_planar_skill_reaches_its_moving_goal_and_repeats_byte_for_byte() {
    let place = Place::new("planar");
    let model = place.train("planar");
    let mut streams = Vec::new();
    for seed in ["1", "1", "3"] {
        let mut bridge = program("planar-sim");
        bridge.args(["run", "--scene", &file("config/scenes/planar.json"), "--seed", seed]);
        streams.push(lockstep(&place, "config/controllers/planar.ron", &model, &mut bridge));
        let report = run(program("planar-sim").args(["report", &place.path("")]));
        assert!(report.status.success(), "seed {seed}: {}", text(&report));
        let result = json(&place.path("result.json"));
        assert_eq!(result["success"], true, "seed {seed}: {result}");
        assert_eq!(result["allocations"], 0, "{result}");
        assert!(result["position_error_mm"].as_f64().unwrap() < 5.0, "{result}");
    }
    assert!(streams[0] == streams[1], "the same seed gave other commands");
    assert!(streams[0] != streams[2], "another seed gave the same commands");
}

#[test]
fn of_two_modes_the_one_that_is_free_is_taken_and_told() {
    let place = Place::new("modes");
    let skill =
        place.edited("config/skills/planar.ron", &[("../demonstrations/planar", "demonstrations")]);
    let folder = place.path("demonstrations");
    std::fs::create_dir_all(&folder).unwrap();
    for number in 1..=6 {
        let mut demonstration =
            json(&file(&format!("config/demonstrations/planar/{number:02}.json")));
        let write = |name: String, text: &serde_json::Value| {
            std::fs::write(format!("{folder}/{name}.json"), text.to_string()).unwrap();
        };
        write(format!("{number:02}"), &demonstration);
        // The other way round: mirrored at the line from its first to its last sample.
        let samples = demonstration["samples"].as_array_mut().unwrap();
        let xy = |sample: &serde_json::Value| [0, 1].map(|i| sample[i].as_f64().unwrap());
        let ([x0, y0], [x1, y1]) = (xy(&samples[0]), xy(&samples[samples.len() - 1]));
        let length = (x1 - x0).hypot(y1 - y0);
        let (along, across) = ([(x1 - x0) / length, (y1 - y0) / length], [y0 - y1, x1 - x0]);
        for sample in samples {
            let [x, y] = xy(sample);
            let [dx, dy] = [x - x0, y - y0];
            let beside = (dx * across[0] + dy * across[1]) / length;
            let forward = dx * along[0] + dy * along[1];
            let mirrored = [
                x0 + forward * along[0] - beside * across[0] / length,
                y0 + forward * along[1] - beside * across[1] / length,
            ];
            *sample = serde_json::json!(mirrored);
        }
        write(format!("mirrored-{number:02}"), &demonstration);
    }
    let model = place.train_file(&skill, &[]);
    let scene = file("config/scenes/planar.json");
    // The same with an obstacle that reaches into the first way of doing it.
    let larger = place.edited(
        "config/scenes/planar.json",
        &[
            ("[0.08, 0.14]", "[0.15, 0.16]"),
            ("../robots", &file("config/robots")),
            ("../demonstrations", &file("config/demonstrations")),
        ],
    );
    for (scene, expected) in [(&scene, 1), (&larger, 2)] {
        let mut bridge = program("planar-sim");
        bridge.args(["run", "--scene", scene, "--seed", "1"]);
        let config = file("config/controllers/planar.ron");
        let controller = place.controller(&config, &model, &["--lockstep", "--until-done"]);
        let (_, bridge, said) = beside(&place, controller, &mut bridge);
        assert!(bridge.status.success(), "{}", text(&bridge));
        let summary = json(&place.path("controller.json"));
        let mode = &summary["mode"];
        assert!(summary["allocations"] == 0 && mode["of"] == 2, "{summary}");
        assert_eq!(mode["number"], expected, "{summary}");
        let told = format!("mode {expected} of 2");
        assert!(mode["free"] == true && said.contains(&told), "{summary}\n{said}");
    }
}

#[test]
fn a_model_without_its_certificate_runs_when_it_is_allowed_to() {
    let place = Place::new("allowed");
    let skill = file("config/skills/planar_thesis.ron");
    let model = place.train_file(&skill, &["--allow-uncertified"]);
    let config = file("config/controllers/planar.ron");
    let mut streams = Vec::new();
    for seed in ["1", "1"] {
        let controller = place.controller(&config, &model, &["--lockstep", "--allow-uncertified"]);
        let mut bridge = program("planar-sim");
        // The goal frame goes round and turns. Whether the skill gets there is not asked.
        bridge.args(["run", "--scene", &file("config/scenes/planar.json"), "--seed", seed]);
        let (commands, bridge, said) = beside(&place, controller, &mut bridge);
        let outcome = &json(&place.path("bridge.json"))["outcome"];
        assert!(outcome == "timeout" || outcome == "done", "{}\n{said}", text(&bridge));
        assert!(finite(&commands));
        let summary = json(&place.path("controller.json"));
        assert_eq!(summary["allocations"], 0, "{summary}");
        let ticks = summary["ticks"].as_u64().unwrap();
        assert!(ticks > 1000, "{summary}");
        // It follows the skill: no check of its input or limit holds it.
        let by_reason = |reason: &str| summary["ticks_by_reason"][reason].as_u64().unwrap_or(0);
        let allowed = ["None", "Blocked", "Unreachable", "StopRequested", "StateUnconfirmed"];
        assert_eq!(allowed.map(by_reason).iter().sum::<u64>(), ticks, "{summary}");
        streams.push(commands);
    }
    assert!(streams[0] == streams[1], "the same seed gave other commands");
}

#[test]
fn a_skill_of_one_frame_reaches_its_moving_goal() {
    let place = Place::new("one-frame");
    let skill = place.edited(
        "config/skills/planar.ron",
        &[
            ("start_frame: \"start\"", "start_frame: \"end\""),
            ("other_frames: []", "other_frames: [\"start\"]"),
            ("../demonstrations", &file("config/demonstrations")),
        ],
    );
    let model = place.train_file(&skill, &[]);
    for seed in ["1", "3"] {
        let mut bridge = program("planar-sim");
        bridge.args(["run", "--scene", &file("config/scenes/planar.json"), "--seed", seed]);
        let commands = lockstep(&place, "config/controllers/planar.ron", &model, &mut bridge);
        assert!(finite(&commands));
        let report = run(program("planar-sim").args(["report", &place.path("")]));
        assert!(report.status.success(), "seed {seed}: {}", text(&report));
        let result = json(&place.path("result.json"));
        assert_eq!(result["allocations"], 0, "{result}");
    }
}

#[test]
fn a_periodic_skill_goes_round_until_the_time_is_over() {
    let place = Place::new("wipe");
    let model = place.train("wipe");
    let mut streams = Vec::new();
    for seed in ["1", "1", "2"] {
        let mut bridge = program("planar-sim");
        bridge.args(["run", "--scene", &file("config/scenes/wipe.json"), "--seed", seed]);
        let config = file("config/controllers/planar.ron");
        let controller = place.controller(&config, &model, &["--lockstep"]);
        let (commands, bridge, said) = beside(&place, controller, &mut bridge);
        assert!(finite(&commands));
        let outcome = &json(&place.path("bridge.json"))["outcome"];
        assert_eq!(outcome, "done", "{}\n{said}", text(&bridge));
        assert!(bridge.status.success());
        let report = run(program("planar-sim").args(["report", &place.path("")]));
        assert!(report.status.success(), "seed {seed}: {}", text(&report));
        let result = json(&place.path("result.json"));
        let rounds = &result["rounds"];
        assert!(rounds["done"].as_u64().unwrap() >= 5, "{result}");
        let period_s = rounds["period_s"].as_f64().unwrap();
        assert!((2.0..3.5).contains(&period_s), "{result}");
        assert!(text(&report).contains("rounds done"), "{}", text(&report));
        assert!(result["position_error_mm"].is_null() && result["allocations"] == 0, "{result}");
        streams.push(commands);
    }
    assert!(streams[0] == streams[1], "the same seed gave other commands");
    assert!(streams[0] != streams[2], "another seed gave the same commands");
}
