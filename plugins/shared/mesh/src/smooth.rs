//! Smoothing that does not shrink.

use crate::blocks::by_item;
use crate::jet;
use crate::measure::{normal, vertex_normals};
use crate::mesh::{Mesh, NONE};
use crate::topology::describe;
use crate::vector::{Point, add, along, scale, sub};
use puncta_sdk::{Cancelled, Failure, Run};

/// How a mesh is smoothed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smoothing {
    /// Number of steps, each a pass that smooths and one that swells again.
    pub steps: u32,
    /// How far a vertex moves towards the mean of its neighbours in the first pass, 0 to 1.
    pub strength: f64,
    /// Frequency below which shape is kept, 0.01 to 0.5, in the scale of the graph Laplacian (2 is
    /// the highest): 0.1 keeps shapes of more than about ten edges.
    pub pass_band: f64,
    /// Whether closed components are brought back to exactly the volume that they had.
    pub keep_volume: bool,
}

impl Default for Smoothing {
    fn default() -> Smoothing {
        Smoothing {
            steps: 10,
            strength: 0.5,
            pass_band: 0.1,
            keep_volume: true,
        }
    }
}

/// Smooths with the low-pass filter of Taubin (SIGGRAPH 1995). Vertices at the boundary move along
/// it only.
///
/// # Errors
/// When the strength or the pass band is out of range, or cancelled.
pub fn smooth(mesh: &mut Mesh, how: Smoothing, run: &dyn Run) -> Result<(), Failure> {
    if !(how.strength > 0.0 && how.strength <= 1.0) {
        return Err(Failure::bad_input(
            "the strength must lie above 0 and up to 1",
        ));
    }
    if !(how.pass_band >= 0.01 && how.pass_band <= 0.5) {
        return Err(Failure::bad_input(
            "the pass band must lie from 0.01 to 0.5",
        ));
    }
    let swell = 1.0 / (how.pass_band - 1.0 / how.strength);
    let step = |mesh: &mut Mesh| {
        pass(mesh, how.strength, run)?;
        pass(mesh, swell, run)
    };
    steps(mesh, how.steps, how.keep_volume, step, run)
}

/// How a mesh is smoothed by polynomials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fitting {
    /// Number of steps.
    pub steps: u32,
    /// Degree of the polynomials, 2 to 4: a higher one keeps more.
    pub degree: u8,
    /// Edges from a vertex to the farthest neighbours of its polynomial, 1 to 8.
    pub rings: u8,
    /// Whether closed components are brought back to exactly the volume that they had.
    pub keep_volume: bool,
}

impl Default for Fitting {
    fn default() -> Fitting {
        Fitting {
            steps: 6,
            degree: 3,
            rings: 3,
            keep_volume: true,
        }
    }
}

/// Smooths by moving each vertex along its normal onto the polynomial that fits its neighbourhood
/// best (as for curvature). It keeps curvature, and unequal triangles do no harm, so that this is the
/// way before measuring curvature. The boundary stays.
///
/// # Errors
/// When cancelled.
pub fn fit(mesh: &mut Mesh, how: Fitting, run: &dyn Run) -> Result<(), Failure> {
    let rings = how.rings.clamp(1, 8);
    let step = |mesh: &mut Mesh| {
        let normals = vertex_normals(mesh, run)?;
        let moved = by_item(run, mesh.positions().len(), |v| {
            let p = mesh.positions()[v];
            if mesh.at_boundary(v as u32) {
                return p;
            }
            let height = jet::height(mesh, &normals, v as u32, how.degree, rings);
            along(p, normals[v], height)
        })?;
        mesh.positions = moved;
        Ok(())
    };
    steps(mesh, how.steps, how.keep_volume, step, run)
}

fn steps(
    mesh: &mut Mesh,
    count: u32,
    keep_volume: bool,
    step: impl Fn(&mut Mesh) -> Result<(), Cancelled>,
    run: &dyn Run,
) -> Result<(), Failure> {
    let before = keep_volume.then(|| describe(mesh));
    for i in 0..count {
        run.progress(f64::from(i) / f64::from(count), "smoothing")?;
        step(mesh)?;
    }
    let Some((components, of)) = before else {
        return Ok(());
    };
    let volumes: Vec<Option<f64>> = components
        .iter()
        .map(|one| (one.loops == 0).then_some(one.volume))
        .collect();
    for _ in 0..RESTORING {
        restore(mesh, &volumes, &of, run)?;
    }
    Ok(())
}

/// Steps of Newton's method towards the volume that was.
const RESTORING: usize = 4;

fn pass(mesh: &mut Mesh, factor: f64, run: &dyn Run) -> Result<(), Cancelled> {
    let moved = by_item(run, mesh.positions().len(), |v| {
        let v = v as u32;
        let p = mesh.position(v);
        match mean_of_ring(mesh, v) {
            Some(mean) => along(p, sub(mean, p), factor),
            None => p,
        }
    })?;
    mesh.positions = moved;
    Ok(())
}

/// Mean of the neighbours; at the boundary, of those two that are there as well.
pub(crate) fn mean_of_ring(mesh: &Mesh, v: u32) -> Option<Point> {
    let (mut total, mut count) = ([0.0; 3], 0.0);
    if mesh.at_boundary(v) {
        let last = mesh.outgoing(v).last()?;
        let ends = [mesh.to(mesh.out(v)), mesh.from(crate::prev(last))];
        total = ends
            .iter()
            .fold(total, |sum, &w| add(sum, mesh.position(w)));
        count = 2.0;
    } else {
        for w in mesh.ring(v) {
            total = add(total, mesh.position(w));
            count += 1.0;
        }
    }
    (count > 0.0).then(|| scale(total, 1.0 / count))
}

/// Moves closed components along their normals, each by one distance, towards the volumes that they
/// had.
fn restore(
    mesh: &mut Mesh,
    volumes: &[Option<f64>],
    of: &[u32],
    run: &dyn Run,
) -> Result<(), Cancelled> {
    let (now, _) = describe(mesh);
    let shift = |i: usize| {
        let (volume, now) = (volumes[i]?, &now[i]);
        // A component that has turned inside out or all but vanished cannot be brought back.
        let ratio = volume / now.volume;
        (ratio > 0.5 && ratio < 2.0).then(|| (volume - now.volume) / now.area)
    };
    let shifts: Vec<Option<f64>> = (0..volumes.len()).map(shift).collect();
    let moved = by_item(run, mesh.positions().len(), |v| {
        let p = mesh.positions()[v];
        let out = mesh.out(v as u32);
        let component = of.get((out / 3) as usize).map_or(NONE, |i| *i);
        match shifts.get(component as usize) {
            Some(Some(shift)) => along(p, normal(mesh, v as u32), *shift),
            _ => p,
        }
    })?;
    mesh.positions = moved;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::volume;
    use crate::shapes;
    use crate::vector::norm;
    use puncta_sdk::run::Serial;

    #[test]
    fn noise_goes_and_volume_stays() {
        let (mut positions, triangles) = shapes::sphere(100.0, 4);
        let wave = |i: usize| ((i * 7919 % 1009) as f64 / 1009.0 - 0.5) * 6.0;
        for (i, p) in positions.iter_mut().enumerate() {
            *p = scale(*p, 1.0 + wave(i) / 100.0);
        }
        let mut mesh = Mesh::new(positions, &triangles).unwrap();
        let before = volume(&mesh, &Serial).unwrap();
        let rough = |mesh: &Mesh| {
            let square = |p: &Point| (norm(*p) - 100.0) * (norm(*p) - 100.0);
            (mesh.positions().iter().map(square).sum::<f64>() / 2562.0).sqrt()
        };
        let start = rough(&mesh);
        let how = Smoothing {
            steps: 40,
            ..Smoothing::default()
        };
        let mut fitted = mesh.clone();
        smooth(&mut mesh, how, &Serial).unwrap();
        fit(&mut fitted, Fitting::default(), &Serial).unwrap();
        for mesh in [mesh, fitted] {
            assert!((volume(&mesh, &Serial).unwrap() / before - 1.0).abs() < 1e-9);
            assert!(rough(&mesh) < 0.3 * start, "{} of {start}", rough(&mesh));
        }
    }

    #[test]
    fn the_filter_alone_hardly_changes_the_volume() {
        let (positions, triangles) = shapes::torus(100.0, 40.0, 60, 24);
        let mut mesh = Mesh::new(positions, &triangles).unwrap();
        let before = volume(&mesh, &Serial).unwrap();
        let how = Smoothing {
            keep_volume: false,
            ..Smoothing::default()
        };
        smooth(&mut mesh, how, &Serial).unwrap();
        // A mode of frequency k grows by (1 - strength k) (1 + swell k): half a percent of the tube.
        let change = volume(&mesh, &Serial).unwrap() / before - 1.0;
        assert!(change.abs() < 0.015, "{change}");
    }

    #[test]
    fn sheets_keep_their_rim_and_bad_values_are_refused() {
        let (positions, triangles) = shapes::grid(6, 6, 1.0);
        let mut mesh = Mesh::new(positions, &triangles).unwrap();
        smooth(&mut mesh, Smoothing::default(), &Serial).unwrap();
        assert!(mesh.positions().iter().all(|p| p[2] == 0.0));
        let wrong = Smoothing {
            strength: f64::NAN,
            ..Smoothing::default()
        };
        assert!(smooth(&mut mesh, wrong, &Serial).is_err());
    }
}
