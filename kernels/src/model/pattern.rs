//! Storage and sparsity of symmetric matrices over the dofs.

use super::Span;

/// Storage and sparsity of symmetric nv×nv matrices, lower triangle by rows (a *skyline*): row `i` holds columns
/// `first..=i` without a gap, from `start` on. The gaps inside a row are exact zeros, skipped by the runs of a
/// [`Pattern`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rows {
    /// Offset of column `first[i]` of row `i`.
    pub start: Vec<u32>,
    /// First stored column of row `i`: the lowest dof that can ever be coupled to `i`.
    pub first: Vec<u32>,
}

impl Rows {
    /// Offset of entry (i, j), j ≤ i and j ≥ first[i].
    #[inline(always)]
    pub fn at(&self, i: usize, j: usize) -> usize {
        self.start[i] as usize + j - self.first[i] as usize
    }

    /// The storage of row `i`, from its first column to the diagonal.
    #[inline(always)]
    pub fn row(&self, i: usize) -> std::ops::Range<usize> {
        let start = self.start[i] as usize;
        start..start + i + 1 - self.first[i] as usize
    }

    /// Offset of the diagonal entry of row `i`.
    #[inline(always)]
    pub fn diagonal(&self, i: usize) -> usize {
        self.at(i, i)
    }
}

/// Which entries below the diagonal are not structurally zero: for every row, ascending runs of columns, and for every
/// column its rows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pattern {
    /// Runs of all rows, as columns.
    pub runs: Vec<Span>,
    /// Runs of row `i`.
    pub rows: Vec<Span>,
    /// Rows of all columns.
    below: Vec<u32>,
    /// Rows of column `i`.
    columns: Vec<Span>,
}

impl Pattern {
    /// The pattern with the given runs of rows.
    pub fn new(runs: Vec<Span>, rows: Vec<Span>) -> Self {
        let mut pattern = Pattern { runs, rows, ..Pattern::default() };
        pattern.find_columns();
        pattern
    }

    /// An empty pattern with room for `runs` runs and `entries` entries of an `n`×`n` matrix.
    pub fn with_capacity(n: usize, runs: usize, entries: usize) -> Self {
        Pattern {
            runs: Vec::with_capacity(runs),
            rows: Vec::with_capacity(n),
            below: Vec::with_capacity(entries),
            columns: Vec::with_capacity(n),
        }
    }

    /// Finds the columns after the rows have changed.
    pub fn find_columns(&mut self) {
        let Pattern { runs, rows, below, columns } = self;
        columns.clear();
        columns.resize(rows.len(), Span::default());
        let entries = |row: &Span| runs[row.range()].iter().flat_map(|run| run.range());
        for j in rows.iter().flat_map(entries) {
            columns[j].len += 1;
        }
        let mut offset = 0;
        for column in columns.iter_mut() {
            let len = std::mem::take(&mut column.len);
            column.start = offset;
            offset += len;
        }
        below.clear();
        below.resize(offset as usize, 0);
        for (i, row) in rows.iter().enumerate().rev() {
            for j in entries(row) {
                below[columns[j].range().end] = i as u32;
                columns[j].len += 1;
            }
        }
    }

    /// The rows below the diagonal of column `i`, from the last to the first.
    #[inline(always)]
    pub fn column(&self, i: usize) -> &[u32] {
        &self.below[self.columns[i].range()]
    }

    /// The runs of row `i`.
    #[inline(always)]
    pub fn row(&self, i: usize) -> &[Span] {
        &self.runs[self.rows[i].range()]
    }
}
