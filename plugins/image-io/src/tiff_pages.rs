//! The pages of a TIFF file: which of them make the image, and what they are.

use crate::calibration::{self, Calibration};
use crate::options::ImageOptions;
use crate::store::Stored;
use puncta_sdk::documents::ImageInfo;
use puncta_sdk::{Failure, FailureCode};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use tiff::decoder::{Decoder, Limits, ifd::Value};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

/// Pages that are looked at.
const MOST_PAGES: u64 = 16_000_000;
/// Voxels of an image that a machine may hold.
const MOST_VOXELS: u64 = 1 << 44;
/// Bytes of one page that is decoded.
const MOST_PAGE: usize = 1 << 30;

pub(crate) type Open = Decoder<BufReader<File>>;

/// An image in a TIFF file.
pub(crate) struct Pages {
    pub(crate) info: ImageInfo,
    pub(crate) stored: Stored,
    /// Numbers of a pixel in the file; each is a channel.
    pub(crate) samples: u64,
    pub(crate) linear: Option<[f64; 2]>,
    pub(crate) unit: String,
    /// The planes lie behind each other from this byte on, in the byte order `big_endian`.
    pub(crate) run: Option<(u64, bool)>,
    /// Places of the pages among all of the file.
    pub(crate) pages: Vec<u64>,
    /// The axes of the planes, the fastest first: 0 t, 1 c, 2 z.
    order: [usize; 3],
    pub(crate) description: String,
    pub(crate) format: &'static str,
}

/// Opens a file.
///
/// # Errors
/// A file that cannot be read, or is no TIFF.
pub(crate) fn open(path: &Path, name: &str) -> Result<Open, Failure> {
    let file = File::open(path).map_err(|e| Failure::io("read", path, &e))?;
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MOST_PAGE;
    limits.intermediate_buffer_size = MOST_PAGE;
    let decoder = Decoder::new(BufReader::with_capacity(1 << 18, file));
    decoder
        .map(|decoder| decoder.with_limits(limits))
        .map_err(|e| failure(e, name, None))
}

/// A sentence for what the decoder says.
pub(crate) fn failure(error: TiffError, name: &str, page: Option<u64>) -> Failure {
    let place = page.map_or(String::new(), |page| format!(", page {}", page + 1));
    match error {
        TiffError::IoError(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => Failure::new(
            FailureCode::Io,
            format!("{name}{place} cannot be read ({e})"),
        ),
        TiffError::UnsupportedError(e) => {
            Failure::new(FailureCode::Unsupported, format!("{name}{place}: {e}"))
                .remedy("save it again as grey values, without compression")
        }
        TiffError::LimitsExceeded => {
            let message = format!("{name}{place} is larger than 1 GiB");
            Failure::new(FailureCode::Unsupported, message).remedy("save it in smaller planes")
        }
        e => Failure::bad_file(format!("{name}{place} is damaged ({e})"))
            .remedy("copy it again from its source"),
    }
}

/// What one page holds.
#[derive(Clone, Copy, PartialEq)]
struct Page {
    width: u64,
    height: u64,
    samples: u64,
    stored: Stored,
}

/// The type of numbers of a sample format with so many bits.
fn number(format: u16, bits: u8) -> Option<Stored> {
    Some(match (format, bits) {
        (1 | 4, 8) => Stored::U8,
        (1 | 4, 16) => Stored::U16,
        (1 | 4, 32) => Stored::U32,
        (1 | 4, 64) => Stored::U64,
        (2, 8) => Stored::I8,
        (2, 16) => Stored::I16,
        (2, 32) => Stored::I32,
        (2, 64) => Stored::I64,
        (3, 16) => Stored::F16,
        (3, 32) => Stored::F32,
        (3, 64) => Stored::F64,
        _ => return None,
    })
}

fn page(decoder: &mut Open, name: &str, at: u64) -> Result<Option<Page>, Failure> {
    let failed = |e| failure(e, name, Some(at));
    let (width, height) = decoder.dimensions().map_err(failed)?;
    let reduced = decoder
        .find_tag_unsigned::<u32>(Tag::NewSubfileType)
        .unwrap_or(None);
    if reduced.is_some_and(|kind| kind & 1 == 1) || width == 0 || height == 0 {
        return Ok(None);
    }
    let colour = decoder.colortype().map_err(failed)?;
    let samples = match colour {
        ColorType::Gray(_) | ColorType::Palette(_) => 1,
        ColorType::GrayA(_) => 2,
        ColorType::RGB(_) | ColorType::YCbCr(_) | ColorType::Lab(_) => 3,
        ColorType::RGBA(_) | ColorType::CMYK(_) => 4,
        ColorType::CMYKA(_) => 5,
        ColorType::Multiband { num_samples, .. } => u64::from(num_samples),
        _ => 1,
    };
    let planar = decoder
        .find_tag_unsigned::<u16>(Tag::PlanarConfiguration)
        .unwrap_or(None);
    let unsupported = |what: String| {
        Failure::new(
            FailureCode::Unsupported,
            format!("{name}, page {}: {what}", at + 1),
        )
        .remedy("save it again as plain planes of 8, 16 or 32 bits")
    };
    if planar == Some(2) && samples > 1 {
        return Err(unsupported(
            "its channels are kept apart in one page".into(),
        ));
    }
    let formats = decoder
        .find_tag_unsigned_vec::<u16>(Tag::SampleFormat)
        .unwrap_or(None);
    let format = formats.and_then(|f| f.first().copied()).unwrap_or(1);
    let bits = colour.bit_depth();
    let stored = number(format, bits);
    let stored =
        stored.ok_or_else(|| unsupported(format!("numbers of {bits} bits, format {format}")))?;
    Ok(Some(Page {
        width: width.into(),
        height: height.into(),
        samples: samples.max(1),
        stored,
    }))
}

/// Looks at all pages of a file. Notes say what was taken as what, and what was left out.
///
/// # Errors
/// A damaged file, or pages that cannot be decoded.
pub(crate) fn look(
    decoder: &mut Open,
    name: &str,
    length: u64,
    options: &ImageOptions,
    notes: &mut Vec<String>,
) -> Result<Pages, Failure> {
    let description = decoder
        .get_tag_ascii_string(Tag::ImageDescription)
        .unwrap_or_default();
    let mut said = calibration::imagej(&description).or_else(|| calibration::ome(&description));
    let format = format(said.as_ref());
    let lateral = lateral(decoder, said.as_ref());
    let (first, found) = walk(decoder, name, notes)?;
    let run = behind_each_other(
        decoder,
        &first,
        said.as_ref(),
        found.len() as u64,
        length,
        name,
    )?;
    let count = match (run, &said) {
        (Some(_), Some(said)) => said.planes.iter().product(),
        _ => found.len() as u64,
    };
    if let Some(said) = said.as_mut() {
        check_planes(said, count, first.samples, name, notes);
    }
    if said.is_none() && count > 1 && !options.says_planes() {
        notes.push(format!(
            "The {count} pages of {name} are taken as planes along z; --planes t or c says otherwise."
        ));
    }
    let said = said.filter(|_| !options.says_planes() || count == 1);
    let (mut info, order) = grid(&first, count, said.as_ref(), lateral, options);
    options.apply(&mut info, name, notes);
    if info.voxels().is_none_or(|voxels| voxels > MOST_VOXELS) {
        let [.., height, width] = info.size;
        let message = format!("{name} announces {count} pages of {width} x {height} pixels");
        return Err(Failure::bad_file(message).remedy("copy it again from its source"));
    }
    let linear = said.as_ref().and_then(|said| said.linear);
    Ok(Pages {
        info,
        stored: first.stored,
        samples: first.samples,
        linear,
        unit: said
            .and_then(|s| s.value_unit)
            .unwrap_or_else(|| "1".to_owned()),
        run,
        pages: found,
        order,
        description,
        format,
    })
}

fn format(said: Option<&Calibration>) -> &'static str {
    match said {
        Some(said) if said.contiguous => "ImageJ TIFF",
        Some(_) => "OME-TIFF",
        None => "TIFF",
    }
}

/// The first page, and the places of all pages like it.
fn walk(
    decoder: &mut Open,
    name: &str,
    notes: &mut Vec<String>,
) -> Result<(Page, Vec<u64>), Failure> {
    let mut found = Vec::new();
    let mut first: Option<Page> = None;
    let (mut others, mut at) = (0_u64, 0_u64);
    loop {
        if let Some(page) = page(decoder, name, at)? {
            match first.get_or_insert(page) {
                same if *same == page => found.push(at),
                _ => others += 1,
            }
        }
        at += 1;
        if !decoder.more_images() || at >= MOST_PAGES {
            break;
        }
        decoder
            .next_image()
            .map_err(|e| failure(e, name, Some(at)))?;
    }
    let Some(first) = first else {
        return Err(Failure::bad_file(format!("{name} holds no image")));
    };
    if others > 0 {
        notes.push(format!(
            "{others} of {} pages of {name} have another size or type and are left out.",
            others + found.len() as u64
        ));
    }
    Ok((first, found))
}

/// Takes the pages as they come where their number is not the announced one.
fn check_planes(
    said: &mut Calibration,
    count: u64,
    samples: u64,
    name: &str,
    notes: &mut Vec<String>,
) {
    let planes = said.planes.iter().try_fold(1_u64, |n, p| n.checked_mul(*p));
    // OME counts the samples of a pixel among the channels.
    if planes == Some(count) || !said.contiguous && planes == Some(count * samples) {
        return;
    }
    notes.push(format!(
        "{name} announces {:?} planes along t, c and z but holds {count} pages; they are taken as they \
         come.",
        said.planes
    ));
    said.planes = [1, 1, count];
    said.order = "ZCT".to_owned();
}

/// Side of a pixel along y and x in nm, by the tags of the resolution.
fn lateral(decoder: &mut Open, said: Option<&Calibration>) -> Option<[f64; 2]> {
    let by_tag = decoder
        .find_tag_unsigned::<u16>(Tag::ResolutionUnit)
        .unwrap_or(None);
    // Inches are what programs write that know no size; a micrograph has centimetres.
    let unit = match (said, by_tag) {
        (Some(said), _) if said.contiguous => said.unit?,
        (_, Some(3)) => 1e7,
        _ => return None,
    };
    let mut size = |tag: Tag| match decoder.find_tag(tag) {
        Ok(Some(Value::Rational(n, d))) if n > 0 && d > 0 => {
            Some(f64::from(d) * unit / f64::from(n))
        }
        _ => None,
    };
    Some([size(Tag::YResolution)?, size(Tag::XResolution)?])
}

/// ImageJ writes one page for stacks beyond 4 GB: the planes follow the first.
fn behind_each_other(
    decoder: &mut Open,
    first: &Page,
    said: Option<&Calibration>,
    pages: u64,
    length: u64,
    name: &str,
) -> Result<Option<(u64, bool)>, Failure> {
    let Some(said) = said.filter(|said| said.contiguous && pages == 1 && first.samples == 1) else {
        return Ok(None);
    };
    let planes = said.planes.iter().try_fold(1_u64, |n, p| n.checked_mul(*p));
    let plain = decoder
        .find_tag_unsigned::<u16>(Tag::Compression)
        .unwrap_or(None);
    if planes.is_none_or(|planes| planes < 2) || plain.is_some_and(|c| c != 1) {
        return Ok(None);
    }
    let offsets = decoder.get_tag_u64_vec(Tag::StripOffsets);
    let start = offsets.ok().and_then(|offsets| offsets.first().copied());
    let bytes = planes
        .and_then(|n| n.checked_mul(first.width))
        .and_then(|n| n.checked_mul(first.height))
        .and_then(|n| n.checked_mul(first.stored.size() as u64));
    let end = bytes
        .zip(start)
        .and_then(|(bytes, start)| bytes.checked_add(start));
    if end.is_none_or(|end| end > length) {
        let planes = planes.unwrap_or(u64::MAX);
        let message = format!("{name} announces {planes} planes, but has {length} bytes");
        return Err(Failure::bad_file(message).remedy("copy it again from its source"));
    }
    let big = decoder.byte_order() == tiff::tags::ByteOrder::BigEndian;
    Ok(start.map(|start| (start, big)))
}

fn grid(
    first: &Page,
    count: u64,
    said: Option<&Calibration>,
    lateral: Option<[f64; 2]>,
    options: &ImageOptions,
) -> (ImageInfo, [usize; 3]) {
    let mut info = ImageInfo::plane(first.width, first.height, 0.0, 0.0, 0.0);
    let axis = |letter: char| match letter {
        'T' => 0,
        'C' => 1,
        _ => 2,
    };
    let mut order = [1, 2, 0];
    match said {
        Some(said) => {
            for (place, planes) in info.size.iter_mut().zip(said.planes) {
                *place = planes;
            }
            for (place, letter) in order.iter_mut().zip(said.order.chars()) {
                *place = axis(letter);
            }
            info.voxel = said.voxel;
            info.frame_time = said.frame_time;
            info.channels.clone_from(&said.channels);
        }
        None => {
            if let Some(size) = info.size.get_mut(options.axis()) {
                *size = count;
            }
        }
    }
    if let Some([y, x]) = lateral.filter(|_| info.voxel[2] == 0.0) {
        info.voxel[1] = y;
        info.voxel[2] = x;
    }
    if let Some(said) = said {
        for axis in 0..3 {
            info.origin[axis] = match said.corner {
                Some(corner) => corner[axis],
                None if said.zero[axis] == 0.0 => 0.0,
                None => -said.zero[axis] * info.voxel[axis],
            };
        }
    }
    if first.samples > 1 {
        // Colours are channels; those of OME count them already.
        let channels = info.size[1];
        let counted = channels.is_multiple_of(first.samples) && said.is_some_and(|s| !s.contiguous);
        if !counted {
            info.size[1] = channels * first.samples;
        }
        info.channels.truncate(info.size[1] as usize);
        if info.channels.len() as u64 != info.size[1] {
            info.channels.clear();
        }
    }
    (info, order)
}

impl Pages {
    /// Number of planes in the file, each with all samples of its pixels.
    pub(crate) fn planes(&self) -> u64 {
        let [t, c, z, ..] = self.info.size;
        t * c * z / self.samples
    }

    /// Where plane number `plane` of the file begins in the image, in pixels, for one of its
    /// samples.
    pub(crate) fn place(&self, plane: u64, sample: u64) -> u64 {
        let [t, c, z, height, width] = self.info.size;
        let sizes = [t, c / self.samples, z];
        let mut index = [0_u64; 3];
        let mut rest = plane;
        for axis in self.order {
            let (Some(size), Some(place)) = (sizes.get(axis), index.get_mut(axis)) else {
                continue;
            };
            *place = rest % (*size).max(1);
            rest /= (*size).max(1);
        }
        let [t, channel, z_index] = index;
        let channel = channel * self.samples + sample;
        ((t * c + channel) * z + z_index) * height * width
    }
}
