//! The rows of each group that a column of numbers makes.

use puncta_sdk::Cancelled;
use puncta_sdk::Run;

/// Groups in the order of their numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Groups {
    /// Numbers, rising.
    pub numbers: Vec<i32>,
    starts: Vec<usize>,
    rows: Vec<u32>,
}

impl Groups {
    /// Groups of the rows that `keep` and whose number is above 0.
    ///
    /// # Errors
    /// When cancelled.
    pub fn new(
        numbers: &[f64],
        keep: &dyn Fn(usize) -> bool,
        run: &dyn Run,
    ) -> Result<Groups, Cancelled> {
        let mut pairs: Vec<(i32, u32)> = Vec::new();
        for (row, number) in numbers.iter().enumerate() {
            if row.is_multiple_of(1 << 18) && run.cancelled() {
                return Err(Cancelled);
            }
            if *number >= 1.0 && *number <= f64::from(i32::MAX) && keep(row) {
                #[allow(clippy::cast_possible_truncation)]
                pairs.push((*number as i32, row as u32));
            }
        }
        pairs.sort_unstable();
        let mut groups = Groups {
            rows: pairs.iter().map(|pair| pair.1).collect(),
            ..Groups::default()
        };
        for (place, (number, _)) in pairs.iter().enumerate() {
            if groups.numbers.last() != Some(number) {
                groups.numbers.push(*number);
                groups.starts.push(place);
            }
        }
        groups.starts.push(pairs.len());
        Ok(groups)
    }

    /// Number of groups.
    #[must_use]
    pub fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    /// Rows of the group at a place.
    #[must_use]
    pub fn rows(&self, group: usize) -> &[u32] {
        &self.rows[self.starts[group]..self.starts[group + 1]]
    }
}
