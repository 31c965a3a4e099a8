//! Where worlds are kept between runs: all states in one allocation, one block's after the other's, with nothing between.

use std::ops::Range;

use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::math::low;
use lanesim_kernels::model::{Model, Quantities, Quantity, Sizes, Varied};
use lanesim_kernels::state::{Applied, BlockStatus, State, Status, state_len};

use crate::block::Block;
use crate::error::Error;
use crate::field::{Field, Home};
use crate::memory;
use crate::status::First;

/// What the allocator keeps beside each piece, at most.
const OVERHEAD: usize = 64;

/// All blocks of a batch.
pub(crate) struct Store<L> {
    /// States; a block's fields in the order of their declaration.
    states: Vec<L>,
    /// Everything else.
    pub kept: Vec<Kept<L>>,
    /// Lanes of a block's state.
    len: usize,
}

/// What is kept of a block beside its state.
#[derive(Clone, Debug, Default)]
pub(crate) struct Kept<L> {
    pub status: BlockStatus,
    pub applied: Option<Box<Applied<L>>>,
    pub varied: Option<Box<Varied<L>>>,
    pub firsts: Vec<First>,
}

impl<L: LaneQuery> Store<L> {
    /// `nworld` worlds in the reference configuration, at rest.
    pub fn new(model: &Model<L::Real>, nworld: usize) -> Result<Self, Error> {
        let (count, len) = (nworld.div_ceil(L::WIDTH), state_len::<L>(&model.sizes));
        let bytes = Self::block_bytes(&model.sizes);
        memory::ask("the worlds", &[count, bytes])?;
        let refused = |_| Error::Memory { what: "the worlds", bytes: count.checked_mul(bytes) };
        let (mut states, mut kept) = (Vec::new(), Vec::new());
        states.try_reserve_exact(count * len).map_err(refused)?;
        kept.try_reserve_exact(count).map_err(refused)?;
        let mut first = Block::new(model);
        for b in 0..count {
            first.state.for_each(&mut |field| states.extend_from_slice(field.data));
            let worlds = L::WIDTH.min(nworld - b * L::WIDTH);
            let status = BlockStatus { alive: ((1_u64 << worlds) - 1) as u32, ..BlockStatus::default() };
            kept.push(Kept { status, applied: None, varied: None, firsts: Vec::new() });
        }
        Ok(Store { states, kept, len })
    }

    /// Bytes of a block without forces from outside.
    pub fn block_bytes(sizes: &Sizes) -> usize {
        state_len::<L>(sizes) * size_of::<L>() + size_of::<Kept<L>>()
    }

    /// An error if there is no memory for the forces from outside of so many worlds more, each of which may be in another block.
    pub fn ask_for_forces(&self, sizes: &Sizes, nworld: usize) -> Result<(), Error> {
        let without = self.kept.iter().filter(|kept| kept.applied.is_none()).count();
        memory::ask("the worlds' forces", &[without.min(nworld), Self::applied_bytes(sizes)])
    }

    /// Bytes of the forces on a block from outside, with what the allocator adds.
    fn applied_bytes(sizes: &Sizes) -> usize {
        Applied::<L>::bytes(sizes) + size_of::<Applied<L>>() + 3 * OVERHEAD
    }

    /// From now on these quantities of `model` vary, beside those that do already; every world has the model's own.
    pub fn vary(&mut self, model: &Model<L::Real>, set: Quantities) -> Result<(), Error> {
        let lanes: usize = set.iter().map(|quantity| quantity.of(model).len()).sum();
        memory::ask("the worlds' parameters", &[self.kept.len(), lanes, size_of::<L>()])?;
        let start = Varied::new(model, set);
        for kept in &mut self.kept {
            let mut varied = Box::new(start.clone());
            if let Some(old) = &kept.varied {
                let known = old.set().iter();
                known.for_each(|quantity| varied.lanes_mut(quantity).copy_from_slice(old.lanes(quantity)));
            }
            kept.varied = Some(varied);
        }
        Ok(())
    }

    /// Sets a quantity that varies in one world.
    pub fn put(&mut self, quantity: Quantity, world: usize, values: &[f64]) {
        let varied = self.kept[world / L::WIDTH].varied.as_mut();
        let lanes = varied.map_or(&mut [][..], |varied| varied.lanes_mut(quantity));
        for (entry, x) in lanes.iter_mut().zip(values) {
            entry.set(world % L::WIDTH, L::Real::from_f64(*x));
        }
    }

    /// All blocks, as many at a time as `size` says of the number that is left: their states, and what else is kept of them.
    pub fn groups(&mut self, size: impl Fn(usize) -> usize) -> impl Iterator<Item = (&mut [L], &mut [Kept<L>])> {
        let (len, mut states, mut kept) = (self.len, &mut self.states[..], &mut self.kept[..]);
        std::iter::from_fn(move || {
            let count = size(kept.len()).min(kept.len());
            let first = states.split_off_mut(..count * len)?;
            let group = kept.split_off_mut(..count)?;
            (count > 0).then_some((first, group))
        })
    }

    /// Where a block's state is.
    fn place(&self, block: usize) -> Range<usize> {
        block * self.len..(block + 1) * self.len
    }

    /// Where a field of a block's state is, by its number.
    fn entries(&self, number: usize, sizes: &Sizes, block: usize) -> Range<usize> {
        let (before, here) = State::<L>::FIELDS.split_at(number);
        let start = self.place(block).start + before.iter().map(|field| field.len(sizes)).sum::<usize>();
        start..start + here[0].len(sizes)
    }

    /// Sets a field of one world.
    pub fn set(&mut self, field: Field, sizes: &Sizes, world: usize, values: &[f64]) {
        let (block, lane) = (world / L::WIDTH, world % L::WIDTH);
        if field == Field::Qpos && sizes.nsleep > 0 {
            // Trees are awake where they are put.
            self.set(Field::TreeRest, sizes, world, &vec![0.0; sizes.nsleep]);
        }
        if matches!(field, Field::Qpos | Field::Qvel) && sizes.nguard > 0 {
            // The guard's books are of how the world moved by itself.
            self.set(Field::TreeGuard, sizes, world, &vec![0.0; 15 * sizes.nguard]);
        }
        let low = self.low(field, sizes, block);
        for (low, x) in self.states[low].iter_mut().zip(values) {
            low.set(lane, L::Real::from_f64(low::remainder::<L::Real>(*x)));
        }
        let entries = match field.home() {
            Home::State(number) => {
                let range = self.entries(number, sizes, block);
                &mut self.states[range]
            }
            Home::Applied(number) => {
                let applied = self.kept[block].applied.get_or_insert_with(|| Box::new(Applied::new(sizes)));
                applied.field_mut(number)
            }
        };
        for (entry, x) in entries.iter_mut().zip(values) {
            entry.set(lane, L::Real::from_f64(*x));
        }
    }

    /// A field of one world.
    pub fn get(&self, field: Field, sizes: &Sizes, world: usize) -> Vec<f64> {
        let (block, lane) = (world / L::WIDTH, world % L::WIDTH);
        let entries = match (field.home(), &self.kept[block].applied) {
            (Home::State(number), _) => &self.states[self.entries(number, sizes, block)],
            (Home::Applied(number), Some(applied)) => applied.field(number),
            (Home::Applied(_), None) => return vec![0.0; field.lanes(sizes)],
        };
        let low = &self.states[self.low(field, sizes, block)];
        let mut values: Vec<f64> = entries.iter().map(|x| x.get(lane).to_f64()).collect();
        values.iter_mut().zip(low).for_each(|(x, low)| *x += low.get(lane).to_f64());
        values
    }

    /// Where the low words of a field are, if it has any: in the last field of a block's state.
    fn low(&self, field: Field, sizes: &Sizes, block: usize) -> Range<usize> {
        let all = self.entries(State::<L>::COUNT - 1, sizes, block);
        field.low(sizes).map_or(0..0, |first| (all.start + first).min(all.end)..all.end)
    }

    /// Status of one world.
    pub fn status(&self, world: usize) -> Status {
        self.kept[world / L::WIDTH].status.lane(world % L::WIDTH)
    }

    /// Whether any of the worlds is frozen.
    pub fn any_frozen(&self, nworld: usize) -> bool {
        let expected = |b: usize| L::WIDTH.min(nworld - b * L::WIDTH);
        self.kept.iter().enumerate().any(|(b, kept)| kept.status.alive.count_ones() as usize != expected(b))
    }

    /// Takes one world's block to `scratch`, lets `work` change it there, and puts it back.
    pub fn change(&mut self, world: usize, scratch: &mut Block<L>, work: impl FnOnce(&mut Block<L>, usize)) {
        let (block, place) = (world / L::WIDTH, self.place(world / L::WIDTH));
        scratch.load(&self.states[place.clone()], &mut self.kept[block]);
        work(scratch, world % L::WIDTH);
        scratch.store(&mut self.states[place], &mut self.kept[block]);
    }

    /// Some of the worlds, copied to a store of their own in the order of `ids`, of which there must be one.
    pub fn gather(&self, sizes: &Sizes, ids: &[usize]) -> Result<Self, Error> {
        let count = ids.len().div_ceil(L::WIDTH);
        let any = |has: fn(&Kept<L>) -> bool| self.kept.iter().find(|kept| has(kept));
        let applied = any(|kept| kept.applied.is_some()).map_or(0, |_| Self::applied_bytes(sizes));
        let varied = any(|kept| kept.varied.is_some())
            .and_then(|kept| kept.varied.as_deref())
            .map_or(0, |varied| varied.bytes() + size_of::<Varied<L>>());
        memory::ask("the chosen worlds", &[count, Self::block_bytes(sizes) + applied + varied])?;
        let mut part =
            Store { states: vec![L::zero(); count * self.len], kept: Vec::with_capacity(count), len: self.len };
        for (b, ids) in ids.chunks(L::WIDTH).enumerate() {
            let varied = self.kept[ids[0] / L::WIDTH].varied.clone();
            let mut kept = Kept { status: BlockStatus::default(), applied: None, varied, firsts: Vec::new() };
            // Lanes without a world hold what the first one does.
            for to in 0..L::WIDTH {
                let world = ids.get(to).copied().unwrap_or(ids[0]);
                let (source, from) = (&self.kept[world / L::WIDTH], world % L::WIDTH);
                copy(
                    &self.states[self.place(world / L::WIDTH)],
                    from,
                    &mut part.states[b * self.len..][..self.len],
                    to,
                );
                if let Some(applied) = &source.applied {
                    let mine = kept.applied.get_or_insert_with(|| Box::new(Applied::new(sizes)));
                    copy_applied(applied, from, mine, to);
                }
                if let (Some(varied), Some(mine)) = (&source.varied, &mut kept.varied) {
                    varied.set().iter().for_each(|q| copy(varied.lanes(q), from, mine.lanes_mut(q), to));
                }
                if to < ids.len() {
                    kept.status.set_lane(to, source.status.lane(from));
                    let firsts = source.firsts.iter().filter(|first| first.lane == from);
                    kept.firsts.extend(firsts.map(|first| First { lane: to, ..*first }));
                }
            }
            part.kept.push(kept);
        }
        Ok(part)
    }

    /// Puts worlds back that were gathered by the same `ids`. Parameters stay: runs do not change them.
    pub fn scatter(&mut self, ids: &[usize], part: &Self) {
        for (i, world) in ids.iter().enumerate() {
            let (source, from) = (&part.kept[i / L::WIDTH], i % L::WIDTH);
            let (place, to) = (self.place(world / L::WIDTH), world % L::WIDTH);
            copy(&part.states[part.place(i / L::WIDTH)], from, &mut self.states[place], to);
            let kept = &mut self.kept[world / L::WIDTH];
            // Forces that were not there were not gathered, and runs set none.
            if let (Some(applied), Some(mine)) = (&source.applied, &mut kept.applied) {
                copy_applied(applied, from, mine, to);
            }
            kept.status.set_lane(to, source.status.lane(from));
            kept.firsts.retain(|first| first.lane != to);
            let firsts = source.firsts.iter().filter(|first| first.lane == from);
            kept.firsts.extend(firsts.map(|first| First { lane: to, ..*first }));
        }
    }

    /// Positions and velocities of one world, and low words.
    pub fn configuration(&self, sizes: &Sizes, world: usize) -> impl Iterator<Item = L::Real> + '_ {
        let Range { start, end } = self.place(world / L::WIDTH);
        let (first, low) = (start + 1, end - sizes.nlow);
        let lanes = self.states[first..first + sizes.nq + sizes.nv].iter().chain(&self.states[low..end]);
        lanes.map(move |x| x.get(world % L::WIDTH))
    }
}

/// Copies one lane of every entry.
pub(crate) fn copy<L: LaneQuery>(source: &[L], from: usize, target: &mut [L], to: usize) {
    source.iter().zip(target).for_each(|(source, target)| target.set(to, source.get(from)));
}

fn copy_applied<L: LaneQuery>(source: &Applied<L>, from: usize, target: &mut Applied<L>, to: usize) {
    (0..Applied::<L>::FIELDS.len()).for_each(|n| copy(source.field(n), from, target.field_mut(n), to));
}

impl<L: LaneQuery> Block<L> {
    /// Takes over a block that was kept.
    pub fn load(&mut self, states: &[L], kept: &mut Kept<L>) {
        let mut rest = states;
        self.state.for_each(&mut |field| {
            let (mine, others) = rest.split_at(field.data.len());
            field.data.copy_from_slice(mine);
            rest = others;
        });
        self.status = kept.status;
        self.applied = kept.applied.take();
        self.varied = kept.varied.take();
        self.firsts = std::mem::take(&mut kept.firsts);
    }

    /// Puts it back.
    pub fn store(&mut self, states: &mut [L], kept: &mut Kept<L>) {
        let mut rest = states;
        self.state.for_each(&mut |field| {
            let (mine, others) = std::mem::take(&mut rest).split_at_mut(field.data.len());
            mine.copy_from_slice(field.data);
            rest = others;
        });
        kept.status = self.status;
        kept.applied = self.applied.take();
        kept.varied = self.varied.take();
        kept.firsts = std::mem::take(&mut self.firsts);
    }
}
