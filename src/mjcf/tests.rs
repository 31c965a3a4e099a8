//! Tests of the front end. Numbers were computed by MuJoCo 4.0.0 from the same text.

mod actuators;
mod attach;
mod attributes;
mod bodies;
mod left_out;
mod model;
mod text;
mod written;

use super::{LoadOptions, parse};
use crate::spec::Spec;

/// Half the square root of two: quarter turns are full of it.
const H: f64 = std::f64::consts::FRAC_1_SQRT_2;

fn world(body: &str) -> String {
    format!("<mujoco><worldbody>{body}</worldbody></mujoco>")
}

/// A model with a joint `j` and some sections.
fn with_joint(sections: &str) -> String {
    format!(
        "<mujoco>{sections}<worldbody><body><joint name=\"j\" range=\"-30 60\"/><geom name=\"g\" size=\".1\"/></body>\
         <geom name=\"h\" size=\".1\"/></worldbody></mujoco>"
    )
}

#[track_caller]
fn ok(text: &str) -> Spec {
    parse(text, &LoadOptions::default()).unwrap_or_else(|problems| panic!("{problems}\n{text}"))
}

fn lenient(text: &str) -> Spec {
    let options = LoadOptions { lenient: true, ..LoadOptions::default() };
    parse(text, &options).unwrap_or_else(|problems| panic!("{problems}\n{text}"))
}

/// The first problem is as expected.
#[track_caller]
fn rejects(text: &str, expected: &str) {
    let problems = parse(text, &LoadOptions::default()).expect_err("must be rejected");
    assert_eq!(problems.0[0].to_string(), expected, "in {text}");
}

#[track_caller]
fn close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() < 2e-6, "{found:?} instead of {expected:?}");
    }
}
