//! Delaunay tetrahedra of points in space.
//!
//! Points are inserted one after the other (Bowyer 1981, Watson 1981): the tetrahedra whose spheres
//! hold the new point are replaced by those between it and the faces about them. A face of the hull
//! has a tetrahedron to a point at infinity, so that no enclosing box is needed. Signs come from
//! exact predicates (Shewchuk 1997), so that rounding never breaks the mesh. The order is that of
//! Amenta, Choi and Rote (2003): random rounds of doubling size, along a space-filling curve in
//! each.

use puncta_sdk::{Cancelled, Run};
use robust::{Coord3D, insphere, orient3d};

/// The corner at infinity.
const INFINITE: u32 = u32::MAX;
/// No tetrahedron.
const NONE: u32 = u32::MAX;
/// Points between two looks at cancel.
const BATCH: usize = 256;
/// Bits of the curve along each axis.
const CURVE: u32 = 16;

/// A tetrahedron: corners in positive orientation, and the neighbour across the face opposite each.
#[derive(Clone, Copy)]
struct Cell {
    corners: [u32; 4],
    across: [u32; 4],
}

struct Mesh<'a> {
    points: &'a [[f64; 3]],
    cells: Vec<Cell>,
    /// The last point for which a cell was looked at: its number plus one, twice, and one more if
    /// its sphere holds it.
    marks: Vec<u64>,
    free: Vec<u32>,
    last: u32,
    /// Scratch of an insertion.
    cavity: Vec<u32>,
    border: Vec<(u32, u8)>,
    sides: Vec<(u64, u32, u8)>,
}

/// The tetrahedra of the points, as numbers of corners; none when all points lie in a plane. A point
/// that repeats an earlier one is no corner.
///
/// Coordinates must be finite, and their differences must not overflow when multiplied five times.
/// Where more than four points lie on a sphere, one of the possible meshes is given.
///
/// # Errors
/// When cancelled.
pub fn tetrahedra(points: &[[f64; 3]], run: &dyn Run) -> Result<Vec<[u32; 4]>, Cancelled> {
    let order = order(points);
    let Some(first) = first_four(points, &order) else {
        return Ok(Vec::new());
    };
    let mut mesh = Mesh::new(points, first);
    for (i, point) in order.iter().enumerate() {
        if i % BATCH == 0 && run.cancelled() {
            return Err(Cancelled);
        }
        if !first.contains(point) {
            mesh.insert(*point);
        }
    }
    // Cells that are free have no finite corner.
    let finite = |cell: &&Cell| cell.corners.iter().all(|corner| *corner != INFINITE);
    Ok(mesh
        .cells
        .iter()
        .filter(finite)
        .map(|cell| cell.corners)
        .collect())
}

/// The order of insertion.
fn order(points: &[[f64; 3]]) -> Vec<u32> {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for point in points {
        for a in 0..3 {
            low[a] = low[a].min(point[a]);
            high[a] = high[a].max(point[a]);
        }
    }
    let side = (0..3)
        .map(|a| high[a] - low[a])
        .fold(f64::MIN_POSITIVE, f64::max);
    let scale = f64::from((1_u32 << CURVE) - 1) / side;
    let mut keys: Vec<(u64, u32)> = points
        .iter()
        .enumerate()
        .map(|(i, point)| {
            let cell: [u32; 3] = std::array::from_fn(|a| ((point[a] - low[a]) * scale) as u32);
            // A round has half the points of the next: the number of zeros of a mixed number.
            let mixed = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let round = u64::from((mixed ^ (mixed >> 32)).trailing_zeros().min(15));
            (((15 - round) << 48) | curve(cell), i as u32)
        })
        .collect();
    keys.sort_unstable();
    keys.into_iter().map(|(_, i)| i).collect()
}

/// Place along the Z-order curve.
fn curve(cell: [u32; 3]) -> u64 {
    let mut out = 0;
    for bit in 0..CURVE {
        for (a, place) in cell.iter().enumerate() {
            out |= u64::from((place >> bit) & 1) << (3 * bit + a as u32);
        }
    }
    out
}

/// Four points that are not in a plane, in positive orientation.
fn first_four(points: &[[f64; 3]], order: &[u32]) -> Option<[u32; 4]> {
    let at = |i: u32| points[i as usize];
    let a = *order.first()?;
    let b = *order.iter().find(|i| at(**i) != at(a))?;
    let across = |i: u32| {
        let (u, v) = (minus(at(b), at(a)), minus(at(i), at(a)));
        let cross = [
            u[1] * v[2] - u[2] * v[1],
            u[2] * v[0] - u[0] * v[2],
            u[0] * v[1] - u[1] * v[0],
        ];
        cross.iter().map(|c| c * c).sum::<f64>()
    };
    let c = *order.iter().find(|i| across(**i) > 0.0)?;
    let d = *order
        .iter()
        .find(|i| orientation([at(a), at(b), at(c), at(**i)]) != 0.0)?;
    let positive = orientation([at(a), at(b), at(c), at(d)]) > 0.0;
    Some(if positive { [a, b, c, d] } else { [b, a, c, d] })
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn coord([x, y, z]: [f64; 3]) -> Coord3D<f64> {
    Coord3D { x, y, z }
}

fn orientation([a, b, c, d]: [[f64; 3]; 4]) -> f64 {
    orient3d(coord(a), coord(b), coord(c), coord(d))
}

impl<'a> Mesh<'a> {
    fn new(points: &'a [[f64; 3]], first: [u32; 4]) -> Self {
        let mut mesh = Mesh {
            points,
            cells: Vec::with_capacity(8 * points.len()),
            marks: Vec::with_capacity(8 * points.len()),
            free: Vec::new(),
            last: 0,
            cavity: Vec::new(),
            border: Vec::new(),
            sides: Vec::new(),
        };
        mesh.cells.push(Cell {
            corners: first,
            across: [1, 2, 3, 4],
        });
        for i in 0..4 {
            // The infinite corner lies beyond the face: two others change places.
            let mut corners = first;
            corners[i] = INFINITE;
            let (j, k) = ((i + 1) % 4, (i + 2) % 4);
            corners.swap(j, k);
            let mut across = [0; 4];
            for (slot, corner) in corners.iter().enumerate() {
                if *corner != INFINITE {
                    let opposite = first.iter().position(|one| one == corner).unwrap_or(0);
                    across[slot] = opposite as u32 + 1;
                }
            }
            mesh.cells.push(Cell { corners, across });
        }
        mesh.marks.resize(5, 0);
        mesh
    }

    fn at(&self, corner: u32) -> [f64; 3] {
        self.points[corner as usize]
    }

    /// Orientation of a cell with one corner replaced by a point.
    fn side(&self, cell: &Cell, slot: usize, point: [f64; 3]) -> f64 {
        let corner = |i: usize| {
            if i == slot {
                point
            } else {
                self.at(cell.corners[i])
            }
        };
        orientation([corner(0), corner(1), corner(2), corner(3)])
    }

    /// Whether the sphere of a cell holds a point; beyond a face of the hull it is a half-space.
    fn holds(&self, cell: &Cell, point: [f64; 3]) -> bool {
        let infinite = cell.corners.iter().position(|corner| *corner == INFINITE);
        let Some(slot) = infinite else {
            let [a, b, c, d] = cell.corners.map(|corner| coord(self.at(corner)));
            return insphere(a, b, c, d, coord(point)) > 0.0;
        };
        let side = self.side(cell, slot, point);
        if side != 0.0 {
            return side > 0.0;
        }
        // In the plane of the face: as the tetrahedron on its other side.
        let inner = self.cells[cell.across[slot] as usize];
        self.holds(&inner, point)
    }

    /// The cell that holds a point, or one of the hull that sees it.
    fn locate(&self, point: [f64; 3]) -> u32 {
        let mut here = self.last;
        let first = self.cells[here as usize];
        if let Some(slot) = first.corners.iter().position(|corner| *corner == INFINITE) {
            here = first.across[slot];
        }
        let mut from = NONE;
        'walk: loop {
            let cell = self.cells[here as usize];
            if cell.corners.contains(&INFINITE) {
                return here;
            }
            for slot in 0..4 {
                let next = cell.across[slot];
                if next != from && self.side(&cell, slot, point) < 0.0 {
                    (from, here) = (here, next);
                    continue 'walk;
                }
            }
            return here;
        }
    }

    fn insert(&mut self, point: u32) {
        let place = self.at(point);
        let start = self.locate(place);
        let mark = (u64::from(point) + 1) << 1;
        if !self.holds(&self.cells[start as usize], place) {
            // It repeats a corner.
            return;
        }
        self.cavity.clear();
        self.border.clear();
        self.cavity.push(start);
        self.marks[start as usize] = mark | 1;
        let mut next = 0;
        while let Some(here) = self.cavity.get(next).copied() {
            next += 1;
            for slot in 0..4 {
                let other = self.cells[here as usize].across[slot];
                let seen = self.marks[other as usize];
                let held = if seen | 1 == mark | 1 {
                    seen & 1 == 1
                } else {
                    let held = self.holds(&self.cells[other as usize], place);
                    self.marks[other as usize] = mark | u64::from(held);
                    if held {
                        self.cavity.push(other);
                    }
                    held
                };
                if !held {
                    self.border.push((here, slot as u8));
                }
            }
        }
        self.fill(point);
    }

    /// Replaces the cavity by cells between the point and the faces about it.
    fn fill(&mut self, point: u32) {
        self.sides.clear();
        let border = std::mem::take(&mut self.border);
        for (old, slot) in &border {
            let (old, slot) = (self.cells[*old as usize], *slot as usize);
            let mut cell = old;
            cell.corners[slot] = point;
            cell.across = [NONE; 4];
            let outside = old.across[slot];
            cell.across[slot] = outside;
            let number = match self.free.pop() {
                Some(number) => {
                    self.cells[number as usize] = cell;
                    self.marks[number as usize] = 0;
                    number
                }
                None => {
                    self.cells.push(cell);
                    self.marks.push(0);
                    self.cells.len() as u32 - 1
                }
            };
            // The face is known by its corners, which both cells have.
            let beyond = &self.cells[outside as usize];
            let face = |corner: &u32| *corner != point && cell.corners.contains(corner);
            let back = beyond
                .corners
                .iter()
                .position(|corner| !face(corner))
                .unwrap_or(0);
            self.cells[outside as usize].across[back] = number;
            for j in (0..4).filter(|j| *j != slot) {
                let mut ends = (0..4)
                    .filter(|k| *k != slot && *k != j)
                    .map(|k| cell.corners[k]);
                let (a, b) = (ends.next().unwrap_or(0), ends.next().unwrap_or(0));
                let key = (u64::from(a.min(b)) << 32) | u64::from(a.max(b));
                self.sides.push((key, number, j as u8));
            }
            self.last = number;
        }
        self.sides.sort_unstable();
        for pair in self.sides.as_chunks::<2>().0 {
            let [(_, one, i), (_, other, j)] = *pair;
            self.cells[one as usize].across[i as usize] = other;
            self.cells[other as usize].across[j as usize] = one;
        }
        for old in &self.cavity {
            self.cells[*old as usize].corners = [INFINITE; 4];
            self.free.push(*old);
        }
        self.border = border;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_sdk::run::Serial;
    use puncta_testkit::Random;

    fn volume(points: &[[f64; 3]], cell: &[u32; 4]) -> f64 {
        let [a, b, c, d] = cell.map(|corner| points[corner as usize]);
        let (u, v, w) = (minus(b, a), minus(c, a), minus(d, a));
        let cross = [
            v[1] * w[2] - v[2] * w[1],
            v[2] * w[0] - v[0] * w[2],
            v[0] * w[1] - v[1] * w[0],
        ];
        (0..3).map(|i| u[i] * cross[i]).sum::<f64>().abs() / 6.0
    }

    fn random(count: usize, seed: u64) -> Vec<[f64; 3]> {
        let mut random = Random(seed);
        (0..count)
            .map(|_| std::array::from_fn(|_| random.unit()))
            .collect()
    }

    #[test]
    fn no_sphere_holds_another_point() {
        let points = random(120, 4);
        let cells = tetrahedra(&points, &Serial).unwrap();
        assert!(cells.len() > 400);
        for cell in &cells {
            let [a, b, c, d] = cell.map(|corner| coord(points[corner as usize]));
            assert!(orient3d(a, b, c, d) > 0.0);
            for (i, point) in points.iter().enumerate() {
                let own = cell.contains(&(i as u32));
                assert!(own || insphere(a, b, c, d, coord(*point)) <= 0.0);
            }
        }
    }

    #[test]
    fn the_tetrahedra_fill_the_hull_once() {
        let mut points = random(2000, 5);
        for corner in 0..8 {
            points.push(std::array::from_fn(|a| f64::from((corner >> a) & 1)));
        }
        let cells = tetrahedra(&points, &Serial).unwrap();
        let sum: f64 = cells.iter().map(|cell| volume(&points, cell)).sum();
        assert!((sum - 1.0).abs() < 1e-9, "{sum}");
        let mut used = vec![false; points.len()];
        cells
            .iter()
            .flatten()
            .for_each(|corner| used[*corner as usize] = true);
        assert!(used.iter().all(|used| *used));
        // About 6.77 tetrahedra a point inside (Miles 1972), fewer at the hull.
        let each = cells.len() as f64 / points.len() as f64;
        assert!((6.0..6.8).contains(&each), "{each}");
    }

    #[test]
    fn lattices_repeats_and_planes_are_no_trouble() {
        let lattice: Vec<[f64; 3]> = (0..343)
            .map(|i| [f64::from(i % 7), f64::from(i / 7 % 7), f64::from(i / 49)])
            .collect();
        let twice: Vec<[f64; 3]> = lattice.iter().chain(&lattice).copied().collect();
        let cells = tetrahedra(&twice, &Serial).unwrap();
        let sum: f64 = cells.iter().map(|cell| volume(&twice, cell)).sum();
        assert!((sum - 216.0).abs() < 1e-9, "{sum}");
        let plane: Vec<[f64; 3]> = lattice[..49].to_vec();
        assert!(tetrahedra(&plane, &Serial).unwrap().is_empty());
        for few in 0..4 {
            assert!(tetrahedra(&random(few, 1), &Serial).unwrap().is_empty());
        }
        assert_eq!(tetrahedra(&random(4, 1), &Serial).unwrap().len(), 1);
    }
}
