//! Every operation of every lane type does what it says, and the wide lanes do it bit for bit as the scalar ones.

mod support;

use lanesim_kernels::lane::{Lane, LaneQuery, Mask, Real, acos, atan2, exp, log, powf, sin_cos};
use support::{Random, block};
use wide::{f32x16, f64x8};

/// An operation on up to three numbers, written over any lane.
trait Operation {
    fn apply<L: LaneQuery>(x: L, y: L, z: L) -> L;
}

fn number<L: Lane>(mask: L::Mask) -> L {
    L::select(mask, L::one(), L::zero())
}

fn assigned<L: Lane>(x: L, f: impl Fn(&mut L)) -> L {
    let mut x = x;
    f(&mut x);
    x
}

/// Moderate numbers, for functions that need them; NaN becomes the lower bound.
fn within<L: Lane>(x: L, low: f64, high: f64) -> L {
    x.clamp(L::of(low), L::of(high))
}

/// Declares operations and a function that calls `check` with each.
macro_rules! operations {
    ($($name:ident: |$x:ident, $y:ident, $z:ident| $body:expr;)*) => {
        $(#[allow(non_camel_case_types)]
        enum $name {}
        impl Operation for $name {
            #[allow(unused_variables)]
            fn apply<L: LaneQuery>($x: L, $y: L, $z: L) -> L {
                $body
            }
        })*
        fn every_operation<W: LaneQuery<Real: LaneQuery<Real = W::Real>>>(inputs: &[[W::Real; 3]]) {
            $(same_bits::<$name, W>(stringify!($name), inputs);)*
        }
    };
}

operations! {
    add: |x, y, z| x + y;
    subtract: |x, y, z| x - y;
    multiply: |x, y, z| x * y;
    divide: |x, y, z| x / y;
    negate: |x, y, z| -x;
    add_assign: |x, y, z| assigned(x, |x| *x += y);
    sub_assign: |x, y, z| assigned(x, |x| *x -= y);
    mul_assign: |x, y, z| assigned(x, |x| *x *= y);
    mul_add: |x, y, z| x.mul_add(y, z);
    neg_mul_add: |x, y, z| x.neg_mul_add(y, z);
    square_root: |x, y, z| x.sqrt();
    round: |x, y, z| x.round();
    absolute: |x, y, z| x.abs();
    minimum: |x, y, z| x.min(y);
    maximum: |x, y, z| x.max(y);
    clamp: |x, y, z| x.clamp(y, z);
    less: |x, y, z| number(x.lt(y));
    less_or_equal: |x, y, z| number(x.le(y));
    equal: |x, y, z| number(x.eq(y));
    greater: |x, y, z| number(x.gt(y));
    greater_or_equal: |x, y, z| number(x.ge(y));
    bounded: |x, y, z| number(x.within(1e5));
    finite: |x, y, z| number(x.within(L::Real::MAX));
    select: |x, y, z| L::select(x.lt(y), y, z);
    both: |x, y, z| number(x.lt(y) & y.lt(z));
    either: |x, y, z| number(x.lt(y) | y.lt(z));
    not: |x, y, z| number(!x.lt(y));
    power_of_two: |x, y, z| within(x, -126.0, 127.0).round().exp2_integral();
    mantissa: |x, y, z| within(x, 1.2e-38, 3.4e38).split_exponent().0;
    exponent: |x, y, z| within(x, 1.2e-38, 3.4e38).split_exponent().1;
    sine: |x, y, z| sin_cos(x).0;
    cosine: |x, y, z| sin_cos(x).1;
    arc_tangent: |x, y, z| atan2(x, y);
    arc_cosine: |x, y, z| acos(x);
    exponential: |x, y, z| exp(x);
    logarithm: |x, y, z| log(within(x, 1.2e-38, 3.4e38));
    power: |x, y, z| powf(x.abs(), within(y, 1.0, 9.0));
}

/// Whether two numbers are the same bits; any NaN is as good as any other.
fn same<R: Real>(a: R, b: R) -> bool {
    a.bits() == b.bits() || (a.to_f64().is_nan() && b.to_f64().is_nan())
}

fn same_bits<O: Operation, W: LaneQuery<Real: LaneQuery<Real = W::Real>>>(name: &str, inputs: &[[W::Real; 3]]) {
    for chunk in inputs.chunks(W::WIDTH) {
        let argument = |i: usize| block::<W>(&chunk.iter().map(|input| input[i]).collect::<Vec<_>>());
        let wide = O::apply(argument(0), argument(1), argument(2));
        for (lane, [x, y, z]) in chunk.iter().enumerate() {
            let scalar = O::apply(*x, *y, *z);
            let (got, expected) = (wide.get(lane), scalar.get(0));
            assert!(same(got, expected), "{name} of {x:?}, {y:?}, {z:?} in {}: {got:?}, not {expected:?}", W::NAME);
        }
    }
}

/// Numbers at which operations are special, in any number type.
fn specials<R: Real>() -> Vec<R> {
    let (max, epsilon) = (R::MAX, R::EPSILON);
    let smallest = if epsilon > 1e-10 { f64::from(f32::MIN_POSITIVE) } else { f64::MIN_POSITIVE };
    let denormal = smallest * epsilon * 3.0;
    let magnitudes =
        [0.0, 0.5, 1.0, 1.5, 2.5, 1e-3, 0.7, 1.0 + epsilon, 3e5, 1e9, max, smallest, denormal, f64::INFINITY];
    let signed = magnitudes.iter().flat_map(|x| [*x, -*x]).chain([f64::NAN]);
    signed.map(R::from_f64).collect()
}

/// Every triple of special numbers, then random ones of many magnitudes.
fn inputs<R: Real>() -> Vec<[R; 3]> {
    let specials = specials::<R>();
    let mut out = Vec::new();
    for x in &specials {
        for y in &specials {
            out.extend(specials.iter().map(|z| [*x, *y, *z]));
        }
    }
    let mut random = Random(1);
    for _ in 0..50_000 {
        let mut next = || {
            let size = random.uniform(-12.0, 6.0).exp();
            R::from_f64(random.uniform(-size, size))
        };
        out.push([next(), next(), next()]);
    }
    out
}

#[test]
fn f64x8_does_as_f64() {
    every_operation::<f64x8>(&inputs());
}

#[test]
fn f32x16_does_as_f32() {
    every_operation::<f32x16>(&inputs());
}

#[test]
fn minimum_and_maximum_give_the_second_number_where_it_is_in_doubt() {
    let nan = f64::NAN;
    let bits = |x: f64| x.to_bits();
    assert_eq!((Lane::min(2.0, 1.0), Lane::max(2.0, 1.0)), (1.0, 2.0));
    assert_eq!((Lane::min(nan, 1.0), Lane::max(nan, 1.0)), (1.0, 1.0));
    assert!(Lane::min(1.0, nan).is_nan() && Lane::max(1.0, nan).is_nan());
    assert_eq!((bits(Lane::min(0.0, -0.0)), bits(Lane::min(-0.0, 0.0))), (bits(-0.0), bits(0.0)));
    assert_eq!((bits(Lane::max(0.0, -0.0)), bits(Lane::max(-0.0, 0.0))), (bits(-0.0), bits(0.0)));
    assert_eq!(
        (Lane::clamp(nan, -1.0, 1.0), Lane::clamp(-3.0, -1.0, 1.0), Lane::clamp(3.0, -1.0, 1.0)),
        (-1.0, -1.0, 1.0)
    );
}

#[test]
fn multiply_add_rounds_once() {
    let e = f64::EPSILON;
    assert_eq!(Lane::mul_add(1.0 + e, 1.0 - e, -1.0), -e * e);
    assert_eq!(Lane::neg_mul_add(1.0 + e, 1.0 - e, 1.0), e * e);
    let e = f32::EPSILON;
    assert_eq!(Lane::mul_add(1.0 + e, 1.0 - e, -1.0), -e * e);
    assert_eq!(Lane::neg_mul_add(1.0 + e, 1.0 - e, 1.0), e * e);
}

#[test]
fn rounding_takes_ties_to_even() {
    for (x, expected) in
        [(0.5_f64, 0.0_f64), (1.5, 2.0), (2.5, 2.0), (-0.5, -0.0), (-1.5, -2.0), (0.499, 0.0), (1e17, 1e17)]
    {
        assert_eq!(Lane::round(x).to_bits(), expected.to_bits(), "{x}");
    }
}

#[test]
fn within_is_false_for_nan_and_beyond() {
    let cases = [(f64::NAN, false), (f64::INFINITY, false), (-2.5, false), (2.0, true), (-2.0, true), (0.0, true)];
    for (x, expected) in cases {
        assert_eq!(Lane::within(x, 2.0), expected, "{x}");
    }
}

#[test]
fn powers_of_two_are_exact() {
    for k in -1022..=1023 {
        assert_eq!(f64::from(k).exp2_integral(), 2.0_f64.powi(k), "2^{k}");
    }
    for k in -126..=127_i16 {
        assert_eq!(f32::from(k).exp2_integral(), 2.0_f32.powi(k.into()), "2^{k}");
    }
}

#[test]
fn exponents_split_off_exactly() {
    fn check<L: Lane<Real = L> + Real>(x: L) {
        let (m, k) = x.split_exponent();
        let (m, k, x) = (m.to_f64(), k.to_f64(), x.to_f64());
        let root = std::f64::consts::SQRT_2 * (1.0 + L::EPSILON);
        assert!(m >= 1.0 / root && m <= root, "mantissa {m} of {x}");
        // Two factors: the power alone may be out of range.
        let half = (k / 2.0).floor();
        assert_eq!(m * half.exp2() * (k - half).exp2(), x, "{m} 2^{k}");
    }
    let mut random = Random(2);
    for _ in 0..20_000 {
        check(random.uniform(-708.0, 709.0).exp());
        check(random.uniform(-87.0, 88.0).exp() as f32);
    }
    for x in [1.0, f64::MIN_POSITIVE, f64::MAX, std::f64::consts::SQRT_2, std::f64::consts::FRAC_1_SQRT_2] {
        check(x);
    }
    for x in [1.0, f32::MIN_POSITIVE, f32::MAX, std::f32::consts::SQRT_2, std::f32::consts::FRAC_1_SQRT_2] {
        check(x);
    }
}

/// Masks as bits, entries, and constants.
fn queries<L: LaneQuery>() {
    let mut random = Random(3);
    let all = ((1_u64 << L::WIDTH) - 1) as u32;
    for _ in 0..200 {
        let (a, b) = (random.bits() as u32 & all, random.bits() as u32 & all);
        let (ma, mb) = (L::mask_of(a), L::mask_of(b));
        assert_eq!(L::bits(ma), a);
        assert_eq!(L::bits(ma & mb), a & b);
        assert_eq!(L::bits(ma | mb), a | b);
        assert_eq!(L::bits(!ma), !a & all);
        assert_eq!(L::any(ma), a != 0);
        let chosen = L::select(ma, L::one(), L::of(-2.0));
        for lane in 0..L::WIDTH {
            assert_eq!(chosen.get(lane).to_f64(), if a >> lane & 1 != 0 { 1.0 } else { -2.0 });
        }
    }
    assert_eq!((L::bits(L::Mask::splat(true)), L::bits(L::Mask::splat(false))), (all, 0));
    let mut x = L::of(0.1);
    for lane in 0..L::WIDTH {
        assert_eq!(x.get(lane).to_f64(), L::Real::from_f64(0.1).to_f64());
        x.set(lane, L::Real::from_f64(lane as f64));
    }
    for lane in 0..L::WIDTH {
        assert_eq!(x.get(lane).to_f64(), lane as f64);
        assert_eq!((L::zero().get(lane).to_f64(), L::one().get(lane).to_f64()), (0.0, 1.0));
    }
}

#[test]
fn masks_and_entries() {
    queries::<f64>();
    queries::<f32>();
    queries::<f64x8>();
    queries::<f32x16>();
}
