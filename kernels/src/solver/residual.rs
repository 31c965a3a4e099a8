//! How far an acceleration is from the minimum: the residual of the optimality (KKT) conditions.

use super::{Problem, Solver, SolverWork, primal, rows};
use crate::lane::Lane;
use crate::math::ldl;
use crate::options;

/// Sets the residual of the statistics. Newton's method and conjugate gradients leave the gradient behind. After the dual
/// solver or the no-slip pass it is computed from the acceleration; the no-slip pass minimises another cost on purpose, so
/// there it says how much friction's regularisation is missing.
pub fn measure_residual<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let options = &problem.model.options;
    if options.solver == options::Solver::Pgs || options.noslip_iterations > 0 {
        find_gradient(problem, work);
    }
    let constrained = super::active_lanes(problem.constraint);
    let squared = work.fields.gradient.iter().fold(L::zero(), |sum, g| g.mul_add(*g, sum));
    let scale = L::splat(problem.model.mean_inertia) * L::of((problem.model.sizes.nv as f64).max(1.0));
    work.statistics.residual = L::select(constrained, squared.sqrt() / scale, L::zero());
}

/// The gradient at the acceleration, from forces that the convex cost gives it; the forces that the solver found stay.
fn find_gradient<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let Problem { model, inertia, constraint, .. } = problem;
    let Solver { qacc, ma, twist, .. } = &mut work.fields;
    rows::apply(problem, qacc, twist, &mut work.y);
    primal::add_reference(constraint, &mut work.y);
    ldl::multiply(&model.rows, &model.tree_pattern, &inertia.m, qacc, ma);
    let swap = |work: &mut SolverWork<L>| {
        std::mem::swap(&mut work.force, &mut work.jp);
        std::mem::swap(&mut work.fields.qfrc_constraint, &mut work.fields.msearch);
    };
    swap(work);
    rows::forces(problem, work);
    swap(work);
}
