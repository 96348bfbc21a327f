//! The pixel grid of an image: which pixel holds a position.
//!
//! Pixel `i` of an axis spans `offset + [first + i, first + i + 1) * size`, where each edge is the
//! product rounded once to f64. An automatic field of view has `offset = 0`: the grid is the same
//! for every table, so that a shift of all positions by whole pixels gives the same pixels bit for
//! bit.

/// 1.5 * 2^52: adding it rounds an f64 below 2^51 in magnitude to an integer, kept in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// Largest index of a pixel counted from the origin of the absolute grid.
const LARGEST_INDEX: f64 = (1_u64 << 40) as f64;

/// One axis of the pixel grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    offset: f64,
    first: f64,
    size: f64,
    inverse: f64,
    count: usize,
    low: f64,
    high: f64,
}

impl Axis {
    /// The axis whose low corner is exactly `origin` (nm), `count` pixels of `size` nm.
    ///
    /// None when `size` is not positive and finite, `origin` not finite or `count` 0.
    pub fn at(origin: f64, size: f64, count: usize) -> Option<Self> {
        Self::new(origin, 0.0, size, count)
    }

    /// The pixels of the absolute grid (edges at whole multiples of `size`) that cover `min..=max`.
    /// At least one pixel.
    ///
    /// None when an argument is not finite, `size` is not positive, `max < min`, or an index leaves
    /// 2^40.
    pub fn covering(min: f64, max: f64, size: f64) -> Option<Self> {
        let grid = Self::new(0.0, 0.0, size, 1)?;
        let (first, last) = (grid.floor(min)?, grid.floor(max)?);
        let count = if max >= min {
            (last - first) as usize + 1
        } else {
            0
        };
        Self::new(0.0, first, size, count)
    }

    /// The pixels from `min` (exactly) to the one that holds `max`.
    ///
    /// None when an argument is not finite, `size` is not positive, `max < min`, or there are more
    /// than 2^40.
    pub fn reaching(min: f64, max: f64, size: f64) -> Option<Self> {
        let last = Self::new(min, 0.0, size, 1)?.floor(max)?;
        let count = if max >= min { last as usize + 1 } else { 0 };
        Self::new(min, 0.0, size, count)
    }

    /// The axis from `min` (exactly) as far as needed to reach `max`. A last pixel that would be
    /// needed for less than a millionth of its size is left out.
    ///
    /// None when an argument is not finite, `size` is not positive or `max <= min`.
    pub fn between(min: f64, max: f64, size: f64) -> Option<Self> {
        let pixels = (max - min) / size;
        if !(pixels > 0.0 && pixels < LARGEST_INDEX) {
            return None;
        }
        let nearest = pixels.round();
        let near = (pixels - nearest).abs() < 1e-6 && nearest > 0.0;
        let count = if near { nearest } else { pixels.ceil() };
        Self::new(min, 0.0, size, count as usize)
    }

    fn new(offset: f64, first: f64, size: f64, count: usize) -> Option<Self> {
        let last = first + count as f64;
        let low = first * size;
        let high = last * size;
        let sound = size > 0.0
            && size.is_finite()
            && (1.0 / size).is_finite()
            && offset.is_finite()
            && count > 0
            && first.abs() <= LARGEST_INDEX
            && last.abs() <= LARGEST_INDEX
            && (offset + low).is_finite()
            && (offset + high).is_finite()
            && low < high;
        sound.then_some(Self {
            offset,
            first,
            size,
            inverse: 1.0 / size,
            count,
            low,
            high,
        })
    }

    /// World position (nm) of the low corner of pixel 0.
    pub fn origin(&self) -> f64 {
        self.offset + self.low
    }

    /// Number of pixel 0 on the grid that the axis lies on: counted from 0 nm without a given bound,
    /// 0 where the axis starts at a bound.
    pub fn first(&self) -> i64 {
        self.first as i64
    }

    /// Size of a pixel in nm.
    pub fn size(&self) -> f64 {
        self.size
    }

    /// Number of pixels.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Index, counted from the grid's offset, of the pixel that holds `x`; None when it is not
    /// finite or leaves 2^40.
    fn floor(&self, x: f64) -> Option<f64> {
        // False for NaN too.
        let near = ((x - self.offset) * self.inverse).abs() < LARGEST_INDEX;
        near.then(|| self.index(x) + self.first)
    }

    /// Whether pixel `0..count` holds `x`. False for NaN.
    #[inline(always)]
    pub fn holds(&self, x: f64) -> bool {
        let d = x - self.offset;
        (d >= self.low) & (d < self.high)
    }

    /// Index of the pixel that holds `x`, as a whole f64; below 0 or from `count` on when it lies
    /// outside.
    ///
    /// The rounded quotient may be one too high but never too low, so that one comparison with the
    /// pixel's own edge makes it exact, and no floor instruction is needed. Meaningless when |x /
    /// size| exceeds 2^40.
    #[inline(always)]
    pub fn index(&self, x: f64) -> f64 {
        let d = x - self.offset;
        let near = ((d * self.inverse - self.first) + ROUND) - ROUND;
        let edge = (self.first + near) * self.size;
        near - f64::from(u8::from(d < edge))
    }

    /// Position in pixels from the low corner as fixed point with 32 fractional bits; None when it
    /// is not finite or more than 2^30 pixels away. The fraction is of the distance to the pixel's
    /// own edge: where that distance is exact (positions moved by whole pixels without rounding),
    /// so is the equality of the fractions.
    #[inline]
    pub fn fixed(&self, x: f64) -> Option<i64> {
        let q = (x - self.offset) * self.inverse - self.first;
        let near = q.abs() < (1_u64 << 30) as f64;
        if !near {
            return None;
        }
        let index = self.index(x);
        let rest = (x - self.offset) - (self.first + index) * self.size;
        let fraction = (rest * self.inverse * 4_294_967_296.0) as u32;
        Some(((index as i64) << 32) | i64::from(fraction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_belongs_to_the_pixel_above_it() {
        for size in [0.1, 0.3, 1.0, 3.0, 7.7, 10.0, 49.0, 130.0, 1e-3, 1.0 / 3.0] {
            let axis = Axis::covering(-1000.0 * size, 1000.0 * size, size).unwrap();
            for k in -1000_i32..=1000 {
                let edge = f64::from(k) * size;
                let i = f64::from(k) - axis.first;
                assert_eq!(axis.index(edge), i, "size {size} edge {k}");
                assert_eq!(
                    axis.index(edge.next_down()),
                    i - 1.0,
                    "size {size} below edge {k}"
                );
                assert_eq!(axis.index(edge.next_up()), i, "size {size} above edge {k}");
            }
        }
    }

    #[test]
    fn the_grid_is_absolute() {
        let axis = Axis::covering(12.0, 31.0, 10.0).unwrap();
        assert_eq!((axis.origin(), axis.count()), (10.0, 3));
        let axis = Axis::covering(-0.5, 30.0, 10.0).unwrap();
        assert_eq!((axis.origin(), axis.count()), (-10.0, 5));
        let axis = Axis::covering(12.0 - 25.0, 31.0 + 25.0, 10.0).unwrap();
        assert_eq!((axis.origin(), axis.count()), (-20.0, 8));
        let axis = Axis::covering(5.0, 5.0, 10.0).unwrap();
        assert_eq!((axis.origin(), axis.count()), (0.0, 1));
    }

    #[test]
    fn given_bounds_are_kept_exactly() {
        let axis = Axis::between(3.7, 3.7 + 0.1 * 30.0, 0.1).unwrap();
        assert_eq!((axis.origin(), axis.count()), (3.7, 30));
        assert_eq!(Axis::between(0.0, 31.0, 10.0).unwrap().count(), 4);
        assert!(!axis.holds(3.7_f64.next_down()));
        assert!(axis.holds(3.7));
    }

    #[test]
    fn what_is_no_grid_is_refused() {
        assert!(Axis::covering(0.0, 1.0, 0.0).is_none());
        assert!(Axis::covering(0.0, 1.0, -1.0).is_none());
        assert!(Axis::covering(0.0, 1.0, f64::NAN).is_none());
        assert!(Axis::covering(0.0, f64::INFINITY, 1.0).is_none());
        assert!(Axis::covering(0.0, 1e300, 1.0).is_none());
        assert!(Axis::covering(2.0, 1.0, 1.0).is_none());
        assert!(Axis::between(1.0, 1.0, 1.0).is_none());
        assert!(Axis::between(f64::NAN, 1.0, 1.0).is_none());
        assert!(Axis::at(0.0, 1.0, 0).is_none());
        assert!(
            Axis::at(1e300, 1e-5, 4).is_some_and(|a| a.count() == 4)
                || Axis::at(1e300, 1e-5, 4).is_none()
        );
    }

    #[test]
    fn fixed_point_holds_index_and_fraction() {
        let axis = Axis::covering(-95.0, 95.0, 10.0).unwrap();
        assert_eq!(axis.fixed(-100.0), Some(0));
        assert_eq!(axis.fixed(-97.5), Some(1 << 30));
        assert_eq!(axis.fixed(-105.0), Some(-(1 << 31)));
        assert_eq!(axis.fixed(f64::NAN), None);
        assert_eq!(axis.fixed(f64::INFINITY), None);
        assert_eq!(axis.fixed(1e300), None);
        assert_eq!(axis.fixed((-100.0_f64).next_down()), Some(-1));
    }
}
