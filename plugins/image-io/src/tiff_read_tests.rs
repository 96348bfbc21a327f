use super::*;
use crate::TiffWrite;
use puncta_testkit::{Call, Object};
use std::path::PathBuf;
use std::process::Command;

fn values(image: &Object) -> Vec<f64> {
    let f64s = |v: Vec<f32>| v.into_iter().map(f64::from).collect();
    match image.header.parts[0].columns[0].type_.element {
        Element::F64 => image.f64("value").unwrap(),
        Element::F32 => f64s(image.f32("value").unwrap()),
        Element::I32 => image
            .i32("value")
            .unwrap()
            .into_iter()
            .map(f64::from)
            .collect(),
        Element::U16 => {
            let numbers = image
                .numbers(0, "value", Element::U16, u16::from_ne_bytes)
                .unwrap();
            numbers.into_iter().map(f64::from).collect()
        }
        _ => {
            let numbers = image
                .numbers(0, "value", Element::U8, u8::from_ne_bytes)
                .unwrap();
            numbers.into_iter().map(f64::from).collect()
        }
    }
}

fn stack() -> (ImageInfo, Vec<f32>) {
    let info = ImageInfo {
        size: [2, 3, 4, 5, 7],
        voxel: [50.0, 10.35, 10.35],
        origin: [-100.0, 45.0, -30.0],
        frame_time: 0.02,
        channels: vec!["a".into(), "µ".into(), "c".into()],
        labels: false,
    };
    let values = (0..2 * 3 * 4 * 5 * 7)
        .map(|i| i as f32 * 0.5 - 7.0)
        .collect();
    (info, values)
}

fn written(folder: &Path, name: &str) -> PathBuf {
    let (info, values) = stack();
    let path = folder.join(name);
    let image = Object::image("stack", info, &values);
    Call::of::<TiffWrite>()
        .input("image", image)
        .file(&path)
        .run()
        .unwrap();
    path
}

fn read(path: &Path) -> Result<Object, Failure> {
    let done = Call::of::<TiffRead>().file(path).run()?;
    Ok(done.output("image").unwrap().clone())
}

fn check_grid(found: &ImageInfo) {
    let (info, _) = stack();
    assert_eq!(found.size, info.size);
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
    assert!(near(found.voxel, info.voxel), "{:?}", found.voxel);
    assert!(near(found.origin, info.origin), "{:?}", found.origin);
    assert_eq!((found.frame_time, &found.channels), (0.02, &info.channels));
}

#[test]
fn hyperstacks_of_both_kinds_come_back() {
    let folder = tempfile::tempdir().unwrap();
    for (name, format) in [("a.tif", "ImageJ TIFF"), ("a.ome.tif", "OME-TIFF")] {
        let path = written(folder.path(), name);
        let plan = Call::of::<TiffRead>().file(&path).prepare().unwrap();
        assert_eq!(plan.probe.unwrap().format, format);
        assert_eq!(plan.notes, Vec::<String>::new());
        let image = read(&path).unwrap();
        check_grid(image.header.image.as_ref().unwrap());
        assert_eq!(image.f32("value").unwrap(), stack().1, "{name}");
    }
}

#[test]
fn scaled_whole_numbers_give_their_values() {
    let folder = tempfile::tempdir().unwrap();
    let (info, numbers) = stack();
    let path = folder.path().join("s.tif");
    let image = Object::image("stack", info, &numbers);
    let call = Call::of::<TiffWrite>()
        .set("pixel_type", "uint16")
        .input("image", image);
    call.file(&path).run().unwrap();
    let found = values(&read(&path).unwrap());
    let step = 419.5 / 65535.0;
    for (found, wanted) in found.iter().zip(&numbers) {
        assert!(
            (found - f64::from(*wanted)).abs() <= step,
            "{found} is not {wanted}"
        );
    }
}

/// A page of a small file: width, height, bits, format, samples, bytes.
type Page = (u32, u32, u16, u16, u16, Vec<u8>);

fn plain(pages: &[Page], resolution: Option<u16>) -> Vec<u8> {
    use tiff::encoder::{Rational, TiffEncoder};
    use tiff::tags::Tag;
    let mut file = std::io::Cursor::new(Vec::new());
    let mut tiff = TiffEncoder::new(&mut file).unwrap();
    for (width, height, bits, format, samples, bytes) in pages {
        let mut page = tiff.image_directory().unwrap();
        let offset = page.write_data(&bytes[..]).unwrap();
        let each = vec![*bits; usize::from(*samples)];
        page.write_tag(Tag::ImageWidth, *width).unwrap();
        page.write_tag(Tag::ImageLength, *height).unwrap();
        page.write_tag(Tag::BitsPerSample, &each[..]).unwrap();
        page.write_tag(Tag::Compression, 1_u16).unwrap();
        let colour = if *samples == 3 { 2_u16 } else { 1 };
        page.write_tag(Tag::PhotometricInterpretation, colour)
            .unwrap();
        page.write_tag(Tag::SamplesPerPixel, *samples).unwrap();
        page.write_tag(Tag::RowsPerStrip, *height).unwrap();
        page.write_tag(Tag::SampleFormat, *format).unwrap();
        page.write_tag(Tag::StripOffsets, offset as u32).unwrap();
        page.write_tag(Tag::StripByteCounts, bytes.len() as u32)
            .unwrap();
        if let Some(unit) = resolution {
            page.write_tag(Tag::XResolution, Rational { n: 100_000, d: 1 })
                .unwrap();
            page.write_tag(Tag::YResolution, Rational { n: 100_000, d: 1 })
                .unwrap();
            page.write_tag(Tag::ResolutionUnit, unit).unwrap();
        }
        page.finish().unwrap();
    }
    file.into_inner()
}

#[test]
fn pages_without_a_description() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.tif");
    let page = |k: u8| (2, 1, 16, 2, 1, vec![k, 0, 0xff, 0xff]);
    let other = (1, 1, 8, 1, 1, vec![9]);
    std::fs::write(&path, plain(&[page(1), other, page(2)], None)).unwrap();
    let plan = Call::of::<TiffRead>().file(&path).prepare().unwrap();
    assert!(plan.notes[0].contains("1 of 3 pages"), "{:?}", plan.notes);
    assert!(plan.notes[1].contains("--planes t"), "{:?}", plan.notes);
    assert!(plan.notes[2].contains("--pixel_size"), "{:?}", plan.notes);
    let image = read(&path).unwrap();
    assert_eq!(image.header.image.as_ref().unwrap().size, [1, 1, 2, 1, 2]);
    assert_eq!(values(&image), [1.0, -1.0, 2.0, -1.0]);
    let call = Call::of::<TiffRead>()
        .set("planes", "t")
        .set("pixel_size", 80)
        .set("frame_time", 0.5);
    let done = call.file(&path).run().unwrap();
    let info = done.output("image").unwrap().header.image.clone().unwrap();
    assert_eq!(
        (info.size, info.voxel[2], info.frame_time),
        ([2, 1, 1, 1, 2], 80.0, 0.5)
    );
}

#[test]
fn colours_are_channels_and_centimetres_a_size() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.tif");
    let page = (2, 1, 8, 1, 3, vec![1, 2, 3, 4, 5, 6]);
    std::fs::write(&path, plain(std::slice::from_ref(&page), Some(3))).unwrap();
    let image = read(&path).unwrap();
    let info = image.header.image.as_ref().unwrap();
    assert_eq!(
        (info.size, info.voxel),
        ([1, 3, 1, 1, 2], [0.0, 100.0, 100.0])
    );
    assert_eq!(values(&image), [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
    std::fs::write(&path, plain(&[page], Some(2))).unwrap();
    assert_eq!(read(&path).unwrap().header.image.unwrap().voxel, [0.0; 3]);
}

#[test]
fn stacks_of_imagej_with_one_page() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), "a.tif");
    let mut bytes = std::fs::read(&path).unwrap();
    // The link from the first page to the next is taken out.
    let first = u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize;
    let tags = usize::from(u16::from_le_bytes(
        bytes[first..first + 2].try_into().unwrap(),
    ));
    let link = first + 2 + 12 * tags;
    bytes[link..link + 4].fill(0);
    std::fs::write(&path, &bytes).unwrap();
    let image = read(&path).unwrap();
    check_grid(image.header.image.as_ref().unwrap());
    assert_eq!(image.f32("value").unwrap(), stack().1);
}

#[test]
fn damage_is_survived() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.tif", "a.ome.tif"] {
        let path = written(folder.path(), name);
        let whole = std::fs::read(&path).unwrap();
        for cut in 0..64 {
            std::fs::write(&path, &whole[..whole.len() * cut / 64]).unwrap();
            assert!(read(&path).is_err(), "{name} cut at {cut}");
        }
        let mut state = 3_u64;
        for _ in 0..200 {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            let mut bytes = whole.clone();
            let at = (state >> 33) as usize % bytes.len();
            bytes[at] = (state >> 20) as u8;
            std::fs::write(&path, &bytes).unwrap();
            if let Err(failure) = read(&path) {
                assert!(failure.code != FailureCode::Internal, "{failure}");
            }
        }
    }
}

/// A Python with a module, where there is one.
fn python(module: &str) -> Option<String> {
    let own = std::env::var("PUNCTA_TEST_PYTHON").ok();
    let import = format!("import {module}");
    let works = |name: &String| {
        let status = Command::new(name).args(["-c", &import]).output();
        status.is_ok_and(|output| output.status.success())
    };
    own.into_iter().chain(["python3".to_owned()]).find(works)
}

#[test]
#[allow(clippy::print_stderr, reason = "says that it is skipped")]
fn tifffile_reads_what_is_written() {
    let Some(python) = python("tifffile") else {
        eprintln!("skipped: no python3 with tifffile (PUNCTA_TEST_PYTHON may name one)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let script = "\
import sys, tifffile
for path, kind in [(sys.argv[1], 'is_imagej'), (sys.argv[2], 'is_ome')]:
    file = tifffile.TiffFile(path)
    assert getattr(file, kind), path
    series = file.series[0]
    assert (series.axes, series.shape) == ('TZCYX', (2, 4, 3, 5, 7)), (series.axes, series.shape)
    data = series.asarray().transpose(0, 2, 1, 3, 4).ravel()
    assert data.tolist() == [i * 0.5 - 7 for i in range(840)]
assert 'PhysicalSizeX=\"10.35\"' in tifffile.TiffFile(sys.argv[2]).ome_metadata
";
    let output = Command::new(python)
        .args(["-c", script])
        .arg(written(folder.path(), "a.tif"))
        .arg(written(folder.path(), "a.ome.tif"))
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}
