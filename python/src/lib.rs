//! The compiled half of the Python package `lanesim`.
//!
//! What is here moves numbers and releases the interpreter; shapes, names and everything a user reads are in
//! `python/lanesim/`.

mod arrays;
mod cloud;
mod failure;
mod home;
mod model;
mod optimise;
mod watch;
mod worlds;

use numpy::PyArrayMethods;
use pyo3::prelude::*;

/// The compiled half of lanesim. Use the package `lanesim`.
#[pymodule]
mod _lanesim {
    #[pymodule_export]
    use super::arrays::{check_finite, or_list};
    #[pymodule_export]
    use super::cloud::Cloud;
    #[pymodule_export]
    use super::model::Model;
    #[pymodule_export]
    use super::optimise::{optimise, tasks};
    #[pymodule_export]
    use super::worlds::{Pool, Worlds};
    use super::{Bound, PyArrayMethods, PyModule, PyModuleMethods, PyResult};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        // NumPy's interface is found now: later, a signal that comes while it is looked for would be a panic.
        numpy::PyArray1::<f64>::zeros(module.py(), 0, false).readonly();
        // What a process makes once is made before any thread could be at it while the process is forked.
        lanesim::prepare_to_fork();
        super::worlds::Choice::learn(module.py())?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("STATUS", super::worlds::status_bits())?;
        let parameters = lanesim::Parameter::ALL.map(|(parameter, name)| (name, parameter.meaning()));
        module.add("PARAMETERS", parameters.to_vec())?;
        let fields = lanesim::Field::ALL.map(|(field, name)| (name, field.meaning(), field.dims()));
        module.add("FIELDS", fields.to_vec())?;
        let outputs = lanesim::outputs::Output::all().map(|output| (output.name, output.meaning));
        module.add("OUTPUTS", outputs.collect::<Vec<_>>())
    }
}
