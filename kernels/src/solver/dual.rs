//! The dual problem, minimise over forces: A = J M⁻¹ Jᵀ through whitened rows b = D^-½ L⁻ᵀ jᵀ, so that A = b·b and a sweep
//! over the rows is matrix-free: z = Σ b f holds what all forces do.

use super::whitened::{Layout, Whitened};
use super::{Problem, RowVector, SolverWork, contact, joints, rows};
use crate::constraint::{Constraint, ContactRow, DofLaw, DofRowKind, grow};
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
    /// Of rows of equality constraints, then of dof rows: what the [layout](Layout) says that each has.
    pub rows: Vec<L>,
    /// Products of these with themselves.
    pub diagonal: Vec<L>,
    /// Of contacts: the rows of their components, then the lower triangle of A's block. Never shorter than it once was, as the
    /// lists of [`Constraint`].
    pub contacts: Vec<L>,
    /// Σ b f.
    pub z: Vec<L>,
    /// √D⁻¹ of M's factor.
    pub root: Vec<L>,
    /// J a₀ - a_ref.
    pub bias: RowVector<L>,
    /// By how much the cost has fallen in this sweep.
    pub gain: Vec<L>,
    /// Where the listed contacts have their numbers.
    pub places: Vec<Whitened>,
    layout: Layout,
    /// A row that is whitened.
    dense: Vec<L>,
    /// Dofs that it has to do with.
    marks: Vec<bool>,
}

/// Entries of contacts for which there is room from the start; more are asked for when they are needed.
fn entries<T>(layout: &Layout, model: &Model<T>, [contacts, components]: [usize; 2]) -> usize {
    let width = (2 * layout.width()).min(model.sizes.nv);
    (components * width + 21 * contacts).min(1 << 20)
}

impl<L: Lane> Dual<L> {
    /// Room for all rows if the model's options need the dual problem, else none.
    pub fn new(model: &Model<L::Real>, rows: [usize; 3], contacts: usize) -> Self {
        let used = needed(model);
        let layout = if used { Layout::new(model) } else { Layout::default() };
        let [nv, contacts] = if used { [model.sizes.nv, contacts] } else { [0; 2] };
        let rows = if used { rows } else { [0; 3] };
        Dual {
            rows: vec![L::zero(); layout.numbers()],
            diagonal: vec![L::zero(); layout.count()],
            contacts: Vec::with_capacity(entries(&layout, model, [contacts, rows[1]])),
            z: vec![L::zero(); nv],
            root: vec![L::zero(); nv],
            bias: RowVector::with_capacity(rows),
            gain: vec![L::zero(); usize::from(used)],
            places: Vec::with_capacity(contacts),
            layout,
            dense: vec![L::zero(); nv],
            marks: vec![false; nv],
        }
    }

    /// Bytes of that.
    pub fn bytes(model: &Model<L::Real>, rows: [usize; 3], contacts: usize) -> usize {
        if !needed(model) {
            return 0;
        }
        let (nv, layout) = (model.sizes.nv, Layout::new(model));
        let numbers = layout.numbers() + layout.count() + 3 * nv + rows.iter().sum::<usize>() + 1;
        (numbers + entries(&layout, model, [contacts, rows[1]])) * size_of::<L>()
            + contacts * size_of::<Whitened>()
            + layout.bytes()
            + nv
    }

    /// Sets the lengths to those of the constraint's lists, if there is any use.
    pub fn fit(&mut self, constraint: &Constraint<L>) {
        if !self.gain.is_empty() {
            self.bias.fit(constraint);
        }
    }

    /// What the dofs of a row on joints or of an equality constraint say of it: b, and z there.
    fn row(&self, row: usize) -> impl Iterator<Item = (L, L)> {
        let (range, dofs) = self.layout.row(row);
        self.rows[range].iter().zip(dofs).map(|(b, dof)| (*b, self.z[*dof as usize]))
    }

    /// J(a₀ + M⁻¹Jᵀf) - a_ref of such a row, whose bias is given.
    pub fn residual_of_row(&self, row: usize, bias: L) -> L {
        self.row(row).fold(L::zero(), |sum, (b, z)| b.mul_add(z, sum)) + bias
    }

    /// z += b Δ for such a row.
    pub fn add_row(&mut self, row: usize, change: L) {
        pull_row(&self.layout, &self.rows, row, change, &mut self.z);
    }

    /// The same, to another z.
    pub fn pull_row(&self, row: usize, change: L, z: &mut [L]) {
        pull_row(&self.layout, &self.rows, row, change, z);
    }

    /// A's block of a contact: products of its components' rows.
    #[inline(always)]
    pub fn block(&self, row: &ContactRow, place: &Whitened) -> [[L; 6]; 6] {
        let mut out = [[L::zero(); 6]; 6];
        let mut entries = self.contacts[place.block(row)].iter();
        for i in 0..row.dim as usize {
            for (j, entry) in entries.by_ref().take(i + 1).enumerate() {
                out[i][j] = *entry;
                out[j][i] = *entry;
            }
        }
        out
    }

    /// J(a₀ + M⁻¹Jᵀf) - a_ref of a contact's component.
    #[inline(always)]
    pub fn residual_of(&self, row: &ContactRow, place: &Whitened, component: usize) -> L {
        let b = &self.contacts[place.component(component)];
        let z = place.dofs().map(|dof| &self.z[dof]);
        let product = b.iter().zip(z).fold(L::zero(), |sum, (b, z)| b.mul_add(*z, sum));
        self.bias.component[row.component as usize + component] + product
    }

    /// The same of all its components.
    #[inline(always)]
    pub fn residual(&self, row: &ContactRow, place: &Whitened) -> [L; 6] {
        let mut out = [L::zero(); 6];
        for (i, out) in out.iter_mut().enumerate().take(row.dim as usize) {
            *out = self.residual_of(row, place, i);
        }
        out
    }

    /// z += b Δ for a contact's component.
    #[inline(always)]
    pub fn add_component(&mut self, place: &Whitened, component: usize, change: L) {
        pull(&self.contacts, place, component, change, &mut self.z);
    }

    /// The same for all its components.
    #[inline(always)]
    pub fn add(&mut self, row: &ContactRow, place: &Whitened, changes: &[L; 6]) {
        for (i, change) in changes.iter().enumerate().take(row.dim as usize) {
            self.add_component(place, i, *change);
        }
    }

    /// The same, to another z.
    pub fn pull(&self, row: &ContactRow, place: &Whitened, changes: &[L; 6], z: &mut [L]) {
        for (i, change) in changes.iter().enumerate().take(row.dim as usize) {
            pull(&self.contacts, place, i, *change, z);
        }
    }

    /// Finds where the listed contacts have their numbers.
    fn lay_out(&mut self, model: &Model<L::Real>, contacts: &[ContactRow]) {
        self.places.clear();
        let mut next = [0; 2];
        for row in contacts {
            let place = self.layout.place(model, row, next);
            next = [place.end(row), place.edge + row.edges() as u32];
            self.places.push(place);
        }
        grow(&mut self.contacts, next[0] as usize, L::zero());
    }
}

fn pull_row<L: Lane>(layout: &Layout, rows: &[L], row: usize, change: L, z: &mut [L]) {
    let (range, dofs) = layout.row(row);
    for (b, dof) in rows[range].iter().zip(dofs) {
        let z = &mut z[*dof as usize];
        *z = b.mul_add(change, *z);
    }
}

#[inline(always)]
fn pull<L: Lane>(contacts: &[L], place: &Whitened, component: usize, change: L, z: &mut [L]) {
    for (b, dof) in contacts[place.component(component)].iter().zip(place.dofs()) {
        z[dof] = b.mul_add(change, z[dof]);
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

/// Whitens all rows and sets the bias and, from the forces in `work.force`, z.
pub fn prepare<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let Problem { model, acceleration, constraint, .. } = problem;
    let SolverWork { dual, fields, force, .. } = work;
    rows::apply(problem, &acceleration.qacc_smooth, &mut fields.twist, &mut dual.bias);
    rows::add_reference(problem, &mut dual.bias);
    for (root, inverse) in dual.root.iter_mut().zip(&acceleration.inverse) {
        *root = inverse.sqrt();
    }
    dual.lay_out(model, &constraint.contact_rows);
    dual.z.fill(L::zero());
    let mut r = 0;
    for equality in &model.equalities {
        for i in 0..equality.dim() {
            let columns = constraint.equality.columns(model, equality);
            whiten_row(problem, r, columns.map(|(dof, column)| (dof, column[i])), dual);
            dual.add_row(r, force.equality[r]);
            r += 1;
        }
    }
    for (law, f) in constraint.dof_laws().zip(&force.dof) {
        if law.row.tendon == NONE {
            whiten_row(problem, r, jacobian(&law), dual);
        } else {
            let columns = tendon::columns(model, law.row.tendon as usize, &problem.tendons.jacobian);
            whiten_row(problem, r, columns.map(|(dof, j)| (dof, joints::signed(&law, j))), dual);
        }
        dual.add_row(r, *f);
        r += 1;
    }
    for (i, row) in constraint.contact_rows.iter().enumerate() {
        let place = dual.places[i];
        fill(problem, row, &place, dual);
        whiten_contact(problem, row, &place, dual);
        for (i, f) in force.component[row.components()].iter().enumerate() {
            dual.add_component(&place, i, *f);
        }
    }
}

/// The Jacobian of a row on a joint.
fn jacobian<L: Lane>(law: &DofLaw<'_, L>) -> impl Iterator<Item = (usize, L)> {
    let (one, dof) = (L::one(), law.row.dof as usize);
    let (count, entries) = match law.row.kind {
        DofRowKind::Friction | DofRowKind::Lower => (1, [one; 3]),
        DofRowKind::Upper => (1, [-one; 3]),
        DofRowKind::Limit => (1, [law.sign(); 3]),
        DofRowKind::Ball => (3, law.axis().map(|axis| -axis)),
    };
    entries.into_iter().take(count).enumerate().map(move |(k, entry)| (dof + k, entry))
}

/// Whitens a row on joints or of an equality constraint.
fn whiten_row<L: Lane>(
    problem: &Problem<'_, L>,
    row: usize,
    jacobian: impl Iterator<Item = (usize, L)>,
    dual: &mut Dual<L>,
) {
    let Dual { rows, diagonal, layout, dense, root, .. } = dual;
    let (range, dofs) = layout.row(row);
    dofs.iter().for_each(|dof| dense[*dof as usize] = L::zero());
    jacobian.for_each(|(dof, j)| dense[dof] = j);
    dofs.iter().rev().for_each(|dof| eliminate(problem, root, *dof as usize, 0, dense));
    let rows = &mut rows[range];
    rows.iter_mut().zip(dofs).for_each(|(b, dof)| *b = dense[*dof as usize]);
    diagonal[row] = product(rows, rows);
}

/// Dense Jacobian rows of a contact; marks the dofs that it has to do with.
fn fill<L: Lane>(problem: &Problem<'_, L>, row: &ContactRow, place: &Whitened, dual: &mut Dual<L>) {
    let Problem { model, position, constraint, .. } = *problem;
    let Dual { contacts, marks, .. } = dual;
    let (b, width) = (&mut contacts[place.rows(row)], place.width());
    b.fill(L::zero());
    if row.sides != Sides::One {
        for (dof, column) in contact::columns(&model, constraint, row) {
            marks[dof] = true;
            let at = place.at(dof);
            column.iter().enumerate().for_each(|(i, j)| b[i * width + at] = *j);
        }
        return;
    }
    let motion = &constraint.motion[row.components()];
    let mut dof = model.links[row.link as usize].last_dof();
    while dof != NONE {
        let (cdof, at) = (&position.cdof[dof as usize], place.at(dof as usize));
        motion.iter().enumerate().for_each(|(i, w)| b[i * width + at] = dot6(w, cdof));
        marks[dof as usize] = true;
        dof = model.dofs[dof as usize].parent;
    }
}

/// Whitens the rows of a contact, and finds A's block.
fn whiten_contact<L: Lane>(problem: &Problem<'_, L>, row: &ContactRow, place: &Whitened, dual: &mut Dual<L>) {
    let Dual { contacts, marks, root, .. } = dual;
    for (span, first) in place.spans() {
        for dof in span.range().rev() {
            if !std::mem::take(&mut marks[dof]) {
                continue;
            }
            problem.model.tree_pattern.row(dof).iter().for_each(|run| marks[run.range()].fill(true));
            for b in contacts[place.rows(row)].chunks_exact_mut(place.width()) {
                eliminate(problem, root, dof, span.start as usize, &mut b[first..]);
            }
        }
    }
    let (rows, block) = contacts[place.start as usize..].split_at_mut(place.rows(row).len());
    let mut entries = block.iter_mut();
    let component = |i: usize| &rows[i * place.width()..][..place.width()];
    for i in 0..row.dim as usize {
        for (j, entry) in entries.by_ref().take(i + 1).enumerate() {
            *entry = product(component(i), component(j));
        }
    }
}

/// A step from jᵀ to D^-½ L⁻ᵀ jᵀ, whose entries begin with that of dof `first`: those of a dof and of all that it is coupled to.
#[inline(always)]
fn eliminate<L: Lane>(problem: &Problem<'_, L>, root: &[L], dof: usize, first: usize, j: &mut [L]) {
    let Problem { model, acceleration, .. } = problem;
    let y = j[dof - first] * acceleration.inverse[dof];
    ldl::for_each_entry(&model.rows, &model.tree_pattern, &acceleration.factor, dof, |columns, row| {
        for (j, u) in j[columns.start - first..].iter_mut().zip(row) {
            *j = y.neg_mul_add(*u, *j);
        }
    });
    j[dof - first] *= root[dof];
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
