//! Newton's method: the direction -H⁻¹g.

use super::{Problem, Solver, SolverWork, hessian, pattern, primal};
use crate::code::Code;
use crate::lane::{Lane, LaneQuery};
use crate::math::ldl;
use crate::model::Pattern;

/// Sets the search direction of the current iterate, and its motion.
pub fn direction<L: LaneQuery>(problem: &Problem<'_, L>, code: &mut dyn Code<L>, work: &mut SolverWork<L>) {
    hessian::assemble(problem, code, work);
    if !code.descend(problem, &mut work.fields) {
        descend(problem, pattern(problem, &mut work.fill), &mut work.fields);
    }
}

/// Factors the Hessian and sets the search direction and its motion.
pub fn descend<L: Lane>(problem: &Problem<'_, L>, pattern: &Pattern, solver: &mut Solver<L>) {
    let Solver { hessian, inverse, multipliers, .. } = solver;
    ldl::factor(&problem.model.rows, pattern, hessian, inverse, multipliers);
    polish(problem, pattern, solver);
}

/// Sets the search direction -H⁻¹g from the factor at hand, and its motion.
pub fn polish<L: Lane>(problem: &Problem<'_, L>, pattern: &Pattern, solver: &mut Solver<L>) {
    let Solver { gradient, search, hessian, inverse, .. } = solver;
    for (p, g) in search.iter_mut().zip(gradient.iter()) {
        *p = -*g;
    }
    ldl::solve(&problem.model.rows, pattern, hessian, inverse, search);
    primal::motion(problem, solver);
}
