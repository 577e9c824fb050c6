//! Learner, model, controller and bridge together, in lockstep: exact whatever the machine's load.

use crate::common::{Place, file, finish, json, program, run, text};

/// One run of learner's model, controller and bridge. Returns the bytes of all commands.
fn lockstep(
    place: &Place,
    config: &str,
    model: &str,
    bridge: &mut std::process::Command,
) -> Vec<u8> {
    let commands = place.path("commands.bin");
    let controller = place.controller(&file(config), model, &["--lockstep", "--until-done"]);
    let output = run(bridge
        .args(["--instance", &place.instance, "--out", &place.path("")])
        .args(["--lockstep", "--record-commands", &commands]));
    let controller = finish_or_stop(controller);
    assert!(output.status.success(), "{}\n{controller}", text(&output));
    assert_eq!(place.leftovers(), Vec::<std::path::PathBuf>::new());
    std::fs::read(commands).expect("the bridge recorded the commands")
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
