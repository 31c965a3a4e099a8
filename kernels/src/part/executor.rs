//! Who runs parts.

use std::sync::Arc;

use super::{Family, Item, Op, Part, Step};
use crate::constraint::ContactRow;
use crate::lane::LaneQuery;
use crate::model::{Model, Quantities, Sides};
use crate::solver::{Phase, Work, sparse};

/// Runs parts for a block: here by their kernels over lanes; whoever has code for some runs that, with the same results up to
/// signs of zeros.
pub trait Executor<L: LaneQuery> {
    /// From now on these quantities vary from world to world, within the structure of `model`.
    fn vary(&mut self, _model: &Arc<Model<L::Real>>, _: Quantities) {}

    /// Whether bounding tests of pairs are to be run in [groups](crate::collision::groups), or pair by pair.
    fn in_groups(&self) -> bool {
        false
    }

    /// Runs a part for the block as a whole; masks as bits.
    fn run(&mut self, part: Part, given: u32, returned: &mut [u32], step: &mut Step<'_, L>) {
        part.run_lanes(&Item::Whole, given, returned, step);
    }

    /// Runs a part for items, one after the other.
    fn each(&mut self, part: Part, items: &mut dyn Iterator<Item = Item<'_>>, given: u32, step: &mut Step<'_, L>) {
        for item in items {
            part.run_lanes(&item, given, &mut [], step);
        }
    }

    /// Calls back with the parts that find the numbers of the listed contacts made ready once, if that makes them faster.
    fn measure(&mut self, _: &mut Step<'_, L>, _run: &mut dyn FnMut(&mut dyn Parts)) -> bool {
        false
    }

    /// The same with the parts of a solve, of the contacts that were last measured.
    fn solve(&mut self, _: &mut Step<'_, L>, _run: &mut dyn FnMut(&mut dyn Parts)) -> bool {
        false
    }
}

/// The parts of a solve. Masks are bits: those given, then the worlds for which it is wanted, if not for more.
pub trait Parts {
    /// The listed contacts.
    fn rows(&self) -> &[ContactRow];
    /// Runs a part for the block as a whole.
    fn run(&mut self, part: Part, masks: [u32; 2]) -> [u32; 2];
    /// Runs a part for the listed contacts that act in some world of `acting` and have it: those [in order](Op::in_order), then class
    /// by class.
    fn each(&mut self, op: Op, acting: u32, masks: [u32; 2]);
    /// Makes the factor fit for contacts that act in some world of `acting`.
    fn fill(&mut self, acting: u32) -> Factor;
    /// Works on the tiles of the Hessian, for which the factor was last made fit.
    fn tiles(&mut self, phase: Phase, lanes: u32);
    /// Newton's direction in these lanes, world by world; of `again`, from the factors at hand.
    fn sparse(&mut self, again: bool, lanes: u32);
}

/// How the Hessian is factored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Factor {
    /// On the inertia matrix's pattern.
    Tree,
    /// On a filled pattern.
    Filled,
    /// By tiles.
    Tiles,
    /// In every world by itself.
    Sparse,
}

/// No code: kernels do everything.
#[derive(Clone, Copy, Debug)]
pub struct Kernels;

impl<L: LaneQuery> Executor<L> for Kernels {}

/// The parts of a solve one by one.
pub struct OneByOne<'a, 's, L: LaneQuery> {
    executor: &'a mut dyn Executor<L>,
    step: &'a mut Step<'s, L>,
    rows: Vec<ContactRow>,
    /// Worlds for which the pattern was found.
    filled: Option<u32>,
}

impl<'a, 's, L: LaneQuery> OneByOne<'a, 's, L> {
    /// Those of a step.
    pub fn run(executor: &'a mut dyn Executor<L>, step: &'a mut Step<'s, L>, run: &mut dyn FnMut(&mut dyn Parts)) {
        let rows = std::mem::take(&mut step.ws.constraint.contact_rows);
        let mut parts = OneByOne { executor, step, rows, filled: None };
        run(&mut parts);
        parts.step.ws.constraint.contact_rows = parts.rows;
    }
}

impl Op {
    /// Whether contacts with such sides have the part.
    pub fn applies(self, sides: Sides) -> bool {
        match self {
            Op::Stiffen | Op::Measure => sides == Sides::One,
            Op::MeasureBoth | Op::Couple => sides != Sides::One,
            _ => true,
        }
    }

    /// Whether contacts with such sides have the part in the order of the list: what they have or add goes by their Jacobian.
    pub fn in_order(self, sides: Sides) -> bool {
        matches!(self, Op::Couple | Op::MeasureBoth) || self.family() == Family::Kind && sides == Sides::Apart
    }
}

impl ContactRow {
    /// The part of a contact.
    #[inline(always)]
    pub fn part(&self, op: Op) -> Part {
        let class = match op.family() {
            Family::Law => self.law,
            Family::Links => self.links,
            Family::Couple => self.couple,
            _ => self.number,
        };
        Part::of(op, class)
    }
}

impl<L: LaneQuery> Parts for OneByOne<'_, '_, L> {
    fn rows(&self) -> &[ContactRow] {
        &self.rows
    }

    fn run(&mut self, part: Part, [given, _]: [u32; 2]) -> [u32; 2] {
        let mut returned = [0; 2];
        self.executor.run(part, given, &mut returned[..part.op.masks()[1]], self.step);
        returned
    }

    fn each(&mut self, op: Op, acting: u32, [given, _]: [u32; 2]) {
        let OneByOne { executor, step, rows, .. } = self;
        let acting = rows.iter().filter(|row| row.lanes & acting != 0 && op.applies(row.sides));
        let mut next = 0;
        // Forces and stiffnesses of those that go by their Jacobian are summed in the order of the list.
        let mut in_order = acting.clone().filter(|row| op.in_order(row.sides)).peekable();
        while let Some(first) = in_order.next() {
            let part = first.part(op);
            let alike = std::iter::from_fn(|| in_order.next_if(|row| row.part(op) == part));
            executor.each(part, &mut std::iter::once(first).chain(alike).map(Item::Row), given, step);
        }
        let others = acting.filter(|row| !op.in_order(row.sides)).map(|row| (row.part(op).of, row));
        while let Some(class) = others.clone().map(|(class, _)| class).filter(|class| *class >= next).min() {
            let mut of_class = others.clone().filter(|(of, _)| *of == class).map(|(_, row)| Item::Row(row));
            executor.each(Part::of(op, class), &mut of_class, given, step);
            next = class + 1;
        }
    }

    fn fill(&mut self, acting: u32) -> Factor {
        let OneByOne { step, rows, filled, .. } = self;
        let model = step.model.model;
        if !model.tiles.is_empty() {
            let (joined, _) = step.ws.solver.tiling.find(model, rows, acting);
            return if joined { Factor::Tiles } else { Factor::Tree };
        }
        let joins = |row: &&ContactRow| row.lanes & acting != 0 && model.pairs[row.pair as usize].cross;
        if !model.own.is_empty() {
            return if rows.iter().any(|row| joins(&row)) { Factor::Sparse } else { Factor::Tree };
        }
        let constraint = &step.ws.constraint;
        let joined = || constraint.joining() & acting != 0 || rows.iter().any(|row| joins(&row));
        if !constraint.cross || !joined() {
            return Factor::Tree;
        }
        if filled.replace(acting) != Some(acting) {
            step.ws.solver.fill.find(model, rows.iter().filter(joins).map(|row| row.pair));
        }
        Factor::Filled
    }

    fn tiles(&mut self, phase: Phase, _: u32) {
        let OneByOne { executor, step, rows, .. } = self;
        let (model, tiling) = (step.model.model, std::mem::take(&mut step.ws.solver.tiling));
        for stretch in tiling.phase(phase).map(|number| tiling.stretch(number)) {
            let part = Part::of(stretch.work.into(), stretch.shape);
            if stretch.work == Work::Couple {
                let patches = tiling.patches[stretch.items.range()].iter();
                let item =
                    |[_, row, patch]: &[u32; 3]| Item::Patch(&rows[*row as usize], model.tiles.patch(*patch as usize));
                executor.each(part, &mut patches.map(item), 0, step);
            } else {
                let tiles = tiling.tiles[stretch.items.range()].iter();
                executor.each(part, &mut tiles.map(Item::Tile), 0, step);
            }
        }
        step.ws.solver.tiling = tiling;
    }

    fn sparse(&mut self, again: bool, lanes: u32) {
        let (problem, _, work) = self.step.solver();
        if again {
            sparse::solve(&problem, lanes, work);
        } else {
            sparse::direct(&problem, &self.rows, lanes, work);
        }
    }
}
