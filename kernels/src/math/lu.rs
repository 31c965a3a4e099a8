//! Triangular factors of a matrix whose entries, not their values, are symmetric, eliminating dofs from last to first: on the
//! pattern of a tree nothing fills in, as with [`ldl`](super::ldl).
//!
//! The matrix is kept as two triangles, both stored by the skyline [`Rows`]: entries left of the diagonal, with the diagonal, row by
//! row in `lower`; those above it, column by column, in `upper`.

use std::ops::Range;

use super::ldl::for_each_entry;
use crate::lane::{Lane, Real};
use crate::model::{Pattern, Rows};

/// Factors some rows that no others are coupled with, in place, and sets `inverse` to the reciprocals of the pivots. Pivots nearer to
/// zero than `TINY` are replaced by it.
pub fn factor<L: Lane>(
    rows: &Rows,
    pattern: &Pattern,
    range: Range<usize>,
    lower: &mut [L],
    upper: &mut [L],
    inverse: &mut [L],
) {
    let tiny = L::of(L::Real::TINY);
    for k in range.rev() {
        let (start, first) = (rows.start[k] as usize, rows.first[k] as usize);
        let pivot = lower[rows.diagonal(k)];
        let pivot = L::select(pivot.abs().ge(tiny), pivot, tiny);
        inverse[k] = L::one() / pivot;
        // Rows above k, and what is left of k in them; columns likewise.
        for i in pattern.row(k).iter().flat_map(|run| run.range()) {
            let own = start + i - first;
            let (by_lower, by_upper) = (upper[own] * inverse[k], lower[own] * inverse[k]);
            for run in pattern.row(k) {
                let columns = run.start as usize..run.range().end.min(i);
                for j in columns {
                    let (target, source) = (rows.at(i, j), start + j - first);
                    lower[target] = by_lower.neg_mul_add(lower[source], lower[target]);
                    upper[target] = by_upper.neg_mul_add(upper[source], upper[target]);
                }
            }
            let diagonal = rows.diagonal(i);
            lower[diagonal] = by_lower.neg_mul_add(lower[own], lower[diagonal]);
        }
    }
}

/// Solves for x in place of the right-hand side, from the factors.
pub fn solve<L: Lane>(
    rows: &Rows,
    pattern: &Pattern,
    range: Range<usize>,
    lower: &[L],
    upper: &[L],
    inverse: &[L],
    x: &mut [L],
) {
    for k in range.clone().rev() {
        x[k] *= inverse[k];
        let y = x[k];
        for_each_entry(rows, pattern, upper, k, |columns, column| {
            for (x, u) in x[columns].iter_mut().zip(column) {
                *x = y.neg_mul_add(*u, *x);
            }
        });
    }
    for k in range {
        let mut sum = L::zero();
        for_each_entry(rows, pattern, lower, k, |columns, row| {
            for (x, l) in x[columns].iter().zip(row) {
                sum = x.mul_add(*l, sum);
            }
        });
        x[k] = sum.neg_mul_add(inverse[k], x[k]);
    }
}
