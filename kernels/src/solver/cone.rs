//! The contact model: cost, force and stiffness of a contact as functions of its components y.
//!
//! * Ray (frictionless): ½ D min(y₀, 0)².
//! * Pyramid: the same for every edge y₀ ± μⱼ yⱼ.
//! * Ellipse, with U = (μ̂ y₀, μ₁ y₁, ...), N = U₀, T = ‖U₁..‖, κ = D/μ̂²: nothing where N ≥ μ̂ T; ½ κ ‖U‖² where
//!   μ̂ N + T ≤ 0; ½ κ/(1 + μ̂²) (N - μ̂ T)² between.

use crate::constraint::{Cone, Law};
use crate::lane::{Lane, Real};

/// Stiffness of a contact in its components.
pub enum Stiffness<L> {
    /// The normal couples to every other component, those not to each other: (normal, sides, normal with side).
    Arrow(L, [L; 5], [L; 5]),
    /// Any symmetric matrix, lower triangle.
    Full([[L; 6]; 6]),
}

/// Forces of the components.
#[inline(always)]
pub fn force<L: Lane>(law: Law<'_, L>, y: &[L], force: &mut [L]) {
    let zero = L::zero();
    match law.cone {
        Cone::Ray => force[0] = -(law.d() * y[0].min(zero)),
        Cone::Pyramid => {
            let mut normal = zero;
            for j in 1..y.len() {
                let mu = law.friction(j);
                let plus = mu.mul_add(y[j], y[0]).min(zero);
                let minus = mu.neg_mul_add(y[j], y[0]).min(zero);
                normal += plus + minus;
                force[j] = -(law.d() * mu * (plus - minus));
            }
            force[0] = -(law.d() * normal);
        }
        Cone::Ellipse => {
            let zone = Zone::new(law, y);
            let pull = zone.middle_stiffness(law) * zone.gap();
            // Bottom: -κ Uⱼ scaleⱼ. Middle: -∂/∂yⱼ of ½ Dm (N - μ̂ T)².
            let normal = L::select(zone.bottom, zone.kappa * zone.n, L::select(zone.top, zero, pull));
            force[0] = -(normal * law.mu());
            for j in 1..y.len() {
                let bottom = zone.kappa * zone.u[j];
                let middle = -(pull * law.mu() * zone.t_inverse * zone.u[j]);
                let side = L::select(zone.bottom, bottom, L::select(zone.top, zero, middle));
                force[j] = -(side * law.friction(j));
            }
        }
    }
}

/// Second derivative of the cost.
#[inline(always)]
pub fn stiffness<L: Lane>(law: Law<'_, L>, y: &[L]) -> Stiffness<L> {
    let zero = L::zero();
    if law.cone == Cone::Ellipse {
        return Stiffness::Full(ellipse_stiffness(law, y));
    }
    let (mut normal, mut side, mut cross) = (zero, [zero; 5], [zero; 5]);
    if law.cone == Cone::Ray {
        normal = L::select(y[0].lt(zero), law.d(), zero);
    }
    for j in 1..y.len() {
        let mu = law.friction(j);
        let plus = L::select(mu.mul_add(y[j], y[0]).lt(zero), law.d(), zero);
        let minus = L::select(mu.neg_mul_add(y[j], y[0]).lt(zero), law.d(), zero);
        normal += plus + minus;
        side[j - 1] = mu * mu * (plus + minus);
        cross[j - 1] = mu * (plus - minus);
    }
    Stiffness::Arrow(normal, side, cross)
}

#[inline(always)]
fn ellipse_stiffness<L: Lane>(law: Law<'_, L>, y: &[L]) -> [[L; 6]; 6] {
    let zero = L::zero();
    let zone = Zone::new(law, y);
    let middle = zone.middle_stiffness(law);
    let ratio = law.mu() * zone.n * zone.t_inverse;
    let diagonal = law.mu().mul_add(law.mu(), -ratio);
    let mut k = [[zero; 6]; 6];
    let pick = |bottom: L, between: L| L::select(zone.bottom, bottom, L::select(zone.top, zero, between));
    k[0][0] = pick(zone.kappa, middle) * law.mu() * law.mu();
    for i in 1..y.len() {
        let (mu_i, t_i) = (law.friction(i), zone.u[i] * zone.t_inverse);
        k[i][0] = pick(zero, -(middle * law.mu() * t_i)) * law.mu() * mu_i;
        for j in 1..=i {
            let (mu_j, t_j) = (law.friction(j), zone.u[j] * zone.t_inverse);
            let (identity, kappa) = if i == j { (diagonal, zone.kappa) } else { (zero, zero) };
            k[i][j] = pick(kappa, middle * (ratio * t_i).mul_add(t_j, identity)) * mu_i * mu_j;
        }
    }
    k
}

/// Twice the cost.
#[inline(always)]
pub fn twice_cost<L: Lane>(law: Law<'_, L>, y: &[L]) -> L {
    let zero = L::zero();
    match law.cone {
        Cone::Ray => {
            let e = y[0].min(zero);
            law.d() * e * e
        }
        Cone::Pyramid => {
            let mut squares = zero;
            for j in 1..y.len() {
                let mu = law.friction(j);
                let plus = mu.mul_add(y[j], y[0]).min(zero);
                let minus = mu.neg_mul_add(y[j], y[0]).min(zero);
                squares = minus.mul_add(minus, plus.mul_add(plus, squares));
            }
            law.d() * squares
        }
        Cone::Ellipse => {
            let zone = Zone::new(law, y);
            let gap = zone.gap();
            let bottom = zone.kappa * zone.t.mul_add(zone.t, zone.n * zone.n);
            let middle = zone.middle_stiffness(law) * gap * gap;
            L::select(zone.bottom, bottom, L::select(zone.top, zero, middle))
        }
    }
}

/// Whether an elliptic contact is in its top and in its bottom zone.
#[inline(always)]
pub fn zones<L: Lane>(law: Law<'_, L>, y: &[L]) -> [L::Mask; 2] {
    let zone = Zone::new(law, y);
    [zone.top, zone.bottom]
}

/// Where the components of an elliptic contact lie.
struct Zone<L: Lane> {
    u: [L; 6],
    n: L,
    t: L,
    /// 1/T; 1 where T is tiny.
    t_inverse: L,
    mu: L,
    kappa: L,
    top: L::Mask,
    bottom: L::Mask,
}

impl<L: Lane> Zone<L> {
    #[inline(always)]
    fn new(law: Law<'_, L>, y: &[L]) -> Self {
        let mut u = [L::zero(); 6];
        u[0] = law.mu() * y[0];
        let mut squares = L::zero();
        for j in 1..y.len() {
            u[j] = law.friction(j) * y[j];
            squares = u[j].mul_add(u[j], squares);
        }
        let (n, t) = (u[0], squares.sqrt());
        let tiny = t.lt(L::of(L::Real::MINVAL));
        let t_inverse = L::one() / L::select(tiny, L::one(), t);
        let (top, bottom) = (n.ge(law.mu() * t), law.mu().mul_add(n, t).le(L::zero()));
        Zone { u, n, t, t_inverse, mu: law.mu(), kappa: law.d() / (law.mu() * law.mu()), top, bottom }
    }

    /// N - μ̂ T, negative between the zones.
    #[inline(always)]
    fn gap(&self) -> L {
        self.mu.neg_mul_add(self.t, self.n)
    }

    /// κ/(1 + μ̂²)
    #[inline(always)]
    fn middle_stiffness(&self, law: Law<'_, L>) -> L {
        self.kappa / law.mu().mul_add(law.mu(), L::one())
    }
}
