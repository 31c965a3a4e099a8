//! Code that runs once for every item of a list, on windows into larger fields.

use super::{FieldSlice, Fragment, Scratch};
use crate::error::CompileError;
use crate::float::{BLOCK_BYTES, Float};
use crate::isa::InstructionSet;
use crate::layout::Columns;
use crate::recording::Program;

/// Lists of items, each of which says where windows into fields start, in `N` columns. They are filled once and used by
/// any number of runs, by any code that was compiled for `N` columns.
#[derive(Clone, Debug, Default)]
pub struct Windows<const N: usize> {
    /// Starts in bytes, as the code adds them to addresses.
    offsets: Vec<[usize; N]>,
    lists: Vec<Extent<N>>,
}

/// A list among the others.
#[derive(Clone, Copy, Debug)]
struct Extent<const N: usize> {
    first: usize,
    end: usize,
    /// The largest start in every column, entries.
    largest: [usize; N],
}

/// A list of [`Windows`].
#[derive(Clone, Copy, Debug)]
pub struct WindowsList<'a, const N: usize> {
    pub(super) offsets: &'a [[usize; N]],
    pub(super) largest: [usize; N],
}

impl<const N: usize> Windows<N> {
    /// No lists, and room for some with so many items together.
    pub fn with_capacity(lists: usize, items: usize) -> Self {
        Windows { offsets: Vec::with_capacity(items), lists: Vec::with_capacity(lists) }
    }

    /// Forgets all lists and keeps their memory.
    pub fn clear(&mut self) {
        self.offsets.clear();
        self.lists.clear();
    }

    /// Adds a list of items: the first entry of the window of every column.
    #[inline]
    pub fn add(&mut self, items: impl Iterator<Item = [usize; N]>) {
        let first = self.offsets.len();
        let mut largest = [0; N];
        for starts in items {
            for (largest, start) in largest.iter_mut().zip(starts) {
                *largest = start.max(*largest);
            }
            // Offsets that wrap belong to starts beyond every field, which no run accepts.
            self.offsets.push(starts.map(|start| start.wrapping_mul(BLOCK_BYTES)));
        }
        self.lists.push(Extent { first, end: self.offsets.len(), largest });
    }

    /// Adds lists with the items of all lists that there are, in the same order.
    pub fn repeat(&mut self) {
        let (lists, items) = (self.lists.len(), self.offsets.len());
        self.offsets.extend_from_within(..);
        self.lists.extend_from_within(..);
        for list in &mut self.lists[lists..] {
            (list.first, list.end) = (list.first + items, list.end + items);
        }
    }

    /// Drops all lists but the first ones, so many.
    pub fn truncate(&mut self, lists: usize) {
        self.lists.truncate(lists);
        let end = self.lists.iter().map(|list| list.end).max().unwrap_or(0);
        self.offsets.truncate(end);
    }

    /// Drops the items of a list for which `keep` does not hold, by their place in it; the others move up.
    ///
    /// # Panics
    ///
    /// If there are not so many lists.
    pub fn retain(&mut self, number: usize, mut keep: impl FnMut(usize) -> bool) {
        let Extent { first, end, .. } = self.lists[number];
        let offsets = &mut self.offsets[first..end];
        let mut kept = 0;
        for item in 0..offsets.len() {
            if keep(item) {
                // Mostly they stay where they are.
                if kept != item {
                    offsets[kept] = offsets[item];
                }
                kept += 1;
            }
        }
        // The largest starts bound those of fewer items.
        self.lists[number].end = first + kept;
    }

    /// List by number, in the order in which they were added.
    ///
    /// # Panics
    ///
    /// If there are not so many.
    #[inline]
    pub fn list(&self, number: usize) -> WindowsList<'_, N> {
        let Extent { first, end, largest } = &self.lists[number];
        WindowsList { offsets: &self.offsets[*first..*end], largest: *largest }
    }
}

impl<const N: usize> WindowsList<'_, N> {
    /// Number of items.
    #[inline]
    pub fn len(&self) -> usize {
        self.offsets.len()
    }

    /// The items from one to another.
    ///
    /// # Panics
    ///
    /// If there are not so many.
    #[inline]
    pub fn part(&self, start: usize, end: usize) -> Self {
        let offsets = &self.offsets[start..end];
        let mut largest = [0; N];
        for item in offsets {
            for (largest, offset) in largest.iter_mut().zip(item) {
                *largest = (offset / BLOCK_BYTES).max(*largest);
            }
        }
        WindowsList { offsets, largest }
    }

    /// Whether there is no item.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.offsets.is_empty()
    }
}

impl<T: Float> Program<T> {
    /// Compiles code that [runs](Fragment::run_each) once for every item of a list of [`Windows<N>`](Windows). `columns`
    /// says, by field, which column of the items the field's window starts at; a field without one is the same for all. Of
    /// uniform numbers windows start at whole blocks: as many from each to the next as a block has worlds.
    ///
    /// # Errors
    ///
    /// As for [`compile`](Program::compile).
    ///
    /// # Panics
    ///
    /// If the program returns masks, `columns` is of another length than its fields, or names a column that is not among
    /// `N`.
    pub fn compile_each<const N: usize>(
        &self,
        isa: InstructionSet,
        columns: &[Option<usize>],
    ) -> Result<Fragment<T>, CompileError> {
        assert!(self.masks_out.is_empty(), "code that returns masks runs once");
        assert_eq!(columns.len(), self.fields.len(), "number of fields");
        let column = |column: &Option<usize>| column.inspect(|i| assert!(*i < N, "column {i} of {N}"));
        let of_fields = columns.iter().map(column).map(|column| column.map(|i| i as u32));
        self.compile_with(isa, Some(Columns { of_fields: of_fields.collect(), width: N }))
    }
}

impl<T: Float> Fragment<T> {
    /// Runs code that was compiled for windows, once for every item of the list, one after the other: on the recorded number
    /// of entries of every field, from where the item says. What one run writes, the next one reads. Without items it does
    /// nothing.
    ///
    /// # Panics
    ///
    /// If the code was not compiled for windows of `N` columns, the number of fields or masks or a field's kind differs from
    /// what was recorded, a field that is written was lent for reading only, a window does not lie within its field, or the
    /// length of a field without windows differs.
    pub fn run_each<const N: usize>(
        &self,
        scratch: &mut Scratch,
        fields: &mut [FieldSlice<'_, T>],
        masks_in: &[u32],
        windows: WindowsList<'_, N>,
    ) {
        if !windows.is_empty() {
            self.call_with(scratch, fields, &windows.largest).run_each(masks_in, windows);
        }
    }
}
