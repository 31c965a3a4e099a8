//! Rows that go by a list of dofs and pull both ways: equality constraints. Their cost ½ D y² is quadratic wherever the
//! acceleration is, so a line search knows them by one slope and one curvature.

use super::{Problem, SolverWork, contact};
use crate::lane::Lane;

/// out = J x; 0 for rows that are not listed.
pub fn rates<L: Lane>(problem: &Problem<'_, L>, x: &[L], out: &mut [L]) {
    let Problem { model, constraint, .. } = problem;
    out.fill(L::zero());
    for equality in constraint.equality.listed(model) {
        let out = &mut out[equality.rows()];
        for (dof, column) in constraint.equality.columns(model, equality) {
            for (y, j) in out.iter_mut().zip(column) {
                *y = j.mul_add(x[dof], *y);
            }
        }
    }
}

/// y = J x - a_ref; returns twice the cost there.
pub fn survey<L: Lane>(problem: &Problem<'_, L>, x: &[L], y: &mut [L]) -> L {
    rates(problem, x, y);
    add_reference(problem, y);
    twice_cost(problem, y)
}

/// y = J x becomes J x - a_ref.
pub fn add_reference<L: Lane>(problem: &Problem<'_, L>, y: &mut [L]) {
    let equality = &problem.constraint.equality;
    for row in equality.listed(problem.model).flat_map(|listed| listed.rows()) {
        y[row] += equality.reference[row];
    }
}

/// Twice the cost at y.
pub fn twice_cost<L: Lane>(problem: &Problem<'_, L>, y: &[L]) -> L {
    let equality = &problem.constraint.equality;
    let rows = equality.listed(problem.model).flat_map(|listed| listed.rows());
    rows.fold(L::zero(), |twice, row| (equality.d[row] * y[row]).mul_add(y[row], twice))
}

/// J p of the search direction p; slope and curvature along it, and their part at a full step.
pub fn approach<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let equality = &problem.constraint.equality;
    if equality.is_empty() {
        return;
    }
    rates(problem, &work.fields.search, &mut work.jp.equality);
    let SolverWork { y, jp, along, .. } = &mut *work;
    *along = [L::zero(); 2];
    for row in equality.listed(problem.model).flat_map(|listed| listed.rows()) {
        let pull = equality.d[row] * jp.equality[row];
        along[0] = pull.mul_add(y.equality[row], along[0]);
        along[1] = pull.mul_add(jp.equality[row], along[1]);
    }
    slope(problem, work);
}

/// Adds slope and curvature at the step that is tried.
pub fn slope<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let SolverWork { along: [slope, curvature], line, .. } = work;
    if !problem.constraint.equality.is_empty() {
        line.set_contact_slope(line.contact_slope() + line.step().mul_add(*curvature, *slope));
        line.set_contact_curvature(line.contact_curvature() + *curvature);
    }
}

/// Moves y by the step in the lanes of `open`, and finds the forces there.
pub fn follow<L: Lane>(problem: &Problem<'_, L>, step: L, open: L::Mask, y: &mut [L], jp: &[L], force: &mut [L]) {
    for equality in problem.constraint.equality.listed(problem.model) {
        contact::follow(step, open, &mut y[equality.rows()], &jp[equality.rows()]);
    }
    forces(problem, y, force);
}

/// f = -D y; 0 of rows that are not listed.
pub fn forces<L: Lane>(problem: &Problem<'_, L>, y: &[L], force: &mut [L]) {
    let equality = &problem.constraint.equality;
    force.fill(L::zero());
    for row in equality.listed(problem.model).flat_map(|listed| listed.rows()) {
        force[row] = -(equality.d[row] * y[row]);
    }
}

/// Adds Jᵀf.
pub fn pull<L: Lane>(problem: &Problem<'_, L>, force: &[L], qfrc_constraint: &mut [L]) {
    let Problem { model, constraint, .. } = problem;
    for equality in constraint.equality.listed(model) {
        for (dof, column) in constraint.equality.columns(model, equality) {
            for (f, j) in force[equality.rows()].iter().zip(column) {
                qfrc_constraint[dof] = j.mul_add(*f, qfrc_constraint[dof]);
            }
        }
    }
}

/// H += Jᵀ D J.
pub fn stiffen<L: Lane>(problem: &Problem<'_, L>, hessian: &mut [L]) {
    let Problem { model, constraint, .. } = problem;
    for equality in constraint.equality.listed(model) {
        let d = &constraint.equality.d[equality.rows()];
        let columns = constraint.equality.columns(model, equality);
        for (n, (i, column)) in columns.clone().enumerate() {
            let mut scaled = [L::zero(); 6];
            for (s, (d, j)) in scaled.iter_mut().zip(d.iter().zip(column)) {
                *s = *d * *j;
            }
            for (j, column) in columns.clone().take(n + 1) {
                let target = &mut hessian[model.rows.at(i, j)];
                for (s, j) in scaled.iter().zip(column) {
                    *target = s.mul_add(*j, *target);
                }
            }
        }
    }
}
