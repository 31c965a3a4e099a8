//! Elementary functions: our own, the same operations for every lane type.
//!
//! Reductions and minimax polynomials follow the classical scheme (Cody and Waite, Software Manual for the Elementary
//! Functions, 1980); errors are stated at each function and tested against the standard library.

use super::{Lane, Real};

/// Whether a lane's entries are f32, for the choice of a polynomial.
#[inline(always)]
fn single<L: Lane>() -> bool {
    L::Real::EPSILON > 1e-10
}

/// Horner's rule, highest coefficient first.
#[inline(always)]
fn polynomial<L: Lane, const N: usize>(x: L, coefficients: [f64; N]) -> L {
    let mut y = L::of(coefficients[0]);
    for c in &coefficients[1..] {
        y = y.mul_add(x, L::of(*c));
    }
    y
}

/// Sine and cosine of an angle in radians; error below 3 ulp for |x| < 1e5, near their zeros too.
#[inline(always)]
pub fn sin_cos<L: Lane>(x: L) -> (L, L) {
    // x = q π/2 + r, |r| <= π/4; π/2 in three parts. The first difference is exact, the others round once.
    let q = (x * L::of(std::f64::consts::FRAC_2_PI)).round();
    let parts = if single::<L>() {
        [1.570_796_370_506_286_6, -4.371_139_000_186_243e-8, -1.715_124_510_005_881_4e-15]
    } else {
        [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21]
    };
    let mut r = x;
    for part in parts {
        r = q.neg_mul_add(L::of(part), r);
    }
    let z = r * r;
    let (s, c) = if single::<L>() {
        (
            polynomial(z, [-1.951_529_589_1e-4, 8.332_160_873_6e-3, -1.666_665_461_1e-1]),
            polynomial(z, [2.443_315_711_809_948e-5, -1.388_731_625_493_765e-3, 4.166_664_568_298_827e-2, -0.5]),
        )
    } else {
        (
            polynomial(
                z,
                [
                    1.589_623_015_765_465_6e-10,
                    -2.505_074_776_285_780_7e-8,
                    2.755_731_362_138_572_4e-6,
                    -1.984_126_982_958_954e-4,
                    8.333_333_333_322_118e-3,
                    -1.666_666_666_666_663e-1,
                ],
            ),
            polynomial(
                z,
                [
                    -1.135_853_652_138_768_2e-11,
                    2.087_570_084_197_473e-9,
                    -2.755_731_417_929_674e-7,
                    2.480_158_728_885_170_4e-5,
                    -1.388_888_888_887_305_6e-3,
                    4.166_666_666_666_66e-2,
                    -0.5,
                ],
            ),
        )
    };
    let s = (s * z).mul_add(r, r);
    let c = c.mul_add(z, L::one());
    // Quadrant q mod 4 as a number in -2..=2; odd quadrants swap sine and cosine.
    let h = (q * L::of(0.25)).round().neg_mul_add(L::of(4.0), q);
    let odd = h.abs().eq(L::one());
    let sin = L::select(odd, c, s);
    let cos = L::select(odd, s, c);
    let sin = L::select(h.abs().gt(L::of(1.5)) | h.lt(L::of(-0.5)), -sin, sin);
    let cos = L::select(h.gt(L::of(0.5)) | h.lt(L::of(-1.5)), -cos, cos);
    (sin, cos)
}

/// Angle of the point (x, y) in (-π, π]; 0 at the origin, and a zero of either sign counts as +0. Error below 4 ulp. Not for
/// two infinities.
#[inline(always)]
pub fn atan2<L: Lane>(y: L, x: L) -> L {
    let (ax, ay) = (x.abs(), y.abs());
    let steep = ay.gt(ax);
    let (small, large) = (L::select(steep, ax, ay), L::select(steep, ay, ax));
    let origin = large.le(L::zero());
    let ratio = small / L::select(origin, L::one(), large);
    let mut angle = atan_unit(ratio);
    angle = L::select(steep, L::of(std::f64::consts::FRAC_PI_2) - angle, angle);
    angle = L::select(x.lt(L::zero()), L::of(std::f64::consts::PI) - angle, angle);
    L::select(y.lt(L::zero()), -angle, angle)
}

/// Arc tangent of a number in [0, 1].
#[inline(always)]
fn atan_unit<L: Lane>(t: L) -> L {
    // Above tan(π/8) reduce by atan t = π/4 + atan((t - 1)/(t + 1)).
    let far = t.gt(L::of(0.414_213_562_373_095));
    let x = L::select(far, (t - L::one()) / (t + L::one()), t);
    let z = x * x;
    let tail = if single::<L>() {
        polynomial(z, [8.053_744_5e-2, -1.387_768_6e-1, 1.997_771_1e-1, -3.333_294_9e-1]) * z
    } else {
        let p = polynomial(
            z,
            [
                -8.750_608_600_031_904e-1,
                -1.615_753_718_733_365_2e1,
                -7.500_855_792_314_705e1,
                -1.228_866_684_490_136_2e2,
                -6.485_021_904_942_025e1,
            ],
        );
        let q = polynomial(
            z,
            [
                1.0,
                2.485_846_490_142_306_2e1,
                1.650_270_098_316_988_5e2,
                4.328_810_604_912_903e2,
                4.853_903_996_359_137e2,
                1.945_506_571_482_614e2,
            ],
        );
        z * (p / q)
    };
    let angle = tail.mul_add(x, x);
    L::select(far, L::of(std::f64::consts::FRAC_PI_4) + angle, angle)
}

/// Arc cosine; arguments outside [-1, 1] are clamped. Error below 4 ulp.
#[inline(always)]
pub fn acos<L: Lane>(x: L) -> L {
    let inside = x.clamp(-L::one(), L::one());
    let angle = atan2(((L::one() - inside) * (L::one() + inside)).max(L::zero()).sqrt(), inside);
    L::select(x.eq(x), angle, x)
}

/// Exponential; 0 below -708 (f64) or -87 (f32), and constant above 708 or 87. Error below 2 ulp.
pub fn exp<L: Lane>(x: L) -> L {
    let bound = if single::<L>() { 87.0 } else { 708.0 };
    let clamped = x.clamp(L::of(-bound), L::of(bound));
    let k = (clamped * L::of(std::f64::consts::LOG2_E)).round();
    let (high, low) = if single::<L>() {
        (0.693_359_375, -2.121_944_4e-4)
    } else {
        (0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10)
    };
    let r = k.neg_mul_add(L::of(low), k.neg_mul_add(L::of(high), clamped));
    // Taylor series: |r| <= ln 2 / 2.
    let mut sum = L::one();
    let terms = if single::<L>() { 8 } else { 14 };
    for i in (1..=terms).rev() {
        sum = (r * L::of(1.0 / f64::from(i))).mul_add(sum, L::one());
    }
    let y = sum * k.exp2_integral();
    let y = L::select(x.lt(L::of(-bound)), L::zero(), y);
    L::select(x.eq(x), y, x)
}

/// Natural logarithm of a positive normal number; others give any number. Error below 4 ulp.
pub fn log<L: Lane>(x: L) -> L {
    let (m, k) = x.split_exponent();
    // log m = 2 atanh s, s = (m - 1)/(m + 1), |s| <= 0.1716
    let s = (m - L::one()) / (m + L::one());
    let z = s * s;
    let terms = if single::<L>() { 5 } else { 11 };
    let mut sum = L::of(1.0 / f64::from(2 * terms + 1));
    for i in (0..terms).rev() {
        sum = sum.mul_add(z, L::of(1.0 / f64::from(2 * i + 1)));
    }
    let y = (s + s) * sum;
    k.mul_add(L::of(std::f64::consts::LN_2), y)
}

/// `x` to the power `p` for x ≥ 0 and p ≥ 1; 0 for x below the smallest normal number. Relative error below
/// 2 + 2 |p log x| ulp.
pub fn powf<L: Lane>(x: L, p: L) -> L {
    let tiny = L::of(if single::<L>() { 1.2e-38 } else { 2.3e-308 });
    let y = exp(p * log(x.max(tiny)));
    L::select(x.le(tiny), L::zero(), L::select(x.eq(x), y, x))
}
