//! What the parent of a body exerts on it: what the body and all that it carries need for their accelerations, less what acts on
//! them from outside and through contacts, connects and welds.

use super::frame::{Frame, point_acceleration};
use super::subtree::Body;
use super::{Seen, ray, rows, tendons};
use crate::lane::{Lane, Mask};
use crate::math::spatial::{lin, rot};
use crate::math::vec3::{Vec3, add, cross, mul_t, neg, row, scale, splat, sub, zero};
use crate::model::{Instance, NONE, Sensor};
use crate::state::Applied;

/// Torque and force at a point.
struct Load<L> {
    /// Origin of a tree, from which places are told.
    base: Vec3<L>,
    /// The point, from there.
    at: Vec3<L>,
    torque: Vec3<L>,
    force: Vec3<L>,
}

impl<L: Lane> Load<L> {
    /// Adds a force that acts at a place, and a torque.
    #[inline(always)]
    fn add(&mut self, force: &Vec3<L>, torque: &Vec3<L>, place: &Vec3<L>) {
        let arm = sub(place, &self.at);
        self.force = add(&self.force, force);
        self.torque = add(&self.torque, &add(torque, &cross(&arm, force)));
    }
}

/// Torque and force on the body of a sensor's site, at the site, in its axes.
pub(super) fn load<L: Lane>(
    model: Instance<'_, L>,
    sensor: &Sensor<L::Real>,
    applied: Option<&Applied<L>>,
    seen: &Seen<'_, L>,
) -> [Vec3<L>; 2] {
    let site = Frame::new(&model, seen.position, sensor.mount);
    let mut load = Load { base: site.origin, at: site.pos, torque: zero(), force: zero() };
    for b in sensor.bodies.range().filter(|b| *b > 0) {
        let body = Body::new(model, seen.position, b);
        let [turn, _] = body.velocity(seen);
        let [turning, rising] = point_acceleration(model, seen, body.link, &body.com);
        let torque = add(&body.spin(&turning), &cross(&turn, &body.spin(&turn)));
        let place = body.from(&load.base);
        load.add(&scale(body.mass, &rising), &torque, &place);
        if let Some(applied) = applied {
            let [fx, fy, fz, tx, ty, tz] = applied.xfrc_applied[b];
            load.add(&neg(&[fx, fy, fz]), &neg(&[tx, ty, tz]), &place);
        }
    }
    // Nothing is asked of the world.
    let carries = |body: u32| body > 0 && sensor.bodies.range().contains(&(body as usize));
    rows::contacts(model, seen, |contact| {
        let place = add(&contact.pos, &sub(&contact.origin, &load.base));
        let [first, second] = contact.bodies.map(carries);
        if first != second {
            let sign = if first { L::one() } else { -L::one() };
            let [force, torque] = contact.wrench.map(|part| scale(sign, &mul_t(contact.frame, &part)));
            load.add(&force, &torque, &place);
        }
    });
    rows::holds(model, seen, |held| {
        let [first, second] = held.bodies.map(carries);
        if first != second {
            let (side, sign) = if first { (0, -L::one()) } else { (1, L::one()) };
            let place = add(&held.places[side].pos, &sub(&held.places[side].origin, &load.base));
            let [force, torque] = [&held.force, &held.torque].map(|part| scale(sign, part));
            load.add(&force, &torque, &place);
        }
    });
    tendons::pushes(model, seen, seen.plastic, |push| {
        if carries(push.body) {
            let origin = if push.link == NONE { zero() } else { seen.position.origin_of(&model, push.link) };
            load.add(&neg(&lin(&push.wrench)), &neg(&rot(&push.wrench)), &sub(&origin, &load.base));
        }
    });
    [mul_t(&site.rot, &load.torque), mul_t(&site.rot, &load.force)]
}

/// Sum of the normal forces of the contacts of the body of a site that push through the site.
pub(super) fn touch<L: Lane>(model: Instance<'_, L>, sensor: &Sensor<L::Real>, seen: &Seen<'_, L>) -> L {
    let site = Frame::new(&model, seen.position, sensor.mount);
    let mut sum = L::zero();
    rows::contacts(model, seen, |contact| {
        if !contact.bodies.contains(&sensor.id) {
            return;
        }
        let normal = row(contact.frame, 0);
        let away = if contact.bodies[1] == sensor.id { neg(&normal) } else { normal };
        let at = add(&sub(&contact.pos, &site.pos), &sub(&contact.origin, &site.origin));
        let size = splat(&sensor.size);
        let force = contact.wrench[0][0];
        let counts = contact.acts & force.gt(L::zero()) & ray::meets(sensor.shape, &size, &site, &at, &away);
        sum += L::select(counts, force, L::zero());
    });
    sum
}

/// Of a limit, how far it is exceeded, how fast, or its force; 0 in worlds where it does not act.
pub(super) fn limit<L: Lane>(sensor: &Sensor<L::Real>, qvel: &[L], seen: &Seen<'_, L>) -> L {
    let (mut found, mut value) = (L::Mask::splat(false), L::zero());
    rows::limits(sensor.id, qvel, seen, |acts, numbers| {
        let number = sensor.kind.of_limit().map_or(L::zero(), |number| numbers[number]);
        value = L::select(acts & !found, number, value);
        found = found | acts;
    });
    value
}
