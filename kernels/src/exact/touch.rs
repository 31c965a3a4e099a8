//! Contacts whose one side stands still: what they do to their links goes down the tree as composite inertias do, so that the cost hardly depends on
//! how many there are.
//!
//! A step s of a dof moves the pose of what it carries, and turns the motions of that as far as they come from the dofs from there on: they change by
//! s × (v - v₋), v the link's and v₋ that before the joint. So a contact's wrench gains Q s + V (s × v₋) + A (s × a₋) with the sums A of stiffness, V of
//! damping by stiffness, negative both, and Q that of the pose with s × v in it. Seen from outside the wrench f turns as well, by s ×* f. With speeds of
//! dofs wrenches gain -V s, with accelerations -A s.

use super::held::Held;
use super::rigid::{Rigid, ancestors, group};
use crate::collision::Found;
use crate::lane::Lane;
use crate::math::spatial::{Spatial, Sym6, cross_force, cross_motion, dot6};
use crate::math::tree::times_axis;
use crate::math::vec3::{add, build, neg, scale_add, sub, zero};
use crate::model::{DofKind, Model, NONE, Sides};
use crate::position::Position;

/// What contacts do to a link and all that it carries, about the tree's origin.
#[derive(Clone, Copy, Debug)]
struct Touch<L> {
    /// By six steps of the pose, what wrenches gain.
    pose: [Spatial<L>; 6],
    /// By six motions, what wrenches lose with velocities.
    speed: [Spatial<L>; 6],
    /// What they lose with accelerations.
    pull: Sym6<L>,
    /// The wrench.
    force: Spatial<L>,
}

impl<L: Lane> Touch<L> {
    fn none() -> Self {
        Touch { pose: [zero(); 6], speed: [zero(); 6], pull: zero(), force: zero() }
    }

    fn add(&mut self, other: &Self) {
        for k in 0..6 {
            self.pose[k] = add(&self.pose[k], &other.pose[k]);
            self.speed[k] = add(&self.speed[k], &other.speed[k]);
        }
        self.pull = add(&self.pull, &other.pull);
        self.force = add(&self.force, &other.force);
    }
}

/// Where derivatives of M a + c - Jᵀf are added up.
#[derive(Debug)]
pub struct Slopes<'a, L> {
    /// By positions, velocities, and more, rows first.
    pub by_state: &'a mut [L],
    /// Columns of that.
    pub width: usize,
    /// By accelerations: stored as the inertia matrix.
    pub hessian: &'a mut [L],
}

/// The touched links.
#[derive(Clone, Debug)]
pub(super) struct Touches<L> {
    /// By link; of a model without such contacts nothing.
    of: Vec<Touch<L>>,
    touched: Vec<bool>,
    /// By dof that carries a touched link, the part of the acceleration before its joint that comes from the dofs' accelerations, times its axis.
    curl: Vec<Spatial<L>>,
}

/// A matrix by its columns times a vector.
#[inline(always)]
fn times<L: Lane>(columns: &[Spatial<L>; 6], x: &Spatial<L>) -> Spatial<L> {
    let mut sum = zero();
    for (column, x) in columns.iter().zip(x) {
        sum = scale_add(*x, column, &sum);
    }
    sum
}

/// The transposed matrix times a vector.
#[inline(always)]
fn times_t<L: Lane>(columns: &[Spatial<L>; 6], x: &Spatial<L>) -> Spatial<L> {
    build(|k| dot6(&columns[k], x))
}

impl<L: Lane> Touches<L> {
    pub fn new(model: &Model<L::Real>) -> Self {
        let any = model.pairs.iter().any(|pair| pair.sides == Sides::One && !pair.rigid());
        let count = if any { model.sizes.nlink } else { 0 };
        Touches { of: vec![Touch::none(); count], touched: vec![false; count], curl: vec![zero(); model.sizes.nv] }
    }

    /// Adds a contact of a link that is its side number `side`; `steps` are what six steps of the link change of it.
    pub fn add(&mut self, (held, side): (&Held<L>, usize), steps: &[Found<L>; 6], rigid: &Rigid<L>) {
        let link = held.links[side] as usize;
        let (touch, motions) = (&mut self.of[link], [&rigid.velocity[link], &rigid.pull[link]]);
        self.touched[link] = true;
        for k in 0..6 {
            let axis = build(|i| if i == k { L::one() } else { L::zero() });
            let turned = motions.map(|motion| held.components(side, &cross_motion(&axis, motion)));
            touch.pose[k] = add(&touch.pose[k], &held.changed(&steps[k], turned)[side]);
            let lost = held.wrench(side, &held.sped(&held.components(side, &axis)));
            touch.speed[k] = sub(&touch.speed[k], &lost);
        }
        held.stiffen(side, &mut touch.pull);
        touch.force = add(&touch.force, &held.own_wrench(side));
    }

    /// Adds what all contribute, and forgets them.
    pub fn spread(
        &mut self,
        model: &Model<L::Real>,
        (places, rigid): (&Position<L>, &Rigid<L>),
        slopes: &mut Slopes<'_, L>,
    ) {
        let Touches { of, touched, curl } = self;
        for l in (0..of.len()).rev() {
            let parent = model.links[l].parent;
            if touched[l] && parent != NONE {
                let (parents, own) = of.split_at_mut(l);
                parents[parent as usize].add(&own[0]);
                touched[parent as usize] = true;
            }
        }
        let carries =
            |i: usize, touched: &[bool]| touched.get(model.dofs[i].link as usize).is_some_and(|touched| *touched);
        for i in (0..model.sizes.nv).filter(|i| carries(*i, touched)) {
            curl[i] = cross_motion(&rigid.pull_before[i], &places.cdof[i]);
        }
        for i in (0..model.sizes.nv).filter(|i| carries(*i, touched)) {
            spread_row(model, i, &of[model.dofs[i].link as usize], (places, rigid, curl), slopes);
        }
        for (touch, _) in of.iter_mut().zip(&*touched).filter(|(_, touched)| **touched) {
            *touch = Touch::none();
        }
        touched.fill(false);
    }
}

/// What a dof feels of those that carry it and of those that turn with it, and what its own step does to those that carry it.
fn spread_row<L: Lane>(
    model: &Model<L::Real>,
    i: usize,
    touch: &Touch<L>,
    (places, rigid, curl): (&Position<L>, &Rigid<L>, &[Spatial<L>]),
    slopes: &mut Slopes<'_, L>,
) {
    let (nv, width, axis, own) = (model.sizes.nv, slopes.width, &places.cdof[i], group(model, i));
    let felt = neg(&add(&times_t(&touch.pose, axis), &cross_force(axis, &touch.force)));
    let by_speed = times_t(&touch.speed, axis);
    let by_pull = times_axis(&touch.pull, model.dofs[i].kind, axis);
    let held = add(&times(&touch.speed, &rigid.rate[i]), &times_axis(&touch.pull, DofKind::Hinge, &curl[i]));
    let moved = sub(&held, &times(&touch.pose, axis));
    let sped = times(&touch.speed, axis);
    let mut each = |j: usize| {
        let s = &places.cdof[j];
        let turned = dot6(&by_speed, &rigid.rate[j]) + dot6(&by_pull, &curl[j]);
        slopes.by_state[width * i + j] += dot6(&felt, s) + turned;
        slopes.by_state[width * i + nv + j] += dot6(&by_speed, s);
        if j <= i {
            slopes.hessian[model.rows.at(i, j)] += dot6(&by_pull, s);
        }
        if !own.contains(&j) {
            slopes.by_state[width * j + i] += dot6(&moved, s);
            slopes.by_state[width * j + nv + i] += dot6(&sped, s);
        }
    };
    own.clone().for_each(&mut each);
    ancestors(model, own.start).for_each(each);
}
