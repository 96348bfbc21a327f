//! Results by key, within a budget.

use super::Key;
use super::flight::Outputs;
use super::report::Record;
use puncta_documents::{Failure, FailureCode};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Records without results that are kept.
const MOST_RECORDS: usize = 50_000;

/// What is known of a key.
pub(crate) enum Held<O> {
    Outputs(Arc<Outputs<O>>, u64),
    /// It would fail again in the same way.
    Failure(Failure),
    /// The result was dropped for its size.
    Dropped,
}

struct Entry<O> {
    held: Held<O>,
    record: Option<Arc<Record>>,
    used: u64,
}

/// Results by key. Over the budget the least recently used ones are dropped; a run touches
/// everything it needs at its start, so that results of no current step go first.
pub(crate) struct Memo<O> {
    entries: HashMap<Key, Entry<O>>,
    /// Keys with outputs by last use.
    uses: BTreeMap<u64, Key>,
    clock: u64,
    bytes: u64,
    budget: u64,
}

impl<O> Memo<O> {
    pub fn new(budget: u64) -> Memo<O> {
        Memo {
            entries: HashMap::new(),
            uses: BTreeMap::new(),
            clock: 0,
            bytes: 0,
            budget,
        }
    }

    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    pub fn held(&self, key: &Key) -> Option<&Held<O>> {
        self.entries.get(key).map(|entry| &entry.held)
    }

    pub fn record(&self, key: &Key) -> Option<Arc<Record>> {
        self.entries.get(key)?.record.clone()
    }

    /// Makes a result the most recently used.
    pub fn touch(&mut self, key: &Key) {
        if let Some(entry) = self.entries.get_mut(key) {
            self.clock += 1;
            let known = self.uses.remove(&entry.used).is_some();
            entry.used = self.clock;
            if known {
                self.uses.insert(self.clock, *key);
            }
        }
    }

    /// Remembers outputs. What has to go for them is returned, to be dropped without a lock.
    #[must_use]
    pub fn insert(
        &mut self,
        key: Key,
        outputs: Arc<Outputs<O>>,
        bytes: u64,
        record: Arc<Record>,
    ) -> Vec<Held<O>> {
        let mut gone = self.remove(&key);
        self.clock += 1;
        // What does not fit at all would only push out everything else.
        let held = if bytes <= self.budget {
            self.bytes += bytes;
            self.uses.insert(self.clock, key);
            Held::Outputs(outputs, bytes)
        } else {
            Held::Dropped
        };
        self.entries.insert(
            key,
            Entry {
                held,
                record: Some(record),
                used: self.clock,
            },
        );
        gone.extend(self.trim());
        gone
    }

    /// Remembers a failure, if the same call would fail again.
    pub fn fail(&mut self, key: Key, failure: &Failure) {
        use FailureCode::{BadInput, BadParameter, NoConvergence, Unsupported};
        if matches!(
            failure.code,
            BadInput | BadParameter | NoConvergence | Unsupported
        ) && !self.entries.contains_key(&key)
        {
            self.clock += 1;
            let held = Held::Failure(failure.clone());
            self.entries.insert(
                key,
                Entry {
                    held,
                    record: None,
                    used: self.clock,
                },
            );
        }
    }

    /// Sets the budget and drops what is beyond it.
    #[must_use]
    pub fn set_budget(&mut self, budget: u64) -> Vec<Held<O>> {
        self.budget = budget;
        self.trim()
    }

    /// Forgets failures, so that they are tried again.
    pub fn forget_failures(&mut self) {
        self.entries
            .retain(|_, entry| !matches!(entry.held, Held::Failure(_)));
    }

    /// Forgets everything.
    #[must_use]
    pub fn clear(&mut self) -> Vec<Held<O>> {
        self.uses.clear();
        self.bytes = 0;
        self.entries.drain().map(|(_, entry)| entry.held).collect()
    }

    fn remove(&mut self, key: &Key) -> Vec<Held<O>> {
        let Some(entry) = self.entries.remove(key) else {
            return Vec::new();
        };
        if let Held::Outputs(_, bytes) = &entry.held {
            self.bytes = self.bytes.saturating_sub(*bytes);
            self.uses.remove(&entry.used);
        }
        vec![entry.held]
    }

    fn trim(&mut self) -> Vec<Held<O>> {
        let mut gone = Vec::new();
        while self.bytes > self.budget
            && let Some((_, key)) = self.uses.pop_first()
        {
            if let Some(entry) = self.entries.get_mut(&key)
                && let Held::Outputs(_, bytes) = &entry.held
            {
                self.bytes = self.bytes.saturating_sub(*bytes);
                gone.push(std::mem::replace(&mut entry.held, Held::Dropped));
            }
        }
        let bare = self.entries.len() - self.uses.len();
        if bare > MOST_RECORDS {
            let without = self
                .entries
                .values()
                .filter(|one| !matches!(one.held, Held::Outputs(..)));
            let mut used: Vec<u64> = without.map(|entry| entry.used).collect();
            let (_, middle, _) = used.select_nth_unstable(bare / 2);
            let middle = *middle;
            self.entries
                .retain(|_, entry| entry.used > middle || matches!(entry.held, Held::Outputs(..)));
        }
        gone
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_documents::Map;

    fn record() -> Arc<Record> {
        Arc::new(Record {
            operation: "a/1".into(),
            plugin: Arc::default(),
            parameters: Arc::new(Map::new()),
            inputs: Vec::new(),
        })
    }

    fn key(number: u16) -> Key {
        let mut bytes = [0; 32];
        bytes[..2].copy_from_slice(&number.to_le_bytes());
        Key::from_bytes(bytes)
    }

    fn has(memo: &Memo<u8>, number: u16) -> bool {
        matches!(memo.held(&key(number)), Some(Held::Outputs(..)))
    }

    #[test]
    fn the_least_recently_used_goes_first() {
        let mut memo: Memo<u8> = Memo::new(100);
        for number in 0..4 {
            assert!(
                memo.insert(key(number), Arc::default(), 25, record())
                    .is_empty()
            );
        }
        memo.touch(&key(0));
        assert_eq!(memo.insert(key(4), Arc::default(), 50, record()).len(), 2);
        let there = [0, 1, 2, 3, 4].map(|number| has(&memo, number));
        assert_eq!(there, [true, false, false, true, true]);
        assert_eq!(memo.bytes(), 100);
        assert!(memo.record(&key(1)).is_some());
        // One that cannot fit leaves the others alone.
        assert!(
            memo.insert(key(5), Arc::default(), 101, record())
                .is_empty()
        );
        assert!(!has(&memo, 5) && has(&memo, 0));
        assert_eq!(memo.set_budget(50).len(), 2);
        assert!(has(&memo, 4));
        assert_eq!(memo.insert(key(4), Arc::default(), 10, record()).len(), 1);
        assert_eq!(memo.bytes(), 10);
    }

    #[test]
    fn only_failures_that_would_come_again_are_kept() {
        let mut memo: Memo<u8> = Memo::new(100);
        memo.fail(key(0), &Failure::bad_input("no"));
        memo.fail(key(1), &Failure::new(FailureCode::Crashed, "no"));
        assert!(memo.held(&key(0)).is_some() && memo.held(&key(1)).is_none());
        memo.forget_failures();
        assert!(memo.held(&key(0)).is_none());
    }

    #[test]
    fn records_do_not_grow_without_end() {
        let mut memo: Memo<u8> = Memo::new(10);
        for number in 0..=u16::MAX {
            drop(memo.insert(key(number), Arc::default(), 11, record()));
        }
        assert!(memo.entries.len() <= MOST_RECORDS);
        assert!(memo.record(&key(u16::MAX)).is_some() && memo.record(&key(0)).is_none());
    }
}
