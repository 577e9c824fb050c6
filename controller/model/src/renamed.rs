//! Keys that are called otherwise than in the last version.

use crate::ron_text::{entries, position};

/// Keys of the last version's files, and what they are called now: of controller configurations, of
/// skill files and of models.
pub const RENAMED_KEYS: [(&str, &str); 15] = [
    ("bends", "coefficients"),
    ("deceleration_share", "deceleration_fraction"),
    ("effort_share", "effort_fraction"),
    ("frame_displacement_share", "frame_translation_fraction"),
    ("frame_turn_rad", "frame_rotation_rad"),
    ("free_share", "free_fraction"),
    ("onset_s", "ramp_time_s"),
    ("positions_turn", "rotate_positions"),
    ("repairs_max", "refinement_rounds_max"),
    ("rest_share", "rest_fraction"),
    ("rest_speed_share", "rest_speed_fraction"),
    ("running_mean", "kaiser_smoothing"),
    ("skills_beside", "additional_skills"),
    ("speed_share", "speed_fraction"),
    ("velocity_share", "velocity_fraction"),
];

/// What a key of the last version is called now.
pub(crate) fn new_name(old: &str) -> Option<&'static str> {
    RENAMED_KEYS.iter().find(|(name, _)| *name == old).map(|(_, new)| *new)
}

/// A key of the last version that stands in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenamedKey {
    /// Line, from 1.
    pub line: usize,
    /// Column, from 1.
    pub column: usize,
    /// The key.
    pub old: &'static str,
    /// What it is called now.
    pub new: &'static str,
}

impl std::fmt::Display for RenamedKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "`{}` is now `{}`", self.old, self.new)
    }
}

/// Most of them that are told at once.
const TOLD_MAX: usize = 20;

/// The keys of the last version in RON text, in its order; the first twenty, where there are more.
#[must_use]
pub fn renamed_keys(text: &str) -> Vec<RenamedKey> {
    let find = |entry: &crate::ron_text::Entry| {
        let key = &text[entry.key.clone()];
        let (old, new) = RENAMED_KEYS.iter().find(|(old, _)| *old == key)?;
        let (line, column) = position(text, entry.key.start);
        Some(RenamedKey { line, column, old, new })
    };
    entries(text).iter().filter_map(find).take(TOLD_MAX).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_found_where_they_are_keys() {
        for (old, new) in RENAMED_KEYS {
            let text = format!("// {old}: 0\n(a: [(\n {old}: \"{old}: 1\")], {new}: 1)");
            let found = renamed_keys(&text);
            assert_eq!(found, [RenamedKey { line: 3, column: 2, old, new }]);
            assert_eq!(found[0].to_string(), format!("`{old}` is now `{new}`"));
            assert_eq!(new_name(old), Some(new));
            assert_eq!(new_name(new), None, "a name is not given to another key");
        }
    }
}
