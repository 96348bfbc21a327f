//! The pixels of an image of any type.

use puncta_sdk::documents::Read;
use puncta_sdk::input::ColumnRef;
use puncta_sdk::prelude::*;
use puncta_sdk::{Input, run};

/// Pixels looked at by one task.
const CHUNK: usize = 1 << 20;

/// A type of number that an image may hold.
pub(crate) trait Pixel: Copy + Sync + 'static {
    /// As f64, exactly.
    fn wide(self) -> f64;
}

macro_rules! pixels {
    ($($type:ty),*) => {
        $(impl Pixel for $type {
            #[inline(always)]
            fn wide(self) -> f64 {
                self.into()
            }
        })*
    };
}
pixels!(u8, u16, i32, u32, f32, f64);

/// The pixels of an image: axes t c z y x, x fastest.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Pixels<'a> {
    U8(&'a [u8]),
    U16(&'a [u16]),
    I32(&'a [i32]),
    U32(&'a [u32]),
    F32(&'a [f32]),
    F64(&'a [f64]),
}

/// Calls an expression with the slice of whatever type there is.
macro_rules! each_type {
    ($pixels:expr, $values:ident => $body:expr) => {
        match $pixels {
            $crate::pixels::Pixels::U8($values) => $body,
            $crate::pixels::Pixels::U16($values) => $body,
            $crate::pixels::Pixels::I32($values) => $body,
            $crate::pixels::Pixels::U32($values) => $body,
            $crate::pixels::Pixels::F32($values) => $body,
            $crate::pixels::Pixels::F64($values) => $body,
        }
    };
}
pub(crate) use each_type;

/// What the values of an image are like. NaN and infinite ones are left out of `min` and `max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Summary {
    /// Smallest value; infinite when there is none.
    pub(crate) min: f64,
    /// Largest value; minus infinite when there is none.
    pub(crate) max: f64,
    /// Whether all values are whole numbers.
    pub(crate) whole: bool,
    /// Values that are NaN or infinite.
    pub(crate) not_finite: u64,
}

impl<'a> Pixels<'a> {
    /// The pixels of an input, as many as its header says.
    pub(crate) fn of(input: &Input<'a>) -> Result<Self, Failure> {
        let name = &input.header().name;
        let info = image_info(input.header())?;
        let pixels = match input.column(0, &value_column(input.header())?)? {
            ColumnRef::U8(v) | ColumnRef::Bool(v) => Pixels::U8(v),
            ColumnRef::U16(v) => Pixels::U16(v),
            ColumnRef::I32(v) => Pixels::I32(v),
            ColumnRef::U32(v) => Pixels::U32(v),
            ColumnRef::F32(v) => Pixels::F32(v),
            ColumnRef::F64(v) => Pixels::F64(v),
            _ => {
                let message = format!("the pixels of {name} have a type that no image has");
                return Err(Failure::bad_input(message));
            }
        };
        if pixels.len() == 0 || info.voxels() != Some(pixels.len() as u64) {
            let [t, c, z, y, x] = info.size;
            let message = format!(
                "image {name} has {} values for {t} x {c} x {z} x {y} x {x} pixels",
                pixels.len()
            );
            return Err(Failure::bad_input(message).remedy("an image file needs one per pixel"));
        }
        Ok(pixels)
    }

    /// Number of pixels.
    pub(crate) fn len(&self) -> usize {
        each_type!(self, v => v.len())
    }

    /// The pixels `from..from + count`.
    pub(crate) fn part(&self, from: usize, count: usize) -> Self {
        let range = from..from + count;
        match self {
            Pixels::U8(v) => Pixels::U8(&v[range]),
            Pixels::U16(v) => Pixels::U16(&v[range]),
            Pixels::I32(v) => Pixels::I32(&v[range]),
            Pixels::U32(v) => Pixels::U32(&v[range]),
            Pixels::F32(v) => Pixels::F32(&v[range]),
            Pixels::F64(v) => Pixels::F64(&v[range]),
        }
    }

    /// Smallest and largest value, and whether all are whole.
    pub(crate) fn summary(&self, run: &dyn Run) -> Result<Summary, Failure> {
        let parts = run::map(run, self.len().div_ceil(CHUNK), &|i| {
            let part = self.part(i * CHUNK, CHUNK.min(self.len() - i * CHUNK));
            if run.cancelled() {
                Summary::EMPTY
            } else {
                each_type!(part, v => Summary::of(v))
            }
        });
        if run.cancelled() {
            return Err(Failure::cancelled());
        }
        Ok(parts.into_iter().fold(Summary::EMPTY, Summary::and))
    }
}

impl Summary {
    const EMPTY: Summary = Summary {
        min: f64::INFINITY,
        max: f64::NEG_INFINITY,
        whole: true,
        not_finite: 0,
    };

    fn of<T: Pixel>(values: &[T]) -> Summary {
        let mut s = Summary::EMPTY;
        for v in values {
            let v = v.wide();
            if v.is_finite() {
                s.min = if v < s.min { v } else { s.min };
                s.max = if v > s.max { v } else { s.max };
                s.whole = s.whole && v == v.trunc();
            } else {
                s.not_finite += 1;
                s.whole = false;
            }
        }
        s
    }

    fn and(self, other: Summary) -> Summary {
        Summary {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            whole: self.whole && other.whole,
            not_finite: self.not_finite + other.not_finite,
        }
    }
}

/// Name of the column that holds the pixels.
fn value_column(header: &Header) -> Result<String, Failure> {
    let column = header.parts.first().and_then(|part| part.columns.first());
    let missing = || Failure::bad_input(format!("image {} has no pixels", header.name));
    column.map(|column| column.name.clone()).ok_or_else(missing)
}

/// The grid of an input image.
pub(crate) fn image_info(header: &Header) -> Result<&ImageInfo, Failure> {
    let missing = || Failure::bad_input(format!("{} is no image: it has no grid", header.name));
    header.image.as_ref().ok_or_else(missing)
}

/// The plan that reads the pixels of the only input.
pub(crate) fn plan(request: &Request, memory: u64) -> Result<Plan, Failure> {
    let mut plan = Plan {
        interruptible: true,
        memory,
        ..Plan::default()
    };
    if let Some(input) = request.inputs.first() {
        image_info(&input.header)?;
        let columns = vec![value_column(&input.header)?];
        plan.read.push(Read {
            input: 0,
            part: 0,
            columns,
        });
    }
    Ok(plan)
}
