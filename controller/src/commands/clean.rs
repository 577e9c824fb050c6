//! `controller clean`: removes what killed processes left behind, and says what it was.

use std::io::Write;

use tprmp_messages::{Cleaned, Instance, ServiceError};

/// Cleans one instance, or all of this user's. Nothing of the living is removed; that there is nothing to
/// remove is no error.
///
/// # Errors
/// The first instance whose files are not this user's, or cannot be removed.
pub fn clean(instance: Option<&str>) -> Result<(), ServiceError> {
    let instances = match instance {
        Some(name) => vec![Instance::new(name)?],
        None => Instance::all(),
    };
    let (mut nothing, mut first_error) = (true, None);
    for instance in &instances {
        match instance.clean() {
            Ok(cleaned) => {
                nothing &= cleaned.shared_files + cleaned.paths == 0;
                if let Some(text) = describe(instance.name(), cleaned) {
                    say(&text);
                }
            }
            // The others are cleaned all the same.
            Err(error) => first_error = first_error.or(Some(error)),
        }
    }
    if nothing && first_error.is_none() {
        say("nothing to remove");
    }
    first_error.map_or(Ok(()), Err)
}

/// What was removed of an instance, and who lives; `None` when neither is anything.
fn describe(name: &str, cleaned: Cleaned) -> Option<String> {
    let Cleaned { shared_files, shared_bytes, paths, living } = cleaned;
    let removed = shared_files + paths > 0;
    let what = format!(
        "{shared_files} files in shared memory ({} KiB) and {paths} files and folders removed",
        shared_bytes.div_ceil(1024)
    );
    match (removed, living) {
        (false, 0) => None,
        (false, _) => Some(format!("instance `{name}`: {living} in use, left alone")),
        (true, 0) => Some(format!("instance `{name}`: {what}")),
        (true, _) => Some(format!("instance `{name}`: {what}; {living} in use, left alone")),
    }
}

fn say(text: &str) {
    // A reader that has gone away is no reason to fail.
    let _ = writeln!(std::io::stdout(), "{text}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_removed_is_told_and_what_lives() {
        let some = Cleaned { shared_files: 2, shared_bytes: 1025, paths: 3, living: 0 };
        let removed = "2 files in shared memory (2 KiB) and 3 files and folders removed";
        assert_eq!(describe("a", some), Some(format!("instance `a`: {removed}")));
        let beside = describe("a", Cleaned { living: 1, ..some });
        assert_eq!(beside, Some(format!("instance `a`: {removed}; 1 in use, left alone")));
        let living = describe("a", Cleaned { living: 2, ..Cleaned::default() });
        assert_eq!(living, Some("instance `a`: 2 in use, left alone".into()));
        assert_eq!(describe("a", Cleaned::default()), None);
    }
}
