//! MATLAB files of version 5 (`save -v6`, `-v7`): named arrays of numbers, cells and structures.
//!
//! An element is a tag (type, length) and its data, padded to 8 bytes; a matrix is an element of
//! elements (flags, dimensions, name, contents); a compressed element holds one matrix, deflated.

use std::io::Read;

/// Bound on cells in cells.
const DEPTH_MAX: usize = 16;
/// Most unpacked bytes of all variables.
const BYTES_MAX: u64 = 32 << 20;
/// Most bytes of numbers of all variables, of which one takes up to eight in memory.
const NUMBERS_BYTES_MAX: usize = 8 << 20;
/// Most matrices: variables, cells, and fields of structures.
const MATRICES_MAX: usize = 100_000;

/// What a file may still hold.
struct Budget {
    bytes: u64,
    numbers: usize,
    matrices: usize,
}

impl Budget {
    fn take(left: &mut usize, count: usize, what: &str, most: usize) -> Result<(), String> {
        *left = left.checked_sub(count).ok_or_else(|| {
            format!("expected at most {most} {what} in the file, found more: keep the variable `demos` only")
        })?;
        Ok(())
    }
}

/// A value of a file.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    /// Numbers, column by column.
    Numbers {
        /// Length of the first axis.
        rows: usize,
        /// Product of the other axes' lengths.
        columns: usize,
        /// rows · columns numbers.
        values: Vec<f64>,
    },
    /// A cell array, or an array of structures.
    List(Vec<Value>),
    /// Fields by their names.
    Structure(Vec<(String, Value)>),
    /// Text, sparse or complex numbers, objects: what no demonstration is made of.
    Other,
}

impl Value {
    /// The field of a structure.
    pub(super) fn field(&self, name: &str) -> Option<&Self> {
        let Self::Structure(fields) = self else { return None };
        fields.iter().find(|(field, _)| field == name).map(|(_, value)| value)
    }

    /// What it is, for errors.
    pub(super) fn describe(&self) -> String {
        match self {
            Self::Numbers { rows, columns, .. } => format!("{rows}×{columns} numbers"),
            Self::List(list) => format!("{} cells", list.len()),
            Self::Structure(fields) => {
                let names: Vec<_> = fields.iter().map(|(name, _)| name.as_str()).collect();
                format!("a structure of [{}]", names.join(", "))
            }
            Self::Other => "something else than real numbers".into(),
        }
    }
}

/// The named values of a file.
///
/// # Errors
/// What was expected: the file is of another version, truncated or corrupted.
pub(super) fn parse(bytes: &[u8]) -> Result<Vec<(String, Value)>, String> {
    let expected = "expected a MATLAB file of version 5";
    if bytes.starts_with(b"MATLAB 7.3") {
        return Err(format!("{expected}, found version 7.3; write it by `save -v7`"));
    }
    let (header, mut rest) = bytes
        .split_at_checked(128)
        .filter(|(header, _)| header.starts_with(b"MATLAB"))
        .ok_or(format!("{expected}, found something else"))?;
    match &header[124..] {
        [0, 1, b'I', b'M'] => {}
        [1, 0, b'M', b'I'] => return Err(format!("{expected} in little-endian order, found big")),
        other => return Err(format!("{expected}, found version and order {other:?}")),
    }
    let mut left = Budget { bytes: BYTES_MAX, numbers: NUMBERS_BYTES_MAX, matrices: MATRICES_MAX };
    let mut values = Vec::new();
    while !rest.is_empty() {
        let element = element(rest)?;
        rest = element.rest;
        match element.kind {
            COMPRESSED => {
                let mut inflated = Vec::new();
                let inflate = flate2::read::ZlibDecoder::new(element.data);
                let size = inflate.take(left.bytes + 1).read_to_end(&mut inflated);
                let size = size.map_err(|e| format!("a variable cannot be unpacked: {e}"))? as u64;
                left.bytes = left.bytes.checked_sub(size).ok_or_else(|| {
                    format!("expected at most {BYTES_MAX} bytes unpacked, found more")
                })?;
                let inner = self::element(&inflated)?;
                if inner.kind == MATRIX {
                    values.push(matrix(inner.data, DEPTH_MAX, &mut left)?);
                }
            }
            MATRIX => values.push(matrix(element.data, DEPTH_MAX, &mut left)?),
            _ => {}
        }
    }
    Ok(values)
}

const INT8: u32 = 1;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

struct Element<'a> {
    kind: u32,
    data: &'a [u8],
    rest: &'a [u8],
}

fn element(bytes: &[u8]) -> Result<Element<'_>, String> {
    let truncated = || String::from("the file is truncated or corrupted");
    let (tag, after) = bytes.split_first_chunk::<4>().ok_or_else(truncated)?;
    let tag = u32::from_le_bytes(*tag);
    if tag >> 16 != 0 {
        // A small element: its length stands in the tag, up to four bytes of data follow.
        let (data, rest) = after.split_at_checked(4).ok_or_else(truncated)?;
        let data = data.get(..(tag >> 16) as usize).ok_or_else(truncated)?;
        return Ok(Element { kind: tag & 0xffff, data, rest });
    }
    let (length, after) = after.split_first_chunk::<4>().ok_or_else(truncated)?;
    let length = u32::from_le_bytes(*length) as usize;
    let (data, rest) = after.split_at_checked(length).ok_or_else(truncated)?;
    let padding = if tag == COMPRESSED { 0 } else { length.next_multiple_of(8) - length };
    // The last one may come without its padding.
    Ok(Element { kind: tag, data, rest: rest.get(padding..).unwrap_or_default() })
}

/// The next element, which must be of a kind.
fn expect<'a>(rest: &mut &'a [u8], kind: u32, what: &str) -> Result<&'a [u8], String> {
    let element = element(rest)?;
    if element.kind != kind {
        return Err(format!("expected {what} of a matrix, found type {}", element.kind));
    }
    *rest = element.rest;
    Ok(element.data)
}

fn matrix(mut rest: &[u8], depth: usize, left: &mut Budget) -> Result<(String, Value), String> {
    Budget::take(&mut left.matrices, 1, "cells and fields", MATRICES_MAX)?;
    if rest.is_empty() {
        return Ok((String::new(), Value::Other));
    }
    if depth == 0 {
        return Err(format!("cells are nested deeper than {DEPTH_MAX}"));
    }
    let flags = expect(&mut rest, UINT32, "the flags")?;
    let flags =
        flags.first_chunk().map(|b| u32::from_le_bytes(*b)).ok_or("a matrix has no flags")?;
    let dimensions = expect(&mut rest, INT32, "the dimensions")?;
    let dimensions: Vec<usize> = (dimensions.as_chunks().0.iter())
        .map(|b| usize::try_from(i32::from_le_bytes(*b)).map_err(|_| "a dimension is negative"))
        .collect::<Result<_, _>>()?;
    let name = String::from_utf8_lossy(expect(&mut rest, INT8, "the name")?).into_owned();
    let count = dimensions.iter().try_fold(1_usize, |all, n| all.checked_mul(*n));
    let count = count.ok_or("the dimensions of a matrix are too large")?;
    let is_complex = flags & 0x0800 != 0;
    let value = match flags & 0xff {
        1 => Value::List(matrices(&mut rest, count, depth, left)?),
        2 => structures(rest, count, depth, left)?,
        6..=15 if !is_complex => {
            let element = element(rest)?;
            Budget::take(
                &mut left.numbers,
                element.data.len(),
                "bytes of numbers",
                NUMBERS_BYTES_MAX,
            )?;
            let values = numbers(element.kind, element.data)?;
            let rows = dimensions.first().copied().unwrap_or(0);
            if values.len() != count {
                let found = values.len();
                return Err(format!("`{name}`: expected {dimensions:?} numbers, found {found}"));
            }
            Value::Numbers { rows, columns: count.checked_div(rows).unwrap_or(0), values }
        }
        _ => Value::Other,
    };
    Ok((name, value))
}

/// As many matrices; each takes bytes, so the loop ends with them.
fn matrices(
    rest: &mut &[u8],
    count: usize,
    depth: usize,
    left: &mut Budget,
) -> Result<Vec<Value>, String> {
    let mut list = Vec::new();
    for _ in 0..count {
        list.push(matrix(expect(rest, MATRIX, "a cell")?, depth - 1, left)?.1);
    }
    Ok(list)
}

fn structures(
    mut rest: &[u8],
    count: usize,
    depth: usize,
    left: &mut Budget,
) -> Result<Value, String> {
    let length = expect(&mut rest, INT32, "the length of field names")?;
    let length = length.first_chunk().map_or(0, |b| i32::from_le_bytes(*b));
    let length = usize::try_from(length).ok().filter(|n| (1..=256).contains(n));
    let length = length.ok_or("the field names of a structure have no readable length")?;
    let names = expect(&mut rest, INT8, "field names")?;
    if names.len() / length > left.matrices {
        return Err(format!("expected at most {MATRICES_MAX} fields, found more"));
    }
    let names: Vec<String> = names
        .chunks(length)
        .map(|name| {
            let end = name.iter().position(|byte| *byte == 0).unwrap_or(name.len());
            String::from_utf8_lossy(&name[..end]).into_owned()
        })
        .collect();
    if names.is_empty() {
        return Ok(Value::Other);
    }
    let mut list = Vec::new();
    for _ in 0..count {
        let values = matrices(&mut rest, names.len(), depth, left)?;
        list.push(Value::Structure(names.iter().cloned().zip(values).collect()));
    }
    Ok(if list.len() == 1 { list.remove(0) } else { Value::List(list) })
}

/// Numbers are stored in the smallest type that holds them.
fn numbers(kind: u32, data: &[u8]) -> Result<Vec<f64>, String> {
    fn all<const N: usize>(data: &[u8], number: impl Fn([u8; N]) -> f64) -> Vec<f64> {
        data.as_chunks().0.iter().map(|chunk| number(*chunk)).collect()
    }
    Ok(match kind {
        1 => all(data, |b| f64::from(i8::from_le_bytes(b))),
        2 => all(data, |b| f64::from(u8::from_le_bytes(b))),
        3 => all(data, |b| f64::from(i16::from_le_bytes(b))),
        4 => all(data, |b| f64::from(u16::from_le_bytes(b))),
        5 => all(data, |b| f64::from(i32::from_le_bytes(b))),
        6 => all(data, |b| f64::from(u32::from_le_bytes(b))),
        7 => all(data, |b| f64::from(f32::from_le_bytes(b))),
        9 => all(data, f64::from_le_bytes),
        12 => all(data, |b| i64::from_le_bytes(b) as f64),
        13 => all(data, |b| u64::from_le_bytes(b) as f64),
        other => return Err(format!("expected numbers, found type {other}")),
    })
}
