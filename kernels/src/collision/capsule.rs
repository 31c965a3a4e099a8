//! Capsule against capsule: nearest points of two segments (Ericson, Real-Time Collision Detection, 2005, §5.1.9).

use super::pair::{Body, Candidate};
use super::sphere::balls;
use crate::lane::{Lane, Mask};
use crate::math::vec3::{self, Vec3, cross, dot, scale, scale_add, sub};

/// The candidate `a` where the mask holds, else `b`.
#[inline(always)]
pub(super) fn select<L: Lane>(mask: L::Mask, a: &Candidate<L>, b: &Candidate<L>) -> Candidate<L> {
    Candidate {
        dist: L::select(mask, a.dist, b.dist),
        pos: vec3::select(mask, &a.pos, &b.pos),
        normal: vec3::select(mask, &a.normal, &b.normal),
        tangent: vec3::select(mask, &a.tangent, &b.tangent),
    }
}

/// The quadratic form of the squared distance between points x₁ α₁ and x₂ α₂ (α: axis times half length).
struct Segments<L> {
    alpha1: Vec3<L>,
    alpha2: Vec3<L>,
    a: L,
    b: L,
    c: L,
    u: L,
    v: L,
}

#[inline(always)]
fn segments<L: Lane>(first: &Body<L>, second: &Body<L>) -> Segments<L> {
    let alpha1 = scale(first.size[1], &first.axis());
    let alpha2 = scale(second.size[1], &second.axis());
    let between = sub(&first.pos, &second.pos);
    Segments {
        a: dot(&alpha1, &alpha1),
        b: -dot(&alpha1, &alpha2),
        c: dot(&alpha2, &alpha2),
        u: -dot(&alpha1, &between),
        v: dot(&alpha2, &between),
        alpha1,
        alpha2,
    }
}

/// The spheres at x₁ and x₂.
#[inline(always)]
fn at<L: Lane>(first: &Body<L>, second: &Body<L>, s: &Segments<L>, x1: L, x2: L) -> Candidate<L> {
    let p1 = scale_add(x1, &s.alpha1, &first.pos);
    let p2 = scale_add(x2, &s.alpha2, &second.pos);
    balls(&p1, first.size[0], &first.axis(), &p2, second.size[0], &second.axis())
}

/// The nearest points of segments that are not parallel, and where they are parallel.
pub(super) fn crossing<L: Lane>(first: &Body<L>, second: &Body<L>) -> (Candidate<L>, L::Mask) {
    let s = segments(first, second);
    // By cross products: with θ the angle between the axes, a c - b² and its like are differences of nearly equal numbers
    // that lose 1/θ² digits, these lose 1/θ.
    let normal = cross(&s.alpha1, &s.alpha2);
    let det = dot(&normal, &normal);
    // Parallel up to an angle of 1e-4.
    let parallel = det.le(s.a * s.c * L::of(1e-8));
    let one = L::one();
    let inverse = one / L::select(parallel, one, det);
    let between = sub(&second.pos, &first.pos);
    let free1 = dot(&cross(&between, &s.alpha2), &normal) * inverse;
    let free2 = dot(&cross(&between, &s.alpha1), &normal) * inverse;
    let x1 = free1.clamp(-one, one);
    let clipped = free1.abs().gt(one);
    let x2 = L::select(clipped, x1.neg_mul_add(s.b, s.v) / s.c, free2);
    let x2_clipped = x2.clamp(-one, one);
    let beyond = x2.abs().gt(one);
    let x1 = L::select(beyond, (x2_clipped.neg_mul_add(s.b, s.u) / s.a).clamp(-one, one), x1);
    (at(first, second, &s, x1, x2_clipped), parallel)
}

/// Parallel segments: each end of one against the other, the first two within `include`.
pub(super) fn parallel<L: Lane>(first: &Body<L>, second: &Body<L>, include: L) -> [(Candidate<L>, L::Mask); 2] {
    let s = segments(first, second);
    let one = L::one();
    let blank = at(first, second, &s, one, one);
    let mut found = [(blank, L::Mask::splat(false)); 2];
    let mut count = L::zero();
    for end in 0..4 {
        let sign = if end % 2 == 0 { one } else { -one };
        let (x1, x2) = if end < 2 {
            (sign, (sign.neg_mul_add(s.b, s.v) / s.c).clamp(-one, one))
        } else {
            ((sign.neg_mul_add(s.b, s.u) / s.a).clamp(-one, one), sign)
        };
        let candidate = at(first, second, &s, x1, x2);
        let counts = candidate.dist.le(include);
        for (i, (slot, mask)) in found.iter_mut().enumerate() {
            let here = counts & count.eq(L::of(i as f64));
            *slot = select(here, &candidate, slot);
            *mask = *mask | here;
        }
        count = L::select(counts, count + one, count);
    }
    found
}
