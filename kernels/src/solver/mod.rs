//! Constraint solvers: the acceleration that minimises ½(a - a₀)ᵀM(a - a₀) + s(Ja - a_ref), with s the convex cost of the
//! rows (Todorov, Convex and analytically-invertible dynamics with contacts and constraints, ICRA 2014).
//!
//! [Drivers](crate::drivers::solver) iterate until every world of the block has converged; a world that has is frozen by a mask, so its bits do not
//! depend on how long its neighbours take.

mod anderson;
mod cg;
pub mod cone;
pub mod contact;
mod dual;
pub mod edges;
mod equality;
mod fill;
pub(crate) mod hessian;
mod inverse;
pub mod joints;
mod line;
mod newton;
pub mod noslip;
pub mod pgs;
mod primal;
mod probe;
mod qcqp;
mod residual;
mod rows;
pub mod sparse;
mod tiles;
mod tiling;
mod whitened;

pub use anderson::Anderson;
pub use cg::conjugate;
pub use dual::{Dual, finish, needed, prepare};
pub use fill::Fill;
pub use hessian::{couple, couple_row, curve};
pub use inverse::{force_at, stiffness_at};
pub use line::{LINE, Line};
pub use newton::{descend, polish, settle};
pub use primal::{choose, depart, motion};
pub use probe::{Trial, probe};
pub use residual::measure_residual;
pub use rows::{Arrival, catch_up, gather};
pub use tiles::{
    Tile, aim, backward, backward_tile, clear, couple_tile, eliminate, forward, forward_tile, panel, pivot, spread,
};
pub use tiling::{Phase, Stretch, Tiling, Work, prototype};
pub use whitened::{Layout, Whitened};

use crate::acceleration::Acceleration;
use crate::constraint::{Constraint, grow};
use crate::fields::fields;
use crate::inertia::Inertia;
use crate::lane::Lane;
use crate::model::{Capacity, Instance, Model, NONE, Pattern, Sides};
use crate::options;
use crate::position::Position;
use crate::stage::Stage;
use crate::tendon::Tendons;

fields! {
    /// Vectors and matrices of the solver.
    pub struct Solver(sizes) {
        /// Acceleration with constraints.
        pub qacc: Vec<L> = sizes.nv,
        /// Σ Jᵀf: generalised force of the constraints.
        pub qfrc_constraint: Vec<L> = sizes.nv,
        /// The same of contacts between trees at the current iterate; zero once that has been passed on.
        pub pull: Vec<L> = sizes.nv,
        /// M a of the current iterate.
        pub ma: Vec<L> = sizes.nv,
        /// Gradient of the cost.
        pub gradient: Vec<L> = sizes.nv,
        /// Search direction p.
        pub search: Vec<L> = sizes.nv,
        /// M p.
        pub msearch: Vec<L> = sizes.nv,
        /// Hessian, then its factor, stored by `model.rows`.
        pub hessian: Vec<L> = sizes.nm,
        /// The same where trees touch, by [tiles](crate::model::Tiles).
        pub tiles: Vec<L> = sizes.ntile,
        /// Of these, the multipliers of the strip that is eliminated.
        pub panel: Vec<L> = sizes.npanel,
        /// D⁻¹ of that factor.
        pub inverse: Vec<L> = sizes.nv,
        /// Scratch.
        pub multipliers: Vec<L> = sizes.nv,
        /// M⁻¹ times the gradient (conjugate gradients).
        pub scaled: Vec<L> = sizes.nv,
        /// Gradient of the last iterate (conjugate gradients).
        pub last_gradient: Vec<L> = sizes.nv,
        /// M⁻¹ times that gradient (conjugate gradients).
        pub last_scaled: Vec<L> = sizes.nv,
        /// Per link: motion of the vector that is mapped to the rows.
        pub twist: Vec<[L; 6]> = sizes.nlink,
        /// The same without the warm start.
        pub cold_twist: Vec<[L; 6]> = sizes.nlink,
        /// Per link: force of contacts on it and all that it carries; zero once that has been passed on.
        pub wrench: Vec<[L; 6]> = sizes.nlink,
        /// Per link: stiffness JᵀDJ of contacts on it and all that it carries, lower triangle by rows; zero once that has been
        /// passed on.
        pub stiffness: Vec<[L; 21]> = sizes.nlink,
    } L
}

/// What a solver solves: the model and the stages that it reads.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a, L: Lane> {
    /// Model.
    pub model: Instance<'a, L>,
    /// Mean inertia, which scales tolerances.
    pub mean_inertia: L,
    /// Poses and dof axes.
    pub position: &'a Position<L>,
    /// Tendons.
    pub tendons: &'a Tendons<L>,
    /// Inertia matrix.
    pub inertia: &'a Inertia<L>,
    /// Smooth force and acceleration.
    pub acceleration: &'a Acceleration<L>,
    /// Rows.
    pub constraint: &'a Constraint<L>,
}

/// Row quantities of one iterate: per dof row and per contact component.
#[derive(Clone, Debug)]
pub struct RowVector<L> {
    /// Per dof row.
    pub dof: Vec<L>,
    /// Per contact component; never shorter than it once was, as the lists of [`Constraint`].
    pub component: Vec<L>,
    /// Per row of equality constraints.
    pub equality: Vec<L>,
}

impl<L: Lane> RowVector<L> {
    fn with_capacity([dof, component, equality]: [usize; 3]) -> Self {
        let equality = vec![L::zero(); equality];
        RowVector { dof: Vec::with_capacity(dof), component: Vec::with_capacity(component), equality }
    }

    /// Sets the lengths to those of the constraint's lists, which those of contacts never exceed.
    pub(crate) fn fit(&mut self, constraint: &Constraint<L>) {
        self.dof.resize(constraint.dof_rows.len(), L::zero());
        grow(&mut self.component, constraint.reference.len(), L::zero());
    }
}

/// Statistics of a solve, per world.
#[derive(Clone, Copy, Debug)]
pub struct Statistics<L> {
    /// Iterations.
    pub niter: L,
    /// Iterations of the slowest world of the block.
    pub block_niter: u32,
    /// ‖gradient of the primal cost‖ / (mean inertia · nv) at the acceleration found, if it was asked for: what Newton's
    /// method and conjugate gradients hold against the tolerance.
    pub residual: L,
}

impl<L: Lane> Statistics<L> {
    /// Those of a solve that had nothing to do.
    pub fn none() -> Self {
        Statistics { niter: L::zero(), block_niter: 0, residual: L::zero() }
    }
}

/// Everything that a solver needs beyond the constraint's rows.
#[derive(Clone, Debug)]
pub struct SolverWork<L: Lane> {
    /// Vectors and matrices.
    pub fields: Solver<L>,
    /// y = J a - a_ref of the current iterate.
    pub y: RowVector<L>,
    /// J p.
    pub jp: RowVector<L>,
    /// Force: per dof row, and per contact component.
    pub force: RowVector<L>,
    /// Forces at the acceleration found, for the residual and for whoever wants to know them; empty until then.
    pub spare: RowVector<L>,
    /// What is known along p.
    pub line: Line<L>,
    /// Force of each edge of the pyramidal contacts, contact by contact (of primal solvers if anyone wants to know); never shorter
    /// than it once was.
    pub edge_force: Vec<L>,
    /// Inverse inertia in row space (dual solvers and the no-slip pass).
    pub dual: dual::Dual<L>,
    /// What the last sweeps of projected Gauss-Seidel did.
    pub past: anderson::Anderson<L>,
    /// Pattern of the Hessian when contacts join branches.
    pub fill: Fill,
    /// What is done with the tiles of the Hessian.
    pub tiling: Tiling,
    /// Hessians of worlds that have their own.
    pub sparse: sparse::Sparse<L>,
    /// Links with contacts in the block, or carrying such links.
    pub touched: Vec<bool>,
    /// Statistics of the last solve.
    pub statistics: Statistics<L>,
}

impl<L: Lane> SolverWork<L> {
    /// Sets the lengths to those of the constraint's lists.
    pub fn fit(&mut self, constraint: &Constraint<L>) {
        self.y.fit(constraint);
        self.jp.fit(constraint);
        self.force.fit(constraint);
        self.dual.fit(constraint);
    }

    /// Room for the rows that the model can have.
    pub fn new(model: &Model<L::Real>) -> Self {
        let Capacity { contacts, dof_rows: dof, components: component, .. } = model.capacity();
        let rows = [dof, component, model.sizes.ne];
        let sizes = Stage::Solver.sizes(model);
        SolverWork {
            fields: Solver::new(&sizes),
            y: RowVector::with_capacity(rows),
            jp: RowVector::with_capacity(rows),
            force: RowVector::with_capacity(rows),
            spare: RowVector::with_capacity(rows),
            line: Line::new(),
            edge_force: Vec::with_capacity(2 * component),
            dual: dual::Dual::new(model, rows, contacts),
            past: match point(model) {
                0 => anderson::Anderson::new(),
                len => anderson::Anderson::with_capacity(len),
            },
            fill: Fill::new(model),
            tiling: Tiling::default(),
            sparse: sparse::Sparse::default(),
            touched: vec![false; model.sizes.nlink],
            statistics: Statistics::none(),
        }
    }

    /// Bytes of that.
    pub fn bytes(model: &Model<L::Real>) -> usize {
        let Capacity { contacts, dof_rows: dof, components: component, .. } = model.capacity();
        let all = dof + component + model.sizes.ne;
        let rows = (4 * all + 2 * component) * size_of::<L>() + model.sizes.nlink;
        let past = anderson::Anderson::<L>::bytes(point(model));
        let fields = Solver::<L>::bytes(&Stage::Solver.sizes(model));
        fields.saturating_add(
            rows + past
                + dual::Dual::<L>::bytes(model, [dof, component, model.sizes.ne], contacts)
                + Fill::bytes(model)
                + sparse::bytes(model, size_of::<L>() / size_of::<L::Real>()),
        )
    }
}

/// Finds the links with contacts, and those that carry them.
pub fn touch<L: Lane>(model: &Model<L::Real>, constraint: &Constraint<L>, work: &mut SolverWork<L>) {
    work.touched.fill(false);
    for row in constraint.contact_rows.iter().filter(|row| row.sides != Sides::Apart) {
        for mut l in [row.link, row.other] {
            while l != NONE && !work.touched[l as usize] {
                work.touched[l as usize] = true;
                l = model.links[l as usize].parent;
            }
        }
    }
}

/// Length of the points that acceleration of sweeps remembers: forces and accelerations; 0 for solvers without.
fn point<T: crate::lane::Real>(model: &Model<T>) -> usize {
    let Capacity { dof_rows: dof, components: component, .. } = model.capacity();
    if model.options.solver == options::Solver::Pgs { dof + 2 * component + model.sizes.ne + model.sizes.nv } else { 0 }
}

/// The pattern of the Hessian when all rows act that join branches, wider than any that a step can need; `None` if there are
/// none.
pub fn fullest_pattern<T>(model: &Model<T>) -> Option<Pattern> {
    let joining: Vec<u32> = (0..model.pairs.len() as u32).filter(|p| model.pairs[*p as usize].cross).collect();
    fill::joins(model).then(|| {
        let mut fill = Fill::new(model);
        fill.find(model, joining.into_iter());
        fill.pattern
    })
}
