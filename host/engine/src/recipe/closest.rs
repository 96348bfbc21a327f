//! The known name that a person most likely meant.

/// Names longer than this are not compared.
const LONGEST: usize = 128;

/// The closest of `known` to `name`, if any is close; ties go to the first in alphabetical order.
pub(crate) fn closest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    several(name, known, 1).into_iter().next()
}

/// Up to `most` names that are equally close.
pub(crate) fn several<'a>(
    name: &str,
    known: impl IntoIterator<Item = &'a str>,
    most: usize,
) -> Vec<&'a str> {
    let letters: Vec<char> = name.chars().take(LONGEST + 1).collect();
    if letters.len() > LONGEST {
        return Vec::new();
    }
    // A third of the letters may differ, at least one.
    let limit = (letters.len() / 3).max(1);
    let mut found: Vec<(usize, &str)> = known
        .into_iter()
        .filter(|one| one.len() <= LONGEST)
        .filter_map(|one| Some((distance(&letters, one, limit)?, one)))
        .collect();
    found.sort_unstable();
    found.dedup();
    let least = found.first().map_or(0, |(distance, _)| *distance);
    found
        .into_iter()
        .take_while(|(distance, _)| *distance == least)
        .take(most)
        .map(|(_, one)| one)
        .collect()
}

/// Insertions, deletions, replacements and swaps of neighbours that turn one into the other
/// (optimal string alignment), without regard to case, if there are at most `limit`.
fn distance(a: &[char], b: &str, limit: usize) -> Option<usize> {
    let same = |x: char, y: char| x.to_lowercase().eq(y.to_lowercase());
    let b: Vec<char> = b.chars().collect();
    if a.len().abs_diff(b.len()) > limit {
        return None;
    }
    // Rows of the table for two, one and no letters less of `a`.
    let mut before: Vec<usize> = Vec::new();
    let mut last: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut row = Vec::with_capacity(last.len());
        row.push(i + 1);
        for (j, y) in b.iter().enumerate() {
            let cell = |row: &[usize], at: usize| row.get(at).copied().unwrap_or(usize::MAX - 1);
            let changed = cell(&last, j) + usize::from(!same(*x, *y));
            let mut least = changed.min(cell(&last, j + 1) + 1).min(cell(&row, j) + 1);
            let (above, left) = (i.checked_sub(1), j.checked_sub(1));
            if let (Some(above), Some(left)) = (above, left)
                && a.get(above).is_some_and(|other| same(*other, *y))
                && b.get(left).is_some_and(|other| same(*x, *other))
            {
                least = least.min(cell(&before, left) + 1);
            }
            row.push(least);
        }
        before = std::mem::replace(&mut last, row);
    }
    last.last().copied().filter(|found| *found <= limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn close_names_are_found() {
        let known = ["pixel_size", "sigma", "seed"];
        assert_eq!(closest("pixelsize", known), Some("pixel_size"));
        assert_eq!(closest("Sigma", known), Some("sigma"));
        assert_eq!(closest("sede", known), Some("seed"));
        assert_eq!(closest("sed", known), Some("seed"));
        assert_eq!(closest("zzzzzz", known), None);
        assert_eq!(closest("", known), None);
        assert_eq!(closest(&"x".repeat(10_000), known), None);
    }

    #[test]
    fn the_distance_counts_changes() {
        let letters: Vec<char> = "kitten".chars().collect();
        assert_eq!(distance(&letters, "sitting", 5), Some(3));
        assert_eq!(distance(&letters, "sitting", 2), None);
        assert_eq!(distance(&letters, "kitten", 0), Some(0));
        assert_eq!(distance(&letters, "iktten", 5), Some(1));
        assert_eq!(distance(&letters, "", 6), Some(6));
        assert_eq!(distance(&[], "abc", 6), Some(3));
    }
}
