//! Sweeps over the dual problem: projected Gauss-Seidel, and the pass without slip.

use std::iter;

use super::Outcome;
use crate::lane::{Lane, LaneQuery};
use crate::options;
use crate::part::{Executor, Item, Op, Part, Step};
use crate::solver::{self, pgs};

/// What turns an improvement of the cost into MuJoCo's measure.
fn scale<L: Lane>(step: &Step<'_, L>) -> L {
    L::one() / (step.model.mean_inertia() * L::of((step.model.sizes.nv as f64).max(1.0)))
}

/// Projected Gauss-Seidel, until the worlds of `open` have converged: a sweep improves the cost by less than the tolerance.
pub fn sweeps<L: LaneQuery>(step: &mut Step<'_, L>, mut open: u32, executor: &mut dyn Executor<L>) -> Outcome<L> {
    let scale = scale(step);
    let options = &step.model.model.options;
    let tolerance = L::of(options.tolerance);
    let (problem, warmstart, work) = step.solver();
    pgs::start(&problem, warmstart, work);
    let (mut niter, mut rounds) = (L::zero(), 0);
    let mut past = std::mem::take(&mut work.past);
    past.begin(&problem, work);
    while open != 0 && rounds < options.iterations {
        rounds += 1;
        niter += L::select(L::mask_of(open), L::one(), L::zero());
        let gain = sweep(Op::Push, open, step, executor);
        open &= !L::bits((gain * scale).lt(tolerance));
        if open != 0 {
            let (problem, _, work) = step.solver();
            past.accelerate(&problem, (open, L::mask_of(open)), work);
        }
    }
    step.ws.solver.past = past;
    let (problem, _, work) = step.solver();
    solver::finish(&problem, work);
    Outcome { open, niter, rounds, ahead: 0 }
}

/// Sweeps over friction until a sweep improves the cost by less than the no-slip tolerance, in the worlds of `open`.
pub fn noslip<L: LaneQuery>(step: &mut Step<'_, L>, mut open: u32, executor: &mut dyn Executor<L>) {
    let scale = scale(step);
    let options = &step.model.model.options;
    let tolerance = L::of(options.noslip_tolerance);
    if options.solver != options::Solver::Pgs {
        let (problem, _, work) = step.solver();
        solver::prepare(&problem, work);
    }
    for _ in 0..options.noslip_iterations {
        if open == 0 {
            break;
        }
        let gain = sweep(Op::Hold, open, step, executor);
        open &= !L::bits((gain * scale).lt(tolerance));
    }
    let (problem, _, work) = step.solver();
    solver::finish(&problem, work);
}

/// One pass over the rows in the worlds of `open`, contact by contact in the order of the list. Rows that act in none of these are passed
/// over: their forces do not change. Returns by how much the cost has fallen.
fn sweep<L: LaneQuery>(of_contact: Op, open: u32, step: &mut Step<'_, L>, executor: &mut dyn Executor<L>) -> L {
    let (constraint, dual) = (&mut step.ws.constraint, &mut step.ws.solver.dual);
    let of_rows = match of_contact {
        Op::Hold => 1,
        _ if (constraint.joint_lanes | constraint.equality.lanes) & open != 0 => 0,
        _ => 2,
    };
    let (rows, places) = (std::mem::take(&mut constraint.contact_rows), std::mem::take(&mut dual.places));
    executor.run(Part::of(Op::Sweep, of_rows), open, &mut [], step);
    let mut acting = rows.iter().zip(&places).filter(|(row, _)| row.lanes & open != 0).peekable();
    while let Some(first) = acting.next() {
        let kind = first.0.number;
        let alike = iter::from_fn(|| acting.next_if(|(row, _)| row.number == kind));
        let mut items = iter::once(first).chain(alike).map(|(row, place)| Item::Whitened(row, place));
        executor.each(Part::of(of_contact, kind), &mut items, open, step);
    }
    (step.ws.constraint.contact_rows, step.ws.solver.dual.places) = (rows, places);
    step.ws.solver.dual.gain[0]
}
