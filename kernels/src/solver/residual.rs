//! How far an acceleration is from the minimum: the residual of the optimality (KKT) conditions.

use super::{Problem, Solver, SolverWork, rows};
use crate::lane::Lane;
use crate::math::ldl;

/// Sets the residual of the statistics in the lanes of `active`, from the acceleration alone: whatever a solver believes, M a - smooth force - Jᵀf
/// with the forces f that the convex cost has at a. The no-slip pass minimises another cost on purpose; there the residual
/// says how much friction's regularisation is missing. Nothing that can be asked for changes, the solver's forces neither.
pub fn measure_residual<L: Lane>(problem: &Problem<'_, L>, active: L::Mask, work: &mut SolverWork<L>) {
    let Problem { model, inertia, acceleration, .. } = problem;
    rows::at_acceleration(problem, work);
    let Solver { qacc, ma, .. } = &mut work.fields;
    ldl::multiply(&model.rows, &model.tree_pattern, &inertia.m, qacc, ma);
    swap_results(work);
    rows::transpose(problem, work);
    swap_results(work);
    let Solver { ma, msearch: pull, .. } = &work.fields;
    let mut squared = L::zero();
    for i in 0..ma.len() {
        let gradient = ma[i] - acceleration.qfrc_smooth[i] - pull[i];
        squared = gradient.mul_add(gradient, squared);
    }
    let scale = problem.mean_inertia * L::of((model.sizes.nv as f64).max(1.0));
    work.statistics.residual = L::select(active, squared.sqrt() / scale, L::zero());
}

/// Puts scratch in the place of the row forces and of their generalised force, or puts them back.
fn swap_results<L: Lane>(work: &mut SolverWork<L>) {
    std::mem::swap(&mut work.force, &mut work.spare);
    std::mem::swap(&mut work.fields.qfrc_constraint, &mut work.fields.msearch);
}
