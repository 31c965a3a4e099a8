//! Pattern of the Hessian when contacts join branches: entries of the inertia matrix, entries between the dofs of each
//! joining contact, and what elimination fills in.

use crate::model::{Model, Pattern, Sizes, Span};

/// The pattern, and the bit sets from which it is made.
#[derive(Clone, Debug, Default)]
pub struct Fill {
    /// The filled pattern of the current block.
    pub pattern: Pattern,
    /// Whether it has been found.
    pub known: bool,
    /// `words` words per row: columns below the diagonal.
    bits: Vec<u64>,
    words: usize,
}

impl Fill {
    /// Room for any pattern.
    pub fn new(sizes: &Sizes) -> Self {
        let words = sizes.nv.div_ceil(64);
        // A row of n columns has at most n/2 runs.
        let runs = sizes.nv * (sizes.nv / 4 + 1);
        Fill {
            pattern: Pattern::with_capacity(sizes.nv, runs, sizes.nm),
            bits: vec![0; words * sizes.nv],
            words,
            known: false,
        }
    }

    /// Finds the pattern for contacts of the given pairs of links.
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
        self.close();
        self.collect_runs();
        self.known = true;
    }

    fn set(&mut self, i: usize, j: usize) {
        self.bits[i * self.words + j / 64] |= 1 << (j % 64);
    }

    /// Eliminating row k couples all its columns: row i of them gets those below i.
    fn close(&mut self) {
        let words = self.words;
        let nv = self.bits.len().checked_div(words).unwrap_or(0);
        for k in (0..nv).rev() {
            let (above, row) = self.bits.split_at_mut(k * words);
            for word in 0..words {
                let mut left = row[word];
                while left != 0 {
                    let i = word * 64 + left.trailing_zeros() as usize;
                    left &= left - 1;
                    for w in 0..word {
                        above[i * words + w] |= row[w];
                    }
                    above[i * words + word] |= row[word] & ((1 << (i % 64)) - 1);
                }
            }
        }
    }

    fn collect_runs(&mut self) {
        let Fill { pattern, bits, words, .. } = self;
        let Pattern { runs, rows, .. } = pattern;
        runs.clear();
        rows.clear();
        for row in bits.chunks_exact((*words).max(1)) {
            let start = runs.len();
            for (w, word) in row.iter().enumerate() {
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
