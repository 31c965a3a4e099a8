//! Accelerations without the inertia matrix, by articulated bodies (Featherstone, Rigid Body Dynamics Algorithms, 2008, § 7.3).
//!
//! Joints are taken from last to first. What a joint's dof can follow freely is taken out of the inertia that its link shows to the
//! parent: K - U Uᵀ / D, with U = K s and D = sᵀU. So the work grows with the number of dofs, where that of a factor grows with the
//! square of their depth: long chains are faster, and in single precision more accurate, as nothing is summed up over the chain only
//! to be subtracted again.

use crate::lane::{Lane, Mask, Real};
use crate::math::spatial::{Inertia10, Spatial, Sym6, at, dot6};
use crate::math::tree;
use crate::math::vec3::{add, scale_add, zero};
use crate::model::{Model, NONE};

/// What is worked with.
#[derive(Debug)]
pub struct Scratch<'a, L> {
    /// Per link: inertia of it and all that it carries, as far as it cannot move on its own.
    pub body: &'a mut [Sym6<L>],
    /// Per link: force that comes with that, then its acceleration.
    pub force: &'a mut [Spatial<L>],
    /// Per dof: U.
    pub column: &'a mut [Spatial<L>],
    /// Per dof: 1 / D.
    pub inverse: &'a mut [L],
}

/// Whether this takes fewer operations than the inertia matrix and its factor, in a model of which nothing else needs them.
pub fn pays<T>(model: &Model<T>) -> bool {
    // Of a dof: K s, U Uᵀ / D, and products with s and U. Of a row of M with n entries: K s, n projections, elimination, solving.
    let entries = |i: usize| model.tree_pattern.row(i).iter().map(|run| run.len as usize).sum::<usize>();
    let of_row = |n: usize| 36 + 6 * n + n * (n + 3) / 2 + 2 * n;
    let matrix: usize = (0..model.sizes.nv).map(|i| of_row(entries(i))).sum();
    let plain = !model.constrained() && model.tendons.iter().all(|tendon| !tendon.heavy);
    plain && 100 * model.sizes.nv + 27 * model.sizes.nlink < matrix + 10 * model.sizes.nlink
}

/// Turns the forces `x` into the accelerations (M + diagonal)⁻¹ x, M without armature. `own` are the links' spatial inertias. Pivots D
/// below `TINY` are replaced by it and reported in the returned mask.
pub fn solve<L: Lane>(
    model: &Model<L::Real>,
    cdof: &[Spatial<L>],
    own: &[Inertia10<L>],
    diagonal: impl Fn(usize) -> L,
    scratch: Scratch<'_, L>,
    x: &mut [L],
) -> L::Mask {
    let Scratch { body, force, column, inverse } = scratch;
    let tiny = L::of(L::Real::TINY);
    let mut singular = L::Mask::splat(false);
    for ((body, force), own) in body.iter_mut().zip(force.iter_mut()).zip(own) {
        (*body, *force) = (expanded(own), zero());
    }
    for (l, link) in model.links.iter().enumerate().rev() {
        let (mut k, mut p) = (body[l], force[l]);
        for i in link.dofs.range().rev() {
            let u = tree::times_axis(&k, model.dofs[i].kind, &cdof[i]);
            let pivot = tree::project(model, cdof, i, &u) + diagonal(i);
            let bad = !pivot.ge(tiny);
            singular = singular | bad;
            inverse[i] = L::one() / L::select(bad, tiny, pivot);
            x[i] -= tree::project(model, cdof, i, &p);
            p = scale_add(x[i] * inverse[i], &u, &p);
            let scaled = u.map(|u| u * inverse[i]);
            for r in 0..6 {
                for c in 0..=r {
                    k[at(r, c)] = scaled[r].neg_mul_add(u[c], k[at(r, c)]);
                }
            }
            column[i] = u;
        }
        if link.parent != NONE {
            let parent = link.parent as usize;
            force[parent] = add(&force[parent], &p);
            body[parent].iter_mut().zip(&k).for_each(|(sum, k)| *sum += *k);
        }
    }
    for (l, link) in model.links.iter().enumerate() {
        let mut motion = if link.parent == NONE { zero() } else { force[link.parent as usize] };
        for i in link.dofs.range() {
            x[i] = (x[i] - dot6(&column[i], &motion)) * inverse[i];
            motion = scale_add(x[i], &cdof[i], &motion);
        }
        force[l] = motion;
    }
    singular
}

/// A spatial inertia as a matrix.
#[inline(always)]
fn expanded<L: Lane>([xx, yy, zz, xy, xz, yz, hx, hy, hz, m]: &Inertia10<L>) -> Sym6<L> {
    let o = L::zero();
    [
        *xx, //
        *xy, *yy, //
        *xz, *yz, *zz, //
        o, *hz, -*hy, *m, //
        -*hz, o, *hx, o, *m, //
        *hy, -*hx, o, o, o, *m,
    ]
}
