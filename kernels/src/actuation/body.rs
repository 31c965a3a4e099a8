//! Actuators that act on a body through its contacts: they pull what touches the body towards it. As contacts are found after the stages
//! that do without, so are these.

use super::{Actuation, clamp, force, gather};
use crate::collision::{Collision, Contact, reference};
use crate::lane::{Lane, Real};
use crate::math::spatial::join;
use crate::math::tree;
use crate::math::vec3::{Vec3, add, cross, neg, row, sub};
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
            actuation.force[a] = if actuator.force_limited { clamp(force, &actuator.force_range) } else { force };
        }
    }
    if model.features.actuation {
        gather(&model, passive, actuation);
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
        let (one, normal) = (L::select(exists, L::one(), L::zero()), row(contact.frame(), 0));
        let origin = position.origin_of(model, reference(pair));
        count += one;
        for (link, way) in [(pair.link1, normal), (pair.link2, neg(&normal))] {
            if link != NONE {
                let at = add(&contact.pos(), &sub(&origin, &position.origin_of(model, link)));
                push(model, position, link, (&at, &way), one, moment);
            }
        }
    }
    let share = L::one() / count.max(L::one());
    moment.iter_mut().for_each(|moment| *moment *= share);
}

/// Adds what a unit of force at a point of a link does, where `one` is 1.
fn push<L: Lane>(
    model: &Model<L::Real>,
    position: &Position<L>,
    link: u32,
    (at, way): (&Vec3<L>, &Vec3<L>),
    one: L,
    moment: &mut [L],
) {
    let wrench = join(&cross(at, way), way);
    let mut dof = model.links[link as usize].dofs.range().end as u32 - 1;
    while dof != NONE {
        let own = tree::project(model, &position.cdof, dof as usize, &wrench);
        moment[dof as usize] += L::select(one.gt(L::zero()), own, L::zero());
        dof = model.dofs[dof as usize].parent;
    }
}
