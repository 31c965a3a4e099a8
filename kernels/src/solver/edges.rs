//! The contacts of an iterate (pyramid edges, elliptic contacts), flat, for the line search.

use super::line::Line;
use crate::constraint::{Cone, Constraint, ContactRow, Law, grow};
use crate::lane::{Lane, Mask, Real};

/// Numbers of an edge.
pub const EDGE: usize = 3;
/// Numbers of an elliptic contact.
pub const ELLIPSE: usize = 7;

/// Along a + α p a one-sided row costs ½ D min(y + α v, 0)².
#[derive(Clone, Debug)]
pub struct Edges<L> {
    /// (y, v, D v) of every edge of a contact, at its place in the list of rows.
    pub contacts: Vec<[L; EDGE]>,
    /// Elliptic contacts, at their places in the list: (N, its derivative, T², half its derivative, that one's derivative,
    /// μ̂, κ).
    pub ellipses: Vec<[L; ELLIPSE]>,
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
pub(super) fn stays<L: Lane>([y, v, dv]: &[L; EDGE]) -> L::Mask {
    let zero = L::zero();
    let z = L::one().mul_add(*v, *y);
    let moved = (y.lt(zero) & !z.lt(zero)) | (z.lt(zero) & !y.lt(zero));
    !moved | dv.eq(zero)
}

/// Writes the edges of a contact, or its ellipse. [`Line::same`] becomes 0 where it leaves its quadratic piece of the cost on a full
/// step.
#[inline(always)]
pub fn of_contact<L: Lane>(law: Law<'_, L>, y: &[L], v: &[L], out: &mut [L], line: &mut Line<L>) {
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
    line.set_same(L::select(stay, line.same(), L::zero()));
}

/// Adds to first and second derivative by α of a one-sided row's cost.
#[inline(always)]
pub(super) fn add_slope<L: Lane>([y, v, dv]: &[L; EDGE], alpha: L, [first, second]: &mut [L; 2]) {
    let z = alpha.mul_add(*v, *y);
    *first = z.min(L::zero()).mul_add(*dv, *first);
    *second = L::select(z.lt(L::zero()), dv.mul_add(*v, *second), *second);
}

/// Adds a contact's part to slope and curvature at a step.
#[inline(always)]
pub fn slope<L: Lane>(cone: Cone, edges: &[L], alpha: L, line: &mut Line<L>) {
    let mut sum = [L::zero(); 2];
    if cone == Cone::Ellipse {
        let (list, _) = edges.as_chunks::<ELLIPSE>();
        for ellipse in list {
            let (first, second) = Ellipse::of(*ellipse).slope(alpha);
            sum = [sum[0] + first, sum[1] + second];
        }
    } else {
        let (list, _) = edges.as_chunks::<EDGE>();
        for edge in list {
            add_slope(edge, alpha, &mut sum);
        }
    }
    line.set_contact_slope(line.contact_slope() + sum[0]);
    line.set_contact_curvature(line.contact_curvature() + sum[1]);
}

impl<L: Lane> Edges<L> {
    /// Room for `edges` edges of contacts.
    pub fn with_capacity(edges: usize) -> Self {
        Edges { contacts: Vec::with_capacity(edges), ellipses: Vec::with_capacity(edges) }
    }

    /// Room for the contacts of the constraint's list.
    pub fn fit(&mut self, constraint: &Constraint<L>) {
        let end = |cone: &dyn Fn(Cone) -> bool| {
            let last = constraint.contact_rows.iter().rfind(|row| cone(row.cone));
            last.map_or(0, |row| row.edge as usize + row.edges())
        };
        grow(&mut self.contacts, end(&|cone| cone != Cone::Ellipse), [L::zero(); EDGE]);
        grow(&mut self.ellipses, end(&|cone| cone == Cone::Ellipse), [L::zero(); ELLIPSE]);
    }

    /// A contact's edges or its ellipse.
    #[inline(always)]
    pub fn row(&self, row: &ContactRow) -> &[L] {
        let range = row.edge as usize..row.edge as usize + row.edges();
        if row.cone == Cone::Ellipse {
            self.ellipses[range].as_flattened()
        } else {
            self.contacts[range].as_flattened()
        }
    }

    /// The same, to be written.
    #[inline(always)]
    pub fn row_mut(&mut self, row: &ContactRow) -> &mut [L] {
        let range = row.edge as usize..row.edge as usize + row.edges();
        if row.cone == Cone::Ellipse {
            self.ellipses[range].as_flattened_mut()
        } else {
            self.contacts[range].as_flattened_mut()
        }
    }
}
