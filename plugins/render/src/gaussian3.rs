//! The operation `puncta.render.gaussian3d/1`.

use crate::channels::{self, Want};
use crate::gaussian::{entries, widths};
use crate::gaussian3d::{Depths, gaussian3d};
use crate::output::{check3, header3, render, view3, warn_invalid};
use crate::parameters::{Box3, Channels};
use crate::spots::{Gaussians, Sigma};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// Renders each localisation as a Gaussian of its precision in three dimensions.
#[derive(Params)]
pub struct Gaussian3d {
    /// Side of a voxel in x and y.
    #[param(default = 20, min = 1e-6, max = 1e9, unit = "nm")]
    pixel_size: f64,
    /// Side of a voxel in z.
    #[param(default = 50, min = 1e-6, max = 1e9, unit = "nm")]
    voxel_z: f64,
    /// Column with the standard deviation in x.
    #[param(default = "error_x")]
    sigma_x: Column,
    /// Column with the standard deviation in y.
    #[param(default = "error_y")]
    sigma_y: Column,
    /// Column with the standard deviation in z.
    #[param(default = "error_z")]
    sigma_z: Column,
    /// One standard deviation in x and y for all localisations, instead of the columns.
    #[param(min = 0, max = 1e9, unit = "nm")]
    sigma: Option<f64>,
    /// One standard deviation in z for all localisations, instead of the column.
    #[param(min = 0, max = 1e9, unit = "nm")]
    depth_sigma: Option<f64>,
    /// Column with the sum of each localisation, such as its photons; 1 for all if left out.
    weight: Option<Column>,
    /// Factor on the standard deviations of the columns.
    #[param(default = 1, min = 0, max = 1e6, advanced)]
    scale: f64,
    /// Smallest standard deviation: smaller ones are raised to it.
    #[param(default = 0, min = 0, max = 1e9, unit = "nm", advanced)]
    sigma_min: f64,
    /// The field of view.
    #[param(flatten)]
    view: Box3,
    /// The channels.
    #[param(flatten)]
    channels: Channels,
}

impl Gaussian3d {
    /// Positions, then widths unless they are given for all, then the weight.
    fn wants(&self, header: &Header) -> Result<Vec<Want>, Failure> {
        let mut all: Vec<Want> = ["x", "y", "z"].map(Want::position).into();
        if self.sigma.is_none() {
            all.extend(widths(header, &self.sigma_x, &self.sigma_y));
        }
        if self.depth_sigma.is_none() {
            all.push(Want::named(&self.sigma_z, "sigma_z", Some("nm")));
        }
        let weight = self.weight.as_ref();
        all.extend(weight.map(|name| Want::named(name, "weight", None)));
        Ok(all)
    }

    fn scale_of(&self, fixed: Option<f64>) -> f64 {
        if fixed.is_none() { self.scale } else { 1.0 }
    }
}

impl Operation for Gaussian3d {
    const ID: &'static str = "puncta.render.gaussian3d/1";

    fn info() -> Info {
        let table = Ports::table("table");
        let table = table.column("x", "nm").column("y", "nm").column("z", "nm");
        Info::operation("Gaussian volume")
            .description(
                "Renders each localisation as a Gaussian of its precision, integrated over each \
                 voxel, cut off at four standard deviations and renormalised, so that each adds up \
                 to 1 (or its weight) whatever its width. The slices lie on the grid of the \
                 Gaussian image and add up to it. What falls outside the volume is lost: give a \
                 margin to keep it. Rows without a finite position, width and weight, and rows \
                 with a negative width, are left out and counted in the report.",
            )
            .input(table.many())
            .output(Ports::image("image").description("Sum per voxel, 32-bit float"))
            .output(Ports::report("report").description("Rows rendered, outside and left out"))
            .cite("Smith et al., Nature Methods 7, 373 (2010), equation 1")
            .example(json!({"sigma": 15, "depth_sigma": 30}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let count = channels::count(request, &self.channels);
        let sizes = [self.pixel_size, self.voxel_z];
        check3(request, &self.view.bounds(), sizes, count)?;
        let rows = request.rows();
        Ok(Plan {
            read: channels::reads(request, &self.channels, |header| self.wants(header))?,
            // Ranges of slices of all rows; positions, widths and sorted entries of a slice.
            memory: rows * 200 + (64 << 20),
            interruptible: true,
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let channels = channels::load(job, &self.channels, |header| self.wants(header))?;
        let sizes = [self.pixel_size, self.voxel_z];
        let volume = view3(job, &self.view.bounds(), sizes, &channels, 0)?;
        let header = header3(&volume, "gaussian", "1", &channels);
        render(job, header, &channels, |channel, out, run| {
            let mut columns = channel.columns.iter().map(|column| &**column);
            let mut next = || columns.next().unwrap_or(&[]);
            let (x, y, z) = (next(), next(), next());
            let (sigma_x, sigma_y) = match self.sigma {
                Some(sigma) => (Sigma::Fixed(sigma), Sigma::Fixed(sigma)),
                None => (Sigma::Column(next()), Sigma::Column(next())),
            };
            let sigma_z = match self.depth_sigma {
                Some(sigma) => Sigma::Fixed(sigma),
                None => Sigma::Column(next()),
            };
            let weight = self.weight.as_ref().map(|_| next());
            let (sigma_min, scale) = (self.sigma_min, self.scale_of(self.sigma));
            let spots = Gaussians {
                x,
                y,
                sigma_x,
                sigma_y,
                weight,
                sigma_min,
                scale,
            };
            let scale = self.scale_of(self.depth_sigma);
            let depths = Depths {
                z,
                sigma: sigma_z,
                scale,
            };
            let rendered = gaussian3d(&spots, &depths, &volume, out, run)?;
            warn_invalid(job, rendered.invalid, x.len(), "finite position and width");
            Ok(entries(&rendered))
        })
    }
}

puncta_sdk::register!(Gaussian3d);
