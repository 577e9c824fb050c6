//! What came of a run: a table, `result.json` and `report.html`.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec2;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use tprmp_drawing::{Page, Picture};
use tprmp_files::{Existing, outln, write};

use crate::error::{SimError, parse_json, read_text};
use crate::log::{Bridge, Mode, Outcome, Row, before_stopping, counted, load};
use crate::pictures::pictures;
use crate::record::read_folder;
use crate::scene::Scene;

/// Summary that the controller writes.
pub(crate) const CONTROLLER_FILE: &str = "controller.json";
const RESULT_FILE: &str = "result.json";
const REPORT_FILE: &str = "report.html";
/// The error is the largest of the last so many seconds before the controller left.
const ERROR_WINDOW_S: f64 = 0.5;

/// The run in numbers: `result.json`.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct RunResult {
    pub(crate) success: bool,
    /// Why not, empty on success.
    pub(crate) failures: Vec<String>,
    seed: u64,
    mode: Mode,
    outcome: Outcome,
    simulated_s: f64,
    /// Of a skill that goes to a goal.
    pub(crate) position_error_mm: Option<f64>,
    /// Of a skill that goes round.
    pub(crate) rounds: Option<Rounds>,
    /// A point has no orientation.
    orientation_error_deg: f64,
    clearance_min_mm: f64,
    limit_fraction_max: f64,
    tick_us: Value,
    state_age_us: Value,
    ticks: Value,
    deadline_misses: Value,
    allocations: Value,
    slips: u64,
    slip_total_ms: f64,
    /// How many commands had each fault.
    command_faults: BTreeMap<String, u64>,
}

/// How a periodic skill went round, as the controller counted.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct Rounds {
    /// Complete rounds.
    done: u64,
    /// How long the last complete one took.
    period_s: Option<f64>,
    /// How far beside its cycle the point was in it, at most.
    beside_max_mm: Option<f64>,
}

/// Reports on a folder; gives whether the run succeeded.
pub(crate) fn report(folder: &Path) -> Result<bool, SimError> {
    let (rows, bridge) = load(folder)?;
    let rows = before_stopping(rows);
    let scene = Scene::read(Path::new(&bridge.scene))?;
    let demonstrations = read_folder(&scene.task.demonstrations, &scene)?;
    let controller = read_controller(&folder.join(CONTROLLER_FILE))?;
    let result = judge(&rows, &bridge, &scene, controller.as_ref());
    let json = serde_json::to_string_pretty(&result).expect("keys are strings");
    // Judged anew: a report is no record of anything.
    write(&folder.join(RESULT_FILE), json + "\n", Existing::Replace)?;
    let mut pictures = pictures(&rows, &bridge, &scene, &demonstrations, controller.as_ref());
    // The distance from a goal, of what has none.
    pictures.retain(|picture| result.rounds.is_none() || picture.name != "error");
    let table = table(&result);
    let html = folder.join(REPORT_FILE);
    write(&html, page(&result, &table, &pictures), Existing::Replace)?;
    for (name, value) in &table {
        outln!("{name:<36} {value}");
    }
    outln!("{:<36} {}", "pictures", html.display());
    Ok(result.success)
}

/// The controller's summary; `None` when there is none, or none that was finished.
fn read_controller(path: &Path) -> Result<Option<Value>, SimError> {
    let Ok(text) = read_text(path, "") else { return Ok(None) };
    let summary: Value = parse_json(&text, path)?;
    Ok(summary.get("ticks").is_some().then_some(summary))
}

/// Judges a run.
fn judge(rows: &[Row], bridge: &Bridge, scene: &Scene, controller: Option<&Value>) -> RunResult {
    let rounds: Option<Rounds> =
        controller.and_then(|c| serde_json::from_value(c["rounds"].clone()).ok());
    let goes_round = rounds.is_some();
    let error_mm = if goes_round { None } else { position_error_m(rows).map(|m| 1e3 * m) };
    let limit_mm = 1e3 * scene.task.position_error_max_m;
    let clearance_min_mm = 1e3 * bridge.extremes.clearance_min_m;
    let mut failures = match rounds {
        Some(rounds) => cycle_failures(&rounds, bridge.outcome, limit_mm),
        None => goal_failures(error_mm, bridge.outcome, limit_mm),
    };
    if clearance_min_mm <= 0.0 {
        failures.push(format!("the point touched the obstacle ({clearance_min_mm:.1} mm)"));
    }
    if controller.is_none() {
        failures.push(format!(
            "{CONTROLLER_FILE} is missing or empty: `controller run --summary` writes it when it \
             ends"
        ));
    }
    let of = |key: &str| controller.map_or(Value::Null, |c| c[key].clone());
    let times = |key: &str| {
        let t = of(key);
        json!({"p50": t["p50"], "p99": t["p99"], "max": t["max"]})
    };
    let extremes = &bridge.extremes;
    RunResult {
        success: failures.is_empty(),
        failures,
        seed: bridge.episode.seed,
        mode: bridge.mode,
        outcome: bridge.outcome,
        simulated_s: bridge.timing.simulated_s,
        position_error_mm: error_mm,
        rounds,
        orientation_error_deg: 0.0,
        clearance_min_mm,
        limit_fraction_max: extremes.effort_fraction_max.max(extremes.velocity_fraction_max),
        tick_us: times("tick_us"),
        state_age_us: times("state_age_us"),
        ticks: of("ticks"),
        deadline_misses: of("deadline_misses"),
        allocations: of("allocations"),
        slips: bridge.timing.slips,
        slip_total_ms: 1e3 * bridge.timing.slip_total_s,
        command_faults: bridge.command_faults.clone(),
    }
}

/// What is wrong with a run to a goal.
fn goal_failures(error_mm: Option<f64>, outcome: Outcome, limit_mm: f64) -> Vec<String> {
    let mut failures = Vec::new();
    if outcome != Outcome::Done {
        failures.push(format!("the task was not done: {}", in_words(outcome)));
    }
    match error_mm {
        Some(error) if error <= limit_mm => {}
        Some(error) => failures
            .push(format!("the goal was missed by {error:.2} mm, at most {limit_mm} mm may be")),
        None => failures.push("the controller never moved the point".into()),
    }
    failures
}

/// What is wrong with a run of what goes round: it is never done, and runs until somebody ends it.
fn cycle_failures(rounds: &Rounds, outcome: Outcome, limit_mm: f64) -> Vec<String> {
    let mut failures = Vec::new();
    if outcome == Outcome::ControllerLost {
        failures.push(format!("it did not go on: {}", in_words(outcome)));
    }
    match rounds.beside_max_mm {
        Some(beside) if beside <= limit_mm => {}
        Some(beside) => failures.push(format!(
            "the last round ran up to {beside:.2} mm beside the cycle, at most {limit_mm} mm may be"
        )),
        None => failures.push("the point went round not once: expected a complete round".into()),
    }
    failures
}

/// Largest distance from the moving goal in the last half second of the task \[m\].
fn position_error_m(rows: &[Row]) -> Option<f64> {
    let since = rows.last()?.time_s - ERROR_WINDOW_S;
    let window = rows.iter().filter(|row| row.time_s >= since);
    let distance = |row: &Row| DVec2::new(row.x_m - row.goal_x_m, row.y_m - row.goal_y_m).length();
    window.map(distance).reduce(f64::max)
}

fn in_words(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Done => "done",
        Outcome::ControllerStopped => "the controller left before",
        Outcome::ControllerLost => "the controller was lost",
        Outcome::Timeout => "the time limit came first",
        Outcome::Interrupted => "a signal came first",
    }
}

fn table(result: &RunResult) -> Vec<(String, String)> {
    let text = |value: &Value| match value {
        Value::Null => "—".to_owned(),
        Value::Number(n) if n.is_f64() => format!("{:.1}", n.as_f64().unwrap_or(f64::NAN)),
        value => value.to_string(),
    };
    let times = |value: &Value| {
        format!("{} / {} / {} µs", text(&value["p50"]), text(&value["p99"]), text(&value["max"]))
    };
    let clock = match result.mode {
        Mode::RealTime => "real time",
        Mode::Lockstep => "lockstep",
    };
    let mut table = vec![("success", if result.success { "yes" } else { "no" }.to_owned())];
    table.extend(result.failures.iter().map(|failure| ("failed because", failure.clone())));
    table.extend([
        ("seed, clock", format!("{}, {clock}", result.seed)),
        ("end", format!("{} after {:.2} s", in_words(result.outcome), result.simulated_s)),
    ]);
    let millimetres = |mm: Option<f64>| mm.map_or("—".to_owned(), |mm| format!("{mm:.2} mm"));
    match result.rounds {
        None => {
            table.push(("distance from the moving goal", millimetres(result.position_error_mm)));
        }
        Some(Rounds { done, period_s, beside_max_mm }) => table.extend([
            ("rounds done", done.to_string()),
            ("period of the last one", period_s.map_or("—".into(), |s| format!("{s:.2} s"))),
            ("distance beside the cycle in it", millimetres(beside_max_mm)),
        ]),
    }
    table.extend([
        ("least gap to the obstacle", format!("{:.1} mm", result.clearance_min_mm)),
        ("largest fraction of a limit", format!("{:.1} %", 100.0 * result.limit_fraction_max)),
        ("tick, median / 99 % / max", times(&result.tick_us)),
        ("age of the state, median / 99 % / max", times(&result.state_age_us)),
        ("ticks", text(&result.ticks)),
        ("deadlines missed", text(&result.deadline_misses)),
        ("heap allocations in the loop", text(&result.allocations)),
        ("simulator's slips", format!("{}, together {:.1} ms", result.slips, result.slip_total_ms)),
        ("commands with a fault", counted(&result.command_faults)),
    ]);
    table.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

fn page(result: &RunResult, table: &[(String, String)], pictures: &[Picture]) -> String {
    let mut page = Page::new(&format!("Planar run, seed {}", result.seed));
    let word = if result.success { "succeeded" } else { "failed" };
    page.verdict(Some(result.success), &format!("The run {word}."));
    page.table(&[], table.iter().map(|(name, value)| vec![name.into(), value.into()]));
    page.pictures(pictures);
    page.html()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode::tests::episode;
    use crate::log::{Extremes, STOPPING, Timing, save};
    use crate::scene::tests::FILE;
    use std::path::PathBuf;

    /// A run of two seconds that ends `error_m` beside the moving goal, in a folder of its own.
    struct SyntheticRun {
        folder: PathBuf,
        rows: Vec<Row>,
        bridge: Bridge,
    }

    impl SyntheticRun {
        fn new(name: &str, error_m: f64) -> Self {
            let episode = episode(3);
            let start = episode.start().position_m;
            let row = |i: u32| {
                let time_s = 0.02 * f64::from(i);
                let goal = episode.goal.at(time_s).pose;
                let obstacle = episode.obstacle.at(time_s).position_m;
                let aim = goal.position_m + DVec2::new(error_m, 0.0);
                let position = start.lerp(aim, f64::from(i.min(60)) / 60.0);
                Row {
                    time_s,
                    x_m: position.x,
                    y_m: position.y,
                    goal_x_m: goal.position_m.x,
                    goal_y_m: goal.position_m.y,
                    goal_angle_rad: goal.angle_rad,
                    obstacle_x_m: obstacle.x,
                    obstacle_y_m: obstacle.y,
                    clearance_m: 0.2,
                    life_cycle: if i < 60 { 1.0 } else { 3.0 },
                    ..Row::default()
                }
            };
            let bridge = Bridge {
                schema: Bridge::schema(),
                scene: FILE.into(),
                instance: "test".into(),
                mode: Mode::RealTime,
                outcome: Outcome::Done,
                point_radius_m: 0.05,
                effort_max_n: [400.0; 2],
                velocity_max_m_s: [20.0; 2],
                timing: Timing::default(),
                command_faults: BTreeMap::new(),
                extremes: Extremes {
                    clearance_min_m: 0.1,
                    effort_fraction_max: 0.25,
                    velocity_fraction_max: 0.5,
                },
                episode: episode.clone(),
            };
            let folder = std::env::temp_dir().join(format!("planar-{name}-{}", std::process::id()));
            std::fs::create_dir_all(&folder).unwrap();
            let run = Self { folder, rows: (0..100).map(row).collect(), bridge };
            run.write_controller(&json!({
                "ticks": 2000, "deadline_misses": 1, "allocations": 0,
                "tick_us": {"p50": 10.0, "p99": 20.0, "p999": 30.0, "max": 40.0},
                "state_age_us": {"p50": 500.0, "p99": 900.0, "p999": 950.0, "max": 1000.0},
                "histograms": {"tick_us": [[10.0, 1500], [40.0, 500]], "state_age_us": [[512.0, 2000]]},
            }));
            run
        }

        fn write_controller(&self, summary: &Value) {
            write(&self.folder.join(CONTROLLER_FILE), summary.to_string(), Existing::Replace)
                .unwrap();
        }

        fn report(&self) -> (bool, Value) {
            save(&self.folder, &self.rows, &self.bridge, Existing::Replace).unwrap();
            let success = report(&self.folder).unwrap();
            let text = std::fs::read_to_string(self.folder.join(RESULT_FILE)).unwrap();
            let result: Value = serde_json::from_str(&text).unwrap();
            assert_eq!(result["success"], success);
            (success, result)
        }
    }

    impl Drop for SyntheticRun {
        fn drop(&mut self) {
            std::fs::remove_dir_all(&self.folder).unwrap();
        }
    }

    #[test]
    fn a_good_run_is_merged_into_result_and_pictures() {
        let run = SyntheticRun::new("good", 0.003);
        let (success, result) = run.report();
        assert!(success, "{result}");
        assert!((result["position_error_mm"].as_f64().unwrap() - 3.0).abs() < 0.02);
        assert_eq!(result["orientation_error_deg"], 0.0);
        assert_eq!(result["clearance_min_mm"], 100.0);
        assert_eq!(result["limit_fraction_max"], 0.5);
        assert_eq!(result["tick_us"], json!({"p50": 10.0, "p99": 20.0, "max": 40.0}));
        assert_eq!(result["state_age_us"]["p99"], 900.0);
        assert_eq!((&result["ticks"], &result["allocations"]), (&json!(2000), &json!(0)));
        let html = std::fs::read_to_string(run.folder.join(REPORT_FILE)).unwrap();
        for name in ["path", "from_goal", "error", "clearance", "limits", "latency"] {
            assert!(html.contains(&format!("<figure id=\"{name}\">")), "{name}");
        }
        assert_eq!(html.matches("role=\"img\"").count(), 6);
        assert!(!html.contains("NaN") && !html.contains("inf,"));
    }

    #[test]
    fn every_failure_is_reported() {
        type Edit = fn(&mut SyntheticRun);
        let cases: [(&str, Edit, &str); 5] = [
            ("far", |run| run.rows = SyntheticRun::new("farther", 0.01).rows.clone(), "missed by"),
            ("touch", |run| run.bridge.extremes.clearance_min_m = -0.001, "touched the obstacle"),
            ("late", |run| run.bridge.outcome = Outcome::Timeout, "time limit"),
            ("killed", |run| run.write_controller(&json!({})), "controller.json is missing"),
            ("idle", |run| run.rows.clear(), "never moved"),
        ];
        for (name, edit, reason) in cases {
            let mut run = SyntheticRun::new(name, 0.003);
            edit(&mut run);
            let (success, result) = run.report();
            assert!(!success, "{name}");
            assert_eq!(result["failures"].as_array().unwrap().len(), 1, "{name}: {result}");
            assert!(result["failures"][0].as_str().unwrap().contains(reason), "{result}");
        }
    }

    #[test]
    fn what_goes_round_misses_no_goal() {
        let mut run = SyntheticRun::new("round", 0.2);
        run.bridge.outcome = Outcome::Timeout;
        let summary = |beside: Value| {
            let period_s = if beside.is_null() { Value::Null } else { json!(2.5) };
            json!({
                "ticks": 2000,
                "rounds": {"done": 7, "period_s": period_s, "beside_max_mm": beside},
            })
        };
        run.write_controller(&summary(json!(1.5)));
        let (success, result) = run.report();
        assert!(success && result["position_error_mm"].is_null(), "{result}");
        assert_eq!(result["rounds"]["done"], 7);
        let html = std::fs::read_to_string(run.folder.join(REPORT_FILE)).unwrap();
        for text in ["rounds done", "2.50 s", "1.50 mm"] {
            assert!(html.contains(text), "{text}");
        }
        assert!(!html.contains("goal was missed") && !html.contains("from the moving goal"));
        for (beside, reason) in [(json!(9.0), "beside the cycle"), (Value::Null, "not once")] {
            run.write_controller(&summary(beside));
            let (success, result) = run.report();
            assert!(!success, "{result}");
            assert!(result["failures"][0].as_str().unwrap().contains(reason), "{result}");
        }
    }

    #[test]
    fn braking_in_order_to_leave_is_no_error() {
        let mut run = SyntheticRun::new("leave", 0.003);
        for row in run.rows.iter_mut().rev().take(5) {
            row.life_cycle = STOPPING;
            row.x_m += 0.1;
        }
        assert!(run.report().0);
    }

    #[test]
    fn a_folder_without_a_run_is_reported() {
        let error = report(Path::new("no/such/folder")).unwrap_err().to_string();
        assert!(error.contains("bridge.json") && error.contains("planar-sim run --out"), "{error}");
    }
}
