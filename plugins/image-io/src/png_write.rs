//! The writer `puncta.image.png.write/1`.

use crate::limits::display;
use crate::lut::Lut;
use crate::pixels::{Pixel, Pixels, each_type, image_info, plan};
use crate::tiff_write::example_image;
use png::{
    BitDepth, ColorType, Compression, Encoder, EncodingError, Filter, PixelDimensions, Unit,
};
use puncta_sdk::prelude::*;
use puncta_sdk::run::chunks_mut;
use puncta_sdk::serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Pixels brought to colours at a time; a row more than that is one step.
const CHUNK: usize = 1 << 20;
/// Compressed bytes of a chunk of the file.
const FILE_CHUNK: usize = 1 << 20;

/// Writes a plane of an image as PNG in colours.
#[derive(Params)]
pub struct PngWrite {
    /// Colour map.
    #[param(default = Lut::Inferno)]
    lut: Lut,
    /// Value shown in the first colour; from percentile_low if left out.
    low: Option<f64>,
    /// Value shown in the last colour; from percentile_high if left out.
    high: Option<f64>,
    /// Percentage of the pixels other than 0 below `low`; 0 is the smallest value, or 0.
    #[param(default = 0, min = 0, max = 100, advanced)]
    percentile_low: f64,
    /// Percentage of the pixels other than 0 below `high`.
    #[param(default = 99.9, min = 0, max = 100, advanced)]
    percentile_high: f64,
    /// Exponent of the brightness: below 1 shows dim structures brighter.
    #[param(default = 1, min = 0.05, max = 20)]
    gamma: f64,
    /// Slice (z) of a stack, counted from 0.
    #[param(default = 0, advanced)]
    slice: u64,
    /// Channel, counted from 0.
    #[param(default = 0, advanced)]
    channel: u64,
    /// Frame, counted from 0.
    #[param(default = 0, advanced)]
    frame: u64,
    /// A text that is stored with the image.
    #[param(advanced)]
    comment: Option<String>,
}

impl Operation for PngWrite {
    const ID: &'static str = "puncta.image.png.write/1";

    fn info() -> Info {
        Info::writer("PNG", &[".png"])
            .description(
                "Writes one plane of an image as PNG: values between two limits in 256 colours of \
                 a colour map. The limits, if not given, are percentiles of the pixels other than \
                 0. The file says the size of its pixels, the limits and the colour map. For \
                 measuring, write TIFF.",
            )
            .input(Ports::image("image"))
            .example(json!({}))
            .example_step("image", example_image())
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        if let Some(input) = request.inputs.first() {
            self.plane(image_info(&input.header)?)?;
        }
        plan(request, 32 << 20)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let input = job.input("image")?;
        let info = image_info(input.header())?;
        let [.., height, width] = info.size;
        let size = (height * width) as usize;
        let pixels = Pixels::of(&input)?.part(self.plane(info)? as usize * size, size);
        job.progress(0.0, "finding the limits")?;
        let percent = [self.percentile_low, self.percentile_high];
        let limits = display(&pixels, [self.low, self.high], percent, job)?;
        let plane = Plane {
            pixels,
            info,
            limits,
            lut: self.lut,
            gamma: self.gamma,
        };
        let path = Path::new(&job.file()?.path);
        let io = |error: &std::io::Error| Failure::io("write", path, error);
        let file = File::create(path).map_err(|e| io(&e))?;
        let mut file = BufWriter::with_capacity(1 << 20, file);
        match plane.encode(&mut file, self.comment.as_deref(), job) {
            Ok(()) => file.flush().map_err(|e| io(&e)),
            Err(Stop::Failed(failure)) => Err(failure),
            Err(Stop::Png(EncodingError::IoError(error))) => Err(io(&error)),
            Err(Stop::Png(error)) => Err(Failure::internal(format!(
                "cannot write {}: {error}",
                path.display()
            ))),
        }
    }
}

puncta_sdk::register!(PngWrite);

impl PngWrite {
    /// Number of the chosen plane, and whether PNG can hold it.
    fn plane(&self, info: &ImageInfo) -> Result<u64, Failure> {
        let [frames, channels, slices, height, width] = info.size;
        let check = |name: &str, number: u64, count: u64| {
            if number < count {
                return Ok(());
            }
            let message = format!("{name} {number} was asked for, but the image has {count}");
            let failure = Failure::bad_parameter(name, message);
            Err(failure.remedy("counting starts at 0"))
        };
        check("slice", self.slice, slices)?;
        check("channel", self.channel, channels)?;
        check("frame", self.frame, frames)?;
        let longest = i32::MAX as u64;
        if width == 0 || height == 0 || width > longest || height > longest {
            let message = format!("an image of {width} x {height} pixels cannot be a PNG file");
            return Err(Failure::bad_input(message).remedy("use other pixels, or write TIFF"));
        }
        Ok((self.frame * channels + self.channel) * slices + self.slice)
    }
}

/// A plane to write.
struct Plane<'a> {
    pixels: Pixels<'a>,
    info: &'a ImageInfo,
    limits: [f64; 2],
    lut: Lut,
    gamma: f64,
}

/// Why writing stopped.
enum Stop {
    Failed(Failure),
    Png(EncodingError),
}

impl From<EncodingError> for Stop {
    fn from(error: EncodingError) -> Self {
        Stop::Png(error)
    }
}

impl From<std::io::Error> for Stop {
    fn from(error: std::io::Error) -> Self {
        Stop::Png(EncodingError::IoError(error))
    }
}

impl From<puncta_sdk::Cancelled> for Stop {
    fn from(cancelled: puncta_sdk::Cancelled) -> Self {
        Stop::Failed(cancelled.into())
    }
}

impl Plane<'_> {
    fn encode(&self, out: impl Write, comment: Option<&str>, run: &dyn Run) -> Result<(), Stop> {
        let [.., height, width] = self.info.size;
        // Sizes were checked when the call was planned.
        let mut encoder = Encoder::new(out, width as u32, height as u32);
        encoder.set_color(ColorType::Indexed);
        encoder.set_depth(BitDepth::Eight);
        encoder.set_palette(self.lut.colours().concat());
        encoder.set_compression(Compression::Fast);
        // Differences of colour numbers mean nothing.
        encoder.set_filter(Filter::NoFilter);
        let [_, y, x] = self.info.voxel;
        encoder.set_pixel_dims(per_metre(x).zip(per_metre(y)).map(|(xppu, yppu)| {
            PixelDimensions {
                xppu,
                yppu,
                unit: Unit::Meter,
            }
        }));
        encoder.add_text_chunk("Software".into(), "Puncta".into())?;
        encoder.add_itxt_chunk("Description".into(), self.description())?;
        if let Some(comment) = comment {
            encoder.add_itxt_chunk("Comment".into(), comment.into())?;
        }
        let mut writer = encoder.write_header()?;
        let mut stream = writer.stream_writer_with_size(FILE_CHUNK)?;
        let size = self.pixels.len();
        let mut levels = vec![0_u8; CHUNK.min(size)];
        for from in (0..size).step_by(CHUNK) {
            let levels = &mut levels[..CHUNK.min(size - from)];
            self.levels(from, levels, run);
            stream.write_all(levels)?;
            run.progress(from as f64 / size as f64, "writing the image")?;
        }
        stream.finish()?;
        writer.finish()?;
        Ok(())
    }

    /// Colour numbers of the pixels from `from` on.
    fn levels(&self, from: usize, out: &mut [u8], run: &dyn Run) {
        const TASK: usize = 1 << 16;
        let [low, high] = self.limits;
        let scale = 1.0 / (high - low);
        chunks_mut(run, out, TASK, &|i, out| {
            let part = self.pixels.part(from + i * TASK, out.len());
            let t = |v: f64| ((v - low) * scale).clamp(0.0, 1.0);
            // A cast of a float gives 0 for NaN. Two loops, as a power takes long.
            if self.gamma == 1.0 {
                each_type!(part, values => for (o, v) in out.iter_mut().zip(values) {
                    *o = (t(v.wide()) * 255.0 + 0.5) as u8;
                });
            } else {
                each_type!(part, values => for (o, v) in out.iter_mut().zip(values) {
                    *o = (t(v.wide()).powf(self.gamma) * 255.0 + 0.5) as u8;
                });
            }
        });
    }

    fn description(&self) -> String {
        let [low, high] = self.limits;
        let [_, y, x] = self.info.voxel;
        let [_, origin_y, origin_x] = self.info.origin;
        format!(
            "pixel size {x} x {y} nm; low corner at {origin_x}, {origin_y} nm; colours {:?} from \
             {low} to {high}; gamma {}",
            self.lut, self.gamma
        )
    }
}

/// Pixels per metre, where that is a number that PNG can hold.
fn per_metre(size: f64) -> Option<u32> {
    let count = (1e9 / size).round();
    (count >= 1.0 && count <= f64::from(i32::MAX)).then_some(count as u32)
}

#[cfg(test)]
mod tests;
