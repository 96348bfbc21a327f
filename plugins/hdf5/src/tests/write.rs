//! Small files as Picasso and PYME write them.
#![allow(non_snake_case, missing_docs)]

use std::path::{Path, PathBuf};

use hdf5::types::{FixedAscii, VarLenUnicode};
use hdf5::{File, H5Type};

#[derive(H5Type, Clone, Copy, Default, Debug, PartialEq)]
#[repr(C)]
pub struct Loc {
    pub frame: u32,
    pub x: f32,
    pub y: f32,
    pub z: f32,
    pub photons: f32,
    pub bg: f32,
    pub lpx: f32,
    pub lpz: f32,
    pub group: i32,
}

#[derive(H5Type, Clone, Copy, Default)]
#[repr(C)]
pub struct Fit {
    pub A: f32,
    pub x0: f32,
    pub y0: f32,
    pub sigma: f32,
}

#[derive(H5Type, Clone, Copy, Default)]
#[repr(C)]
pub struct Slice {
    pub start: i32,
    pub stop: i32,
}

#[derive(H5Type, Clone, Copy, Default)]
#[repr(C)]
pub struct Slices {
    pub x: Slice,
    pub y: Slice,
}

#[derive(H5Type, Clone, Copy, Default)]
#[repr(C)]
pub struct FitRow {
    pub tIndex: i32,
    pub fitResults: Fit,
    pub fitError: Fit,
    pub slicesUsed: Slices,
}

#[derive(H5Type, Clone, Copy)]
#[repr(C)]
pub struct Event {
    pub EventDescr: FixedAscii<32>,
    pub EventName: FixedAscii<16>,
    pub Time: f64,
}

pub fn locs(rows: usize) -> Vec<Loc> {
    let loc = |row: usize| {
        let v = row as f32;
        Loc {
            frame: (row / 3) as u32,
            x: v * 0.01 - 0.5,
            y: v * 0.02,
            z: 2.0 * v,
            photons: 1000.0 + v,
            bg: 5.0,
            lpx: 0.1,
            lpz: 20.0,
            group: (row % 7) as i32 - 1,
        }
    };
    (0..rows).map(loc).collect()
}

/// A Picasso file in `folder`, with a `.yaml` of these words where there are any.
pub fn picasso(folder: &Path, rows: usize, yaml: Option<&str>) -> PathBuf {
    let path = folder.join("made_locs.hdf5");
    let file = File::create(&path).unwrap();
    file.new_dataset_builder()
        .with_data(&locs(rows))
        .create("locs")
        .unwrap();
    if let Some(yaml) = yaml {
        std::fs::write(path.with_extension("yaml"), yaml).unwrap();
    }
    path
}

/// Rows of an `.h5r`: blocks of frames out of order, as appended by parallel workers.
pub fn fits(rows: usize) -> Vec<FitRow> {
    let fit = |row: usize| {
        let v = row as f32;
        let failed = row % 11 == 3;
        let error = if failed { -5000.0 } else { 1.0 + v * 0.001 };
        FitRow {
            tIndex: ((row / 50) ^ 1) as i32,
            fitResults: Fit {
                A: 10.0 * v,
                x0: v,
                y0: -v,
                sigma: 120.0,
            },
            fitError: Fit {
                A: f32::NAN,
                x0: error,
                y0: error,
                sigma: 1.0,
            },
            slicesUsed: Slices {
                x: Slice {
                    start: row as i32,
                    stop: row as i32 + 9,
                },
                y: Slice { start: 1, stop: 10 },
            },
        }
    };
    (0..rows).map(fit).collect()
}

/// How the rows of an `.h5r` are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Packing {
    Plain,
    Shuffled,
    Deflated,
    ShuffledDeflated,
    Checked,
    Lzf,
    Blosc,
}

pub const PACKINGS: [Packing; 7] = [
    Packing::Plain,
    Packing::Shuffled,
    Packing::Deflated,
    Packing::ShuffledDeflated,
    Packing::Checked,
    Packing::Lzf,
    Packing::Blosc,
];

/// A PYME file in `folder`.
pub fn h5r(folder: &Path, rows: usize, packing: Packing) -> PathBuf {
    let path = folder.join("made.h5r");
    let file = File::create(&path).unwrap();
    let builder = file.new_dataset_builder();
    let builder = if rows > 0 {
        builder.chunk(rows.min(97))
    } else {
        builder
    };
    let builder = match packing {
        _ if rows == 0 => builder,
        Packing::Plain => builder,
        Packing::Shuffled => builder.shuffle(),
        Packing::Deflated => builder.deflate(5),
        Packing::ShuffledDeflated => builder.shuffle().deflate(5),
        Packing::Checked => builder.shuffle().deflate(5).fletcher32(),
        Packing::Lzf => builder.lzf(),
        Packing::Blosc => builder.blosc_zstd(5, true),
    };
    builder.with_data(&fits(rows)).create("FitResults").unwrap();
    events(&file);
    metadata(&file);
    path
}

fn events(file: &File) {
    let event = |name: &str, descr: &str, time| Event {
        EventDescr: FixedAscii::from_ascii(descr.as_bytes()).unwrap(),
        EventName: FixedAscii::from_ascii(name.as_bytes()).unwrap(),
        Time: time,
    };
    let events = [
        event("StartAq", "0", 1.5e9),
        event("ProtocolFocus", "12, 3.5", 1.5e9 + 0.25),
    ];
    file.new_dataset_builder()
        .chunk(2)
        .deflate(1)
        .with_data(&events)
        .create("Events")
        .unwrap();
}

fn metadata(file: &File) {
    let camera = file.create_group("MetaData/Camera").unwrap_or_else(|_| {
        file.create_group("MetaData")
            .unwrap()
            .create_group("Camera")
            .unwrap()
    });
    let ascii = |text: &[u8]| FixedAscii::<64>::from_ascii(text).unwrap();
    let attribute = |name: &str, text: &[u8]| {
        camera
            .new_attr::<FixedAscii<64>>()
            .create(name)
            .unwrap()
            .write_scalar(&ascii(text))
            .unwrap();
    };
    attribute("ROI", b"(L1L\nL2L\nL64L\nL32L\ntp1\n.");
    attribute("Name", b"Andor Zyla.");
    attribute("Evil", b"cposix\nsystem\n(S'true'\ntR.");
    camera
        .new_attr::<f64>()
        .create("CycleTime")
        .unwrap()
        .write_scalar(&0.05)
        .unwrap();
    camera
        .new_attr::<bool>()
        .create("On")
        .unwrap()
        .write_scalar(&true)
        .unwrap();
    let unit: VarLenUnicode = "µm".parse().unwrap();
    camera
        .new_attr::<VarLenUnicode>()
        .create("unit")
        .unwrap()
        .write_scalar(&unit)
        .unwrap();
    camera
        .new_attr::<i16>()
        .shape(3)
        .create("list")
        .unwrap()
        .write(&[1_i16, -2, 3])
        .unwrap();
}
