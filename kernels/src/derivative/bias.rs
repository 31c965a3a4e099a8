//! What the bias force gains with velocity, in one pass over the tree each way (Singh, Russo, Wensing, Efficient analytical derivatives of
//! rigid-body dynamics using spatial vector algebra, RA-L 2022).
//!
//! A dof that moves faster by one unit gives the links that it moves the velocity s more, and their acceleration v₋ × s + v₊ × s - v × s,
//! where v₋ and v₊ are the velocities before and after its joint and v is the link's. A link's force I a + v ×* I v gains from that
//! I (v₋ + v₊) × s + K s, with K s = v ×* I s - I (v × s) + s ×* I v. Of K's four blocks two vanish: torque comes from rotation alone, by
//! a matrix T, and force is 2 ω × p, p the link's momentum. T and p add up over the links that are carried.

use super::{Stages, Tree};
use crate::lane::Lane;
use crate::math::spatial::{Inertia10, Spatial, cross_motion, dot6, inertia_mul, join, lin, rot};
use crate::math::vec3::{Mat3, Vec3, add as sum, cross, dot, mul, mul_t, scale, scale_add, sub, zero};
use crate::model::{DofKind, Model, NONE};

/// Where it goes, and scratch (see [`Derivative`](super::Derivative)).
pub(super) struct Target<'a, L> {
    pub lower: &'a mut [L],
    pub upper: &'a mut [L],
    pub turn: &'a mut [Spatial<L>],
    pub gain: &'a mut [[L; 12]],
}

/// Adds h times the derivative to a tree's rows of the matrix.
pub(super) fn add<L: Lane>(
    model: &Model<L::Real>,
    tree: &Tree,
    qvel: &[L],
    stages: Stages<'_, L>,
    h: L,
    Target { lower, upper, turn, gain }: Target<'_, L>,
) {
    let Stages { position, inertia, velocity, .. } = stages;
    for l in tree.links.clone() {
        let link = &model.links[l];
        let before = if link.parent == NONE { zero() } else { velocity.cvel[link.parent as usize] };
        turns(model, link.dofs.range(), before, &position.cdof, qvel, turn);
        gain[l] = gained(&inertia.link[l], &velocity.cvel[l]);
    }
    for l in tree.links.clone().rev() {
        let (parent, carried) = (model.links[l].parent, gain[l]);
        if parent != NONE {
            gain[parent as usize].iter_mut().zip(carried).for_each(|(all, x)| *all += x);
        }
    }
    for i in tree.dofs.clone() {
        let link = model.dofs[i].link as usize;
        let (composite, axis) = (&inertia.composite[link], &position.cdof[i]);
        let gain = &gain[link];
        let (matrix, momentum): (Mat3<L>, Vec3<L>) =
            (std::array::from_fn(|k| gain[k]), std::array::from_fn(|k| gain[9 + k]));
        let (w, v) = (rot(axis), lin(axis));
        // Forces on what the dof carries, from its own motion; and what its own force gains from motions below it.
        let moved = join(&mul(&matrix, &w), &scale(L::of(2.0), &cross(&w, &momentum)));
        let moved = sum(&moved, &inertia_mul(composite, &turn[i]));
        let held = inertia_mul(composite, axis);
        let felt = scale_add(L::of(2.0), &cross(&momentum, &v), &mul_t(&matrix, &w));
        for j in model.tree_pattern.row(i).iter().flat_map(|run| run.range()) {
            let (below, at) = (&position.cdof[j], model.rows.at(i, j));
            let own = dot6(&held, &turn[j]) + dot(&felt, &rot(below));
            lower[at] = h.mul_add(own, lower[at]);
            upper[at] = h.mul_add(dot6(&moved, below), upper[at]);
        }
        let diagonal = &mut lower[model.rows.diagonal(i)];
        *diagonal = h.mul_add(dot6(&moved, axis), *diagonal);
    }
}

/// (v₋ + v₊) × s of a link's dofs. Translations of a free joint do not turn.
pub fn turns<L: Lane>(
    model: &Model<L::Real>,
    dofs: std::ops::Range<usize>,
    mut before: Spatial<L>,
    cdof: &[Spatial<L>],
    qvel: &[L],
    turn: &mut [Spatial<L>],
) {
    let mut i = dofs.start;
    while i < dofs.end {
        let own = match model.dofs[i].kind {
            DofKind::Slide | DofKind::Hinge => i..i + 1,
            DofKind::FreeTranslation(_) | DofKind::FreeRotation(_) | DofKind::BallRotation(_) => i..i + 3,
        };
        i = own.end;
        let after = own.clone().fold(before, |v, k| scale_add(qvel[k], &cdof[k], &v));
        let both = sum(&before, &after);
        for k in own {
            let still = matches!(model.dofs[k].kind, DofKind::FreeTranslation(_));
            turn[k] = if still { zero() } else { cross_motion(&both, &cdof[k]) };
        }
        before = after;
    }
}

/// T and p of a link of velocity (ω; u) and inertia (J, h, m): T a = ω × J a - J (ω × a) - u × (h × a) - h × (u × a) + a × (J ω + h × u),
/// p = m u - h × ω.
pub fn gained<L: Lane>(inertia: &Inertia10<L>, v: &Spatial<L>) -> [L; 12] {
    let momentum = inertia_mul(inertia, v);
    let (w, u, h, l) = (rot(v), lin(v), [inertia[6], inertia[7], inertia[8]], rot(&momentum));
    let [xx, yy, zz, xy, xz, yz, ..] = *inertia;
    let j = [xx, xy, xz, xy, yy, yz, xz, yz, zz];
    let mut out = [L::zero(); 12];
    for c in 0..3 {
        let axis: Vec3<L> = std::array::from_fn(|k| if k == c { L::one() } else { L::zero() });
        let column = [j[c], j[3 + c], j[6 + c]];
        let turned = sub(&cross(&w, &column), &mul(&j, &cross(&w, &axis)));
        let shifted = sum(&cross(&u, &cross(&h, &axis)), &cross(&h, &cross(&u, &axis)));
        let torque = sum(&sub(&turned, &shifted), &cross(&axis, &l));
        for r in 0..3 {
            out[3 * r + c] = torque[r];
        }
    }
    out[9..].copy_from_slice(&lin(&momentum));
    out
}
