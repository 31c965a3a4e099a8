//! Contact sensors: the contacts between two sides, sorted and cut to a number of places, or their sum.

use super::Seen;
use super::frame::{Frame, point_velocity};
use super::ray::inside;
use super::rows::{Touching, contacts};
use crate::lane::{Lane, Mask, Real};
use crate::math::vec3::{Vec3, add, cross, dot, mul, mul_t, row, scale, scale_add, select, splat, sub, zero};
use crate::model::{ContactField as Field, Instance, NONE, Reduce, Sensor, Side};

/// Most numbers of a contact.
const MOST: usize = 23;

/// A contact as a sensor returns it, and by what it is sorted.
struct Entry<L> {
    key: L,
    numbers: [L; MOST],
}

/// Of a contact: whether it matches, and whether its first geom is on the second side.
fn matching(sides: &[Side; 2], geoms: [u32; 2], bodies: [u32; 2]) -> Option<bool> {
    let fits = |first: usize, second: usize| {
        sides[0].has(geoms[first], bodies[first]) && sides[1].has(geoms[second], bodies[second])
    };
    if fits(0, 1) { Some(false) } else { fits(1, 0).then_some(true) }
}

/// Calls `f` with the contacts that match, where they do, and -1 where a contact is seen from its second geom, else 1.
fn matches<'a, L: Lane>(
    model: Instance<'a, L>,
    sensor: &Sensor<L::Real>,
    seen: &Seen<'a, L>,
    mut f: impl FnMut(&Touching<'a, L>, L::Mask, L),
) {
    let site = (sensor.mount != NONE).then(|| Frame::new(&model, seen.position, sensor.mount));
    contacts(model, seen, |contact| {
        let Some(turned) = matching(&sensor.sides, contact.geoms, contact.bodies) else { return };
        let mut there = contact.exists;
        if let Some(site) = &site {
            let at = add(&sub(&contact.pos, &site.pos), &sub(&contact.origin, &site.origin));
            there = there & inside(sensor.shape, &splat(&sensor.size), &mul_t(&site.rot, &at));
        }
        f(&contact, there, if turned { -L::one() } else { L::one() });
    });
}

/// Finds what a sensor returns, place by place; `keys` is room for as many numbers as it has places.
pub(super) fn measure<L: Lane>(
    model: Instance<'_, L>,
    sensor: &Sensor<L::Real>,
    seen: &Seen<'_, L>,
    keys: &mut [L],
    data: &mut [L],
) {
    data.fill(L::zero());
    if sensor.reduce == Reduce::NetForce {
        return net(model, sensor, seen, data);
    }
    let width: usize = Field::of(sensor.fields).map(Field::width).sum();
    let (free, mut count, mut number) = (L::of(L::Real::MAX), L::zero(), 0.0);
    let keys = &mut keys[..data.len() / width];
    keys.fill(free);
    matches(model, sensor, seen, |contact, there, sign| {
        let [force, _] = contact.wrench;
        let key = match sensor.reduce {
            Reduce::MinDist => contact.dist,
            Reduce::MaxForce => -dot(&force, &force),
            Reduce::None | Reduce::NetForce => L::of(number),
        };
        number += 1.0;
        count += L::select(there, L::one(), L::zero());
        let mut entry = Entry { key: L::select(there, key, free), numbers: [L::zero(); MOST] };
        numbers(model, sensor, seen, contact, sign, &mut entry.numbers);
        insert(&mut entry, width, keys, data);
    });
    if sensor.fields & Field::Found.bit() != 0 {
        for (key, place) in keys.iter().zip(data.chunks_exact_mut(width)) {
            place[0] = L::select(key.lt(free), count, L::zero());
        }
    }
}

/// Puts a contact before the first place with a larger key; those from there on move by one.
fn insert<L: Lane>(entry: &mut Entry<L>, width: usize, keys: &mut [L], data: &mut [L]) {
    let mut moving = L::Mask::splat(false);
    for (key, place) in keys.iter_mut().zip(data.chunks_exact_mut(width)) {
        moving = moving | entry.key.lt(*key);
        let swap = |a: &mut L, b: &mut L| (*a, *b) = (L::select(moving, *b, *a), L::select(moving, *a, *b));
        swap(&mut entry.key, key);
        entry.numbers.iter_mut().zip(place).for_each(|(a, b)| swap(a, b));
    }
}

/// The numbers of a contact.
fn numbers<L: Lane>(
    model: Instance<'_, L>,
    sensor: &Sensor<L::Real>,
    seen: &Seen<'_, L>,
    contact: &Touching<'_, L>,
    sign: L,
    out: &mut [L; MOST],
) {
    let ([force, torque], frame) = (contact.wrench, contact.frame);
    // Seen from the other side, the normal and the first tangent are turned, the second tangent is not.
    let turned = |[x, y, z]: Vec3<L>| [x, y, sign * z];
    let mut at = 0;
    for field in Field::of(sensor.fields) {
        let three = match field {
            Field::Found => zero(),
            Field::Dist => [contact.dist, L::zero(), L::zero()],
            Field::Force => turned(force),
            Field::Torque => turned(torque),
            Field::Pos => add(&contact.origin, &contact.pos),
            Field::Normal => scale(sign, &row(frame, 0)),
            Field::Tangent => scale(sign, &row(frame, 1)),
            Field::LinVel => turned(mul(frame, &relative(model, seen, contact)[1])),
            Field::AngVel => turned(mul(frame, &relative(model, seen, contact)[0])),
        };
        out[at..at + field.width()].copy_from_slice(&three[..field.width()]);
        at += field.width();
    }
}

/// Angular and linear velocity of the second geom at a contact, less those of the first.
fn relative<L: Lane>(model: Instance<'_, L>, seen: &Seen<'_, L>, contact: &Touching<'_, L>) -> [Vec3<L>; 2] {
    let [[turn1, shift1], [turn2, shift2]] = contact.links.map(|link| {
        if link == NONE {
            return [zero(); 2];
        }
        let at = add(&contact.pos, &sub(&contact.origin, &seen.position.origin_of(&model, link)));
        point_velocity(&seen.velocity.cvel[link as usize], &at)
    });
    [sub(&turn2, &turn1), sub(&shift2, &shift1)]
}

/// The sum of forces, where they act on average, each counted by its size; torque about that place.
fn net<L: Lane>(model: Instance<'_, L>, sensor: &Sensor<L::Real>, seen: &Seen<'_, L>, data: &mut [L]) {
    let (mut count, mut weight) = (L::zero(), L::zero());
    let [mut force, mut torque, mut moment]: [Vec3<L>; 3] = [zero(); 3];
    // Places are told from that of the first contact, which keeps their digits.
    let mut base: Option<Vec3<L>> = None;
    matches(model, sensor, seen, |contact, there, sign| {
        let place = add(&contact.origin, &contact.pos);
        let base = base.get_or_insert(place);
        let at = sub(&place, base);
        let [push, turn] =
            contact.wrench.map(|part| select(there, &scale(sign, &mul_t(contact.frame, &part)), &zero()));
        let size = dot(&push, &push).sqrt();
        count += L::select(there, L::one(), L::zero());
        weight += size;
        force = add(&force, &push);
        torque = add(&torque, &add(&turn, &cross(&at, &push)));
        moment = scale_add(size, &at, &moment);
    });
    let (some, pushed) = (count.gt(L::zero()), weight.gt(L::of(L::Real::MINVAL)));
    let mean = scale(L::one() / L::select(pushed, weight, L::one()), &moment);
    let torque = sub(&torque, &cross(&mean, &force));
    let place = select(pushed, &add(&mean, &base.unwrap_or(zero())), &zero());
    let unit = |axis: usize| {
        let mut unit = zero::<L, 3>();
        unit[axis] = L::select(some, L::one(), L::zero());
        unit
    };
    let mut at = 0;
    for field in Field::of(sensor.fields) {
        let three = match field {
            Field::Found => [count, L::zero(), L::zero()],
            Field::Force => force,
            Field::Torque => torque,
            Field::Pos => place,
            Field::Normal => unit(0),
            Field::Tangent => unit(1),
            Field::Dist | Field::LinVel | Field::AngVel => zero(),
        };
        data[at..at + field.width()].copy_from_slice(&three[..field.width()]);
        at += field.width();
    }
}
