//! Parallel work in blocks of fixed size, so that results do not depend on the number of threads.

use puncta_sdk::Cancelled;
use puncta_sdk::run::{Run, map};
use std::ops::Range;

/// Items of a block: short enough that cancel is polled between blocks only.
const BLOCK: usize = 2048;

/// Calls `task` for blocks of `0..count` in parallel; the results in order.
pub(crate) fn by_block<T: Send>(
    run: &dyn Run,
    count: usize,
    task: impl Fn(Range<usize>) -> T + Sync,
) -> Result<Vec<T>, Cancelled> {
    let parts = map(run, count.div_ceil(BLOCK), &|block| {
        let begin = block * BLOCK;
        (!run.cancelled()).then(|| task(begin..count.min(begin + BLOCK)))
    });
    let parts: Option<Vec<T>> = parts.into_iter().collect();
    parts.filter(|_| !run.cancelled()).ok_or(Cancelled)
}

/// `task(i)` for each i of `0..count`, in parallel.
pub(crate) fn by_item<T: Send>(
    run: &dyn Run,
    count: usize,
    task: impl Fn(usize) -> T + Sync,
) -> Result<Vec<T>, Cancelled> {
    let parts = by_block(run, count, |block| block.map(&task).collect::<Vec<T>>())?;
    let mut items = Vec::with_capacity(count);
    parts.into_iter().for_each(|part| items.extend(part));
    Ok(items)
}

/// The sum of `task(i)` over `0..count`, block by block.
pub(crate) fn sum(
    run: &dyn Run,
    count: usize,
    task: impl Fn(usize) -> f64 + Sync,
) -> Result<f64, Cancelled> {
    let parts = by_block(run, count, |block| block.map(&task).sum::<f64>())?;
    Ok(parts.iter().sum())
}
