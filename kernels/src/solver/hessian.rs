//! H = M + Jᵀ D_active J.
//!
//! Contacts whose one side stands still add a 6×6 stiffness to their link; stiffnesses are pushed down the tree exactly as
//! the composite rigid body algorithm pushes inertias, so the cost hardly depends on the number of contacts and H keeps
//! M's sparsity. Contacts between links add their rows' products.

use super::cone::{self, Stiffness};
use super::contact::{self, Sym6, at};
use super::{Problem, Solver, SolverWork, rows};
use crate::code::Code;
use crate::constraint::{Constraint, ContactRow, DofRowKind};
use crate::lane::{Lane, LaneQuery};
use crate::math::spatial::Spatial;
use crate::math::tree;
use crate::math::vec3::build;
use crate::model::{DofKind, Model, NONE};

/// Fills the Hessian for the current iterate.
pub fn assemble<L: LaneQuery>(problem: &Problem<'_, L>, code: &mut dyn Code<L>, work: &mut SolverWork<L>) {
    let Problem { model, constraint, .. } = *problem;
    let stiffness = &mut work.fields.stiffness;
    for (stiffness, _) in stiffness.iter_mut().zip(&work.touched).filter(|(_, touched)| **touched) {
        *stiffness = [L::zero(); 21];
    }
    contact::stiffen_all(constraint, &work.y.component, code, stiffness);
    if !code.curve(problem, &mut work.fields) {
        curve(problem, &work.touched, &mut work.fields);
    }
    let hessian = &mut work.fields.hessian;
    for (row, y) in constraint.dof_rows.iter().zip(&work.y.dof) {
        let (_, k) = rows::dof_force(row, *y);
        let dof = row.dof as usize;
        if row.kind == DofRowKind::Ball {
            for i in 0..3 {
                for j in 0..=i {
                    let entry = &mut hessian[model.rows.at(dof + i, dof + j)];
                    *entry = (k * row.axis[i]).mul_add(row.axis[j], *entry);
                }
            }
        } else {
            hessian[model.rows.diagonal(dof)] += k;
        }
    }
    for row in constraint.contact_rows.iter().filter(|row| row.link == NONE) {
        let (first, dim) = (row.component as usize, row.dim as usize);
        let k = cone::stiffness(constraint.law(row), &work.y.component[first..first + dim]);
        add_rows(model, constraint, row, &k, hessian);
    }
}

/// H = M + Sᵀ K S: pushes the stiffnesses of touched links down the tree, and projects them on the dofs.
pub fn curve<L: Lane>(problem: &Problem<'_, L>, touched: &[bool], solver: &mut Solver<L>) {
    let (model, stiffness) = (problem.model, &mut solver.stiffness);
    for (l, link) in model.links.iter().enumerate().rev() {
        if touched[l] && link.parent != NONE {
            let (parents, rest) = stiffness.split_at_mut(l);
            for (p, k) in parents[link.parent as usize].iter_mut().zip(&rest[0]) {
                *p += *k;
            }
        }
    }
    project_stiffness(problem, touched, solver);
}

/// H += Jᵀ K J of a contact between two links.
#[inline(always)]
fn add_rows<L: Lane>(
    model: &Model<L::Real>,
    constraint: &Constraint<L>,
    row: &ContactRow,
    k: &Stiffness<L>,
    hessian: &mut [L],
) {
    let pair = &model.pairs[row.pair as usize];
    let dofs = &model.pair_dofs[pair.dofs.range()];
    for (n, (i, column)) in rows::two_sided(model, constraint, row).enumerate() {
        let scaled = times(k, column);
        let base = model.rows.start[i] as usize;
        let first = model.rows.first[i] as usize;
        for (entry, other) in dofs[..=n].iter().zip(rows::two_sided(model, constraint, row)) {
            let target = &mut hessian[base + entry.dof as usize - first];
            for (k, j) in scaled.iter().zip(other.1) {
                *target = k.mul_add(*j, *target);
            }
        }
    }
}

/// K times a column of components.
#[inline(always)]
fn times<L: Lane>(k: &Stiffness<L>, column: &[L]) -> [L; 6] {
    let mut out = [L::zero(); 6];
    match k {
        Stiffness::Arrow(normal, side, cross) => {
            out[0] = *normal * column[0];
            for j in 1..column.len() {
                out[0] = cross[j - 1].mul_add(column[j], out[0]);
                out[j] = side[j - 1].mul_add(column[j], cross[j - 1] * column[0]);
            }
        }
        Stiffness::Full(k) => {
            for (i, out) in out.iter_mut().enumerate().take(column.len()) {
                for (j, x) in column.iter().enumerate() {
                    *out = k[i.max(j)][i.min(j)].mul_add(*x, *out);
                }
            }
        }
    }
    out
}

/// H = M + Sᵀ K S, row by row.
fn project_stiffness<L: Lane>(problem: &Problem<'_, L>, touched: &[bool], solver: &mut Solver<L>) {
    let Problem { model, position, inertia, .. } = problem;
    let Solver { stiffness, hessian, .. } = solver;
    for (i, dof) in model.dofs.iter().enumerate() {
        let range = model.rows.row(i);
        let row = &mut hessian[range.clone()];
        row.copy_from_slice(&inertia.m[range]);
        if !touched[dof.link as usize] {
            continue;
        }
        let force = stiffness_times(&stiffness[dof.link as usize], dof.kind, &position.cdof[i]);
        tree::project_on_ancestors(model, &position.cdof, i, &force, row, |entry, x| *entry += x);
        if let Some(diagonal) = row.last_mut() {
            *diagonal += tree::project(model, &position.cdof, i, &force);
        }
    }
}

/// K times a dof's axis.
#[inline(always)]
fn stiffness_times<L: Lane>(k: &Sym6<L>, kind: DofKind, s: &Spatial<L>) -> Spatial<L> {
    let columns = |r: usize, from: usize, to: usize| {
        let mut sum = k[at(r, from)] * s[from];
        for c in from + 1..to {
            sum = k[at(r, c)].mul_add(s[c], sum);
        }
        sum
    };
    match kind {
        DofKind::FreeTranslation(c) => build(|r| k[at(r, 3 + c as usize)]),
        DofKind::FreeRotation(_) => build(|r| columns(r, 0, 3)),
        DofKind::Slide => build(|r| columns(r, 3, 6)),
        DofKind::BallRotation(_) | DofKind::Hinge => build(|r| columns(r, 0, 6)),
    }
}
