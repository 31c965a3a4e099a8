//! The guard: inertial forces create no energy and no momentum. A kick of the step, h a, is taken apart into half of what forces do, what
//! inertial forces do, and the other half of what forces do. Forces and constraints work exactly as the algebra of the kick says, and
//! that work is booked, tree by tree; the kinetic energy in the middle of the inertial part may not be more than what the books say.
//! Where it is, the inner velocities (all but the motion of the root that has the tree's momentum) are scaled down; the root of a
//! floating tree moves as its booked momentum says. What the books and the tree differ by leaks into the books with a time constant of a
//! second, so that small errors do not add up.

use super::root::Root;
use super::{Guard, Kick, Scratch};
use crate::acceleration::Acceleration;
use crate::inertia::Inertia;
use crate::lane::{Lane, Mask, Real};
use crate::math::ldl;
use crate::math::spatial::{Spatial, dot6, inertia_mul};
use crate::math::vec3::{add, scale, sub, zero};
use crate::model::{Instance, Tree};
use crate::position::Position;
use crate::state::State;

/// By how much more than its energy a tree starts.
const START: f64 = 1.02;
/// The part of its largest energy by which a tree may exceed its books.
const SLACK: f64 = 0.03;
/// Scales below which the second half of the inertial part is left out, from this number up to 1 less and less of it.
const KEEN: f64 = 0.9;
/// Scales above which the guard does not count as having acted.
const SILENT: f64 = 0.99;

/// The stages that it reads.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)] // each field is the stage of the same name
pub struct Stages<'a, L> {
    pub position: &'a Position<L>,
    pub inertia: &'a Inertia<L>,
    /// What is factored: the inertia matrix, or what the step has in its place.
    pub metric: &'a [L],
}

/// Changes the smooth force and acceleration where a tree would have more energy or another momentum than it was given, and opens the
/// next books.
pub fn guard<L: Lane>(
    model: Instance<'_, L>,
    stages: Stages<'_, L>,
    state: &State<L>,
    acceleration: &mut Acceleration<L>,
    kick: &mut Kick<L>,
) {
    let h = L::of(model.options.timestep);
    let Acceleration { qfrc_smooth, qacc_smooth, factor, inverse, .. } = acceleration;
    let Kick { guard, scratch, .. } = kick;
    let (rows, pattern, m) = (&model.rows, &model.tree_pattern, &stages.inertia.m);
    let Scratch { first: turned, second: pushed, change, product, forced, inertial, bias } = scratch;
    weigh(model, stages, turned);
    for (i, x) in turned.iter_mut().enumerate() {
        *x = h * (*x - bias[i]);
    }
    ldl::solve(rows, pattern, factor, inverse, turned);
    for (i, x) in pushed.iter_mut().enumerate() {
        *x = h.mul_add(qacc_smooth[i], -turned[i]);
    }
    ldl::multiply(rows, pattern, m, &state.qvel, product);
    ldl::multiply(rows, pattern, m, pushed, forced);
    ldl::multiply(rows, pattern, m, turned, inertial);
    change.fill(L::zero());
    for (t, tree) in model.guarded().enumerate() {
        let tree = Kicked {
            root: tree.floats(&model).then(|| Root::new(&model, stages.position, stages.inertia, &tree)),
            tree,
            parts: [&state.qvel, pushed, turned],
            momenta: [product, forced, inertial],
        };
        let found = tree.check(&state.tree_guard[t], h, (change, &mut guard.velocity));
        (guard.books[t], guard.acted[t]) = found;
    }
    ldl::multiply(rows, pattern, stages.metric, change, product);
    let rate = L::one() / h;
    for (i, change) in change.iter().enumerate() {
        qacc_smooth[i] = rate.mul_add(*change, qacc_smooth[i]);
        qfrc_smooth[i] = rate.mul_add(product[i], qfrc_smooth[i]);
    }
}

/// The bias force at rest: the weight.
fn weigh<L: Lane>(model: Instance<'_, L>, Stages { position, inertia, .. }: Stages<'_, L>, out: &mut [L]) {
    let (o, g) = (L::zero(), model.gravity());
    let up = [o, o, o, -g[0], -g[1], -g[2]];
    for (link, composite) in model.links.iter().zip(&inertia.composite) {
        let force = inertia_mul(composite, &up);
        for i in link.dofs.range() {
            out[i] = dot6(&position.cdof[i], &force);
        }
    }
}

/// A tree and its kick: the velocity, what forces add to it and what inertial forces add; their products with the inertia.
struct Kicked<'a, L> {
    tree: Tree,
    root: Option<Root<L>>,
    parts: [&'a [L]; 3],
    momenta: [&'a [L]; 3],
}

impl<L: Lane> Kicked<'_, L> {
    /// What is to be changed of the velocity, and what it is then after the inertial part. Returns the next books, and whether the
    /// guard acted.
    fn check(&self, books: &[L; 15], h: L, (change, velocity): (&mut [L], &mut [L])) -> ([L; 15], L) {
        let (zero, one, half) = (L::zero(), L::one(), L::of(0.5));
        let ([v, pushed, turned], [p, forced, inertial]) = (self.parts, self.momenta);
        let [booked, work, most] = [books[0], books[1], books[2]];
        let dofs = self.tree.dofs.clone();
        let middle = |i: usize| half.mul_add(pushed[i] + turned[i], v[i]);
        let (mut start, mut gain, mut kinetic) = (zero, zero, zero);
        for i in dofs.clone() {
            start = (half * v[i]).mul_add(p[i], start);
            gain = (half * pushed[i]).mul_add(L::of(0.25).mul_add(forced[i], p[i]), gain);
            kinetic = (half * middle(i)).mul_add(half.mul_add(forced[i] + inertial[i], p[i]), kinetic);
        }
        let fresh = most.le(zero);
        let energy = L::select(fresh, L::of(START) * start, booked) + work + gain;
        let Carried { locked, shift, half: carried, energies: [own, target], momentum } = self.carried(books, fresh);
        let most = energy.max((one - h) * most);
        let inner = (kinetic - own).max(zero);
        let excess = L::of(-SLACK).mul_add(most, inner + target - energy);
        let rounding = L::of(4096.0 * L::Real::EPSILON);
        let acts = excess.gt(zero) & inner.gt(rounding * kinetic);
        let kept = one - excess / L::select(acts, inner, one);
        let scale = L::select(acts, kept.max(zero).sqrt(), one);
        let second = scale * (L::of(1.0 / (1.0 - KEEN)) * (scale - L::of(KEEN))).max(zero).min(one);
        for i in dofs {
            let at = i - self.tree.dofs.start;
            let root = |x: &Spatial<L>| if self.root.is_some() && at < 6 { x[at] } else { zero };
            let (held, push) = (middle(i) - root(&locked), half.mul_add(turned[i], -root(&carried)));
            let changed = root(&shift) - (one - scale) * held - (one - second) * push;
            change[i] = changed;
            velocity[i] = middle(i) + half * turned[i] + changed;
        }
        let left = (inner * scale).mul_add(scale, target - energy);
        let mut next = [zero; 15];
        (next[0], next[2]) = (h.mul_add(left, energy), most);
        next[3..9].copy_from_slice(&momentum);
        (next, L::select(scale.lt(L::of(SILENT)), one, zero))
    }

    /// How the root moves.
    fn carried(&self, books: &[L; 15], fresh: L::Mask) -> Carried<L> {
        let Some(root) = &self.root else {
            return Carried { locked: zero(), shift: zero(), half: zero(), energies: [L::zero(); 2], momentum: zero() };
        };
        let [p, forced, inertial] = self.momenta.map(|x| root.of(x));
        let half = L::of(0.5);
        let now: Spatial<L> = std::array::from_fn(|k| half.mul_add(forced[k] + inertial[k], p[k]));
        let seen = root.wrench(&now);
        let pushed = root.wrench(&scale(half, &forced));
        let momentum: Spatial<L> =
            std::array::from_fn(|k| L::select(fresh, seen[k], books[3 + k] + books[9 + k] + pushed[k]));
        let missing = root.momentum(&sub(&momentum, &seen));
        let (locked, shift) = (root.motion(&now), root.motion(&missing));
        let energy = |x: &Spatial<L>, p: &Spatial<L>| half * dot6(x, p);
        let own = energy(&locked, &now);
        let target = energy(&add(&locked, &shift), &add(&now, &missing));
        Carried { half: root.motion(&scale(half, &inertial)), locked, shift, energies: [own, target], momentum }
    }
}

/// How the root of a tree moves.
struct Carried<L> {
    /// With the tree's momentum in the middle of the inertial part.
    locked: Spatial<L>,
    /// What it moves more with the booked momentum.
    shift: Spatial<L>,
    /// With half of what inertial forces add.
    half: Spatial<L>,
    /// Energy of the first, and with the booked momentum.
    energies: [L; 2],
    /// The booked momentum.
    momentum: Spatial<L>,
}

/// Books what has worked on the trees since the inertial part: half of the forces, and constraints. `qvel` is the next velocity.
pub fn book<L: Lane>(
    model: Instance<'_, L>,
    (position, inertia): (&Position<L>, &Inertia<L>),
    qvel: &[L],
    kick: &mut Kick<L>,
) {
    let Kick { guard: Guard { velocity, books, .. }, scratch: Scratch { change, product, .. }, .. } = kick;
    for (i, change) in change.iter_mut().enumerate() {
        *change = qvel[i] - velocity[i];
    }
    ldl::multiply(&model.rows, &model.tree_pattern, &inertia.m, change, product);
    for (books, tree) in books.iter_mut().zip(model.guarded()) {
        let mut work = L::zero();
        for i in tree.dofs.clone() {
            work = L::of(0.5).mul_add(change[i], velocity[i]).mul_add(product[i], work);
        }
        books[1] = work;
        if tree.floats(&model) {
            let root = Root::new(&model, position, inertia, &tree);
            books[9..].copy_from_slice(&root.wrench(&root.of(product)));
        }
    }
}

/// Replaces a state's books by the next ones in the lanes of `good`.
pub fn keep<L: Lane>(model: Instance<'_, L>, guard: &Guard<L>, good: L::Mask, state: &mut State<L>) {
    let zero = model.zero();
    let usable = |books: &[L; 15]| books.iter().fold(L::Mask::splat(true), |good, x| good & x.within(L::Real::MAX));
    for (old, new) in state.tree_guard.iter_mut().zip(&guard.books) {
        // Books that overflow, as those of what is about to be lost, start anew.
        let usable = usable(new);
        for (old, new) in old.iter_mut().zip(new) {
            *old = L::select(good, L::select(usable, *new, L::zero()) + zero, *old);
        }
    }
}
