//! What is simulated, and the checks of it.

use crate::arrangement::Turn;
use crate::shape::Shape;
use puncta_sdk::Failure;

/// Parameters of a simulation. Lengths in nm.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// The membrane.
    pub shape: Shape,
    /// Probability p that a candidate is kept as a site, above 0 to 1.
    pub acceptance: f64,
    /// Sampling rate dx: side of the smallest octree boxes, 0.5 to 10 nm.
    pub dx: f64,
    /// Share n of localisations that are background, 0 to below 1.
    pub background: f64,
    /// Resolution of the simulated microscope along x, y, z: full widths at half maximum, nm.
    pub fwhm: [f64; 3],
    /// Mean rho of the exponential distribution of photon numbers, before it is clipped.
    pub photons: f64,
    /// Background photon number b: only localisations above it are seen, at least 1.
    pub background_photons: f64,
    /// Samples of each site among which the localisations are drawn, 1 to 1000.
    pub blinks: u32,
    /// Number of frames, at least twice `blinks`, at most 10 000 000.
    pub frames: u32,
    /// Mean length of a burst, frames, at least 1.
    pub mean_on: f64,
    /// Copies of the shape, 1 to 1 000 000.
    pub copies: u32,
    /// How copies are turned.
    pub turn: Turn,
    /// Mean gap between copies, nm.
    pub gap: f64,
    /// Seed.
    pub seed: u64,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            shape: Shape::Tori,
            acceptance: 0.005,
            dx: 1.66,
            background: 0.1,
            fwhm: [280.0; 3],
            photons: 100.0,
            background_photons: 20.0,
            blinks: 10,
            frames: 10_000,
            mean_on: 2.5,
            copies: 1,
            turn: Turn::None,
            gap: 100.0,
            seed: 0,
        }
    }
}

/// Largest number of candidates of one shape.
const MAX_CANDIDATES: f64 = 2e7;
/// Largest expected number of localisations.
const MAX_ROWS: f64 = 1e9;
/// Largest number of candidates of all copies.
const MAX_WORK: f64 = 1e11;

impl Parameters {
    /// Expected number of candidates of one copy, 2 A / dx^2.
    pub fn expected_candidates(&self) -> f64 {
        2.0 * self.shape.area() / (self.dx * self.dx)
    }

    /// Expected number of localisations, background included.
    pub fn expected_rows(&self) -> f64 {
        let sites = self.expected_candidates() * self.acceptance * f64::from(self.copies);
        sites / (1.0 - self.background)
    }

    /// A number of localisations that a simulation does not exceed, six standard deviations and
    /// three percent (for the lattice of the candidates) above the expected one.
    pub fn row_bound(&self) -> u64 {
        let rows = self.expected_rows();
        let share = 1.0 - self.background;
        (rows * 1.03 + 6.0 * (rows * share).sqrt() / share + 100.0).ceil() as u64
    }

    /// Checks every parameter.
    ///
    /// # Errors
    /// A sentence about the first parameter outside its range, with the range.
    pub fn check(&self) -> Result<(), Failure> {
        let Self {
            acceptance,
            background,
            blinks,
            frames,
            ..
        } = *self;
        if !(acceptance > 0.0 && acceptance <= 1.0) {
            return Err(outside("acceptance", acceptance, "above 0 and up to 1"));
        }
        if !(0.0..1.0).contains(&background) {
            return Err(outside("background", background, "from 0 to below 1"));
        }
        within("dx", self.dx, 0.5, 10.0)?;
        for (name, fwhm) in ["fwhm_x", "fwhm_y", "fwhm_z"].into_iter().zip(self.fwhm) {
            within(name, fwhm, 0.1, 1e5)?;
        }
        within("photons", self.photons, 1e-3, 1e9)?;
        within("background_photons", self.background_photons, 1.0, 1e9)?;
        within("blinks", f64::from(blinks), 1.0, 1000.0)?;
        within("mean_on", self.mean_on, 1.0, 1e9)?;
        within("copies", f64::from(self.copies), 1.0, 1e6)?;
        within("gap", self.gap, 0.0, 1e6)?;
        within("frames", f64::from(frames), 2.0, 1e7)?;
        if frames < 2 * blinks {
            let message = format!("{frames} frames are too few for {blinks} samples of a site");
            let remedy = format!("give at least {}", 2 * blinks);
            return Err(Failure::bad_parameter("frames", message).remedy(remedy));
        }
        match self.shape {
            Shape::Sphere { radius } => within("radius", radius, 4.0 * self.dx, 1e6)?,
            Shape::Torus { ring, tube } => {
                within("tube", tube, 4.0 * self.dx, 1e6)?;
                within("ring", ring, tube, 1e6)?;
            }
            _ => {}
        }
        self.check_size()
    }

    fn check_size(&self) -> Result<(), Failure> {
        let candidates = self.expected_candidates();
        let all = candidates * f64::from(self.copies);
        let rows = self.expected_rows();
        if candidates > MAX_CANDIDATES {
            let name = self.shape.name();
            let message = format!(
                "{name} has {candidates:.1e} candidate sites at dx {} nm, more than \
                 {MAX_CANDIDATES:e}",
                self.dx
            );
            return Err(Failure::bad_parameter("dx", message).remedy("raise dx"));
        }
        if rows > MAX_ROWS {
            let message = format!("about {rows:.1e} localisations are more than {MAX_ROWS:e}");
            let remedy = "lower acceptance or copies";
            return Err(Failure::bad_parameter("acceptance", message).remedy(remedy));
        }
        if all > MAX_WORK {
            let message = format!("{all:.1e} candidates of all copies are more than {MAX_WORK:e}");
            return Err(
                Failure::bad_parameter("copies", message).remedy("raise dx or lower copies")
            );
        }
        Ok(())
    }
}

fn within(name: &str, value: f64, low: f64, high: f64) -> Result<(), Failure> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(outside(name, value, &format!("from {low} to {high}")))
}

fn outside(name: &str, value: f64, range: &str) -> Failure {
    Failure::bad_parameter(name, format!("{name} is {value}")).remedy(format!("give one {range}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bad_parameter_is_refused_in_one_sentence() {
        type Change = fn(&mut Parameters);
        let changes: [(Change, &str); 20] = [
            (|q| q.acceptance = 0.0, "acceptance is"),
            (|q| q.acceptance = 1.1, "acceptance is"),
            (|q| q.acceptance = f64::NAN, "acceptance is"),
            (|q| q.background = 1.0, "background is"),
            (|q| q.background = -0.1, "background is"),
            (|q| q.background = f64::NAN, "background is"),
            (|q| q.dx = 0.1, "dx is"),
            (|q| q.fwhm[2] = 0.0, "fwhm_z is"),
            (|q| q.fwhm[0] = f64::INFINITY, "fwhm_x is"),
            (|q| q.photons = -5.0, "photons is"),
            (|q| q.background_photons = 0.0, "background_photons is"),
            (|q| q.blinks = 0, "blinks is"),
            (|q| q.frames = 19, "19 frames"),
            (|q| q.mean_on = 0.5, "mean_on is"),
            (|q| q.copies = 0, "copies is"),
            (|q| q.gap = f64::NAN, "gap is"),
            (|q| q.shape = Shape::Sphere { radius: 1.0 }, "radius is"),
            (|q| q.shape = Shape::Sphere { radius: 9e4 }, "raise dx"),
            (
                |q| (q.copies, q.acceptance) = (1_000_000, 0.5),
                "localisations",
            ),
            (
                |q| (q.copies, q.acceptance, q.shape) = (1_000_000, 1e-4, Shape::Er),
                "of all copies",
            ),
        ];
        for (change, word) in changes {
            let mut parameters = Parameters::default();
            assert_eq!(parameters.check(), Ok(()));
            change(&mut parameters);
            let failure = parameters.check().expect_err(word);
            assert!(failure.parameter.is_some());
            let sentence = failure.to_string();
            assert!(
                sentence.contains(word) && !sentence.contains('\n'),
                "{sentence}"
            );
        }
    }

    #[test]
    fn limits_themselves_are_accepted() {
        let parameters = Parameters {
            acceptance: 1.0,
            background: 0.0,
            blinks: 1,
            frames: 2,
            mean_on: 1.0,
            gap: 0.0,
            ..Parameters::default()
        };
        assert_eq!(parameters.check(), Ok(()));
    }
}
