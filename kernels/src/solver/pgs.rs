//! Projected Gauss-Seidel on the dual problem: ½ fᵀ(A + R)f + fᵀ(J a₀ - a_ref) over forces within their cones, contact by
//! contact in a fixed order.
//!
//! Limits and pyramid edges are scalar rows. An elliptic contact moves along the ray through its force, then its friction
//! is minimised with the normal force fixed. Between sweeps, forces move on to where the last sweeps say together.

use super::{Dual, Problem, SolverWork, Whitened, dual, joints, qcqp, rows};
use crate::constraint::{Cone, Constraint, ContactRow, DofRowKind, Law, grow};
use crate::lane::{Lane, Mask, Real};
use crate::math::vec3::build;

/// Forces of the warm start's acceleration where their dual cost is negative, else none.
pub fn start<L: Lane>(problem: &Problem<'_, L>, warmstart: &[L], work: &mut SolverWork<L>) {
    let constraint = problem.constraint;
    let warm = &mut work.fields.search;
    for (warm, (smooth, change)) in warm.iter_mut().zip(problem.acceleration.qacc_smooth.iter().zip(warmstart)) {
        *warm = *smooth + *change;
    }
    rows::apply(problem, warm, &mut work.fields.twist, &mut work.y);
    rows::add_reference(problem, &mut work.y);
    rows::from_y(problem, &work.y, &mut work.force);
    edge_forces(constraint, work);
    dual::prepare(problem, work);
    // fᵀA f = z·z, fᵀR f = -y·f where the force map is linear, row by row the same as twice its cost.
    let mut cost = dual::product(&work.dual.z, &work.dual.z) * L::of(0.5) + rows::cost(problem, &work.y);
    for (f, bias) in work.force.dof.iter().zip(&work.dual.bias.dof) {
        cost = f.mul_add(*bias, cost);
    }
    for (f, bias) in work.force.equality.iter().zip(&work.dual.bias.equality) {
        cost = f.mul_add(*bias, cost);
    }
    for (f, bias) in work.force.component[..constraint.components].iter().zip(&work.dual.bias.component) {
        cost = f.mul_add(*bias, cost);
    }
    let keep = if problem.model.options.flags.warmstart { cost.lt(L::zero()) } else { L::Mask::splat(false) };
    let forces = work.force.dof.iter_mut().chain(&mut work.force.component).chain(&mut work.edge_force);
    for x in forces.chain(&mut work.force.equality).chain(&mut work.dual.z) {
        *x = L::select(keep, *x, L::zero());
    }
}

/// Edge forces of pyramids from y. Their list, too, never gets shorter.
pub fn edge_forces<L: Lane>(constraint: &Constraint<L>, work: &mut SolverWork<L>) {
    let count = constraint.contact_rows.iter().map(ContactRow::edges).sum();
    grow(&mut work.edge_force, count, L::zero());
    let mut edges = work.edge_force.chunks_exact_mut(2);
    for row in constraint.contact_rows.iter().filter(|row| row.cone == Cone::Pyramid) {
        let law = constraint.law(row);
        let y = &work.y.component[row.components()];
        for ((j, y_j), forces) in (1..).zip(&y[1..]).zip(&mut edges) {
            let mu = law.friction(j);
            let force = |y: L| -(law.d() * y.min(L::zero()));
            forces.copy_from_slice(&[force(mu.mul_add(*y_j, y[0])), force(mu.neg_mul_add(*y_j, y[0]))]);
        }
    }
}

/// Begins a sweep: over the rows of equality constraints and on joints. The gain of a sweep is by how much the cost falls. On the way
/// to a block's minimum it falls by at least half the square ΔᵀAΔ of the change: this bound stands in where rounding leaves no
/// better number, else noise would end the sweeps.
pub fn sweep_rows<L: Lane>(problem: &Problem<'_, L>, open: L::Mask, work: &mut SolverWork<L>) {
    let Problem { model, constraint, .. } = problem;
    let SolverWork { dual, force, .. } = work;
    let (most, mut gain) = (L::of(L::Real::MAX), L::zero());
    let mut sweep = |dual: &mut Dual<L>, row: usize, bias: L, d: L, f: &mut L, [low, high]: [L; 2]| {
        let regulariser = regulariser(d);
        let residual = dual.residual_of_row(row, bias) + regulariser * *f;
        let diagonal = dual.diagonal[row] + regulariser;
        let (change, fall) = scalar(f, residual, diagonal, low, high, open & d.gt(L::zero()));
        gain += fall;
        dual.add_row(row, change);
    };
    let equality = &constraint.equality;
    for (row, d) in equality.d.iter().enumerate() {
        sweep(dual, row, dual.bias.equality[row], *d, &mut force.equality[row], [-most, most]);
    }
    for (r, law) in constraint.dof_laws().enumerate() {
        let bounds = match law.row.kind {
            DofRowKind::Friction => [-joints::bound(*model, &law), joints::bound(*model, &law)],
            _ => [L::zero(), most],
        };
        sweep(dual, equality.d.len() + r, dual.bias.dof[r], law.d(), &mut force.dof[r], bounds);
    }
    dual.gain[0] = gain;
}

/// Goes on with a contact.
pub fn sweep_contact<L: Lane>(
    problem: &Problem<'_, L>,
    (row, place): (&ContactRow, &Whitened),
    open: L::Mask,
    work: &mut SolverWork<L>,
) {
    let SolverWork { dual, force, edge_force, .. } = work;
    let law = problem.constraint.law(row);
    let acts = open & law.d().gt(L::zero());
    let (block, residual) = (dual.block(row, place), dual.residual(row, place));
    let force = &mut force.component[row.components()];
    let (change, gain) = match row.cone {
        Cone::Ray => ray(law, &block, residual, force, acts),
        Cone::Pyramid => pyramid(law, &block, residual, &mut edge_force[place.edges(row)], force, acts),
        Cone::Ellipse => ellipse(law, &block, residual, force, acts),
    };
    dual.gain[0] += gain;
    dual.add(row, place, &change);
}

/// 1/D where the row acts, else 1.
#[inline(always)]
pub(super) fn regulariser<L: Lane>(d: L) -> L {
    L::one() / L::select(d.gt(L::zero()), d, L::one())
}

/// The best force of a scalar row, its change in the lanes of `acts`, and by how much the cost falls.
#[inline(always)]
pub(super) fn scalar<L: Lane>(f: &mut L, residual: L, diagonal: L, low: L, high: L, acts: L::Mask) -> (L, L) {
    let next = (*f - residual / diagonal).max(low).min(high);
    let change = L::select(acts, next - *f, L::zero());
    *f = L::select(acts, next, *f);
    let half = change * diagonal * L::of(0.5);
    (change, (-(change * (half + residual))).max(change * half))
}

fn ray<L: Lane>(law: Law<'_, L>, block: &[[L; 6]; 6], residual: [L; 6], force: &mut [L], acts: L::Mask) -> ([L; 6], L) {
    let regulariser = regulariser(law.d());
    let (residual, diagonal) = (regulariser.mul_add(force[0], residual[0]), block[0][0] + regulariser);
    let mut out = [L::zero(); 6];
    let (change, gain) = scalar(&mut force[0], residual, diagonal, L::zero(), L::of(L::Real::MAX), acts);
    out[0] = change;
    (out, gain)
}

fn pyramid<L: Lane>(
    law: Law<'_, L>,
    block: &[[L; 6]; 6],
    mut residual: [L; 6],
    edges: &mut [L],
    force: &mut [L],
    acts: L::Mask,
) -> ([L; 6], L) {
    let regulariser = regulariser(law.d());
    let (mut out, mut total) = ([L::zero(); 6], L::zero());
    for (e, f) in edges.iter_mut().enumerate() {
        let j = e / 2 + 1;
        let mu = if e % 2 == 0 { law.friction(j) } else { -law.friction(j) };
        let r = mu.mul_add(residual[j], residual[0]) + regulariser * *f;
        let diagonal = mu.mul_add(mu.mul_add(block[j][j], block[0][j] + block[0][j]), block[0][0]) + regulariser;
        let (change, gain) = scalar(f, r, diagonal, L::zero(), L::of(L::Real::MAX), acts);
        total += gain;
        for (k, residual) in residual.iter_mut().enumerate().take(force.len()) {
            *residual = change.mul_add(mu.mul_add(block[k][j], block[k][0]), *residual);
        }
        out[0] += change;
        out[j] = mu.mul_add(change, out[j]);
    }
    for (f, change) in force.iter_mut().zip(&out) {
        *f += *change;
    }
    (out, total)
}

fn ellipse<L: Lane>(
    law: Law<'_, L>,
    block: &[[L; 6]; 6],
    residual: [L; 6],
    force: &mut [L],
    acts: L::Mask,
) -> ([L; 6], L) {
    let n = force.len();
    let old: [L; 6] = build(|i| if i < n { force[i] } else { L::zero() });
    let mut a = *block;
    let base = regulariser(law.d());
    for (i, a) in a.iter_mut().enumerate().take(n) {
        // R of component i is that of the normal times (μ̂/μᵢ)².
        let ratio = if i == 0 { L::one() } else { law.mu() / law.friction(i) };
        a[i] += base * ratio * ratio;
    }
    let times = |x: &[L; 6]| -> [L; 6] { build(|i| (0..n).fold(L::zero(), |sum, k| a[i][k].mul_add(x[k], sum))) };
    // Gradient at the old force: residual + R f; and the constant part, gradient - (A + R) f.
    let af = times(&old);
    let gradient: [L; 6] = build(|i| if i < n { residual[i] + (a[i][i] - block[i][i]) * old[i] } else { L::zero() });
    let constant: [L; 6] = build(|i| gradient[i] - af[i]);
    let mut next = along_ray(n, law, &a, &old, &af, &gradient);
    friction(n, law, &a, &constant, &mut next);
    let change: [L; 6] = build(|i| L::select(acts, next[i] - old[i], L::zero()));
    let moved = times(&change);
    let (mut gain, mut least) = (L::zero(), L::zero());
    for i in 0..n {
        let half = moved[i] * L::of(0.5);
        gain -= change[i] * (half + gradient[i]);
        least = change[i].mul_add(half, least);
        force[i] = L::select(acts, next[i], old[i]);
    }
    (change, gain.max(least))
}

/// The best force on the ray through the old one. A vanishing force moves along the steepest ray of the cone, whose
/// friction opposes the slip, so that the tip of the cone is left whenever it is not the minimum.
#[inline(always)]
fn along_ray<L: Lane>(
    n: usize,
    law: Law<'_, L>,
    a: &[[L; 6]; 6],
    old: &[L; 6],
    af: &[L; 6],
    gradient: &[L; 6],
) -> [L; 6] {
    let (zero, one, tiny) = (L::zero(), L::one(), L::of(L::Real::TINY));
    let vanishing = old[0].lt(tiny);
    let mut slip = zero;
    for i in 1..n {
        let u = law.friction(i) * gradient[i];
        slip = u.mul_add(u, slip);
    }
    let inverse = one / slip.sqrt().max(tiny);
    let steepest: [L; 6] = build(|i| match i {
        0 => one,
        _ if i < n => -(law.friction(i) * law.friction(i) * gradient[i] * inverse),
        _ => zero,
    });
    let (mut slope, mut curvature, mut tip_slope, mut tip_curvature) = (zero, zero, zero, zero);
    for i in 0..n {
        slope = old[i].mul_add(gradient[i], slope);
        curvature = old[i].mul_add(af[i], curvature);
        tip_slope = steepest[i].mul_add(gradient[i], tip_slope);
        let moved = (0..n).fold(zero, |sum, k| a[i][k].mul_add(steepest[k], sum));
        tip_curvature = steepest[i].mul_add(moved, tip_curvature);
    }
    let step = (-slope / L::select(curvature.gt(zero), curvature, one)).max(-one);
    let tip_step = (-tip_slope / tip_curvature).max(zero);
    build(|i| L::select(vanishing, tip_step * steepest[i], step.mul_add(old[i], old[i])))
}

/// The best friction within the ellipsoid of the normal force.
pub(super) fn friction<L: Lane>(n: usize, law: Law<'_, L>, a: &[[L; 6]; 6], constant: &[L; 6], force: &mut [L; 6]) {
    let zero = L::zero();
    let (mut q, mut c) = ([[zero; 5]; 5], [zero; 5]);
    for i in 1..n {
        let mu = law.friction(i);
        c[i - 1] = mu * a[i][0].mul_add(force[0], constant[i]);
        for j in 1..n {
            q[i - 1][j - 1] = mu * law.friction(j) * a[i][j];
        }
    }
    let u = qcqp::minimise(n - 1, &q, &c, force[0]);
    for i in 1..n {
        force[i] = law.friction(i) * u[i - 1];
    }
}
