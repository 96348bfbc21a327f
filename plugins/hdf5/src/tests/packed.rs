//! The files that `data/write.py` wrote with h5py and PyTables.

use std::path::PathBuf;

use puncta_sdk::{Element, FailureCode};

use super::{call, failure, localisations, numbers, output};

fn file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("data/{name}_locs.hdf5"))
}

#[test]
fn every_packing_and_byte_order_gives_the_same_rows() {
    let names = [
        "swapped",
        "userblock",
        "userblock_gzip",
        "gzip",
        "gzip_only",
        "lzf",
        "fletcher",
        "blosc_blosclz",
        "blosc_lz4",
        "blosc_zlib",
        "blosc_zstd",
    ];
    for name in names {
        let (_, table) = localisations(&file(name));
        let good = table.bytes("good").unwrap();
        assert_eq!(good.len(), 40, "{name}");
        let column = |name| numbers(&table, name);
        let (t, x, y, photons) = (column("t"), column("x"), column("y"), column("nPhotons"));
        for row in 0..40 {
            let i = row as f64;
            let wanted = ((row / 2) as f64, i / 4.0, 100.0 - i / 8.0, 50.0 * i);
            assert_eq!((t[row], x[row], y[row], photons[row]), wanted, "{name}");
            assert_eq!(good[row] == 1, row % 3 == 0, "{name}");
        }
    }
    let (_, swapped) = localisations(&file("swapped"));
    assert_eq!(
        swapped.header.column("t").unwrap().type_.element,
        Element::I16
    );
    assert_eq!(
        swapped.header.column("nPhotons").unwrap().type_.element,
        Element::F32
    );
}

#[test]
fn compression_that_is_not_included_is_named() {
    for (name, word) in [
        ("bzip2", "bzip2"),
        ("blosc2", "Blosc2"),
        ("zstd", "Zstandard"),
    ] {
        let failure = failure(&file(name));
        assert_eq!(failure.code, FailureCode::Unsupported);
        assert!(failure.message.contains(word), "{failure}");
        assert!(
            failure.remedy.as_ref().is_some_and(|r| r.contains("gzip")),
            "{failure}"
        );
    }
}

#[test]
fn the_example_is_read() {
    let done = call(&file("example")).set("pixel_size", 100).run().unwrap();
    let table = output(&done, "localisations");
    assert_eq!(table.f64("x").unwrap(), [1025.0, 1250.0, 1050.0, 3175.0]);
    assert_eq!(table.f64("error_x").unwrap(), [6.25; 4]);
    assert_eq!(table.header.column("sigx").unwrap().unit, "nm");
}
