//! The reader `puncta.image.tiff.read/1`.

use crate::options::ImageOptions;
use crate::store::{Numbers, Stored};
use crate::tiff_pages::{Open, Pages, failure, look, open};
use puncta_sdk::output::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use tiff::decoder::DecodingResult;

const MAGIC: [&[u8]; 4] = [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"];

/// Reads an image from a TIFF file.
#[derive(Debug, Params)]
pub struct TiffRead {
    #[param(flatten)]
    options: ImageOptions,
}

fn begin(
    file: &puncta_sdk::documents::FileRef,
    options: &ImageOptions,
    notes: &mut Vec<String>,
) -> Result<(Open, Pages), Failure> {
    let path = Path::new(&file.path);
    let length = path
        .metadata()
        .map_err(|e| Failure::io("read", path, &e))?
        .len();
    let mut decoder = open(path, &file.name)?;
    let pages = look(&mut decoder, &file.name, length, options, notes)?;
    Ok((decoder, pages))
}

fn header(pages: &Pages) -> Header {
    let element = match pages.linear {
        Some(_) => Element::F64,
        None => pages.stored.element(),
    };
    let mut header = Header::image("image", pages.info.clone(), element, &pages.unit);
    let metadata = &mut header.metadata;
    metadata.insert("format".into(), pages.format.into());
    if !pages.description.is_empty() {
        metadata.insert("description".into(), pages.description.clone().into());
    }
    header
}

impl Operation for TiffRead {
    const ID: &'static str = "puncta.image.tiff.read/1";

    fn info() -> Info {
        Info::reader("TIFF", &[".tif", ".tiff", ".btf", ".tf8"])
            .description(
                "Reads an image from TIFF and BigTIFF: one page or many, hyperstacks of ImageJ with \
                 their calibration, also those beyond 4 GB, and OME-TIFF in one file.\n\
                 Numbers keep their type; of 8 and 16 bits with a sign they become i32, of 64 bits \
                 f64. Colours become channels. The size of pixels comes from ImageJ's or OME's \
                 description or a resolution per cm; otherwise it is given here.",
            )
            .formats(&MAGIC, &["TIFF", "ImageJ TIFF", "OME-TIFF"])
            .output(Ports::image("image"))
            .example(json!({ "pixel_size": 100 }))
            .example_bytes("image.tif", EXAMPLE)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let file = request.file.as_ref();
        let file = file.ok_or_else(|| Failure::internal("the call has no file"))?;
        let mut plan = Plan {
            interruptible: true,
            ..Plan::default()
        };
        let (_, pages) = begin(file, &self.options, &mut plan.notes)?;
        let [.., height, width] = pages.info.size;
        let page = height * width * pages.stored.size() as u64;
        plan.memory = page.saturating_mul(3 * pages.samples);
        plan.outputs.push(Output {
            output: "image".into(),
            form: OutputForm::Object,
            of: None,
            header: header(&pages),
        });
        plan.probe = Some(Probe {
            format: pages.format.into(),
            confidence: 0.9,
        });
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let file = job.file()?;
        let (mut decoder, pages) = begin(file, &self.options, &mut Vec::new())?;
        let mut out = job.begin("image", header(&pages))?;
        out.commit(0, pages.info.voxels().unwrap_or(0))?;
        let mut columns = out.columns_mut(0)?;
        let Some(column) = columns.first_mut() else {
            return Err(Failure::internal("an image without a column"));
        };
        match pages.run {
            Some((start, big)) => run(&mut decoder, &pages, (start, big), column, job)?,
            None => decode(&mut decoder, &pages, &file.name, column, job)?,
        }
        drop(columns);
        out.finish()
    }
}

/// Planes that lie behind each other.
fn run(
    decoder: &mut Open,
    pages: &Pages,
    (start, big_endian): (u64, bool),
    column: &mut ColumnMut<'_>,
    job: &Job,
) -> Result<(), Failure> {
    let [.., height, width] = pages.info.size;
    let pixels = usize::try_from(height * width).unwrap_or(usize::MAX);
    let mut bytes = vec![0; pixels.saturating_mul(pages.stored.size())];
    let file = decoder.inner();
    let path = Path::new(&job.file()?.path);
    let io = |e: &std::io::Error| Failure::io("read", path, e);
    file.seek(SeekFrom::Start(start)).map_err(|e| io(&e))?;
    for plane in 0..pages.planes() {
        job.progress(plane as f64 / pages.planes() as f64, "reading")?;
        file.read_exact(&mut bytes).map_err(|e| io(&e))?;
        let numbers = Numbers {
            bytes: &bytes,
            stored: pages.stored,
            big_endian,
            step: 1,
            first: 0,
            linear: pages.linear,
        };
        let at = usize::try_from(pages.place(plane, 0)).unwrap_or(usize::MAX);
        numbers.put(column, at, pixels)?;
    }
    Ok(())
}

/// Pages, one after the other.
fn decode(
    decoder: &mut Open,
    pages: &Pages,
    name: &str,
    column: &mut ColumnMut<'_>,
    job: &Job,
) -> Result<(), Failure> {
    let [.., height, width] = pages.info.size;
    let pixels = usize::try_from(height * width).unwrap_or(usize::MAX);
    let samples = usize::try_from(pages.samples).unwrap_or(1);
    decoder
        .seek_to_image(0)
        .map_err(|e| failure(e, name, None))?;
    let mut at = 0;
    for (plane, page) in pages.pages.iter().enumerate() {
        job.progress(plane as f64 / pages.pages.len() as f64, "reading")?;
        while at < *page {
            decoder
                .next_image()
                .map_err(|e| failure(e, name, Some(at)))?;
            at += 1;
        }
        let mut decoded = decoder
            .read_image()
            .map_err(|e| failure(e, name, Some(at)))?;
        let stored = stored(&decoded);
        let buffer = decoded.as_buffer(0);
        let bytes = buffer.as_bytes();
        if stored != pages.stored || bytes.len() / stored.size() < pixels * samples {
            let message = format!("{name}, page {}, is damaged: it is too short", at + 1);
            return Err(Failure::bad_file(message).remedy("copy it again from its source"));
        }
        for sample in 0..samples {
            let numbers = Numbers {
                bytes,
                stored,
                big_endian: cfg!(target_endian = "big"),
                step: samples,
                first: sample,
                linear: pages.linear,
            };
            let place = pages.place(plane as u64, sample as u64);
            numbers.put(column, usize::try_from(place).unwrap_or(usize::MAX), pixels)?;
        }
    }
    Ok(())
}

/// The type of decoded numbers.
fn stored(decoded: &DecodingResult) -> Stored {
    match decoded {
        DecodingResult::U8(_) => Stored::U8,
        DecodingResult::U16(_) => Stored::U16,
        DecodingResult::U32(_) => Stored::U32,
        DecodingResult::U64(_) => Stored::U64,
        DecodingResult::F16(_) => Stored::F16,
        DecodingResult::F32(_) => Stored::F32,
        DecodingResult::F64(_) => Stored::F64,
        DecodingResult::I8(_) => Stored::I8,
        DecodingResult::I16(_) => Stored::I16,
        DecodingResult::I32(_) => Stored::I32,
        DecodingResult::I64(_) => Stored::I64,
    }
}

/// Two pixels of 8 bits.
const EXAMPLE: &[u8] = &[
    b'I', b'I', 42, 0, 8, 0, 0, 0, 8, 0, // eight tags
    0, 1, 3, 0, 1, 0, 0, 0, 2, 0, 0, 0, // width
    1, 1, 3, 0, 1, 0, 0, 0, 1, 0, 0, 0, // height
    2, 1, 3, 0, 1, 0, 0, 0, 8, 0, 0, 0, // bits
    3, 1, 3, 0, 1, 0, 0, 0, 1, 0, 0, 0, // no compression
    6, 1, 3, 0, 1, 0, 0, 0, 1, 0, 0, 0, // black is zero
    17, 1, 4, 0, 1, 0, 0, 0, 110, 0, 0, 0, // where the strip is
    22, 1, 3, 0, 1, 0, 0, 0, 1, 0, 0, 0, // its rows
    23, 1, 4, 0, 1, 0, 0, 0, 2, 0, 0, 0, // its bytes
    0, 0, 0, 0, 7, 9,
];

puncta_sdk::register!(TiffRead);

#[cfg(test)]
#[path = "tiff_read_tests.rs"]
mod tests;
