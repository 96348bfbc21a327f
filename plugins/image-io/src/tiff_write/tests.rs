use super::*;
use puncta_testkit::{Call, Object};
use tiff::decoder::{Decoder, DecodingResult};

fn info(size: [u64; 5], voxel: [f64; 3]) -> ImageInfo {
    ImageInfo {
        size,
        voxel,
        ..ImageInfo::plane(1, 1, 1.0, -30.0, 45.0)
    }
}

fn read(path: &Path) -> Decoder<std::io::BufReader<File>> {
    Decoder::new(std::io::BufReader::new(File::open(path).unwrap())).unwrap()
}

fn floats(decoder: &mut Decoder<std::io::BufReader<File>>) -> Vec<f32> {
    match decoder.read_image().unwrap() {
        DecodingResult::F32(v) => v,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_plane_comes_back_with_its_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    let values: Vec<f32> = (0..700 * 3).map(|i| i as f32 * 0.37 - 5.0).collect();
    let image = Object::image("er", ImageInfo::plane(700, 3, 10.35, -30.0, 45.0), &values);
    let call = Call::of::<TiffWrite>()
        .set("comment", "one\nµ line")
        .input("image", image);
    call.file(&path).run().unwrap();
    let mut decoder = read(&path);
    assert_eq!(decoder.dimensions().unwrap(), (700, 3));
    assert_eq!(floats(&mut decoder), values);
    let rational = decoder.get_tag(Tag::XResolution).unwrap();
    assert_eq!(format!("{rational:?}"), "Rational(20, 207)");
    let text = decoder.get_tag_ascii_string(Tag::ImageDescription).unwrap();
    assert!(
        text.starts_with("ImageJ=1.11a\nimages=1\n") && text.contains("\nunit=nm\n"),
        "{text}"
    );
    assert!(text.contains("comment=one\\n\\u00b5 line\n"), "{text}");
    assert!(!decoder.more_images());
}

#[test]
fn planes_lie_one_after_the_other_channel_fastest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stack.tif");
    let size = [2, 3, 4, 5, 7];
    let values: Vec<f32> = (0..2 * 3 * 4 * 5 * 7).map(|i| i as f32).collect();
    let image = Object::image("stack", info(size, [50.0, 10.0, 10.0]), &values);
    Call::of::<TiffWrite>()
        .input("image", image)
        .file(&path)
        .run()
        .unwrap();
    let mut decoder = read(&path);
    let first = decoder.get_tag_u64(Tag::StripOffsets).unwrap();
    for page in 0..24_u64 {
        let (c, z, t) = (
            (page % 3) as usize,
            (page / 3 % 4) as usize,
            (page / 12) as usize,
        );
        let start = ((t * 3 + c) * 4 + z) * 35;
        assert_eq!(
            decoder.get_tag_u64(Tag::StripOffsets).unwrap(),
            first + page * 35 * 4
        );
        assert_eq!(
            floats(&mut decoder),
            &values[start..start + 35],
            "page {page}"
        );
        assert_eq!(decoder.more_images(), page < 23);
        if page < 23 {
            decoder.next_image().unwrap();
        }
    }
}

#[test]
fn whole_numbers_of_sixteen_bits_with_and_without_a_scale() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("u16.tif");
    let write = |values: &[f32]| {
        let image = Object::image("i", ImageInfo::plane(3, 1, 5.0, 0.0, 0.0), values);
        let call = Call::of::<TiffWrite>()
            .set("pixel_type", "uint16")
            .input("image", image);
        call.file(&path).run().unwrap();
        let mut decoder = read(&path);
        let text = decoder.get_tag_ascii_string(Tag::ImageDescription).unwrap();
        match decoder.read_image().unwrap() {
            DecodingResult::U16(v) => (v, text),
            other => panic!("{other:?}"),
        }
    };
    let (numbers, text) = write(&[0.0, 7.0, 65535.0]);
    assert_eq!(numbers, [0, 7, 65535]);
    assert!(!text.contains("c0="), "{text}");
    let (numbers, text) = write(&[0.0, 0.5, 131.07]);
    assert_eq!(numbers, [0, 250, 65535]);
    assert!(text.contains("cf=0\nc0=0\nc1=0.00"), "{text}");
}

#[test]
fn other_types_keep_theirs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.tif");
    let info = info([1, 1, 1, 1, 3], [0.0; 3]);
    let as_bits = |pixels: Pixels<'_>| {
        let values = pixels.summary(&puncta_sdk::run::Serial).unwrap();
        let levels = Levels::new(NumberType::Same, &values, true, [None; 2]).unwrap();
        let stack = Stack {
            info: &info,
            pixels,
            levels,
            description: "ImageJ=1.11a\n".into(),
        };
        write(&stack, &path, &puncta_sdk::run::Serial).unwrap();
        let mut decoder = read(&path);
        assert!(decoder.find_tag(Tag::XResolution).unwrap().is_none());
        decoder.read_image().unwrap()
    };
    let found = as_bits(Pixels::U8(&[1, 2, 255]));
    assert!(matches!(found, DecodingResult::U8(v) if v == [1, 2, 255]));
    let found = as_bits(Pixels::I32(&[-1, 0, i32::MAX]));
    assert!(matches!(found, DecodingResult::I32(v) if v == [-1, 0, i32::MAX]));
    let found = as_bits(Pixels::U32(&[0, 1, u32::MAX]));
    assert!(matches!(found, DecodingResult::U32(v) if v == [0, 1, u32::MAX]));
    let found = as_bits(Pixels::F64(&[0.1, -1e300, 3.0]));
    assert!(matches!(found, DecodingResult::F64(v) if v == [0.1, -1e300, 3.0]));
}

#[test]
fn files_above_four_gigabytes_are_big() {
    let is_big = |size: [u64; 5]| {
        let info = info(size, [0.0, 5.0, 5.0]);
        let values = Pixels::U8(&[0]).summary(&puncta_sdk::run::Serial).unwrap();
        let levels = Levels::new(NumberType::Same, &values, false, [None; 2]).unwrap();
        let pixels = Pixels::F32(&[]);
        Stack {
            info: &info,
            pixels,
            levels,
            description: String::new(),
        }
        .is_big()
    };
    assert!(is_big([1, 1, 1, 1 << 15, 1 << 15]));
    assert!(!is_big([1, 1, 1, 1 << 15, (1 << 15) - 8]));
    assert!(is_big([2, 1, 1, 1 << 15, 1 << 14]));
    assert!(is_big([1 << 23, 1, 1, 1, 1]));
}

#[test]
fn a_big_file_says_so_and_decodes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("big.tif");
    let info = info([1, 1, 2, 1, 3], [0.0, 5.0, 5.0]);
    let pixels = Pixels::U8(&[1, 2, 3, 4, 5, 6]);
    let values = pixels.summary(&puncta_sdk::run::Serial).unwrap();
    let levels = Levels::new(NumberType::Same, &values, false, [None; 2]).unwrap();
    let stack = Stack {
        info: &info,
        pixels,
        levels,
        description: "ImageJ=1.11a\n".into(),
    };
    let mut file = File::create(&path).unwrap();
    let tiff = TiffEncoder::new_big(&mut file).unwrap();
    assert!(encode(&stack, tiff, &puncta_sdk::run::Serial).is_ok());
    assert_eq!(std::fs::read(&path).unwrap()[2], 43);
    let mut decoder = read(&path);
    assert!(matches!(decoder.read_image().unwrap(), DecodingResult::U8(v) if v == [1, 2, 3]));
    decoder.next_image().unwrap();
    assert!(matches!(decoder.read_image().unwrap(), DecodingResult::U8(v) if v == [4, 5, 6]));
}

#[test]
fn failures_are_one_sentence() {
    let image = || {
        Object::image(
            "i",
            ImageInfo::plane(600, 500, 5.0, 0.0, 0.0),
            &vec![1.5; 300_000],
        )
    };
    let call = |path: &str| {
        Call::of::<TiffWrite>()
            .input("image", image())
            .file(Path::new(path))
    };
    if Path::new("/dev/full").exists() {
        let full = call("/dev/full").run().unwrap_err();
        assert_eq!(full.to_string(), "cannot write /dev/full: the disk is full");
    }
    let folder = call("/there/is/no/such/folder/a.tif").run().unwrap_err();
    assert!(
        folder.to_string().starts_with("cannot write /there/is/no"),
        "{folder}"
    );
    let labels = call("/dev/null")
        .set("pixel_type", "int32")
        .run()
        .unwrap_err();
    assert_eq!(labels.parameter.as_deref(), Some("pixel_type"));
    assert!(
        call("/dev/null")
            .cancel_after(2)
            .run()
            .unwrap_err()
            .is_cancelled()
    );
    let empty = Object::image("i", ImageInfo::plane(0, 5, 5.0, 0.0, 0.0), &[]);
    let empty = Call::of::<TiffWrite>()
        .input("image", empty)
        .file(Path::new("/dev/null"))
        .run();
    assert!(empty.unwrap_err().to_string().contains("0 values"));
}
