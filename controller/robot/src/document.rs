//! Bounds on a document before a tree is made of it: the parser recurses into nested elements, and
//! takes a time quadratic in their number.

use quick_xml::Reader;
use quick_xml::events::Event;

use crate::error::UrdfErrorKind as Kind;

/// Deepest nesting of elements; a URDF needs six.
const DEPTH_MAX: usize = 64;
/// Most elements. The largest humanoids have some thousand.
const ELEMENTS_MAX: usize = 50_000;
/// Most links, and so joints.
const LINKS_MAX: usize = 1000;

/// Refuses what is no XML, or has more of something than a robot has. Takes a time proportional to
/// the text's length, and nothing recurses.
pub(crate) fn check(text: &str) -> Result<(), Kind> {
    let mut reader = Reader::from_str(text);
    let line = |position: u64| {
        let before = usize::try_from(position).unwrap_or(usize::MAX).min(text.len());
        1 + text.as_bytes()[..before].iter().filter(|byte| **byte == b'\n').count()
    };
    let (mut depth, mut elements, mut links) = (0_usize, 0, 0);
    loop {
        let event = reader.read_event();
        let (element, opens) = match &event {
            Ok(Event::Start(element)) => (element, true),
            Ok(Event::Empty(element)) => (element, false),
            Ok(Event::End(_)) => {
                depth = depth.saturating_sub(1);
                continue;
            }
            Ok(Event::Eof) => return Ok(()),
            Ok(_) => continue,
            Err(error) => {
                let line = line(reader.error_position());
                return Err(Kind::NotUrdf(format!("line {line}: {error}")));
            }
        };
        elements += 1;
        links += usize::from(element.name().as_ref() == b"link" && depth == 1);
        depth += usize::from(opens);
        for (what, found, most) in [
            ("nested elements", depth, DEPTH_MAX),
            ("elements", elements, ELEMENTS_MAX),
            ("links", links, LINKS_MAX),
        ] {
            if found > most {
                let line = line(reader.buffer_position());
                return Err(Kind::TooMany { line, what, most });
            }
        }
    }
}
