//! Localisations by frame.

/// Rows in the order of their frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frames {
    /// Row numbers, by frame, then by row.
    pub rows: Vec<u32>,
    /// Number of each frame that has rows, increasing.
    pub numbers: Vec<i64>,
    /// Where each frame's rows start in `rows`, and the end.
    pub starts: Vec<usize>,
    /// Rows without a finite frame, or that `keep` refuses.
    pub left_out: usize,
}

impl Frames {
    /// Sorts rows by the whole part of `t`. Rows whose t is not finite, or that `keep` refuses, are
    /// left out.
    #[must_use]
    pub fn new(t: &[f64], keep: impl Fn(usize) -> bool) -> Frames {
        let frame = |row: u32| t[row as usize].floor() as i64;
        let mut rows: Vec<u32> = (0..t.len() as u32)
            .filter(|row| t[*row as usize].is_finite() && keep(*row as usize))
            .collect();
        // Most tables are sorted by time already.
        if !rows.is_sorted_by_key(|row| frame(*row)) {
            rows.sort_unstable_by_key(|row| (frame(*row), *row));
        }
        let mut frames = Frames {
            left_out: t.len() - rows.len(),
            ..Frames::default()
        };
        for group in rows.chunk_by(|a, b| frame(*a) == frame(*b)) {
            let end = frames.starts.last().copied().unwrap_or(0);
            if frames.starts.is_empty() {
                frames.starts.push(0);
            }
            frames.numbers.push(frame(group[0]));
            frames.starts.push(end + group.len());
        }
        frames.rows = rows;
        frames
    }

    /// Rows of the i-th frame that has rows.
    #[must_use]
    pub fn of(&self, i: usize) -> &[u32] {
        &self.rows[self.starts[i]..self.starts[i + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_grouped_by_frame() {
        let t = [3.0, 1e6 + 3.0, 3.5, f64::NAN, -1.0, 3.0];
        let frames = Frames::new(&t, |row| row != 5);
        assert_eq!(frames.numbers, [-1, 3, 1_000_003]);
        assert_eq!(frames.of(1), [0, 2]);
        assert_eq!((frames.of(0), frames.of(2)), (&[4][..], &[1][..]));
        assert_eq!(frames.left_out, 2);
        assert_eq!(Frames::new(&[], |_| true), Frames::default());
    }
}
