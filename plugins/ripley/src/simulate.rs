//! Patterns without structure, to compare with.

use crate::ripley::Sets;
use crate::window::{Random, Window};
use puncta_sdk::{Choice, Failure};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// What "no structure" means.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Null {
    /// As many points, with uniform density in the region (both sets, if there are two).
    Uniform,
    /// The same places; which belong to which set is random.
    Labels,
    /// The second set is moved as a whole, around the ends of a rectangle or box.
    Shift,
}

/// The generator of a simulation.
pub(crate) fn stream(seed: u64, number: u64) -> ChaCha8Rng {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    let mut random = ChaCha8Rng::from_seed(key);
    random.set_stream(number);
    random
}

/// Points of one or two sets.
pub(crate) struct Drawn<const D: usize> {
    one: [Vec<f64>; D],
    two: Option<[Vec<f64>; D]>,
}

impl<const D: usize> Drawn<D> {
    pub(crate) fn sets(&self) -> Sets<'_, D> {
        Sets {
            one: self.one.each_ref().map(Vec::as_slice),
            two: self
                .two
                .as_ref()
                .map(|two| two.each_ref().map(Vec::as_slice)),
        }
    }
}

/// Points with uniform density.
#[cfg(test)]
pub(crate) fn uniform<const D: usize>(
    window: &dyn Window<D>,
    count: usize,
    random: &mut dyn Random,
) -> [Vec<f64>; D] {
    uniform_while(window, count, random, &|| true)
}

/// Points with uniform density; fewer if it is stopped.
fn uniform_while<const D: usize>(
    window: &dyn Window<D>,
    count: usize,
    random: &mut dyn Random,
    going: &dyn Fn() -> bool,
) -> [Vec<f64>; D] {
    let mut axes: [Vec<f64>; D] = std::array::from_fn(|_| Vec::with_capacity(count));
    for i in 0..count {
        if i % 1024 == 0 && !going() {
            break;
        }
        let point = window.draw(random);
        axes.iter_mut()
            .zip(point)
            .for_each(|(axis, x)| axis.push(x));
    }
    axes
}

/// Checks that a null pattern can be drawn for these sets in this region.
///
/// # Errors
/// When it needs a second set, or a rectangle or box, that is not there.
pub fn check<const D: usize>(
    null: Null,
    two_sets: bool,
    window: &dyn Window<D>,
) -> Result<(), Failure> {
    if null != Null::Uniform && !two_sets {
        let message = "random labels and shifts need a second table";
        return Err(Failure::bad_parameter("null", message).remedy("use uniform"));
    }
    if null == Null::Uniform && window.tries() > 1000.0 {
        let message = "the outline fills less than a thousandth of its bounding box";
        return Err(Failure::bad_input(message).remedy("give it as a mask, to draw points in it"));
    }
    if null == Null::Shift && window.sides().is_none() {
        let message = "shifts around the ends need a rectangle or a box";
        return Err(Failure::bad_parameter("null", message).remedy("use labels or uniform"));
    }
    Ok(())
}

/// The pattern of a number.
pub(crate) fn draw<const D: usize>(
    null: Null,
    sets: &Sets<D>,
    window: &dyn Window<D>,
    seed: u64,
    number: u64,
    going: &dyn Fn() -> bool,
) -> Drawn<D> {
    let mut random = stream(seed, number);
    let owned = |axes: [&[f64]; D]| axes.map(<[f64]>::to_vec);
    match (null, sets.two) {
        (Null::Labels, Some(two)) => {
            let mut all: [Vec<f64>; D] = owned(sets.one);
            all.iter_mut()
                .zip(two)
                .for_each(|(axis, more)| axis.extend_from_slice(more));
            let first = sets.one[0].len();
            for i in 0..first {
                let other = i + random.below(all[0].len() - i);
                all.iter_mut().for_each(|axis| axis.swap(i, other));
            }
            let two = all.each_mut().map(|axis| axis.split_off(first));
            Drawn {
                one: all,
                two: Some(two),
            }
        }
        (Null::Shift, Some(two)) => {
            let [low, _] = window.bounds();
            let sides = window.sides().unwrap_or([1.0; D]);
            let mut two = owned(two);
            for (a, axis) in two.iter_mut().enumerate() {
                let shift = random.unit() * sides[a];
                for x in axis {
                    *x = low[a] + (*x - low[a] + shift) % sides[a];
                }
            }
            Drawn {
                one: owned(sets.one),
                two: Some(two),
            }
        }
        (_, two) => Drawn {
            one: uniform_while(window, sets.one[0].len(), &mut random, going),
            two: two.map(|two| uniform_while(window, two[0].len(), &mut random, going)),
        },
    }
}
