//! The force that constraints have at an acceleration that is known.

use super::{Problem, SolverWork, equality, joints, rows, touch};
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
    touch(&problem.model, problem.constraint, work);
    rows::at_acceleration(problem, work);
    std::mem::swap(&mut work.force, &mut work.spare);
    rows::transpose(problem, work);
}

/// The stiffness of all rows but those of contacts where forces were last asked for by [`force_at`], in `hessian`.
pub fn stiffness_at<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let SolverWork { fields, jp, .. } = work;
    fields.hessian.fill(L::zero());
    joints::stiffen(problem, &jp.dof, &mut fields.hessian);
    equality::stiffen(problem, &mut fields.hessian);
}
