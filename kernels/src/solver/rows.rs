//! Between dofs and rows: J x, row forces, and Jᵀ f.

use super::{Problem, RowVector, Solver, SolverWork, cone, contact, edges, primal};
use crate::code::Code;
use crate::constraint::{Constraint, ContactRow, DofRow, DofRowKind};
use crate::lane::{Lane, LaneQuery, Real};
use crate::math::spatial::dot6;
use crate::math::tree;
use crate::math::vec3::{add, dot, zero};
use crate::model::{Model, NONE};

/// out = J x.
pub fn apply<L: Lane>(problem: &Problem<'_, L>, x: &[L], twist: &mut [[L; 6]], out: &mut RowVector<L>) {
    if !problem.constraint.contact_rows.is_empty() {
        tree::twists(problem.model, &problem.position.cdof, x, twist);
    }
    of_motion(problem, x, twist, out);
}

/// out = J x, where `twist` is the motion of every link with x.
fn of_motion<L: Lane>(problem: &Problem<'_, L>, x: &[L], twist: &[[L; 6]], out: &mut RowVector<L>) {
    let constraint = problem.constraint;
    of_dofs(problem, x, out);
    for row in constraint.contact_rows.iter().filter(|row| row.link != NONE) {
        let range = row.components();
        contact::rates(&constraint.motion[range.clone()], &twist[row.link as usize], &mut out.component[range]);
    }
}

/// The components of J x that depend on x itself: rows on joints, and contacts with two moving sides.
fn of_dofs<L: Lane>(problem: &Problem<'_, L>, x: &[L], out: &mut RowVector<L>) {
    let Problem { model, constraint, .. } = problem;
    for (row, y) in constraint.dof_rows.iter().zip(&mut out.dof) {
        let x = &x[row.dof as usize..];
        *y = match row.kind {
            DofRowKind::Friction | DofRowKind::Lower => x[0],
            DofRowKind::Upper => -x[0],
            DofRowKind::Ball => -dot(&row.axis, &[x[0], x[1], x[2]]),
        };
    }
    for row in constraint.contact_rows.iter().filter(|row| row.link == NONE) {
        let out = &mut out.component[row.components()];
        out.fill(L::zero());
        for (entry, column) in two_sided(model, constraint, row) {
            for (y, j) in out.iter_mut().zip(column) {
                *y = j.mul_add(x[entry], *y);
            }
        }
    }
}

/// y = J x - a_ref, where `twist` is the motion of every link with x; returns twice the cost there.
pub fn survey<L: LaneQuery>(
    problem: &Problem<'_, L>,
    x: &[L],
    twist: &[[L; 6]],
    code: &mut dyn Code<L>,
    y: &mut RowVector<L>,
) -> L {
    let constraint = problem.constraint;
    of_dofs(problem, x, y);
    for (y, row) in y.dof.iter_mut().zip(&constraint.dof_rows) {
        *y += row.reference;
    }
    let mut twice = dofs_twice_cost(constraint, y);
    for row in constraint.contact_rows.iter().filter(|row| row.link == NONE) {
        let y = &mut y.component[row.components()];
        for (y, reference) in y.iter_mut().zip(&constraint.reference[row.components()]) {
            *y += *reference;
        }
        twice += cone::twice_cost(constraint.law(row), y);
    }
    twice + contact::survey_all(constraint, twist, code, &mut y.component)
}

/// J p of the search direction p, and what the line search wants to know.
pub fn approach<L: LaneQuery>(problem: &Problem<'_, L>, code: &mut dyn Code<L>, work: &mut SolverWork<L>) {
    let constraint = problem.constraint;
    let SolverWork { fields, y, jp, edges, .. } = work;
    of_dofs(problem, &fields.search, jp);
    edges.collect(constraint, &y.dof, &jp.dof);
    for row in constraint.contact_rows.iter().filter(|row| row.link == NONE) {
        let (y, v) = (&y.component[row.components()], &jp.component[row.components()]);
        let mut same = edges.same[0];
        edges::of_contact(constraint.law(row), y, v, edges.of_row(row), &mut same);
        edges.same[0] = same;
    }
    contact::approach_all(constraint, &fields.twist, &y.component, code, &mut jp.component, edges);
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
    row: &ContactRow,
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

/// Where a step along the search direction has led: lanes that
#[derive(Clone, Copy, Debug)]
pub struct Arrival<M> {
    /// have converged;
    pub converged: M,
    /// moved no further than the rounding of the acceleration, in the norm of the inertia matrix: what is left of the
    /// gradient is rounding of stiff rows, and stays.
    pub still: M,
}

/// Moves the lanes of `open` by the step along the search direction: acceleration, y, row forces, their generalised force
/// Jᵀf, and the gradient M a - smooth force - Jᵀf.
pub fn follow<L: LaneQuery>(
    problem: &Problem<'_, L>,
    open: L::Mask,
    code: &mut dyn Code<L>,
    work: &mut SolverWork<L>,
) -> Arrival<L::Mask> {
    let constraint = problem.constraint;
    let SolverWork { fields, y, jp, force, .. } = work;
    let step = fields.step[0];
    contact::follow(step, open, &mut y.dof, &jp.dof);
    of_dof_rows(constraint, &y.dof, &mut force.dof);
    for row in constraint.contact_rows.iter().filter(|row| row.link == NONE) {
        let y = &mut y.component[row.components()];
        contact::follow(step, open, y, &jp.component[row.components()]);
        cone::force(constraint.law(row), y, &mut force.component[row.components()]);
    }
    clear_wrenches(&work.touched, &mut fields.wrench);
    pull_dofs(problem, force, &mut fields.qfrc_constraint);
    let (jp, force, wrench) = (&jp.component, &mut force.component, &mut fields.wrench);
    contact::act_all(constraint, step, open, jp, code, &mut y.component, force, wrench);
    match code.gather(problem, L::bits(open), fields) {
        Some([converged, still]) => Arrival { converged: L::mask_of(converged), still: L::mask_of(still) },
        None => gather(problem, &work.touched, open, fields),
    }
}

/// Moves the acceleration of the lanes of `open` by the step, sums the forces on touched links up to the dofs, and sets the
/// gradient.
pub fn gather<L: Lane>(
    problem: &Problem<'_, L>,
    touched: &[bool],
    open: L::Mask,
    solver: &mut Solver<L>,
) -> Arrival<L::Mask> {
    climb(problem, touched, solver);
    let Solver { qacc, ma, search, msearch, along, step, qfrc_constraint, gradient, .. } = solver;
    let (step, curvature, mut size) = (step[0], along[1], L::zero());
    for i in 0..gradient.len() {
        qacc[i] = L::select(open, step.mul_add(search[i], qacc[i]), qacc[i]);
        ma[i] = L::select(open, step.mul_add(msearch[i], ma[i]), ma[i]);
        size = qacc[i].mul_add(ma[i], size);
        gradient[i] = ma[i] - problem.acceleration.qfrc_smooth[i] - qfrc_constraint[i];
    }
    let rounding = L::of(L::Real::EPSILON);
    let still = (step * step * curvature).le(rounding * rounding * size);
    Arrival { converged: primal::converged(problem, solver), still }
}

/// Row forces from y.
pub fn from_y<L: Lane>(constraint: &Constraint<L>, y: &RowVector<L>, force: &mut RowVector<L>) {
    of_dof_rows(constraint, &y.dof, &mut force.dof);
    for row in &constraint.contact_rows {
        cone::force(constraint.law(row), &y.component[row.components()], &mut force.component[row.components()]);
    }
}

/// Forces of rows on joints.
fn of_dof_rows<L: Lane>(constraint: &Constraint<L>, y: &[L], force: &mut [L]) {
    for ((row, y), force) in constraint.dof_rows.iter().zip(y).zip(force) {
        *force = dof_force(row, *y).0;
    }
}

/// Generalised force Jᵀf of the row forces.
pub fn transpose<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let constraint = problem.constraint;
    let SolverWork { fields, force, touched, .. } = work;
    clear_wrenches(touched, &mut fields.wrench);
    pull_dofs(problem, force, &mut fields.qfrc_constraint);
    for row in constraint.contact_rows.iter().filter(|row| row.link != NONE) {
        let range = row.components();
        let wrench = &mut fields.wrench[row.link as usize];
        contact::push(&constraint.motion[range.clone()], &force.component[range], wrench);
    }
    climb(problem, touched, fields);
}

fn clear_wrenches<L: Lane>(touched: &[bool], wrench: &mut [[L; 6]]) {
    for (wrench, _) in wrench.iter_mut().zip(touched).filter(|(_, touched)| **touched) {
        *wrench = zero();
    }
}

/// Jᵀf of the rows that act on dofs: those on joints, and contacts with two moving sides.
fn pull_dofs<L: Lane>(problem: &Problem<'_, L>, force: &RowVector<L>, qfrc_constraint: &mut [L]) {
    let Problem { model, constraint, .. } = problem;
    qfrc_constraint.fill(L::zero());
    for (row, force) in constraint.dof_rows.iter().zip(&force.dof) {
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
    for row in constraint.contact_rows.iter().filter(|row| row.link == NONE) {
        for (dof, column) in two_sided(model, constraint, row) {
            for (f, j) in force.component[row.components()].iter().zip(column) {
                qfrc_constraint[dof] = j.mul_add(*f, qfrc_constraint[dof]);
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
    let mut twice = dofs_twice_cost(constraint, y);
    for row in &constraint.contact_rows {
        twice += cone::twice_cost(constraint.law(row), &y.component[row.components()]);
    }
    twice * L::of(0.5)
}

/// Twice the cost of the rows on joints.
fn dofs_twice_cost<L: Lane>(constraint: &Constraint<L>, y: &RowVector<L>) -> L {
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
    twice
}
