//! Polygons and masks as regions.

use crate::bands::Bands;
use crate::flat::{Edge, Flat, Inside, ring};
use puncta_sdk::{Failure, ImageInfo};

/// The region inside a closed chain of corners, in either direction. The first corner may be
/// repeated at the end; corners that follow their equal are dropped.
///
/// # Errors
/// When fewer than three corners are left, one is not finite, sides cross or touch, or the area is 0.
pub fn polygon(x: &[f64], y: &[f64]) -> Result<Flat, Failure> {
    let mut corners: Vec<[f64; 2]> = Vec::new();
    for (row, (&x, &y)) in x.iter().zip(y).enumerate() {
        if !(x.is_finite() && y.is_finite()) {
            let message = "a corner of the outline has no finite position";
            return Err(Failure::bad_input(message).row(row as u64));
        }
        if corners.last() != Some(&[x, y]) {
            corners.push([x, y]);
        }
    }
    if corners.len() > 1 && corners.first() == corners.last() {
        corners.pop();
    }
    if corners.len() < 3 {
        let message = format!("the outline has {} different corners", corners.len());
        return Err(Failure::bad_input(message).remedy("give three or more"));
    }
    // Areas and crossings are found from the first corner, so that far shapes keep their digits.
    let origin = corners[0];
    let near: Vec<[f64; 2]> = corners
        .iter()
        .map(|c| [c[0] - origin[0], c[1] - origin[1]])
        .collect();
    if let Some((one, two)) = crossing(&ring(&near)) {
        let message = format!(
            "the outline crosses or touches itself: sides {} and {}",
            one + 1,
            two + 1
        );
        return Err(Failure::bad_input(message).remedy("draw it anew without crossings"));
    }
    let cross = |edge: &Edge| edge.from[0] * edge.to[1] - edge.from[1] * edge.to[0];
    let area: f64 = ring(&near).iter().map(cross).sum::<f64>() / 2.0;
    if area == 0.0 || !area.is_finite() {
        return Err(Failure::bad_input("the outline has no area"));
    }
    if area < 0.0 {
        corners.reverse();
    }
    let edges = ring(&corners);
    let end = |a: usize, pick: fn(f64, f64) -> f64| {
        corners.iter().map(|c| c[a]).fold(corners[0][a], pick)
    };
    Ok(Flat {
        bands: Bands::new(&edges),
        edges,
        area: area.abs(),
        low: [end(0, f64::min), end(1, f64::min)],
        high: [end(0, f64::max), end(1, f64::max)],
        inside: Inside::Polygon,
    })
}

/// Two edges of a ring that meet elsewhere than at their common corner.
fn crossing(edges: &[Edge]) -> Option<(usize, usize)> {
    let ends = |edge: &Edge| (edge.from[0].min(edge.to[0]), edge.from[0].max(edge.to[0]));
    let mut order: Vec<usize> = (0..edges.len()).collect();
    order.sort_by(|a, b| ends(&edges[*a]).0.total_cmp(&ends(&edges[*b]).0));
    let mut active: Vec<usize> = Vec::new();
    for &one in &order {
        let (low, _) = ends(&edges[one]);
        active.retain(|other| ends(&edges[*other]).1 >= low);
        for &two in &active {
            let (first, second) = (one.min(two), one.max(two));
            let follows = first + 1 == second;
            let wraps = first == 0 && second == edges.len() - 1;
            let meets = if follows {
                folds(&edges[first], &edges[second])
            } else if wraps {
                folds(&edges[second], &edges[first])
            } else {
                meet(&edges[first], &edges[second])
            };
            if meets {
                return Some((first, second));
            }
        }
        active.push(one);
    }
    None
}

/// Twice the signed area of a triangle.
fn turn(a: &[f64; 2], b: &[f64; 2], c: &[f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether an edge runs back over the one before it.
fn folds(before: &Edge, after: &Edge) -> bool {
    let along = (0..2).map(|a| (before.to[a] - before.from[a]) * (after.to[a] - after.from[a]));
    turn(&before.from, &before.to, &after.to) == 0.0 && along.sum::<f64>() < 0.0
}

fn meet(one: &Edge, two: &Edge) -> bool {
    let on = |edge: &Edge, p: &[f64; 2]| {
        (0..2).all(|a| edge.from[a].min(edge.to[a]) <= p[a] && p[a] <= edge.from[a].max(edge.to[a]))
    };
    let (a, b) = (
        turn(&one.from, &one.to, &two.from),
        turn(&one.from, &one.to, &two.to),
    );
    let (c, d) = (
        turn(&two.from, &two.to, &one.from),
        turn(&two.from, &two.to, &one.to),
    );
    if ((a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0))
        && ((c > 0.0 && d < 0.0) || (c < 0.0 && d > 0.0))
    {
        return true;
    }
    (a == 0.0 && on(one, &two.from))
        || (b == 0.0 && on(one, &two.to))
        || (c == 0.0 && on(two, &one.from))
        || (d == 0.0 && on(two, &one.to))
}

/// The region of the pixels above 0.5 of an image of one plane, x fastest.
///
/// # Errors
/// When the image is not one plane, or no pixel is above 0.5.
pub fn mask(info: &ImageInfo, values: &[f64]) -> Result<Flat, Failure> {
    let [t, c, z, height, width] = info.size.map(|n| n as usize);
    if t * c * z != 1 || width * height != values.len() || values.len() >= u32::MAX as usize {
        let message = "the mask is not an image of one plane, one channel and one time";
        return Err(Failure::bad_input(message).remedy("take one plane of it"));
    }
    let pixels: Vec<bool> = values.iter().map(|value| *value > 0.5).collect();
    let set: Vec<u32> = (0..)
        .zip(&pixels)
        .filter(|(_, set)| **set)
        .map(|(i, _)| i)
        .collect();
    if set.is_empty() {
        let message = "the mask has no pixel above 0.5";
        return Err(Failure::bad_input(message).remedy("check its values"));
    }
    let [_, side_y, side_x] = info.voxel;
    let [_, low_y, low_x] = info.origin;
    let at = |i: usize, j: usize| [low_x + i as f64 * side_x, low_y + j as f64 * side_y];
    let is = |i: usize, j: usize| i < width && j < height && pixels[j * width + i];
    let mut edges = Vec::new();
    // Between each two rows and columns: 1 where the region begins, -1 where it ends.
    let step = |before: bool, after: bool| i8::from(after) - i8::from(before);
    for j in 0..=height {
        let steps = (0..width).map(|i| step(j > 0 && is(i, j - 1), is(i, j)));
        runs(steps, |from, to, up| {
            edges.push(directed(at(from, j), at(to, j), up));
        });
    }
    for i in 0..=width {
        let steps = (0..height).map(|j| step(i > 0 && is(i - 1, j), is(i, j)));
        runs(steps, |from, to, up| {
            edges.push(directed(at(i, from), at(i, to), !up));
        });
    }
    Ok(Flat {
        bands: Bands::new(&edges),
        edges,
        area: set.len() as f64 * side_x * side_y,
        low: at(0, 0),
        high: at(width, height),
        inside: Inside::Mask {
            shape: [width, height],
            side: [side_x, side_y],
            pixels,
            set,
        },
    })
}

fn directed(from: [f64; 2], to: [f64; 2], forward: bool) -> Edge {
    if forward {
        Edge { from, to }
    } else {
        Edge { from: to, to: from }
    }
}

/// Runs of equal steps other than 0: where each begins and ends, and whether it is a rise.
fn runs(steps: impl Iterator<Item = i8>, mut found: impl FnMut(usize, usize, bool)) {
    let (mut begin, mut last) = (0, 0);
    for (i, step) in steps.chain([0]).enumerate() {
        if step != last {
            if last != 0 {
                found(begin, i, last > 0);
            }
            (begin, last) = (i, step);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flat::tests::{letter, shares_are_right};
    use crate::window::Window;

    #[test]
    fn areas_and_directions() {
        assert_eq!(letter(0.0).area, 607_500.0);
        assert_eq!(letter(1e7).area, 607_500.0);
        let (x, y) = ([0.0, 0.0, 4.0, 4.0, 0.0], [0.0, 3.0, 3.0, 0.0, 0.0]);
        let turned = polygon(&x, &y).expect("valid");
        assert_eq!((turned.area, turned.edges.len()), (12.0, 4));
        assert!(turned.holds(&[1.0, 1.0]) && !turned.holds(&[5.0, 1.0]));
    }

    #[test]
    fn bad_outlines_are_refused() {
        let refused = |x: &[f64], y: &[f64], say: &str| {
            let failure = polygon(x, y).expect_err(say).to_string();
            assert!(failure.contains(say), "{failure}");
        };
        refused(
            &[0.0, 4.0, 0.0, 4.0],
            &[0.0, 4.0, 4.0, 0.0],
            "crosses or touches itself",
        );
        refused(
            &[0.0, 4.0, 2.0],
            &[0.0, 0.0, 0.0],
            "crosses or touches itself",
        );
        refused(
            &[0.0, 4.0, 4.0, 2.0, 1.0, 0.0],
            &[0.0, 0.0, 4.0, 0.0, 4.0, 4.0],
            "crosses or touches itself",
        );
        refused(&[0.0, 4.0, 4.0, 0.0], &[0.0, 0.0, 0.0, 0.0], "corners");
        refused(&[], &[], "0 different corners");
        refused(
            &[0.0, 1.0, f64::NAN],
            &[0.0, 1.0, 0.0],
            "no finite position",
        );
    }

    fn info(size: [u64; 5]) -> ImageInfo {
        let mut info = ImageInfo::plane(size[4], size[3], 100.0, -200.0, 500.0);
        info.size = size;
        info
    }

    #[test]
    fn masks_have_holes_and_parts() {
        #[rustfmt::skip]
        let values = [
            1.0, 1.0, 1.0, 0.0, 1.0,
            1.0, 0.0, 1.0, 0.0, 0.0,
            1.0, 1.0, 1.0, 1.0, 0.0,
            0.0, 0.0, 0.0, 0.0, 1.0,
        ];
        let region = mask(&info([1, 1, 1, 4, 5]), &values).expect("valid");
        assert_eq!(region.area, 11.0 * 1e4);
        assert!(region.holds(&[-150.0, 550.0]) && !region.holds(&[-50.0, 650.0]));
        let around: f64 = region
            .edges
            .iter()
            .map(|e| (e.to[0] - e.from[0]) * e.from[1])
            .sum();
        assert_eq!(-around, region.area);
        shares_are_right(&region, 200);
    }

    #[test]
    fn bad_masks_are_refused() {
        assert!(mask(&info([1, 1, 2, 1, 1]), &[1.0; 2]).is_err());
        assert!(mask(&info([1, 1, 1, 2, 2]), &[0.5, f64::NAN, 0.0, -1.0]).is_err());
    }
}
