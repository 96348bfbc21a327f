use crate::{Field, Number, Pass, Pick, Source, Stored, fill};
use puncta_sdk::output::ColumnMut;
use puncta_sdk::{ColumnInfo, Element, Failure};
use puncta_testkit::{Stopped, Threads};

const RECORD: usize = 20;

/// Records of a big-endian u16, a little-endian f32 and a pair of little-endian f32, and padding.
fn records(rows: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    for row in 0..rows {
        bytes.extend_from_slice(&(row as u16).to_be_bytes());
        bytes.extend_from_slice(&(row as f32 / 2.0).to_le_bytes());
        bytes.extend_from_slice(&(row as f32).to_le_bytes());
        bytes.extend_from_slice(&(-(row as f32)).to_le_bytes());
        bytes.extend_from_slice(&[7; 6]);
    }
    bytes
}

fn fields() -> Vec<Field> {
    let info = |name: &str| ColumnInfo::new(name, Element::F32, "1");
    let big = Stored {
        number: Number::U16,
        big_endian: true,
    };
    let pair = Field::new(info("pair").width(2), Number::F32.little(), 6);
    vec![
        Field::new(info("t"), big, 0).from_one(),
        Field::new(info("x"), Number::F32.little(), 2).scaled(1000.0),
        pair,
    ]
}

struct Read {
    t: Vec<i64>,
    x: Vec<f64>,
    pair: Vec<f32>,
    kept: u64,
}

fn read(
    source: Source<'_>,
    rows: u32,
    threads: usize,
    select: Option<&crate::fill::Select<'_>>,
) -> Result<Read, Failure> {
    let fields = fields();
    let count = rows as usize;
    let (mut t, mut x, mut pair) = (vec![0; count], vec![0.0; count], vec![0.0; 2 * count]);
    let pass = Pass {
        name: "a.bin",
        rows: rows.into(),
        record: RECORD,
        fields: &fields,
        select,
    };
    let mut columns = [
        ColumnMut::I64(&mut t),
        ColumnMut::F64(&mut x),
        ColumnMut::F32(&mut pair),
    ];
    let mut committed = 0;
    let mut commit = |rows| {
        committed += rows;
        Ok(())
    };
    let kept = fill(source, &pass, &mut columns, &mut commit, &Threads(threads))?;
    assert_eq!(kept, committed);
    Ok(Read { t, x, pair, kept })
}

fn check(read: &Read, rows: &[u32]) {
    assert_eq!(read.kept, rows.len() as u64);
    for (i, row) in rows.iter().enumerate() {
        assert_eq!(read.t[i], i64::from(*row as u16) - 1);
        assert_eq!(read.x[i], f64::from(*row) * 500.0);
        assert_eq!(read.pair[2 * i..2 * i + 2], [*row as f32, -(*row as f32)]);
    }
}

#[test]
fn files_and_streams_give_the_same_with_any_number_of_threads() {
    let rows = 200_003;
    let bytes = records(rows);
    let all: Vec<u32> = (0..rows).collect();
    let mut file = tempfile::tempfile().unwrap();
    std::io::Write::write_all(&mut file, b"head").unwrap();
    std::io::Write::write_all(&mut file, &bytes).unwrap();
    for threads in [1, 3] {
        check(
            &read(Source::File(&file, 4), rows, threads, None).unwrap(),
            &all,
        );
        let mut stream = bytes.as_slice();
        check(
            &read(Source::Stream(&mut stream), rows, threads, None).unwrap(),
            &all,
        );
    }
}

#[test]
fn a_selection_keeps_the_order() {
    let rows = 50_000;
    let bytes = records(rows);
    let select = |_: u64, tile: &[u8], rows: usize, picks: &mut Vec<Pick>| {
        for row in 0..rows {
            let place = (row * RECORD) as u32;
            if tile[row * RECORD + 1].is_multiple_of(3) {
                picks.push(Pick {
                    record: place,
                    sub: place,
                });
            }
        }
    };
    let mut stream = bytes.as_slice();
    let done = read(Source::Stream(&mut stream), rows, 2, Some(&select)).unwrap();
    let wanted: Vec<u32> = (0..rows).filter(|row| (row & 0xff) % 3 == 0).collect();
    check(&done, &wanted);
}

#[test]
fn what_ends_early_is_said() {
    let bytes = records(99);
    let mut stream = bytes.as_slice();
    let failure = read(Source::Stream(&mut stream), 100, 2, None)
        .err()
        .unwrap();
    assert!(
        failure.to_string().contains("ends before the 100 rows"),
        "{failure}"
    );
    let fields = fields();
    let pass = Pass {
        name: "a",
        rows: 99,
        record: RECORD,
        fields: &fields,
        select: None,
    };
    let mut stream = bytes.as_slice();
    let stopped = fill(
        Source::Stream(&mut stream),
        &pass,
        &mut [],
        &mut |_| Ok(()),
        &Stopped,
    );
    assert!(stopped.unwrap_err().is_cancelled());
}
