//! Solutions for many right sides, some columns of them at a time, so that they stay near.

use crate::lane::Lane;
use crate::math::ldl::for_each_entry;
use crate::math::vec3::scale;
use crate::model::{Pattern, Rows};

/// Columns that are worked on together: as many as the sums of which stay in registers.
pub const STRIP: usize = 4;

/// A row of them.
pub type Strip<L> = [L; STRIP];

/// sum - factor row
#[inline(always)]
fn less<L: Lane>(sum: &mut Strip<L>, factor: L, row: &Strip<L>) {
    for (sum, x) in sum.iter_mut().zip(row) {
        *sum = factor.neg_mul_add(*x, *sum);
    }
}

/// sum + factor row
#[inline(always)]
fn more<L: Lane>(sum: &mut Strip<L>, factor: L, row: &Strip<L>) {
    for (sum, x) in sum.iter_mut().zip(row) {
        *sum = factor.mul_add(*x, *sum);
    }
}

/// A matrix that is stored by rows of a pattern, factored: what is on the left, what is on the right, reciprocal pivots.
#[derive(Clone, Copy, Debug)]
pub struct Factors<'a, L> {
    pub lower: &'a [L],
    pub upper: &'a [L],
    pub inverse: &'a [L],
}

/// Solves A X = B in place of B, as [`ldl`](crate::math::ldl) and [`lu`](crate::math::lu) do for one right side. Rows of B for which `there` is
/// false are zero, and all whose columns they have.
pub fn solve<L: Lane>(
    (rows, pattern): (&Rows, &Pattern),
    factors: Factors<'_, L>,
    there: impl Fn(usize) -> bool,
    b: &mut [Strip<L>],
) {
    let Factors { lower, upper, inverse } = factors;
    for k in (0..b.len()).rev().filter(|k| there(*k)) {
        let (above, from) = b.split_at_mut(k);
        let own = scale(inverse[k], &from[0]);
        from[0] = own;
        for_each_entry(rows, pattern, upper, k, |columns, row| {
            above[columns].iter_mut().zip(row).for_each(|(to, factor)| less(to, *factor, &own));
        });
    }
    for k in 0..b.len() {
        let (above, to) = b.split_at_mut(k);
        let mut sum = [L::zero(); STRIP];
        for_each_entry(rows, pattern, lower, k, |columns, row| {
            above[columns].iter().zip(row).for_each(|(x, factor)| more(&mut sum, *factor, x));
        });
        less(&mut to[0], inverse[k], &sum);
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
    for (k, y) in y.iter_mut().enumerate() {
        let mut sum = *y;
        more(&mut sum, lower[rows.diagonal(k)], &x[k]);
        for i in pattern.column(k).iter().map(|i| *i as usize) {
            more(&mut sum, upper[rows.at(i, k)], &x[i]);
        }
        for_each_entry(rows, pattern, lower, k, |columns, row| {
            x[columns].iter().zip(row).for_each(|(x, factor)| more(&mut sum, *factor, x));
        });
        *y = sum;
    }
}
