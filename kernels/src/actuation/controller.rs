//! Controllers: what actuators do with several controls (MuJoCo's manual, `actuator/pid` and the controller of `actuator/dcmotor`).

use crate::lane::Lane;
use crate::model::{Actuator, Controller, Model, NONE};

/// What a controller makes of its controls.
pub(super) struct Command<L> {
    /// Position, velocity and force that it is told; 0 where it is not.
    pub told: [L; 3],
    /// The integral of the error in position.
    pub integral: L,
}

/// Finds it, for an actuator of a length, and the rates of the controller's activations.
#[inline(always)]
pub(super) fn command<L: Lane>(
    model: &Model<L::Real>,
    (actuator, own): (&Actuator<L::Real>, &Controller<L::Real>),
    control: impl Fn(u32) -> L,
    (act, length): (&[L], L),
    rates: &mut [L],
) -> Command<L> {
    let zero = L::zero();
    let mut told = own.inputs.map(|input| if input == NONE { zero } else { control(input) });
    if let Some(reached) = act.get(own.slew as usize) {
        let first = own.inputs.iter().position(|input| *input != NONE).unwrap_or(0);
        let [step, rate] = [own.slew_step, own.slew_rate].map(L::splat);
        let missing = told[first] - *reached;
        rates[own.slew as usize] = (missing / L::of(model.options.timestep)).clamp(-rate, rate);
        told[first] = *reached + missing.clamp(-step, step);
    }
    let mut integral = zero;
    if let Some(sum) = act.get(own.integral as usize) {
        let (error, most) = (told[0] - length, L::splat(own.windup));
        let wound = !sum.lt(most) & error.gt(zero) | !sum.gt(-most) & error.lt(zero);
        let rate = if own.winds { L::select(wound, zero, error) } else { error };
        rates[own.integral as usize] = rate;
        integral = if actuator.early { super::next(actuator, *sum, rate) } else { *sum };
    }
    Command { told, integral }
}
