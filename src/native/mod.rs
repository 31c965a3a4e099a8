//! Machine code made for a model: an executor of the parts of a step.
//!
//! A part is recorded and compiled when it is first needed, once per model, number type, instruction set and set of varying
//! quantities that it depends on. Parts whose straight-line code would be too large stay with the kernels.

mod library;
mod patterns;
mod places;
mod record;
mod solve;
mod structure;
#[cfg(test)]
mod tests;

use std::sync::{Arc, OnceLock};

use lanesim_codegen::{Block, Float, InstructionSet, Scratch, Windows};
use lanesim_kernels::model::{Model as Tables, Quantities, Sides};
use lanesim_kernels::part::{COLUMNS, Executor, Family, Item, KIND_COLUMNS, Op, Part, Parts, Step, Threes};
use lanesim_kernels::solver::Tiling;
use lanesim_kernels::workspace::Workspace;

pub(crate) use library::ModelCode;
use patterns::Found;
use places::Places;
use solve::Solve;

/// Most bytes of a workspace of one world for which parts are recorded.
const MOST_BYTES: usize = 32 << 20;

const BOUND: &str = "a call that was just bound";

/// The code of a model for one number type, by instruction set, made at first use.
pub(crate) struct Codes<T: Float>([OnceLock<Result<Arc<ModelCode<T>>, String>>; 2]);

impl<T: Float> Default for Codes<T> {
    fn default() -> Self {
        Codes(Default::default())
    }
}

impl<T: Float> Codes<T> {
    /// The code for an instruction set, or the best that the machine has; if there can be none, why.
    pub fn get(&self, tables: &Arc<Tables<T>>, isa: Option<InstructionSet>) -> Result<Arc<ModelCode<T>>, String> {
        // Every part is recorded in a workspace of its own.
        let bytes = Workspace::<T>::bytes(tables);
        if bytes > MOST_BYTES {
            return Err(format!(
                "the model is too large for machine code: its workspace has {} MiB a world",
                bytes >> 20
            ));
        }
        let isa = isa.map_or_else(InstructionSet::detect, Ok).map_err(|e| e.to_string())?;
        let place = &self.0[usize::from(isa == InstructionSet::Avx512)];
        place.get_or_init(|| ModelCode::new(tables, isa).map(Arc::new).map_err(|e| e.to_string())).clone()
    }
}

impl<T: Float> std::fmt::Debug for Codes<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Codes").finish_non_exhaustive()
    }
}

/// A worker's way to the code.
pub(crate) struct Native<T: Float> {
    /// Where nothing varies.
    root: Arc<ModelCode<T>>,
    code: Arc<ModelCode<T>>,
    scratch: Scratch,
    /// By number of part, the fields of its code; none: it was not asked for yet, or has no code.
    sets: Vec<Threes>,
    /// Of the items of a call.
    windows: Windows<COLUMNS>,
    kinds: Windows<KIND_COLUMNS>,
    worlds: Vec<u32>,
    lists: Lists,
}

/// What the parts of a solve are run for.
struct Lists {
    /// The contacts.
    places: Places,
    /// Patterns that contacts have filled in.
    filled: Found,
    /// Tiles of the Hessian, and of every stretch their windows.
    tiling: Tiling,
    tiles: Windows<KIND_COLUMNS>,
}

impl<T: Float> Native<T> {
    pub fn new(code: Arc<ModelCode<T>>) -> Self {
        let most = code.tables.capacity().contacts;
        let places = Places::with_capacity(most, &code.common.rows);
        let (filled, tiles) = (Found::new(&code.tables), Windows::with_capacity(0, 0));
        let lists = Lists { places, filled, tiling: Tiling::default(), tiles };
        let (windows, kinds) = (Windows::with_capacity(1, most), Windows::with_capacity(1, most));
        let (worlds, sets) = (Vec::with_capacity(most), vec![Threes::NONE; code.common.count()]);
        Native { root: code.clone(), code, scratch: Scratch::new(), sets, windows, kinds, worlds, lists }
    }

    /// Number of a part, and the fields of its code; `None`: it has no code.
    #[inline(always)]
    fn find(&mut self, part: Part) -> Option<(usize, Threes)> {
        let call = self.code.common.number(part)?;
        if self.sets[call] == Threes::NONE {
            self.sets[call] = self.code.get(&self.root, part)?.set;
        }
        Some((call, self.sets[call]))
    }
}

impl<L: Block> Executor<L> for Native<L::Float> {
    fn vary(&mut self, model: &Arc<Tables<L::Float>>, set: Quantities) {
        // A new one from the start: places of patterns that were kept are those of the code as it was.
        *self = Native::new(self.root.clone());
        self.code = self.root.for_set(model, set);
    }

    fn in_groups(&self) -> bool {
        true
    }

    fn run(&mut self, part: Part, given: u32, returned: &mut [u32], step: &mut Step<'_, L>) {
        let Some((call, set)) = self.find(part) else {
            return part.run_lanes(&Item::Whole, given, returned, step);
        };
        let Native { root, code, scratch, .. } = self;
        let mut session = code.lend(set, (scratch, step), &mut &[][..]);
        while session.run_into(call, given, returned).is_none() {
            code.bind(root, part, &mut session, call);
        }
    }

    fn each(&mut self, part: Part, items: &mut dyn Iterator<Item = Item<'_>>, given: u32, step: &mut Step<'_, L>) {
        let Some((call, set)) = self.find(part) else {
            return items.for_each(|item| part.run_lanes(&item, given, &mut [], step));
        };
        let Native { root, code, scratch, windows, kinds, worlds, .. } = self;
        let (model, width, masks) = (step.model.model, L::WIDTH, [given, u32::MAX]);
        let mut session = code.lend(set, (scratch, step), &mut &[][..]);
        if !session.has(call) {
            code.bind(root, part, &mut session, call);
        }
        if code.common.columns(part) == KIND_COLUMNS {
            kinds.clear();
            kinds.add(items.map(|item| *item.starts(model, width).first_chunk().expect("more columns")));
            return session.run_each(call, masks, kinds.list(0)).expect(BOUND);
        }
        windows.clear();
        worlds.clear();
        windows.add(items.map(|item| {
            worlds.push(item.worlds() & given);
            item.starts(model, width)
        }));
        match part.op.family() {
            Family::Shapes => session.run_each_masked(call, worlds, windows.list(0)),
            _ => session.run_each(call, masks, windows.list(0)),
        }
        .expect(BOUND);
    }

    fn measure(&mut self, step: &mut Step<'_, L>, run: &mut dyn FnMut(&mut dyn Parts)) -> bool {
        self.lists.places.place(step);
        let mut all = Threes::NONE;
        for row in &step.ws.constraint.contact_rows {
            let op = if row.sides == Sides::One { Op::Measure } else { Op::MeasureBoth };
            let Some((_, set)) = self.find(row.part(op)) else { return false };
            all = all.or(set);
        }
        let Native { root, code, scratch, lists, .. } = self;
        run(&mut Solve::on(all, (root, code), (scratch, lists), step));
        true
    }

    fn solve(&mut self, step: &mut Step<'_, L>, run: &mut dyn FnMut(&mut dyn Parts)) -> bool {
        let Native { root, code, scratch, lists, .. } = self;
        let Some(mut parts) = Solve::new((root, code), (scratch, lists), step) else { return false };
        run(&mut parts);
        true
    }
}
