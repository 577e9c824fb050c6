//! Makes `target/bench/report.html` from `target/bench/results.json`: verdicts, tables, histograms.
//! One page that needs nothing else.

use std::fmt::Write;
use std::fs;

use serde_json::Value;
use tprmp_bench::Fallible;
use tprmp_bench::plot::{escape, histograms, line, short, stacked};
use tprmp_bench::results::{self, Verdict};
use tprmp_bench::statistics::Buckets;

const STYLE: &str = "\
body{font:15px/1.45 system-ui,sans-serif;color:#22303c;max-width:1400px;margin:24px auto;padding:0 20px}\
h1{font-size:26px}h2{margin-top:40px;border-bottom:1px solid #dfe5ea}h3{margin:26px 0 8px}\
table{border-collapse:collapse;font-size:13px;margin:10px 0}th,td{padding:3px 9px;text-align:right}\
th{border-bottom:2px solid #9aa7b1;vertical-align:bottom}td{border-bottom:1px solid #eef1f4}\
td:first-child,th:first-child,td.t,th.t{text-align:left}td:first-child{white-space:nowrap}\
div.wide{overflow-x:auto}.holds{color:#00705a}.not{color:#b3261e;font-weight:600}\
.open{color:#8a6100}.plots{display:flex;flex-wrap:wrap;gap:14px}p.note{color:#56636f;max-width:900px}";
/// Groups with a section of their own.
const OWN: [&str; 3] = ["latency", "deadlines", "evaluation"];

/// A page that grows.
struct Page(String);

impl Page {
    fn add(&mut self, html: &str) {
        self.0.push_str(html);
        self.0.push('\n');
    }

    fn note(&mut self, text: &str) {
        self.add(&format!("<p class=\"note\">{}</p>", escape(text)));
    }

    fn table(&mut self, head: &[&str], rows: &[Vec<String>]) {
        if rows.is_empty() {
            return;
        }
        let mut html = String::from("<table><tr>");
        for title in head {
            let _ = write!(html, "<th>{}</th>", escape(title));
        }
        for row in rows {
            html.push_str("</tr><tr>");
            for cell in row {
                let _ = write!(html, "<td>{}</td>", escape(cell));
            }
        }
        self.add(&format!("<div class=\"wide\">{html}</tr></table></div>"));
    }

    fn plots(&mut self, plots: &[String]) {
        if plots.iter().any(|plot| !plot.is_empty()) {
            self.add(&format!("<div class=\"plots\">{}</div>", plots.join("\n")));
        }
    }
}

fn text<'a>(row: &'a Value, key: &str) -> &'a str {
    row[key].as_str().unwrap_or("")
}

/// A number of a row, as it is shown.
fn cell(row: &Value, key: &str) -> String {
    match &row[key] {
        Value::Null => "–".into(),
        Value::Number(n) if n.is_u64() => n.to_string(),
        Value::Number(n) => short(n.as_f64().unwrap_or(f64::NAN)),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

fn cells(row: &Value, keys: &[&str]) -> Vec<String> {
    keys.iter().map(|key| cell(row, key)).collect()
}

fn histogram(row: &Value, key: &str) -> Buckets {
    Buckets::from_json(&row["histograms_us"][key]).unwrap_or_default()
}

fn of_group<'a>(rows: &'a [Value], group: &str) -> Vec<&'a Value> {
    rows.iter().filter(|row| row["group"] == group).collect()
}

fn verdicts(page: &mut Page, rows: &[Value]) {
    page.add("<h2>What is promised, and what was found</h2>");
    let mut html = String::from(
        "<table><tr><th>group</th><th class=\"t\">measurement</th><th class=\"t\">must</th>\
         <th class=\"t\">found</th><th></th></tr>",
    );
    // Those over many rows first.
    let (many, single): (Vec<_>, Vec<_>) = rows.iter().partition(|row| row["p50_us"].is_null());
    for row in many.into_iter().chain(single) {
        let Ok(verdict) = serde_json::from_value::<Verdict>(row["verdict"].clone()) else {
            continue;
        };
        let class = match verdict.holds {
            Some(true) => "holds",
            Some(false) => "not",
            None => "open",
        };
        let cells = [text(row, "group"), text(row, "name"), &verdict.must, &verdict.found];
        html.push_str("<tr>");
        for cell in cells {
            let _ = write!(html, "<td class=\"t\">{}</td>", escape(cell));
        }
        let _ = write!(html, "<td class=\"t {class}\">{}</td></tr>", verdict.word());
    }
    page.add(&(html + "</table>"));
}

fn machines(page: &mut Page, rows: &[Value]) {
    page.add("<h2>Machine</h2>");
    let machines: Vec<_> = rows
        .iter()
        .filter(|row| row["name"] == "machine")
        .map(|row| {
            cells(
                row,
                &[
                    "group",
                    "cpu",
                    "cores",
                    "virtual_machine",
                    "kernel",
                    "preempt_rt",
                    "sched_rt_runtime_us",
                    "load_average",
                ],
            )
        })
        .collect();
    let head = [
        "group",
        "processor",
        "cores",
        "virtual machine",
        "kernel",
        "PREEMPT_RT",
        "sched_rt_runtime_us",
        "load average at the start",
    ];
    page.table(&head, &machines);
}

fn evaluation(page: &mut Page, rows: &[Value]) {
    let rows = of_group(rows, "evaluation");
    if rows.is_empty() {
        return;
    }
    page.add("<h2>One evaluation</h2>");
    let (grows, single): (Vec<_>, Vec<_>) = rows.iter().partition(|row| row["series"].is_string());
    generic(page, &single);
    let mut series: Vec<&str> = Vec::new();
    for row in &grows {
        if !series.contains(&text(row, "series")) {
            series.push(text(row, "series"));
        }
    }
    let (mut plots, mut table) = (Vec::new(), Vec::new());
    for name in series {
        let mut points: Vec<(f64, f64)> = grows
            .iter()
            .filter(|row| row["series"] == name)
            .filter_map(|row| Some((row["x"].as_f64()?, row["best_us"].as_f64()?)))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        plots.push(line(&format!("growth with {name}"), name, "µs", &points));
        let list = points.iter().map(|(x, us)| format!("{}: {}", short(*x), short(*us)));
        table.push(vec![name.into(), list.collect::<Vec<_>>().join(", ")]);
    }
    if !plots.is_empty() {
        page.add("<h3>How it grows</h3>");
        page.plots(&plots);
        page.table(&["varied", "number: best of batches in µs"], &table);
    }
}

/// A table of whatever numbers the rows have.
fn generic(page: &mut Page, rows: &[&Value]) {
    let mut keys: Vec<&str> = Vec::new();
    for row in rows {
        for (key, value) in row.as_object().into_iter().flatten() {
            let shown = value.is_number() || (value.is_string() && key == "name");
            if shown && !keys.contains(&key.as_str()) {
                keys.push(key);
            }
        }
    }
    keys.sort_by_key(|key| *key != "name");
    let rows: Vec<_> = rows.iter().map(|row| cells(row, &keys)).collect();
    page.table(&keys, &rows);
}

fn latency(page: &mut Page, rows: &[Value]) {
    let rows: Vec<_> =
        of_group(rows, "latency").into_iter().filter(|row| row["name"] != "machine").collect();
    if rows.is_empty() {
        return;
    }
    page.add("<h2>Between processes: state published → command received</h2>");
    page.note(
        "Times in µs. Blocks of all cases take turns. The ping-pong sends the same messages over the \
         same services, without a controller; the ratio is to the one with one exchange a period. In \
         lockstep the controller asks for no priority and no core of its own.",
    );
    let keys = [
        "name",
        "scheduler",
        "spin_us",
        "p50_us",
        "p99_us",
        "p999_us",
        "max_us",
        "ratio_p50",
        "receiving_p50_us",
        "evaluation_p50_us",
        "publishing_p50_us",
        "cycles",
        "lost",
        "steal_ms",
    ];
    let head = [
        "",
        "scheduler",
        "spin",
        "p50",
        "p99",
        "p99.9",
        "max",
        "ratio of p50",
        "receiving p50",
        "evaluation p50",
        "publishing p50",
        "exchanges",
        "lost",
        "steal [ms]",
    ];
    let table: Vec<_> = rows.iter().map(|row| cells(row, &keys)).collect();
    page.table(&head, &table);
    let reference = rows.iter().find(|row| row["skill"].is_null());
    let plots = rows.iter().filter(|row| row["skill"].is_string()).map(|row| {
        let mut series = vec![("through the controller", histogram(row, "latency"))];
        series.extend(reference.map(|row| ("ping-pong", histogram(row, "latency"))));
        histograms(text(row, "name"), &series)
    });
    page.plots(&plots.collect::<Vec<_>>());
}

fn deadlines(page: &mut Page, rows: &[Value]) {
    let rows: Vec<_> =
        of_group(rows, "deadlines").into_iter().filter(|row| row["rate_hz"].is_u64()).collect();
    if rows.is_empty() {
        return;
    }
    page.add("<h2>Deadlines</h2>");
    page.note(
        "Times in µs. A deadline is missed when the command is not out within a period of the tick's \
         due time; cyclictest, on the same core in the same minutes, misses when it wakes up later \
         than that. Steal is what the hypervisor took from that core meanwhile. A slow tick spends \
         more than 100 µs on evaluation and publishing; in brackets those without steal within 0.1 s. \
         A busy core is one with a process that computes and walks through memory.",
    );
    let mut kinds: Vec<(&str, &str)> = Vec::new();
    for row in &rows {
        let kind = (text(row, "scheduler"), text(row, "wait"));
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    let head = [
        "load",
        "rate [Hz]",
        "cycles",
        "misses",
        "cyclictest",
        "of cycles",
        "steal [ms]",
        "its steal",
        "wake-up p50",
        "p99",
        "p99.9",
        "max",
        "cyclictest p99",
        "max",
        "state age max",
        "evaluation p99",
        "max",
        "publishing p99",
        "max",
        "slow ticks",
    ];
    let keys = [
        "load",
        "rate_hz",
        "cycles",
        "misses",
        "cyclictest_misses",
        "cyclictest_cycles",
        "steal_ms",
        "cyclictest_steal_ms",
        "p50_us",
        "p99_us",
        "p999_us",
        "max_us",
        "cyclictest_p99_us",
        "cyclictest_max_us",
        "state_age_max_us",
        "evaluation_p99_us",
        "evaluation_max_us",
        "publishing_p99_us",
        "publishing_max_us",
    ];
    for (scheduler, wait) in kinds {
        page.add(&format!("<h3>{}, {}</h3>", escape(scheduler), escape(wait)));
        let of_kind: Vec<_> = rows
            .iter()
            .filter(|row| text(row, "scheduler") == scheduler && text(row, "wait") == wait)
            .collect();
        let table: Vec<_> = of_kind
            .iter()
            .map(|row| {
                let mut cells = cells(row, &keys);
                let (slow, bare) = (cell(row, "slow_ticks"), cell(row, "slow_ticks_without_steal"));
                cells.push(format!("{slow} ({bare})"));
                cells
            })
            .collect();
        page.table(&head, &table);
        let mut plots = Vec::new();
        // The rate that is judged, or whatever was measured.
        let judged = of_kind.iter().filter(|row| row["rate_hz"] == 1000).count() > 0;
        for row in of_kind.iter().filter(|row| !judged || row["rate_hz"] == 1000) {
            plots.push(histograms(
                &format!("{} Hz, {}", cell(row, "rate_hz"), text(row, "load")),
                &[
                    ("wake-up", histogram(row, "wake_up")),
                    ("cyclictest", histogram(row, "cyclictest")),
                    ("evaluation", histogram(row, "evaluation")),
                    ("publishing", histogram(row, "publishing")),
                ],
            ));
            plots.push(worst(row));
        }
        page.plots(&plots);
    }
}

/// The slowest ticks of a row, split into what they spent their time on.
fn worst(row: &Value) -> String {
    let parts = ["wake-up", "receiving", "evaluation", "publishing"];
    let keys = ["wake_up_us", "receiving_us", "evaluation_us", "publishing_us"];
    let ticks = row["worst_ticks"].as_array().into_iter().flatten();
    let bars: Vec<_> = ticks
        .enumerate()
        .map(|(i, tick)| {
            let stolen = if tick["steal"] == true { "steal" } else { "" };
            let times = keys.iter().map(|key| tick[*key].as_f64().unwrap_or(0.0)).collect();
            (format!("{stolen} {}", i + 1), times)
        })
        .collect();
    if bars.is_empty() { String::new() } else { stacked("its slowest ticks", "µs", &parts, &bars) }
}

fn main() -> Fallible<()> {
    let rows = results::read()?;
    let mut page = Page(String::new());
    page.add("<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">");
    page.add(&format!("<title>Benchmarks</title><style>{STYLE}</style></head><body>"));
    page.add("<h1>Benchmarks</h1>");
    verdicts(&mut page, &rows);
    machines(&mut page, &rows);
    evaluation(&mut page, &rows);
    latency(&mut page, &rows);
    deadlines(&mut page, &rows);
    let mut others: Vec<&str> = Vec::new();
    for row in &rows {
        let group = text(row, "group");
        if !OWN.contains(&group) && !others.contains(&group) {
            others.push(group);
        }
    }
    for group in others {
        page.add(&format!("<h2>{}</h2>", escape(group)));
        generic(&mut page, &of_group(&rows, group));
    }
    page.add("</body></html>");
    let path = results::folder().join("report.html");
    fs::write(&path, page.0)?;
    println!("report: {}", path.display());
    Ok(())
}
