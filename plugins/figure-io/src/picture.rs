//! From a figure to a picture.

use crate::layout::{Frame, layout};
use crate::scene::Scene;
use crate::text::Font;
use crate::{colours, curves, data};
use puncta_sdk::prelude::*;

/// Largest number of points of a figure that is written; far beyond what can be seen.
const MOST: usize = 200_000_000;

/// The plan of a writer of figures: the columns that the series name.
///
/// # Errors
/// When the figure names what did not come with it.
pub fn plan(request: &Request) -> Result<Plan, Failure> {
    let input = request.inputs.first();
    let header = input.map(|input| &input.header);
    let header = header.ok_or_else(|| Failure::bad_input("there is no figure to write"))?;
    let figure = data::figure(header)?;
    let rows: u64 = header.parts.iter().map(|part| part.rows).sum();
    if rows > MOST as u64 {
        let message = format!("a figure of {rows} points is too large to be drawn");
        return Err(Failure::bad_input(message).remedy("write its table instead"));
    }
    Ok(Plan {
        read: data::columns(&figure, header)?,
        memory: (64 << 20) + 64 * rows,
        interruptible: true,
        ..Plan::default()
    })
}

/// Draws the figure of a call.
///
/// # Errors
/// What is wrong with the figure; when the call is cancelled.
pub fn picture(job: &Job, frame: &Frame, font: &Font) -> Result<Scene, Failure> {
    let input = job.input("figure")?;
    let figure = data::figure(input.header())?;
    let series = data::curves(&figure, &input)?;
    let log = ["x", "y"].map(|axis| figure.logarithmic.contains(axis));
    job.progress(0.1, "finding the ranges")?;
    let (ranges, hidden) = curves::ranges(&series, log, job)?;
    if hidden > 0 {
        job.warn(&format!(
            "{hidden} values are zero, negative or too large for the axes and are not drawn"
        ));
    }
    job.progress(0.4, "drawing")?;
    let looks = colours::looks(&series);
    let (mut scene, plot) = layout(&figure, &series, &looks, &ranges, frame, font);
    curves::draw(&mut scene, &plot, &series, &looks, job)?;
    Ok(scene)
}
