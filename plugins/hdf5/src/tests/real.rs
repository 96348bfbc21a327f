//! Values that Picasso, PYME, scipy and h5py give for real files.

use puncta_sdk::{Element, FailureCode};
use puncta_testkit::Object;
use serde_json::json;

use super::{call, failure, localisations, numbers, output, shared};

fn close(found: f64, wanted: f64, digits: i32) {
    let tolerance = 0.5 * 10f64.powi(-digits) + 1e-9 * wanted.abs();
    assert!(
        (found - wanted).abs() <= tolerance,
        "{found} is not {wanted}"
    );
}

fn sum(table: &Object, name: &str) -> f64 {
    numbers(table, name).iter().sum()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len() % 2 == 1 {
        values[middle]
    } else {
        f64::midpoint(values[middle - 1], values[middle])
    }
}

/// Picasso 0.11.3: file, rows, frames, size, sum of x and y (px), mean photons, median lpx (px).
type Expected = (&'static str, usize, u64, u64, f64, f64, f64, f64);
const PICASSO: [Expected; 4] = [
    (
        "picasso/raw_movie_locs.hdf5",
        2399,
        5000,
        32,
        34091.237,
        39974.996,
        5840.8704,
        0.017381,
    ),
    (
        "picasso/raw_movie_locs_picked.hdf5",
        2378,
        5000,
        32,
        33830.478,
        39697.043,
        5780.5854,
        0.017363,
    ),
    (
        "picasso/testdata_locs.hdf5",
        564,
        1000,
        32,
        8946.963,
        8643.698,
        14798.2023,
        0.009467,
    ),
    (
        "pyme-extra-sample-data/origami-simul3_locs.hdf5",
        60722,
        7500,
        128,
        3949461.684,
        3717516.981,
        15695.1871,
        0.008463,
    ),
];

#[test]
fn picasso_files_as_picasso_reads_them() {
    for (file, rows, frames, size, x, y, photons, lpx) in PICASSO {
        let Some(path) = shared(file) else { return };
        let (plan, table) = localisations(&path);
        assert_eq!(plan.probe.unwrap().format, "Picasso hdf5");
        let camera = &table.header.metadata["camera"];
        assert_eq!(camera["pixel_size_nm"], 130);
        assert_eq!(camera["frames"], frames);
        assert_eq!(camera["width_px"], size);
        assert_eq!(table.header.rows(), rows as u64);
        close(sum(&table, "x") / 130.0, x, 2);
        close(sum(&table, "y") / 130.0, y, 2);
        close(sum(&table, "nPhotons") / rows as f64, photons, 3);
        close(median(numbers(&table, "error_x")) / 130.0, lpx, 6);
        let column = |name: &str| table.header.column(name).unwrap();
        assert_eq!(column("t").type_.element, Element::U32);
        assert_eq!(column("x").type_.element, Element::F64);
        assert_eq!(
            (column("x").unit.as_str(), column("x").role.as_deref()),
            ("nm", Some("position"))
        );
        // All of these lie in the field.
        assert_eq!(call(&path).run().unwrap().messages, []);
    }
}

#[test]
fn pixel_sizes_that_disagree_are_told() {
    for file in [
        "picasso/testdata_locs.hdf5",
        "pyme-extra-sample-data/origami-simul3_locs.hdf5",
    ] {
        let Some(path) = shared(file) else { return };
        let notes = call(&path).prepare().unwrap().notes;
        assert!(
            notes.iter().any(|n| n.contains("160") && n.contains("130")),
            "{notes:?}"
        );
    }
    let Some(path) = shared("picasso/raw_movie_locs.hdf5") else {
        return;
    };
    assert_eq!(call(&path).prepare().unwrap().notes, Vec::<String>::new());
}

#[test]
fn pyme_fits_as_scipy_reads_them() {
    let Some(path) = shared("pyme-extra-sample-data/1_2_series_D.h5r") else {
        return;
    };
    let (plan, table) = localisations(&path);
    assert_eq!(plan.probe.unwrap().format, "PYME h5r");
    assert_eq!(
        (table.header.rows(), table.header.parts[0].columns.len()),
        (57894, 38)
    );
    close(sum(&table, "x"), 599517284.3, 1);
    close(sum(&table, "y"), 642511157.69, 1);
    let t = table.i32("t").unwrap();
    assert!(t.is_sorted());
    assert_eq!((t[0], t[t.len() - 1]), (30, 10148));
    close(sum(&table, "A") / 57894.0, 74496145485.7672, -3);
    let column = |name: &str| table.header.column(name).unwrap();
    assert_eq!(column("error_y").source.as_deref(), Some("fitError_y0"));
    assert_eq!(column("A").unit, "ADU");
}

#[test]
fn pyme_events_and_metadata() {
    let Some(path) = shared("pyme-extra-sample-data/1_2_series_D.h5r") else {
        return;
    };
    let done = call(&path).run().unwrap();
    let events = output(&done, "events");
    let (names, descriptions) = (
        events.texts("EventName").unwrap(),
        events.texts("EventDescr").unwrap(),
    );
    assert_eq!(names.len(), 2019);
    assert_eq!(names[..3], ["StartAq", "ProtocolTask", "ShiftMeasure"]);
    assert_eq!(descriptions[2], "0.2514, -0.0789, 0.0505");
    close(events.f64("Time").unwrap()[0], 1.58055378e9, -2);
    let metadata = output(&done, "localisations").header.metadata;
    let tree = &metadata["pyme"];
    assert_eq!(tree["Camera"]["ROI"], json!([770, 1076, 1090, 1374]));
    assert_eq!(tree["Camera"]["ADOffset"], 100);
    assert_eq!(tree["Analysis"]["BGRange"], json!([0, 0]));
    assert_eq!(tree["Analysis"]["subtractBackground"], true);
    assert_eq!(
        tree["Sample"]["Labelling"],
        json!([["alpha-tubulin", "ATTO655"]])
    );
    assert_eq!(tree["Camera"]["VarianceMapID"], "");
    assert_eq!(tree["Lasers"]["l647"]["On"], true);
    assert_eq!(metadata["camera"]["pixel_size_nm"], 72.0);
    assert_eq!(call(&path).prepare().unwrap().notes, Vec::<String>::new());
}

#[test]
fn other_formats_are_left_to_other_readers_by_name() {
    let cases = [
        ("pyminflux/pmx_format_versions.zip", "zip archive"),
        ("picasso/raw_movie_locs.yaml", "text"),
    ];
    for (file, word) in cases {
        let Some(path) = shared(file) else { return };
        let failure = failure(&path);
        assert_eq!(failure.code, FailureCode::NotMine);
        assert!(
            failure.message.contains(word) && failure.remedy.is_some(),
            "{failure}"
        );
        assert!(failure.to_string().len() < 400, "{failure}");
    }
}
