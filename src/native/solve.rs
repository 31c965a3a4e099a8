//! The parts of a solve with their calls made ready: bound when they are first needed, and kept from solve to solve as long as
//! the fields are the same and the code is.

use std::sync::Arc;

use lanesim_codegen::{Block, Float, Scratch, Session};
use lanesim_kernels::constraint::ContactRow;
use lanesim_kernels::model::{Model as Tables, Sides};
use lanesim_kernels::options;
use lanesim_kernels::part::{self, Family, Item, Op, Part, Parts, Step, Threes};
use lanesim_kernels::solver::{Phase, Work};

use super::Lists;
use super::library::{Coded, KIND_OPS, ModelCode};
use super::patterns::{Found, Joined};

/// What the type says that holds them: parts for which there is no code are not bound.
const COMPILED: &str = "all parts have code";

/// The pattern of the factor at hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Factor {
    /// A filled one, by its place.
    Filled(usize),
    /// The fullest.
    Full,
}

/// Code where nothing varies, and as it is.
type Codes<'a, T> = (&'a Arc<ModelCode<T>>, &'a Arc<ModelCode<T>>);

/// Parts for contacts and for a solve.
pub struct Solve<'a, L: Block> {
    root: &'a Arc<ModelCode<L::Float>>,
    code: &'a Arc<ModelCode<L::Float>>,
    /// By op, the number of its first part.
    bases: &'a [usize],
    lists: &'a mut Lists,
    rows: &'a [ContactRow],
    factor: Factor,
    /// One that fits all listed contacts.
    whole: Factor,
    /// The worlds for whose contacts it was chosen, and whether some join; `None`: it was not yet.
    chosen: Option<(u32, bool)>,
    /// Whether anything that is listed joins branches, and worlds in which equality constraints act that do.
    cross: bool,
    joining: u32,
    session: Session<'a, L::Float>,
}

impl<'a, L: Block> Solve<'a, L> {
    /// Lends the fields; `None` unless all parts that the solve needs have code.
    pub fn new(
        (root, code): Codes<'a, L::Float>,
        (scratch, lists): (&'a mut Scratch, &'a mut Lists),
        step: &'a mut Step<'_, L>,
    ) -> Option<Self> {
        let constraint = &step.ws.constraint;
        // A world's own factor is not code.
        let own = constraint.cross && !code.tables.own.is_empty();
        if own || step.model.options.solver == options::Solver::Pgs {
            return None;
        }
        let set = code.solves(root)?;
        let lent = |coded: &Coded<_>| set.includes(coded.set);
        let coded = |row: &ContactRow, ops: &[Op]| ops.iter().all(|op| code.get(root, row.part(*op)).is_some_and(lent));
        let tiled = !code.tables.tiles.is_empty();
        let of_pair = |row: &ContactRow| match row.sides {
            Sides::One => true,
            Sides::Two => coded(row, &PAIR_OPS),
            Sides::Apart => (tiled || coded(row, &PAIR_OPS)) && coded(row, &KIND_OPS),
        };
        if constraint.coupled && !constraint.contact_rows.iter().all(of_pair) {
            return None;
        }
        let (cross, joining) = (constraint.cross, constraint.joining());
        // Whatever of them acts later fits where all do.
        let full = || [Op::Descend, Op::Polish].into_iter().all(|op| code.get(root, Part::of(op, 1)).is_some());
        if tiled && cross {
            lists.find((root, code), &constraint.contact_rows, u32::MAX, L::WIDTH)?;
        }
        let whole = if tiled || !cross || full() {
            Factor::Full
        } else {
            pattern((root, code), &mut lists.filled, (&constraint.contact_rows, joining), u32::MAX)?
        };
        lists.places.begin();
        let parts = Solve::on(set, (root, code), (scratch, lists), step);
        Some(Solve { factor: whole, whole, cross, joining, ..parts })
    }

    /// Lends the fields of a set; nothing joins branches.
    pub fn on(
        set: Threes,
        (root, code): Codes<'a, L::Float>,
        (scratch, lists): (&'a mut Scratch, &'a mut Lists),
        step: &'a mut Step<'_, L>,
    ) -> Self {
        let (mut rows, bases, full) = (&[][..], code.common.bases(), Factor::Full);
        let session = code.lend(set, (scratch, step), &mut rows);
        let (chosen, cross, joining) = (None, false, 0);
        Solve { root, code, bases, lists, rows, factor: full, whole: full, chosen, cross, joining, session }
    }

    /// Number of a call: that of the part, or one beyond those of all for a pattern.
    #[inline(always)]
    fn call(&self, part: Part) -> usize {
        match (part, self.factor) {
            (Part { op: op @ (Op::Descend | Op::Polish), of: 1 }, Factor::Filled(place)) => {
                self.code.common.count() + 2 * place + usize::from(op == Op::Polish)
            }
            _ => self.bases[part.op as usize] + part.of as usize,
        }
    }

    /// Runs a part in the order of the list: for all that follow each other and are of one class at once.
    fn in_order(&mut self, op: Op, acting: u32, masks: [u32; 2]) {
        let by_kind = |sides: Sides| op.family() == Family::Kind && sides != Sides::Apart;
        let has = |row: &ContactRow| !by_kind(row.sides) && op.applies(row.sides) && row.lanes & acting != 0;
        let mut end = 0;
        while let Some(skipped) = self.rows[end..].iter().position(has) {
            let start = end + skipped;
            let part = self.rows[start].part(op);
            let alike = |row: &ContactRow| has(row) && row.part(op) == part;
            end = start + self.rows[start..].iter().take_while(|row| alike(row)).count();
            let call = self.bases[op as usize] + part.of as usize;
            while self.session.run_each(call, masks, self.lists.places.some(start, end)).is_none() {
                bind((self.root, self.code), &mut self.session, part, call);
            }
        }
    }
}

/// Makes a part ready.
#[cold]
fn bind<T: Float>((root, code): Codes<'_, T>, session: &mut Session<'_, T>, part: Part, call: usize) {
    let pattern = call.checked_sub(code.common.count()).map(|of_pattern| of_pattern / 2);
    let coded: &Coded<_> = match pattern {
        Some(place) => code.patterns.get(code, place, part),
        None => code.get(root, part),
    }
    .expect(COMPILED);
    coded.bind(session, call);
}

impl Lists {
    /// Finds the tiles for the contacts that act in some world of `acting`; whether these join branches. `None`: not all that is to be
    /// done with them has code.
    fn find<T: Float>(
        &mut self,
        (root, code): Codes<'_, T>,
        rows: &[ContactRow],
        acting: u32,
        width: usize,
    ) -> Option<bool> {
        let Lists { tiling, tiles, .. } = self;
        let (model, (joined, new)) = (&*code.tables, tiling.find(&code.tables, rows, acting));
        if !new {
            return Some(joined);
        }
        tiles.clear();
        for stretch in (0..tiling.count()).map(|number| tiling.stretch(number)) {
            if code.get(root, Part::of(stretch.work.into(), stretch.shape)).is_none() {
                tiling.forget();
                return None;
            }
            let starts = |item: Item<'_>| *item.starts(model, width).first_chunk().expect("more columns");
            if stretch.work == Work::Couple {
                let patches = tiling.patches[stretch.items.range()].iter();
                let item = |[_, row, patch]: &[u32; 3]| {
                    starts(Item::Patch(&rows[*row as usize], model.tiles.patch(*patch as usize)))
                };
                tiles.add(patches.map(item));
            } else {
                tiles.add(tiling.tiles[stretch.items.range()].iter().map(|tile| starts(Item::Tile(tile))));
            }
        }
        Some(joined)
    }
}

/// Parts of contacts both sides of which move.
const PAIR_OPS: [Op; 1] = [Op::Couple];

/// Whether a contact that acts in some world of `acting` couples dofs that the inertia matrix does not.
fn joins<T>(tables: &Tables<T>, row: &ContactRow, acting: u32) -> bool {
    row.lanes & acting != 0 && tables.pairs[row.pair as usize].cross
}

/// A pattern with code that has room for the contacts that act in some world of `acting`.
fn pattern<T: Float>(
    (root, code): Codes<'_, T>,
    found: &mut Found,
    (rows, joining): (&[ContactRow], u32),
    acting: u32,
) -> Option<Factor> {
    let mut joined_rows = rows.iter().filter(|row| joins(&code.tables, row, acting)).peekable();
    if joined_rows.peek().is_none() && joining & acting == 0 {
        return Some(Factor::Full);
    }
    let mut joined = Joined::default();
    if joined_rows.all(|row| code.patterns.add(row.pair, &mut joined)) {
        let place = found.find(&code.patterns, &code.tables, &joined);
        if let Some(place) = place.filter(|place| code.patterns.is_coded(code, *place)) {
            return Some(Factor::Filled(place));
        }
    }
    let full = |op| code.get(root, Part::of(op, 1)).is_some();
    [Op::Descend, Op::Polish].into_iter().all(full).then_some(Factor::Full)
}

impl<L: Block> Parts for Solve<'_, L> {
    fn rows(&self) -> &[ContactRow] {
        self.rows
    }

    #[inline]
    fn run(&mut self, part: Part, [given, lanes]: [u32; 2]) -> [u32; 2] {
        let call = self.call(part);
        loop {
            if let Some(masks) = self.session.run(call, given, lanes) {
                return masks;
            }
            bind((self.root, self.code), &mut self.session, part, call);
        }
    }

    fn each(&mut self, op: Op, acting: u32, masks: [u32; 2]) {
        if op.family() != Family::Kind {
            return self.in_order(op, acting, masks);
        }
        if self.lists.places.apart() {
            self.in_order(op, acting, masks);
        }
        let Solve { root, code, lists: Lists { places, .. }, session, .. } = self;
        let whole = acting == u32::MAX;
        if !whole {
            places.narrow(acting);
        }
        let first = self.bases[op as usize];
        for place in 0..places.present().len() {
            let (kind, sides) = places.present()[place];
            let windows = if whole { places.all(kind) } else { places.active(kind) };
            if windows.is_empty() || !op.applies(sides) {
                continue;
            }
            let call = first + kind;
            while session.run_each(call, masks, windows).is_none() {
                bind((root, code), session, Part::of(op, kind as u32), call);
            }
        }
    }

    fn tiles(&mut self, phase: Phase, lanes: u32) {
        let Solve { root, code, lists: Lists { tiling, tiles, .. }, session, .. } = self;
        for number in tiling.phase(phase) {
            let stretch = tiling.stretch(number);
            let part = Part::of(stretch.work.into(), stretch.shape);
            let call = self.bases[part.op as usize] + part.of as usize;
            while session.run_each(call, [0, lanes], tiles.list(number)).is_none() {
                bind((root, code), session, part, call);
            }
        }
    }

    fn sparse(&mut self, _: bool, _: u32) {
        unreachable!("a solve in which trees touch is not lent where every world has a factor of its own");
    }

    fn fill(&mut self, acting: u32) -> part::Factor {
        let Solve { root, code, rows, lists, .. } = self;
        if !code.tables.tiles.is_empty() {
            let joined = self.cross && lists.find((root, code), rows, acting, L::WIDTH).expect(COMPILED);
            return if joined { part::Factor::Tiles } else { part::Factor::Tree };
        }
        if self.fill_pattern(acting) { part::Factor::Filled } else { part::Factor::Tree }
    }
}

impl<L: Block> Solve<'_, L> {
    /// Chooses a pattern; whether it is a filled one.
    fn fill_pattern(&mut self, acting: u32) -> bool {
        if let Some((known, filled)) = self.chosen
            && known == acting
        {
            return filled;
        }
        let Solve { root, code, rows, lists, factor, whole, joining, cross, .. } = self;
        if !*cross {
            return false;
        }
        let filled = *joining & acting != 0 || rows.iter().any(|row| joins(&code.tables, row, acting));
        *factor = pattern((root, code), &mut lists.filled, (rows, *joining), acting).unwrap_or(*whole);
        self.chosen = Some((acting, filled));
        filled
    }
}
