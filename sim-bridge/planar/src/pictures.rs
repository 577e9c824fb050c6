//! The pictures of a run.

use glam::DVec2;
use serde_json::Value;
use tprmp_drawing::{
    AXES, Anchor, BLUE, Figure, GREEN, GREY, ORANGE, Panel, Picture, RED, Sign, Stroke, decades,
};

use crate::log::{Bridge, Row};
use crate::record::Demonstration;
use crate::scene::Scene;
use crate::shape::PlanarPose;

/// Longest side of a map, and size of a graph over time \[px\].
const MAP_PX: f64 = 550.0;
const GRAPH_PX: DVec2 = DVec2::new(MAP_PX, 240.0);
/// So often the obstacle is drawn, and how far apart in time \[s\].
const SAMPLES: usize = 5;
const SAMPLE_S: f64 = 0.6;
/// Labels keep this distance from each other \[m\].
const LABEL_M: f64 = 0.13;
/// Length of a drawn frame axis \[m\].
const AXIS_M: f64 = 0.16;
/// What counts as near the obstacle \[m\].
const NEAR_M: f64 = 0.3;
/// Ratio of the bounds of a bucket of the controller's histograms: 2^(1/8).
const BUCKET_RATIO: f64 = 1.090_507_732_665_257_7;
const DEMONSTRATION: Stroke = Stroke::solid(GREY, 1.2);
const PATH: Stroke = Stroke::solid(BLUE, 2.6);
const GOAL_PATH: Stroke = Stroke::dashed(ORANGE, 2.0);
const NEAR_PATH: Stroke = Stroke::solid(RED, 2.6);

/// All pictures of a run; `rows` without those in which the controller leaves.
pub(crate) fn pictures(
    rows: &[Row],
    bridge: &Bridge,
    scene: &Scene,
    demonstrations: &[Demonstration],
    controller: Option<&Value>,
) -> Vec<Picture> {
    let mut pictures = Vec::new();
    let mut add = |name: &str, figure: Figure, caption: &str| {
        pictures.push(Picture { name: name.into(), svg: figure.svg(), caption: caption.into() });
    };
    if rows.len() > 1 {
        add(
            "path",
            path(rows, bridge, demonstrations),
            "The obstacle is darker with time. The demonstrations are laid between the start frame and \
             the last goal frame.",
        );
        add(
            "from_goal",
            from_goal(rows, bridge, demonstrations),
            "The goal frame is held where it was at first, and all else moves around it.",
        );
        add("error", error(rows, scene), "");
        add("clearance", clearance(rows), "");
        add("limits", limits(rows, bridge), "");
    }
    if let Some(figure) = controller.and_then(latency) {
        add("latency", figure, "In lockstep every state is of no age.");
    }
    pictures
}

fn position(row: &Row) -> DVec2 {
    DVec2::new(row.x_m, row.y_m)
}

fn obstacle(row: &Row) -> DVec2 {
    DVec2::new(row.obstacle_x_m, row.obstacle_y_m)
}

fn goal_frame(row: &Row) -> PlanarPose {
    let position_m = DVec2::new(row.goal_x_m, row.goal_y_m);
    PlanarPose { position_m, angle_rad: row.goal_angle_rad }
}

/// Axes in metres around points, with a little room.
fn map(labels: [&str; 2], points: impl IntoIterator<Item = DVec2>) -> Panel {
    let ends = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let (low, high) = points.into_iter().fold(ends, |(low, high), p| (low.min(p), high.max(p)));
    let side = (high - low).max_element().max(1e-3);
    let room = DVec2::splat(0.05 * side);
    Panel::map("", labels, [low - room, high + room], MAP_PX / (1.1 * side))
}

fn path(rows: &[Row], bridge: &Bridge, demonstrations: &[Demonstration]) -> Figure {
    let frames = [("start", bridge.episode.start()), ("end", goal_frame(&rows[rows.len() - 1]))];
    let [(_, start), (_, end)] = frames;
    let demonstrations: Vec<_> = demonstrations.iter().map(|d| d.between(&start, &end)).collect();
    let radius = bridge.episode.obstacle.radius_m;
    let samples = samples(rows);

    let size = DVec2::splat(radius);
    let balls = samples.iter().flat_map(|row| [obstacle(row) - size, obstacle(row) + size]);
    let points = demonstrations.iter().flatten().copied();
    let points = points.chain(rows.iter().flat_map(|r| [position(r), goal_frame(r).position_m]));
    let tips = frames.iter().flat_map(|(_, frame)| axis_tips(frame));
    let labels = ["x in the base frame [m]", "y in the base frame [m]"];
    let mut panel = map(labels, points.chain(balls).chain(tips));
    for points in demonstrations {
        panel.line(points, &DEMONSTRATION);
    }
    panel.line(rows.iter().map(obstacle), &Stroke::dashed(RED, 1.0));
    for (i, row) in samples.iter().enumerate() {
        let fill = 0.10 + 0.35 * i as f64 / (SAMPLES - 1) as f64;
        panel.circle(obstacle(row), radius, RED, fill);
    }
    panel.line(rows.iter().map(|r| goal_frame(r).position_m), &GOAL_PATH);
    panel.line(rows.iter().map(position), &PATH);
    for (name, frame) in frames {
        for (tip, colour) in axis_tips(&frame).into_iter().zip(AXES) {
            panel.line([frame.position_m, tip], &Stroke::solid(colour, 2.4));
        }
        panel.words(frame.position_m, DVec2::new(8.0, 18.0), Anchor::Start, name);
    }
    label(&mut panel, &samples);
    let legend = [
        ("demonstration", Sign::Line(DEMONSTRATION)),
        ("obstacle", Sign::Ellipse(RED)),
        ("goal", Sign::Line(GOAL_PATH)),
        ("path of the point", Sign::Line(PATH)),
        ("frame", Sign::Frame(&AXES[..2])),
    ];
    Figure::single("The run in the world", legend, panel)
}

/// Writes the times of samples beside the point and the obstacle.
fn label(panel: &mut Panel, samples: &[Row]) {
    let mut labelled: Vec<DVec2> = Vec::new();
    for row in samples {
        panel.dot(position(row), 3.6, BLUE);
        for (point, offset, colour) in [
            (obstacle(row), DVec2::new(-11.0, 4.0), RED),
            (position(row), DVec2::new(7.0, -6.0), BLUE),
        ] {
            // Words on words cannot be read.
            if labelled.iter().all(|other| (*other - point).length() > LABEL_M) {
                let at = panel.at(point) + offset;
                panel.label(at, Anchor::Start, colour, &format!("{:.1} s", row.time_s));
                labelled.push(point);
            }
        }
    }
}

/// Rows about the closest approach to the obstacle, in order of time.
fn samples(rows: &[Row]) -> Vec<Row> {
    let least = rows.iter().map(|r| r.clearance_m).fold(f64::INFINITY, f64::min);
    let closest = rows.iter().position(|r| r.clearance_m <= least).unwrap_or(0);
    let step_s = (rows[rows.len() - 1].time_s - rows[0].time_s) / (rows.len() - 1) as f64;
    let stride = (SAMPLE_S / step_s.max(1e-6)).round().max(1.0) as usize;
    (0..SAMPLES)
        .filter_map(|i| rows.get((closest + i * stride).checked_sub(SAMPLES / 2 * stride)?))
        .copied()
        .collect()
}

fn axis_tips(frame: &PlanarPose) -> [DVec2; 2] {
    [DVec2::X, DVec2::Y].map(|axis| frame.transform(AXIS_M * axis))
}

fn from_goal(rows: &[Row], bridge: &Bridge, demonstrations: &[Demonstration]) -> Figure {
    let (start, first) = (bridge.episode.start(), goal_frame(&rows[0]));
    let from_first = |row: &Row| first.transform(goal_frame(row).inverse_transform(position(row)));
    let seen: Vec<DVec2> = rows.iter().map(from_first).collect();
    let demonstrations: Vec<_> = demonstrations.iter().map(|d| d.between(&start, &first)).collect();
    let labels = ["x with the goal held still [m]", "y with the goal held still [m]"];
    let mut panel = map(labels, demonstrations.iter().flatten().chain(&seen).copied());
    for points in demonstrations {
        panel.line(points, &DEMONSTRATION);
    }
    panel.line(seen.iter().copied(), &PATH);
    let near = rows.iter().zip(&seen).filter(|(row, _)| row.clearance_m < NEAR_M);
    panel.line(near.map(|(_, point)| *point), &NEAR_PATH);
    panel.star(first.position_m);
    let legend = [
        ("demonstration", Sign::Line(DEMONSTRATION)),
        ("path of the point", Sign::Line(PATH)),
        ("within 0.3 m of the obstacle", Sign::Line(NEAR_PATH)),
        ("goal", Sign::Star),
    ];
    Figure::single("The run as seen from the goal", legend, panel)
}

/// Axes over the time of a run.
fn graph(rows: &[Row], label: &str, [low, high]: [f64; 2]) -> Panel {
    let range = [DVec2::new(0.0, low), DVec2::new(rows[rows.len() - 1].time_s, high)];
    Panel::graph("", ["time [s]", label], range, GRAPH_PX)
}

/// A number of each row over time.
fn series(rows: &[Row], of: impl Fn(&Row) -> f64) -> Vec<DVec2> {
    rows.iter().map(|row| DVec2::new(row.time_s, of(row))).collect()
}

/// A graph of curves and a level that is not to be crossed.
fn figure(
    title: &str,
    mut panel: Panel,
    (limit, value, stroke): (&str, f64, Stroke),
    curves: &[(&str, &'static str, Vec<DVec2>)],
) -> Figure {
    let last = curves[0].2.last().map_or(0.0, |p| p.x);
    panel.line([0.0, last].map(|time| DVec2::new(time, value)), &stroke);
    let mut legend = vec![(limit, Sign::Line(stroke))];
    for (label, colour, points) in curves {
        let stroke = Stroke::solid(colour, 2.2);
        panel.line(points.iter().copied(), &stroke);
        legend.push((label, Sign::Line(stroke)));
    }
    Figure::single(title, legend, panel)
}

fn error(rows: &[Row], scene: &Scene) -> Figure {
    let limit_mm = 1e3 * scene.task.position_error_max_m;
    let errors = series(rows, |row| 1e3 * (position(row) - goal_frame(row).position_m).length());
    let least = errors.iter().map(|e| e.y.max(1e-3)).fold(limit_mm, f64::min);
    let most = errors.iter().map(|e| e.y).fold(limit_mm, f64::max);
    let panel = graph(rows, "distance from the moving goal [mm]", decades(least, most));
    let limit = ("limit for success", limit_mm, Stroke::dashed(ORANGE, 1.6));
    let curves = [("distance", BLUE, errors)];
    figure("Distance from the goal", panel.logarithmic(false, true), limit, &curves)
}

fn clearance(rows: &[Row]) -> Figure {
    let clearances = series(rows, |row| row.clearance_m);
    let least = clearances.iter().map(|c| c.y).fold(0.0, f64::min);
    let most = clearances.iter().map(|c| c.y).fold(0.1, f64::max);
    let panel = graph(rows, "clearance [m]", [least - 0.03 * most, 1.05 * most]);
    let contact = ("contact", 0.0, Stroke::dashed(RED, 1.6));
    let curves = [("gap between the surfaces", BLUE, clearances)];
    figure("Gap between point and obstacle", panel, contact, &curves)
}

fn limits(rows: &[Row], bridge: &Bridge) -> Figure {
    let percent = |values: [f64; 2], most: [f64; 2]| {
        100.0 * (values[0].abs() / most[0]).max(values[1].abs() / most[1])
    };
    let (effort_max, velocity_max) = (bridge.effort_max_n, bridge.velocity_max_m_s);
    let force = series(rows, |r| percent([r.force_x_n, r.force_y_n], effort_max));
    let speed = series(rows, |r| percent([r.vx_m_s, r.vy_m_s], velocity_max));
    let panel = graph(rows, "fraction of the limit [%]", [0.01, 130.0]).logarithmic(false, true);
    let labels = [
        format!("force, limit {} N", effort_max[0]),
        format!("speed, limit {} m/s", velocity_max[0]),
    ];
    let curves = [(labels[0].as_str(), BLUE, force), (labels[1].as_str(), GREEN, speed)];
    let limit = ("limit", 100.0, Stroke::dashed(RED, 1.6));
    figure("Forces and speeds against their limits", panel, limit, &curves)
}

/// The controller's histograms: logarithmic buckets, eight an octave.
fn latency(controller: &Value) -> Option<Figure> {
    let buckets = |key: &str| -> Option<Vec<(f64, f64)>> {
        controller[key]["max"].as_f64().filter(|most| *most > 0.0)?;
        let buckets = controller["histograms"][key].as_array()?;
        buckets.iter().map(|b| Some((b[0].as_f64()?, b[1].as_f64()?))).collect()
    };
    let series = [
        ("tick_us", BLUE, "computing a command"),
        ("state_age_us", ORANGE, "age of the state it used"),
    ];
    let series =
        series.map(|(key, colour, label)| (buckets(key).unwrap_or_default(), colour, label));
    let all = || series.iter().flat_map(|(buckets, ..)| buckets);
    let least = all().map(|(upper, _)| upper / BUCKET_RATIO).reduce(f64::min)?;
    let most = all().map(|(upper, _)| *upper).fold(0.0, f64::max);
    let tallest = all().map(|(_, count)| *count).fold(1.0, f64::max);
    let (times, ticks) = (decades(least, most), decades(1.0, tallest));
    // A single tick is seen too.
    let range = [DVec2::new(times[0], 0.6), DVec2::new(times[1], ticks[1])];
    let mut panel =
        Panel::graph("", ["time [µs]", "ticks"], range, GRAPH_PX).logarithmic(true, true);
    let mut legend = Vec::new();
    for (buckets, colour, label) in series.iter().filter(|(buckets, ..)| !buckets.is_empty()) {
        let bar = |(upper, count): &(f64, f64)| {
            [DVec2::new(upper / BUCKET_RATIO, 0.0), DVec2::new(*upper, *count)]
        };
        panel.bars(buckets.iter().map(bar), colour, 0.4);
        legend.push((*label, Sign::Ellipse(colour)));
    }
    Some(Figure::single("Latency of the controller's loop", legend, panel))
}
