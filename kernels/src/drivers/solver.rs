//! The constrained acceleration: which solver, what it needs, and its iterations.

use super::{Outcome, dual};
use crate::constraint::ContactRow;
use crate::lane::{LaneQuery, Real};
use crate::model::Sides;
use crate::options::{self, Options};
use crate::part::{Executor, Factor, OneByOne, Op, Part, Parts, Step};
use crate::solver::{self, Arrival, Phase, Solver, Statistics, Trial, pgs};

/// All worlds of a block.
const ALL: u32 = u32::MAX;

/// Solves for `qacc` and `qfrc_constraint` in the worlds of `alive`: what the listed rows add to the smooth acceleration. The
/// solver starts from what they added in the last step: with controls that change all the time it says more about this step
/// than the last acceleration itself. Worlds without active rows keep the smooth acceleration. `residual`: whether that is
/// wanted. Unless `keep`, forces of rows may be those of the acceleration before a last small step. Returns the worlds that
/// reached the limit of iterations.
pub fn solve<L: LaneQuery>(
    step: &mut Step<'_, L>,
    alive: u32,
    (residual, keep): (bool, bool),
    executor: &mut dyn Executor<L>,
) -> u32 {
    let (constraint, work) = (&step.ws.constraint, &mut step.ws.solver);
    if constraint.is_empty() {
        pass_on(step);
        return 0;
    }
    work.fit(constraint);
    solver::touch(step.model.model, constraint, work);
    let options = &step.model.model.options;
    let active = constraint.joint_lanes | constraint.contact_lanes | constraint.equality.lanes;
    let open = alive & active;
    let mut outcome = Outcome { open, niter: L::zero(), rounds: 0, ahead: 0 };
    let primal = options.solver != options::Solver::Pgs;
    if primal {
        let mut run = |parts: &mut dyn Parts| outcome = iterate(options, open, parts);
        if !executor.solve(step, &mut run) {
            OneByOne::run(executor, step, &mut run);
        }
        if keep || options.noslip_iterations > 0 {
            let (problem, _, work) = step.solver();
            if outcome.ahead != 0 {
                solver::catch_up(&problem, L::mask_of(outcome.ahead), work);
            }
            pgs::edge_forces(problem.constraint, work);
        }
    } else {
        outcome = dual::sweeps(step, open, executor);
    }
    if options.noslip_iterations > 0 {
        dual::noslip(step, open, executor);
    }
    finish(step, active);
    step.ws.solver.statistics = Statistics { niter: outcome.niter, block_niter: outcome.rounds, ..Statistics::none() };
    if residual {
        let (problem, _, work) = step.solver();
        solver::measure_residual(&problem, L::mask_of(active), work);
    }
    outcome.open
}

/// Passes on the smooth acceleration where no row acts in any world.
fn pass_on<L: LaneQuery>(step: &mut Step<'_, L>) {
    let Solver { qacc, qfrc_constraint, .. } = &mut step.ws.solver.fields;
    qacc.copy_from_slice(&step.ws.acceleration.qacc_smooth);
    qfrc_constraint.fill(L::zero());
    step.ws.solver.statistics = Statistics::none();
}

/// Passes on the smooth acceleration in the worlds in which no row acts.
fn finish<L: LaneQuery>(step: &mut Step<'_, L>, active: u32) {
    let (active, smooth) = (L::mask_of(active), &step.ws.acceleration.qacc_smooth);
    let Solver { qacc, qfrc_constraint, search, .. } = &mut step.ws.solver.fields;
    // Chosen in another place, then copied: of a choice between what is stored and what was there, compilers make a masked
    // store, which takes many times as long.
    let mut keep = |own: &mut [L], other: &dyn Fn(usize) -> L| {
        for (i, (chosen, own)) in search.iter_mut().zip(&*own).enumerate() {
            *chosen = L::select(active, *own, other(i));
        }
        own.copy_from_slice(search);
    };
    keep(qacc, &|i| smooth[i]);
    keep(qfrc_constraint, &|_| L::zero());
}

/// The iteration that Newton's method and conjugate gradients share, until the worlds of `open` have converged.
fn iterate<L: LaneQuery>(options: &Options, open: u32, parts: &mut dyn Parts) -> Outcome<L> {
    start(parts);
    let converged = follow(ALL, ALL, parts).converged;
    let conjugate = options.solver == options::Solver::Cg;
    let mut open = open & !converged;
    let mut landed = 0;
    let mut factor = Factor::Tree;
    let mut niter = L::zero();
    let mut rounds = 0;
    while open != 0 && rounds < options.iterations {
        niter += L::select(L::mask_of(open), L::one(), L::zero());
        if conjugate {
            parts.run(Part::of(Op::Conjugate, u32::from(rounds == 0)), [0, open]);
        } else {
            factor = direct::<L>(open, parts);
        }
        parts.each(Op::Approach, open, [0, open]);
        let full = search(options, open, parts);
        let Arrival { converged, still } = follow(open, open, parts);
        landed |= open & full;
        open &= !(full | still | converged);
        rounds += 1;
    }
    // One more Newton step, for single precision: what rounding left in the gradient goes through the factor at hand. That is
    // the factor at their solution for the lanes that took a full step within one quadratic piece.
    let ahead = if !conjugate && L::Real::EPSILON > 1e-10 { landed } else { 0 };
    if ahead != 0 {
        polish(factor, ahead, parts);
    }
    Outcome { open, niter, rounds, ahead }
}

/// Chooses where to start, and takes no step.
fn start(parts: &mut dyn Parts) {
    parts.run(Part::new(Op::Depart), [ALL; 2]);
    parts.each(Op::Survey, ALL, [0, ALL]);
    let [warm, _] = parts.run(Part::new(Op::Choose), [ALL; 2]);
    parts.each(Op::Take, ALL, [warm, ALL]);
}

/// Newton's direction in the worlds of `open`, and what follows from it. Contacts that act only in worlds that no longer iterate are
/// passed over; in single precision not for the Hessian, whose factor is used once more, for worlds that no longer iterate.
/// Returns how the Hessian is factored.
fn direct<L: LaneQuery>(open: u32, parts: &mut dyn Parts) -> Factor {
    let factored = if L::Real::EPSILON > 1e-10 { ALL } else { open };
    let couples = |row: &ContactRow| row.sides != Sides::One && row.lanes & factored != 0;
    parts.each(Op::Stiffen, factored, [0, open]);
    let factor = parts.fill(factored);
    if factor == Factor::Tiles {
        parts.run(Part::new(Op::Spread), [open; 2]);
        parts.tiles(Phase::Couple, open);
        parts.run(Part::new(Op::Aim), [open; 2]);
        parts.tiles(Phase::Factor, open);
        parts.tiles(Phase::Solve, open);
        parts.run(Part::new(Op::Motion), [open; 2]);
        return factor;
    }
    if factor == Factor::Sparse {
        parts.run(Part::new(Op::Curve), [open; 2]);
        parts.sparse(false, open);
        parts.run(Part::new(Op::Motion), [open; 2]);
        return factor;
    }
    if factor == Factor::Tree && !parts.rows().iter().any(couples) {
        parts.run(Part::new(Op::Turn), [open; 2]);
        return factor;
    }
    parts.run(Part::new(Op::Curve), [open; 2]);
    parts.each(Op::Couple, factored, [0, open]);
    parts.run(Part::of(Op::Descend, u32::from(factor == Factor::Filled)), [open; 2]);
    factor
}

/// One more step from the factor at hand.
fn polish(factor: Factor, ahead: u32, parts: &mut dyn Parts) {
    match factor {
        Factor::Tiles => {
            parts.run(Part::new(Op::Aim), [ahead; 2]);
            parts.tiles(Phase::Solve, ahead);
        }
        Factor::Sparse => parts.sparse(true, ahead),
        Factor::Tree | Factor::Filled => {
            parts.run(Part::of(Op::Polish, u32::from(factor == Factor::Filled)), [ahead; 2]);
            return;
        }
    }
    parts.run(Part::new(Op::Settle), [ahead; 2]);
}

/// Finds the step along the search direction to the minimum, in the worlds of `open`. Returns those that take a full step on
/// which no row leaves its quadratic piece.
fn search(options: &Options, open: u32, parts: &mut dyn Parts) -> u32 {
    let mut trial = Trial { open, full: 0 };
    for round in 0..options.ls_iterations {
        if round > 0 {
            parts.each(Op::Slope, open, [0, trial.open]);
        }
        let [open, full] = parts.run(Part::of(Op::Probe, u32::from(round == 0)), [trial.open; 2]);
        trial = Trial { open, full: trial.full | full };
        if trial.open == 0 {
            break;
        }
    }
    trial.full & open
}

/// Moves the worlds of `open` by the step, and finds forces and gradient.
fn follow(acting: u32, open: u32, parts: &mut dyn Parts) -> Arrival<u32> {
    parts.each(Op::Act, acting, [open; 2]);
    let [converged, still] = parts.run(Part::new(Op::Gather), [open; 2]);
    Arrival { converged, still }
}
