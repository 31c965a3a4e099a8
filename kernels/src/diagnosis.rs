//! What happened to a world, and to which of its elements: the part of a step that runs only when something is wrong.

use crate::lane::{LaneQuery, Mask, Real};
use crate::math::ldl;
use crate::math::vec3::dot;
use crate::model::{JointKind, Model};
use crate::state::{BlockStatus, State, Status};
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
    /// An actuator.
    Actuator(u32),
    /// A pair of geoms, index into [`Model::pairs`].
    Pair(u32),
}

/// How far the square of a quaternion's length may be from 1: a length off by 1e-3.
const FAR: f64 = 2e-3;

/// Freezes the given lanes and records why: a bad state, a bad acceleration, or a value too large.
pub fn freeze<L: LaneQuery>(state: &State<L>, ws: &Workspace<L>, lost: u32, status: &mut BlockStatus) {
    let bits_where = |values: &[L], test: fn(L) -> L::Mask| values.iter().fold(0, |bits, x| bits | L::bits(test(*x)));
    let huge = |x: L| x.within(L::Real::MAX) & !x.within(L::Real::MAXVAL);
    let (next, qacc) = (&ws.integration, &ws.solver.fields.qacc);
    let pos = bits_where(&state.qpos, not_finite) & lost;
    let vel = bits_where(&state.qvel, not_finite) & lost & !pos;
    let acc = (bits_where(qacc, not_finite) | bits_where(&next.qvel, not_finite)) & lost & !pos & !vel;
    let large = [&next.qpos, &next.qvel, qacc].iter().fold(0, |bits, x| bits | bits_where(x, huge)) & lost;
    status.record(Status::NON_FINITE_POS, pos);
    status.record(Status::NON_FINITE_VEL, vel);
    status.record(Status::NON_FINITE_ACC, acc);
    status.record(Status::HUGE_VALUE, large & !pos & !vel & !acc);
    status.record(Status::FROZEN, lost);
    status.alive &= !lost;
}

/// Flags quaternions of a state from outside that are far from unit length, or have none. Those of a state that a step
/// left are of unit length.
pub fn check_quaternions<L: LaneQuery>(model: &Model<L::Real>, state: &State<L>, status: &mut BlockStatus) {
    for joint in &model.joints {
        if let Some((short, far)) = quaternion(joint.kind, &state.qpos[joint.qpos as usize..]) {
            status.record(Status::QUAT_ZERO, L::bits(short) & status.alive);
            status.record(Status::QUAT_FAR, L::bits(far) & status.alive);
        }
    }
}

/// Whether a joint's quaternion is as good as zero, and whether it is otherwise far from unit length.
fn quaternion<L: LaneQuery>(kind: JointKind, q: &[L]) -> Option<(L::Mask, L::Mask)> {
    let q = match kind {
        JointKind::Free => &q[3..7],
        JointKind::Ball => &q[..4],
        JointKind::Slide | JointKind::Hinge => return None,
    };
    let squared = q[3].mul_add(q[3], dot(&[q[0], q[1], q[2]], &[q[0], q[1], q[2]]));
    let short = squared.sqrt().lt(L::of(L::Real::MINVAL));
    let finite = q.iter().fold(L::Mask::splat(true), |all, x| all & x.within(L::Real::MAX));
    Some((short, finite & !short & !(squared - L::one()).within(FAR)))
}

fn not_finite<L: LaneQuery>(x: L) -> L::Mask {
    !x.within(L::Real::MAX)
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
    let (next, qacc) = (&ws.integration, &ws.solver.fields.qacc);
    let found = match status {
        Status::NON_FINITE_POS => joint_of(first(&state.qpos, &not_finite)),
        Status::NON_FINITE_VEL => dof(first(&state.qvel, &not_finite)),
        Status::NON_FINITE_ACC => dof(first(qacc, &not_finite)).or_else(|| dof(first(&next.qvel, &not_finite))),
        Status::HUGE_VALUE => {
            let huge = |x: L| !x.within(L::Real::MAXVAL);
            let moves = dof(first(qacc, &huge)).or_else(|| dof(first(&next.qvel, &huge)));
            moves.or_else(|| joint_of(first(&next.qpos, &huge)))
        }
        Status::BAD_CTRL => first(&state.ctrl, &|x| !x.within(L::Real::MAXVAL)).map(|u| Element::Actuator(u as u32)),
        Status::QUAT_ZERO | Status::QUAT_FAR => Some(quaternion_element(model, state, status, lane)),
        Status::SINGULAR_INERTIA => {
            // Too small a pivot was replaced by the least.
            let clamped = |i: usize| {
                let diagonal = ws.inertia.m.get(model.rows.diagonal(i)).copied().unwrap_or(L::zero());
                L::one() / ldl::least_pivot(if model.features.articulated { L::zero() } else { diagonal })
            };
            let pivots = &ws.acceleration.inverse;
            dof((0..pivots.len()).rev().find(|i| holds(pivots[*i].ge(clamped(*i)))))
        }
        Status::CONTACT_OVERFLOW => {
            let collision = &ws.collision;
            let last = collision.contacts().rposition(|contact| holds(contact.dist().lt(L::of(L::Real::MAXVAL))));
            last.map(|c| Element::Pair(collision.slots[c].pair))
        }
        Status::FROZEN => {
            let causes = [Status::NON_FINITE_POS, Status::NON_FINITE_VEL, Status::NON_FINITE_ACC, Status::HUGE_VALUE];
            let mut elements = causes.iter().map(|cause| element(model, state, ws, *cause, lane));
            elements.find(|element| *element != Element::World)
        }
        _ => None,
    };
    found.unwrap_or(Element::World)
}

/// The joint at which [`check_quaternions`] flagged a lane.
pub fn quaternion_element<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &State<L>,
    status: Status,
    lane: usize,
) -> Element {
    let flagged = |kind, qpos: u32| {
        quaternion(kind, &state.qpos[qpos as usize..]).is_some_and(|(short, far)| {
            let mask = if status == Status::QUAT_ZERO { short } else { far };
            L::bits(mask) >> lane & 1 != 0
        })
    };
    let joint = model.joints.iter().position(|joint| flagged(joint.kind, joint.qpos));
    joint.map_or(Element::World, |j| Element::Joint(j as u32))
}

/// The joint to which a position belongs.
fn joint_at<T>(model: &Model<T>, q: usize) -> Option<Element> {
    let after = model.joints.iter().position(|joint| joint.qpos as usize > q);
    let joint = after.unwrap_or(model.joints.len()).checked_sub(1)?;
    Some(Element::Joint(joint as u32))
}
