//! `controller layout`: what is in shared memory, for publishers in other languages.

mod c;
mod json;
mod python;
mod text;

use clap::{Args, ValueEnum};
use tprmp_files::outln;

/// In which language.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// For people.
    Text,
    /// For programs.
    Json,
    /// A header of C11, which is one of C++11 too.
    C,
    /// A module of ctypes.
    Python,
}

/// What to print.
#[derive(Debug, Args)]
pub struct Layout {
    /// In which language.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
}

impl Layout {
    /// Prints it.
    pub fn run(&self) {
        let text = match self.format {
            Format::Text => text::layout(),
            Format::Json => json::layout(),
            Format::C => c::layout(),
            Format::Python => python::layout(),
        };
        outln!("{}", text.trim_end());
    }
}

/// Documentation without its marks: `\[m\]` becomes \[m\], a link its text.
fn plain(doc: &[&str]) -> String {
    let text = doc.iter().map(|line| line.trim()).collect::<Vec<_>>().join(" ");
    let mut plain = String::new();
    let mut rest = text.as_str();
    while let Some(at) = rest.find(['\\', '[', ']']) {
        plain += &rest[..at];
        let mark = &rest[at..];
        rest = if let Some(escaped) = mark.strip_prefix('\\') {
            plain += &escaped[..1];
            &escaped[1..]
        } else if let Some(target) = mark.strip_prefix("](") {
            target.split_once(')').map_or("", |(_, after)| after)
        } else {
            // Of a link to code, or of an index in code.
            let of_code = mark.starts_with("[`") || mark.starts_with(']') && plain.ends_with('`');
            plain += if of_code { "" } else { &mark[..1] };
            &mark[1..]
        };
    }
    (plain + rest).replace("crate::", "")
}

/// Lines of at most `width` characters, each behind `prefix`.
fn wrapped(text: &str, prefix: &str, width: usize) -> Vec<String> {
    let mut lines = vec![prefix.trim_end().to_owned()];
    for word in text.split_whitespace() {
        let last = lines.last_mut().expect("there is one");
        if last.chars().count() + 1 + word.chars().count() > width {
            lines.push(format!("{prefix}{word}"));
        } else {
            let space =
                if last.len() <= prefix.trim_end().len() { &prefix[last.len()..] } else { " " };
            last.push_str(space);
            last.push_str(word);
        }
    }
    lines
}

/// `RobotState` as `robot_state`.
fn snake(name: &str) -> String {
    let mut snake = String::new();
    for c in name.chars() {
        if c.is_uppercase() && !snake.is_empty() {
            snake.push('_');
        }
        snake.extend(c.to_lowercase());
    }
    snake
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documentation_loses_its_marks() {
        let doc =
            [" On the clock of [`RobotState::time_ns`]", r" \[ns\]: see [`hash`](crate::hash)."];
        assert_eq!(plain(&doc), "On the clock of `RobotState::time_ns` [ns]: see `hash`.");
        assert_eq!(plain(&["`size[0]` of [`Kind`]"]), "`size[0]` of `Kind`");
        assert_eq!(snake("ControllerStatus"), "controller_status");
    }

    #[test]
    fn long_texts_become_lines() {
        assert_eq!(wrapped("one two three", "# ", 9), ["# one two", "# three"]);
        assert_eq!(wrapped("one", "    # ", 9), ["    # one"]);
    }

    #[test]
    fn every_format_has_every_message_service_and_value() {
        for text in [text::layout(), json::layout(), c::layout(), python::layout()] {
            for message in tprmp_messages::MESSAGES {
                assert!(text.contains(message.type_name), "{}", message.name);
            }
            for service in tprmp_messages::SERVICES {
                assert!(text.contains(&format!("/{}/v1", service.topic)), "{}", service.topic);
            }
            assert!(text.contains("0.9.3") && text.contains("/tmp/tprmp-"));
            let squeezed = text.to_lowercase().replace('_', "");
            for value in tprmp_messages::ENUMS.iter().flat_map(|listed| listed.values) {
                assert!(squeezed.contains(&value.name.to_lowercase()), "{}", value.name);
            }
        }
    }
}
