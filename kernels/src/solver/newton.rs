//! Newton's method: the direction -H⁻¹g.

use super::{Problem, Solver, SolverWork, find_pattern, hessian, pattern, primal};
use crate::code::{Code, SolverPart};
use crate::lane::{Lane, LaneQuery};
use crate::math::ldl;
use crate::model::Pattern;

/// Sets the search direction of the current iterate, and what follows from it.
pub fn direction<L: LaneQuery>(problem: &Problem<'_, L>, code: &mut dyn Code<L>, work: &mut SolverWork<L>) {
    hessian::collect(problem, code, work);
    // Contacts whose sides both move have more to add to the Hessian.
    let alone = !problem.constraint.coupled;
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
    polish(problem, pattern, work);
}

/// Sets the search direction -H⁻¹g from the factor at hand, and what follows from it.
pub fn polish<L: Lane>(problem: &Problem<'_, L>, pattern: &Pattern, work: &mut SolverWork<L>) {
    let Solver { gradient, search, hessian, inverse, .. } = &mut work.fields;
    for (p, g) in search.iter_mut().zip(gradient.iter()) {
        *p = -*g;
    }
    ldl::solve(&problem.model.rows, pattern, hessian, inverse, search);
    primal::motion(problem, work);
}
