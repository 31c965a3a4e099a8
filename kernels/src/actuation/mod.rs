//! Actuators: length, velocity and force, and the generalised forces that they make.

use crate::fields::fields;
use crate::lane::{Lane, Mask, Real};
use crate::math::quat;
use crate::math::vec3::{dot, mul, mul_t, splat};
use crate::model::{Actuator, Instance, Model, Transmission};
use crate::passive::Passive;
use crate::state::State;

fields! {
    /// Actuators.
    pub struct Actuation(sizes) {
        /// Length: gear times the joint's position.
        pub length: Vec<L> = sizes.nu,
        /// Velocity.
        pub velocity: Vec<L> = sizes.nu,
        /// Force.
        pub force: Vec<L> = sizes.nu,
        /// Moments: generalised force per unit of force on the joints' dofs.
        pub moment: Vec<L> = sizes.nmoment,
        /// Sum of the actuators' generalised forces.
        pub qfrc_actuator: Vec<L> = sizes.nv,
    } L
}

/// Sets the moments and returns the length.
#[inline(always)]
fn length_and_moment<L: Lane>(actuator: &Actuator<L::Real>, gear: &[L; 6], q: &[L], moment: &mut [L]) -> L {
    let turn = [gear[0], gear[1], gear[2]];
    let unit = |at: usize| quat::unit(&[q[at], q[at + 1], q[at + 2], q[at + 3]]);
    match actuator.transmission {
        Transmission::Scalar => {
            moment[0] = gear[0];
            gear[0] * q[0]
        }
        Transmission::Ball => {
            moment.copy_from_slice(&turn);
            dot(&turn, &quat::log(&unit(0)))
        }
        Transmission::BallInParent => {
            let q = unit(0);
            let turn = mul_t(&quat::to_matrix(&q), &turn);
            moment.copy_from_slice(&turn);
            dot(&turn, &quat::log(&q))
        }
        Transmission::Free => {
            moment.copy_from_slice(gear);
            L::zero()
        }
        Transmission::FreeInParent => {
            let spin = mul(&quat::to_matrix(&quat::conjugate(&unit(3))), &[gear[3], gear[4], gear[5]]);
            moment[..3].copy_from_slice(&turn);
            moment[3..].copy_from_slice(&spin);
            L::zero()
        }
    }
}

/// Lengths and moments, and if actuation is on velocities, forces and generalised forces. Returns the lanes in which a
/// control was not a usable number: all controls of such a world count as 0.
pub fn actuation<L: Lane>(
    model: Instance<'_, L>,
    state: &State<L>,
    passive: &Passive<L>,
    actuation: &mut Actuation<L>,
) -> L::Mask {
    let State { qpos, qvel, ctrl, .. } = state;
    let good = usable(ctrl);
    actuation.qfrc_actuator.fill(L::zero());
    for (a, actuator) in model.actuators.iter().enumerate() {
        let moment = &mut actuation.moment[actuator.moments.range()];
        let length = length_and_moment(actuator, &model.gear(a), &qpos[actuator.qpos as usize..], moment);
        actuation.length[a] = length;
        if !model.features.actuation {
            continue;
        }
        let dof = actuator.dof as usize;
        let mut velocity = moment[0] * qvel[dof];
        for k in 1..moment.len() {
            velocity = moment[k].mul_add(qvel[dof + k], velocity);
        }
        actuation.velocity[a] = velocity;
        if actuator.disabled {
            actuation.force[a] = L::zero();
            continue;
        }
        let force = force(model, a, control(&model, a, good, ctrl), length, velocity);
        actuation.force[a] = force;
        for (out, moment) in actuation.qfrc_actuator[dof..].iter_mut().zip(&*moment) {
            *out = moment.mul_add(force, *out);
        }
    }
    if !model.features.actuation {
        return L::Mask::splat(false);
    }
    route_to_joints(&model, passive, &mut actuation.qfrc_actuator);
    !good
}

/// The lanes in which all controls are usable numbers.
pub(crate) fn usable<L: Lane>(ctrl: &[L]) -> L::Mask {
    ctrl.iter().fold(L::Mask::splat(true), |good, u| good & u.within(L::Real::MAXVAL))
}

#[inline(always)]
fn clamp<L: Lane>(x: L, range: &[L::Real; 2]) -> L {
    x.clamp(L::splat(range[0]), L::splat(range[1]))
}

/// The control that an actuator acts on, `good` where it is [`usable`].
#[inline(always)]
pub(crate) fn control<L: Lane>(model: &Model<L::Real>, a: usize, good: L::Mask, ctrl: &[L]) -> L {
    let (actuator, u) = (&model.actuators[a], L::select(good, ctrl[a], L::zero()));
    let limited = actuator.ctrl_limited && model.options.flags.clampctrl;
    if limited { clamp(u, &actuator.ctrl_range) } else { u }
}

#[inline(always)]
fn force<L: Lane>(model: Instance<'_, L>, a: usize, u: L, length: L, velocity: L) -> L {
    let (actuator, gain) = (&model.actuators[a], model.gain(a));
    let affine = |p: &[L; 3]| p[2].mul_add(velocity, p[1].mul_add(length, p[0]));
    let gain = if actuator.gain_affine { affine(&gain) } else { gain[0] };
    let force = if actuator.bias_affine { gain.mul_add(u, affine(&model.bias(a))) } else { gain * u };
    if actuator.force_limited { clamp(force, &actuator.force_range) } else { force }
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
