//! Disjoint sets of numbers (union-find).

/// Disjoint sets of the numbers below some count, each known by its lowest number. Paths are halved
/// while they are walked (Tarjan and van Leeuwen, J. ACM 31, 1984).
#[derive(Clone, Debug)]
pub struct Groups(Vec<u32>);

impl Groups {
    /// Each number by itself. At most 2^32 of them.
    #[must_use]
    pub fn new(count: usize) -> Groups {
        Groups((0..count as u32).collect())
    }

    /// The lowest number of a number's set.
    ///
    /// # Panics
    /// When there is no such number.
    pub fn find(&mut self, mut a: u32) -> u32 {
        while self.0[a as usize] != a {
            let up = self.0[self.0[a as usize] as usize];
            self.0[a as usize] = up;
            a = up;
        }
        a
    }

    /// Makes one set of those of two numbers.
    ///
    /// # Panics
    /// When there is no such number.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_known_by_their_lowest_number() {
        let mut groups = Groups::new(10);
        for (a, b) in [(9, 4), (4, 7), (1, 2), (2, 2), (7, 3)] {
            groups.join(a, b);
        }
        let found: Vec<u32> = (0..10).map(|i| groups.find(i)).collect();
        assert_eq!(found, [0, 1, 1, 3, 3, 5, 6, 3, 8, 3]);
    }
}
