//! NumPy arrays as slices. They come contiguous and of a known type: `lanesim/_arrays.py` sees to that.

use lanesim::rows::{Rows, Values};
use numpy::{PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::failure::raise;

/// An array to read.
#[derive(FromPyObject)]
pub enum Numbers<'py> {
    /// Double precision.
    F64(PyReadonlyArrayDyn<'py, f64>),
    /// Single precision.
    F32(PyReadonlyArrayDyn<'py, f32>),
}

impl Numbers<'_> {
    /// Its numbers in C order.
    pub fn values(&self) -> PyResult<Values<'_>> {
        Ok(match self {
            Numbers::F64(array) => Values::F64(array.as_slice()?),
            Numbers::F32(array) => Values::F32(array.as_slice()?),
        })
    }
}

/// An array to write to.
#[derive(FromPyObject)]
pub enum Target<'py> {
    /// Double precision.
    F64(PyReadwriteArrayDyn<'py, f64>),
    /// Single precision.
    F32(PyReadwriteArrayDyn<'py, f32>),
    /// Integers.
    I32(PyReadwriteArrayDyn<'py, i32>),
}

impl Target<'_> {
    /// Its entries in C order.
    pub fn rows(&mut self) -> PyResult<Rows<'_>> {
        Ok(match self {
            Target::F64(array) => Rows::F64(array.as_slice_mut()?),
            Target::F32(array) => Rows::F32(array.as_slice_mut()?),
            Target::I32(array) => Rows::I32(array.as_slice_mut()?),
        })
    }
}

/// An exception if an array holds a number that is not finite; `name` is for its text.
#[pyfunction]
pub fn check_finite(py: Python<'_>, name: &str, array: Numbers<'_>) -> PyResult<()> {
    let values = array.values()?;
    let shape = match &array {
        Numbers::F64(array) => array.shape(),
        Numbers::F32(array) => array.shape(),
    };
    py.detach(|| values.check_finite(name, shape)).map_err(|e| raise(py, e))
}

/// `did you mean "x"?` for the known name nearest to `name`, or the list if it is short and none is near, or nothing.
#[pyfunction]
pub fn or_list(name: &str, known: Vec<String>) -> String {
    lanesim::suggest::or_list(name, known.iter().map(String::as_str))
}
