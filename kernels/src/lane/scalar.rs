//! The reference lanes: `f64` and `f32`, one world at a time.

use super::{Lane, LaneQuery, Mask};

impl Mask for bool {
    #[inline(always)]
    fn splat(x: bool) -> Self {
        x
    }
}

macro_rules! scalar_lane {
    ($real:ident, $bits:ident, $mantissa:literal, $bias:literal) => {
        impl Lane for $real {
            type Real = $real;
            type Mask = bool;

            #[inline(always)]
            fn splat(x: $real) -> Self {
                x
            }
            #[inline(always)]
            fn mul_add(self, b: Self, c: Self) -> Self {
                $real::mul_add(self, b, c)
            }
            #[inline(always)]
            fn neg_mul_add(self, b: Self, c: Self) -> Self {
                $real::mul_add(-self, b, c)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                $real::sqrt(self)
            }
            #[inline(always)]
            fn round(self) -> Self {
                self.round_ties_even()
            }
            #[inline(always)]
            fn abs(self) -> Self {
                $real::abs(self)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn lt(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn le(self, other: Self) -> bool {
                self <= other
            }
            #[inline(always)]
            fn eq(self, other: Self) -> bool {
                self == other
            }
            #[inline(always)]
            fn select(mask: bool, a: Self, b: Self) -> Self {
                if mask { a } else { b }
            }
            #[inline(always)]
            fn exp2_integral(self) -> Self {
                $real::from_bits(((self as i64 + $bias) as $bits) << $mantissa)
            }
            #[inline(always)]
            fn split_exponent(self) -> (Self, Self) {
                // Subtracting the bits of √½ makes the exponent field roll over exactly at √½·2^k.
                const ROOT: $bits = std::f64::consts::FRAC_1_SQRT_2.to_bits() as $bits;
                let root = if $mantissa == 52 { ROOT } else { std::f32::consts::FRAC_1_SQRT_2.to_bits() as $bits };
                let shifted = self.to_bits().wrapping_sub(root);
                let exponent = (shifted >> $mantissa) << $mantissa;
                let mantissa = $real::from_bits(self.to_bits().wrapping_sub(exponent));
                (mantissa, ((exponent as i64) << (64 - $bits::BITS) >> (64 - $bits::BITS) >> $mantissa) as $real)
            }
        }

        impl LaneQuery for $real {
            const WIDTH: usize = 1;
            const NAME: &'static str = stringify!($real);

            #[inline(always)]
            fn get(&self, _: usize) -> $real {
                *self
            }
            #[inline(always)]
            fn set(&mut self, _: usize, x: $real) {
                *self = x;
            }
            #[inline(always)]
            fn any(mask: bool) -> bool {
                mask
            }
            #[inline(always)]
            fn bits(mask: bool) -> u32 {
                u32::from(mask)
            }
            #[inline(always)]
            fn mask_of(bits: u32) -> bool {
                bits & 1 != 0
            }
        }
    };
}

scalar_lane!(f64, u64, 52, 1023);
scalar_lane!(f32, u32, 23, 127);
