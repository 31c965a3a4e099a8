//! The factor of one world's Hessian by blocks of its strips. Strips are eliminated one after the other, each as
//! [`tiles`](crate::solver::tiles) are: dofs from last to first, entries see the same operations.

use super::pattern::Pattern;
use crate::lane::Scalar;
use crate::math::ldl::least_pivot;
use crate::model::{LONGEST, Span};

/// Numbers of a row: as many as fill registers.
pub const WIDTH: usize = 8;
/// A row of a block.
pub type Row<T> = [T; WIDTH];
/// What the Hessian has between two strips: rows are dofs of the one that is eliminated first. Rows and columns beyond the strips are
/// zero, or of no meaning.
pub type Block<T> = [Row<T>; LONGEST];

/// The Hessian of one world, then its factor.
#[derive(Clone, Debug)]
pub struct Factor<T> {
    /// The pattern.
    pub pattern: Pattern,
    /// By place, a strip with itself: the lower triangle.
    pub own: Vec<Block<T>>,
    /// Strips with others, as [`Pattern::later`].
    pub others: Vec<Block<T>>,
    /// By place, D⁻¹.
    inverse: Vec<Row<T>>,
    /// Right side, then solution, by place.
    pub x: Vec<Row<T>>,
    /// Of the strip that is eliminated: others over pivots.
    panel: Vec<Block<T>>,
}

impl<T: Scalar> Default for Factor<T> {
    fn default() -> Self {
        let (own, others, inverse, x, panel) = Default::default();
        Factor { pattern: Pattern::default(), own, others, inverse, x, panel }
    }
}

/// sum - factor row
#[inline(always)]
fn less<T: Scalar>(sum: &mut Row<T>, factor: T, row: &Row<T>) {
    for (sum, x) in sum.iter_mut().zip(row) {
        *sum = factor.neg_mul_add(*x, *sum);
    }
}

/// Runs a function for so many dofs, as if there were as many always.
macro_rules! with_count {
    ($count:expr, $function:ident($($argument:expr),*)) => {
        match $count {
            1 => $function::<T, 1>($($argument),*),
            2 => $function::<T, 2>($($argument),*),
            3 => $function::<T, 3>($($argument),*),
            4 => $function::<T, 4>($($argument),*),
            5 => $function::<T, 5>($($argument),*),
            _ => $function::<T, 6>($($argument),*),
        }
    };
}

impl<T: Scalar> Factor<T> {
    /// Makes all blocks of the pattern zero.
    pub fn clear(&mut self) {
        let Factor { pattern, own, others, inverse, x, .. } = self;
        own.clear();
        own.resize(pattern.order.len(), Default::default());
        others.clear();
        others.resize(pattern.later.len(), Default::default());
        inverse.resize(pattern.order.len(), Default::default());
        x.resize(pattern.order.len(), Default::default());
    }

    /// Factors.
    pub fn factor(&mut self, strips: &[Span]) {
        // Pivots are held against the diagonal as it was.
        for (inverse, own) in self.inverse.iter_mut().zip(&self.own) {
            (0..LONGEST).for_each(|i| inverse[i] = least_pivot(own[i][i]));
        }
        for place in 0..self.pattern.order.len() {
            let count = strips[self.pattern.order[place] as usize].len;
            with_count!(count, pivot(&mut self.own[place], &mut self.inverse[place]));
            with_count!(count, eliminate(self, place, strips));
        }
    }

    /// Solves in place of `x`.
    pub fn solve(&mut self, strips: &[Span]) {
        for place in 0..self.pattern.order.len() {
            let count = strips[self.pattern.order[place] as usize].len;
            with_count!(count, forward(self, place));
        }
        for place in (0..self.pattern.order.len()).rev() {
            let count = strips[self.pattern.order[place] as usize].len;
            with_count!(count, backward(self, place));
        }
    }
}

/// Factors a strip's own block. `inverse` holds the least pivots, then D⁻¹.
fn pivot<T: Scalar, const N: usize>(own: &mut Block<T>, inverse: &mut Row<T>) {
    for i in (0..N).rev() {
        for k in (i + 1..N).rev() {
            let l = own[k][i] * inverse[k];
            let row = own[k];
            for j in 0..=i {
                own[i][j] = l.neg_mul_add(row[j], own[i][j]);
            }
        }
        let (found, least) = (own[i][i], inverse[i]);
        let pivot = if found >= least { found } else { least };
        own[i][i] = pivot;
        inverse[i] = T::one() / pivot;
    }
}

/// Takes a strip out of those that it is coupled with.
fn eliminate<T: Scalar, const N: usize>(factor: &mut Factor<T>, place: usize, strips: &[Span]) {
    let Factor { pattern, own, others, inverse, panel, .. } = factor;
    let column = pattern.columns[place].range();
    let inverse = &inverse[place];
    let (done, rest) = others.split_at_mut(column.end);
    let blocks = &mut done[column.start..];
    panel.clear();
    for block in blocks.iter_mut() {
        panel.push(finish::<T, N>(block, &own[place], inverse));
    }
    let later = &pattern.later[column.clone()];
    for (a, i) in later.iter().map(|i| *i as usize).enumerate() {
        let rows = strips[pattern.order[i] as usize].len as usize;
        subtract::<T, N>(&panel[a], &blocks[a], rows, &mut own[i]);
        // Both lists ascend, and that of the other has all of this one's.
        let mut at = pattern.columns[i].range().start;
        for (b, j) in later.iter().enumerate().skip(a + 1) {
            while pattern.later[at] != *j {
                at += 1;
            }
            subtract::<T, N>(&panel[a], &blocks[b], rows, &mut rest[at - column.end]);
        }
    }
}

/// Finishes the rows of a strip in another block. Returns them over their pivots.
#[inline(always)]
fn finish<T: Scalar, const N: usize>(block: &mut Block<T>, own: &Block<T>, inverse: &Row<T>) -> Block<T> {
    for i in (0..N).rev() {
        for k in (i + 1..N).rev() {
            let (l, row) = (own[k][i] * inverse[k], block[k]);
            less(&mut block[i], l, &row);
        }
    }
    let mut panel = Block::<T>::default();
    for k in 0..N {
        panel[k] = block[k].map(|x| x * inverse[k]);
    }
    panel
}

/// Subtracts what elimination leaves of the block of two others.
#[inline(always)]
fn subtract<T: Scalar, const N: usize>(panel: &Block<T>, source: &Block<T>, rows: usize, target: &mut Block<T>) {
    for r in 0..rows.min(LONGEST) {
        let mut sum = target[r];
        for k in (0..N).rev() {
            less(&mut sum, panel[k][r], &source[k]);
        }
        target[r] = sum;
    }
}

/// Of L⁻ᵀ x, a strip's part, and what that takes from others.
fn forward<T: Scalar, const N: usize>(factor: &mut Factor<T>, place: usize) {
    let Factor { pattern, own, others, inverse, x, .. } = factor;
    let (done, rest) = x.split_at_mut(place + 1);
    let (x, own, inverse) = (&mut done[place], &own[place], &inverse[place]);
    for k in (0..N).rev() {
        let y = x[k] * inverse[k];
        x[k] = y;
        for j in 0..k {
            x[j] = y.neg_mul_add(own[k][j], x[j]);
        }
    }
    let column = pattern.columns[place].range();
    for (other, block) in pattern.later[column.clone()].iter().zip(&others[column]) {
        for k in (0..N).rev() {
            less(&mut rest[*other as usize - place - 1], x[k], &block[k]);
        }
    }
}

/// Of the solution, a strip's part.
fn backward<T: Scalar, const N: usize>(factor: &mut Factor<T>, place: usize) {
    let Factor { pattern, own, others, inverse, x, .. } = factor;
    let column = pattern.columns[place].range();
    let (done, rest) = x.split_at_mut(place + 1);
    let (x, own, inverse) = (&mut done[place], &own[place], &inverse[place]);
    let mut sums = [T::zero(); N];
    for (other, block) in pattern.later[column.clone()].iter().zip(&others[column]).rev() {
        let known = &rest[*other as usize - place - 1];
        for (sum, row) in sums.iter_mut().zip(block) {
            *sum = known.iter().zip(row).fold(*sum, |sum, (x, u)| x.mul_add(*u, sum));
        }
    }
    for k in 0..N {
        let sum = (0..k).fold(sums[k], |sum, j| x[j].mul_add(own[k][j], sum));
        x[k] = sum.neg_mul_add(inverse[k], x[k]);
    }
}
