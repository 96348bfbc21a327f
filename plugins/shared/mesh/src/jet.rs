//! Curvature by a polynomial over the neighbours of a vertex.

use crate::curvature::{Curvature, eigen};
use crate::mesh::Mesh;
use crate::vector::{Point, add, dot, frame, scale, squared, sub, unit};
use nalgebra::{SMatrix, SVector};

/// Neighbours within `rings` edges of a vertex, that itself first.
pub(crate) fn neighbourhood(mesh: &Mesh, vertex: u32, rings: u8, found: &mut Vec<u32>) {
    found.clear();
    found.push(vertex);
    let mut begin = 0;
    for _ in 0..rings {
        let end = found.len();
        for i in begin..end {
            for neighbour in mesh.ring(found[i]) {
                // Neighbours of a ring are in it, the one before or the one after.
                if !found.contains(&neighbour) {
                    found.push(neighbour);
                }
            }
        }
        begin = end;
        if found.len() > MOST {
            break;
        }
    }
}

/// Neighbours from which no further ring is added.
const MOST: usize = 400;

/// The polynomial that fits best around a vertex.
struct Fit {
    /// Coefficients of 1, x, y, x^2, xy, y^2, of lengths divided by `reach`.
    coefficients: [f64; 6],
    axes: [Point; 2],
    reach: f64,
}

/// Curvature at a vertex: weighted least squares of z(x, y) in the frame of its normal. With too few
/// neighbours for the degree, a lower one is used.
pub(crate) fn curvature(
    mesh: &Mesh,
    normals: &[Point],
    vertex: u32,
    degree: u8,
    rings: u8,
) -> Curvature {
    let normal = normals.get(vertex as usize).copied().unwrap_or_default();
    let Some(fit) = around(mesh, normals, vertex, degree, rings) else {
        return Curvature::UNKNOWN;
    };
    let [_, rest @ ..] = fit.coefficients;
    of_graph(rest, fit.axes, normal, fit.reach)
}

/// Height of the polynomial over a vertex along its normal, in the unit of the positions; 0 if
/// there is none.
pub(crate) fn height(mesh: &Mesh, normals: &[Point], vertex: u32, degree: u8, rings: u8) -> f64 {
    let fit = around(mesh, normals, vertex, degree, rings);
    fit.map_or(0.0, |fit| fit.coefficients[0] * fit.reach)
}

fn around(mesh: &Mesh, normals: &[Point], vertex: u32, degree: u8, rings: u8) -> Option<Fit> {
    let normal = normals.get(vertex as usize).copied().unwrap_or_default();
    if squared(normal) == 0.0 {
        return None;
    }
    let mut around = Vec::with_capacity(64);
    neighbourhood(mesh, vertex, rings, &mut around);
    if around.len() < 6 {
        neighbourhood(mesh, vertex, rings + 1, &mut around);
    }
    let axes = frame(normal);
    let centre = mesh.position(vertex);
    let mut local: Vec<Point> = Vec::with_capacity(around.len());
    for &v in &around {
        // Sheets that fold back are not part of the graph over the tangent plane.
        if dot(normals[v as usize], normal) > 0.1 {
            let p = sub(mesh.position(v), centre);
            local.push([dot(p, axes[0]), dot(p, axes[1]), dot(p, normal)]);
        }
    }
    let reach = local.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
    if reach == 0.0 {
        return None;
    }
    local.iter_mut().for_each(|p| *p = scale(*p, 1.0 / reach));
    let enough = |unknowns: usize| local.len() >= unknowns + unknowns / 3;
    let mut fitted = None;
    if degree >= 4 && enough(15) {
        fitted = fit::<15>(&local);
    }
    if fitted.is_none() && degree >= 3 && enough(10) {
        fitted = fit::<10>(&local);
    }
    if fitted.is_none() && local.len() >= 6 {
        fitted = fit::<6>(&local);
    }
    Some(Fit {
        coefficients: fitted?,
        axes,
        reach,
    })
}

/// What a neighbour counts at this squared distance, the farthest being at 1: what the polynomial
/// cannot follow grows with the distance, and so does harm mostly there.
fn weight(squared: f64) -> f64 {
    (1.0 - 0.9 * squared) * (1.0 - 0.9 * squared)
}

/// Coefficients of 1, x, y, x^2, xy, y^2 of the polynomial with N terms that fits best.
fn fit<const N: usize>(points: &[Point]) -> Option<[f64; 6]> {
    let mut matrix = SMatrix::<f64, N, N>::zeros();
    let mut right = SVector::<f64, N>::zeros();
    for &[x, y, z] in points {
        let weight = weight(x * x + y * y);
        let terms = monomials::<N>(x, y);
        for (i, a) in terms.iter().enumerate() {
            for (j, b) in terms.iter().enumerate().take(i + 1) {
                matrix[(i, j)] += weight * a * b;
            }
            right[i] += weight * a * z;
        }
    }
    // Rows and columns are brought to a diagonal of 1; a pivot that then all but vanishes shows
    // that the points do not determine the polynomial.
    let scales: [f64; N] = std::array::from_fn(|i| matrix[(i, i)].sqrt().recip());
    for i in 0..N {
        for j in 0..=i {
            matrix[(i, j)] *= scales[i] * scales[j];
            matrix[(j, i)] = matrix[(i, j)];
        }
        right[i] *= scales[i];
    }
    let factor = matrix.cholesky()?;
    let lower = factor.l_dirty();
    if (0..N).any(|i| !(lower[(i, i)] > 1e-5)) {
        return None;
    }
    let solution = factor.solve(&right);
    let found: [f64; 6] = std::array::from_fn(|i| solution[i] * scales[i]);
    found.iter().all(|c| c.is_finite()).then_some(found)
}

/// 1, x, y, x^2, xy, y^2, then the higher degrees.
fn monomials<const N: usize>(x: f64, y: f64) -> [f64; N] {
    let (xx, xy, yy) = (x * x, x * y, y * y);
    let all = [
        1.0,
        x,
        y,
        xx,
        xy,
        yy,
        xx * x,
        xx * y,
        x * yy,
        yy * y,
        xx * xx,
        xx * xy,
        xx * yy,
        xy * yy,
        yy * yy,
    ];
    std::array::from_fn(|i| all[i])
}

/// Curvature of z = c1 x + c2 y + c3 x^2 + c4 xy + c5 y^2 at the origin, with z along the normal;
/// lengths were divided by `reach`.
fn of_graph([zx, zy, a, b, c]: [f64; 5], axes: [Point; 2], n: Point, reach: f64) -> Curvature {
    let long = 1.0 / (1.0 + zx * zx + zy * zy).sqrt() / reach;
    let [zxx, zxy, zyy] = [2.0 * a * long, b * long, 2.0 * c * long];
    // An orthonormal basis of the tangent plane: e1 = l11 (1, 0), e2 = l21 (1, 0) + l22 (0, 1),
    // by the Cholesky factor of the first fundamental form.
    let e = 1.0 + zx * zx;
    let (f, g) = (zx * zy, 1.0 + zy * zy);
    let l11 = 1.0 / e.sqrt();
    let l22 = 1.0 / (g - f * f / e).sqrt();
    let l21 = -f / e * l22;
    let s11 = -zxx * l11 * l11;
    let s12 = -(zxx * l21 + zxy * l22) * l11;
    let s22 = -(zxx * l21 * l21 + 2.0 * zxy * l21 * l22 + zyy * l22 * l22);
    let (principal, [cos, sin]) = eigen(s11, s12, s22);
    let direction = |p: f64, q: f64| {
        let (x, y) = (p * l11 + q * l21, q * l22);
        let flat = add(scale(axes[0], x), scale(axes[1], y));
        unit(add(flat, scale(n, zx * x + zy * y)))
    };
    Curvature {
        principal,
        directions: [direction(cos, sin), direction(-sin, cos)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_come_back() {
        let points: Vec<Point> = (0..40)
            .map(|i| {
                let (x, y) = (f64::from(i % 7) / 3.0 - 1.0, f64::from(i / 7) / 3.0 - 1.0);
                let low = 0.1 + 0.2 * x - 0.3 * y + 0.4 * x * x - 0.5 * x * y + 0.6 * y * y;
                [x, y, low + 0.7 * x * x * x - 0.2 * y * y * x * x]
            })
            .collect();
        let found = fit::<15>(&points).unwrap();
        for (found, truth) in found.iter().zip([0.1, 0.2, -0.3, 0.4, -0.5, 0.6]) {
            assert!((found - truth).abs() < 1e-10, "{found} {truth}");
        }
    }

    #[test]
    fn points_on_a_line_determine_nothing() {
        let points: Vec<Point> = (0..30).map(|i| [f64::from(i) / 30.0, 0.0, 0.1]).collect();
        assert!(fit::<6>(&points).is_none());
    }

    #[test]
    fn a_tilted_graph_has_the_curvature_of_its_surface() {
        // A sphere of radius 1 over (0.5, 0): z' and z'' of sqrt(1 - x^2 - y^2).
        let w = 0.75f64.sqrt();
        let zx = -0.5 / w;
        let zxx = -1.0 / w - 0.25 / (w * w * w);
        let zyy = -1.0 / w;
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let one = of_graph(
            [zx, 0.0, zxx / 2.0, 0.0, zyy / 2.0],
            axes,
            [0.0, 0.0, 1.0],
            1.0,
        );
        assert!((one.principal[0] - 1.0).abs() < 1e-12 && (one.principal[1] - 1.0).abs() < 1e-12);
    }
}
