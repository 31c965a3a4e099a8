//! Joint-space inertia by the composite rigid body algorithm (Featherstone 2008, §6.2).

use crate::fields::fields;
use crate::lane::Lane;
use crate::math::spatial::{Inertia10, inertia_mul};
use crate::math::tree;
use crate::model::{Instance, Link, NONE};
use crate::position::Position;
use crate::tendon::{self, Tendons};

fields! {
    /// Spatial inertias and the joint-space inertia matrix.
    pub struct Inertia(sizes) {
        /// Spatial inertia of each link at its tree's origin, world axes.
        pub link: Vec<[L; 10]> = sizes.nlink,
        /// Spatial inertia of each link and all that it carries.
        pub composite: Vec<[L; 10]> = sizes.nlink,
        /// Joint-space inertia matrix M, stored by `model.rows`.
        pub m: Vec<L> = sizes.nm,
    } L
}

/// Spatial inertias of links, composite inertias, and M with armature.
pub fn crb<L: Lane>(model: Instance<'_, L>, position: &Position<L>, tendons: &Tendons<L>, inertia: &mut Inertia<L>) {
    for (l, link) in model.links.iter().enumerate() {
        let own = link_inertia(link, model.mass(l), &position.rot[l], &position.com[l]);
        inertia.link[l] = own;
        inertia.composite[l] = own;
    }
    for (l, link) in model.links.iter().enumerate().rev() {
        if link.parent != NONE {
            let carried = inertia.composite[l];
            let parent = &mut inertia.composite[link.parent as usize];
            for (p, c) in parent.iter_mut().zip(carried) {
                *p += c;
            }
        }
    }
    for (i, dof) in model.dofs.iter().enumerate() {
        let force = inertia_mul(&inertia.composite[dof.link as usize], &position.cdof[i]);
        let row = &mut inertia.m[model.rows.row(i)];
        tree::project_on_ancestors(&model, &position.cdof, i, &force, row, |entry, x| *entry = x);
        if let Some(diagonal) = row.last_mut() {
            *diagonal = tree::project(&model, &position.cdof, i, &force) + model.armature(i);
        }
    }
    for (t, tendon) in model.tendons.iter().enumerate().filter(|(_, tendon)| tendon.heavy) {
        tendon::add_square(&model, t, &tendons.jacobian, L::splat(tendon.armature), &mut inertia.m);
    }
}

/// Spatial inertia at the tree's origin of a link whose centre of mass is at `com`.
#[inline(always)]
fn link_inertia<L: Lane>(
    link: &Link<L::Real>,
    (m, _, i): (L, [L; 3], [L; 6]),
    rot: &[L; 9],
    com: &[L; 3],
) -> Inertia10<L> {
    // R I Rᵀ, I in link axes: first T = R I, then the upper triangle of T Rᵀ.
    let r = rot;
    let t: [[L; 3]; 3] = std::array::from_fn(|k| {
        let (x, y, z) = (r[3 * k], r[3 * k + 1], r[3 * k + 2]);
        if matches!(link.zeros.1, [_, _, _, true, true, true]) {
            [x * i[0], y * i[1], z * i[2]]
        } else {
            [
                z.mul_add(i[4], y.mul_add(i[3], x * i[0])),
                z.mul_add(i[5], y.mul_add(i[1], x * i[3])),
                z.mul_add(i[2], y.mul_add(i[5], x * i[4])),
            ]
        }
    });
    let entry = |a: usize, b: usize| t[a][2].mul_add(r[3 * b + 2], t[a][1].mul_add(r[3 * b + 1], t[a][0] * r[3 * b]));
    // Parallel axes: + m (s·s 1 - s sᵀ).
    let s = com;
    let h = [m * s[0], m * s[1], m * s[2]];
    let (xx, yy, zz) = (h[0] * s[0], h[1] * s[1], h[2] * s[2]);
    [
        entry(0, 0) + (yy + zz),
        entry(1, 1) + (xx + zz),
        entry(2, 2) + (xx + yy),
        h[0].neg_mul_add(s[1], entry(0, 1)),
        h[0].neg_mul_add(s[2], entry(0, 2)),
        h[1].neg_mul_add(s[2], entry(1, 2)),
        h[0],
        h[1],
        h[2],
        m,
    ]
}
