//! Rows inside a rectangle of the x y plane, turned about its centre. The boundary belongs to it.

use crate::mask::{Mask, WORD};
use crate::range::{Limits, Values, check_limits, range_mask};
use puncta_sdk::{Failure, Run};

/// A closed rectangle, lengths in nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Lowest and highest x before it is turned; a turned rectangle has finite sides.
    pub x: [f64; 2],
    /// Lowest and highest y before it is turned.
    pub y: [f64; 2],
    /// Turn about its centre, rad, positive from the x axis towards the y axis.
    pub angle: f64,
}

impl Rectangle {
    /// Checks the limits and the angle.
    ///
    /// # Errors
    /// When the rectangle is inverted, has a limit that is not a number, or is infinite and turned.
    pub fn check(&self) -> Result<(), Failure> {
        let Self { x, y, angle } = self;
        check_limits("x", x[0], x[1])?;
        check_limits("y", y[0], y[1])?;
        let finite = angle.is_finite() && x.iter().chain(y).all(|limit| limit.is_finite());
        if *angle != 0.0 && !finite {
            let message = "a turned rectangle needs a finite angle and finite limits of x and y";
            return Err(Failure::bad_parameter("angle", message));
        }
        Ok(())
    }
}

/// The rows whose point lies in the rectangle, its boundary included. NaN is never inside.
///
/// # Errors
/// A sentence when the rectangle is inverted, has a limit that is not a number, or is infinite and
/// turned, or when `x` and `y` differ in length; or cancelled.
pub fn rectangle_mask(
    x: &[f64],
    y: &[f64],
    rectangle: &Rectangle,
    run: &dyn Run,
) -> Result<Mask, Failure> {
    rectangle.check()?;
    let [x_low, x_high] = rectangle.x;
    let [y_low, y_high] = rectangle.y;
    if rectangle.angle == 0.0 {
        let limits = [
            Limits {
                name: "x",
                values: Values::F64(x),
                low: x_low,
                high: x_high,
            },
            Limits {
                name: "y",
                values: Values::F64(y),
                low: y_low,
                high: y_high,
            },
        ];
        return range_mask(x.len(), &limits, run);
    }
    let turned = Turned::new(rectangle);
    if x.len() != y.len() {
        let (rows, table) = (y.len(), x.len());
        return Err(Failure::bad_input(format!(
            "column y has {rows} rows, but the table has {table}"
        )));
    }
    Mask::build(x.len(), run, &|rows, words| {
        let x = x.get(rows.clone()).unwrap_or_default().chunks(WORD);
        let y = y.get(rows).unwrap_or_default().chunks(WORD);
        for (word, (x, y)) in words.iter_mut().zip(x.zip(y)) {
            let points = x.iter().zip(y).enumerate();
            *word = points.fold(0, |m, (i, (&x, &y))| {
                m | (u64::from(turned.holds(x, y)) << i)
            });
        }
    })
}

/// As [`rectangle_mask`], as strictly increasing row numbers.
///
/// # Errors
/// As [`rectangle_mask`].
pub fn rectangle_rows(
    x: &[f64],
    y: &[f64],
    rectangle: &Rectangle,
    run: &dyn Run,
) -> Result<Vec<u32>, Failure> {
    rectangle_mask(x, y, rectangle, run)?.rows(run)
}

/// The rectangle in its own frame: centre, half sides, turn.
struct Turned {
    centre: [f64; 2],
    half: [f64; 2],
    cos: f64,
    sin: f64,
}

impl Turned {
    fn new(rectangle: &Rectangle) -> Self {
        let Rectangle { x, y, angle } = *rectangle;
        let (sin, cos) = angle.sin_cos();
        let centre = [x, y].map(|[low, high]| low / 2.0 + high / 2.0);
        let half = [x, y].map(|[low, high]| high / 2.0 - low / 2.0);
        Self {
            centre,
            half,
            cos,
            sin,
        }
    }

    #[inline]
    fn holds(&self, x: f64, y: f64) -> bool {
        let (dx, dy) = (x - self.centre[0], y - self.centre[1]);
        let u = dx * self.cos + dy * self.sin;
        let v = dy * self.cos - dx * self.sin;
        (u.abs() <= self.half[0]) & (v.abs() <= self.half[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::Threads;
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

    const INF: f64 = f64::INFINITY;

    fn rows(x: &[f64], y: &[f64], rx: [f64; 2], ry: [f64; 2], angle: f64) -> Vec<u32> {
        let rectangle = Rectangle {
            x: rx,
            y: ry,
            angle,
        };
        let one = rectangle_rows(x, y, &rectangle, &Threads(1)).expect("valid");
        assert_eq!(
            rectangle_rows(x, y, &rectangle, &Threads(2)),
            Ok(one.clone())
        );
        one
    }

    /// A grid of points at the half-integers of a square of side `2 n` about the origin.
    fn grid(n: i32) -> (Vec<f64>, Vec<f64>) {
        let axis = || (-n..n).map(|i| f64::from(i) + 0.5);
        axis().flat_map(|y| axis().map(move |x| (x, y))).unzip()
    }

    #[test]
    fn an_upright_rectangle_holds_its_boundary() {
        let x = [0.0, 10.0, 10.0, 10.5, 5.0, f64::NAN, 5.0];
        let y = [0.0, 4.0, 4.1, 2.0, 2.0, 2.0, f64::NAN];
        assert_eq!(rows(&x, &y, [0.0, 10.0], [0.0, 4.0], 0.0), [0, 1, 4]);
        assert_eq!(rows(&x, &y, [0.0, INF], [-INF, INF], 0.0), [0, 1, 2, 3, 4]);
    }

    #[test]
    fn a_turned_rectangle_has_the_analytic_points() {
        // The unit diamond |x| + |y| <= d is a square of half side d / sqrt 2 turned by 45 degrees.
        let (x, y) = grid(300);
        let d = 250.25;
        let half = d / 2f64.sqrt();
        let found = rows(&x, &y, [-half, half], [-half, half], FRAC_PI_4);
        let expected: Vec<u32> = (0..x.len() as u32)
            .filter(|&i| x[i as usize].abs() + y[i as usize].abs() <= d)
            .collect();
        assert_eq!(found, expected);
        // 2 d^2 points of unit density.
        assert!((found.len() as f64 / (2.0 * d * d) - 1.0).abs() < 0.005);
    }

    #[test]
    fn quarter_and_half_turns_swap_and_keep_the_sides() {
        let (x, y) = grid(50);
        let upright = rows(&x, &y, [7.0, 41.0], [-20.0, 30.0], 0.0);
        assert_eq!(rows(&x, &y, [7.0, 41.0], [-20.0, 30.0], PI), upright);
        let swapped = rows(&x, &y, [-1.0, 49.0], [-12.0, 22.0], 0.0);
        assert_eq!(rows(&x, &y, [7.0, 41.0], [-20.0, 30.0], FRAC_PI_2), swapped);
        assert_eq!(swapped.len(), 50 * 34);
    }

    #[test]
    fn turning_points_and_rectangle_together_changes_nothing() {
        let (x, y) = grid(40);
        let (sin, cos) = 0.3f64.sin_cos();
        let (tx, ty): (Vec<f64>, Vec<f64>) = x
            .iter()
            .zip(&y)
            .map(|(x, y)| (x * cos - y * sin, x * sin + y * cos))
            .unzip();
        // Off the grid lines, so that rounding decides nothing.
        let (half_x, half_y) = (17.2, 9.3);
        let upright = rows(&x, &y, [-half_x, half_x], [-half_y, half_y], 0.0);
        assert_eq!(
            rows(&tx, &ty, [-half_x, half_x], [-half_y, half_y], 0.3),
            upright
        );
    }

    #[test]
    fn bad_rectangles_are_refused() {
        let refused = |rx, ry, angle| {
            let rectangle = Rectangle {
                x: rx,
                y: ry,
                angle,
            };
            rectangle_rows(&[1.0], &[1.0], &rectangle, &Threads(1)).is_err()
        };
        for angle in [0.0, 1.0] {
            assert!(refused([2.0, 1.0], [0.0, 1.0], angle));
            assert!(refused([0.0, 1.0], [0.0, f64::NAN], angle));
        }
        assert!(refused([0.0, INF], [0.0, 1.0], 1.0));
        assert!(refused([0.0, 1.0], [0.0, 1.0], f64::NAN));
        let rectangle = Rectangle {
            x: [0.0, 1.0],
            y: [0.0, 1.0],
            angle: 1.0,
        };
        assert!(rectangle_rows(&[1.0], &[], &rectangle, &Threads(1)).is_err());
        assert_eq!(
            rectangle_rows(&[], &[], &rectangle, &Threads(1)),
            Ok(vec![])
        );
    }
}
