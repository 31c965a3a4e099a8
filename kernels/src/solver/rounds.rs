//! The iteration that Newton's method and conjugate gradients share, over its parts, however these are run.

use super::line::{self, Trial};
use super::rows::{self, Arrival};
use super::{Problem, SolverWork, cg, find_pattern, newton, pattern, primal};
use crate::code::{Code, SolverPart};
use crate::lane::{LaneQuery, Mask, Real};
use crate::options::{self, Options};

/// The parts of the iteration. Each leaves its results where the next looks for them. Masks are bits, as code has them.
pub trait Rounds {
    /// Chooses where to start, and takes no step.
    fn start(&mut self);
    /// Chooses the search direction in the lanes of `open`, and finds what the line search needs. `first`: there was none
    /// before.
    fn direct(&mut self, first: bool, open: u32);
    /// A last step from the factor at hand, in the lanes of `open`, for single precision. Leaves the rows where they are.
    fn polish(&mut self, open: u32);
    /// [`probe`](super::probe); finds the slope of contacts there, but for the `first` step, whose slope is known.
    fn probe(&mut self, first: bool, open: u32) -> Trial<u32>;
    /// Moves the lanes of `open` by the step, and finds forces and gradient.
    fn follow(&mut self, open: u32) -> Arrival<u32>;
}

/// How an iteration ended.
#[derive(Clone, Copy, Debug)]
pub struct Outcome<L: LaneQuery> {
    /// Lanes that reached the limit of iterations.
    pub open: u32,
    /// Iterations of each world.
    pub niter: L,
    /// Iterations of the slowest.
    pub rounds: u32,
    /// Lanes in which the acceleration is the last step ahead of the rows.
    pub ahead: u32,
}

/// Iterates until the lanes of `open` have converged.
pub fn iterate<L: LaneQuery>(options: &Options, open: u32, parts: &mut dyn Rounds) -> Outcome<L> {
    parts.start();
    let converged = parts.follow(L::bits(L::Mask::splat(true))).converged;
    let conjugate = options.solver == options::Solver::Cg;
    let mut open = open & !converged;
    let mut landed = 0;
    let mut niter = L::zero();
    let mut rounds = 0;
    while open != 0 && rounds < options.iterations {
        niter += L::select(L::mask_of(open), L::one(), L::zero());
        parts.direct(rounds == 0, open);
        let full = search(options, open, parts);
        let Arrival { converged, still } = parts.follow(open);
        landed |= open & full;
        open &= !(full | still | converged);
        rounds += 1;
    }
    // One more Newton step, for single precision: what rounding left in the gradient goes through the factor at hand. That is
    // the factor at their solution for the lanes that took a full step within one quadratic piece.
    let ahead = if !conjugate && L::Real::EPSILON > 1e-10 { landed } else { 0 };
    if ahead != 0 {
        parts.polish(ahead);
    }
    Outcome { open, niter, rounds, ahead }
}

/// Finds the step along the search direction to the minimum, in the lanes of `open`. Returns those that take a full step on
/// which no row leaves its quadratic piece.
fn search(options: &Options, open: u32, parts: &mut dyn Rounds) -> u32 {
    let mut trial = Trial { open, full: 0 };
    for round in 0..options.ls_iterations {
        let next = parts.probe(round == 0, trial.open);
        trial = Trial { open: next.open, full: trial.full | next.full };
        if trial.open == 0 {
            break;
        }
    }
    trial.full & open
}

/// The parts one by one, in kernels, or in code where there is some.
pub struct PartByPart<'a, L: LaneQuery> {
    /// What is solved.
    pub problem: &'a Problem<'a, L>,
    /// What constraints added to the smooth acceleration in the last step.
    pub warmstart: &'a [L],
    /// Code.
    pub code: &'a mut dyn Code<L>,
    /// What the solver works with.
    pub work: &'a mut SolverWork<L>,
}

impl<L: LaneQuery> Rounds for PartByPart<'_, L> {
    fn start(&mut self) {
        primal::start(self.problem, self.warmstart, self.code, self.work);
    }

    fn direct(&mut self, first: bool, _: u32) {
        let PartByPart { problem, code, work, .. } = self;
        if problem.model.options.solver == options::Solver::Cg {
            cg::direction(problem, first, work);
            if code.solver(SolverPart::Motion, problem, &[], 0, work).is_none() {
                primal::motion(problem, work);
            }
        } else {
            newton::direction(problem, *code, work);
        }
        rows::approach(problem, *code, work);
    }

    fn polish(&mut self, open: u32) {
        let PartByPart { problem, code, work, .. } = self;
        let part = SolverPart::Polish { filled: problem.constraint.cross };
        if code.solver(part, problem, &[], open, work).is_none() {
            let fill = find_pattern(problem, work);
            newton::polish(problem, pattern(problem, &fill), L::mask_of(open), work);
            work.fill = fill;
        }
    }

    fn probe(&mut self, first: bool, open: u32) -> Trial<u32> {
        let PartByPart { problem, code, work, .. } = self;
        if !first {
            rows::slope(problem, *code, work);
        }
        match code.solver(SolverPart::Probe { first }, problem, &[], open, work) {
            Some([open, full]) => Trial { open, full },
            None => {
                let Trial { open, full } = line::probe(problem, first, L::mask_of(open), work);
                Trial { open: L::bits(open), full: L::bits(full) }
            }
        }
    }

    fn follow(&mut self, open: u32) -> Arrival<u32> {
        rows::follow(self.problem, open, self.code, self.work)
    }
}
