//! Localisations in the order of their frames.

use puncta_sdk::run::{chunks_mut, map};
use puncta_sdk::{Cancelled, Run};
use std::borrow::Cow;

/// Rows of a task.
const CHUNK: usize = 1 << 15;

/// How far apart two localisations of a molecule may lie along some axes.
#[derive(Clone, Copy, Debug)]
pub enum Radius<'a> {
    /// The same for all.
    Constant(f64),
    /// A factor times the root of the sum of the squares of both localisations' values.
    Combined {
        /// Standard deviation of each row, nm.
        sigma: &'a [f64],
        /// The factor.
        scale: f64,
    },
}

impl Radius<'_> {
    /// The row's share of the square of the radius: those of both localisations add up to it.
    #[must_use]
    pub fn share(&self, row: usize) -> f64 {
        match self {
            Radius::Constant(radius) => radius * radius * 0.5,
            Radius::Combined { sigma, scale } => {
                let reach = scale * sigma[row];
                if reach < 0.0 { f64::NAN } else { reach * reach }
            }
        }
    }
}

/// Columns of a table of localisations.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// Positions, nm.
    pub x: &'a [f64],
    /// Positions, nm.
    pub y: &'a [f64],
    /// Frame numbers, rounded to whole ones.
    pub t: &'a [f64],
    /// Radius in the plane.
    pub radius: Radius<'a>,
    /// Positions and radius along z; the plane alone decides if absent.
    pub axial: Option<(&'a [f64], Radius<'a>)>,
}

/// Localisations by frame, then row; those that cannot be placed are left out.
#[derive(Debug)]
pub struct Spots<'a> {
    /// Row of each, if they differ from 0, 1, 2...
    pub order: Option<Vec<u32>>,
    /// Frame of each.
    pub frames: Vec<i64>,
    /// Position in the plane.
    pub x: Cow<'a, [f64]>,
    /// Position in the plane.
    pub y: Cow<'a, [f64]>,
    /// Share of the square of the radius in the plane.
    pub share: Vec<f64>,
    /// Position and share along z.
    pub axial: Option<(Cow<'a, [f64]>, Vec<f64>)>,
}

impl Spots<'_> {
    /// The row of the localisation at this place.
    #[must_use]
    pub fn row(&self, place: usize) -> usize {
        self.order
            .as_ref()
            .map_or(place, |order| order[place] as usize)
    }

    /// Square of the distance between two localisations in units of their radius; at most 1 where
    /// they may be one molecule.
    #[inline]
    #[must_use]
    pub fn distance(&self, a: usize, b: usize) -> f64 {
        let (dx, dy) = (self.x[a] - self.x[b], self.y[a] - self.y[b]);
        let plane = in_units(dx * dx + dy * dy, self.share[a] + self.share[b]);
        match &self.axial {
            None => plane,
            Some((z, share)) => {
                let dz = z[a] - z[b];
                plane + in_units(dz * dz, share[a] + share[b])
            }
        }
    }
}

/// Coincident localisations are at distance 0, even if their radius is 0.
#[inline]
fn in_units(square: f64, limit: f64) -> f64 {
    if square == 0.0 { 0.0 } else { square / limit }
}

/// Sorts the rows by frame.
///
/// # Errors
/// When cancelled.
pub fn spots<'a>(rows: &Rows<'a>, run: &dyn Run) -> Result<Spots<'a>, Cancelled> {
    run.progress(0.0, "sorting by frame")?;
    let count = rows.x.len();
    let order = order(rows, run);
    if run.cancelled() {
        return Err(Cancelled);
    }
    let len = order.as_ref().map_or(count, Vec::len);
    let row = |place: usize| order.as_ref().map_or(place, |order| order[place] as usize);
    let shares = |radius: Radius<'_>| fill(len, run, &|place| radius.share(row(place)));
    let gather = |values: &'a [f64]| match &order {
        None => Cow::Borrowed(values),
        Some(_) => Cow::Owned(fill(len, run, &|place| values[row(place)])),
    };
    let spots = Spots {
        frames: fill(len, run, &|place| frame(rows.t[row(place)])),
        x: gather(rows.x),
        y: gather(rows.y),
        share: shares(rows.radius),
        axial: rows.axial.map(|(z, radius)| (gather(z), shares(radius))),
        order: None,
    };
    if run.cancelled() {
        return Err(Cancelled);
    }
    Ok(Spots { order, ..spots })
}

/// The nearest whole number; saturates.
#[inline]
#[allow(clippy::cast_possible_truncation, clippy::float_cmp)]
fn frame(t: f64) -> i64 {
    let whole = t as i64;
    if whole as f64 == t {
        whole
    } else {
        t.round() as i64
    }
}

fn fill<T: Send + Default + Clone>(
    len: usize,
    run: &dyn Run,
    value: &(dyn Fn(usize) -> T + Sync),
) -> Vec<T> {
    let mut out = vec![T::default(); len];
    chunks_mut(run, &mut out, CHUNK, &|chunk, part| {
        for (i, slot) in part.iter_mut().enumerate() {
            *slot = value(chunk * CHUNK + i);
        }
    });
    out
}

/// Whether a row has a position, a frame and a radius.
fn placed(rows: &Rows<'_>, row: usize) -> bool {
    let axial = rows
        .axial
        .is_none_or(|(z, radius)| z[row].is_finite() && radius.share(row).is_finite());
    rows.x[row].is_finite()
        && rows.y[row].is_finite()
        && rows.t[row].is_finite()
        && rows.radius.share(row).is_finite()
        && axial
}

/// The rows by frame, then row; None if that is all of them as they are.
fn order(rows: &Rows<'_>, run: &dyn Run) -> Option<Vec<u32>> {
    let count = rows.x.len();
    let plain = map(run, count.div_ceil(CHUNK), &|chunk| {
        let from = chunk * CHUNK;
        let to = count.min(from + CHUNK);
        let sorted = |row: usize| row == 0 || rows.t[row - 1] <= rows.t[row];
        (from..to).all(|row| placed(rows, row) && sorted(row))
    });
    if plain.into_iter().all(|one| one) {
        return None;
    }
    let mut order: Vec<u32> = Vec::with_capacity(count);
    #[allow(clippy::cast_possible_truncation)]
    order.extend(
        (0..count)
            .filter(|row| placed(rows, *row))
            .map(|row| row as u32),
    );
    // Stable, so that rows of a frame keep their order; fast on pieces that are sorted already.
    order.sort_by_key(|row| frame(rows.t[*row as usize]));
    Some(order)
}
