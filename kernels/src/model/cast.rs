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
    };
}
pub(super) use table;
