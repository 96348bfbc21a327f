//! Localisations of a membrane, with the truth beside them (thesis, appendix C, "Point cloud
//! simulation").
//!
//! 1. S sites: candidates of the octree, each kept with probability p.
//! 2. Each site gives up to `blinks` samples; S of them all are drawn, each with the same
//!    probability, so one site is seen 0 to `blinks` times.
//! 3. J = n S / (1 - n) background localisations, so that their share of T = S + J is n: J sites
//!    uniform in the bounding box of the localisations of the membrane, 1.2 times as large, which
//!    are sampled and drawn in the same way.
//! 4. Each localisation has its own photon number N, an exponential of mean rho clipped above b,
//!    which is b + Exp(rho), and its own normal error of standard deviation
//!    sigma_e = r_e / (2.355 sqrt N) along each axis e.

use std::sync::Mutex;

use rand_distr::{Distribution, Exp1, StandardNormal};

use crate::arrangement::{Placement, arrange};
use crate::blink::Bursts;
use crate::parameters::Parameters;
use crate::random::{Purpose, below, stream, unit};
use crate::sample::{Candidate, candidates, keep};
use puncta_sdk::{Failure, Run};
use puncta_shared_vector::Point;

/// Sites in a chunk of random numbers.
const CHUNK: usize = 1 << 12;
/// Rows between two looks at cancel.
const POLL: usize = 1 << 20;
/// The box of the background is this much larger than the membrane's.
const BACKGROUND_BOX: f64 = 1.2;
/// Full width at half maximum of a normal distribution, in standard deviations, as in the thesis.
pub const FWHM: f64 = 2.355;

/// Where fluorophores are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    /// Position without error, nm.
    pub position: Point,
    /// Outward normal of the membrane; NaN in the background.
    pub normal: [f32; 3],
    /// Number of the copy, from 1; 0 in the background.
    pub copy: u32,
}

const NO_SITE: Site = Site {
    position: [f64::NAN; 3],
    normal: [f32::NAN; 3],
    copy: 0,
};

/// One localisation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Localisation {
    /// Position with error, nm.
    pub position: Point,
    /// Photon number.
    pub photons: f32,
    /// Frame.
    pub frame: u32,
    /// Number of its site.
    pub site: u32,
}

/// A simulated data set.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// All sites, those of the membrane first; a site that was never seen is among them.
    pub sites: Vec<Site>,
    /// Number of sites of the membrane.
    pub membrane_sites: usize,
    /// By frame, then by site.
    pub localisations: Vec<Localisation>,
    /// Resolution of the microscope, nm.
    pub fwhm: [f64; 3],
}

impl Cloud {
    /// Standard deviations of the localisation's error, nm.
    pub fn errors(&self, localisation: &Localisation) -> Point {
        errors(self.fwhm, localisation.photons)
    }

    /// The site of a localisation of this cloud.
    pub fn site(&self, localisation: &Localisation) -> &Site {
        self.sites
            .get(localisation.site as usize)
            .unwrap_or(&NO_SITE)
    }

    /// Whether the localisation belongs to the membrane.
    pub fn is_membrane(&self, localisation: &Localisation) -> bool {
        (localisation.site as usize) < self.membrane_sites
    }
}

fn errors(fwhm: [f64; 3], photons: f32) -> Point {
    let root = f64::from(photons).sqrt();
    fwhm.map(|width| width / (FWHM * root))
}

/// Simulates a data set; the same parameters give the same bits.
///
/// # Errors
/// A sentence when a parameter is out of range or no site was kept; or cancelled.
pub fn simulate(parameters: &Parameters, run: &dyn Run) -> Result<Cloud, Failure> {
    parameters.check()?;
    let mut sites = membrane(parameters, run)?;
    let membrane_sites = sites.len();
    if membrane_sites == 0 {
        let message = format!("no site was kept at acceptance {}", parameters.acceptance);
        return Err(Failure::bad_parameter("acceptance", message).remedy("raise it"));
    }
    run.progress(0.5, "Blinking")?;
    let sampler = Sampler {
        parameters,
        background: false,
        first: 0,
    };
    let mut localisations = sampler.localisations(&sites, run)?;

    run.progress(0.7, "Adding the background")?;
    let share = parameters.background;
    let count = (share * membrane_sites as f64 / (1.0 - share)).round() as usize;
    let around = background_box(&localisations);
    let background = background_sites(count, around, parameters.seed, run)?;
    let first = membrane_sites as u32;
    let sampler = Sampler {
        parameters,
        background: true,
        first,
    };
    localisations.extend(sampler.localisations(&background, run)?);
    sites.extend(background);

    run.progress(0.9, "Sorting by frame")?;
    let localisations = by_frame(&localisations, parameters.frames as usize, run)?;
    run.progress(1.0, "Sorting by frame")?;
    Ok(Cloud {
        sites,
        membrane_sites,
        localisations,
        fwhm: parameters.fwhm,
    })
}

/// The kept sites of all copies, copy by copy.
fn membrane(parameters: &Parameters, run: &dyn Run) -> Result<Vec<Site>, Failure> {
    let Parameters {
        shape,
        acceptance,
        seed,
        ..
    } = *parameters;
    let found = candidates(&shape.solid(), shape.bounds(), parameters.dx, run)?;
    let copies = parameters.copies as usize;
    let places = arrange(
        shape.bounds(),
        copies,
        parameters.turn,
        parameters.gap,
        seed,
    );
    let batch = 8 * run.threads().max(1);
    let mut sites = vec![];
    for (number, places) in places.chunks(batch).enumerate() {
        let start = number * batch;
        run.progress(0.3 + 0.2 * start as f64 / copies as f64, "Keeping sites")?;
        sites.extend(gather(places.len(), run, &|i, out| {
            let Some(place) = places.get(i) else { return };
            let Ok(kept) = keep(found.len(), acceptance, seed, start + i, run) else {
                return;
            };
            let kept = kept.iter().filter_map(|&k| found.get(k as usize));
            out.extend(kept.map(|p| place_site(p, place, start + i)));
        })?);
    }
    Ok(sites)
}

fn place_site(found: &Candidate, place: &Placement, copy: usize) -> Site {
    let normal = place
        .rotation
        .apply(found.normal.map(f64::from))
        .map(|c| c as f32);
    Site {
        position: place.point(found.position),
        normal,
        copy: copy as u32 + 1,
    }
}

/// Calls `task` in parallel and joins what each call pushes, in order.
fn gather<T: Send>(
    count: usize,
    run: &dyn Run,
    task: &(dyn Fn(usize, &mut Vec<T>) + Sync),
) -> Result<Vec<T>, Failure> {
    let parts: Vec<Mutex<Vec<T>>> = (0..count).map(|_| Mutex::default()).collect();
    run.parallel(count, &|i| {
        if run.cancelled() {
            return;
        }
        let mut here = vec![];
        task(i, &mut here);
        if let Some(Ok(mut part)) = parts.get(i).map(Mutex::lock) {
            *part = here;
        }
    });
    if run.cancelled() {
        return Err(Failure::cancelled());
    }
    let parts: Vec<Vec<T>> = parts
        .into_iter()
        .map(|part| part.into_inner().unwrap_or_default())
        .collect();
    let mut all = Vec::with_capacity(parts.iter().map(Vec::len).sum());
    parts.into_iter().for_each(|part| all.extend(part));
    Ok(all)
}

/// Low corner and sides of the box of the background.
fn background_box(localisations: &[Localisation]) -> [Point; 2] {
    let start = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let (low, high) = localisations.iter().fold(start, |(low, high), l| {
        let p = l.position;
        (
            [0, 1, 2].map(|i| p[i].min(low[i])),
            [0, 1, 2].map(|i| p[i].max(high[i])),
        )
    });
    let margin = (BACKGROUND_BOX - 1.0) / 2.0;
    let side = [0, 1, 2].map(|i| high[i] - low[i]);
    [
        [0, 1, 2].map(|i| low[i] - margin * side[i]),
        side.map(|s| s * BACKGROUND_BOX),
    ]
}

fn background_sites(
    count: usize,
    [low, side]: [Point; 2],
    seed: u64,
    run: &dyn Run,
) -> Result<Vec<Site>, Failure> {
    gather(count.div_ceil(CHUNK), run, &|chunk, out| {
        let mut random = stream(seed, Purpose::Background, true, chunk as u64);
        out.extend((chunk * CHUNK..count.min((chunk + 1) * CHUNK)).map(|_| {
            let position = [0, 1, 2].map(|i| low[i] + side[i] * unit(&mut random));
            Site {
                position,
                normal: [f32::NAN; 3],
                copy: 0,
            }
        }));
    })
}

/// How often each of `sites` sites is seen, when `sites` of their `sites * blinks` samples are
/// drawn without replacement (selection sampling: Knuth, TAOCP 2, 3.4.2, algorithm S).
fn draw(
    sites: usize,
    blinks: u32,
    seed: u64,
    background: bool,
    run: &dyn Run,
) -> Result<Vec<u16>, Failure> {
    let mut random = stream(seed, Purpose::Draw, background, 0);
    let mut left = sites as u64;
    let mut samples = left * u64::from(blinks);
    let mut counts = Vec::with_capacity(sites);
    for site in 0..sites {
        if site % CHUNK == 0 && run.cancelled() {
            return Err(Failure::cancelled());
        }
        let mut seen = 0u16;
        for _ in 0..blinks {
            let drawn = below(samples, &mut random) < left;
            seen += u16::from(drawn);
            left -= u64::from(drawn);
            samples -= 1;
        }
        counts.push(seen);
    }
    Ok(counts)
}

/// Turns sites into localisations.
struct Sampler<'a> {
    parameters: &'a Parameters,
    background: bool,
    /// Number of the first site.
    first: u32,
}

impl Sampler<'_> {
    /// As many localisations as sites, in the order of the sites.
    fn localisations(&self, sites: &[Site], run: &dyn Run) -> Result<Vec<Localisation>, Failure> {
        let Parameters { blinks, seed, .. } = *self.parameters;
        let counts = draw(sites.len(), blinks, seed, self.background, run)?;
        gather(sites.len().div_ceil(CHUNK), run, &|chunk, out| {
            let range = chunk * CHUNK..sites.len().min((chunk + 1) * CHUNK);
            let first = self.first + range.start as u32;
            let sites = sites.get(range.clone()).unwrap_or_default();
            self.chunk(
                chunk as u64,
                first,
                sites,
                counts.get(range).unwrap_or_default(),
                out,
            );
        })
    }

    fn chunk(
        &self,
        chunk: u64,
        first: u32,
        sites: &[Site],
        counts: &[u16],
        out: &mut Vec<Localisation>,
    ) {
        let q = self.parameters;
        let [mut time, mut light, mut jitter] = [Purpose::Frame, Purpose::Photons, Purpose::Jitter]
            .map(|purpose| stream(q.seed, purpose, self.background, chunk));
        let mut bursts = Bursts::new(q.frames, q.mean_on);
        out.reserve(counts.iter().map(|count| usize::from(*count)).sum());
        for ((number, site), &count) in (first..).zip(sites).zip(counts) {
            for &frame in bursts.draw(u32::from(count), &mut time) {
                let excess: f64 = Exp1.sample(&mut light);
                let photons = (q.background_photons + q.photons * excess) as f32;
                let sigma = errors(q.fwhm, photons);
                let position = [0, 1, 2].map(|i| {
                    let normal: f64 = StandardNormal.sample(&mut jitter);
                    site.position[i] + sigma[i] * normal
                });
                out.push(Localisation {
                    position,
                    photons,
                    frame,
                    site: number,
                });
            }
        }
    }
}

/// Sorted by frame; those of one frame keep their order.
fn by_frame(
    localisations: &[Localisation],
    frames: usize,
    run: &dyn Run,
) -> Result<Vec<Localisation>, Failure> {
    let mut next = vec![0u32; frames + 1];
    for chunk in localisations.chunks(POLL) {
        if run.cancelled() {
            return Err(Failure::cancelled());
        }
        for localisation in chunk {
            if let Some(count) = next.get_mut(localisation.frame as usize + 1) {
                *count += 1;
            }
        }
    }
    let mut before = 0;
    for count in &mut next {
        before += *count;
        *count = before;
    }
    let mut sorted = vec![Localisation::default(); localisations.len()];
    for chunk in localisations.chunks(POLL) {
        if run.cancelled() {
            return Err(Failure::cancelled());
        }
        for localisation in chunk {
            let Some(place) = next.get_mut(localisation.frame as usize) else {
                continue;
            };
            if let Some(slot) = sorted.get_mut(*place as usize) {
                *slot = *localisation;
            }
            *place += 1;
        }
    }
    Ok(sorted)
}

#[cfg(test)]
#[path = "simulate_tests.rs"]
mod tests;
