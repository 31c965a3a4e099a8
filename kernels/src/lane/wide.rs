//! The portable SIMD lanes, over the `wide` crate: `f64x8` and `f32x16`.
//!
//! Traps of `wide` that this file keeps away from kernels: instructions are chosen when the crate is compiled; `recip`
//! and `recip_sqrt` are approximations on some builds; `min` and `max` treat NaN in their own way.

use ::wide::{f32x16, f64x8};

use super::{Lane, LaneQuery, Mask};

macro_rules! wide_lane {
    ($wide:ident, $real:ident, $n:literal, $name:literal) => {
        impl Mask for $wide {
            #[inline(always)]
            fn splat(x: bool) -> Self {
                let zero = $wide::splat(0.0);
                if x { zero.simd_eq(zero) } else { zero }
            }
        }

        impl Lane for $wide {
            type Real = $real;
            type Mask = $wide;

            #[inline(always)]
            fn splat(x: $real) -> Self {
                $wide::splat(x)
            }
            #[inline(always)]
            fn mul_add(self, b: Self, c: Self) -> Self {
                $wide::mul_add(self, b, c)
            }
            #[inline(always)]
            fn neg_mul_add(self, b: Self, c: Self) -> Self {
                $wide::mul_neg_add(self, b, c)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                $wide::sqrt(self)
            }
            #[inline(always)]
            fn round(self) -> Self {
                self.round_ties_even()
            }
            #[inline(always)]
            fn abs(self) -> Self {
                $wide::abs(self)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                self.fast_min(other)
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                self.fast_max(other)
            }
            #[inline(always)]
            fn lt(self, other: Self) -> Self {
                self.simd_lt(other)
            }
            #[inline(always)]
            fn le(self, other: Self) -> Self {
                self.simd_le(other)
            }
            #[inline(always)]
            fn eq(self, other: Self) -> Self {
                self.simd_eq(other)
            }
            #[inline(always)]
            fn select(mask: Self, a: Self, b: Self) -> Self {
                ::wide::Select::select(mask, a, b)
            }
            fn exp2_integral(self) -> Self {
                $wide::from(self.to_array().map(Lane::exp2_integral))
            }
            fn split_exponent(self) -> (Self, Self) {
                let parts = self.to_array().map(Lane::split_exponent);
                ($wide::from(parts.map(|p| p.0)), $wide::from(parts.map(|p| p.1)))
            }
        }

        impl LaneQuery for $wide {
            const WIDTH: usize = $n;
            const NAME: &'static str = $name;

            #[inline(always)]
            fn get(&self, i: usize) -> $real {
                self.as_array()[i]
            }
            #[inline(always)]
            fn set(&mut self, i: usize, x: $real) {
                self.as_mut_array()[i] = x;
            }
            #[inline(always)]
            fn put(&mut self, first: usize, entries: &[$real]) {
                self.as_mut_array()[first..first + entries.len()].copy_from_slice(entries);
            }
            #[inline(always)]
            fn any(mask: Self) -> bool {
                mask.any()
            }
            #[inline(always)]
            fn bits(mask: Self) -> u32 {
                mask.to_bitmask()
            }
            fn mask_of(bits: u32) -> Self {
                let ones: [$real; $n] = std::array::from_fn(|i| if bits >> i & 1 != 0 { 1.0 } else { 0.0 });
                $wide::from(ones).simd_eq($wide::splat(1.0))
            }
        }
    };
}

wide_lane!(f64x8, f64, 8, "f64x8");
wide_lane!(f32x16, f32, 16, "f32x16");
