//! What forces gain with velocity, and the matrix M - h D of the implicit integrators; the metrics of discrete and of midpoint steps.
//!
//! `implicitfast` takes the derivative of passive and actuator forces, which is symmetric; `implicit` that of the bias force too. Free
//! bodies that carry no joint have the latter in either case: their spin is what makes Euler's step unstable.

mod actuators;
pub(crate) mod bias;
mod discrete;
mod fitted;

use std::ops::Range;

use crate::actuation::Actuation;
use crate::fields::fields;
use crate::inertia::Inertia;
use crate::lane::Lane;
use crate::math::{ldl, lu};
use crate::model::{Instance, Model};
use crate::options::Integrator;
use crate::passive::{damper_slope, ellipsoid, fluid, tendon_damper_slope};
use crate::position::Position;
use crate::state::State;
use crate::tendon::{self, Tendons};
use crate::velocity::Velocity;

fields! {
    /// M - h D, or its factors; stored by `model.rows`.
    pub struct Derivative(sizes) {
        /// Entries up to the diagonal.
        pub lower: Vec<L> = sizes.nm,
        /// Entries above it, column by column, of trees for which they differ.
        pub upper: Vec<L> = if sizes.nlink > 0 { sizes.nm } else { 0 },
        /// The metric of a discrete step, or of a midpoint step. Of the former, free bodies that carry no joint have the derivative of the bias force beside it, where no row
        /// holds them.
        pub metric: Vec<L> = sizes.nm,
        /// What the force loses on the way of a discrete step, h K v; of a midpoint step, ε v.
        pub pull: Vec<L> = sizes.nv,
        /// By dof, 1 in worlds in which an actuator holds it in a discrete step.
        pub joined: Vec<L> = sizes.nv,
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
    pub tendons: &'a Tendons<L>,
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
    model.trees().map(|tree| {
        let skew = match model.options.integrator {
            Integrator::Implicit => true,
            Integrator::ImplicitFast | Integrator::Discrete => tree.is_free_body(model),
            Integrator::Euler | Integrator::Rk4 | Integrator::Midpoint => false,
        };
        Tree { dofs: tree.dofs, links: tree.links, skew }
    })
}

/// Fills in M - h D; of discrete steps, their metric, and what the force loses.
pub fn implicit<L: Lane>(model: Instance<'_, L>, state: &State<L>, stages: Stages<'_, L>, out: &mut Derivative<L>) {
    let h = L::of(model.options.timestep);
    out.lower.copy_from_slice(&stages.inertia.m);
    let discrete = model.options.integrator == Integrator::Discrete;
    if discrete {
        discrete::add(model, state, stages, h, (&mut out.lower, &mut out.pull, &mut out.joined));
    }
    if model.features.dampers && !discrete {
        for (i, _) in model.dofs.iter().enumerate().filter(|(_, dof)| dof.damped) {
            let diagonal = &mut out.lower[model.rows.diagonal(i)];
            *diagonal = h.mul_add(damper_slope(model, i, state.qvel[i]), *diagonal);
        }
        for (t, _) in model.tendons.iter().enumerate().filter(|(_, tendon)| tendon.damped) {
            let Tendons { velocity, jacobian, .. } = stages.tendons;
            let slope = h * tendon_damper_slope(model, t, velocity[t]);
            tendon::add_square(&model, t, jacobian, slope, &mut out.lower);
        }
    }
    fluid::add_slope(&model, stages.position, stages.velocity, h, &mut out.lower);
    if discrete {
        out.metric.copy_from_slice(&out.lower);
    }
    if model.features.actuation && !discrete {
        actuators::add(model, stages.actuation, h, &mut out.lower);
    }
    let Derivative { lower, upper, turn, gain, .. } = out;
    if !upper.is_empty() {
        upper.copy_from_slice(lower);
    }
    for tree in trees(&model) {
        let motion = (stages.position, stages.velocity);
        ellipsoid::add_slope(&model, motion, (tree.links, tree.skew), h, (lower, upper));
    }
    for tree in trees(&model).filter(|tree| tree.skew) {
        bias::add(&model, &tree, &state.qvel, stages, h, bias::Target { lower, upper, turn, gain });
    }
}

/// Fills in the metric of midpoint steps, and what the force loses; outside of a step (`kicks`) the inertia matrix, and nothing.
pub fn fitted<L: Lane>(
    model: Instance<'_, L>,
    state: &State<L>,
    stages: Stages<'_, L>,
    kicks: bool,
    out: &mut Derivative<L>,
) {
    let Derivative { metric, pull, joined, .. } = out;
    metric.copy_from_slice(&stages.inertia.m);
    if kicks {
        fitted::add(model, state, stages, (metric, pull, joined));
        // A medium resists what is between the velocities of the step.
        fluid::add_slope(&model, stages.position, stages.velocity, L::of(0.5 * model.options.timestep), metric);
    } else {
        pull.fill(L::zero());
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

/// y = (M - h D) x of discrete steps: by the metric where rows, which `held` tells by the tree's first dof, or actuators hold the tree.
pub fn multiply_discrete<L: Lane>(
    model: &Model<L::Real>,
    derivative: &Derivative<L>,
    held: &dyn Fn(usize) -> L::Mask,
    x: &[L],
    y: &mut [L],
) {
    multiply(model, derivative, x, y);
    for Tree { dofs, .. } in trees(model).filter(|tree| tree.skew) {
        let first = dofs.start;
        let held = held(first) | derivative.joined[first].gt(L::zero());
        let mut by_metric = [L::zero(); 6];
        for k in dofs.clone() {
            by_metric[k - first] = derivative.metric[model.rows.diagonal(k)].mul_add(x[k], by_metric[k - first]);
            for j in model.tree_pattern.row(k).iter().flat_map(|run| run.range()) {
                let entry = derivative.metric[model.rows.at(k, j)];
                by_metric[k - first] = entry.mul_add(x[j], by_metric[k - first]);
                by_metric[j - first] = entry.mul_add(x[k], by_metric[j - first]);
            }
        }
        for (k, metric) in dofs.zip(by_metric) {
            y[k] = L::select(held, metric, y[k]);
        }
    }
}

/// The accelerations of free bodies that no row and no actuator holds in a discrete step, in place of those of a solver. `held` tells where rows hold a tree, by
/// its first dof; `scratch` has room for the force.
pub fn release<L: Lane>(
    model: &Model<L::Real>,
    derivative: &Derivative<L>,
    held: &dyn Fn(usize) -> L::Mask,
    (force, scratch): (&[L], &mut [L]),
    qacc: &mut [L],
) {
    let Derivative { lower, upper, inverse, .. } = derivative;
    for Tree { dofs, .. } in trees(model).filter(|tree| tree.skew) {
        scratch[dofs.clone()].copy_from_slice(&force[dofs.clone()]);
        lu::solve(&model.rows, &model.tree_pattern, dofs.clone(), lower, upper, inverse, scratch);
        let held = held(dofs.start) | derivative.joined[dofs.start].gt(L::zero());
        for i in dofs {
            qacc[i] = L::select(held, qacc[i], scratch[i]);
        }
    }
}

/// Factors it; of discrete steps, what is not factored as their metric is.
pub fn factor<L: Lane>(model: &Model<L::Real>, derivative: &mut Derivative<L>) {
    let Derivative { lower, upper, inverse, multipliers, .. } = derivative;
    let discrete = model.options.integrator == Integrator::Discrete;
    for Tree { dofs, skew, .. } in trees(model).filter(|tree| tree.skew || !discrete) {
        if skew {
            lu::factor(&model.rows, &model.tree_pattern, dofs, lower, upper, inverse);
        } else {
            ldl::factor_rows(&model.rows, &model.tree_pattern, dofs, lower, inverse, multipliers);
        }
    }
}

/// Makes entries above the diagonal known in all trees, of the matrix or of its factors: where it is symmetric they are those below.
pub fn complete<L: Lane>(model: &Model<L::Real>, derivative: &mut Derivative<L>) {
    let Derivative { lower, upper, .. } = derivative;
    for dof in trees(model).filter(|tree| !tree.skew).flat_map(|tree| tree.dofs) {
        let row = model.rows.row(dof);
        if let Some(upper) = upper.get_mut(row.clone()) {
            upper.copy_from_slice(&lower[row]);
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
