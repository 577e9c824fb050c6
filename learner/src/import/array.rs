//! Arrays in NumPy's own format (`np.save`): little-endian floats or integers of 4 or 8 bytes.

use npyz::{NpyHeader, Order};

use super::rows::ROWS_MAX;

/// Most opening brackets in the header of an array. Numbers have two; the parser takes a time
/// exponential in their depth.
const BRACKETS_MAX: usize = 8;

/// Most numbers of an array.
pub(super) const NUMBERS_MAX: usize = 7 * ROWS_MAX;

/// An array of some axes; one axis is a column.
#[derive(Debug)]
pub(super) struct Array {
    /// Lengths of the axes, two or more.
    shape: Vec<usize>,
    /// The last axis first: row by row.
    pub(super) values: Vec<f64>,
}

impl Array {
    /// Length of the last axis.
    pub(super) fn columns(&self) -> usize {
        self.shape[self.shape.len() - 1]
    }

    /// Length of the axis before it.
    pub(super) fn rows(&self) -> usize {
        self.shape[self.shape.len() - 2]
    }

    /// Length of the first of three axes.
    pub(super) fn blocks(&self) -> usize {
        if self.shape.len() > 2 { self.shape[0] } else { 1 }
    }

    /// Row i of all.
    pub(super) fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.columns()..(i + 1) * self.columns()]
    }
}

/// Reads an array in version 1 of the format, in which all arrays of numbers are written, with at most so
/// many axes.
pub(super) fn parse(bytes: &[u8], axes_max: usize) -> Result<Array, String> {
    let wrong = |e: std::io::Error| format!("expected a NumPy array (npy): {e}");
    let truncated = "the array is truncated";
    let (start, rest) = bytes.split_first_chunk::<10>().ok_or(truncated)?;
    let length = usize::from(u16::from_le_bytes([start[8], start[9]]));
    let (text, data) = rest.split_at_checked(length).ok_or(truncated)?;
    if start[6] != 1 || text.iter().filter(|byte| b"([{".contains(byte)).count() > BRACKETS_MAX {
        return Err("expected a NumPy array (npy) of numbers, version 1".into());
    }
    let header = NpyHeader::from_reader(&bytes[..10 + length]).map_err(wrong)?;
    let axes = header.shape();
    if axes.is_empty() || axes.len() > axes_max {
        let names = ["one", "one or two", "one, two or three"];
        return Err(format!("expected {} axes, found shape {axes:?}", names[axes_max - 1]));
    }
    let said: Vec<String> = axes.iter().map(u64::to_string).collect();
    let said = if said.len() == 1 { format!("{}×1", said[0]) } else { said.join("×") };
    let count = axes.iter().try_fold(1_u64, |product, length| product.checked_mul(*length));
    let Some(count) = count.filter(|count| *count <= NUMBERS_MAX as u64) else {
        return Err(format!("expected at most {NUMBERS_MAX} numbers by its shape, found {said}"));
    };
    let numbers = numbers(data, header.dtype().descr().trim_matches('\''))?;
    if count != numbers.len() as u64 {
        let found = numbers.len();
        return Err(format!("expected {said} numbers by its shape, found {found}"));
    }
    // Each axis is at most the product, unless another one is zero.
    let bounded = |length: &u64| (*length).min(NUMBERS_MAX as u64) as usize;
    let mut shape: Vec<usize> = axes.iter().map(bounded).collect();
    let values = match header.order() {
        Order::C => numbers,
        Order::Fortran => by_rows(&numbers, &shape),
    };
    if shape.len() == 1 {
        shape.push(1);
    }
    Ok(Array { shape, values })
}

/// Numbers of a kind.
fn numbers(data: &[u8], kind: &str) -> Result<Vec<f64>, String> {
    Ok(match kind {
        "<f8" => all(data, f64::from_le_bytes),
        "<f4" => all(data, |b| f64::from(f32::from_le_bytes(b))),
        "<i8" => all(data, |b| i64::from_le_bytes(b) as f64),
        "<i4" => all(data, |b| f64::from(i32::from_le_bytes(b))),
        kind => {
            return Err(format!("expected numbers `<f8`, `<f4`, `<i8` or `<i4`, found `{kind}`"));
        }
    })
}

/// All whole numbers of N bytes each.
fn all<const N: usize>(data: &[u8], number: impl Fn([u8; N]) -> f64) -> Vec<f64> {
    data.as_chunks().0.iter().map(|chunk| number(*chunk)).collect()
}

/// Numbers whose first index runs fastest, in the order in which the last does.
fn by_rows(numbers: &[f64], shape: &[usize]) -> Vec<f64> {
    let place = |mut i: usize| {
        // The index along each axis from the last to the first, and the step along it.
        let mut at = 0;
        let mut step = numbers.len();
        for length in shape.iter().rev() {
            step /= length;
            at += i % length * step;
            i /= length;
        }
        at
    };
    (0..numbers.len()).map(|i| numbers[place(i)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_axes_are_read_in_both_orders() {
        // a[i][j][k] = 100 i + 10 j + k, of shape 2×3×4.
        let value = |i: usize, j: usize, k: usize| (100 * i + 10 * j + k) as f64;
        let by_last: Vec<f64> = (0..24).map(|n| value(n / 12, n / 4 % 3, n % 4)).collect();
        let by_first: Vec<f64> = (0..24).map(|n| value(n % 2, n / 2 % 3, n / 6)).collect();
        for (order, numbers) in [("False", &by_last), ("True", &by_first)] {
            let header =
                format!("{{'descr': '<f8', 'fortran_order': {order}, 'shape': (2, 3, 4), }}\n");
            let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
            bytes.extend((header.len() as u16).to_le_bytes());
            bytes.extend(header.as_bytes());
            bytes.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
            let array = parse(&bytes, 3).unwrap();
            assert_eq!((array.blocks(), array.rows(), array.columns()), (2, 3, 4));
            assert_eq!(array.values, by_last, "{order}");
            assert_eq!(array.row(4), [110.0, 111.0, 112.0, 113.0]);
            assert!(parse(&bytes, 2).unwrap_err().contains("[2, 3, 4]"));
        }
    }
}
