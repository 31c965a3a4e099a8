//! Numbers of single precision with a low word: what is beyond their digits, so that a small step far from zero is not lost.
//!
//! What rounding took from a sum is exact whichever of the two numbers is larger (Knuth, The Art of Computer Programming 2, 4.2.2), and so at
//! most half a unit of the sum's last digit. A low word is rounded to a multiple of a unit that a number and its low word share with double
//! precision. So the two can be told as one number of double precision, and be had from it again.

use crate::lane::{Lane, Real};

/// Part of a number by which its low word is rounded: added and taken away again, it leaves 52 bits below the number's first.
const GRAIN: f64 = 1.0 / (1 << 28) as f64;

/// `a` and a step from it: the sum and its low word.
#[inline(always)]
pub fn add<L: Lane>(a: L, step: L) -> [L; 2] {
    let [high, rest] = rounded(a, step);
    let grain = L::of(GRAIN);
    [high, high.neg_mul_add(grain, high.mul_add(grain, rest))]
}

/// The same of two steps, the second far smaller.
#[inline(always)]
pub fn sum<L: Lane>(a: L, step: L, rest: L) -> [L; 2] {
    let [high, low] = rounded(a, step);
    add(high, low + rest)
}

/// The sum, rounded, and what rounding took.
#[inline(always)]
fn rounded<L: Lane>(a: L, b: L) -> [L; 2] {
    let sum = a + b;
    let second = sum - a;
    let first = sum - second;
    [sum, (a - first) + (b - second)]
}

/// Low words of time 0 and of numbers that are rounded to `U`; none in double precision.
pub fn remainders<'a, T: Real, U: Real>(numbers: impl Iterator<Item = &'a T>) -> Vec<U> {
    if !kept::<U>() {
        return Vec::new();
    }
    let rest = |x: &T| U::from_f64(remainder::<U>(x.to_f64()));
    std::iter::once(U::from_f64(0.0)).chain(numbers.map(rest)).collect()
}

/// Whether numbers of this type have low words.
fn kept<T: Real>() -> bool {
    T::EPSILON > 1e-10
}

/// What rounding takes from a number; of one that is not finite then, nothing.
pub fn remainder<T: Real>(x: f64) -> f64 {
    let rest = x - T::from_f64(x).to_f64();
    if rest.is_finite() { rest } else { 0.0 }
}
