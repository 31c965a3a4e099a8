//! Rows of contacts (edges of pyramids, elliptic contacts) along the search direction.

use super::cone;
use super::line::Line;
use crate::constraint::{Cone, Law};
use crate::lane::{Lane, Mask, Real};

/// An edge along a + α p, whose cost is ½ D min(y + α v, 0)²: y, v, D v.
pub type Edge<L> = [L; 3];

/// An elliptic contact along a + α p: N = n + α dn, T² = uu + 2 α uv + α² vv.
#[derive(Clone, Copy, Debug)]
struct Ellipse<L> {
    n: L,
    dn: L,
    uu: L,
    uv: L,
    vv: L,
    mu: L,
    kappa: L,
}

impl<L: Lane> Ellipse<L> {
    #[inline(always)]
    fn new(law: Law<'_, L>, y: &[L], v: &[L]) -> Self {
        let (mut uu, mut uv, mut vv) = (L::zero(), L::zero(), L::zero());
        for j in 1..y.len() {
            let (u, w) = (law.friction(j) * y[j], law.friction(j) * v[j]);
            uu = u.mul_add(u, uu);
            uv = u.mul_add(w, uv);
            vv = w.mul_add(w, vv);
        }
        let mu = law.mu();
        Ellipse { n: mu * y[0], dn: mu * v[0], uu, uv, vv, mu, kappa: law.d() / (mu * mu) }
    }

    /// N, T, and whether the point lies in the top and in the bottom zone.
    #[inline(always)]
    fn zone(&self, alpha: L) -> (L, L, L::Mask, L::Mask) {
        let n = alpha.mul_add(self.dn, self.n);
        let squared = alpha.mul_add(alpha.mul_add(self.vv, self.uv + self.uv), self.uu);
        let t = squared.max(L::zero()).sqrt();
        (n, t, n.ge(self.mu * t), self.mu.mul_add(n, t).le(L::zero()))
    }

    /// First and second derivative of the cost by α.
    #[inline(always)]
    fn slope(&self, alpha: L) -> (L, L) {
        let zero = L::zero();
        let (n, t, top, bottom) = self.zone(alpha);
        let along = alpha.mul_add(self.vv, self.uv);
        let low = (self.kappa * n.mul_add(self.dn, along), self.kappa * self.dn.mul_add(self.dn, self.vv));
        let tiny = t.lt(L::of(L::Real::MINVAL));
        let inverse = L::one() / L::select(tiny, L::one(), t);
        let dt = along * inverse;
        let ddt = dt.neg_mul_add(dt, self.vv) * inverse;
        let stiffness = self.kappa / self.mu.mul_add(self.mu, L::one());
        let (gap, rate) = (self.mu.neg_mul_add(t, n), self.mu.neg_mul_add(dt, self.dn));
        let middle = (stiffness * gap * rate, stiffness * rate.mul_add(rate, -(gap * self.mu * ddt)));
        let pick = |low: L, middle: L| L::select(bottom, low, L::select(top, zero, middle));
        (pick(low.0, middle.0), pick(low.1, middle.1))
    }
}

/// Whether a one-sided row of strength `d` keeps acting, or not acting, from y to z.
#[inline(always)]
pub(super) fn stays<L: Lane>(y: L, z: L, d: L) -> L::Mask {
    let zero = L::zero();
    let moved = (y.lt(zero) & !z.lt(zero)) | (z.lt(zero) & !y.lt(zero));
    !moved | d.eq(zero)
}

/// Adds to first and second derivative by α of a one-sided row's cost.
#[inline(always)]
pub(super) fn add_slope<L: Lane>([y, v, dv]: &Edge<L>, alpha: L, [first, second]: &mut [L; 2]) {
    let z = alpha.mul_add(*v, *y);
    *first = z.min(L::zero()).mul_add(*dv, *first);
    *second = L::select(z.lt(L::zero()), dv.mul_add(*v, *second), *second);
}

/// Edges of a ray or a pyramid, of which there are two for each component beside the normal.
#[inline(always)]
fn edges<L: Lane>(law: Law<'_, L>, y: &[L]) -> [L; 10] {
    let mut edges = [y[0]; 10];
    for j in 1..y.len() {
        let mu = law.friction(j);
        edges[2 * j - 2] = mu.mul_add(y[j], y[0]);
        edges[2 * j - 1] = mu.neg_mul_add(y[j], y[0]);
    }
    edges
}

/// Number of edges of a ray or a pyramid with components `y`.
#[inline(always)]
fn count<L: Lane>(law: Law<'_, L>, y: &[L]) -> usize {
    if law.cone == Cone::Ray { 1 } else { 2 * (y.len() - 1) }
}

/// Whether a contact stays in its quadratic piece of the cost on a full step. It looks at the very numbers that the step leads to, as the
/// Hessian does: where that of another round is at hand in the end, because a neighbour took longer, it is the same.
#[inline(always)]
fn contact_stays<L: Lane>(law: Law<'_, L>, y: &[L], v: &[L]) -> L::Mask {
    let mut moved = [L::zero(); 6];
    for (z, (y, v)) in moved.iter_mut().zip(y.iter().zip(v)) {
        *z = L::one().mul_add(*v, *y);
    }
    let moved = &moved[..y.len()];
    if law.cone == Cone::Ellipse {
        let ([top, bottom], [end_top, end_bottom]) = (cone::zones(law, y), cone::zones(law, moved));
        return (top & end_top) | (bottom & end_bottom) | law.d().eq(L::zero());
    }
    let (from, to) = (edges(law, y), edges(law, moved));
    (0..count(law, y)).fold(L::Mask::splat(true), |stay, e| stay & stays(from[e], to[e], law.d()))
}

/// Adds a contact's part to slope and curvature at a step.
#[inline(always)]
pub fn slope<L: Lane>(law: Law<'_, L>, y: &[L], v: &[L], alpha: L, line: &mut Line<L>) {
    let mut sum = [L::zero(); 2];
    if law.cone == Cone::Ellipse {
        sum = Ellipse::new(law, y, v).slope(alpha).into();
    } else {
        let (from, rates) = (edges(law, y), edges(law, v));
        (0..count(law, y)).for_each(|e| add_slope(&[from[e], rates[e], law.d() * rates[e]], alpha, &mut sum));
    }
    line.set_contact_slope(line.contact_slope() + sum[0]);
    line.set_contact_curvature(line.contact_curvature() + sum[1]);
}

/// What the line search wants to know before it begins: adds the contact's part on a full step, and sets [`Line::same`] to 0 where
/// it leaves its quadratic piece of the cost on it.
#[inline(always)]
pub fn begin<L: Lane>(law: Law<'_, L>, y: &[L], v: &[L], line: &mut Line<L>) {
    line.set_same(L::select(contact_stays(law, y, v), line.same(), L::zero()));
    slope(law, y, v, L::one(), line);
}
