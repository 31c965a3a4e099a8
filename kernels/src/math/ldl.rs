//! M = Lᵀ D L with unit lower triangular L, eliminating dofs from last to first (Featherstone, Efficient factorization of
//! the joint-space inertia matrix for branched kinematic trees, 2005).
//!
//! Matrices are stored by the skyline [`Rows`]; a [`Pattern`] says which entries to visit. Rows are finished one after the
//! other, each in a single pass over the rows that it depends on (left-looking), a few columns at a time in registers.
//! What is stored is U = D L, so that no division and no scaling touches the entries.
//!
//! Eliminating with a wider pattern of the same matrix gives the same bits: its extra entries are exact zeros, and every
//! entry sees the same subtractions in the same order.

use std::ops::Range;

use super::vec3::build;
use crate::lane::{Lane, Mask, Real};
use crate::model::{Pattern, Rows};

/// Columns that are updated together.
const COLUMNS: usize = 4;

/// The least pivot of a row with this diagonal entry: smaller ones are rounding, or zero.
#[inline(always)]
pub fn least_pivot<L: Lane>(diagonal: L) -> L {
    let tiny = L::of(L::Real::TINY);
    let rounding = L::Real::PIVOT_ROUNDING;
    if rounding > 0.0 { (diagonal * L::of(rounding)).max(tiny) } else { tiny }
}

/// Factors `m` in place into U = D L, and sets `inverse` = D⁻¹. Pivots below the [least](least_pivot) are replaced by it and
/// reported in the returned mask. `multipliers` is scratch of length nv.
///
/// The pattern must be closed under elimination: if row k has columns i > j, row i has column j.
pub fn factor<L: Lane>(
    rows: &Rows,
    pattern: &Pattern,
    m: &mut [L],
    inverse: &mut [L],
    multipliers: &mut [L],
) -> L::Mask {
    factor_rows(rows, pattern, 0..inverse.len(), m, inverse, multipliers)
}

/// The same of some rows that no others are coupled with.
pub fn factor_rows<L: Lane>(
    rows: &Rows,
    pattern: &Pattern,
    range: Range<usize>,
    m: &mut [L],
    inverse: &mut [L],
    multipliers: &mut [L],
) -> L::Mask {
    let mut singular = L::Mask::splat(false);
    for i in range.rev() {
        let (start, first) = (rows.start[i] as usize, rows.first[i] as usize);
        let offset = start + i - first + 1;
        let (head, finished) = m.split_at_mut(offset);
        let row = &mut head[start..];
        let least = least_pivot(row[i - first]);
        let below = pattern.column(i);
        let multipliers = &mut multipliers[..below.len()];
        for (l, k) in multipliers.iter_mut().zip(below) {
            let k = *k as usize;
            *l = finished[rows.at(k, i) - offset] * inverse[k];
        }
        let update = Update { rows, finished, offset, below, multipliers };
        let mut diagonal_done = below.is_empty();
        for run in pattern.row(i) {
            let mut range = run.range();
            // The diagonal joins a run that ends beside it.
            if range.end == i {
                range.end = i + 1;
                diagonal_done = true;
            }
            if !below.is_empty() {
                update.columns(row, first, range);
            }
        }
        if !diagonal_done {
            update.columns(row, first, i..i + 1);
        }
        let pivot = row[i - first];
        let bad = !pivot.ge(least);
        let pivot = L::select(bad, least, pivot);
        singular = singular | bad;
        row[i - first] = pivot;
        inverse[i] = L::one() / pivot;
    }
    singular
}

/// What a row is updated from: the finished rows below it that have an entry in its column.
struct Update<'a, L> {
    rows: &'a Rows,
    finished: &'a [L],
    /// Offset of `finished` in the storage.
    offset: usize,
    below: &'a [u32],
    multipliers: &'a [L],
}

impl<L: Lane> Update<'_, L> {
    /// Subtracts from a range of the row's columns.
    #[inline(always)]
    fn columns(&self, row: &mut [L], first: usize, range: std::ops::Range<usize>) {
        let mut column = range.start;
        while column + COLUMNS <= range.end {
            self.chunk::<COLUMNS>(&mut row[column - first..], column);
            column += COLUMNS;
        }
        if column + 2 <= range.end {
            self.chunk::<2>(&mut row[column - first..], column);
            column += 2;
        }
        if column < range.end {
            self.chunk::<1>(&mut row[column - first..], column);
        }
    }

    #[inline(always)]
    fn chunk<const N: usize>(&self, target: &mut [L], column: usize) {
        let mut sum: [L; N] = build(|c| target[c]);
        for (k, l) in self.below.iter().zip(self.multipliers) {
            let (start, first) = (self.rows.start[*k as usize] as usize, self.rows.first[*k as usize] as usize);
            if column >= first {
                let at = start + column - first - self.offset;
                let source = &self.finished[at..at + N];
                for c in 0..N {
                    sum[c] = l.neg_mul_add(source[c], sum[c]);
                }
            } else {
                // Columns left of the row's skyline are zero. The loop has constant bounds, else `sum` would live in memory.
                for c in 0..N {
                    if column + c >= first {
                        sum[c] = l.neg_mul_add(self.finished[start + column + c - first - self.offset], sum[c]);
                    }
                }
            }
        }
        target[..N].copy_from_slice(&sum);
    }
}

/// Solves (Lᵀ D L) x = b in place of b, from U and D⁻¹.
pub fn solve<L: Lane>(rows: &Rows, pattern: &Pattern, u: &[L], inverse: &[L], x: &mut [L]) {
    solve_rows(rows, pattern, 0..x.len(), u, inverse, x);
}

/// The same of some rows that no others are coupled with.
pub fn solve_rows<L: Lane>(rows: &Rows, pattern: &Pattern, range: Range<usize>, u: &[L], inverse: &[L], x: &mut [L]) {
    for k in range.clone().rev() {
        let y = x[k] * inverse[k];
        x[k] = y;
        for_each_entry(rows, pattern, u, k, |columns, row| {
            for (x, u) in x[columns].iter_mut().zip(row) {
                *x = y.neg_mul_add(*u, *x);
            }
        });
    }
    for k in range {
        let mut sum = L::zero();
        for_each_entry(rows, pattern, u, k, |columns, row| {
            for (x, u) in x[columns].iter().zip(row) {
                sum = x.mul_add(*u, sum);
            }
        });
        x[k] = sum.neg_mul_add(inverse[k], x[k]);
    }
}

/// Calls `f` with every run of columns of row `k` and its entries.
#[inline(always)]
pub fn for_each_entry<L>(
    rows: &Rows,
    pattern: &Pattern,
    m: &[L],
    k: usize,
    mut f: impl FnMut(std::ops::Range<usize>, &[L]),
) {
    let (start, first) = (rows.start[k] as usize, rows.first[k] as usize);
    for run in pattern.row(k) {
        let range = run.range();
        f(range.clone(), &m[start + range.start - first..start + range.end - first]);
    }
}

/// y = M x for a symmetric matrix of the given pattern.
pub fn multiply<L: Lane>(rows: &Rows, pattern: &Pattern, m: &[L], x: &[L], y: &mut [L]) {
    for k in 0..x.len() {
        let xk = x[k];
        let mut sum = m[rows.diagonal(k)] * xk;
        for_each_entry(rows, pattern, m, k, |columns, row| {
            for ((y, x), m) in y[columns.clone()].iter_mut().zip(&x[columns]).zip(row) {
                sum = m.mul_add(*x, sum);
                *y = m.mul_add(xk, *y);
            }
        });
        y[k] = sum;
    }
}
