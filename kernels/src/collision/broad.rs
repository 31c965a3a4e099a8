//! The broad phase: when pairs have to be tested again.
//!
//! Pairs that are out of reach by a gap in a world need no other test there until its geoms have moved so far that the gap
//! may be closed. Since the path of a point is at least as long as the way between its ends, this holds however worlds move,
//! also when others take their place; a pair is never passed over while it is near.
//!
//! Ways, gaps and due times are those of each world. No number is shared by worlds, so none can hide what another needs.
//!
//! Kernels test pair by pair, each when it is due in some world. Code tests whole groups of pairs at once, those that are near
//! each other in the reference configuration in the first and smallest group, so that few groups are due where nothing
//! touches.

use crate::code::Code;
use crate::lane::{LaneQuery, Mask, Real};
use crate::model::Model;
use crate::position::Position;

use super::Colliders;
use super::bound::Test;
use super::pair::{Body, body};

/// Part of a gap that ways may use up before the pair is tested again: within a tree, and in the world, where two geoms can
/// approach from both sides. The rest is for rounding of lengths; that of places is the blur of
/// [`Colliders`](super::Colliders).
const USABLE: [f64; 2] = [0.9, 0.45];
/// The sum of ways from which on all starts anew, m: a longer one would lose the ways of single steps.
const LONGEST: f64 = 8.0;

/// When tests are due, world by world.
#[derive(Clone, Debug)]
struct Schedule<L> {
    /// Travel at which each test is to be made again.
    due: Vec<L>,
    /// The earliest of each frame.
    next: [L; 2],
}

/// The bounding tests, and when each is due.
#[derive(Clone, Debug)]
pub struct Broad<L> {
    /// By pair.
    tests: Vec<Test>,
    /// By pair, or by group and frame.
    schedule: Schedule<L>,
    /// Geoms whose pose is that of this step: what stands still, and what some pair needed.
    placed: Vec<bool>,
    /// Worlds in which each pair is near, as bits: of pairs that were not tested, none that is alive.
    pub near: Vec<u32>,
}

/// Most tests that have a due time of their own: one of each pair, or two of each group of pairs, of which only the last may
/// be of one.
fn most_tests<T>(model: &Model<T>) -> usize {
    model.pairs.len() + 1
}

impl<L: LaneQuery> Broad<L> {
    /// The tests of the model's pairs, all due.
    pub fn new(model: &Model<L::Real>) -> Self {
        Broad {
            tests: model.pairs.iter().map(|pair| Test::new(model, pair)).collect(),
            schedule: Schedule { due: Vec::with_capacity(most_tests(model)), next: [L::zero(); 2] },
            placed: vec![false; model.geoms.len()],
            near: vec![0; model.pairs.len()],
        }
    }

    /// Bytes of that.
    pub fn bytes(model: &Model<L::Real>) -> usize {
        let pairs = model.pairs.len() * (size_of::<Test>() + size_of::<u32>());
        pairs + most_tests(model) * size_of::<L>() + model.geoms.len()
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
        let groups = code.groups();
        self.schedule.begin(if groups > 0 { 2 * groups } else { self.tests.len() }, colliders);
        colliders.set_out(qpos, position);
        let any = if groups > 0 {
            self.test_groups(groups, position, alive, code, colliders)
        } else {
            self.test_pairs(model, position, alive, colliders)
        };
        colliders.due.copy_from_slice(&self.schedule.next);
        any
    }

    fn test_groups(
        &mut self,
        groups: usize,
        position: &Position<L>,
        alive: L::Mask,
        code: &mut dyn Code<L>,
        colliders: &Colliders<L>,
    ) -> bool {
        let Broad { schedule, near, .. } = self;
        let mut any = false;
        for group in 0..groups {
            let tests = [2 * group, 2 * group + 1];
            if [0, 1].into_iter().any(|frame| schedule.is_due(tests[frame], frame, alive, colliders)) {
                let mut gaps = [L::zero(); 2];
                any |= code.near(group, position, L::bits(alive), near, &mut gaps);
                for frame in [0, 1] {
                    schedule.postpone(tests[frame], frame, gaps[frame], colliders);
                }
            }
            for frame in [0, 1] {
                schedule.foresee(tests[frame], frame);
            }
        }
        any
    }

    fn test_pairs(
        &mut self,
        model: &Model<L::Real>,
        position: &Position<L>,
        alive: L::Mask,
        colliders: &mut Colliders<L>,
    ) -> bool {
        self.placed.fill(false);
        let mut any = 0;
        for p in 0..self.tests.len() {
            let frame = self.tests[p].frame();
            self.near[p] = 0;
            if self.schedule.is_due(p, frame, alive, colliders) {
                let (mask, gap) = self.test_pair(model, p, position, colliders);
                self.near[p] = L::bits(mask & alive);
                any |= self.near[p];
                self.schedule.postpone(p, frame, gap, colliders);
            }
            self.schedule.foresee(p, frame);
        }
        any != 0
    }

    /// Places the geoms of a pair where that was not done yet, and tests it.
    #[inline(always)]
    fn test_pair(
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

    /// A pair's geoms, where they are relative to its reference point.
    #[inline(always)]
    pub fn bodies(&self, model: &Model<L::Real>, p: usize, position: &Position<L>) -> [Body<L>; 2] {
        let test = &self.tests[p];
        test.frames.place(position, test.geoms.map(|g| body(model, position, g as usize)))
    }
}

impl<L: LaneQuery> Schedule<L> {
    /// Adds the ways to the travel; starts anew in worlds that came from nowhere, or whose sum would lose digits.
    fn begin(&mut self, tests: usize, colliders: &mut Colliders<L>) {
        self.due.resize(tests, L::of(-L::Real::MAX));
        self.next = [L::of(LONGEST); 2];
        let Colliders { travel, way, .. } = colliders;
        travel.iter_mut().zip(way).for_each(|(travel, way)| *travel += *way);
        let short = |travel: &L| travel.lt(L::of(LONGEST));
        let goes_on = travel.iter().map(short).fold(L::Mask::splat(true), |all, short| all & short);
        if !L::any(!goes_on) {
            return;
        }
        for travel in travel {
            *travel = L::select(goes_on, *travel, L::zero());
        }
        for due in &mut self.due {
            *due = L::select(goes_on, *due, L::of(-L::Real::MAX));
        }
    }

    /// Whether a test is due in some world of `alive`.
    #[inline(always)]
    fn is_due(&self, test: usize, frame: usize, alive: L::Mask, colliders: &Colliders<L>) -> bool {
        let spent = colliders.travel[frame] + colliders.blur[frame];
        L::any(!spent.lt(self.due[test]) & alive)
    }

    /// After a test: it is due again when ways have used up the gap. At once, if the gap is not a number.
    #[inline(always)]
    fn postpone(&mut self, test: usize, frame: usize, gap: L, colliders: &Colliders<L>) {
        let due = gap.mul_add(L::of(USABLE[frame]), colliders.travel[frame]) - colliders.blur[frame];
        self.due[test] = L::select(due.within(L::Real::MAX), due, L::of(-L::Real::MAX));
    }

    /// Looks for the earliest test.
    #[inline(always)]
    fn foresee(&mut self, test: usize, frame: usize) {
        self.next[frame] = self.due[test].min(self.next[frame]);
    }
}
