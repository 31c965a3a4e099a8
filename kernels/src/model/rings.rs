//! Rings of samples in the histories of worlds.

use super::Span;

/// What is told between samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// The earlier one.
    #[default]
    Hold,
    /// A line.
    Linear,
    /// A cubic (Catmull-Rom).
    Cubic,
}

/// A ring of samples in [`State::history`](crate::state::State::history): a number of the sensor's own, the place of the newest sample, the
/// times of all, and their values, sample by sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Ring {
    /// Its numbers.
    pub span: Span,
    /// How many samples it holds.
    pub samples: u32,
    /// Numbers of a sample.
    pub dim: u32,
    /// The first control, or number of sensors, of which it holds samples.
    pub first: u32,
    /// What is told between samples.
    pub interpolation: Interpolation,
    /// How late they are told, s; 0: they are not.
    pub delay: f64,
    /// How often a sensor measures, s; 0: at every step. Its own number is when it last was due to.
    pub period: f64,
}

impl Ring {
    /// Numbers of a ring of so many samples of `dim` numbers.
    pub fn len(samples: usize, dim: usize) -> usize {
        samples.saturating_mul(1 + dim).saturating_add(2)
    }

    /// Where a number of the sample at a place of the ring is.
    pub fn value(&self, place: usize, component: usize) -> usize {
        2 + self.samples as usize + place * self.dim as usize + component
    }
}
