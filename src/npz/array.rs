//! An array of numbers with a shape, in C order.

use std::borrow::Cow;

/// The numbers of an array.
#[derive(Clone, Debug, PartialEq)]
pub enum Data {
    /// Double precision.
    F64(Vec<f64>),
    /// Single precision.
    F32(Vec<f32>),
    /// Signed 32-bit integers; NumPy's narrower signed ones are widened to these.
    I32(Vec<i32>),
    /// Signed 64-bit integers.
    I64(Vec<i64>),
    /// Unsigned 32-bit integers; booleans and NumPy's narrower unsigned ones are widened to these.
    U32(Vec<u32>),
    /// Unsigned 64-bit integers.
    U64(Vec<u64>),
}

/// Runs an expression on the vector inside, whatever its type.
macro_rules! each {
    ($data:expr, $v:ident => $body:expr) => {
        match $data {
            Data::F64($v) => $body,
            Data::F32($v) => $body,
            Data::I32($v) => $body,
            Data::I64($v) => $body,
            Data::U32($v) => $body,
            Data::U64($v) => $body,
        }
    };
}
pub(super) use each;

impl Data {
    /// Number of entries.
    pub fn len(&self) -> usize {
        each!(self, v => v.len())
    }

    /// Whether there is no entry.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// An array of any number of dimensions; none for a scalar. The last index runs fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    shape: Vec<usize>,
    data: Data,
}

impl Array {
    /// An array of `shape` with the entries of `data`; `None` if their numbers differ.
    pub fn new(shape: Vec<usize>, data: Data) -> Option<Array> {
        (entries(&shape)? == data.len()).then_some(Array { shape, data })
    }

    /// Double-precision numbers; one dimension.
    pub fn vector(values: Vec<f64>) -> Array {
        Array { shape: vec![values.len()], data: Data::F64(values) }
    }

    /// Lengths of the dimensions.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// The entries.
    pub fn data(&self) -> &Data {
        &self.data
    }

    /// The entries as double-precision numbers; 64-bit integers beyond 2^53 are rounded.
    pub fn to_f64(&self) -> Cow<'_, [f64]> {
        match &self.data {
            Data::F64(v) => Cow::Borrowed(v),
            Data::F32(v) => v.iter().map(|&x| f64::from(x)).collect(),
            Data::I32(v) => v.iter().map(|&x| f64::from(x)).collect(),
            Data::I64(v) => v.iter().map(|&x| x as f64).collect(),
            Data::U32(v) => v.iter().map(|&x| f64::from(x)).collect(),
            Data::U64(v) => v.iter().map(|&x| x as f64).collect(),
        }
    }

    /// The same, without a copy where they are such already; `None` if there is no memory for one.
    pub fn into_f64(self) -> Option<Vec<f64>> {
        fn convert<T: Copy>(values: &[T], f: impl Fn(T) -> f64) -> Option<Vec<f64>> {
            let mut out = Vec::new();
            out.try_reserve_exact(values.len()).ok()?;
            out.extend(values.iter().map(|x| f(*x)));
            Some(out)
        }
        match self.data {
            Data::F64(v) => Some(v),
            Data::F32(v) => convert(&v, f64::from),
            Data::I32(v) => convert(&v, f64::from),
            Data::I64(v) => convert(&v, |x| x as f64),
            Data::U32(v) => convert(&v, f64::from),
            Data::U64(v) => convert(&v, |x| x as f64),
        }
    }
}

/// Number of entries of an array of this shape, if it can be counted.
pub(super) fn entries(shape: &[usize]) -> Option<usize> {
    // A length of zero makes the array empty however long the other dimensions are.
    if shape.contains(&0) {
        return Some(0);
    }
    shape.iter().try_fold(1usize, |n, &d| n.checked_mul(d))
}
