//! The writer `puncta.figure.png.write/1`.

use crate::layout::Frame;
use crate::picture::{picture, plan};
use crate::raster::raster;
use crate::text::Font;
use crate::{example, pixels};
use png::{BitDepth, ColorType, Encoder, EncodingError, PixelDimensions, Unit};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use tiny_skia::Pixmap;

/// Most pixels of a picture.
const MOST: f64 = 64e6;

/// Writes a figure as PNG.
#[derive(Params)]
pub struct PngWrite {
    /// Width of the picture.
    #[param(default = 140.0, min = 40.0, max = 1000.0, unit = "mm")]
    width: f64,
    /// Height of the picture without the caption.
    #[param(default = 95.0, min = 30.0, max = 1000.0, unit = "mm")]
    height: f64,
    /// Pixels per inch (25.4 mm).
    #[param(default = 220.0, min = 50.0, max = 1200.0)]
    resolution: f64,
    /// Whether the title stands above.
    #[param(default = true)]
    title: bool,
    /// Whether the caption stands below.
    #[param(default = true)]
    caption: bool,
}

impl Operation for PngWrite {
    const ID: &'static str = "puncta.figure.png.write/1";

    fn info() -> Info {
        Info::writer("PNG figure", &[".png"])
            .description("Writes a figure as pixels.")
            .input(Ports::figure("figure"))
            .example(json!({}))
            .example_step("figure", example::figure())
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        self.fits(pixels(self.width), pixels(self.height))?;
        plan(request)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let frame = Frame {
            width: pixels(self.width),
            height: pixels(self.height),
            title: self.title,
            caption: self.caption,
        };
        let font = Font::new();
        let scene = picture(job, &frame, &font)?;
        // The caption may have made it higher.
        self.fits(scene.width, scene.height)?;
        job.progress(0.6, "drawing pixels")?;
        let pixmap = raster(&scene, &font, self.scale());
        let pixmap = pixmap.ok_or_else(|| self.too_large(scene.width, scene.height))?;
        job.progress(0.8, "writing")?;
        let path = Path::new(&job.file()?.path);
        let io = |error| Failure::io("write", path, &error);
        let file = BufWriter::new(File::create(path).map_err(io)?);
        encode(&pixmap, self.resolution, file).map_err(|error| match error {
            EncodingError::IoError(error) => io(error),
            error => Failure::internal(format!("cannot write {}: {error}", path.display())),
        })
    }
}

puncta_sdk::register!(PngWrite);

impl PngWrite {
    fn scale(&self) -> f64 {
        self.resolution / 96.0
    }

    fn fits(&self, width: f64, height: f64) -> Result<(), Failure> {
        let count = width * height * self.scale() * self.scale();
        if count <= MOST {
            Ok(())
        } else {
            Err(self.too_large(width, height))
        }
    }

    fn too_large(&self, width: f64, height: f64) -> Failure {
        let [w, h] = [width, height].map(|side| (side * self.scale()).ceil());
        let fits = (96.0 * (MOST / (width * height)).sqrt()).floor();
        let message = format!("a picture of {w} x {h} pixels is too large");
        Failure::bad_parameter("resolution", message)
            .remedy(format!("make it smaller, or use a resolution of {fits}"))
    }
}

/// Writes the pixels, which are opaque, as RGB.
fn encode(pixmap: &Pixmap, resolution: f64, out: impl Write) -> Result<(), EncodingError> {
    let mut encoder = Encoder::new(out, pixmap.width(), pixmap.height());
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    let per_metre = (resolution / 0.0254).round() as u32;
    let (xppu, yppu, unit) = (per_metre, per_metre, Unit::Meter);
    encoder.set_pixel_dims(Some(PixelDimensions { xppu, yppu, unit }));
    encoder.add_text_chunk("Software".into(), "Puncta".into())?;
    let (pixels, _) = pixmap.data().as_chunks::<4>();
    let rgb: Vec<u8> = pixels
        .iter()
        .flat_map(|[r, g, b, _]| [*r, *g, *b])
        .collect();
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&rgb)?;
    writer.finish()
}
