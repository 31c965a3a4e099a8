//! `nsample`, `interp` and `delay` of actuators and sensors.

use super::reader::Reader;
use crate::spec::{History, Interpolation};

const INTERPOLATIONS: &[(&str, Interpolation)] =
    &[("zoh", Interpolation::Hold), ("linear", Interpolation::Linear), ("cubic", Interpolation::Cubic)];

/// Reads what is kept of an actuator's controls, or of a sensor's numbers.
pub(super) fn history(reader: &mut Reader, history: &mut History) {
    let mut samples = i32::try_from(history.nsample).unwrap_or(i32::MAX);
    reader.integer("nsample", &mut samples);
    match usize::try_from(samples) {
        Ok(samples) => history.nsample = samples,
        Err(_) => reader.report.error(reader.element, "nsample must not be negative", "give 0 for none"),
    }
    reader.keyword("interp", INTERPOLATIONS, &mut history.interp);
    reader.real("delay", &mut history.delay);
}
