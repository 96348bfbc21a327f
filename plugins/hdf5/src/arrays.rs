//! Tables that have a dataset for each column: any number of dimensions, one dataset or one a
//! group of many.

use puncta_sdk::{Failure, Run};

use crate::column::PartRows;
use crate::columns::{self, Meaning};
use crate::error::{damaged, hdf5_reason, unsupported};
use crate::info::{ColumnInfo, Place, Segment, TableInfo};
use crate::open::{self, Opened};
use crate::raw;
use crate::read::{Sink, subtract};
use crate::record::{Fields, Leaf, LeafType, Number, number};
use crate::split::{Block, fill};
use crate::storage::{self, Shape};

/// Bytes that are read at a time.
const BLOCK: u64 = 1 << 20;
/// Bytes of a block that is larger because the file's chunks are.
const MOST: u64 = 512 << 20;

/// A dataset of numbers.
pub(crate) struct Array {
    pub(crate) shape: Vec<u64>,
    number: Number,
    big_endian: bool,
}

/// Looks at a dataset of numbers; `None` where it holds something else. One without a dataspace has
/// the shape `[0]`.
///
/// # Errors
/// A dataset that is damaged or announces more than the file can hold.
pub(crate) fn array(opened: &Opened, at: &str) -> Result<Option<Array>, Failure> {
    let dataset = open::dataset(opened, at)?;
    let file = &opened.name;
    let broken = |e: hdf5::Error| {
        damaged(format!(
            "{file} is damaged at dataset {at} ({})",
            hdf5_reason(&e)
        ))
    };
    let (stored, size) = raw::stored_type(&dataset).map_err(broken)?;
    let Some((number, big_endian)) = number(&stored) else {
        return Ok(None);
    };
    let empty = dataset.space().map_err(broken)?.is_null();
    let shape = match empty {
        true => vec![0],
        false => dataset.shape().iter().map(|n| *n as u64).collect(),
    };
    let elements = shape.iter().try_fold(1_u64, |n, s| n.checked_mul(*s));
    let shape_of_storage = Shape {
        file,
        dataset: at,
        length: opened.length,
        rows: elements.unwrap_or(u64::MAX),
        record: size,
    };
    if elements != Some(0) {
        storage::check_array(&dataset, &shape_of_storage, 0)?;
    }
    Ok(Some(Array {
        shape,
        number,
        big_endian,
    }))
}

impl Array {
    /// The number of rows along an axis.
    pub(crate) fn rows(&self, axis: usize) -> u64 {
        self.shape.get(axis).copied().unwrap_or(0)
    }

    /// The axis of a list of N numbers that may stand as N, N x 1 or 1 x N.
    pub(crate) fn list_axis(&self) -> Option<usize> {
        match self.shape.as_slice() {
            [_] | [_, 1] => Some(0),
            [1, _] => Some(1),
            _ => None,
        }
    }

    /// The field of a row that begins `index` numbers behind the start of the row.
    pub(crate) fn leaf(&self, name: &str, index: usize) -> Leaf {
        Leaf {
            name: name.to_owned(),
            offset: index * self.number.size(),
            stored: LeafType::Number {
                number: self.number,
                big_endian: self.big_endian,
            },
        }
    }
}

/// A field that is a number for each segment.
pub(crate) fn numbers(name: &str) -> Leaf {
    Leaf {
        name: name.to_owned(),
        offset: 0,
        stored: LeafType::Number {
            number: Number::F64,
            big_endian: false,
        },
    }
}

/// A table of such columns.
pub(crate) fn table(
    port: &'static str,
    name: &str,
    segments: Vec<Segment>,
    fields: Vec<(Leaf, Place)>,
    meanings: impl Fn(&Leaf) -> Vec<Meaning>,
) -> TableInfo {
    let (leaves, places): (Vec<Leaf>, Vec<Place>) = fields.into_iter().unzip();
    let all = Fields {
        leaves,
        skipped: Vec::new(),
    };
    let mut columns = columns::build(&all, meanings);
    for column in &mut columns {
        let at = all.leaves.iter().position(|leaf| *leaf == column.leaf);
        column.place = at.and_then(|at| places.get(at).cloned());
    }
    TableInfo {
        port,
        name: name.to_owned(),
        dataset: "/".to_owned(),
        rows: segments.iter().map(|s| s.rows).sum(),
        columns,
        segments,
        tracks: false,
        record: 8,
        block: BLOCK as usize,
        sort_by: None,
        field: None,
    }
}

/// Fills the sinks, column by column.
///
/// # Errors
/// Cancel, a damaged file, or one that changed since it was looked at.
pub(crate) fn read(
    opened: &Opened,
    table: &TableInfo,
    columns: &[&ColumnInfo],
    sinks: &mut [Sink<'_>],
    run: &dyn Run,
) -> Result<(), Failure> {
    let rows = usize::try_from(table.rows).unwrap_or(usize::MAX);
    let total = (columns.len() * table.segments.len()).max(1);
    let mut done = 0;
    for (sink, column) in sinks.iter_mut().zip(columns) {
        let mut parts = sink.data.parts(rows.max(1), 1);
        let Some(part) = parts.first_mut() else {
            continue;
        };
        let mut first = 0;
        for (index, segment) in table.segments.iter().enumerate() {
            run.progress(done as f64 / total as f64, "reading")?;
            done += 1;
            let count = usize::try_from(segment.rows).unwrap_or(usize::MAX);
            match &column.place {
                Some(Place::Numbers(values)) => {
                    let value = values.get(index).copied().unwrap_or(f64::NAN);
                    let value = value * column.factor.unwrap_or(1.0);
                    if let PartRows::F64(out) = part.rows_mut(first, count) {
                        out.fill(value);
                    }
                    subtract(column.base, part.rows_mut(first, count));
                }
                Some(place @ Place::Dataset { .. }) => {
                    let mut reader = Reader::open(opened, segment, column, place)?;
                    reader.read(run, |at, count, bytes, record| {
                        let block = Block::Records { bytes, record };
                        let out = part.rows_mut(first + at, count);
                        fill(block, &column.leaf, column.factor, out);
                        subtract(column.base, part.rows_mut(first + at, count));
                    })?;
                }
                None => return Err(Failure::internal("a column has no place in the file")),
            }
            first += count;
        }
    }
    Ok(())
}

/// Where a block of no rows starts, and its size, along all axes.
fn slab(rank: usize, axis: usize, lead: &[u64], width: u64) -> (Vec<u64>, Vec<u64>) {
    let size = |k: usize| match k {
        k if k == axis => 0,
        k if k + 1 == rank && axis + 1 != rank => width,
        _ => 1,
    };
    let start = |k: usize| match k {
        k if k == axis => 0,
        k => lead.get(k).copied().unwrap_or(0),
    };
    (
        (0..rank).map(start).collect(),
        (0..rank).map(size).collect(),
    )
}

/// Rows of a dataset that are decoded together.
fn chunk(
    opened: &Opened,
    dataset: &hdf5::Dataset,
    (at, array): (&str, &Array),
    axis: usize,
) -> Result<u64, Failure> {
    let shape = Shape {
        file: &opened.name,
        dataset: at,
        length: opened.length,
        rows: array.shape.iter().product(),
        record: array.number.size(),
    };
    storage::check_array(dataset, &shape, axis)
}

/// One dataset, read in blocks of rows.
struct Reader<'a> {
    opened: &'a Opened,
    dataset: hdf5::Dataset,
    at: String,
    axis: usize,
    start: Vec<u64>,
    count: Vec<u64>,
    rows: u64,
    block: u64,
    record: usize,
}

impl<'a> Reader<'a> {
    fn open(
        opened: &'a Opened,
        segment: &Segment,
        column: &ColumnInfo,
        place: &Place,
    ) -> Result<Reader<'a>, Failure> {
        let Place::Dataset {
            name,
            axis,
            lead,
            width,
        } = place
        else {
            return Err(Failure::internal("a column has no dataset"));
        };
        let at = format!("{}{name}", segment.group);
        let changed = || {
            unsupported(
                format!(
                    "{}, dataset {at}: it differs from the others of its column",
                    opened.name
                ),
                "export the file again",
            )
        };
        let array = array(opened, &at)?.ok_or_else(changed)?;
        let element = array.number.size();
        let leaf = array.leaf("", 0);
        let (start, count) = slab(array.shape.len(), *axis, lead, *width);
        let record = element * usize::try_from(*width).unwrap_or(1);
        let inside = column.leaf.offset + element <= record;
        let same = leaf.stored == column.leaf.stored && array.rows(*axis) == segment.rows;
        if !inside || !same && segment.rows > 0 {
            return Err(changed());
        }
        let dataset = open::dataset(opened, &at)?;
        let chunk = match segment.rows {
            0 => 1,
            _ => chunk(opened, &dataset, (&at, &array), *axis)?,
        };
        let plain = (BLOCK / record.max(1) as u64).max(1);
        let whole = plain.div_ceil(chunk) * chunk;
        let most = (MOST / record.max(1) as u64).max(1);
        Ok(Reader {
            opened,
            dataset,
            at,
            axis: *axis,
            start,
            count,
            rows: segment.rows,
            block: whole.min(most),
            record,
        })
    }

    /// Reads block by block; `visit` takes the first row, their number, their bytes and the bytes
    /// of one.
    fn read(
        &mut self,
        run: &dyn Run,
        mut visit: impl FnMut(usize, usize, &[u8], usize),
    ) -> Result<(), Failure> {
        let mut bytes = Vec::new();
        let mut row = 0;
        while row < self.rows {
            if run.cancelled() {
                return Err(Failure::cancelled());
            }
            let count = self.block.min(self.rows - row);
            let size = usize::try_from(count).unwrap_or(usize::MAX);
            bytes.resize(size.saturating_mul(self.record), 0);
            if let (Some(start), Some(length)) =
                (self.start.get_mut(self.axis), self.count.get_mut(self.axis))
            {
                *start = row;
                *length = count;
            }
            raw::read_slab(&self.dataset, &self.start, &self.count, &mut bytes).map_err(|e| {
                damaged(format!(
                    "{}, dataset {}, is damaged from row {row} on ({})",
                    self.opened.name,
                    self.at,
                    hdf5_reason(&e)
                ))
            })?;
            visit(
                usize::try_from(row).unwrap_or(usize::MAX),
                size,
                &bytes,
                self.record,
            );
            row += count;
        }
        Ok(())
    }
}
