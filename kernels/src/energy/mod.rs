//! Potential and kinetic energy.

use crate::fields::fields;
use crate::inertia::Inertia;
use crate::lane::Lane;
use crate::math::ldl;
use crate::math::vec3::{add, dot, norm};
use crate::model::{Instance, Joint, JointKind};
use crate::passive::{Spring, joint_rest, shift_from_rest, tendon_spring_energy, twist_from_rest};
use crate::position::Position;
use crate::state::State;
use crate::tendon::Tendons;

fields! {
    /// Energies, J.
    pub struct Energy(sizes) {
        /// Potential: of gravity, zero at the world's origin, and of springs.
        pub potential: Vec<L> = 1,
        /// Kinetic: ½ vᵀ M v.
        pub kinetic: Vec<L> = 1,
        /// M v.
        pub momentum: Vec<L> = sizes.nv,
    } L
}

/// The stages that they are found from.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)] // each field is the stage of the same name
pub struct Stages<'a, L> {
    pub position: &'a Position<L>,
    pub tendons: &'a Tendons<L>,
    pub inertia: &'a Inertia<L>,
}

/// Both energies.
pub fn energy<L: Lane>(
    model: Instance<'_, L>,
    Stages { position, tendons, inertia }: Stages<'_, L>,
    State { qpos, qvel, plastic, .. }: &State<L>,
    energy: &mut Energy<L>,
) {
    // Bodies that stand still count as well: their potential is a constant.
    let mut potential = model.still_potential();
    let g = model.gravity();
    for (l, link) in model.links.iter().enumerate() {
        let (mass, ..) = model.mass(l);
        let com = add(&position.com[l], &position.origin[link.tree as usize]);
        potential = mass.neg_mul_add(dot(&g, &com), potential);
    }
    if model.features.springs {
        for (j, joint) in model.joints.iter().enumerate().filter(|(_, joint)| joint.spring) {
            let own = Spring { stiffness: model.stiffness(j), rest: joint_rest(&model, j, plastic) };
            potential += spring_energy(joint, &own, &qpos[joint.qpos as usize..]);
        }
        for (t, _) in model.tendons.iter().enumerate().filter(|(_, tendon)| tendon.spring) {
            potential += tendon_spring_energy(model, t, tendons.length[t], plastic);
        }
    }
    energy.potential[0] = potential;
    ldl::multiply(&model.rows, &model.tree_pattern, &inertia.m, qvel, &mut energy.momentum);
    let mut twice = L::zero();
    for (v, p) in qvel.iter().zip(&energy.momentum) {
        twice = v.mul_add(*p, twice);
    }
    energy.kinetic[0] = twice * L::of(0.5);
}

/// ½ a r² + b r³/3 + c r⁴/4 of each stretched part of a joint.
#[inline(always)]
fn spring_energy<L: Lane>(joint: &Joint<L::Real>, own: &Spring<L>, q: &[L]) -> L {
    let Spring { stiffness: [a, b, c], rest } = own;
    let stored = |r: L| {
        let inner = r.mul_add(r.mul_add(*c * L::of(0.25), *b * L::of(1.0 / 3.0)), *a * L::of(0.5));
        inner * r * r
    };
    match joint.kind {
        JointKind::Free => {
            stored(norm(&shift_from_rest(rest, q))) + stored(norm(&twist_from_rest(&rest[3..], &q[3..])))
        }
        JointKind::Ball => stored(norm(&twist_from_rest(rest, q))),
        JointKind::Slide | JointKind::Hinge => stored(q[0] - rest[0]),
    }
}
