//! What spatial tendons do to bodies.

use super::Stages;
use crate::constraint::{DofRowKind, slope};
use crate::lane::Lane;
use crate::math::spatial::Spatial;
use crate::math::vec3::scale;
use crate::model::{EqualityKind, Instance, NONE};
use crate::velocity::stretching;
use crate::{passive, tendon};

/// A tendon's push on a body at one place of its path.
#[derive(Clone, Copy, Debug)]
pub struct Push<L> {
    /// MJCF body.
    pub body: u32,
    /// Link that carries it, or [`NONE`].
    pub link: u32,
    /// Torque at the origin of the link's tree, or of the world, and force.
    pub wrench: Spatial<L>,
}

/// Calls `f` with what each spatial tendon does to bodies, piece by piece; `plastic` is where springs rest that yield.
pub fn pushes<L: Lane>(model: Instance<'_, L>, stages: &Stages<'_, L>, plastic: &[L], mut f: impl FnMut(Push<L>)) {
    for (t, tendon) in model.tendons.iter().enumerate().filter(|(_, tendon)| !tendon.fixed()) {
        let force = along(model, t, stages, plastic);
        for stretch in &model.stretches[tendon.stretches.range()] {
            let pulls = tendon::pulls(&model, stretch, stages.position);
            for ((body, link), pull) in stretch.bodies.into_iter().zip(stretch.links).zip(&pulls) {
                if body != NONE {
                    f(Push { body, link, wrench: scale(force, pull) });
                }
            }
        }
    }
}

/// Force along a tendon, that of a push: of springs, dampers, actuators and rows, less what its armature takes.
fn along<L: Lane>(model: Instance<'_, L>, t: usize, stages: &Stages<'_, L>, plastic: &[L]) -> L {
    let Stages { position, tendons, velocity, actuation, constraint, solver, .. } = stages;
    let mut force = -passive::tension(model, tendons, t, plastic);
    let driven = |a: &usize| model.actuators[*a].tendon as usize == t;
    // A model whose actuators are switched off has no such forces.
    for a in (0..actuation.force.len()).filter(driven) {
        force = model.gear(a)[0].mul_add(actuation.force[a], force);
    }
    for (law, row) in constraint.dof_laws().zip(&solver.force.dof).filter(|(law, _)| law.row.tendon as usize == t) {
        force += if law.row.kind == DofRowKind::Friction { *row } else { law.sign() * *row };
    }
    for equality in model.equalities.iter().filter(|equality| equality.kind == EqualityKind::Tendon) {
        let row = equality.row as usize;
        for (side, moves) in
            equality.tendons.into_iter().zip([L::one(), slope(equality, equality.tendons[1], &tendons.length)])
        {
            let acts = constraint.equality.d[row].gt(L::zero());
            if side as usize == t {
                force += L::select(acts, moves * solver.force.equality[row], L::zero());
            }
        }
    }
    if model.tendons[t].heavy {
        let bias = stretching(&model, t, position, &model.gravity(), velocity);
        let rate = tendon::rate(&model, t, &tendons.jacobian, &solver.fields.qacc) + bias;
        force = L::splat(model.tendons[t].armature).neg_mul_add(rate, force);
    }
    force
}
