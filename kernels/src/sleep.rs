//! Trees that sleep: those that have rested for a while, with all that they touch, are held where they are until something moves them.
//! Who sleeps is asked world by world; what is computed stays the same for all, so that no world depends on another's sleep.

use crate::constraint::Constraint;
use crate::lane::{Lane, LaneQuery, Real};
use crate::model::{Model, NONE};
use crate::state::{Applied, State};

/// Steps that a tree rests before it may sleep.
pub const LEAST_REST: u32 = 10;
/// From here on a tree sleeps: the number beyond is that of the next of those that sleep together.
pub const ASLEEP: u32 = LEAST_REST + 1;

/// What is worked with.
#[derive(Clone, Debug)]
pub struct Sleep<L> {
    /// Positions before the step.
    qpos: Vec<L>,
    /// Low words of time and positions before the step.
    low: Vec<L>,
    /// Of one world, by tree: how long it has rested.
    rest: Vec<u32>,
    /// By tree, a tree of the same island; itself if it stands for the island.
    island: Vec<u32>,
    /// By island: whether it keeps others awake.
    open: Vec<bool>,
}

impl<L: Lane> Sleep<L> {
    /// Room for a model whose trees may sleep.
    pub fn new(model: &Model<L::Real>) -> Option<Self> {
        let n = model.sizes.nsleep;
        (n > 0).then(|| Sleep {
            qpos: vec![L::zero(); model.sizes.nq],
            low: vec![L::zero(); model.sizes.nlow],
            rest: vec![0; n],
            island: vec![0; n],
            open: vec![false; n],
        })
    }

    /// Bytes of it.
    pub fn bytes(model: &Model<L::Real>) -> usize {
        let room =
            (model.sizes.nq + model.sizes.nlow) * size_of::<L>() + model.sizes.nsleep * (2 * size_of::<u32>() + 1);
        if model.sizes.nsleep > 0 { room } else { 0 }
    }
}

/// The worlds of a mask.
fn worlds(mut lanes: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = (lanes != 0).then_some(lanes.trailing_zeros())?;
        lanes &= lanes - 1;
        Some(lane as usize)
    })
}

/// Wakes trees that were given a velocity or a force from outside, and those that sleep with them.
pub fn disturb<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &mut State<L>,
    applied: Option<&Applied<L>>,
    alive: u32,
    sleep: &mut Sleep<L>,
) {
    for lane in worlds(alive) {
        sleep.load(state, lane);
        for tree in 0..sleep.rest.len() {
            if sleep.rest[tree] >= ASLEEP && (moves(model, state, tree, lane) || pushed(model, applied, tree, lane)) {
                sleep.wake(tree);
            }
        }
        sleep.store(state, lane);
    }
}

/// Before the state is advanced: wakes what something awake touches, counts for how long trees have rested, and lets islands sleep that
/// have rested for long enough. Their velocities are zero from now on.
pub fn settle<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &mut State<L>,
    (applied, constraint): (Option<&Applied<L>>, &Constraint<L>),
    alive: u32,
    sleep: &mut Sleep<L>,
) {
    for lane in worlds(alive) {
        sleep.load(state, lane);
        sleep.join(model, constraint, lane);
        sleep.rouse();
        for tree in 0..sleep.rest.len() {
            let rest = sleep.rest[tree];
            if rest < ASLEEP {
                let still = model.sleepers[tree].allowed
                    && !pushed(model, applied, tree, lane)
                    && slow(model, state, tree, lane);
                sleep.rest[tree] = if still { (rest + 1).min(LEAST_REST) } else { 0 };
            }
        }
        sleep.lull();
        sleep.store(state, lane);
    }
    sleep.qpos.copy_from_slice(&state.qpos);
    sleep.low.copy_from_slice(&state.low);
}

/// After it: trees that sleep are where they were, at rest.
pub fn hold<L: Lane>(model: &Model<L::Real>, state: &mut State<L>, sleep: &Sleep<L>) {
    let State { qpos, qvel, tree_rest, tree_guard, low, .. } = state;
    for (tree, rest) in model.sleepers.iter().zip(&*tree_rest) {
        let awake = rest.lt(L::of(f64::from(ASLEEP)));
        for q in tree.qpos.range() {
            qpos[q] = L::select(awake, qpos[q], sleep.qpos[q]);
            if let Some(low) = low.get_mut(1 + q) {
                *low = L::select(awake, *low, sleep.low[1 + q]);
            }
        }
        for v in tree.dofs.range() {
            qvel[v] = L::select(awake, qvel[v], L::zero());
        }
    }
    // The guard's books are of trees that move.
    for (books, guarded) in tree_guard.iter_mut().zip(model.guarded()) {
        let own = model.sleepers.iter().position(|tree| tree.dofs.range() == guarded.dofs);
        if let Some(rest) = own.and_then(|tree| tree_rest.get(tree)) {
            let awake = rest.lt(L::of(f64::from(ASLEEP)));
            books.iter_mut().for_each(|x| *x = L::select(awake, *x, L::zero()));
        }
    }
}

fn slow<L: LaneQuery>(model: &Model<L::Real>, state: &State<L>, tree: usize, lane: usize) -> bool {
    let tolerance = L::Real::from_f64(model.options.sleep_tolerance);
    model.sleepers[tree].dofs.range().all(|v| {
        let speed = state.qvel[v].get(lane) * model.sleep_lengths[v];
        speed < tolerance && -speed < tolerance
    })
}

fn moves<L: LaneQuery>(model: &Model<L::Real>, state: &State<L>, tree: usize, lane: usize) -> bool {
    let zero = L::Real::from_f64(0.0);
    model.sleepers[tree].dofs.range().any(|v| state.qvel[v].get(lane) != zero)
}

/// Whether a force from outside acts on a tree.
fn pushed<L: LaneQuery>(model: &Model<L::Real>, applied: Option<&Applied<L>>, tree: usize, lane: usize) -> bool {
    let Some(applied) = applied else { return false };
    let acts = |force: &L| force.get(lane) != L::Real::from_f64(0.0);
    let of_tree = |link: u32| link != NONE && model.links[link as usize].tree as usize == tree;
    let bodies = model.bodies.iter().zip(&applied.xfrc_applied).filter(|(body, _)| of_tree(body.link));
    model.sleepers[tree].dofs.range().any(|v| acts(&applied.qfrc_applied[v]))
        || bodies.into_iter().any(|(_, force)| force.iter().any(acts))
}

impl<L: LaneQuery> Sleep<L> {
    /// A world's; trees that are said to sleep with one that is not there are awake.
    fn load(&mut self, state: &State<L>, lane: usize) {
        let end = ASLEEP + self.rest.len() as u32;
        for (own, rest) in self.rest.iter_mut().zip(&state.tree_rest) {
            let rest = rest.get(lane).to_f64() as u32;
            *own = if rest < end { rest } else { 0 };
        }
    }

    fn store(&self, state: &mut State<L>, lane: usize) {
        let counts = state.tree_rest.iter_mut().zip(&self.rest);
        counts.for_each(|(rest, own)| rest.set(lane, L::Real::from_f64(f64::from(*own))));
    }
}

impl<L: LaneQuery> Sleep<L> {
    /// Which trees are joined by constraints that act in a world.
    fn join(&mut self, model: &Model<L::Real>, constraint: &Constraint<L>, lane: usize) {
        (0..).zip(&mut self.island).for_each(|(tree, island)| *island = tree);
        let here = |lanes: u32| lanes >> lane & 1 == 1;
        let acts = |d: &L| d.get(lane) > L::Real::from_f64(0.0);
        let of_link = |link: u32| (link != NONE).then(|| model.links[link as usize].tree);
        let of_dof = |dof: u32| of_link(model.dofs[dof as usize].link);
        for row in constraint.contact_rows.iter().filter(|row| here(row.lanes)) {
            let pair = &model.pairs[row.pair as usize];
            let links = [pair.geom1, pair.geom2].map(|geom| model.geoms[geom as usize].link);
            self.unite(links.into_iter().filter_map(of_link));
        }
        let equalities = if here(constraint.equality.lanes) { &model.equalities[..] } else { &[] };
        for equality in equalities.iter().filter(|equality| acts(&constraint.equality.d[equality.row as usize])) {
            let dofs = &model.equality_dofs[equality.dofs.range()];
            self.unite(dofs.iter().filter_map(|dof| of_dof(dof.dof)));
        }
        let along = constraint.dof_laws().filter(|law| here(constraint.joint_lanes) && law.row.tendon != NONE);
        for law in along.filter(|law| acts(&law.d())) {
            let dofs = &model.tendon_dofs[model.tendons[law.row.tendon as usize].dofs.range()];
            self.unite(dofs.iter().filter_map(|dof| of_dof(dof.dof)));
        }
    }

    /// Lets trees sleep that are to start asleep, if all that each touches are: `state` is the one in which they start. Where there are such
    /// trees, MuJoCo counts the start as a step for which the others have rested.
    pub fn begin(&mut self, model: &Model<L::Real>, constraint: &Constraint<L>, asleep: &[bool], state: &mut State<L>) {
        for ((rest, asleep), tree) in self.rest.iter_mut().zip(asleep).zip(&model.sleepers) {
            *rest = if *asleep { LEAST_REST } else { u32::from(tree.allowed) };
        }
        self.join(model, constraint, 0);
        self.lull();
        let failed = self.rest.iter_mut().zip(asleep).filter(|(rest, asleep)| **asleep && **rest < ASLEEP);
        failed.for_each(|(rest, _)| *rest = 0);
        self.store(state, 0);
    }
}

impl<L> Sleep<L> {
    /// The tree that stands for a tree's island.
    fn head(&self, tree: u32) -> u32 {
        let mut tree = tree;
        while self.island[tree as usize] != tree {
            tree = self.island[tree as usize];
        }
        tree
    }

    /// Makes one island of those of trees.
    fn unite(&mut self, trees: impl IntoIterator<Item = u32>) {
        let mut first = None;
        for tree in trees {
            let head = self.head(tree);
            let one = *first.get_or_insert(head);
            let (low, high) = (one.min(head), one.max(head));
            self.island[high as usize] = low;
            first = Some(low);
        }
    }

    /// Wakes a tree and those that sleep with it.
    fn wake(&mut self, tree: usize) {
        let mut tree = tree;
        while let Some(next) = self.rest[tree].checked_sub(ASLEEP) {
            self.rest[tree] = 0;
            tree = next as usize;
        }
    }

    /// Wakes trees in whose islands some tree is awake; and those that sleep with them, in whose islands others may.
    fn rouse(&mut self) {
        loop {
            self.open.fill(false);
            for tree in 0..self.rest.len() {
                let head = self.head(tree as u32) as usize;
                self.open[head] |= self.rest[tree] < ASLEEP;
            }
            let wakes = |tree: &usize| self.rest[*tree] >= ASLEEP && self.open[self.head(*tree as u32) as usize];
            let Some(tree) = (0..self.rest.len()).find(wakes) else { return };
            self.wake(tree);
        }
    }

    /// Lets islands sleep all of whose trees have rested for long enough.
    fn lull(&mut self) {
        self.open.fill(false);
        for tree in 0..self.rest.len() {
            let head = self.head(tree as u32) as usize;
            self.open[head] |= self.rest[tree] != LEAST_REST;
        }
        for head in (0..self.rest.len()).filter(|tree| self.island[*tree] as usize == *tree) {
            if !self.open[head] {
                // Each has the number of the next, the last that of the first.
                let mut last = head;
                for tree in head + 1..self.rest.len() {
                    if self.head(tree as u32) as usize == head {
                        self.rest[last] = ASLEEP + tree as u32;
                        last = tree;
                    }
                }
                self.rest[last] = ASLEEP + head as u32;
            }
        }
    }
}
