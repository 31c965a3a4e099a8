//! The force that constraints have at an acceleration that is known.

use super::{Problem, SolverWork, rows, touch};
use crate::lane::Lane;

/// Sets the generalised force of the constraints to that which the convex cost has at the acceleration `qacc`, which is kept as the
/// solver's.
pub fn force_at<L: Lane>(problem: &Problem<'_, L>, qacc: &[L], work: &mut SolverWork<L>) {
    work.fields.qacc.copy_from_slice(qacc);
    if problem.constraint.is_empty() {
        work.fields.qfrc_constraint.fill(L::zero());
        return;
    }
    work.fit(problem.constraint);
    touch(problem.model, problem.constraint, work);
    rows::at_acceleration(problem, work);
    std::mem::swap(&mut work.force, &mut work.spare);
    rows::transpose(problem, work);
}
