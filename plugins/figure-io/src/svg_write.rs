//! The writer `puncta.figure.svg.write/1`.

use crate::layout::Frame;
use crate::picture::{picture, plan};
use crate::svg::svg;
use crate::text::Font;
use crate::{example, pixels};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use std::path::Path;

/// Writes a figure as SVG.
#[derive(Params)]
pub struct SvgWrite {
    /// Width of the picture.
    #[param(default = 140.0, min = 40.0, max = 1000.0, unit = "mm")]
    width: f64,
    /// Height of the picture without the caption.
    #[param(default = 95.0, min = 30.0, max = 1000.0, unit = "mm")]
    height: f64,
    /// Whether the title stands above.
    #[param(default = true)]
    title: bool,
    /// Whether the caption stands below.
    #[param(default = true)]
    caption: bool,
}

impl Operation for SvgWrite {
    const ID: &'static str = "puncta.figure.svg.write/1";

    fn info() -> Info {
        Info::writer("SVG figure", &[".svg"])
            .description("Writes a figure as a vector picture whose texts stay texts.")
            .input(Ports::figure("figure"))
            .example(json!({}))
            .example_step("figure", example::figure())
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        plan(request)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let frame = Frame {
            width: pixels(self.width),
            height: pixels(self.height),
            title: self.title,
            caption: self.caption,
        };
        let scene = picture(job, &frame, &Font::new())?;
        let path = Path::new(&job.file()?.path);
        std::fs::write(path, svg(&scene)).map_err(|error| Failure::io("write", path, &error))
    }
}

puncta_sdk::register!(SvgWrite);
