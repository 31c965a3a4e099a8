//! Contacts: between links, or dofs, and the components of the contacts on them.
//!
//! What one contact does is a function of its law, its components and its links. Of contacts between trees all goes by J.

use super::cone::{self, Stiffness};
use super::edges;
use super::line::Line;
use super::{Problem, SolverWork};
use crate::constraint::{Constraint, ContactRow, Law};
use crate::lane::Lane;
use crate::math::spatial::{Spatial, Sym6, at, dot6};
use crate::math::vec3::{build, scale_add, sub};
use crate::model::{Model, NONE, Sides};

/// y = W t of a contact, W its motion rows and t the motion of its link.
#[inline(always)]
pub fn rates<L: Lane>(w: &[Spatial<L>], twist: &Spatial<L>, y: &mut [L]) {
    for (y, w) in y.iter_mut().zip(w) {
        *y = dot6(w, twist);
    }
}

/// What a contact's components measure: the motion of its link, or that relative to another link.
#[inline(always)]
pub fn relative<L: Lane>(twist: &[Spatial<L>], row: &ContactRow) -> Spatial<L> {
    let motion = twist[row.link as usize];
    if row.other == NONE { motion } else { sub(&motion, &twist[row.other as usize]) }
}

/// Adds a contact's force to its link's.
#[inline(always)]
pub fn push<L: Lane>(w: &[Spatial<L>], force: &[L], wrench: &mut Spatial<L>) {
    for (f, w) in force.iter().zip(w) {
        *wrench = scale_add(*f, w, wrench);
    }
}

/// Subtracts a contact's force from that on the other link.
#[inline(always)]
pub fn pull<L: Lane>(w: &[Spatial<L>], force: &[L], wrench: &mut Spatial<L>) {
    for (f, w) in force.iter().zip(w) {
        *wrench = scale_add(-*f, w, wrench);
    }
}

/// y = W t - a_ref at two accelerations, and adds twice the contact's costs there.
#[inline(always)]
pub fn survey<L: Lane>(
    law: Law<'_, L>,
    w: &[Spatial<L>],
    [cold_twist, warm_twist]: &[Spatial<L>; 2],
    reference: &[L],
    [cold, warm]: [&mut [L]; 2],
    line: &mut Line<L>,
) {
    let twice = |twist: &Spatial<L>, y: &mut [L]| {
        rates(w, twist, y);
        for (y, reference) in y.iter_mut().zip(reference) {
            *y += *reference;
        }
        cone::twice_cost(law, y)
    };
    line.set_cold_cost(line.cold_cost() + twice(cold_twist, cold));
    line.set_warm_cost(line.warm_cost() + twice(warm_twist, warm));
}

/// J p, and what the line search wants to know of the contact on a full step.
#[inline(always)]
pub fn approach<L: Lane>(
    law: Law<'_, L>,
    w: &[Spatial<L>],
    twist: &Spatial<L>,
    y: &[L],
    jp: &mut [L],
    line: &mut Line<L>,
) {
    rates(w, twist, jp);
    edges::begin(law, y, jp, line);
}

/// Moves y along J p in the lanes of `open`.
#[inline(always)]
pub fn follow<L: Lane>(step: L, open: L::Mask, y: &mut [L], jp: &[L]) {
    for (y, v) in y.iter_mut().zip(jp) {
        *y = L::select(open, step.mul_add(*v, *y), *y);
    }
}

/// Moves y, and adds the contact's force there to that on its link, and the opposite to that on the other.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // all that a contact has
pub fn act<L: Lane>(
    law: Law<'_, L>,
    w: &[Spatial<L>],
    step: L,
    open: L::Mask,
    jp: &[L],
    y: &mut [L],
    force: &mut [L],
    wrench: &mut Spatial<L>,
    other: Option<&mut Spatial<L>>,
) {
    follow(step, open, y, jp);
    cone::force(law, y, force);
    push(w, force, wrench);
    if let Some(other) = other {
        pull(w, force, other);
    }
}

/// Adds the contact's stiffness at y to that of its link.
#[inline(always)]
pub fn stiffen<L: Lane>(law: Law<'_, L>, w: &[Spatial<L>], y: &[L], stiffness: &mut Sym6<L>) {
    let k = cone::stiffness(law, y);
    match w.len() {
        1 => add_components::<L, 1>(&k, w, stiffness),
        3 => add_components::<L, 3>(&k, w, stiffness),
        4 => add_components::<L, 4>(&k, w, stiffness),
        _ => add_components::<L, 6>(&k, w, stiffness),
    }
}

/// stiffness += Wᵀ K W
#[inline(always)]
fn add_components<L: Lane, const N: usize>(k: &Stiffness<L>, w: &[Spatial<L>], stiffness: &mut Sym6<L>) {
    let w = &w[..N];
    let mut t = [[L::zero(); 6]; N];
    match k {
        Stiffness::Arrow(normal, side, cross) => {
            t[0] = w[0].map(|x| *normal * x);
            for c in 1..N {
                t[0] = scale_add(cross[c - 1], &w[c], &t[0]);
                t[c] = build(|i| side[c - 1].mul_add(w[c][i], cross[c - 1] * w[0][i]));
            }
        }
        Stiffness::Full(k) => {
            for c in 0..N {
                for d in 0..N {
                    t[c] = scale_add(k[c.max(d)][c.min(d)], &w[d], &t[c]);
                }
            }
        }
    }
    for i in 0..6 {
        for j in 0..=i {
            let mut sum = stiffness[at(i, j)];
            for c in 0..N {
                sum = t[c][i].mul_add(w[c][j], sum);
            }
            stiffness[at(i, j)] = sum;
        }
    }
}

/// Leaves y in the lanes of `warm`, and takes the other start's in the rest.
#[inline(always)]
pub fn choose<L: Lane>(warm: L::Mask, y: &mut [L], cold: &[L]) {
    for (y, cold) in y.iter_mut().zip(cold) {
        *y = L::select(warm, *y, *cold);
    }
}

/// [`survey`] of a listed contact at the two starts.
#[inline(always)]
pub fn survey_row<L: Lane>(problem: &Problem<'_, L>, row: &ContactRow, work: &mut SolverWork<L>) {
    let SolverWork { fields, y, jp, line, .. } = work;
    let (constraint, range) = (problem.constraint, row.components());
    let [cold, warm] = [&mut jp.component[range.clone()], &mut y.component[range.clone()]];
    let reference = &constraint.reference[range.clone()];
    if row.sides == Sides::Apart {
        let cost = |x: &[L], y: &mut [L]| survey_apart(problem, row, x, reference, y);
        line.set_cold_cost(line.cold_cost() + cost(&problem.acceleration.qacc_smooth, cold));
        line.set_warm_cost(line.warm_cost() + cost(&fields.search, warm));
        return;
    }
    let twists = [&fields.cold_twist, &fields.twist].map(|twist| relative(twist, row));
    survey(constraint.law(row), &constraint.motion[range], &twists, reference, [cold, warm], line);
}

/// y = J x - a_ref of a contact between trees; returns twice its cost there.
#[inline(always)]
fn survey_apart<L: Lane>(problem: &Problem<'_, L>, row: &ContactRow, x: &[L], reference: &[L], y: &mut [L]) -> L {
    rates_apart(problem, row, x, y);
    y.iter_mut().zip(reference).for_each(|(y, reference)| *y += *reference);
    cone::twice_cost(problem.constraint.law(row), y)
}

/// y = J x of a contact between trees.
#[inline(always)]
pub fn rates_apart<L: Lane>(problem: &Problem<'_, L>, row: &ContactRow, x: &[L], y: &mut [L]) {
    y.fill(L::zero());
    for (dof, column) in columns(&problem.model, problem.constraint, row) {
        for (y, j) in y.iter_mut().zip(column) {
            *y = j.mul_add(x[dof], *y);
        }
    }
}

/// Adds Jᵀf of a contact between trees.
#[inline(always)]
pub fn pull_apart<L: Lane>(problem: &Problem<'_, L>, row: &ContactRow, force: &[L], out: &mut [L]) {
    for (dof, column) in columns(&problem.model, problem.constraint, row) {
        for (f, j) in force.iter().zip(column) {
            out[dof] = j.mul_add(*f, out[dof]);
        }
    }
}

/// Dofs and Jacobian columns of a contact whose sides both move.
#[inline(always)]
pub fn columns<'a, L: Lane>(
    model: &'a Model<L::Real>,
    constraint: &'a Constraint<L>,
    row: &ContactRow,
) -> impl Iterator<Item = (usize, &'a [L])> {
    let dofs = &model.pair_dofs[model.pairs[row.pair as usize].dofs.range()];
    let columns = constraint.jacobian_of(row, dofs.len()).chunks_exact(row.dim as usize);
    dofs.iter().map(|entry| entry.dof as usize).zip(columns)
}

/// [`choose`] of a listed contact.
#[inline(always)]
pub fn choose_row<L: Lane>(warm: L::Mask, row: &ContactRow, work: &mut SolverWork<L>) {
    choose(warm, &mut work.y.component[row.components()], &work.jp.component[row.components()]);
}

/// [`approach`] of a listed contact.
#[inline(always)]
pub fn approach_row<L: Lane>(problem: &Problem<'_, L>, row: &ContactRow, work: &mut SolverWork<L>) {
    let SolverWork { fields, y, jp, line, .. } = work;
    let (constraint, range) = (problem.constraint, row.components());
    let (y, jp, law) = (&y.component[range.clone()], &mut jp.component[range.clone()], constraint.law(row));
    if row.sides == Sides::Apart {
        rates_apart(problem, row, &fields.search, jp);
        edges::begin(law, y, jp, line);
    } else {
        approach(law, &constraint.motion[range], &relative(&fields.twist, row), y, jp, line);
    }
}

/// [`edges::slope`] of a listed contact at the step that is tried.
#[inline(always)]
pub fn slope_row<L: Lane>(problem: &Problem<'_, L>, row: &ContactRow, work: &mut SolverWork<L>) {
    let SolverWork { y, jp, line, .. } = work;
    let (y, jp) = (&y.component[row.components()], &jp.component[row.components()]);
    edges::slope(problem.constraint.law(row), y, jp, line.step(), line);
}

/// [`act`] of a listed contact, in the lanes of `open`.
#[inline(always)]
pub fn act_row<L: Lane>(problem: &Problem<'_, L>, open: L::Mask, row: &ContactRow, work: &mut SolverWork<L>) {
    let (constraint, range) = (problem.constraint, row.components());
    let SolverWork { fields, y, jp, force, line, .. } = work;
    let (jp, y, force) =
        (&jp.component[range.clone()], &mut y.component[range.clone()], &mut force.component[range.clone()]);
    let (law, step, wrench) = (constraint.law(row), line.step(), &mut fields.wrench);
    let w = &constraint.motion[range];
    match row.sides {
        Sides::Apart => {
            follow(step, open, y, jp);
            cone::force(law, y, force);
            pull_apart(problem, row, force, &mut fields.pull);
        }
        Sides::One => act(law, w, step, open, jp, y, force, &mut wrench[row.link as usize], None),
        Sides::Two => {
            if let Ok([wrench, other]) = wrench.get_disjoint_mut([row.link as usize, row.other as usize]) {
                act(law, w, step, open, jp, y, force, wrench, Some(other));
            }
        }
    }
}

/// [`stiffen`] of a listed contact one side of which stands still.
#[inline(always)]
pub fn stiffen_row<L: Lane>(problem: &Problem<'_, L>, row: &ContactRow, work: &mut SolverWork<L>) {
    let (w, y) = (&problem.constraint.motion[row.components()], &work.y.component[row.components()]);
    stiffen(problem.constraint.law(row), w, y, &mut work.fields.stiffness[row.link as usize]);
}
