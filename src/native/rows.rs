//! Code for the numbers of contact rows: by kind of contact where one side stands still, else by pair of links.

use std::sync::OnceLock;

use lanesim_codegen::{FieldSlice, Float, Fragment, InstructionSet, Program, Recorder, Scratch, Windows};
use lanesim_kernels::collision::{Collision, Contact};
use lanesim_kernels::constraint::{
    Cone, Constraint, ContactRow, Grip, Motion, NUMBERS, Numbers, both_sides, cone, numbers, still_side,
};
use lanesim_kernels::lane::{Lane, LaneQuery};
use lanesim_kernels::math::spatial::Spatial;
use lanesim_kernels::model::{Model, NONE, Pair, Sides};

use super::contacts::clear_dead;
use super::parts::Binder;
use super::structure::{Structure, fill_in};

/// What the code for a contact depends on if one side stands still.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Kind {
    cone: Cone,
    dim: u32,
    /// Whether it is the first geom that moves.
    flipped: bool,
    /// Impedance: whether it is flat, and its power.
    impedance: (bool, u8),
}

impl Kind {
    fn new<T>(model: &Model<T>, pair: &Pair<T>) -> Self {
        let impedance = (pair.impedance.flat, pair.impedance.small_power);
        Kind { cone: cone(model, pair), dim: pair.condim, flipped: pair.link2 == NONE, impedance }
    }

    fn name(&self) -> String {
        let Kind { cone, dim, flipped, impedance: (flat, power) } = self;
        let law = if *flat { "flat".to_owned() } else { format!("power {power}") };
        format!("rows {cone:?} {dim}, {law}{}", if *flipped { ", flipped" } else { "" }).to_lowercase()
    }
}

/// Code of a kind.
struct KindCode<T> {
    kind: Kind,
    /// A pair of the kind.
    pair: u32,
    fragment: OnceLock<Option<Fragment<T>>>,
}

/// Columns of the windows of a contact: what was found of it, motion of its link, numbers of its pair; strength, motion
/// rows, reference. The fields are in the same order; where grips vary, that of its pair is one more.
pub const COLUMNS: usize = 6;
/// Numbers of a grip that vary.
const GRIP: usize = 6;
/// Fields of a contact both sides of which move, beside a grip that varies.
const BOTH_FIELDS: usize = 8;

/// What code is made from: the model, the components that its motions have, the instruction set.
type How<'a, T> = (&'a Model<T>, [bool; 6], InstructionSet);

/// Where contacts have their numbers, list by list of a kind.
pub type RowPlaces<const N: usize> = Windows<N>;

/// Code for the numbers of contact rows.
pub struct RowCode<T> {
    kinds: Vec<KindCode<T>>,
    /// By pair, its kind among the model's; [`NONE`] if both sides move.
    of_pairs: Vec<u32>,
    /// Numbers of all pairs, those of each from a multiple of a block's bytes on.
    numbers: Vec<T>,
    /// Whether grips vary.
    varying: bool,
}

impl<T: Float> RowCode<T> {
    /// Blocks that the numbers of a pair take.
    const BLOCKS: usize = NUMBERS.div_ceil(<T::Block as LaneQuery>::WIDTH);
    /// Numbers from a pair's first to the next one's.
    const STRIDE: usize = Self::BLOCKS * <T::Block as LaneQuery>::WIDTH;

    /// Nothing compiled yet.
    pub fn new(model: &Model<T>, varying: bool) -> Self {
        let mut kinds: Vec<KindCode<T>> = vec![];
        let place = |(pair, p): (&Pair<T>, u32)| {
            if pair.sides != Sides::One {
                return NONE;
            }
            let kind = Kind::new(model, pair);
            let known = kinds.iter().position(|code| code.kind == kind).unwrap_or_else(|| {
                kinds.push(KindCode { kind, pair: p, fragment: OnceLock::new() });
                kinds.len() - 1
            });
            known as u32
        };
        let of_pairs = model.pairs.iter().zip(0..).map(place).collect();
        let padding = vec![T::from_f64(0.0); Self::STRIDE - NUMBERS];
        let numbers = model.pairs.iter().flat_map(|pair| numbers(pair).into_iter().chain(padding.iter().copied()));
        RowCode { kinds, of_pairs, numbers: numbers.collect(), varying }
    }

    fn get<'a>(&self, code: &'a KindCode<T>, (model, live, isa): How<'_, T>) -> Option<&'a Fragment<T>> {
        let columns: [Option<usize>; COLUMNS + 1] = std::array::from_fn(Some);
        let compile = || {
            let program = record_still(model, &model.pairs[code.pair as usize], live, self.varying);
            let code = match self.varying {
                true => program.compile_each::<{ COLUMNS + 1 }>(isa, &columns),
                false => program.compile_each::<COLUMNS>(isa, &columns[..COLUMNS]),
            };
            code.ok()
        };
        code.fragment.get_or_init(|| Some(compile()?.named(&code.kind.name()))).as_ref()
    }

    /// The code of all kinds, by name.
    pub fn parts(&self, how: How<'_, T>) -> impl Iterator<Item = (String, Option<&Fragment<T>>)> {
        self.kinds.iter().map(move |code| (code.kind.name(), self.get(code, how)))
    }

    /// Writes the numbers of all listed contacts one side of which stands still; not, if some code cannot be had.
    pub fn still_sides<const N: usize>(
        &self,
        how: How<'_, T>,
        (scratch, places): (&mut Scratch, &mut RowPlaces<N>),
        motion: Motion<'_, T::Block>,
        (collision, grips): (&Collision<T::Block>, &[T::Block]),
        constraint: &mut Constraint<T::Block>,
    ) -> bool {
        places.clear();
        for (code, k) in self.kinds.iter().zip(0..) {
            let mine = constraint.contact_rows.iter().filter(|row| self.of_pairs[row.pair as usize] == k);
            places.add(mine.map(|row| self.starts(row, collision)));
            if places.list(k as usize).is_empty() {
                continue;
            }
            let Some(fragment) = self.get(code, how) else { return false };
            let mut fields = [
                FieldSlice::read(collision.found().as_flattened()),
                FieldSlice::read(motion.velocity.cvel.as_flattened()),
                FieldSlice::uniform(&self.numbers),
                FieldSlice::write(constraint.strengths.as_flattened_mut()),
                FieldSlice::write(constraint.motion.as_flattened_mut()),
                FieldSlice::write(&mut constraint.reference),
                FieldSlice::read(grips),
            ];
            fragment.run_each(scratch, &mut fields[..N], &[], places.list(k as usize));
        }
        true
    }

    /// Where the windows of a contact start, by column.
    fn starts<const N: usize>(&self, row: &ContactRow, collision: &Collision<T::Block>) -> [usize; N] {
        let place = collision.slots[row.contact as usize].place;
        let [place, link, pair, strength, component] =
            [place, row.link, row.pair, row.strength, row.component].map(|x| x as usize);
        let all = [13 * place, 6 * link, Self::BLOCKS * pair, 7 * strength, 6 * component, component, GRIP * pair];
        std::array::from_fn(|column| all[column])
    }

    /// Writes the numbers of a contact between two links of a tree, by the [code](record_both) for its pair.
    pub fn both_sides(
        &self,
        fragment: &Fragment<T>,
        scratch: &mut Scratch,
        motion: Motion<'_, T::Block>,
        (collision, grips): (&Collision<T::Block>, &[T::Block]),
        (row, dofs): (&ContactRow, usize),
        constraint: &mut Constraint<T::Block>,
    ) {
        let (from, grip) = (row.pair as usize * Self::STRIDE, row.pair as usize * GRIP);
        let (out, jacobian) = constraint.numbers_mut(row, dofs);
        let mut fields = [
            FieldSlice::read(collision.contact(row.contact as usize).0),
            FieldSlice::read(motion.position.cdof.as_flattened()),
            FieldSlice::read(motion.qvel),
            FieldSlice::uniform(&self.numbers[from..][..NUMBERS]),
            FieldSlice::write(out.strength),
            FieldSlice::write(out.motion.as_flattened_mut()),
            FieldSlice::write(out.reference),
            FieldSlice::write(jacobian),
            FieldSlice::read(grips.get(grip..grip + GRIP).unwrap_or_default()),
        ];
        let count = BOTH_FIELDS + usize::from(self.varying);
        fragment.run(scratch, &mut fields[..count], &[], &mut []);
    }
}

/// A contact's numbers while they are recorded.
struct Recorded<T: Float> {
    strength: [Recorder<T>; 7],
    motion: Vec<Spatial<Recorder<T>>>,
    reference: Vec<Recorder<T>>,
}

impl<T: Float> Recorded<T> {
    fn new(dim: usize) -> Self {
        let zero = Recorder::zero();
        Recorded { strength: [zero; 7], motion: vec![[zero; 6]; dim], reference: vec![zero; dim] }
    }

    fn numbers(&mut self) -> Numbers<'_, Recorder<T>> {
        Numbers { strength: &mut self.strength, motion: &mut self.motion, reference: &mut self.reference }
    }

    /// Makes them the next fields. What no motion has is zero in motion rows.
    fn output(mut self, binder: &mut Binder<T>, live: [bool; 6]) {
        self.motion.iter_mut().for_each(|w| clear_dead(live, w));
        for lanes in [&self.strength[..], self.motion.as_flattened(), &self.reference] {
            binder.output(lanes);
        }
    }
}

/// The numbers of a pair like this one, as the next field; if its grip varies, that is field `varied`.
fn grip<T: Float>(
    binder: &mut Binder<T>,
    model: &Model<T>,
    pair: &Pair<T>,
    varied: Option<usize>,
) -> Grip<Recorder<T>> {
    let numbers = binder.recording.uniform(binder.next, NUMBERS);
    binder.next += 1;
    let grip = Grip::of(model, pair, std::array::from_fn(|i| numbers[i]));
    let Some(field) = varied else { return grip };
    let own = binder.recording.input(field, GRIP);
    grip.with(std::array::from_fn(|i| own[i]))
}

/// Records the numbers of contacts one side of which stands still. Fields: see [`COLUMNS`].
fn record_still<T: Float>(model: &Model<T>, pair: &Pair<T>, live: [bool; 6], varying: bool) -> Program<T> {
    let mut binder = Binder::new();
    let (mut found, mut twist) = ([Recorder::zero(); 13], [Recorder::zero(); 6]);
    binder.input(&mut found);
    binder.input(&mut twist);
    clear_dead(live, &mut twist);
    let grip = grip(&mut binder, model, pair, varying.then_some(COLUMNS));
    let mut out = Recorded::new(pair.condim as usize);
    still_side(&grip, Contact(&found), &twist, out.numbers());
    out.output(&mut binder, live);
    binder.recording.finish()
}

/// Records the numbers and the Jacobian of a contact between two links of a tree. Fields: what was found; axes and
/// velocities of dofs; numbers of the pair; strength, motion rows, reference, Jacobian; its grip, if that varies.
pub fn record_both<T: Float>(model: &Model<T>, structure: &Structure<T>, pair: &Pair<T>, varying: bool) -> Program<T> {
    let mut binder = Binder::new();
    let (zero, nv) = (Recorder::zero(), model.sizes.nv);
    let (mut found, mut axes, mut qvel) = ([zero; 13], vec![[zero; 6]; nv], vec![zero; nv]);
    binder.input(&mut found);
    binder.input(axes.as_flattened_mut());
    binder.input(&mut qvel);
    fill_in(axes.as_flattened_mut(), &structure.axes);
    let grip = grip(&mut binder, model, pair, varying.then_some(BOTH_FIELDS));
    let (dofs, mut out) = (&model.pair_dofs[pair.dofs.range()], Recorded::new(pair.condim as usize));
    let mut jacobian = vec![zero; dofs.len() * pair.condim as usize];
    let contact = Contact(&found);
    both_sides(&grip, contact, &contact.pos(), dofs, (&axes, &qvel), &mut jacobian, out.numbers());
    out.output(&mut binder, structure.live);
    binder.output(&jacobian);
    binder.recording.finish()
}

/// Operations of that code, about.
pub fn operations_of_both<T>(pair: &Pair<T>) -> usize {
    100 + (7 * pair.dofs.len * pair.condim) as usize
}
