//! The page, and the summary on the terminal.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use tprmp_drawing::{Cell, Page, number};

use crate::conditions::DURATION_S;
use crate::dataset::SkillSet;
use crate::experiment::{Experiment, PolicyKind, Space};
use crate::people;
use crate::report::content::Run;
use crate::report::{boxes, fields, measures, obstacle, paths, stability, times};
use crate::verdict::Verdict;

/// The table of verdicts as text.
pub(crate) fn summary(verdicts: &[Verdict], failures: &[String]) -> String {
    let mut text = String::new();
    for verdict in verdicts {
        let sign = match verdict.holds {
            Some(true) => "pass",
            Some(false) => "FAIL",
            None => "-",
        };
        writeln!(text, "{sign:<5} {}\n      {}", verdict.requirement, verdict.measured)
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
pub(crate) fn page(run: &Run) -> String {
    let bench = run.bench;
    let mut page = Page::new(&format!("Experiments on “{}”", bench.dataset));
    page.paragraph(&format!(
        "{skills} skills, {rollouts} rollouts, seed {seed}; {seconds:.0} s, of which training \
         {training:.0} s. Each experiment is measured twice: by what the thesis measured (after its \
         early stop, against the policy's own goal), and against the true goal after {duration} s.",
        skills = bench.skills.len(),
        rollouts = run.cases.len(),
        seed = bench.seed,
        seconds = run.elapsed.as_secs_f64(),
        training = run.trained.as_secs_f64(),
        duration = DURATION_S,
    ));
    page.paragraph(&scales(run));
    page.section("What the default policy must do");
    page.table(&["", "requirement", "measured"], run.verdicts.iter().map(verdict_row));
    if !bench.models.failures.is_empty() {
        page.section("Not trained");
        page.list(&bench.models.failures);
    }
    page.section("The field's measures");
    measures::tables(&mut page, run);
    if !run.people.is_empty() {
        page.section("Learned from a hand's recordings");
        page.paragraph(
            "The same paths, frames and noise in each row of a method: 30 Hz, a tremor of 1.2 mm, durations that \
             differ by 20 %, a pace of its own for each demonstration, rests of 0.7 to 1.4 s. Distances of the \
             recordings from the learned paths.",
        );
        let rows = people::table::cells(run.people);
        let cells = |row: &Vec<String>| row.iter().map(Cell::from).collect::<Vec<_>>();
        page.table(&people::table::HEADS, rows.iter().map(cells));
    }
    page.section("Figures");
    let mut pictures = boxes::pictures(run);
    pictures.extend(obstacle::picture(run));
    pictures.extend(measures::picture(run));
    pictures.extend(times::picture(run));
    pictures.extend(stability::picture(run));
    pictures.extend(paths::pictures(run));
    pictures.extend(fields::pictures(run));
    pictures.sort_by(|a, b| order(&a.name).total_cmp(&order(&b.name)));
    page.pictures(&pictures);
    page.section("Failures by policy and experiment");
    list_failures(&mut page, run);
    page.html()
}

/// How large the skills are beside the thesis'.
fn scales(run: &Run) -> String {
    let of = |space| run.bench.skills.iter().find(move |set| set.space() == space);
    let sentence = |set: &SkillSet| {
        format!(
            "The lengths, speeds and forces of the experiments ({}) are the thesis' × {}: so many times as large \
             are the skills, by the median. Titles name the thesis'. ",
            set.space(),
            number(set.scale())
        )
    };
    Space::ALL.into_iter().filter_map(of).map(sentence).collect()
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

fn verdict_row(verdict: &Verdict) -> Vec<Cell> {
    let word = match verdict.holds {
        Some(true) => "pass",
        Some(false) => "fail",
        None => "–",
    };
    let mut measured = Cell::from(&verdict.measured);
    if !verdict.failures.is_empty() {
        let summary = format!("{} failures", verdict.failures.len());
        measured = measured.with_details(&summary, &verdict.failures.join("; "));
    }
    vec![Cell::verdict(verdict.holds, word), (&verdict.requirement).into(), measured]
}

/// Every rollout that did not reach its goal, or touched an obstacle though it need not have.
fn list_failures(page: &mut Page, run: &Run) {
    let mut groups: BTreeMap<(PolicyKind, Experiment), (usize, Vec<String>)> = BTreeMap::new();
    for row in run.rows.iter().filter(|row| row.iteration_us.is_none()) {
        let group = groups.entry((row.policy, row.experiment)).or_default();
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
        let summary = format!("{policy}, {experiment}: {} of {count}", failures.len());
        page.details(&summary, &failures.join("; "));
    }
}
