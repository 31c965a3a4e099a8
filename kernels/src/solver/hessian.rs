//! H = M + Jᵀ D_active J.
//!
//! Contacts whose one side stands still add a 6×6 stiffness to their link; stiffnesses are pushed down the tree exactly as
//! the composite rigid body algorithm pushes inertias, so the cost hardly depends on the number of contacts and H keeps
//! M's sparsity. Contacts whose sides both move add their rows' products.

use super::cone::{self, Stiffness};
use super::{Problem, Solver, SolverWork, equality, joints};
use crate::constraint::{ContactRow, Law};
use crate::lane::Lane;
use crate::math::tree;
use crate::model::{NONE, PairDof, Rows};

/// [`couple`] of a listed contact.
#[inline(always)]
pub fn couple_row<L: Lane>(problem: &Problem<'_, L>, row: &ContactRow, work: &mut SolverWork<L>) {
    let Problem { model, constraint, .. } = *problem;
    let dofs = &model.pair_dofs[model.pairs[row.pair as usize].dofs.range()];
    let (jacobian, y) = (constraint.jacobian_of(row, dofs.len()), &work.y.component[row.components()]);
    couple(&model.rows, dofs, constraint.law(row), jacobian, y, &mut work.fields.hessian);
}

/// H += Jᵀ K J of a contact whose sides both move, on the given dofs.
#[inline(always)]
pub fn couple<L: Lane>(rows: &Rows, dofs: &[PairDof], law: Law<'_, L>, jacobian: &[L], y: &[L], hessian: &mut [L]) {
    let k = cone::stiffness(law, y);
    let columns = || jacobian.chunks_exact(y.len());
    for (n, (entry, column)) in dofs.iter().zip(columns()).enumerate() {
        let scaled = times(&k, column);
        let i = entry.dof as usize;
        for (entry, column) in dofs[..=n].iter().zip(columns()) {
            let target = &mut hessian[rows.at(i, entry.dof as usize)];
            for (k, j) in scaled.iter().zip(column) {
                *target = k.mul_add(*j, *target);
            }
        }
    }
}

/// H = M + Sᵀ K S and the stiffness of rows on joints: pushes the stiffnesses of touched links down the tree, and projects
/// them on the dofs.
pub fn curve<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let SolverWork { fields, touched, y, .. } = work;
    let (model, stiffness) = (problem.model, &mut fields.stiffness);
    for (l, link) in model.links.iter().enumerate().rev() {
        if touched[l] && link.parent != NONE {
            let (parents, rest) = stiffness.split_at_mut(l);
            for (p, k) in parents[link.parent as usize].iter_mut().zip(&rest[0]) {
                *p += *k;
            }
        }
    }
    project_stiffness(problem, touched, fields);
    for (stiffness, _) in fields.stiffness.iter_mut().zip(&*touched).filter(|(_, touched)| **touched) {
        *stiffness = [L::zero(); 21];
    }
    joints::stiffen(problem, &y.dof, &mut fields.hessian);
    equality::stiffen(problem, &mut fields.hessian);
}

/// K times a column of components.
#[inline(always)]
pub fn times<L: Lane>(k: &Stiffness<L>, column: &[L]) -> [L; 6] {
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
        let force = tree::times_axis(&stiffness[dof.link as usize], dof.kind, &position.cdof[i]);
        tree::project_on_ancestors(model, &position.cdof, i, &force, row, |entry, x| *entry += x);
        if let Some(diagonal) = row.last_mut() {
            *diagonal += tree::project(model, &position.cdof, i, &force);
        }
    }
}
