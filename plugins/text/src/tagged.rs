//! Micro-Manager's tagged spots: `name: value` between tabs, the settings in the first line.

use crate::wording::quoted;
use puncta_sdk::Failure;
use std::collections::BTreeMap;

/// More names than this are no table.
const NAMES: usize = 256;

/// `name: value` fields of a line; `None` when one is something else.
fn tags(line: &[u8]) -> Option<Vec<(&[u8], &[u8])>> {
    let fields = line
        .split(|b| *b == b'\t')
        .map(<[u8]>::trim_ascii)
        .filter(|f| !f.is_empty());
    fields
        .map(|field| {
            let at = memchr::memchr(b':', field)?;
            let name = field.get(..at)?.trim_ascii();
            let value = field.get(at + 1..)?.trim_ascii();
            let fits =
                !name.is_empty() && name.iter().all(|b| b.is_ascii_alphanumeric() || *b == b'_');
            fits.then_some((name, value))
        })
        .collect()
}

/// Whether the first line is that of tagged spots.
pub fn is_tagged(head: &[u8]) -> bool {
    let line = head.split(|b| *b == b'\n').next().unwrap_or(&[]);
    tags(line).is_some_and(|tags| tags.len() >= 3)
}

/// The spots as a table with a header, between tabs; the settings as a comment.
///
/// # Errors
/// A line that holds something else, or no spot.
pub fn plain(text: &[u8], file: &str) -> Result<Vec<u8>, Failure> {
    let mut lines = text
        .split(|b| *b == b'\n')
        .enumerate()
        .map(|(number, line)| (number as u64 + 1, line.trim_ascii()))
        .filter(|(_, line)| !line.is_empty());
    let mut out = Vec::with_capacity(text.len());
    let mut names: Vec<&[u8]> = Vec::new();
    let mut places = BTreeMap::new();
    let mut units: Option<&[u8]> = None;
    for (number, line) in &mut lines {
        let damaged = |what: String| Failure::bad_file(what).row(number);
        let tags = tags(line).ok_or_else(|| {
            damaged(format!(
                "{file}: {} holds no name: value fields",
                quoted(line)
            ))
        })?;
        let value = |wanted: &[u8]| {
            tags.iter()
                .find(|(name, _)| *name == wanted)
                .map(|(_, v)| *v)
        };
        if names.is_empty() && (value(b"x").is_none() || value(b"y").is_none()) {
            units = units.or(value(b"location_units"));
            out.extend_from_slice(b"# ");
            out.extend_from_slice(line);
            out.push(b'\n');
            continue;
        }
        if names.is_empty() {
            names = tags.iter().map(|(name, _)| *name).take(NAMES).collect();
            places = names
                .iter()
                .enumerate()
                .map(|(at, name)| (*name, at))
                .collect();
            header(&mut out, &names, units);
        }
        let row = row(&tags, &places, names.len()).map_err(|name| {
            let name = quoted(name);
            damaged(format!(
                "{file}: the spot has {name}, which the first spot has not"
            ))
        })?;
        out.extend_from_slice(&row.join(&b'\t'));
        out.push(b'\n');
    }
    if names.is_empty() {
        return Err(Failure::bad_file(format!(
            "{file} holds no spot with x and y"
        )));
    }
    Ok(out)
}

/// The values of a spot in the order of the columns, or the name that has none.
fn row<'a>(
    tags: &[(&'a [u8], &'a [u8])],
    places: &BTreeMap<&[u8], usize>,
    count: usize,
) -> Result<Vec<&'a [u8]>, &'a [u8]> {
    let mut row: Vec<&[u8]> = vec![b""; count];
    for (name, value) in tags {
        let place = places.get(name).and_then(|at| row.get_mut(*at));
        *place.ok_or(*name)? = value;
    }
    Ok(row)
}

fn header(out: &mut Vec<u8>, names: &[&[u8]], units: Option<&[u8]>) {
    let unit = match units.map(<[u8]>::to_ascii_lowercase).as_deref() {
        Some(b"nm" | b"0") => " [nm]",
        Some(b"um" | b"1") => " [um]",
        Some(b"pixels" | b"px" | b"2") => " [px]",
        _ => "",
    };
    let lengths: [&[u8]; 6] = [
        b"x",
        b"y",
        b"z",
        b"x_precision",
        b"y_precision",
        b"z_precision",
    ];
    for (at, name) in names.iter().enumerate() {
        if at > 0 {
            out.push(b'\t');
        }
        out.extend_from_slice(name);
        if lengths.contains(name) {
            out.extend_from_slice(unit.as_bytes());
        }
    }
    out.push(b'\n');
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &[u8] = b"application_id: 1\tname: a\tlocation_units: NM\tnr_spots: 2\n\
        molecule: 1\tframe: 1\tx: 10.5\ty: 20\tintensity: 300\n\
        molecule: 2\ty: 21\tframe: 2\tx: 11\n";

    #[test]
    fn tags_become_columns() {
        assert!(is_tagged(FILE));
        assert!(!is_tagged(b"x,y\n1,2\n") && !is_tagged(b"a: 1\n"));
        let text = String::from_utf8(plain(FILE, "f").unwrap()).unwrap();
        assert_eq!(
            text,
            "# application_id: 1\tname: a\tlocation_units: NM\tnr_spots: 2\n\
             molecule\tframe\tx [nm]\ty [nm]\tintensity\n1\t1\t10.5\t20\t300\n2\t2\t11\t21\t\n"
        );
    }

    #[test]
    fn other_lines_are_refused_with_their_number() {
        let bad = [FILE, b"molecule 3\n"].concat();
        assert_eq!(plain(&bad, "f").unwrap_err().row, Some(4));
        let odd = [FILE, b"molecule: 3\tq: 1\n"].concat();
        assert_eq!(plain(&odd, "f").unwrap_err().row, Some(4));
        assert!(plain(b"a: 1\tb: 2\tc: 3\n", "f").is_err());
    }
}
