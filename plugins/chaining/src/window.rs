//! The localisations of the last few frames, by place.
//!
//! Cells of a plane are hashed to buckets. A bucket is a list with its latest localisation first, so
//! that a search ends at the first that is too old, and nothing is ever removed for its age.
//! Localisations with a wide radius are kept in levels of their own with wider cells, so that one
//! of them does not widen the search of all.

use crate::spots::Spots;

/// No localisation.
const NONE: u32 = u32::MAX;
/// Factor between the squares of the largest radii of two levels.
const STEP: f64 = 16.0;
/// Localisations looked at to choose the cells.
const SAMPLE: usize = 2048;

#[derive(Debug)]
struct Level {
    number: u32,
    /// Largest share of the square of the radius.
    share: f64,
    /// Cells in a nm.
    density: f64,
    /// Latest localisation of each bucket.
    heads: Vec<u32>,
    /// Frame of the latest localisation.
    newest: i64,
}

/// The localisations that chains may go on from.
#[derive(Debug)]
pub struct Window<'a> {
    spots: &'a Spots<'a>,
    next: Vec<u32>,
    levels: Vec<Level>,
    buckets: usize,
    /// Largest share of the first level.
    share: f64,
    cell: f64,
}

impl<'a> Window<'a> {
    /// An empty window. `most` is the largest number of localisations in it at a time.
    #[must_use]
    pub fn new(spots: &'a Spots<'a>, most: usize) -> Window<'a> {
        let sample = |values: &[f64]| -> Vec<f64> {
            let step = values.len().div_ceil(SAMPLE).max(1);
            let mut some: Vec<f64> = values.iter().step_by(step).copied().collect();
            some.sort_by(f64::total_cmp);
            some
        };
        // From the middle of the values: neither a far localisation nor a wide one counts.
        let quantile = |some: &[f64], q: f64| -> f64 {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let place = (some.len().saturating_sub(1) as f64 * q) as usize;
            some.get(place).copied().unwrap_or(0.0)
        };
        let shares = sample(&spots.share);
        let share = quantile(&shares, 1.0).min(STEP * quantile(&shares, 0.5));
        let share = share.max(f64::MIN_POSITIVE);
        let side = |values: &[f64]| {
            let some = sample(values);
            quantile(&some, 0.95) - quantile(&some, 0.05)
        };
        let area = side(&spots.x) * side(&spots.y);
        let cell = (area / (most.max(1) as f64))
            .sqrt()
            .max(2.0 * (2.0 * share).sqrt());
        Window {
            spots,
            next: vec![NONE; spots.frames.len()],
            levels: Vec::new(),
            buckets: (2 * most).clamp(16, 1 << 22).next_power_of_two(),
            share,
            cell: if cell > 0.0 && cell.is_finite() {
                cell
            } else {
                1.0
            },
        }
    }

    /// Adds a localisation; frames must not fall.
    pub fn insert(&mut self, place: usize) {
        let share = self.spots.share[place];
        let number = self.level(share);
        let at = match self.levels.iter().position(|level| level.number == number) {
            Some(at) => at,
            None => {
                let share = self.share * STEP.powi(number.cast_signed());
                self.levels.push(Level {
                    number,
                    share,
                    density: 1.0 / self.cell.max(2.0 * (2.0 * share).sqrt()),
                    heads: vec![NONE; self.buckets],
                    newest: i64::MIN,
                });
                self.levels.len() - 1
            }
        };
        let level = &mut self.levels[at];
        let column = floor(self.spots.x[place] * level.density);
        let line = floor(self.spots.y[place] * level.density);
        let bucket = hash(column, line) & (level.heads.len() - 1);
        self.next[place] = level.heads[bucket];
        #[allow(clippy::cast_possible_truncation)]
        let latest = place as u32;
        level.heads[bucket] = latest;
        level.newest = self.spots.frames[place];
    }

    fn level(&self, share: f64) -> u32 {
        if share <= self.share {
            return 0;
        }
        let mut number = 0;
        let mut most = self.share;
        while most < share {
            most *= STEP;
            number += 1;
        }
        number
    }

    /// Calls `visit` with the localisations, not older than the frame `oldest`, that may lie within
    /// the radius of the one at `place`; some twice. Those for which it says false are dropped.
    pub fn near(&mut self, place: usize, oldest: i64, visit: &mut impl FnMut(usize) -> bool) {
        let (x, y, share) = (
            self.spots.x[place],
            self.spots.y[place],
            self.spots.share[place],
        );
        for level in &mut self.levels {
            if level.newest < oldest {
                continue;
            }
            let reach = (share + level.share).sqrt() * (1.0 + 1e-9);
            let ends = |at: f64| {
                let reach = reach + at.abs() * 4.0 * f64::EPSILON;
                let low = floor((at - reach) * level.density);
                let high = floor((at + reach) * level.density);
                (low, high.abs_diff(low).saturating_add(1))
            };
            let ((left, width), (bottom, height)) = (ends(x), ends(y));
            let mut list = List {
                frames: &self.spots.frames,
                next: &mut self.next,
                oldest,
            };
            let mask = level.heads.len() - 1;
            if width.saturating_mul(height) < level.heads.len() as u64 {
                for line in 0..height.cast_signed() {
                    for column in 0..width.cast_signed() {
                        let cell = hash(left.wrapping_add(column), bottom.wrapping_add(line));
                        list.walk(&mut level.heads[cell & mask], visit);
                    }
                }
            } else {
                level
                    .heads
                    .iter_mut()
                    .for_each(|head| list.walk(head, visit));
            }
        }
    }
}

struct List<'l> {
    frames: &'l [i64],
    next: &'l mut [u32],
    oldest: i64,
}

impl List<'_> {
    #[inline]
    fn walk(&mut self, head: &mut u32, visit: &mut impl FnMut(usize) -> bool) {
        let mut before = NONE;
        let mut at = *head;
        while at != NONE {
            let place = at as usize;
            let old = self.frames[place] < self.oldest;
            let after = if old { NONE } else { self.next[place] };
            if !old && visit(place) {
                before = at;
            } else if before == NONE {
                *head = after;
            } else {
                self.next[before as usize] = after;
            }
            at = after;
        }
    }
}

/// The whole number below; saturates.
#[inline]
fn floor(value: f64) -> i64 {
    #[allow(clippy::cast_possible_truncation)]
    let whole = value as i64;
    whole.saturating_sub(i64::from(value < whole as f64))
}

/// Spreads cells over the buckets.
#[inline]
fn hash(column: i64, line: i64) -> usize {
    let mixed = column
        .cast_unsigned()
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add(line.cast_unsigned().wrapping_mul(0xc2b2_ae3d_27d4_eb4f));
    #[allow(clippy::cast_possible_truncation)]
    let index = (mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 32;
    index as usize
}
