//! From localisations to a closed surface.

use crate::centre::{centre, median_distance};
use crate::field::Field;
use crate::surface::Surface;
use puncta_sdk::Failure;
use puncta_sdk::run::Run;
use puncta_shared_octree::{BITS, Cube, Limits, Octree, Points, Tree, bounds};

/// How a surface is extracted.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Cells with more localisations are cut.
    pub most: u32,
    /// Smallest side of a cell, nm.
    pub smallest_cell: f64,
    /// Passes of smoothing over the density.
    pub smoothing: u32,
    /// Localisations per nm^3 at the surface; none: chosen by the data.
    pub threshold: Option<f64>,
    /// Whether hollows are filled, so that inner sheets vanish.
    pub cull: bool,
    /// Whether the surface is moved into the middle of the localisations.
    pub centre: bool,
    /// Components with fewer triangles are dropped.
    pub fewest_triangles: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            most: 50,
            smallest_cell: 5.0,
            smoothing: 1,
            threshold: None,
            cull: true,
            centre: true,
            fewest_triangles: 100,
        }
    }
}

/// A surface and how it came about.
#[derive(Clone, Debug)]
pub struct Extracted {
    /// The surface.
    pub surface: Surface,
    /// The octree before it was balanced.
    pub octree: Octree,
    /// Leaves after it was balanced.
    pub leaves: usize,
    /// Localisations per nm^3.
    pub threshold: f64,
    /// Components kept, and dropped as too small.
    pub components: [usize; 2],
    /// Rows without a finite position.
    pub left_out: usize,
    /// Median signed distance of the localisations, nm, before and after the surface was moved.
    pub median: [f64; 2],
}

/// Share of the cube's side that stays free on each side of the localisations; above 1/16.
const MARGIN: f64 = 1.0 / 12.0;

/// The cube about localisations.
///
/// # Errors
/// When there is none, or they have no extent along an axis.
pub fn cube_about(columns: [&[f64]; 3], run: &dyn Run) -> Result<Cube, Failure> {
    let ([low, high], count) = bounds(columns, run)?;
    if count == 0 {
        let message = "no localisation has a finite position x, y, z";
        return Err(Failure::bad_input(message).remedy("a surface needs localisations"));
    }
    let extent: [f64; 3] = std::array::from_fn(|axis| high[axis] - low[axis]);
    let side = extent.into_iter().fold(0.0, f64::max) / (1.0 - 2.0 * MARGIN);
    if side == 0.0 {
        let message = format!("all {count} localisations lie at one place");
        return Err(Failure::bad_input(message).remedy("a surface needs them in three dimensions"));
    }
    if let Some(axis) = extent.iter().position(|length| *length <= 1e-9 * side) {
        let name = ["x", "y", "z"][axis];
        let message = format!("{name} is the same for all {count} localisations");
        return Err(Failure::bad_input(message).remedy("a surface needs them in three dimensions"));
    }
    Ok(Cube {
        low: std::array::from_fn(|axis| (low[axis] + high[axis]) / 2.0 - side / 2.0),
        side,
    })
}

/// Extracts the surface of the density of localisations.
///
/// # Errors
/// When there is no localisation in three dimensions, no cell reaches the threshold, no component
/// is large enough, or cancelled.
pub fn extract(
    columns: [&[f64]; 3],
    settings: &Settings,
    run: &dyn Run,
) -> Result<Extracted, Failure> {
    run.progress(0.0, "sorting the localisations")?;
    let points = Points::new(columns, cube_about(columns, run)?, run)?;
    run.progress(0.2, "building the octree")?;
    let (octree, tree) = build(&points, settings, run)?;
    run.progress(0.35, "taking the density")?;
    let field = Field::new(&tree, settings.smoothing, run)?;
    let threshold = match settings.threshold {
        Some(threshold) => threshold,
        None => automatic(&field),
    };
    let highest = field.highest();
    if highest < threshold {
        let message = format!(
            "no cell reaches the threshold of {threshold:.3e} / nm^3; the densest has {highest:.3e}"
        );
        return Err(Failure::bad_parameter("threshold", message)
            .remedy("lower it, or leave it out to have it chosen"));
    }
    run.progress(0.45, "extracting the surface")?;
    let sides = field.sides(threshold, settings.cull, run)?;
    let mut surface = Surface::new(&field, &sides, threshold, run)?;
    let components = surface.drop_small(settings.fewest_triangles);
    if components[0] == 0 {
        let (dropped, fewest) = (components[1], settings.fewest_triangles);
        let message = format!("all {dropped} components have fewer than {fewest} triangles");
        return Err(Failure::bad_parameter("minimum_triangles", message)
            .remedy("lower it, or use smaller cells"));
    }
    let leaves = tree.nodes().iter().filter(|node| node.is_leaf()).count();
    drop((field, sides));
    drop(tree);
    let median = if settings.centre {
        centre(&mut surface, &points, run)?
    } else {
        [median_distance(&surface, &points, run)?; 2]
    };
    Ok(Extracted {
        surface,
        octree,
        leaves,
        threshold,
        components,
        left_out: points.left_out(),
        median,
    })
}

fn build(points: &Points, settings: &Settings, run: &dyn Run) -> Result<(Octree, Tree), Failure> {
    let mut max_level = 0;
    while max_level < BITS && points.cube().cell(max_level + 1) >= settings.smallest_cell {
        max_level += 1;
    }
    let limits = Limits {
        capacity: settings.most,
        max_level: max_level.max(4),
    };
    let octree = Octree::new(points, limits, run)?;
    let mut tree = Tree::new(&octree);
    tree.balance(points, run)?;
    Ok((octree, tree))
}

/// A threshold that the shell stays above everywhere: a share of the density at the median
/// localisation.
fn automatic(field: &Field<'_>) -> f64 {
    let [median] = field.quantiles([0.5]);
    0.25 * median
}
