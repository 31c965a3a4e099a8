//! Surfaces that move while their geoms stay: belts. What lies on one is pulled along, which is a speed less in the rows of friction and
//! spin; along the normal, and in rolling, nothing moves.

use super::{Cone, Constraint};
use crate::collision::{Collision, Contact, body, reference};
use crate::lane::Lane;
use crate::math::vec3::{Vec3, add, cross_add, dot, mul, row, scale, splat, sub, zero};
use crate::model::Instance;
use crate::position::Position;

/// Adds the speeds of surfaces to the rows of contacts that are listed.
pub fn drive<L: Lane>(
    model: Instance<'_, L>,
    position: &Position<L>,
    collision: &Collision<L>,
    constraint: &mut Constraint<L>,
) {
    for i in 0..constraint.contact_rows.len() {
        let row_of = constraint.contact_rows[i];
        let pair = &model.pairs[row_of.pair as usize];
        let contact = Contact(&collision.found[row_of.place as usize]);
        let at = add(&position.origin_of(&model, reference(pair)), &contact.pos());
        let sides = [(pair.geom1, -L::one()), (pair.geom2, L::one())];
        let (mut slide, mut spin) = (zero(), zero());
        let mut driven = false;
        for (geom, sign) in sides {
            for belt in model.belts.iter().filter(|belt| belt.geom == geom) {
                let [shift, turn] = surface(model, position, geom, &belt.velocity, &at);
                slide = add(&slide, &scale(sign, &shift));
                spin = add(&spin, &scale(sign, &turn));
                driven = true;
            }
        }
        if driven {
            let b = if row_of.cone == Cone::Ellipse { L::splat(pair.friction_b) } else { L::splat(pair.impedance.b) };
            let speeds = [
                dot(&row(contact.frame(), 1), &slide),
                dot(&row(contact.frame(), 2), &slide),
                dot(&row(contact.frame(), 0), &spin),
            ];
            for (component, speed) in row_of.components().skip(1).zip(speeds) {
                constraint.reference[component] = b.mul_add(speed, constraint.reference[component]);
            }
        }
    }
}

/// Velocity and angular velocity of a geom's surface at a point of the world, against the geom.
fn surface<L: Lane>(
    model: Instance<'_, L>,
    position: &Position<L>,
    geom: u32,
    velocity: &[L::Real; 6],
    at: &Vec3<L>,
) -> [Vec3<L>; 2] {
    let own = body(model, position, geom as usize);
    let [x, y, z, a, b, c]: [L; 6] = splat(velocity);
    let turn = mul(&own.rot, &[a, b, c]);
    let origin = position.origin_of(&model, model.geoms[geom as usize].link);
    let arm = sub(at, &add(&origin, &own.pos));
    [cross_add(&turn, &arm, &mul(&own.rot, &[x, y, z])), turn]
}
