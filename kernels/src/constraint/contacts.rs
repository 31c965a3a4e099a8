//! Rows of contacts.

use super::{Cone, Constraint, ContactRow, dof_rows};
use crate::collision::{Collision, Contact, origin, reference};
use crate::lane::{Lane, LaneQuery};
use crate::math::spatial::{Spatial, dot6};
use crate::math::vec3::{Vec3, add, cross, neg, row, splat, sub};
use crate::model::{Model, NONE, Pair};
use crate::options;
use crate::position::Position;
use crate::velocity::Velocity;

/// Lists the contacts that act in some world: closer than their margin.
pub fn contact_rows<L: LaneQuery>(
    model: &Model<L::Real>,
    position: &Position<L>,
    velocity: &Velocity<L>,
    collision: &Collision<L>,
    qvel: &[L],
    constraint: &mut Constraint<L>,
) {
    constraint.contact_rows.clear();
    constraint.strengths.clear();
    constraint.reference.clear();
    constraint.motion.clear();
    constraint.jacobian.clear();
    constraint.cross = false;
    let (mut edges, mut ellipses) = (0, 0);
    for (c, (slot, contact)) in collision.slots.iter().zip(&collision.contacts).enumerate() {
        let pair = &model.pairs[slot.pair as usize];
        let acts = contact.dist.lt(L::splat(pair.margin));
        if !L::any(acts) {
            continue;
        }
        let (cone, component) = (cone(model, pair), constraint.reference.len());
        let dim = pair.condim as usize;
        let one_sided = pair.link1 == NONE || pair.link2 == NONE;
        let jacobian = constraint.jacobian.len() as u32;
        let speeds = if one_sided {
            still_side(pair, contact, velocity, &mut constraint.motion)
        } else {
            constraint.cross |= pair.cross;
            // Keeps the component's index the same in `motion` and `reference`.
            constraint.motion.extend_from_slice(&[[L::zero(); 6]; 6][..dim]);
            two_sides(model, position, pair, contact, qvel, &mut constraint.jacobian)
        };
        let (d, references) = regularise(model, pair, contact, &speeds);
        constraint.reference.extend_from_slice(&references[..dim]);
        let edge = if cone == Cone::Ellipse { &mut ellipses } else { &mut edges };
        let row = ContactRow {
            contact: c as u32,
            pair: slot.pair,
            dim: dim as u32,
            component: component as u32,
            link: if !one_sided { NONE } else { reference(pair) },
            jacobian,
            edge: *edge,
            strength: constraint.strengths.len() as u32,
            cone,
        };
        *edge += row.edges() as u32;
        constraint.contact_rows.push(row);
        let mu = L::splat(pair.friction[0]) * L::of((1.0 / model.options.impratio).sqrt());
        let [f1, f2, f3, f4, f5] = splat(&pair.friction);
        constraint.strengths.push([L::select(acts, d, L::zero()), mu, f1, f2, f3, f4, f5]);
    }
}

/// The components' motion rows at a point `at` relative to a tree's origin: (at × n; n) for a translation along `n`,
/// (n; 0) for a rotation about it.
#[inline(always)]
pub fn motion_row<L: Lane>(contact: &Contact<L>, at: &Vec3<L>, component: usize) -> Spatial<L> {
    let z = L::zero();
    let n = row(&contact.frame, component % 3);
    if component < 3 {
        let torque = cross(at, &n);
        [torque[0], torque[1], torque[2], n[0], n[1], n[2]]
    } else {
        [n[0], n[1], n[2], z, z, z]
    }
}

/// Rows of a contact whose one side stands still; returns the components' velocities.
#[inline(always)]
fn still_side<L: Lane>(
    pair: &Pair<L::Real>,
    contact: &Contact<L>,
    velocity: &Velocity<L>,
    motion: &mut Vec<[L; 6]>,
) -> [L; 6] {
    let link = reference(pair) as usize;
    let mut speeds = [L::zero(); 6];
    for (i, speed) in speeds.iter_mut().enumerate().take(pair.condim as usize) {
        let w = motion_row(contact, &contact.pos, i);
        // The relative motion is that of the second body; it is minus the first's where the second stands still.
        let w = if pair.link2 == NONE { neg(&w) } else { w };
        *speed = dot6(&w, &velocity.cvel[link]);
        motion.push(w);
    }
    speeds
}

/// Stores the Jacobian of a contact between two links; returns the components' velocities.
#[inline(always)]
fn two_sides<L: Lane>(
    model: &Model<L::Real>,
    position: &Position<L>,
    pair: &Pair<L::Real>,
    contact: &Contact<L>,
    qvel: &[L],
    jacobian: &mut Vec<L>,
) -> [L; 6] {
    let dim = pair.condim as usize;
    let shift = sub(&origin(model, position, pair.link2), &origin(model, position, pair.link1));
    let same_tree = model.links[pair.link1 as usize].tree == model.links[pair.link2 as usize].tree;
    let at1 = if same_tree { contact.pos } else { add(&contact.pos, &shift) };
    let mut first = [[L::zero(); 6]; 6];
    let mut second = first;
    for i in 0..dim {
        second[i] = motion_row(contact, &contact.pos, i);
        first[i] = if same_tree { neg(&second[i]) } else { neg(&motion_row(contact, &at1, i)) };
    }
    let mut speeds = [L::zero(); 6];
    for entry in &model.pair_dofs[pair.dofs.range()] {
        let dof = entry.dof as usize;
        let rows = if entry.second { &second } else { &first };
        for i in 0..dim {
            let j = dot6(&rows[i], &position.cdof[dof]);
            speeds[i] = j.mul_add(qvel[dof], speeds[i]);
            jacobian.push(j);
        }
    }
    speeds
}

/// The cone of a pair's contacts.
pub fn cone<T>(model: &Model<T>, pair: &Pair<T>) -> Cone {
    match model.options.cone {
        _ if pair.condim == 1 => Cone::Ray,
        options::Cone::Pyramidal => Cone::Pyramid,
        options::Cone::Elliptic => Cone::Ellipse,
    }
}

/// D of the contact's first row, and minus the reference acceleration of each component. A pyramid's rows share
/// R = 2 μ₁² (1 + μ₁²) Â (1 - d)/d / impratio; friction rows of an elliptic cone have damping of their own.
#[inline(always)]
fn regularise<L: Lane>(
    model: &Model<L::Real>,
    pair: &Pair<L::Real>,
    contact: &Contact<L>,
    speeds: &[L; 6],
) -> (L, [L; 6]) {
    let weight = L::splat(pair.invweight);
    let cone = cone(model, pair);
    let (diagonal, factor) = if cone == Cone::Pyramid {
        let mu2 = L::splat(pair.friction[0]) * L::splat(pair.friction[0]);
        (mu2.mul_add(weight, weight), (mu2 + mu2) * L::of(1.0 / model.options.impratio))
    } else {
        (weight, L::one())
    };
    let pos = contact.dist - L::splat(pair.margin);
    let (d, normal) = dof_rows::row(&pair.impedance, pos, speeds[0], diagonal, factor);
    let b = if cone == Cone::Ellipse { L::splat(pair.friction_b) } else { L::splat(pair.impedance.b) };
    let mut references = speeds.map(|v| b * v);
    references[0] = normal;
    (d, references)
}
