//! Nonlinear conjugate gradients, preconditioned by the inertia matrix (Hager and Zhang, A new conjugate gradient method
//! with guaranteed descent, 2005).

use super::{Problem, Solver, SolverWork, primal};
use crate::lane::{Lane, Real};
use crate::math::ldl;

/// Sets the search direction of conjugate gradients and what follows from it.
pub fn conjugate<L: Lane>(problem: &Problem<'_, L>, first: bool, work: &mut SolverWork<L>) {
    direction(problem, first, work);
    primal::motion(problem, work);
}

/// Sets the search direction -M⁻¹g + β p, and keeps the gradient for the next; β = 0 if `first`.
fn direction<L: Lane>(problem: &Problem<'_, L>, first: bool, work: &mut SolverWork<L>) {
    let Problem { model, acceleration, .. } = problem;
    let Solver { gradient, search, last_gradient, last_scaled, scaled, .. } = &mut work.fields;
    scaled.copy_from_slice(gradient);
    ldl::solve(&model.rows, &model.tree_pattern, &acceleration.factor, &acceleration.inverse, scaled);
    let beta = if first { L::zero() } else { beta(gradient, scaled, search, last_gradient, last_scaled) };
    for (p, s) in search.iter_mut().zip(scaled.iter()) {
        *p = if first { -*s } else { beta.mul_add(*p, -*s) };
    }
    last_gradient.copy_from_slice(gradient);
    last_scaled.copy_from_slice(scaled);
}

/// β = max(η, (y·M⁻¹g - 2 (y·M⁻¹y)/(p·y) p·g)/(p·y)), y the change of the gradient, η = -1/(‖p‖ min(0.01, ‖g‖)); 0, which
/// restarts, where p·y vanishes.
fn beta<L: Lane>(gradient: &[L], scaled: &[L], search: &[L], last_gradient: &[L], last_scaled: &[L]) -> L {
    let z = L::zero();
    let (mut y_scaled, mut y_my, mut py, mut pg, mut pp, mut gg) = (z, z, z, z, z, z);
    for i in 0..gradient.len() {
        let (g, p) = (gradient[i], search[i]);
        let y = g - last_gradient[i];
        y_scaled = y.mul_add(scaled[i], y_scaled);
        y_my = y.mul_add(scaled[i] - last_scaled[i], y_my);
        py = p.mul_add(y, py);
        pg = p.mul_add(g, pg);
        pp = p.mul_add(p, pp);
        gg = g.mul_add(g, gg);
    }
    let vanishes = py.lt(L::of(L::Real::TINY));
    let inverse = L::one() / L::select(vanishes, L::one(), py);
    let beta = (L::of(2.0) * y_my * inverse).neg_mul_add(pg, y_scaled) * inverse;
    let eta = -(L::one() / (pp.sqrt() * gg.sqrt().min(L::of(0.01))));
    L::select(vanishes, z, beta.max(eta))
}
