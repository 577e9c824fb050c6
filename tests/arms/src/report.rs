//! What came out, as lines and as a page.

use std::path::Path;

use tprmp_controller::init::{Initialised, NoteKind};
use tprmp_drawing::{Cell, Page};
use tprmp_files::{Existing, WriteError, write as write_file};

use crate::episode::Outcome;

/// What came out for an arm.
pub(crate) struct Row {
    name: String,
    joints: usize,
    spheres: usize,
    protrusion_mm: f64,
    init_s: f64,
    to_look_at: Vec<String>,
    picture: Option<String>,
    pub(crate) tick_us: f64,
    /// Of each place; none where no posture reaches it.
    pub(crate) outcomes: Vec<Option<Outcome>>,
    /// What ended it before.
    pub(crate) failure: Option<String>,
}

impl Row {
    pub(crate) fn new(name: &str, made: &Initialised, init_s: f64) -> Self {
        let look = made.notes.iter().filter(|note| note.kind == NoteKind::Lack);
        Self {
            name: name.to_owned(),
            joints: made.joints.len(),
            spheres: made.cover.as_ref().map_or(0, |cover| cover.sphere_count()),
            protrusion_mm: made.cover.as_ref().map_or(0.0, |cover| 1e3 * cover.protrusion_m),
            init_s,
            to_look_at: look.map(|note| note.text.clone()).collect(),
            picture: made.cover.as_ref().map(|cover| cover.page(&format!("Spheres of {name}"))),
            tick_us: f64::NAN,
            outcomes: Vec::new(),
            failure: None,
        }
    }

    pub(crate) fn failed(name: &str, failure: String) -> Self {
        Self {
            name: name.to_owned(),
            joints: 0,
            spheres: 0,
            protrusion_mm: 0.0,
            init_s: f64::NAN,
            to_look_at: Vec::new(),
            picture: None,
            tick_us: f64::NAN,
            outcomes: Vec::new(),
            failure: Some(failure),
        }
    }

    /// Whether all places were reached without a contact.
    pub(crate) fn holds(&self) -> bool {
        let holds = |outcome: &Option<Outcome>| outcome.as_ref().is_some_and(Outcome::holds);
        self.failure.is_none() && self.outcomes.len() == 4 && self.outcomes.iter().all(holds)
    }

    fn reached(&self) -> usize {
        self.outcomes.iter().flatten().filter(|outcome| outcome.holds()).count()
    }

    fn places(&self) -> String {
        let place = |outcome: &Option<Outcome>| match outcome {
            None => "no posture reaches it".to_owned(),
            Some(o) if o.holds() => {
                format!("{:.1} mm {:.1}° {:.1} s", o.distance_mm, o.angle_deg, o.time_s)
            }
            Some(o) => {
                let done = if o.is_done { "done" } else { "not done" };
                let contacts = if o.contacts.is_empty() {
                    String::new()
                } else {
                    format!(", contact: {}", o.contacts.join(", "))
                };
                format!(
                    "{done}, {:.1} mm {:.1}° {:.1} s{contacts} {}, joints {:.2?}",
                    o.distance_mm, o.angle_deg, o.time_s, o.said, o.joints
                )
            }
        };
        self.outcomes.iter().map(place).collect::<Vec<_>>().join(" | ")
    }

    /// The row as a line.
    pub(crate) fn line(&self) -> String {
        match &self.failure {
            Some(failure) => format!("{:<8} failed: {failure}", self.name),
            None => format!(
                "{:<8} {} joints, {} spheres, {:.0} mm, init {:.1} s, tick {:.1} µs, {} of 4: {}",
                self.name,
                self.joints,
                self.spheres,
                self.protrusion_mm,
                self.init_s,
                self.tick_us,
                self.reached(),
                self.places()
            ),
        }
    }
}

/// The median time of an evaluation \[µs\], of a controller's summary.
pub(crate) fn tick_us(summary: &Path) -> Option<f64> {
    let text = tprmp_files::read_text(summary, 1 << 20).ok()?;
    let value: serde_json::Value = serde_json::from_str(&text).ok()?;
    value["evaluation_us"]["p50"].as_f64()
}

/// Writes the page, and a page for each arm.
pub(crate) fn write(rows: &[Row], out: &Path) -> Result<(), WriteError> {
    let mut page = Page::new("Arms configured from their URDF alone");
    let held = rows.iter().filter(|row| row.holds()).count();
    page.verdict(
        Some(held == rows.len()),
        &format!(
            "{held} of {} arms reach all four places without a contact of their meshes",
            rows.len()
        ),
    );
    page.paragraph(
        "Each was configured by `controller init`, with nothing changed by hand, and follows a skill that was demonstrated \
         with a UR5, around a ball and above a table. A place counts where the tool ends within 3 mm and 1° of \
         the goal. The time of a tick is the median of an evaluation, the whole tree included.",
    );
    let head = [
        "arm",
        "joints",
        "spheres",
        "stick out by [mm]",
        "init [s]",
        "tick [µs]",
        "places",
        "of each",
    ];
    page.table(
        &head,
        rows.iter().map(|row| {
            let verdict = Cell::verdict(Some(row.holds()), &format!("{} of 4", row.reached()));
            let details = row.failure.clone().unwrap_or_else(|| row.places());
            vec![
                Cell::from(row.name.clone()),
                Cell::from(row.joints.to_string()),
                Cell::from(row.spheres.to_string()),
                Cell::from(format!("{:.0}", row.protrusion_mm)),
                Cell::from(format!("{:.1}", row.init_s)),
                Cell::from(format!("{:.1}", row.tick_us)),
                verdict,
                Cell::from(details),
            ]
        }),
    );
    page.section("What a person has to look at");
    for row in rows.iter().filter(|row| !row.to_look_at.is_empty()) {
        page.subsection(&row.name);
        page.list(&row.to_look_at);
    }
    for row in rows {
        if let Some(picture) = &row.picture {
            write_file(&out.join(&row.name).join("spheres.html"), picture, Existing::Replace)?;
        }
    }
    write_file(&out.join("arms.html"), page.html(), Existing::Replace)
}
