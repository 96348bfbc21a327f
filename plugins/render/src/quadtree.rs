//! The operation `puncta.render.quadtree/1`.

use crate::channels::{self, Want};
use crate::histogram::entries;
use crate::output::{check, header, render, view, warn_invalid};
use crate::parameters::{Channels, Density, Window};
use crate::quadtree2d::quadtree2d;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// Renders the density of localisations in squares that adapt to it.
#[derive(Params)]
pub struct Quadtree {
    /// Side of a pixel, the smallest square.
    #[param(default = 10, min = 1e-6, max = 1e9, unit = "nm")]
    pixel_size: f64,
    /// Most localisations of a square that is not divided further.
    #[param(default = 10, min = 1, max = 1e9)]
    leaf_size: u32,
    /// Unit of the density.
    #[param(default = Density::Pixel)]
    unit: Density,
    /// The field of view.
    #[param(flatten)]
    window: Window,
    /// The channels.
    #[param(flatten)]
    channels: Channels,
}

/// The columns of a table.
fn wants(_: &Header) -> Result<Vec<Want>, Failure> {
    Ok(["x", "y"].map(Want::position).into())
}

impl Operation for Quadtree {
    const ID: &'static str = "puncta.render.quadtree/1";

    fn info() -> Info {
        Info::operation("Quadtree image")
            .description(
                "Divides the field of view into squares, each into four as long as it holds more \
                 localisations than a leaf may, down to one pixel. A pixel has the density of its \
                 square: the localisations over the part of the square that lies in the image. The \
                 relative noise is nearly the same everywhere. The squares lie on a grid that \
                 starts at 0 nm, or at the given low edge, and the image adds up to the number of \
                 localisations.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .many(),
            )
            .output(Ports::image("image").description("Density, 32-bit float"))
            .output(Ports::report("report").description("Rows inside, outside and left out"))
            .cite("Baddeley, Cannell and Soeller, Microscopy and Microanalysis 16, 64 (2010)")
            .example(json!({"pixel_size": 5}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let count = channels::count(request, &self.channels);
        check(request, &self.window.bounds(), self.pixel_size, count)?;
        let rows = request.rows();
        Ok(Plan {
            read: channels::reads(request, &self.channels, wants)?,
            // As for the histogram; the sums of the squares are a third of the image.
            memory: rows.min(1 << 24) * 8 + (8 << 20),
            interruptible: true,
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let channels = channels::load(job, &self.channels, wants)?;
        let field = view(job, &self.window.bounds(), self.pixel_size, &channels, 0)?;
        let header = header(&field, "quadtree", self.unit.unit(false), &channels);
        let factor = self.unit.factor(self.pixel_size * self.pixel_size);
        render(job, header, &channels, |channel, out, run| {
            let (x, y) = (&channel.columns[0], &channel.columns[1]);
            let counted = quadtree2d([x, y], &field, self.leaf_size, factor, out, run)?;
            warn_invalid(job, counted.invalid, x.len(), "finite position");
            Ok(entries(&counted))
        })
    }
}

puncta_sdk::register!(Quadtree);
