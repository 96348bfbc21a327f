//! What the writer writes, the reader gives back.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use puncta_plugin_text::reader::ReadText;
use puncta_plugin_text::writer::WriteText;
use puncta_sdk::Element;
use puncta_testkit::{Call, Object, Table};
use std::path::Path;

/// Numbers whose digits are hard, and common ones.
fn doubles(count: usize) -> Vec<f64> {
    let hard = [
        0.0,
        -0.0,
        5e-324,
        f64::MAX,
        f64::MIN_POSITIVE,
        0.1,
        1e23,
        -1.0 / 3.0,
        1e16,
    ];
    let mut state = 1u64;
    let mut values: Vec<f64> = hard
        .into_iter()
        .chain([f64::INFINITY, f64::NEG_INFINITY])
        .collect();
    while values.len() < count {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        let value = f64::from_bits(state ^ (state >> 17));
        values.push(if value.is_finite() {
            value
        } else {
            (state >> 40) as f64 / 128.0
        });
    }
    values.truncate(count);
    values
}

fn there_and_back(table: Table, path: &Path, style: &str) -> Object {
    let write = Call::of::<WriteText>()
        .set("style", style)
        .input("table", table)
        .file(path);
    write.run().unwrap();
    let done = Call::of::<ReadText>().file(path).run().unwrap();
    done.output("localisations").unwrap().clone()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|v| v.to_bits()).collect()
}

#[test]
fn plain_text_keeps_names_units_and_every_bit() {
    let folder = tempfile::tempdir().unwrap();
    let n = 20_000;
    let (x, t) = (doubles(n), (0..n as i32).collect::<Vec<_>>());
    let words: Vec<String> = (0..n).map(|i| format!("w {i}, \"{}\"", i % 7)).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    for name in ["t.csv", "t.tsv", "t.txt"] {
        let mut y = x.clone();
        y.reverse();
        y[5] = f64::NAN;
        let table = Table::new("t")
            .f64("x", "nm", &x)
            .f64("y", "unknown", &y)
            .i32("t", "frame", &t)
            .texts("label", &words)
            .i32("id", "unknown", &t)
            .f64("density", "1/nm^2", &x);
        let back = there_and_back(table, &folder.path().join(name), "plain");
        let columns: Vec<_> = back.header.parts[0]
            .columns
            .iter()
            .map(|c| (c.name.as_str(), c.unit.as_str()))
            .collect();
        let wanted = [
            ("x", "nm"),
            ("y", "unknown"),
            ("t", "frame"),
            ("label", "1"),
            ("id", "unknown"),
            ("density", "1/nm^2"),
        ];
        assert_eq!(columns, wanted);
        assert_eq!(bits(&back.f64("x").unwrap()), bits(&x));
        let found = back.f64("y").unwrap();
        assert!(found[5].is_nan());
        assert_eq!(bits(&found[6..]), bits(&y[6..]));
        assert_eq!(back.i32("t").unwrap(), t);
        assert_eq!(back.texts("label").unwrap(), words);
    }
}

#[test]
fn typed_text_keeps_every_type() {
    let folder = tempfile::tempdir().unwrap();
    let texts = ["", "nan", " a", "1", "#", "two\nlines", "\"", "µ\t,;"];
    let table = Table::new("t")
        .f32(
            "sigma",
            "nm",
            &[
                0.1,
                -0.0,
                f32::MAX,
                1e-45,
                3.0,
                f32::INFINITY,
                0.3,
                16_777_216.0,
            ],
        )
        .u64("id", "1", &[0, u64::MAX, 1, 2, 3, 4, 5, 6])
        .i64(
            "n_nm",
            "unknown",
            &[i64::MIN, i64::MAX, 0, 9_007_199_254_740_993, 1, 2, 3, 4],
        )
        .u8("flag", "1", &[0, 255, 1, 2, 3, 4, 5, 6])
        .u16("frame", "frame", &[0, 65_535, 1, 2, 3, 4, 5, 6])
        .texts("odd name, with comma", &texts);
    let back = there_and_back(table.clone(), &folder.path().join("t.csv"), "typed");
    let before: Object = table.into();
    let (old, new) = (
        &before.header.parts[0].columns,
        &back.header.parts[0].columns,
    );
    for (old, new) in old.iter().zip(new) {
        assert_eq!(
            (&old.name, &old.unit, old.type_),
            (&new.name, &new.unit, new.type_)
        );
    }
    let single = |table: &Object| -> Vec<u32> {
        table
            .numbers(0, "sigma", Element::F32, u32::from_ne_bytes)
            .unwrap()
    };
    assert_eq!(single(&back), single(&before));
    assert_eq!(back.u64("id").unwrap(), before.u64("id").unwrap());
    assert_eq!(back.i64("n_nm").unwrap(), before.i64("n_nm").unwrap());
    assert_eq!(back.bytes("flag").unwrap(), before.bytes("flag").unwrap());
    assert_eq!(back.u16("frame").unwrap(), before.u16("frame").unwrap());
    assert_eq!(back.texts("odd name, with comma").unwrap(), texts);
}

#[test]
fn other_programs_styles_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let table = || {
        Table::new("t")
            .i32("t", "frame", &[0, 5])
            .f64("x", "nm", &[1.5, 2.0])
            .f64("sig", "nm", &[130.0, 131.0])
            .f64("nPhotons", "photon", &[500.0, 600.0])
            .f64("error_x", "nm", &[9.0, 8.0])
            .f64("error_y", "nm", &[9.0, 8.0])
    };
    let path = folder.path().join("t.csv");
    let back = there_and_back(table(), &path, "thunderstorm");
    let text = std::fs::read_to_string(&path).unwrap();
    assert_eq!(
        text,
        "\"frame\",\"x [nm]\",\"sigma [nm]\",\"intensity [photon]\",\"uncertainty_xy [nm]\"\n\
         1,1.5,130.0,500.0,9.0\n6,2.0,131.0,600.0,8.0\n"
    );
    let check = |back: Object| {
        assert_eq!(back.i32("t").unwrap(), [0, 5]);
        assert_eq!(back.f64("sig").unwrap(), [130.0, 131.0]);
        assert_eq!(back.f64("error_y").unwrap(), [9.0, 8.0]);
        assert_eq!(back.header.column("x").unwrap().unit, "nm");
    };
    check(back);
    check(there_and_back(table(), &path, "pyme"));
    assert!(
        std::fs::read_to_string(&path)
            .unwrap()
            .starts_with("#t,x,sig,nPhotons,error_x")
    );
}

#[test]
fn tables_without_rows_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let table = Table::new("t").f64("x", "nm", &[]).i32("t", "frame", &[]);
    let back = there_and_back(table, &folder.path().join("t.csv"), "plain");
    assert_eq!(back.header.rows(), 0);
    assert_eq!(back.header.column("x").unwrap().unit, "nm");
    let none = Call::of::<WriteText>().input("table", Table::new("t"));
    assert!(none.file(&folder.path().join("u.csv")).run().is_err());
}

#[test]
fn bytes_do_not_depend_on_the_threads() {
    let folder = tempfile::tempdir().unwrap();
    let x = doubles(100_000);
    let write = |threads: usize| {
        let path = folder.path().join("t.csv");
        let table = Table::new("t").f64("x", "nm", &x).f64("y", "nm", &x);
        let call = Call::of::<WriteText>().input("table", table).file(&path);
        call.threads(threads).run().unwrap();
        std::fs::read(&path).unwrap()
    };
    assert_eq!(write(1), write(3));
    let path = folder.path().join("t.csv");
    let read = |threads: usize| {
        let done = Call::of::<ReadText>()
            .file(&path)
            .threads(threads)
            .run()
            .unwrap();
        bits(&done.output("localisations").unwrap().f64("y").unwrap())
    };
    assert_eq!(read(1), read(4));
}
