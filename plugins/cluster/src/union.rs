//! Sets that are joined by several threads at once.

use std::sync::atomic::{AtomicU32, Ordering};

/// Numbers 0 to n - 1 in sets. A set's root is its smallest number, so that it does not depend on
/// the order in which sets were joined.
#[derive(Debug)]
pub struct Union(Vec<AtomicU32>);

impl Union {
    /// Each number in a set of its own; at most 2^32 - 1 of them.
    #[must_use]
    pub fn new(count: usize) -> Union {
        #[allow(clippy::cast_possible_truncation)]
        Union(
            (0..count)
                .map(|number| AtomicU32::new(number as u32))
                .collect(),
        )
    }

    /// The smallest number of the set.
    #[must_use]
    pub fn root(&self, number: usize) -> usize {
        let mut at = number;
        loop {
            let parent = self.0[at].load(Ordering::Relaxed);
            if parent as usize == at {
                return at;
            }
            // Halves the path; a parent only ever changes to one nearer the root.
            let above = self.0[parent as usize].load(Ordering::Relaxed);
            if above != parent {
                let _ = self.0[at].compare_exchange(
                    parent,
                    above,
                    Ordering::Relaxed,
                    Ordering::Relaxed,
                );
            }
            at = above as usize;
        }
    }

    /// Whether two numbers are in one set.
    #[must_use]
    pub fn joined(&self, a: usize, b: usize) -> bool {
        self.root(a) == self.root(b)
    }

    /// Joins the sets of two numbers.
    pub fn join(&self, a: usize, b: usize) {
        let (mut a, mut b) = (self.root(a), self.root(b));
        while a != b {
            let (low, high) = (a.min(b), a.max(b));
            #[allow(clippy::cast_possible_truncation)]
            let (small, large) = (low as u32, high as u32);
            let hung =
                self.0[high].compare_exchange(large, small, Ordering::Relaxed, Ordering::Relaxed);
            if hung.is_ok() {
                return;
            }
            (a, b) = (self.root(low), self.root(high));
        }
    }
}
