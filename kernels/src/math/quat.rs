//! Quaternions (w, x, y, z): Hamilton product, local to global.

use super::vec3::{Mat3, Vec3, norm, normalize, scale, select};
use crate::lane::{Lane, Real, atan2, sin_cos};

/// A quaternion.
pub type Quat<L> = [L; 4];

/// p ∘ q
#[inline(always)]
pub fn mul<L: Lane>(p: &Quat<L>, q: &Quat<L>) -> Quat<L> {
    [
        p[3].neg_mul_add(q[3], p[2].neg_mul_add(q[2], p[1].neg_mul_add(q[1], p[0] * q[0]))),
        p[3].neg_mul_add(q[2], p[2].mul_add(q[3], p[1].mul_add(q[0], p[0] * q[1]))),
        p[3].mul_add(q[1], p[2].mul_add(q[0], p[1].neg_mul_add(q[3], p[0] * q[2]))),
        p[3].mul_add(q[0], p[2].neg_mul_add(q[1], p[1].mul_add(q[2], p[0] * q[3]))),
    ]
}

/// The conjugate.
#[inline(always)]
pub fn conjugate<L: Lane>(q: &Quat<L>) -> Quat<L> {
    [q[0], -q[1], -q[2], -q[3]]
}

/// q / ‖q‖; the identity for quaternions shorter than `MINVAL`.
#[inline(always)]
pub fn unit<L: Lane>(q: &Quat<L>) -> Quat<L> {
    let norm = q[3].mul_add(q[3], q[2].mul_add(q[2], q[1].mul_add(q[1], q[0] * q[0]))).sqrt();
    let short = norm.lt(L::of(L::Real::MINVAL));
    let inverse = L::one() / L::select(short, L::one(), norm);
    let identity = [L::one(), L::zero(), L::zero(), L::zero()];
    select(short, &identity, &scale(inverse, q))
}

/// The rotation matrix of a unit quaternion.
#[inline(always)]
pub fn to_matrix<L: Lane>(q: &Quat<L>) -> Mat3<L> {
    let [w, x, y, z] = *q;
    let (x2, y2, z2) = (x + x, y + y, z + z);
    let (wx, wy, wz) = (w * x2, w * y2, w * z2);
    let (xx, yy, zz) = (x * x2, y * y2, z * z2);
    let one = L::one();
    [
        one - (yy + zz),
        x.mul_add(y2, -wz),
        x.mul_add(z2, wy),
        x.mul_add(y2, wz),
        one - (xx + zz),
        y.mul_add(z2, -wx),
        x.mul_add(z2, -wy),
        y.mul_add(z2, wx),
        one - (xx + yy),
    ]
}

/// The rotation by vector `v`, radians: (cos ‖v‖/2, sin(‖v‖/2) v/‖v‖).
#[inline(always)]
pub fn exp<L: Lane>(v: &Vec3<L>) -> Quat<L> {
    let (axis, angle) = normalize(v);
    let (s, c) = sin_cos(angle * L::of(0.5));
    [c, s * axis[0], s * axis[1], s * axis[2]]
}

/// The axis and the angle in (-π, π] of a unit quaternion.
#[inline(always)]
pub fn axis_angle<L: Lane>(q: &Quat<L>) -> (Vec3<L>, L) {
    let (axis, sine) = normalize(&[q[1], q[2], q[3]]);
    let angle = L::of(2.0) * atan2(sine, q[0]);
    let full = L::of(2.0 * std::f64::consts::PI);
    (axis, L::select(angle.gt(L::of(std::f64::consts::PI)), angle - full, angle))
}

/// The rotation vector of a unit quaternion, of length at most π.
#[inline(always)]
pub fn log<L: Lane>(q: &Quat<L>) -> Vec3<L> {
    let (axis, angle) = axis_angle(q);
    let turn = [q[1], q[2], q[3]];
    // Near none there is no axis, but a derivative.
    let short = norm(&turn).lt(L::of(L::Real::MINVAL));
    select(short, &scale(L::of(2.0) / L::select(short, q[0], L::one()), &turn), &scale(angle, &axis))
}
