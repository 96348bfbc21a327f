//! The operation `puncta.render.triangulation3d/1`.

use crate::channels::{self, Want};
use crate::jitter::{Jitter, SUMS, entries, none};
use crate::output::{check3, header3, render, view3, warn_invalid};
use crate::parameters::{Box3, Channels, Density};
use crate::tetrahedra3d::tetrahedra3d;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// Renders the density of localisations from tetrahedra between them.
#[derive(Params)]
pub struct Triangulation3d {
    /// Side of a voxel in x and y.
    #[param(default = 20, min = 1e-6, max = 1e9, unit = "nm")]
    pixel_size: f64,
    /// Side of a voxel in z.
    #[param(default = 50, min = 1e-6, max = 1e9, unit = "nm")]
    voxel_z: f64,
    /// Unit of the density.
    #[param(default = Density::Pixel)]
    unit: Density,
    /// How the localisations are jittered and sampled.
    #[param(flatten)]
    jitter: Jitter,
    /// The field of view.
    #[param(flatten)]
    view: Box3,
    /// The channels.
    #[param(flatten)]
    channels: Channels,
}

impl Triangulation3d {
    fn wants(&self) -> Vec<Want> {
        let positions = ["x", "y", "z"].map(Want::position);
        positions.into_iter().chain(self.jitter.want()).collect()
    }
}

impl Operation for Triangulation3d {
    const ID: &'static str = "puncta.render.triangulation3d/1";

    fn info() -> Info {
        let table = Ports::table("table");
        let table = table.column("x", "nm").column("y", "nm").column("z", "nm");
        Info::operation("Jittered triangulation volume")
            .description(
                "Averages over samples in which each localisation is moved at random, by about the \
                 distance from its neighbours, and may be left out. In a sample each localisation \
                 is shared equally among the Delaunay tetrahedra that meet in it, and a tetrahedron \
                 has the density of its shares over its volume. What jitter moves out of the volume \
                 is lost: give a margin to keep it. The seed makes the volume the same again.",
            )
            .input(table.many())
            .output(Ports::image("image").description("Density, 32-bit float"))
            .output(Ports::report("report").description("Rows rendered and left out"))
            .cite("Baddeley, Cannell and Soeller, Microscopy and Microanalysis 16, 64 (2010)")
            .example(json!({"samples": 2}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let count = channels::count(request, &self.channels);
        let sizes = [self.pixel_size, self.voxel_z];
        check3(request, &self.view.bounds(), sizes, count)?;
        let rows = request.rows();
        Ok(Plan {
            read: channels::reads(request, &self.channels, |_| Ok(self.wants()))?,
            // Positions and jitter; tetrahedra of a sample on each of two threads.
            memory: rows * 1600 + (64 << 20),
            interruptible: true,
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let channels = channels::load(job, &self.channels, |_| Ok(self.wants()))?;
        let sizes = [self.pixel_size, self.voxel_z];
        let volume = view3(job, &self.view.bounds(), sizes, &channels, SUMS)?;
        let header = header3(&volume, "triangulation", self.unit.unit(true), &channels);
        let voxel = self.pixel_size * self.pixel_size * self.voxel_z;
        let factor = self.unit.factor(voxel);
        let axes = [volume.plane.x, volume.plane.y, volume.z];
        render(job, header, &channels, |channel, out, run| {
            flat(channel)?;
            let cloud = self.jitter.cloud(channel, &axes, run)?;
            let rows = channel.columns[0].len();
            warn_invalid(job, cloud.invalid, rows, "finite position and jitter");
            let sampling = self.jitter.sampling();
            let shown = tetrahedra3d(&cloud, &sampling, &volume, factor, out, run)?;
            if shown == 0.0 {
                return Err(none(&channel.name, 4, "plane"));
            }
            Ok(entries(cloud.points.len(), shown, cloud.invalid, out))
        })
    }
}

puncta_sdk::register!(Triangulation3d);

/// Refuses localisations without depth, which jitter would turn into a slab.
fn flat(channel: &channels::Channel<'_>) -> Result<(), Failure> {
    let mut depths = channel.columns[2].iter().filter(|z| z.is_finite());
    let first = depths.next();
    let mut others = depths.peekable();
    if others.peek().is_some() && others.all(|z| Some(z) == first) {
        let message = format!("all localisations of {} have the same z", channel.name);
        return Err(Failure::bad_input(message).remedy("use the triangulation image of the plane"));
    }
    Ok(())
}
