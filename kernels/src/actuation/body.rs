//! Actuators that act on a body through its contacts: they pull what touches the body towards it. As contacts are found after the stages
//! that do without, so are these.

use super::{Actuation, clamp, force, gather};
use crate::collision::{Collision, Contact, reference};
use crate::lane::{Lane, Real};
use crate::math::spatial::join;
use crate::math::tree;
use crate::math::vec3::{add, cross, neg, row, sub};
use crate::model::{Instance, Model, NONE, Transmission};
use crate::passive::Passive;
use crate::position::Position;

/// Moments, velocities and forces of actuators on bodies, and then the actuators' generalised forces.
pub fn bodies<L: Lane>(
    model: Instance<'_, L>,
    qvel: &[L],
    (position, passive, collision): (&Position<L>, &Passive<L>, &Collision<L>),
    actuation: &mut Actuation<L>,
) {
    for (a, actuator) in model.actuators.iter().enumerate() {
        if actuator.transmission != Transmission::Body {
            continue;
        }
        let moment = &mut actuation.moment[actuator.moments.range()];
        contacts(&model, actuator.body, position, collision, moment);
        let velocity = moment.iter().zip(qvel).fold(L::zero(), |sum, (moment, speed)| moment.mul_add(*speed, sum));
        actuation.velocity[a] = velocity;
        if !actuator.disabled && model.features.actuation {
            let force = force(model, a, actuation.input[a], L::zero(), velocity);
            actuation.force[a] = if actuator.force_limited { clamp(force, &model.force_range(a)) } else { force };
        }
    }
    if model.features.actuation {
        gather(model, passive, actuation);
    }
}

/// Moments on all dofs: minus the mean of the normals of a body's contacts, also of those that do not push yet.
fn contacts<L: Lane>(
    model: &Model<L::Real>,
    body: u32,
    position: &Position<L>,
    collision: &Collision<L>,
    moment: &mut [L],
) {
    moment.fill(L::zero());
    let mut count = L::zero();
    for slot in &collision.slots {
        let pair = &model.pairs[slot.pair as usize];
        if [pair.geom1, pair.geom2].iter().all(|geom| model.geoms[*geom as usize].body != body) {
            continue;
        }
        let contact = Contact(&collision.found[slot.place as usize]);
        let exists = contact.dist().lt(L::of(L::Real::MAXVAL));
        let normal = row(contact.frame(), 0);
        let origin = position.origin_of(model, reference(pair));
        count += L::select(exists, L::one(), L::zero());
        for (link, way) in [(pair.link1, normal), (pair.link2, neg(&normal))] {
            if link != NONE {
                let at = add(&contact.pos(), &sub(&origin, &position.origin_of(model, link)));
                let wrench = join(&cross(&at, &way), &way).map(|x| L::select(exists, x, L::zero()));
                tree::push(model, &position.cdof, link as usize, &wrench, moment);
            }
        }
    }
    let share = L::one() / count.max(L::one());
    moment.iter_mut().for_each(|moment| *moment *= share);
}
