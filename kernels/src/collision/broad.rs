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

use crate::lane::{Lane, LaneQuery, Mask, Real};
use crate::model::{Instance, Model};
use crate::position::{Configuration, Position};

use super::Colliders;
use super::body::body;
use super::bound::Test;

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

impl<L: Lane> Broad<L> {
    /// Bytes of that.
    pub fn bytes(model: &Model<L::Real>) -> usize {
        let pairs = model.pairs.len() * (size_of::<Test>() + size_of::<u32>());
        pairs + most_tests(model) * size_of::<L>() + model.geoms.len()
    }

    /// The tests of the model's pairs, all due.
    pub fn new(model: &Model<L::Real>) -> Self {
        Broad {
            tests: model.pairs.iter().map(|pair| Test::new(model, pair)).collect(),
            schedule: Schedule { due: Vec::with_capacity(most_tests(model)), next: [L::zero(); 2] },
            placed: vec![false; model.geoms.len()],
            near: vec![0; model.pairs.len()],
        }
    }
}

impl<L: LaneQuery> Broad<L> {
    /// Finds where pairs are near, in the worlds of `alive`, pair by pair. Whether any is. A pair that is near is due at once, so
    /// that none is where no test is due.
    pub fn test(
        &mut self,
        model: Instance<'_, L>,
        (configuration, position): (Configuration<'_, L>, &Position<L>),
        alive: L::Mask,
        colliders: &mut Colliders<L>,
    ) -> bool {
        self.schedule.begin(self.tests.len(), colliders);
        colliders.set_out(configuration, position);
        let any = self.test_pairs(model, position, alive, colliders);
        self.end(colliders);
        any
    }

    /// Begins tests of so many groups.
    pub fn begin(
        &mut self,
        groups: usize,
        (configuration, position): (Configuration<'_, L>, &Position<L>),
        colliders: &mut Colliders<L>,
    ) {
        self.schedule.begin(2 * groups, colliders);
        colliders.set_out(configuration, position);
    }

    /// Whether a group is due in some world of `alive`.
    #[inline(always)]
    pub fn is_due(&self, group: usize, alive: L::Mask, colliders: &Colliders<L>) -> bool {
        [0, 1].into_iter().any(|frame| self.schedule.is_due(2 * group + frame, frame, alive, colliders))
    }

    /// Notes where the pairs of a group that was tested are near, in the worlds of `alive`, and when it is due again. Whether
    /// any is near.
    pub fn note(
        &mut self,
        group: usize,
        (pairs, worlds): (&[u32], &[u32]),
        alive: u32,
        colliders: &Colliders<L>,
    ) -> bool {
        let mut any = 0;
        for (p, worlds) in pairs.iter().zip(worlds) {
            self.near[*p as usize] = worlds & alive;
            any |= worlds;
        }
        for frame in [0, 1] {
            self.schedule.postpone(2 * group + frame, frame, colliders.gaps[frame], colliders);
        }
        any & alive != 0
    }

    /// After all groups, or all pairs: keeps when the next of them is due.
    pub fn end(&mut self, colliders: &mut Colliders<L>) {
        colliders.due.copy_from_slice(&self.schedule.next);
    }

    /// Looks whether a group is the next that is due.
    #[inline(always)]
    pub fn foresee(&mut self, group: usize) {
        [0, 1].into_iter().for_each(|frame| self.schedule.foresee(2 * group + frame, frame));
    }

    fn test_pairs(
        &mut self,
        model: Instance<'_, L>,
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
        model: Instance<'_, L>,
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
