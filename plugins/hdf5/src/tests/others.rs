//! Files written here in the layouts of DECODE, SMAP, storm-analysis, pyMINFLUX and Abberior.

use std::path::{Path, PathBuf};

use hdf5::types::VarLenUnicode;
use hdf5::{File, Group, H5Type};

use super::{call, localisations, numbers, output};

fn made(folder: &Path, name: &str, fill: impl FnOnce(&File)) -> PathBuf {
    let path = folder.join(name);
    let file = File::create(&path).unwrap();
    fill(&file);
    path
}

/// A dataset of `data` in rows of `shape`.
fn dataset<T: H5Type>(group: &Group, name: &str, shape: &[usize], data: &[T]) {
    let builder = group.new_dataset::<T>();
    let builder = if data.is_empty() {
        builder
    } else {
        builder.chunk(shape).deflate(3)
    };
    let dataset = builder.shape(shape).create(name).unwrap();
    dataset.write_raw(data).unwrap();
}

fn texts(words: &[&str]) -> Vec<VarLenUnicode> {
    words.iter().map(|word| word.parse().unwrap()).collect()
}

fn decode(folder: &Path, unit: &str) -> PathBuf {
    made(folder, "d.h5", |file| {
        let data = file.create_group("data").unwrap();
        dataset(&data, "xyz", &[2, 3], &[1.0_f32, 2.0, 30.0, 4.0, 5.0, 60.0]);
        dataset(&data, "frame_ix", &[2], &[7_i64, 9]);
        dataset(&data, "phot", &[2], &[500.0_f32, 600.0]);
        data.new_dataset::<f32>()
            .shape(())
            .create("scalar")
            .unwrap();
        dataset::<f32>(&data, "bg_cr", &[0], &[]);
        let meta = file.create_group("meta").unwrap();
        let attribute = meta.new_attr::<f32>().shape(2).create("px_size").unwrap();
        attribute.write(&[127.0_f32, 117.0]).unwrap();
        let attribute = meta.new_attr::<VarLenUnicode>().create("xy_unit").unwrap();
        attribute.write_scalar(&texts(&[unit])[0]).unwrap();
    })
}

#[test]
fn decode_has_a_pixel_size_for_each_axis() {
    let folder = tempfile::tempdir().unwrap();
    let path = decode(folder.path(), "px");
    let (_, table) = localisations(&path);
    assert_eq!(table.f64("x").unwrap(), [127.0, 508.0]);
    assert_eq!(table.f64("y").unwrap(), [234.0, 585.0]);
    assert_eq!(table.f64("z").unwrap(), [30.0, 60.0]);
    assert_eq!(numbers(&table, "t"), [7.0, 9.0]);
    assert_eq!(table.header.column("nPhotons").unwrap().unit, "photon");
    let mapped = call(&path)
        .set("pixel_size", 100)
        .set("swap_xy", true)
        .set("z_factor", 0.5)
        .set("frame_base", "one")
        .run()
        .unwrap();
    let table = output(&mapped, "localisations");
    assert_eq!(table.f64("y").unwrap(), [100.0, 400.0]);
    assert_eq!(table.f64("x").unwrap(), [200.0, 500.0]);
    assert_eq!(table.f64("z").unwrap(), [15.0, 30.0]);
    assert_eq!(numbers(&table, "t"), [6.0, 8.0]);
    let (_, table) = localisations(&decode(folder.path(), "nm"));
    assert_eq!(table.f64("x").unwrap(), [1.0, 4.0]);
    let (_, table) = localisations(&decode(folder.path(), "?"));
    let x = table.header.column("x").unwrap();
    assert_eq!(x.unit, "unknown");
    assert!(
        x.rest["remedy"]
            .as_str()
            .unwrap()
            .contains("--in-units x=nm")
    );
}

#[test]
fn names_and_units_can_be_said_for_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let path = decode(folder.path(), "?");
    let call = call(&path)
        .set("columns", "frame_ix=start")
        .set("units", "x=um, y=nm");
    let table = output(&call.run().unwrap(), "localisations");
    assert_eq!(table.f64("x").unwrap(), [1000.0, 4000.0]);
    assert_eq!(table.header.column("y").unwrap().unit, "nm");
    assert!(table.header.column("start").is_some() && table.header.column("t").is_none());
    let failure = super::call(&path)
        .set("columns", "q=x")
        .prepare()
        .unwrap_err();
    assert!(failure.to_string().contains("no column \"q\""), "{failure}");
}

#[test]
fn smap_lists_lie_along_either_axis() {
    let folder = tempfile::tempdir().unwrap();
    let path = made(folder.path(), "s.mat", |file| {
        let group = file
            .create_group("saveloc")
            .unwrap()
            .create_group("loc")
            .unwrap();
        let list = |name: &str, values: &[f32]| dataset(&group, name, &[1, values.len()], values);
        list("xnm", &[10.5, 20.5]);
        list("znm", &[-5.0, 5.0]);
        list("locprecnm", &[8.0, 9.0]);
        list("xnmerr", &[1.0, 2.0]);
        list("odd", &[1.0]);
        dataset(&group, "ynm", &[2, 1], &[30.0_f32, 40.0]);
        dataset(&group, "frame", &[1, 2], &[1.0_f64, 12.0]);
    });
    let (plan, table) = localisations(&path);
    assert_eq!(table.f64("x").unwrap(), [10.5, 20.5]);
    assert_eq!(table.f64("y").unwrap(), [30.0, 40.0]);
    assert_eq!(table.f64("t").unwrap(), [0.0, 11.0]);
    assert_eq!(table.f64("error_y").unwrap(), [8.0, 9.0]);
    assert_eq!(numbers(&table, "xnmerr"), [1.0, 2.0]);
    assert!(plan.notes[0].contains("odd"), "{:?}", plan.notes);
    assert_eq!(plan.probe.unwrap().format, "SMAP mat");
}

#[test]
fn storm_analysis_frames_follow_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = made(folder.path(), "a.hdf5", |file| {
        for (frame, xs) in [(10_u32, [1.0_f32, 2.0]), (2, [3.0, 4.0]), (5, [0.0, 0.0])] {
            let group = file.create_group(&format!("fr_{frame}")).unwrap();
            let count = i64::from(frame != 5) * 2;
            let number = |name: &str, value: f64| {
                let attribute = group.new_attr::<f64>().create(name).unwrap();
                attribute.write_scalar(&value).unwrap();
            };
            number("n_locs", count as f64);
            number("dx", f64::from(frame) * 0.5);
            if count > 0 {
                dataset(&group, "x", &[2], &xs);
                dataset(&group, "y", &[2], &[5.0_f32, 6.0]);
                dataset(&group, "z", &[2], &[0.25_f32, -0.5]);
            }
        }
        let pixel = file.new_attr::<f64>().create("pixel_size").unwrap();
        pixel.write_scalar(&160.0).unwrap();
    });
    let (_, table) = localisations(&path);
    assert_eq!(table.f64("t").unwrap(), [2.0, 2.0, 10.0, 10.0]);
    assert_eq!(table.f64("x").unwrap(), [480.0, 640.0, 160.0, 320.0]);
    assert_eq!(table.f64("z").unwrap(), [250.0, -500.0, 250.0, -500.0]);
    assert_eq!(table.f64("driftx").unwrap(), [160.0, 160.0, 800.0, 800.0]);
    assert_eq!(table.header.metadata["camera"]["pixel_size_nm"], 160.0);
}

#[test]
fn minflux_takes_the_last_iteration() {
    let folder = tempfile::tempdir().unwrap();
    let path = made(folder.path(), "m.mat", |file| {
        let itr = file.create_group("itr").unwrap();
        // 3 axes, 2 iterations, 2 localisations, in metres.
        let loc: Vec<f64> = (0..12).map(|v| f64::from(v) * 1e-9).collect();
        dataset(&itr, "loc", &[3, 2, 2], &loc);
        dataset(&itr, "efo", &[2, 2], &[1.0_f64, 2.0, 3.0, 4.0]);
        dataset(file, "tid", &[1, 2], &[5_i32, 6]);
        dataset(file, "vld", &[1, 2], &[1_u8, 0]);
        dataset(file, "tim", &[1, 2], &[0.5_f64, 0.75]);
    });
    let (plan, table) = localisations(&path);
    let near = |name: &str, wanted: [f64; 2]| {
        let found = table.f64(name).unwrap();
        assert!(
            found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9),
            "{name}: {found:?}"
        );
    };
    near("x", [2.0, 3.0]);
    near("y", [6.0, 7.0]);
    near("z", [10.0, 11.0]);
    assert_eq!(table.f64("efo").unwrap(), [3.0, 4.0]);
    assert_eq!(table.i32("clumpIndex").unwrap(), [5, 6]);
    assert_eq!(table.f64("time").unwrap(), [0.5, 0.75]);
    assert!(plan.notes[0].contains("vld"), "{:?}", plan.notes);
}

fn pmx(folder: &Path, names: &[&str]) -> PathBuf {
    made(folder, "p.pmx", |file| {
        let group = file.create_group("paraview").unwrap();
        let rows = [[5.0, 0.5, 10.0, 20.0, 2.0], [6.0, 1.5, 30.0, 40.0, 4.0]];
        dataset(&group, "dataframe", &[2, 5], rows.as_flattened());
        let dataset = group.dataset("dataframe").unwrap();
        let attribute = dataset.new_attr::<VarLenUnicode>().shape(names.len());
        attribute
            .create("column_names")
            .unwrap()
            .write(&texts(names))
            .unwrap();
    })
}

#[test]
fn pyminflux_names_stand_in_an_attribute() {
    let folder = tempfile::tempdir().unwrap();
    let path = pmx(folder.path(), &["tid", "tim", "x", "y", "dwell"]);
    let (plan, table) = localisations(&path);
    assert_eq!(table.f64("clumpIndex").unwrap(), [5.0, 6.0]);
    assert_eq!(table.f64("y").unwrap(), [20.0, 40.0]);
    assert_eq!(table.f64("dwell").unwrap(), [0.002, 0.004]);
    assert_eq!(plan.probe.unwrap().format, "pyMINFLUX pmx");
    let lying = pmx(folder.path(), &["tid", "tim", "x"]);
    let failure = call(&lying).prepare().unwrap_err();
    assert!(
        failure
            .to_string()
            .contains("3 names are given for 5 columns"),
        "{failure}"
    );
}

/// Every layout, cut short at 64 places and with 200 bytes changed: a table or a sentence.
#[test]
fn damaged_files_of_every_layout() {
    let folder = tempfile::tempdir().unwrap();
    let files = [
        decode(folder.path(), "px"),
        pmx(folder.path(), &["tid", "tim", "x", "y", "dwell"]),
    ];
    let mut state = 11_u64;
    let mut random = move || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 33) as usize
    };
    for path in files {
        let whole = std::fs::read(&path).unwrap();
        let damaged = folder.path().join("damaged.h5");
        let check = |bytes: &[u8]| {
            std::fs::write(&damaged, bytes).unwrap();
            if let Err(failure) = call(&damaged).run() {
                assert!(
                    failure.code != puncta_sdk::FailureCode::Internal,
                    "{failure}"
                );
            }
        };
        (0..64).for_each(|cut| check(&whole[..whole.len() * cut / 64]));
        for _ in 0..200 {
            let mut bytes = whole.clone();
            let at = random() % bytes.len();
            bytes[at] = random() as u8;
            check(&bytes);
        }
    }
}
