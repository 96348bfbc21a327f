//! From two halves to ring sums.

use crate::curve::Sums;
use crate::grid::{Axis, Grid, extent};
use crate::points::{Points, Positions};
use crate::split::Units;
use crate::window::Window;
use puncta_sdk::prelude::*;
use puncta_sdk::run::Cancelled;
use puncta_shared_fourier::{Complex, RealFft, Rings, good_size};

/// Transform, window and rings of a size.
pub(crate) struct Setup {
    pub(crate) plan: RealFft<f32>,
    pub(crate) window: Window,
    pub(crate) rings: Rings,
    /// Share of the frequencies that are independent.
    pub(crate) independent: f64,
}

impl Setup {
    /// For an image of `size` voxels of `voxel` nm (z, y, x); zeros fill it up to a size that is
    /// transformed fast.
    pub(crate) fn new(size: [usize; 3], voxel: [f64; 3], taper: f64) -> Setup {
        let padded = size.map(|n| if n > 1 { good_size(n) } else { 1 });
        let window = Window::new(size, taper);
        Setup {
            plan: RealFft::new(padded),
            rings: Rings::new(padded, voxel),
            independent: window.independent(padded.iter().product()),
            window,
        }
    }

    /// Ring sums of two spectra, and the number of frequencies of each ring.
    pub(crate) fn sums(
        &self,
        run: &dyn Run,
        a: &[Complex<f32>],
        b: &[Complex<f32>],
    ) -> Result<(Sums, Vec<f64>), Cancelled> {
        self.rings.sum(run, &|i| terms(a[i], b[i]))
    }

    /// Ring sums of a half and the rest of the whole: the transform is linear.
    fn sums_of_rest(
        &self,
        run: &dyn Run,
        all: &[Complex<f32>],
        a: &[Complex<f32>],
    ) -> Result<(Sums, Vec<f64>), Cancelled> {
        self.rings.sum(run, &|i| terms(a[i], all[i] - a[i]))
    }
}

#[inline]
fn terms(a: Complex<f32>, b: Complex<f32>) -> [f64; 3] {
    let [ar, ai, br, bi] = [a.re, a.im, b.re, b.im].map(f64::from);
    [ar * br + ai * bi, ar * ar + ai * ai, br * br + bi * bi]
}

/// What the splits of tables gave.
pub(crate) struct Splits {
    pub(crate) sums: Vec<Sums>,
    pub(crate) frequencies: Vec<f64>,
    /// Localisations of the halves, of the first split.
    pub(crate) rows: [usize; 2],
    pub(crate) outside: u64,
    pub(crate) invalid: u64,
}

/// The field over all tables.
pub(crate) fn field(
    run: &dyn Run,
    axes: [Axis<'_>; 3],
    tables: &[Positions<'_>],
    memory: Option<u64>,
) -> Result<Grid, Failure> {
    let extents = puncta_sdk::run::map(run, 3, &|axis| {
        let each = tables.iter().filter_map(|at| extent(at[axis]));
        each.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    });
    let extents = std::array::from_fn(|axis| extents.get(axis).copied().flatten());
    Grid::new(axes, extents, memory)
}

/// Splits one table so many times.
pub(crate) fn split(
    run: &dyn Run,
    setup: &Setup,
    points: &Points,
    units: &Units,
    repeats: u64,
    seed: u64,
) -> Result<Splits, Failure> {
    let all = points.spectrum(run, &setup.plan, &setup.window, &|_| true)?;
    let repeats = if units.is_random() { repeats.max(1) } else { 1 };
    let mut splits = Splits {
        sums: Vec::new(),
        frequencies: Vec::new(),
        rows: [0; 2],
        outside: points.outside,
        invalid: points.invalid,
    };
    for repeat in 0..repeats {
        let half = units.first_half(seed, repeat);
        let chosen = |unit: u32| half.has(unit);
        let first = points.count(&chosen);
        let rows = [first, points.total() - first];
        check(rows)?;
        if repeat == 0 {
            splits.rows = rows;
        }
        let a = points.spectrum(run, &setup.plan, &setup.window, &chosen)?;
        let (sums, frequencies) = setup.sums_of_rest(run, &all, &a)?;
        splits.sums.push(sums);
        splits.frequencies = frequencies;
        run.progress(
            (repeat + 1) as f64 / repeats as f64,
            "correlating the halves",
        )?;
    }
    Ok(splits)
}

/// Takes two tables as the halves.
pub(crate) fn pair(run: &dyn Run, setup: &Setup, halves: [&Points; 2]) -> Result<Splits, Failure> {
    let [a, b] = halves;
    check([a.total(), b.total()])?;
    let first = a.spectrum(run, &setup.plan, &setup.window, &|_| true)?;
    run.progress(0.5, "correlating the halves")?;
    let second = b.spectrum(run, &setup.plan, &setup.window, &|_| true)?;
    let (sums, frequencies) = setup.sums(run, &first, &second)?;
    Ok(Splits {
        sums: vec![sums],
        frequencies,
        rows: [a.total(), b.total()],
        outside: a.outside + b.outside,
        invalid: a.invalid + b.invalid,
    })
}

fn check([a, b]: [usize; 2]) -> Result<(), Failure> {
    if a > 0 && b > 0 {
        return Ok(());
    }
    let message = format!("the halves have {a} and {b} localisations in the field");
    Err(Failure::bad_input(message)
        .remedy("give more localisations, another split or a larger field"))
}

/// Unit of a column, refused unless it is one of `units`.
pub(crate) fn unit_is(header: &Header, column: &str, units: &[&str]) -> Result<(), Failure> {
    let Some(info) = header.column(column) else {
        return Err(Failure::bad_input(format!(
            "there is no column {column} in {}",
            header.name
        )));
    };
    if units.contains(&info.unit.as_str()) {
        return Ok(());
    }
    let message = format!(
        "column {column} of {} is in {}, not in {}",
        header.name, info.unit, units[0]
    );
    Err(Failure::bad_input(message).remedy("give the column its unit first"))
}

/// Adds columns to those that the plan reads from an input.
pub(crate) fn read_more(plan: &mut Plan, input: usize, columns: &[&str]) {
    if let Some(read) = plan.read.iter_mut().find(|read| read.input == input) {
        for column in columns {
            if !read.columns.iter().any(|known| known == column) {
                read.columns.push((*column).into());
            }
        }
    }
}
