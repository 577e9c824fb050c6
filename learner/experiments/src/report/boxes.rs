//! Figures of numbers: box plots over what was varied, counts, histograms of times.

use glam::DVec2;

use super::Run;
use crate::metric::quantile;
use crate::published::{Published, at, published};
use crate::results::Row;
use tprmp_drawing::{
    Anchor, BLUE, Figure, GREEN, GREY, ORANGE, PURPLE, Panel, Picture, RED, Sign, Stroke,
};

/// Size of the axes [px].
const SIZE: DVec2 = DVec2::new(470.0, 300.0);
/// What is smaller or larger is drawn at the edge: log10 of the axes.
const DECADES: [f64; 2] = [-6.0, 3.0];

/// Colour of a policy.
fn colour(policy: &str) -> &'static str {
    match policy {
        "canonical" => BLUE,
        "thesis" => RED,
        "pd" => GREEN,
        "pd_published" => GREY,
        "dmp" => ORANGE,
        _ => PURPLE,
    }
}

fn line(colour: &'static str, width: f64, dashes: &'static str) -> Stroke {
    Stroke { colour, width, dashes, rim: false }
}

/// One experiment as box plots: left what the thesis measured, right the true error.
struct Boxes {
    title: &'static str,
    experiment: &'static str,
    label: &'static str,
    unit: &'static str,
    /// Only the first demonstration's frames.
    first_only: bool,
}

const BOXES: [Boxes; 13] = [
    Boxes {
        title: "Figure 5.3a: planar tracking over K",
        experiment: "tracking",
        label: "K",
        unit: "",
        first_only: true,
    },
    Boxes {
        title: "Figure 5.3b: tracking of the pick over K",
        experiment: "pick_tracking",
        label: "K",
        unit: "",
        first_only: false,
    },
    Boxes {
        title: "Figure 5.7a: goal on a circle of 0.2 m, over K",
        experiment: "adaptation",
        label: "K",
        unit: "",
        first_only: false,
    },
    Boxes {
        title: "Figure 5.7b: object on a circle of 0.2 m, over K",
        experiment: "pick_adaptation",
        label: "K",
        unit: "",
        first_only: false,
    },
    Boxes {
        title: "Figure 5.8a: push across the motion, truly orthogonal",
        experiment: "disturbance",
        label: "force [N]",
        unit: " N",
        first_only: false,
    },
    Boxes {
        title: "Figure 5.8a: push as published, which is not orthogonal",
        experiment: "disturbance_published",
        label: "force [N]",
        unit: " N",
        first_only: false,
    },
    Boxes {
        title: "Figure 5.8b: push on the pick",
        experiment: "pick_disturbance",
        label: "force [N]",
        unit: " N",
        first_only: false,
    },
    Boxes {
        title: "Figure 5.9a: goal on circles of growing radius",
        experiment: "radius",
        label: "radius [m]",
        unit: " m",
        first_only: false,
    },
    Boxes {
        title: "Figure 5.9b: object on circles of growing radius",
        experiment: "pick_radius",
        label: "radius [m]",
        unit: " m",
        first_only: false,
    },
    Boxes {
        title: "Static displaced goals, in all directions",
        experiment: "static_goal",
        label: "displacement [m]",
        unit: " m",
        first_only: false,
    },
    Boxes {
        title: "Frames turned at rest",
        experiment: "turned_frames",
        label: "turn [°]",
        unit: "°",
        first_only: false,
    },
    Boxes {
        title: "Noisy starts",
        experiment: "start_noise",
        label: "radius of the noise [m]",
        unit: " m",
        first_only: false,
    },
    Boxes {
        title: "Object that circles and turns",
        experiment: "pick_turning",
        label: "turn [rad]",
        unit: " rad",
        first_only: false,
    },
];

/// All of these figures.
pub(super) fn pictures(run: &Run) -> Vec<Picture> {
    let figures = published();
    let mut pictures: Vec<Picture> =
        BOXES.iter().filter_map(|boxes| boxes.picture(run, &figures)).collect();
    pictures.extend(successes(run, &figures));
    pictures.extend(times(run, &figures));
    pictures.extend(stability(run));
    pictures
}

/// What was varied, ascending, and the policies, in a fixed order.
fn axes(rows: &[&Row]) -> (Vec<f64>, Vec<String>) {
    let mut xs: Vec<f64> = rows.iter().map(|row| row.x).filter(|x| x.is_finite()).collect();
    xs.sort_by(f64::total_cmp);
    xs.dedup();
    let policies = ["canonical", "thesis", "pd", "pd_published", "dmp", "tpgmm_lqr"];
    let known = policies.into_iter().filter(|p| rows.iter().any(|row| row.policy == *p));
    (xs, known.map(Into::into).collect())
}

/// Least distance of neighbours, where there are any.
fn step(xs: &[f64]) -> f64 {
    let own = xs.iter().filter(|x| **x != 0.0).copied().collect::<Vec<_>>();
    own.windows(2).map(|pair| pair[1] - pair[0]).reduce(f64::min).unwrap_or(1.0)
}

/// A place to the left of all that is varied.
fn left(xs: &[f64], step: f64) -> f64 {
    xs.iter().filter(|x| **x != 0.0).copied().reduce(f64::min).unwrap_or(0.0) - step
}

/// Values of a policy at a value of what was varied; missing ones are infinite.
fn values(rows: &[&Row], policy: &str, x: f64, of: impl Fn(&Row) -> Option<f64>) -> Vec<f64> {
    let own = rows.iter().filter(|row| row.policy == policy && row.x == x);
    own.map(|row| of(row).unwrap_or(f64::INFINITY)).collect()
}

fn decade(value: f64) -> f64 {
    value.max(1e-300).log10().clamp(DECADES[0], DECADES[1])
}

impl Boxes {
    fn picture(&self, run: &Run, figures: &[Published]) -> Option<Picture> {
        let rows: Vec<&Row> = run
            .rows
            .iter()
            .filter(|row| row.experiment == self.experiment)
            .filter(|row| !self.first_only || row.instance == 0)
            .collect();
        if rows.is_empty() {
            return None;
        }
        let (xs, policies) = axes(&rows);
        let panels = vec![
            self.panel(&rows, &xs, &policies, "thesis' metric", |row| row.thesis_metric, figures),
            self.panel(
                &rows,
                &xs,
                &policies,
                "distance to the true goal",
                |row| row.goal_error_m,
                &[],
            ),
        ];
        let mut legend: Vec<(String, Sign)> = policies
            .iter()
            .map(|policy| (policy.replace('_', " "), Sign::Line(line(colour(policy), 3.0, ""))))
            .collect();
        if figures.iter().any(|figure| figure.experiment == self.experiment) {
            legend.push(("published median".into(), Sign::Dot(INK_DOT)));
        }
        let figure = Figure { title: self.title.into(), legend, rows: vec![panels], bar: None };
        Some(Picture {
            name: self.title.into(),
            svg: figure.svg(),
            caption: self.caption(&rows, &xs, &policies, figures),
        })
    }

    fn panel(
        &self,
        rows: &[&Row],
        xs: &[f64],
        policies: &[String],
        title: &str,
        of: impl Fn(&Row) -> Option<f64> + Copy,
        figures: &[Published],
    ) -> Panel {
        // Policies to which the varied number means nothing stand to the left.
        let step = step(xs);
        let place = |x: f64| if x == 0.0 { left(xs, step) } else { x };
        let (first, last) = (place(xs[0]), xs[xs.len() - 1]);
        let low = DVec2::new(first - 0.6 * step, DECADES[0] - 0.3);
        let high = DVec2::new(last + 0.6 * step, DECADES[1] + 0.3);
        let mut panel = Panel::graph(title, [self.label, "log10 of metres"], [low, high], SIZE);
        let width = 0.8 * step / policies.len() as f64;
        for x in xs {
            for (p, policy) in policies.iter().enumerate() {
                let values = values(rows, policy, *x, of);
                if values.is_empty() {
                    continue;
                }
                let center = place(*x) - 0.4 * step + width * (p as f64 + 0.5);
                draw_box(&mut panel, center, 0.36 * width, &values, colour(policy));
            }
            if let Some(median) = at(figures, self.experiment, *x) {
                panel.dot(DVec2::new(*x, decade(median)), 4.0, INK_DOT);
            }
            if *x == 0.0 {
                let at = DVec2::new(place(*x), DECADES[1]);
                panel.words(at, DVec2::new(0.0, 4.0), Anchor::Middle, "no K");
            }
        }
        panel
    }

    /// What is seen, by the numbers.
    fn caption(
        &self,
        rows: &[&Row],
        xs: &[f64],
        policies: &[String],
        figures: &[Published],
    ) -> String {
        let mut words =
            String::from("Boxes from the first to the third quartile, whiskers to the extremes. ");
        for policy in policies {
            let own: Vec<&&Row> = rows.iter().filter(|row| row.policy == *policy).collect();
            let reached = own.iter().filter(|row| row.reached).count();
            let errors: Vec<f64> =
                own.iter().map(|row| row.goal_error_m.unwrap_or(f64::INFINITY)).collect();
            let median = quantile(&errors, 0.5).unwrap_or(f64::NAN);
            let diverged = errors.iter().filter(|error| error.is_infinite()).count();
            let diverged =
                if diverged > 0 { format!(", {diverged} diverged") } else { String::new() };
            words += &format!(
                "{}: {reached} of n = {} reach the true goal (median {}{diverged}). ",
                policy.replace('_', " "),
                own.len(),
                length(median)
            );
        }
        let compare = xs.iter().filter_map(|x| Some((*x, at(figures, self.experiment, *x)?)));
        for policy in ["canonical", "thesis"] {
            let pairs: Vec<String> = compare
                .clone()
                .filter_map(|(x, median)| {
                    let own = values(rows, policy, x, |row| row.thesis_metric);
                    let here = quantile(&own, 0.5)?;
                    Some(format!(
                        "{here:.3} ({median:.3}) at {}{}",
                        tprmp_drawing::number(x),
                        self.unit
                    ))
                })
                .collect();
            if !pairs.is_empty() {
                words += &format!(
                    "Medians of the thesis' metric, {policy} (published): {}. ",
                    pairs.join(", ")
                );
            }
        }
        words
    }
}

const INK_DOT: &str = "#1a1a1a";

fn length(metres: f64) -> String {
    if metres.is_infinite() {
        "diverged".into()
    } else if metres < 0.01 {
        format!("{:.3} mm", metres * 1e3)
    } else {
        format!("{metres:.3} m")
    }
}

fn draw_box(panel: &mut Panel, x: f64, half: f64, values: &[f64], colour: &'static str) {
    let at = |fraction| decade(quantile(values, fraction).unwrap_or(f64::INFINITY));
    let [least, low, middle, high, most] = [0.0, 0.25, 0.5, 0.75, 1.0].map(at);
    let p = DVec2::new;
    let thin = line(colour, 1.2, "");
    panel.line([p(x, least), p(x, low)], &thin);
    panel.line([p(x, high), p(x, most)], &thin);
    let corners = [p(x - half, low), p(x + half, low), p(x + half, high), p(x - half, high)];
    panel.band(corners, colour);
    panel.line(corners.into_iter().chain([corners[0]]), &thin);
    panel.line([p(x - half, middle), p(x + half, middle)], &line(colour, 2.6, ""));
}

/// Range of the clearances of figure 5.14 [m].
const CLEARANCE_M: [f64; 2] = [-0.1, 0.4];

/// Figure 5.14: how many of the skills pass an obstacle.
fn successes(run: &Run, figures: &[Published]) -> Vec<Picture> {
    let rows: Vec<&Row> = run.rows.iter().filter(|row| row.experiment == "obstacle").collect();
    if rows.is_empty() {
        return Vec::new();
    }
    let (xs, policies) = axes(&rows);
    let skills = rows.iter().map(|row| &row.skill).collect::<std::collections::BTreeSet<_>>().len();
    let step = step(&xs);
    let (first, last) = (xs[0] - 0.6 * step, xs[xs.len() - 1] + 0.6 * step);
    let mut panel = Panel::graph(
        "no contact, and within 1 cm of the true goal",
        ["obstacle radius [m]", "fraction of the feasible cases [%]"],
        [DVec2::new(first, -4.0), DVec2::new(last, 105.0)],
        SIZE,
    );
    let mut clear = Panel::graph(
        "least clearance and largest acceleration",
        ["log10 of the largest acceleration [m/s²]", "least clearance [m]"],
        [DVec2::new(0.0, CLEARANCE_M[0]), DVec2::new(4.0, CLEARANCE_M[1])],
        SIZE,
    );
    let mut words = String::new();
    // The default policy last: on top of the others.
    for policy in policies.iter().rev() {
        let (mut points, mut told, mut feasible_all, mut passed_all) =
            (Vec::new(), Vec::new(), 0, 0);
        for x in &xs {
            let own: Vec<&&Row> = rows
                .iter()
                .filter(|row| row.policy == *policy && row.x == *x && row.feasible)
                .collect();
            let passed = own.iter().filter(|row| row.reached && !row.collided).count();
            told.push(format!("{passed}/{}", own.len()));
            feasible_all += own.len();
            passed_all += passed;
            if !own.is_empty() {
                points.push(DVec2::new(*x, 100.0 * passed as f64 / own.len() as f64));
            }
            for row in own {
                if let (Some(a), Some(c)) = (row.acceleration_max_m_s2, row.clearance_min_m) {
                    let shown = c.clamp(CLEARANCE_M[0], CLEARANCE_M[1]);
                    let p = DVec2::new(a.max(1.0).log10().min(4.0), shown);
                    clear.dot(p, 2.6, colour(policy));
                }
            }
        }
        panel.line(points.iter().copied(), &line(colour(policy), 2.4, ""));
        points.iter().for_each(|p| panel.dot(*p, 3.4, colour(policy)));
        let told = format!(
            "{policy}: {passed_all} of {feasible_all} feasible cases (by radius {}); by the thesis' \
             criterion, of all {}: {}. ",
            told.join(", "),
            skills,
            xs.iter()
                .map(|x| values(&rows, policy, *x, |row| row.thesis_metric))
                .map(|passed| format!("{:.0}", passed.iter().sum::<f64>()))
                .collect::<Vec<_>>()
                .join(", ")
        );
        words.insert_str(0, &told);
    }
    let mut theirs = Vec::new();
    for x in &xs {
        if let Some(count) = at(figures, "obstacle", *x) {
            panel.dot(DVec2::new(*x, 100.0 * count / 15.0), 4.0, INK_DOT);
            theirs.push(format!("{count:.0}"));
        }
    }
    clear.line([DVec2::new(0.0, 0.0), DVec2::new(4.0, 0.0)], &line(GREY, 1.2, "4 3"));
    clear.line(
        [40.0_f64.log10(); 2].into_iter().zip(CLEARANCE_M).map(|(x, y)| DVec2::new(x, y)),
        &line(GREY, 1.2, "4 3"),
    );
    words += &format!(
        "Published, of 15, where a touch within 0.2 m of the last Gaussian counted and collisions \
         did not: {}. {skills} skills; a case is feasible when neither goal nor start is ever within 5 cm \
         of the obstacle.",
        theirs.join(", ")
    );
    let mut legend: Vec<(String, Sign)> = policies
        .iter()
        .map(|policy| (policy.clone(), Sign::Line(line(colour(policy), 3.0, ""))))
        .collect();
    legend.push(("published".into(), Sign::Dot(INK_DOT)));
    let title = "Figure 5.14: obstacle that moves with the goal";
    let figure = Figure { title: title.into(), legend, rows: vec![vec![panel, clear]], bar: None };
    vec![Picture { name: title.into(), svg: figure.svg(), caption: words }]
}

/// Figure 5.12: time of a control iteration.
fn times(run: &Run, figures: &[Published]) -> Vec<Picture> {
    if run.timed.is_empty() {
        return Vec::new();
    }
    let (low, high) = (DVec2::new(-1.0, -0.02), DVec2::new(5.5, 1.02));
    let mut rows = Vec::new();
    let mut words = String::from("Medians here: ");
    for (experiment, name) in [("iteration_time", "planar"), ("pick_iteration_time", "pick")] {
        let mut panel = Panel::graph(
            &format!("{name}: fraction of iterations below a time"),
            ["log10 of the time [µs]", "fraction"],
            [low, high],
            SIZE,
        );
        let mut any = false;
        for (row, times) in run.timed.iter().filter(|(row, _)| row.experiment == experiment) {
            any = true;
            let points = (0..=100).map(|i| {
                let fraction = f64::from(i) / 100.0;
                let time = quantile(times, fraction).unwrap_or(f64::NAN);
                DVec2::new(time.max(0.1).log10(), fraction)
            });
            panel.line(points, &line(colour(&row.policy), 1.6, ""));
            if let Some([median, ..]) = row.iteration_us {
                let theirs = at(figures, experiment, row.x).filter(|_| row.policy == "thesis");
                let theirs = theirs.map_or(String::new(), |ms| format!(" (published {ms:.0} ms)"));
                words += &format!("{} {} {name} {median:.1} µs{theirs}; ", row.policy, row.setting);
            }
        }
        for figure in figures.iter().filter(|figure| figure.experiment == experiment) {
            for median in &figure.median {
                panel.dot(DVec2::new((median * 1e3).log10(), 0.5), 4.0, INK_DOT);
            }
        }
        if any {
            rows.push(panel);
        }
    }
    words += "one core of this machine, goal moving in every iteration.";
    let legend = ["canonical", "thesis", "dmp", "tpgmm_lqr"]
        .map(|p| (p.replace('_', " "), Sign::Line(line(colour(p), 3.0, ""))))
        .into_iter()
        .chain([("published medians, Python".into(), Sign::Dot(INK_DOT))])
        .collect();
    let title = "Figure 5.12: time of a control iteration, K = 5 … 15";
    let figure = Figure { title: title.into(), legend, rows: vec![rows], bar: None };
    vec![Picture { name: title.into(), svg: figure.svg(), caption: words }]
}

/// Energy and random starts.
fn stability(run: &Run) -> Vec<Picture> {
    let rows: Vec<&Row> = run
        .rows
        .iter()
        .filter(|row| ["energy", "random_starts"].contains(&row.experiment.as_str()))
        .collect();
    if rows.is_empty() {
        return Vec::new();
    }
    let mut panel = Panel::graph(
        "largest rise of V in a step, against the largest acceleration",
        [
            "log10 of acceleration over the demonstrations' largest",
            "log10 of rise over the fall of V",
        ],
        [DVec2::new(-1.5, -18.0), DVec2::new(3.5, 3.0)],
        SIZE,
    );
    let mut words = String::new();
    for policy in ["canonical", "thesis"] {
        let own: Vec<&&Row> = rows.iter().filter(|row| row.policy == policy).collect();
        let (mut reached, mut of, mut rise, mut ratio) = (0, 0, 0.0_f64, 0.0_f64);
        for row in own {
            if let Some([a, b]) = row.starts_reached {
                reached += a;
                of += b;
            }
            let own_rise = row.energy_rise_max.unwrap_or(f64::INFINITY);
            rise = rise.max(own_rise);
            if let (Some(a), Some(b)) =
                (row.acceleration_max_m_s2, row.demonstrated_acceleration_max_m_s2)
            {
                if row.experiment == "energy" {
                    ratio = ratio.max(a / b);
                }
                let y = own_rise.max(1e-18).log10().clamp(-18.0, 3.0);
                panel.dot(DVec2::new((a / b).log10().clamp(-1.5, 3.5), y), 3.0, colour(policy));
            }
        }
        words += &format!(
            "{policy}: {reached} of {of} random starts reach the goal; V rises by at most {rise:.1e} of \
             its fall in a step; from the demonstrated starts the acceleration is at most \
             {ratio:.1} times the demonstrations' largest. "
        );
    }
    panel.line([DVec2::new(-1.5, -9.0), DVec2::new(3.5, -9.0)], &line(GREY, 1.2, "4 3"));
    let legend = ["canonical", "thesis"].map(|p| (p.into(), Sign::Dot(colour(p)))).to_vec();
    let title = "Stability: energy at 100 Hz and 1 kHz, random starts, accelerations";
    let figure = Figure { title: title.into(), legend, rows: vec![vec![panel]], bar: None };
    vec![Picture { name: title.into(), svg: figure.svg(), caption: words }]
}
