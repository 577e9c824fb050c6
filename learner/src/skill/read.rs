//! Reads skill files.

use std::path::Path;

use ron::extensions::Extensions;
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer};
use tprmp_model::{RenamedKey, renamed_keys, ron_value};
use tprmp_spatial::Pose;

use crate::demonstration::Demonstration;
use crate::file_error::{FileError, read_text};
use crate::skill::settings::{AlignmentSettings, Skill};
use crate::skill::validate::{validate, validate_counts};

/// Schema version this module reads.
pub const SCHEMA: &str = "tprmp-skill/5";
/// The one before it, which is read too: what it lacks is as in the shipped skill files.
pub const SCHEMA_BEFORE: &str = "tprmp-skill/4";
/// What stands in place of further frames that are to be proposed.
const AUTO: &str = "Auto";
/// Largest skill file [bytes]; those of the repository have some thousand.
const BYTES_MAX: u64 = 256 << 10;

#[derive(Deserialize)]
struct Header {
    schema: String,
    /// Whether there is such a group.
    #[serde(default, deserialize_with = "is_there")]
    alignment: bool,
}

fn is_there<'de, D: Deserializer<'de>>(deserializer: D) -> Result<bool, D::Error> {
    IgnoredAny::deserialize(deserializer).map(|_| true)
}

impl Skill {
    /// Reads and validates a skill file.
    ///
    /// # Errors
    /// [`FileError`], naming the file and the key or line: missing, not RON, of another version, an
    /// unknown or missing key, or a value outside its range.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let text = read_text(path, BYTES_MAX)?;
        // `fit: Canonical(damping_1_s: …)` instead of two pairs of parentheses.
        let options =
            ron::Options::default().with_default_extension(Extensions::UNWRAP_VARIANT_NEWTYPES);
        let renamed = renamed_keys(&text);
        if let Some(first) = renamed.first() {
            let names: Vec<String> = renamed.iter().map(RenamedKey::to_string).collect();
            return Err(FileError::syntax(path, first.line, first.column, names.join("; ")));
        }
        let header = options.from_str::<Header>(&text).ok();
        let is = |schema| header.as_ref().is_some_and(|header| header.schema == schema);
        if let Some(Header { schema: found, .. }) = &header
            && !(is(SCHEMA) || is(SCHEMA_BEFORE))
        {
            let problem = format!(
                "expected `{SCHEMA}`, found `{found}`; new since then are the groups `frame_map` and \
                 `alignment`, and numbers in `fit` and `certification`: take them from the skill files in \
                 config/skills"
            );
            return Err(FileError::key(path, "schema", problem));
        }
        let auto =
            ron_value(&text, "other_frames").filter(|value| text[value.clone()].trim() == AUTO);
        let mut listed = text.clone();
        if let Some(value) = &auto {
            // Of the same length, so that places in messages stay.
            let none = text[value.clone()].replace(AUTO, "[]  ");
            listed.replace_range(value.clone(), &none);
        }
        let mut skill: Self = options.from_str(&listed).map_err(|e| {
            FileError::syntax(path, e.span.start.line, e.span.start.col, e.code.to_string())
        })?;
        skill.proposes_frames = auto.is_some();
        let has_alignment = header.is_some_and(|header| header.alignment);
        match (skill.schema == SCHEMA, has_alignment) {
            (true, false) => {
                let problem = "expected how demonstrations are brought to a common time, found none; \
                               take this group from the skill files in config/skills";
                return Err(FileError::key(path, "alignment", problem));
            }
            (false, false) => skill.alignment = AlignmentSettings::shipped(&skill.fit),
            _ => {}
        }
        validate(&skill).map_err(|(key, problem)| FileError::key(path, key, problem))?;
        Ok(skill)
    }

    /// The same skill with another number of Gaussians.
    ///
    /// # Errors
    /// What was expected, when the number is outside the range of `mixture.components`.
    pub fn with_components(mut self, components: usize) -> Result<Self, String> {
        self.mixture.components = components;
        validate_counts(&self).map_err(|(_, problem)| problem).map(|()| self)
    }

    /// Whether it starts at another frame than that to which its goal is fixed.
    #[must_use]
    pub fn has_start_frame(&self) -> bool {
        self.start_frame != self.goal_frame
    }

    /// Index of the goal frame among the skill's.
    #[must_use]
    pub fn goal_index(&self) -> usize {
        usize::from(self.has_start_frame())
    }

    /// The frames of a demonstration by name, in the skill's order: start, goal unless it is the same,
    /// then the others.
    ///
    /// # Panics
    /// When the demonstration lacks one of them; [`read_folder`](crate::demonstration::read_folder)
    /// refuses such.
    pub fn named_frames<'a>(
        &'a self,
        demonstration: &'a Demonstration,
    ) -> impl Iterator<Item = (&'a str, Pose)> {
        let start =
            self.has_start_frame().then_some((self.start_frame.as_str(), demonstration.start));
        let goal = (self.goal_frame.as_str(), demonstration.goal_frame);
        let others = self.other_frames.iter();
        let others = others.map(|name| (name.as_str(), demonstration.other_frames[name]));
        start.into_iter().chain([goal]).chain(others)
    }

    /// The poses of [`Skill::named_frames`].
    #[must_use]
    pub fn frames(&self, demonstration: &Demonstration) -> Vec<Pose> {
        self.named_frames(demonstration).map(|(_, pose)| pose).collect()
    }

    /// Every value as `section.key` and text, in order of the keys.
    #[must_use]
    pub fn values(&self) -> Vec<(String, String)> {
        let value = serde_json::to_value(self).expect("plain numbers and strings serialise");
        let mut values = Vec::new();
        flatten("", &value, &mut values);
        values
    }
}

fn flatten(prefix: &str, value: &serde_json::Value, values: &mut Vec<(String, String)>) {
    match value {
        serde_json::Value::Object(map) => {
            for (key, value) in map {
                let dot = if prefix.is_empty() { "" } else { "." };
                flatten(&format!("{prefix}{dot}{key}"), value, values);
            }
        }
        serde_json::Value::String(text) => values.push((prefix.into(), text.clone())),
        other => values.push((prefix.into(), other.to_string())),
    }
}
