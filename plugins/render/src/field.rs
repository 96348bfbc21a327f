//! The field of view of an image: its two axes, and the refusal of one that is too large.

use crate::grid::Axis;
use puncta_sdk::{Cancelled, Failure, FailureCode, Run};
use std::sync::Mutex;

/// Memory that an image may take, in bytes, unless the host says otherwise.
pub const IMAGE_BYTES: u64 = 8 << 30;

/// Rows that one task takes.
const CHUNK: usize = 1 << 16;

/// Smallest and largest finite value of a column; None when it has none.
pub type Extent = Option<(f64, f64)>;

/// The grid of a 2D image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Columns of pixels.
    pub x: Axis,
    /// Rows of pixels.
    pub y: Axis,
}

impl Field {
    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.x.count().saturating_mul(self.y.count())
    }
}

/// The grid of a 3D image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Volume {
    /// Each of its slices.
    pub plane: Field,
    /// Slices.
    pub z: Axis,
}

impl Volume {
    /// Number of voxels.
    pub fn voxels(&self) -> usize {
        self.plane.pixels().saturating_mul(self.z.count())
    }
}

/// The field of view that the person asks for: low and high edges in nm. A bound that is None comes
/// from the data.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Bounds {
    /// Edges in x.
    pub x: [Option<f64>; 2],
    /// Edges in y.
    pub y: [Option<f64>; 2],
    /// Edges in z; without meaning for a plane.
    pub z: [Option<f64>; 2],
    /// Added on each side that comes from the data.
    pub margin: f64,
}

/// What an image may take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Room {
    /// Bytes of the image.
    pub budget: u64,
    /// Bytes of a pixel with all its channels.
    pub pixel_bytes: u64,
}

impl Room {
    /// Most pixels of a channel.
    fn pixels(&self) -> f64 {
        (self.budget / self.pixel_bytes.max(1)).min(u64::from(u32::MAX)) as f64
    }
}

/// The smallest and largest finite values of `values`.
pub fn extent(values: &[f64], run: &dyn Run) -> Result<Extent, Cancelled> {
    let chunks: Vec<&[f64]> = values.chunks(CHUNK).collect();
    let total = Mutex::new((f64::INFINITY, f64::NEG_INFINITY));
    run.parallel(chunks.len(), &|i| {
        if run.cancelled() {
            return;
        }
        let (low, high) = extent_of(chunks[i]);
        if let Ok(mut t) = total.lock() {
            *t = (t.0.min(low), t.1.max(high));
        }
    });
    if run.cancelled() {
        return Err(Cancelled);
    }
    let (low, high) = total
        .into_inner()
        .unwrap_or((f64::INFINITY, f64::NEG_INFINITY));
    Ok((low <= high).then_some((low, high)))
}

/// Eight lanes, so that the compiler uses vector registers.
fn extent_of(values: &[f64]) -> (f64, f64) {
    let (mut low, mut high) = ([f64::INFINITY; 8], [f64::NEG_INFINITY; 8]);
    let mut blocks = values.chunks_exact(8);
    for block in &mut blocks {
        for ((v, l), h) in block.iter().zip(&mut low).zip(&mut high) {
            let (a, b) = finite_or_empty(*v);
            *l = if a < *l { a } else { *l };
            *h = if b > *h { b } else { *h };
        }
    }
    for v in blocks.remainder() {
        let (a, b) = finite_or_empty(*v);
        low[0] = low[0].min(a);
        high[0] = high[0].max(b);
    }
    (
        low.into_iter().fold(f64::INFINITY, f64::min),
        high.into_iter().fold(f64::NEG_INFINITY, f64::max),
    )
}

#[inline(always)]
fn finite_or_empty(v: f64) -> (f64, f64) {
    // False for NaN too.
    if v.abs() < f64::INFINITY {
        (v, v)
    } else {
        (f64::INFINITY, f64::NEG_INFINITY)
    }
}

/// The grid for `bounds`, with what they leave open taken from the extents of the positions.
///
/// An axis with both bounds open lies on the absolute grid of multiples of `pixel_size`; one with a
/// low bound starts exactly there.
///
/// # Errors
/// When the pixel size or a bound cannot be used, when there is no finite position to take a bound
/// from, and when the image would exceed the room (it names the pixel size that would fit).
pub fn field(
    bounds: &Bounds,
    pixel_size: f64,
    [x, y]: [Extent; 2],
    room: &Room,
) -> Result<Field, Failure> {
    let field = plane(bounds, pixel_size, [x, y])?;
    if field.x.count() as f64 * field.y.count() as f64 > room.pixels() {
        return Err(too_large(&[&field.y, &field.x], room));
    }
    Ok(field)
}

/// As [`field`], for voxels of `pixel_size` in x and y and `voxel_z` in z.
///
/// # Errors
/// As [`field`].
pub fn volume(
    bounds: &Bounds,
    pixel_size: f64,
    voxel_z: f64,
    [x, y, z]: [Extent; 3],
    room: &Room,
) -> Result<Volume, Failure> {
    let plane = plane(bounds, pixel_size, [x, y])?;
    positive("voxel_z", voxel_z)?;
    let z = axis("z", bounds.z, z, voxel_z, bounds.margin)?;
    let volume = Volume { plane, z };
    if plane.x.count() as f64 * plane.y.count() as f64 * z.count() as f64 > room.pixels() {
        return Err(too_large(&[&z, &plane.y, &plane.x], room));
    }
    Ok(volume)
}

fn positive(name: &str, size: f64) -> Result<(), Failure> {
    if size > 0.0 && size.is_finite() {
        return Ok(());
    }
    let what = if name == "voxel_z" {
        "voxel size in z"
    } else {
        "pixel size"
    };
    let message = format!("the {what} is {size} nm");
    Err(Failure::bad_parameter(name, message).remedy("give a positive number of nm"))
}

fn plane(bounds: &Bounds, pixel_size: f64, [x, y]: [Extent; 2]) -> Result<Field, Failure> {
    positive("pixel_size", pixel_size)?;
    let margin = bounds.margin;
    if !(margin >= 0.0 && margin.is_finite()) {
        let message = format!("the margin is {margin} nm");
        return Err(Failure::bad_parameter("margin", message)
            .remedy("give zero or a positive number of nm"));
    }
    Ok(Field {
        x: axis("x", bounds.x, x, pixel_size, margin)?,
        y: axis("y", bounds.y, y, pixel_size, margin)?,
    })
}

fn axis(
    name: &str,
    [min, max]: [Option<f64>; 2],
    extent: Extent,
    size: f64,
    margin: f64,
) -> Result<Axis, Failure> {
    for (end, bound) in [("min", min), ("max", max)] {
        if let Some(bound) = bound.filter(|b| !b.is_finite()) {
            let message = format!("the bound {name}_{end} is {bound} nm");
            return Err(Failure::bad_parameter(&format!("{name}_{end}"), message)
                .remedy("give a number of nm or leave it out"));
        }
    }
    let missing = || {
        Failure::bad_input(format!(
            "no row has a finite {name}, so that the data give no field of view"
        ))
        .remedy(format!("give {name}_min and {name}_max"))
    };
    let low = min.or(extent.map(|e| e.0 - margin)).ok_or_else(missing)?;
    let high = max.or(extent.map(|e| e.1 + margin)).ok_or_else(missing)?;
    if high < low || (max.is_some() && high <= low) {
        let message = format!(
            "the field of view ends in {name} at {high} nm, not above its start at {low} nm"
        );
        let end = if max.is_some() { "max" } else { "min" };
        return Err(Failure::bad_parameter(&format!("{name}_{end}"), message)
            .remedy(format!("change {name}_min or {name}_max")));
    }
    let axis = match (min, max) {
        (None, None) => Axis::covering(low, high, size),
        (None, Some(_)) => {
            Axis::covering(low, low, size).and_then(|a| Axis::between(a.origin(), high, size))
        }
        (Some(_), Some(_)) => Axis::between(low, high, size),
        (Some(_), None) => Axis::reaching(low, high, size),
    };
    axis.ok_or_else(|| {
        let message = format!(
            "the field of view from {low} to {high} nm in {name} has more pixels of {size} nm than \
             can be numbered"
        );
        let parameter = if name == "z" { "voxel_z" } else { "pixel_size" };
        Failure::bad_parameter(parameter, message).remedy("use larger pixels or give closer bounds")
    })
}

/// Refuses an image of these axes (z first, x last) with the sizes that would fit.
fn too_large(axes: &[&Axis], room: &Room) -> Failure {
    let gib = |b: f64| b / f64::from(1 << 30);
    // Two more pixels per axis, since the low corner moves to a multiple of the new size.
    let count = |axis: &Axis, by: f64| (axis.count() as f64 / by).ceil() + 2.0;
    let fits = |by: f64| axes.iter().map(|axis| count(axis, by)).product::<f64>() <= room.pixels();
    let pixels: f64 = axes.iter().map(|axis| axis.count() as f64).product();
    let mut by = (pixels / room.pixels())
        .powf(1.0 / axes.len() as f64)
        .max(1.0);
    let mut steps = 0;
    while !fits(by) && steps < 5000 {
        by *= 1.01;
        steps += 1;
    }
    let round = |fit: f64| {
        let scale = 10_f64.powf(fit.log10().floor() - 2.0);
        let fit = format!("{:.6}", (fit / scale).ceil() * scale);
        fit.trim_end_matches('0').trim_end_matches('.').to_owned()
    };
    let counts: Vec<String> = axes
        .iter()
        .rev()
        .map(|axis| axis.count().to_string())
        .collect();
    let sizes = match axes {
        [z, _, x] => format!(
            "a pixel size of {} nm and a voxel size in z of {} nm or more",
            round(x.size() * by),
            round(z.size() * by)
        ),
        _ => format!("a pixel size of {} nm or more", round(axes[0].size() * by)),
    };
    Failure::new(
        FailureCode::Resources,
        format!(
            "the image would have {} pixels ({:.1} GiB) and the limit is {:.1} GiB",
            counts.join(" x "),
            gib(pixels * room.pixel_bytes as f64),
            gib(room.budget as f64)
        ),
    )
    .parameter("pixel_size")
    .remedy(format!(
        "use {sizes}, or give bounds for a smaller field of view"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::ROOM;
    use puncta_testkit::Threads;

    fn auto(margin: f64) -> Bounds {
        Bounds {
            margin,
            ..Bounds::default()
        }
    }

    #[test]
    fn the_extent_skips_what_is_not_finite() {
        let mut v: Vec<f64> = (0..200_000).map(|i| f64::from(i % 1000) - 17.5).collect();
        v[3] = f64::NAN;
        v[199_999] = f64::INFINITY;
        v[70_000] = f64::NEG_INFINITY;
        for threads in [1, 2] {
            assert_eq!(extent(&v, &Threads(threads)), Ok(Some((-17.5, 981.5))));
        }
        assert_eq!(extent(&[f64::NAN, f64::INFINITY], &Threads(2)), Ok(None));
        assert_eq!(extent(&[], &Threads(2)), Ok(None));
        assert_eq!(extent(&[4.0], &Threads(2)), Ok(Some((4.0, 4.0))));
    }

    #[test]
    fn open_bounds_come_from_the_data() {
        let f = field(
            &auto(0.0),
            10.0,
            [Some((12.0, 58.0)), Some((-3.0, -3.0))],
            &ROOM,
        )
        .unwrap();
        assert_eq!(
            (f.x.origin(), f.x.count(), f.y.origin(), f.y.count()),
            (10.0, 5, -10.0, 1)
        );
        let b = Bounds {
            x: [Some(3.0), None],
            ..Bounds::default()
        };
        let f = field(&b, 10.0, [Some((12.0, 53.0)), Some((0.0, 5.0))], &ROOM).unwrap();
        assert_eq!((f.x.origin(), f.x.count()), (3.0, 6));
        let b = Bounds {
            x: [None, Some(40.0)],
            margin: 5.0,
            ..Bounds::default()
        };
        let f = field(&b, 10.0, [Some((12.0, 53.0)), Some((0.0, 5.0))], &ROOM).unwrap();
        assert_eq!((f.x.origin(), f.x.count()), (0.0, 4));
        assert_eq!((f.y.origin(), f.y.count()), (-10.0, 3));
    }

    #[test]
    fn a_bound_below_all_data_is_refused() {
        let b = Bounds {
            x: [None, Some(4.0)],
            ..Bounds::default()
        };
        let e = field(&b, 10.0, [Some((12.0, 53.0)), Some((0.0, 5.0))], &ROOM).unwrap_err();
        assert_eq!(e.parameter.as_deref(), Some("x_max"), "{e}");
        let e = field(&auto(0.0), 10.0, [None, Some((0.0, 5.0))], &ROOM).unwrap_err();
        assert!(e.to_string().contains("finite x"), "{e}");
        for size in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(
                field(
                    &auto(0.0),
                    size,
                    [Some((0.0, 1.0)), Some((0.0, 1.0))],
                    &ROOM
                )
                .is_err()
            );
        }
        let b = Bounds {
            y: [None, Some(f64::NAN)],
            ..Bounds::default()
        };
        assert!(field(&b, 1.0, [Some((0.0, 1.0)), Some((0.0, 1.0))], &ROOM).is_err());
    }

    #[test]
    fn the_named_pixel_size_fits() {
        for (wide, high) in [(1e6, 1e6), (4e7, 10.0), (123_456.0, 98.0), (1e11, 1e3)] {
            let (x, y) = (Some((0.5, wide)), Some((-high, 0.25)));
            let room = Room {
                budget: 1 << 24,
                pixel_bytes: 4,
            };
            let e = field(&auto(0.0), 0.5, [x, y], &room).unwrap_err();
            let e = e.to_string();
            let size: f64 = e
                .split("pixel size of ")
                .nth(1)
                .unwrap()
                .split(' ')
                .next()
                .unwrap()
                .parse()
                .unwrap();
            assert!(field(&auto(0.0), size, [x, y], &room).is_ok(), "{e}");
            // Not much too coarse either, where both sides have many pixels.
            if high > 90.0 && wide < 1e9 {
                assert!(field(&auto(0.0), size * 0.9, [x, y], &room).is_err(), "{e}");
            }
        }
    }

    #[test]
    fn a_volume_has_the_planes_grid_and_the_named_sizes_fit() {
        let (x, y, z) = (
            Some((12.0, 58.0)),
            Some((-3.0, -3.0)),
            Some((-260.0, 240.0)),
        );
        let v = volume(&auto(0.0), 10.0, 50.0, [x, y, z], &ROOM).unwrap();
        assert_eq!(v.plane, field(&auto(0.0), 10.0, [x, y], &ROOM).unwrap());
        assert_eq!((v.z.origin(), v.z.count(), v.voxels()), (-300.0, 11, 55));
        let room = Room {
            budget: 1 << 22,
            pixel_bytes: 8,
        };
        let wide = [Some((0.0, 1e5)), Some((0.0, 3e4)), z];
        let e = volume(&auto(0.0), 10.0, 20.0, wide, &room)
            .unwrap_err()
            .to_string();
        let sizes: Vec<f64> = e
            .split(" of ")
            .skip(1)
            .filter_map(|part| part.split(" nm").next().and_then(|n| n.parse().ok()))
            .collect();
        assert!(
            volume(&auto(0.0), sizes[0], sizes[1], wide, &room).is_ok(),
            "{e}"
        );
        for size in [0.0, f64::NAN] {
            let e = volume(&auto(0.0), 10.0, size, [x, y, z], &ROOM).unwrap_err();
            assert_eq!(e.parameter.as_deref(), Some("voxel_z"));
        }
        let e = volume(&auto(0.0), 10.0, 10.0, [x, y, None], &ROOM).unwrap_err();
        assert!(e.to_string().contains("finite z"), "{e}");
    }
}
