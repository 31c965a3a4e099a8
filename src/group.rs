//! Groups of blocks whose worlds change places, so that worlds with the same contacts are side by side.
//!
//! A block pays for the union of its worlds' contacts and for its slowest world's iterations. Between spans of steps a
//! group sorts its worlds by their contacts, the most common ones first. Since no world's bits depend on its neighbours,
//! this changes no result; every lane knows which world it holds, and at the end all are back where they came from.

use lanesim_kernels::lane::{Lane, LaneQuery, Real};
use lanesim_kernels::model::{Model, Sizes};
use lanesim_kernels::state::{Applied, Status, state_len};
use lanesim_kernels::workspace::Workspace;

use crate::block::Block;
use crate::status::First;
use crate::store::Kept;

/// Steps between two sortings that change something.
pub(crate) const SPAN: usize = 16;
/// Most blocks of a group.
const MOST: usize = 16;
/// Bytes of states of a group that stay in a core's cache.
const CACHE: usize = 1 << 18;
/// Contacts of a world that are looked at.
const SEEN: usize = 24;

/// How many blocks of a model to take together: enough to find worlds that are alike, few enough to stay in cache.
pub(crate) fn size<T>(model: &Model<T>, block_bytes: usize, nstep: usize) -> usize {
    if model.pairs.is_empty() || nstep <= SPAN { 1 } else { (CACHE / block_bytes).clamp(1, MOST) }
}

/// The contact slots that a world had in the last step.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    slots: [u32; SEEN],
    len: usize,
}

/// Blocks that are worked on together. A place is a lane of a block; all but the last places hold worlds.
pub(crate) struct Group<L: LaneQuery> {
    /// The blocks; the first `used` are in use.
    blocks: Vec<Block<L>>,
    used: usize,
    /// Contacts by place.
    seen: Vec<Seen>,
    /// By contact slot: worlds that have it, then its rank among all.
    common: Vec<u32>,
    /// Slots that some world has.
    present: Vec<u32>,
    /// By place: what to sort by, and the place that the world came from.
    order: Vec<(u64, usize)>,
    /// All blocks' lanes while they change places.
    moved: Vec<L>,
    /// First times of statuses meanwhile, by place.
    moved_firsts: Vec<(usize, First)>,
    /// Lanes of a block that hold numbers of the model which vary.
    varied: usize,
    sizes: Sizes,
}

impl<L: LaneQuery> Group<L> {
    /// Room for a group of `size` blocks, of which so many lanes hold numbers of the model that vary.
    pub fn new(model: &Model<L::Real>, size: usize, varied: usize) -> Self {
        let (places, len) = (size * L::WIDTH, state_len::<L>(&model.sizes) + varied);
        Group {
            blocks: (0..size).map(|_| Block::new(model)).collect(),
            used: 0,
            seen: vec![Seen::default(); places],
            common: vec![0; if size > 1 { model.sizes.nslot } else { 0 }],
            present: Vec::with_capacity(if size > 1 { model.sizes.nslot.min(places * SEEN) } else { 0 }),
            order: Vec::with_capacity(places),
            moved: Vec::with_capacity(if size > 1 { size * len } else { 0 }),
            moved_firsts: Vec::new(),
            varied,
            sizes: model.sizes.clone(),
        }
    }

    /// Makes room for groups of `size` blocks.
    pub fn fit(&mut self, model: &Model<L::Real>, size: usize) {
        if self.blocks.len() < size {
            *self = Group::new(model, size, self.varied);
        }
    }

    /// The blocks in use.
    pub fn blocks(&mut self) -> &mut [Block<L>] {
        &mut self.blocks[..self.used]
    }

    /// A block for somebody to use, when none is in use.
    pub fn scratch(&mut self) -> &mut Block<L> {
        &mut self.blocks[0]
    }

    /// Takes over blocks of `worlds` worlds that were kept.
    pub fn load(&mut self, states: &[L], kept: &mut [Kept<L>], worlds: usize) {
        self.used = kept.len();
        let len = states.len() / kept.len();
        for (b, ((block, states), kept)) in self.blocks.iter_mut().zip(states.chunks_exact(len)).zip(kept).enumerate() {
            block.load(states, kept);
            block.done = 0;
            block.ids.clear();
            block.ids.extend(b * L::WIDTH..worlds.min((b + 1) * L::WIDTH));
            block.pad();
        }
    }

    /// Puts them back, every world where it was.
    pub fn store(&mut self, states: &mut [L], kept: &mut [Kept<L>]) {
        self.restore();
        let len = states.len() / kept.len();
        for ((block, states), kept) in self.blocks.iter_mut().zip(states.chunks_exact_mut(len)).zip(kept) {
            block.store(states, kept);
        }
    }

    /// Keeps the contacts that the worlds of block `b` had in the last step.
    pub fn observe(&mut self, b: usize, model: &Model<L::Real>, workspace: &Workspace<L>) {
        let seen = &mut self.seen[b * L::WIDTH..(b + 1) * L::WIDTH];
        seen.iter_mut().for_each(|seen| seen.len = 0);
        let alive = self.blocks[b].status.alive;
        let collision = &workspace.collision;
        for (slot, contact) in collision.slots.iter().zip(collision.contacts()) {
            let slot = model.pairs[slot.pair as usize].slots.start + slot.point;
            let mut lanes = L::bits(contact.dist().lt(L::of(L::Real::MAXVAL))) & alive;
            while lanes != 0 {
                let seen = &mut seen[lanes.trailing_zeros() as usize];
                lanes &= lanes - 1;
                if seen.len < SEEN {
                    seen.slots[seen.len] = slot;
                    seen.len += 1;
                }
            }
        }
    }

    /// Sorts the worlds by the contacts observed last, if that makes blocks' lists of contacts clearly shorter. Whether it
    /// did.
    pub fn sort(&mut self) -> bool {
        self.rank();
        if self.present.is_empty() {
            return false;
        }
        let key = |seen: &Seen| {
            let bit = |slot: &u32| 1_u64.checked_shl(63_u32.wrapping_sub(self.common[*slot as usize])).unwrap_or(0);
            seen.slots[..seen.len].iter().fold(0, |key, slot| key | bit(slot))
        };
        self.order.clear();
        self.order.extend((0..self.places()).map(|place| (key(&self.seen[place]), place)));
        // How many of the common contacts the blocks' unions have: now, and with the worlds in order.
        let cost = |order: &[(u64, usize)]| -> u32 {
            order.chunks(L::WIDTH).map(|block| block.iter().fold(0, |union, (key, _)| union | key).count_ones()).sum()
        };
        let now = cost(&self.order);
        self.order.sort_unstable_by_key(|(key, place)| (std::cmp::Reverse(*key), *place));
        let pays = 10 * cost(&self.order) < 9 * now;
        if pays {
            self.rearrange();
        }
        for slot in self.present.drain(..) {
            self.common[slot as usize] = 0;
        }
        pays
    }

    /// Numbers the slots that some world has in `common`, from the most common one on.
    fn rank(&mut self) {
        let places = self.places();
        let Group { common, present, seen, .. } = self;
        for seen in &seen[..places] {
            for slot in &seen.slots[..seen.len] {
                if common[*slot as usize] == 0 {
                    present.push(*slot);
                }
                common[*slot as usize] += 1;
            }
        }
        present.sort_unstable_by_key(|slot| (std::cmp::Reverse(common[*slot as usize]), *slot));
        for (rank, slot) in present.iter().enumerate() {
            common[*slot as usize] = rank as u32;
        }
    }

    /// Number of worlds.
    fn places(&self) -> usize {
        self.blocks[..self.used].iter().map(|block| block.ids.len()).sum()
    }

    /// Puts every world back where it came from.
    fn restore(&mut self) {
        self.order.clear();
        let ids = self.blocks[..self.used].iter().flat_map(|block| &block.ids);
        self.order.extend(ids.enumerate().map(|(place, id)| (*id as u64, place)));
        if self.order.iter().any(|(id, place)| *id != *place as u64) {
            self.order.sort_unstable();
            self.rearrange();
        }
    }

    /// Moves to each place the world from the place in `order`.
    fn rearrange(&mut self) {
        let Group { blocks, order, moved, moved_firsts: firsts, sizes, .. } = self;
        let blocks = &mut blocks[..self.used];
        if blocks.iter().any(|block| block.applied.is_some()) {
            for block in blocks.iter_mut() {
                block.applied.get_or_insert_with(|| Box::new(Applied::new(sizes)));
            }
        }
        moved.clear();
        firsts.clear();
        let mut places: [(usize, Status); MOST * 16] = [Default::default(); MOST * 16];
        for (b, block) in blocks.iter_mut().enumerate() {
            block.for_each(&mut |lanes| moved.extend_from_slice(lanes));
            firsts.extend(block.firsts.drain(..).map(|first| (b * L::WIDTH + first.lane, first)));
            for (lane, id) in block.ids.iter().enumerate() {
                places[b * L::WIDTH + lane] = (*id, block.status.lane(lane));
            }
        }
        let len = moved.len() / blocks.len();
        for (block, from) in blocks.iter_mut().zip(order.chunks(L::WIDTH)) {
            let mut entry = 0;
            block.for_each(&mut |lanes| {
                for x in lanes {
                    let mut taken = [<L::Real as Lane>::zero(); 16];
                    for (taken, (_, place)) in taken.iter_mut().zip(from) {
                        *taken = moved[place / L::WIDTH * len + entry].get(place % L::WIDTH);
                    }
                    x.put(0, &taken[..from.len()]);
                    entry += 1;
                }
            });
            for (lane, (_, place)) in from.iter().enumerate() {
                let (id, status) = places[*place];
                block.ids[lane] = id;
                block.status.set_lane(lane, status);
                let mine = firsts.iter().filter(|(at, _)| at == place);
                block.firsts.extend(mine.map(|(_, first)| First { lane, ..*first }));
            }
            block.pad();
        }
    }
}

#[cfg(test)]
mod tests {
    use wide::f64x8;

    use super::*;
    use crate::model::Model as Compiled;

    /// A ball above a floor, in worlds of which every other one lies on it.
    #[test]
    fn worlds_with_the_same_contacts_come_together() {
        let text = "<mujoco><worldbody><geom type='plane' size='1 1 1'/>
            <body><freejoint/><geom size='.1'/></body></worldbody></mujoco>";
        let model = Compiled::from_xml_string(text, &Default::default()).expect("a model");
        let tables = model.tables();
        let mut group = Group::<f64x8>::new(tables, 2, 0);
        let len = state_len::<f64x8>(&tables.sizes);
        let (mut states, mut kept) = (vec![f64x8::splat(0.0); 2 * len], vec![Kept::default(), Kept::default()]);
        for (b, states) in states.chunks_mut(len).enumerate() {
            (0..8).for_each(|lane| states[0].set(lane, (8 * b + lane) as f64));
        }
        let before = states.clone();
        group.load(&states, &mut kept, 13);
        for seen in group.seen.iter_mut().step_by(2) {
            *seen = Seen { slots: [0; SEEN], len: 1 };
        }
        group.sort();
        assert_eq!(group.blocks()[0].ids, [0, 2, 4, 6, 8, 10, 12, 1]);
        assert_eq!(group.blocks()[1].ids, [3, 5, 7, 9, 11]);
        // Time is the first field of a state.
        let time =
            |block: &Block<f64x8>| block.ids.iter().enumerate().all(|(l, id)| block.state.time[0].get(l) == *id as f64);
        assert!(group.blocks().iter().all(time));
        group.store(&mut states, &mut kept);
        for world in 0..13 {
            let at = |states: &[f64x8]| states[world / 8 * len].get(world % 8);
            assert_eq!(at(&states), at(&before));
        }
    }
}
