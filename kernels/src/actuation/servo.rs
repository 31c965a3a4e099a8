//! Servos on orientations: a torque along the shortest rotation to where they are told to turn (MuJoCo's manual, `actuator/orientation`).

use crate::lane::Lane;
use crate::math::quat::{self, Quat};
use crate::math::vec3::{Vec3, dot, splat};
use crate::model::{Actuator, Instance, Model, Servo, Transmission};
use crate::position::{Configuration, orientation};

/// The orientation that a servo turns: that of its ball joint, or of its site relative to another.
#[inline(always)]
pub(super) fn turned<L: Lane>(
    model: Instance<'_, L>,
    actuator: &Actuator<L::Real>,
    configuration: Configuration<'_, L>,
) -> Quat<L> {
    if actuator.transmission == Transmission::Turn {
        let q = &configuration.qpos[actuator.qpos as usize..];
        return quat::unit(&[q[0], q[1], q[2], q[3]]);
    }
    let mounts = &model.mounts[actuator.mounts.range()];
    let [one, other] =
        [0, 1].map(|k: usize| orientation::orientation(&model, configuration, mounts[k].link, splat(&mounts[k].quat)));
    quat::mul(&quat::conjugate(&other), &one)
}

/// The rotation vector, in its own axes, by which it is not where it is told to be: by its controls, or its activations.
#[inline(always)]
pub(super) fn error<L: Lane>(
    model: Instance<'_, L>,
    servo: &Servo<L::Real>,
    turned: &Quat<L>,
    told: impl Fn(u32) -> L,
    act: &[L],
) -> Vec3<L> {
    let target = if servo.quaternion {
        let wanted = [0, 1, 2, 3].map(|k| told(servo.ctrl + k));
        quat::unit(&wanted)
    } else {
        let first = servo.first as usize;
        quat::exp(&[0, 1, 2].map(|k: usize| {
            let own = &model.actuators[first + k];
            let control = told(servo.ctrl + k as u32);
            match act.get(own.act as usize) {
                Some(w) if own.early => super::next(own, *w, super::rate(model, first + k, control, *w)),
                Some(w) => *w,
                None => control,
            }
        }))
    };
    quat::log(&quat::mul(&quat::conjugate(turned), &target))
}

/// Shortens torques that are beyond their bounds.
pub(super) fn bound<L: Lane>(model: &Model<L::Real>, force: &mut [L]) {
    for servo in model.servos.iter().filter(|servo| servo.bounded) {
        let own = &mut force[servo.first as usize..][..3];
        let (torque, most) = ([own[0], own[1], own[2]], L::splat(servo.most));
        let square = dot(&torque, &torque);
        let beyond = square.gt(most * most);
        let share = most / L::select(beyond, square, L::one()).sqrt();
        own.iter_mut().for_each(|x| *x = L::select(beyond, *x * share, *x));
    }
}

/// Where the torque of a servo is within its bound.
pub fn within<L: Lane>(servo: &Servo<L::Real>, force: &[L]) -> L::Mask {
    let own = &force[servo.first as usize..];
    let (torque, most) = ([own[0], own[1], own[2]], L::splat(servo.most));
    // A torque that was shortened has that length but for rounding.
    dot(&torque, &torque).lt(most * most * L::of(1.0 - 1e-5))
}
