//! Fields: arrays of a stage, declared once with name, shape and meaning.

use crate::lane::Lane;

/// A view of one field: `data` has `width` lanes per entry.
pub struct FieldView<'a, L> {
    /// Name.
    pub name: &'static str,
    /// Lanes per entry.
    pub width: usize,
    /// All lanes, entry by entry.
    pub data: &'a mut [L],
}

/// Storage of a field: a vector of lanes or of small arrays of lanes.
pub trait Field<L> {
    /// `n` zero entries.
    fn zeros(n: usize) -> Self;
    /// Lanes per entry.
    fn width() -> usize;
    /// Bytes of `n` entries.
    fn bytes(n: usize) -> usize {
        n.saturating_mul(Self::width() * size_of::<L>())
    }
    /// All lanes, entry by entry.
    fn lanes(&mut self) -> &mut [L];
}

impl<L: Lane> Field<L> for Vec<L> {
    fn zeros(n: usize) -> Self {
        vec![L::zero(); n]
    }
    fn width() -> usize {
        1
    }
    fn lanes(&mut self) -> &mut [L] {
        self
    }
}

impl<L: Lane, const N: usize> Field<L> for Vec<[L; N]> {
    fn zeros(n: usize) -> Self {
        vec![[L::zero(); N]; n]
    }
    fn width() -> usize {
        N
    }
    fn lanes(&mut self) -> &mut [L] {
        self.as_flattened_mut()
    }
}

/// Declares the struct of a stage: every field with its type, length in terms of the model's sizes, and documentation.
/// Generates construction and iteration over the fields.
macro_rules! fields {
    ($(#[$doc:meta])* pub struct $name:ident($sizes:ident) {
        $($(#[$fdoc:meta])* pub $field:ident: $type:ty = $len:expr,)*
    } $l:ident) => {
        $(#[$doc])*
        #[derive(Clone, Debug)]
        pub struct $name<$l> {
            $($(#[$fdoc])* pub $field: $type,)*
        }
        impl<$l: $crate::lane::Lane> $name<$l> {
            /// All fields zero, with the lengths that the model needs.
            pub fn new($sizes: &$crate::model::Sizes) -> Self {
                $name { $($field: <$type as $crate::fields::Field<$l>>::zeros($len),)* }
            }
            /// Number of fields.
            pub const COUNT: usize = [$(stringify!($field)),*].len();

            /// Bytes of all fields.
            pub fn bytes($sizes: &$crate::model::Sizes) -> usize {
                0_usize$(.saturating_add(<$type as $crate::fields::Field<$l>>::bytes($len)))*
            }
            /// Calls `f` with every field, in the order of declaration.
            #[inline(always)]
            pub fn for_each<'a>(&'a mut self, f: &mut impl FnMut($crate::fields::FieldView<'a, $l>)) {
                $(f($crate::fields::FieldView {
                    name: stringify!($field),
                    width: <$type as $crate::fields::Field<$l>>::width(),
                    data: $crate::fields::Field::lanes(&mut self.$field),
                });)*
            }
        }
    };
}
pub(crate) use fields;
