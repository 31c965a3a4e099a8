//! Newton's method: the direction -H⁻¹g.

use super::{Problem, Solver, SolverWork, hessian, pattern};
use crate::lane::Lane;
use crate::math::ldl;

/// Sets the search direction of the current iterate.
pub fn direction<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    hessian::assemble(problem, work);
    let pattern = pattern(problem, &work.fill);
    let Solver { hessian, inverse, multipliers, .. } = &mut work.fields;
    ldl::factor(&problem.model.rows, pattern, hessian, inverse, multipliers);
    search(problem, work);
}

/// Sets the search direction -H⁻¹g from the factor at hand.
pub fn search<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let pattern = pattern(problem, &work.fill);
    let Solver { gradient, search, hessian, inverse, .. } = &mut work.fields;
    for (p, g) in search.iter_mut().zip(gradient.iter()) {
        *p = -*g;
    }
    ldl::solve(&problem.model.rows, pattern, hessian, inverse, search);
}
