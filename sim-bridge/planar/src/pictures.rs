//! The pictures of a run.

use glam::{DQuat, DVec2, DVec3};
use serde_json::Value;
use tprmp_rmpflow::policy::canonical::frame_map::{Anchor, Canonical, FrameMap};
use tprmp_spatial::{MovingPose, Pose};

use crate::log::{Bridge, Row};
use crate::record::Demonstration;
use crate::report::STOPPING;
use crate::scene::Scene;
use crate::shape::PlanarPose;
use crate::svg::{Axis, BLUE, GREEN, GREY, ORANGE, Plot, RED, Stroke};

const WIDTH: f64 = 620.0;
const CHART: DVec2 = DVec2::new(WIDTH, 250.0);
/// So often the obstacle is drawn, and how far apart in time \[s\].
const MOMENTS: usize = 5;
const MOMENT_S: f64 = 0.6;
/// Labels keep this distance from each other \[m\].
const LABEL_M: f64 = 0.13;
/// Length of a drawn frame axis \[m\].
const AXIS_M: f64 = 0.16;
/// A logarithmic chart ends there, where there are zeros \[its unit\].
const LEAST: f64 = 1e-3;

/// All pictures of a run: their file name and their SVG.
pub(crate) fn pictures(
    rows: &[Row],
    bridge: &Bridge,
    scene: &Scene,
    demonstrations: &[Demonstration],
    controller: Option<&Value>,
) -> Vec<(&'static str, String)> {
    let driven: Vec<Row> = rows.iter().copied().filter(|r| r.life_cycle != STOPPING).collect();
    let mut pictures = Vec::new();
    if driven.len() > 1 {
        pictures.push(("path", path(&driven, bridge, demonstrations)));
        if let Some(svg) = from_goal(&driven, bridge, demonstrations) {
            pictures.push(("from_goal", svg));
        }
        pictures.push(("error", error(&driven, scene)));
        pictures.push(("clearance", clearance(&driven)));
        pictures.push(("limits", limits(&driven, bridge)));
    }
    if let Some(svg) = controller.and_then(latency) {
        pictures.push(("latency", svg));
    }
    pictures
}

fn position(row: &Row) -> DVec2 {
    DVec2::new(row.x_m, row.y_m)
}

fn goal_frame(row: &Row) -> PlanarPose {
    let position_m = DVec2::new(row.goal_x_m, row.goal_y_m);
    PlanarPose { position_m, angle_rad: row.goal_angle_rad }
}

fn pose(frame: &PlanarPose) -> Pose {
    Pose {
        position: frame.position_m.extend(0.0),
        orientation: DQuat::from_rotation_z(frame.angle_rad),
    }
}

fn at_rest(frame: &PlanarPose) -> MovingPose {
    MovingPose::at_rest(pose(frame))
}

fn at(point: DVec2) -> Canonical {
    Canonical { position: point.extend(0.0), rotation: DVec3::ZERO }
}

/// The frame map of the start frame and a goal frame whose origin is the goal.
fn map_between(start: &PlanarPose, goal: &PlanarPose) -> FrameMap {
    let anchor = |index: usize, frame: &PlanarPose, phase| {
        let frame = pose(frame);
        Anchor { index, frame, point: frame.position, phase }
    };
    let anchors = [anchor(0, start, 0.0), anchor(1, goal, 1.0)];
    FrameMap::new(&anchors, pose(goal), true).expect("their phases are in order")
}

/// A demonstration carried over to the frames of the run, as the skill carries it: the phase of a
/// sample is taken as its fraction of the time.
fn carried(demonstration: &Demonstration, start: &PlanarPose, goal: &PlanarPose) -> Vec<DVec2> {
    let map = map_between(&demonstration.start, &demonstration.goal);
    let displacement =
        map.transforms(&[at_rest(start), at_rest(goal)]).expect("there are both frames");
    let last = demonstration.points.len().max(2) - 1;
    let forward = |(i, p): (usize, &DVec2)| {
        let phase = i as f64 / last as f64;
        map.forward(&displacement, phase, &at(*p)).position.truncate()
    };
    demonstration.points.iter().enumerate().map(forward).collect()
}

fn path(rows: &[Row], bridge: &Bridge, demonstrations: &[Demonstration]) -> String {
    let start = bridge.episode.start();
    let last = rows[rows.len() - 1];
    let end = goal_frame(&last);
    let shown: Vec<Vec<DVec2>> = demonstrations.iter().map(|d| carried(d, &start, &end)).collect();
    let obstacle_radius = bridge.episode.obstacle.radius_m;
    let moments = moments(rows);
    let centre = |row: &Row| DVec2::new(row.obstacle_x_m, row.obstacle_y_m);

    let mut points: Vec<DVec2> = shown.iter().flatten().copied().collect();
    points.extend(rows.iter().flat_map(|r| [position(r), goal_frame(r).position_m]));
    for moment in &moments {
        let size = DVec2::splat(obstacle_radius);
        points.extend([centre(moment) - size, centre(moment) + size]);
    }
    for frame in [start, end] {
        points.extend(axis_tips(&frame));
    }
    let labels = ["x in the base frame [m]", "y in the base frame [m]"];
    let mut plot = Plot::map("The run in the world", labels, &points, WIDTH);
    for (i, points) in shown.iter().enumerate() {
        let label = (i == 0).then_some("demonstrations, carried to the last goal");
        plot.line(points.iter().copied(), Stroke::solid(GREY, 1.2), label);
    }
    plot.disc_label(RED, "obstacle, darker with time");
    plot.line(rows.iter().map(centre), Stroke::dashed(RED, 1.0), None);
    for (i, moment) in moments.iter().enumerate() {
        let opacity = 0.10 + 0.35 * i as f64 / (MOMENTS - 1) as f64;
        plot.circle(centre(moment), obstacle_radius, RED, opacity);
    }
    let goals = rows.iter().map(|r| goal_frame(r).position_m);
    plot.line(goals, Stroke::dashed(ORANGE, 2.0), Some("goal"));
    plot.line(rows.iter().map(position), Stroke::solid(BLUE, 2.6), Some("path of the point"));
    for (frame, name) in [(start, "start"), (end, "end")] {
        for tip in axis_tips(&frame) {
            plot.line([frame.position_m, tip], Stroke::solid(GREEN, 2.0), None);
        }
        plot.words(frame.position_m, DVec2::new(8.0, 16.0), GREEN, name);
    }
    let mut labelled: Vec<DVec2> = Vec::new();
    for moment in &moments {
        let label = format!("{:.1} s", moment.time_s);
        plot.dot(position(moment), 3.6, BLUE);
        for (point, offset, colour) in [
            (centre(moment), DVec2::new(-11.0, 4.0), RED),
            (position(moment), DVec2::new(7.0, -6.0), BLUE),
        ] {
            // Words on words cannot be read.
            if labelled.iter().all(|other| (*other - point).length() > LABEL_M) {
                plot.words(point, offset, colour, &label);
                labelled.push(point);
            }
        }
    }
    plot.svg()
}

/// Moments about the closest approach to the obstacle, in order of time.
fn moments(rows: &[Row]) -> Vec<Row> {
    let least = rows.iter().map(|r| r.clearance_m).fold(f64::INFINITY, f64::min);
    let closest = rows.iter().position(|r| r.clearance_m <= least).unwrap_or(0);
    let step_s = (rows[rows.len() - 1].time_s - rows[0].time_s) / (rows.len() - 1) as f64;
    let stride = (MOMENT_S / step_s.max(1e-6)).round().max(1.0) as usize;
    (0..MOMENTS)
        .filter_map(|i| rows.get((closest + i * stride).checked_sub(MOMENTS / 2 * stride)?))
        .copied()
        .collect()
}

fn axis_tips(frame: &PlanarPose) -> [DVec2; 2] {
    [0.0, 0.5 * std::f64::consts::PI]
        .map(|turn| frame.position_m + AXIS_M * DVec2::from_angle(frame.angle_rad + turn))
}

fn from_goal(rows: &[Row], bridge: &Bridge, demonstrations: &[Demonstration]) -> Option<String> {
    let start = bridge.episode.start();
    // The goal is held where it stood at the run's beginning.
    let first = goal_frame(rows.first()?);
    let seen: Vec<DVec2> = rows
        .iter()
        .map(|row| {
            let goal = goal_frame(row);
            let turn = DVec2::from_angle(first.angle_rad - goal.angle_rad);
            first.position_m + turn.rotate(position(row) - goal.position_m)
        })
        .collect();
    let shown: Vec<Vec<DVec2>> =
        demonstrations.iter().map(|d| carried(d, &start, &first)).collect();
    let points: Vec<DVec2> = shown.iter().flatten().chain(&seen).copied().collect();
    let labels = ["x with the goal held still [m]", "y with the goal held still [m]"];
    let mut plot = Plot::map("The run as seen from the goal", labels, &points, WIDTH);
    for (i, points) in shown.iter().enumerate() {
        let label = (i == 0).then_some("demonstrations");
        plot.line(points.iter().copied(), Stroke::solid(GREY, 1.2), label);
    }
    let near: Vec<DVec2> = rows
        .iter()
        .zip(&seen)
        .filter(|(row, _)| row.clearance_m < NEAR_M)
        .map(|(_, point)| *point)
        .collect();
    plot.line(seen.iter().copied(), Stroke::solid(BLUE, 2.6), Some("path of the point"));
    if near.len() > 1 {
        plot.line(near, Stroke::solid(RED, 2.6), Some("… within 0.3 m of the obstacle"));
    }
    plot.dot(first.position_m, 4.5, ORANGE);
    plot.words(first.position_m, DVec2::new(8.0, 16.0), ORANGE, "goal");
    Some(plot.svg())
}

/// What counts as near the obstacle, in a picture \[m\].
const NEAR_M: f64 = 0.3;

fn time_axis(rows: &[Row]) -> Axis {
    Axis::linear("time [s]", 0.0, rows[rows.len() - 1].time_s)
}

fn error(rows: &[Row], scene: &Scene) -> String {
    let errors: Vec<DVec2> = rows
        .iter()
        .map(|row| {
            let distance = (position(row) - goal_frame(row).position_m).length();
            DVec2::new(row.time_s, (1e3 * distance).max(LEAST))
        })
        .collect();
    let limit = 1e3 * scene.task.position_error_max_m;
    let least = errors.iter().map(|e| e.y).fold(limit, f64::min);
    let most = errors.iter().map(|e| e.y).fold(limit, f64::max);
    let y = Axis::logarithmic("distance from the moving goal [mm]", least, most);
    let mut plot = Plot::new("Distance from the goal", time_axis(rows), y, CHART);
    level(&mut plot, rows, limit, ORANGE, "limit for success");
    plot.line(errors, Stroke::solid(BLUE, 2.2), Some("distance"));
    plot.svg()
}

fn level(plot: &mut Plot, rows: &[Row], value: f64, colour: &'static str, label: &str) {
    let ends = [0.0, rows[rows.len() - 1].time_s].map(|t| DVec2::new(t, value));
    plot.line(ends, Stroke::dashed(colour, 1.6), Some(label));
}

fn clearance(rows: &[Row]) -> String {
    let clearances: Vec<DVec2> =
        rows.iter().map(|row| DVec2::new(row.time_s, row.clearance_m)).collect();
    let least = clearances.iter().map(|c| c.y).fold(0.0, f64::min);
    let most = clearances.iter().map(|c| c.y).fold(0.1, f64::max);
    let y = Axis::linear("clearance [m]", least, 1.05 * most);
    let title = "Gap between point and obstacle";
    let mut plot = Plot::new(title, time_axis(rows), y, CHART);
    level(&mut plot, rows, 0.0, RED, "contact");
    plot.line(clearances, Stroke::solid(BLUE, 2.2), Some("gap between the surfaces"));
    plot.svg()
}

fn limits(rows: &[Row], bridge: &Bridge) -> String {
    let percent = |values: [f64; 2], most: [f64; 2]| {
        (100.0 * (values[0].abs() / most[0]).max(values[1].abs() / most[1])).max(0.01)
    };
    let force = |r: &Row| percent([r.force_x_n, r.force_y_n], bridge.effort_max_n);
    let speed = |r: &Row| percent([r.vx_m_s, r.vy_m_s], bridge.velocity_max_m_s);
    let y = Axis::logarithmic("fraction of the limit [%]", 0.01, 100.0);
    let mut plot = Plot::new("Forces and speeds against their limits", time_axis(rows), y, CHART);
    let [force_limit, speed_limit] = [bridge.effort_max_n[0], bridge.velocity_max_m_s[0]];
    level(&mut plot, rows, 100.0, RED, "limit");
    let series = |f: &dyn Fn(&Row) -> f64| -> Vec<DVec2> {
        rows.iter().map(|r| DVec2::new(r.time_s, f(r))).collect()
    };
    let label = format!("force, limit {force_limit} N");
    plot.line(series(&force), Stroke::solid(BLUE, 2.0), Some(&label));
    let label = format!("speed, limit {speed_limit} m/s");
    plot.line(series(&speed), Stroke::solid(GREEN, 2.0), Some(&label));
    plot.svg()
}

/// The controller's histograms: logarithmic buckets, eight an octave.
fn latency(controller: &Value) -> Option<String> {
    let buckets = |key: &str| -> Option<Vec<(f64, f64)>> {
        let buckets = controller["histograms"][key].as_array()?;
        buckets.iter().map(|b| Some((b[0].as_f64()?, b[1].as_f64()?))).collect()
    };
    let series = [
        ("tick_us", BLUE, "computing a command"),
        ("state_age_us", ORANGE, "age of the state it used"),
    ];
    // In lockstep every state is of no age.
    let told = |key: &str| controller[key]["max"].as_f64().is_some_and(|most| most > 0.0);
    let series: Vec<_> = series
        .iter()
        .filter(|(key, ..)| told(key))
        .filter_map(|(key, colour, name)| Some((buckets(key)?, *colour, *name)))
        .collect();
    let all: Vec<(f64, f64)> = series.iter().flat_map(|(b, ..)| b).copied().collect();
    let least = all.iter().map(|b| b.0).fold(f64::INFINITY, f64::min);
    let most = all.iter().map(|b| b.0).fold(0.0, f64::max);
    let tallest = all.iter().map(|b| b.1).fold(1.0, f64::max);
    if all.is_empty() {
        return None;
    }
    let mut plot = Plot::new(
        "Latency of the controller's loop",
        Axis::logarithmic("time [µs]", least / EIGHTH_OCTAVE, most),
        Axis::logarithmic("ticks", 1.0, tallest).from(0.6),
        CHART,
    );
    for (buckets, colour, name) in series {
        plot.disc_label(colour, name);
        for (upper, count) in buckets {
            plot.bar(upper / EIGHTH_OCTAVE, upper, count, colour);
        }
    }
    Some(plot.svg())
}

/// Ratio of a bucket's bounds: 2^(1/8).
const EIGHTH_OCTAVE: f64 = 1.090_507_732_665_257_7;
