//! Actuators: length, velocity and force, and the generalised forces that they make.

mod body;
mod controller;
mod motor;
mod muscle;
mod servo;
mod transmission;

pub use body::bodies;
pub use servo::within as servo_within;

use crate::fields::fields;
use crate::lane::{Lane, Mask, Real};
use crate::math::quat;
use crate::math::vec3::{norm, splat};
use crate::model::{Actuator, Controller, Dynamics, Instance, Model, NONE, Tendon, Transmission};
use crate::passive::Passive;
use crate::position::{Configuration, Position};
use crate::state::State;
use crate::tendon::Tendons;
use controller::Command;

fields! {
    /// Actuators.
    pub struct Actuation(sizes) {
        /// Length: gear times the position of a joint, or what else it is that its transmission measures.
        pub length: Vec<L> = sizes.nout,
        /// Velocity.
        pub velocity: Vec<L> = sizes.nout,
        /// The controls that act; of models in which some act late.
        pub told: Vec<L> = sizes.ndelayed,
        /// What its gain multiplies: the control within its range, or the activation.
        pub input: Vec<L> = sizes.nout,
        /// Orientations that servos turn, quaternions (w, x, y, z).
        pub turned: Vec<[L; 4]> = sizes.nservo,
        /// What the forces of motors gain with length and with velocity.
        pub slopes: Vec<[L; 2]> = sizes.nmotor,
        /// How far the bristles of motors are bent after a step, at the velocity at which it begins.
        pub bent: Vec<L> = sizes.nmotor,
        /// Rates of activations.
        pub act_dot: Vec<L> = sizes.na,
        /// Force.
        pub force: Vec<L> = sizes.nout,
        /// Force of each tendon's actuators together, of tendons that bound it.
        pub total: Vec<L> = sizes.ntendon,
        /// Moments: generalised force per unit of force, on the dofs of [`Model::moment_dofs`].
        pub moment: Vec<L> = sizes.nmoment,
        /// Sum of the actuators' generalised forces.
        pub qfrc_actuator: Vec<L> = sizes.nv,
    } L
}

/// Lengths and moments.
#[inline(always)]
pub fn lengths<L: Lane>(
    model: Instance<'_, L>,
    configuration: Configuration<'_, L>,
    places: (&Position<L>, &Tendons<L>),
    actuation: &mut Actuation<L>,
) {
    for (a, actuator) in model.actuators.iter().enumerate() {
        let moment = &mut actuation.moment[actuator.moments.range()];
        if let Some(servo) = model.servos.get(actuator.servo as usize) {
            let (turned, axis) = (&mut actuation.turned[actuator.servo as usize], a - servo.first as usize);
            if axis == 0 {
                *turned = servo::turned(model, actuator, configuration);
            }
            transmission::turn(model, (actuator, axis), places.0, moment);
            actuation.length[a] = quat::log(turned)[axis];
            continue;
        }
        actuation.length[a] = transmission::transmit(model, a, configuration, places, moment);
    }
}

/// Lengths and moments, and if actuation is on velocities, activations, forces and generalised forces. Returns the lanes in which a
/// control was not a usable number: all controls of such a world count as 0.
pub fn actuation<L: Lane>(
    model: Instance<'_, L>,
    state: &State<L>,
    (position, tendons, passive): (&Position<L>, &Tendons<L>, &Passive<L>),
    actuation: &mut Actuation<L>,
) -> L::Mask {
    let State { qvel, act, .. } = state;
    lengths(model, state.into(), (position, tendons), actuation);
    actuation.qfrc_actuator.fill(L::zero());
    actuation.act_dot.fill(L::zero());
    actuation.total.fill(L::zero());
    if !model.features.actuation {
        return L::Mask::splat(false);
    }
    let good = usable(acting(state, &actuation.told));
    for (a, actuator) in model.actuators.iter().enumerate() {
        let moment = &actuation.moment[actuator.moments.range()];
        let length = actuation.length[a];
        let dofs = &model.moment_dofs[actuator.moments.range()];
        let mut velocity = L::zero();
        for (k, (moment, entry)) in moment.iter().zip(dofs).enumerate() {
            let speed = qvel[entry.dof as usize];
            velocity = if k == 0 { *moment * speed } else { moment.mul_add(speed, velocity) };
        }
        actuation.velocity[a] = velocity;
        let told = |input: u32| control(model, input as usize, good, acting(state, &actuation.told));
        let mut input = if actuator.ctrl == NONE { L::zero() } else { told(actuator.ctrl) };
        let mut motor = None;
        if let Some(own) = model.controllers.get(actuator.controller as usize) {
            let Actuation { told, act_dot, .. } = &mut *actuation;
            let control = |input: u32| control(model, input as usize, good, acting(state, told));
            let command = controller::command(&model, (actuator, own), control, (act, length), act_dot);
            input = commanded(&model.bias(a), own, &command);
            motor = Some((own, command));
        }
        if let Some(own) = model.motors.get(actuator.motor as usize) {
            let Actuation { told, act_dot, .. } = &mut *actuation;
            let control = |input: u32| control(model, input as usize, good, acting(state, told));
            let volts = if own.voltage == NONE { L::zero() } else { control(own.voltage) };
            let of = (&act[..], length, velocity);
            let bounds = actuator.force_limited.then(|| model.force_range(a));
            let turned = motor::turn((own, motor), volts, of, (bounds, model.options.timestep), act_dot);
            let at = actuator.motor as usize;
            (actuation.slopes[at], actuation.bent[at]) = (turned.slopes, turned.bent);
            actuation.input[a] = volts;
            actuation.force[a] = if actuator.disabled { L::zero() } else { turned.force };
            continue;
        }
        if let Some(act) = act.get(actuator.act as usize) {
            let rate = rate(model, a, input, *act);
            actuation.act_dot[actuator.act as usize] = rate;
            input = if actuator.early { next(actuator, *act, rate) } else { *act };
        }
        if actuator.disabled {
            (actuation.input[a], actuation.force[a]) = (L::zero(), L::zero());
            continue;
        }
        if let Some(servo) = model.servos.get(actuator.servo as usize) {
            let (first, told) = (servo.first as usize, acting(state, &actuation.told));
            if a == first {
                let told = |input: u32| control(model, input as usize, good, told);
                let error = servo::error(model, servo, &actuation.turned[actuator.servo as usize], told, act);
                actuation.input[a..a + 3].copy_from_slice(&error);
            }
            let [_, _, hold] = model.bias(a);
            actuation.force[a] = model.gain(a)[0].mul_add(actuation.input[a], hold * velocity);
            continue;
        }
        let input = nearest(model, a, input, length);
        actuation.input[a] = input;
        if actuator.transmission == Transmission::Body {
            // Its contacts are not known yet.
            actuation.force[a] = L::zero();
            continue;
        }
        actuation.force[a] = force(model, a, input, length, velocity);
    }
    servo::bound(&model, &mut actuation.force);
    bound_by_tendons(&model, actuation);
    gather(model, passive, actuation);
    !good
}

/// The generalised forces, from moments and forces.
fn gather<L: Lane>(model: Instance<'_, L>, passive: &Passive<L>, actuation: &mut Actuation<L>) {
    actuation.qfrc_actuator.fill(L::zero());
    for (a, actuator) in model.actuators.iter().enumerate().filter(|(_, actuator)| !actuator.disabled) {
        let Actuation { force, moment, qfrc_actuator, .. } = &mut *actuation;
        if actuator.force_limited && actuator.motor == NONE {
            force[a] = clamp(force[a], &model.force_range(a));
        }
        let range = actuator.moments.range();
        for (entry, moment) in model.moment_dofs[range.clone()].iter().zip(&moment[range]) {
            let out = &mut qfrc_actuator[entry.dof as usize];
            *out = moment.mul_add(force[a], *out);
        }
    }
    for (t, _) in bounding(&model) {
        actuation.total[t] = total(&model, t, &actuation.force);
    }
    route_to_joints(&model, passive, &mut actuation.qfrc_actuator);
}

/// The controls that act: those of the state, or where some act late, what was `told`.
pub fn acting<'a, L>(state: &'a State<L>, told: &'a [L]) -> &'a [L] {
    if told.is_empty() { &state.ctrl } else { told }
}

/// The lanes in which all controls are usable numbers.
fn usable<L: Lane>(ctrl: &[L]) -> L::Mask {
    ctrl.iter().fold(L::Mask::splat(true), |good, u| good & u.within(L::Real::MAXVAL))
}

#[inline(always)]
fn clamp<L: Lane>(x: L, [low, high]: &[L; 2]) -> L {
    x.clamp(*low, *high)
}

/// A control as its actuator acts on it, `good` where it is [`usable`].
#[inline(always)]
fn control<L: Lane>(model: Instance<'_, L>, input: usize, good: L::Mask, ctrl: &[L]) -> L {
    let (own, u) = (&model.controls[input], L::select(good, ctrl[input], L::zero()));
    if own.limited && model.options.flags.clampctrl { clamp(u, &model.control_range(input)) } else { u }
}

/// What a bias of length and velocity is added to, so that a controller's force follows its errors in both.
#[inline(always)]
fn commanded<L: Lane>([_, length, velocity]: &[L; 3], own: &Controller<L::Real>, command: &Command<L>) -> L {
    let [pos, vel, force] = command.told;
    let pull = length.neg_mul_add(pos, velocity.neg_mul_add(vel, force));
    L::splat(own.ki).mul_add(command.integral, pull)
}

/// Of a servo on a rotation, the setpoint nearest to where it is: a turn is 2π times the gear.
#[inline(always)]
fn nearest<L: Lane>(model: Instance<'_, L>, a: usize, setpoint: L, length: L) -> L {
    let actuator = &model.actuators[a];
    if !actuator.turning {
        return setpoint;
    }
    let [x, y, z, rx, ry, rz] = model.gear(a);
    let axis = if actuator.transmission == Transmission::Relative { [rx, ry, rz] } else { [x, y, z] };
    let turn = norm(&axis) * L::of(2.0 * std::f64::consts::PI);
    let some = turn.gt(L::zero());
    let turns = ((length - setpoint) / L::select(some, turn, L::one())).round();
    // Its gain is that of a servo, and it turns.
    let servo = (model.gain(a)[0] + model.bias(a)[1]).eq(L::zero()) & some;
    L::select(servo, turns.mul_add(turn, setpoint), setpoint)
}

/// Rate of activation `w` at a control `u`.
#[inline(always)]
fn rate<L: Lane>(model: Instance<'_, L>, a: usize, u: L, w: L) -> L {
    let (actuator, times) = (&model.actuators[a], model.times(a));
    match actuator.dynamics {
        Dynamics::None => L::zero(),
        Dynamics::Integrator => u,
        Dynamics::Filter => (u - w) * times[0],
        Dynamics::Muscle => muscle::rate((actuator, times), u, w),
    }
}

/// Activation `w` after a step with a rate, that of a group that is not disabled.
#[inline(always)]
pub fn next<L: Lane>(actuator: &Actuator<L::Real>, w: L, rate: L) -> L {
    advance(actuator, w, rate, L::splat(actuator.reach))
}

/// The same, where an activation gains `reach` in a step per unit of its rate.
#[inline(always)]
fn advance<L: Lane>(actuator: &Actuator<L::Real>, w: L, rate: L, reach: L) -> L {
    let next = if actuator.disabled { w } else { rate.mul_add(reach, w) };
    if actuator.act_limited { clamp(next, &splat(&actuator.act_range)) } else { next }
}

/// Next activations, from their rates, and motors' bristles as they will be ([`Actuation::bent`]).
pub fn activations<L: Lane>(model: &Model<L::Real>, act: &[L], (rates, bent): (&[L], &[L]), out: &mut [L]) {
    if !model.features.actuation {
        return out.copy_from_slice(act);
    }
    for actuator in &model.actuators {
        let mut take = |at: u32, reach: L| {
            if let Some(w) = act.get(at as usize) {
                out[at as usize] = advance(actuator, *w, rates[at as usize], reach);
            }
        };
        let step = L::splat(actuator.reach);
        take(actuator.act, step);
        if let Some(own) = model.controllers.get(actuator.controller as usize) {
            take(own.slew, step);
            take(own.integral, step);
        }
        if let Some(own) = model.motors.get(actuator.motor as usize) {
            take(own.temperature, step);
            take(own.current, L::splat(own.electric[1]));
            if let Some(w) = act.get(own.bristle as usize) {
                out[own.bristle as usize] = if actuator.disabled { *w } else { bent[actuator.motor as usize] };
            }
            // Other controllers stop adding up at the bound; a motor's is never beyond it.
            if let Some(own) = model.controllers.get(actuator.controller as usize).filter(|own| own.winds)
                && let Some(sum) = out.get_mut(own.integral as usize)
                && !actuator.disabled
            {
                *sum = sum.clamp(-L::splat(own.windup), L::splat(own.windup));
            }
        }
    }
}

#[inline(always)]
fn force<L: Lane>(model: Instance<'_, L>, a: usize, input: L, length: L, velocity: L) -> L {
    let (actuator, gain) = (&model.actuators[a], model.gain(a));
    let affine = |p: &[L; 3]| p[2].mul_add(velocity, p[1].mul_add(length, p[0]));
    let gain = match model.muscles.get(actuator.muscle_gain as usize) {
        Some(muscle) => muscle::gain(muscle, length, velocity).0,
        None if actuator.controller != NONE => L::one(),
        None if actuator.gain_affine => affine(&gain),
        None => gain[0],
    };
    match model.muscles.get(actuator.muscle_bias as usize) {
        Some(muscle) => gain.mul_add(input, muscle::bias(muscle, length).0),
        None if actuator.bias_affine => gain.mul_add(input, affine(&model.bias(a))),
        None => gain * input,
    }
}

/// Where the forces of a tendon's actuators together are beyond its bounds, each gets its share of what is within.
fn bound_by_tendons<L: Lane>(model: &Model<L::Real>, actuation: &mut Actuation<L>) {
    let force = &mut actuation.force;
    for (t, tendon) in bounding(model) {
        let total = total(model, t, force);
        let within = clamp(total, &splat(&tendon.force_range));
        let bound = !within.eq(total);
        let share = within / L::select(bound, total, L::one());
        for (a, _) in model.actuators.iter().enumerate().filter(|(_, actuator)| actuator.tendon as usize == t) {
            force[a] = L::select(bound, share * force[a], force[a]);
        }
    }
}

/// The tendons that bound what their actuators pull together.
fn bounding<T>(model: &Model<T>) -> impl Iterator<Item = (usize, &Tendon<T>)> {
    model.tendons.iter().enumerate().filter(|(_, tendon)| tendon.force_limited)
}

/// Force of a tendon's actuators together.
fn total<L: Lane>(model: &Model<L::Real>, tendon: usize, force: &[L]) -> L {
    let own = model.actuators.iter().zip(force).filter(|(actuator, _)| actuator.tendon as usize == tendon);
    own.fold(L::zero(), |sum, (_, force)| sum + *force)
}

/// What an actuator's force gains with its length and its velocity, where it is at no bound.
#[inline(always)]
pub fn slopes<L: Lane>(model: Instance<'_, L>, a: usize, actuation: &Actuation<L>) -> [L; 2] {
    let (actuator, input) = (&model.actuators[a], actuation.input[a]);
    if let Some(slopes) = actuation.slopes.get(actuator.motor as usize) {
        return *slopes;
    }
    let [_, mut by_length, mut by_velocity] = if actuator.bias_affine { model.bias(a) } else { [L::zero(); 3] };
    if let Some(muscle) = model.muscles.get(actuator.muscle_gain as usize) {
        let (_, [length, velocity]) = muscle::gain(muscle, actuation.length[a], actuation.velocity[a]);
        [by_length, by_velocity] = [length.mul_add(input, by_length), velocity.mul_add(input, by_velocity)];
    } else if actuator.gain_affine {
        let [_, length, velocity] = model.gain(a);
        [by_length, by_velocity] = [length.mul_add(input, by_length), velocity.mul_add(input, by_velocity)];
    }
    if let Some(muscle) = model.muscles.get(actuator.muscle_bias as usize) {
        by_length += muscle::bias(muscle, actuation.length[a]).1;
    }
    [by_length, by_velocity]
}

/// Gravity compensation through actuators, then the bounds on the total force of joints.
fn route_to_joints<L: Lane>(model: &Model<L::Real>, passive: &Passive<L>, force: &mut [L]) {
    if model.features.gravcomp {
        for (i, dof) in model.dofs.iter().enumerate() {
            if model.joints[dof.joint as usize].actuator_gravcomp {
                force[i] += passive.qfrc_gravcomp[i];
            }
        }
    }
    for joint in model.joints.iter().filter(|joint| joint.force_limited) {
        let range: [L; 2] = splat(&joint.force_range);
        let out = &mut force[joint.dof as usize];
        *out = out.clamp(range[0], range[1]);
    }
}
