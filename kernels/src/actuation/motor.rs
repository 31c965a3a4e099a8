//! Direct-current motors: what current their voltage drives against resistance and their own motion, and what turns them beside it (MuJoCo's
//! manual, `actuator/dcmotor`; friction by bristles: Canudas de Wit, Olsson, Åström, Lischinsky 1995). Found by experiment where the manual
//! is silent.

use super::controller::Command;
use crate::lane::{Lane, Real, exp, sin_cos};
use crate::model::{Controller, Motor};

/// What a motor has at a moment.
pub(super) struct Turned<L> {
    /// Torque.
    pub force: L,
    /// What it gains with length and with velocity.
    pub slopes: [L; 2],
    /// How far its bristles are bent after a step.
    pub bent: L,
}

/// A controller, and what it makes of its controls.
pub(super) type Commanded<'a, L> = (&'a Controller<<L as Lane>::Real>, Command<L>);

/// Torque of a motor, and the rates of its activations. `volts` is the voltage that it is told, `bounds` are those of its current's torque.
#[inline(always)]
pub(super) fn turn<L: Lane>(
    (own, controller): (&Motor<L::Real>, Option<Commanded<'_, L>>),
    volts: L,
    (act, length, velocity): (&[L], L, L),
    (bounds, timestep): (Option<[L; 2]>, f64),
    rates: &mut [L],
) -> Turned<L> {
    let (zero, constant) = (L::zero(), L::splat(own.constant));
    let (drive, by) = voltage(own, controller, length, velocity);
    let voltage = drive + volts;
    let mut resistance = L::splat(own.resistance);
    if let Some(warmer) = act.get(own.temperature as usize) {
        let [gain, beyond] = own.warming.map(L::splat);
        resistance = (gain * (*warmer + beyond)).mul_add(resistance, resistance);
    }
    // What drives the current, and what the current gains with length and velocity.
    let driven = constant.neg_mul_add(velocity, voltage) / resistance;
    let mut slopes = [by[0] / resistance, (by[1] - constant) / resistance];
    let (mut heats, mut current) = (driven, driven);
    if let Some(now) = act.get(own.current as usize) {
        let ([quickness, reach], most) = (own.electric.map(L::splat), L::splat(own.most_rise));
        let rate = (driven - *now) * quickness;
        let bounded = if own.rises { rate.clamp(-most, most) } else { rate };
        rates[own.current as usize] = bounded;
        let free = L::select(bounded.eq(rate), reach * quickness, zero);
        slopes = slopes.map(|slope| slope * free);
        (heats, current) = (*now, reach.mul_add(bounded, *now));
    }
    if let Some(warmer) = act.get(own.temperature as usize) {
        let [gain, loss] = own.heating.map(L::splat);
        rates[own.temperature as usize] = loss.neg_mul_add(*warmer, resistance * heats * heats * gain);
    }
    let mut out = Turned { force: constant * current, slopes: slopes.map(|slope| constant * slope), bent: zero };
    if let Some([low, high]) = bounds {
        // What friction and cogging do comes beside it.
        let free = out.force.gt(low) & out.force.lt(high);
        out.slopes = out.slopes.map(|slope| L::select(free, slope, zero));
        out.force = out.force.clamp(low, high);
    }
    if own.cogs {
        let [amplitude, periods, phase] = own.cogging.map(L::splat);
        let (sin, cos) = sin_cos(periods.mul_add(length, phase));
        out.force = amplitude.mul_add(sin, out.force);
        out.slopes[0] = (amplitude * periods).mul_add(cos, out.slopes[0]);
    }
    if let Some(bent) = act.get(own.bristle as usize) {
        let [stiffness, damping] = own.bristles.map(L::splat);
        let [moving, more, fades] = own.friction.map(L::splat);
        let ratio = velocity * fades;
        let most = more.mul_add(exp(-(ratio * ratio)), moving);
        let decay = stiffness * velocity.abs() / most;
        let rate = decay.neg_mul_add(*bent, velocity);
        rates[own.bristle as usize] = rate;
        out.force -= stiffness.mul_add(*bent, damping * rate);
        out.slopes[1] -= damping;
        out.bent = rate.mul_add(relaxed(decay, timestep), *bent);
    }
    out
}

/// Voltage of a motor's controller, which makes up for that of the motion, and what it gains with length and with velocity.
#[inline(always)]
fn voltage<L: Lane>(own: &Motor<L::Real>, controller: Option<Commanded<'_, L>>, length: L, velocity: L) -> (L, [L; 2]) {
    let zero = L::zero();
    let Some((controller, Command { told: [pos, vel, force], integral })) = controller else {
        return (zero, [zero; 2]);
    };
    let [kp, kd] = controller.gains.map(L::splat);
    let pull = kd.mul_add(vel - velocity, kp.mul_add(pos - length, force));
    let torque = L::splat(controller.ki).mul_add(integral, pull);
    let (constant, most) = (L::splat(own.constant), L::splat(own.most_voltage));
    let per_torque = L::splat(own.resistance) / constant;
    let wanted = constant.mul_add(velocity, per_torque * torque);
    let given = if own.saturates { wanted.clamp(-most, most) } else { wanted };
    let free = given.eq(wanted);
    let slopes = [-(per_torque * kp), per_torque.neg_mul_add(kd, constant)];
    (given, slopes.map(|slope| L::select(free, slope, zero)))
}

/// (1 - exp(-a h)) / a.
#[inline(always)]
fn relaxed<L: Lane>(decay: L, timestep: f64) -> L {
    let (h, one) = (L::of(timestep), L::one());
    let x = decay * h;
    // Where that is small, its series.
    let small = x.lt(L::of(if L::Real::EPSILON < 1e-10 { 1e-4 } else { 1e-2 }));
    let series = x.mul_add(x.mul_add(x.mul_add(L::of(-1.0 / 24.0), L::of(1.0 / 6.0)), L::of(-0.5)), one);
    let whole = (one - exp(-x)) / L::select(small, one, x);
    h * L::select(small, series, whole)
}
