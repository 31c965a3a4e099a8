//! M = Lᵀ D L with unit lower triangular L, eliminating dofs from last to first (Featherstone, Efficient factorization of
//! the joint-space inertia matrix for branched kinematic trees, 2005).
//!
//! Matrices are stored by the skyline [`Rows`]; a [`Pattern`] says which entries to visit. Eliminating with a wider
//! pattern of the same matrix gives the same bits: its extra entries are exact zeros, and the order is the same.

use crate::lane::{Lane, Real};
use crate::model::{Pattern, Rows};

/// Factors `m` in place: L below the diagonal, D on it, and `inverse` = D⁻¹. Pivots below `MINVAL` are replaced by it
/// and reported in the returned mask.
///
/// The pattern must be closed under elimination: if row k has columns i > j, row i has column j.
pub fn factor<L: Lane>(rows: &Rows, pattern: &Pattern, m: &mut [L], inverse: &mut [L]) -> L::Mask {
    let tiny = L::of(L::Real::MINVAL);
    let mut singular = <L::Mask as crate::lane::Mask>::splat(false);
    for k in (0..inverse.len()).rev() {
        let first = rows.first[k] as usize;
        let (above, row) = m.split_at_mut(rows.start[k] as usize);
        let row = &mut row[..k - first + 1];
        let bad = !row[k - first].ge(tiny);
        let pivot = L::select(bad, tiny, row[k - first]);
        singular = singular | bad;
        row[k - first] = pivot;
        let pivot_inverse = L::one() / pivot;
        inverse[k] = pivot_inverse;
        let runs = pattern.row(k);
        for (r, run) in runs.iter().enumerate().rev() {
            for i in run.range().rev() {
                let l = row[i - first] * pivot_inverse;
                let target = &mut above[rows.start[i] as usize..];
                let target_first = rows.first[i] as usize;
                for lower in &runs[..r] {
                    subtract_scaled(target, target_first, row, first, lower.start as usize, lower.len as usize, l);
                }
                let start = run.start as usize;
                subtract_scaled(target, target_first, row, first, start, i - start + 1, l);
                // Row i's own column is needed no more as M_ki; the entries left of it still are.
                row[i - first] = l;
            }
        }
    }
    singular
}

/// target[j] -= l row[j] for `len` columns from `start`.
#[inline(always)]
fn subtract_scaled<L: Lane>(
    target: &mut [L],
    target_first: usize,
    row: &[L],
    first: usize,
    start: usize,
    len: usize,
    l: L,
) {
    let target = &mut target[start - target_first..start - target_first + len];
    let source = &row[start - first..start - first + len];
    for (t, s) in target.iter_mut().zip(source) {
        *t = l.neg_mul_add(*s, *t);
    }
}

/// Solves (Lᵀ D L) x = b in place of b.
pub fn solve<L: Lane>(rows: &Rows, pattern: &Pattern, l: &[L], inverse: &[L], x: &mut [L]) {
    for k in (0..x.len()).rev() {
        let (start, first) = (rows.start[k] as usize, rows.first[k] as usize);
        let xk = x[k];
        for run in pattern.row(k) {
            let range = run.range();
            let row = &l[start + range.start - first..start + range.end - first];
            for (xi, lki) in x[range].iter_mut().zip(row) {
                *xi = xk.neg_mul_add(*lki, *xi);
            }
        }
    }
    for k in 0..x.len() {
        let (start, first) = (rows.start[k] as usize, rows.first[k] as usize);
        let mut sum = x[k] * inverse[k];
        for run in pattern.row(k) {
            let range = run.range();
            let row = &l[start + range.start - first..start + range.end - first];
            for (xi, lki) in x[range].iter().zip(row) {
                sum = xi.neg_mul_add(*lki, sum);
            }
        }
        x[k] = sum;
    }
}

/// y = M x for a symmetric matrix of the given pattern.
pub fn multiply<L: Lane>(rows: &Rows, pattern: &Pattern, m: &[L], x: &[L], y: &mut [L]) {
    for k in 0..x.len() {
        let (start, first) = (rows.start[k] as usize, rows.first[k] as usize);
        let xk = x[k];
        let mut sum = m[start + k - first] * xk;
        for run in pattern.row(k) {
            let range = run.range();
            let row = &m[start + range.start - first..start + range.end - first];
            for ((yi, xi), mki) in y[range.clone()].iter_mut().zip(&x[range]).zip(row) {
                sum = mki.mul_add(*xi, sum);
                *yi = mki.mul_add(xk, *yi);
            }
        }
        y[k] = sum;
    }
}
