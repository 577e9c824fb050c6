//! Columns of numbers in a Parquet file, compressed with Snappy or not at all.

use std::path::Path;

use bytes::Bytes;
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, RowGroupReader, SerializedFileReader};

use super::rows::{ROWS_MAX, read_bytes};
use crate::file_error::FileError;

/// Most row groups of a file, and most columns.
const GROUPS_MAX: usize = 10_000;
const COLUMNS_MAX: usize = 1000;
/// Most numbers of a column.
const NUMBERS_MAX: usize = 16 * ROWS_MAX;

/// A file of columns.
pub(super) struct Table {
    file: SerializedFileReader<Bytes>,
    rows: usize,
}

impl Table {
    pub(super) fn open(path: &Path) -> Result<Self, FileError> {
        let fail = |problem: String| FileError::input(path, "parquet", problem);
        let bytes = Bytes::from(read_bytes(path)?);
        let file = SerializedFileReader::new(bytes)
            .map_err(|e| fail(format!("expected a Parquet file: {}", said(&e))))?;
        let metadata = file.metadata();
        let columns = metadata.file_metadata().schema_descr().num_columns();
        if metadata.num_row_groups() > GROUPS_MAX || columns > COLUMNS_MAX {
            let groups = metadata.num_row_groups();
            return Err(fail(format!(
                "expected at most {GROUPS_MAX} row groups and {COLUMNS_MAX} columns, found {groups} and \
                 {columns}"
            )));
        }
        let rows = metadata.row_groups().iter().try_fold(0_usize, |sum, group| {
            sum.checked_add(usize::try_from(group.num_rows()).ok()?)
        });
        match rows.filter(|rows| *rows <= ROWS_MAX) {
            Some(rows) => Ok(Self { file, rows }),
            None => Err(fail(format!("expected at most {ROWS_MAX} rows, found more"))),
        }
    }

    /// Number of rows.
    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    /// The numbers of a column, so many a row: a column of numbers, or one of lists of equal length.
    pub(super) fn numbers(&self, name: &str, count: usize) -> Result<Vec<f64>, String> {
        let schema = self.file.metadata().file_metadata().schema_descr();
        let is_it = |i: &usize| schema.column(*i).path().parts().first().is_some_and(|p| p == name);
        let found: Vec<usize> = (0..schema.num_columns()).filter(is_it).collect();
        let [column] = found[..] else {
            return Err(format!(
                "expected this column of numbers, found {} of the name",
                found.len()
            ));
        };
        if self.rows * count > NUMBERS_MAX {
            return Err(format!("expected at most {NUMBERS_MAX} numbers, found more"));
        }
        let mut numbers = Vec::with_capacity(self.rows * count);
        for group in 0..self.file.num_row_groups() {
            let group = self.file.get_row_group(group).map_err(|e| said(&e))?;
            let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
            check_pages(&*group, column, rows * count)?;
            let read = match group.get_column_reader(column).map_err(|e| said(&e))? {
                ColumnReader::FloatColumnReader(reader) => all(reader, rows, count, f64::from)?,
                ColumnReader::DoubleColumnReader(reader) => all(reader, rows, count, |x| x)?,
                ColumnReader::Int64ColumnReader(reader) => all(reader, rows, count, |x| x as f64)?,
                ColumnReader::Int32ColumnReader(reader) => all(reader, rows, count, f64::from)?,
                _ => return Err("expected floats or integers of 4 or 8 bytes".into()),
            };
            numbers.extend(read);
        }
        Ok(numbers)
    }
}

/// Refuses pages that say to hold more numbers than the rows have, before they are unpacked.
fn check_pages(group: &dyn RowGroupReader, column: usize, expected: usize) -> Result<(), String> {
    let mut pages = group.get_column_page_reader(column).map_err(|e| said(&e))?;
    let mut found = 0_usize;
    while let Some(page) = pages.peek_next_page().map_err(|e| said(&e))? {
        // Without levels a page has as many numbers as rows.
        let numbers = page.num_levels.or(page.num_rows).unwrap_or(0);
        found = found.saturating_add(if page.is_dict { 0 } else { numbers });
        if found > expected {
            return Err(format!("expected {expected} numbers by its rows, found pages with more"));
        }
        pages.skip_next_page().map_err(|e| said(&e))?;
    }
    Ok(())
}

/// All numbers of a column in a row group; each row has exactly so many, and none is missing.
fn all<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    rows: usize,
    count: usize,
    number: impl Fn(T::T) -> f64,
) -> Result<Vec<f64>, String> {
    let (mut defined, mut repeated, mut values) = (Vec::new(), Vec::new(), Vec::new());
    let mut records = 0;
    while records < rows {
        let read = reader.read_records(
            rows - records,
            Some(&mut defined),
            Some(&mut repeated),
            &mut values,
        );
        let (read, ..) = read.map_err(|e| said(&e))?;
        if read == 0 {
            break;
        }
        records += read;
    }
    // The first of each row's numbers has repetition level 0.
    let even = repeated.iter().enumerate().all(|(i, level)| (*level == 0) == (i % count == 0));
    if records != rows || values.len() != rows * count || !(even || count == 1) {
        let found = values.len();
        return Err(format!(
            "expected {count} numbers in each of {rows} rows, found {found} in {records}: are some missing?"
        ));
    }
    Ok(values.into_iter().map(number).collect())
}

/// What the reader says, at most a few lines of it.
fn said(error: &ParquetError) -> String {
    tprmp_files::shortened(&error.to_string())
}
