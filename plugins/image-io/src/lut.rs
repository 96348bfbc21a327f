//! Colour maps.
//!
//! Viridis, magma, inferno, plasma and cividis are perceptually uniform; turbo shows more steps but
//! is not. Fire is ImageJ's map of that name (public domain), the others are straight ramps.

use puncta_sdk::prelude::*;

/// A colour map.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lut {
    /// Perceptually uniform, dark blue over green to yellow.
    Viridis,
    /// Perceptually uniform, black over purple to pale yellow.
    Magma,
    /// Perceptually uniform, black over red to pale yellow.
    Inferno,
    /// Perceptually uniform, blue over red to yellow.
    Plasma,
    /// Perceptually uniform for colour-blind people too, blue to yellow.
    Cividis,
    /// Rainbow with even steps.
    Turbo,
    /// Black to white.
    Grey,
    /// White to black.
    InvertedGrey,
    /// Black over red and yellow to white.
    Hot,
    /// As ImageJ's Fire: black over blue, red and yellow to white.
    Fire,
    /// Black to red.
    Red,
    /// Black to green.
    Green,
    /// Black to blue.
    Blue,
    /// Black to cyan.
    Cyan,
    /// Black to magenta.
    Magenta,
    /// Black to yellow.
    Yellow,
}

const FIRE: [[u8; 3]; 32] = [
    [0, 0, 0],
    [0, 0, 61],
    [1, 0, 96],
    [25, 0, 130],
    [49, 0, 165],
    [73, 0, 192],
    [98, 0, 220],
    [122, 0, 227],
    [146, 0, 210],
    [162, 0, 181],
    [173, 0, 151],
    [184, 0, 122],
    [195, 0, 93],
    [207, 14, 64],
    [217, 35, 35],
    [229, 57, 5],
    [240, 79, 0],
    [252, 101, 0],
    [255, 117, 0],
    [255, 133, 0],
    [255, 147, 0],
    [255, 161, 0],
    [255, 175, 0],
    [255, 190, 0],
    [255, 205, 0],
    [255, 219, 0],
    [255, 234, 0],
    [255, 248, 35],
    [255, 255, 98],
    [255, 255, 160],
    [255, 255, 223],
    [255, 255, 255],
];

impl Lut {
    /// The 256 colours (red, green, blue).
    #[must_use]
    pub fn colours(self) -> [[u8; 3]; 256] {
        std::array::from_fn(|i| self.colour(i))
    }

    fn colour(self, i: usize) -> [u8; 3] {
        let v = i as u8;
        let gradient = |g: colorous::Gradient| g.eval_rational(i, 256).into_array();
        match self {
            Lut::Viridis => gradient(colorous::VIRIDIS),
            Lut::Magma => gradient(colorous::MAGMA),
            Lut::Inferno => gradient(colorous::INFERNO),
            Lut::Plasma => gradient(colorous::PLASMA),
            Lut::Cividis => gradient(colorous::CIVIDIS),
            Lut::Turbo => gradient(colorous::TURBO),
            Lut::Grey => [v, v, v],
            Lut::InvertedGrey => [255 - v; 3],
            Lut::Hot => hot(i),
            Lut::Fire => fire(i),
            Lut::Red => [v, 0, 0],
            Lut::Green => [0, v, 0],
            Lut::Blue => [0, 0, v],
            Lut::Cyan => [0, v, v],
            Lut::Magenta => [v, 0, v],
            Lut::Yellow => [v, v, 0],
        }
    }
}

/// Red, green and blue rise one after the other, over 3/8, 3/8 and 1/4 of the range.
fn hot(i: usize) -> [u8; 3] {
    let t = i as f64 / 255.0;
    [(0.0, 0.375), (0.375, 0.75), (0.75, 1.0)]
        .map(|(low, high)| (((t - low) / (high - low)).clamp(0.0, 1.0) * 255.0).round() as u8)
}

fn fire(i: usize) -> [u8; 3] {
    let place = i as f64 / 255.0 * 31.0;
    let low = place.floor() as usize;
    let (a, b) = (FIRE[low], FIRE[(low + 1).min(31)]);
    std::array::from_fn(|k| {
        let (a, b) = (f64::from(a[k]), f64::from(b[k]));
        (a + (b - a) * (place - low as f64)).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of matplotlib's maps of the same names.
    #[test]
    fn colours_are_the_published_ones() {
        let near = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 2);
        let check = |lut: Lut, places: [(usize, [u8; 3]); 3]| {
            let colours = lut.colours();
            for (i, colour) in places {
                assert!(near(colours[i], colour), "{lut:?} {i}: {:?}", colours[i]);
            }
        };
        check(
            Lut::Viridis,
            [
                (0, [68, 1, 84]),
                (128, [33, 145, 140]),
                (255, [253, 231, 36]),
            ],
        );
        check(
            Lut::Magma,
            [
                (0, [0, 0, 3]),
                (128, [183, 55, 121]),
                (255, [251, 252, 191]),
            ],
        );
        check(
            Lut::Inferno,
            [(0, [0, 0, 3]), (128, [188, 55, 84]), (255, [252, 254, 164])],
        );
        check(
            Lut::Plasma,
            [
                (0, [12, 7, 134]),
                (128, [204, 71, 120]),
                (255, [239, 248, 33]),
            ],
        );
        check(
            Lut::Hot,
            [(0, [0, 0, 0]), (96, [255, 1, 0]), (255, [255, 255, 255])],
        );
        check(
            Lut::Grey,
            [(0, [0, 0, 0]), (77, [77, 77, 77]), (255, [255, 255, 255])],
        );
    }

    #[test]
    fn brightness_rises() {
        let weights = [0.2126, 0.7152, 0.0722];
        let light = |c: [u8; 3]| {
            c.iter()
                .zip(weights)
                .map(|(c, w)| w * f64::from(*c))
                .sum::<f64>()
        };
        for lut in [
            Lut::Viridis,
            Lut::Magma,
            Lut::Inferno,
            Lut::Cividis,
            Lut::Hot,
            Lut::Grey,
        ] {
            let colours = lut.colours();
            assert!(
                colours.windows(2).all(|w| light(w[1]) >= light(w[0]) - 1.0),
                "{lut:?}"
            );
        }
    }
}
