//! Products of dof axes along the tree. Dofs of a free joint at a tree's root have axes that are mostly zeros, one
//! translation along a world axis or one rotation through the tree's origin, and take part in every row: they are
//! spelled out. Orientations of links as quaternions, composed from joint to joint as MuJoCo does.

use super::spatial::{Spatial, Sym6, at, dot6};
use super::vec3::{build, scale_add, zero};
use crate::lane::Lane;
use crate::model::{DofKind, Model, NONE};

/// Product of dof `i`'s axis and a force.
#[inline(always)]
pub fn project<L: Lane>(model: &Model<L::Real>, cdof: &[Spatial<L>], i: usize, force: &Spatial<L>) -> L {
    let s = &cdof[i];
    match model.dofs[i].kind {
        DofKind::FreeTranslation(k) => force[3 + k as usize],
        DofKind::FreeRotation(_) => rotation(s, force),
        DofKind::Slide => s[5].mul_add(force[5], s[4].mul_add(force[4], s[3] * force[3])),
        DofKind::BallRotation(_) | DofKind::Hinge => dot6(s, force),
    }
}

#[inline(always)]
fn rotation<L: Lane>(s: &Spatial<L>, force: &Spatial<L>) -> L {
    s[2].mul_add(force[2], s[1].mul_add(force[1], s[0] * force[0]))
}

/// A symmetric matrix times a dof's axis.
#[inline(always)]
pub fn times_axis<L: Lane>(k: &Sym6<L>, kind: DofKind, s: &Spatial<L>) -> Spatial<L> {
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

/// Motion of every link whose dofs move with `x`.
#[inline(always)]
pub fn twists<L: Lane>(model: &Model<L::Real>, cdof: &[Spatial<L>], x: &[L], out: &mut [Spatial<L>]) {
    for (l, link) in model.links.iter().enumerate() {
        let mut motion = if link.parent == NONE { zero() } else { out[link.parent as usize] };
        for i in link.dofs.range() {
            motion = scale_add(x[i], &cdof[i], &motion);
        }
        out[l] = motion;
    }
}

/// Adds the generalised force of a force on link `l`.
#[inline(always)]
pub fn push<L: Lane>(model: &Model<L::Real>, cdof: &[Spatial<L>], l: usize, wrench: &Spatial<L>, force: &mut [L]) {
    let mut i = model.links[l].last_dof();
    while i != NONE {
        force[i as usize] += dot6(&cdof[i as usize], wrench);
        i = model.dofs[i as usize].parent;
    }
}

/// Calls `f` with the entry in `row` (a row of the skyline, from its first column on) of each ancestor of dof `i`, and
/// the product of the ancestor's axis and a force.
#[inline(always)]
pub fn project_on_ancestors<L: Lane>(
    model: &Model<L::Real>,
    cdof: &[Spatial<L>],
    i: usize,
    force: &Spatial<L>,
    row: &mut [L],
    f: impl Fn(&mut L, L),
) {
    let first = model.rows.first[i] as usize;
    let base = model.dofs[i].free_base;
    let mut done = 0;
    if base != NONE {
        let base = base as usize;
        let translations = i.min(base + 3);
        for (entry, x) in row[base - first..translations - first].iter_mut().zip(&force[3..]) {
            f(entry, *x);
        }
        done = i.min(base + 6);
        let rotations = translations..done;
        for (entry, s) in row[translations - first..done - first].iter_mut().zip(&cdof[rotations]) {
            f(entry, rotation(s, force));
        }
    }
    for run in model.tree_pattern.row(i) {
        let range = done.max(run.start as usize)..run.range().end;
        if !range.is_empty() {
            for (entry, s) in row[range.start - first..range.end - first].iter_mut().zip(&cdof[range]) {
                f(entry, dot6(s, force));
            }
        }
    }
}
