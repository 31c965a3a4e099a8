//! Drivers: what asks whether any world needs something, and runs the parts for those that do. Only they know lists of pairs
//! and of contacts, and loops that end when worlds have converged.

pub mod collision;
pub mod constraint;
mod dual;
pub mod solver;
