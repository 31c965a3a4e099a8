//! The primal problem, minimise over the acceleration: what Newton's method and conjugate gradients share. Both move
//! along a search direction by an exact line search.
//!
//! The cost of limits and pyramids is piecewise quadratic: a full Newton step after which no row has changed side lands on
//! the minimum, so the solver knows that it is done.

use super::rows::{self, Arrival};
use super::{Problem, Solver, SolverWork, cg, newton, pattern};
use crate::code::Code;
use crate::lane::{Lane, LaneQuery, Mask, Real};
use crate::math::{ldl, tree};
use crate::options;

/// Iterates from the smooth acceleration plus `warmstart`, or without it if that costs less, until the lanes of `open` have
/// converged. Returns the lanes that reached the limit of iterations.
pub fn solve<L: LaneQuery>(
    problem: &Problem<'_, L>,
    warmstart: &[L],
    open: L::Mask,
    code: &mut dyn Code<L>,
    work: &mut SolverWork<L>,
) -> L::Mask {
    code.contacts(problem.constraint);
    start(problem, warmstart, code, work);
    let nowhere = L::Mask::splat(false);
    work.fields.step[0] = L::zero();
    let converged = rows::follow(problem, nowhere, code, work).converged;
    let conjugate = problem.model.options.solver == options::Solver::Cg;
    let mut open = open & !converged;
    let mut landed = nowhere;
    let mut niter = L::zero();
    let mut rounds = 0;
    while L::any(open) && rounds < problem.model.options.iterations {
        niter += L::select(open, L::one(), L::zero());
        if conjugate {
            cg::direction(problem, rounds == 0, work);
            if !code.motion(problem, &mut work.fields) {
                motion(problem, &mut work.fields);
            }
        } else {
            newton::direction(problem, code, work);
        }
        let full = search(problem, open, code, work);
        let Arrival { converged, still } = rows::follow(problem, open, code, work);
        if !conjugate {
            landed = landed | (open & full);
            open = open & !full;
        }
        open = open & !still & !converged;
        rounds += 1;
    }
    if L::Real::EPSILON > 1e-10 && L::any(landed) {
        refine(problem, landed, code, work);
    }
    work.statistics.niter = niter;
    work.statistics.block_niter = rounds;
    open
}

/// One more Newton step, for single precision: what rounding left in the gradient goes through the factor at hand. That
/// is the factor at their solution for the lanes of `landed`, which took a full step within one quadratic piece.
fn refine<L: LaneQuery>(problem: &Problem<'_, L>, landed: L::Mask, code: &mut dyn Code<L>, work: &mut SolverWork<L>) {
    if !code.polish(problem, &mut work.fields) {
        newton::polish(problem, pattern(problem, &mut work.fill), &mut work.fields);
    }
    rows::approach(problem, code, work);
    work.fields.step[0] = L::one();
    rows::follow(problem, landed, code, work);
}

/// Sets M p of the search direction p, slopes and curvature along it, and the motion of every link with p.
pub fn motion<L: Lane>(problem: &Problem<'_, L>, solver: &mut Solver<L>) {
    let Problem { model, position, inertia, acceleration, .. } = problem;
    let Solver { search, msearch, along, twist, ma, gradient, .. } = solver;
    ldl::multiply(&model.rows, &model.tree_pattern, &inertia.m, search, msearch);
    let (mut slope, mut curvature, mut descent) = (L::zero(), L::zero(), L::zero());
    for i in 0..search.len() {
        slope = search[i].mul_add(ma[i] - acceleration.qfrc_smooth[i], slope);
        curvature = search[i].mul_add(msearch[i], curvature);
        descent = search[i].mul_add(gradient[i], descent);
    }
    along.copy_from_slice(&[slope, curvature, descent]);
    tree::twists(model, &position.cdof, search, twist);
}

/// Chooses the start: sets qacc, M qacc and y.
fn start<L: LaneQuery>(problem: &Problem<'_, L>, warmstart: &[L], code: &mut dyn Code<L>, work: &mut SolverWork<L>) {
    let Problem { model, position, acceleration, .. } = problem;
    let SolverWork { fields, y, jp, .. } = work;
    let smooth = &acceleration.qacc_smooth;
    tree::twists(model, &position.cdof, smooth, &mut fields.twist);
    let cold = rows::survey(problem, smooth, &fields.twist, code, jp);
    for (warm, (smooth, change)) in fields.search.iter_mut().zip(smooth.iter().zip(warmstart)) {
        *warm = *smooth + *change;
    }
    if !code.motion(problem, fields) {
        motion(problem, fields);
    }
    let Solver { qacc, ma, twist, search: warm, msearch: mwarm, .. } = fields;
    let mut twice = rows::survey(problem, warm, twist, code, y);
    for i in 0..ma.len() {
        twice = warmstart[i].mul_add(mwarm[i] - acceleration.qfrc_smooth[i], twice);
    }
    let use_warm = if model.options.flags.warmstart { twice.lt(cold) } else { L::Mask::splat(false) };
    for i in 0..ma.len() {
        qacc[i] = L::select(use_warm, warm[i], smooth[i]);
        ma[i] = L::select(use_warm, mwarm[i], acceleration.qfrc_smooth[i]);
    }
    for (y, cold) in y.dof.iter_mut().zip(&jp.dof).chain(y.component.iter_mut().zip(&jp.component)) {
        *y = L::select(use_warm, *y, *cold);
    }
}

/// Whether the gradient is below the tolerance, scaled by the model's inertia, or lost in rounding.
pub(super) fn converged<L: Lane>(problem: &Problem<'_, L>, solver: &Solver<L>) -> L::Mask {
    let Problem { model, acceleration, .. } = problem;
    let (mut gradient, mut size) = (L::zero(), L::zero());
    for i in 0..solver.gradient.len() {
        let (g, a, b) = (solver.gradient[i], solver.ma[i], solver.qfrc_constraint[i]);
        let c = acceleration.qfrc_smooth[i];
        gradient = g.mul_add(g, gradient);
        size = c.mul_add(c, b.mul_add(b, a.mul_add(a, size)));
    }
    let bound = L::of(model.options.tolerance) * L::splat(model.mean_inertia) * L::of(model.sizes.nv as f64);
    let rounding = L::of(2.0 * L::Real::EPSILON);
    gradient.sqrt().le(bound) | gradient.le(rounding * rounding * size)
}

/// Finds the step along the search direction to the minimum, in the lanes of `open`. Returns those that take a full step on
/// which no row leaves its quadratic piece.
fn search<L: LaneQuery>(
    problem: &Problem<'_, L>,
    open: L::Mask,
    code: &mut dyn Code<L>,
    work: &mut SolverWork<L>,
) -> L::Mask {
    let options = &problem.model.options;
    rows::approach(problem, code, work);
    let Solver { along, step, .. } = &mut work.fields;
    let (slope, curvature, descent) = (along[0], along[1], along[2]);
    // Newton's direction is no worse after a rough search; conjugacy is lost by one.
    let conjugate = options.solver == options::Solver::Cg;
    let precision = options.ls_tolerance * if conjugate { 1e-6 } else { 1.0 };
    let tolerance = descent.abs() * L::of(precision.max(8.0 * L::Real::EPSILON));
    let full = if conjugate { L::Mask::splat(false) } else { work.edges.unchanged() };
    let searching = open & !full;
    let alpha = if L::any(searching) {
        work.edges.search(slope, curvature, tolerance, options.ls_iterations, searching)
    } else {
        L::one()
    };
    step[0] = L::select(searching, alpha, L::one());
    full
}
