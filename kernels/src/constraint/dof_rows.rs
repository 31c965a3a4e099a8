//! Dry friction and joint limits.

use super::{Constraint, DofRow, DofRowKind, impedance};
use crate::lane::{Lane, LaneQuery};
use crate::math::quat;
use crate::math::vec3::{dot, neg, zero};
use crate::model::{Impedance, Limit, Model};

/// Lists dry friction and the limits that act in some world of `alive`, in MuJoCo's order.
pub fn dof_rows<L: LaneQuery>(
    model: &Model<L::Real>,
    qpos: &[L],
    qvel: &[L],
    alive: L::Mask,
    constraint: &mut Constraint<L>,
) {
    let rows = &mut constraint.dof_rows;
    rows.clear();
    for (id, friction) in model.friction_losses.iter().enumerate() {
        rows.push(DofRow {
            kind: DofRowKind::Friction,
            id: id as u32,
            dof: friction.dof,
            axis: zero(),
            pos: L::zero(),
            d: L::one() / L::splat(friction.r),
            reference: L::splat(friction.b) * qvel[friction.dof as usize],
            bound: L::splat(friction.bound),
        });
    }
    for (id, limit) in model.limits.iter().enumerate() {
        let q = &qpos[limit.qpos as usize..];
        let v = &qvel[limit.dof as usize..];
        let margin = L::splat(limit.margin);
        if limit.ball {
            let (axis, angle) = quat::axis_angle(&quat::unit(&[q[0], q[1], q[2], q[3]]));
            let flip = angle.lt(L::zero());
            let axis = crate::math::vec3::select(flip, &neg(&axis), &axis);
            let pos = L::splat(limit.range[1]) - angle.abs() - margin;
            let speed = -dot(&axis, &[v[0], v[1], v[2]]);
            push::<L>(rows, limit, id, DofRowKind::Ball, axis, pos, speed, alive);
        } else {
            let lower = q[0] - L::splat(limit.range[0]) - margin;
            push::<L>(rows, limit, id, DofRowKind::Lower, zero(), lower, v[0], alive);
            let upper = L::splat(limit.range[1]) - q[0] - margin;
            push::<L>(rows, limit, id, DofRowKind::Upper, zero(), upper, -v[0], alive);
        }
    }
}

/// Adds a limit's row if it acts in some world. `pos` is the distance less the margin, `speed` the row's velocity.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // a row's ingredients, all different
fn push<L: LaneQuery>(
    rows: &mut Vec<DofRow<L>>,
    limit: &Limit<L::Real>,
    id: usize,
    kind: DofRowKind,
    axis: [L; 3],
    pos: L,
    speed: L,
    alive: L::Mask,
) {
    let acts = pos.lt(L::zero()) & alive;
    if !L::any(acts) {
        return;
    }
    let (d, reference) = row(&limit.impedance, pos, speed, L::splat(limit.invweight), L::one());
    let d = L::select(acts, d, L::zero());
    rows.push(DofRow { kind, id: id as u32, dof: limit.dof, axis, pos, d, reference, bound: L::zero() });
}

/// Least regulariser: of rows between bodies that weigh nothing against each other. Not a rounding threshold, so the same
/// in every precision.
const MIN_REGULARISER: f64 = 1e-15;

/// D = 1/R with R = `factor` Â (1 - d)/d, and minus the reference acceleration b v + k d r.
#[inline(always)]
pub(super) fn row<L: Lane>(model: &Impedance<L::Real>, pos: L, speed: L, diagonal: L, factor: L) -> (L, L) {
    let imp = impedance(model, pos);
    let r = ((L::one() - imp) / imp * diagonal).max(L::of(MIN_REGULARISER));
    let reference = L::splat(model.b).mul_add(speed, L::splat(model.k) * imp * pos);
    (L::one() / (r * factor), reference)
}
