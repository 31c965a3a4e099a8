//! Capsule against capsule: nearest points of two segments (Ericson, Real-Time Collision Detection, 2005, §5.1.9).

use super::body::{Body, Candidate};
use super::sphere::balls;
use crate::lane::Lane;
use crate::math::vec3::{Vec3, cross, dot, scale_add, sub};

/// Axes at a smaller angle, in radians, count as parallel.
const PARALLEL: f64 = 1e-4;

/// Two segments as products of their unit axes and the way from the first centre to the second. Places on them are lengths
/// from the centres.
struct Segments<L> {
    axis1: Vec3<L>,
    axis2: Vec3<L>,
    half1: L,
    half2: L,
    between: Vec3<L>,
    /// Cosine of the angle between the axes.
    cos: L,
    /// The way between the centres along the first axis, and along the second.
    along1: L,
    along2: L,
}

#[inline(always)]
fn segments<L: Lane>(first: &Body<L>, second: &Body<L>) -> Segments<L> {
    let (axis1, axis2) = (first.axis(), second.axis());
    let between = sub(&second.pos, &first.pos);
    Segments {
        cos: dot(&axis1, &axis2),
        along1: dot(&axis1, &between),
        along2: dot(&axis2, &between),
        half1: first.size[1],
        half2: second.size[1],
        axis1,
        axis2,
        between,
    }
}

impl<L: Lane> Segments<L> {
    /// The place on the first segment that is nearest to place `x2` on the second.
    #[inline(always)]
    fn on_first(&self, x2: L) -> L {
        self.cos.mul_add(x2, self.along1).clamp(-self.half1, self.half1)
    }

    /// The place on the second segment's line that is nearest to place `x1` on the first.
    #[inline(always)]
    fn on_second_line(&self, x1: L) -> L {
        self.cos.mul_add(x1, -self.along2)
    }

    /// The spheres at two places.
    #[inline(always)]
    fn balls(&self, first: &Body<L>, second: &Body<L>, x1: L, x2: L) -> Candidate<L> {
        let p1 = scale_add(x1, &self.axis1, &first.pos);
        let p2 = scale_add(x2, &self.axis2, &second.pos);
        balls(&p1, first.size[0], &self.axis1, &p2, second.size[0], &self.axis2)
    }
}

/// The nearest points of segments that are not parallel, and where they are parallel.
pub(super) fn crossing<L: Lane>(first: &Body<L>, second: &Body<L>) -> (Candidate<L>, L::Mask) {
    let s = segments(first, second);
    // By cross products: with θ the angle between the axes, 1 - cos² and its like are differences of nearly equal numbers
    // that lose 1/θ² digits, these lose 1/θ.
    let normal = cross(&s.axis1, &s.axis2);
    let sin2 = dot(&normal, &normal);
    let parallel = sin2.le(L::of(PARALLEL * PARALLEL));
    let inverse = L::one() / L::select(parallel, L::one(), sin2);
    let free1 = dot(&cross(&s.between, &s.axis2), &normal) * inverse;
    let free2 = dot(&cross(&s.between, &s.axis1), &normal) * inverse;
    let x1 = free1.clamp(-s.half1, s.half1);
    let x2 = L::select(free1.abs().gt(s.half1), s.on_second_line(x1), free2);
    let x2_clipped = x2.clamp(-s.half2, s.half2);
    let x1 = L::select(x2.abs().gt(s.half2), s.on_first(x2_clipped), x1);
    (s.balls(first, second, x1, x2_clipped), parallel)
}

/// Parallel segments: the ends of what they have in common along the first axis, the lower one first. Where they have
/// nothing in common both are the same, the ends that face each other.
pub(super) fn parallel<L: Lane>(first: &Body<L>, second: &Body<L>) -> [Candidate<L>; 2] {
    let s = segments(first, second);
    [-L::one(), L::one()].map(|sign| {
        // The second segment's end on this side, as seen along the first axis.
        let end = L::select(s.cos.lt(L::zero()), -sign, sign) * s.half2;
        let place = s.cos.mul_add(end, s.along1);
        let x1 = place.clamp(-s.half1, s.half1);
        let x2 = s.on_second_line(x1).clamp(-s.half2, s.half2);
        s.balls(first, second, x1, L::select(place.abs().le(s.half1), end, x2))
    })
}
