//! Rows of discrete steps: a row pulls at where the step ends. With s = 1 + h b + h² k d, R becomes R/s and the reference
//! -(b v + k d (r + h v))/s; Â is that of the step's metric as far as its diagonal tells. Friction of a contact keeps its ratio to the
//! normal's R.

use super::{Cone, Constraint, ContactRow, DofRow, DofRowKind, Motion, impedance};
use crate::collision::Collision;
use crate::lane::{Lane, LaneQuery, Mask, Real};
use crate::math::spatial::{Spatial, dot6};
use crate::model::{Impedance, Instance, Model, NONE, Sides};
use crate::tendon;

/// The inertia matrix, and the metric of the step; both stored by `model.rows`.
#[derive(Clone, Copy, Debug)]
pub struct Metric<'a, L> {
    /// M.
    pub inertia: &'a [L],
    /// M + h D + h² K.
    pub step: &'a [L],
}

/// Least (1 - d)/d: that of the largest impedance.
const LEAST: f64 = (1.0 - 0.9999) / 0.9999;

/// How a row's numbers change.
struct Change<L> {
    /// Factor of D but for that of the metric.
    stiffer: L,
    /// h k d.
    ahead: L,
    /// k d.
    spring: L,
    b: L,
    /// 1/s
    inverse: L,
}

/// The change of rows with this impedance, at violation `pos`. A stiffness below zero stands for what `refsafe` chooses: k d = 1/h², and
/// a damping ratio in place of b.
#[inline(always)]
fn change<L: Lane>(model: &Impedance<L::Real>, pos: L, h: f64) -> Change<L> {
    let imp = impedance(&model.lanes(), pos);
    let (spring, b) = if model.k.to_f64() < 0.0 {
        let stiffness = L::of(1.0 / (h * h)) / imp;
        (L::of(1.0 / (h * h)), L::splat(model.b) * L::of(2.0) * stiffness.sqrt())
    } else {
        (L::splat(model.k) * imp, L::splat(model.b))
    };
    let h = L::of(h);
    let ahead = h * spring;
    let s = h.mul_add(b + ahead, L::one());
    let own = (L::one() - imp) / imp;
    Change { stiffer: own / (own / s).max(L::of(LEAST)), ahead, spring, b, inverse: L::one() / s }
}

/// Sums of a row's squares over both diagonals.
#[derive(Clone, Copy)]
struct Ratio<L> {
    bare: L,
    step: L,
}

impl<L: Lane> Ratio<L> {
    fn none() -> Self {
        Ratio { bare: L::zero(), step: L::zero() }
    }

    #[inline(always)]
    fn add(&mut self, model: Instance<'_, L>, metric: Metric<'_, L>, dof: usize, j: L) {
        let (square, at) = (j * j, model.rows.diagonal(dof));
        self.bare += square / metric.inertia[at];
        self.step += square / metric.step[at];
    }

    /// By what D grows: the inverse of what Â shrinks by.
    #[inline(always)]
    fn factor(self) -> L {
        L::select(self.step.gt(L::zero()), self.bare / self.step, L::one())
    }
}

/// Turns the rows that are listed, as they are for continuous time, into those of a discrete step.
pub fn discretise<L: LaneQuery>(
    model: Instance<'_, L>,
    motion: Motion<'_, L>,
    metric: Metric<'_, L>,
    collision: &Collision<L>,
    constraint: &mut Constraint<L>,
) {
    joints(model, motion, metric, constraint);
    equalities(model, motion.qvel, metric, constraint);
    for i in 0..constraint.contact_rows.len() {
        let row = constraint.contact_rows[i];
        contact(model, motion, metric, collision, &row, constraint);
    }
}

/// Dry friction and limits. The compiler has changed damping and R of dry friction already.
fn joints<L: Lane>(
    model: Instance<'_, L>,
    motion: Motion<'_, L>,
    metric: Metric<'_, L>,
    constraint: &mut Constraint<L>,
) {
    let Motion { qvel, tendons, .. } = motion;
    let h = model.options.timestep;
    for (row, lanes) in constraint.dof_rows.iter().zip(&mut constraint.dof_lanes) {
        let (dof, mut ratio) = (row.dof as usize, Ratio::none());
        if row.tendon != NONE {
            for (dof, j) in tendon::columns(&model, row.tendon as usize, &tendons.jacobian) {
                ratio.add(model, metric, dof, j);
            }
        } else if row.kind == DofRowKind::Friction {
            ratio.add(model, metric, dof, L::one());
        }
        if row.kind == DofRowKind::Friction {
            lanes[4] *= ratio.factor();
            continue;
        }
        let parts = if row.kind == DofRowKind::Ball { 3 } else { 1 };
        let mut speed = L::zero();
        if row.tendon != NONE {
            speed = lanes[0] * tendons.velocity[row.tendon as usize];
        } else {
            for (k, axis) in lanes.iter().take(parts).enumerate() {
                ratio.add(model, metric, dof + k, *axis);
                speed = axis.mul_add(qvel[dof + k], speed);
            }
        }
        let speed = if row.kind == DofRowKind::Ball { -speed } else { speed };
        let Change { stiffer, ahead, spring, b, inverse } =
            change(&model.limits[row.id as usize].impedance, lanes[3], h);
        lanes[4] = lanes[4] * stiffer * ratio.factor();
        lanes[5] = (b + ahead).mul_add(speed, spring * lanes[3]) * inverse;
    }
}

fn equalities<L: Lane>(model: Instance<'_, L>, qvel: &[L], metric: Metric<'_, L>, constraint: &mut Constraint<L>) {
    let rows = &mut constraint.equality;
    for equality in &model.model.equalities {
        let mut square = L::zero();
        for row in equality.rows() {
            square = rows.pos[row].mul_add(rows.pos[row], square);
        }
        let Change { stiffer, ahead, inverse, .. } = change(&equality.impedance, square.sqrt(), model.options.timestep);
        for (i, row) in equality.rows().enumerate() {
            let (mut ratio, mut speed) = (Ratio::none(), L::zero());
            for (dof, column) in rows.columns(&model, equality) {
                ratio.add(model, metric, dof, column[i]);
                speed = column[i].mul_add(qvel[dof], speed);
            }
            rows.d[row] = L::select(rows.d[row].gt(L::zero()), rows.d[row] * stiffer * ratio.factor(), L::zero());
            rows.reference[row] = ahead.mul_add(speed, rows.reference[row]) * inverse;
        }
    }
}

fn contact<L: LaneQuery>(
    model: Instance<'_, L>,
    motion: Motion<'_, L>,
    metric: Metric<'_, L>,
    collision: &Collision<L>,
    row: &ContactRow,
    constraint: &mut Constraint<L>,
) {
    let pair = &model.pairs[row.pair as usize];
    let (dim, components) = (row.dim as usize, row.components());
    let law = constraint.law(row);
    // Of a pyramid, its first edge counts for all.
    let lean = if row.cone == Cone::Pyramid { law.friction(1) } else { L::zero() };
    let (mut ratio, mut speeds) = (Ratio::none(), [L::zero(); 6]);
    if row.sides == Sides::One {
        let rows = &constraint.motion[components.clone()];
        let first: Spatial<L> = match rows {
            [normal, tangent, ..] => std::array::from_fn(|k| lean.mul_add(tangent[k], normal[k])),
            _ => rows[0],
        };
        let mut dof = model.links[row.link as usize].last_dof();
        while dof != NONE {
            ratio.add(model, metric, dof as usize, dot6(&first, &motion.position.cdof[dof as usize]));
            dof = model.dofs[dof as usize].parent;
        }
        for (speed, w) in speeds.iter_mut().zip(rows) {
            *speed = dot6(w, &motion.velocity.cvel[row.link as usize]);
        }
    } else {
        let dofs = &model.pair_dofs[pair.dofs.range()];
        let columns = constraint.jacobian_of(row, dofs.len()).chunks_exact(dim);
        for (entry, column) in dofs.iter().zip(columns) {
            let first = if dim > 1 { lean.mul_add(column[1], column[0]) } else { column[0] };
            ratio.add(model, metric, entry.dof as usize, first);
            for (speed, j) in speeds.iter_mut().zip(column) {
                *speed = j.mul_add(motion.qvel[entry.dof as usize], *speed);
            }
        }
    }
    let pos = collision.contact(row.contact as usize).dist() - model.margin(row.pair as usize);
    let Change { stiffer, ahead, spring, b, inverse } = change(&pair.impedance, pos, model.options.timestep);
    let strength = &mut constraint.strengths[row.strength as usize];
    strength[0] = L::select(strength[0].gt(L::zero()), strength[0] * stiffer * ratio.factor(), L::zero());
    for (i, (reference, speed)) in constraint.reference[components].iter_mut().zip(speeds).enumerate() {
        let pull = if i == 0 { spring * pos } else { L::zero() };
        // Friction of an elliptic cone has a damping of its own, which the compiler has changed.
        if i == 0 || row.cone == Cone::Pyramid {
            *reference = (b + ahead).mul_add(speed, pull) * inverse;
        }
    }
}

/// The worlds in which some row acts on a free body that carries no joint; `dof` is its first.
pub fn held<L: LaneQuery>(model: &Model<L::Real>, constraint: &Constraint<L>, dof: usize) -> L::Mask {
    let link = model.dofs[dof].link;
    let acts = |d: L| d.gt(L::zero());
    let moves = |row: &DofRow| match row.tendon {
        NONE => (dof..dof + 6).contains(&(row.dof as usize)),
        tendon => {
            let dofs = &model.tendon_dofs[model.tendons[tendon as usize].dofs.range()];
            dofs.iter().any(|entry| (dof..dof + 6).contains(&(entry.dof as usize)))
        }
    };
    let mut held = L::Mask::splat(false);
    for law in constraint.dof_laws().filter(|law| moves(&law.row)) {
        held = held | acts(law.d());
    }
    for row in &constraint.contact_rows {
        let pair = &model.pairs[row.pair as usize];
        if [pair.link1, pair.link2].contains(&link) {
            held = held | acts(constraint.law(row).d());
        }
    }
    for equality in &model.equalities {
        let dofs = &model.equality_dofs[equality.dofs.range()];
        if dofs.iter().any(|entry| (dof..dof + 6).contains(&(entry.dof as usize))) {
            held = equality.rows().fold(held, |held, row| held | acts(constraint.equality.d[row]));
        }
    }
    held
}
