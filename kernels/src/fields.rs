//! Fields: arrays of a stage, declared once with name, shape and meaning.

use crate::lane::Lane;
use crate::model::Sizes;

/// What a field was declared as.
#[derive(Clone, Copy, Debug)]
pub struct Declared {
    /// Name.
    pub name: &'static str,
    /// What it is, as its declaration says.
    pub what: &'static str,
    /// Number of entries as the declaration says it: `sizes.nq`, or a number.
    pub count: &'static str,
    /// Number of entries.
    pub entries: fn(&Sizes) -> usize,
    /// Lanes per entry.
    pub width: usize,
}

impl Declared {
    /// Lanes of a model of these sizes.
    pub fn len(&self, sizes: &Sizes) -> usize {
        (self.entries)(sizes).saturating_mul(self.width)
    }
}

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
    const WIDTH: usize;
    /// Bytes of `n` entries.
    fn bytes(n: usize) -> usize {
        n.saturating_mul(Self::WIDTH * size_of::<L>())
    }
    /// All lanes, entry by entry.
    fn lanes(&mut self) -> &mut [L];
    /// The same, to be read.
    fn all(&self) -> &[L];
}

impl<L: Lane> Field<L> for Vec<L> {
    fn zeros(n: usize) -> Self {
        vec![L::zero(); n]
    }
    const WIDTH: usize = 1;
    fn lanes(&mut self) -> &mut [L] {
        self
    }
    fn all(&self) -> &[L] {
        self
    }
}

impl<L: Lane, const N: usize> Field<L> for Vec<[L; N]> {
    fn zeros(n: usize) -> Self {
        vec![[L::zero(); N]; n]
    }
    const WIDTH: usize = N;
    fn lanes(&mut self) -> &mut [L] {
        self.as_flattened_mut()
    }
    fn all(&self) -> &[L] {
        self.as_flattened()
    }
}

/// Declares the struct of a stage: every field with its type, length in terms of the model's sizes, and documentation.
/// Generates construction, iteration over the fields, and access to them by their number.
macro_rules! fields {
    ($(#[$doc:meta])* pub struct $name:ident($sizes:ident) {
        $($(#[doc = $fdoc:literal])* pub $field:ident: $type:ty = $len:expr,)*
    } $l:ident) => {
        $(#[$doc])*
        #[derive(Clone, Debug)]
        pub struct $name<$l> {
            $($(#[doc = $fdoc])* pub $field: $type,)*
        }
        impl<$l: $crate::lane::Lane> $name<$l> {
            /// The fields as they are declared, in this order.
            pub const FIELDS: &'static [$crate::fields::Declared] = &[$($crate::fields::Declared {
                name: stringify!($field),
                what: concat!($($fdoc),*).trim_ascii(),
                count: stringify!($len),
                #[allow(unused_variables, reason = "some lengths are numbers")]
                entries: |$sizes: &$crate::model::Sizes| $len,
                width: <$type as $crate::fields::Field<$l>>::WIDTH,
            },)*];
            /// The lanes of the field of this number.
            pub fn field(&self, number: usize) -> &[$l] {
                [$($crate::fields::Field::all(&self.$field)),*][number]
            }
            /// The same, to be written.
            pub fn field_mut(&mut self, number: usize) -> &mut [$l] {
                let mut fields = [$(Some($crate::fields::Field::lanes(&mut self.$field))),*];
                fields[number].take().unwrap_or_default()
            }
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
                    width: <$type as $crate::fields::Field<$l>>::WIDTH,
                    data: $crate::fields::Field::lanes(&mut self.$field),
                });)*
            }
        }
    };
}
pub(crate) use fields;
