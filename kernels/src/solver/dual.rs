//! The dual problem, minimise over forces: A = J M⁻¹ Jᵀ through whitened rows b = D^-½ L⁻ᵀ jᵀ, so that A = b·b and a sweep
//! over the rows is matrix-free: z = Σ b f holds what all forces do.

use super::{Problem, RowVector, SolverWork, contact, joints, rows};
use crate::constraint::{Constraint, ContactRow, DofRowKind};
use crate::lane::Lane;
use crate::math::ldl;
use crate::math::spatial::dot6;
use crate::model::{Model, NONE, Sides};
use crate::options;
use crate::tendon;

/// Whether the model's options need the dual problem.
pub fn needed<T>(model: &Model<T>) -> bool {
    model.options.solver == options::Solver::Pgs || model.options.noslip_iterations > 0
}

/// Whitened rows, and what all forces together do.
#[derive(Clone, Debug)]
pub struct Dual<L> {
    /// `nv` numbers per row of equality constraints, then per dof row, then per contact component.
    pub b: Vec<L>,
    /// Σ b f.
    pub z: Vec<L>,
    /// √D⁻¹ of M's factor.
    pub root: Vec<L>,
    /// J a₀ - a_ref.
    pub bias: RowVector<L>,
    nv: usize,
}

impl<L: Lane> Dual<L> {
    /// Room for all rows if the model's options need the dual problem, else none.
    pub fn new(model: &Model<L::Real>, rows: [usize; 3]) -> Self {
        let used = needed(model);
        let nv = if used { model.sizes.nv } else { 0 };
        Dual {
            b: Vec::with_capacity((rows.iter().sum::<usize>() * nv).min(1 << 20)),
            z: vec![L::zero(); nv],
            root: vec![L::zero(); nv],
            bias: RowVector::with_capacity(if used { rows } else { [0; 3] }),
            nv,
        }
    }

    /// Bytes of that.
    pub fn bytes(model: &Model<L::Real>, rows: usize) -> usize {
        let nv = model.sizes.nv;
        if needed(model) { ((rows * nv).min(1 << 20) + 2 * nv + rows) * size_of::<L>() } else { 0 }
    }

    /// The whitened row of an equality constraint.
    pub fn equality(&self, row: usize) -> &[L] {
        &self.b[row * self.nv..(row + 1) * self.nv]
    }

    /// The whitened row of a dof row.
    pub fn dof(&self, row: usize) -> &[L] {
        self.equality(self.bias.equality.len() + row)
    }

    /// The whitened row of a contact component.
    pub fn component(&self, component: usize) -> &[L] {
        self.dof(self.bias.dof.len() + component)
    }

    /// A's block of a contact: products of its components' rows.
    pub fn block(&self, row: &ContactRow) -> [[L; 6]; 6] {
        let mut out = [[L::zero(); 6]; 6];
        for i in 0..row.dim as usize {
            for j in 0..=i {
                let (bi, bj) = (self.component(row.component as usize + i), self.component(row.component as usize + j));
                out[i][j] = product(bi, bj);
                out[j][i] = out[i][j];
            }
        }
        out
    }

    /// J(a₀ + M⁻¹Jᵀf) - a_ref of a contact's components.
    pub fn residual(&self, row: &ContactRow) -> [L; 6] {
        let mut out = [L::zero(); 6];
        for (i, out) in out.iter_mut().enumerate().take(row.dim as usize) {
            let at = row.component as usize + i;
            *out = self.bias.component[at] + product(self.component(at), &self.z);
        }
        out
    }

    /// z += b Δ for a contact's components.
    pub fn add(&mut self, row: &ContactRow, change: &[L; 6]) {
        for (i, change) in change.iter().enumerate().take(row.dim as usize) {
            let at = self.bias.equality.len() + self.bias.dof.len() + row.component as usize + i;
            self.add_at(at, *change);
        }
    }

    /// z += b Δ for a dof row.
    pub fn add_dof(&mut self, row: usize, change: L) {
        self.add_at(self.bias.equality.len() + row, change);
    }

    /// z += b Δ for a row of an equality constraint.
    pub fn add_equality(&mut self, row: usize, change: L) {
        self.add_at(row, change);
    }

    fn add_at(&mut self, row: usize, change: L) {
        add_scaled(&mut self.z, &self.b[row * self.nv..(row + 1) * self.nv], change);
    }
}

/// a · b
pub fn product<L: Lane>(a: &[L], b: &[L]) -> L {
    let mut sum = L::zero();
    for (x, y) in a.iter().zip(b) {
        sum = x.mul_add(*y, sum);
    }
    sum
}

/// z += b · factor
pub(super) fn add_scaled<L: Lane>(z: &mut [L], b: &[L], factor: L) {
    for (z, b) in z.iter_mut().zip(b) {
        *z = b.mul_add(factor, *z);
    }
}

/// Whitens all rows and sets the bias and, from the forces in `work.force`, z.
pub fn prepare<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let Problem { acceleration, constraint, .. } = problem;
    let SolverWork { dual, fields, force, .. } = work;
    dual.bias.fit(constraint);
    rows::apply(problem, &acceleration.qacc_smooth, &mut fields.twist, &mut dual.bias);
    rows::add_reference(problem, &mut dual.bias);
    for (root, inverse) in dual.root.iter_mut().zip(&acceleration.inverse) {
        *root = inverse.sqrt();
    }
    fill_rows(problem, dual);
    let nv = dual.nv;
    let Dual { b, root, z, .. } = dual;
    z.fill(L::zero());
    for (b, f) in b.chunks_exact_mut(nv.max(1)).zip(force.equality.iter().chain(&force.dof).chain(&force.component)) {
        whiten(problem, root, b);
        add_scaled(z, b, *f);
    }
}

/// Dense Jacobian rows.
fn fill_rows<L: Lane>(problem: &Problem<'_, L>, dual: &mut Dual<L>) {
    let Problem { model, position, tendons, constraint, .. } = *problem;
    let Constraint { dof_rows, contact_rows, motion, .. } = constraint;
    let Dual { b, nv, .. } = dual;
    b.clear();
    let ne = model.sizes.ne;
    b.resize((ne + dof_rows.len() + constraint.components) * *nv, L::zero());
    for equality in &model.equalities {
        for (dof, column) in constraint.equality.columns(model, equality) {
            for (row, j) in equality.rows().zip(column) {
                b[row * *nv + dof] = *j;
            }
        }
    }
    let (one, at) = (L::one(), |row: usize, dof: usize| (ne + row) * *nv + dof);
    for (r, law) in constraint.dof_laws().enumerate() {
        let dof = law.row.dof as usize;
        if law.row.tendon != NONE {
            for (dof, j) in tendon::columns(model, law.row.tendon as usize, &tendons.jacobian) {
                b[at(r, dof)] = joints::signed(&law, j);
            }
            continue;
        }
        match law.row.kind {
            DofRowKind::Friction | DofRowKind::Lower => b[at(r, dof)] = one,
            DofRowKind::Upper => b[at(r, dof)] = -one,
            DofRowKind::Limit => b[at(r, dof)] = law.sign(),
            DofRowKind::Ball => (0..3).for_each(|k| b[at(r, dof + k)] = -law.axis()[k]),
        }
    }
    for row in contact_rows {
        if row.sides != Sides::One {
            for (dof, column) in contact::columns(model, constraint, row) {
                for (i, j) in row.components().zip(column) {
                    b[at(dof_rows.len() + i, dof)] = *j;
                }
            }
            continue;
        }
        let mut dof = model.links[row.link as usize].last_dof();
        while dof != NONE {
            let cdof = &position.cdof[dof as usize];
            for i in row.components() {
                b[at(dof_rows.len() + i, dof as usize)] = dot6(&motion[i], cdof);
            }
            dof = model.dofs[dof as usize].parent;
        }
    }
}

/// j becomes D^-½ L⁻ᵀ jᵀ.
fn whiten<L: Lane>(problem: &Problem<'_, L>, root: &[L], j: &mut [L]) {
    let Problem { model, acceleration, .. } = problem;
    for k in (0..j.len()).rev() {
        let y = j[k] * acceleration.inverse[k];
        ldl::for_each_entry(&model.rows, &model.tree_pattern, &acceleration.factor, k, |columns, row| {
            for (j, u) in j[columns].iter_mut().zip(row) {
                *j = y.neg_mul_add(*u, *j);
            }
        });
        j[k] *= root[k];
    }
}

/// Sets qacc = a₀ + M⁻¹Jᵀf from z, and Jᵀf from the row forces.
pub fn finish<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let Problem { model, acceleration, .. } = problem;
    rows::transpose(problem, work);
    let Dual { z, root, .. } = &work.dual;
    let change = &mut work.fields.search;
    for k in 0..z.len() {
        let mut sum = L::zero();
        ldl::for_each_entry(&model.rows, &model.tree_pattern, &acceleration.factor, k, |columns, row| {
            for (x, u) in change[columns].iter().zip(row) {
                sum = x.mul_add(*u, sum);
            }
        });
        change[k] = sum.neg_mul_add(acceleration.inverse[k], z[k] * root[k]);
    }
    for (a, (a0, change)) in work.fields.qacc.iter_mut().zip(acceleration.qacc_smooth.iter().zip(change.iter())) {
        *a = *a0 + *change;
    }
}
