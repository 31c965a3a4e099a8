//! Transmissions: an actuator's length, and its moments, by which the length gains with the velocities of dofs.

use crate::lane::Lane;
use crate::math::quat;
use crate::math::spatial::{Spatial, join, lin, rot};
use crate::math::tree;
use crate::math::vec3::{
    Mat3, Vec3, column, cross, cross_add, dot, mul, mul_add, mul_mat, mul_t, scale, scale_add, splat, sub,
};
use crate::model::{Actuator, Instance, MomentDof, NONE, Transmission};
use crate::position::{Configuration, Position, orientation};
use crate::tendon::{self, Tendons};

/// Sets the moments of actuator `a`, and returns its length.
#[inline(always)]
pub(super) fn transmit<L: Lane>(
    model: Instance<'_, L>,
    a: usize,
    configuration: Configuration<'_, L>,
    (position, tendons): (&Position<L>, &Tendons<L>),
    moment: &mut [L],
) -> L {
    let (actuator, gear) = (&model.actuators[a], model.gear(a));
    match actuator.transmission {
        Transmission::Tendon => {
            let tendon = actuator.tendon as usize;
            for (moment, (_, j)) in moment.iter_mut().zip(tendon::columns(&model, tendon, &tendons.jacobian)) {
                *moment = gear[0] * j;
            }
            gear[0] * tendons.length[tendon]
        }
        Transmission::Site => site(model, actuator, &gear, position, moment),
        Transmission::Relative => relative(model, actuator, &gear, configuration, position, moment),
        Transmission::Body | Transmission::Turn | Transmission::TurnBetween => {
            moment.fill(L::zero());
            L::zero()
        }
        Transmission::SliderCrank => slider_crank(model, actuator, gear[0], position, moment),
        _ => joint(actuator, &gear, &configuration.qpos[actuator.qpos as usize..], moment),
    }
}

#[inline(always)]
fn joint<L: Lane>(actuator: &Actuator<L::Real>, gear: &[L; 6], q: &[L], moment: &mut [L]) -> L {
    let (push, turn) = halves(gear);
    let unit = |at: usize| quat::unit(&[q[at], q[at + 1], q[at + 2], q[at + 3]]);
    match actuator.transmission {
        Transmission::Ball => {
            moment.copy_from_slice(&push);
            dot(&push, &quat::log(&unit(0)))
        }
        Transmission::BallInParent => {
            let q = unit(0);
            let turn = mul_t(&quat::to_matrix(&q), &push);
            moment.copy_from_slice(&turn);
            dot(&turn, &quat::log(&q))
        }
        Transmission::Free => {
            moment.copy_from_slice(gear);
            L::zero()
        }
        Transmission::FreeInParent => {
            let spin = mul(&quat::to_matrix(&quat::conjugate(&unit(3))), &turn);
            moment[..3].copy_from_slice(&push);
            moment[3..].copy_from_slice(&spin);
            L::zero()
        }
        _ => {
            moment[0] = gear[0];
            gear[0] * q[0]
        }
    }
}

/// Translational and rotational part of a gear.
#[inline(always)]
fn halves<L: Lane>(gear: &[L; 6]) -> (Vec3<L>, Vec3<L>) {
    ([gear[0], gear[1], gear[2]], [gear[3], gear[4], gear[5]])
}

/// A mount where it is: relative to the origin of its tree, or in the world.
struct Frame<L> {
    link: u32,
    pos: Vec3<L>,
    rot: Mat3<L>,
}

#[inline(always)]
fn frame<L: Lane>(model: Instance<'_, L>, actuator: &Actuator<L::Real>, k: usize, position: &Position<L>) -> Frame<L> {
    let mount = &model.mounts[actuator.mounts.range()][k];
    let (pos, rot, link) = (splat(&mount.pos), splat(&mount.rot), mount.link);
    if link == NONE {
        return Frame { link, pos, rot };
    }
    let (at, turn) = (&position.pos[link as usize], &position.rot[link as usize]);
    Frame { link, pos: mul_add(turn, &pos, at), rot: mul_mat(turn, &rot) }
}

/// From the second mount to the first.
#[inline(always)]
fn apart<L: Lane>(model: Instance<'_, L>, position: &Position<L>, first: &Frame<L>, second: &Frame<L>) -> Vec3<L> {
    position.moved(&model, &sub(&first.pos, &second.pos), first.link, second.link)
}

/// The force and torque that a frame feels, seen at its tree's origin.
#[inline(always)]
fn wrench<L: Lane>(at: &Vec3<L>, push: &Vec3<L>, turn: &Vec3<L>) -> Spatial<L> {
    join(&cross_add(at, push, turn), push)
}

#[inline(always)]
fn site<L: Lane>(
    model: Instance<'_, L>,
    actuator: &Actuator<L::Real>,
    gear: &[L; 6],
    position: &Position<L>,
    moment: &mut [L],
) -> L {
    let Frame { pos, rot, .. } = frame(model, actuator, 0, position);
    let (push, turn) = halves(gear);
    let wrench = wrench(&pos, &mul(&rot, &push), &mul(&rot, &turn));
    for (moment, entry) in moment.iter_mut().zip(&model.moment_dofs[actuator.moments.range()]) {
        *moment = tree::project(&model, &position.cdof, entry.dof as usize, &wrench);
    }
    L::zero()
}

/// Sets the moments of what turns a joint, or a site against another, about one of its own axes.
#[inline(always)]
pub(super) fn turn<L: Lane>(
    model: Instance<'_, L>,
    (actuator, axis): (&Actuator<L::Real>, usize),
    position: &Position<L>,
    moment: &mut [L],
) {
    if actuator.transmission == Transmission::Turn {
        return moment.fill(L::one());
    }
    let (first, zero) = (frame(model, actuator, 0, position), [L::zero(); 3]);
    let twist = wrench(&zero, &zero, &column(&first.rot, axis));
    for (moment, MomentDof { dof, moves }) in moment.iter_mut().zip(&model.moment_dofs[actuator.moments.range()]) {
        let on = tree::project(&model, &position.cdof, *dof as usize, &twist);
        *moment = if moves[0] { on } else { -on };
    }
}

/// Lengths along and about the second site's axes. As in MuJoCo, moments take these axes for fixed, and dofs that move both sites have
/// none.
#[inline(always)]
fn relative<L: Lane>(
    model: Instance<'_, L>,
    actuator: &Actuator<L::Real>,
    gear: &[L; 6],
    configuration: Configuration<'_, L>,
    position: &Position<L>,
    moment: &mut [L],
) -> L {
    let (first, second) = (frame(model, actuator, 0, position), frame(model, actuator, 1, position));
    let (push, turn) = halves(gear);
    let shift = mul_t(&second.rot, &apart(model, position, &first, &second));
    let mounts = &model.mounts[actuator.mounts.range()];
    let mut length = dot(&push, &shift);
    if actuator.turns {
        let [one, other] = [0, 1]
            .map(|k: usize| orientation::orientation(&model, configuration, mounts[k].link, splat(&mounts[k].quat)));
        length += dot(&turn, &quat::log(&quat::mul(&quat::conjugate(&other), &one)));
    }
    let (push, turn) = (mul(&second.rot, &push), mul(&second.rot, &turn));
    let [on_first, on_second] = [&first, &second].map(|frame| wrench(&frame.pos, &push, &turn));
    for (moment, MomentDof { dof, moves }) in moment.iter_mut().zip(&model.moment_dofs[actuator.moments.range()]) {
        let on = |wrench| tree::project(&model, &position.cdof, *dof as usize, wrench);
        *moment = if moves[0] { on(&on_first) } else { -on(&on_second) };
    }
    length
}

/// With a the slide's axis, v from slide to crank and ρ the rod: a·v - √((a·v)² + ρ² - v·v); where the rod does not reach, a·v.
#[inline(always)]
fn slider_crank<L: Lane>(
    model: Instance<'_, L>,
    actuator: &Actuator<L::Real>,
    gear: L,
    position: &Position<L>,
    moment: &mut [L],
) -> L {
    let (crank, slide) = (frame(model, actuator, 0, position), frame(model, actuator, 1, position));
    let (axis, to_crank) = (column(&slide.rot, 2), apart(model, position, &crank, &slide));
    let along = dot(&axis, &to_crank);
    let rod = L::splat(actuator.rod);
    let square = along.mul_add(along, rod.mul_add(rod, -dot(&to_crank, &to_crank)));
    let reaches = square.gt(L::zero());
    let root = L::select(reaches, square, L::one()).sqrt();
    let inverse = L::select(reaches, L::one() / root, L::zero());
    let share = along.neg_mul_add(inverse, L::one());
    let by_shift = scale_add(share, &axis, &scale(inverse, &to_crank));
    let by_axis = scale(share, &to_crank);
    for (moment, MomentDof { dof, moves }) in moment.iter_mut().zip(&model.moment_dofs[actuator.moments.range()]) {
        let motion = &position.cdof[*dof as usize];
        let speed = |at: &Vec3<L>| cross_add(&rot(motion), at, &lin(motion));
        let gain = if moves[0] {
            dot(&by_shift, &speed(&crank.pos))
        } else {
            dot(&by_axis, &cross(&rot(motion), &axis)) - dot(&by_shift, &speed(&slide.pos))
        };
        *moment = gear * gain;
    }
    gear * (along - L::select(reaches, root, L::zero()))
}
