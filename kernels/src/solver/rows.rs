//! Between dofs and rows: J x, row forces, and Jᵀ f.

use super::{Problem, RowVector, Solver, SolverWork, cone, contact, equality, joints, primal};
use crate::lane::{Lane, Real};
use crate::math::spatial::{Spatial, dot6};
use crate::math::tree;
use crate::math::vec3::{add, zero};
use crate::model::{NONE, Sides};

/// out = J x.
pub fn apply<L: Lane>(problem: &Problem<'_, L>, x: &[L], twist: &mut [[L; 6]], out: &mut RowVector<L>) {
    let constraint = problem.constraint;
    if !constraint.contact_rows.is_empty() {
        tree::twists(&problem.model, &problem.position.cdof, x, twist);
    }
    joints::rates(problem, x, &mut out.dof);
    equality::rates(problem, x, &mut out.equality);
    for row in &constraint.contact_rows {
        let (w, y) = (&constraint.motion[row.components()], &mut out.component[row.components()]);
        if row.sides == Sides::Apart {
            contact::rates_apart(problem, row, x, y);
        } else {
            contact::rates(w, &contact::relative(twist, row), y);
        }
    }
}

/// y = J x becomes J x - a_ref.
pub fn add_reference<L: Lane>(problem: &Problem<'_, L>, y: &mut RowVector<L>) {
    let constraint = problem.constraint;
    equality::add_reference(problem, &mut y.equality);
    for (y, law) in y.dof.iter_mut().zip(constraint.dof_laws()) {
        *y += law.reference();
    }
    for (y, reference) in y.component[..constraint.components].iter_mut().zip(&constraint.reference) {
        *y += *reference;
    }
}

/// Where a step along the search direction has led: lanes that
#[derive(Clone, Copy, Debug)]
pub struct Arrival<M> {
    /// have converged;
    pub converged: M,
    /// moved no further than the rounding of the acceleration, in the norm of the inertia matrix: what is left of the
    /// gradient is rounding of stiff rows, and stays.
    pub still: M,
}

/// Moves the acceleration, the rows on joints and those of equality constraints by the step in the lanes of `open`, sums their
/// forces and those on touched links up to the dofs, beside those of contacts between trees, and sets the gradient.
pub fn gather<L: Lane>(problem: &Problem<'_, L>, open: L::Mask, work: &mut SolverWork<L>) -> Arrival<L::Mask> {
    let SolverWork { fields, y, jp, force, touched, line, .. } = work;
    contact::follow(line.step(), open, &mut y.dof, &jp.dof);
    of_joints(problem, &y.dof, &mut force.dof);
    contact::follow(line.step(), open, &mut y.equality, &jp.equality);
    equality::forces(problem, &y.equality, &mut force.equality);
    let Solver { qacc, ma, search, msearch, qfrc_constraint, gradient, pull, multipliers, wrench, .. } = &mut *fields;
    let between_trees = problem.constraint.between_trees;
    let pull = if between_trees {
        pull
    } else {
        multipliers.fill(L::zero());
        multipliers
    };
    equality::pull(problem, &force.equality, pull);
    joints::pull(problem, &force.dof, pull);
    climb(problem, touched, wrench, pull);
    let (step, curvature, mut sizes) = (line.step(), line.curvature(), [L::zero(); 4]);
    for i in 0..gradient.len() {
        qacc[i] = L::select(open, step.mul_add(search[i], qacc[i]), qacc[i]);
        ma[i] = L::select(open, step.mul_add(msearch[i], ma[i]), ma[i]);
        qfrc_constraint[i] = L::select(open, pull[i], qfrc_constraint[i]);
        sizes[i % 4] = qacc[i].mul_add(ma[i], sizes[i % 4]);
        gradient[i] = ma[i] - problem.acceleration.qfrc_smooth[i] - qfrc_constraint[i];
    }
    if between_trees {
        pull.fill(L::zero());
    }
    let size = (sizes[0] + sizes[1]) + (sizes[2] + sizes[3]);
    let rounding = L::of(L::Real::EPSILON);
    let still = (step * step * curvature).le(rounding * rounding * size);
    Arrival { converged: primal::converged(problem, fields), still }
}

/// Sets the spare forces to those that rows have at the acceleration found.
pub fn at_acceleration<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let Solver { qacc, twist, .. } = &mut work.fields;
    apply(problem, qacc, twist, &mut work.jp);
    add_reference(problem, &mut work.jp);
    work.spare.fit(problem.constraint);
    from_y(problem, &work.jp, &mut work.spare);
}

/// Sets the row forces to those at the acceleration found, in the lanes of `open`.
pub fn catch_up<L: Lane>(problem: &Problem<'_, L>, open: L::Mask, work: &mut SolverWork<L>) {
    let constraint = problem.constraint;
    at_acceleration(problem, work);
    let take = |old: &mut [L], new: &[L]| old.iter_mut().zip(new).for_each(|(f, g)| *f = L::select(open, *g, *f));
    take(&mut work.force.dof, &work.spare.dof);
    take(&mut work.force.equality, &work.spare.equality);
    take(&mut work.force.component, &work.spare.component[..constraint.components]);
}

/// Row forces from y.
pub fn from_y<L: Lane>(problem: &Problem<'_, L>, y: &RowVector<L>, force: &mut RowVector<L>) {
    let constraint = problem.constraint;
    of_joints(problem, &y.dof, &mut force.dof);
    equality::forces(problem, &y.equality, &mut force.equality);
    for row in &constraint.contact_rows {
        cone::force(constraint.law(row), &y.component[row.components()], &mut force.component[row.components()]);
    }
}

/// Forces of rows on joints.
fn of_joints<L: Lane>(problem: &Problem<'_, L>, y: &[L], force: &mut [L]) {
    for ((law, y), force) in problem.constraint.dof_laws().zip(y).zip(force) {
        *force = joints::force(problem.model, &law, *y).0;
    }
}

/// Generalised force Jᵀf of the row forces.
pub fn transpose<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let constraint = problem.constraint;
    let SolverWork { fields, force, touched, .. } = work;
    let Solver { qfrc_constraint, wrench, .. } = fields;
    qfrc_constraint.fill(L::zero());
    equality::pull(problem, &force.equality, qfrc_constraint);
    for row in constraint.apart() {
        contact::pull_apart(problem, row, &force.component[row.components()], qfrc_constraint);
    }
    joints::pull(problem, &force.dof, qfrc_constraint);
    for row in constraint.contact_rows.iter().filter(|row| row.sides != Sides::Apart) {
        let range = row.components();
        let (w, force) = (&constraint.motion[range.clone()], &force.component[range]);
        contact::push(w, force, &mut wrench[row.link as usize]);
        if row.other != NONE {
            contact::pull(w, force, &mut wrench[row.other as usize]);
        }
    }
    climb(problem, touched, wrench, qfrc_constraint);
}

/// Passes the forces on touched links, and on all that they carry, on to the dofs.
fn climb<L: Lane>(problem: &Problem<'_, L>, touched: &[bool], wrench: &mut [Spatial<L>], pull: &mut [L]) {
    let Problem { model, position, .. } = problem;
    for (l, link) in model.links.iter().enumerate().rev() {
        if !touched[l] {
            continue;
        }
        let sum = std::mem::replace(&mut wrench[l], zero());
        for i in link.dofs.range() {
            pull[i] += dot6(&position.cdof[i], &sum);
        }
        if link.parent != NONE {
            let parent = &mut wrench[link.parent as usize];
            *parent = add(parent, &sum);
        }
    }
}

/// Cost of the rows at y.
pub fn cost<L: Lane>(problem: &Problem<'_, L>, y: &RowVector<L>) -> L {
    let mut twice = joints::twice_cost(problem, &y.dof) + equality::twice_cost(problem, &y.equality);
    for row in &problem.constraint.contact_rows {
        twice += cone::twice_cost(problem.constraint.law(row), &y.component[row.components()]);
    }
    twice * L::of(0.5)
}
