//! Parts of a step as code made for the model: straight lines in place of loops over its tables.

use std::sync::Arc;

use crate::collision::{Collision, Found, Near};
use crate::constraint::{Constraint, ContactRow, Motion};
use crate::lane::LaneQuery;
use crate::model::{Model, Quantities, Varied};
use crate::pipeline::Findings;
use crate::position::Position;
use crate::solver::contact::Contacts;
use crate::solver::{Problem, Rounds, SolverWork};
use crate::state::{Applied, State};
use crate::workspace::Workspace;

/// What acts on a block from outside: forces, and numbers of the model that vary.
pub type Outside<'a, L> = (Option<&'a Applied<L>>, Option<&'a Varied<L>>);

/// Code that stands in for parts of a step. Every part does what the kernel that its documentation names does, with the
/// same results up to signs of zeros. A part for which there is no code says so, and the kernel runs.
pub trait Code<L: LaneQuery> {
    /// From now on these quantities vary from world to world, within the structure of `model`.
    fn vary(&mut self, _model: &Arc<Model<L::Real>>, _: Quantities) {}

    /// [`smooth`](crate::pipeline::smooth). Unless `keep`, only what later parts of a step read is written.
    fn smooth(&mut self, _: &State<L>, _: Outside<'_, L>, _keep: bool, _: &mut Workspace<L>) -> Option<Findings<u32>> {
        None
    }

    /// Number of groups of pairs whose bounding tests have code; 0: kernels test all pairs.
    fn groups(&self) -> usize {
        0
    }

    /// [`collision::near_pairs`](crate::collision::near_pairs) of a group: writes, for its pairs, the worlds of `alive` in
    /// which they are near, and the gaps. Returns whether any is near.
    fn near(&mut self, _group: usize, _: &Position<L>, _alive: u32, _near: &mut [u32], _gaps: &mut [L; 2]) -> bool {
        false
    }

    /// [`collision::points`](crate::collision::points), or [`collision::capsules`](crate::collision::capsules) where
    /// some are parallel, of the pairs that have a formula in lanes.
    fn narrow(&mut self, _: &Position<L>, _: &[Near], _: &mut [Found<L>]) -> bool {
        false
    }

    /// [`integration::euler`](crate::integration::euler) from the solver's acceleration and the sum of forces, and
    /// [`commit`](crate::pipeline::commit) in the worlds of `alive`: returns those whose next state was usable.
    fn euler(&mut self, _: &mut State<L>, _: Option<&Varied<L>>, _alive: u32, _: &mut Workspace<L>) -> Option<u32> {
        None
    }

    /// [`constraint::dof_lanes`](crate::constraint::dof_lanes), of all rows on joints that the model has.
    fn dof_rows(&mut self, _: &State<L>, _: Option<&Varied<L>>, _: &mut Constraint<L>) -> bool {
        false
    }

    /// [`constraint::still_side`](crate::constraint::still_side) of all listed contacts one side of which stands still.
    fn still_sides(
        &mut self,
        _: Motion<'_, L>,
        _: &Collision<L>,
        _: Option<&Varied<L>>,
        _: &mut Constraint<L>,
    ) -> bool {
        false
    }

    /// [`constraint::both_sides`](crate::constraint::both_sides) of a listed contact with both sides in one tree.
    fn both_sides(
        &mut self,
        _: Motion<'_, L>,
        _: (&Collision<L>, &ContactRow),
        _: Option<&Varied<L>>,
        _: &mut Constraint<L>,
    ) -> bool {
        false
    }

    /// A solve begins: the contacts that the following are called for, as [`Contacts::runs`] has them.
    fn contacts(&mut self, _: &Constraint<L>) {}

    /// A part of the solver, from the lanes that the kernel takes to those that it returns.
    fn solver(
        &mut self,
        _: SolverPart,
        _: &Problem<'_, L>,
        _warmstart: &[L],
        _open: u32,
        _: &mut SolverWork<L>,
    ) -> Option<[u32; 2]> {
        None
    }

    /// A part of the solver for all contacts of a kind.
    fn contact(
        &mut self,
        _: ContactPart,
        _: Contacts<'_>,
        _: &Problem<'_, L>,
        _open: u32,
        _: &mut SolverWork<L>,
    ) -> bool {
        false
    }

    /// [`solver::couple`](crate::solver::couple) of a contact.
    fn couple(&mut self, _: &Problem<'_, L>, _: &ContactRow, _: &mut SolverWork<L>) -> bool {
        false
    }

    /// Calls back with all parts of Newton's iteration, made ready once.
    fn rounds(
        &mut self,
        _: &Problem<'_, L>,
        _warmstart: &[L],
        _: &mut SolverWork<L>,
        _run: &mut dyn FnMut(&mut dyn Rounds),
    ) -> bool {
        false
    }
}

/// Part of the solver, after the kernels of the same names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolverPart {
    /// [`depart`](crate::solver::depart).
    Depart,
    /// [`choose`](crate::solver::choose).
    Choose,
    /// [`motion`](crate::solver::motion).
    Motion,
    /// [`curve`](crate::solver::curve), then [`descend`](crate::solver::descend): if of every contact one side stands still.
    Turn,
    /// [`curve`](crate::solver::curve).
    Curve,
    /// [`descend`](crate::solver::descend).
    Descend {
        /// On the fullest pattern that contacts can fill in, or on the inertia matrix's.
        filled: bool,
    },
    /// [`polish`](crate::solver::polish).
    Polish {
        /// The same.
        filled: bool,
    },
    /// [`probe`](crate::solver::probe).
    Probe {
        /// Of a full step.
        first: bool,
    },
    /// [`gather`](crate::solver::gather).
    Gather,
}

/// Part of the solver for a contact, after the kernels of the same names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactPart {
    /// [`contact::survey`](crate::solver::contact::survey).
    Survey,
    /// [`contact::choose`](crate::solver::contact::choose).
    Choose,
    /// [`contact::approach`](crate::solver::contact::approach).
    Approach,
    /// [`edges::slope`](crate::solver::edges::slope).
    Slope,
    /// [`contact::act`](crate::solver::contact::act).
    Act,
    /// [`contact::stiffen`](crate::solver::contact::stiffen).
    Stiffen,
}

/// No code: kernels do everything.
#[derive(Clone, Copy, Debug)]
pub struct Kernels;

impl<L: LaneQuery> Code<L> for Kernels {}
