//! What the operations of this plugin share: the field of view of a call, and its outputs.

use crate::field::{Bounds, Field, IMAGE_BYTES, extent, field};
use puncta_sdk::job::Job;
use puncta_sdk::prelude::*;

/// Bytes of a pixel of the image that is made.
const PIXEL_BYTES: u64 = 4;

/// Bytes that the image may take: what the host allows, and at most [`IMAGE_BYTES`].
fn budget(request: &Request) -> u64 {
    request.memory.unwrap_or(IMAGE_BYTES).min(IMAGE_BYTES)
}

/// Refuses a field of view that is given completely, before anything is read.
pub(crate) fn check(request: &Request, bounds: &Bounds, pixel_size: f64) -> Result<(), Failure> {
    let edges = [bounds.x_min, bounds.x_max, bounds.y_min, bounds.y_max];
    if edges.iter().all(Option::is_some) {
        field(bounds, pixel_size, None, None, budget(request), PIXEL_BYTES)?;
    }
    Ok(())
}

/// The field of view of a call: the bounds, and what they leave open from the positions.
pub(crate) fn view(
    job: &Job,
    bounds: &Bounds,
    size: f64,
    x: &[f64],
    y: &[f64],
) -> Result<Field, Failure> {
    let needed = |low: Option<f64>, high: Option<f64>| low.is_none() || high.is_none();
    job.progress(0.0, "finding the field of view")?;
    let x = if needed(bounds.x_min, bounds.x_max) {
        extent(x, job)?
    } else {
        None
    };
    let y = if needed(bounds.y_min, bounds.y_max) {
        extent(y, job)?
    } else {
        None
    };
    field(bounds, size, x, y, budget(job.request()), PIXEL_BYTES)
}

/// Header of the image of a field of view.
pub(crate) fn header(field: &Field, name: &str, unit: &str) -> Header {
    let (w, h) = (field.x.count() as u64, field.y.count() as u64);
    let info = ImageInfo::plane(w, h, field.x.size(), field.x.origin(), field.y.origin());
    Header::image(name, info, Element::F32, unit)
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
