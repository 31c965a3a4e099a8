//! Pattern of the Hessian when rows join branches: entries of the inertia matrix, entries between the dofs of each joining
//! contact, of all joining equality constraints and of all tendons with joining rows, and what elimination fills in.

use std::ops::Range;

use crate::model::{Model, Pattern, Span};

/// The pattern, and the bit sets from which it is made.
#[derive(Clone, Debug, Default)]
pub struct Fill {
    /// The filled pattern of the current block.
    pub pattern: Pattern,
    /// Columns below the diagonal, for every row from the word of its first stored column to that of the diagonal.
    bits: Vec<u64>,
    /// Where the word of column 0 of each row would be in `bits`, and the words that there are.
    rows: Vec<(isize, Range<usize>)>,
}

impl Fill {
    /// Room for any pattern; none if nothing joins branches.
    pub fn new<T>(model: &Model<T>) -> Self {
        if !joins(model) {
            return Fill::default();
        }
        let (bits, runs) = needs(model);
        let nv = model.sizes.nv;
        let mut start = 0;
        let place = |(i, first): (usize, &u32)| {
            let words = *first as usize / 64..i / 64 + 1;
            let row = (start as isize - words.start as isize, words.clone());
            start += words.len();
            row
        };
        Fill {
            rows: model.rows.first.iter().enumerate().map(place).collect(),
            pattern: Pattern::with_capacity(nv, runs, model.sizes.nm),
            bits: vec![0; bits],
        }
    }

    /// Whether something other than contacts joins branches: some equality constraint, or row along a tendon.
    pub fn always<T>(model: &Model<T>) -> bool {
        model.equalities.iter().any(|equality| equality.cross) || model.tendon_joins().next().is_some()
    }

    /// Bytes of that.
    pub fn bytes<T>(model: &Model<T>) -> usize {
        if !joins(model) {
            return 0;
        }
        let (bits, runs) = needs(model);
        8 * (bits + runs) + 4 * model.sizes.nm + 40 * model.sizes.nv
    }

    /// Finds the pattern for contacts of the given pairs of links, and the model's equality constraints and tendons.
    pub fn find<T>(&mut self, model: &Model<T>, pairs: impl Iterator<Item = u32>) {
        self.bits.fill(0);
        for i in 0..model.sizes.nv {
            for run in model.tree_pattern.row(i) {
                run.range().for_each(|j| self.set(i, j));
            }
        }
        for pair in pairs.map(|p| &model.pairs[p as usize]) {
            if pair.cross {
                let dofs = &model.pair_dofs[pair.dofs.range()];
                for (n, i) in dofs.iter().enumerate() {
                    dofs[..n].iter().for_each(|j| self.set(i.dof as usize, j.dof as usize));
                }
            }
        }
        for equality in model.equalities.iter().filter(|equality| equality.cross) {
            let dofs = &model.equality_dofs[equality.dofs.range()];
            for (n, i) in dofs.iter().enumerate() {
                dofs[..n].iter().for_each(|j| self.set(i.dof as usize, j.dof as usize));
            }
        }
        for dofs in model.tendon_joins() {
            for (n, i) in dofs.iter().enumerate() {
                dofs[..n].iter().for_each(|j| self.set(i.dof as usize, j.dof as usize));
            }
        }
        self.close();
        self.collect_runs();
    }

    fn set(&mut self, i: usize, j: usize) {
        let word = self.word(i, j / 64);
        self.bits[word] |= 1 << (j % 64);
    }

    /// Where the word of row `i` with columns from 64 `w` on is.
    fn word(&self, i: usize, w: usize) -> usize {
        (self.rows[i].0 + w as isize) as usize
    }

    /// Eliminating row k couples all its columns: row i of them gets those below i.
    fn close(&mut self) {
        for k in (0..self.rows.len()).rev() {
            let words = self.rows[k].1.clone();
            let start = self.word(k, words.start);
            let (above, row) = self.bits.split_at_mut(start);
            for word in words.clone() {
                let mut left = row[word - words.start];
                while left != 0 {
                    let i = word * 64 + left.trailing_zeros() as usize;
                    left &= left - 1;
                    // The rows of its columns begin no later than row k does.
                    let first = (self.rows[i].0 + words.start as isize) as usize;
                    for (to, from) in above[first..].iter_mut().zip(&row[..word - words.start]) {
                        *to |= from;
                    }
                    above[first + word - words.start] |= row[word - words.start] & ((1 << (i % 64)) - 1);
                }
            }
        }
    }

    fn collect_runs(&mut self) {
        let Fill { pattern, bits, rows: places, .. } = self;
        let Pattern { runs, rows, .. } = pattern;
        runs.clear();
        rows.clear();
        for (origin, words) in places {
            let start = runs.len();
            for w in words.clone() {
                let word = &bits[(*origin + w as isize) as usize];
                let mut left = *word;
                while left != 0 {
                    let at = left.trailing_zeros();
                    let len = (left >> at).trailing_ones();
                    left &= !(u64::MAX.checked_shr(64 - len).unwrap_or(0) << at);
                    let first = w as u32 * 64 + at;
                    match runs[start..].last_mut() {
                        Some(last) if last.start + last.len == first => last.len += len,
                        _ => runs.push(Span { start: first, len }),
                    }
                }
            }
            rows.push(Span { start: start as u32, len: (runs.len() - start) as u32 });
        }
        pattern.find_columns();
    }
}

/// Whether some contact, equality constraint or row along a tendon joins branches in a Hessian that all worlds of a block share.
pub(super) fn joins<T>(model: &Model<T>) -> bool {
    (model.own.is_empty() && model.pairs.iter().any(|pair| pair.cross)) || Fill::always(model)
}

/// Words of bits, and most runs. A row of n columns below the diagonal has at most (n + 1)/2 runs.
fn needs<T>(model: &Model<T>) -> (usize, usize) {
    let firsts = || model.rows.first.iter().map(|first| *first as usize).enumerate();
    let words = firsts().map(|(i, first)| i / 64 + 1 - first / 64).sum();
    (words, firsts().map(|(i, first)| (i - first).div_ceil(2)).sum())
}
