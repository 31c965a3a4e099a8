//! The primal problem, minimise over the acceleration: what Newton's method and conjugate gradients share. Both move
//! along a search direction by a line search.
//!
//! The cost of limits and pyramids is piecewise quadratic: a full Newton step after which no row has changed side lands on
//! the minimum, so the solver knows that it is done.

use super::{Problem, Solver, SolverWork, contact, equality, joints};
use crate::lane::{Lane, Mask, Real};
use crate::math::{ldl, tree};

/// From the search direction p: M p, slopes and curvature along it, the motion of every link, J p of rows on joints, and the
/// start of the line search.
pub fn motion<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let Problem { model, position, inertia, acceleration, .. } = problem;
    let Solver { search, msearch, twist, ma, gradient, .. } = &mut work.fields;
    ldl::multiply(&model.rows, &model.tree_pattern, &inertia.m, search, msearch);
    let (mut slope, mut curvature, mut descent) = (L::zero(), L::zero(), L::zero());
    for i in 0..search.len() {
        slope = search[i].mul_add(ma[i] - acceleration.qfrc_smooth[i], slope);
        curvature = search[i].mul_add(msearch[i], curvature);
        descent = search[i].mul_add(gradient[i], descent);
    }
    work.line.set_slope(slope);
    work.line.set_curvature(curvature);
    work.line.set_descent(descent);
    tree::twists(model, &position.cdof, search, twist);
    joints::rates(problem, search, &mut work.jp.dof);
    work.line.begin();
    equality::approach(problem, work);
}

/// Looks at the smooth acceleration, and at the same plus `warmstart`, which becomes the search direction: the motion of every
/// link, rows on joints (in J p and in y), and twice the cost but for contacts, and for that of the former's inertia, which is
/// the measure.
pub fn depart<L: Lane>(problem: &Problem<'_, L>, warmstart: &[L], work: &mut SolverWork<L>) {
    let Problem { model, position, inertia, acceleration, .. } = problem;
    let Solver { search, msearch, twist, cold_twist, .. } = &mut work.fields;
    let smooth = &acceleration.qacc_smooth;
    for (warm, (smooth, change)) in search.iter_mut().zip(smooth.iter().zip(warmstart)) {
        *warm = *smooth + *change;
    }
    ldl::multiply(&model.rows, &model.tree_pattern, &inertia.m, search, msearch);
    tree::twists(model, &position.cdof, smooth, cold_twist);
    tree::twists(model, &position.cdof, search, twist);
    let cold =
        joints::survey(problem, smooth, &mut work.jp.dof) + equality::survey(problem, smooth, &mut work.jp.equality);
    let mut warm = joints::survey(problem, search, &mut work.y.dof);
    for i in 0..search.len() {
        warm = warmstart[i].mul_add(msearch[i] - acceleration.qfrc_smooth[i], warm);
    }
    work.line.set_cold_cost(cold);
    work.line.set_warm_cost(warm + equality::survey(problem, search, &mut work.y.equality));
}

/// Takes the warm start where it costs less: sets qacc, M qacc and y of rows on joints, and no step. Returns the lanes that
/// take it.
pub fn choose<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) -> L::Mask {
    let acceleration = problem.acceleration;
    let SolverWork { fields, y, jp, line, .. } = work;
    let Solver { qacc, ma, search, msearch, .. } = fields;
    let warm = line.warm_cost().lt(line.cold_cost());
    let warm = if problem.model.options.flags.warmstart { warm } else { L::Mask::splat(false) };
    for i in 0..qacc.len() {
        qacc[i] = L::select(warm, search[i], acceleration.qacc_smooth[i]);
        ma[i] = L::select(warm, msearch[i], acceleration.qfrc_smooth[i]);
    }
    contact::choose(warm, &mut y.dof, &jp.dof);
    contact::choose(warm, &mut y.equality, &jp.equality);
    // No step along nothing: a warm start that is not a number leaves no trace.
    search.fill(L::zero());
    msearch.fill(L::zero());
    line.set_step(L::zero());
    line.set_curvature(L::zero());
    line.set_searches(L::zero());
    warm
}

/// Whether the gradient is below the tolerance, scaled by the model's inertia, or lost in rounding.
pub(super) fn converged<L: Lane>(problem: &Problem<'_, L>, solver: &Solver<L>) -> L::Mask {
    let Problem { model, acceleration, .. } = problem;
    // Sums in parallel: one chain of additions would take longer than all else.
    let (mut gradients, mut sizes) = ([L::zero(); 4], [[L::zero(); 3]; 2]);
    for i in 0..solver.gradient.len() {
        let g = solver.gradient[i];
        gradients[i % 4] = g.mul_add(g, gradients[i % 4]);
        let forces = [solver.ma[i], solver.qfrc_constraint[i], acceleration.qfrc_smooth[i]];
        for (size, force) in sizes[i % 2].iter_mut().zip(forces) {
            *size = force.mul_add(force, *size);
        }
    }
    let gradient = (gradients[0] + gradients[1]) + (gradients[2] + gradients[3]);
    let [first, second] = sizes.map(|[a, b, c]| (a + b) + c);
    let size = first + second;
    let bound = L::of(model.options.tolerance) * problem.mean_inertia * L::of(model.sizes.nv as f64);
    let rounding = L::of(2.0 * L::Real::EPSILON);
    gradient.sqrt().le(bound) | gradient.le(rounding * rounding * size)
}
