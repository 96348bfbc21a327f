//! In which of many polygons points lie, by strips across the plane.
//!
//! A point lies in an outline when a line from it to the left crosses the outline's rings an odd
//! number of times. So holes are outside, and a polygon that crosses itself has a defined inside.
//! A vertex belongs to the edge above it, so that polygons that share an edge share no point.

use puncta_sdk::Failure;

/// Most entries of the strips for each edge.
const ENTRIES: f64 = 8.0;

/// An edge, its lower end first.
#[derive(Clone, Copy, Debug)]
struct Edge {
    outline: i32,
    low: [f64; 2],
    high: [f64; 2],
}

/// Outlines, sorted into strips of y.
#[derive(Debug)]
pub struct Polygons {
    bottom: f64,
    height: f64,
    /// Edges of each strip, by outline.
    strips: Vec<Vec<Edge>>,
}

impl Polygons {
    /// Outlines from vertices: those with the same outline and ring that follow each other are a
    /// closed polygon. Outlines below 1 are left out.
    ///
    /// # Errors
    /// When a vertex is not finite, with its row.
    pub fn new(outlines: &[f64], rings: &[f64], x: &[f64], y: &[f64]) -> Result<Polygons, Failure> {
        let mut edges = Vec::new();
        let mut start = 0;
        for row in 0..x.len() {
            if !(x[row].is_finite() && y[row].is_finite()) {
                return Err(
                    Failure::bad_input("an outline has a vertex without a position")
                        .row(row as u64 + 1)
                        .remedy("remove the outline, or read the file with another column mapping"),
                );
            }
            #[allow(clippy::float_cmp)]
            let same = |a: usize, b: usize| outlines[a] == outlines[b] && rings[a] == rings[b];
            if row + 1 == x.len() || !same(row, row + 1) {
                if outlines[row] >= 1.0 && outlines[row] <= f64::from(i32::MAX) {
                    #[allow(clippy::cast_possible_truncation)]
                    let outline = outlines[row] as i32;
                    ring(outline, &x[start..=row], &y[start..=row], &mut edges);
                }
                start = row + 1;
            }
        }
        Ok(Polygons::sorted(edges))
    }

    fn sorted(mut edges: Vec<Edge>) -> Polygons {
        edges.sort_by_key(|edge| edge.outline);
        let bottom = edges
            .iter()
            .map(|edge| edge.low[1])
            .fold(f64::INFINITY, f64::min);
        let top = edges
            .iter()
            .map(|edge| edge.high[1])
            .fold(f64::NEG_INFINITY, f64::max);
        let long: f64 = edges.iter().map(|edge| edge.high[1] - edge.low[1]).sum();
        // As many strips as there are edges, unless tall edges would be in too many of them.
        let count = edges.len().max(1) as f64;
        let most = ENTRIES * count * (top - bottom) / long.max(f64::MIN_POSITIVE);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let strips = count.min(most).clamp(1.0, 1e7) as usize;
        let mut polygons = Polygons {
            bottom,
            height: (top - bottom) / strips as f64,
            strips: vec![Vec::new(); strips],
        };
        for edge in edges {
            for strip in polygons.strip(edge.low[1])..=polygons.strip(edge.high[1]) {
                polygons.strips[strip].push(edge);
            }
        }
        polygons
    }

    fn strip(&self, y: f64) -> usize {
        let place = (y - self.bottom) / self.height;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let place = place as usize;
        place.min(self.strips.len() - 1)
    }

    /// The lowest number of the outlines that a point lies in; 0 if in none.
    #[must_use]
    pub fn find(&self, x: f64, y: f64) -> i32 {
        if !(x.is_finite() && y >= self.bottom) {
            return 0;
        }
        let (mut outline, mut odd) = (0, false);
        for edge in &self.strips[self.strip(y)] {
            if edge.outline != outline {
                if odd {
                    return outline;
                }
                (outline, odd) = (edge.outline, false);
            }
            if y >= edge.low[1] && y < edge.high[1] {
                let along = (y - edge.low[1]) / (edge.high[1] - edge.low[1]);
                odd ^= edge.low[0] + along * (edge.high[0] - edge.low[0]) <= x;
            }
        }
        if odd { outline } else { 0 }
    }
}

fn ring(outline: i32, x: &[f64], y: &[f64], edges: &mut Vec<Edge>) {
    for at in 0..x.len() {
        let next = (at + 1) % x.len();
        let (a, b) = ([x[at], y[at]], [x[next], y[next]]);
        let (low, high) = if a[1] < b[1] { (a, b) } else { (b, a) };
        if low[1] < high[1] {
            edges.push(Edge { outline, low, high });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    fn find(vertices: &[[f64; 4]], points: &[[f64; 2]]) -> Vec<i32> {
        let column = |k: usize| vertices.iter().map(|v| v[k]).collect::<Vec<_>>();
        let polygons = Polygons::new(&column(0), &column(1), &column(2), &column(3)).unwrap();
        points.iter().map(|p| polygons.find(p[0], p[1])).collect()
    }

    #[test]
    fn squares_with_holes_and_shared_edges() {
        let square = |outline: f64, ring: f64, low: f64, high: f64, left: f64| {
            [[low, low], [high, low], [high, high], [low, high]]
                .map(|[x, y]| [outline, ring, x + left, y])
        };
        let mut vertices = square(1.0, 0.0, 0.0, 10.0, 0.0).to_vec();
        vertices.extend(square(1.0, 1.0, 4.0, 6.0, 0.0));
        vertices.extend(square(7.0, 0.0, 0.0, 10.0, 10.0));
        vertices.extend(square(9.0, 0.0, 0.0, 10.0, 12.0));
        let points = [
            [1.0, 1.0],
            [5.0, 5.0],
            [10.0, 5.0],
            [15.0, 3.0],
            [21.0, 3.0],
            [-1.0, 5.0],
        ];
        assert_eq!(find(&vertices, &points), [1, 0, 7, 7, 9, 0]);
        let odd = [
            [3.0, 10.0],
            [3.0, f64::NAN],
            [f64::NAN, 3.0],
            [3.0, 1e300],
            [3.0, -1e300],
        ];
        assert_eq!(find(&vertices, &odd), [0; 5]);
        assert_eq!(find(&[], &points), [0; 6]);
    }

    #[test]
    fn a_polygon_that_crosses_itself_is_inside_where_it_winds_an_odd_number_of_times() {
        // A bow tie, and a star whose middle is outside.
        let bow = [[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]];
        let bow: Vec<[f64; 4]> = bow.iter().map(|v| [2.0, 0.0, v[0], v[1]]).collect();
        assert_eq!(find(&bow, &[[1.0, 5.0], [5.0, 1.0], [9.0, 5.0]]), [2, 0, 2]);
        let star: Vec<[f64; 4]> = (0..5)
            .map(|k| (f64::from(k) * 0.8 * std::f64::consts::PI).sin_cos())
            .map(|(sin, cos)| [3.0, 0.0, sin, cos])
            .collect();
        assert_eq!(
            find(&star, &[[0.0, 0.0], [0.0, 0.8], [0.0, -0.9]]),
            [0, 3, 0]
        );
    }

    #[test]
    fn many_triangles_are_those_of_brute_force() {
        let mut random = Random(12);
        let mut vertices = vec![];
        for outline in 1..400 {
            let (x, y) = (random.unit() * 1000.0, random.unit() * 1000.0);
            let tall = if outline % 50 == 0 { 900.0 } else { 80.0 };
            for _ in 0..3 {
                let (dx, dy) = (random.unit() * 80.0, random.unit() * tall);
                vertices.push([f64::from(outline), 0.0, x + dx, y + dy]);
            }
        }
        let points: Vec<[f64; 2]> = (0..3000)
            .map(|_| [random.unit() * 1000.0, random.unit() * 1000.0])
            .collect();
        let brute = |p: &[f64; 2]| -> i32 {
            let side = |a: &[f64; 4], b: &[f64; 4]| {
                (b[2] - a[2]) * (p[1] - a[3]) - (b[3] - a[3]) * (p[0] - a[2]) > 0.0
            };
            let inside = vertices.chunks(3).find(|t| {
                let sides = [side(&t[0], &t[1]), side(&t[1], &t[2]), side(&t[2], &t[0])];
                sides[0] == sides[1] && sides[1] == sides[2]
            });
            inside.map_or(0, |t| t[0][0] as i32)
        };
        let expected: Vec<i32> = points.iter().map(brute).collect();
        assert!(expected.iter().filter(|id| **id > 0).count() > 300);
        assert_eq!(find(&vertices, &points), expected);
    }

    #[test]
    fn a_vertex_without_a_position_is_refused_with_its_row() {
        let failure = Polygons::new(&[1.0; 3], &[0.0; 3], &[0.0, 1.0, f64::NAN], &[0.0; 3]);
        assert_eq!(failure.unwrap_err().row, Some(3));
    }
}
