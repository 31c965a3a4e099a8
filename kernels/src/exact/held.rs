//! How a contact holds its links, and how that changes when its geometry or its motion does.
//!
//! A contact's force depends on its distance, and on its components' speeds and accelerations. By distance its derivative follows from the law over
//! dual numbers, by the others it is that of the law alone: forces gain minus the contact's stiffness times what J a - a_ref gains, the reference
//! acceleration its damping times speeds. What components gain when the frame turns and the place moves is linear in these.

use crate::collision::{Contact, Found};
use crate::constraint::{self, Cone, Law};
use crate::lane::{Lane, Tangent};
use crate::math::spatial::{Spatial, Sym6, dot6, join, lin, rot};
use crate::math::vec3::{Mat3, Vec3, add, build, cross, cross_add, dot, dot_add, neg, row, scale_add, sub, zero};
use crate::model::{Instance, Model, NONE, Pair};
use crate::position::Position;
use crate::solver::{cone, contact, hessian};

/// Part of what a row's force depends on, within which it is about to begin or to cease to act, or to slide.
pub(super) const EDGE: f64 = 1e-6;

/// How a contact's components and force are at the nominal state.
pub(super) struct Held<L> {
    pub links: [u32; 2],
    /// Number of components.
    pub dim: usize,
    /// By side, the motion rows.
    pub rows: [[Spatial<L>; 6]; 2],
    frame: Mat3<L>,
    /// The contact relative to the origins of its links' trees.
    at: [Vec3<L>; 2],
    /// Of the second link's velocity less the first's, and of the part of accelerations that comes from the dofs' own: how the contact is shifted,
    /// and turned.
    relative: [[Vec3<L>; 2]; 2],
    force: [L; 6],
    push: Vec3<L>,
    /// What forces gain with the distance.
    by_distance: [L; 6],
    damping: [L; 6],
    /// J a - a_ref.
    y: [L; 6],
    strength: constraint::Strength<L>,
    cone: Cone,
    stiffness: cone::Stiffness<L>,
    /// How many of its rows are about to begin or cease to act, or to slide.
    pub edges: L,
}

impl<L: Lane> Held<L> {
    /// That of a contact of a pair, whose links have the given velocities and parts of accelerations.
    #[inline(always)]
    pub fn new(
        (model, dual): (Instance<'_, L>, Instance<'_, Tangent<L>>),
        position: &Position<L>,
        pair: u32,
        found: &Found<L>,
        motions: &[[Spatial<L>; 2]; 2],
    ) -> Self {
        let (own, number) = (Contact(found), &model.pairs[pair as usize]);
        let (links, dim, cone) =
            ([number.link1, number.link2], number.condim as usize, constraint::cone(&model, number));
        let at = places_of(&model, position, pair, own.pos());
        let relative = motions.map(|motions| relative(links, &at, &motions));
        let [speeds, pulls] = relative.map(|[shift, turn]| {
            build(|i| match i {
                i if i >= dim => L::zero(),
                0..3 => dot(&row(own.frame(), i), &shift),
                _ => dot(&row(own.frame(), i - 3), &turn),
            })
        });
        let mut farther = found.map(Tangent::still);
        farther[0].rate = L::one();
        let regular = constraint::regular(dual, pair as usize, Contact(&farther), &speeds.map(Tangent::still));
        let (y, mut force) = (add(&pulls.map(Tangent::still), &regular.reference), [Tangent::zero(); 6]);
        cone::force(Law { cone, strength: &regular.strength }, &y[..dim], &mut force[..dim]);
        let (strength, reference) = (regular.strength.map(|x| x.value), regular.reference.map(|x| x.value));
        let (law, y) = (Law { cone, strength: &strength }, y.map(|x| x.value));
        let sizes = build(|i| (y[i] - reference[i]).abs() + reference[i].abs());
        Held {
            links,
            dim,
            rows: at.map(|at| motion_rows(own, &at)),
            frame: *own.frame(),
            at,
            relative,
            force: force.map(|x| x.value),
            push: along(own.frame(), &force.map(|x| x.value), 0..dim.min(3)),
            by_distance: force.map(|x| x.rate),
            damping: regular.damping.map(|x| x.value),
            y,
            strength,
            cone,
            stiffness: cone::stiffness(law, &y[..dim]),
            edges: edges(law, &y[..dim], &sizes),
        }
    }

    /// Components of a motion of one of its links.
    #[inline(always)]
    pub fn components(&self, side: usize, motion: &Spatial<L>) -> [L; 6] {
        let rows = &self.rows[side];
        build(|i| if i < self.dim { signed(side, dot6(&rows[i], motion)) } else { L::zero() })
    }

    /// The wrench on one of its links, of forces of its components.
    #[inline(always)]
    pub fn wrench(&self, side: usize, force: &[L; 6]) -> Spatial<L> {
        let mut sum = zero();
        for (force, row) in force.iter().zip(&self.rows[side][..self.dim]) {
            sum = scale_add(signed(side, *force), row, &sum);
        }
        sum
    }

    /// The same of its own forces.
    pub fn own_wrench(&self, side: usize) -> Spatial<L> {
        self.wrench(side, &self.force)
    }

    /// What forces gain with accelerations of the components.
    #[inline(always)]
    pub fn pulled(&self, pulls: &[L; 6]) -> [L; 6] {
        neg(&hessian::times(&self.stiffness, &pulls[..self.dim]))
    }

    /// What they gain with speeds of the components.
    #[inline(always)]
    pub fn sped(&self, speeds: &[L; 6]) -> [L; 6] {
        self.pulled(&build(|i| self.damping[i] * speeds[i]))
    }

    /// Adds minus what wrenches gain with accelerations, where one side stands still.
    pub fn stiffen(&self, side: usize, stiffness: &mut Sym6<L>) {
        let Held { dim, cone, ref strength, .. } = *self;
        contact::stiffen(Law { cone, strength }, &self.rows[side][..dim], &self.y[..dim], stiffness);
    }

    /// What wrenches gain on either link when what the narrow phase found changes at these rates, and components have speeds and accelerations
    /// beyond what follows from that.
    pub fn changed(&self, rates: &Found<L>, [speeds, pulls]: [[L; 6]; 2]) -> [Spatial<L>; 2] {
        let Held { dim, frame, relative, force, .. } = self;
        let (moved, turned) = (Contact(rates).pos(), Contact(rates).frame());
        let gained = |[shift, turn]: &[Vec3<L>; 2], more: &[L; 6]| -> [L; 6] {
            let shifted = cross(turn, &moved);
            build(|i| match i {
                i if i >= *dim => L::zero(),
                0..3 => dot_add(&row(turned, i), shift, dot_add(&row(frame, i), &shifted, more[i])),
                _ => dot_add(&row(turned, i - 3), turn, more[i]),
            })
        };
        let (speeds, pulls) = (gained(&relative[0], &speeds), gained(&relative[1], &pulls));
        let stiff = self.pulled(&build(|i| self.damping[i].mul_add(speeds[i], pulls[i])));
        let gain = build(|i| self.by_distance[i].mul_add(rates[0], stiff[i]));
        let both = |of: std::ops::Range<usize>| add(&along(frame, &gain, of.clone()), &along(turned, force, of));
        let (push, torque) = (both(0..3.min(*dim)), both(3.min(*dim)..*dim));
        let torque = cross_add(&moved, &self.push, &torque);
        let mut wrenches = [zero(); 2];
        for side in (0..2).filter(|side| self.links[*side] != NONE) {
            let wrench = join(&cross_add(&self.at[side], &push, &torque), &push);
            wrenches[side] = if side == 1 { wrench } else { neg(&wrench) };
        }
        wrenches
    }
}

/// The second link's counts as it is, the first's with the other sign.
#[inline(always)]
fn signed<L: Lane>(side: usize, x: L) -> L {
    if side == 1 { x } else { -x }
}

/// The sum of some components' forces along the rows of a frame.
#[inline(always)]
fn along<L: Lane>(frame: &Mat3<L>, force: &[L; 6], of: std::ops::Range<usize>) -> Vec3<L> {
    let mut sum = zero();
    for i in of {
        sum = scale_add(force[i], &row(frame, i % 3), &sum);
    }
    sum
}

/// The motion rows of a contact at a place relative to a tree's origin, of all components that there can be.
#[inline(always)]
fn motion_rows<L: Lane>(contact: Contact<'_, L>, at: &Vec3<L>) -> [Spatial<L>; 6] {
    let mut rows = [zero(); 6];
    for (i, row) in rows.iter_mut().enumerate() {
        *row = constraint::motion_row(contact, at, i);
    }
    rows
}

/// Places of a contact relative to the origins of its links' trees.
#[inline(always)]
fn places_of<L: Lane>(model: &Model<L::Real>, position: &Position<L>, pair: u32, at: [L; 3]) -> [[L; 3]; 2] {
    let Pair { link1, link2, .. } = model.pairs[pair as usize];
    let both = link1 != NONE && link2 != NONE;
    [if both { position.moved(model, &at, link2, link1) } else { at }, at]
}

/// Shift and turn of the second link's motion at a contact less the first's.
#[inline(always)]
fn relative<L: Lane>(links: [u32; 2], at: &[Vec3<L>; 2], motions: &[Spatial<L>; 2]) -> [Vec3<L>; 2] {
    let (mut shift, mut turn) = (zero(), zero());
    for side in (0..2).filter(|side| links[*side] != NONE) {
        let (w, v) = (rot(&motions[side]), cross_add(&rot(&motions[side]), &at[side], &lin(&motions[side])));
        (shift, turn) = if side == 1 { (add(&shift, &v), add(&turn, &w)) } else { (sub(&shift, &v), sub(&turn, &w)) };
    }
    [shift, turn]
}

/// How many rows of a contact are within [`EDGE`] of where they begin or cease to act, or to slide; `sizes` are those of what its components
/// are the sums of.
fn edges<L: Lane>(law: Law<'_, L>, y: &[L], sizes: &[L; 6]) -> L {
    let near = |x: L, size: L| L::select(x.abs().le(L::of(EDGE) * size), L::one(), L::zero());
    let mut count = L::zero();
    match law.cone {
        Cone::Ray => count = near(y[0], sizes[0]),
        Cone::Pyramid => {
            for j in 1..y.len() {
                let (mu, size) = (law.friction(j), law.friction(j).mul_add(sizes[j], sizes[0]));
                count += near(mu.mul_add(y[j], y[0]), size) + near(mu.neg_mul_add(y[j], y[0]), size);
            }
        }
        Cone::Ellipse => {
            let slip = |of: &[L]| {
                (1..y.len())
                    .fold(L::zero(), |sum, j| (law.friction(j) * of[j]).mul_add(law.friction(j) * of[j], sum))
                    .sqrt()
            };
            let (normal, slips) = (law.mu() * y[0], slip(y));
            let size = law.mu().mul_add(sizes[0], slip(sizes));
            count = near(law.mu().neg_mul_add(slips, normal), size) + near(law.mu().mul_add(normal, slips), size);
        }
    }
    L::select(law.d().gt(L::zero()), count, L::zero())
}
