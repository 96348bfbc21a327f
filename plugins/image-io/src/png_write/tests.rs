use super::*;
use puncta_testkit::{Call, Object};

struct Decoded {
    info: png::Info<'static>,
    levels: Vec<u8>,
}

fn decode(path: &Path) -> Decoded {
    let file = std::io::BufReader::new(File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut levels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut levels).unwrap();
    Decoded {
        info: reader.info().clone(),
        levels,
    }
}

fn written(call: Call) -> Decoded {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    call.file(&path).run().unwrap();
    decode(&path)
}

fn image(width: u64, height: u64, values: &[f32]) -> Object {
    Object::image(
        "er",
        ImageInfo::plane(width, height, 5.0, -30.0, 45.0),
        values,
    )
}

#[test]
fn values_between_the_limits_become_colours() {
    let values = [-1.0, 0.0, 0.5, 1.0, 2.0, f32::NAN];
    let call = Call::of::<PngWrite>()
        .set("low", 0)
        .set("high", 1)
        .set("lut", "grey");
    let decoded = written(call.input("image", image(3, 2, &values)));
    assert_eq!((decoded.info.width, decoded.info.height), (3, 2));
    assert_eq!(decoded.levels, [0, 0, 128, 255, 255, 0]);
    let palette = decoded.info.palette.as_ref().unwrap();
    assert_eq!(palette[..], Lut::Grey.colours().concat()[..]);
    let dims = decoded.info.pixel_dims.unwrap();
    assert_eq!((dims.xppu, dims.yppu), (200_000_000, 200_000_000));
    let text = decoded
        .info
        .utf8_text
        .iter()
        .map(|t| t.get_text().unwrap())
        .collect::<String>();
    assert!(
        text.contains("pixel size 5 x 5 nm; low corner at -30, 45 nm"),
        "{text}"
    );
}

#[test]
fn limits_are_percentiles_of_what_is_not_zero() {
    let mut values = vec![0.0; 3000];
    values.extend((1..=1000).map(|i| i as f32));
    let call = || {
        Call::of::<PngWrite>()
            .set("lut", "fire")
            .input("image", image(40, 100, &values))
    };
    let level = |v: f32, high: f32| (v / high * 255.0).round() as u8;
    let decoded = written(call());
    assert_eq!(decoded.levels[3499], level(500.0, 999.0));
    assert_eq!(decoded.levels[0], 0);
    let decoded = written(call().set("percentile_low", 10).set("percentile_high", 50));
    assert_eq!(decoded.levels[3099..3101], [0, 1]);
    assert_eq!(decoded.levels[3499], 255);
    let decoded = written(call().set("gamma", 0.5).set("high", 1000));
    assert_eq!(decoded.levels[3249], 128);
}

#[test]
fn large_images_and_single_pixels() {
    let values: Vec<f32> = (0..1500 * 1100).map(|i| (i % 997) as f32).collect();
    let call = Call::of::<PngWrite>().set("low", 0).set("high", 1024);
    let decoded = written(call.input("image", image(1500, 1100, &values)));
    let right = |(l, v): (&u8, &f32)| *l == (v / 1024.0 * 255.0).round() as u8;
    assert!(decoded.levels.iter().zip(&values).all(right));
    assert_eq!(
        written(Call::of::<PngWrite>().input("image", image(1, 1, &[0.0]))).levels,
        [0]
    );
    assert_eq!(
        written(Call::of::<PngWrite>().input("image", image(1, 1, &[4.0]))).levels,
        [255]
    );
}

#[test]
fn a_plane_of_a_stack() {
    let info = ImageInfo {
        size: [2, 2, 3, 1, 2],
        ..ImageInfo::plane(1, 1, 5.0, 0.0, 0.0)
    };
    let values: Vec<f32> = (0..24).map(|i| i as f32).collect();
    let call = || Call::of::<PngWrite>().input("image", Object::image("s", info.clone(), &values));
    let call = || call().set("low", 0).set("high", 255);
    let chosen = call().set("frame", 1).set("channel", 0).set("slice", 2);
    assert_eq!(written(chosen).levels, [16, 17]);
    let refused = call().set("slice", 3).prepare().unwrap_err();
    assert_eq!(
        refused.to_string(),
        "slice 3 was asked for, but the image has 3; counting starts at 0"
    );
}

#[test]
fn failures_are_one_sentence() {
    let call = |path: &str| {
        let noise: Vec<f32> = (0..300_000_u32)
            .map(|i| (i.wrapping_mul(2_654_435_761) >> 9) as f32)
            .collect();
        Call::of::<PngWrite>()
            .input("image", image(600, 500, &noise))
            .file(Path::new(path))
    };
    if Path::new("/dev/full").exists() {
        let full = call("/dev/full").run().unwrap_err();
        assert_eq!(full.to_string(), "cannot write /dev/full: the disk is full");
    }
    let folder = call("/there/is/no/such/folder/a.png").run().unwrap_err();
    assert!(
        folder.to_string().starts_with("cannot write /there/is/no"),
        "{folder}"
    );
    let limits = call("/dev/null")
        .set("low", 2)
        .set("high", 1)
        .run()
        .unwrap_err();
    assert_eq!(limits.parameter.as_deref(), Some("low"));
    assert!(
        call("/dev/null")
            .cancel_after(2)
            .run()
            .unwrap_err()
            .is_cancelled()
    );
}
