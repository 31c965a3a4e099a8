//! What happened to a world, and to which of its elements: the part of a step that runs only when something is wrong.

use crate::acceleration::wild;
use crate::actuation;
use crate::lane::{LaneQuery, Mask, Real};
use crate::math::ldl;
use crate::math::vec3::dot;
use crate::model::{Actuator, Joint, JointKind, Model};
use crate::state::{Applied, BlockStatus, State, Status};
use crate::workspace::Workspace;

/// The element at which something happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// The world as a whole.
    World,
    /// A joint.
    Joint(u32),
    /// A degree of freedom.
    Dof(u32),
    /// A body.
    Body(u32),
    /// An actuator.
    Actuator(u32),
    /// A pair of geoms, index into [`Model::pairs`].
    Pair(u32),
}

/// How far the square of a quaternion's length may be from 1: a length off by 1e-3.
const FAR: f64 = 2e-3;

/// Freezes the lanes that a step lost and records why: a smooth acceleration that is not finite, or else a value that is too large.
/// What a solver makes of values that are too large, NaN or another such value, says no more, and may depend on other worlds' contacts.
pub fn freeze<L: LaneQuery>(ws: &Workspace<L>, lost: u32, status: &mut BlockStatus) {
    let acc = ws.acceleration.qacc_smooth.iter().fold(0, |bits, a| bits | L::bits(not_finite(*a))) & lost;
    status.record(Status::NON_FINITE_ACC, acc);
    status.record(Status::HUGE_VALUE, lost & !acc);
    status.record(Status::FROZEN, lost);
    status.alive &= !lost;
}

/// Looks at what came from outside, before it is used: the state, and forces. Flags quaternions that are far from unit length, or
/// have none; those of a state that a step left are of unit length. Returns the lanes that cannot be stepped, by reason: a
/// position, an activation or a velocity that is not finite, a force that is not, and what is too large.
pub fn inspect<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &State<L>,
    applied: Option<&Applied<L>>,
    status: &mut BlockStatus,
) -> [(Status, u32); 4] {
    for (_, quat) in quaternions(model, state) {
        let (short, far) = quaternion(quat);
        status.record(Status::QUAT_ZERO, L::bits(short) & status.alive);
        status.record(Status::QUAT_FAR, L::bits(far) & status.alive);
    }
    let lanes = |values: &[L], test: &dyn Fn(L) -> L::Mask| values.iter().fold(0, |bits, x| bits | L::bits(test(*x)));
    let [mocap_pos, mocap_quat] = [state.mocap_pos.as_flattened(), state.mocap_quat.as_flattened()];
    let mocap = |test: &dyn Fn(L) -> L::Mask| lanes(mocap_pos, test) | lanes(mocap_quat, test);
    let mut left = status.alive;
    let mut take = |lanes: u32| {
        let taken = lanes & left;
        left &= !taken;
        taken
    };
    let forces = applied.map_or([&[][..]; 2], |all| [&all.qfrc_applied, all.xfrc_applied.as_flattened()]);
    let bad_forces = forces.iter().fold(0, |bits, force| bits | lanes(force, &not_finite));
    let large = |values: &[L]| lanes(values, &huge);
    let strong = forces.iter().fold(0, |bits, force| bits | lanes(force, &too_strong));
    [
        (
            Status::NON_FINITE_POS,
            take(lanes(&state.qpos, &not_finite) | lanes(&state.act, &not_finite) | mocap(&not_finite)),
        ),
        (Status::NON_FINITE_VEL, take(lanes(&state.qvel, &not_finite))),
        (Status::NON_FINITE_ACC, take(bad_forces)),
        (Status::HUGE_VALUE, take(large(&state.qpos) | large(&state.qvel) | large(&state.act) | mocap(&huge) | strong)),
    ]
}

/// A force whose square might overflow on its way through a step.
fn too_strong<L: LaneQuery>(x: L) -> L::Mask {
    !x.within(L::Real::MAXVAL * L::Real::MAXVAL)
}

/// The quaternions of a state, each with the element that it is of: those of joints, then those of mocap bodies.
fn quaternions<'a, L: LaneQuery>(
    model: &'a Model<L::Real>,
    state: &'a State<L>,
) -> impl Iterator<Item = (Element, &'a [L])> {
    let of_joint = |(j, joint): (u32, &Joint<L::Real>)| {
        let q = &state.qpos[joint.qpos as usize..];
        let quat = match joint.kind {
            JointKind::Free => &q[3..7],
            JointKind::Ball => &q[..4],
            JointKind::Slide | JointKind::Hinge => return None,
        };
        Some((Element::Joint(j), quat))
    };
    let of_mocap = |(m, quat): (usize, &'a [L; 4])| (mocap_body(model, m), &quat[..]);
    (0..).zip(&model.joints).filter_map(of_joint).chain(state.mocap_quat.iter().enumerate().map(of_mocap))
}

/// A mocap body by its number.
fn mocap_body<T>(model: &Model<T>, number: usize) -> Element {
    let link = model.links.iter().find(|link| link.mocap as usize == number);
    link.map_or(Element::World, |link| Element::Body(link.body))
}

/// Whether a quaternion is as good as zero, and whether it is otherwise far from unit length.
fn quaternion<L: LaneQuery>(q: &[L]) -> (L::Mask, L::Mask) {
    let squared = q[3].mul_add(q[3], dot(&[q[0], q[1], q[2]], &[q[0], q[1], q[2]]));
    let short = squared.sqrt().lt(L::of(L::Real::MINVAL));
    let finite = q.iter().fold(L::Mask::splat(true), |all, x| all & x.within(L::Real::MAX));
    (short, finite & !short & !(squared - L::one()).within(FAR))
}

fn not_finite<L: LaneQuery>(x: L) -> L::Mask {
    !x.within(L::Real::MAX)
}

fn huge<L: LaneQuery>(x: L) -> L::Mask {
    !x.within(L::Real::MAXVAL)
}

/// The element at which `status` happened in a lane, in the step that the workspace still holds.
pub fn element<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &State<L>,
    ws: &Workspace<L>,
    status: Status,
    lane: usize,
) -> Element {
    let holds = |mask: L::Mask| L::bits(mask) >> lane & 1 != 0;
    let first = |values: &[L], test: &dyn Fn(L) -> L::Mask| values.iter().position(|x| holds(test(*x)));
    let dof = |i: Option<usize>| i.map(|i| Element::Dof(i as u32));
    let joint_of = |q: Option<usize>| q.and_then(|q| joint_at(model, q));
    let (next, smooth) = (&ws.integration, &ws.acceleration.qacc_smooth);
    // A wild lane has no other acceleration.
    let qacc = if holds(wild(smooth)) { smooth } else { &ws.solver.fields.qacc };
    let singular = || {
        // Too small a pivot was replaced by the least.
        let clamped = |i: usize| {
            let diagonal = ws.inertia.m.get(model.rows.diagonal(i)).copied().unwrap_or(L::zero());
            L::one() / ldl::least_pivot(if model.features.articulated { L::zero() } else { diagonal })
        };
        let pivots = &ws.acceleration.inverse;
        dof((0..pivots.len()).rev().find(|i| holds(pivots[*i].ge(clamped(*i)))))
    };
    let found = match status {
        // Where both happen, that was the cause. What comes of it is not the same number in every backend.
        Status::NON_FINITE_ACC => singular().or_else(|| dof(first(smooth, &not_finite))),
        Status::HUGE_VALUE => {
            let moves = dof(first(qacc, &huge)).or_else(|| dof(first(&next.qvel, &huge)));
            let acts = || first(&next.act, &huge).and_then(|w| actuator_of(model, w));
            moves.or_else(|| joint_of(first(&next.qpos, &huge))).or_else(acts)
        }
        Status::BAD_CTRL => first(actuation::acting(state, &ws.actuation.told), &huge)
            .map(|u| Element::Actuator(model.controls[u].actuator)),
        Status::SINGULAR_INERTIA => singular(),
        Status::CONTACT_OVERFLOW => {
            let collision = &ws.collision;
            let last = collision.contacts().rposition(|contact| holds(contact.dist().lt(L::of(L::Real::MAXVAL))));
            last.map(|c| Element::Pair(collision.slots[c].pair))
        }
        Status::FROZEN => {
            let mut elements = CAUSES.iter().map(|cause| element(model, state, ws, *cause, lane));
            elements.find(|element| *element != Element::World)
        }
        _ => None,
    };
    found.unwrap_or(Element::World)
}

/// The element at which [`inspect`] flagged a lane.
pub fn element_outside<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &State<L>,
    applied: Option<&Applied<L>>,
    status: Status,
    lane: usize,
) -> Element {
    let first = |values: &[L], test: &dyn Fn(L) -> L::Mask| {
        values.iter().position(|x| L::bits(test(*x)) >> lane & 1 != 0).map(|i| i as u32)
    };
    let force = |test| {
        let applied = applied?;
        let body = || first(applied.xfrc_applied.as_flattened(), test).map(|i| Element::Body(i / 6));
        first(&applied.qfrc_applied, test).map(Element::Dof).or_else(body)
    };
    let joint_of = |q: Option<u32>| q.and_then(|q| joint_at(model, q as usize));
    let acts = |w: Option<u32>| w.and_then(|w| actuator_of(model, w as usize));
    let mocap = |test| {
        let turned = || first(state.mocap_quat.as_flattened(), test).map(|i| i / 4);
        let number = first(state.mocap_pos.as_flattened(), test).map(|i| i / 3).or_else(turned);
        number.map(|number| mocap_body(model, number as usize))
    };
    let found = match status {
        Status::NON_FINITE_POS => {
            let held = || acts(first(&state.act, &not_finite)).or_else(|| mocap(&not_finite));
            joint_of(first(&state.qpos, &not_finite)).or_else(held)
        }
        Status::NON_FINITE_VEL => first(&state.qvel, &not_finite).map(Element::Dof),
        Status::NON_FINITE_ACC => force(&not_finite),
        Status::HUGE_VALUE => {
            let moves = first(&state.qvel, &huge).map(Element::Dof);
            let held = || joint_of(first(&state.qpos, &huge)).or_else(|| acts(first(&state.act, &huge)));
            moves.or_else(held).or_else(|| mocap(&huge)).or_else(|| force(&too_strong))
        }
        Status::FROZEN => {
            let mut elements = CAUSES.iter().map(|cause| element_outside(model, state, applied, *cause, lane));
            elements.find(|element| *element != Element::World)
        }
        _ => quaternion_element(model, state, status, lane),
    };
    found.unwrap_or(Element::World)
}

/// Why a step freezes a world.
const CAUSES: [Status; 4] =
    [Status::NON_FINITE_POS, Status::NON_FINITE_VEL, Status::NON_FINITE_ACC, Status::HUGE_VALUE];

/// The element whose quaternion was flagged in a lane.
fn quaternion_element<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &State<L>,
    status: Status,
    lane: usize,
) -> Option<Element> {
    let flagged = |quat: &[L]| {
        let (short, far) = quaternion(quat);
        let mask = if status == Status::QUAT_ZERO { short } else { far };
        L::bits(mask) >> lane & 1 != 0
    };
    quaternions(model, state).find(|(_, quat)| flagged(quat)).map(|(element, _)| element)
}

/// The actuator to which an activation belongs.
fn actuator_of<T>(model: &Model<T>, w: usize) -> Option<Element> {
    let has = |actuator: &Actuator<T>| {
        let controller = model.controllers.get(actuator.controller as usize);
        let motor = model.motors.get(actuator.motor as usize);
        let of_controller = controller.is_some_and(|own| [own.slew, own.integral].contains(&(w as u32)));
        let of_motor = motor.is_some_and(|own| [own.temperature, own.bristle, own.current].contains(&(w as u32)));
        actuator.act as usize == w || of_controller || of_motor
    };
    let actuator = model.actuators.iter().position(has)?;
    Some(Element::Actuator(model.actuators[actuator].id))
}

/// The joint to which a position belongs.
fn joint_at<T>(model: &Model<T>, q: usize) -> Option<Element> {
    let after = model.joints.iter().position(|joint| joint.qpos as usize > q);
    let joint = after.unwrap_or(model.joints.len()).checked_sub(1)?;
    Some(Element::Joint(joint as u32))
}
