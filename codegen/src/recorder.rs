//! The lane that writes down what is done to it.

use std::cell::RefCell;
use std::marker::PhantomData;
use std::ops::{Add, AddAssign, BitAnd, BitOr, Div, Mul, MulAssign, Neg, Not, Sub, SubAssign};

use lanesim_kernels::lane::{Lane, Mask};

use crate::float::{Float, Precision};
use crate::graph::{Graph, Id, Op};

thread_local! {
    static ACTIVE: RefCell<Option<(Precision, Graph)>> = const { RefCell::new(None) };
}

/// Opens this thread's graph.
///
/// # Panics
///
/// If one is open already.
pub(crate) fn open(precision: Precision) {
    ACTIVE.with_borrow_mut(|active| {
        assert!(active.is_none(), "another recording is open on this thread");
        *active = Some((precision, Graph::default()));
    });
}

/// Closes this thread's graph and hands it over.
pub(crate) fn close() -> Graph {
    ACTIVE.take().map(|(_, graph)| graph).unwrap_or_default()
}

/// Calls `f` with this thread's open graph.
///
/// # Panics
///
/// If none is open, or one of another precision.
pub(crate) fn with_graph<T: Float, R>(f: impl FnOnce(&mut Graph) -> R) -> R {
    ACTIVE.with_borrow_mut(|active| match active {
        Some((precision, graph)) if *precision == T::PRECISION => f(graph),
        Some(_) => panic!("a recorder met a recording of the other precision"),
        None => panic!("a recorder was used while no recording was open on this thread"),
    })
}

/// A lane value of the recording that is open on this thread. Computing with it records the operation; it has no numbers.
///
/// Everything on it panics when no recording is open. Values must not outlive their recording: in the next one they
/// would stand for other values, or panic.
#[derive(Clone, Copy, Debug)]
pub struct Recorder<T> {
    pub(crate) id: Id,
    real: PhantomData<T>,
}

/// A mask of the recording that is open on this thread.
#[derive(Clone, Copy, Debug)]
pub struct RecorderMask<T> {
    pub(crate) id: Id,
    real: PhantomData<T>,
}

impl<T: Float> Recorder<T> {
    pub(crate) fn new(id: Id) -> Self {
        Recorder { id, real: PhantomData }
    }

    fn record(f: impl FnOnce(&mut Graph) -> Id) -> Self {
        Recorder::new(with_graph::<T, _>(f))
    }

    /// The number, if it is the same whatever the inputs.
    pub fn constant(self) -> Option<T> {
        let node = with_graph::<T, _>(|graph| graph.node(self.id));
        (node.op == crate::graph::Op::Constant).then(|| T::of_bits(node.bits()))
    }
}

impl<T: Float> RecorderMask<T> {
    pub(crate) fn new(id: Id) -> Self {
        RecorderMask { id, real: PhantomData }
    }

    fn record(f: impl FnOnce(&mut Graph) -> Id) -> Self {
        RecorderMask::new(with_graph::<T, _>(f))
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident, $rule:ident, $assign:ident, $assign_method:ident) => {
        impl<T: Float> $trait for Recorder<T> {
            type Output = Self;
            fn $method(self, b: Self) -> Self {
                Self::record(|g| g.$rule::<T>(self.id, b.id))
            }
        }
        impl<T: Float> $assign for Recorder<T> {
            fn $assign_method(&mut self, b: Self) {
                *self = $trait::$method(*self, b);
            }
        }
    };
}

operator!(Add, add, add, AddAssign, add_assign);
operator!(Sub, sub, sub, SubAssign, sub_assign);
operator!(Mul, mul, mul, MulAssign, mul_assign);

impl<T: Float> Div for Recorder<T> {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        Self::record(|g| g.div::<T>(self.id, b.id))
    }
}

impl<T: Float> Neg for Recorder<T> {
    type Output = Self;
    fn neg(self) -> Self {
        Self::record(|g| g.neg::<T>(self.id))
    }
}

impl<T: Float> BitAnd for RecorderMask<T> {
    type Output = Self;
    fn bitand(self, b: Self) -> Self {
        Self::record(|g| g.combine(Op::MaskAnd, self.id, b.id))
    }
}

impl<T: Float> BitOr for RecorderMask<T> {
    type Output = Self;
    fn bitor(self, b: Self) -> Self {
        Self::record(|g| g.combine(Op::MaskOr, self.id, b.id))
    }
}

impl<T: Float> Not for RecorderMask<T> {
    type Output = Self;
    fn not(self) -> Self {
        Self::record(|g| g.not(self.id))
    }
}

impl<T: Float> Mask for RecorderMask<T> {
    fn splat(x: bool) -> Self {
        Self::record(|g| g.truth(x))
    }
}

impl<T: Float> Lane for Recorder<T> {
    type Real = T;
    type Mask = RecorderMask<T>;

    fn splat(x: T) -> Self {
        Self::record(|g| g.constant(x))
    }
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self::record(|g| g.fused::<T>(self.id, b.id, c.id, false))
    }
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        Self::record(|g| g.fused::<T>(self.id, b.id, c.id, true))
    }
    fn sqrt(self) -> Self {
        Self::record(|g| g.sqrt::<T>(self.id))
    }
    fn round(self) -> Self {
        Self::record(|g| g.round::<T>(self.id))
    }
    fn abs(self) -> Self {
        Self::record(|g| g.abs::<T>(self.id))
    }
    fn min(self, other: Self) -> Self {
        Self::record(|g| g.extremum::<T>(Op::Min, self.id, other.id))
    }
    fn max(self, other: Self) -> Self {
        Self::record(|g| g.extremum::<T>(Op::Max, self.id, other.id))
    }
    fn lt(self, other: Self) -> RecorderMask<T> {
        RecorderMask::record(|g| g.compare::<T>(Op::Less, self.id, other.id))
    }
    fn le(self, other: Self) -> RecorderMask<T> {
        RecorderMask::record(|g| g.compare::<T>(Op::LessEqual, self.id, other.id))
    }
    fn eq(self, other: Self) -> RecorderMask<T> {
        RecorderMask::record(|g| g.compare::<T>(Op::Equal, self.id, other.id))
    }
    fn select(mask: RecorderMask<T>, a: Self, b: Self) -> Self {
        Self::record(|g| g.select(mask.id, a.id, b.id))
    }
    fn exp2_integral(self) -> Self {
        Self::record(|g| g.exp2_integral::<T>(self.id))
    }
    fn split_exponent(self) -> (Self, Self) {
        let (mantissa, exponent) = with_graph::<T, _>(|g| g.split_exponent::<T>(self.id));
        (Recorder::new(mantissa), Recorder::new(exponent))
    }
}
