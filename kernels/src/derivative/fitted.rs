//! The metric of midpoint steps, M + Δ, and what the force loses, ε v: both fitted such that one dof of inertia m with a spring k and a
//! damper b, which is kicked at the middle of a step, (m + δ)(v⁺ - v) = h (-k (x + h/2 v) - b v - ε v), moves as it would with exact
//! time: trace t and determinant d of the map from (x, v) to (x⁺, v⁺) are those of the exact motion.
//!
//! With S = 1 - t + d that is m + δ = h² k / S and ε = (m + δ)(1 - d)/h - b. The map of an overdamped dof has the factors e⁻ᵖ and e⁻q,
//! p + q = h b/m and p q = h² k/m, so that S = (1 - e⁻ᵖ)(1 - e⁻q), and no digits are lost where k or b vanish. From half a period per
//! step on, S stays what it is there, and the dof is stable with any spring. The inertia is that of the reference configuration.

use std::f64::consts::PI;

use super::Stages;
use super::actuators::{Gain, gains, products};
use super::discrete::slopes;
use crate::lane::{Lane, exp, sin_cos};
use crate::model::{Instance, MomentDof};
use crate::passive::{damper_slope, tendon_damper_slope, tendon_spring_slope};
use crate::state::State;
use crate::tendon;

/// Adds Δ to a matrix and writes ε v. What acts on one dof is fitted together; tendons, and actuators that act on several dofs, along
/// their lengths. `scratch` has a number for each dof.
pub(super) fn add<L: Lane>(
    model: Instance<'_, L>,
    state: &State<L>,
    stages: Stages<'_, L>,
    (matrix, pull, scratch): (&mut [L], &mut [L], &mut [L]),
) {
    let h = L::of(model.options.timestep);
    let (springs, dampers) = (&mut *pull, scratch);
    single(model, state, stages, springs, dampers);
    for i in 0..model.dofs.len() {
        if acts(&model, i) {
            let weight = L::splat(model.dofs[i].invweight);
            let [added, lost] = fit(weight, springs[i], dampers[i], h);
            matrix[model.rows.diagonal(i)] += added;
            springs[i] = lost * state.qvel[i];
        }
    }
    tendons(model, (stages, &state.plastic), h, (matrix, pull));
    if model.features.actuation {
        gains(model, stages.actuation, |Gain { dofs, moment, length, velocity }| {
            if dofs.len() < 2 {
                return;
            }
            let (mut weight, mut speed) = (L::zero(), L::zero());
            for (m, MomentDof { dof, .. }) in moment.iter().zip(dofs) {
                weight = (*m * *m).mul_add(L::splat(model.dofs[*dof as usize].invweight), weight);
                speed = m.mul_add(state.qvel[*dof as usize], speed);
            }
            let [added, lost] = fit(weight, (-length).max(L::zero()), (-velocity).max(L::zero()), h);
            products(model, dofs, |at, [i, j]| matrix[at] = (added * moment[i]).mul_add(moment[j], matrix[at]));
            for (m, MomentDof { dof, .. }) in moment.iter().zip(dofs) {
                let pull = &mut pull[*dof as usize];
                *pull = (lost * speed).mul_add(*m, *pull);
            }
        });
    }
}

/// Whether a joint's spring or damper, or an actuator on nothing else, acts on a dof.
fn acts<T>(model: &crate::model::Model<T>, dof: usize) -> bool {
    let by_actuator = |actuator: &crate::model::Actuator<T>| {
        let dofs = &model.moment_dofs[actuator.moments.range()];
        actuator.follows() && dofs.len() == 1 && dofs[0].dof as usize == dof
    };
    let own = &model.dofs[dof];
    model.features.dampers && own.damped
        || model.features.springs && model.joints[own.joint as usize].spring
        || model.features.actuation && model.actuators.iter().any(by_actuator)
}

/// Stiffness and damping of dofs, where they hold and do not push.
fn single<L: Lane>(
    model: Instance<'_, L>,
    state: &State<L>,
    stages: Stages<'_, L>,
    springs: &mut [L],
    dampers: &mut [L],
) {
    springs.fill(L::zero());
    dampers.fill(L::zero());
    if model.features.dampers {
        for (i, _) in model.dofs.iter().enumerate().filter(|(_, dof)| dof.damped) {
            dampers[i] = damper_slope(model, i, state.qvel[i]).max(L::zero());
        }
    }
    if model.features.springs {
        for (j, joint) in model.joints.iter().enumerate().filter(|(_, joint)| joint.spring) {
            for (dofs, stiffness) in slopes(model, (j, joint), state) {
                dofs.for_each(|i| springs[i] = stiffness.max(L::zero()));
            }
        }
    }
    if model.features.actuation {
        gains(model, stages.actuation, |Gain { dofs, moment, length, velocity }| {
            if let ([MomentDof { dof, .. }], [m]) = (dofs, moment) {
                let (square, i) = (*m * *m, *dof as usize);
                springs[i] = (-length).max(L::zero()).mul_add(square, springs[i]);
                dampers[i] = (-velocity).max(L::zero()).mul_add(square, dampers[i]);
            }
        });
    }
}

fn tendons<L: Lane>(
    model: Instance<'_, L>,
    (stages, plastic): (Stages<'_, L>, &[L]),
    h: L,
    (matrix, pull): (&mut [L], &mut [L]),
) {
    let features = &model.features;
    let tendons = stages.tendons;
    for (t, tendon) in model.tendons.iter().enumerate() {
        let (spring, damper) = (features.springs && tendon.spring, features.dampers && tendon.damped);
        if !spring && !damper {
            continue;
        }
        let (zero, speed) = (L::zero(), tendons.velocity[t]);
        let b = if damper { tendon_damper_slope(model, t, speed).max(zero) } else { zero };
        let k = if spring { tendon_spring_slope(model, t, tendons.length[t], plastic).max(zero) } else { zero };
        let mut weight = zero;
        for (dof, j) in tendon::columns(&model, t, &tendons.jacobian) {
            weight = (j * j).mul_add(L::splat(model.dofs[dof].invweight), weight);
        }
        let [added, lost] = fit(weight, k, b, h);
        tendon::add_square(&model, t, &tendons.jacobian, added, matrix);
        tendon::pull(&model, t, &tendons.jacobian, lost * speed, pull);
    }
}

/// δ and ε of a spring `k` and a damper `b` on what has the inverse inertia `weight`.
fn fit<L: Lane>(weight: L, k: L, b: L, h: L) -> [L; 2] {
    let (zero, one, half) = (L::zero(), L::one(), L::of(0.5));
    let (decay, square) = (half * h * b * weight, h * h * k * weight);
    let discriminant = decay.mul_add(decay, -square);
    let oscillates = discriminant.lt(zero);
    let q = decay + discriminant.max(zero).sqrt();
    let some = q.gt(zero);
    let p = L::select(some, square / L::select(some, q, one), zero);
    let creeping = slowness(p) * slowness(q);
    let angle = (-discriminant).max(zero).sqrt().min(L::of(PI));
    let (sin, _) = sin_cos(half * angle);
    let shrinking = decay / slowness(decay);
    let s = (L::of(4.0) * exp(-decay) * sin).mul_add(sin, shrinking * shrinking);
    let swinging = square / L::select(oscillates, s, one);
    // (m + δ) / m
    let grown = L::select(oscillates, swinging, creeping);
    let counts = weight.gt(zero);
    let added = (grown - one).max(zero) / L::select(counts, weight, one);
    let lost = b * (grown / slowness(decay + decay) - one);
    [L::select(counts, added, zero), L::select(counts, lost, zero)]
}

/// x / (1 - e⁻ˣ) of a number that is not negative: by how much a decay is slower than at first.
fn slowness<L: Lane>(x: L) -> L {
    let (one, square) = (L::one(), x * x);
    let terms = [1.0 / 47_900_160.0, -1.0 / 1_209_600.0, 1.0 / 30240.0, -1.0 / 720.0, 1.0 / 12.0];
    let series = terms.into_iter().fold(L::zero(), |sum, term| sum.mul_add(square, L::of(term)));
    let series = series.mul_add(square, L::of(0.5).mul_add(x, one));
    let small = x.lt(L::of(0.25));
    let exact = x / (one - exp(-L::select(small, one, x)));
    L::select(small, series, exact)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The map of a step by the fitted numbers: trace and determinant.
    fn map(m: f64, k: f64, b: f64, h: f64) -> (f64, f64) {
        let [added, lost] = fit(1.0 / m, k, b, h);
        let step = |x: f64, v: f64| {
            let middle = x + 0.5 * h * v;
            let next = v + h * (-k * middle - b * v - lost * v) / (m + added);
            (middle + 0.5 * h * next, next)
        };
        let ((xx, vx), (xv, vv)) = (step(1.0, 0.0), step(0.0, 1.0));
        (xx + vv, xx * vv - xv * vx)
    }

    #[test]
    fn fitted_dofs_move_as_with_exact_time() {
        for (k, b) in [(0.0, 3.0), (40.0, 0.0), (40.0, 3.0), (4e3, 1.0), (10.0, 300.0), (1e-9, 5.0), (1e-9, 1e-9)] {
            let (m, h): (f64, f64) = (0.7, 0.01);
            let (rate, square) = (0.5 * b / m, k / m - 0.25 * b * b / (m * m));
            let swing = if square > 0.0 { (square.sqrt() * h).cos() } else { ((-square).sqrt() * h).cosh() };
            let exact = (2.0 * (-rate * h).exp() * swing, (-2.0 * rate * h).exp());
            let (trace, determinant) = map(m, k, b, h);
            assert!((trace - exact.0).abs() < 1e-14, "k {k} b {b}: trace {trace} {}", exact.0);
            assert!((determinant - exact.1).abs() < 1e-14, "k {k} b {b}: determinant {determinant} {}", exact.1);
        }
    }

    #[test]
    fn no_spring_and_no_damper_is_too_stiff() {
        for k in [0.0, 1.0, 1e3, 1e6, 1e12] {
            for b in [0.0, 1.0, 1e3, 1e6, 1e12] {
                for m in [1e-6, 1.0, 1e3] {
                    let (trace, determinant) = map(m, k, b, 0.01);
                    // Both roots are within the unit circle.
                    assert!(determinant.abs() <= 1.0 + 1e-9, "k {k} b {b} m {m}: determinant {determinant}");
                    assert!(trace.abs() <= 1.0 + determinant + 1e-9, "k {k} b {b} m {m}: trace {trace} {determinant}");
                }
            }
        }
        assert_eq!(fit(0.3_f32, 0.0, 0.0, 0.002), [0.0, 0.0]);
        assert_eq!(fit(0.0, 5.0, 5.0, 0.002), [0.0, 0.0]);
    }

    #[test]
    fn single_precision_keeps_its_digits() {
        for (k, b) in [(1e-3, 0.0), (40.0, 1e-3), (1e-3, 1e-3), (5.0, 70.0), (2e4, 200.0)] {
            let ([added, lost], [wide, far]) = (fit(1.5_f32, k, b, 0.002), fit(1.5, f64::from(k), f64::from(b), 0.002));
            assert!((f64::from(added) - wide).abs() < 1e-6 * (wide + 1.0 / 1.5), "{k} {b}: {added} {wide}");
            assert!((f64::from(lost) - far).abs() < 1e-6 * f64::from(b) + 1e-9, "{k} {b}: {lost} {far}");
        }
    }
}
