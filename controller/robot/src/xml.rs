//! A document as a tree of elements that know their line, within bounds: parsers recurse into nested
//! elements, and take a time quadratic in their number.

use quick_xml::Reader;
use quick_xml::escape::escape;
use quick_xml::events::{BytesStart, Event};

use crate::error::{UrdfErrorKind as Kind, UrdfFault};

/// Deepest nesting of elements; a URDF needs six.
const DEPTH_MAX: usize = 64;
/// Most elements. The largest humanoids have some thousand.
const ELEMENTS_MAX: usize = 50_000;
/// Most links, and so joints.
const LINKS_MAX: usize = 1000;

/// An element of a document.
#[derive(Debug, Clone)]
pub(crate) struct Element {
    pub(crate) name: String,
    /// Line on which it begins, from 1.
    pub(crate) line: usize,
    pub(crate) attributes: Vec<(String, String)>,
    pub(crate) children: Vec<Element>,
}

impl Element {
    /// The value of an attribute.
    pub(crate) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }

    /// The first child of this name.
    pub(crate) fn child(&self, name: &str) -> Option<&Self> {
        self.children.iter().find(|child| child.name == name)
    }

    /// `<link name="hand">`, as one finds it in the file.
    fn opening(&self) -> String {
        match self.attribute("name") {
            Some(name) => format!("<{} name=\"{name}\">", self.name),
            None => format!("<{}>", self.name),
        }
    }

    /// Appends the text of the element. Recurses as deep as the element is nested.
    pub(crate) fn write(&self, text: &mut String) {
        *text += "<";
        *text += &self.name;
        for (key, value) in &self.attributes {
            *text += &format!(" {key}=\"{}\"", escape(value.as_str()));
        }
        *text += ">";
        self.children.iter().for_each(|child| child.write(text));
        *text += &format!("</{}>", self.name);
    }
}

/// Counts lines up to positions that only grow.
struct Lines<'a> {
    text: &'a [u8],
    counted: usize,
    line: usize,
}

impl Lines<'_> {
    fn at(&mut self, position: u64) -> usize {
        let position = usize::try_from(position).unwrap_or(usize::MAX).min(self.text.len());
        if position > self.counted {
            let between = &self.text[self.counted..position];
            self.line += between.iter().filter(|byte| **byte == b'\n').count();
            self.counted = position;
        }
        self.line
    }
}

/// The root element of a text. Takes a time proportional to the text's length, and nothing recurses.
///
/// # Errors
/// What is no XML, ends too early, or has more of something than a robot has.
pub(crate) fn parse(text: &str) -> Result<Element, UrdfFault> {
    let mut reader = Reader::from_str(text);
    let mut lines = Lines { text: text.as_bytes(), counted: 0, line: 1 };
    let (mut open, mut root): (Vec<Element>, Option<Element>) = (Vec::new(), None);
    let (mut elements, mut links) = (0, 0);
    loop {
        let line = lines.at(reader.buffer_position());
        let (element, opens) = match reader.read_event() {
            Ok(Event::Start(start)) => (element(&start, line)?, true),
            Ok(Event::Empty(start)) => (element(&start, line)?, false),
            Ok(Event::End(_)) => {
                close(&mut open, &mut root)?;
                continue;
            }
            Ok(Event::Eof) => break,
            Ok(_) => continue,
            Err(error) => {
                let at = reader.error_position();
                // What is never closed is looked for up to the end: on the last line, that is missing.
                let rest = text.get(at as usize..).unwrap_or("").trim_end();
                let is_last = matches!(error, quick_xml::Error::Syntax(_)) && !rest.contains('\n');
                return Err(match is_last && !open.is_empty() {
                    true => cut_off(&open),
                    false => no_xml(lines.at(at), &error),
                });
            }
        };
        elements += 1;
        links += usize::from(element.name == "link" && open.len() == 1);
        open.push(element);
        for (what, found, most) in [
            ("nested elements", open.len(), DEPTH_MAX),
            ("elements", elements, ELEMENTS_MAX),
            ("links", links, LINKS_MAX),
        ] {
            if found > most {
                return Err(UrdfFault::at(line, Kind::TooMany { what, most }));
            }
        }
        if !opens {
            close(&mut open, &mut root)?;
        }
    }
    match root {
        _ if !open.is_empty() => Err(cut_off(&open)),
        Some(root) => Ok(root),
        None => Err(UrdfFault::new(Kind::NotUrdf {
            found: "no element at all".into(),
            remedy: "a URDF has the root element <robot>",
        })),
    }
}

/// Puts the innermost open element where it belongs.
fn close(open: &mut Vec<Element>, root: &mut Option<Element>) -> Result<(), UrdfFault> {
    let Some(element) = open.pop() else { return Ok(()) };
    match open.last_mut() {
        Some(parent) => parent.children.push(element),
        None if root.is_none() => *root = Some(element),
        None => {
            let found = format!("a second root element, {}", element.opening());
            let remedy = "one file is one robot";
            return Err(UrdfFault::at(element.line, Kind::NotUrdf { found, remedy }));
        }
    }
    Ok(())
}

fn element(start: &BytesStart<'_>, line: usize) -> Result<Element, UrdfFault> {
    let name = String::from_utf8_lossy(start.name().as_ref()).into_owned();
    let mut attributes = Vec::new();
    for attribute in start.attributes() {
        let attribute = attribute.map_err(|error| no_xml(line, &error))?;
        let key = String::from_utf8_lossy(attribute.key.as_ref()).into_owned();
        let value = attribute.unescape_value().map_err(|error| no_xml(line, &error))?;
        attributes.push((key, value.into_owned()));
    }
    Ok(Element { name, line, attributes, children: Vec::new() })
}

fn no_xml(line: usize, error: &dyn std::fmt::Display) -> UrdfFault {
    let found = format!("broken XML: {}", tprmp_files::shortened(&error.to_string()));
    UrdfFault::at(
        line,
        Kind::NotUrdf { found, remedy: "mend this place, or export the file again" },
    )
}

/// The fault of a text that ends inside these elements, from the outermost.
fn cut_off(open: &[Element]) -> UrdfFault {
    let named = open.iter().rfind(|element| element.attribute("name").is_some());
    let inside = named.or(open.last()).expect("some element is open");
    let found = format!("half a file: it ends inside {}, which begins here", inside.opening());
    UrdfFault::at(inside.line, Kind::NotUrdf { found, remedy: "copy or export it again, whole" })
}
