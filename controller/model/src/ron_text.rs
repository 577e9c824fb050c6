//! The tokens and the keys of RON text, each with its place: what layering, renaming and checksums
//! need of a text before its types are known.
//!
//! Nothing here refuses a text: what is no RON is found by the parser that reads it afterwards.

use std::ops::Range;

/// A piece of RON text that is neither space nor comment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Token<'a> {
    /// Byte at which it begins.
    pub(crate) start: usize,
    /// Its text: a string with its quotes, a bracket, a comma, a colon, or a word.
    pub(crate) text: &'a str,
}

impl Token<'_> {
    /// The byte after it.
    pub(crate) fn end(&self) -> usize {
        self.start + self.text.len()
    }

    fn is_word(&self) -> bool {
        self.text.starts_with(|c: char| c.is_alphabetic() || c == '_') && !self.text.contains('"')
    }
}

/// The tokens of a text.
pub(crate) fn tokens(text: &str) -> Vec<Token<'_>> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let length = match first {
            _ if rest.starts_with("//") => rest.find('\n').unwrap_or(rest.len()),
            _ if rest.starts_with("/*") => block_comment(rest),
            _ if first.is_whitespace() => first.len_utf8(),
            _ => {
                let length = token(rest, first);
                tokens.push(Token { start: at, text: &rest[..length] });
                length
            }
        };
        at += length;
    }
    tokens
}

/// Length of the block comment with which a text begins. Comments nest.
fn block_comment(text: &str) -> usize {
    let (mut depth, mut at) = (0, 0);
    while at < text.len() {
        match &text.as_bytes()[at..] {
            [b'/', b'*', ..] => (depth, at) = (depth + 1, at + 2),
            [b'*', b'/', ..] => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 {
            return at;
        }
    }
    text.len()
}

/// Length of the token with which a text begins.
fn token(text: &str, first: char) -> usize {
    let is_mark = |c: char| "()[]{}:,".contains(c);
    if is_mark(first) {
        return 1;
    }
    if first == '"' {
        let mut escaped = false;
        let end = text[1..].find(|c| {
            let ends = c == '"' && !escaped;
            escaped = c == '\\' && !escaped;
            ends
        });
        return end.map_or(text.len(), |end| end + 2);
    }
    if let Some(raw) = text.strip_prefix('r') {
        let hashes = raw.bytes().take_while(|b| *b == b'#').count();
        if let Some(body) = raw[hashes..].strip_prefix('"') {
            let close = format!("\"{}", "#".repeat(hashes));
            let end = body.find(&close).map_or(body.len(), |end| end + close.len());
            return text.len() - body.len() + end;
        }
    }
    let rest = &text[first.len_utf8()..];
    let ends = |c: char| is_mark(c) || c == '"' || c == '/' || c.is_whitespace();
    rest.find(ends).map_or(text.len(), |end| first.len_utf8() + end)
}

/// Line and column of a byte, counted from 1.
pub(crate) fn position(text: &str, byte: usize) -> (usize, usize) {
    let before = &text[..byte];
    let line_start = before.rfind('\n').map_or(0, |end| end + 1);
    (1 + before.matches('\n').count(), 1 + before[line_start..].chars().count())
}

/// The byte of a line and column.
pub(crate) fn byte(text: &str, line: usize, column: usize) -> usize {
    let line_start = text.split_inclusive('\n').take(line - 1).map(str::len).sum::<usize>();
    let rest = &text[line_start..];
    line_start + rest.char_indices().nth(column - 1).map_or(rest.len(), |(byte, _)| byte)
}

/// A text without spaces, comments and the commas before closing brackets: as it is serialised
/// without a layout.
pub(crate) fn compact(text: &str) -> String {
    let tokens = tokens(text);
    let closes = |token: &Token<'_>| [")", "]", "}"].contains(&token.text);
    let mut compact = String::with_capacity(text.len());
    for (i, token) in tokens.iter().enumerate() {
        if token.text != "," || !tokens.get(i + 1).is_some_and(closes) {
            compact.push_str(token.text);
        }
    }
    compact
}

/// A key of a text and its value, or a bracketed value in a list.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    /// Keys from the outermost, and places in lists: `additional_skills[0].governor`.
    pub(crate) path: String,
    /// Bytes of the key; none in a list.
    pub(crate) key: Range<usize>,
    /// Bytes of the value.
    pub(crate) value: Range<usize>,
    /// Where a further key can stand, for a value that has keys itself.
    pub(crate) group: Option<Group>,
}

/// The end of a list of keys.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Group {
    /// Byte of the closing bracket.
    pub(crate) close: usize,
    /// Whether a comma is needed before a further key.
    pub(crate) needs_comma: bool,
}

/// A bracket that is open.
struct Open {
    /// Path of what stands in it.
    path: String,
    /// Which value of a list is being read; `None` in round brackets.
    index: Option<usize>,
    /// The entry whose value it is, through round brackets alone: `Some((…))` is one too.
    owner: Option<usize>,
    has_keys: bool,
    /// The entry whose value is being read.
    entry: Option<usize>,
}

/// Deeper brackets are not looked into: no file needs them, and the parser refuses them at the same depth.
const DEPTH_MAX: usize = 128;

/// Nor is what stands under longer paths [bytes]: each entry has its own.
const PATH_MAX: usize = 1024;

/// Bytes of the value of a key, `section.key`, in the text of a RON file.
#[must_use]
pub fn ron_value(text: &str, path: &str) -> Option<Range<usize>> {
    entries(text).into_iter().find(|entry| entry.path == path).map(|entry| entry.value)
}

/// The keys of a text in its order. The first entry is the whole text, and has no key.
pub(crate) fn entries(text: &str) -> Vec<Entry> {
    let tokens = tokens(text);
    let whole = Entry { path: String::new(), key: 0..0, value: 0..text.len(), group: None };
    let mut entries = vec![whole];
    let outermost =
        Open { path: String::new(), index: None, owner: None, has_keys: false, entry: Some(0) };
    let mut open = vec![outermost];
    for (i, token) in tokens.iter().enumerate() {
        let before = i.checked_sub(1).map(|before| tokens[before]);
        let (is_inside, is_deep) = (open.len() > 1, open.len() > DEPTH_MAX);
        let Some(top) = open.last_mut() else { break };
        if is_deep || top.path.len() > PATH_MAX {
            break;
        }
        match token.text {
            bracket @ ("(" | "[" | "{") => {
                let is_round = bracket == "(";
                if let (None, Some(index)) = (top.entry, top.index) {
                    let path = format!("{}[{index}]", top.path);
                    let (key, value) = (token.start..token.start, token.start..text.len());
                    top.entry = Some(entries.len());
                    entries.push(Entry { path, key, value, group: None });
                }
                let path = top.entry.map_or(&top.path, |entry| &entries[entry].path).clone();
                let owner = if is_round { top.entry.or(top.owner) } else { None };
                let index = (!is_round).then_some(0);
                open.push(Open { path, index, owner, has_keys: false, entry: None });
            }
            ")" | "]" | "}" if is_inside => {
                let Some(closed) = open.pop() else { break };
                let end = before.map_or(0, |token| token.end());
                if let Some(entry) = closed.entry {
                    // A key without a value ends where it would begin.
                    let value = &mut entries[entry].value;
                    value.end = end.max(value.start);
                }
                let needs_comma = !before.is_some_and(|token| ["(", ","].contains(&token.text));
                if let Some(owner) = closed.owner
                    && (closed.has_keys || before.is_some_and(|token| token.text == "("))
                {
                    entries[owner].group = Some(Group { close: token.start, needs_comma });
                }
            }
            "," => {
                top.index = top.index.map(|index| index + 1);
                if let Some(entry) = top.entry.filter(|entry| *entry > 0) {
                    entries[entry].value.end = token.start;
                    top.entry = None;
                }
            }
            ":" if top.index.is_none() && top.entry.is_none() => {
                let Some(key) = before.filter(Token::is_word) else { continue };
                let dot = if top.path.is_empty() { "" } else { "." };
                let path = format!("{}{dot}{}", top.path, key.text);
                if path.len() > PATH_MAX {
                    break;
                }
                let value = tokens.get(i + 1).map_or(text.len(), |next| next.start)..text.len();
                (top.has_keys, top.entry) = (true, Some(entries.len()));
                entries.push(Entry { path, key: key.start..key.end(), value, group: None });
            }
            _ => {}
        }
    }
    entries
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str =
        "// a: (\n(\n  a: (b: 1.5, /* c: 2, /* */ */ d: [(e: -1), (e: \"x: \\\" (\")]),
      f: Some((g: None,)), h: Above(0.1), i: {\"j\": (1, 2)}, k: r#\"l: \"m\"\"#, n: (), )";

    #[test]
    fn keys_have_their_paths_values_and_groups() {
        let found: Vec<_> = entries(TEXT)
            .iter()
            .skip(1)
            .map(|e| (e.path.clone(), &TEXT[e.value.clone()], e.group.is_some()))
            .collect();
        let expected = [
            ("a", "(b: 1.5, /* c: 2, /* */ */ d: [(e: -1), (e: \"x: \\\" (\")])", true),
            ("a.b", "1.5", false),
            ("a.d", "[(e: -1), (e: \"x: \\\" (\")]", false),
            ("a.d[0]", "(e: -1)", true),
            ("a.d[0].e", "-1", false),
            ("a.d[1]", "(e: \"x: \\\" (\")", true),
            ("a.d[1].e", "\"x: \\\" (\"", false),
            ("f", "Some((g: None,))", true),
            ("f.g", "None", false),
            ("h", "Above(0.1)", false),
            ("i", "{\"j\": (1, 2)}", false),
            ("i[0]", "(1, 2)", false),
            ("k", "r#\"l: \"m\"\"#", false),
            ("n", "()", true),
        ];
        let expected = expected.map(|(path, value, is_group)| (path.to_owned(), value, is_group));
        assert_eq!(found, expected);
        let commas: Vec<_> =
            entries(TEXT).iter().filter_map(|e| e.group).map(|group| group.needs_comma).collect();
        assert_eq!(commas, [false, true, true, true, false, false]);
    }

    #[test]
    fn a_compact_text_has_nothing_that_the_parser_passes_over() {
        let expected = "(a:(b:1.5,d:[(e:-1),(e:\"x: \\\" (\")]),f:Some((g:None)),h:Above(0.1),\
                        i:{\"j\":(1,2)},k:r#\"l: \"m\"\"#,n:())";
        assert_eq!(compact(TEXT), expected);
        assert_eq!(compact(expected), expected);
    }

    #[test]
    fn what_is_no_ron_has_tokens_all_the_same() {
        for text in ["", "(", ")", "(a", "(a:", "a: \"", "/* (", "r#\"", ")))(a: 1", "'", "\u{e9}:"]
        {
            assert!(compact(text).len() <= text.len());
            assert!(!entries(text).is_empty());
        }
        // Deep ones too: nothing recurses.
        assert_eq!(entries(&"(a:".repeat(3_000)).len(), DEPTH_MAX);
        // A long key over many short ones would be copied for each.
        let long = format!("({}: ({}))", "a".repeat(500_000), "b: 1, ".repeat(80_000));
        assert!(entries(&long).len() < 4);
    }
}
