//! What the test crates share: models of the repository, random numbers, comparison of fields.
#![allow(dead_code, unused_imports)] // every test crate uses its own part

pub mod golden;
mod random;

use std::path::{Path, PathBuf};

use lanesim::mjcf::LoadOptions;
use lanesim::outputs::Output;
use lanesim::{Backend, Controls, Error, Field, Model, Options, Precision, Rollout, Worlds};

pub use random::Random;

/// A path inside the repository.
pub fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Models that the integrator `discrete` refuses: see `what_discrete_steps_refuse` in tests/steps.rs.
pub const NOT_DISCRETE: [&str; 10] = [
    "unit/fluid_thin",
    "unit/fluid_ellipsoid",
    "unit/adhesion",
    "unit/surfacevel",
    "unit/actuator_across",
    "unit/tendon_armature",
    "unit/tendon_fixed",
    "unit/tendon_spatial",
    "unit/tendon_wrap",
    "unit/tendon_actuators",
];

/// Every model under `models/zoo` and `models/unit` as folder/name, sorted.
pub fn all_models() -> Vec<String> {
    let mut names = Vec::new();
    for folder in ["zoo", "unit"] {
        for entry in std::fs::read_dir(repository("models").join(folder)).expect("the models folder") {
            let path = entry.expect("a file of the models folder").path();
            if path.extension().is_some_and(|e| e == "xml") {
                names.push(format!("{folder}/{}", path.file_stem().expect("a file name").to_string_lossy()));
            }
        }
    }
    names.sort();
    names
}

/// Worlds in states of their own, under control noise of this share of the ranges for a while.
pub fn moving(model: &Model, nworld: usize, scale: f64, options: &Options) -> Worlds {
    let mut worlds = Worlds::new(model, nworld, options).expect("a batch");
    let noise = Rollout { nstep: 120, controls: Controls::Noise { seed: 3, scale }, ..Rollout::default() };
    worlds.rollout(&noise).expect("a rollout");
    worlds
}

/// A batch with the states of some worlds of another, as they are.
pub fn copied(from: &Worlds, ids: &[usize], options: &Options) -> Worlds {
    let mut worlds = Worlds::new(from.model(), ids.len(), options).expect("a batch");
    for (field, _) in Field::ALL {
        for (to, id) in ids.iter().enumerate() {
            worlds.set(field, to, &from.get(field, *id).expect("a field")).expect("a world");
        }
    }
    worlds
}

/// Asserts that something fails with `message` in its error.
#[track_caller]
pub fn fails<T>(result: Result<T, Error>, message: &str) {
    match result {
        Ok(_) => panic!("no error; expected: {message}"),
        Err(error) => assert!(error.to_string().contains(message), "{error}\nexpected: {message}"),
    }
}

/// A model of the repository by folder/name, with options replaced.
#[track_caller]
pub fn load_with(name: &str, overrides: &[(&str, &str)]) -> Model {
    let overrides = overrides.iter().map(|(k, v)| ((*k).to_string(), (*v).to_string())).collect();
    let path = repository("models").join(format!("{name}.xml"));
    Model::from_xml_path(&path, &LoadOptions { overrides, ..LoadOptions::default() })
        .unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// A model of the repository by folder/name.
#[track_caller]
pub fn load(name: &str) -> Model {
    load_with(name, &[])
}

/// A model from MJCF text.
#[track_caller]
pub fn parse(text: &str) -> Model {
    Model::from_xml_string(text, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

/// Options with one worker thread.
pub fn options(precision: Precision, backend: Backend) -> Options {
    Options { precision, backend, threads: Some(1), ..Options::default() }
}

/// Largest magnitude.
pub fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m: f64, x| m.max(x.abs()))
}

/// The entry in which two vectors differ most, and by how much; NaN counts as infinite.
pub fn worst(got: &[f64], expected: &[f64]) -> (usize, f64) {
    let mut found = (0, 0.0);
    for (i, (a, b)) in got.iter().zip(expected).enumerate() {
        let error = if a == b { 0.0 } else { (a - b).abs() };
        let error = if error.is_nan() { f64::INFINITY } else { error };
        if error > found.1 {
            found = (i, error);
        }
    }
    found
}

/// Whether two vectors agree to `tolerance` times the larger of the expected vector's largest entry and `floor`: the error
/// in that unit, or a message that says where they differ most.
pub fn agree(got: &[f64], expected: &[f64], tolerance: f64, floor: f64) -> Result<f64, String> {
    if got.len() != expected.len() {
        return Err(format!("{} numbers instead of {}", got.len(), expected.len()));
    }
    let size = largest(expected).max(floor);
    let (i, error) = worst(got, expected);
    if error <= tolerance * size {
        return Ok(if size > 0.0 { error / size } else { 0.0 });
    }
    Err(format!("[{i}] is {} instead of {}: {:.1e} of the field's size {size:.3}", got[i], expected[i], error / size))
}

/// Asserts [`agree`], naming `what`.
#[track_caller]
pub fn assert_agree(what: &str, got: &[f64], expected: &[f64], tolerance: f64, floor: f64) {
    if let Err(message) = agree(got, expected, tolerance, floor) {
        panic!("{what}{message}");
    }
}

/// Every output that there is of a model, those of an element of its first.
pub fn every_output(model: &Model) -> Vec<Output> {
    // Not every model has a geom and a site.
    Output::all().filter_map(|output| model.output(&output.name.replace("NAME", "0")).ok()).collect()
}
