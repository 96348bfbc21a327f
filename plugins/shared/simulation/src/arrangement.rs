//! Copies of a shape over a field: a square grid in x and y, each copy turned and shifted.

use std::f64::consts::TAU;

use rand_chacha::rand_core::Rng;

use crate::random::{Purpose, stream, unit};
use crate::rotation::Rotation;
use puncta_shared_vector::{Point, add, norm, sub};

/// How copies are turned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// Not at all.
    None,
    /// By a random angle about the z axis.
    AboutZ,
    /// By a random rotation, all directions alike.
    Any,
}

/// Where one copy lies.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    /// The turn, about the centre of the shape's bounds.
    pub rotation: Rotation,
    /// The centre of the shape's bounds before.
    pub centre: Point,
    /// The same point after.
    pub to: Point,
}

impl Placement {
    /// The placed point.
    pub fn point(&self, p: Point) -> Point {
        add(self.rotation.apply(sub(p, self.centre)), self.to)
    }
}

/// The placements of `copies` copies of a shape with these bounds. A single copy is turned but stays
/// where it is; more stand on a square grid about it, so far apart that no turn makes two of them
/// meet: their circles (spheres for [`Turn::Any`]) keep `gap` nm on average and never overlap, for
/// each is shifted by up to half the gap in x and y.
pub fn arrange(
    bounds: [Point; 2],
    copies: usize,
    turn: Turn,
    gap: f64,
    seed: u64,
) -> Vec<Placement> {
    let [low, high] = bounds;
    let centre = [0, 1, 2].map(|i| (low[i] + high[i]) / 2.0);
    let mut half = sub(high, centre);
    if turn != Turn::Any {
        half[2] = 0.0;
    }
    let pitch = 2.0 * norm(half) + gap;
    let columns = (copies as f64).sqrt().ceil() as usize;
    let rows = copies.div_ceil(columns.max(1));
    let mut random = stream(seed, Purpose::Arrangement, false, 0);
    (0..copies)
        .map(|copy| {
            let rotation = rotation(turn, &mut random);
            let shift = [unit(&mut random), unit(&mut random)];
            let mut to = centre;
            if copies > 1 {
                let middle = |n: usize| (n as f64 - 1.0) / 2.0;
                to[0] += ((copy % columns) as f64 - middle(columns)) * pitch;
                to[1] += ((copy / columns) as f64 - middle(rows)) * pitch;
                to[0] += (shift[0] - 0.5) * gap;
                to[1] += (shift[1] - 0.5) * gap;
            }
            Placement {
                rotation,
                centre,
                to,
            }
        })
        .collect()
}

fn rotation(turn: Turn, random: &mut impl Rng) -> Rotation {
    // Always three numbers, so that the turn changes no shift.
    let u = [unit(random), unit(random), unit(random)];
    match turn {
        Turn::None => Rotation::NONE,
        Turn::AboutZ => Rotation::about_z(TAU * u[0]),
        Turn::Any => Rotation::uniform(u),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Shape;

    #[test]
    fn a_single_copy_without_turn_stays() {
        let placed = arrange(Shape::Er.bounds(), 1, Turn::None, 100.0, 1);
        assert_eq!(placed.len(), 1);
        let p = [12.0, -7.0, 3.0];
        assert!(norm(sub(placed[0].point(p), p)) < 1e-12);
    }

    #[test]
    fn copies_never_meet() {
        for turn in [Turn::None, Turn::AboutZ, Turn::Any] {
            let [low, high] = Shape::Er.bounds();
            let placed = arrange([low, high], 23, turn, 50.0, 7);
            assert_eq!(placed.len(), 23);
            let mut half = sub(high, placed[0].centre);
            if turn != Turn::Any {
                half[2] = 0.0;
            }
            for (i, a) in placed.iter().enumerate() {
                for b in &placed[..i] {
                    assert!(norm(sub(a.to, b.to)) >= 2.0 * norm(half));
                }
                if turn != Turn::Any {
                    assert_eq!(a.rotation.0[2], [0.0, 0.0, 1.0]);
                }
            }
            let mean: f64 = placed.iter().map(|p| p.to[0]).sum::<f64>() / 23.0;
            assert!(mean.abs() < 300.0);
        }
    }
}
