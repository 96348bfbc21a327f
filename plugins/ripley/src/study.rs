//! What the operations of this plugin share: points, regions and bins of a call.

use crate::bins::Bins;
use crate::flat::Flat;
use crate::polygon::{mask, polygon};
use crate::solid::Solid;
use crate::window::{Cuboid, Window};
use puncta_sdk::ImageInfo;
use puncta_sdk::documents::Read;
use puncta_sdk::job::Job;
use puncta_sdk::prelude::*;
use puncta_sdk::run::map;
use std::borrow::Cow;

/// Most bins of a curve.
const MAX_BINS: f64 = 20_000.0;

/// Ends of the region, as far as the person gives them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Bounds {
    /// Low and high end along each axis, nm.
    pub ends: [[Option<f64>; 2]; 3],
}

impl Bounds {
    fn given(&self) -> bool {
        self.ends.iter().flatten().any(Option::is_some)
    }

    /// Refuses ends in the wrong order.
    ///
    /// # Errors
    /// Naming the parameter.
    pub fn check(&self) -> Result<(), Failure> {
        for (name, ends) in ["x", "y", "z"].into_iter().zip(self.ends) {
            if let Some(end) = ends.into_iter().flatten().find(|end| !end.is_finite()) {
                let message = format!("the region cannot end at {name} = {end} nm");
                return Err(Failure::bad_parameter(&format!("{name}_max"), message));
            }
            if let [Some(low), Some(high)] = ends
                && low >= high
            {
                let message = format!("the region's {name} ends at {high} nm, not above {low} nm");
                return Err(Failure::bad_parameter(&format!("{name}_max"), message));
            }
        }
        Ok(())
    }
}

/// Bins of so many nm up to a radius.
///
/// # Errors
/// When there would be too many, or none.
pub fn bins(step: f64, radius: f64, make: fn(f64, usize) -> Bins) -> Result<Bins, Failure> {
    let count = (radius / step - 1e-9).ceil();
    if !(1.0..=MAX_BINS).contains(&count) {
        let message =
            format!("a largest distance of {radius} nm in steps of {step} nm is {count} steps");
        return Err(Failure::bad_parameter("step", message).remedy(format!(
            "take a step from {} nm up to the largest distance",
            radius / MAX_BINS
        )));
    }
    Ok(make(step, count as usize))
}

/// Adds the mask's pixels to what is read, and refuses flat regions of points in space.
///
/// # Errors
/// When an outline is bound and z is used, or bounds and a region are given.
pub fn plan_region(
    plan: &mut Plan,
    request: &Request,
    bounds: &Bounds,
    z: bool,
) -> Result<(), Failure> {
    bounds.check()?;
    let place = |port: &str| request.inputs.iter().position(|input| input.port == port);
    let (outline, image) = (place("outline"), place("mask"));
    if outline.is_some() && image.is_some() {
        let message = "both an outline and a mask are given";
        return Err(Failure::bad_input(message).remedy("give one of them"));
    }
    if let Some(input) = image {
        plan.read.push(Read {
            input,
            part: 0,
            columns: vec!["value".into()],
        });
    }
    if (outline.is_some() || image.is_some()) && bounds.given() {
        let message = "an outline or a mask is a region by itself";
        return Err(Failure::bad_input(message).remedy("leave out the bounds"));
    }
    if outline.is_some() && z {
        let message = "an outline is a region of the plane";
        return Err(Failure::bad_input(message).remedy("leave out z, or give a mask in space"));
    }
    Ok(())
}

/// The columns of a table that hold positions.
///
/// # Errors
/// When the plan does not name one.
pub fn points<'a, const D: usize>(
    job: &'a Job,
    port: &str,
    z: Option<&Column>,
) -> Result<[Cow<'a, [f64]>; D], Failure> {
    let table = job.input(port)?;
    let names = ["x", "y", z.map_or("z", |z| z.0.as_str())];
    let mut axes: [Cow<'a, [f64]>; D] = std::array::from_fn(|_| Cow::Borrowed(&[][..]));
    for (axis, name) in axes.iter_mut().zip(names) {
        *axis = table.f64(name)?;
    }
    Ok(axes)
}

/// The second table, if it is bound.
///
/// # Errors
/// As [`points`].
pub fn others<'a, const D: usize>(
    job: &'a Job,
    z: Option<&Column>,
) -> Result<Option<[Cow<'a, [f64]>; D]>, Failure> {
    let bound = job.inputs("other").next().is_some();
    bound.then(|| points(job, "other", z)).transpose()
}

/// Low and high end of what is finite in all axes; None without such a row.
#[must_use]
pub fn extent<const D: usize>(
    points: &[Cow<'_, [f64]>; D],
    run: &dyn Run,
) -> Option<[[f64; 2]; D]> {
    const CHUNK: usize = 1 << 16;
    let rows = points[0].len();
    let none = [[f64::INFINITY, f64::NEG_INFINITY]; D];
    let widen = |ends: [[f64; 2]; D], other: [[f64; 2]; D]| {
        std::array::from_fn(|a| [ends[a][0].min(other[a][0]), ends[a][1].max(other[a][1])])
    };
    let parts = map(run, rows.div_ceil(CHUNK), &|chunk| {
        let rows = chunk * CHUNK..rows.min((chunk + 1) * CHUNK);
        rows.filter(|row| points.iter().all(|axis| axis[*row].is_finite()))
            .fold(none, |ends, row| {
                widen(ends, std::array::from_fn(|a| [points[a][row]; 2]))
            })
    });
    let whole = parts.into_iter().fold(none, widen);
    (whole[0][0] <= whole[0][1]).then_some(whole)
}

/// Ends along each axis: given, or those of the points.
fn ends<const D: usize>(
    bounds: &Bounds,
    extent: Option<[[f64; 2]; D]>,
) -> Result<[[f64; 2]; D], Failure> {
    let mut ends = [[0.0; 2]; D];
    for a in 0..D {
        let name = ["x", "y", "z"][a];
        ends[a] = match (bounds.ends[a], extent) {
            ([Some(low), Some(high)], _) => [low, high],
            (_, None) => {
                let message = "no row has a finite position, so that there is no region";
                return Err(Failure::bad_input(message));
            }
            ([low, high], Some(extent)) => {
                [low.unwrap_or(extent[a][0]), high.unwrap_or(extent[a][1])]
            }
        };
        if ends[a][0] >= ends[a][1] {
            let message = format!(
                "the region has no width along {name}: it is from {} to {} nm",
                ends[a][0], ends[a][1]
            );
            let remedy = if a == 2 {
                "leave out z, or give z_min and z_max".into()
            } else {
                format!("give {name}_min and {name}_max")
            };
            return Err(Failure::bad_input(message).remedy(remedy));
        }
    }
    Ok(ends)
}

/// A region and how it was come by.
pub struct Region<W> {
    /// The region.
    pub window: W,
    /// For captions.
    pub origin: &'static str,
}

fn origin(bounds: &Bounds, axes: usize) -> &'static str {
    if bounds.ends.iter().take(axes).flatten().all(Option::is_some) {
        "given bounds"
    } else {
        "bounding box of the localisations"
    }
}

/// The region of the plane: outline, mask, given bounds or the bounding box.
///
/// # Errors
/// When it has no area, or the outline or mask is not one.
pub fn flat(
    job: &Job,
    bounds: &Bounds,
    extent: impl Fn() -> Option<[[f64; 2]; 2]>,
) -> Result<Region<Flat>, Failure> {
    if let Some(outline) = job.inputs("outline").next() {
        let window = polygon(&outline.f64("x")?, &outline.f64("y")?)?;
        return Ok(Region {
            window,
            origin: "outline",
        });
    }
    if let Some(window) = masked(job, mask)? {
        return Ok(Region {
            window,
            origin: "mask",
        });
    }
    let [x, y] = ends(bounds, extent())?;
    Ok(Region {
        window: Flat::rectangle([x[0], y[0]], [x[1], y[1]]),
        origin: origin(bounds, 2),
    })
}

/// The region of a mask in space, if one is bound.
///
/// # Errors
/// When the mask is no volume, or has no voxel above 0.5.
pub fn solid(job: &Job) -> Result<Option<Region<Solid>>, Failure> {
    let window = masked(job, Solid::new)?;
    Ok(window.map(|window| Region {
        window,
        origin: "mask",
    }))
}

/// What the mask is, if one is bound.
fn masked<W>(
    job: &Job,
    region: impl Fn(&ImageInfo, &[f64]) -> Result<W, Failure>,
) -> Result<Option<W>, Failure> {
    let Some(image) = job.inputs("mask").next() else {
        return Ok(None);
    };
    let info = image.header().image.as_ref();
    let info = info.ok_or_else(|| Failure::bad_input("the mask is not an image"))?;
    region(info, &image.f64("value")?).map(Some)
}

/// The region of space: given bounds or the bounding box.
///
/// # Errors
/// When it has no volume.
pub fn cuboid(
    bounds: &Bounds,
    extent: impl Fn() -> Option<[[f64; 2]; 3]>,
) -> Result<Region<Cuboid>, Failure> {
    let ends = ends(bounds, extent())?;
    Ok(Region {
        window: Cuboid {
            low: ends.map(|end| end[0]),
            high: ends.map(|end| end[1]),
        },
        origin: origin(bounds, 3),
    })
}

/// Points of a region, and how many rows are none.
pub struct Members<'a, const D: usize> {
    axes: [Cow<'a, [f64]>; D],
    /// Rows without a finite position.
    pub missing: usize,
    /// Rows outside the region.
    pub outside: usize,
}

impl<const D: usize> Members<'_, D> {
    /// One slice an axis.
    #[must_use]
    pub fn axes(&self) -> [&[f64]; D] {
        self.axes.each_ref().map(|axis| &**axis)
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.axes[0].len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The points that lie in a region, in the order of their rows.
///
/// # Errors
/// When cancelled.
#[allow(clippy::needless_range_loop)]
pub fn members<'a, const D: usize>(
    points: [Cow<'a, [f64]>; D],
    window: &dyn Window<D>,
    run: &dyn Run,
) -> Result<Members<'a, D>, Failure> {
    const CHUNK: usize = 1 << 15;
    let rows = points[0].len();
    let parts = map(run, rows.div_ceil(CHUNK), &|chunk| {
        let mut found: [Vec<f64>; D] = std::array::from_fn(|_| Vec::new());
        let mut missing = 0;
        if run.cancelled() {
            return (found, missing);
        }
        for row in chunk * CHUNK..rows.min((chunk + 1) * CHUNK) {
            let point: [f64; D] = std::array::from_fn(|a| points[a][row]);
            if point.iter().any(|x| !x.is_finite()) {
                missing += 1;
            } else if window.holds(&point) {
                found
                    .iter_mut()
                    .zip(point)
                    .for_each(|(axis, x)| axis.push(x));
            }
        }
        (found, missing)
    });
    if run.cancelled() {
        return Err(Failure::cancelled());
    }
    let missing = parts.iter().map(|part| part.1).sum();
    let count: usize = parts.iter().map(|part| part.0[0].len()).sum();
    let axes = if count == rows {
        points
    } else {
        std::array::from_fn(|a| {
            Cow::Owned(
                parts
                    .iter()
                    .flat_map(|part| part.0[a].iter().copied())
                    .collect(),
            )
        })
    };
    Ok(Members {
        axes,
        missing,
        outside: rows - missing - count,
    })
}

/// Tells the person what was left out.
pub fn tell(job: &Job, port: &str, missing: usize, outside: usize) {
    if missing > 0 {
        job.warn(&format!(
            "{missing} rows of {port} have no finite position and are left out"
        ));
    }
    if outside > 0 {
        job.log(&format!(
            "{outside} rows of {port} lie outside the region and are left out"
        ));
    }
}

/// Adds a number with its meaning.
pub fn say(report: &mut Report, name: &str, value: f64, unit: &str, text: &str) {
    report.number(name, value, unit).description = Some(text.into());
}

/// A new table of f64 columns.
///
/// # Errors
/// When the host has no room.
pub fn table(job: &Job, port: &str, columns: &[(&str, &str, &str, &[f64])]) -> Result<(), Failure> {
    let rows = columns.first().map_or(0, |column| column.3.len());
    let infos = columns.iter().map(|(name, unit, text, _)| {
        ColumnInfo::new(*name, Element::F64, *unit).description(*text)
    });
    let mut out = job.begin(port, Header::table(port, rows as u64, infos.collect()))?;
    out.commit(0, rows as u64)?;
    for (name, _, _, values) in columns {
        out.f64_mut(name)?.copy_from_slice(values);
    }
    out.finish()
}
