//! Newton's method: the direction -H⁻¹g.

use super::{Problem, Solver, SolverWork, find_pattern, hessian, pattern, primal};
use crate::code::{Code, SolverPart};
use crate::lane::{Lane, LaneQuery};
use crate::math::ldl;
use crate::model::Pattern;

/// Sets the search direction of the current iterate, and what follows from it.
pub fn direction<L: LaneQuery>(problem: &Problem<'_, L>, code: &mut dyn Code<L>, work: &mut SolverWork<L>) {
    hessian::collect(problem, code, work);
    // Contacts whose sides both move, and equality constraints, have more to add to the Hessian.
    let alone = !problem.constraint.coupled && problem.constraint.equality.is_empty();
    if alone && code.solver(SolverPart::Turn, problem, &[], 0, work).is_some() {
        return;
    }
    hessian::assemble(problem, code, work);
    let part = SolverPart::Descend { filled: problem.constraint.cross };
    if code.solver(part, problem, &[], 0, work).is_none() {
        let fill = find_pattern(problem, work);
        descend(problem, pattern(problem, &fill), work);
        work.fill = fill;
    }
}

/// Factors the Hessian, and sets the search direction and what follows from it.
pub fn descend<L: Lane>(problem: &Problem<'_, L>, pattern: &Pattern, work: &mut SolverWork<L>) {
    let Solver { hessian, inverse, multipliers, .. } = &mut work.fields;
    ldl::factor(&problem.model.rows, pattern, hessian, inverse, multipliers);
    search(problem, pattern, &mut work.fields);
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

/// A last step from the factor at hand, in the lanes of `open`. It stays within a quadratic piece, so it leaves no gradient: the
/// force of the constraints is M a - (smooth force), and rows need not be looked at.
pub fn polish<L: Lane>(problem: &Problem<'_, L>, pattern: &Pattern, open: L::Mask, work: &mut SolverWork<L>) {
    search(problem, pattern, &mut work.fields);
    let Problem { model, inertia, acceleration, .. } = problem;
    let Solver { qacc, ma, qfrc_constraint, search, msearch, .. } = &mut work.fields;
    ldl::multiply(&model.rows, &model.tree_pattern, &inertia.m, search, msearch);
    for i in 0..qacc.len() {
        qacc[i] = L::select(open, qacc[i] + search[i], qacc[i]);
        ma[i] = L::select(open, ma[i] + msearch[i], ma[i]);
        qfrc_constraint[i] = L::select(open, ma[i] - acceleration.qfrc_smooth[i], qfrc_constraint[i]);
    }
}
