//! Dry friction and limits of joints and tendons.

use super::{Constraint, DofLanes, DofRow, DofRowKind, impedance};
use crate::lane::{Lane, Mask, Real};
use crate::math::quat;
use crate::math::vec3::{dot, neg, select};
use crate::model::{Impedance, Instance, Model, NONE};
use crate::tendon::Tendons;

/// All rows on joints and tendons that the model can have, in MuJoCo's order.
pub fn all_dof_rows<T: Real>(model: &Model<T>) -> impl Iterator<Item = DofRow> {
    let frictions = model.friction_losses.iter().zip(0..);
    let frictions = frictions.map(|(friction, id)| DofRow {
        kind: DofRowKind::Friction,
        id,
        dof: friction.dof,
        tendon: friction.tendon,
    });
    let limits = model.limits.iter().zip(0..).flat_map(|(limit, id)| {
        use DofRowKind::{Ball, Limit, Lower, Upper};
        let [low, high, margin] = [limit.range[0], limit.range[1], limit.margin].map(T::to_f64);
        let kinds: &[DofRowKind] = if limit.ball {
            &[Ball]
        } else if low + 2.0 * margin < high {
            &[Limit]
        } else {
            &[Lower, Upper]
        };
        kinds.iter().map(move |kind| DofRow { kind: *kind, id, dof: limit.dof, tendon: limit.tendon })
    });
    frictions.chain(limits)
}

/// What rows on joints and tendons measure.
#[derive(Clone, Copy, Debug)]
pub struct Measured<'a, L> {
    /// Positions.
    pub qpos: &'a [L],
    /// Velocities.
    pub qvel: &'a [L],
    /// Tendons.
    pub tendons: &'a Tendons<L>,
}

/// Numbers of the rows of the constraint's list, which act in worlds of `alive` alone; returns those in which some of them does, and
/// those in which some does that couples dofs that the inertia matrix does not.
pub fn dof_lanes<L: Lane>(
    model: Instance<'_, L>,
    measured: Measured<'_, L>,
    alive: L::Mask,
    constraint: &mut Constraint<L>,
) -> [L::Mask; 2] {
    let [mut some, mut cross] = [L::zero().lt(L::zero()); 2];
    let Constraint { dof_rows, dof_lanes, .. } = constraint;
    for (row, lanes) in dof_rows.iter().zip(dof_lanes) {
        let violated = violation(model, row, measured);
        let acts = if row.kind == DofRowKind::Friction { alive } else { violated.pos.lt(L::zero()) & alive };
        *lanes = numbers(model, row, violated, acts);
        some = some | lanes[4].gt(L::zero());
        if row.tendon != NONE && model.tendons[row.tendon as usize].cross {
            cross = cross | lanes[4].gt(L::zero());
        }
    }
    [some, cross]
}

/// The worlds in which some row on a joint or tendon may act: dry friction always does, and of limits of ball joints it costs as much to
/// tell as to have the row.
pub fn joint_rows<L: Lane>(model: Instance<'_, L>, measured: Measured<'_, L>) -> L::Mask {
    all_dof_rows(&model).fold(L::Mask::splat(false), |acting, row| {
        let acts = match row.kind {
            DofRowKind::Friction | DofRowKind::Ball => L::Mask::splat(true),
            _ => violation(model, &row, measured).pos.lt(L::zero()),
        };
        acting | acts
    })
}

/// By how much a limit is exceeded.
struct Violation<L> {
    /// As in [`DofLanes`].
    axis: [L; 3],
    /// Distance less the margin.
    pos: L,
    speed: L,
}

#[inline(always)]
fn violation<L: Lane>(model: Instance<'_, L>, row: &DofRow, measured: Measured<'_, L>) -> Violation<L> {
    let Measured { qpos, qvel, tendons } = measured;
    let (zero, one) = (L::zero(), L::one());
    let (length, rate) = match row.tendon {
        NONE => (qpos, qvel[row.dof as usize]),
        tendon => (&tendons.length[tendon as usize..], tendons.velocity[tendon as usize]),
    };
    if row.kind == DofRowKind::Friction {
        return Violation { axis: [zero; 3], pos: zero, speed: rate };
    }
    let limit = &model.limits[row.id as usize];
    let (q, v) = (&length[limit.qpos as usize..], &qvel[limit.dof as usize..]);
    let ([low, high], margin, _) = model.limit(row.id as usize);
    if row.kind == DofRowKind::Ball {
        let (axis, angle) = quat::axis_angle(&quat::unit(&[q[0], q[1], q[2], q[3]]));
        let axis = select(angle.lt(zero), &neg(&axis), &axis);
        let pos = high - angle.abs() - margin;
        return Violation { axis, pos, speed: -dot(&axis, &[v[0], v[1], v[2]]) };
    }
    let lower = q[0] - low - margin;
    let upper = high - q[0] - margin;
    let (pos, sign) = match row.kind {
        DofRowKind::Lower => (lower, one),
        DofRowKind::Upper => (upper, -one),
        _ => {
            let low = lower.lt(upper);
            (L::select(low, lower, upper), L::select(low, one, -one))
        }
    };
    Violation { axis: [sign, zero, zero], pos, speed: sign * rate }
}

/// The numbers of a row.
#[inline(always)]
fn numbers<L: Lane>(model: Instance<'_, L>, row: &DofRow, violated: Violation<L>, acts: L::Mask) -> DofLanes<L> {
    let Violation { axis: [x, y, z], pos, speed } = violated;
    if row.kind == DofRowKind::Friction {
        let friction = &model.friction_losses[row.id as usize];
        let d = L::one() / model.regulariser(row.id as usize);
        return [x, y, z, pos, L::select(acts, d, L::zero()), L::splat(friction.b) * speed];
    }
    let (_, _, impedance) = model.limit(row.id as usize);
    let (d, reference) = self::row(&impedance, pos, speed, model.limit_weight(row.id as usize), L::one());
    [x, y, z, pos, L::select(acts, d, L::zero()), reference]
}

/// Least regulariser: of rows between bodies that weigh nothing against each other. Not a rounding threshold, so the same
/// in every precision.
const MIN_REGULARISER: f64 = 1e-15;

/// D = 1/R with R = `factor` Â (1 - d)/d, and minus the reference acceleration b v + k d r.
#[inline(always)]
pub(super) fn row<L: Lane>(model: &Impedance<L>, pos: L, speed: L, diagonal: L, factor: L) -> (L, L) {
    let imp = impedance(model, pos);
    let reference = model.b.mul_add(speed, model.k * imp * pos);
    (L::one() / (regulariser(imp, diagonal) * factor), reference)
}

/// R = Â (1 - d)/d
#[inline(always)]
pub(super) fn regulariser<L: Lane>(imp: L, diagonal: L) -> L {
    ((L::one() - imp) / imp * diagonal).max(L::of(MIN_REGULARISER))
}
