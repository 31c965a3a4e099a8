//! The rows of an iterate (limits, pyramid edges, dry friction, elliptic contacts), flat, for the line search.

use crate::constraint::{Cone, Constraint, ContactRow, DofRowKind, Law};
use crate::lane::{Lane, LaneQuery, Mask, Real};

/// Numbers of an edge.
pub const EDGE: usize = 3;
/// Numbers of an elliptic contact.
pub const ELLIPSE: usize = 7;

/// Along a + α p a one-sided row costs ½ D min(y + α v, 0)².
#[derive(Clone, Debug)]
pub struct Edges<L> {
    /// (y, v, D v) of every limit.
    limits: Vec<[L; EDGE]>,
    /// The same of every edge of a contact, at its place in the list of rows.
    pub contacts: Vec<[L; EDGE]>,
    /// Dry friction: (y, v, D, bound).
    frictions: Vec<[L; 4]>,
    /// Elliptic contacts, at their places in the list: (N, its derivative, T², half its derivative, that one's derivative,
    /// μ̂, κ).
    pub ellipses: Vec<[L; ELLIPSE]>,
    /// 1 where no contact leaves its quadratic piece of the cost on a full step, else 0.
    pub same: [L; 1],
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
    #[inline(always)]
    fn of([n, dn, uu, uv, vv, mu, kappa]: [L; ELLIPSE]) -> Self {
        Ellipse { n, dn, uu, uv, vv, mu, kappa }
    }

    #[inline(always)]
    fn numbers(&self) -> [L; ELLIPSE] {
        [self.n, self.dn, self.uu, self.uv, self.vv, self.mu, self.kappa]
    }

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

/// Whether a one-sided row keeps acting, or not acting, on a full step.
#[inline(always)]
fn stays<L: Lane>([y, v, dv]: &[L; EDGE]) -> L::Mask {
    let zero = L::zero();
    let z = L::one().mul_add(*v, *y);
    let moved = (y.lt(zero) & !z.lt(zero)) | (z.lt(zero) & !y.lt(zero));
    !moved | dv.eq(zero)
}

/// Writes the edges of a contact, or its ellipse. `same` becomes 0 where it leaves its quadratic piece of the cost on a full
/// step.
#[inline(always)]
pub fn of_contact<L: Lane>(law: Law<'_, L>, y: &[L], v: &[L], out: &mut [L], same: &mut L) {
    let mut stay = L::Mask::splat(true);
    let mut edge = |out: &mut [L], y: L, v: L| {
        let edge = [y, v, law.d() * v];
        stay = stay & stays(&edge);
        out.copy_from_slice(&edge);
    };
    match law.cone {
        Cone::Ray => edge(out, y[0], v[0]),
        Cone::Pyramid => {
            for (out, j) in out.chunks_exact_mut(2 * EDGE).zip(1..y.len()) {
                let mu = law.friction(j);
                let (up, down) = out.split_at_mut(EDGE);
                edge(up, mu.mul_add(y[j], y[0]), mu.mul_add(v[j], v[0]));
                edge(down, mu.neg_mul_add(y[j], y[0]), mu.neg_mul_add(v[j], v[0]));
            }
        }
        Cone::Ellipse => {
            let ellipse = Ellipse::new(law, y, v);
            let ((.., top, bottom), (.., end_top, end_bottom)) = (ellipse.zone(L::zero()), ellipse.zone(L::one()));
            stay = (top & end_top) | (bottom & end_bottom) | ellipse.kappa.eq(L::zero());
            out.copy_from_slice(&ellipse.numbers());
        }
    }
    *same = L::select(stay, *same, L::zero());
}

impl<L: LaneQuery> Edges<L> {
    /// Room for the rows of `dof_rows` joints and for `edges` edges of contacts.
    pub fn with_capacity(dof_rows: usize, edges: usize) -> Self {
        Edges {
            limits: Vec::with_capacity(dof_rows),
            contacts: Vec::with_capacity(edges),
            frictions: Vec::with_capacity(dof_rows),
            ellipses: Vec::with_capacity(edges),
            same: [L::one()],
        }
    }

    /// Room for the contacts of the constraint's list.
    pub fn fit(&mut self, constraint: &Constraint<L>) {
        let end = |cone: &dyn Fn(Cone) -> bool| {
            let last = constraint.contact_rows.iter().rfind(|row| cone(row.cone));
            last.map_or(0, |row| row.edge as usize + row.edges())
        };
        self.contacts.resize(end(&|cone| cone != Cone::Ellipse), [L::zero(); EDGE]);
        self.ellipses.resize(end(&|cone| cone == Cone::Ellipse), [L::zero(); ELLIPSE]);
    }

    /// Where a contact's edges or its ellipse are.
    #[inline(always)]
    pub fn of_row(&mut self, row: &ContactRow) -> &mut [L] {
        let range = row.edge as usize..row.edge as usize + row.edges();
        match row.cone {
            Cone::Ray | Cone::Pyramid => self.contacts[range].as_flattened_mut(),
            Cone::Ellipse => self.ellipses[range].as_flattened_mut(),
        }
    }

    /// Collects the rows on joints of an iterate with rows `y` and direction `v`, and forgets what contacts do.
    pub fn collect(&mut self, constraint: &Constraint<L>, y: &[L], v: &[L]) {
        self.same = [L::one()];
        self.limits.clear();
        self.frictions.clear();
        for ((row, y), v) in constraint.dof_rows.iter().zip(y).zip(v) {
            if row.kind == DofRowKind::Friction {
                self.frictions.push([*y, *v, row.d, row.bound]);
            } else {
                self.limits.push([*y, *v, row.d * *v]);
            }
        }
    }

    /// First and second derivative by α of the rows' cost.
    fn slope(&self, alpha: L) -> (L, L) {
        let zero = L::zero();
        let (mut first, mut second) = (zero, zero);
        for [y, v, dv] in self.limits.iter().chain(&self.contacts) {
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
            let (slope, curvature) = Ellipse::of(*ellipse).slope(alpha);
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
        let alpha = L::one();
        let mut same = self.same[0].eq(alpha);
        for edge in &self.limits {
            same = same & stays(edge);
        }
        for [y, v, d, bound] in &self.frictions {
            let (from, to) = (*d * *y, *d * alpha.mul_add(*v, *y));
            same = same & from.abs().lt(*bound) & to.abs().lt(*bound)
                | same & from.ge(*bound) & to.ge(*bound)
                | same & from.le(-*bound) & to.le(-*bound);
        }
        same
    }
}
