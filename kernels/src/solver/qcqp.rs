//! The friction of one elliptic contact with its normal force fixed: minimise ½ uᵀQu + uᵀc over ‖u‖ ≤ r.

use crate::lane::{Lane, Real};
use crate::math::vec3::build;

/// Newton steps on the secular equation.
const STEPS: usize = 20;

/// The minimiser, in `n` ≤ 5 dimensions. Outside the ball it is (Q + λ)⁻¹(-c) with ‖u‖ = r: λ by Newton's method on
/// 1/‖u‖ (Moré and Sorensen, Computing a trust region step, 1983), which is monotone from λ = 0.
pub fn minimise<L: Lane>(n: usize, q: &[[L; 5]; 5], c: &[L; 5], r: L) -> [L; 5] {
    let c = c.map(|x| -x);
    let mut factor = Factor::of(n, q, L::zero());
    let free = factor.solve(n, &c);
    let outside = norm(n, &free).gt(r);
    let (mut u, mut lambda) = (free, L::zero());
    let tiny = L::of(L::Real::TINY);
    let usable = outside & r.gt(tiny);
    for _ in 0..STEPS {
        let length = norm(n, &u).max(tiny);
        let w = factor.solve(n, &u);
        let mut slope = L::zero();
        for i in 0..n {
            slope = u[i].mul_add(w[i], slope);
        }
        let step = (length - r) / r * (length * length / slope.max(tiny));
        lambda = L::select(usable & step.gt(L::zero()), lambda + step, lambda);
        factor = Factor::of(n, q, lambda);
        u = factor.solve(n, &c);
    }
    // Exactly on the sphere.
    let scale = r / norm(n, &u).max(tiny);
    let zero = L::zero();
    build(|i| L::select(outside, L::select(usable, u[i] * scale, zero), free[i]))
}

fn norm<L: Lane>(n: usize, u: &[L; 5]) -> L {
    let mut sum = L::zero();
    for x in &u[..n] {
        sum = x.mul_add(*x, sum);
    }
    sum.sqrt()
}

/// Q + λ as LDLᵀ.
struct Factor<L> {
    l: [[L; 5]; 5],
    d: [L; 5],
}

impl<L: Lane> Factor<L> {
    fn of(n: usize, q: &[[L; 5]; 5], lambda: L) -> Self {
        let (zero, tiny) = (L::zero(), L::of(L::Real::TINY));
        let (mut l, mut d) = ([[zero; 5]; 5], [zero; 5]);
        for i in 0..n {
            for j in 0..i {
                let mut sum = q[i][j];
                for k in 0..j {
                    sum = (l[i][k] * d[k]).neg_mul_add(l[j][k], sum);
                }
                l[i][j] = sum / d[j];
            }
            let mut sum = q[i][i] + lambda;
            for k in 0..i {
                sum = (l[i][k] * d[k]).neg_mul_add(l[i][k], sum);
            }
            d[i] = sum.max(tiny);
        }
        Factor { l, d }
    }

    /// (Q + λ)⁻¹ b
    fn solve(&self, n: usize, b: &[L; 5]) -> [L; 5] {
        let Factor { l, d } = self;
        let mut x = [L::zero(); 5];
        for i in 0..n {
            let mut sum = b[i];
            for k in 0..i {
                sum = l[i][k].neg_mul_add(x[k], sum);
            }
            x[i] = sum;
        }
        for i in (0..n).rev() {
            let mut sum = x[i] / d[i];
            for k in i + 1..n {
                sum = l[k][i].neg_mul_add(x[k], sum);
            }
            x[i] = sum;
        }
        x
    }
}
