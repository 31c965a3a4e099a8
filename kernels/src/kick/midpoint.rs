//! The velocity of midpoint steps. Forces are those of the beginning's velocity v, but for inertial ones, which are taken at a velocity
//! v̄ of the middle: v̄ = v + h/2 a₀ with the acceleration at v, a = M⁻¹(f - c(v̄)). Of rotations of free and ball joints v̄ follows from
//! one step of Newton's method on their own implicit equation, I x = h (I a₀) - h/2 G x, G = [ω]I - [I ω], which keeps the energy of a
//! lone body. Where a second evaluation is as far from the first as that from nothing, the two are mixed for the least residual of
//! x = h a(v + x/2) (Anderson's acceleration), by a share that vanishes with the fourth power of h, so that order two stays.

use super::Kick;
use crate::acceleration::Acceleration;
use crate::inertia::Inertia;
use crate::lane::Lane;
use crate::math::ldl;
use crate::math::vec3::{Mat3, Vec3, build, column, cross, dot, mul, mul_mat, scale};
use crate::model::{Instance, JointKind, Model};
use crate::position::Position;
use crate::tendon::Tendons;
use crate::velocity::{self, Velocity};

/// Square of the residuals' ratio at which mixing counts by half.
const MIXED: f64 = 0.01;
/// A rotation's equation is used while its determinant is at least this part of the inertia's.
const LEAST: f64 = 0.1;

/// Replaces the smooth force and acceleration at the velocity `qvel`, found with `metric` and its factor, by those over a midpoint step.
pub fn midpoint<L: Lane>(
    model: Instance<'_, L>,
    (position, tendons, inertia): (&Position<L>, &Tendons<L>, &Inertia<L>),
    (metric, at_start): (&[L], &Velocity<L>),
    qvel: &[L],
    acceleration: &mut Acceleration<L>,
    kick: &mut Kick<L>,
) {
    let h = L::of(model.options.timestep);
    let Acceleration { qfrc_smooth: force, qacc_smooth: a, factor, inverse, .. } = acceleration;
    let Kick { scratch, motion, .. } = kick;
    let (first, between, residual, product) =
        (&mut scratch.first, &mut scratch.second, &mut scratch.change, &mut scratch.product);
    first.copy_from_slice(a);
    middle(&model, inertia, (qvel, first), between);
    velocity::rne(model, (position, tendons, inertia), between, motion);
    let gained = |i: usize| at_start.qfrc_bias[i] - motion.qfrc_bias[i];
    for (i, a) in a.iter_mut().enumerate() {
        *a = force[i] + gained(i);
    }
    ldl::solve(&model.rows, &model.tree_pattern, factor, inverse, a);
    // The second residual is a - 2 (v̄ - v)/h, whose product with the metric is the bias force's gain but for that of rotations.
    let rate = L::of(2.0) / h;
    residual.fill(L::zero());
    for i in rotations(&model).flat_map(|first| first..first + 3) {
        residual[i] = (between[i] - qvel[i]).mul_add(rate, -first[i]);
    }
    ldl::multiply(&model.rows, &model.tree_pattern, metric, residual, product);
    for (i, residual) in residual.iter_mut().enumerate() {
        *residual = a[i] - first[i] - *residual;
        product[i] = gained(i) - product[i];
    }
    for tree in model.trees() {
        let dofs = tree.dofs;
        let mut products = [L::zero(); 3];
        for i in dofs.clone() {
            products[0] = force[i].mul_add(first[i], products[0]);
            products[1] = force[i].mul_add(residual[i], products[1]);
            products[2] = product[i].mul_add(residual[i], products[2]);
        }
        let share = share(products);
        for i in dofs {
            a[i] = share.mul_add(first[i] - a[i], a[i]);
            // What is left of the bias force's gain.
            let left = (L::one() - share) * gained(i);
            force[i] += left;
            scratch.bias[i] = at_start.qfrc_bias[i] - left;
        }
    }
}

/// First dofs of the rotations of free and ball joints.
fn rotations<T>(model: &Model<T>) -> impl Iterator<Item = usize> {
    model.joints.iter().filter_map(|joint| match joint.kind {
        JointKind::Free => Some(joint.dof as usize + 3),
        JointKind::Ball => Some(joint.dof as usize),
        JointKind::Slide | JointKind::Hinge => None,
    })
}

/// By how much the first acceleration counts, from <F₀, F₀>, <F₀, F₁> and <F₁, F₁> of the residuals F.
#[inline(always)]
fn share<L: Lane>([start, both, end]: [L; 3]) -> L {
    let (zero, one) = (L::zero(), L::one());
    let apart = L::of(-2.0).mul_add(both, start + end);
    let some = start.gt(zero) & apart.gt(zero);
    let least = (end - both) / L::select(some, apart, one);
    let ratio = end / L::select(some, start, one);
    let square = ratio * ratio;
    L::select(some, least * square / (square + L::of(MIXED)), zero)
}

/// The velocity at the middle of the step, from the first acceleration.
fn middle<L: Lane>(model: &Model<L::Real>, inertia: &Inertia<L>, (qvel, qacc): (&[L], &[L]), out: &mut [L]) {
    let (h, half) = (L::of(model.options.timestep), L::of(0.5 * model.options.timestep));
    for (i, out) in out.iter_mut().enumerate() {
        *out = half.mul_add(qacc[i], qvel[i]);
    }
    for first in rotations(model) {
        let at = |x: &[L]| -> Vec3<L> { build(|k| x[first + k]) };
        let entry = |i: usize, j: usize| inertia.m[model.rows.at(first + i.max(j), first + i.min(j))];
        let own: Mat3<L> = build(|k| entry(k / 3, k % 3));
        let x = turn(&own, &at(qvel), &scale(h, &at(qacc)), half);
        for k in 0..3 {
            out[first + k] = L::of(0.5).mul_add(x[k], qvel[first + k]);
        }
    }
}

/// The x with (I + s G) x = I y, G = [ω]I - [I ω]; y where the equation is near to having none.
#[inline(always)]
fn turn<L: Lane>(inertia: &Mat3<L>, w: &Vec3<L>, y: &Vec3<L>, s: L) -> Vec3<L> {
    // Light bodies have determinants beyond all bounds.
    let size = L::one() / (inertia[0] + inertia[4] + inertia[8]);
    let inertia: Mat3<L> = build(|k| size * inertia[k]);
    let momentum = mul(&inertia, w);
    let o = L::zero();
    let skew = |a: &Vec3<L>| [o, -a[2], a[1], a[2], o, -a[0], -a[1], a[0], o];
    let spin = mul_mat(&skew(w), &inertia);
    let lever = skew(&momentum);
    let matrix: Mat3<L> = build(|k| s.mul_add(spin[k] - lever[k], inertia[k]));
    let columns = [0, 1, 2].map(|k| column(&matrix, k));
    let volume = |columns: &[Vec3<L>; 3]| dot(&columns[0], &cross(&columns[1], &columns[2]));
    let (whole, bare) = (volume(&columns), volume(&[0, 1, 2].map(|k| column(&inertia, k))));
    let good = whole.gt(L::of(LEAST) * bare);
    let right = mul(&inertia, y);
    let inverse = L::one() / L::select(good, whole, L::one());
    build(|k| {
        let mut replaced = columns;
        replaced[k] = right;
        L::select(good, volume(&replaced) * inverse, y[k])
    })
}
