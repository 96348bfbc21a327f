//! Making a sound mesh of any triangles.

use crate::check::{Defects, check, in_order, is_sliver, sorted_edges};
use crate::groups::Groups;
use crate::holes::fill_holes;
use crate::mesh::{Mesh, NONE, next, prev};
use crate::orient::{orient, turn_outward};
use crate::vector::{Point, finite, middle, squared, sub};
use crate::weld::weld;
use puncta_sdk::{Failure, Run};
use std::collections::HashSet;

/// What a repair may do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Repair {
    /// Vertices at most this far apart become one; 0 for those at the same place only.
    pub merge_distance: f64,
    /// Holes of up to this many edges are filled.
    pub fill_edges: usize,
    /// Whether closed components are turned to face outwards (those inside another: inwards).
    pub turn: bool,
}

impl Default for Repair {
    fn default() -> Repair {
        Repair {
            merge_distance: 0.0,
            fill_edges: 100,
            turn: true,
        }
    }
}

/// What a repair found and did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mended {
    /// Defects of the input.
    pub found: Defects,
    /// Vertices that became one with an earlier one.
    pub merged: usize,
    /// Triangles left out: an index that does not exist or a place that is not finite, a vertex
    /// twice (after merging), or the corners of an earlier triangle.
    pub dropped: usize,
    /// Triangles that were turned to face the side of their neighbours.
    pub turned: usize,
    /// Edges at which sheets were parted: of more than two triangles, or where a surface with one
    /// side only comes back to itself.
    pub parted: usize,
    /// Vertices that were added so that sheets that touch there have one each.
    pub copied: usize,
    /// Triangles without area of which the longest edge was turned.
    pub flattened: usize,
    /// Holes that were filled.
    pub filled: usize,
    /// Holes that are left.
    pub holes: usize,
    /// Closed components that were turned inside out.
    pub reversed: usize,
}

/// A mesh of the triangles that are sound, mended; for each of its vertices the one of the input
/// that it stands for ([`NONE`] for new ones); and what was done.
///
/// The order: triangles that cannot be used go; vertices are merged; winding is made the same over
/// each sheet, as most of its triangles have it; edges of more than two triangles are parted into
/// pairs that enclose something (Guéziec et al., IEEE TVCG 7, 2001); vertices at which sheets only
/// touch are copied; holes are filled; closed components are turned outwards.
///
/// # Errors
/// When there are too many triangles, the merge distance is no length, or cancelled.
pub fn repair(
    positions: &[Point],
    triangles: &[[u32; 3]],
    how: Repair,
    run: &dyn Run,
) -> Result<(Mesh, Vec<u32>, Mended), Failure> {
    if !(how.merge_distance >= 0.0 && how.merge_distance.is_finite()) {
        return Err(Failure::bad_input("the merge distance must be 0 or more"));
    }
    crate::build::check_size(positions.len(), triangles.len())?;
    run.progress(0.0, "checking the triangles")?;
    let mut mended = Mended {
        found: check(positions, triangles),
        ..Mended::default()
    };
    run.progress(0.2, "merging vertices")?;
    let stands = weld(positions, how.merge_distance);
    let own = |(i, first): (usize, &u32)| *first != i as u32;
    mended.merged = stands.iter().enumerate().filter(|item| own(*item)).count();
    let mut sound = usable(positions, triangles, &stands);
    mended.dropped = triangles.len() - sound.len();
    run.progress(0.4, "orienting the triangles")?;
    let twin = orient(positions, &mut sound, &mut mended);
    run.progress(0.6, "parting sheets")?;
    let (mut mesh, mut origin) = part(positions, &sound, twin, &mut mended);
    flatten(&mut mesh, &mut mended);
    run.progress(0.7, "filling holes")?;
    (mended.filled, mended.holes) = fill_holes(&mut mesh, how.fill_edges, run)?;
    if how.turn {
        run.progress(0.8, "turning components")?;
        mended.reversed = turn_outward(&mut mesh, run)?;
    }
    origin.resize(mesh.positions.len(), NONE);
    let kept = mesh.compact();
    let origin = kept.iter().map(|&v| origin[v as usize]).collect();
    Ok((mesh, origin, mended))
}

/// The triangles that can be used, their vertices merged.
fn usable(positions: &[Point], triangles: &[[u32; 3]], stands: &[u32]) -> Vec<[u32; 3]> {
    let mut seen = HashSet::with_capacity(triangles.len());
    let mut sound = Vec::with_capacity(triangles.len());
    for triangle in triangles {
        let there = |v: &u32| positions.get(*v as usize).is_some_and(|p| finite(*p));
        if !triangle.iter().all(there) {
            continue;
        }
        let merged = triangle.map(|v| stands[v as usize]);
        let [a, b, c] = merged;
        if a != b && b != c && c != a && seen.insert(in_order(merged)) {
            sound.push(merged);
        }
    }
    sound
}

/// The mesh in which each fan of triangles has a vertex of its own, and what each stands for.
fn part(
    positions: &[Point],
    triangles: &[[u32; 3]],
    twin: Vec<u32>,
    mended: &mut Mended,
) -> (Mesh, Vec<u32>) {
    let corners = triangles.as_flattened();
    let mut fans = Groups::new(corners.len());
    for (h, &twin) in (0..).zip(&twin) {
        if twin != NONE && h < twin {
            fans.join(h, next(twin));
            fans.join(next(h), twin);
        }
    }
    let mut roots: Vec<u32> = (0..corners.len() as u32)
        .filter(|&h| fans.find(h) == h)
        .collect();
    // In the order of the input.
    roots.sort_unstable_by_key(|&h| (corners[h as usize], h));
    let origin: Vec<u32> = roots.iter().map(|&h| corners[h as usize]).collect();
    mended.copied = origin.windows(2).filter(|pair| pair[0] == pair[1]).count();
    let mut number = vec![NONE; corners.len()];
    for (i, &h) in (0..).zip(&roots) {
        number[h as usize] = i;
    }
    let corner: Vec<u32> = (0..corners.len() as u32)
        .map(|h| number[fans.find(h) as usize])
        .collect();
    let mut mesh = Mesh {
        positions: origin.iter().map(|&v| positions[v as usize]).collect(),
        out: vec![NONE; origin.len()],
        vertices: origin.len(),
        triangles: triangles.len(),
        corner,
        twin,
    };
    for h in 0..mesh.half_edges() {
        let vertex = mesh.from(h) as usize;
        if mesh.out[vertex] == NONE || mesh.twin(h) == NONE {
            mesh.out[vertex] = h;
        }
    }
    separate(&mut mesh, mended);
    (mesh, origin)
}

/// Where a fan comes to the same vertex twice, all edges to it but one get a vertex midway.
fn separate(mesh: &mut Mesh, mended: &mut Mended) {
    let corners: Vec<[u32; 3]> = mesh.stored_triangles().to_vec();
    let mut twice = Vec::new();
    for edge in sorted_edges(&corners).chunk_by(|a, b| a.0 == b.0) {
        let first = edge[0].1;
        let other = |h: &u32| *h != first && *h != mesh.twin(first) && *h < mesh.twin(*h);
        twice.extend(edge.iter().map(|(_, h)| *h).filter(other));
    }
    for h in twice {
        let place = middle(mesh.position(mesh.from(h)), mesh.position(mesh.to(h)));
        if mesh.split(h, place).is_some() {
            mended.copied += 1;
        }
    }
}

/// Turns the longest edge of each triangle without area, if that leaves two that have some.
fn flatten(mesh: &mut Mesh, mended: &mut Mended) {
    let slivers: Vec<u32> = (0..mesh.half_edges() / 3)
        .filter(|&i| mesh.corners(i).is_some_and(is_sliver))
        .collect();
    for i in slivers {
        let Some(corners) = mesh.corners(i).filter(|corners| is_sliver(*corners)) else {
            continue;
        };
        let length = |side: usize| squared(sub(corners[(side + 1) % 3], corners[side]));
        let longest = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b)));
        let h = 3 * i + longest.unwrap_or(0) as u32;
        let twin = mesh.twin(h);
        if twin == NONE {
            continue;
        }
        let place = |h: u32| mesh.position(mesh.from(h));
        let (a, b, c, d) = (place(h), place(twin), place(prev(h)), place(prev(twin)));
        if !is_sliver([a, d, c]) && !is_sliver([d, b, c]) && mesh.flip(h) {
            mended.flattened += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;
    use crate::topology::{describe, euler};
    use puncta_sdk::run::Serial;
    use puncta_testkit::Stopped;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    fn mend(shape: &shapes::Shape, how: Repair) -> (Mesh, Mended) {
        let (mesh, origin, mended) = repair(&shape.0, &shape.1, how, &Serial).unwrap();
        mesh.verify().unwrap();
        assert_eq!(origin.len(), mesh.positions().len());
        for (&v, p) in origin.iter().zip(mesh.positions()) {
            assert!(v == NONE || squared(sub(shape.0[v as usize], *p)) < 1e-6);
        }
        let after = check(mesh.positions(), mesh.stored_triangles());
        let sound = Defects {
            degenerate: 0,
            ..after
        };
        assert!(sound.is_manifold(), "{after:?}");
        (mesh, mended)
    }

    #[test]
    fn triangle_soup_becomes_the_shape_again() {
        let (positions, triangles) = shapes::torus(10.0, 3.0, 20, 9);
        let corners: Vec<Point> = triangles
            .as_flattened()
            .iter()
            .map(|&v| positions[v as usize])
            .collect();
        let soup = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
        let mut shape = (corners, soup.collect::<Vec<_>>());
        let first = shape.1[0];
        shape
            .1
            .extend([[first[1], first[2], first[0]], [0, 0, 1], [0, 1, 9_999_999]]);
        shape.0[5] = [f64::NAN; 3];
        let (mesh, mended) = mend(&shape, Repair::default());
        assert_eq!((mended.dropped, mended.filled, mended.holes), (4, 1, 0));
        assert_eq!((euler(&mesh), mesh.vertex_count()), (0, 180));
    }

    #[test]
    fn near_vertices_are_merged_if_asked() {
        let (positions, triangles) = shapes::cube(10.0, 2);
        let corners = triangles.as_flattened().iter().enumerate();
        let shaken =
            corners.map(|(i, &v)| positions[v as usize].map(|x| x + 1e-4 * (i % 3) as f64));
        let indices = 0..triangles.len() as u32;
        let shape = (
            shaken.collect::<Vec<_>>(),
            indices
                .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
                .collect::<Vec<_>>(),
        );
        let how = Repair {
            merge_distance: 1e-3,
            ..Repair::default()
        };
        let (mesh, mended) = mend(&shape, how);
        assert_eq!(
            (euler(&mesh), mended.holes, mesh.vertex_count()),
            (2, 0, 26)
        );
    }

    #[test]
    fn random_triangles_always_give_a_mesh() {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        for round in 0..300_u32 {
            let vertices = 4 + random.next_u32() % 12;
            let place =
                |random: &mut ChaCha8Rng| [0; 3].map(|_: i32| f64::from(random.next_u32() % 4));
            let positions = (0..vertices).map(|_| place(&mut random)).collect();
            let count = random.next_u32() % 60;
            let mut corner = || random.next_u32() % (vertices + u32::from(round % 7 == 0));
            let triangles = (0..count).map(|_| [corner(), corner(), corner()]).collect();
            mend(&(positions, triangles), Repair::default());
        }
    }

    #[test]
    fn slivers_are_flattened() {
        let (mut positions, mut triangles) = shapes::cube(2.0, 1);
        // A corner on the edge between two corners, used by one side only.
        let edge = triangles[0];
        let place = middle(positions[edge[0] as usize], positions[edge[1] as usize]);
        let new = positions.len() as u32;
        positions.push(place);
        triangles[0] = [edge[0], new, edge[2]];
        triangles.push([new, edge[1], edge[2]]);
        triangles.push([edge[0], edge[1], new]);
        let (mesh, mended) = mend(&(positions, triangles), Repair::default());
        assert_eq!((mended.flattened, mended.holes), (1, 0));
        assert_eq!(
            check(mesh.positions(), mesh.stored_triangles()).degenerate,
            0
        );
        assert!((describe(&mesh).0[0].volume - 8.0).abs() < 1e-12);
    }

    #[test]
    fn nothing_and_bad_values() {
        let (mesh, mended) = mend(&(Vec::new(), Vec::new()), Repair::default());
        assert!(mesh.is_empty() && mended == Mended::default());
        let wrong = Repair {
            merge_distance: f64::INFINITY,
            ..Repair::default()
        };
        assert!(repair(&[], &[], wrong, &Serial).is_err());
        let cancelled = repair(&[], &[], Repair::default(), &Stopped).unwrap_err();
        assert!(cancelled.is_cancelled());
    }
}
