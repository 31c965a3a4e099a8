//! Poses and velocities in the world, from links to everything that MJCF puts on them.

use glam::{DMat3, DQuat, DVec3};
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{JointKind, NONE};

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

pub(super) fn positions<L: LaneQuery>(view: &View<'_, L>, lane: usize, placements: &[Placement]) -> Vec<f64> {
    placements.iter().flat_map(|placement| position(view, lane, placement).to_array()).collect()
}

pub(super) fn matrices<L: LaneQuery>(view: &View<'_, L>, lane: usize, placements: &[Placement]) -> Vec<f64> {
    let matrix = |placement: &Placement| {
        let local = DMat3::from_cols_array(&placement.mat).transpose();
        let world = if placement.link == NONE { local } else { rotation(view, placement.link, lane) * local };
        world.transpose().to_cols_array()
    };
    placements.iter().flat_map(matrix).collect()
}

/// Quaternions, composed from joint to joint: kernels move matrices only.
pub(super) fn quaternions<L: LaneQuery>(view: &View<'_, L>, lane: usize, placements: &[Placement]) -> Vec<f64> {
    let links = link_quaternions(view, lane);
    let quaternion = |placement: &Placement| {
        let [w, x, y, z] = placement.quat;
        let local = DQuat::from_xyzw(x, y, z, w);
        let q = if placement.link == NONE { local } else { links[placement.link as usize] * local };
        let q = q.normalize();
        [q.w, q.x, q.y, q.z]
    };
    placements.iter().flat_map(quaternion).collect()
}

fn link_quaternions<L: LaneQuery>(view: &View<'_, L>, lane: usize) -> Vec<DQuat> {
    let qpos = &view.block.state.qpos;
    let q = |at: u32, i: u32| number(&qpos[(at + i) as usize], lane);
    let unit = |at: u32| DQuat::from_xyzw(q(at, 1), q(at, 2), q(at, 3), q(at, 0)).normalize();
    let mut out: Vec<DQuat> = Vec::with_capacity(view.tables.links.len());
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
    out
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
pub(super) fn subtree_com<L: LaneQuery>(view: &View<'_, L>, lane: usize) -> Vec<[f64; 3]> {
    let own: Vec<DVec3> = view.model.placements().inertials.iter().map(|p| position(view, lane, p)).collect();
    let mut mass = reals(view, "body_mass").to_vec();
    let parents = integers(view, "body_parentid");
    let mut moment: Vec<DVec3> = own.iter().zip(&mass).map(|(x, m)| *x * *m).collect();
    for b in (1..own.len()).rev() {
        let parent = parents[b] as usize;
        mass[parent] += mass[b];
        let carried = moment[b];
        moment[parent] += carried;
    }
    let centre = |((own, moment), mass): ((&DVec3, &DVec3), &f64)| {
        if *mass < f64::MINVAL { own.to_array() } else { (*moment / *mass).to_array() }
    };
    own.iter().zip(&moment).zip(&mass).map(centre).collect()
}

pub(super) fn anchors<L: LaneQuery>(view: &View<'_, L>, lane: usize) -> Vec<f64> {
    let anchor = |(j, joint): (usize, &lanesim_kernels::model::Joint<L::Real>)| {
        (vector(&view.workspace.position.anchor[j], lane) + origin(view, joint.link, lane)).to_array()
    };
    view.tables.joints.iter().enumerate().flat_map(anchor).collect()
}

pub(super) fn axes<L: LaneQuery>(view: &View<'_, L>, lane: usize) -> Vec<f64> {
    let axis = |(j, joint): (usize, &lanesim_kernels::model::Joint<L::Real>)| match joint.kind {
        // A free joint's axis is the world's z.
        JointKind::Free => [0.0, 0.0, 1.0],
        _ => vector(&view.workspace.position.axis[j], lane).to_array(),
    };
    view.tables.joints.iter().enumerate().flat_map(axis).collect()
}

/// Dof motions at the centre of mass of the whole kinematic tree, which is MuJoCo's reference point.
pub(super) fn cdof<L: LaneQuery>(view: &View<'_, L>, lane: usize) -> Vec<f64> {
    let com = subtree_com(view, lane);
    let roots = integers(view, "body_rootid");
    let mut out = Vec::with_capacity(6 * view.tables.dofs.len());
    for (dof, motion) in view.tables.dofs.iter().zip(&view.workspace.position.cdof) {
        let body = view.tables.links[dof.link as usize].body as usize;
        let at = DVec3::from(com[roots[body] as usize]) - origin(view, dof.link, lane);
        let turn = vector(&motion[..3], lane);
        let shift = vector(&motion[3..], lane) + turn.cross(at);
        out.extend(turn.to_array());
        out.extend(shift.to_array());
    }
    out
}

pub(super) fn velocities<L: LaneQuery>(view: &View<'_, L>, lane: usize) -> Vec<f64> {
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
    view.model.placements().bodies.iter().flat_map(velocity).collect()
}
