//! Where the contacts of a solve have their entries, as lists of windows.

use lanesim_codegen::{Block, Windows, WindowsList};
use lanesim_kernels::constraint::Classes;
use lanesim_kernels::model::Sides;
use lanesim_kernels::part::{COLUMNS, Item, KIND_COLUMNS, Starts, Step};

/// A list of windows of contacts.
pub type List<'a> = WindowsList<'a, COLUMNS>;
/// One for parts of the iteration.
pub type KindList<'a> = WindowsList<'a, KIND_COLUMNS>;

/// Windows of a block's contacts.
pub struct Places {
    /// Of every contact.
    starts: Vec<Starts>,
    /// Of every kind a list of all, then of every kind one of those that act in some world that still iterates.
    kinds: Windows<KIND_COLUMNS>,
    count: usize,
    /// Numbers of the kinds that there are contacts of.
    present: Vec<usize>,
    /// Worlds in which the contacts act, list by list; of the second lists once there are any.
    lanes: Vec<u32>,
    /// Where those of a list start, and their number.
    extents: Vec<(usize, usize)>,
    /// Worlds for which the second lists were made; `None`: they were not yet.
    open: Option<u32>,
    /// Of every contact both sides of which move a list of its own.
    singles: Windows<COLUMNS>,
    /// By contact, the number of that list.
    numbers: Vec<u32>,
    /// The first contact between trees, or the number of all.
    apart: usize,
}

impl Places {
    /// Room for so many contacts.
    pub fn with_capacity(contacts: usize, classes: &Classes) -> Self {
        let kinds: Vec<_> = classes.kinds.iter().filter(|row| row.sides != Sides::Apart).collect();
        Places {
            starts: Vec::with_capacity(contacts),
            kinds: Windows::with_capacity(2 * kinds.len(), 2 * contacts),
            count: kinds.len(),
            present: Vec::with_capacity(kinds.len()),
            lanes: Vec::with_capacity(contacts),
            extents: Vec::with_capacity(kinds.len()),
            open: None,
            singles: Windows::with_capacity(contacts, contacts),
            numbers: Vec::with_capacity(contacts),
            apart: 0,
        }
    }

    /// Sets the windows of all listed contacts.
    pub fn place<L: Block>(&mut self, step: &Step<'_, L>) {
        let (constraint, model) = (&step.ws.constraint, step.model.model);
        let rows = &constraint.contact_rows;
        let Places { starts, kinds, present, lanes, extents, singles, numbers, .. } = self;
        starts.clear();
        starts.extend(rows.iter().map(|row| Item::Row(row).starts(model, L::WIDTH)));
        (kinds.clear(), singles.clear());
        (lanes.clear(), extents.clear(), present.clear());
        self.open = None;
        self.apart = rows.len();
        if constraint.between_trees && constraint.coupled {
            self.apart = rows.iter().position(|row| row.sides == Sides::Apart).unwrap_or(rows.len());
        }
        for kind in 0..self.count {
            let first = lanes.len();
            let mine = rows.iter().zip(&*starts).filter(|(row, _)| row.number as usize == kind);
            kinds.add(mine.map(|(row, starts)| {
                lanes.push(row.lanes);
                *starts.first_chunk().expect("more columns")
            }));
            let len = lanes.len() - first;
            extents.push((first, len));
            if len != 0 {
                present.push(kind);
            }
        }
        numbers.clear();
        if constraint.coupled {
            let mut count = 0;
            for (row, starts) in rows.iter().zip(&*starts) {
                numbers.push(count);
                if row.sides != Sides::One {
                    singles.add(std::iter::once(*starts));
                    count += 1;
                }
            }
        }
    }

    /// The first contact between trees, or the number of all.
    #[inline(always)]
    pub fn apart(&self) -> usize {
        self.apart
    }

    /// Numbers of the kinds that there are contacts of.
    #[inline(always)]
    pub fn present(&self) -> &[usize] {
        &self.present
    }

    /// All contacts of a kind.
    #[inline(always)]
    pub fn all(&self, kind: usize) -> KindList<'_> {
        self.kinds.list(kind)
    }

    /// Those that act in some world that still iterates, after [`narrow`](Places::narrow).
    #[inline(always)]
    pub fn active(&self, kind: usize) -> KindList<'_> {
        self.kinds.list(self.count + kind)
    }

    /// One contact, both sides of which move.
    #[inline(always)]
    pub fn single(&self, row: usize) -> List<'_> {
        self.singles.list(self.numbers[row] as usize)
    }

    /// Leaves the contacts in the second lists that act in some world of `open`, which are fewer from call to call.
    #[inline(always)]
    pub fn narrow(&mut self, open: u32) {
        if self.open != Some(open) {
            self.drop_closed(open);
        }
    }

    fn drop_closed(&mut self, open: u32) {
        if self.open.replace(open).is_none() {
            self.kinds.repeat();
        }
        for kind in &self.present {
            let (first, len) = &mut self.extents[*kind];
            let lanes = &mut self.lanes[*first..*first + *len];
            let mut kept = 0;
            self.kinds.retain(self.count + kind, |item| {
                let keep = lanes[item] & open != 0;
                if keep {
                    lanes[kept] = lanes[item];
                    kept += 1;
                }
                keep
            });
            *len = kept;
        }
    }
}
