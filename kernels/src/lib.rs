//! The physics of lanesim: every stage of a step, written once over a [`lane`] type.

pub mod lane;
pub mod model;
pub mod options;
