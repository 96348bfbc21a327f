//! The operation `puncta.render.histogram3d/1`.

use crate::channels::{self, Want};
use crate::histogram::entries;
use crate::histogram2d::histogram3d;
use crate::output::{check3, header3, render, view3, warn_invalid};
use crate::parameters::{Box3, Channels};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// Counts the localisations in each voxel.
#[derive(Params)]
pub struct Histogram3d {
    /// Side of a voxel in x and y.
    #[param(default = 20, min = 1e-6, max = 1e9, unit = "nm")]
    pixel_size: f64,
    /// Side of a voxel in z.
    #[param(default = 50, min = 1e-6, max = 1e9, unit = "nm")]
    voxel_z: f64,
    /// The field of view.
    #[param(flatten)]
    view: Box3,
    /// The channels.
    #[param(flatten)]
    channels: Channels,
}

/// The columns of a table.
pub(crate) fn wants(_: &Header) -> Result<Vec<Want>, Failure> {
    Ok(["x", "y", "z"].map(Want::position).into())
}

impl Operation for Histogram3d {
    const ID: &'static str = "puncta.render.histogram3d/1";

    fn info() -> Info {
        let table = Ports::table("table");
        let table = table.column("x", "nm").column("y", "nm").column("z", "nm");
        Info::operation("Histogram volume")
            .description(
                "Counts the localisations in each voxel. The slices lie on the grid of the \
                 histogram image, so that they add up to it. Without bounds the volume covers all \
                 localisations. A voxel holds its low edges. Rows without a finite position are \
                 left out and counted in the report.",
            )
            .input(table.many())
            .output(Ports::image("image").description("Localisations per voxel, 32-bit float"))
            .output(Ports::report("report").description("Rows inside, outside and left out"))
            .example(json!({}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let count = channels::count(request, &self.channels);
        let sizes = [self.pixel_size, self.voxel_z];
        check3(request, &self.view.bounds(), sizes, count)?;
        let rows = request.rows();
        Ok(Plan {
            read: channels::reads(request, &self.channels, wants)?,
            // Sorted voxel numbers of a round, and a tile for each thread.
            memory: rows.min(1 << 24) * 8 + (8 << 20),
            interruptible: true,
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let channels = channels::load(job, &self.channels, wants)?;
        let sizes = [self.pixel_size, self.voxel_z];
        let volume = view3(job, &self.view.bounds(), sizes, &channels, 0)?;
        let header = header3(&volume, "histogram", "1", &channels);
        render(job, header, &channels, |channel, out, run| {
            let [x, y, z] = [0, 1, 2].map(|i| &*channel.columns[i]);
            let counted = histogram3d([x, y, z], &volume, out, run)?;
            warn_invalid(job, counted.invalid, x.len(), "finite position");
            Ok(entries(&counted))
        })
    }
}

puncta_sdk::register!(Histogram3d);
