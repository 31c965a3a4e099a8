//! The rows of an iterate (limits, pyramid edges, dry friction, elliptic contacts), flat, for the line search.

use super::RowVector;
use crate::constraint::{Cone, Constraint, ContactRow, DofRowKind};
use crate::lane::{Lane, LaneQuery, Mask, Real};

/// Along a + α p a one-sided row costs ½ D min(y + α v, 0)².
#[derive(Clone, Debug)]
pub struct Edges<L> {
    /// (y, v, D v) of every edge.
    edges: Vec<[L; 3]>,
    /// Dry friction: (y, v, D, bound).
    frictions: Vec<[L; 4]>,
    /// Elliptic contacts.
    ellipses: Vec<Ellipse<L>>,
}

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
    fn new(row: &ContactRow<L>, y: &[L], v: &[L]) -> Self {
        let (mut uu, mut uv, mut vv) = (L::zero(), L::zero(), L::zero());
        for j in 1..y.len() {
            let (u, w) = (row.friction[j - 1] * y[j], row.friction[j - 1] * v[j]);
            uu = u.mul_add(u, uu);
            uv = u.mul_add(w, uv);
            vv = w.mul_add(w, vv);
        }
        let kappa = row.d / (row.mu * row.mu);
        Ellipse { n: row.mu * y[0], dn: row.mu * v[0], uu, uv, vv, mu: row.mu, kappa }
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

impl<L: LaneQuery> Edges<L> {
    /// Room for `n` edges.
    pub fn with_capacity(n: usize) -> Self {
        Edges { edges: Vec::with_capacity(n), frictions: Vec::with_capacity(n), ellipses: Vec::with_capacity(n) }
    }

    /// Collects the edges of an iterate with rows `y` and direction `v`.
    pub fn collect(&mut self, constraint: &Constraint<L>, y: &RowVector<L>, v: &RowVector<L>) {
        self.edges.clear();
        self.frictions.clear();
        self.ellipses.clear();
        for ((row, y), v) in constraint.dof_rows.iter().zip(&y.dof).zip(&v.dof) {
            if row.kind == DofRowKind::Friction {
                self.frictions.push([*y, *v, row.d, row.bound]);
            } else {
                self.edges.push([*y, *v, row.d * *v]);
            }
        }
        for row in &constraint.contact_rows {
            let range = row.component as usize..(row.component + row.dim) as usize;
            let (y, v) = (&y.component[range.clone()], &v.component[range]);
            match row.cone {
                Cone::Ray => self.edges.push([y[0], v[0], row.d * v[0]]),
                Cone::Pyramid => {
                    for j in 1..y.len() {
                        let mu = row.friction[j - 1];
                        let up = mu.mul_add(v[j], v[0]);
                        let down = mu.neg_mul_add(v[j], v[0]);
                        self.edges.push([mu.mul_add(y[j], y[0]), up, row.d * up]);
                        self.edges.push([mu.neg_mul_add(y[j], y[0]), down, row.d * down]);
                    }
                }
                Cone::Ellipse => self.ellipses.push(Ellipse::new(row, y, v)),
            }
        }
    }

    /// First and second derivative by α of the rows' cost.
    fn slope(&self, alpha: L) -> (L, L) {
        let zero = L::zero();
        let (mut first, mut second) = (zero, zero);
        for [y, v, dv] in &self.edges {
            let z = alpha.mul_add(*v, *y);
            first = z.min(zero).mul_add(*dv, first);
            second += L::select(z.lt(zero), *dv * *v, zero);
        }
        for [y, v, d, bound] in &self.frictions {
            let pull = *d * alpha.mul_add(*v, *y);
            first = pull.clamp(-*bound, *bound).mul_add(*v, first);
            second += L::select(pull.abs().lt(*bound), *d * *v * *v, zero);
        }
        for ellipse in &self.ellipses {
            let (slope, curvature) = ellipse.slope(alpha);
            first += slope;
            second += curvature;
        }
        (first, second)
    }

    /// The step along p that minimises the cost, for the lanes in `active`. `slope` and `curvature` are those of the
    /// quadratic part; a lane stops when the derivative is below `tolerance`.
    pub fn search(&self, slope: L, curvature: L, tolerance: L, iterations: u32, active: L::Mask) -> L {
        let mut alpha = L::one();
        let (mut low, mut high) = (L::zero(), L::of(f64::MAX));
        let mut open = active;
        for _ in 0..iterations {
            let (first, second) = self.slope(alpha);
            let first = alpha.mul_add(curvature, slope) + first;
            let second = curvature + second;
            open = open & !first.abs().le(tolerance);
            if !L::any(open) {
                break;
            }
            let falling = first.lt(L::zero());
            low = L::select(open & falling, alpha, low);
            high = L::select(open & !falling, alpha, high);
            let newton = alpha - first / second;
            let middle = (low + high) * L::of(0.5);
            let inside = newton.gt(low) & newton.lt(high);
            // Without a bracket above, a Newton step that rounding stops is the end.
            let middle = L::select(middle.within(L::Real::MAX), middle, alpha);
            let next = L::select(inside, newton, middle);
            // No representable step left.
            open = open & !next.eq(alpha);
            alpha = L::select(open, next, alpha);
        }
        alpha
    }

    /// Whether every row stays in one quadratic piece of its cost on a full step: none changes between acting and not
    /// acting, or sticking and sliding.
    pub fn unchanged(&self) -> L::Mask {
        let (zero, alpha) = (L::zero(), L::one());
        let mut same = L::Mask::splat(true);
        for [y, v, dv] in &self.edges {
            let z = alpha.mul_add(*v, *y);
            let moved = (y.lt(zero) & !z.lt(zero)) | (z.lt(zero) & !y.lt(zero));
            same = same & (!moved | dv.eq(zero));
        }
        for [y, v, d, bound] in &self.frictions {
            let (from, to) = (*d * *y, *d * alpha.mul_add(*v, *y));
            same = same & from.abs().lt(*bound) & to.abs().lt(*bound)
                | same & from.ge(*bound) & to.ge(*bound)
                | same & from.le(-*bound) & to.le(-*bound);
        }
        for ellipse in &self.ellipses {
            let ((.., top, bottom), (.., end_top, end_bottom)) = (ellipse.zone(zero), ellipse.zone(alpha));
            same = same & ((top & end_top) | (bottom & end_bottom) | ellipse.kappa.eq(zero));
        }
        same
    }
}
