//! Parts of a step as code made for the model: straight lines in place of loops over its tables.

use crate::constraint::Constraint;
use crate::lane::LaneQuery;
use crate::solver::contact::Contacts;
use crate::solver::edges::Edges;
use crate::solver::{Problem, Solver};
use crate::state::{Applied, State};
use crate::workspace::Workspace;

/// Code that stands in for parts of a step. Every part does what the kernel that its documentation names does, with the
/// same results up to signs of zeros. A part for which there is no code says so, and the kernel runs.
pub trait Code<L: LaneQuery> {
    /// [`smooth`](crate::pipeline::smooth): returns the lanes with unusable controls and those with a singular inertia.
    /// Unless `keep`, only what later parts of a step read is written.
    fn smooth(&mut self, _: &State<L>, _: Option<&Applied<L>>, _keep: bool, _: &mut Workspace<L>) -> Option<[u32; 2]> {
        None
    }

    /// [`integration::euler`](crate::integration::euler) from the solver's acceleration and the sum of forces.
    fn euler(&mut self, _: &State<L>, _: &mut Workspace<L>) -> bool {
        false
    }

    /// [`solver::motion`](crate::solver::motion) of the search direction.
    fn motion(&mut self, _: &Problem<'_, L>, _: &mut Solver<L>) -> bool {
        false
    }

    /// [`solver::curve`](crate::solver::curve), with contacts on any link.
    fn curve(&mut self, _: &Problem<'_, L>, _: &mut Solver<L>) -> bool {
        false
    }

    /// [`solver::descend`](crate::solver::descend).
    fn descend(&mut self, _: &Problem<'_, L>, _: &mut Solver<L>) -> bool {
        false
    }

    /// [`solver::polish`](crate::solver::polish).
    fn polish(&mut self, _: &Problem<'_, L>, _: &mut Solver<L>) -> bool {
        false
    }

    /// [`solver::gather`](crate::solver::gather), with contacts on any link: returns the lanes that have converged, and
    /// those that stood still.
    fn gather(&mut self, _: &Problem<'_, L>, _open: u32, _: &mut Solver<L>) -> Option<[u32; 2]> {
        None
    }

    /// A solve begins: the contacts that the next four are called for, as [`Contacts::runs`] has them.
    fn contacts(&mut self, _: &Constraint<L>) {}

    /// [`contact::survey`](crate::solver::contact::survey) of the contacts: motions of links, y, twice the cost.
    fn survey(
        &mut self,
        _: &Constraint<L>,
        _: Contacts<'_>,
        _twist: &[[L; 6]],
        _y: &mut [L],
        _twice: &mut [L; 1],
    ) -> bool {
        false
    }

    /// [`contact::approach`](crate::solver::contact::approach) of the contacts: motions of links, y, J p.
    fn approach(
        &mut self,
        _: &Constraint<L>,
        _: Contacts<'_>,
        _twist: &[[L; 6]],
        _y: &[L],
        _jp: &mut [L],
        _: &mut Edges<L>,
    ) -> bool {
        false
    }

    /// [`contact::act`](crate::solver::contact::act) of the contacts: J p, y, forces, forces on links.
    #[allow(clippy::too_many_arguments)] // all that contacts have
    fn act(
        &mut self,
        _: &Constraint<L>,
        _: Contacts<'_>,
        _step: L,
        _open: u32,
        _jp: &[L],
        _y: &mut [L],
        _force: &mut [L],
        _wrench: &mut [[L; 6]],
    ) -> bool {
        false
    }

    /// [`contact::stiffen`](crate::solver::contact::stiffen) of the contacts: y, stiffnesses of links.
    fn stiffen(&mut self, _: &Constraint<L>, _: Contacts<'_>, _y: &[L], _stiffness: &mut [[L; 21]]) -> bool {
        false
    }

    /// Whether `curve` and `gather` want the forces and stiffnesses of links without contacts to be zero.
    fn every_link(&self) -> bool {
        false
    }
}

/// No code: kernels do everything.
#[derive(Clone, Copy, Debug)]
pub struct Kernels;

impl<L: LaneQuery> Code<L> for Kernels {}
