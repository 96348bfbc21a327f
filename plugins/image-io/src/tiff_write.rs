//! The writer `puncta.image.tiff.write/1`.

use crate::calibration::ome_text;
use crate::imagej::{Description, resolution};
use crate::levels::{Levels, NumberType};
use crate::limits::display;
use crate::pixels::{Pixels, image_info, plan};
use puncta_sdk::documents::manifest::Step;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::Path;
use tiff::encoder::{DirectoryEncoder, Rational, TiffEncoder, TiffKind};
use tiff::tags::Tag;
use tiff::{TiffError, TiffResult};

/// Pixels converted and written at a time.
const CHUNK: usize = 1 << 20;
/// Bytes of a page's tags, generously.
const PAGE_BYTES: u64 = 512;

/// Writes an image as TIFF that ImageJ reads with its calibration.
#[derive(Params)]
pub struct TiffWrite {
    /// Type of the stored numbers; whole numbers are scaled where the values do not fit.
    #[param(default = NumberType::Same)]
    pixel_type: NumberType,
    /// Value that scaling makes 0; the smallest if left out.
    #[param(advanced)]
    scale_min: Option<f64>,
    /// Value that scaling makes the largest whole number; the largest if left out.
    #[param(advanced)]
    scale_max: Option<f64>,
    /// A text that is stored with the image.
    #[param(advanced)]
    comment: Option<String>,
}

impl Operation for TiffWrite {
    const ID: &'static str = "puncta.image.tiff.write/1";

    fn info() -> Info {
        Info::writer("TIFF", &[".tif", ".tiff"])
            .description(
                "Writes an image as TIFF with the size of its pixels, its origin and the order of \
                 its planes as ImageJ reads them. Numbers keep their type unless another is \
                 chosen; where whole numbers are scaled, the file says how, and ImageJ shows the \
                 values. Above 4 GB the file is a BigTIFF. A name that ends with .ome.tif makes \
                 it OME-TIFF.",
            )
            .input(Ports::image("image"))
            .example(json!({}))
            .example_step("image", example_image())
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        plan(request, 32 << 20)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let input = job.input("image")?;
        let info = image_info(input.header())?;
        let pixels = Pixels::of(&input)?;
        job.progress(0.0, "looking at the values")?;
        let values = pixels.summary(job)?;
        let levels = Levels::new(
            self.pixel_type,
            &values,
            info.labels,
            [self.scale_min, self.scale_max],
        )?;
        if values.not_finite > 0 && levels.linear.is_some() {
            job.warn(&format!(
                "{} pixels without a finite value are stored as 0 or the largest number",
                values.not_finite
            ));
        }
        let shown = display(&pixels, [None; 2], [0.0, 99.9], job)?;
        let unit = input
            .header()
            .parts
            .first()
            .and_then(|part| part.columns.first());
        let description = Description {
            display: shown.map(|v| levels.number(v)),
            linear: levels.linear,
            unit: unit.map_or("1", |column| column.unit.as_str()),
            comment: self.comment.as_deref(),
        };
        let file = job.file()?;
        let lower = file.name.to_lowercase();
        let ome = lower.ends_with(".ome.tif") || lower.ends_with(".ome.tiff");
        let text = match ome_type(levels.format(&pixels)).filter(|_| ome && levels.linear.is_none())
        {
            Some(name) => ome_text(info, name, description.unit, self.comment.as_deref()),
            None => description.text(info),
        };
        if ome && !text.starts_with("<?xml") {
            job.warn(
                "OME-TIFF cannot say how numbers were scaled; the file has ImageJ's description",
            );
        }
        let stack = Stack {
            info,
            pixels,
            levels,
            // Texts of TIFF are ASCII; OME's are UTF-8 in all programs, as references they are both.
            description: ascii(&text),
        };
        let path = Path::new(&job.file()?.path);
        write(&stack, path, job)
    }
}

puncta_sdk::register!(TiffWrite);

/// What OME calls numbers of so many bits and this sample format.
fn ome_type((bits, format): (u16, u16)) -> Option<&'static str> {
    Some(match (bits, format) {
        (8, 1) => "uint8",
        (16, 1) => "uint16",
        (32, 1) => "uint32",
        (8, 2) => "int8",
        (16, 2) => "int16",
        (32, 2) => "int32",
        (32, 3) => "float",
        (64, 3) => "double",
        _ => return None,
    })
}

/// Letters beyond ASCII as references of XML; ImageJ's text has none.
fn ascii(text: &str) -> String {
    let letter = |c: char| match c.is_ascii() {
        true => c.to_string(),
        false => format!("&#{};", u32::from(c)),
    };
    text.chars().map(letter).collect()
}

/// A rendered image for the examples.
pub(crate) fn example_image() -> Step {
    let table = Step {
        op: "puncta.synthetic.membrane/1".into(),
        ..Step::default()
    };
    Step {
        op: "puncta.render.histogram/1".into(),
        parameters: Map::from_iter([("pixel_size".into(), json!(20))]),
        inputs: [("table".into(), table)].into(),
        ..Step::default()
    }
}

/// What is written.
struct Stack<'a> {
    info: &'a ImageInfo,
    pixels: Pixels<'a>,
    levels: Levels,
    description: String,
}

/// Why writing stopped.
enum Stop {
    Failed(Failure),
    Tiff(TiffError),
}

impl From<TiffError> for Stop {
    fn from(error: TiffError) -> Self {
        Stop::Tiff(error)
    }
}

impl From<puncta_sdk::Cancelled> for Stop {
    fn from(cancelled: puncta_sdk::Cancelled) -> Self {
        Stop::Failed(cancelled.into())
    }
}

impl Stack<'_> {
    fn planes(&self) -> u64 {
        let [t, c, z, ..] = self.info.size;
        t * c * z
    }

    /// Bytes of a plane in the file.
    fn plane_bytes(&self) -> u64 {
        let [.., y, x] = self.info.size;
        y * x * u64::from(self.levels.format(&self.pixels).0 / 8)
    }

    /// Whether offsets need 64 bits.
    fn is_big(&self) -> bool {
        let tags = self.planes() * PAGE_BYTES + self.description.len() as u64;
        self.planes() * self.plane_bytes() + tags > u64::from(u32::MAX) - 1024
    }
}

fn write(stack: &Stack<'_>, path: &Path, run: &dyn Run) -> Result<(), Failure> {
    let [.., height, width] = stack.info.size;
    if u32::try_from(width).is_err() || u32::try_from(height).is_err() {
        let message = format!("an image of {width} x {height} pixels is too wide for a TIFF file");
        return Err(Failure::bad_input(message).remedy("use larger pixels"));
    }
    let io = |error: &std::io::Error| Failure::io("write", path, error);
    let mut file = BufWriter::with_capacity(1 << 20, File::create(path).map_err(|e| io(&e))?);
    let result = if stack.is_big() {
        TiffEncoder::new_big(&mut file)
            .map_err(Stop::from)
            .and_then(|tiff| encode(stack, tiff, run))
    } else {
        TiffEncoder::new(&mut file)
            .map_err(Stop::from)
            .and_then(|tiff| encode(stack, tiff, run))
    };
    match result {
        Ok(()) => file.flush().map_err(|e| io(&e)),
        Err(Stop::Failed(failure)) => Err(failure),
        Err(Stop::Tiff(TiffError::IoError(error))) => Err(io(&error)),
        Err(Stop::Tiff(error)) => Err(Failure::internal(format!(
            "cannot write {}: {error}",
            path.display()
        ))),
    }
}

/// Writes all planes one after the other, as ImageJ needs them, and then the pages that point to
/// them.
fn encode<W: Write + Seek, K: TiffKind>(
    stack: &Stack<'_>,
    mut tiff: TiffEncoder<W, K>,
    run: &dyn Run,
) -> Result<(), Stop> {
    let [frames, channels, slices, height, width] = stack.info.size;
    let size = (height * width) as usize;
    let mut offsets = Vec::new();
    let mut first = tiff.image_directory()?;
    let mut bytes = Vec::new();
    for plane in 0..stack.planes() {
        // Channel fastest in the file, x y z c t in memory.
        let (c, z, t) = (
            plane % channels,
            plane / channels % slices,
            plane / channels / slices,
        );
        let start = ((t * channels + c) * slices + z) as usize * size;
        for from in (0..size).step_by(CHUNK) {
            let part = stack.pixels.part(start + from, CHUNK.min(size - from));
            stack.levels.bytes(&part, &mut bytes);
            let offset = first.write_data(&bytes[..])?;
            if from == 0 {
                offsets.push(offset);
            }
            let done = plane as f64 + from as f64 / size as f64;
            run.progress(done / stack.planes() as f64, "writing the image")?;
        }
    }
    debug_assert_eq!(offsets.len() as u64, frames * channels * slices);
    let mut offsets = offsets.into_iter();
    if let Some(offset) = offsets.next() {
        page(&mut first, stack, offset)?;
        first.write_tag(Tag::ImageDescription, stack.description.as_str())?;
        first.write_tag(Tag::Software, "Puncta")?;
    }
    first.finish()?;
    for offset in offsets {
        let mut directory = tiff.image_directory()?;
        page(&mut directory, stack, offset)?;
        directory.finish()?;
    }
    Ok(())
}

/// The tags of a page whose one strip starts at `offset`.
fn page<W: Write + Seek, K: TiffKind>(
    directory: &mut DirectoryEncoder<'_, W, K>,
    stack: &Stack<'_>,
    offset: u64,
) -> TiffResult<()> {
    let [.., height, width] = stack.info.size;
    let (bits, format) = stack.levels.format(&stack.pixels);
    let (width, height) = (u32::try_from(width)?, u32::try_from(height)?);
    directory.write_tag(Tag::ImageWidth, width)?;
    directory.write_tag(Tag::ImageLength, height)?;
    directory.write_tag(Tag::BitsPerSample, bits)?;
    directory.write_tag(Tag::Compression, 1_u16)?;
    // Black is zero.
    directory.write_tag(Tag::PhotometricInterpretation, 1_u16)?;
    directory.write_tag(Tag::SamplesPerPixel, 1_u16)?;
    directory.write_tag(Tag::RowsPerStrip, height)?;
    directory.write_tag(Tag::SampleFormat, format)?;
    let strip = [offset, stack.plane_bytes()];
    if stack.is_big() {
        directory.write_tag(Tag::StripOffsets, strip[0])?;
        directory.write_tag(Tag::StripByteCounts, strip[1])?;
    } else {
        directory.write_tag(Tag::StripOffsets, u32::try_from(strip[0])?)?;
        directory.write_tag(Tag::StripByteCounts, u32::try_from(strip[1])?)?;
    }
    let [_, y, x] = stack.info.voxel;
    if let (Some(x), Some(y)) = (resolution(x), resolution(y)) {
        directory.write_tag(Tag::XResolution, Rational { n: x.0, d: x.1 })?;
        directory.write_tag(Tag::YResolution, Rational { n: y.0, d: y.1 })?;
        // No unit that TIFF knows: the description names it.
        directory.write_tag(Tag::ResolutionUnit, 1_u16)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
