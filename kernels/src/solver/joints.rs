//! Rows on joints and along tendons: dry friction and limits.

use super::Problem;
use super::edges::{add_slope, stays};
use crate::constraint::{DofLaw, DofRowKind};
use crate::lane::{Lane, Mask};
use crate::math::vec3::dot;
use crate::model::{Instance, NONE};
use crate::tendon;

/// out = J x.
#[inline(always)]
pub fn rates<L: Lane>(problem: &Problem<'_, L>, x: &[L], out: &mut [L]) {
    let Problem { model, tendons, constraint, .. } = *problem;
    for (law, y) in constraint.dof_laws().zip(out) {
        let rate = match law.row.tendon {
            NONE => x[law.row.dof as usize],
            tendon => tendon::rate(&model, tendon as usize, &tendons.jacobian, x),
        };
        let x = &x[law.row.dof as usize..];
        *y = match law.row.kind {
            DofRowKind::Friction | DofRowKind::Lower => rate,
            DofRowKind::Upper => -rate,
            DofRowKind::Limit => law.sign() * rate,
            DofRowKind::Ball => -dot(&law.axis(), &[x[0], x[1], x[2]]),
        };
    }
}

/// y = J x - a_ref; returns twice the cost there.
#[inline(always)]
pub fn survey<L: Lane>(problem: &Problem<'_, L>, x: &[L], y: &mut [L]) -> L {
    rates(problem, x, y);
    for (law, y) in problem.constraint.dof_laws().zip(y.iter_mut()) {
        *y += law.reference();
    }
    twice_cost(problem, y)
}

/// Largest force of a dry friction.
#[inline(always)]
pub fn bound<L: Lane>(model: Instance<'_, L>, law: &DofLaw<'_, L>) -> L {
    model.loss(law.row.id as usize)
}

/// Force of a row at y, and its derivative's negative: the row's stiffness.
#[inline(always)]
pub fn force<L: Lane>(model: Instance<'_, L>, law: &DofLaw<'_, L>, y: L) -> (L, L) {
    let (zero, d) = (L::zero(), law.d());
    let pull = d * y;
    if law.row.kind == DofRowKind::Friction {
        let bound = bound(model, law);
        let slides = pull.abs().ge(bound);
        (-(pull.clamp(-bound, bound)), L::select(slides, zero, d))
    } else {
        let acts = y.lt(zero);
        (L::select(acts, -pull, zero), L::select(acts, d, zero))
    }
}

/// Twice the cost of the rows.
#[inline(always)]
pub fn twice_cost<L: Lane>(problem: &Problem<'_, L>, y: &[L]) -> L {
    let mut twice = L::zero();
    for (law, y) in problem.constraint.dof_laws().zip(y) {
        let (force, _) = force(problem.model, &law, *y);
        // Twice the cost: D y² = -f y; sliding friction: η (2|y| - η/D).
        let quadratic = -(force * *y);
        twice += if law.row.kind == DofRowKind::Friction {
            let bound = bound(problem.model, &law);
            let slides = (law.d() * *y).abs().ge(bound);
            let linear = bound * ((*y + *y).abs() - bound / law.d());
            L::select(slides, linear, quadratic)
        } else {
            quadratic
        };
    }
    twice
}

/// A number of a row that is not a ball joint's, times the row's sign.
#[inline(always)]
pub fn signed<L: Lane>(law: &DofLaw<'_, L>, x: L) -> L {
    match law.row.kind {
        DofRowKind::Upper => -x,
        DofRowKind::Limit => law.sign() * x,
        _ => x,
    }
}

/// Adds Jᵀf.
#[inline(always)]
pub fn pull<L: Lane>(problem: &Problem<'_, L>, force: &[L], qfrc_constraint: &mut [L]) {
    let Problem { model, tendons, constraint, .. } = *problem;
    for (law, force) in constraint.dof_laws().zip(force) {
        if law.row.tendon != NONE {
            let force = signed(&law, *force);
            tendon::pull(&model, law.row.tendon as usize, &tendons.jacobian, force, qfrc_constraint);
            continue;
        }
        let out = &mut qfrc_constraint[law.row.dof as usize..];
        match law.row.kind {
            DofRowKind::Friction | DofRowKind::Lower => out[0] += *force,
            DofRowKind::Upper => out[0] -= *force,
            DofRowKind::Limit => out[0] = law.sign().mul_add(*force, out[0]),
            DofRowKind::Ball => {
                for (out, axis) in out.iter_mut().zip(law.axis()) {
                    *out = force.neg_mul_add(axis, *out);
                }
            }
        }
    }
}

/// Adds the rows' stiffness at y to the Hessian.
#[inline(always)]
pub fn stiffen<L: Lane>(problem: &Problem<'_, L>, y: &[L], hessian: &mut [L]) {
    let Problem { model, tendons, .. } = *problem;
    let rows = &model.rows;
    for (law, y) in problem.constraint.dof_laws().zip(y) {
        let (_, k) = force(model, &law, *y);
        let dof = law.row.dof as usize;
        if law.row.tendon != NONE {
            let columns = tendon::columns(&model, law.row.tendon as usize, &tendons.jacobian);
            for (n, (i, row)) in columns.clone().enumerate() {
                for (j, column) in columns.clone().take(n + 1) {
                    let entry = &mut hessian[rows.at(i, j)];
                    *entry = (k * row).mul_add(column, *entry);
                }
            }
        } else if law.row.kind == DofRowKind::Ball {
            let axis = law.axis();
            for i in 0..3 {
                for j in 0..=i {
                    let entry = &mut hessian[rows.at(dof + i, dof + j)];
                    *entry = (k * axis[i]).mul_add(axis[j], *entry);
                }
            }
        } else {
            hessian[rows.diagonal(dof)] += k;
        }
    }
}

/// Adds to first and second derivative by α of the rows' cost at y + α v.
#[inline(always)]
pub fn slope<L: Lane>(problem: &Problem<'_, L>, alpha: L, y: &[L], v: &[L], out: &mut [L; 2]) {
    for ((law, y), v) in problem.constraint.dof_laws().zip(y).zip(v) {
        let d = law.d();
        if law.row.kind == DofRowKind::Friction {
            let bound = bound(problem.model, &law);
            let pull = d * alpha.mul_add(*v, *y);
            out[0] = pull.clamp(-bound, bound).mul_add(*v, out[0]);
            out[1] += L::select(pull.abs().lt(bound), d * *v * *v, L::zero());
        } else {
            add_slope(&[*y, *v, d * *v], alpha, out);
        }
    }
}

/// Whether every row stays in one quadratic piece of its cost on a full step: none changes between acting and not acting,
/// or sticking and sliding.
#[inline(always)]
pub fn unchanged<L: Lane>(problem: &Problem<'_, L>, y: &[L], v: &[L]) -> L::Mask {
    let mut same = L::Mask::splat(true);
    for ((law, y), v) in problem.constraint.dof_laws().zip(y).zip(v) {
        let d = law.d();
        same = if law.row.kind == DofRowKind::Friction {
            let bound = bound(problem.model, &law);
            let (from, to) = (d * *y, d * L::one().mul_add(*v, *y));
            same & ((from.abs().lt(bound) & to.abs().lt(bound))
                | (from.ge(bound) & to.ge(bound))
                | (from.le(-bound) & to.le(-bound)))
        } else {
            same & stays(*y, L::one().mul_add(*v, *y), d)
        };
    }
    same
}
