//! Tables without a header: what their columns may be, by the file's suffix or by their values.

use crate::flavours::Flavour;

/// What was found out, and whether only the values say so.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Guess {
    /// The kind.
    pub flavour: Flavour,
    /// The units are not known then.
    pub assumed: bool,
}

/// The kind of a table without a header: by the person's word, the suffix, or the values of its
/// first rows.
pub fn guess(said: Flavour, file: &str, rows: &[Vec<f64>]) -> Guess {
    let known = |flavour| Guess {
        flavour,
        assumed: false,
    };
    let count = rows.first().map_or(0, Vec::len);
    if said != Flavour::Auto {
        return known(said);
    }
    let lower = file.to_lowercase();
    let ends = |suffix: &str| lower.ends_with(suffix);
    let by_suffix = if ends(".trxyt") {
        Flavour::Trxyt
    } else if ends(".malk") {
        Flavour::Malk
    } else if [".2d", ".3d", ".2dlp", ".3dlp"].iter().any(|s| ends(s)) {
        Flavour::Visp
    } else {
        Flavour::Auto
    };
    if by_suffix.positions(count, file).is_some() {
        return known(by_suffix);
    }
    let flavour = if eval_spt(rows) {
        Flavour::Evalspt
    } else if trxyt(rows) {
        Flavour::Trxyt
    } else {
        Flavour::Auto
    };
    Guess {
        flavour,
        assumed: flavour != Flavour::Auto,
    }
}

/// Enough rows to see a pattern.
const ROWS: usize = 8;

fn whole(value: f64) -> bool {
    value >= 0.0 && value.fract() == 0.0
}

/// Whether the rows are tracks: whole ids that never fall, and a time that grows within each.
fn tracks(rows: &[Vec<f64>], id: usize, time: usize) -> bool {
    let value = |row: &Vec<f64>, at: usize| row.get(at).copied().unwrap_or(f64::NAN);
    let mut continued = 0;
    let steps = rows.windows(2).all(|pair| {
        let [a, b] = pair else { return false };
        let (from, to) = (value(a, id), value(b, id));
        let within = from == to;
        continued += usize::from(within);
        whole(from) && whole(to) && to >= from && (!within || value(b, time) > value(a, time))
    });
    steps && rows.len() >= ROWS && continued >= rows.len() / 4
}

fn eval_spt(rows: &[Vec<f64>]) -> bool {
    let frames = rows
        .iter()
        .all(|row| row.len() == 8 && row.get(2).is_some_and(|f| whole(*f)));
    frames && tracks(rows, 3, 2)
}

fn trxyt(rows: &[Vec<f64>]) -> bool {
    let fractions = |at: usize| {
        rows.iter()
            .any(|row| row.get(at).is_some_and(|v| v.fract() != 0.0))
    };
    match rows.first().map(Vec::len) {
        Some(4) => fractions(1) && fractions(3) && tracks(rows, 0, 3),
        Some(5) => {
            let counted = rows.windows(2).all(|pair| match pair {
                [a, b] => b.first().zip(a.first()).is_some_and(|(b, a)| b - a == 1.0),
                _ => false,
            });
            counted && fractions(2) && fractions(4) && tracks(rows, 1, 4)
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(columns: usize, row: impl Fn(usize) -> Vec<f64>) -> Vec<Vec<f64>> {
        let all: Vec<Vec<f64>> = (0..12).map(row).collect();
        assert!(all.iter().all(|r| r.len() == columns));
        all
    }

    #[test]
    fn tracks_are_seen_in_the_values_but_their_units_are_not() {
        let eval = rows(8, |i| {
            let (track, frame) = ((i / 4 + 1) as f64, (i % 4 + 1) as f64);
            vec![8.25, 30.5, frame, track, 1.0, 2.0, 3.0, 4.0]
        });
        let found = guess(Flavour::Auto, "a.txt", &eval);
        assert_eq!((found.flavour, found.assumed), (Flavour::Evalspt, true));
        let trxyt = rows(4, |i| {
            vec![(i / 6) as f64, 0.5, 0.25, i as f64 * 0.05 + 0.01]
        });
        let found = guess(Flavour::Auto, "a.txt", &trxyt);
        assert_eq!((found.flavour, found.assumed), (Flavour::Trxyt, true));
        let found = guess(Flavour::Auto, "a.trxyt", &trxyt);
        assert_eq!((found.flavour, found.assumed), (Flavour::Trxyt, false));
        let points = rows(4, |i| vec![0.5 * i as f64, 1.5, 2.5, 1.0]);
        assert_eq!(
            guess(Flavour::Auto, "a.txt", &points).flavour,
            Flavour::Auto
        );
        assert_eq!(guess(Flavour::Auto, "a.2d", &points).flavour, Flavour::Visp);
        assert_eq!(guess(Flavour::Auto, "a.3d", &points).flavour, Flavour::Auto);
        assert_eq!(
            guess(Flavour::Malk, "a.txt", &points).flavour,
            Flavour::Malk
        );
    }
}
