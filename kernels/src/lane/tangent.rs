//! Dual numbers as lanes: numbers, and how fast they change along one direction.
//!
//! What a kernel finds from such lanes has the derivative beside it, exact but for rounding. Where a function has two slopes, the one is taken
//! that belongs to the branch which the numbers take; the square root of zero, whose slope is infinite, counts as still.

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use super::{Lane, LaneQuery, Real, Scalar};

/// Numbers and their rates.
#[derive(Clone, Copy, Debug)]
pub struct Tangent<L> {
    /// The numbers.
    pub value: L,
    /// How fast they change.
    pub rate: L,
}

impl<L: Lane> Tangent<L> {
    /// Numbers that change at that rate.
    #[inline(always)]
    pub fn new(value: L, rate: L) -> Self {
        Tangent { value, rate }
    }

    /// Numbers that stay as they are.
    #[inline(always)]
    pub fn still(value: L) -> Self {
        Tangent { value, rate: L::zero() }
    }
}

impl<L: Lane> Add for Tangent<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Tangent { value: self.value + b.value, rate: self.rate + b.rate }
    }
}

impl<L: Lane> Sub for Tangent<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Tangent { value: self.value - b.value, rate: self.rate - b.rate }
    }
}

impl<L: Lane> Mul for Tangent<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Tangent { value: self.value * b.value, rate: self.rate.mul_add(b.value, self.value * b.rate) }
    }
}

impl<L: Lane> Div for Tangent<L> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        let value = self.value / b.value;
        Tangent { value, rate: value.neg_mul_add(b.rate, self.rate) / b.value }
    }
}

impl<L: Lane> Neg for Tangent<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Tangent { value: -self.value, rate: -self.rate }
    }
}

impl<L: Lane> AddAssign for Tangent<L> {
    #[inline(always)]
    fn add_assign(&mut self, b: Self) {
        *self = *self + b;
    }
}

impl<L: Lane> SubAssign for Tangent<L> {
    #[inline(always)]
    fn sub_assign(&mut self, b: Self) {
        *self = *self - b;
    }
}

impl<L: Lane> MulAssign for Tangent<L> {
    #[inline(always)]
    fn mul_assign(&mut self, b: Self) {
        *self = *self * b;
    }
}

impl<L: Lane> Lane for Tangent<L> {
    type Real = L::Real;
    type Mask = L::Mask;

    #[inline(always)]
    fn splat(x: L::Real) -> Self {
        Tangent::still(L::splat(x))
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        let rate = self.rate.mul_add(b.value, self.value.mul_add(b.rate, c.rate));
        Tangent { value: self.value.mul_add(b.value, c.value), rate }
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        let rate = self.rate.neg_mul_add(b.value, self.value.neg_mul_add(b.rate, c.rate));
        Tangent { value: self.value.neg_mul_add(b.value, c.value), rate }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        let none = value.eq(L::zero());
        let twice = L::select(none, L::one(), value + value);
        Tangent { value, rate: L::select(none, L::zero(), self.rate / twice) }
    }
    #[inline(always)]
    fn round(self) -> Self {
        Tangent::still(self.value.round())
    }
    #[inline(always)]
    fn abs(self) -> Self {
        let rate = L::select(self.value.lt(L::zero()), -self.rate, self.rate);
        Tangent { value: self.value.abs(), rate }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        let rate = L::select(other.value.lt(self.value), other.rate, self.rate);
        Tangent { value: self.value.min(other.value), rate }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        let rate = L::select(self.value.lt(other.value), other.rate, self.rate);
        Tangent { value: self.value.max(other.value), rate }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> L::Mask {
        self.value.lt(other.value)
    }
    #[inline(always)]
    fn le(self, other: Self) -> L::Mask {
        self.value.le(other.value)
    }
    #[inline(always)]
    fn eq(self, other: Self) -> L::Mask {
        self.value.eq(other.value)
    }
    #[inline(always)]
    fn select(mask: L::Mask, a: Self, b: Self) -> Self {
        Tangent { value: L::select(mask, a.value, b.value), rate: L::select(mask, a.rate, b.rate) }
    }
    fn exp2_integral(self) -> Self {
        Tangent::still(self.value.exp2_integral())
    }
    fn split_exponent(self) -> (Self, Self) {
        let (mantissa, exponent) = self.value.split_exponent();
        let mantissa = Tangent { value: mantissa, rate: self.rate * (mantissa / self.value) };
        (mantissa, Tangent::still(exponent))
    }
}

impl<L: LaneQuery> LaneQuery for Tangent<L>
where
    L::Real: Scalar,
{
    const WIDTH: usize = L::WIDTH;
    const NAME: &'static str = L::NAME;

    /// The number alone.
    #[inline(always)]
    fn get(&self, i: usize) -> L::Real {
        self.value.get(i)
    }
    /// The number, which stays as it is.
    #[inline(always)]
    fn set(&mut self, i: usize, x: L::Real) {
        self.value.set(i, x);
        self.rate.set(i, L::Real::from_f64(0.0));
    }
    #[inline(always)]
    fn any(mask: L::Mask) -> bool {
        L::any(mask)
    }
    #[inline(always)]
    fn bits(mask: L::Mask) -> u32 {
        L::bits(mask)
    }
    #[inline(always)]
    fn mask_of(bits: u32) -> L::Mask {
        L::mask_of(bits)
    }
}
