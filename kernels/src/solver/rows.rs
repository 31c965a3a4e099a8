//! Between dofs and rows: J x, row forces, and Jᵀ f.

use super::{Problem, RowVector, Solver, SolverWork, cone, primal};
use crate::code::Code;
use crate::constraint::{Constraint, ContactRow, DofRow, DofRowKind};
use crate::lane::{Lane, LaneQuery};
use crate::math::spatial::dot6;
use crate::math::tree;
use crate::math::vec3::{add, dot, scale_add, zero};
use crate::model::{Model, NONE};

/// out = J x.
pub fn apply<L: Lane>(problem: &Problem<'_, L>, x: &[L], twist: &mut [[L; 6]], out: &mut RowVector<L>) {
    if !problem.constraint.contact_rows.is_empty() {
        tree::twists(problem.model, &problem.position.cdof, x, twist);
    }
    of_motion(problem, x, twist, out);
}

/// out = J x, where `twist` is the motion of every link with x.
pub fn of_motion<L: Lane>(problem: &Problem<'_, L>, x: &[L], twist: &[[L; 6]], out: &mut RowVector<L>) {
    let Problem { model, constraint, .. } = problem;
    for (row, y) in constraint.dof_rows.iter().zip(&mut out.dof) {
        let x = &x[row.dof as usize..];
        *y = match row.kind {
            DofRowKind::Friction | DofRowKind::Lower => x[0],
            DofRowKind::Upper => -x[0],
            DofRowKind::Ball => -dot(&row.axis, &[x[0], x[1], x[2]]),
        };
    }
    for row in &constraint.contact_rows {
        let (first, dim) = (row.component as usize, row.dim as usize);
        let out = &mut out.component[first..first + dim];
        if row.link != NONE {
            let motion = &twist[row.link as usize];
            for (y, w) in out.iter_mut().zip(&constraint.motion[first..first + dim]) {
                *y = dot6(w, motion);
            }
        } else {
            out.fill(L::zero());
            for (entry, column) in two_sided(model, constraint, row) {
                for (y, j) in out.iter_mut().zip(column) {
                    *y = j.mul_add(x[entry], *y);
                }
            }
        }
    }
}

/// y = J x becomes J x - a_ref.
pub fn add_reference<L: Lane>(constraint: &Constraint<L>, y: &mut RowVector<L>) {
    for (y, row) in y.dof.iter_mut().zip(&constraint.dof_rows) {
        *y += row.reference;
    }
    for (y, reference) in y.component.iter_mut().zip(&constraint.reference) {
        *y += *reference;
    }
}

/// Dofs and Jacobian columns of a contact with two moving sides.
#[inline(always)]
pub fn two_sided<'a, L: Lane>(
    model: &'a Model<L::Real>,
    constraint: &'a Constraint<L>,
    row: &ContactRow<L>,
) -> impl Iterator<Item = (usize, &'a [L])> {
    let dofs = &model.pair_dofs[model.pairs[row.pair as usize].dofs.range()];
    let (start, dim) = (row.jacobian as usize, row.dim as usize);
    let columns = constraint.jacobian[start..start + dim * dofs.len()].chunks_exact(dim);
    dofs.iter().map(|entry| entry.dof as usize).zip(columns)
}

/// Force of a dof row at y, and its derivative's negative: the row's stiffness.
#[inline(always)]
pub fn dof_force<L: Lane>(row: &DofRow<L>, y: L) -> (L, L) {
    let pull = row.d * y;
    if row.kind == DofRowKind::Friction {
        let slides = pull.abs().ge(row.bound);
        (-(pull.clamp(-row.bound, row.bound)), L::select(slides, L::zero(), row.d))
    } else {
        let acts = y.lt(L::zero());
        (L::select(acts, -pull, L::zero()), L::select(acts, row.d, L::zero()))
    }
}

/// Row forces from y, their generalised force Jᵀf, and the gradient M a - smooth force - Jᵀf. Returns the lanes that have
/// converged.
pub fn forces<L: LaneQuery>(problem: &Problem<'_, L>, code: &mut dyn Code<L>, work: &mut SolverWork<L>) -> L::Mask {
    from_y(problem.constraint, &work.y, &mut work.force);
    pull(problem, work);
    match code.gather(problem, &mut work.fields) {
        Some(converged) => L::mask_of(converged),
        None => gather(problem, &work.touched, &mut work.fields),
    }
}

/// Sums the forces on touched links up to the dofs, and sets the gradient. Returns the lanes that have converged.
pub fn gather<L: Lane>(problem: &Problem<'_, L>, touched: &[bool], solver: &mut Solver<L>) -> L::Mask {
    climb(problem, touched, solver);
    let Solver { qfrc_constraint, ma, gradient, .. } = solver;
    for i in 0..gradient.len() {
        gradient[i] = ma[i] - problem.acceleration.qfrc_smooth[i] - qfrc_constraint[i];
    }
    primal::converged(problem, solver)
}

/// Row forces from y.
pub fn from_y<L: Lane>(constraint: &Constraint<L>, y: &RowVector<L>, force: &mut RowVector<L>) {
    for ((row, y), force) in constraint.dof_rows.iter().zip(&y.dof).zip(&mut force.dof) {
        *force = dof_force(row, *y).0;
    }
    for row in &constraint.contact_rows {
        let range = row.component as usize..(row.component + row.dim) as usize;
        cone::force(row, &y.component[range.clone()], &mut force.component[range]);
    }
}

/// Generalised force Jᵀf of the row forces.
pub fn transpose<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    pull(problem, work);
    climb(problem, &work.touched, &mut work.fields);
}

/// Forces of the rows: on the dofs that they name, and on touched links.
fn pull<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let Problem { model, constraint, .. } = problem;
    let Solver { qfrc_constraint, wrench, .. } = &mut work.fields;
    qfrc_constraint.fill(L::zero());
    for (row, force) in constraint.dof_rows.iter().zip(&work.force.dof) {
        let out = &mut qfrc_constraint[row.dof as usize..];
        match row.kind {
            DofRowKind::Friction | DofRowKind::Lower => out[0] += *force,
            DofRowKind::Upper => out[0] -= *force,
            DofRowKind::Ball => {
                for k in 0..3 {
                    out[k] = force.neg_mul_add(row.axis[k], out[k]);
                }
            }
        }
    }
    for (wrench, touched) in wrench.iter_mut().zip(&work.touched) {
        if *touched {
            *wrench = zero();
        }
    }
    for row in &constraint.contact_rows {
        let range = row.component as usize..(row.component + row.dim) as usize;
        let force = &work.force.component[range.clone()];
        if row.link != NONE {
            let wrench = &mut wrench[row.link as usize];
            for (f, w) in force.iter().zip(&constraint.motion[range]) {
                *wrench = scale_add(*f, w, wrench);
            }
        } else {
            for (dof, column) in two_sided(model, constraint, row) {
                for (f, j) in force.iter().zip(column) {
                    qfrc_constraint[dof] = j.mul_add(*f, qfrc_constraint[dof]);
                }
            }
        }
    }
}

/// Adds the forces on touched links, and on all that they carry, to the dofs.
fn climb<L: Lane>(problem: &Problem<'_, L>, touched: &[bool], solver: &mut Solver<L>) {
    let Problem { model, position, .. } = problem;
    let Solver { qfrc_constraint, wrench, .. } = solver;
    for (l, link) in model.links.iter().enumerate().rev() {
        if !touched[l] {
            continue;
        }
        let sum = wrench[l];
        for i in link.dofs.range() {
            qfrc_constraint[i] += dot6(&position.cdof[i], &sum);
        }
        if link.parent != NONE {
            let parent = &mut wrench[link.parent as usize];
            *parent = add(parent, &sum);
        }
    }
}

/// Cost of the rows at y.
pub fn cost<L: Lane>(constraint: &Constraint<L>, y: &RowVector<L>) -> L {
    let zero = L::zero();
    let mut twice = zero;
    for (row, y) in constraint.dof_rows.iter().zip(&y.dof) {
        let (force, _) = dof_force(row, *y);
        // Twice the cost: D y² = -f y; sliding friction: η (2|y| - η/D).
        let quadratic = -(force * *y);
        twice += if row.kind == DofRowKind::Friction {
            let slides = (row.d * *y).abs().ge(row.bound);
            let linear = row.bound * ((*y + *y).abs() - row.bound / row.d);
            L::select(slides, linear, quadratic)
        } else {
            quadratic
        };
    }
    for row in &constraint.contact_rows {
        let first = row.component as usize;
        twice += cone::twice_cost(row, &y.component[first..first + row.dim as usize]);
    }
    twice * L::of(0.5)
}
