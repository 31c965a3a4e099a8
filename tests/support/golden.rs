//! The recorded results of MuJoCo.

use std::collections::BTreeMap;

use lanesim::eval::eval;
use lanesim::npz::{self, Array, Data};
use lanesim::{Model, Options};

use super::{all_models, load_with, repository};

/// A model with what MuJoCo computed for it.
pub struct Golden {
    /// Folder/name.
    pub name: String,
    /// Ours, compiled.
    pub model: Model,
    /// The recorded arrays.
    pub arrays: BTreeMap<String, Array>,
}

/// The solver runs to the minimiser, as it did for the goldens.
const CONVERGED: [(&str, &str); 3] = [("tolerance", "1e-14"), ("ls_tolerance", "1e-6"), ("iterations", "200")];

impl Golden {
    /// The model and its file.
    pub fn read(name: &str) -> Golden {
        Golden::read_with(name, &[])
    }

    /// The same with other options.
    pub fn read_with(name: &str, overrides: &[(&str, &str)]) -> Golden {
        let overrides: Vec<_> = CONVERGED.iter().chain(overrides).copied().collect();
        Golden { name: name.into(), model: load_with(name, &overrides), arrays: recorded("tests/goldens", name) }
    }

    /// Steps of other integrators, and inverse dynamics.
    pub fn steps(&self) -> BTreeMap<String, Array> {
        recorded("tests/goldens/steps", &self.name)
    }

    /// Motions of bodies, forces between them, and Jacobians of points.
    pub fn bodies(&self) -> BTreeMap<String, Array> {
        recorded("tests/goldens/bodies", &self.name)
    }

    /// Every model of the repository.
    pub fn all() -> Vec<Golden> {
        all_models().iter().map(|name| Golden::read(name)).collect()
    }

    /// An array; empty ones are not recorded.
    pub fn array(&self, name: &str) -> Vec<f64> {
        self.arrays.get(name).map_or(vec![], |array| array.to_f64().into_owned())
    }

    /// The recorded states.
    pub fn inputs(&self) -> BTreeMap<String, Array> {
        let input = |(name, array): (&String, &Array)| Some((name.strip_prefix("in/")?.to_string(), array.clone()));
        self.arrays.iter().filter_map(input).collect()
    }

    /// Rounds an input to single precision.
    pub fn round(&mut self, name: &str) {
        if let Some(array) = self.arrays.get_mut(name) {
            let rounded = array.to_f64().iter().map(|x| f64::from(*x as f32)).collect();
            *array = Array::new(array.shape().to_vec(), Data::F64(rounded)).expect("an array");
        }
    }

    /// Number of recorded states. A model without positions or controls has one, of no numbers.
    pub fn states(&self) -> usize {
        self.array("out/ncon").len()
    }

    /// The rows of an array with a leading dimension of states.
    pub fn rows(&self, array: &[f64]) -> Vec<Vec<f64>> {
        let n = self.states();
        let width = array.len() / n;
        (0..n).map(|i| array[i * width..(i + 1) * width].to_vec()).collect()
    }

    /// Our results, by field.
    pub fn eval(&self, fields: &[&str], nstep: usize, options: &Options) -> BTreeMap<String, Vec<Vec<f64>>> {
        let mut inputs = self.inputs();
        // States of a model without inputs are all alike, and one world per state must still come out.
        inputs.entry("time".into()).or_insert_with(|| Array::vector(vec![0.0; self.states()]));
        let outputs =
            eval(&self.model, &inputs, fields, nstep, options).unwrap_or_else(|e| panic!("{}: {e}", self.name));
        outputs.into_iter().map(|(name, array)| (name, self.rows(&array.to_f64()))).collect()
    }
}

/// A model's file in a folder.
fn recorded(folder: &str, name: &str) -> BTreeMap<String, Array> {
    let file = name.split('/').next_back().unwrap_or(name);
    let path = repository(folder).join(format!("{file}.npz"));
    npz::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Collects what is wrong, to name everything at once.
#[derive(Default)]
pub struct Failures {
    list: Vec<String>,
    checked: usize,
    worst: f64,
}

impl Failures {
    /// Takes a comparison's result; `place` says what was compared.
    pub fn check(&mut self, place: impl FnOnce() -> String, result: Result<f64, String>) {
        self.checked += 1;
        match result {
            Ok(error) => self.worst = self.worst.max(error),
            Err(message) => self.list.push(format!("{}{message}", place())),
        }
    }

    /// Panics if anything was wrong, or if there was nothing to compare.
    #[track_caller]
    pub fn report(self) {
        let (n, checked) = (self.list.len(), self.checked);
        println!("{checked} comparisons, the worst that passes {:.1e}", self.worst);
        assert!(checked > 0, "nothing was compared");
        assert!(n == 0, "{n} of {checked} comparisons fail:\n{}", self.list.join("\n"));
    }
}
