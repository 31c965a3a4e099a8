//! Lanes: one number of every world in a block, side by side.
//!
//! Every kernel is written once over [`Lane`]. With `f64` or `f32` a block is a single world and the code is the
//! reference; with `f64x8` and `f32x16` it is the portable SIMD path. A lane never looks at its neighbours: there is no
//! operation across lanes, and no branch on a lane's value. Drivers that may skip work when no lane needs it use
//! [`LaneQuery`].
//!
//! All implementations perform the same IEEE operations in the same order, with the same fused multiply-adds, so that a
//! world's bits do not depend on the lane type's width.

mod functions;
mod scalar;
mod tangent;
mod wide;

pub use functions::{acos, atan2, exp, log, powf, sin_cos};
pub use tangent::Tangent;

use std::fmt::Debug;
use std::ops::{Add, AddAssign, BitAnd, BitOr, Div, Mul, MulAssign, Neg, Not, Sub, SubAssign};

/// The number type of a lane's entries: `f64` or `f32`.
pub trait Real: Copy + Debug + Default + PartialOrd + Send + Sync + 'static {
    /// Norms below this count as zero.
    const MINVAL: f64;
    /// Pivots and curvatures below this are not divided by: in double precision the reference's, which is absolute, in single
    /// precision near the least number, so that bodies may be as small as in double precision.
    const TINY: f64;
    /// Pivots below this part of the diagonal that they are left of are rounding; 0: the reference has no such bound.
    const PIVOT_ROUNDING: f64;
    /// States above this are huge: the world is frozen.
    const MAXVAL: f64;
    /// Name, as the command line spells it.
    const NAME: &'static str;
    /// Difference between 1 and the next number.
    const EPSILON: f64;
    /// Largest finite number.
    const MAX: f64;

    /// Rounds.
    fn from_f64(x: f64) -> Self;
    /// Widens.
    fn to_f64(self) -> f64;
    /// The bits, widened to 64.
    fn bits(self) -> u64;
}

impl Real for f64 {
    const MINVAL: f64 = 1e-15;
    const TINY: f64 = 1e-15;
    const PIVOT_ROUNDING: f64 = 0.0;
    const MAXVAL: f64 = 1e10;
    const NAME: &'static str = "f64";
    const EPSILON: f64 = f64::EPSILON;
    const MAX: f64 = f64::MAX;

    #[inline(always)]
    fn from_f64(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
    fn bits(self) -> u64 {
        self.to_bits()
    }
}

impl Real for f32 {
    const MINVAL: f64 = 1e-12;
    const TINY: f64 = 1e-30;
    const PIVOT_ROUNDING: f64 = f32::EPSILON as f64;
    const MAXVAL: f64 = 1e7;
    const NAME: &'static str = "f32";
    const EPSILON: f64 = f32::EPSILON as f64;
    const MAX: f64 = f32::MAX as f64;

    #[inline(always)]
    fn from_f64(x: f64) -> Self {
        x as f32
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    fn bits(self) -> u64 {
        u64::from(self.to_bits())
    }
}

/// A truth value per lane.
pub trait Mask: Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> {
    /// The same value in every lane.
    fn splat(x: bool) -> Self;
}

/// One number per world of a block: what kernels compute with.
pub trait Lane:
    Copy
    + Debug
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
{
    /// Type of one entry, and of the model's numbers.
    type Real: Real;
    /// Result of a comparison.
    type Mask: Mask;

    /// The same number in every lane.
    fn splat(x: Self::Real) -> Self;
    /// `self * b + c`, rounded once.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `c - self * b`, rounded once.
    fn neg_mul_add(self, b: Self, c: Self) -> Self;
    /// Square root; NaN for negative numbers.
    fn sqrt(self) -> Self;
    /// Nearest integer, ties to even.
    fn round(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// The smaller number; `other` if either is NaN or both are zero.
    fn min(self, other: Self) -> Self;
    /// The larger number; `other` if either is NaN or both are zero.
    fn max(self, other: Self) -> Self;
    /// `self < other`.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self <= other`.
    fn le(self, other: Self) -> Self::Mask;
    /// `self == other`.
    fn eq(self, other: Self) -> Self::Mask;
    /// `a` where `mask` holds, else `b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// 2 to the power of an integral `self` within the exponent range of the type.
    fn exp2_integral(self) -> Self;
    /// Mantissa in [√½, √2) and integral exponent of a positive normal number.
    fn split_exponent(self) -> (Self, Self);

    /// The same number in every lane, rounded from f64.
    #[inline(always)]
    fn of(x: f64) -> Self {
        Self::splat(Self::Real::from_f64(x))
    }
    /// Zero.
    #[inline(always)]
    fn zero() -> Self {
        Self::of(0.0)
    }
    /// One.
    #[inline(always)]
    fn one() -> Self {
        Self::of(1.0)
    }
    /// `self > other`.
    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        other.lt(self)
    }
    /// `self >= other`.
    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        other.le(self)
    }
    /// Within `lo` and `hi`.
    #[inline(always)]
    fn clamp(self, lo: Self, hi: Self) -> Self {
        self.max(lo).min(hi)
    }
    /// Whether the number is finite and of magnitude at most `bound`; false for NaN.
    #[inline(always)]
    fn within(self, bound: f64) -> Self::Mask {
        self.abs().le(Self::of(bound))
    }
}

/// A real type as a lane of its own, for code that treats one world at a time.
pub trait Scalar: Real + Lane<Real = Self, Mask = bool> {}

impl<T: Real + Lane<Real = T, Mask = bool>> Scalar for T {}

/// What only drivers may ask of lanes: their number, single entries, whether any satisfies a condition.
pub trait LaneQuery: Lane<Real: Scalar> {
    /// Number of lanes.
    const WIDTH: usize;
    /// Name, as reports spell it.
    const NAME: &'static str;
    /// Entry of lane `i`.
    fn get(&self, i: usize) -> Self::Real;
    /// Replaces the entry of lane `i`.
    fn set(&mut self, i: usize, x: Self::Real);
    /// Replaces the entries of lanes from `first` on.
    #[inline(always)]
    fn put(&mut self, first: usize, entries: &[Self::Real]) {
        entries.iter().zip(first..).for_each(|(x, lane)| self.set(lane, *x));
    }
    /// Whether the mask holds in any lane.
    fn any(mask: Self::Mask) -> bool;
    /// The mask as bits, lane 0 lowest.
    fn bits(mask: Self::Mask) -> u32;
    /// The mask of the given bits.
    fn mask_of(bits: u32) -> Self::Mask;
}
