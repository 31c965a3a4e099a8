//! Acceleration of sweeps (Anderson, Iterative procedures for nonlinear integral equations, 1965; Walker and Ni, Anderson
//! acceleration for fixed-point iterations, 2011).
//!
//! A sweep takes forces x to g(x), and is done where they agree. From what the last sweeps changed, the combination of their ends
//! is found of which a sweep would change least, were it linear. It is projected on the cones, and taken where it costs less than
//! the sweep's own end; so the cost falls from sweep to sweep, whatever rows do.
//!
//! Lengths are measured in the dual problem's own matrix, xᵀ(A + R)x = z·z + xᵀR x with z = Σ b x: forces and torques count by what
//! they do, and rows that do the same count once. So a point is its forces followed by z.

use super::{Problem, SolverWork, joints, pgs};
use crate::constraint::{Cone, Constraint, ContactRow, DofRowKind, Law};
use crate::lane::{Lane, Real};
use crate::model::Span;

/// Sweeps that are remembered.
const MEMORY: usize = 12;

/// What the last sweeps did. Lists of points hold one after the other.
#[derive(Clone, Debug)]
pub struct Anderson<L> {
    /// Length of a point.
    len: usize,
    /// Of them forces.
    forces: usize,
    /// Stretches of a point that can change in some world that still iterates.
    live: Vec<Span>,
    /// R of the forces, then 1.
    weight: Vec<L>,
    /// Slope of the cost at no force, then 0.
    bias: Vec<L>,
    /// Where the sweep began.
    before: Vec<L>,
    /// Where it ended, and where the one before did.
    after: [Vec<L>; 2],
    /// What it changed, and what the one before did.
    change: [Vec<L>; 2],
    /// Differences of successive changes.
    changes: Vec<L>,
    /// Differences of successive ends.
    ends: Vec<L>,
    /// Products of the differences of changes.
    gram: [[L; MEMORY]; MEMORY],
    /// Products of the differences with the last change, by place.
    along: [L; MEMORY],
    /// The last change, weighted.
    weighted: Vec<L>,
    /// A step from the end.
    step: Vec<L>,
    /// Sweeps so far.
    sweeps: usize,
}

/// Room for a point, and for a list of them. More than a million numbers are asked for when they are needed.
fn room_of(len: usize) -> [usize; 2] {
    [len, MEMORY * len].map(|n| n.min(1 << 20))
}

impl<L: Lane> Default for Anderson<L> {
    fn default() -> Self {
        Anderson::new()
    }
}

impl<L: Lane> Anderson<L> {
    /// Knows nothing, and has no room.
    pub fn new() -> Self {
        Anderson {
            len: 0,
            forces: 0,
            live: Vec::new(),
            weight: Vec::new(),
            bias: Vec::new(),
            before: Vec::new(),
            after: [Vec::new(), Vec::new()],
            change: [Vec::new(), Vec::new()],
            changes: Vec::new(),
            ends: Vec::new(),
            gram: [[L::zero(); MEMORY]; MEMORY],
            along: [L::zero(); MEMORY],
            weighted: Vec::new(),
            step: Vec::new(),
            sweeps: 0,
        }
    }

    /// The same with room for points of that length.
    pub fn with_capacity(len: usize) -> Self {
        let room = Vec::with_capacity;
        let [point, list] = room_of(len);
        Anderson {
            weight: room(point),
            bias: room(point),
            before: room(point),
            after: [room(point), room(point)],
            change: [room(point), room(point)],
            changes: room(list),
            ends: room(list),
            weighted: room(point),
            step: room(point),
            live: Vec::with_capacity(point),
            ..Anderson::new()
        }
    }

    /// Bytes of that.
    pub fn bytes(len: usize) -> usize {
        let [point, list] = room_of(len);
        (9 * point + 2 * list) * size_of::<L>() + point * size_of::<Span>()
    }

    /// A solve begins, from rows that are whitened.
    pub fn begin(&mut self, problem: &Problem<'_, L>, work: &SolverWork<L>) {
        let constraint = problem.constraint;
        self.weight.clear();
        self.weight.extend(constraint.equality.d.iter().map(|d| pgs::regulariser(*d)));
        self.weight.extend(constraint.dof_laws().map(|law| pgs::regulariser(law.d())));
        self.bias.clone_from(&work.dual.bias.equality);
        self.bias.extend_from_slice(&work.dual.bias.dof);
        for row in &constraint.contact_rows {
            let (law, bias) = (constraint.law(row), &work.dual.bias.component[row.components()]);
            let base = pgs::regulariser(law.d());
            for i in 0..entries(row) {
                let (j, mu) = edge(law, i);
                self.bias.push(if row.cone == Cone::Pyramid { mu.mul_add(bias[j], bias[0]) } else { bias[i] });
                let ratio = if row.cone == Cone::Ellipse && i > 0 { law.mu() / law.friction(i) } else { L::one() };
                self.weight.push(base * ratio * ratio);
            }
        }
        self.forces = self.weight.len();
        self.len = self.forces + work.dual.z.len();
        self.weight.resize(self.len, L::one());
        self.bias.resize(self.len, L::zero());
        for list in [&mut self.changes, &mut self.ends] {
            list.resize(MEMORY * self.len, L::zero());
        }
        self.weighted.resize(self.len, L::zero());
        self.sweeps = 0;
        read(constraint, work, &mut self.before);
    }

    /// A sweep has ended: goes on to where the past says, in the lanes of `open` where that costs less. Forces of rows that act in none of
    /// the worlds of `acting` stay what they are, and are passed over.
    pub fn accelerate(&mut self, problem: &Problem<'_, L>, (acting, open): (u32, L::Mask), work: &mut SolverWork<L>) {
        self.after.swap(0, 1);
        self.change.swap(0, 1);
        read(problem.constraint, work, &mut self.after[0]);
        self.change[0].clear();
        self.change[0].extend(self.after[0].iter().zip(&self.before).map(|(after, before)| *after - *before));
        self.before.clone_from(&self.after[0]);
        self.sweeps += 1;
        if self.sweeps == 1 {
            return;
        }
        self.find_live(problem.constraint, acting);
        self.note();
        self.combine();
        self.project(problem, acting);
        self.whiten(problem.constraint, acting, work);
        let mut rise = L::zero();
        for i in self.live.iter().flat_map(|span| span.range()) {
            let step = self.step[i];
            let middle = step.mul_add(L::of(0.5), self.after[0][i]);
            rise = step.mul_add(self.weight[i].mul_add(middle, self.bias[i]), rise);
        }
        self.take(problem.constraint, (acting, open & rise.lt(L::zero())), work);
    }

    /// Finds the stretches that can change in worlds of `acting`, which are fewer from sweep to sweep.
    fn find_live(&mut self, constraint: &Constraint<L>, acting: u32) {
        let (live, mut at) = (&mut self.live, 0);
        live.clear();
        let mut add = |len: usize, lanes: u32| {
            let span = Span { start: at, len: len as u32 };
            at += span.len;
            match live.last_mut() {
                _ if lanes & acting == 0 || len == 0 => {}
                Some(last) if last.start + last.len == span.start => last.len += span.len,
                _ => live.push(span),
            }
        };
        add(constraint.equality.d.len(), constraint.equality.lanes);
        add(constraint.dof_rows.len(), constraint.joint_lanes);
        constraint.contact_rows.iter().for_each(|row| add(entries(row), row.lanes));
        add(self.len - self.forces, acting);
    }

    /// Place of the difference that was noted `age` sweeps ago.
    fn place(&self, age: usize) -> usize {
        (self.sweeps - 2 - age) % MEMORY
    }

    /// Number of differences noted.
    fn known(&self) -> usize {
        (self.sweeps - 1).min(MEMORY)
    }

    /// Notes by how much the last sweep differs from the one before.
    fn note(&mut self) {
        let (new, len, known) = (self.place(0), self.len, self.known());
        let Anderson { live, change, after, changes, ends, weight, weighted, gram, along, .. } = self;
        for (list, [now, last]) in [(&mut *changes, &*change), (ends, &*after)] {
            let list = &mut list[new * len..(new + 1) * len];
            for range in live.iter().map(|span| span.range()) {
                let (now, last) = (&now[range.clone()], &last[range.clone()]);
                list[range].iter_mut().zip(now.iter().zip(last)).for_each(|(out, (now, last))| *out = *now - *last);
            }
        }
        let mut square = L::zero();
        for i in live.iter().flat_map(|span| span.range()) {
            let difference = changes[new * len + i];
            weighted[i] = weight[i] * change[0][i];
            square = (weight[i] * difference).mul_add(difference, square);
        }
        // By what the change has changed, products with it have, too.
        let before = *along;
        let (fours, rest) = along[..known].as_chunks_mut::<4>();
        let list = |place: usize| &changes[place * len..(place + 1) * len];
        for (n, four) in fours.iter_mut().enumerate() {
            *four = products(live, weighted, [0, 1, 2, 3].map(|i| list(4 * n + i)));
        }
        for (sum, place) in rest.iter_mut().zip(known / 4 * 4..) {
            [*sum] = products(live, weighted, [list(place)]);
        }
        for old in 0..known {
            let product = if old == new { square } else { along[old] - before[old] };
            (gram[new][old], gram[old][new]) = (product, product);
        }
    }

    /// Sets the step to the combination of ends whose sweep would change least. By LDLᵀ, the latest difference first; those
    /// that say nothing new but for rounding count nothing.
    fn combine(&mut self) {
        let (n, zero) = (self.known(), L::zero());
        let rounding = L::of(L::Real::EPSILON.sqrt());
        let (mut l, mut d, mut x) = ([[zero; MEMORY]; MEMORY], [zero; MEMORY], [zero; MEMORY]);
        let mut inverse = [zero; MEMORY];
        for i in 0..n {
            let place = self.place(i);
            let mut sum = self.along[place];
            for j in 0..i {
                let mut entry = self.gram[place][self.place(j)];
                for k in 0..j {
                    entry = (l[i][k] * d[k]).neg_mul_add(l[j][k], entry);
                }
                l[i][j] = entry * inverse[j];
                sum = l[i][j].neg_mul_add(x[j], sum);
            }
            x[i] = sum;
            let diagonal = self.gram[place][place];
            let mut pivot = diagonal;
            for k in 0..i {
                pivot = (l[i][k] * d[k]).neg_mul_add(l[i][k], pivot);
            }
            let counts = pivot.gt(diagonal * rounding);
            d[i] = L::select(counts, pivot, zero);
            inverse[i] = L::select(counts, L::one() / L::select(counts, pivot, L::one()), zero);
        }
        let mut shares = [zero; MEMORY];
        for i in (0..n).rev() {
            let mut share = x[i] * inverse[i];
            for k in i + 1..n {
                share = l[k][i].neg_mul_add(x[k], share);
            }
            x[i] = share;
            shares[self.place(i)] = share;
        }
        self.step.clear();
        self.step.resize(self.forces, zero);
        let Anderson { live, step, ends, len, .. } = self;
        let (fours, rest) = shares[..n].as_chunks::<4>();
        let list = |place: usize| &ends[place * *len..(place + 1) * *len];
        for (n, four) in fours.iter().enumerate() {
            go_back(live, step, [0, 1, 2, 3].map(|i| list(4 * n + i)), *four);
        }
        for (share, place) in rest.iter().zip(n / 4 * 4..) {
            go_back(live, step, [list(place)], [*share]);
        }
    }

    /// Shortens the step so that forces stay within their cones.
    fn project(&mut self, problem: &Problem<'_, L>, acting: u32) {
        let constraint = problem.constraint;
        let Anderson { after: [after, _], step, .. } = self;
        let zero = L::zero();
        let confine = |step: &mut L, after: L, low: L, high: L| *step = (after + *step).max(low).min(high) - after;
        let most = L::of(L::Real::MAX);
        // Equality constraints pull both ways.
        let (_, step) = step.split_at_mut(constraint.equality.d.len());
        let (_, after) = after.split_at(constraint.equality.d.len());
        let none = constraint.joint_lanes & acting == 0;
        for (r, law) in constraint.dof_laws().enumerate().take(if none { 0 } else { usize::MAX }) {
            let (low, high) = match law.row.kind {
                DofRowKind::Friction => (-joints::bound(problem.model, &law), joints::bound(problem.model, &law)),
                _ => (zero, most),
            };
            confine(&mut step[r], after[r], low, high);
        }
        let mut at = constraint.dof_rows.len();
        for row in &constraint.contact_rows {
            let range = at..at + entries(row);
            at = range.end;
            if row.lanes & acting == 0 {
                continue;
            }
            let (step, after) = (&mut step[range.clone()], &after[range]);
            if row.cone == Cone::Ellipse {
                confine_ellipse(constraint.law(row), step, after);
            } else {
                step.iter_mut().zip(after).for_each(|(step, after)| confine(step, *after, zero, most));
            }
        }
    }

    /// Appends to the step's forces what they do to z.
    fn whiten(&mut self, constraint: &Constraint<L>, acting: u32, work: &SolverWork<L>) {
        self.step.resize(self.len, L::zero());
        let (forces, z) = self.step.split_at_mut(self.forces);
        let (rows, mut rest) = forces.split_at(constraint.equality.d.len() + constraint.dof_rows.len());
        if (constraint.equality.lanes | constraint.joint_lanes) & acting != 0 {
            rows.iter().enumerate().for_each(|(r, step)| work.dual.pull_row(r, *step, z));
        }
        for (row, place) in constraint.contact_rows.iter().zip(&work.dual.places) {
            let step = rest.split_off(..entries(row)).unwrap_or_default();
            if row.lanes & acting == 0 {
                continue;
            }
            work.dual.pull(row, place, &components(constraint.law(row), row, step), z);
        }
    }

    /// Takes the step in the given lanes: there the next sweep begins.
    fn take(&mut self, constraint: &Constraint<L>, (acting, lanes): (u32, L::Mask), work: &mut SolverWork<L>) {
        // To another place than the numbers come from: a blend in place would become a masked store, which is slow.
        let Anderson { before, after: [after, _], step, live, forces, .. } = self;
        for range in live.iter().map(|span| span.range()) {
            let ends = after[range.clone()].iter().zip(&step[range.clone()]);
            for (next, (end, step)) in before[range].iter_mut().zip(ends) {
                *next = L::select(lanes, *end + *step, *end);
            }
        }
        let (mut next, z) = before.split_at(*forces);
        let mut steps = &step[constraint.equality.d.len() + constraint.dof_rows.len()..*forces];
        work.dual.z.copy_from_slice(z);
        for list in [&mut work.force.equality, &mut work.force.dof] {
            let len = list.len();
            list.copy_from_slice(next.split_off(..len).unwrap_or_default());
        }
        for (row, place) in constraint.contact_rows.iter().zip(&work.dual.places) {
            let next = next.split_off(..entries(row)).unwrap_or_default();
            let step = steps.split_off(..entries(row)).unwrap_or_default();
            let force = &mut work.force.component[row.components()];
            if row.lanes & acting == 0 {
                continue;
            }
            if row.cone != Cone::Pyramid {
                force.copy_from_slice(next);
                continue;
            }
            work.edge_force[place.edges(row)].copy_from_slice(next);
            let components = components(constraint.law(row), row, step);
            force.iter_mut().zip(components).for_each(|(f, step)| *f = L::select(lanes, *f + step, *f));
        }
    }
}

/// Products of a vector with others, over the given stretches; several at once, as one sum after the other would wait for its
/// own additions.
fn products<L: Lane, const N: usize>(live: &[Span], vector: &[L], others: [&[L]; N]) -> [L; N] {
    let mut sums = [L::zero(); N];
    for range in live.iter().map(|span| span.range()) {
        let vector = &vector[range.clone()];
        let others = others.map(|other| &other[range.clone()][..vector.len()]);
        for (i, x) in vector.iter().enumerate() {
            for (sum, other) in sums.iter_mut().zip(&others) {
                *sum = x.mul_add(other[i], *sum);
            }
        }
    }
    sums
}

/// Takes shares of vectors from a step, over the given stretches as far as it goes.
fn go_back<L: Lane, const N: usize>(live: &[Span], step: &mut [L], vectors: [&[L]; N], shares: [L; N]) {
    for range in live.iter().map(|span| span.range()) {
        let range = range.start.min(step.len())..range.end.min(step.len());
        let step = &mut step[range.clone()];
        let vectors = vectors.map(|vector| &vector[range.clone()][..step.len()]);
        for (i, step) in step.iter_mut().enumerate() {
            for (share, vector) in shares.iter().zip(&vectors) {
                *step = share.neg_mul_add(vector[i], *step);
            }
        }
    }
}

/// Number of forces of a contact: of a pyramid's edges, or of components.
fn entries(row: &ContactRow) -> usize {
    if row.cone == Cone::Pyramid { row.edges() } else { row.dim as usize }
}

/// Component of an edge of a pyramid, and its friction with the edge's sign.
fn edge<L: Lane>(law: Law<'_, L>, edge: usize) -> (usize, L) {
    let j = edge / 2 + 1;
    let mu = if law.cone == Cone::Pyramid { law.friction(j) } else { L::zero() };
    (j, if edge.is_multiple_of(2) { mu } else { -mu })
}

/// Forces of a contact by component.
fn components<L: Lane>(law: Law<'_, L>, row: &ContactRow, forces: &[L]) -> [L; 6] {
    let mut out = [L::zero(); 6];
    for (i, f) in forces.iter().enumerate() {
        if row.cone == Cone::Pyramid {
            let (j, mu) = edge(law, i);
            out[0] += *f;
            out[j] = mu.mul_add(*f, out[j]);
        } else {
            out[i] = *f;
        }
    }
    out
}

/// Shortens a step so that it ends within an elliptic cone: the normal force pulls, and friction is scaled to what that bears.
fn confine_ellipse<L: Lane>(law: Law<'_, L>, step: &mut [L], after: &[L]) {
    let normal = (after[0] + step[0]).max(L::zero());
    let mut squares = L::zero();
    for i in 1..step.len() {
        let u = (after[i] + step[i]) / law.friction(i);
        squares = u.mul_add(u, squares);
    }
    let scale = (normal / squares.sqrt().max(L::of(L::Real::TINY))).min(L::one());
    step[0] = normal - after[0];
    for i in 1..step.len() {
        step[i] = scale.mul_add(after[i] + step[i], -after[i]);
    }
}

/// The point at which the solver is.
fn read<L: Lane>(constraint: &Constraint<L>, work: &SolverWork<L>, point: &mut Vec<L>) {
    point.clear();
    point.extend_from_slice(&work.force.equality);
    point.extend_from_slice(&work.force.dof);
    let mut rest = &work.edge_force[..];
    for row in &constraint.contact_rows {
        if row.cone == Cone::Pyramid {
            point.extend_from_slice(rest.split_off(..row.edges()).unwrap_or_default());
        } else {
            point.extend_from_slice(&work.force.component[row.components()]);
        }
    }
    point.extend_from_slice(&work.dual.z);
}
