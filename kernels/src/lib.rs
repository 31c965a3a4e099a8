//! The physics of lanesim: every stage of a step, written once over a [`lane`] type.
//!
//! The tree is the pipeline: `position`, `tendon`, `inertia`, `velocity`, `passive`, `actuation`, `acceleration`, `derivative`,
//! `collision`, `constraint`, `solver`, `integration`. A stage reads earlier stages' structs and never calls their functions.

pub mod acceleration;
pub mod actuation;
pub mod collision;
pub mod constraint;
pub mod derivative;
pub mod diagnosis;
pub mod double;
pub mod drivers;
pub mod energy;
pub mod exact;
pub mod fields;
pub mod history;
pub mod inertia;
pub mod integration;
pub mod inverse;
pub mod kick;
pub mod lane;
pub mod math;
pub mod model;
pub mod options;
pub mod part;
pub mod passive;
pub mod pipeline;
pub mod position;
pub mod sensor;
pub mod sleep;
pub mod smooth;
pub mod solver;
pub mod stage;
pub mod state;
pub mod step;
pub mod tendon;
pub mod velocity;
pub mod workspace;
