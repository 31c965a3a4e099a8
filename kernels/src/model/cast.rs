//! Rounding the tables to another real type.

use crate::lane::Real;

/// Conversion of a table to another real type.
pub trait Cast<U> {
    /// The converted type.
    type Out;
    /// Rounds every real number of `self` to `U`.
    fn cast(&self) -> Self::Out;
}

impl<T: Real, U: Real> Cast<U> for T {
    type Out = U;
    fn cast(&self) -> U {
        U::from_f64(self.to_f64())
    }
}

impl<U, A: Cast<U>, const N: usize> Cast<U> for [A; N] {
    type Out = [A::Out; N];
    fn cast(&self) -> Self::Out {
        std::array::from_fn(|i| self[i].cast())
    }
}

impl<U, A: Cast<U>> Cast<U> for Vec<A> {
    type Out = Vec<A::Out>;
    fn cast(&self) -> Self::Out {
        self.iter().map(Cast::cast).collect()
    }
}

/// Whether numbers stay finite when they are rounded to single precision.
pub trait Representable {
    /// Whether all of `self` do.
    fn representable(&self) -> bool;
}

impl Representable for f64 {
    fn representable(&self) -> bool {
        (*self as f32).is_finite()
    }
}

impl<A: Representable, const N: usize> Representable for [A; N] {
    fn representable(&self) -> bool {
        self.iter().all(Representable::representable)
    }
}

/// Declares a table entry: plain fields first, then, after `real`, those that depend on the real type.
macro_rules! table {
    ($(#[$doc:meta])* pub struct $name:ident {
        $($(#[$pdoc:meta])* pub $plain:ident: $ptype:ty,)*
        real: $($(#[$rdoc:meta])* pub $real:ident: $rtype:ty,)*
    } $t:ident) => {
        $(#[$doc])*
        #[derive(Clone, Debug)]
        pub struct $name<$t> {
            $($(#[$pdoc])* pub $plain: $ptype,)*
            $($(#[$rdoc])* pub $real: $rtype,)*
        }
        impl<$t: Real, U: Real> Cast<U> for $name<$t> {
            type Out = $name<U>;
            fn cast(&self) -> $name<U> {
                $name { $($plain: self.$plain.clone(),)* $($real: self.$real.cast(),)* }
            }
        }
        impl $name<f64> {
            /// The first field that is not finite, or not in single precision.
            pub fn overflow(&self) -> Option<&'static str> {
                $(if !self.$real.representable() {
                    return Some(stringify!($real));
                })*
                None
            }
        }
        impl Representable for $name<f64> {
            fn representable(&self) -> bool {
                self.overflow().is_none()
            }
        }
    };
}
pub(super) use table;
