//! Contacts with sides in one tree: between links and the components of the contacts on them.
//!
//! What one contact does is a function of its law, its components and its links, for which code can be made. The list is
//! worked through kind by kind, so that there are few calls of that code.

use super::cone::{self, Stiffness};
use super::edges;
use super::line::Line;
use super::{Problem, SolverWork};
use crate::code::{Code, ContactPart};
use crate::constraint::{Constraint, ContactRow, Kind, Law};
use crate::lane::{Lane, LaneQuery};
use crate::math::spatial::{Spatial, Sym6, at, dot6};
use crate::math::vec3::{build, scale_add, sub};
use crate::model::{NONE, Sides};

/// Listed contacts of one kind.
#[derive(Clone, Copy, Debug)]
pub struct Contacts<'a> {
    /// Their kind.
    pub kind: Kind,
    /// Place of the kind among those of the model.
    pub number: usize,
    rows: &'a [ContactRow],
}

impl<'a> Contacts<'a> {
    /// Those of the list with sides in one tree.
    pub fn runs<L: Lane>(constraint: &'a Constraint<L>) -> impl Iterator<Item = Contacts<'a>> {
        let rows = &constraint.contact_rows[..];
        let kinds = constraint.kinds.iter().enumerate();
        let runs = kinds.map(move |(number, kind)| Contacts { kind: *kind, number, rows });
        runs.filter(|contacts| contacts.rows().next().is_some())
    }

    /// One by one.
    pub fn rows(&self) -> impl Iterator<Item = &'a ContactRow> + Clone + use<'a> {
        let kind = self.kind;
        self.rows.iter().filter(move |row| row.kind() == kind)
    }
}

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

/// [`survey`] of the list at the two starts.
pub fn survey_all<L: LaneQuery>(problem: &Problem<'_, L>, code: &mut dyn Code<L>, work: &mut SolverWork<L>) {
    let constraint = problem.constraint;
    for contacts in Contacts::runs(constraint) {
        if code.contact(ContactPart::Survey, contacts, problem, 0, work) {
            continue;
        }
        let SolverWork { fields, y, jp, line, .. } = work;
        for row in contacts.rows() {
            let range = row.components();
            let (w, reference) = (&constraint.motion[range.clone()], &constraint.reference[range.clone()]);
            let twists = [&fields.cold_twist, &fields.twist].map(|twist| relative(twist, row));
            let y = [&mut jp.component[range.clone()], &mut y.component[range]];
            survey(constraint.law(row), w, &twists, reference, y, line);
        }
    }
}

/// [`approach`] of the list.
pub fn approach_all<L: LaneQuery>(problem: &Problem<'_, L>, code: &mut dyn Code<L>, work: &mut SolverWork<L>) {
    let constraint = problem.constraint;
    for contacts in Contacts::runs(constraint) {
        if code.contact(ContactPart::Approach, contacts, problem, 0, work) {
            continue;
        }
        let SolverWork { fields, y, jp, line, .. } = work;
        for row in contacts.rows() {
            let range = row.components();
            let (w, twist) = (&constraint.motion[range.clone()], relative(&fields.twist, row));
            let (y, jp) = (&y.component[range.clone()], &mut jp.component[range]);
            approach(constraint.law(row), w, &twist, y, jp, line);
        }
    }
}

/// [`edges::slope`] of the list at the step that is tried.
pub fn slope_all<L: LaneQuery>(problem: &Problem<'_, L>, code: &mut dyn Code<L>, work: &mut SolverWork<L>) {
    for contacts in Contacts::runs(problem.constraint) {
        if code.contact(ContactPart::Slope, contacts, problem, 0, work) {
            continue;
        }
        let SolverWork { y, jp, line, .. } = work;
        for row in contacts.rows() {
            let (y, jp) = (&y.component[row.components()], &jp.component[row.components()]);
            edges::slope(problem.constraint.law(row), y, jp, line.step(), line);
        }
    }
}

/// [`act`] of the list.
pub fn act_all<L: LaneQuery>(
    problem: &Problem<'_, L>,
    open: L::Mask,
    code: &mut dyn Code<L>,
    work: &mut SolverWork<L>,
) {
    let constraint = problem.constraint;
    for contacts in Contacts::runs(constraint) {
        if code.contact(ContactPart::Act, contacts, problem, L::bits(open), work) {
            continue;
        }
        let SolverWork { fields, y, jp, force, line, .. } = work;
        let (step, wrench) = (line.step(), &mut fields.wrench);
        for row in contacts.rows() {
            let range = row.components();
            let (w, jp) = (&constraint.motion[range.clone()], &jp.component[range.clone()]);
            let (y, force) = (&mut y.component[range.clone()], &mut force.component[range]);
            let law = constraint.law(row);
            if row.other == NONE {
                act(law, w, step, open, jp, y, force, &mut wrench[row.link as usize], None);
            } else if let Ok([wrench, other]) = wrench.get_disjoint_mut([row.link as usize, row.other as usize]) {
                act(law, w, step, open, jp, y, force, wrench, Some(other));
            }
        }
    }
}

/// [`stiffen`] of those contacts of the list whose one side stands still.
pub fn stiffen_all<L: LaneQuery>(problem: &Problem<'_, L>, code: &mut dyn Code<L>, work: &mut SolverWork<L>) {
    let constraint = problem.constraint;
    for contacts in Contacts::runs(constraint).filter(|contacts| contacts.kind.sides == Sides::One) {
        if code.contact(ContactPart::Stiffen, contacts, problem, 0, work) {
            continue;
        }
        for row in contacts.rows() {
            let range = row.components();
            let (w, y) = (&constraint.motion[range.clone()], &work.y.component[range]);
            stiffen(constraint.law(row), w, y, &mut work.fields.stiffness[row.link as usize]);
        }
    }
}
