//! The broad phase: which pairs are near in some world of the block.
//!
//! A pair is near where its bounding spheres, or a plane (which stands still) and a bounding sphere, are within reach. A
//! pair that is out of reach by a gap in every world needs no other test until geoms have moved so far that the gap may be
//! closed, so far pairs are rarely looked at. Since the path of a point is at least as long as the way between its ends,
//! this holds however worlds move, also when others take their place; a pair is never passed over while it is near.

use crate::lane::{Lane, LaneQuery, Real, Scalar};
use crate::math::vec3::{Vec3, add, column, dot, sub, zero};
use crate::model::{Model, NONE, Pair, Shape};
use crate::position::Position;

use super::{Colliders, reference};

/// Gaps that are told apart, in units of a pair's reach.
const GAPS: [f64; 8] = [0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];

/// Part of a gap that geoms may close before the pair is tested again. Two geoms can approach from both sides; the rest is
/// for rounding.
const USABLE: f64 = 0.45;

/// The bounding test of a pair.
#[derive(Clone, Debug)]
struct Test {
    geoms: [u32; 2],
    /// Trees of the geoms, [`NONE`] for one that stands still, and the tree at whose origin the contacts are placed.
    trees: [u32; 2],
    reference: u32,
    /// Whether the first geom is a plane.
    plane: bool,
    /// Distance of centres, or height above the plane, within which the pair is near.
    reach: f64,
}

/// The bounding tests, and when each is due.
#[derive(Clone, Debug)]
pub struct Broad<L> {
    tests: Vec<Test>,
    /// Travel at which each pair is to be tested.
    due: Vec<f64>,
    /// Sum over the steps of the longest way of any geom in any world, m: relative to its tree's origin, and in the world.
    travel: [f64; 2],
    /// Travel at which the next pair is to be tested.
    next: [f64; 2],
    /// Origins of trees in the last step.
    origin: Vec<Vec3<L>>,
    /// Worlds that took part in the last step.
    alive: u32,
}

impl<L: LaneQuery> Broad<L> {
    /// The tests of the model's pairs, all due.
    pub fn new(model: &Model<L::Real>) -> Self {
        Broad {
            tests: model.pairs.iter().map(|pair| Test::new(model, pair)).collect(),
            due: vec![0.0; model.pairs.len()],
            travel: [0.0; 2],
            next: [0.0; 2],
            origin: vec![zero(); model.sizes.ntree],
            alive: 0,
        }
    }

    /// Takes note of how far the worlds in `alive` have moved since the last step. `relative` is the largest square of the
    /// way of any geom relative to its tree's origin, `MAX` where it is not a number.
    pub fn advance(&mut self, position: &Position<L>, relative: L, alive: L::Mask) {
        let mut known = relative.lt(L::of(L::Real::MAX));
        let mut origins = L::zero();
        for (old, new) in self.origin.iter_mut().zip(&position.origin) {
            let way = sub(new, old);
            let square = dot(&way, &way);
            known = known & square.within(L::Real::MAX);
            origins = origins.max(square);
            *old = *new;
        }
        let alive = L::bits(alive);
        if alive & !(L::bits(known) & self.alive) != 0 {
            // Worlds that were not looked at before, or came from nowhere.
            self.due.fill(0.0);
            self.travel = [0.0; 2];
            self.next = [0.0; 2];
        } else {
            let longest = |squares: L| {
                let lanes = (0..L::WIDTH).filter(|i| alive >> i & 1 != 0);
                lanes.fold(0.0, |most: f64, i| most.max(squares.get(i).to_f64())).sqrt()
            };
            let relative = longest(relative);
            self.travel[0] += relative;
            self.travel[1] += relative + longest(origins);
        }
        self.alive = alive;
    }

    /// Whether any pair has to be tested.
    pub fn any_due(&self) -> bool {
        self.next[0] <= self.travel[0] || self.next[1] <= self.travel[1]
    }

    /// Finds when the next pair has to be tested.
    pub fn look_ahead(&mut self) {
        self.next = [f64::INFINITY; 2];
        for (test, due) in self.tests.iter().zip(&self.due) {
            let next = &mut self.next[test.frame()];
            *next = next.min(*due);
        }
    }

    /// Whether pair `p` has to be tested.
    #[inline(always)]
    pub fn is_due(&self, p: usize) -> bool {
        self.due[p] <= self.travel[self.tests[p].frame()]
    }

    /// The worlds of `alive` in which pair `p` is near. If there are none, notes when to look again.
    #[inline(always)]
    pub fn near(&mut self, p: usize, position: &Position<L>, colliders: &Colliders<L>, alive: L::Mask) -> L::Mask {
        let test = &self.tests[p];
        let [first, second] = test.centres(position, colliders);
        let between = sub(&second, &first);
        let reach = L::of(test.reach);
        let (distance, near) = if test.plane {
            let height = dot(&column(&colliders.rot[test.geoms[0] as usize], 2), &between);
            (height, height.le(reach) & alive)
        } else {
            let square = dot(&between, &between);
            (square, square.le(reach * reach) & alive)
        };
        if !L::any(near) {
            let gap = test.gap(distance, self.alive);
            self.due[p] = self.travel[test.frame()] + USABLE * gap;
        }
        near
    }

    /// The centres of pair `p`'s geoms, relative to the pair's reference point.
    pub fn centres(&self, p: usize, position: &Position<L>, colliders: &Colliders<L>) -> [Vec3<L>; 2] {
        self.tests[p].centres(position, colliders)
    }
}

impl Test {
    fn new<T: Scalar>(model: &Model<T>, pair: &Pair<T>) -> Self {
        let [first, second] = [pair.geom1, pair.geom2].map(|g| &model.geoms[g as usize]);
        let tree = |link: u32| if link == NONE { NONE } else { model.links[link as usize].tree };
        let plane = first.shape == Shape::Plane;
        let reach = pair.include + second.rbound;
        Test {
            geoms: [pair.geom1, pair.geom2],
            trees: [tree(pair.link1), tree(pair.link2)],
            reference: tree(reference(pair)),
            plane,
            reach: if plane { reach } else { reach + first.rbound }.to_f64(),
        }
    }

    /// Which travel counts: relative to the one tree's origin, or in the world.
    #[inline(always)]
    fn frame(&self) -> usize {
        usize::from(self.trees[0] != self.trees[1])
    }

    #[inline(always)]
    fn centres<L: Lane>(&self, position: &Position<L>, colliders: &Colliders<L>) -> [Vec3<L>; 2] {
        let origin = |tree: u32| if tree == NONE { zero() } else { position.origin[tree as usize] };
        let centre = |k: usize| {
            let pos = colliders.pos[self.geoms[k] as usize];
            if self.trees[k] == self.reference {
                return pos;
            }
            add(&pos, &sub(&origin(self.trees[k]), &origin(self.reference)))
        };
        [centre(0), centre(1)]
    }

    /// The largest of [`GAPS`] by which the worlds in `alive` are all out of reach, m, or 0. `distance` is the height above
    /// a plane, or the square of the distance of centres.
    #[inline(always)]
    fn gap<L: LaneQuery>(&self, distance: L, alive: u32) -> f64 {
        let clear = |gap: &f64| {
            let edge = (1.0 + gap) * self.reach;
            let edge = L::of(if self.plane { edge } else { edge * edge });
            L::bits(distance.ge(edge)) & alive == alive
        };
        match GAPS.partition_point(clear) {
            0 => 0.0,
            n => GAPS[n - 1] * self.reach,
        }
    }
}
