//! Winding: the same over each sheet, and outwards.

use crate::check::sorted_edges;
use crate::mesh::{Mesh, NONE, next, prev};
use crate::repair::Mended;
use crate::topology::describe;
use crate::vector::{Point, along, cross, dot, norm, sub, unit};
use puncta_sdk::Cancelled;
use puncta_sdk::run::{Run, map};

/// Turns triangles so that neighbours face the same side, and pairs the half-edges of each edge;
/// gives the twin of each.
pub(crate) fn orient(
    positions: &[Point],
    triangles: &mut [[u32; 3]],
    mended: &mut Mended,
) -> Vec<u32> {
    let edges = sorted_edges(triangles);
    let groups: Vec<&[(u64, u32)]> = edges.chunk_by(|a, b| a.0 == b.0).collect();
    let mut beside = vec![NONE; triangles.len() * 3];
    for group in &groups {
        if let [(_, a), (_, b)] = group {
            beside[*a as usize] = *b;
            beside[*b as usize] = *a;
        }
    }
    let turned = sheets(triangles, &beside);
    for (triangle, &turn) in triangles.iter_mut().zip(&turned) {
        if turn {
            triangle.swap(1, 2);
            mended.turned += 1;
        }
    }
    // Turning (a, b, c) to (a, c, b) makes sides 0 and 2 exchange places.
    let place = |h: u32| {
        if turned[(h / 3) as usize] {
            3 * (h / 3) + 2 - h % 3
        } else {
            h
        }
    };
    let mut twin = vec![NONE; triangles.len() * 3];
    let corners = triangles.as_flattened();
    for group in groups {
        let sides: Vec<u32> = group.iter().map(|(_, h)| place(*h)).collect();
        let pairs = match sides[..] {
            [_] => continue,
            [a, b] if corners[a as usize] != corners[b as usize] => vec![(a, b)],
            _ => {
                mended.parted += 1;
                wedges(positions, corners, &sides)
            }
        };
        for (a, b) in pairs {
            twin[a as usize] = b;
            twin[b as usize] = a;
        }
    }
    twin
}

/// Which triangles to turn: each sheet, joined by edges of two triangles, is wound as most of it.
fn sheets(triangles: &[[u32; 3]], beside: &[u32]) -> Vec<bool> {
    let corners = triangles.as_flattened();
    let mut turn: Vec<Option<bool>> = vec![None; triangles.len()];
    for start in 0..triangles.len() {
        if turn[start].is_some() {
            continue;
        }
        turn[start] = Some(false);
        let mut sheet = vec![start];
        let mut i = 0;
        while i < sheet.len() {
            let triangle = sheet[i];
            i += 1;
            for h in 3 * triangle as u32..3 * triangle as u32 + 3 {
                let other = beside[h as usize];
                if other == NONE || turn[(other / 3) as usize].is_some() {
                    continue;
                }
                let same = corners[h as usize] == corners[other as usize];
                turn[(other / 3) as usize] = turn[triangle].map(|turn| turn != same);
                sheet.push((other / 3) as usize);
            }
        }
        let turned = sheet.iter().filter(|&&i| turn[i] == Some(true)).count();
        if 2 * turned > sheet.len() {
            for i in sheet {
                turn[i] = turn[i].map(|turn| !turn);
            }
        }
    }
    turn.into_iter().map(|turn| turn == Some(true)).collect()
}

/// Pairs of half-edges of one edge that enclose a wedge of the inside, around the edge.
fn wedges(positions: &[Point], corners: &[u32], sides: &[u32]) -> Vec<(u32, u32)> {
    let (a, b) = (corners[sides[0] as usize], corners[next(sides[0]) as usize]);
    let at = |v: u32| positions[v as usize];
    let axis = unit(sub(at(b), at(a)));
    let flat = |h: u32| {
        let across = sub(at(corners[prev(h) as usize]), at(a));
        along(across, axis, -dot(across, axis))
    };
    let start = unit(flat(sides[0]));
    let up = cross(axis, start);
    // Forward half-edges have the inside below them (at smaller angles), backward ones above.
    let mut around: Vec<(f64, u32, bool)> = sides
        .iter()
        .map(|&h| {
            let to = flat(h);
            (
                dot(to, up).atan2(dot(to, start)),
                h,
                corners[h as usize] == a,
            )
        })
        .collect();
    around.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut pairs = Vec::new();
    let mut paired = vec![false; around.len()];
    // Like brackets on a circle: each forward one closes the last backward one that is open.
    let mut open = Vec::new();
    for turn in 0..2 * around.len() {
        let i = turn % around.len();
        if paired[i] {
            continue;
        }
        if !around[i].2 {
            if turn < around.len() {
                open.push(i);
            }
        } else if let Some(j) = open.pop() {
            paired[i] = true;
            paired[j] = true;
            pairs.push((around[i].1, around[j].1));
        }
    }
    pairs
}

/// Turns closed components so that their volume is positive, or negative if they lie inside an odd
/// number of others; gives how many were turned.
pub(crate) fn turn_outward(mesh: &mut Mesh, run: &dyn Run) -> Result<usize, Cancelled> {
    let (components, of) = describe(mesh);
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); components.len()];
    for (i, _) in mesh.triangles() {
        members[of[i as usize] as usize].push(i);
    }
    let wrong = map(run, components.len(), &|i| {
        let one = &components[i];
        if one.loops > 0 || one.volume == 0.0 || run.cancelled() {
            return false;
        }
        let Some(corners) = mesh.corners(members[i][0]) else {
            return false;
        };
        let encloses = |j: &usize| {
            let other = &components[*j];
            let inside = (0..3).all(|k| other.low[k] < one.low[k] && one.high[k] < other.high[k]);
            inside && other.loops == 0 && *j != i && winding(mesh, &members[*j], corners[0])
        };
        let depth = (0..components.len()).filter(encloses).count();
        (one.volume > 0.0) != depth.is_multiple_of(2)
    });
    if run.cancelled() {
        return Err(Cancelled);
    }
    for (list, _) in members.iter().zip(&wrong).filter(|(_, wrong)| **wrong) {
        reverse(mesh, list);
    }
    Ok(wrong.iter().filter(|wrong| **wrong).count())
}

/// Whether a closed component winds around a point (van Oosterom and Strackee, 1983).
fn winding(mesh: &Mesh, triangles: &[u32], p: Point) -> bool {
    let mut angle = 0.0;
    for corners in triangles.iter().filter_map(|&i| mesh.corners(i)) {
        let [a, b, c] = corners.map(|corner| sub(corner, p));
        let (la, lb, lc) = (norm(a), norm(b), norm(c));
        let below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
        angle += 2.0 * dot(a, cross(b, c)).atan2(below);
    }
    angle.abs() > std::f64::consts::TAU
}

/// Turns the triangles of a whole component inside out.
fn reverse(mesh: &mut Mesh, triangles: &[u32]) {
    for &i in triangles {
        let first = 3 * i as usize;
        mesh.corner.swap(first + 1, first + 2);
        mesh.twin.swap(first, first + 2);
    }
    let place = |h: u32| match h {
        NONE => NONE,
        h => 3 * (h / 3) + 2 - h % 3,
    };
    for &i in triangles {
        for h in 3 * i..3 * i + 3 {
            mesh.twin[h as usize] = place(mesh.twin[h as usize]);
        }
    }
    for &i in triangles {
        for h in 3 * i..3 * i + 3 {
            mesh.settle_out(mesh.from(h), h);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::volume;
    use crate::repair::{Repair, repair};
    use crate::shapes;
    use puncta_sdk::run::Serial;

    fn joined(parts: &[(shapes::Shape, f64, Point)]) -> shapes::Shape {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for ((more, others), size, shift) in parts {
            let first = positions.len() as u32;
            positions.extend(more.iter().map(|p| along(*shift, *p, *size)));
            triangles.extend(others.iter().map(|t| t.map(|v| v + first)));
        }
        (positions, triangles)
    }

    #[test]
    fn winding_is_made_the_same_and_outwards() {
        let (positions, mut triangles) = shapes::torus(10.0, 3.0, 30, 12);
        for triangle in triangles.iter_mut().step_by(3) {
            triangle.swap(0, 2);
        }
        let (mesh, _, mended) = repair(&positions, &triangles, Repair::default(), &Serial).unwrap();
        mesh.verify().unwrap();
        assert_eq!((mended.turned, mended.reversed, mended.holes), (240, 0, 0));
        let all: Vec<[u32; 3]> = triangles.iter().map(|t| [t[2], t[1], t[0]]).collect();
        let (mesh, _, mended) = repair(&positions, &all, Repair::default(), &Serial).unwrap();
        mesh.verify().unwrap();
        assert_eq!(mended.reversed, 1);
        assert!(volume(&mesh, &Serial).unwrap() > 0.0);
    }

    #[test]
    fn a_hollow_ball_keeps_its_hollow() {
        let ball = |size| (shapes::sphere(1.0, 2), size, [0.0; 3]);
        let (positions, triangles) = joined(&[ball(10.0), ball(5.0), ball(2.0)]);
        let (mesh, _, mended) = repair(&positions, &triangles, Repair::default(), &Serial).unwrap();
        assert_eq!(mended.reversed, 1);
        let (all, _) = describe(&mesh);
        let signs: Vec<bool> = all.iter().map(|one| one.volume > 0.0).collect();
        assert_eq!(signs, [true, false, true]);
    }

    #[test]
    fn cubes_that_share_an_edge_are_parted() {
        let cube = |shift| (shapes::cube(1.0, 1), 1.0, shift);
        let (positions, triangles) = joined(&[cube([0.0; 3]), cube([1.0, 1.0, 0.0])]);
        let (mesh, _, mended) = repair(&positions, &triangles, Repair::default(), &Serial).unwrap();
        mesh.verify().unwrap();
        assert_eq!((mended.merged, mended.parted, mended.copied), (2, 1, 2));
        let (all, _) = describe(&mesh);
        assert_eq!(all.len(), 2);
        assert!(
            all.iter()
                .all(|one| (one.volume - 1.0).abs() < 1e-12 && one.loops == 0)
        );
    }

    #[test]
    fn one_sided_strips_are_cut_open() {
        let (positions, triangles) = shapes::moebius(5.0, 1.0, 24, 3);
        let how = Repair {
            fill_edges: 0,
            ..Repair::default()
        };
        let (mesh, _, mended) = repair(&positions, &triangles, how, &Serial).unwrap();
        mesh.verify().unwrap();
        assert_eq!((mended.parted, mended.holes), (3, 1));
        assert_eq!(mesh.triangle_count(), triangles.len());
    }
}
