//! Solutions for many right sides, some columns of them at a time, so that they stay near.

use crate::lane::Lane;
use crate::math::ldl::least_pivot;
use crate::model::{Pattern, Rows};

/// Columns that are worked on together: as many as the sums of which stay in registers.
pub const STRIP: usize = 4;

/// A row of them.
pub type Strip<L> = [L; STRIP];

/// sum - factor row
#[inline(always)]
fn less<L: Lane>(sum: Strip<L>, factor: L, row: &Strip<L>) -> Strip<L> {
    std::array::from_fn(|c| factor.neg_mul_add(row[c], sum[c]))
}

#[inline(always)]
fn times<L: Lane>(factor: L, row: &Strip<L>) -> Strip<L> {
    row.map(|x| factor * x)
}

/// Factors the lower triangle of a dense symmetric n×n matrix, rows first, into L D Lᵀ in place; D⁻¹ on the diagonal.
pub fn factor<L: Lane>(n: usize, h: &mut [L]) {
    for i in 0..n {
        let (done, rest) = h.split_at_mut(n * i);
        let row = &mut rest[..=i];
        // A row of L D, from the left.
        for j in 0..i {
            let other = &done[n * j..n * j + j];
            row[j] = row[..j].iter().zip(other).fold(row[j], |sum, (a, b)| a.neg_mul_add(*b, sum));
        }
        let mut pivot = row[i];
        let least = least_pivot(pivot);
        for j in 0..i {
            let scaled = row[j] * done[n * j + j];
            pivot = row[j].neg_mul_add(scaled, pivot);
            row[j] = scaled;
        }
        row[i] = L::one() / pivot.max(least);
    }
}

/// Solves H X = B in place of B, from the factors.
pub fn solve<L: Lane>(h: &[L], b: &mut [Strip<L>]) {
    let n = b.len();
    for i in 0..n {
        let factors = &h[n * i..n * i + i];
        b[i] = factors.iter().zip(&b[..i]).fold(b[i], |sum, (factor, row)| less(sum, *factor, row));
    }
    for i in (0..n).rev() {
        let own = times(h[n * i + i], &b[i]);
        b[i] = (i + 1..n).fold(own, |sum, k| less(sum, h[n * k + i], &b[k]));
    }
}

/// A matrix that is stored by rows of a pattern, factored: what is on the left, what is on the right, reciprocal pivots.
#[derive(Clone, Copy, Debug)]
pub struct Factors<'a, L> {
    pub lower: &'a [L],
    pub upper: &'a [L],
    pub inverse: &'a [L],
}

/// Solves A X = B in place of B, as [`ldl`](crate::math::ldl) and [`lu`](crate::math::lu) do for one right side.
pub fn solve_sparse<L: Lane>(rows: &Rows, pattern: &Pattern, factors: Factors<'_, L>, b: &mut [Strip<L>]) {
    let Factors { lower, upper, inverse } = factors;
    for k in (0..b.len()).rev() {
        let below = pattern.column(k).iter().map(|m| *m as usize);
        let sum = below.fold(b[k], |sum, m| less(sum, upper[rows.at(m, k)], &b[m]));
        b[k] = times(inverse[k], &sum);
    }
    for k in 0..b.len() {
        let above = pattern.row(k).iter().flat_map(|run| run.range());
        b[k] = above.fold(b[k], |sum, j| less(sum, lower[rows.at(k, j)] * inverse[k], &b[j]));
    }
}

/// Y += A X of a matrix with `lower` and `upper` entries.
pub fn add_product<L: Lane>(
    rows: &Rows,
    pattern: &Pattern,
    [lower, upper]: [&[L]; 2],
    x: &[Strip<L>],
    y: &mut [Strip<L>],
) {
    let more = |sum: Strip<L>, factor: L, row: &Strip<L>| std::array::from_fn(|c| factor.mul_add(row[c], sum[c]));
    for (k, y) in y.iter_mut().enumerate() {
        let mut sum = more(*y, lower[rows.diagonal(k)], &x[k]);
        for i in pattern.column(k).iter().map(|i| *i as usize) {
            sum = more(sum, upper[rows.at(i, k)], &x[i]);
        }
        for j in pattern.row(k).iter().flat_map(|run| run.range()) {
            sum = more(sum, lower[rows.at(k, j)], &x[j]);
        }
        *y = sum;
    }
}
