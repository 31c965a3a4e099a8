//! The broad phase: when pairs have to be tested again.
//!
//! Pairs that are out of reach by a gap in every world need no other test until geoms have moved so far that the gap may be
//! closed. Since the path of a point is at least as long as the way between its ends, this holds however worlds move, also
//! when others take their place; a pair is never passed over while it is near.
//!
//! Kernels test pair by pair, each when it is due. Code tests whole groups of pairs at once, those that are near each other
//! in the reference configuration in the first and smallest group, so that few groups are due where nothing touches.

use crate::code::Code;
use crate::lane::{LaneQuery, Mask, Real};
use crate::model::Model;
use crate::position::Position;

use super::Colliders;
use super::bound::Test;
use super::pair::{Body, body};

/// Part of a gap that ways may use up before the pair is tested again: within a tree, and in the world, where two geoms can
/// approach from both sides. The rest is for rounding.
const USABLE: [f64; 2] = [0.9, 0.45];
/// The sum of ways from which on all starts anew, m.
const LONGEST: f64 = 8.0;

/// The bounding tests of pair by pair, and when each is due.
#[derive(Clone, Debug)]
struct Pairs {
    tests: Vec<Test>,
    /// Travel at which each pair is to be tested.
    due: Vec<f64>,
    /// Sum over all tests of the longest way in any world, m: within a tree, and in the world.
    travel: [f64; 2],
    /// The last summands.
    way: [f64; 2],
    /// Travel at which the next pair is to be tested.
    next: [f64; 2],
    /// Geoms whose pose is that of this step: what stands still, and what some pair needed.
    placed: Vec<bool>,
    /// Worlds that took part in the last step.
    alive: u32,
}

/// When groups of pairs are to be tested, world by world.
#[derive(Clone, Debug)]
struct Groups<L> {
    /// Travel at which each group is to be tested: by its pairs within a tree, and by others.
    due: Vec<[L; 2]>,
}

/// The bounding tests, and when each is due.
#[derive(Clone, Debug)]
pub struct Broad<L> {
    pairs: Pairs,
    groups: Groups<L>,
    /// Worlds in which each pair is near, as bits: of pairs that were not tested, none.
    pub near: Vec<u32>,
}

impl<L: LaneQuery> Broad<L> {
    /// The tests of the model's pairs, all due.
    pub fn new(model: &Model<L::Real>) -> Self {
        let pairs = Pairs {
            tests: model.pairs.iter().map(|pair| Test::new(model, pair)).collect(),
            due: vec![0.0; model.pairs.len()],
            travel: [0.0; 2],
            way: [0.0; 2],
            next: [0.0; 2],
            placed: vec![false; model.geoms.len()],
            alive: 0,
        };
        let groups = Groups { due: Vec::new() };
        Broad { pairs, groups, near: vec![0; model.pairs.len()] }
    }

    /// Bytes of that.
    pub fn bytes(model: &Model<L::Real>) -> usize {
        model.pairs.len() * (size_of::<Test>() + size_of::<f64>() + size_of::<u32>()) + model.geoms.len()
    }

    /// Finds where pairs are near, in the worlds of `alive`. Whether any may be. A pair that is near is due at once, so that none
    /// is where no test is due.
    pub fn test(
        &mut self,
        model: &Model<L::Real>,
        (qpos, position): (&[L], &Position<L>),
        alive: L::Mask,
        code: &mut dyn Code<L>,
        colliders: &mut Colliders<L>,
    ) -> bool {
        let count = code.groups();
        if count == 0 {
            self.pairs.advance(&colliders.way, alive);
            colliders.set_out(qpos, position);
            return self.pairs.test(model, position, alive, colliders, &mut self.near);
        }
        let Broad { groups, near, .. } = self;
        groups.due.resize(count, [L::of(-L::Real::MAX); 2]);
        groups.begin(colliders);
        colliders.set_out(qpos, position);
        let mut any = false;
        for group in 0..count {
            any |= groups.is_due(group, alive, colliders) && {
                let mut gaps = [L::zero(); 2];
                let some = code.near(group, position, L::bits(alive), near, &mut gaps);
                groups.postpone(group, &gaps, colliders);
                some
            };
        }
        groups.end(colliders);
        any
    }

    /// A pair's geoms, where they are relative to its reference point.
    #[inline(always)]
    pub fn bodies(&self, model: &Model<L::Real>, p: usize, position: &Position<L>) -> [Body<L>; 2] {
        let test = &self.pairs.tests[p];
        test.frames.place(position, test.geoms.map(|g| body(model, position, g as usize)))
    }
}

impl<L: LaneQuery> Groups<L> {
    /// Adds the ways to the travel; starts anew where worlds came from nowhere, or a sum would lose digits.
    fn begin(&mut self, colliders: &mut Colliders<L>) {
        let Colliders { travel, way, .. } = colliders;
        travel.iter_mut().zip(way).for_each(|(travel, way)| *travel += *way);
        let short = |travel: &L| travel.lt(L::of(LONGEST));
        let goes_on = colliders.travel.iter().map(short).fold(L::Mask::splat(true), |all, short| all & short);
        for travel in &mut colliders.travel {
            *travel = L::select(goes_on, *travel, L::zero());
        }
        for due in self.due.as_flattened_mut() {
            *due = L::select(goes_on, *due, L::of(-L::Real::MAX));
        }
    }

    #[inline(always)]
    fn is_due(&self, group: usize, alive: L::Mask, colliders: &Colliders<L>) -> bool {
        let [inner, outer] = self.due[group];
        L::any(!(colliders.travel[0].lt(inner) & colliders.travel[1].lt(outer)) & alive)
    }

    #[inline(always)]
    fn postpone(&mut self, group: usize, gaps: &[L; 2], colliders: &Colliders<L>) {
        for (i, due) in self.due[group].iter_mut().enumerate() {
            *due = gaps[i].mul_add(L::of(USABLE[i]), colliders.travel[i]);
        }
    }

    /// Keeps when the next of the groups is due.
    fn end(&self, colliders: &mut Colliders<L>) {
        for (i, next) in colliders.due.iter_mut().enumerate() {
            *next = self.due.iter().fold(L::of(LONGEST), |next, due| due[i].min(next));
        }
    }
}

impl Pairs {
    fn advance<L: LaneQuery>(&mut self, way: &[L], alive: L::Mask) {
        let alive = L::bits(alive);
        let known = way.iter().fold(L::Mask::splat(true), |known, way| known & way.lt(L::of(L::Real::MAX)));
        if alive & !(L::bits(known) & self.alive) != 0 {
            // Worlds that were not looked at before, or came from nowhere.
            self.due.fill(0.0);
            self.travel = [0.0; 2];
            self.next = [0.0; 2];
        } else {
            for (i, way) in way.iter().enumerate() {
                let lanes = (0..L::WIDTH).filter(|i| alive >> i & 1 != 0);
                self.way[i] = lanes.fold(0.0, |most: f64, i| most.max(way.get(i).to_f64()));
                self.travel[i] += self.way[i];
            }
        }
        self.alive = alive;
    }

    fn test<L: LaneQuery>(
        &mut self,
        model: &Model<L::Real>,
        position: &Position<L>,
        alive: L::Mask,
        colliders: &mut Colliders<L>,
        near: &mut [u32],
    ) -> bool {
        let [inner, outer] = self.travel;
        if self.next[0] > inner && self.next[1] > outer {
            near.fill(0);
            return false;
        }
        self.placed.fill(false);
        self.next = [f64::INFINITY; 2];
        for (p, near) in near.iter_mut().enumerate() {
            let frame = self.tests[p].frame();
            *near = 0;
            if self.due[p] <= self.travel[frame] {
                let (mask, gap) = self.test_pair(model, p, position, colliders);
                *near = L::bits(mask & alive);
                // A gap that another step like the last may close is not worth knowing.
                let narrow = gap.le(L::of(self.way[frame] / USABLE[frame]));
                let gap = if L::any((narrow | mask) & alive) { 0.0 } else { smallest(gap, self.alive) };
                self.due[p] = self.travel[frame] + USABLE[frame] * gap;
            }
            self.next[frame] = self.next[frame].min(self.due[p]);
        }
        true
    }

    /// Places the geoms of a pair where that was not done yet, and tests it.
    #[inline(always)]
    fn test_pair<L: LaneQuery>(
        &mut self,
        model: &Model<L::Real>,
        p: usize,
        position: &Position<L>,
        colliders: &mut Colliders<L>,
    ) -> (L::Mask, L) {
        let test = &self.tests[p];
        let [first, second] = [0, 1].map(|k| {
            let g = test.geoms[k] as usize;
            if !self.placed[g] {
                let body = body(model, position, g);
                (colliders.pos[g], colliders.axis[g]) = (body.pos, body.axis());
                self.placed[g] = true;
            }
            [test.frames.shift(k, &colliders.pos[g], position), colliders.axis[g]]
        });
        test.near(&first, &second)
    }
}

/// The smallest of the entries of the lanes in `alive`, 0 if one is not a number.
fn smallest<L: LaneQuery>(x: L, alive: u32) -> f64 {
    let lanes = (0..L::WIDTH).filter(|i| alive >> i & 1 != 0);
    lanes.map(|i| x.get(i).to_f64()).fold(f64::INFINITY, |least, x| if x >= least { least } else { x.max(0.0) })
}
