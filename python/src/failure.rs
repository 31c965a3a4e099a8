//! From the library's errors to the exceptions of `lanesim.errors`, with the same text.

use lanesim::{Diagnostics, Error};
use pyo3::BoundObject;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// The exception for an error of the library.
pub fn raise(py: Python<'_>, error: Error) -> PyErr {
    let text = error.to_string();
    match error {
        Error::Model(diagnostics) => rejected(py, &diagnostics),
        Error::Input(_) => new(py, "InputError", (text,)),
        Error::Options(_) => new(py, "OptionError", (text,)),
        Error::Unknown(_) => new(py, "UnknownNameError", (text,)),
        Error::Memory { .. } | Error::MemoryLimit { .. } => new(py, "WorldMemoryError", (text,)),
        Error::Diverged { .. } => new(py, "DivergedError", (text,)),
        Error::Cancelled => new(py, "LanesimError", (text,)),
    }
}

/// The exception for a model that was rejected: its text, and its problems one by one.
pub fn rejected(py: Python<'_>, diagnostics: &Diagnostics) -> PyErr {
    let list: Vec<_> = diagnostics
        .0
        .iter()
        .map(|d| (d.source.file.as_deref(), d.source.line, &*d.element, &*d.message, &*d.remedy))
        .collect();
    new(py, "ModelError", (diagnostics.to_string(), list))
}

/// An exception of `lanesim.errors` by its name.
pub fn new<'py>(py: Python<'py>, name: &str, arguments: impl IntoPyObject<'py, Target = PyTuple>) -> PyErr {
    let make = || -> PyResult<PyErr> {
        let arguments = arguments.into_pyobject(py).map_err(Into::into)?;
        let class = py.import("lanesim.errors")?.getattr(name)?;
        Ok(PyErr::from_value(class.call1(arguments.into_bound())?))
    };
    make().unwrap_or_else(|error| error)
}
