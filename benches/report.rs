//! Makes `target/bench/report.html` from `target/bench/results.json`: verdicts, tables, histograms.
//! One page that needs nothing else.

use std::fs;

use glam::DVec2;
use serde_json::Value;
use tprmp_bench::Fallible;
use tprmp_bench::results::{self, Verdict};
use tprmp_bench::statistics::Buckets;
use tprmp_drawing::{
    Anchor, BLUE, Cell, Figure, GREEN, INK, ORANGE, PURPLE, Page, Panel, Picture, Sign, Stroke,
    decades, number,
};

/// Groups with a section of their own.
const OWN: [&str; 3] = ["evaluation", "latency", "deadlines"];
const COLOURS: [&str; 4] = [BLUE, ORANGE, GREEN, PURPLE];
/// Size of the axes of a graph \[px\].
const SIZE: DVec2 = DVec2::new(360.0, 190.0);
/// The rate whose rows are drawn, where it was measured \[Hz\].
const DRAWN_HZ: u64 = 1000;

/// Columns of tables: title and key.
const MACHINE: [(&str, &str); 8] = [
    ("group", "group"),
    ("processor", "cpu"),
    ("cores", "cores"),
    ("virtual machine", "virtual_machine"),
    ("kernel", "kernel"),
    ("PREEMPT_RT", "preempt_rt"),
    ("sched_rt_runtime_us", "sched_rt_runtime_us"),
    ("load average at the start", "load_average"),
];
const LATENCY: [(&str, &str); 14] = [
    ("", "name"),
    ("scheduler", "scheduler"),
    ("spin", "spin_us"),
    ("p50", "p50_us"),
    ("p99", "p99_us"),
    ("p99.9", "p999_us"),
    ("max", "max_us"),
    ("ratio of p50", "ratio_p50"),
    ("receiving p50", "receiving_p50_us"),
    ("evaluation p50", "evaluation_p50_us"),
    ("publishing p50", "publishing_p50_us"),
    ("exchanges", "cycles"),
    ("lost", "lost"),
    ("steal [ms]", "steal_ms"),
];
const DEADLINES: [(&str, &str); 21] = [
    ("load", "load"),
    ("rate [Hz]", "rate_hz"),
    ("cycles", "cycles"),
    ("misses", "misses"),
    ("cyclictest", "cyclictest_misses"),
    ("of cycles", "cyclictest_cycles"),
    ("steal [ms]", "steal_ms"),
    ("its steal", "cyclictest_steal_ms"),
    ("wake-up p50", "p50_us"),
    ("p99", "p99_us"),
    ("p99.9", "p999_us"),
    ("max", "max_us"),
    ("cyclictest p99", "cyclictest_p99_us"),
    ("max", "cyclictest_max_us"),
    ("state age max", "state_age_max_us"),
    ("evaluation p99", "evaluation_p99_us"),
    ("max", "evaluation_max_us"),
    ("publishing p99", "publishing_p99_us"),
    ("max", "publishing_max_us"),
    ("slow ticks", "slow_ticks"),
    ("without steal", "slow_ticks_without_steal"),
];

fn text<'a>(row: &'a Value, key: &str) -> &'a str {
    row[key].as_str().unwrap_or("")
}

fn cell(row: &Value, key: &str) -> Cell {
    match &row[key] {
        Value::Null => "–".into(),
        Value::Number(n) if n.is_u64() => n.to_string().into(),
        Value::Number(n) => number(n.as_f64().unwrap_or(f64::NAN)).into(),
        Value::String(text) => text.into(),
        other => other.to_string().into(),
    }
}

fn table(page: &mut Page, columns: &[(&str, &str)], rows: &[&Value]) {
    let head: Vec<_> = columns.iter().map(|(title, _)| *title).collect();
    let cells = |row: &&Value| columns.iter().map(|(_, key)| cell(row, key)).collect();
    page.table(&head, rows.iter().map(cells));
}

/// A table of whatever numbers the rows have.
fn table_of_numbers(page: &mut Page, rows: &[&Value]) {
    let fields = rows.iter().filter_map(|row| row.as_object()).flatten();
    let mut keys =
        distinct(fields.filter(|(_, value)| value.is_number()).map(|(key, _)| key.as_str()));
    keys.insert(0, "name");
    let columns: Vec<_> = keys.into_iter().map(|key| (key, key)).collect();
    table(page, &columns, rows);
}

/// Each of some things once, in their order.
fn distinct<T: PartialEq>(all: impl IntoIterator<Item = T>) -> Vec<T> {
    let mut distinct = Vec::new();
    for one in all {
        if !distinct.contains(&one) {
            distinct.push(one);
        }
    }
    distinct
}

fn picture(figure: &Figure) -> Picture {
    Picture { name: figure.title.clone(), svg: figure.svg(), caption: String::new() }
}

fn verdicts(page: &mut Page, rows: &[Value]) {
    page.section("What is promised, and what was found");
    // Those over many rows first.
    let (many, single): (Vec<_>, Vec<_>) = rows.iter().partition(|row| row["p50_us"].is_null());
    let judged = many.into_iter().chain(single).filter_map(|row| {
        let verdict: Verdict = serde_json::from_value(row["verdict"].clone()).ok()?;
        let judgement = Cell::verdict(verdict.holds, verdict.word());
        Some(vec![
            text(row, "group").into(),
            text(row, "name").into(),
            verdict.must.into(),
            verdict.found.into(),
            judgement,
        ])
    });
    page.table(&["group", "measurement", "must", "found", ""], judged);
}

fn evaluation(page: &mut Page, rows: &[&Value]) {
    page.section("One evaluation");
    let (series, single): (Vec<&Value>, Vec<_>) =
        rows.iter().copied().partition(|row| row["series"].is_string());
    table_of_numbers(page, &single);
    let (mut pictures, mut table) = (Vec::new(), Vec::new());
    for name in distinct(series.iter().map(|row| text(row, "series"))) {
        let own = series.iter().filter(|row| row["series"] == name);
        let mut points: Vec<DVec2> = own
            .filter_map(|row| Some(DVec2::new(row["x"].as_f64()?, row["best_us"].as_f64()?)))
            .collect();
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        pictures.push(picture(&growth(name, &points)));
        let list = points.iter().map(|p| format!("{}: {}", number(p.x), number(p.y)));
        table.push(vec![name.into(), list.collect::<Vec<_>>().join(", ").into()]);
    }
    if !pictures.is_empty() {
        page.subsection("How it grows");
        page.pictures(&pictures);
        page.table(&["varied", "number: best of batches in µs"], table);
    }
}

/// A line through points, both axes from zero.
fn growth(name: &str, points: &[DVec2]) -> Figure {
    let high = points.iter().copied().fold(DVec2::splat(1e-9), DVec2::max) * DVec2::new(1.05, 1.1);
    let what = name.split(',').next().unwrap_or(name);
    let mut panel = Panel::graph("", [what, "time [µs]"], [DVec2::ZERO, high], SIZE);
    panel.line(points.iter().copied(), &Stroke::solid(BLUE, 2.0));
    points.iter().for_each(|point| panel.dot(*point, 3.5, BLUE));
    Figure::single(name, [], panel)
}

fn latency(page: &mut Page, rows: &[&Value]) {
    let rows: Vec<_> = rows.iter().copied().filter(|row| row["name"] != "machine").collect();
    page.section("Between processes: state published → command received");
    page.paragraph(
        "Times in µs. The blocks of the cases alternate. The ping-pong sends the same messages over the \
         same services, without a controller; the ratio is to the one with one exchange a period. In \
         lockstep the controller asks for no priority and no core of its own.",
    );
    table(page, &LATENCY, &rows);
    let reference = rows.iter().find(|row| row["skill"].is_null());
    let pictures = rows.iter().filter(|row| row["skill"].is_string()).filter_map(|row| {
        let mut series = vec![("through the controller", histogram(row, "latency"))];
        series.extend(reference.map(|row| ("ping-pong", histogram(row, "latency"))));
        histograms(text(row, "name"), &series)
    });
    page.pictures(&pictures.collect::<Vec<_>>());
}

fn deadlines(page: &mut Page, rows: &[&Value]) {
    let rows: Vec<_> = rows.iter().copied().filter(|row| row["rate_hz"].is_u64()).collect();
    page.section("Deadlines");
    page.paragraph(
        "Times in µs. A deadline is missed when the command is not out within a period of the tick's \
         due time; cyclictest, on the same core in the same minutes, misses when it wakes up later \
         than that. Steal is what the hypervisor took from that core meanwhile. A slow tick spends \
         more than 100 µs on evaluation and publishing; those without steal had none within 0.1 s. A \
         busy core is one with a process that computes and walks through memory.",
    );
    let kind = |row: &Value| (text(row, "scheduler").to_owned(), text(row, "wait").to_owned());
    for of_it in distinct(rows.iter().map(|row| kind(row))) {
        page.subsection(&format!("{}, {}", of_it.0, of_it.1));
        let own: Vec<&Value> = rows.iter().copied().filter(|row| kind(row) == of_it).collect();
        table(page, &DEADLINES, &own);
        let all = !own.iter().any(|row| row["rate_hz"] == DRAWN_HZ);
        let drawn = own.iter().filter(|row| all || row["rate_hz"] == DRAWN_HZ);
        let pictures = drawn.flat_map(|row| {
            let title = text(row, "name");
            let series = [
                ("wake-up", "wake_up"),
                ("cyclictest", "cyclictest"),
                ("evaluation", "evaluation"),
                ("publishing", "publishing"),
            ];
            let series = series.map(|(label, key)| (label, histogram(row, key)));
            [histograms(title, &series), slowest(title, row)]
        });
        page.pictures(&pictures.flatten().collect::<Vec<_>>());
    }
}

fn histogram(row: &Value, key: &str) -> Buckets {
    Buckets::from_json(&row["histograms_us"][key]).unwrap_or_default()
}

/// Several histograms over each other: times on a logarithmic axis, fractions of all times on another,
/// so that one in 10⁵ is still seen. `None` when there is nothing to draw.
fn histograms(title: &str, series: &[(&str, Buckets)]) -> Option<Picture> {
    let all = || series.iter().flat_map(|(_, buckets)| buckets.bars());
    let low = all().map(|(low, ..)| low).reduce(f64::min)?;
    let high = all().map(|(_, high, _)| high).fold(0.0, f64::max);
    let most = series.iter().map(|(_, buckets)| buckets.total()).max()?;
    let (times, least) = (decades(low, high), decades(1.0, most as f64)[1]);
    let range = [DVec2::new(times[0], 100.0 / least), DVec2::new(times[1], 100.0)];
    let mut panel =
        Panel::graph("", ["time [µs]", "of all [%]"], range, SIZE).logarithmic(true, true);
    let mut legend = Vec::new();
    for ((label, buckets), colour) in series.iter().zip(COLOURS) {
        if buckets.total() > 0 {
            let percent = 100.0 / buckets.total() as f64;
            let bars = buckets.bars().into_iter().map(|(low, high, count)| {
                [DVec2::new(low, 0.0), DVec2::new(high, percent * count as f64)]
            });
            panel.bars(bars, colour, 0.25);
            legend.push((*label, Sign::Ellipse(colour)));
        }
    }
    Some(picture(&Figure::single(title, legend, panel)))
}

/// The slowest ticks of a row, split into what they spent their time on; `None` where none are known.
fn slowest(title: &str, row: &Value) -> Option<Picture> {
    const PARTS: [&str; 4] = ["wake-up", "receiving", "evaluation", "publishing"];
    const KEYS: [&str; 4] = ["wake_up_us", "receiving_us", "evaluation_us", "publishing_us"];
    let ticks: Vec<(bool, [f64; 4])> = row["worst_ticks"]
        .as_array()?
        .iter()
        .map(|tick| (tick["steal"] == true, KEYS.map(|key| tick[key].as_f64().unwrap_or(0.0))))
        .collect();
    let tops = ticks.iter().map(|(_, times)| times.iter().sum::<f64>());
    let high = DVec2::new(ticks.len() as f64 + 0.6, 1.15 * tops.reduce(f64::max)?);
    let range = [DVec2::new(0.4, 0.0), high];
    let mut panel = Panel::graph("", ["its slowest ticks", "time [µs]"], range, SIZE);
    for (part, colour) in COLOURS.into_iter().enumerate() {
        let bars = ticks.iter().enumerate().map(|(i, (_, times))| {
            let below: f64 = times[..part].iter().sum();
            let x = i as f64 + 1.0;
            [DVec2::new(x - 0.3, below), DVec2::new(x + 0.3, below + times[part])]
        });
        panel.bars(bars, colour, 0.8);
    }
    for (i, (_, times)) in ticks.iter().enumerate().filter(|(_, (stolen, _))| *stolen) {
        let top = panel.at(DVec2::new(i as f64 + 1.0, times.iter().sum()));
        panel.label(top - DVec2::Y * 5.0, Anchor::Middle, INK, "steal");
    }
    let legend = PARTS.into_iter().zip(COLOURS.map(Sign::Ellipse));
    Some(picture(&Figure::single(&format!("{title}: slowest ticks"), legend, panel)))
}

fn main() -> Fallible<()> {
    let rows = results::read()?;
    let of = |group: &str| rows.iter().filter(|row| row["group"] == group).collect::<Vec<_>>();
    let mut page = Page::new("Benchmarks");
    verdicts(&mut page, &rows);
    page.section("Machine");
    let machines: Vec<_> = rows.iter().filter(|row| row["name"] == "machine").collect();
    table(&mut page, &MACHINE, &machines);
    let own: [fn(&mut Page, &[&Value]); 3] = [evaluation, latency, deadlines];
    for (group, section) in OWN.into_iter().zip(own) {
        if !of(group).is_empty() {
            section(&mut page, &of(group));
        }
    }
    let groups = distinct(rows.iter().map(|row| text(row, "group")));
    for group in groups.into_iter().filter(|group| !OWN.contains(group)) {
        page.section(group);
        table_of_numbers(&mut page, &of(group));
    }
    let path = results::folder().join("report.html");
    fs::write(&path, page.html())?;
    println!("report: {}", path.display());
    Ok(())
}
