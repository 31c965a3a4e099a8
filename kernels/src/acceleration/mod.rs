//! Smooth acceleration: what the worlds would do without constraints, a₀ = M⁻¹(passive + actuator + applied - bias).

pub mod articulated;

use crate::actuation::Actuation;
use crate::fields::fields;
use crate::inertia::Inertia;
use crate::lane::{Lane, Mask, Real};
use crate::math::ldl;
use crate::math::spatial::{dot6, inertia_mul, join};
use crate::math::tree;
use crate::math::vec3::{add, cross, mul_add, splat};
use crate::model::{Instance, Model, NONE};
use crate::passive::Passive;
use crate::position::Position;
use crate::state::Applied;
use crate::tendon::{self, Tendons};
use crate::velocity::Velocity;

fields! {
    /// The smooth force, the factor of M and the smooth acceleration.
    pub struct Acceleration(sizes) {
        /// Sum of all forces but the constraints'.
        pub qfrc_smooth: Vec<L> = sizes.nv,
        /// Factor U = D L of M = Lᵀ D L, with D on the diagonal.
        pub factor: Vec<L> = sizes.nm,
        /// D⁻¹, that of the articulated bodies where there is no factor.
        pub inverse: Vec<L> = sizes.nv,
        /// Scratch of the factorisation.
        pub multipliers: Vec<L> = sizes.nv,
        /// Scratch of the refinement: what M a₀ leaves of the smooth force.
        pub residual: Vec<L> = sizes.nv,
        /// Scratch of the refinement: per link, its acceleration, then the force for it; of articulated bodies: force, then
        /// acceleration.
        pub twist: Vec<[L; 6]> = sizes.nlink,
        /// Scratch without M: inertias of articulated bodies.
        pub body: Vec<[L; 21]> = sizes.narticulated,
        /// Scratch without M: per dof, such an inertia times its axis.
        pub column: Vec<[L; 6]> = if sizes.narticulated > 0 { sizes.nv } else { 0 },
        /// Acceleration without constraints.
        pub qacc_smooth: Vec<L> = sizes.nv,
    } L
}

/// Sum of the forces. `applied` are forces from outside, if there are any.
pub fn smooth_force<L: Lane>(
    model: &Model<L::Real>,
    position: &Position<L>,
    velocity: &Velocity<L>,
    passive: &Passive<L>,
    actuation: &Actuation<L>,
    applied: Option<&Applied<L>>,
    acceleration: &mut Acceleration<L>,
) {
    let force = &mut acceleration.qfrc_smooth;
    for (i, f) in force.iter_mut().enumerate() {
        let passive = if model.features.passive() { passive.qfrc_passive[i] } else { L::zero() };
        *f = passive - velocity.qfrc_bias[i];
    }
    if model.features.actuation {
        for (f, a) in force.iter_mut().zip(&actuation.qfrc_actuator) {
            *f += *a;
        }
    }
    if let Some(applied) = applied {
        for (f, a) in force.iter_mut().zip(&applied.qfrc_applied) {
            *f += *a;
        }
        body_forces(model, position, &applied.xfrc_applied, force);
    }
}

/// Adds the generalised forces of forces and torques at the bodies' centres of mass.
fn body_forces<L: Lane>(model: &Model<L::Real>, position: &Position<L>, xfrc: &[[L; 6]], force: &mut [L]) {
    for (body, x) in model.bodies.iter().zip(xfrc) {
        if body.link == NONE {
            continue;
        }
        let l = body.link as usize;
        let at = mul_add(&position.rot[l], &splat(&body.com), &position.pos[l]);
        let (push, torque) = ([x[0], x[1], x[2]], [x[3], x[4], x[5]]);
        let wrench = join(&add(&torque, &cross(&at, &push)), &push);
        tree::push(model, &position.cdof, l, &wrench, force);
    }
}

/// Factors M and solves for the smooth acceleration, or finds it by articulated bodies. Returns the lanes in which M was singular.
/// `metric` is what discrete steps have in place of M.
pub fn smooth_acceleration<L: Lane>(
    model: Instance<'_, L>,
    stages: (&Position<L>, &Tendons<L>, &Inertia<L>),
    metric: Option<&[L]>,
    acceleration: &mut Acceleration<L>,
) -> L::Mask {
    let (position, _, inertia) = stages;
    let Acceleration { qfrc_smooth, factor, inverse, multipliers, twist, body, column, qacc_smooth, .. } = acceleration;
    if model.features.articulated {
        qacc_smooth.copy_from_slice(qfrc_smooth);
        let scratch = articulated::Scratch { body, force: twist, column, inverse };
        return articulated::solve(&model, &position.cdof, &inertia.link, |i| model.armature(i), scratch, qacc_smooth);
    }
    factor.copy_from_slice(metric.unwrap_or(&inertia.m));
    let singular = ldl::factor(&model.rows, &model.tree_pattern, factor, inverse, multipliers);
    solve_smooth(model, stages, metric.is_none(), acceleration);
    singular
}

/// Solves for the smooth acceleration with the factor at hand, that of M or of what discrete steps have in its place.
pub fn solve_smooth<L: Lane>(
    model: Instance<'_, L>,
    stages: (&Position<L>, &Tendons<L>, &Inertia<L>),
    of_inertia: bool,
    acceleration: &mut Acceleration<L>,
) {
    let Acceleration { qfrc_smooth, factor, inverse, qacc_smooth, .. } = acceleration;
    qacc_smooth.copy_from_slice(qfrc_smooth);
    ldl::solve(&model.rows, &model.tree_pattern, factor, inverse, qacc_smooth);
    if L::Real::EPSILON > 1e-10 && of_inertia {
        refine(model, stages, acceleration);
    }
}

/// How much larger than the largest state a smooth acceleration may be: constraints may hold what would move so fast. Beyond, squares in
/// the solver would overflow.
const WILD: f64 = 1e3;

/// Lanes in which the smooth acceleration is not finite, or longer than a solver can work with. In double precision there is none
/// whose squares overflow.
pub fn wild<L: Lane>(qacc_smooth: &[L]) -> L::Mask {
    if L::Real::EPSILON < 1e-10 {
        return L::Mask::splat(false);
    }
    let square = qacc_smooth.iter().fold(L::zero(), |sum, a| a.mul_add(*a, sum));
    let most = WILD * L::Real::MAXVAL;
    !square.le(L::of(most * most))
}

/// One step of iterative refinement, for single precision. M a₀ is formed link by link, with the armature on its own: a
/// small armature on a large inertia, which the diagonal of M has rounded away, still counts.
fn refine<L: Lane>(
    model: Instance<'_, L>,
    (position, tendons, inertia): (&Position<L>, &Tendons<L>, &Inertia<L>),
    acceleration: &mut Acceleration<L>,
) {
    let Acceleration { qfrc_smooth, factor, inverse, qacc_smooth, residual, twist, .. } = acceleration;
    tree::twists(&model, &position.cdof, qacc_smooth, twist);
    for (force, own) in twist.iter_mut().zip(&inertia.link) {
        *force = inertia_mul(own, force);
    }
    for (l, link) in model.links.iter().enumerate().rev() {
        let force = twist[l];
        for i in link.dofs.range() {
            let armature = model.armature(i);
            residual[i] = armature.neg_mul_add(qacc_smooth[i], qfrc_smooth[i]) - dot6(&position.cdof[i], &force);
        }
        if link.parent != NONE {
            let parent = &mut twist[link.parent as usize];
            *parent = add(parent, &force);
        }
    }
    for (t, tendon) in model.tendons.iter().enumerate().filter(|(_, tendon)| tendon.heavy) {
        let armature = -L::splat(tendon.armature);
        tendon::multiply_square(&model, t, &tendons.jacobian, armature, qacc_smooth, residual);
    }
    ldl::solve(&model.rows, &model.tree_pattern, factor, inverse, residual);
    for (a, change) in qacc_smooth.iter_mut().zip(residual.iter()) {
        *a += *change;
    }
}
