use super::*;
use crate::sink::Part;

fn layout(delimiter: Delimiter) -> Layout {
    Layout {
        delimiter,
        point: b'.',
        line_end: b'\n',
        trailing: false,
        comments: true,
        multiline: false,
    }
}

/// Reads rows of f64 columns.
fn read(text: &str, columns: usize, layout: Layout) -> Result<Vec<Vec<f64>>, Fault> {
    let mut bytes = text.as_bytes().to_vec();
    let end = bytes.len();
    bytes.resize(end + PADDING, 0);
    let piece = Piece {
        bytes: &bytes,
        end,
        layout,
    };
    let (rows, _) = piece.count(0);
    let mut values = vec![vec![0.0; rows]; columns];
    let mut sinks: Vec<Sink<'_>> = values
        .iter_mut()
        .map(|v| Sink {
            part: Part::F64(v),
            ..Sink::skip()
        })
        .collect();
    let taken = piece.take(0, &mut sinks)?;
    assert_eq!(taken, rows, "counting and reading agree");
    Ok((0..rows)
        .map(|r| values.iter().map(|v| v[r]).collect())
        .collect())
}

const COMMA: Delimiter = Delimiter::Byte(b',');

#[test]
fn rows_in_every_spelling() {
    let text = "1,2.5,-3\r\n 1 , 2.5,\t-3 \n\"1\",\"2.5\",\"-3\"\n1e0,25e-1,-3.000\n";
    let rows = read(text, 3, layout(COMMA)).unwrap();
    assert_eq!(rows, vec![vec![1.0, 2.5, -3.0]; 4]);
    let text = "  1 2.5\t-3\n1   2.5 -3  \n1 2.5 -3\r\n1 2.5 -3 \r\n";
    assert_eq!(read(text, 3, layout(Delimiter::Blanks)).unwrap(), rows);
    let tab = layout(Delimiter::Byte(b'\t'));
    assert_eq!(read("1\t 2.5\t-3\n", 3, tab).unwrap(), rows[..1]);
}

#[test]
fn blank_lines_and_comments_are_no_rows() {
    let rows = read("\n1,2\n  \n# c,d\r\n\r\n3,4\n\n", 2, layout(COMMA)).unwrap();
    assert_eq!(rows, [[1.0, 2.0], [3.0, 4.0]]);
}

#[test]
fn missing_values_are_nan() {
    let rows = read(",1,\nNA,,inf\n", 3, layout(COMMA)).unwrap();
    assert!(rows[0][0].is_nan() && rows[0][1] == 1.0 && rows[0][2].is_nan());
    assert!(rows[1][0].is_nan() && rows[1][1].is_nan() && rows[1][2] == f64::INFINITY);
    let tab = layout(Delimiter::Byte(b'\t'));
    assert!(
        read("\t\t\n", 3, tab).unwrap()[0]
            .iter()
            .all(|v| v.is_nan())
    );
}

#[test]
fn rows_of_another_length_are_refused() {
    let fault = |text, layout| read(text, 2, layout).unwrap_err();
    let count = |lines, field, n| Fault {
        lines,
        field,
        problem: Problem::Count(n),
    };
    assert_eq!(fault("1,2\n\n3\n", layout(COMMA)), count(2, 0, 1));
    assert_eq!(fault("1,2\n3,4,5\n", layout(COMMA)), count(1, 1, 3));
    assert_eq!(fault("1,2,\n", layout(COMMA)), count(0, 1, 3));
    assert_eq!(fault("1 2 3\n", layout(Delimiter::Blanks)), count(0, 1, 3));
    assert_eq!(fault("1\n", layout(Delimiter::Blanks)), count(0, 0, 1));
    let trailing = Layout {
        trailing: true,
        ..layout(COMMA)
    };
    assert_eq!(read("1,2,\n1,2, \n1,2\n", 2, trailing).unwrap().len(), 3);
    assert_eq!(fault("1,2,,\n", trailing), count(0, 1, 4));
}

#[test]
fn words_and_broken_quotes_are_refused() {
    let problem = |text| read(text, 2, layout(COMMA)).unwrap_err().problem;
    assert_eq!(problem("1,abc\n"), Problem::NotNumber(b"abc".to_vec()));
    assert_eq!(problem("1,2x\n"), Problem::NotNumber(b"2x".to_vec()));
    assert_eq!(problem("1,2\0\n"), Problem::NotNumber(b"2\0".to_vec()));
    assert_eq!(problem("1,\"2\n"), Problem::OpenQuote);
    assert_eq!(problem("1,\"2\"3\n"), Problem::BehindQuote);
}

#[test]
fn integers_ask_for_the_type_they_need() {
    let take = |text: &str, part: Part<'_>| {
        let mut bytes = text.as_bytes().to_vec();
        let end = bytes.len();
        bytes.resize(end + PADDING, 0);
        let piece = Piece {
            bytes: &bytes,
            end,
            layout: layout(COMMA),
        };
        let mut sinks = [Sink {
            part,
            settled: false,
            ..Sink::skip()
        }];
        piece.take(0, &mut sinks).map_err(|f| f.problem)
    };
    let mut one = [0i32];
    assert_eq!(take("7.0\n", Part::I32(&mut one)), Ok(1));
    assert_eq!(one, [7]);
    assert_eq!(
        take("7.5\n", Part::I32(&mut one)),
        Err(Problem::Needs(Kind::F64))
    );
    assert_eq!(
        take("nan\n", Part::I32(&mut one)),
        Err(Problem::Needs(Kind::F64))
    );
    assert_eq!(
        take("3000000000\n", Part::I32(&mut one)),
        Err(Problem::Needs(Kind::I64))
    );
    let mut float = [0.0];
    assert_eq!(
        take("9007199254740993\n", Part::F64(&mut float)),
        Err(Problem::Needs(Kind::I64))
    );
    assert_eq!(take("9007199254740994\n", Part::F64(&mut float)), Ok(1));
    let mut small = [0u8];
    let misfit = Err(Problem::Misfit(b"256".to_vec()));
    assert_eq!(take("256\n", Part::U8(&mut small)), misfit);
    let mut large = [0u64];
    assert_eq!(take("18446744073709551615\n", Part::U64(&mut large)), Ok(1));
    assert_eq!(large, [u64::MAX]);
}

#[test]
fn rows_with_line_ends_in_quotes_are_counted_as_one() {
    let text = "1,\"a\nb\"\n\n2,\"c\"\"\n\"\n3,d\n4,\"open";
    let mut bytes = text.as_bytes().to_vec();
    let end = bytes.len();
    bytes.resize(end + PADDING, 0);
    let layout = Layout {
        multiline: true,
        ..layout(COMMA)
    };
    let piece = Piece {
        bytes: &bytes,
        end,
        layout,
    };
    assert_eq!(piece.count_quoted(0), (3, 6, text.find("4,").unwrap()));
}
