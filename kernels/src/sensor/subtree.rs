//! Mass, momentum and angular momentum of a body and all that it carries.

use super::Seen;
use super::frame::point_velocity;
use crate::lane::{Lane, Real};
use crate::math::vec3::{
    Mat3, Vec3, add, cross, mul, mul_add, mul_mat, mul_t, scale, scale_add, select, splat, sub, zero,
};
use crate::model::{Instance, NONE, Span};
use crate::position::Position;

/// A body in the world.
pub(super) struct Body<L> {
    pub link: u32,
    /// Origin of its link's tree; zero for bodies that stand still.
    pub origin: Vec3<L>,
    /// Centre of mass relative to that, world axes.
    pub com: Vec3<L>,
    /// Principal axes: inertial frame to world.
    pub axes: Mat3<L>,
    pub mass: L,
    /// Principal moments of inertia.
    pub inertia: Vec3<L>,
}

impl<L: Lane> Body<L> {
    #[inline(always)]
    pub fn new(model: Instance<'_, L>, position: &Position<L>, body: usize) -> Body<L> {
        let own = &model.bodies[body];
        let (mass, inertia) = (model.body_mass(body), model.body_inertia(body));
        let (com, axes) = (splat(&own.com), splat(&own.rot));
        if own.link == NONE {
            return Body { link: NONE, origin: zero(), com, axes, mass, inertia };
        }
        let l = own.link as usize;
        let rot = &position.rot[l];
        Body {
            link: own.link,
            origin: position.origin[model.links[l].tree as usize],
            com: mul_add(rot, &com, &position.pos[l]),
            axes: mul_mat(rot, &axes),
            mass,
            inertia,
        }
    }

    /// Its centre of mass, from a point of the world.
    #[inline(always)]
    pub fn from(&self, base: &Vec3<L>) -> Vec3<L> {
        add(&self.com, &sub(&self.origin, base))
    }

    /// Its inertia times an angular velocity.
    #[inline(always)]
    pub fn spin(&self, turn: &Vec3<L>) -> Vec3<L> {
        let local = mul_t(&self.axes, turn);
        mul(&self.axes, &[self.inertia[0] * local[0], self.inertia[1] * local[1], self.inertia[2] * local[2]])
    }

    /// Angular velocity, and linear velocity of its centre of mass.
    #[inline(always)]
    pub fn velocity(&self, seen: &Seen<'_, L>) -> [Vec3<L>; 2] {
        if self.link == NONE { [zero(); 2] } else { point_velocity(&seen.velocity.cvel[self.link as usize], &self.com) }
    }
}

/// The first body, in whose tree places are told.
#[inline(always)]
fn first<L: Lane>(model: Instance<'_, L>, position: &Position<L>, bodies: Span) -> Body<L> {
    Body::new(model, position, bodies.start as usize)
}

/// Mass, and its inverse; 0 of bodies without mass.
#[inline(always)]
fn mass<L: Lane>(model: Instance<'_, L>, bodies: Span) -> (L, L) {
    let mut mass = L::zero();
    for b in bodies.range() {
        mass += model.body_mass(b);
    }
    let none = mass.lt(L::of(L::Real::MINVAL));
    (mass, L::select(none, L::zero(), L::one() / L::select(none, L::one(), mass)))
}

/// Centre of mass, from the origin of the first body's tree; that body's own where there is no mass.
#[inline(always)]
fn relative_centre<L: Lane>(model: Instance<'_, L>, position: &Position<L>, bodies: Span) -> Vec3<L> {
    let first = first(model, position, bodies);
    let mut moment = zero();
    for b in bodies.range() {
        let body = Body::new(model, position, b);
        moment = scale_add(body.mass, &body.from(&first.origin), &moment);
    }
    let (_, inverse) = mass(model, bodies);
    let none = inverse.eq(L::zero());
    select(none, &first.com, &scale(inverse, &moment))
}

/// Centre of mass in the world, m.
#[inline(always)]
pub(super) fn centre<L: Lane>(model: Instance<'_, L>, position: &Position<L>, bodies: Span) -> Vec3<L> {
    add(&first(model, position, bodies).origin, &relative_centre(model, position, bodies))
}

/// Velocity of the centre of mass, m/s.
#[inline(always)]
pub(super) fn velocity<L: Lane>(model: Instance<'_, L>, seen: &Seen<'_, L>, bodies: Span) -> Vec3<L> {
    let mut momentum = zero();
    for b in bodies.range() {
        let body = Body::new(model, seen.position, b);
        momentum = scale_add(body.mass, &body.velocity(seen)[1], &momentum);
    }
    scale(mass(model, bodies).1, &momentum)
}

/// Angular momentum about the centre of mass, kg m²/s, world axes.
#[inline(always)]
pub(super) fn momentum<L: Lane>(model: Instance<'_, L>, seen: &Seen<'_, L>, bodies: Span) -> Vec3<L> {
    let position = &seen.position;
    let (base, at) = (first(model, position, bodies).origin, relative_centre(model, position, bodies));
    let mean = velocity(model, seen, bodies);
    let mut sum = zero();
    for b in bodies.range() {
        let body = Body::new(model, position, b);
        let [turn, shift] = body.velocity(seen);
        let relative = scale(body.mass, &sub(&shift, &mean));
        sum = add(&sum, &add(&body.spin(&turn), &cross(&sub(&body.from(&base), &at), &relative)));
    }
    sum
}
