//! Rows that go by a list of dofs and pull both ways: equality constraints. Their cost ½ D y² is quadratic wherever the
//! acceleration is, so a line search knows them by one slope and one curvature. D is 0 in worlds where a row does not act.

use super::line::Line;
use super::{Problem, SolverWork};
use crate::lane::Lane;

/// out = J x
pub fn rates<L: Lane>(problem: &Problem<'_, L>, x: &[L], out: &mut [L]) {
    let Problem { model, constraint, .. } = problem;
    out.fill(L::zero());
    for equality in &model.equalities {
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
    for (y, reference) in y.iter_mut().zip(&problem.constraint.equality.reference) {
        *y += *reference;
    }
}

/// Twice the cost at y.
pub fn twice_cost<L: Lane>(problem: &Problem<'_, L>, y: &[L]) -> L {
    y.iter().zip(&problem.constraint.equality.d).fold(L::zero(), |twice, (y, d)| (*d * *y).mul_add(*y, twice))
}

/// J p of the search direction p; slope and curvature along it, and their part at a full step.
pub fn approach<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    if problem.model.equalities.is_empty() {
        return;
    }
    let SolverWork { fields, y, jp, line, .. } = work;
    rates(problem, &fields.search, &mut jp.equality);
    let (mut slope, mut curvature) = (L::zero(), L::zero());
    for (row, d) in problem.constraint.equality.d.iter().enumerate() {
        let pull = *d * jp.equality[row];
        slope = pull.mul_add(y.equality[row], slope);
        curvature = pull.mul_add(jp.equality[row], curvature);
    }
    line.set_equality_slope(slope);
    line.set_equality_curvature(curvature);
    self::slope(problem, line);
}

/// Adds slope and curvature at the step that is tried.
#[inline(always)]
pub fn slope<L: Lane>(problem: &Problem<'_, L>, line: &mut Line<L>) {
    if !problem.model.equalities.is_empty() {
        let (slope, curvature) = (line.equality_slope(), line.equality_curvature());
        line.set_contact_slope(line.contact_slope() + line.step().mul_add(curvature, slope));
        line.set_contact_curvature(line.contact_curvature() + curvature);
    }
}

/// f = -D y
pub fn forces<L: Lane>(problem: &Problem<'_, L>, y: &[L], force: &mut [L]) {
    for ((force, y), d) in force.iter_mut().zip(y).zip(&problem.constraint.equality.d) {
        *force = -(*d * *y);
    }
}

/// Adds Jᵀf.
pub fn pull<L: Lane>(problem: &Problem<'_, L>, force: &[L], qfrc_constraint: &mut [L]) {
    let Problem { model, constraint, .. } = problem;
    for equality in &model.equalities {
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
    for equality in &model.equalities {
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
