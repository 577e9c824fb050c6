//! A configuration as text, with a reason beside every number.

use core::fmt::Write;

/// What arms have in common: its sections stand in what is written, but for those that an arm decides about.
const COMMON: &str = include_str!("../../../config/controllers/base/arm_pick.ron");

/// To two digits.
#[must_use]
pub(super) fn rounded(number: f64) -> f64 {
    format!("{number:.1e}").parse().unwrap_or(number)
}

/// Numbers of a list, in RON.
#[must_use]
pub(super) fn numbers(list: &[f64]) -> String {
    let numbers: Vec<String> = list.iter().map(|number| format!("{number:?}")).collect();
    format!("[{}]", numbers.join(", "))
}

/// Three or four numbers, in RON.
#[must_use]
pub(super) fn tuple(list: &[f64]) -> String {
    let numbers = list.iter().map(|number| format!("{:?}", (number * 1e6).round() / 1e6 + 0.0));
    format!("({})", numbers.collect::<Vec<_>>().join(", "))
}

/// A text that grows by keys, with comments before them.
#[derive(Debug, Default)]
pub(super) struct Text {
    text: String,
    indent: usize,
}

impl Text {
    /// Empty, its lines indented by so many steps.
    #[must_use]
    pub(super) fn new(indent: usize) -> Self {
        Self { text: String::new(), indent }
    }

    /// Adds a comment, wrapped.
    pub(super) fn comment(&mut self, comment: &str) -> &mut Self {
        let width = 110 - 4 * self.indent;
        let mut line = String::new();
        for word in comment.split_whitespace() {
            if !line.is_empty() && line.len() + 1 + word.len() > width {
                self.line(&format!("// {line}"));
                line.clear();
            }
            line += if line.is_empty() { "" } else { " " };
            line += word;
        }
        self.line(&format!("// {line}"));
        self
    }

    /// Adds a key with its value.
    pub(super) fn key(&mut self, key: &str, value: &str) -> &mut Self {
        self.line(&format!("{key}: {value},"));
        self
    }

    /// Adds a key whose value has lines of its own, between `open` and `close`.
    pub(super) fn list(
        &mut self,
        key: &str,
        [open, close]: [&str; 2],
        lines: &[String],
    ) -> &mut Self {
        if lines.is_empty() {
            return self.key(key, &format!("{open}{close}"));
        }
        self.line(&format!("{key}: {open}"));
        self.indent += 1;
        lines.iter().for_each(|line| self.line(&format!("{line},")));
        self.indent -= 1;
        self.line(&format!("{close},"));
        self
    }

    fn line(&mut self, line: &str) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "{}{line}", "    ".repeat(self.indent));
    }

    /// The text.
    #[must_use]
    pub(super) fn finish(self) -> String {
        self.text
    }
}

/// A key in a section of the base, on a line of its own.
#[derive(Debug, Clone, Copy)]
pub(super) struct BaseKey {
    section: &'static str,
    line: &'static str,
}

/// From where spheres of the arm act on each other.
pub(super) const SELF_ACTIVATION: BaseKey =
    BaseKey { section: "self_collision", line: "activation_distance_m: 0.05," };
/// From where a joint's limits act.
pub(super) const LIMIT_ACTIVATION: BaseKey =
    BaseKey { section: "joint_limits", line: "activation_distance: 0.2," };

/// What keeps the tool upright.
pub(super) const KEEP_UPRIGHT: BaseKey =
    BaseKey { section: "keep_upright", line: "keep_upright: None," };

/// What an arm decides about in a whole configuration.
#[derive(Debug, Clone, Default)]
pub(super) struct Sections {
    /// Comment at the top, without slashes.
    pub heading: Vec<String>,
    /// Keys of `robot`.
    pub robot: String,
    /// `posture`, whole.
    pub posture: String,
    /// Further keys of `collision`.
    pub collision: String,
    /// Further keys of `self_collision`.
    pub self_collision: String,
    /// Keys of the base that an arm decides about, with what stands in their place.
    pub replaced: Vec<(BaseKey, String)>,
    /// `approach` and `lift`, whole; those of the base where they are kept.
    pub task: Option<String>,
}

impl Sections {
    /// The whole configuration.
    #[must_use]
    pub(super) fn configuration(&self) -> String {
        let mut text = String::new();
        for line in &self.heading {
            let _ = writeln!(text, "// {line}");
        }
        text += "(\n    robot: (\n";
        text += &self.robot;
        text += "    ),\n";
        text += &self.posture;
        for (key, section) in common() {
            match key {
                "robot" => {}
                "approach" | "lift" | "done" if self.task.is_some() => {
                    text +=
                        if key == "lift" { self.task.as_deref().unwrap_or_default() } else { "" };
                }
                "collision" => text += &with_keys(section, &self.collision),
                "self_collision" => {
                    text += &self.replaced(key, &with_keys(section, &self.self_collision));
                }
                "start_frame" => {
                    text += "    // Where the tool is when the skill starts: no publisher has to know. Or Published.\n";
                    text += "    start_frame: Tool,\n";
                }
                _ => text += &self.replaced(key, section),
            }
        }
        text + ")\n"
    }

    fn replaced(&self, key: &str, section: &str) -> String {
        let of_section = self.replaced.iter().filter(|(base, _)| base.section == key);
        of_section.fold(section.to_owned(), |text, (base, to)| text.replacen(base.line, to, 1))
    }
}

/// A section with further keys at its end.
fn with_keys(section: &str, keys: &str) -> String {
    let end = section.rfind("    )").unwrap_or(section.len());
    format!("{}{keys}{}", &section[..end], &section[end..])
}

/// The sections of the common part: their keys, and their text with the comments before it.
fn common() -> Vec<(&'static str, &'static str)> {
    let begin = COMMON.find("(\n").map_or(0, |at| at + 2);
    let end = COMMON.rfind("\n)").map_or(COMMON.len(), |at| at + 1);
    let mut sections = Vec::new();
    let (mut from, mut at, mut key) = (begin, begin, None);
    for line in COMMON[begin..end].split_inclusive('\n') {
        let inner = line.strip_prefix("    ").unwrap_or_default();
        let is_key = inner.starts_with(|letter: char| letter.is_ascii_lowercase());
        if is_key && key.is_none() {
            key = inner.split_once(':').map(|(key, _)| key);
        }
        at += line.len();
        let ends = inner.starts_with(')') || (is_key && line.trim_end().ends_with(','));
        if let (Some(name), true) = (key, ends) {
            sections.push((name, &COMMON[from..at]));
            (from, key) = (at, None);
        }
    }
    sections
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_section_of_the_common_part_is_found_whole() {
        let sections = common();
        let keys: Vec<_> = sections.iter().map(|(key, _)| *key).collect();
        for key in ["robot", "loop", "collision", "self_collision", "approach", "lift", "real_time"]
        {
            assert_eq!(keys.iter().filter(|found| **found == key).count(), 1, "{key} of {keys:?}");
        }
        let whole: String = sections.iter().map(|(_, text)| *text).collect();
        assert!(COMMON.contains(&whole));
        for (key, text) in sections {
            let count = |mark| text.matches(mark).count();
            let code: String =
                text.lines().map(|line| line.split("//").next().unwrap_or("")).collect();
            assert_eq!(code.matches('(').count(), code.matches(')').count(), "{key}");
            assert!(count("\n    },") == 0, "{key}");
        }
    }

    #[test]
    fn what_an_arm_decides_about_stands_in_the_common_part_once() {
        for base in [SELF_ACTIVATION, LIMIT_ACTIVATION, KEEP_UPRIGHT] {
            let sections = common();
            let (_, text) = sections.iter().find(|(key, _)| *key == base.section).unwrap();
            assert_eq!(text.matches(base.line).count(), 1, "{base:?}");
        }
    }

    #[test]
    fn numbers_are_read_back_as_they_were() {
        assert_eq!(numbers(&[1.0, 0.25]), "[1.0, 0.25]");
        assert_eq!(tuple(&[1.0, -1e-9, 0.1234567]), "(1.0, 0.0, 0.123457)");
        assert_eq!([rounded(12.34), rounded(0.0567)], [12.0, 0.057]);
    }
}
