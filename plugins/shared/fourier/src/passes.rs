//! The passes over memory that transforms are made of.

use crate::Real;
use puncta_sdk::run::{Cancelled, Run, chunks_mut};
use rustfft::{Fft, num_complex::Complex};
use std::sync::Arc;

/// Lines that one task transforms.
pub(crate) const LINES: usize = 16;

/// Rows that are transposed at once: their part of a line fills one cache line.
const TILE: usize = 8;

/// A one-dimensional transform.
pub(crate) type Plan<T> = Arc<dyn Fft<T>>;

/// Whether the call goes on.
pub(crate) fn go_on(run: &dyn Run) -> Result<(), Cancelled> {
    if run.cancelled() {
        Err(Cancelled)
    } else {
        Ok(())
    }
}

/// Room for the scratch numbers of a plan.
pub(crate) fn scratch<T: Real>(length: usize) -> Vec<Complex<T>> {
    vec![Complex::default(); length]
}

/// Copies columns `first..` of `from` (lines of `width` numbers) into the lines of `to`, each as
/// long as `from` has lines.
pub(crate) fn gather<T: Copy>(from: &[T], width: usize, first: usize, to: &mut [T]) {
    let height = from.len() / width.max(1);
    if height == 0 {
        return;
    }
    for top in (0..height).step_by(TILE) {
        let tile = TILE.min(height - top);
        for (column, line) in to.chunks_exact_mut(height).enumerate() {
            let source = from[top * width + first + column..].iter().step_by(width);
            for (to, from) in line[top..top + tile].iter_mut().zip(source) {
                *to = *from;
            }
        }
    }
}

/// Transposes `from` (lines of `width` numbers) into `to` and transforms the parts of `length`
/// numbers that the plan takes, of every line of `to`.
pub(crate) fn transpose_and_transform<T: Real>(
    run: &dyn Run,
    from: &[Complex<T>],
    width: usize,
    to: &mut [Complex<T>],
    plan: &Plan<T>,
) -> Result<(), Cancelled> {
    let height = from.len() / width.max(1);
    // Long lines are few to a task, so that the work can be shared.
    let lines = LINES.min((1 << 20) / height.max(1)).max(1);
    chunks_mut(run, to, lines * height, &|i, to| {
        if run.cancelled() {
            return;
        }
        gather(from, width, i * lines, to);
        let mut room = scratch(plan.get_inplace_scratch_len());
        plan.process_with_scratch(to, &mut room);
    });
    go_on(run)
}

/// Transforms every line in place.
pub(crate) fn transform<T: Real>(
    run: &dyn Run,
    lines: &mut [Complex<T>],
    plan: &Plan<T>,
) -> Result<(), Cancelled> {
    chunks_mut(run, lines, LINES * plan.len(), &|_, lines| {
        if run.cancelled() {
            return;
        }
        let mut room = scratch(plan.get_inplace_scratch_len());
        plan.process_with_scratch(lines, &mut room);
    });
    go_on(run)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transpose_of_any_shape() {
        for (width, height) in [(1, 1), (5, 3), (3, 20), (40, 17)] {
            let from: Vec<usize> = (0..width * height).collect();
            for first in 0..width {
                let columns = (width - first).min(4);
                let mut to = vec![usize::MAX; columns * height];
                gather(&from, width, first, &mut to);
                for (i, value) in to.iter().enumerate() {
                    assert_eq!(*value, (i % height) * width + first + i / height);
                }
            }
        }
    }
}
