//! Triangles of an STL file, binary or ASCII.
//!
//! Binary: 80 bytes of any text, the number of triangles, then 50 bytes for each: its normal, three corners and two
//! bytes more. Many programs begin the text with `solid`, as ASCII does, so that is told by the size first.

use glam::DVec3;

use crate::scene::of_scene;
use crate::triangle::Triangle;

/// Bytes before the triangles.
const HEAD: usize = 84;
/// Bytes of a triangle.
const EACH: usize = 50;
/// So many bytes may follow the last triangle.
const TAIL_MAX: usize = 4096;

/// All triangles of a file.
///
/// # Errors
///
/// What was expected, and what was found.
pub(crate) fn triangles(bytes: &[u8]) -> Result<Vec<Triangle>, String> {
    let count = bytes.get(HEAD - 4..HEAD).and_then(|count| count.try_into().ok());
    let count = count.map(|count| u32::from_le_bytes(count) as usize);
    let is_exact = count.is_some_and(|count| size(count) == bytes.len());
    if !is_exact && is_ascii(bytes) {
        return ascii(bytes);
    }
    let Some(count) = count else {
        let found = bytes.len();
        return Err(format!("expected STL of {HEAD} bytes or more, found {found} bytes"));
    };
    binary(bytes.get(HEAD..).unwrap_or(&[]), count)
}

/// Bytes of a binary file of so many triangles.
fn size(count: usize) -> usize {
    HEAD.saturating_add(count.saturating_mul(EACH))
}

/// Whether it begins with `solid`, in any case, and what would be the head of a binary file is text.
fn is_ascii(bytes: &[u8]) -> bool {
    let text = bytes.trim_ascii_start();
    let word = text.get(..5).unwrap_or(&[]);
    // A number of triangles below 2^24 has a byte of zero.
    word.eq_ignore_ascii_case(b"solid") && !bytes.iter().take(HEAD).any(|byte| *byte == 0)
}

fn ascii(bytes: &[u8]) -> Result<Vec<Triangle>, String> {
    // Its words may be in upper case.
    of_scene(mesh_loader::stl::from_slice(&bytes.to_ascii_lowercase()))
}

fn binary(body: &[u8], count: usize) -> Result<Vec<Triangle>, String> {
    let there = body.len() / EACH;
    // Programs that do not know the number beforehand leave it at none or at the most.
    let is_unknown = [0, u32::MAX as usize].contains(&count) && body.len().is_multiple_of(EACH);
    let count = if is_unknown { there } else { count };
    if count > there || body.len() - count * EACH > TAIL_MAX {
        return Err(format!(
            "expected binary STL of {count} triangles, as its head says, found {there}; the file is damaged: get it \
             anew"
        ));
    }
    let triangle = |bytes: &[u8; EACH]| -> Triangle {
        let number = |at: usize| {
            let bytes = [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
            f64::from(f32::from_le_bytes(bytes))
        };
        [12, 24, 36].map(|at| DVec3::new(number(at), number(at + 4), number(at + 8)))
    };
    let (each, _) = body.as_chunks::<EACH>();
    Ok(each.iter().take(count).map(triangle).collect())
}
