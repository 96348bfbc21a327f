//! Tests of the writers as calls.
#![allow(clippy::unwrap_used)]

use crate::csv_write::CsvWrite;
use crate::histogram::Histogram;
use crate::png_write::PngWrite;
use crate::svg_write::SvgWrite;
use puncta_sdk::serde_json::json;
use puncta_sdk::{Failure, FailureCode, Figure, Series};
use puncta_testkit::{Call, Object, Table};
use std::path::Path;

fn wave(count: usize) -> Object {
    let x: Vec<f64> = (0..count).map(|i| i as f64 * 50.0).collect();
    let y = |shift: f64| -> Vec<f64> {
        x.iter()
            .map(|x| 40.0 * (x / 900.0 + shift).sin() + 0.01 * x)
            .collect()
    };
    let by = |values: &[f64], by: f64| -> Vec<f64> { values.iter().map(|v| v + by).collect() };
    Table::new("drift")
        .f64("t", "frame", &x)
        .f64("x", "nm", &y(0.0))
        .f64("y", "nm", &y(2.0))
        .f64("low", "nm", &by(&y(0.0), -9.0))
        .f64("high", "nm", &by(&y(0.0), 9.0))
        .into()
}

fn drift() -> Figure {
    let mut figure = Figure::new(
        "figure",
        "Drift of the sample",
        ["time", "frame"],
        ["drift", "nm"],
    )
    .with(Series::columns("x, 95 % interval", "line", "drift", "t", "low").up_to("high"))
    .with(Series::columns("x", "line", "drift", "t", "x"))
    .with(Series::columns("y", "line", "drift", "t", "y"));
    figure.caption =
        "Redundant cross-correlation of 20 segments of 1000 frames at 10 nm pixels; the \
        band is twice the split-half error of 3 repeats (seed 1)."
            .into();
    figure
}

fn points(figure: &Figure, x: &[f64], y: &[f64]) -> Object {
    Object::figure(
        figure,
        vec![(
            "table",
            Table::new("t").f64("x", "nm", x).f64("y", "1", y).into(),
        )],
    )
}

fn plain() -> Figure {
    Figure::new("figure", "A < B & C", ["r", "nm"], ["K", "nm^2"])
}

fn svg_of(object: Object) -> Result<String, Failure> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.svg");
    Call::of::<SvgWrite>()
        .input("figure", object)
        .file(&path)
        .run()?;
    Ok(std::fs::read_to_string(path).unwrap())
}

/// The points of all lines, areas and dots with a colour.
fn coordinates(svg: &str, colour: &str) -> Vec<Vec<[f64; 2]>> {
    let marks = svg
        .lines()
        .filter(|line| line.starts_with("<path") && line.contains(colour));
    let runs = marks.flat_map(|line| {
        let d = line.split('"').nth(1).unwrap();
        d.split('M').filter(|run| !run.is_empty())
    });
    runs.map(|run| {
        let text = run.replace(['L', 'Z'], " ");
        let numbers: Vec<f64> = text
            .split_whitespace()
            .map(|n| n.parse().unwrap())
            .collect();
        numbers.as_chunks::<2>().0.to_vec()
    })
    .collect()
}

#[test]
fn points_land_where_the_axes_say() {
    let figure = plain().with(Series::columns("s", "points", "table", "x", "y"));
    let svg = svg_of(points(&figure, &[0.0, 10.0, 20.0], &[0.0, 4.0, 1.0])).unwrap();
    let dots: Vec<[f64; 2]> = coordinates(&svg, "#0072b2")
        .into_iter()
        .map(|dot| dot[0])
        .collect();
    assert_eq!(dots.len(), 3);
    // Equal steps in x; heights above the base line in the ratio of the values.
    assert!((dots[1][0] - dots[0][0] - (dots[2][0] - dots[1][0])).abs() < 0.03);
    let height = |i: usize| dots[0][1] - dots[i][1];
    assert!((height(1) / height(2) - 4.0).abs() < 0.01, "{dots:?}");
    assert!(
        svg.contains("A &lt; B &amp; C") && svg.contains("nm<"),
        "{svg}"
    );
}

#[test]
fn missing_values_make_gaps_and_lone_points_are_seen() {
    let figure = plain().with(Series::columns("s", "line", "table", "x", "y"));
    let nan = f64::NAN;
    let x = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    let y = [1.0, 2.0, nan, 3.0, f64::INFINITY, 2.0, 1.0, 2.0];
    let svg = svg_of(points(&figure, &x, &y)).unwrap();
    let mut lengths: Vec<usize> = coordinates(&svg, "#0072b2").iter().map(Vec::len).collect();
    lengths.sort_unstable();
    // The lone point is a dot: a line of no length.
    assert_eq!(lengths, [2, 2, 3]);
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
}

#[test]
fn every_figure_gives_a_picture() {
    let nan = f64::NAN;
    let data: [(&[f64], &[f64]); 9] = [
        (&[1e-310, 0.0], &[5e-324, 1e-305]),
        (&[], &[]),
        (&[1.0], &[5.0]),
        (&[3.0, 3.0], &[7.0, 7.0]),
        (&[nan, nan], &[1.0, nan]),
        (&[0.0, 1.0], &[0.0, 0.0]),
        (&[-1e300, 1e300], &[1e-300, 1e300]),
        (&[f64::MAX, 1.0], &[f64::MIN, 2.0]),
        (&[1e7, 1e7 + 1e-6], &[1e-9, 2e-9]),
    ];
    for (x, y) in data {
        for style in ["line", "points", "bars", "band"] {
            for log in ["", "x", "y", "xy"] {
                let mut series = Series::columns("s", style, "table", "x", "y");
                if style == "band" {
                    series = series.up_to("y");
                }
                let mut figure = plain().with(series);
                figure.logarithmic = log.into();
                let svg = svg_of(points(&figure, x, y)).unwrap();
                assert!(
                    !svg.contains("NaN") && !svg.contains("inf"),
                    "{style} {log} {x:?}: {svg}"
                );
                assert!(svg.ends_with("</svg>\n"));
            }
        }
    }
    assert!(
        svg_of(points(&plain(), &[], &[]))
            .unwrap()
            .contains("no data")
    );
}

#[test]
fn wrong_figures_are_refused_in_words() {
    let cases = [
        (Series::columns("s", "pie", "table", "x", "y"), "style"),
        (
            Series::columns("s", "line", "other", "x", "y"),
            "table other",
        ),
        (Series::columns("s", "line", "table", "x", "q"), "column q"),
        (Series::columns("s", "band", "table", "x", "y"), "band"),
        (Series::numbers("s", "line", &[1.0, 2.0], &[1.0]), "lengths"),
    ];
    for (series, word) in cases {
        let failure = svg_of(points(&plain().with(series), &[1.0], &[1.0])).unwrap_err();
        assert_eq!(failure.code, FailureCode::BadInput);
        assert!(failure.message.contains(word), "{}", failure.message);
    }
}

#[test]
fn long_lines_keep_their_extremes_and_little_else() {
    let count = 300_000;
    let x: Vec<f64> = (0..count).map(f64::from).collect();
    let mut y = vec![0.0; x.len()];
    y[123_456] = 1.0;
    let figure = plain().with(Series::columns("s", "line", "table", "x", "y"));
    let svg = svg_of(points(&figure, &x, &y)).unwrap();
    let line = &coordinates(&svg, "#0072b2")[0];
    let (low, high) = line
        .iter()
        .fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[1]), h.max(p[1])));
    assert!(high - low > 100.0 && line.len() < 4000, "{}", line.len());
}

#[test]
fn the_csv_holds_every_number() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    let mut figure = plain().with(Series::numbers("a, b", "line", &[0.1], &[f64::NAN]));
    figure
        .series
        .push(Series::columns("band", "band", "table", "x", "y").up_to("y"));
    Call::of::<CsvWrite>()
        .input("figure", points(&figure, &[1.0, 2.0], &[3.0, 4.0]))
        .file(&path)
        .run()
        .unwrap();
    let text = std::fs::read_to_string(path).unwrap();
    assert_eq!(
        text,
        "series,r [nm],K [nm^2],upper\n\"a, b\",0.1,nan,\nband,1,3,3\nband,2,4,4\n"
    );
}

fn png(object: Object, path: &Path, resolution: f64) -> Result<(), Failure> {
    let call = Call::of::<PngWrite>()
        .set("resolution", resolution)
        .input("figure", object);
    call.file(path).run().map(|_| ())
}

#[test]
fn a_png_is_the_picture_and_is_the_same_again() {
    let folder = tempfile::tempdir().unwrap();
    let make = |name: &str| {
        let path = folder.path().join(name);
        png(
            Object::figure(&drift(), vec![("drift", wave(400))]),
            &path,
            96.0,
        )
        .unwrap();
        std::fs::read(path).unwrap()
    };
    let bytes = make("a.png");
    assert_eq!(bytes, make("b.png"));
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!(info.width, 530);
    let blue = pixels
        .as_chunks::<3>()
        .0
        .iter()
        .filter(|p| **p == [0x00, 0x72, 0xb2])
        .count();
    assert!(blue > 300, "{blue}");
    let white = |y: u32, x: u32| {
        let at = 3 * (y * info.width + x) as usize;
        pixels[at..at + 3] == [255; 3]
    };
    // Nothing touches the border.
    assert!((0..info.width).all(|x| white(0, x) && white(info.height - 1, x)));
    assert!((0..info.height).all(|y| white(y, 0) && white(y, info.width - 1)));
}

#[test]
fn a_png_that_is_too_large_is_refused_with_what_would_fit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let call = Call::of::<PngWrite>()
        .set("resolution", 1200)
        .set("width", 1000);
    let call = call
        .input("figure", Object::figure(&plain(), vec![]))
        .file(&path);
    let failure = call.run().unwrap_err();
    assert_eq!(failure.code, FailureCode::BadParameter);
    assert!(failure.to_string().contains("a resolution of"), "{failure}");
}

#[test]
fn histograms_count_every_value_once() {
    let values = [0.0, 0.5, 1.0, 1.0, 2.0, f64::NAN];
    let table = || Table::new("t").f64("v", "nm", &values);
    let call = Call::of::<Histogram>()
        .set("column", "v")
        .input("table", table());
    let done = call.set("bins", 2).run().unwrap();
    let histogram = done.output("histogram").unwrap();
    assert_eq!(histogram.u64("count").unwrap(), [2, 3]);
    assert_eq!(histogram.f64("value").unwrap(), [0.5, 1.5]);
    assert_eq!(done.documents[0]["x"], json!(["v", "nm"]));
    for values in [&[][..], &[4.0], &[f64::INFINITY], &[1.0, 1.0]] {
        let table = Table::new("t").f64("v", "nm", values);
        let done = Call::of::<Histogram>()
            .set("column", "v")
            .input("table", table)
            .run()
            .unwrap();
        let count: u64 = done
            .output("histogram")
            .unwrap()
            .u64("count")
            .unwrap()
            .iter()
            .sum();
        assert_eq!(
            count,
            values.iter().filter(|v| v.is_finite()).count() as u64
        );
    }
    let wrong = Call::of::<Histogram>()
        .set("column", "v")
        .set("low", 3)
        .set("high", 1);
    assert!(wrong.input("table", table()).run().is_err());
}
