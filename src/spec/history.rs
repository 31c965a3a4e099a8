//! Histories of actuators and sensors, as they are written.

pub use lanesim_kernels::model::Interpolation;

/// Samples that are kept of what an actuator was told, or of what a sensor measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// How many; 0: none.
    pub nsample: usize,
    /// What is told of times between them.
    pub interp: Interpolation,
    /// How late the actuator is told, or the sensor tells, s; 0: at once.
    pub delay: f64,
    /// Of a sensor, how often it measures, s, 0: at every step; and when it last did before time 0, s, 0: a period before.
    pub interval: [f64; 2],
}
