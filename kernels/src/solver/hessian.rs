//! H = M + Jᵀ D_active J.
//!
//! Contacts whose one side stands still add a 6×6 stiffness to their link; stiffnesses are pushed down the tree exactly as
//! the composite rigid body algorithm pushes inertias, so the cost hardly depends on the number of contacts and H keeps
//! M's sparsity. Contacts between links add their rows' products.

use super::cone::{self, Stiffness};
use super::{Problem, Solver, SolverWork, rows};
use crate::constraint::{Constraint, ContactRow, DofRowKind};
use crate::lane::Lane;
use crate::math::spatial::{Spatial, dot6};
use crate::math::vec3::scale_add;
use crate::model::{Model, NONE};
use crate::position::Position;

/// A symmetric 6×6 matrix, lower triangle by rows.
type Sym6<L> = [L; 21];

#[inline(always)]
const fn at(i: usize, j: usize) -> usize {
    if i >= j { i * (i + 1) / 2 + j } else { j * (j + 1) / 2 + i }
}

/// Fills the Hessian for the current iterate.
pub fn assemble<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let Problem { model, position, inertia, constraint, .. } = problem;
    let Solver { hessian, stiffness, .. } = &mut work.fields;
    hessian.copy_from_slice(&inertia.m);
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
    for (stiffness, touched) in stiffness.iter_mut().zip(&work.touched) {
        if *touched {
            *stiffness = [L::zero(); 21];
        }
    }
    for row in &constraint.contact_rows {
        let (first, dim) = (row.component as usize, row.dim as usize);
        let k = cone::stiffness(row, &work.y.component[first..first + dim]);
        if row.link != NONE {
            add_to_link(&k, &constraint.motion[first..first + dim], &mut stiffness[row.link as usize]);
        } else {
            add_rows(model, constraint, row, &k, hessian);
        }
    }
    push_down(model, position, &work.touched, stiffness, hessian);
}

/// stiffness += Wᵀ K W, W the components' motion rows.
#[inline(always)]
fn add_to_link<L: Lane>(k: &Stiffness<L>, w: &[Spatial<L>], stiffness: &mut Sym6<L>) {
    match k {
        Stiffness::Arrow(normal, side, cross) => {
            let mut sum: Spatial<L> = w[0].map(|x| *normal * x);
            for j in 1..w.len() {
                let (side, cross) = (side[j - 1], cross[j - 1]);
                sum = scale_add(cross, &w[j], &sum);
                let t: Spatial<L> = std::array::from_fn(|i| side.mul_add(w[j][i], cross * w[0][i]));
                rank_one(&t, &w[j], stiffness);
            }
            rank_one(&sum, &w[0], stiffness);
        }
        Stiffness::Full(k) => {
            for j in 0..w.len() {
                let mut sum = [L::zero(); 6];
                for i in 0..w.len() {
                    sum = scale_add(k[i.max(j)][i.min(j)], &w[i], &sum);
                }
                rank_one(&sum, &w[j], stiffness);
            }
        }
    }
}

/// s += lower triangle of a bᵀ.
#[inline(always)]
fn rank_one<L: Lane>(a: &Spatial<L>, b: &Spatial<L>, s: &mut Sym6<L>) {
    for i in 0..6 {
        for j in 0..=i {
            s[at(i, j)] = a[i].mul_add(b[j], s[at(i, j)]);
        }
    }
}

/// H += Jᵀ K J of a contact between two links.
#[inline(always)]
fn add_rows<L: Lane>(
    model: &Model<L::Real>,
    constraint: &Constraint<L>,
    row: &ContactRow<L>,
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

/// Sums stiffnesses towards the roots and adds Sᵀ K S to the Hessian.
fn push_down<L: Lane>(
    model: &Model<L::Real>,
    position: &Position<L>,
    touched: &[bool],
    stiffness: &mut [Sym6<L>],
    hessian: &mut [L],
) {
    for (l, link) in model.links.iter().enumerate().rev() {
        if !touched[l] {
            continue;
        }
        let k = stiffness[l];
        for i in link.dofs.range() {
            let s = &position.cdof[i];
            let force: Spatial<L> = std::array::from_fn(|r| {
                let mut sum = k[at(r, 0)] * s[0];
                for c in 1..6 {
                    sum = k[at(r, c)].mul_add(s[c], sum);
                }
                sum
            });
            let (start, first) = (model.rows.start[i] as usize, model.rows.first[i] as usize);
            for run in model.tree_pattern.row(i) {
                let row = &mut hessian[start + run.start as usize - first..];
                for (entry, s) in row.iter_mut().zip(&position.cdof[run.range()]) {
                    *entry += dot6(s, &force);
                }
            }
            hessian[start + i - first] += dot6(s, &force);
        }
        if link.parent != NONE {
            let parent = &mut stiffness[link.parent as usize];
            for (p, k) in parent.iter_mut().zip(k) {
                *p += k;
            }
        }
    }
}
