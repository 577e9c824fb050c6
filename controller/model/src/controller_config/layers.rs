//! A file and its base as one text, in which each place knows the file that it comes from.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::de::IgnoredAny;
use tprmp_files::shortened;

use crate::controller_config::error::{ConfigError, Fault, Problem};
use crate::renamed::renamed_keys;
use crate::ron_text::{Entry, byte, entries, position};

/// Largest file [bytes]: those of the repository have some ten thousand.
const BYTES_MAX: u64 = 256 << 10;
/// Most keys of a file; there are about two hundred.
const KEYS_MAX: usize = 2000;
/// Most faults that are told at once: to find one takes another look at the whole text.
pub(super) const FAULTS_MAX: usize = 20;

/// A file that is read.
#[derive(Debug)]
pub(super) struct Source {
    pub(super) path: PathBuf,
    pub(super) text: String,
}

impl Source {
    fn fault(&self, at: usize, key: Option<&str>, problem: Problem) -> Fault {
        let position = Some(position(&self.text, at));
        Fault { path: self.path.clone(), position, key: key.map(Into::into), problem }
    }

    /// Keys of the last version, and what is no RON.
    fn faults(&self) -> Vec<Fault> {
        if let Some(beyond) = entries(&self.text).get(KEYS_MAX) {
            let (expected, found) = ("at most 2000 keys", "more".into());
            return vec![self.fault(beyond.value.start, None, Problem::Value { expected, found })];
        }
        let renamed = renamed_keys(&self.text).into_iter().map(|key| Fault {
            path: self.path.clone(),
            position: Some((key.line, key.column)),
            key: None,
            problem: Problem::Renamed { old: key.old, new: key.new },
        });
        let syntax = options().from_str::<IgnoredAny>(&self.text).err().map(|error| {
            let start = error.span.start;
            let at = byte(&self.text, start.line, start.col);
            self.fault(at, None, Problem::Syntax(shortened(&error.code.to_string())))
        });
        syntax.into_iter().chain(renamed).collect()
    }

    /// Keys that are given twice: which of them should count cannot be known.
    fn doubled(&self) -> Vec<Fault> {
        let entries = entries(&self.text);
        let mut before = BTreeSet::new();
        let keys = entries.iter().filter(|entry| !entry.key.is_empty());
        let doubled = keys.filter(|entry| !before.insert(&entry.path));
        let fault = |entry: &Entry| self.fault(entry.key.start, Some(&entry.path), Problem::Twice);
        doubled.map(fault).take(FAULTS_MAX).collect()
    }
}

/// `Some` may be left out.
pub(super) fn options() -> ron::Options {
    ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME)
}

/// Text that was taken from a file.
#[derive(Debug)]
struct Piece {
    /// First byte in the layered text.
    start: usize,
    /// Which source it comes from …
    source: usize,
    /// … and its first byte there.
    from: usize,
}

/// A file on its base.
#[derive(Debug)]
pub(super) struct Layers {
    /// The file, and its base where it has one.
    sources: Vec<Source>,
    /// What both make up together.
    pub(super) text: String,
    pieces: Vec<Piece>,
}

/// Reads a file and its base.
///
/// # Errors
/// One of them cannot be read, is no RON, or has keys of the last version; a base has a base.
pub(super) fn layers(path: &Path) -> Result<Layers, ConfigError> {
    let read = |path: &Path| tprmp_files::read_text(path, BYTES_MAX);
    let text = read(path).map_err(|source| ConfigError::Read { path: path.into(), source })?;
    layers_of(Source { path: path.into(), text }, read)
}

/// The text of a file, and what `read` gives for its base.
pub(super) fn layers_of(
    file: Source,
    read: impl FnOnce(&Path) -> std::io::Result<String>,
) -> Result<Layers, ConfigError> {
    let mut faults = file.faults();
    let Some(base) = key(&entries(&file.text), "base").cloned() else {
        let pieces = vec![Piece { start: 0, source: 0, from: 0 }];
        let text = file.text.clone();
        return refused(faults, || Layers { sources: vec![file], text, pieces });
    };
    let value = &file.text[base.value.clone()];
    let name = ron::from_str::<String>(value);
    let path = name.map(|name| file.path.parent().unwrap_or(Path::new("")).join(name));
    let read = path.map_err(|error| error.code.to_string()).and_then(|path| {
        let text = read(&path).map_err(|error| format!("{} ({error})", path.display()))?;
        Ok(Source { path, text })
    });
    let base_source = match read {
        Ok(source) => source,
        Err(found) => {
            let expected = "the path of a file that can be read, relative to this one";
            faults.push(file.fault(
                base.key.start,
                Some("base"),
                Problem::Value { expected, found },
            ));
            return Err(ConfigError::Faults(faults));
        }
    };
    faults.extend(base_source.faults());
    if let Some(second) = key(&entries(&base_source.text), "base") {
        let found = base_source.text[second.value.clone()].to_owned();
        let problem = Problem::Value { expected: "none in a file that is a base itself", found };
        faults.push(base_source.fault(second.key.start, Some("base"), problem));
    }
    faults.extend([&file, &base_source].into_iter().flat_map(Source::doubled));
    refused(faults, || {
        let layer = blanked(&file.text, &base);
        let (text, pieces) = layered(&base_source.text, &layer);
        Layers { sources: vec![file, base_source], text, pieces }
    })
}

fn refused<T>(faults: Vec<Fault>, good: impl FnOnce() -> T) -> Result<T, ConfigError> {
    if faults.is_empty() { Ok(good()) } else { Err(ConfigError::Faults(faults)) }
}

fn key<'a>(entries: &'a [Entry], path: &str) -> Option<&'a Entry> {
    entries.iter().skip(1).find(|entry| entry.path == path)
}

/// The text with spaces in place of a key, its value and the comma behind it.
fn blanked(text: &str, entry: &Entry) -> String {
    let is_comma = text[entry.value.end..].starts_with(',');
    let end = entry.value.end + usize::from(is_comma);
    let blank = |c: char| if c == '\n' { "\n".into() } else { " ".repeat(c.len_utf8()) };
    let blanks: String = text[entry.key.start..end].chars().map(blank).collect();
    [&text[..entry.key.start], &blanks, &text[end..]].concat()
}

/// The name of an enum's variant before its keys, where there is one: another variant has other keys, and replaces
/// the whole value.
fn variant(value: &str) -> &str {
    let value = value.strip_prefix("Some(").unwrap_or(value);
    let end = value.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(value.len());
    &value[..end]
}

/// The base with the layer's values in place of its own, and what the layer has besides.
fn layered(base: &str, layer: &str) -> (String, Vec<Piece>) {
    struct Edit {
        of_base: Range<usize>,
        of_layer: Range<usize>,
        needs_comma: bool,
        is_new: bool,
    }
    let (below, above) = (entries(base), entries(layer));
    let mut edits: Vec<Edit> = Vec::new();
    let mut done = 0;
    for entry in above.iter().skip(1).filter(|entry| !entry.path.contains('[')) {
        if entry.key.start < done {
            continue;
        }
        let overridden = key(&below, &entry.path);
        let is_alike = |below: &Entry| {
            let (below, above) = (&base[below.value.clone()], &layer[entry.value.clone()]);
            variant(below) == variant(above)
        };
        let merges = |below: &Entry| below.group.is_some() && is_alike(below);
        if entry.group.is_some() && overridden.is_some_and(merges) {
            continue;
        }
        done = entry.value.end;
        if let Some(of_base) = overridden.map(|below| below.value.clone()) {
            let of_layer = entry.value.clone();
            edits.push(Edit { of_base, of_layer, needs_comma: false, is_new: false });
            continue;
        }
        // A key that the base has not.
        let parent = entry.path.rsplit_once('.').map_or("", |(parent, _)| parent);
        let group = below.iter().find(|below| below.path == parent).and_then(|below| below.group);
        let Some(group) = group else { continue };
        let of_base = group.close..group.close;
        let is_first = edits.iter().all(|edit| edit.of_base != of_base);
        let needs_comma = group.needs_comma && is_first;
        let of_layer = entry.key.start..entry.value.end;
        edits.push(Edit { of_base, of_layer, needs_comma, is_new: true });
    }
    edits.sort_by_key(|edit| edit.of_base.start);
    let (mut text, mut pieces, mut from) = (String::new(), Vec::new(), 0);
    for edit in edits {
        pieces.push(Piece { start: text.len(), source: 1, from });
        text += &base[from..edit.of_base.start];
        text += if edit.needs_comma { "," } else { "" };
        pieces.push(Piece { start: text.len(), source: 0, from: edit.of_layer.start });
        text += &layer[edit.of_layer];
        text += if edit.is_new { "," } else { "" };
        from = edit.of_base.end;
    }
    pieces.push(Piece { start: text.len(), source: 1, from });
    text += &base[from..];
    (text, pieces)
}

impl Layers {
    /// The file that a key comes from, or the nearest key around it that there is.
    pub(super) fn path_of(&self, path: &str) -> &Path {
        let entries = entries(&self.text);
        let mut path = path;
        loop {
            if let Some(entry) = key(&entries, path) {
                return &self.sources[self.piece(entry.value.start).source].path;
            }
            match path.rfind(['.', '[']) {
                Some(end) => path = &path[..end],
                None => return &self.sources[0].path,
            }
        }
    }

    fn piece(&self, at: usize) -> &Piece {
        self.pieces.iter().rfind(|piece| piece.start <= at).expect("the first starts at 0")
    }

    /// What the parser says, with the file and the place in it. An unknown key is taken out: then
    /// there is `true` beside the fault, and parsing can go on.
    pub(super) fn fault(&mut self, error: &ron::error::SpannedError) -> (Fault, bool) {
        let entries = entries(&self.text);
        let told = byte(&self.text, error.span.start.line, error.span.start.col);
        // The parser may stand before the space in front of a value: in another file than the value.
        let before = |entry: &&Entry| (entry.key.end..entry.value.start).contains(&told);
        let at = entries.iter().skip(1).rfind(before).map_or(told, |entry| entry.value.start);
        let is_around = |entry: &&Entry| entry.value.contains(&at) || entry.value.end == at;
        let is_group = |entry: &&Entry| is_around(entry) && entry.group.is_some();
        let group = entries.iter().rfind(is_group).map_or("", |entry| &entry.path);
        let dot = if group.is_empty() { "" } else { "." };
        let key = |name: &str| format!("{group}{dot}{name}");
        let piece = self.piece(at);
        let source = &self.sources[piece.source];
        let from = (piece.from + at - piece.start).min(source.text.len());
        match &error.code {
            ron::Error::MissingStructField { field, .. } => {
                let (path, key) = (self.sources[0].path.clone(), Some(key(field)));
                (Fault { path, position: None, key, problem: Problem::Missing }, false)
            }
            ron::Error::NoSuchStructField { expected, found, .. } => {
                let key = key(found);
                let fault = source.fault(from, Some(&key), Problem::Unknown { expected });
                let unknown = entries.iter().find(|entry| entry.path == key);
                let taken_out = unknown.map(|entry| self.text = blanked(&self.text, entry));
                (fault, taken_out.is_some())
            }
            code => {
                // The place is that of the value, or the one before it.
                let is_it = |entry: &&Entry| {
                    is_around(entry) || (entry.key.end..entry.value.end).contains(&at)
                };
                let innermost = entries.iter().skip(1).rfind(is_it);
                let key = innermost.map(|entry| entry.path.as_str());
                (source.fault(from, key, Problem::Syntax(shortened(&code.to_string()))), false)
            }
        }
    }
}
