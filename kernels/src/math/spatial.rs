//! Spatial algebra at one reference point and in one set of axes (Featherstone, Rigid Body Dynamics Algorithms, 2008):
//! motions (ω; v), forces (torque; force), inertias as ten numbers.

use super::vec3::{Vec3, cross, cross_add, dot, dot_add};
use crate::lane::Lane;

/// A motion (ω; v) or a force (torque; force).
pub type Spatial<L> = [L; 6];

/// Spatial inertia about the reference point: Ixx, Iyy, Izz, Ixy, Ixz, Iyz, m sx, m sy, m sz, m, where s is the centre
/// of mass.
pub type Inertia10<L> = [L; 10];

/// A symmetric 6×6 matrix, lower triangle by rows.
pub type Sym6<L> = [L; 21];

/// Entry of a symmetric matrix.
#[inline(always)]
pub const fn at(i: usize, j: usize) -> usize {
    if i >= j { i * (i + 1) / 2 + j } else { j * (j + 1) / 2 + i }
}

/// Rotational part.
#[inline(always)]
pub fn rot<L: Lane>(a: &Spatial<L>) -> Vec3<L> {
    [a[0], a[1], a[2]]
}

/// Translational part.
#[inline(always)]
pub fn lin<L: Lane>(a: &Spatial<L>) -> Vec3<L> {
    [a[3], a[4], a[5]]
}

/// Both parts joined.
#[inline(always)]
pub fn join<L: Lane>(a: &Vec3<L>, b: &Vec3<L>) -> Spatial<L> {
    [a[0], a[1], a[2], b[0], b[1], b[2]]
}

/// Product of a motion and a force: two independent chains of three.
#[inline(always)]
pub fn dot6<L: Lane>(a: &Spatial<L>, b: &Spatial<L>) -> L {
    dot_add(&rot(a), &rot(b), dot(&lin(a), &lin(b)))
}

/// Inertia times motion.
#[inline(always)]
pub fn inertia_mul<L: Lane>(i: &Inertia10<L>, m: &Spatial<L>) -> Spatial<L> {
    let (w, v, h) = (rot(m), lin(m), [i[6], i[7], i[8]]);
    let moment = [
        i[4].mul_add(w[2], i[3].mul_add(w[1], i[0] * w[0])),
        i[5].mul_add(w[2], i[1].mul_add(w[1], i[3] * w[0])),
        i[2].mul_add(w[2], i[5].mul_add(w[1], i[4] * w[0])),
    ];
    let torque = cross_add(&h, &v, &moment);
    let force = cross_add(&w, &h, &[i[9] * v[0], i[9] * v[1], i[9] * v[2]]);
    join(&torque, &force)
}

/// Motion cross product (ω, u) × (a, b) = (ω×a; ω×b + u×a).
#[inline(always)]
pub fn cross_motion<L: Lane>(v: &Spatial<L>, m: &Spatial<L>) -> Spatial<L> {
    let (w, u, a, b) = (rot(v), lin(v), rot(m), lin(m));
    join(&cross(&w, &a), &cross_add(&w, &b, &cross(&u, &a)))
}

/// Force cross product (ω, u) ×* (t, f) = (ω×t + u×f; ω×f).
#[inline(always)]
pub fn cross_force<L: Lane>(v: &Spatial<L>, f: &Spatial<L>) -> Spatial<L> {
    let (w, u, t, g) = (rot(v), lin(v), rot(f), lin(f));
    join(&cross_add(&u, &g, &cross(&w, &t)), &cross(&w, &g))
}
