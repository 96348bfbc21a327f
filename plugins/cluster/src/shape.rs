//! Centre, size and axes of the points of a cluster.

/// What the second moments say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments<const D: usize> {
    /// Mean position.
    pub centre: [f64; D],
    /// Standard deviation (n - 1) along the principal axes, largest first; NaN for a single point.
    pub sigma: [f64; D],
    /// Principal axes of length 1, the largest component positive.
    pub axes: [[f64; D]; D],
    /// Root of the mean square distance from the centre.
    pub gyration: f64,
}

/// Moments of at least one point.
#[must_use]
pub fn moments<const D: usize>(points: &[[f64; D]]) -> Moments<D> {
    let count = points.len() as f64;
    let origin = points.first().copied().unwrap_or([f64::NAN; D]);
    let mut mean = [0.0; D];
    for point in points {
        for axis in 0..D {
            mean[axis] += (point[axis] - origin[axis]) / count;
        }
    }
    let mut second = [[0.0; D]; D];
    for point in points {
        let d: [f64; D] = std::array::from_fn(|axis| point[axis] - origin[axis] - mean[axis]);
        for i in 0..D {
            for j in 0..D {
                second[i][j] += d[i] * d[j];
            }
        }
    }
    let trace: f64 = (0..D).map(|axis| second[axis][axis]).sum();
    let (values, axes) = eigen(second);
    Moments {
        centre: std::array::from_fn(|axis| origin[axis] + mean[axis]),
        sigma: values.map(|value| (value.max(0.0) / (count - 1.0)).sqrt()),
        axes,
        gyration: (trace / count).sqrt(),
    }
}

/// Eigenvalues and eigenvectors of a symmetric matrix, largest first, by Jacobi's rotations.
fn eigen<const D: usize>(mut matrix: [[f64; D]; D]) -> ([f64; D], [[f64; D]; D]) {
    let mut vectors = [[0.0; D]; D];
    for (axis, vector) in vectors.iter_mut().enumerate() {
        vector[axis] = 1.0;
    }
    for _ in 0..32 {
        for p in 0..D {
            for q in p + 1..D {
                if matrix[p][q] == 0.0 {
                    continue;
                }
                let theta = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for row in &mut matrix {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                turn(&mut matrix, [p, q], c, s);
                turn(&mut vectors, [p, q], c, s);
                matrix[p][q] = 0.0;
                matrix[q][p] = 0.0;
            }
        }
    }
    let mut order: [usize; D] = std::array::from_fn(|axis| axis);
    order.sort_by(|a, b| matrix[*b][*b].total_cmp(&matrix[*a][*a]));
    let signed = |vector: [f64; D]| {
        let largest = vector.iter().copied().fold(0.0_f64, |most, value| {
            if value.abs() > most.abs() + 1e-12 {
                value
            } else {
                most
            }
        });
        vector.map(|value| if largest < 0.0 { -value } else { value })
    };
    (
        order.map(|axis| matrix[axis][axis]),
        order.map(|axis| signed(vectors[axis])),
    )
}

/// Turns two rows, the first of which comes first.
fn turn<const D: usize>(rows: &mut [[f64; D]; D], [p, q]: [usize; 2], c: f64, s: f64) {
    let (before, after) = rows.split_at_mut(q);
    for (a, b) in before[p].iter_mut().zip(&mut after[0]) {
        (*a, *b) = (c * *a - s * *b, s * *a + c * *b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_moments_of_an_ellipse_of_points_are_its_axes() {
        let (sin, cos) = 0.6_f64.sin_cos();
        let at = |u: f64, v: f64| [1e6 + cos * u - sin * v, -3e5 + sin * u + cos * v];
        let points: Vec<[f64; 2]> = (0..100)
            .map(|k| (std::f64::consts::TAU * f64::from(k) / 100.0).sin_cos())
            .map(|(s, c)| at(30.0 * c, 10.0 * s))
            .collect();
        let found = moments(&points);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-7 * b.abs().max(1.0), "{a} {b}");
        near(found.centre[0], 1e6);
        near(found.centre[1], -3e5);
        // Of n points on an ellipse the mean square along an axis a is a^2 / 2.
        near(found.sigma[0], 30.0 * (50.0_f64 / 99.0).sqrt());
        near(found.sigma[1], 10.0 * (50.0_f64 / 99.0).sqrt());
        near(found.axes[0][0], cos);
        near(found.axes[0][1], sin);
        near(found.gyration, (500.0_f64).sqrt());
    }

    #[test]
    fn axes_in_space_are_those_of_a_turned_box() {
        let axes = [[0.6, 0.8, 0.0], [-0.48, 0.36, 0.8], [0.64, -0.48, 0.6]];
        let mut points = vec![];
        for k in 0..8 {
            let sign = |bit: i32| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let sides = [50.0 * sign(0), 20.0 * sign(1), 5.0 * sign(2)];
            points.push(std::array::from_fn(|axis| {
                (0..3).map(|k| sides[k] * axes[k][axis]).sum::<f64>()
            }));
        }
        let found = moments::<3>(&points);
        for (side, (sigma, (ours, axis))) in [50.0, 20.0, 5.0]
            .into_iter()
            .zip(found.sigma.iter().zip(found.axes.iter().zip(axes)))
        {
            assert!((sigma - side * (8.0_f64 / 7.0).sqrt()).abs() < 1e-9);
            let cosine: f64 = ours.iter().zip(axis).map(|(a, b)| a * b).sum();
            assert!((cosine.abs() - 1.0).abs() < 1e-12);
        }
        assert!(moments(&[[1.0, 2.0]]).sigma[0].is_nan());
    }
}
