//! Contacts with one moving side: between a link and the components of the contacts on it.
//!
//! What one contact does is a function of its law, its components and its link, for which code can be made. The list is
//! worked through in runs of one kind, so that there are few calls of that code.

use super::cone::{self, Stiffness};
use super::edges::{self, Edges};
use crate::code::Code;
use crate::constraint::{Cone, Constraint, ContactRow, Law};
use crate::lane::{Lane, LaneQuery};
use crate::math::spatial::{Spatial, dot6};
use crate::math::vec3::{build, scale_add};
use crate::model::NONE;

/// A symmetric 6×6 matrix, lower triangle by rows.
pub type Sym6<L> = [L; 21];

/// What the shape of a contact's equations depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    /// Cone.
    pub cone: Cone,
    /// Number of components.
    pub dim: u32,
}

/// Listed contacts of one kind, one after the other; those with two moving sides among them are left out.
#[derive(Clone, Copy, Debug)]
pub struct Contacts<'a> {
    /// Their kind.
    pub kind: Kind,
    /// How many such runs are before it in the block's list.
    pub number: usize,
    rows: &'a [ContactRow],
}

impl<'a> Contacts<'a> {
    /// Those of the list.
    pub fn runs<L: Lane>(constraint: &'a Constraint<L>) -> impl Iterator<Item = Contacts<'a>> {
        let kind = |row: &ContactRow| Kind { cone: row.cone, dim: row.dim };
        let runs = constraint.contact_rows.chunk_by(move |a, b| kind(a) == kind(b));
        runs.enumerate().map(move |(number, rows)| Contacts { kind: kind(&rows[0]), number, rows })
    }

    /// One by one.
    pub fn rows(&self) -> impl Iterator<Item = &'a ContactRow> + Clone + use<'a> {
        self.rows.iter().filter(|row| row.link != NONE)
    }
}

/// Entry of a symmetric matrix.
#[inline(always)]
pub(super) const fn at(i: usize, j: usize) -> usize {
    if i >= j { i * (i + 1) / 2 + j } else { j * (j + 1) / 2 + i }
}

/// y = W t of a contact, W its motion rows and t the motion of its link.
#[inline(always)]
pub fn rates<L: Lane>(w: &[Spatial<L>], twist: &Spatial<L>, y: &mut [L]) {
    for (y, w) in y.iter_mut().zip(w) {
        *y = dot6(w, twist);
    }
}

/// Adds a contact's force to its link's.
#[inline(always)]
pub fn push<L: Lane>(w: &[Spatial<L>], force: &[L], wrench: &mut Spatial<L>) {
    for (f, w) in force.iter().zip(w) {
        *wrench = scale_add(*f, w, wrench);
    }
}

/// y = W t - a_ref, and adds twice the contact's cost there.
#[inline(always)]
pub fn survey<L: Lane>(
    law: Law<'_, L>,
    w: &[Spatial<L>],
    twist: &Spatial<L>,
    reference: &[L],
    y: &mut [L],
    twice: &mut L,
) {
    rates(w, twist, y);
    for (y, reference) in y.iter_mut().zip(reference) {
        *y += *reference;
    }
    *twice += cone::twice_cost(law, y);
}

/// J p, and what the line search wants to know of the contact.
#[inline(always)]
pub fn approach<L: Lane>(
    law: Law<'_, L>,
    w: &[Spatial<L>],
    twist: &Spatial<L>,
    y: &[L],
    jp: &mut [L],
    edges: &mut [L],
    same: &mut L,
) {
    rates(w, twist, jp);
    edges::of_contact(law, y, jp, edges, same);
}

/// Moves y along J p in the lanes of `open`.
#[inline(always)]
pub fn follow<L: Lane>(step: L, open: L::Mask, y: &mut [L], jp: &[L]) {
    for (y, v) in y.iter_mut().zip(jp) {
        *y = L::select(open, step.mul_add(*v, *y), *y);
    }
}

/// Moves y, and adds the contact's force there to that on its link.
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
) {
    follow(step, open, y, jp);
    cone::force(law, y, force);
    push(w, force, wrench);
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

/// [`survey`] of the list; returns twice the cost of its contacts.
pub fn survey_all<L: LaneQuery>(
    constraint: &Constraint<L>,
    twist: &[Spatial<L>],
    code: &mut dyn Code<L>,
    y: &mut [L],
) -> L {
    let mut twice = [L::zero()];
    for contacts in Contacts::runs(constraint) {
        if code.survey(constraint, contacts, twist, y, &mut twice) {
            continue;
        }
        for row in contacts.rows() {
            let range = row.components();
            let (w, reference) = (&constraint.motion[range.clone()], &constraint.reference[range.clone()]);
            survey(constraint.law(row), w, &twist[row.link as usize], reference, &mut y[range], &mut twice[0]);
        }
    }
    twice[0]
}

/// [`approach`] of the list.
pub fn approach_all<L: LaneQuery>(
    constraint: &Constraint<L>,
    twist: &[Spatial<L>],
    y: &[L],
    code: &mut dyn Code<L>,
    jp: &mut [L],
    edges: &mut Edges<L>,
) {
    for contacts in Contacts::runs(constraint) {
        if code.approach(constraint, contacts, twist, y, jp, edges) {
            continue;
        }
        for row in contacts.rows() {
            let range = row.components();
            let (w, twist) = (&constraint.motion[range.clone()], &twist[row.link as usize]);
            let mut same = edges.same[0];
            approach(constraint.law(row), w, twist, &y[range.clone()], &mut jp[range], edges.of_row(row), &mut same);
            edges.same[0] = same;
        }
    }
}

/// [`act`] of the list.
#[allow(clippy::too_many_arguments)] // all that contacts have
pub fn act_all<L: LaneQuery>(
    constraint: &Constraint<L>,
    step: L,
    open: L::Mask,
    jp: &[L],
    code: &mut dyn Code<L>,
    y: &mut [L],
    force: &mut [L],
    wrench: &mut [Spatial<L>],
) {
    for contacts in Contacts::runs(constraint) {
        if code.act(constraint, contacts, step, L::bits(open), jp, y, force, wrench) {
            continue;
        }
        for row in contacts.rows() {
            let range = row.components();
            let (w, jp) = (&constraint.motion[range.clone()], &jp[range.clone()]);
            let (y, force) = (&mut y[range.clone()], &mut force[range]);
            act(constraint.law(row), w, step, open, jp, y, force, &mut wrench[row.link as usize]);
        }
    }
}

/// [`stiffen`] of the list.
pub fn stiffen_all<L: LaneQuery>(
    constraint: &Constraint<L>,
    y: &[L],
    code: &mut dyn Code<L>,
    stiffness: &mut [Sym6<L>],
) {
    for contacts in Contacts::runs(constraint) {
        if code.stiffen(constraint, contacts, y, stiffness) {
            continue;
        }
        for row in contacts.rows() {
            let range = row.components();
            let (w, y) = (&constraint.motion[range.clone()], &y[range]);
            stiffen(constraint.law(row), w, y, &mut stiffness[row.link as usize]);
        }
    }
}
