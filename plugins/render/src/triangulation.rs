//! The operation `puncta.render.triangulation/1`.

use crate::channels::{self, Want};
use crate::jitter::{Jitter, SUMS, entries, none};
use crate::output::{check, header, render, view, warn_invalid};
use crate::parameters::{Channels, Density, Window};
use crate::triangles2d::triangles2d;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// Rows up to which a triangulation takes less than the time in which cancel must work.
const SOON: u64 = 150_000;

/// Renders the density of localisations from triangles between them.
#[derive(Params)]
pub struct Triangulation {
    /// Side of a pixel.
    #[param(default = 10, min = 1e-6, max = 1e9, unit = "nm")]
    pixel_size: f64,
    /// Unit of the density.
    #[param(default = Density::Pixel)]
    unit: Density,
    /// How the localisations are jittered and sampled.
    #[param(flatten)]
    jitter: Jitter,
    /// The field of view.
    #[param(flatten)]
    window: Window,
    /// The channels.
    #[param(flatten)]
    channels: Channels,
}

impl Triangulation {
    fn wants(&self) -> Vec<Want> {
        let positions = ["x", "y"].map(Want::position);
        positions.into_iter().chain(self.jitter.want()).collect()
    }
}

impl Operation for Triangulation {
    const ID: &'static str = "puncta.render.triangulation/1";

    fn info() -> Info {
        Info::operation("Jittered triangulation image")
            .description(
                "Averages over samples in which each localisation is moved at random, by about the \
                 distance from its neighbours, and may be left out. In a sample each localisation \
                 is shared equally among the Delaunay triangles that meet in it, and a triangle \
                 has the density of its shares over its area, integrated exactly over each pixel. \
                 Compared with Gaussians, few localisations far from others weigh less. What jitter \
                 moves out of the image is lost: give a margin to keep it. The seed makes the image \
                 the same again.",
            )
            .input(Ports::table("table").column("x", "nm").column("y", "nm").many())
            .output(Ports::image("image").description("Density, 32-bit float"))
            .output(Ports::report("report").description("Rows rendered and left out"))
            .cite("Baddeley, Cannell and Soeller, Microscopy and Microanalysis 16, 64 (2010)")
            .example(json!({"pixel_size": 5, "samples": 3}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let count = channels::count(request, &self.channels);
        check(request, &self.window.bounds(), self.pixel_size, count)?;
        let rows = request.rows();
        Ok(Plan {
            read: channels::reads(request, &self.channels, |_| Ok(self.wants()))?,
            // Positions and jitter; points, triangles and edges of a sample on each of two threads.
            memory: rows * 900 + (64 << 20),
            interruptible: rows <= SOON,
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let channels = channels::load(job, &self.channels, |_| Ok(self.wants()))?;
        let field = view(job, &self.window.bounds(), self.pixel_size, &channels, SUMS)?;
        let header = header(&field, "triangulation", self.unit.unit(false), &channels);
        let factor = self.unit.factor(self.pixel_size * self.pixel_size);
        render(job, header, &channels, |channel, out, run| {
            let cloud = self.jitter.cloud(channel, &[field.x, field.y], run)?;
            let rows = channel.columns[0].len();
            warn_invalid(job, cloud.invalid, rows, "finite position and jitter");
            let shown = triangles2d(&cloud, &self.jitter.sampling(), &field, factor, out, run)?;
            if shown == 0.0 {
                return Err(none(&channel.name, 3, "line"));
            }
            Ok(entries(cloud.points.len(), shown, cloud.invalid, out))
        })
    }
}

puncta_sdk::register!(Triangulation);
