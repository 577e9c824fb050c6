//! Stability: energy, random starts, accelerations.

use glam::DVec2;
use tprmp_drawing::{Figure, Panel, Picture, Sign};

use crate::experiment::{Experiment, PolicyKind};
use crate::report::content::Run;
use crate::report::style::{MARK, SIZE, colour};
use crate::results::Row;

/// Range of the accelerations over the demonstrations' largest, and of the rises over the fall of V,
/// log10.
const ACCELERATION: [f64; 2] = [-1.5, 3.5];
const RISE: [f64; 2] = [-18.0, 3.0];
/// What a rise may be, log10.
const RISE_MAX: f64 = -9.0;

/// Rises of V against accelerations.
pub(crate) fn picture(run: &Run) -> Option<Picture> {
    let own = |row: &&Row| matches!(row.experiment, Experiment::Energy | Experiment::RandomStarts);
    let rows: Vec<&Row> = run.rows.iter().filter(own).collect();
    if rows.is_empty() {
        return None;
    }
    let [low, high] = [0, 1].map(|i| DVec2::new(ACCELERATION[i], RISE[i]));
    let axes = [
        "log10 of acceleration over the demonstrations' largest",
        "log10 of rise over the fall of V",
    ];
    let title = "largest rise of V in a step, against the largest acceleration";
    let mut panel = Panel::graph(title, axes, [low, high], SIZE);
    let mut caption = String::new();
    for policy in PolicyKind::LEARNED {
        let (mut reached, mut starts, mut rise, mut ratio) = (0, 0, 0.0_f64, 0.0_f64);
        for row in rows.iter().filter(|row| row.policy == policy) {
            let [near, all] = row.starts_reached.unwrap_or([0, 0]);
            reached += near;
            starts += all;
            let own_rise = row.energy_rise_max.unwrap_or(f64::INFINITY);
            rise = rise.max(own_rise);
            if let (Some(a), Some(b)) =
                (row.acceleration_max_m_s2, row.demonstrated_acceleration_max_m_s2)
            {
                if row.experiment == Experiment::Energy {
                    ratio = ratio.max(a / b);
                }
                let log = DVec2::new((a / b).log10(), own_rise.max(1e-18).log10());
                panel.dot(log.clamp(low, high), 3.0, colour(policy));
            }
        }
        caption += &format!(
            "{policy}: {reached} of {starts} random starts reach the goal; V rises by at most \
             {rise:.1e} of its fall in a step; from the demonstrated starts the acceleration is at \
             most {ratio:.1} times the demonstrations' largest. "
        );
    }
    panel.line(ACCELERATION.map(|x| DVec2::new(x, RISE_MAX)), &MARK);
    let legend = PolicyKind::LEARNED.map(|p| (p.words(), Sign::Dot(colour(p)))).to_vec();
    let title = "Stability: energy at 100 Hz and 1 kHz, random starts, accelerations";
    let figure = Figure { title: title.into(), legend, rows: vec![vec![panel]], bar: None };
    Some(Picture { name: title.into(), svg: figure.svg(), caption })
}
