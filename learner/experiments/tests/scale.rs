//! All lengths of the protocols scale with the data set: a smaller one gives the same results, as much smaller.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::folder::Folder;

const CONFIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config");
/// How much smaller the second data set is.
const FACTOR: f64 = 0.02;
/// What differs by less does not differ: relative to the value, and at full size [m, and so on].
const RELATIVE: f64 = 1e-3;
const ABSOLUTE: f64 = 1e-6;
/// Beside an obstacle, clearance and acceleration depend on a clearance of the goal that is in the controller's steering,
/// 2 cm for bodies of any size.
const BESIDE_OBSTACLE: f64 = 0.5;
/// Of the shipped skills these, and of each so many demonstrations: enough for every experiment.
const SKILLS: [&str; 2] = ["drawings/S", "pick"];
const DEMONSTRATIONS: usize = 4;

/// Writes the demonstrations of the skills, larger by a factor.
fn write_scaled(folder: &Folder, factor: f64) {
    for skill in SKILLS {
        let from = Path::new(CONFIG).join("demonstrations").join(skill);
        for number in 1..=DEMONSTRATIONS {
            let path = from.join(format!("{number:02}.json"));
            let mut file: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
            for frame in file["frames"].as_object_mut().unwrap().values_mut() {
                scale(&mut frame["position_m"], factor);
            }
            let columns = file["columns"].as_array().unwrap().clone();
            for sample in file["samples"].as_array_mut().unwrap() {
                for (value, column) in sample.as_array_mut().unwrap().iter_mut().zip(&columns) {
                    if column.as_str().unwrap().ends_with("_m") {
                        scale(value, factor);
                    }
                }
            }
            folder.write(
                &format!("data/{}/{number}.json", skill.replace('/', "-")),
                &file.to_string(),
            );
        }
    }
}

fn scale(value: &mut Value, factor: f64) {
    match value {
        Value::Array(values) => values.iter_mut().for_each(|value| scale(value, factor)),
        number => *number = (number.as_f64().unwrap() * factor).into(),
    }
}

/// Writes the configuration that is used; the learner's only length, the least span of a skill, goes with the factor.
fn write_config(folder: &Folder, factor: f64) {
    let skills = ["planar", "planar_thesis", "pick", "pick_thesis"];
    let skills = skills.map(|name| format!("skills/{name}.ron"));
    for name in skills.into_iter().chain(["controllers/planar.ron".to_owned()]) {
        let text = std::fs::read_to_string(Path::new(CONFIG).join(&name)).unwrap();
        let span = format!("position_span_min_m: {}", 0.1 * factor);
        assert_eq!(text.contains("position_span_min_m: 0.1,"), name.starts_with("skills"));
        folder.write(&format!("config/{name}"), &text.replace("position_span_min_m: 0.1", &span));
    }
}

/// The rows of a short run.
fn rows(factor: f64) -> Vec<Value> {
    let folder = Folder::new(&format!("experiments-scale-{factor}"));
    write_scaled(&folder, factor);
    write_config(&folder, factor);
    let path = |name| folder.path().join(name);
    let output = Command::new(env!("CARGO_BIN_EXE_experiments"))
        .arg("--quick")
        .args(["--dataset".as_ref(), path("data").as_os_str()])
        .args(["--config".as_ref(), path("config").as_os_str()])
        .args(["--out".as_ref(), path("out").as_os_str()])
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let printed = String::from_utf8_lossy(&output.stdout);
    let page = std::fs::read_to_string(path("out/report.html")).unwrap();
    for title in [
        "Like the demonstrations, in the plane",
        "Starts all over the workspace",
        "Distance to the demonstrated path after a push",
    ] {
        assert!(printed.contains(title) && page.contains(title), "{title}: {printed}");
    }
    let text = std::fs::read_to_string(path("out/results.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn obstructed(row: &Value) -> bool {
    row["experiment"].as_str().unwrap().contains("obstacle")
}

/// The numbers of a row that scale with a power of the factor: their names, values and powers.
fn scaled(row: &Value) -> Vec<(String, Option<f64>, i32)> {
    let mut numbers = Vec::new();
    let mut add = |name: &str, value: &Value, power| {
        numbers.push((name.to_owned(), value.as_f64(), power));
    };
    for name in [
        "goal_error_m",
        "clearance_min_m",
        "acceleration_max_m_s2",
        "demonstrated_acceleration_max_m_s2",
    ] {
        add(name, &row[name], 1);
    }
    // Beside an obstacle it is one or zero.
    add("thesis_metric", &row["thesis_metric"], i32::from(!obstructed(row)));
    add("scale", &row["scale"], 1);
    add("time_aligned_mse_m2", &row["time_aligned_mse_m2"], 2);
    for name in ["rmse_m", "dtw_m", "frechet_m", "velocity_rmse_m_s"] {
        add(name, &row["measures"][name], 1);
    }
    add("swept_area_m2", &row["measures"]["swept_area_m2"], 2);
    // Around an obstacle the side that is taken depends on it, too.
    let distances = row["tube_distances"].as_array().filter(|_| !obstructed(row));
    for (i, fraction) in distances.into_iter().flatten().enumerate() {
        add(&format!("tube_distances[{i}]"), fraction, 0);
    }
    numbers
}

#[test]
fn a_smaller_data_set_gives_the_same_results_as_much_smaller() {
    let [large, small] = [1.0, FACTOR].map(rows);
    assert_eq!(large.len(), small.len());
    let mut compared = std::collections::BTreeMap::<String, usize>::new();
    let mut differ = Vec::new();
    // The thesis' policy does not scale: its program asks for a natural gradient that is a unit vector [thesis
    // eq. 4.15], which is 1 m/s² whatever the size.
    let rows = large.iter().zip(&small).filter(|(large, _)| large["policy"] != "thesis");
    for (large, small) in rows {
        for name in ["experiment", "policy", "components", "x", "instance", "feasible"] {
            assert_eq!(large[name], small[name]);
        }
        let row = format!("{} {} {}", large["experiment"], large["policy"], large["setting"]);
        for name in ["reached", "collided", "starts_reached"] {
            if large[name] != small[name] {
                differ.push(format!("{row}: {name} {} and {}", large[name], small[name]));
            }
        }
        for ((name, a, power), (_, b, _)) in std::iter::zip(scaled(large), scaled(small)) {
            let b = b.map(|b| b / FACTOR.powi(power));
            let near = match (a, b) {
                (Some(a), Some(b)) => {
                    *compared.entry(name.clone()).or_default() += 1;
                    let loose = obstructed(large)
                        && ["clearance_min_m", "acceleration_max_m_s2"].contains(&name.as_str());
                    let relative = if loose { BESIDE_OBSTACLE } else { RELATIVE };
                    (a - b).abs() <= relative * a.abs() + ABSOLUTE
                }
                (a, b) => a == b,
            };
            if !near {
                differ.push(format!("{row}: {name} {a:?} and {b:?}"));
            }
        }
    }
    assert!(differ.is_empty(), "{} of {compared:?}:\n{}", differ.len(), differ.join("\n"));
    assert!(compared.len() == 17 && compared.values().all(|count| *count >= 3), "{compared:?}");
}
