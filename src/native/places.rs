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
    /// Numbers of the kinds that there are contacts of, and what moves.
    present: Vec<(usize, Sides)>,
    /// Worlds in which the contacts act, list by list.
    lanes: Vec<u32>,
    /// Where those of a list start, and their number.
    extents: Vec<(usize, usize)>,
    /// The same of the second lists, once there are any.
    acting: (Vec<u32>, Vec<(usize, usize)>),
    /// Worlds for which the second lists were made; `None`: they were not yet.
    open: Option<u32>,
    /// Of all contacts one list.
    list: Windows<COLUMNS>,
    /// Whether some are between trees.
    apart: bool,
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
            acting: (Vec::with_capacity(contacts), Vec::with_capacity(kinds.len())),
            open: None,
            list: Windows::with_capacity(1, contacts),
            apart: false,
        }
    }

    /// Sets the windows of all listed contacts.
    pub fn place<L: Block>(&mut self, step: &Step<'_, L>) {
        let (constraint, model) = (&step.ws.constraint, step.model.model);
        let rows = &constraint.contact_rows;
        let Places { starts, kinds, present, lanes, extents, list, apart, .. } = self;
        starts.clear();
        starts.extend(rows.iter().map(|row| Item::Row(row).starts(model, L::WIDTH)));
        kinds.clear();
        list.clear();
        lanes.clear();
        extents.clear();
        present.clear();
        self.open = None;
        *apart = constraint.coupled && rows.iter().any(|row| row.sides == Sides::Apart);
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
                present.push((kind, constraint.kinds[kind].sides));
            }
        }
        list.add(starts.iter().copied());
    }

    /// Whether some contacts are between trees.
    #[inline(always)]
    pub fn apart(&self) -> bool {
        self.apart
    }

    /// Numbers of the kinds that there are contacts of, and what moves.
    #[inline(always)]
    pub fn present(&self) -> &[(usize, Sides)] {
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

    /// The contacts from one to another.
    #[inline(always)]
    pub fn some(&self, start: usize, end: usize) -> List<'_> {
        self.list.list(0).part(start, end)
    }

    /// Leaves the contacts in the second lists that act in some world of `open`, which are fewer from call to call.
    #[inline(always)]
    pub fn narrow(&mut self, open: u32) {
        if self.open != Some(open) {
            self.drop_closed(open);
        }
    }

    /// Begins a solve, which may be another one with the same contacts.
    pub fn begin(&mut self) {
        self.open = None;
    }

    fn drop_closed(&mut self, open: u32) {
        let (lanes, extents) = &mut self.acting;
        if self.open.replace(open).is_none() {
            self.kinds.truncate(self.count);
            self.kinds.repeat();
            lanes.clone_from(&self.lanes);
            extents.clone_from(&self.extents);
        }
        for (kind, _) in &self.present {
            let (first, len) = &mut extents[*kind];
            let lanes = &mut lanes[*first..*first + *len];
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
