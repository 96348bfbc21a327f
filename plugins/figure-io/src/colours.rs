//! Colours and lines of the series.

use crate::data::{Curve, Style};
use crate::scene::{Paint, Pen};

/// Texts and axes.
pub const INK: Paint = Paint::solid([0x26, 0x26, 0x26]);
/// Captions.
pub const QUIET: Paint = Paint::solid([0x59, 0x59, 0x59]);
/// Grid.
pub const GRID: Paint = Paint::solid([0xe9, 0xe9, 0xe9]);
/// The line at zero.
pub const RULE: Paint = Paint::solid([0xb0, 0xb0, 0xb0]);
/// A band that belongs to no series.
const BAND: [u8; 3] = [0x77, 0x77, 0x77];
/// Colours that people with any colour vision tell apart (Okabe and Ito 2008), without the yellow,
/// which is too faint on white, and black.
const COLOURS: [[u8; 3]; 6] = [
    [0x00, 0x72, 0xb2],
    [0xd5, 0x5e, 0x00],
    [0x00, 0x9e, 0x73],
    [0xcc, 0x79, 0xa7],
    [0x56, 0xb4, 0xe9],
    [0xe6, 0x9f, 0x00],
];
/// Dashes of the lines, another one each time the colours are used up.
const DASHES: [&[f64]; 4] = [&[], &[6.0, 3.0], &[1.5, 2.5], &[8.0, 3.0, 1.5, 3.0]];
/// Width of lines.
const WIDTH: f64 = 1.6;

/// How a series looks.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// Of lines.
    pub pen: Pen,
    /// Of areas.
    pub area: Paint,
}

/// Looks of all series. A band shares the colour of the series that it names; where there are as
/// many bands as other series, they belong to these in order; a single band is grey.
pub fn looks(curves: &[Curve<'_>]) -> Vec<Look> {
    let others: Vec<&Curve<'_>> = curves
        .iter()
        .filter(|one| one.style != Style::Band)
        .collect();
    let bands = curves.len() - others.len();
    let bars = curves.iter().filter(|one| one.style == Style::Bars).count();
    let paired = bands == others.len() && bands > 1;
    let (mut next_band, mut next) = (0, 0);
    let mut out = Vec::with_capacity(curves.len());
    for curve in curves {
        let named = curve
            .of
            .as_ref()
            .and_then(|of| others.iter().position(|one| one.label == *of));
        let look = if curve.style == Style::Band {
            let own = match (named, paired, bands) {
                (Some(place), ..) => Some(place),
                (None, true, _) => Some(next_band),
                (None, false, 1) => None,
                (None, false, _) => Some(next_band + others.len()),
            };
            next_band += 1;
            let rgb = own.map_or(BAND, |own| COLOURS[own % COLOURS.len()]);
            let paint = Paint::solid(rgb);
            Look {
                pen: Pen::solid(paint, 1.0),
                area: paint.alpha(0.24),
            }
        } else {
            let place = named.unwrap_or(next);
            next += 1;
            let paint = Paint::solid(COLOURS[place % COLOURS.len()]);
            let dashes = DASHES[(place / COLOURS.len()) % DASHES.len()].to_vec();
            // Bars of several series are seen through each other.
            let alpha = match curve.style {
                Style::Bars if bars > 1 => 0.5,
                Style::Bars => 0.8,
                _ => 1.0,
            };
            Look {
                pen: Pen {
                    paint,
                    width: WIDTH,
                    dashes,
                },
                area: paint.alpha(alpha),
            }
        };
        out.push(look);
    }
    out
}
