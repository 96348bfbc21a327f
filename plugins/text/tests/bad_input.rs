//! Damaged and odd files: an error or a table, never a panic, and no time or memory to speak of.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use puncta_plugin_text::reader::ReadText;
use puncta_sdk::{Failure, FailureCode};
use puncta_testkit::{Call, Done};
use std::path::{Path, PathBuf};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }
    fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }
    fn read(&self, bytes: &[u8]) -> Result<Done, Failure> {
        Call::of::<ReadText>()
            .file(&self.file("f.csv", bytes))
            .run()
    }
    fn fails(&self, bytes: &[u8]) -> Failure {
        self.read(bytes)
            .err()
            .unwrap_or_else(|| panic!("{:?} was read", bytes))
    }
}

fn rows(done: &Done) -> u64 {
    done.output("localisations").unwrap().header.rows()
}

#[test]
fn sentences_name_file_row_and_column() {
    let folder = Folder::new();
    for (text, sentence) in [
        ("", "f.csv is empty"),
        (
            "x,y\n1,2\n3,a\n",
            "f.csv has \"a\" in column \"y\" where a number belongs (row 3); correct the line, or read the column as words with text = \"y\"",
        ),
        (
            "x,y\n1,2\n3\n",
            "f.csv has a row of 1 value where the table has 2 columns (row 3); correct or remove the line",
        ),
        (
            "x,y\n1,2\n\n3,4,5\n",
            "f.csv has a row of 3 values where the table has 2 columns (row 4); correct or remove the line",
        ),
        (
            "x,y\n1,2\nmean,1.5\n",
            "f.csv has \"mean\" in column \"x\" where a number belongs (row 3); correct the line, or read the column as words with text = \"x\"",
        ),
        (
            "x,x\n1,2\n",
            "f.csv calls both columns 1 and 2 \"x\"; name all columns in order, such as columns = \"x,y,t\"",
        ),
        (
            "x,n\n1,\"a\n2,b\n",
            "f.csv opens a quote that is never closed (row 2); close the quote, or remove it",
        ),
    ] {
        assert_eq!(folder.fails(text.as_bytes()).to_string(), sentence);
    }
    let missing = Call::of::<ReadText>()
        .file(Path::new("/nowhere/f.csv"))
        .run()
        .err()
        .unwrap();
    assert_eq!(missing.code, FailureCode::Io);
    assert_eq!(
        missing.message,
        "cannot open /nowhere/f.csv: there is no such file or folder"
    );
    assert!(Call::of::<ReadText>().file(folder.0.path()).run().is_err());
}

#[test]
fn other_formats_are_not_ours() {
    let folder = Folder::new();
    let prose = "This is a letter.\nIt has lines of words\nand no table at all in it.\n";
    for bytes in [
        &b"\x89HDF\r\n\x1a\n\0\0"[..],
        b"PK\x03\x04\0\0",
        prose.as_bytes(),
    ] {
        assert_eq!(folder.fails(bytes).code, FailureCode::NotMine);
    }
}

#[test]
fn too_many_columns_are_refused_at_once() {
    let folder = Folder::new();
    let begin = std::time::Instant::now();
    for text in [
        ",".repeat(200_000),
        "1,".repeat(100_000),
        "a\t".repeat(6000),
    ] {
        assert_eq!(folder.fails(text.as_bytes()).code, FailureCode::NotMine);
    }
    assert!(begin.elapsed().as_secs() < 8);
}

#[test]
fn few_rows_and_odd_values() {
    let folder = Folder::new();
    assert_eq!(rows(&folder.read(b"x [nm],y [nm],frame\n").unwrap()), 0);
    assert_eq!(rows(&folder.read(b"x [nm],y [nm],frame").unwrap()), 0);
    let done = folder.read(b"x [nm],y [nm],id\n1,2,3").unwrap();
    let table = done.output("localisations").unwrap();
    assert_eq!(
        (table.f64("x").unwrap(), table.i32("id").unwrap()),
        (vec![1.0], vec![3])
    );
    let done = folder
        .read(b"x [um],y,id\n0.1,inf,1\n,NaN,2\n1e-3,-Inf,3\n")
        .unwrap();
    let table = done.output("localisations").unwrap();
    let x = table.f64("x").unwrap();
    assert!(x[0] == 100.0 && x[1].is_nan() && x[2] == 1.0);
    let y = table.f64("y").unwrap();
    assert!(y[0] == f64::INFINITY && y[1].is_nan() && y[2] == f64::NEG_INFINITY);
    let done = folder.read(b"a,b\n1,2\n").unwrap();
    assert_eq!(rows(&done), 1);
}

#[test]
fn quoted_line_ends_and_words() {
    let folder = Folder::new();
    let done = folder
        .read(b"name,x\n\"two\nlines\",1\n\"a \"\"b\"\"\",2\n\"\",3\n")
        .unwrap();
    let table = done.output("localisations").unwrap();
    assert_eq!(table.texts("name").unwrap(), ["two\nlines", "a \"b\"", ""]);
    assert_eq!(table.f64("x").unwrap(), [1.0, 2.0, 3.0]);
    let failure = folder.fails(b"name,x\n\"two\nlines\",1\n\n\"a\nb\",q\n");
    assert_eq!(failure.row, Some(5));
}

#[test]
fn types_that_a_later_row_changes() {
    let folder = Folder::new();
    let many = |last: &str| {
        let mut text = String::from("frame,x [nm],id\n");
        for i in 0..60_000 {
            text += &format!("{},{}.25,{}\n", i + 1, i, i);
        }
        text + last
    };
    let done = folder.read(many("7.5,1,3\n").as_bytes()).unwrap();
    let table = done.output("localisations").unwrap();
    let t = table.f64("t").unwrap();
    assert_eq!((t.len(), t[0], t[60_000]), (60_001, 0.0, 6.5));
    let done = folder.read(many("0,1,3000000000\n").as_bytes()).unwrap();
    let table = done.output("localisations").unwrap();
    let (t, id) = (table.i32("t").unwrap(), table.i64("id").unwrap());
    assert_eq!(
        (t[0], t[60_000], id[60_000]),
        (1, 0, 3_000_000_000),
        "frame 0 says: from 0"
    );
    let halves = format!("frame,x [nm]\n1.5,1\n{}0,1\n", "2,1\n".repeat(300_000));
    let done = folder.read(halves.as_bytes()).unwrap();
    let t = done.output("localisations").unwrap().f64("t").unwrap();
    assert_eq!((t[0], t[300_001]), (1.5, 0.0));
    let done = folder.read(many(",1,\n").as_bytes()).unwrap();
    let table = done.output("localisations").unwrap();
    assert!(table.f64("id").unwrap()[60_000].is_nan());
}

#[test]
fn the_first_of_many_errors_is_told_whatever_the_threads() {
    let folder = Folder::new();
    let mut text = String::from("x,y\n");
    for i in 0..400_000 {
        text += if i == 200_000 || i > 300_000 {
            "1,oops\n"
        } else {
            "1.5,2.5\n"
        };
    }
    let path = folder.file("f.csv", text.as_bytes());
    for threads in [1, 2, 5] {
        let failure = Call::of::<ReadText>()
            .file(&path)
            .threads(threads)
            .run()
            .err()
            .unwrap();
        assert_eq!(failure.row, Some(200_002));
    }
}

#[test]
fn cancel_stops_the_read() {
    let folder = Folder::new();
    let text = format!("x,y\n{}", "1.5,2.5\n".repeat(600_000));
    let path = folder.file("f.csv", text.as_bytes());
    let failure = Call::of::<ReadText>()
        .file(&path)
        .cancel_after(3)
        .run()
        .err()
        .unwrap();
    assert!(failure.is_cancelled());
}

const FIXTURES: &[&str] = &[
    "\"id\",\"frame\",\"x [nm]\",\"y [nm]\",\"uncertainty [nm]\"\r\n1,1,10.5,20.25,5\r\n2,1,11,21,6.125\r\n3,2,12,22,7\r\n",
    "#A, x, y, sig, t\n8.5e+02, 1.0e+00, -2.5e+00, 1.1e+02, 0.0\n8.5e+02, 1.0e+00, -2.5e+00, 1.1e+02, 1.0\n",
    "#LUME VERSION, 0.54\r\n#2 points\r\nframe,x,y,z,int\r\n1,20669,3512.6,-104.1,1398.4\r\n2,1,2,3,4\r\n",
    "Index\tFirst Frame\tPosition X [nm]\tChannel\t\r\n1\t1\t15850.6\t1\t\r\n2\t1\t15850.6\t1\t\r\n\0\r\rVoxelSizeX : 0.1\r\r\n",
    "name;x [um];y [um]\n\"a;b\";1,5;2,25\n\"c\nd\";3;4,5\n",
    "#puncta.text/1 types=f64,i32,u8,utf8\nx [nm],n [1],m [1],w [1]\n1.0,2,3,a\n-0.5,4,5,\" \"\n",
];

/// Reads with a limit on the time, on two threads.
fn survives(folder: &Folder, bytes: &[u8]) {
    let begin = std::time::Instant::now();
    let _ = folder.read(bytes);
    assert!(
        begin.elapsed().as_secs() < 8,
        "{:?}",
        String::from_utf8_lossy(bytes)
    );
}

#[test]
fn fixtures_are_read_whole() {
    let folder = Folder::new();
    let found: Vec<u64> = FIXTURES
        .iter()
        .map(|text| rows(&folder.read(text.as_bytes()).unwrap()))
        .collect();
    assert_eq!(found, [3, 2, 2, 2, 2, 2]);
}

#[test]
fn truncated_files_are_survived() {
    let folder = Folder::new();
    for text in FIXTURES {
        for cut in 0..64 {
            survives(&folder, &text.as_bytes()[..text.len() * cut / 64]);
        }
    }
}

#[test]
fn changed_bytes_are_survived() {
    let folder = Folder::new();
    let mut seed = 20_261_122u64;
    let mut next = |below: usize| {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((seed >> 33) as usize) % below
    };
    let tokens: [&[u8]; 14] = [
        b",",
        b"\"",
        b"\n",
        b"\r",
        b"#",
        b"\0",
        b"nan",
        b"1e999999999",
        b"-",
        b"[",
        b"\t",
        b";",
        b"99999999999999999999",
        b"\xff\xfe",
    ];
    for text in FIXTURES {
        for _ in 0..200 {
            let mut bytes = text.as_bytes().to_vec();
            for _ in 0..=next(4) {
                let at = next(bytes.len());
                if next(3) == 0 {
                    let token = tokens[next(tokens.len())];
                    bytes.splice(at..at, token.iter().copied());
                } else {
                    bytes[at] ^= 1 << next(8);
                }
            }
            survives(&folder, &bytes);
        }
    }
}
