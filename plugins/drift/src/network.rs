//! Positions from redundant differences: robust least squares.
//!
//! Wang et al. (2014) measure the shift of each pair of time segments and solve the overdetermined
//! system d_b - d_a = r_ab, leaving out the pairs that do not fit while all segments hang together.

/// The shift between two segments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// The earlier segment.
    pub from: usize,
    /// The later segment.
    pub to: usize,
    /// Position of the later minus that of the earlier one, nm.
    pub shift: [f64; 3],
    /// Weight.
    pub weight: f64,
}

/// Positions that agree best with the links.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Position of each segment; their mean is 0.
    pub positions: Vec<[f64; 3]>,
    /// Number of links that were used.
    pub used: usize,
    /// The links that were left out.
    pub rejected: Vec<Link>,
    /// Root mean square of the residuals of the others, nm.
    pub residual: f64,
}

/// Solves for the positions. Links whose residual exceeds `tolerance` nm are left out, the worst
/// first, unless that would cut a segment off.
///
/// None when the links do not connect all segments.
pub fn solve(segments: usize, links: &[Link], tolerance: f64) -> Option<Solution> {
    let mut links: Vec<Link> = links.to_vec();
    let mut rejected = Vec::new();
    if !connected(segments, &links) {
        return None;
    }
    let mut robust: Vec<f64> = vec![1.0; links.len()];
    let mut positions = least_squares(segments, &links, &robust)?;
    // Iteratively reweighted with Cauchy weights, so that gross errors do not hide each other.
    for _ in 0..20 {
        for (weight, link) in robust.iter_mut().zip(&links) {
            *weight = 1.0 / (1.0 + (residual(&positions, link) / tolerance).powi(2));
        }
        positions = least_squares(segments, &links, &robust)?;
    }
    let mut order: Vec<usize> = (0..links.len()).collect();
    let size = |i: &usize| residual(&positions, &links[*i]);
    order.sort_by(|a, b| size(b).total_cmp(&size(a)).then(a.cmp(b)));
    let mut keep = vec![true; links.len()];
    for i in order {
        if residual(&positions, &links[i]) <= tolerance {
            break;
        }
        keep[i] = false;
        let left = || links.iter().zip(&keep).filter(|(_, k)| **k).map(|(l, _)| l);
        keep[i] = !connected(segments, left());
    }
    let mut kept = keep.iter();
    links.retain(|link| {
        let keep = kept.next().copied().unwrap_or(true);
        if !keep {
            rejected.push(*link);
        }
        keep
    });
    let positions = least_squares(segments, &links, &vec![1.0; links.len()])?;
    let sum: f64 = links.iter().map(|l| residual(&positions, l).powi(2)).sum();
    Some(Solution {
        residual: (sum / links.len().max(1) as f64).sqrt(),
        positions,
        used: links.len(),
        rejected,
    })
}

fn residual(positions: &[[f64; 3]], link: &Link) -> f64 {
    let axis = |k: usize| positions[link.to][k] - positions[link.from][k] - link.shift[k];
    (0..3).map(|k| axis(k).powi(2)).sum::<f64>().sqrt()
}

fn connected<'a>(segments: usize, links: impl IntoIterator<Item = &'a Link>) -> bool {
    let mut parent: Vec<usize> = (0..segments).collect();
    fn root(parent: &mut [usize], mut i: usize) -> usize {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    }
    let mut parts = segments;
    for link in links {
        let (a, b) = (root(&mut parent, link.from), root(&mut parent, link.to));
        if a != b {
            parent[a] = b;
            parts -= 1;
        }
    }
    parts <= 1
}

/// Normal equations with the mean fixed at 0, by Cholesky's factorisation.
fn least_squares(segments: usize, links: &[Link], robust: &[f64]) -> Option<Vec<[f64; 3]>> {
    let n = segments;
    let mut matrix = vec![0.0; n * n];
    let mut right = vec![[0.0; 3]; n];
    let mut total = 0.0;
    for (link, robust) in links.iter().zip(robust) {
        let (a, b, w) = (link.from, link.to, link.weight * robust);
        total += w;
        matrix[a * n + a] += w;
        matrix[b * n + b] += w;
        matrix[a * n + b] -= w;
        matrix[b * n + a] -= w;
        for (k, shift) in link.shift.iter().enumerate() {
            right[b][k] += w * shift;
            right[a][k] -= w * shift;
        }
    }
    // The sum of the positions is free; tying it to 0 makes the matrix definite.
    let tie = total.max(f64::MIN_POSITIVE) / (n * n) as f64;
    matrix.iter_mut().for_each(|m| *m += tie);
    cholesky(&mut matrix, n)?;
    for axis in 0..3 {
        let mut column: Vec<f64> = right.iter().map(|r| r[axis]).collect();
        back_substitute(&matrix, n, &mut column);
        for (slot, value) in right.iter_mut().zip(column) {
            slot[axis] = value;
        }
    }
    Some(right)
}

/// Lower triangular factor in place; None if the matrix is not positive definite.
pub fn cholesky(matrix: &mut [f64], n: usize) -> Option<()> {
    for i in 0..n {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| matrix[i * n + k] * matrix[j * n + k]).sum();
            let rest = matrix[i * n + j] - dot;
            if i == j {
                if rest.is_nan() || rest <= 0.0 {
                    return None;
                }
                matrix[i * n + i] = rest.sqrt();
            } else {
                matrix[i * n + j] = rest / matrix[j * n + j];
            }
        }
    }
    Some(())
}

/// Solves with a factor from [`cholesky`].
pub fn back_substitute(factor: &[f64], n: usize, right: &mut [f64]) {
    for i in 0..n {
        let dot: f64 = (0..i).map(|k| factor[i * n + k] * right[k]).sum();
        right[i] = (right[i] - dot) / factor[i * n + i];
    }
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|k| factor[k * n + i] * right[k]).sum();
        right[i] = (right[i] - dot) / factor[i * n + i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn links(truth: &[[f64; 3]]) -> Vec<Link> {
        let pairs = (0..truth.len()).flat_map(|a| (a + 1..truth.len()).map(move |b| (a, b)));
        pairs
            .map(|(from, to)| Link {
                from,
                to,
                shift: std::array::from_fn(|k| truth[to][k] - truth[from][k]),
                weight: 1.0 + (from % 3) as f64,
            })
            .collect()
    }

    fn close(solution: &Solution, truth: &[[f64; 3]], tolerance: f64) {
        let mean = |k: usize| truth.iter().map(|p| p[k]).sum::<f64>() / truth.len() as f64;
        for (found, p) in solution.positions.iter().zip(truth) {
            for k in 0..3 {
                assert!((found[k] - (p[k] - mean(k))).abs() < tolerance);
            }
        }
    }

    #[test]
    fn gross_errors_are_left_out() {
        let truth: Vec<[f64; 3]> = (0..12)
            .map(|i| [f64::from(i) * 20.0, f64::from(i * i), -3.0 * f64::from(i)])
            .collect();
        let mut all = links(&truth);
        close(&solve(12, &all, 10.0).unwrap(), &truth, 1e-9);
        let bad: Vec<usize> = (0..all.len()).step_by(4).collect();
        for i in &bad {
            all[*i].shift[0] += 300.0;
            all[*i].shift[1] -= 150.0 + *i as f64;
        }
        let solution = solve(12, &all, 10.0).unwrap();
        close(&solution, &truth, 1e-9);
        assert_eq!(solution.rejected.len(), bad.len());
        assert!(solution.residual < 1e-9);
    }

    #[test]
    fn segments_without_a_link_are_no_network() {
        let mut all = links(&[[0.0; 3], [5.0; 3], [9.0; 3]]);
        all.retain(|link| link.to < 2);
        assert!(solve(3, &all, 10.0).is_none());
        // The only link of a segment stays, however bad.
        all.push(Link {
            from: 1,
            to: 2,
            shift: [1e4; 3],
            weight: 1.0,
        });
        assert!(solve(3, &all, 10.0).unwrap().rejected.is_empty());
    }
}
