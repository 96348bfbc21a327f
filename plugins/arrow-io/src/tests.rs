//! Round trips, files of other programs, and damaged files.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use crate::{ReadIpc, ReadParquet, WriteIpc, WriteParquet};
use puncta_sdk::documents::header::HEADER;
use puncta_sdk::documents::{self};
use puncta_sdk::{ColumnInfo, Element, Failure, FailureCode, Header, Operation};
use puncta_testkit::{Call, Done, Object, Table, damage};
use serde_json::json;
use std::path::Path;

fn table(rows: usize) -> Table {
    let x: Vec<f64> = (0..rows).map(|i| i as f64 * 0.1).collect();
    let mut table = Table::new("molecules")
        .f64("x", "nm", &x)
        .f32("nPhotons", "photon", &vec![f32::NAN; rows])
        .u64("id", "1", &vec![u64::MAX; rows])
        .i64("gap", "unknown", &vec![i64::MIN; rows])
        .i32("t", "frame", &vec![-3; rows])
        .u16("odd name [um]", "V", &vec![9; rows])
        .u8("flag", "1", &vec![200; rows]);
    let words = ["", "näher", "a"];
    let words: Vec<&str> = (0..rows).map(|i| words[i % 3]).collect();
    table = table.texts("note", &words);
    let header = table.header_mut();
    header.shape = Some("tracks".into());
    header.metadata.insert(
        "camera".into(),
        json!({"pixel_size_nm": 130.5, "n": [1, null]}),
    );
    header.rest.insert("future".into(), json!(1));
    let columns = &mut header.parts[0].columns;
    columns[0].role = Some("position".into());
    columns[0].source = Some("Position X".into());
    columns[0].description = Some("one line".into());
    columns[2].rest.insert("later".into(), json!({"a": 1}));
    table
}

fn write<O: Operation + Sync>(path: &Path, table: impl Into<Object>, options: &[(&str, &str)]) {
    let mut call = Call::of::<O>().input("table", table.into()).file(path);
    for (name, value) in options {
        call = call.set(name, *value);
    }
    call.run().unwrap();
}

fn read<O: Operation + Sync>(path: &Path) -> Result<Done, Failure> {
    Call::of::<O>().file(path).run()
}

/// The header with what only rooms of texts say left out.
fn header(object: &Object) -> String {
    let mut header: Header = object.header.clone();
    for column in &mut header.parts[0].columns {
        (column.text_bytes, column.entries) = (None, None);
    }
    documents::write(&header, HEADER)
}

fn assert_same(a: &Object, b: &Object) {
    assert_eq!(header(a), header(b));
    let columns = &a.header.parts[0].columns;
    for column in columns {
        let name = &column.name;
        match column.type_.element {
            Element::Utf8 | Element::Dictionary => {
                assert_eq!(a.texts(name).unwrap(), b.texts(name).unwrap());
            }
            _ => assert_eq!(a.bytes(name).unwrap(), b.bytes(name).unwrap(), "{name}"),
        }
    }
}

#[test]
fn tables_of_the_host_come_back_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    for rows in [0, 1, 70_001] {
        let whole: Object = table(rows).into();
        for (name, compression) in [
            ("a.arrow", "none"),
            ("b.feather", "lz4"),
            ("c.arrows", "zstd"),
        ] {
            let path = folder.path().join(name);
            write::<WriteIpc>(&path, whole.clone(), &[("compression", compression)]);
            assert_same(
                &whole,
                read::<ReadIpc>(&path)
                    .unwrap()
                    .output("localisations")
                    .unwrap(),
            );
        }
        for compression in ["none", "snappy", "lz4", "zstd"] {
            let path = folder.path().join("a.parquet");
            write::<WriteParquet>(&path, whole.clone(), &[("compression", compression)]);
            assert_same(
                &whole,
                read::<ReadParquet>(&path)
                    .unwrap()
                    .output("localisations")
                    .unwrap(),
            );
        }
    }
}

#[test]
fn several_row_groups_follow_one_another() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.parquet");
    let x: Vec<f64> = (0..1_100_000).map(|i| f64::from(i) * 0.5).collect();
    let table = Table::new("a").f64("x", "nm", &x);
    write::<WriteParquet>(&path, table, &[("compression", "none")]);
    let done = read::<ReadParquet>(&path).unwrap();
    assert!(done.output("localisations").unwrap().f64("x").unwrap() == x);
}

/// A table of lists, truth values and a dictionary, as another program wrote it.
const MIXED: &[(&str, &[u8])] = &[
    ("mixed.arrow", include_bytes!("../data/mixed.arrow")),
    ("mixed.arrows", include_bytes!("../data/mixed.arrows")),
    ("mixed.parquet", include_bytes!("../data/mixed.parquet")),
];

fn open(name: &str, bytes: &[u8]) -> Result<Done, Failure> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    if name.ends_with("parquet") {
        read::<ReadParquet>(&path)
    } else {
        read::<ReadIpc>(&path)
    }
}

#[test]
fn tables_of_pyarrow_open_with_their_units_and_gaps() {
    for (name, bytes) in MIXED {
        let done = open(name, bytes).unwrap();
        let out = done.output("localisations").unwrap();
        let column = |name: &str| out.header.column(name).unwrap().clone();
        assert_eq!(out.header.rows(), 5, "{name}");
        assert_eq!(
            (column("x").unit.as_str(), column("y").unit.as_str()),
            ("nm", "nm")
        );
        assert_eq!(out.f64("x").unwrap(), [1.0, 2.0, 3.0, 4.0, 5.0]);
        let y = out.f64("y").unwrap();
        assert_eq!((y[0], y[4]), (500.0, 4500.0));
        assert!(y[2].is_nan());
        let whole = out.f64("count").unwrap();
        assert!(whole[1].is_nan() && whole[0] == 1.0);
        assert_eq!(out.bytes("flag").unwrap(), [1, 0, 1, 1, 0]);
        let lists = out
            .numbers(0, "normal", Element::F32, f32::from_ne_bytes)
            .unwrap();
        assert_eq!(lists.len(), 15);
        assert_eq!((lists[0], lists[14]), (0.0, 14.0));
        assert_eq!(out.texts("word").unwrap(), ["a", "", "ccc", "a", "ü"]);
        assert_eq!(
            out.texts("kind").unwrap(),
            ["red", "green", "red", "red", "green"]
        );
        assert_eq!(column("kind").type_.element, Element::Dictionary);
        assert!(out.header.column("when").is_none());
        assert_eq!(out.header.metadata["arrow"]["lab"], json!("north"));
        let empty = |m: &(u32, String)| m.1.contains("1 missing texts became empty");
        assert!(done.messages.iter().any(empty), "{:?}", done.messages);
    }
}

#[test]
fn lists_and_dictionaries_are_written_back() {
    let folder = tempfile::tempdir().unwrap();
    let done = open(MIXED[0].0, MIXED[0].1).unwrap();
    let first = done.output("localisations").unwrap();
    for name in ["a.arrow", "a.arrows", "a.parquet"] {
        let path = folder.path().join(name);
        if name.ends_with("parquet") {
            write::<WriteParquet>(&path, first.clone(), &[]);
        } else {
            write::<WriteIpc>(&path, first.clone(), &[]);
        }
        let again = open(name, &std::fs::read(&path).unwrap()).unwrap();
        assert_same(first, again.output("localisations").unwrap());
    }
}

#[test]
fn what_is_left_out_and_what_is_unknown_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mixed.arrow");
    std::fs::write(&path, MIXED[0].1).unwrap();
    let notes = Call::of::<ReadIpc>()
        .file(&path)
        .prepare()
        .unwrap()
        .notes
        .join(" ");
    assert!(notes.contains("when") && notes.contains("count"), "{notes}");
    let bare = Table::new("a").f64("x", "unknown", &[1.0]);
    let bare: Object = bare.into();
    let path = folder.path().join("bare.arrow");
    let mut renamed = bare;
    renamed.header.parts[0].columns[0] = ColumnInfo::new("x", Element::F64, "unknown");
    renamed.header.parts[0].columns[0].role = Some("position".into());
    write::<WriteIpc>(&path, renamed, &[]);
    let notes = Call::of::<ReadIpc>()
        .file(&path)
        .prepare()
        .unwrap()
        .notes
        .join(" ");
    assert!(
        notes.contains("unit of x") && notes.contains("unknown"),
        "{notes}"
    );
    let wrong = Call::of::<ReadIpc>()
        .file(&path)
        .set("units", "furlong")
        .prepare();
    assert_eq!(wrong.unwrap_err().code, FailureCode::BadParameter);
}

#[test]
fn other_files_are_left_to_others() {
    for (name, bytes) in [
        ("a.arrow", &b"x,y\n1,2\n3,4\n"[..]),
        ("b.arrow", b"\x89HDF\r\n\x1a\n00000000"),
        ("c.arrow", MIXED[2].1),
        ("d.parquet", MIXED[0].1),
        ("e.parquet", b"PK\x03\x04"),
    ] {
        let failure = open(name, bytes).unwrap_err();
        assert_eq!(failure.code, FailureCode::NotMine, "{name}: {failure}");
    }
}

#[test]
fn truncated_files_are_refused() {
    for (name, bytes) in MIXED {
        for cut in damage::cuts(bytes) {
            // A stream that is cut between two messages cannot be told from a whole one.
            if let Err(failure) = open(name, cut) {
                let known = [FailureCode::BadFile, FailureCode::NotMine];
                assert!(
                    known.contains(&failure.code),
                    "{name}, {}: {failure}",
                    cut.len()
                );
            } else {
                assert!(name.ends_with("arrows"), "{name} of {} bytes", cut.len());
            }
        }
    }
}

#[test]
fn changed_bytes_never_break_the_reader() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.arrow");
    write::<WriteIpc>(&path, table(40), &[("compression", "zstd")]);
    let own = std::fs::read(&path).unwrap();
    let files = MIXED.iter().map(|(name, bytes)| (*name, bytes.to_vec()));
    for (name, bytes) in files.chain([("own.arrow", own)]) {
        for (_, changed) in damage::flips(&bytes, bytes.len()) {
            let _ = open(name, &changed);
        }
    }
}

#[test]
fn cancel_stops_reading_and_writing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.parquet");
    write::<WriteParquet>(&path, table(300_000), &[]);
    let stopped = Call::of::<ReadParquet>().file(&path).cancel_after(2).run();
    assert!(stopped.unwrap_err().is_cancelled());
    let write = Call::of::<WriteIpc>().input("table", table(300_000));
    let stopped = write
        .file(&folder.path().join("b.arrow"))
        .cancel_after(2)
        .run();
    assert!(stopped.unwrap_err().is_cancelled());
}

/// Reads both files with pyarrow: rows, names, units, a sum, texts.
const PYTHON: &str = "
import sys, pyarrow.ipc, pyarrow.parquet
for table in [pyarrow.ipc.open_file(sys.argv[1]).read_all(), pyarrow.parquet.read_table(sys.argv[2])]:
    field = table.schema.field('x')
    print(table.num_rows, field.type, field.metadata[b'unit'].decode(), sum(table['x'].to_pylist()),
          table['note'][1].as_py(), table['id'][0].as_py())
";

/// Skipped with a message where there is no Python with pyarrow.
#[test]
fn pyarrow_opens_what_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (ipc, parquet) = (
        folder.path().join("a.arrow"),
        folder.path().join("a.parquet"),
    );
    write::<WriteIpc>(&ipc, table(5), &[("compression", "lz4")]);
    write::<WriteParquet>(&parquet, table(5), &[]);
    let own = std::env::var("PUNCTA_TEST_PYTHON").unwrap_or_else(|_| "python3".into());
    let mut python = std::process::Command::new(own);
    let run = python.args(["-c", PYTHON]).args([&ipc, &parquet]).output();
    let Some(output) = run.ok().filter(|output| {
        output.status.success()
            || !String::from_utf8_lossy(&output.stderr).contains("ModuleNotFound")
    }) else {
        eprintln!("skipped: no python3 with pyarrow (PUNCTA_TEST_PYTHON may name one)");
        return;
    };
    let text = String::from_utf8_lossy(&output.stdout);
    let line = "5 double nm 1.0 näher 18446744073709551615";
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(
        lines,
        [line, line],
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}
