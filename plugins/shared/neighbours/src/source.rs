//! The points as they come, in chunks of rows.

use puncta_sdk::Cancelled;
use puncta_sdk::run::{Run, map};

/// Columns of the input.
pub(crate) struct Source<'a, const D: usize> {
    pub(crate) points: [&'a [f64]; D],
    pub(crate) scale: [f64; D],
}

impl<const D: usize> Source<'_, D> {
    pub(crate) fn rows(&self) -> usize {
        self.points[0].len()
    }

    /// Rows of a chunk.
    pub(crate) fn chunk(&self) -> usize {
        self.rows().div_ceil(64).max(1 << 14)
    }

    pub(crate) fn chunks(&self) -> usize {
        self.rows().div_ceil(self.chunk())
    }

    pub(crate) fn rows_of(&self, chunk: usize) -> std::ops::Range<usize> {
        let begin = chunk * self.chunk();
        begin..self.rows().min(begin + self.chunk())
    }

    /// The scaled point of a row, if it has a place.
    #[inline]
    pub(crate) fn point(&self, row: usize) -> Option<[f64; D]> {
        let point: [f64; D] = std::array::from_fn(|a| self.points[a][row] * self.scale[a]);
        point.iter().all(|x| x.is_finite()).then_some(point)
    }
}

/// Bounding box and number of the points that have a place.
pub(crate) struct Extent<const D: usize> {
    pub(crate) low: [f64; D],
    pub(crate) high: [f64; D],
    pub(crate) count: usize,
}

impl<const D: usize> Extent<D> {
    pub(crate) fn of(source: &Source<D>, run: &dyn Run) -> Result<Self, Cancelled> {
        let none = || Self {
            low: [f64::INFINITY; D],
            high: [f64::NEG_INFINITY; D],
            count: 0,
        };
        let parts = map(run, source.chunks(), &|chunk| {
            let mut part = none();
            if run.cancelled() {
                return part;
            }
            for point in source.rows_of(chunk).filter_map(|row| source.point(row)) {
                for (a, x) in point.into_iter().enumerate() {
                    part.low[a] = part.low[a].min(x);
                    part.high[a] = part.high[a].max(x);
                }
                part.count += 1;
            }
            part
        });
        if run.cancelled() {
            return Err(Cancelled);
        }
        let mut whole = parts.into_iter().fold(none(), |one, two| Self {
            low: std::array::from_fn(|a| one.low[a].min(two.low[a])),
            high: std::array::from_fn(|a| one.high[a].max(two.high[a])),
            count: one.count + two.count,
        });
        if whole.count == 0 {
            (whole.low, whole.high) = ([0.0; D], [0.0; D]);
        }
        Ok(whole)
    }
}
