//! The report: every figure beside what the thesis published, and what the default policy must do.

use std::fmt::Write as _;
use std::time::Duration;

use super::protocol::{Bench, Case};
use super::results::Row;
use super::verdict::Verdict;
use tprmp_drawing::svg::{INK, escape};

mod boxes;
mod fields;
mod paths;

/// All that a run gave.
pub struct Run<'a> {
    /// Skills and models.
    pub bench: &'a Bench<'a>,
    /// The rollouts.
    pub cases: &'a [Case],
    /// What they gave, then stability and times.
    pub rows: &'a [Row],
    /// Times of control iterations.
    pub timed: &'a [(Row, Vec<f64>)],
    /// What the default policy must do.
    pub verdicts: &'a [Verdict],
    /// How long the training took.
    pub trained: Duration,
    /// How long all took.
    pub elapsed: Duration,
}

/// A figure of the page: what it shows, and a sentence on what is seen.
struct Picture {
    title: String,
    svg: String,
    caption: String,
}

/// The table of verdicts as text.
#[must_use]
pub fn summary(verdicts: &[Verdict], failures: &[String]) -> String {
    let mut text = String::new();
    for verdict in verdicts {
        let sign = match verdict.holds {
            Some(true) => "pass",
            Some(false) => "FAIL",
            None => "-",
        };
        writeln!(text, "{sign:<5} {}\n      {}", verdict.demand, verdict.measured)
            .expect("a string grows");
        if !verdict.failures.is_empty() {
            let first: Vec<&str> = verdict.failures.iter().take(6).map(String::as_str).collect();
            let more = verdict.failures.len() - first.len();
            let more = if more > 0 { format!("; and {more} more") } else { String::new() };
            writeln!(text, "      not: {}{more}", first.join("; ")).expect("a string grows");
        }
    }
    for failure in failures {
        writeln!(text, "not trained: {failure}").expect("a string grows");
    }
    text
}

/// The self-contained page.
#[must_use]
pub fn page(run: &Run) -> String {
    let bench = run.bench;
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <title>Experiments on {dataset}</title>\n<style>\n\
         body {{ font: 15px/1.5 'Helvetica Neue', Helvetica, Arial, 'Liberation Sans', sans-serif; \
         color: {INK}; background: #f1f4f6; margin: 24px auto; max-width: 1240px; padding: 0 16px; }}\n\
         figure {{ margin: 0 0 20px; padding: 8px; background: white; border: 1px solid #d5dce2; \
         border-radius: 6px; }}\n\
         figure > svg {{ max-width: 100%; height: auto; }}\n\
         figcaption {{ padding: 4px 14px 10px; max-width: 100ch; }}\n\
         table {{ border-collapse: collapse; background: white; }}\n\
         td, th {{ border: 1px solid #d5dce2; padding: 3px 10px; text-align: left; \
         vertical-align: top; }}\n\
         .pass {{ color: #1b7a3a; font-weight: 600; }} .fail {{ color: #c2291f; font-weight: 600; }}\n\
         details {{ max-width: 90ch; }}\n</style>\n</head>\n<body>\n\
         <h1>Experiments on “{dataset}”</h1>\n<p>{skills} skills, {rollouts} rollouts, seed {seed}; \
         {seconds:.0} s, of which training {training:.0} s. Each experiment is measured twice: by what the thesis measured \
         (after its early stop, against the policy's own goal), and against the true goal after \
         {duration} s.</p>\n",
        dataset = escape(&bench.dataset),
        skills = bench.skills.len(),
        rollouts = run.cases.len(),
        seed = bench.seed,
        seconds = run.elapsed.as_secs_f64(),
        training = run.trained.as_secs_f64(),
        duration = super::protocol::DURATION_S,
    );
    page += &verdict_table(run.verdicts);
    if !bench.models.failures.is_empty() {
        page += "<h2>Not trained</h2>\n<ul>\n";
        for failure in &bench.models.failures {
            writeln!(page, "<li>{}</li>", escape(failure)).expect("a string grows");
        }
        page += "</ul>\n";
    }
    let mut pictures = boxes::pictures(run);
    pictures.extend(paths::pictures(run));
    pictures.extend(fields::pictures(run));
    pictures.sort_by(|a, b| order(&a.title).total_cmp(&order(&b.title)));
    for picture in pictures {
        writeln!(
            page,
            "<figure>\n<h3>{}</h3>\n{}<figcaption>{}</figcaption>\n</figure>",
            escape(&picture.title),
            picture.svg,
            escape(&picture.caption)
        )
        .expect("a string grows");
    }
    page += &failure_list(run);
    page += "</body>\n</html>\n";
    page
}

/// Figures in the order of the thesis: 3.2 before 4.2 before 5.10; what has no number comes last.
fn order(title: &str) -> f64 {
    let number = title.trim_start_matches("Figure ");
    let number: String =
        number.chars().take_while(|c| c.is_ascii_digit() || *c == '.' || *c == 'A').collect();
    let mut parts = number.split('.');
    let chapter = match parts.next() {
        Some("A") => 8.0,
        Some(chapter) => chapter.parse().unwrap_or(9.0),
        None => 9.0,
    };
    let figure: f64 = parts.next().and_then(|figure| figure.parse().ok()).unwrap_or(0.0);
    chapter * 100.0 + figure
}

fn verdict_table(verdicts: &[Verdict]) -> String {
    let mut table = String::from(
        "<h2>What the default policy must do</h2>\n<table>\n<tr><th></th><th>demand</th>\
         <th>measured</th></tr>\n",
    );
    for verdict in verdicts {
        let sign = match verdict.holds {
            Some(true) => "<span class=\"pass\">pass</span>",
            Some(false) => "<span class=\"fail\">fail</span>",
            None => "–",
        };
        let failures = if verdict.failures.is_empty() {
            String::new()
        } else {
            format!(
                "<details><summary>{} failures</summary>{}</details>",
                verdict.failures.len(),
                escape(&verdict.failures.join("; "))
            )
        };
        writeln!(
            table,
            "<tr><td>{sign}</td><td>{}</td><td>{}{failures}</td></tr>",
            escape(&verdict.demand),
            escape(&verdict.measured)
        )
        .expect("a string grows");
    }
    table + "</table>\n"
}

/// Every rollout that did not reach its goal, or touched an obstacle though it need not have.
fn failure_list(run: &Run) -> String {
    let mut text = String::from("<h2>Failures by policy and experiment</h2>\n");
    let mut groups: std::collections::BTreeMap<(String, String), (usize, Vec<String>)> =
        std::collections::BTreeMap::new();
    for row in run.rows.iter().filter(|row| row.iteration_us.is_none()) {
        let group = groups.entry((row.policy.clone(), row.experiment.clone())).or_default();
        group.0 += 1;
        if row.feasible && (!row.reached || row.collided) {
            let how = match row.goal_error_m {
                _ if row.collided => "touched the obstacle".to_owned(),
                Some(error) => format!("{:.1} mm", error * 1e3),
                None => "diverged".to_owned(),
            };
            group.1.push(format!(
                "{} ({}, run {}, seed {}): {how}",
                row.skill,
                row.setting,
                row.instance + 1,
                row.seed
            ));
        }
    }
    for ((policy, experiment), (count, failures)) in groups {
        if failures.is_empty() {
            continue;
        }
        writeln!(
            text,
            "<details><summary>{}, {}: {} of {count}</summary>{}</details>",
            escape(&policy),
            escape(&experiment),
            failures.len(),
            escape(&failures.join("; "))
        )
        .expect("a string grows");
    }
    text
}
