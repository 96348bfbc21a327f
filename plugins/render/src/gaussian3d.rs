//! Localisations as Gaussians integrated over each voxel.
//!
//! The share of a slice is the integral of the Gaussian along z over it, as along x and y (see
//! `gaussian2d`); each slice is then a 2D image of the localisations that reach it, weighted by
//! their shares. So the slices lie on the grid of the 2D image and add up to it.

use crate::field::Volume;
use crate::gaussian2d::{Rendered, gaussian2d};
use crate::normal::Normal;
use crate::output::Part;
use crate::spots::{Fate, Gaussians, ONE, Sigma, support};
use puncta_sdk::{Cancelled, Run};
use std::sync::Mutex;

/// Rows that one task takes.
const CHUNK: usize = 1 << 16;

/// Where the localisations lie in z. Columns have the length of the others; the shortest decides.
#[derive(Debug, Clone, Copy)]
pub struct Depths<'a> {
    /// Positions in nm.
    pub z: &'a [f64],
    /// Standard deviation in z.
    pub sigma: Sigma<'a>,
    /// Factor on each of them.
    pub scale: f64,
}

/// A localisation that reaches the volume: its slices, counted from the first one, and what the
/// shares are computed from.
#[derive(Clone, Copy)]
struct Reach {
    start: i64,
    end: i64,
    z: i64,
    sigma: f32,
    row: u32,
}

/// Renders `spots` with their depths into `out` (x fastest, z slowest, `volume.voxels()` long;
/// overwritten). Rows are summed in the order of the slice where they begin, then of their numbers,
/// so that the image does not depend on the number of threads.
///
/// # Errors
/// `Cancelled` when the person cancelled; `out` is then undefined.
pub fn gaussian3d(
    spots: &Gaussians<'_>,
    depths: &Depths<'_>,
    volume: &Volume,
    out: &mut [f32],
    run: &dyn Run,
) -> Result<Rendered, Cancelled> {
    run.progress(0.0, "sorting localisations")?;
    let (reaches, mut total) = reaches(spots, depths, volume, run)?;
    let normal = Normal::new();
    let slices = volume.z.count();
    let share = 1.0 / slices as f64;
    let (mut active, mut next): (Vec<Reach>, usize) = (Vec::new(), 0);
    let mut slice = Slice::default();
    for (k, out) in out.chunks_mut(volume.plane.pixels()).enumerate() {
        let place = k as i64;
        active.retain(|one| one.end > place);
        while let Some(one) = reaches.get(next).filter(|one| one.start <= place) {
            active.push(*one);
            next += 1;
        }
        slice.fill(&active, place, spots, &normal);
        let part = Part {
            run,
            from: place as f64 * share,
            share,
        };
        total.sum += gaussian2d(&slice.gaussians(spots), &volume.plane, out, &part)?.sum;
    }
    run.progress(1.0, "rendering localisations")?;
    Ok(total)
}

/// The localisations that reach the volume, by the slice where they begin and their rows, and what
/// becomes of all.
fn reaches(
    spots: &Gaussians<'_>,
    depths: &Depths<'_>,
    volume: &Volume,
    run: &dyn Run,
) -> Result<(Vec<Reach>, Rendered), Cancelled> {
    let rows = spots.rows().min(depths.z.len());
    let chunks: Vec<Mutex<(Vec<Reach>, Rendered)>> = (0..rows.div_ceil(CHUNK))
        .map(|_| Mutex::default())
        .collect();
    run.parallel(chunks.len(), &|c| {
        if run.cancelled() {
            return;
        }
        let mut found = Vec::new();
        let mut fates = Rendered::default();
        for row in c * CHUNK..rows.min((c + 1) * CHUNK) {
            match (
                spots.spot(row, &volume.plane),
                reach(row, spots, depths, volume),
            ) {
                (Fate::Invalid, _) | (_, Err(Fate::Invalid)) => fates.invalid += 1,
                (Fate::Spot(_), Ok(reach)) => {
                    fates.rendered += 1;
                    found.push(reach);
                }
                _ => fates.outside += 1,
            }
        }
        if let Ok(mut slot) = chunks[c].lock() {
            *slot = (found, fates);
        }
    });
    if run.cancelled() {
        return Err(Cancelled);
    }
    let mut total = Rendered::default();
    let mut all = Vec::new();
    for chunk in chunks {
        let (found, fates) = chunk.into_inner().unwrap_or_default();
        total.rendered += fates.rendered;
        total.outside += fates.outside;
        total.invalid += fates.invalid;
        all.extend(found);
    }
    // Stable: rows stay in order.
    all.sort_by_key(|one| one.start);
    Ok((all, total))
}

/// The slices that a row reaches.
fn reach(
    row: usize,
    spots: &Gaussians<'_>,
    depths: &Depths<'_>,
    volume: &Volume,
) -> Result<Reach, Fate> {
    let raw = depths.sigma.at(row);
    let sigma = (raw * depths.scale).max(spots.sigma_min) / volume.z.size();
    if !(raw >= 0.0 && sigma < f64::INFINITY && depths.z[row].is_finite()) {
        return Err(Fate::Invalid);
    }
    let z = volume.z.fixed(depths.z[row]).ok_or(Fate::Outside)?;
    // Narrower than a millionth of a voxel is a point, as in the plane.
    let sigma = if sigma < 1e-6 { 0.0 } else { sigma as f32 };
    let slices = support(z, sigma);
    if slices.end <= 0 || slices.start >= volume.z.count() as i64 {
        return Err(Fate::Outside);
    }
    let (start, end) = (slices.start, slices.end);
    Ok(Reach {
        start,
        end,
        z,
        sigma,
        row: row as u32,
    })
}

/// The localisations of a slice, as columns.
#[derive(Default)]
struct Slice {
    x: Vec<f64>,
    y: Vec<f64>,
    sigma_x: Vec<f64>,
    sigma_y: Vec<f64>,
    weight: Vec<f64>,
}

impl Slice {
    fn fill(&mut self, active: &[Reach], place: i64, spots: &Gaussians<'_>, normal: &Normal) {
        let columns = [
            &mut self.x,
            &mut self.y,
            &mut self.sigma_x,
            &mut self.sigma_y,
            &mut self.weight,
        ];
        columns.into_iter().for_each(Vec::clear);
        for one in active {
            let row = one.row as usize;
            let share = if one.end - one.start == 1 {
                1.0
            } else {
                let edge = |k: i64| ((k << 32) - one.z) as f64 / ONE / f64::from(one.sigma);
                let at = |t: f64| normal.at(pulp::Scalar::new(), t);
                at(edge(place + 1)) - at(edge(place))
            };
            self.x.push(spots.x[row]);
            self.y.push(spots.y[row]);
            self.sigma_x.push(spots.sigma_x.at(row));
            self.sigma_y.push(spots.sigma_y.at(row));
            self.weight
                .push(share * spots.weight.map_or(1.0, |weight| weight[row]));
        }
    }

    fn gaussians<'a>(&'a self, spots: &Gaussians<'_>) -> Gaussians<'a> {
        Gaussians {
            x: &self.x,
            y: &self.y,
            sigma_x: Sigma::Column(&self.sigma_x),
            sigma_y: Sigma::Column(&self.sigma_y),
            weight: Some(&self.weight),
            sigma_min: spots.sigma_min,
            scale: spots.scale,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Axis;
    use crate::testing::{Random, around, plane, sum};
    use puncta_testkit::Threads;

    struct Cloud([Vec<f64>; 6]);

    impl Cloud {
        fn new(count: usize) -> Cloud {
            let mut random = Random::new(9);
            // Multiples of 1/1024 nm, so that shifts are exact.
            let mut dyadic = |low, high| {
                let values = random.many(count, low, high).into_iter();
                values
                    .map(|v| (v * 1024.0).round() / 1024.0)
                    .collect::<Vec<f64>>()
            };
            let (x, y, z) = (
                dyadic(0.0, 400.0),
                dyadic(0.0, 300.0),
                dyadic(-200.0, 200.0),
            );
            Cloud([
                x,
                y,
                z,
                dyadic(0.0, 30.0),
                dyadic(0.0, 30.0),
                dyadic(0.0, 60.0),
            ])
        }

        fn spots(&self) -> (Gaussians<'_>, Depths<'_>) {
            let [x, y, z, sx, sy, sz] = &self.0;
            let spots = Gaussians {
                x,
                y,
                sigma_x: Sigma::Column(sx),
                sigma_y: Sigma::Column(sy),
                weight: None,
                sigma_min: 0.0,
                scale: 1.0,
            };
            (
                spots,
                Depths {
                    z,
                    sigma: Sigma::Column(sz),
                    scale: 1.0,
                },
            )
        }

        fn volume(&self) -> Volume {
            around([&self.0[0], &self.0[1], &self.0[2]], 16.0, 32.0, 300.0)
        }

        fn image(&self, volume: &Volume, threads: usize) -> (Vec<f32>, Rendered) {
            let (spots, depths) = self.spots();
            let mut out = vec![f32::NAN; volume.voxels()];
            let rendered = gaussian3d(&spots, &depths, volume, &mut out, &Threads(threads));
            (out, rendered.unwrap())
        }
    }

    #[test]
    fn the_slices_add_up_to_the_plane_and_to_the_number() {
        let cloud = Cloud::new(3000);
        let volume = cloud.volume();
        let (found, rendered) = cloud.image(&volume, 2);
        assert!((sum(&found) - 3000.0).abs() < 1e-3 && rendered.rendered == 3000);
        assert!(found == cloud.image(&volume, 1).0);
        let mut flat = vec![0.0; volume.plane.pixels()];
        gaussian2d(&cloud.spots().0, &volume.plane, &mut flat, &Threads(2)).unwrap();
        let mut projected = vec![0.0_f64; flat.len()];
        for slice in found.chunks(flat.len()) {
            projected
                .iter_mut()
                .zip(slice)
                .for_each(|(p, v)| *p += f64::from(*v));
        }
        let worst = projected
            .iter()
            .zip(&flat)
            .map(|(p, f)| (p - f64::from(*f)).abs());
        assert!(worst.fold(0.0, f64::max) < 3e-6);
    }

    #[test]
    fn a_voxel_holds_the_integral() {
        let volume = Volume {
            plane: plane(0.0, 0.0, 10.0, 12, 12),
            z: Axis::at(0.0, 20.0, 12).unwrap(),
        };
        let cloud = Cloud([
            vec![57.0],
            vec![61.0],
            vec![123.0],
            vec![9.0],
            vec![11.0],
            vec![25.0],
        ]);
        let (found, _) = cloud.image(&volume, 2);
        let phi = |t: f64| 0.5 * libm::erfc(-t / 2.0_f64.sqrt());
        let share =
            |low: f64, size: f64, u: f64, s: f64| phi((low + size - u) / s) - phi((low - u) / s);
        for (k, j, i) in [(6, 6, 5), (4, 7, 6), (7, 5, 4)] {
            let [z, y, x] = [20.0 * k as f64, 10.0 * j as f64, 10.0 * i as f64];
            let expected = share(x, 10.0, 57.0, 9.0)
                * share(y, 10.0, 61.0, 11.0)
                * share(z, 20.0, 123.0, 25.0);
            let value = f64::from(found[(k * 12 + j) * 12 + i]);
            // The cut at four standard deviations takes 6e-5 of each axis.
            assert!(
                (value - expected).abs() < 3e-4 * expected,
                "{value} {expected}"
            );
        }
    }

    #[test]
    fn points_land_in_their_voxels_and_shifts_by_voxels_change_nothing() {
        let mut cloud = Cloud::new(500);
        let volume = cloud.volume();
        let before = cloud.image(&volume, 2).0;
        for (column, by) in [(0, 160.0), (1, -48.0), (2, 96.0)] {
            cloud.0[column].iter_mut().for_each(|v| *v += by);
        }
        let moved = cloud.volume();
        assert_eq!(moved.z.first() - volume.z.first(), 3);
        assert!(before == cloud.image(&moved, 2).0);
        let point = Cloud([
            vec![5.0],
            vec![16.0],
            vec![-0.5],
            vec![0.0],
            vec![0.0],
            vec![0.0],
        ]);
        let volume = around(
            [&[0.0, 40.0], &[0.0, 40.0], &[-40.0, 40.0]],
            16.0,
            32.0,
            0.0,
        );
        let (found, _) = point.image(&volume, 2);
        let size = [
            volume.z.count(),
            volume.plane.y.count(),
            volume.plane.x.count(),
        ];
        assert_eq!(size, [4, 3, 3]);
        assert_eq!(found.iter().position(|v| *v == 1.0), Some((3 + 1) * 3));
        assert_eq!(sum(&found), 1.0);
    }

    #[test]
    fn what_cannot_be_rendered_is_counted() {
        let nan = f64::NAN;
        let x = vec![1.0, nan, 1.0, 1.0, 1.0];
        let z = vec![1.0, 1.0, nan, 1.0, 1e7];
        let sz = vec![1.0, 1.0, 1.0, -1.0, 1.0];
        let cloud = Cloud([x, vec![1.0; 5], z, vec![1.0; 5], vec![1.0; 5], sz]);
        let volume = Volume {
            plane: plane(0.0, 0.0, 10.0, 2, 2),
            z: Axis::at(0.0, 10.0, 2).unwrap(),
        };
        let rendered = cloud.image(&volume, 2).1;
        assert_eq!(
            (rendered.rendered, rendered.outside, rendered.invalid),
            (1, 1, 3)
        );
    }
}
