//! What forces gain with velocity, and the matrix M - h D of the implicit integrators.
//!
//! `implicitfast` takes the derivative of passive and actuator forces, which is symmetric; `implicit` that of the bias force too. Free
//! bodies that carry no joint have the latter in either case: their spin is what makes Euler's step unstable.

mod actuators;
mod bias;

use std::ops::Range;

use crate::actuation::Actuation;
use crate::fields::fields;
use crate::inertia::Inertia;
use crate::lane::Lane;
use crate::math::{ldl, lu};
use crate::model::{DofKind, Instance, Model, NONE};
use crate::options::Integrator;
use crate::passive::{damper_slope, fluid};
use crate::position::Position;
use crate::state::State;
use crate::velocity::Velocity;

fields! {
    /// M - h D, or its factors; stored by `model.rows`.
    pub struct Derivative(sizes) {
        /// Entries up to the diagonal.
        pub lower: Vec<L> = sizes.nm,
        /// Entries above it, column by column, of trees for which they differ.
        pub upper: Vec<L> = if sizes.nlink > 0 { sizes.nm } else { 0 },
        /// Reciprocals of the factors' pivots.
        pub inverse: Vec<L> = sizes.nv,
        /// Scratch of the factorisation.
        pub multipliers: Vec<L> = sizes.nv,
        /// Scratch of the bias force's: per dof, how its motion changes what its link is accelerated by.
        pub turn: Vec<[L; 6]> = if sizes.nlink > 0 { sizes.nv } else { 0 },
        /// The same: per link, and all that it carries, what its force gains with its velocity, nine numbers of a matrix from
        /// angular velocity to torque; then its momentum.
        pub gain: Vec<[L; 12]> = sizes.nlink,
    } L
}

/// The stages that it is found from.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)] // each field is the stage of the same name
pub struct Stages<'a, L> {
    pub position: &'a Position<L>,
    pub inertia: &'a Inertia<L>,
    pub velocity: &'a Velocity<L>,
    pub actuation: &'a Actuation<L>,
}

/// Whether any tree of the model has the derivative of the bias force.
pub fn of_bias<T>(model: &Model<T>) -> bool {
    trees(model).any(|tree| tree.skew)
}

/// A tree's degrees of freedom.
struct Tree {
    dofs: Range<usize>,
    /// Its links.
    links: Range<usize>,
    /// Whether the derivative of the bias force counts: the matrix is not symmetric.
    skew: bool,
}

fn trees<T>(model: &Model<T>) -> impl Iterator<Item = Tree> {
    let links = &model.links;
    let roots = (0..links.len()).filter(|l| links[*l].parent == NONE);
    roots.map(|l| {
        let carried = links[l + 1..].iter().take_while(|link| link.parent != NONE).count();
        let own = links[l].dofs.range();
        let dofs = own.start..links[l + carried].dofs.range().end;
        let free = matches!(model.dofs[own.start].kind, DofKind::FreeTranslation(_));
        let skew = match model.options.integrator {
            Integrator::Implicit => true,
            Integrator::ImplicitFast => free && carried == 0,
            Integrator::Euler | Integrator::Rk4 | Integrator::Discrete => false,
        };
        Tree { dofs, links: l..l + carried + 1, skew }
    })
}

/// Fills in M - h D.
pub fn implicit<L: Lane>(model: Instance<'_, L>, state: &State<L>, stages: Stages<'_, L>, out: &mut Derivative<L>) {
    let h = L::of(model.options.timestep);
    out.lower.copy_from_slice(&stages.inertia.m);
    if model.features.dampers {
        for (i, _) in model.dofs.iter().enumerate().filter(|(_, dof)| dof.damped) {
            let diagonal = &mut out.lower[model.rows.diagonal(i)];
            *diagonal = h.mul_add(damper_slope(model, i, state.qvel[i]), *diagonal);
        }
    }
    fluid::add_slope(&model, stages.position, stages.velocity, h, &mut out.lower);
    if model.features.actuation {
        actuators::add(model, state, stages.actuation, h, &mut out.lower);
    }
    let Derivative { lower, upper, turn, gain, .. } = out;
    if !upper.is_empty() {
        upper.copy_from_slice(lower);
    }
    for tree in trees(&model).filter(|tree| tree.skew) {
        bias::add(&model, &tree, &state.qvel, stages, h, bias::Target { lower, upper, turn, gain });
    }
}

/// y = (M - h D) x, of what is not factored.
pub fn multiply<L: Lane>(model: &Model<L::Real>, derivative: &Derivative<L>, x: &[L], y: &mut [L]) {
    let Derivative { lower, upper, .. } = derivative;
    for Tree { dofs, skew, .. } in trees(model) {
        let upper = if skew { upper } else { lower };
        for k in dofs {
            let mut sum = lower[model.rows.diagonal(k)] * x[k];
            for j in model.tree_pattern.row(k).iter().flat_map(|run| run.range()) {
                let at = model.rows.at(k, j);
                sum = lower[at].mul_add(x[j], sum);
                y[j] = upper[at].mul_add(x[k], y[j]);
            }
            y[k] = sum;
        }
    }
}

/// Factors it.
pub fn factor<L: Lane>(model: &Model<L::Real>, derivative: &mut Derivative<L>) {
    let Derivative { lower, upper, inverse, multipliers, .. } = derivative;
    for Tree { dofs, skew, .. } in trees(model) {
        if skew {
            lu::factor(&model.rows, &model.tree_pattern, dofs, lower, upper, inverse);
        } else {
            ldl::factor_rows(&model.rows, &model.tree_pattern, dofs, lower, inverse, multipliers);
        }
    }
}

/// Solves (M - h D) x = b in place of b, from the factors.
pub fn solve<L: Lane>(model: &Model<L::Real>, derivative: &Derivative<L>, x: &mut [L]) {
    let Derivative { lower, upper, inverse, .. } = derivative;
    for Tree { dofs, skew, .. } in trees(model) {
        if skew {
            lu::solve(&model.rows, &model.tree_pattern, dofs, lower, upper, inverse, x);
        } else {
            ldl::solve_rows(&model.rows, &model.tree_pattern, dofs, lower, inverse, x);
        }
    }
}
