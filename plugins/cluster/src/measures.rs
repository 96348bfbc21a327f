//! `puncta.cluster.measures/1`

use crate::columns::{depth, plan};
use crate::groups::Groups;
use crate::plane::{alpha_shape, area, hull, perimeter};
use crate::shape::moments;
use crate::space;
use puncta_sdk::prelude::*;
use puncta_sdk::run::map;
use puncta_sdk::serde_json::json;
use puncta_sdk::{ColumnMut, OutputObject};

/// Measures each cluster.
#[derive(Params)]
pub struct Measures {
    /// Column with the number of the cluster; rows below 1 are left out.
    #[param(default = "dbscanClumpID")]
    group: Column,
    /// Whether clusters are measured in 3D.
    #[param(default = false)]
    axial: bool,
    /// Largest radius of a triangle (in 3D of a tetrahedron) of the alpha shape, which is measured if this is given.
    #[param(min = 1e-6, max = 1e9, unit = "nm")]
    alpha: Option<f64>,
}

/// Columns of the table, in order.
fn columns(axial: bool, alpha: bool) -> Vec<ColumnInfo> {
    let axes = if axial {
        &["x", "y", "z"][..]
    } else {
        &["x", "y"]
    };
    let width = if axial { 3 } else { 2 };
    let named = |name: &str, unit: &str, text: &str| {
        ColumnInfo::new(name, Element::F64, unit).description(text)
    };
    let number = ColumnInfo::new("cluster", Element::I32, "1").role("group");
    let count = ColumnInfo::new("count", Element::U32, "1");
    let mut all = vec![
        number.description("Number of the cluster"),
        count.description("Localisations with a finite position"),
    ];
    all.extend(
        axes.iter()
            .map(|axis| named(axis, "nm", "Mean position").role("position")),
    );
    let gyration = "Root of the mean square distance from the mean";
    all.push(named("gyration_radius", "nm", gyration));
    for axis in 0..axes.len() {
        let text = "Standard deviation (n - 1) along a principal axis";
        all.push(named(&format!("sigma_{axis}"), "nm", text));
    }
    for axis in 0..axes.len() {
        let direction = named(&format!("axis_{axis}"), "1", "Principal axis");
        all.push(direction.width(width).role("vector"));
    }
    all.push(named(
        "anisotropy",
        "1",
        "0 for a round cluster, 1 for a line",
    ));
    let solid = [
        ("hull_volume", "nm^3", "Volume of the convex hull"),
        ("hull_surface", "nm^2", "Surface of the convex hull"),
        ("density", "1/nm^3", "Localisations for the hull's volume"),
    ];
    let flat = [
        ("hull_area", "nm^2", "Area of the convex hull"),
        ("hull_perimeter", "nm", "Perimeter of the convex hull"),
        ("density", "1/nm^2", "Localisations for the hull's area"),
    ];
    let flat_shape = [
        ("alpha_area", "nm^2", "Area of the alpha shape"),
        (
            "alpha_perimeter",
            "nm",
            "Perimeter of the alpha shape, holes too",
        ),
        (
            "alpha_density",
            "1/nm^2",
            "Localisations for the alpha shape's area",
        ),
    ];
    let solid_shape = [
        ("alpha_volume", "nm^3", "Volume of the alpha shape"),
        (
            "alpha_surface",
            "nm^2",
            "Surface of the alpha shape, holes too",
        ),
        (
            "alpha_density",
            "1/nm^3",
            "Localisations for the alpha shape's volume",
        ),
    ];
    let (hull, shape) = if axial {
        (solid, solid_shape)
    } else {
        (flat, flat_shape)
    };
    let more = if alpha { &shape[..] } else { &[] };
    all.extend(
        hull.iter()
            .chain(more)
            .map(|(name, unit, text)| named(name, unit, text)),
    );
    all
}

/// The numbers of the columns of one cluster after its number and count, lists one after another.
fn measure<const D: usize>(
    points: &[[f64; D]],
    alpha: Option<f64>,
    run: &dyn Run,
) -> Result<Vec<f64>, Failure> {
    let found = moments(points);
    let mut out = found.centre.to_vec();
    out.push(found.gyration);
    out.extend(found.sigma);
    out.extend(found.axes.iter().flatten());
    let squares = found.sigma.map(|sigma| sigma * sigma);
    let mean = squares.iter().sum::<f64>() / D as f64;
    let spread: f64 = squares
        .iter()
        .map(|square| (square - mean) * (square - mean))
        .sum();
    // Between 0 and 1 for any number of axes.
    out.push((spread / (D as f64 - 1.0)).sqrt() / ((D as f64).sqrt() * mean));
    let count = points.len() as f64;
    let density = |size: f64| if size > 0.0 { count / size } else { f64::NAN };
    if D == 3 {
        let points: Vec<[f64; 3]> = points.iter().map(|p| [p[0], p[1], p[D - 1]]).collect();
        let hull = space::hull(&points);
        out.extend([hull.volume, hull.surface, density(hull.volume)]);
        if let Some(alpha) = alpha {
            let shape = space::alpha_shape(&points, alpha, run)?;
            out.extend([shape.volume, shape.surface, density(shape.volume)]);
        }
        return Ok(out);
    }
    let points: Vec<[f64; 2]> = points.iter().map(|point| [point[0], point[1]]).collect();
    let ring = hull(&points);
    let size = area(&ring);
    out.extend([size, perimeter(&ring), density(size)]);
    if let Some(alpha) = alpha {
        let rings = alpha_shape(&points, alpha)?;
        let size: f64 = rings.iter().map(|ring| area(ring)).sum();
        let length: f64 = rings.iter().map(|ring| perimeter(ring)).sum();
        out.extend([size, length, density(size)]);
    }
    Ok(out)
}

impl Measures {
    fn table<const D: usize>(&self, at: [&[f64]; D], job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let numbers = table.f64(&self.group)?;
        let finite = |row: usize| at.iter().all(|values| values[row].is_finite());
        let groups = Groups::new(&numbers, &finite, job)?;
        job.progress(0.2, "measuring clusters")?;
        let rows = map(job, groups.len(), &|group| {
            if job.cancelled() {
                return Err(Failure::cancelled());
            }
            let rows = groups.rows(group);
            let points: Vec<[f64; D]> = rows
                .iter()
                .map(|row| at.map(|values| values[*row as usize]))
                .collect();
            measure(&points, self.alpha, job)
        });
        let rows: Vec<Vec<f64>> = rows.into_iter().collect::<Result<_, _>>()?;
        let columns = columns(self.axial, self.alpha.is_some());
        let mut header = Header::table("clusters", groups.len() as u64, columns);
        header.metadata = table.header().metadata.clone();
        let mut out = job.begin("clusters", header)?;
        out.commit(0, groups.len() as u64)?;
        write(&mut out, &groups, &rows)?;
        out.finish()?;
        let mut report = Report::new("report");
        report.number("clusters", groups.len() as f64, "1");
        let mut median = |name: &str, place: usize, unit: &str| {
            let mut values: Vec<f64> = rows.iter().map(|row| row[place]).collect();
            values.sort_by(f64::total_cmp);
            let middle = values.get(values.len() / 2).copied().unwrap_or(f64::NAN);
            report.number(name, middle, unit);
        };
        median("median radius of gyration", D, "nm");
        job.report(&report)
    }
}

fn write(out: &mut OutputObject<'_>, groups: &Groups, rows: &[Vec<f64>]) -> Result<(), Failure> {
    let widths: Vec<usize> = out.header().parts[0]
        .columns
        .iter()
        .map(|column| column.type_.width as usize)
        .collect();
    let mut first = 0;
    for (column, width) in out.columns_mut(0)?.into_iter().zip(widths) {
        match column {
            ColumnMut::I32(to) => to.copy_from_slice(&groups.numbers),
            ColumnMut::U32(to) => {
                for (group, slot) in to.iter_mut().enumerate() {
                    *slot = u32::try_from(groups.rows(group).len()).unwrap_or(u32::MAX);
                }
            }
            ColumnMut::F64(to) => {
                for (list, row) in to.chunks_exact_mut(width).zip(rows) {
                    list.copy_from_slice(&row[first..first + width]);
                }
                first += width;
            }
            _ => return Err(Failure::internal("the host gave another column")),
        }
    }
    Ok(())
}

impl Operation for Measures {
    const ID: &'static str = "puncta.cluster.measures/1";

    fn info() -> Info {
        Info::operation("Measure clusters")
            .description(
                "A table with a row for each cluster: localisations, mean position, radius of \
                 gyration, standard deviations along the principal axes, anisotropy, convex hull \
                 and density, and on request the alpha shape: the Delaunay triangles \
                 (tetrahedra) whose circumscribed circle (sphere) has at most the radius alpha. Hulls of clusters that lie on \
                 a line or, in 3D, in a plane have no area or volume, and their density is NaN. \
                 Works with any column of numbers of clusters.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .any_column("$group")
                    .description("Localisations with the number of their cluster"),
            )
            .output(Ports::table("clusters").description("One row for each cluster"))
            .output(Ports::report("report").description("Number of clusters"))
            .example(json!({ "group": "copy", "alpha": 50 }))
            .example_input(
                "table",
                "puncta.synthetic.membrane/1",
                json!({ "copies": 4 }),
            )
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        plan::<Self>(request, self.axial, &[&self.group], 160)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y) = (table.f64("x")?, table.f64("y")?);
        if self.axial {
            let z = depth(&table, 1.0)?;
            self.table([&x[..], &y[..], &z[..]], job)
        } else {
            self.table([&x[..], &y[..]], job)
        }
    }
}

puncta_sdk::register!(Measures);

#[cfg(test)]
mod tests;
