//! Newton's method: the direction -H⁻¹g.

use super::{Problem, Solver, SolverWork, primal};
use crate::lane::Lane;
use crate::math::ldl;
use crate::model::Pattern;

/// Factors the Hessian, on the inertia matrix's pattern or on the filled one, and sets the search direction and what follows from it.
pub fn descend<L: Lane>(problem: &Problem<'_, L>, filled: bool, work: &mut SolverWork<L>) {
    let SolverWork { fields, fill, .. } = work;
    let pattern = if filled { &fill.pattern } else { &problem.model.tree_pattern };
    let Solver { hessian, inverse, multipliers, .. } = &mut *fields;
    ldl::factor(&problem.model.rows, pattern, hessian, inverse, multipliers);
    search(problem, pattern, fields);
    primal::motion(problem, work);
}

/// p = -H⁻¹g from the factor at hand.
fn search<L: Lane>(problem: &Problem<'_, L>, pattern: &Pattern, solver: &mut Solver<L>) {
    let Solver { gradient, search, hessian, inverse, .. } = solver;
    for (p, g) in search.iter_mut().zip(gradient.iter()) {
        *p = -*g;
    }
    ldl::solve(&problem.model.rows, pattern, hessian, inverse, search);
}

/// A last step from the factor at hand, on the inertia matrix's pattern or on the filled one, in the lanes of `open`. It stays within a quadratic piece, so it leaves no gradient: the
/// force of the constraints is M a - (smooth force), and rows need not be looked at.
pub fn polish<L: Lane>(problem: &Problem<'_, L>, filled: bool, open: L::Mask, work: &mut SolverWork<L>) {
    let pattern = if filled { &work.fill.pattern } else { &problem.model.tree_pattern };
    search(problem, pattern, &mut work.fields);
    settle(problem, open, &mut work.fields);
}

/// Takes that step.
pub fn settle<L: Lane>(problem: &Problem<'_, L>, open: L::Mask, solver: &mut Solver<L>) {
    let Problem { model, inertia, acceleration, .. } = problem;
    let Solver { qacc, ma, qfrc_constraint, search, msearch, .. } = solver;
    ldl::multiply(&model.rows, &model.tree_pattern, &inertia.m, search, msearch);
    for i in 0..qacc.len() {
        qacc[i] = L::select(open, qacc[i] + search[i], qacc[i]);
        ma[i] = L::select(open, ma[i] + msearch[i], ma[i]);
        qfrc_constraint[i] = L::select(open, ma[i] - acceleration.qfrc_smooth[i], qfrc_constraint[i]);
    }
}
