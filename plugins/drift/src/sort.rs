//! Sorting on all threads, with results that do not depend on their number.

use std::sync::{Mutex, PoisonError};

use puncta_sdk::Run;
use puncta_sdk::run::chunks_mut;

/// Values in a part that is sorted by one thread.
const PART: usize = 1 << 16;

/// Sorts row numbers by the value of their row, then by the number.
pub fn by_value(rows: &mut [u32], values: &[f64], run: &dyn Run) {
    let order = |a: &u32, b: &u32| {
        let value = |row: &u32| values[*row as usize];
        value(a).total_cmp(&value(b)).then(a.cmp(b))
    };
    chunks_mut(run, rows, PART, &|_, part| {
        if !run.cancelled() {
            part.sort_unstable_by(order);
        }
    });
    if !run.cancelled() {
        // Sorted parts: the stable sort finds and merges them.
        rows.sort_by(order);
    }
}

/// Starts of the runs of equal keys, and the end.
pub fn runs<T>(items: &[T], key: impl Fn(&T) -> u32) -> Vec<usize> {
    let mut starts = vec![0];
    let mut last = None;
    for (i, item) in items.iter().enumerate() {
        let key = key(item);
        if last.is_some_and(|last| last != key) {
            starts.push(i);
        }
        last = Some(key);
    }
    starts.push(items.len());
    starts
}

/// Calls `task` with each run, the slices between consecutive `starts`, on all threads.
pub fn each_run<T: Send>(
    items: &mut [T],
    starts: &[usize],
    run: &dyn Run,
    task: &(dyn Fn(&mut [T]) + Sync),
) {
    let mut blocks: Vec<Mutex<(usize, usize, &mut [T])>> = Vec::new();
    let mut rest = items;
    let mut begin = 0;
    while begin + 1 < starts.len() {
        let mut end = begin + 1;
        while end + 1 < starts.len() && starts[end + 1] - starts[begin] <= PART {
            end += 1;
        }
        let (head, tail) = rest.split_at_mut(starts[end] - starts[begin]);
        blocks.push(Mutex::new((begin, end, head)));
        rest = tail;
        begin = end;
    }
    run.parallel(blocks.len(), &|i| {
        let mut block = blocks[i].lock().unwrap_or_else(PoisonError::into_inner);
        let (begin, end, items) = &mut *block;
        let first = starts[*begin];
        for k in *begin..*end {
            if k % 256 == 0 && run.cancelled() {
                return;
            }
            task(&mut items[starts[k] - first..starts[k + 1] - first]);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::Threads;

    #[test]
    fn rows_are_sorted_by_value() {
        let count = 3 * PART + 11;
        let value = |i: usize| ((i * 7919) % 1009) as f64;
        let values: Vec<f64> = (0..count).map(value).collect();
        let mut rows: Vec<u32> = (0..count as u32).collect();
        by_value(&mut rows, &values, &Threads(2));
        let key = |row: u32| (values[row as usize], row);
        assert!(rows.is_sorted_by(|a, b| key(*a) < key(*b)));
        let starts = runs(&rows, |row| values[*row as usize] as u32);
        assert_eq!(starts.len(), 1010);
        each_run(&mut rows, &starts, &Threads(2), &|part| part.reverse());
        assert!(rows.is_sorted_by(|a, b| {
            let (a, b) = (key(*a), key(*b));
            a.0 < b.0 || (a.0 == b.0 && a.1 > b.1)
        }));
        assert_eq!(runs::<u32>(&[], |v| *v), [0, 0]);
    }
}
