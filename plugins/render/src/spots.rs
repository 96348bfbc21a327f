//! Localisations as the renderer needs them: in pixels, with the range of pixels that they reach.

use crate::field::Field;
use crate::normal::CUT;
use std::ops::Range;

/// One pixel in fixed point.
pub(crate) const ONE: f64 = 4_294_967_296.0;

/// The standard deviations of the localisations along one axis.
#[derive(Debug, Clone, Copy)]
pub enum Sigma<'a> {
    /// The same for all, in nm.
    Fixed(f64),
    /// One a row, in nm.
    Column(&'a [f64]),
}

/// What is rendered. All columns have the same length; the shortest decides.
#[derive(Debug, Clone, Copy)]
pub struct Gaussians<'a> {
    /// Positions in nm.
    pub x: &'a [f64],
    /// Positions in nm.
    pub y: &'a [f64],
    /// Standard deviation in x.
    pub sigma_x: Sigma<'a>,
    /// Standard deviation in y.
    pub sigma_y: Sigma<'a>,
    /// Sum of each localisation; 1 without.
    pub weight: Option<&'a [f64]>,
    /// Smallest standard deviation in nm; smaller ones are raised to it. 0 for none.
    pub sigma_min: f64,
    /// Factor on each standard deviation, before `sigma_min`.
    pub scale: f64,
}

/// A localisation in pixels: fixed-point position with 32 fractional bits, standard deviations,
/// weight.
#[derive(Clone, Copy, Default)]
pub(crate) struct Spot {
    pub(crate) x: i64,
    pub(crate) y: i64,
    pub(crate) sx: f32,
    pub(crate) sy: f32,
    pub(crate) weight: f32,
}

/// What becomes of a row.
pub(crate) enum Fate {
    Spot(Spot),
    Outside,
    Invalid,
}

impl Sigma<'_> {
    #[inline(always)]
    pub(crate) fn at(&self, i: usize) -> f64 {
        match self {
            Self::Fixed(s) => *s,
            Self::Column(c) => c.get(i).copied().unwrap_or(f64::NAN),
        }
    }
    fn rows(&self, rows: usize) -> usize {
        match self {
            Self::Fixed(_) => rows,
            Self::Column(c) => rows.min(c.len()),
        }
    }
}

impl Gaussians<'_> {
    /// Number of rows.
    pub(crate) fn rows(&self) -> usize {
        let rows = self
            .x
            .len()
            .min(self.y.len())
            .min(self.weight.map_or(usize::MAX, <[f64]>::len));
        self.sigma_y.rows(self.sigma_x.rows(rows))
    }

    /// Row `i` in pixels of `field`.
    #[inline]
    pub(crate) fn spot(&self, i: usize, field: &Field) -> Fate {
        let (x, y, weight) = (self.x[i], self.y[i], self.weight.map_or(1.0, |w| w[i]));
        let sigma = |s: Sigma<'_>| {
            let s = s.at(i) * self.scale;
            if s < self.sigma_min {
                self.sigma_min
            } else {
                s
            }
        };
        let raw = (self.sigma_x.at(i), self.sigma_y.at(i));
        let (sx, sy) = (
            sigma(self.sigma_x) / field.x.size(),
            sigma(self.sigma_y) / field.y.size(),
        );
        // Comparisons with NaN are false.
        if !(raw.0 >= 0.0 && raw.1 >= 0.0 && sx < f64::INFINITY && sy < f64::INFINITY)
            || !(x.is_finite() && y.is_finite() && (weight as f32).is_finite())
        {
            return Fate::Invalid;
        }
        let (Some(px), Some(py)) = (field.x.fixed(x), field.y.fixed(y)) else {
            return Fate::Outside;
        };
        // Narrower than a millionth of a pixel is a point.
        let narrow = |s: f64| if s < 1e-6 { 0.0 } else { s as f32 };
        let spot = Spot {
            x: px,
            y: py,
            sx: narrow(sx),
            sy: narrow(sy),
            weight: weight as f32,
        };
        let (cx, cy) = (support(px, spot.sx), support(py, spot.sy));
        let touches = |c: &Range<i64>, count: usize| c.end > 0 && c.start < count as i64;
        if touches(&cx, field.x.count()) && touches(&cy, field.y.count()) {
            Fate::Spot(spot)
        } else {
            Fate::Outside
        }
    }
}

/// The pixels that a spot at `u` (fixed point) with standard deviation `s` (pixels) reaches.
/// Computed from the fraction alone, so that it moves with the spot exactly.
#[inline(always)]
pub(crate) fn support(u: i64, s: f32) -> Range<i64> {
    let index = u >> 32;
    let fraction = (u & 0xffff_ffff) as f64 / ONE;
    let reach = (CUT * f64::from(s)).min(ONE);
    let (low, high) = (fraction - reach, fraction + reach);
    let (l, h) = (low as i64, high as i64);
    let start = index + l - i64::from(low < l as f64);
    let end = index + h + i64::from(high > h as f64);
    start..end.max(index + 1)
}
