//! Passive forces: springs and dampers of joints and tendons, gravity compensation, and those of a medium.

pub mod ellipsoid;
pub mod fluid;
mod plastic;
mod tendons;

pub(crate) use plastic::joint_rest;
pub use plastic::yield_springs;
pub use tendons::{tendon_damper_slope, tendon_spring_energy, tendon_spring_slope, tension};

use crate::fields::fields;
use crate::lane::Lane;
use crate::math::quat;
use crate::math::spatial::join;
use crate::math::tree;
use crate::math::vec3::{build, cross, mul_add, norm, scale};
use crate::model::{Instance, Joint, JointKind};
use crate::position::Position;
use crate::state::State;
use crate::tendon::Tendons;
use crate::velocity::Velocity;

fields! {
    /// Passive generalised forces.
    pub struct Passive(sizes) {
        /// Gravity compensation, whether it counts as passive or as an actuator force.
        pub qfrc_gravcomp: Vec<L> = sizes.nv,
        /// Sum of the passive forces.
        pub qfrc_passive: Vec<L> = sizes.nv,
    } L
}

/// The stages that they are found from.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)] // each field is the stage of the same name
pub struct Stages<'a, L> {
    pub position: &'a Position<L>,
    pub tendons: &'a Tendons<L>,
    pub velocity: &'a Velocity<L>,
}

/// Sum of spring, damper, gravity compensation and fluid forces.
pub fn passive<L: Lane>(
    model: Instance<'_, L>,
    Stages { position, tendons, velocity }: Stages<'_, L>,
    State { qpos, qvel, plastic, .. }: &State<L>,
    passive: &mut Passive<L>,
) {
    passive.qfrc_passive.fill(L::zero());
    if model.features.springs {
        for (j, joint) in model.joints.iter().enumerate().filter(|(_, joint)| joint.spring) {
            let own = Spring { stiffness: model.stiffness(j), rest: joint_rest(&model, j, plastic) };
            spring(joint, &own, qpos, &mut passive.qfrc_passive);
        }
    }
    if model.features.dampers {
        for (i, _) in model.dofs.iter().enumerate().filter(|(_, dof)| dof.damped) {
            passive.qfrc_passive[i] -= damper(model, i, qvel[i]);
        }
    }
    tendons::add(model, (tendons, plastic), &mut passive.qfrc_passive);
    fluid::add(model, position, velocity, &mut passive.qfrc_passive);
    ellipsoid::add(model, position, velocity, &mut passive.qfrc_passive);
    if model.features.gravcomp {
        gravcomp(model, position, &mut passive.qfrc_gravcomp);
        for (i, dof) in model.dofs.iter().enumerate() {
            if !model.joints[dof.joint as usize].actuator_gravcomp {
                passive.qfrc_passive[i] += passive.qfrc_gravcomp[i];
            }
        }
    }
}

/// a + b r + c r²: the stiffness of a spring stretched by `r`.
#[inline(always)]
fn stiffness<L: Lane>([a, b, c]: &[L; 3], r: L) -> L {
    r.mul_add(r.mul_add(*c, *b), *a)
}

/// Rotation vector by which a ball (or the rotation of a free joint) is turned from where its spring rests, child frame.
#[inline(always)]
pub(crate) fn twist_from_rest<L: Lane>(rest: &[L], q: &[L]) -> [L; 3] {
    let rest = build(|k| rest[k]);
    quat::log(&quat::mul(&quat::conjugate(&rest), &quat::unit(&[q[0], q[1], q[2], q[3]])))
}

/// Displacement of a free joint's position from where its spring rests.
#[inline(always)]
pub(crate) fn shift_from_rest<L: Lane>(rest: &[L], q: &[L]) -> [L; 3] {
    build(|k| q[k] - rest[k])
}

/// A joint's spring.
pub(crate) struct Spring<L> {
    /// Coefficients of its force.
    pub stiffness: [L; 3],
    /// Where it rests.
    pub rest: [L; 7],
}

#[inline(always)]
fn spring<L: Lane>(joint: &Joint<L::Real>, own: &Spring<L>, qpos: &[L], force: &mut [L]) {
    let Spring { stiffness: spring, rest } = own;
    let q = &qpos[joint.qpos as usize..];
    let out = &mut force[joint.dof as usize..];
    let mut pull = |at: usize, d: &[L; 3]| {
        let f = scale(stiffness(spring, norm(d)), d);
        for k in 0..3 {
            out[at + k] -= f[k];
        }
    };
    match joint.kind {
        JointKind::Free => {
            pull(0, &shift_from_rest(rest, q));
            pull(3, &twist_from_rest(&rest[3..], &q[3..]));
        }
        JointKind::Ball => pull(0, &twist_from_rest(rest, q)),
        JointKind::Slide | JointKind::Hinge => {
            let x = q[0] - rest[0];
            out[0] -= stiffness(spring, x) * x;
        }
    }
}

/// a v + b v|v| + c v³
#[inline(always)]
fn damper<L: Lane>(model: Instance<'_, L>, dof: usize, v: L) -> L {
    let [a, b, c] = model.damping(dof);
    if model.dofs[dof].damping_linear {
        return a * v;
    }
    let speed = v.abs();
    speed.mul_add(speed.mul_add(c, b), a) * v
}

/// Derivative of the damper force by velocity, a + 2 b|v| + 3 c v².
#[inline(always)]
pub fn damper_slope<L: Lane>(model: Instance<'_, L>, dof: usize, v: L) -> L {
    let [a, b, c] = model.damping(dof);
    if model.dofs[dof].damping_linear {
        return a;
    }
    let speed = v.abs();
    speed.mul_add(speed.mul_add(L::of(3.0) * c, b + b), a)
}

/// Generalised forces that carry the compensated weight.
fn gravcomp<L: Lane>(model: Instance<'_, L>, position: &Position<L>, force: &mut [L]) {
    force.fill(L::zero());
    let g = model.gravity();
    for (l, link) in model.links.iter().enumerate() {
        let (weight, place) = model.compensation(l);
        if link.gravcomp == L::Real::default() {
            continue;
        }
        let lift = scale(-weight, &g);
        let at = mul_add(&position.rot[l], &place, &position.pos[l]);
        let wrench = join(&cross(&at, &lift), &lift);
        tree::push(&model, &position.cdof, l, &wrench, force);
    }
}
