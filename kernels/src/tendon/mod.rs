//! Tendons: lengths, velocities, and how both follow from the dofs.

mod path;
mod wrap;

pub use path::{Straight, pulls, straight};

use crate::fields::fields;
use crate::lane::Lane;
use crate::model::Model;
use crate::position::Position;

fields! {
    /// Tendons.
    pub struct Tendons(sizes) {
        /// Length, m; of fixed tendons, whatever their coefficients make of their joints.
        pub length: Vec<L> = sizes.ntendon,
        /// Rate of the length.
        pub velocity: Vec<L> = sizes.ntendon,
        /// What each length gains with the dofs that change it: tendon by tendon, dof by dof.
        pub jacobian: Vec<L> = sizes.ntj,
    } L
}

/// Lengths, Jacobians and velocities.
pub fn tendons<L: Lane>(
    model: &Model<L::Real>,
    position: &Position<L>,
    qpos: &[L],
    qvel: &[L],
    tendons: &mut Tendons<L>,
) {
    for (t, tendon) in model.tendons.iter().enumerate() {
        let Tendons { length, velocity, jacobian } = &mut *tendons;
        if tendon.fixed() {
            length[t] = L::zero();
            for (entry, j) in model.tendon_dofs[tendon.dofs.range()].iter().zip(&mut jacobian[tendon.dofs.range()]) {
                *j = L::splat(entry.coef);
                length[t] = j.mul_add(qpos[entry.qpos as usize], length[t]);
            }
        } else {
            length[t] = path::measure(model, tendon, position, jacobian);
        }
        velocity[t] = rate(model, t, jacobian, qvel);
    }
}

/// The dofs of a tendon, each with its entry of the Jacobian; `jacobian` has those of all tendons.
#[inline(always)]
pub fn columns<'a, L: Lane>(
    model: &'a Model<L::Real>,
    tendon: usize,
    jacobian: &'a [L],
) -> impl Iterator<Item = (usize, L)> + Clone {
    let tendon = &model.tendons[tendon];
    let fixed = tendon.fixed();
    let entries = model.tendon_dofs[tendon.dofs.range()].iter().zip(&jacobian[tendon.dofs.range()]);
    // Coefficients are known to whoever records.
    entries.map(move |(entry, j)| (entry.dof as usize, if fixed { L::splat(entry.coef) } else { *j }))
}

/// J x of a tendon.
#[inline(always)]
pub fn rate<L: Lane>(model: &Model<L::Real>, tendon: usize, jacobian: &[L], x: &[L]) -> L {
    columns(model, tendon, jacobian).fold(L::zero(), |sum, (dof, j)| j.mul_add(x[dof], sum))
}

/// Adds the generalised force of a force along a tendon.
#[inline(always)]
pub fn pull<L: Lane>(model: &Model<L::Real>, tendon: usize, jacobian: &[L], force: L, out: &mut [L]) {
    for (dof, j) in columns(model, tendon, jacobian) {
        out[dof] = j.mul_add(force, out[dof]);
    }
}

/// Calls `f` with the entries of Jᵀ J of a tendon that the inertia matrix has, up to the diagonal: row, column, and both columns of J. As in
/// MuJoCo, what couples branches is left out.
#[inline(always)]
fn squares<L: Lane>(model: &Model<L::Real>, tendon: usize, jacobian: &[L], mut f: impl FnMut([usize; 2], [L; 2])) {
    let columns = columns(model, tendon, jacobian);
    for (n, (i, row)) in columns.clone().enumerate() {
        let has = |k: usize| k == i || model.tree_pattern.row(i).iter().any(|run| run.range().contains(&k));
        for (k, column) in columns.clone().take(n + 1).filter(|(k, _)| has(*k)) {
            f([i, k], [row, column]);
        }
    }
}

/// Adds `scale` Jᵀ J of a tendon to a matrix stored by `model.rows`, as far as that has the entries of the inertia matrix.
#[inline(always)]
pub fn add_square<L: Lane>(model: &Model<L::Real>, tendon: usize, jacobian: &[L], scale: L, matrix: &mut [L]) {
    squares(model, tendon, jacobian, |[i, k], [row, column]| {
        let entry = &mut matrix[model.rows.at(i, k)];
        *entry = (scale * row).mul_add(column, *entry);
    });
}

/// Adds `scale` times the same matrix times `x`.
#[inline(always)]
pub fn multiply_square<L: Lane>(
    model: &Model<L::Real>,
    tendon: usize,
    jacobian: &[L],
    scale: L,
    x: &[L],
    out: &mut [L],
) {
    squares(model, tendon, jacobian, |[i, k], [row, column]| {
        let entry = scale * row * column;
        out[i] = entry.mul_add(x[k], out[i]);
        if k != i {
            out[k] = entry.mul_add(x[i], out[k]);
        }
    });
}
