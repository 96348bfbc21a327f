//! The pixel or voxel grid that localisations are counted on.

use puncta_sdk::{Failure, FailureCode};

/// Fewest pixels along an axis: fewer have no curve.
const FEWEST: usize = 16;

/// Bytes of working memory for each voxel: spectra of both halves, and a pass between.
pub const VOXEL_BYTES: u64 = 24;

/// Memory that a call may use unless the host says otherwise.
const BUDGET: u64 = 8 << 30;

/// A grid of pixels (`z` has one) or voxels, in the order z, y, x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Number of voxels.
    pub size: [usize; 3],
    /// Their sides, nm.
    pub voxel: [f64; 3],
    origin: [f64; 3],
    limits: [[f64; 2]; 3],
}

/// An axis of the field: its name, the limits given, and the side of a voxel.
#[derive(Clone, Copy, Debug)]
pub struct Axis<'a> {
    /// Name of the column.
    pub name: &'a str,
    /// Limits that were given, nm.
    pub limits: [Option<f64>; 2],
    /// Side of a voxel, nm.
    pub voxel: f64,
    /// Name of the parameter that gives it.
    pub parameter: &'a str,
}

impl Grid {
    /// The grid over the field: `axes` in the order z, y, x, with what the limits leave open taken
    /// from the smallest and largest finite values `extents`. It is centred on the field, so that a
    /// turned or moved field has the turned or moved grid. A voxel of 0 leaves an axis out.
    ///
    /// # Errors
    /// When there are no finite positions, when a limit makes no sense, and when the field has too
    /// few or too many voxels; the sentence names the size that would do.
    pub fn new(
        axes: [Axis<'_>; 3],
        extents: [Option<(f64, f64)>; 3],
        memory: Option<u64>,
    ) -> Result<Grid, Failure> {
        let mut grid = Grid {
            size: [1; 3],
            voxel: [0.0; 3],
            origin: [0.0; 3],
            limits: [[f64::NEG_INFINITY, f64::INFINITY]; 3],
        };
        let mut pixels = [1.0_f64; 3];
        for (axis, (given, extent)) in axes.iter().zip(extents).enumerate() {
            if given.voxel <= 0.0 {
                continue;
            }
            let [low, high] = field(given, extent)?;
            pixels[axis] = ((high - low) / given.voxel - 1e-6).ceil().max(1.0);
            if pixels[axis] < FEWEST as f64 {
                return Err(too_few(given, high - low, pixels[axis]));
            }
            grid.voxel[axis] = given.voxel;
            grid.limits[axis] = [low, high];
            grid.origin[axis] = 0.5 * (low + high) - 0.5 * pixels[axis] * given.voxel;
        }
        let budget = memory.unwrap_or(BUDGET).min(BUDGET) as f64;
        let bytes = pixels.iter().product::<f64>() * VOXEL_BYTES as f64;
        if bytes > budget {
            return Err(too_many(&axes, pixels, bytes / budget));
        }
        grid.size = pixels.map(|n| n as usize);
        Ok(grid)
    }

    /// The voxel along an axis that holds a position; none outside the field, or for NaN.
    #[inline]
    pub fn place(&self, axis: usize, at: f64) -> Option<usize> {
        let [low, high] = self.limits[axis];
        let inside = at >= low && at <= high && at.abs() < f64::INFINITY;
        inside.then(|| {
            let place = ((at - self.origin[axis]) / self.voxel[axis]).max(0.0) as usize;
            place.min(self.size[axis] - 1)
        })
    }

    /// Number of rows of voxels along x.
    pub fn lines(&self) -> usize {
        self.size[0] * self.size[1]
    }
}

fn field(axis: &Axis<'_>, extent: Option<(f64, f64)>) -> Result<[f64; 2], Failure> {
    let name = axis.name;
    for (end, limit) in ["min", "max"].iter().zip(axis.limits) {
        if let Some(limit) = limit.filter(|limit| !limit.is_finite()) {
            let message = format!("the limit {name}_{end} is {limit} nm");
            return Err(Failure::bad_parameter(&format!("{name}_{end}"), message)
                .remedy("give a number of nm or leave it out"));
        }
    }
    let missing = || {
        Failure::bad_input(format!(
            "no row has a finite {name}, so that there is no field"
        ))
        .remedy("check the columns of the table and the filters before this step")
    };
    let low = axis.limits[0].or(extent.map(|e| e.0)).ok_or_else(missing)?;
    let high = axis.limits[1].or(extent.map(|e| e.1)).ok_or_else(missing)?;
    if high < low {
        let message = format!("the field ends in {name} at {high} nm, below its start at {low} nm");
        let end = if axis.limits[1].is_some() {
            "max"
        } else {
            "min"
        };
        return Err(Failure::bad_parameter(&format!("{name}_{end}"), message)
            .remedy(format!("change {name}_min or {name}_max")));
    }
    Ok([low, high])
}

fn too_few(axis: &Axis<'_>, length: f64, pixels: f64) -> Failure {
    let (name, voxel) = (axis.name, axis.voxel);
    let message = format!(
        "the field is {length:.6} nm long in {name}, {pixels} pixels of {voxel} nm, and a curve \
         needs {FEWEST}"
    );
    let remedy = if length > 0.0 {
        format!("use a pixel size below {:.3e} nm", length / FEWEST as f64)
    } else {
        "the positions must differ".to_owned()
    };
    Failure::bad_parameter(axis.parameter, message).remedy(remedy)
}

fn too_many(axes: &[Axis<'_>; 3], pixels: [f64; 3], excess: f64) -> Failure {
    let used = axes.iter().filter(|axis| axis.voxel > 0.0).count();
    let grow = excess.powf(1.0 / used as f64) * 1.01;
    let sizes: Vec<String> = pixels.iter().rev().map(|n| format!("{n}")).collect();
    let message = format!(
        "the field has {} voxels, {excess:.1} times more than fit into memory",
        sizes[..used].join(" x ")
    );
    let fit = axes[2].voxel * grow;
    Failure::new(FailureCode::Resources, message)
        .parameter(axes[2].parameter)
        .remedy(format!(
            "use voxels of {fit:.4e} nm or more, or a smaller field"
        ))
}

/// Smallest and largest finite value.
pub fn extent(values: &[f64]) -> Option<(f64, f64)> {
    let finite = values.iter().filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(*v), high.max(*v))
    });
    (low <= high).then_some((low, high))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(name: &str, voxel: f64) -> Axis<'_> {
        Axis {
            name,
            limits: [None; 2],
            voxel,
            parameter: "pixel_size",
        }
    }

    fn plane(x: (f64, f64), y: (f64, f64), pixel: f64) -> Result<Grid, Failure> {
        Grid::new(
            [axis("z", 0.0), axis("y", pixel), axis("x", pixel)],
            [None, Some(y), Some(x)],
            None,
        )
    }

    #[test]
    fn the_grid_is_centred_on_the_field() {
        let grid = plane((0.0, 165.0), (-80.0, 80.0), 10.0).unwrap();
        assert_eq!(grid.size, [1, 16, 17]);
        let places = [0.0, 7.4, 7.6, 165.0, 165.1, -0.1, f64::NAN].map(|x| grid.place(2, x));
        assert_eq!(
            places,
            [Some(0), Some(0), Some(1), Some(16), None, None, None]
        );
        assert_eq!(grid.place(1, 80.0), Some(15));
        assert_eq!(grid.place(1, f64::INFINITY), None);
    }

    #[test]
    fn fields_that_give_no_curve_are_refused() {
        let error = plane((0.0, 100.0), (0.0, 900.0), 10.0)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("10 pixels of 10 nm") && error.contains("6.250e0"),
            "{error}"
        );
        let error = plane((3.0, 3.0), (0.0, 900.0), 10.0)
            .unwrap_err()
            .to_string();
        assert!(error.contains("must differ"), "{error}");
        let error = plane((0.0, 1e9), (0.0, 1e9), 10.0).unwrap_err();
        let text = error.to_string();
        let size = text.split("voxels of ").nth(1).unwrap();
        let size: f64 = size.split(' ').next().unwrap().parse().unwrap();
        assert!(plane((0.0, 1e9), (0.0, 1e9), size).is_ok(), "{text}");
        let axes = [axis("z", 0.0), axis("y", 1.0), axis("x", 1.0)];
        assert!(Grid::new(axes, [None; 3], None).is_err());
        let mut axes = axes;
        axes[2].limits = [Some(5.0), Some(4.0)];
        let y = Some((0.0, 100.0));
        assert!(Grid::new(axes, [None, y, None], None).is_err());
        axes[2].limits = [Some(f64::NAN), None];
        let error = Grid::new(axes, [None, y, y], None).unwrap_err();
        assert_eq!(error.parameter.as_deref(), Some("x_min"));
    }

    #[test]
    fn extents_skip_what_is_not_finite() {
        assert_eq!(
            extent(&[f64::NAN, 2.0, f64::INFINITY, -1.0]),
            Some((-1.0, 2.0))
        );
        assert_eq!(extent(&[f64::NAN]), None);
    }
}
