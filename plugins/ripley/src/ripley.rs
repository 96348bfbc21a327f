//! Ripley's K and what follows from it.
//!
//! K(r) = V / (n (n - 1)) sum over ordered pairs of w 1(d <= r), between two sets V / (n1 n2)
//! (Ripley, J. R. Stat. Soc. B 39, 172, 1977); L = (K / pi)^(1/2) or (3 K / 4 pi)^(1/3); H = L - r;
//! g = dK / dr over the same of complete spatial randomness, as the mean over each bin.

use crate::bins::Bins;
use crate::edges::{isotropic, translation};
use crate::pairs::{count_pairs, grid};
use crate::window::Window;
use puncta_sdk::run::Run;
use puncta_sdk::{Choice, Failure};
use puncta_shared_neighbours::Grid;
use std::f64::consts::PI;

/// What is done about what lies beyond the boundary.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edges {
    /// Nothing: K is too small near the boundary.
    None,
    /// Ripley's isotropic correction, exact for rectangles, polygons, masks and boxes.
    Isotropic,
    /// The translation correction, for every region.
    Translation,
}

impl Edges {
    /// For captions.
    #[must_use]
    pub fn describe(self) -> &'static str {
        match self {
            Self::None => "no edge correction",
            Self::Isotropic => "isotropic edge correction",
            Self::Translation => "translation edge correction",
        }
    }
}

/// Points of one or two sets, all inside the region.
#[derive(Clone, Copy, Debug)]
pub struct Sets<'a, const D: usize> {
    /// The first set, one slice an axis, nm.
    pub one: [&'a [f64]; D],
    /// The second set; pairs are counted from the first to the second.
    pub two: Option<[&'a [f64]; D]>,
}

impl<const D: usize> Sets<'_, D> {
    /// Number of ordered pairs.
    #[must_use]
    pub fn pairs(&self) -> f64 {
        let one = self.one[0].len() as f64;
        match self.two {
            Some(two) => one * two[0].len() as f64,
            None => one * (one - 1.0).max(0.0),
        }
    }
}

/// What each bin adds to K, nm^2 or nm^3. NaN without pairs.
///
/// # Errors
/// When cancelled, when the isotropic correction is asked of a mask in space, or when the radius spans
/// too many pixels for the translation correction.
pub fn rings<const D: usize>(
    sets: &Sets<D>,
    window: &dyn Window<D>,
    edges: Edges,
    bins: &Bins,
    run: &dyn Run,
) -> Result<Vec<f64>, Failure> {
    let source = grid(sets.one, bins.radius(), run)?;
    let target = sets
        .two
        .map(|two| Grid::new(two, source.edge(), run))
        .transpose()?;
    let target = target.as_ref();
    let both = if target.is_some() { 1.0 } else { 2.0 };
    let factor = window.volume() / sets.pairs();
    let counts = || -> Result<Vec<f64>, Failure> {
        let counts = count_pairs(&source, target, bins, run)?;
        Ok(counts.iter().map(|count| both * *count as f64).collect())
    };
    let sums: Vec<f64> = match edges {
        Edges::None => counts()?,
        Edges::Isotropic if !window.isotropic() => {
            let message = "the share of spheres in a mask in space is not known";
            let failure = Failure::bad_parameter("edges", message);
            return Err(failure.remedy("use the translation correction"));
        }
        Edges::Isotropic => {
            let extra = isotropic(&source, target, window, bins, run)?;
            counts()?
                .iter()
                .zip(extra)
                .map(|(count, extra)| count + extra)
                .collect()
        }
        Edges::Translation => {
            let overlap = window.overlap(bins.radius(), run)?;
            let sums = translation(&source, target, &overlap, bins, run)?;
            sums.iter().map(|sum| both * sum).collect()
        }
    };
    Ok(sums.into_iter().map(|sum| factor * sum).collect())
}

/// K, L, H and the rest at the upper end of each bin.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves {
    /// Radii, nm.
    pub r: Vec<f64>,
    /// K, nm^2 or nm^3.
    pub k: Vec<f64>,
    /// L, nm.
    pub l: Vec<f64>,
    /// L - r, nm.
    pub h: Vec<f64>,
    /// dL / dr: central differences, one-sided at the last radius.
    pub dl: Vec<f64>,
    /// dH / dr.
    pub dh: Vec<f64>,
    /// Pair correlation, mean over the bin that ends here.
    pub g: Vec<f64>,
}

/// Volume of a ball of radius 1.
#[must_use]
pub fn ball(dimensions: usize) -> f64 {
    if dimensions == 2 { PI } else { 4.0 * PI / 3.0 }
}

/// L of K.
#[must_use]
pub fn l_of_k(k: f64, dimensions: usize) -> f64 {
    let power = k / ball(dimensions);
    if dimensions == 2 {
        power.sqrt()
    } else {
        power.cbrt()
    }
}

impl Curves {
    /// From what each bin adds to K.
    #[must_use]
    pub fn new(rings: &[f64], bins: &Bins, dimensions: usize) -> Self {
        let r = bins.upper();
        let sum = |k: &mut f64, ring: &f64| {
            *k += ring;
            Some(*k)
        };
        let k: Vec<f64> = rings.iter().scan(0.0, sum).collect();
        let l: Vec<f64> = k.iter().map(|k| l_of_k(*k, dimensions)).collect();
        let h: Vec<f64> = l.iter().zip(&r).map(|(l, r)| l - r).collect();
        let slope = |i: usize| {
            let before = if i == 0 { 0.0 } else { l[i - 1] };
            match l.get(i + 1) {
                Some(after) => (after - before) / (2.0 * bins.step()),
                None => (l[i] - before) / bins.step(),
            }
        };
        let dl: Vec<f64> = (0..l.len()).map(slope).collect();
        let power = i32::try_from(dimensions).unwrap_or(2);
        let shell = |r: f64| ball(dimensions) * (r.powi(power) - (r - bins.step()).powi(power));
        let g = rings
            .iter()
            .zip(&r)
            .map(|(ring, r)| ring / shell(*r))
            .collect();
        let dh = dl.iter().map(|slope| slope - 1.0).collect();
        Self {
            r,
            k,
            l,
            h,
            dl,
            dh,
            g,
        }
    }
}

#[cfg(test)]
mod tests;
