use super::*;
use crate::options::Delimiter::{Blanks, Byte};

fn names(dialect: &Dialect) -> Vec<&str> {
    dialect.names.iter().map(String::as_str).collect()
}

fn sniffed(text: &str) -> Dialect {
    sniff(text.as_bytes(), "f.csv").unwrap_or_else(|e| panic!("{text:?}: {e}"))
}

fn refused(text: &[u8]) -> String {
    sniff(text, "f.csv").unwrap_err().to_string()
}

#[test]
fn delimiters() {
    for (text, delimiter) in [
        ("x,y\n1,2\n", Byte(b',')),
        ("x\ty\n1\t2\n", Byte(b'\t')),
        ("x;y\n1;2\n", Byte(b';')),
        ("x|y\n1|2\n", Byte(b'|')),
        ("x y t\n1  2 3\n", Blanks),
        ("x [nm] y [nm]\n1 2\n", Blanks),
        ("x\n1\n2\n", Byte(b',')),
        ("x, y\n1, 2\n", Byte(b',')),
        ("name\tvalue\na,b\t1\nc,d\t2\n", Byte(b'\t')),
    ] {
        assert_eq!(sniffed(text).delimiter, delimiter, "{text:?}");
    }
}

#[test]
fn headers() {
    let d = sniffed("\"id\",\"frame\",\"x [nm]\"\r\n1,1,2.5\r\n");
    assert_eq!(
        (names(&d), d.data_start, d.data_line),
        (vec!["id", "frame", "x [nm]"], 23, 2)
    );
    let d = sniffed("\"id,\"\"frame\"\",\"\"x [nm]\"\"\"\n1,1,2.5\n");
    assert_eq!(names(&d), ["id", "frame", "x [nm]"]);
    let d = sniffed("#A, x, y\n1, 2, 3\n");
    assert_eq!(
        (names(&d), d.data_start, d.flavour),
        (vec!["A", "x", "y"], 9, Flavour::Pyme)
    );
    let d = sniffed(",x [nm],y [nm]\n0,1,2\n");
    assert_eq!(names(&d), ["", "x [nm]", "y [nm]"]);
    let d = sniffed("x,y,z \n1,2,3\n");
    assert_eq!(names(&d), ["x", "y", "z"]);
    let d = sniffed("\n# a note\n\nx,y\n\n1,2\n");
    assert_eq!(
        (d.data_line, d.comments.clone()),
        (6, vec!["a note".to_owned()])
    );
    let d = sniffed("x,y\n");
    assert_eq!(
        (names(&d), d.data_start, d.data_line),
        (vec!["x", "y"], 4, 2)
    );
    let d = sniffed("x\ty\t\n1\t2\t\n");
    assert_eq!((names(&d), d.trailing), (vec!["x", "y"], true));
    let d = sniffed("x,y\n1,2,\n3,4,\n");
    assert_eq!((names(&d), d.trailing), (vec!["x", "y"], true));
}

#[test]
fn flavours() {
    for (text, flavour) in [
        ("id,frame,x [nm],y [nm]\n1,1,2,3\n", Flavour::Thunderstorm),
        ("#x\ty\tsig\n1\t2\t3\n", Flavour::Pyme),
        (
            "#LUME VERSION, 0.54\r\n#2 points\r\nframe,x,y\r\n1,2,3\r\n",
            Flavour::Vlume,
        ),
        (
            "Index\tFirst Frame\tPosition X [nm]\n1\t1\t2\n",
            Flavour::Elyra,
        ),
        (
            "Ground-truth,frame,xnano,intensity \n1, 20, 25.5, 3\n",
            Flavour::Challenge,
        ),
        ("xnm,ynm,locprecnm,frame\n1,2,3,4\n", Flavour::Smap),
        (
            "#puncta.text/1 types=f64,i32\nx [nm],n [1]\n1.0,2\n",
            Flavour::Typed,
        ),
        ("x,y,t\n1,2,3\n", Flavour::Auto),
    ] {
        assert_eq!(sniffed(text).flavour, flavour, "{text:?}");
    }
}

#[test]
fn encodings_and_line_ends() {
    let d = sniff(b"\xef\xbb\xbfx,y\n1,2\n", "f.csv").unwrap();
    assert_eq!((names(&d), d.data_start), (vec!["x", "y"], 7));
    let d = sniff(b"x [\xb5m],y\n1,2\n", "f.csv").unwrap();
    assert_eq!(names(&d), ["x [µm]", "y"]);
    let utf16: Vec<u8> = "\u{feff}x,y\r\n1,2\r\n"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    let d = sniff(&utf16, "f.csv").unwrap();
    assert_eq!(
        (names(&d), d.encoding),
        (vec!["x", "y"], Encoding::Utf16Little)
    );
    let d = sniffed("x,y\r1,2\r");
    assert_eq!((d.line_end, d.data_start), (b'\r', 4));
}

#[test]
fn decimal_commas() {
    assert_eq!(sniffed("x;y\n1,5;2\n").point, b',');
    assert_eq!(sniffed("x;y\n1.5;2,5\n").point, b'.');
    assert_eq!(sniffed("x,y\n1,5\n").point, b'.');
}

#[test]
fn a_list_of_names() {
    let mut options = Options::default();
    options.mapping.set_columns("x,y,t").unwrap();
    let d = sniff_with(b"1.5,2,3\n4,5,6\n", "f.csv", &options).unwrap();
    assert_eq!(
        (names(&d), d.data_start, d.listed),
        (vec!["x", "y", "t"], 0, true)
    );
    let d = sniff_with(b"a,b,c\n4,5,6\n", "f.csv", &options).unwrap();
    assert_eq!((names(&d), d.data_start), (vec!["x", "y", "t"], 6));
    let e = sniff_with(b"1,2\n", "f.csv", &options).unwrap_err();
    assert_eq!(e.parameter.as_deref(), Some("columns"));
    options.skip_rows = 2;
    let d = sniff_with(b"title\n\n1,2,3\n", "f.csv", &options).unwrap();
    assert_eq!((d.data_start, d.data_line), (7, 3));
}

#[test]
fn what_is_refused() {
    for (text, part) in [
        (&b""[..], "is empty"),
        (b"\n \n", "blank lines"),
        (b"# a\n# b\n", "comments"),
        (b"x,y,x\n1,2,3\n", "columns 1 and 3 \"x\""),
        (b"\x89HDF\r\n\x1a\n\0\0\0\0", "no text table"),
        (b"PK\x03\x04", "no text table"),
        (
            b"just some words\nthat go on here and there\nwithout end",
            "no table",
        ),
        (
            b"# <localizations insequence=\"true\">\n1 2 3\n",
            "names 0 fields",
        ),
    ] {
        let sentence = refused(text);
        assert!(sentence.contains(part), "{sentence}");
    }
    let line = vec![b'x'; HEAD];
    assert!(refused(&line).contains("one line"));
}
