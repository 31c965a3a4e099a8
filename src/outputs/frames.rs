//! Poses and velocities in the world, from links to everything that MJCF puts on them.

use glam::{DMat3, DQuat, DVec3};
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{JointKind, NONE, Quantity};

use super::{View, number};
use crate::model::{ArrayData, Placement};

fn vector<L: LaneQuery>(lanes: &[L], lane: usize) -> DVec3 {
    DVec3::new(number(&lanes[0], lane), number(&lanes[1], lane), number(&lanes[2], lane))
}

fn rotation<L: LaneQuery>(view: &View<'_, L>, link: u32, lane: usize) -> DMat3 {
    let m: [f64; 9] = std::array::from_fn(|i| number(&view.workspace.position.rot[link as usize][i], lane));
    DMat3::from_cols_array(&m).transpose()
}

/// Origin of the tree of a link, in the world.
fn origin<L: LaneQuery>(view: &View<'_, L>, link: u32, lane: usize) -> DVec3 {
    let tree = view.tables.links[link as usize].tree as usize;
    vector(&view.workspace.position.origin[tree], lane)
}

fn position<L: LaneQuery>(view: &View<'_, L>, lane: usize, placement: &Placement) -> DVec3 {
    let local = DVec3::from(placement.pos);
    if placement.link == NONE {
        return local;
    }
    let link = vector(&view.workspace.position.pos[placement.link as usize], lane);
    rotation(view, placement.link, lane) * local + link + origin(view, placement.link, lane)
}

/// What poses are made from on their way to an output, kept from world to world.
#[derive(Debug, Default)]
pub(crate) struct Poses {
    links: Vec<DQuat>,
    centres: Vec<DVec3>,
    moments: Vec<DVec3>,
    masses: Vec<f64>,
}

pub(super) fn positions<L: LaneQuery>(view: &View<'_, L>, lane: usize, placements: &[Placement], out: &mut Vec<f64>) {
    out.extend(placements.iter().flat_map(|placement| position(view, lane, placement).to_array()));
}

pub(super) fn matrices<L: LaneQuery>(view: &View<'_, L>, lane: usize, placements: &[Placement], out: &mut Vec<f64>) {
    let matrix = |placement: &Placement| {
        let local = DMat3::from_cols_array(&placement.mat).transpose();
        let world = if placement.link == NONE { local } else { rotation(view, placement.link, lane) * local };
        world.transpose().to_cols_array()
    };
    out.extend(placements.iter().flat_map(matrix));
}

/// Quaternions, composed from joint to joint: kernels move matrices only.
pub(super) fn quaternions<L: LaneQuery>(
    view: &View<'_, L>,
    lane: usize,
    placements: &[Placement],
    poses: &mut Poses,
    out: &mut Vec<f64>,
) {
    let links = &mut poses.links;
    link_quaternions(view, lane, links);
    let quaternion = |placement: &Placement| {
        let [w, x, y, z] = placement.quat;
        let local = DQuat::from_xyzw(x, y, z, w);
        let q = if placement.link == NONE { local } else { links[placement.link as usize] * local };
        let q = q.normalize();
        [q.w, q.x, q.y, q.z]
    };
    out.extend(placements.iter().flat_map(quaternion));
}

fn link_quaternions<L: LaneQuery>(view: &View<'_, L>, lane: usize, out: &mut Vec<DQuat>) {
    let qpos = &view.block.state.qpos;
    let q = |at: u32, i: u32| number(&qpos[(at + i) as usize], lane);
    let unit = |at: u32| DQuat::from_xyzw(q(at, 1), q(at, 2), q(at, 3), q(at, 0)).normalize();
    out.clear();
    for link in &view.tables.links {
        let [w, x, y, z] = link.quat.map(Real::to_f64);
        let placed = DQuat::from_xyzw(x, y, z, w);
        let mut turn = if link.parent == NONE { placed } else { out[link.parent as usize] * placed };
        for joint in &view.tables.joints[link.joints.range()] {
            match joint.kind {
                JointKind::Free => turn = unit(joint.qpos + 3),
                JointKind::Ball => turn *= unit(joint.qpos),
                JointKind::Hinge => {
                    let axis = DVec3::from(joint.axis.map(Real::to_f64));
                    turn *= DQuat::from_axis_angle(axis, q(joint.qpos, 0) - joint.qpos0.to_f64());
                }
                JointKind::Slide => {}
            }
        }
        out.push(turn);
    }
}

fn reals<'a, L: LaneQuery>(view: &'a View<'_, L>, name: &str) -> &'a [f64] {
    match view.model.array(name).map(|array| &array.data) {
        Some(ArrayData::F64(data)) => data,
        _ => &[],
    }
}

fn integers<'a, L: LaneQuery>(view: &'a View<'_, L>, name: &str) -> &'a [i32] {
    match view.model.array(name).map(|array| &array.data) {
        Some(ArrayData::I32(data)) => data,
        _ => &[],
    }
}

/// Centre of mass of each body and its descendants; the body's own where they have no mass.
pub(super) fn subtree_com<'a, L: LaneQuery>(view: &View<'_, L>, lane: usize, poses: &'a mut Poses) -> &'a [DVec3] {
    let Poses { centres, moments, masses, .. } = poses;
    centres.clear();
    centres.extend(view.model.placements().inertials.iter().map(|p| position(view, lane, p)));
    masses.clear();
    match view.block.varied.as_deref().map_or(&[][..], |varied| varied.lanes(Quantity::BodyMass)) {
        [] => masses.extend_from_slice(reals(view, "body_mass")),
        own => masses.extend(own.iter().map(|mass| number(mass, lane))),
    }
    moments.clear();
    moments.extend(centres.iter().zip(masses.iter()).map(|(x, m)| *x * *m));
    let parents = integers(view, "body_parentid");
    for b in (1..centres.len()).rev() {
        let parent = parents[b] as usize;
        masses[parent] += masses[b];
        let carried = moments[b];
        moments[parent] += carried;
    }
    for (centre, (moment, mass)) in centres.iter_mut().zip(moments.iter().zip(masses.iter())) {
        if *mass >= f64::MINVAL {
            *centre = *moment / *mass;
        }
    }
    centres
}

pub(super) fn anchors<L: LaneQuery>(view: &View<'_, L>, lane: usize, out: &mut Vec<f64>) {
    let anchor = |(j, joint): (usize, &lanesim_kernels::model::Joint<L::Real>)| {
        (vector(&view.workspace.position.anchor[j], lane) + origin(view, joint.link, lane)).to_array()
    };
    out.extend(view.tables.joints.iter().enumerate().flat_map(anchor));
}

pub(super) fn axes<L: LaneQuery>(view: &View<'_, L>, lane: usize, out: &mut Vec<f64>) {
    let axis = |(j, joint): (usize, &lanesim_kernels::model::Joint<L::Real>)| match joint.kind {
        // A free joint's axis is the world's z.
        JointKind::Free => [0.0, 0.0, 1.0],
        _ => vector(&view.workspace.position.axis[j], lane).to_array(),
    };
    out.extend(view.tables.joints.iter().enumerate().flat_map(axis));
}

/// Dof motions at the centre of mass of the whole kinematic tree, which is MuJoCo's reference point.
pub(super) fn cdof<L: LaneQuery>(view: &View<'_, L>, lane: usize, poses: &mut Poses, out: &mut Vec<f64>) {
    let com = subtree_com(view, lane, poses);
    let roots = integers(view, "body_rootid");
    for (dof, motion) in view.tables.dofs.iter().zip(&view.workspace.position.cdof) {
        let body = view.tables.links[dof.link as usize].body as usize;
        let at = com[roots[body] as usize] - origin(view, dof.link, lane);
        let turn = vector(&motion[..3], lane);
        let shift = vector(&motion[3..], lane) + turn.cross(at);
        out.extend(turn.to_array());
        out.extend(shift.to_array());
    }
}

pub(super) fn velocities<L: LaneQuery>(view: &View<'_, L>, lane: usize, out: &mut Vec<f64>) {
    let velocity = |placement: &Placement| {
        if placement.link == NONE {
            return [0.0; 6];
        }
        let motion = &view.workspace.velocity.cvel[placement.link as usize];
        let at = position(view, lane, placement) - origin(view, placement.link, lane);
        let turn = vector(&motion[..3], lane);
        let shift = vector(&motion[3..], lane) + turn.cross(at);
        [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
    };
    out.extend(view.model.placements().bodies.iter().flat_map(velocity));
}
