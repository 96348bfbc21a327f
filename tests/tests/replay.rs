//! Saved files are made again from their provenance, byte for byte, or it is said why not.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::Bundle;
use serde_json::Value;
use std::path::Path;
use std::process::Output;
use std::sync::OnceLock;

fn bundle() -> &'static Bundle {
    static BUNDLE: OnceLock<Bundle> = OnceLock::new();
    BUNDLE.get_or_init(|| {
        Bundle::of(&[
            "puncta_plugin_arrow_io",
            "puncta_plugin_figure_io",
            "puncta_plugin_filter",
            "puncta_plugin_hdf5",
            "puncta_plugin_image_io",
            "puncta_plugin_precision",
            "puncta_plugin_render",
            "puncta_plugin_synthetic",
            "puncta_plugin_text",
        ])
    })
}

fn run(bundle: &Bundle, folder: &Path, arguments: &[&str]) -> Output {
    let mut command = bundle.command();
    // An empty cache: nothing of the first run can be of use.
    let cache = tempfile::tempdir().unwrap();
    command.env("PUNCTA_CACHE", cache.path());
    command.args(arguments).current_dir(folder);
    command.output().expect("puncta runs")
}

fn good(folder: &Path, arguments: &[&str]) -> String {
    let output = run(bundle(), folder, arguments);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

fn refused(bundle: &Bundle, folder: &Path, arguments: &[&str]) -> String {
    let output = run(bundle, folder, arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

const RECIPE: &str = r#"
format = "puncta.recipe/1"
[inputs.locs]
kind = "table"
[steps.good]
op = "puncta.filter.range/1"
in.table = "locs"
set.ranges = { error_x = [0, 20] }
[steps.some]
op = "puncta.filter.random/1"
in.table = "good"
set = { count = 500 }
[steps.image]
op = "puncta.render.gaussian/1"
in.table = "good"
set = { pixel_size = 5 }
[steps.photons]
op = "puncta.precision.photons/1"
in.table = "some"
[outputs]
"er.tif" = "image"
"er.png" = "image"
"some.csv" = "some"
"some.tsv" = "some"
"some.hdf" = "some"
"some.parquet" = "some"
"photons.svg" = "photons.figure"
"photons.json" = "photons.report"
"#;

/// A folder with a simulated table and what a recipe makes of it.
fn made() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let simulate = ["op", "puncta.synthetic.membrane", "--seed", "3", "-o"];
    good(at, &[&simulate[..], &["locs.csv"]].concat());
    std::fs::write(at.join("r.toml"), RECIPE).unwrap();
    good(
        at,
        &["run", "r.toml", "--input", "locs=locs.csv", "--out", "out"],
    );
    folder
}

#[test]
fn every_file_is_made_again_in_both_modes_and_with_other_threads() {
    let folder = made();
    let mut files = vec!["locs.csv".to_owned()];
    for entry in std::fs::read_dir(folder.path().join("out")).unwrap() {
        let name = entry.unwrap().file_name().to_string_lossy().into_owned();
        if let Some(file) = name.strip_suffix(".puncta.json") {
            files.push(format!("out/{file}"));
        }
    }
    assert_eq!(files.len(), 9, "{files:?}");
    for file in &files {
        for mode in [&["--isolated", "--threads", "1"], &["--threads", "2", "-q"]] {
            let text = good(folder.path(), &[&["replay", file], &mode[..]].concat());
            assert!(text.contains("the same bytes"), "{file}: {text}");
        }
    }
    // The sidecar names the same file; inside this process the filter and the renderer can run.
    let text = good(
        folder.path(),
        &["replay", "out/er.tif.puncta.json", "--json"],
    );
    let value: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(
        (value["same"].as_bool(), value["good"].as_bool()),
        (Some(true), Some(true))
    );
    let text = good(folder.path(), &["replay", "out/er.tif", "--in-process"]);
    assert!(text.contains("the same bytes"));
}

#[test]
fn one_other_byte_of_the_input_is_named() {
    let folder = made();
    let (locs, moved) = (
        folder.path().join("locs.csv"),
        folder.path().join("moved.csv"),
    );
    let mut bytes = std::fs::read(&locs).unwrap();
    std::fs::rename(&locs, &moved).unwrap();
    let text = refused(bundle(), folder.path(), &["replay", "out/er.tif"]);
    assert!(
        text.contains("the input locs is missing") && text.contains("locs.csv"),
        "{text}"
    );
    assert!(
        text.contains("er.tif itself is as it was written"),
        "{text}"
    );
    let given = ["replay", "out/er.tif", "--input", "locs=moved.csv"];
    assert!(good(folder.path(), &given).contains("the same bytes"));
    // Beside the result it is found without being named.
    std::fs::copy(&moved, folder.path().join("out/locs.csv")).unwrap();
    assert!(good(folder.path(), &["replay", "out/er.tif"]).contains("the same bytes"));
    std::fs::remove_file(folder.path().join("out/locs.csv")).unwrap();

    // A digit of the last row.
    let place = bytes
        .iter()
        .rposition(|byte| (b'1'..b'8').contains(byte))
        .unwrap();
    bytes[place] += 1;
    std::fs::write(&locs, &bytes).unwrap();
    let text = refused(bundle(), folder.path(), &["replay", "out/er.tif"]);
    assert!(text.contains("the input locs is not what it was"), "{text}");
    assert!(text.contains("--anyway"), "{text}");
    let other = ["replay", "out/er.tif", "--input", "others=moved.csv"];
    let output = run(bundle(), folder.path(), &other);
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(
        text.contains("without an input others; its inputs are locs"),
        "{text}"
    );
}

#[test]
fn values_are_compared_where_the_bytes_cannot_be_the_same() {
    let folder = made();
    let record = folder.path().join("out/er.tif.puncta.json");
    let mut value: Value =
        serde_json::from_str(&std::fs::read_to_string(&record).unwrap()).unwrap();
    let library = value["steps"][0]["plugin"]["library"].take();
    value["steps"][0]["plugin"]["library"] = library.as_str().unwrap().replace('a', "b").into();
    std::fs::write(&record, value.to_string()).unwrap();
    let text = refused(bundle(), folder.path(), &["replay", "out/er.tif"]);
    assert!(text.contains("the library of puncta.filter"), "{text}");
    assert!(
        text.contains("is another build") && text.contains("--anyway"),
        "{text}"
    );
    let text = good(folder.path(), &["replay", "out/er.tif", "--anyway"]);
    assert!(text.contains("the same bytes"), "{text}");

    value["steps"][0]["plugin"]["version"] = "0.0.9".into();
    // Another parameter stands for a plugin that computes something else.
    let image = value["steps"].as_array().unwrap().len() - 1;
    value["steps"][image]["parameters"]["magnitude"] = 1.into();
    value["file"]["blake3"] = "00".repeat(32).into();
    std::fs::write(&record, value.to_string()).unwrap();
    let text = refused(bundle(), folder.path(), &["replay", "out/er.tif"]);
    assert!(text.contains("puncta.filter has version"), "{text}");
    assert!(
        text.contains("er.tif itself has changed since it was written"),
        "{text}"
    );
}

#[test]
fn a_plugin_that_is_gone_is_named() {
    let folder = made();
    let poor = Bundle::of(&[
        "puncta_plugin_filter",
        "puncta_plugin_image_io",
        "puncta_plugin_text",
    ]);
    let text = refused(&poor, folder.path(), &["replay", "out/er.tif"]);
    assert!(
        text.contains("puncta.render.gaussian/1 of the plugin puncta.render is not installed"),
        "{text}"
    );
    assert!(
        text.contains("install puncta.render 0.1.0 as it was"),
        "{text}"
    );
    let text = refused(&poor, folder.path(), &["replay", "r.toml"]);
    assert!(
        text.contains("only with its provenance beside it"),
        "{text}"
    );
    std::fs::write(folder.path().join("r.toml.puncta.json"), "{\"format\": 7}").unwrap();
    let text = refused(&poor, folder.path(), &["replay", "r.toml"]);
    assert!(text.contains("r.toml.puncta.json"), "{text}");
}
