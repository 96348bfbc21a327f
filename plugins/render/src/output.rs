//! What the operations of this plugin share: the field of view of a call, and its outputs.

use crate::channels::Channel;
use crate::field::{Bounds, Extent, Field, IMAGE_BYTES, Room, Volume, extent, field, volume};
use puncta_sdk::Cancelled;
use puncta_sdk::job::Job;
use puncta_sdk::prelude::*;

/// Bytes of a pixel of the image that is made.
const PIXEL_BYTES: u64 = 4;

/// What an image of this many channels may take, with `scratch` bytes of working memory a pixel: what
/// the host allows, at most [`IMAGE_BYTES`].
fn room(request: &Request, channels: usize, scratch: u64) -> Room {
    Room {
        budget: request.memory.unwrap_or(IMAGE_BYTES).min(IMAGE_BYTES),
        pixel_bytes: PIXEL_BYTES * channels.max(1) as u64 + scratch,
    }
}

/// Refuses a field of view that is given completely, before anything is read.
pub(crate) fn check(
    request: &Request,
    bounds: &Bounds,
    pixel_size: f64,
    channels: usize,
) -> Result<(), Failure> {
    if bounds.x.iter().chain(&bounds.y).all(Option::is_some) {
        field(bounds, pixel_size, [None; 2], &room(request, channels, 0))?;
    }
    Ok(())
}

/// As [`check`], for a volume.
pub(crate) fn check3(
    request: &Request,
    bounds: &Bounds,
    [pixel_size, voxel_z]: [f64; 2],
    channels: usize,
) -> Result<(), Failure> {
    let edges = bounds.x.iter().chain(&bounds.y).chain(&bounds.z);
    if edges.copied().all(|edge: Option<f64>| edge.is_some()) {
        volume(
            bounds,
            pixel_size,
            voxel_z,
            [None; 3],
            &room(request, channels, 0),
        )?;
    }
    Ok(())
}

/// The field of view of a call: the bounds, and what they leave open from the positions, which are
/// the first columns of each channel. `scratch`: bytes of working memory that a pixel takes.
pub(crate) fn view(
    job: &Job,
    bounds: &Bounds,
    size: f64,
    channels: &[Channel<'_>],
    scratch: u64,
) -> Result<Field, Failure> {
    job.progress(0.0, "finding the field of view")?;
    let x = open(bounds.x, 0, channels, job)?;
    let y = open(bounds.y, 1, channels, job)?;
    field(
        bounds,
        size,
        [x, y],
        &room(job.request(), channels.len(), scratch),
    )
}

/// As [`view`], for a volume.
pub(crate) fn view3(
    job: &Job,
    bounds: &Bounds,
    [size, voxel_z]: [f64; 2],
    channels: &[Channel<'_>],
    scratch: u64,
) -> Result<Volume, Failure> {
    job.progress(0.0, "finding the field of view")?;
    let x = open(bounds.x, 0, channels, job)?;
    let y = open(bounds.y, 1, channels, job)?;
    let z = open(bounds.z, 2, channels, job)?;
    volume(
        bounds,
        size,
        voxel_z,
        [x, y, z],
        &room(job.request(), channels.len(), scratch),
    )
}

/// The extent of a position column over all channels, where an edge is open.
fn open(
    edges: [Option<f64>; 2],
    column: usize,
    channels: &[Channel<'_>],
    run: &dyn Run,
) -> Result<Extent, Cancelled> {
    let mut all: Extent = None;
    if edges.iter().all(Option::is_some) {
        return Ok(all);
    }
    for channel in channels {
        if let Some((low, high)) = extent(&channel.columns[column], run)? {
            all = Some(all.map_or((low, high), |(l, h)| (l.min(low), h.max(high))));
        }
    }
    Ok(all)
}

/// Header of the image of a plane.
pub(crate) fn header(field: &Field, name: &str, unit: &str, channels: &[Channel<'_>]) -> Header {
    Header::image(name, plane(field, channels), Element::F32, unit)
}

/// Header of the image of a volume.
pub(crate) fn header3(volume: &Volume, name: &str, unit: &str, channels: &[Channel<'_>]) -> Header {
    let (mut info, z) = (plane(&volume.plane, channels), &volume.z);
    info.size[2] = z.count() as u64;
    info.voxel[0] = z.size();
    info.origin[0] = z.origin();
    Header::image(name, info, Element::F32, unit)
}

fn plane(field: &Field, channels: &[Channel<'_>]) -> ImageInfo {
    let (w, h) = (field.x.count() as u64, field.y.count() as u64);
    let mut info = ImageInfo::plane(w, h, field.x.size(), field.x.origin(), field.y.origin());
    info.size[1] = channels.len().max(1) as u64;
    if channels.len() > 1 {
        info.channels = channels
            .iter()
            .map(|channel| channel.name.clone())
            .collect();
    }
    info
}

/// A named number of a report, with one line of meaning.
pub(crate) type Entry = (&'static str, f64, &'static str);

/// Makes the image: `make` fills the pixels of a channel and says what the report tells of it. Gives
/// the report.
pub(crate) fn render(
    job: &Job,
    header: Header,
    channels: &[Channel<'_>],
    make: impl Fn(&Channel<'_>, &mut [f32], &dyn Run) -> Result<Vec<Entry>, Failure>,
) -> Result<(), Failure> {
    let pixels = header.rows();
    let mut image = job.begin("image", header)?;
    image.commit(0, pixels)?;
    let values = image.f32_mut("value")?;
    let size = values.len() / channels.len().max(1);
    let mut report = Report::new("report");
    for (place, channel) in channels.iter().enumerate() {
        let share = 1.0 / channels.len() as f64;
        let from = place as f64 * share;
        let part = Part {
            run: job,
            from,
            share,
        };
        let entries = make(
            channel,
            &mut values[place * size..(place + 1) * size],
            &part,
        )?;
        for (name, value, text) in entries {
            let name = match channels.len() {
                1 => name.to_owned(),
                _ => format!("{name} ({})", channel.name),
            };
            report.number(&name, value, "1").description = Some(text.into());
        }
    }
    image.finish()?;
    job.report(&report)
}

/// Tells the person about rows that cannot be rendered.
pub(crate) fn warn_invalid(job: &Job, invalid: u64, rows: usize, what: &str) {
    if invalid > 0 {
        let are = if invalid == 1 { "row has" } else { "rows have" };
        job.warn(&format!(
            "{invalid} of {rows} {are} no {what} and cannot be rendered"
        ));
    }
}

/// A part of some work, whose progress is a part of the whole.
pub(crate) struct Part<'a> {
    pub(crate) run: &'a dyn Run,
    /// Where the part begins, of the whole.
    pub(crate) from: f64,
    /// How much of the whole it is.
    pub(crate) share: f64,
}

impl Run for Part<'_> {
    fn parallel(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        self.run.parallel(count, task);
    }

    fn threads(&self) -> usize {
        self.run.threads()
    }

    fn progress(&self, fraction: f64, phase: &str) -> Result<(), Cancelled> {
        self.run.progress(self.from + self.share * fraction, phase)
    }

    fn cancelled(&self) -> bool {
        self.run.cancelled()
    }
}
