//! Rotations in three dimensions.

use puncta_shared_vector::{Point, dot};

/// A rotation matrix, by rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotation(pub [Point; 3]);

impl Rotation {
    /// No rotation.
    pub const NONE: Self = Self([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);

    /// By `angle` rad about the z axis, positive from x towards y.
    pub fn about_z(angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    }

    /// Uniform over all rotations for `u` uniform in the unit cube (Shoemake, Graphics Gems III,
    /// 1992, "Uniform random rotations").
    pub fn uniform(u: Point) -> Self {
        let (s1, c1) = (std::f64::consts::TAU * u[1]).sin_cos();
        let (s2, c2) = (std::f64::consts::TAU * u[2]).sin_cos();
        let (a, b) = ((1.0 - u[0]).sqrt(), u[0].sqrt());
        let (x, y, z, w) = (a * s1, a * c1, b * s2, b * c2);
        Self([
            [
                1.0 - 2.0 * (y * y + z * z),
                2.0 * (x * y - z * w),
                2.0 * (x * z + y * w),
            ],
            [
                2.0 * (x * y + z * w),
                1.0 - 2.0 * (x * x + z * z),
                2.0 * (y * z - x * w),
            ],
            [
                2.0 * (x * z - y * w),
                2.0 * (y * z + x * w),
                1.0 - 2.0 * (x * x + y * y),
            ],
        ])
    }

    /// The rotated vector.
    #[inline]
    pub fn apply(&self, v: Point) -> Point {
        self.0.map(|row| dot(row, v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream, unit};
    use puncta_shared_vector::{cross, norm, sub};

    #[test]
    fn rotations_are_orthogonal_and_right_handed() {
        let rotations = [Rotation::about_z(0.7), Rotation::uniform([0.3, 0.9, 0.1])];
        for r in rotations {
            let [x, y, z] = r.0;
            for (a, b, expected) in [
                (x, x, 1.0),
                (y, y, 1.0),
                (z, z, 1.0),
                (x, y, 0.0),
                (y, z, 0.0),
            ] {
                assert!((dot(a, b) - expected).abs() < 1e-14);
            }
            assert!(norm(sub(cross(x, y), z)) < 1e-14);
        }
        let quarter = Rotation::about_z(std::f64::consts::FRAC_PI_2);
        assert!(norm(sub(quarter.apply([1.0, 0.0, 5.0]), [0.0, 1.0, 5.0])) < 1e-15);
    }

    #[test]
    fn uniform_rotations_turn_an_axis_to_every_direction_alike() {
        let mut random = stream(1, Purpose::Arrangement, false, 0);
        let mut bins = [0f64; 32];
        for _ in 0..32_000 {
            let u = [unit(&mut random), unit(&mut random), unit(&mut random)];
            let v = Rotation::uniform(u).apply([0.6, 0.0, 0.8]);
            // Height and azimuth of a uniform direction are uniform (Archimedes).
            let height = ((v[2] + 1.0) * 4.0) as usize;
            let azimuth = usize::from(v[0] > 0.0) + 2 * usize::from(v[1] > 0.0);
            bins[height.min(7) * 4 + azimuth] += 1.0;
        }
        let statistic: f64 = bins.iter().map(|n| (n - 1000.0).powi(2) / 1000.0).sum();
        // 31 degrees of freedom: 0.001 and 0.999 quantiles.
        assert!((11.9..61.1).contains(&statistic), "{statistic}");
    }
}
