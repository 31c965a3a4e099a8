//! Sweeps over the dual problem: projected Gauss-Seidel, and the pass without slip.

use super::Outcome;
use crate::lane::{Lane, LaneQuery};
use crate::options;
use crate::part::Step;
use crate::solver::{self, noslip, pgs};

/// What turns an improvement of the cost into MuJoCo's measure.
fn scale<L: Lane>(step: &Step<'_, L>) -> L {
    L::one() / (step.model.mean_inertia() * L::of((step.model.sizes.nv as f64).max(1.0)))
}

/// Projected Gauss-Seidel, until the worlds of `open` have converged: a sweep improves the cost by less than the tolerance.
pub fn sweeps<L: LaneQuery>(step: &mut Step<'_, L>, open: u32) -> Outcome<L> {
    let scale = scale(step);
    let options = &step.model.model.options;
    let tolerance = L::of(options.tolerance);
    let (problem, warmstart, work) = step.solver();
    pgs::start(&problem, warmstart, work);
    let mut open = L::mask_of(open);
    let (mut niter, mut rounds) = (L::zero(), 0);
    let mut past = std::mem::take(&mut work.past);
    past.begin(&problem, work);
    while L::any(open) && rounds < options.iterations {
        rounds += 1;
        niter += L::select(open, L::one(), L::zero());
        past.before(problem.constraint, work);
        let improvement = pgs::sweep(&problem, open, work);
        open = open & !(improvement * scale).lt(tolerance);
        past.accelerate(&problem, open, work);
    }
    work.past = past;
    solver::finish(&problem, work);
    Outcome { open: L::bits(open), niter, rounds, ahead: 0 }
}

/// Sweeps over friction until a sweep improves the cost by less than the no-slip tolerance, in the worlds of `open`.
pub fn noslip<L: LaneQuery>(step: &mut Step<'_, L>, open: u32) {
    let scale = scale(step);
    let options = &step.model.model.options;
    let tolerance = L::of(options.noslip_tolerance);
    let (problem, _, work) = step.solver();
    if options.solver != options::Solver::Pgs {
        solver::prepare(&problem, work);
    }
    let mut open = L::mask_of(open);
    for _ in 0..options.noslip_iterations {
        if !L::any(open) {
            break;
        }
        let improvement = noslip::sweep(&problem, open, work);
        open = open & !(improvement * scale).lt(tolerance);
    }
    solver::finish(&problem, work);
}
