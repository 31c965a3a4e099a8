//! Drivers: what asks whether any world needs something, and runs the parts for those that do. Only they know lists of pairs
//! and of contacts, and loops that end when worlds have converged.

pub mod collision;
pub mod constraint;
mod dual;
pub mod solver;

/// How an iteration ended.
#[derive(Clone, Copy, Debug)]
pub struct Outcome<L> {
    /// Worlds that reached the limit of iterations.
    pub open: u32,
    /// Iterations of each world.
    pub niter: L,
    /// Iterations of the slowest.
    pub rounds: u32,
    /// Worlds in which the acceleration is the last step ahead of the rows.
    pub ahead: u32,
}
