//! Quadratic functions with bounds: the projected Newton method, after Tassa, Mansard, Todorov: Control-limited differential dynamic programming, ICRA 2014.

use faer::Mat;
use faer::linalg::solvers::{Llt, Solve};
use faer::{MatRef, Side};

/// Most steps; a few do.
const MOST_STEPS: usize = 100;
/// A gradient, or a gain, that counts as none.
const SMALL: f64 = 1e-10;

/// Where a quadratic function is least within bounds.
#[derive(Debug)]
pub struct Minimum {
    /// The place.
    pub x: Vec<f64>,
    /// Numbers that are at no bound, ascending.
    pub free: Vec<usize>,
    /// The factor of their part of the matrix; none if all are at bounds.
    factor: Option<Llt<f64>>,
}

impl Minimum {
    /// −H⁻¹ B of the free numbers, zero of the others: how the place moves where the function's slope gains the columns of B.
    pub(super) fn follow(&self, b: MatRef<'_, f64>) -> Mat<f64> {
        let mut out = Mat::zeros(b.nrows(), b.ncols());
        let Some(factor) = &self.factor else { return out };
        let part = factor.solve(Mat::from_fn(self.free.len(), b.ncols(), |i, k| b[(self.free[i], k)]));
        for (i, at) in self.free.iter().enumerate() {
            for k in 0..b.ncols() {
                out[(*at, k)] = -part[(i, k)];
            }
        }
        out
    }
}

/// The least of ½ xᵀHx + gᵀx with lo ≤ x ≤ hi, from a start, where H is symmetric, `[n, n]`; `None` if H is not positive definite where x is free, or
/// lengths do not fit.
pub fn minimise(h: &[f64], g: &[f64], [lo, hi]: [&[f64]; 2], start: &[f64]) -> Option<Minimum> {
    let n = g.len();
    if h.len() != n * n || [lo, hi, start].iter().any(|values| values.len() != n) {
        return None;
    }
    solve(MatRef::from_row_major_slice(h, n, n), g, [lo, hi], start)
}

/// The same.
pub(super) fn solve(h: MatRef<'_, f64>, g: &[f64], [lo, hi]: [&[f64]; 2], start: &[f64]) -> Option<Minimum> {
    let n = g.len();
    let clamp = |x: Vec<f64>| -> Vec<f64> { (0..n).map(|i| x[i].max(lo[i]).min(hi[i])).collect() };
    let times = |x: &[f64], i: usize| (0..n).map(|k| h[(i, k)] * x[k]).sum::<f64>();
    let value = |x: &[f64]| (0..n).map(|i| x[i] * (0.5 * times(x, i) + g[i])).sum::<f64>();
    let mut x = clamp(start.to_vec());
    let mut last: Option<(Vec<usize>, Option<Llt<f64>>)> = None;
    for _ in 0..MOST_STEPS {
        let gradient: Vec<f64> = (0..n).map(|i| g[i] + times(&x, i)).collect();
        let held = |i: &usize| (x[*i] <= lo[*i] && gradient[*i] > 0.0) || (x[*i] >= hi[*i] && gradient[*i] < 0.0);
        let free: Vec<usize> = (0..n).filter(|i| !held(i)).collect();
        if last.as_ref().is_none_or(|(known, _)| *known != free) {
            last = Some((free.clone(), factor(h, &free)?));
        }
        let scale = g.iter().fold(1.0_f64, |most, g| most.max(g.abs()));
        if free.iter().all(|i| gradient[*i].abs() < SMALL * scale) {
            break;
        }
        let Some((_, Some(factor))) = &last else { break };
        let step = factor.solve(Mat::from_fn(free.len(), 1, |i, _| gradient[free[i]]));
        let mut direction = vec![0.0; n];
        free.iter().enumerate().for_each(|(i, at)| direction[*at] = -step[(i, 0)]);
        let (before, mut length) = (value(&x), 1.0);
        let moved = |length: f64| clamp((0..n).map(|i| x[i] + length * direction[i]).collect());
        // As the slope has it for the step that bounds leave.
        let promised = |next: &[f64]| (0..n).map(|i| gradient[i] * (next[i] - x[i])).sum::<f64>();
        let mut next = moved(length);
        while length > 1e-12 && value(&next) - before > 0.1 * promised(&next) {
            length *= 0.6;
            next = moved(length);
        }
        if value(&next) >= before {
            break;
        }
        x = next;
    }
    let (free, factor) = last?;
    Some(Minimum { x, free, factor })
}

/// The factor of the part of a matrix; `None` if there is none, and an empty one of nothing.
fn factor(h: MatRef<'_, f64>, free: &[usize]) -> Option<Option<Llt<f64>>> {
    if free.is_empty() {
        return Some(None);
    }
    let part = Mat::from_fn(free.len(), free.len(), |i, k| h[(free[i], free[k])]);
    part.llt(Side::Lower).ok().map(Some)
}
