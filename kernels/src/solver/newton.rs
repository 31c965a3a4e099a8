//! Newton's method: the direction -H⁻¹g.

use super::{Problem, Solver, SolverWork, hessian, pattern};
use crate::lane::LaneQuery;
use crate::math::ldl;

/// Sets the search direction of the current iterate.
pub fn direction<L: LaneQuery>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    hessian::assemble(problem, work);
    let pattern = pattern(problem, &work.fill);
    let rows = &problem.model.rows;
    let Solver { gradient, search, hessian, inverse, multipliers, .. } = &mut work.fields;
    ldl::factor(rows, pattern, hessian, inverse, multipliers);
    for (p, g) in search.iter_mut().zip(gradient.iter()) {
        *p = -*g;
    }
    ldl::solve(rows, pattern, hessian, inverse, search);
}
