//! Poses and velocities in the world, from links to everything that MJCF puts on them.

use glam::{DMat3, DQuat, DVec3};
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{JointKind, NONE, Quantity};
use lanesim_kernels::tendon;

use super::World;
use crate::model::{ArrayData, Placement};

pub(super) fn rotation<L: LaneQuery>(world: World<'_, L>, link: u32) -> DMat3 {
    let m: [f64; 9] = std::array::from_fn(|i| world.number(&world.workspace.position.rot[link as usize][i]));
    DMat3::from_cols_array(&m).transpose()
}

/// Origin of the tree of a link, in the world.
pub(super) fn origin<L: LaneQuery>(world: World<'_, L>, link: u32) -> DVec3 {
    let tree = world.tables.links[link as usize].tree as usize;
    let position = &world.workspace.position;
    let low = position.origin_low.get(tree).map_or(DVec3::ZERO, |low| world.vector(low));
    world.vector(&position.origin[tree]) + low
}

pub(super) fn position<L: LaneQuery>(world: World<'_, L>, placement: &Placement) -> DVec3 {
    let local = DVec3::from(placement.pos);
    if placement.link == NONE {
        return local;
    }
    let link = world.vector(&world.workspace.position.pos[placement.link as usize]);
    rotation(world, placement.link) * local + link + origin(world, placement.link)
}

/// What poses are made from on their way to an output, kept from world to world.
#[derive(Debug, Default)]
pub(crate) struct Poses {
    links: Vec<DQuat>,
    centres: Vec<DVec3>,
    moments: Vec<DVec3>,
    masses: Vec<f64>,
}

pub(super) fn positions<L: LaneQuery>(world: World<'_, L>, placements: &[Placement], out: &mut Vec<f64>) {
    out.extend(placements.iter().flat_map(|placement| position(world, placement).to_array()));
}

pub(super) fn matrices<L: LaneQuery>(world: World<'_, L>, placements: &[Placement], out: &mut Vec<f64>) {
    out.extend(placements.iter().flat_map(|placement| orientation(world, placement).transpose().to_cols_array()));
}

/// Orientation of a frame: frame to world.
pub(super) fn orientation<L: LaneQuery>(world: World<'_, L>, placement: &Placement) -> DMat3 {
    let local = DMat3::from_cols_array(&placement.mat).transpose();
    if placement.link == NONE { local } else { rotation(world, placement.link) * local }
}

/// Quaternions, composed from joint to joint: kernels move matrices only.
pub(super) fn quaternions<L: LaneQuery>(
    world: World<'_, L>,
    placements: &[Placement],
    poses: &mut Poses,
    out: &mut Vec<f64>,
) {
    let links = &mut poses.links;
    link_quaternions(world, links);
    let quaternion = |placement: &Placement| {
        let [w, x, y, z] = placement.quat;
        let local = DQuat::from_xyzw(x, y, z, w);
        let q = if placement.link == NONE { local } else { links[placement.link as usize] * local };
        let q = q.normalize();
        [q.w, q.x, q.y, q.z]
    };
    out.extend(placements.iter().flat_map(quaternion));
}

/// Orientations of links, as [`quaternions`] has them.
pub(super) fn turns<'a, L: LaneQuery>(world: World<'_, L>, poses: &'a mut Poses) -> &'a [DQuat] {
    link_quaternions(world, &mut poses.links);
    &poses.links
}

fn link_quaternions<L: LaneQuery>(world: World<'_, L>, out: &mut Vec<DQuat>) {
    let qpos = &world.block.state.qpos;
    let q = |at: u32, i: u32| world.number(&qpos[(at + i) as usize]);
    // As the kernels have it: one of no length counts as the identity.
    let unit = |[w, x, y, z]: [f64; 4]| {
        let quat = DQuat::from_xyzw(x, y, z, w);
        if quat.length() < f64::MINVAL { DQuat::IDENTITY } else { quat.normalize() }
    };
    let turned = |at: u32| unit([0, 1, 2, 3].map(|i| q(at, i)));
    out.clear();
    for link in &world.tables.links {
        let [w, x, y, z] = link.quat.map(Real::to_f64);
        let placed = DQuat::from_xyzw(x, y, z, w);
        let mut turn = match link.parent {
            NONE => {
                let moved = world.block.state.mocap_quat.get(link.mocap as usize);
                moved.map_or(placed, |quat| unit(quat.map(|x| world.number(&x))))
            }
            parent => out[parent as usize] * placed,
        };
        for joint in &world.tables.joints[link.joints.range()] {
            match joint.kind {
                JointKind::Free => turn = turned(joint.qpos + 3),
                JointKind::Ball => turn *= turned(joint.qpos),
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

pub(super) fn reals<'a, L: LaneQuery>(world: World<'a, L>, name: &str) -> &'a [f64] {
    match world.model.array(name).map(|array| &array.data) {
        Some(ArrayData::F64(data)) => data,
        _ => &[],
    }
}

pub(super) fn integers<'a, L: LaneQuery>(world: World<'a, L>, name: &str) -> &'a [i32] {
    match world.model.array(name).map(|array| &array.data) {
        Some(ArrayData::I32(data)) => data,
        _ => &[],
    }
}

/// Centre of mass of each body and its descendants; the body's own where they have no mass.
pub(super) fn subtree_com<'a, L: LaneQuery>(world: World<'_, L>, poses: &'a mut Poses) -> &'a [DVec3] {
    let Poses { centres, .. } = &mut *poses;
    centres.clear();
    centres.extend(world.model.placements().inertials.iter().map(|p| position(world, p)));
    poses.sum_up(world, &|body, centres| centres[body]);
    let Poses { centres, moments, masses, .. } = poses;
    for (centre, (moment, mass)) in centres.iter_mut().zip(moments.iter().zip(masses.iter())) {
        if *mass >= f64::MINVAL {
            *centre = *moment / *mass;
        }
    }
    centres
}

/// Velocities of the centres of mass of bodies and their descendants; zero where there is no mass.
pub(super) fn subtree_linvel<L: LaneQuery>(world: World<'_, L>, poses: &mut Poses, out: &mut Vec<f64>) {
    let inertials = &world.model.placements().inertials;
    poses.sum_up(world, &|body, _| com_velocity(world, &inertials[body], position(world, &inertials[body]))[1]);
    let mean = |(momentum, mass): (&DVec3, &f64)| if *mass >= f64::MINVAL { *momentum / *mass } else { DVec3::ZERO };
    out.extend(poses.moments.iter().zip(&poses.masses).flat_map(|own| mean(own).to_array()));
}

impl Poses {
    /// Masses of bodies with their descendants, and sums of what `of` gives for each, times its mass.
    fn sum_up<L: LaneQuery>(&mut self, world: World<'_, L>, of: &dyn Fn(usize, &[DVec3]) -> DVec3) {
        let Poses { centres, moments, masses, .. } = self;
        masses.clear();
        of_bodies(world, Quantity::BodyMass, "body_mass", masses);
        moments.clear();
        moments.extend(masses.iter().enumerate().map(|(body, mass)| of(body, centres) * *mass));
        let parents = integers(world, "body_parentid");
        for b in (1..masses.len()).rev() {
            let (parent, mass, carried) = (parents[b] as usize, masses[b], moments[b]);
            masses[parent] += mass;
            moments[parent] += carried;
        }
    }
}

pub(super) fn anchors<L: LaneQuery>(world: World<'_, L>, out: &mut Vec<f64>) {
    let anchor = |(j, joint): (usize, &lanesim_kernels::model::Joint<L::Real>)| {
        (world.vector(&world.workspace.position.anchor[j]) + origin(world, joint.link)).to_array()
    };
    out.extend(world.tables.joints.iter().enumerate().flat_map(anchor));
}

pub(super) fn axes<L: LaneQuery>(world: World<'_, L>, out: &mut Vec<f64>) {
    let axis = |(j, joint): (usize, &lanesim_kernels::model::Joint<L::Real>)| match joint.kind {
        // A free joint's axis is the world's z.
        JointKind::Free => [0.0, 0.0, 1.0],
        _ => world.vector(&world.workspace.position.axis[j]).to_array(),
    };
    out.extend(world.tables.joints.iter().enumerate().flat_map(axis));
}

/// Dof motions at the centre of mass of the whole kinematic tree, which is MuJoCo's reference point.
/// Appends the Jacobian of the lengths of tendons, ntendon × nv numbers.
pub(super) fn tendon_jacobians<L: LaneQuery>(world: World<'_, L>, _: &mut Poses, out: &mut Vec<f64>) {
    let (tables, jacobian) = (world.tables, &world.workspace.tendons.jacobian);
    for t in 0..tables.tendons.len() {
        let start = out.len();
        out.resize(start + tables.sizes.nv, 0.0);
        for (dof, j) in tendon::columns(tables, t, jacobian) {
            out[start + dof] = world.number(&j);
        }
    }
}

pub(super) fn cdof<L: LaneQuery>(world: World<'_, L>, poses: &mut Poses, out: &mut Vec<f64>) {
    let com = subtree_com(world, poses);
    let roots = integers(world, "body_rootid");
    for (dof, motion) in world.tables.dofs.iter().zip(&world.workspace.position.cdof) {
        let body = world.tables.links[dof.link as usize].body as usize;
        let at = com[roots[body] as usize] - origin(world, dof.link);
        let turn = world.vector(&motion[..3]);
        let shift = world.vector(&motion[3..]) + turn.cross(at);
        out.extend(turn.to_array());
        out.extend(shift.to_array());
    }
}

pub(super) fn velocities<L: LaneQuery>(world: World<'_, L>, out: &mut Vec<f64>) {
    let velocity = |placement: &Placement| {
        if placement.link == NONE {
            return [0.0; 6];
        }
        let motion = &world.workspace.velocity.cvel[placement.link as usize];
        let at = position(world, placement) - origin(world, placement.link);
        let turn = world.vector(&motion[..3]);
        let shift = world.vector(&motion[3..]) + turn.cross(at);
        [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
    };
    out.extend(world.model.placements().bodies.iter().flat_map(velocity));
}

/// Appends a number or more of every body: the world's own, if they vary, else those of the model's array.
pub(super) fn of_bodies<L: LaneQuery>(world: World<'_, L>, quantity: Quantity, array: &str, out: &mut Vec<f64>) {
    match world.block.varied.as_deref().map_or(&[][..], |varied| varied.lanes(quantity)) {
        [] => out.extend_from_slice(reals(world, array)),
        own => out.extend(own.iter().map(|x| world.number(x))),
    }
}

/// A motion at the origin of a link's tree (angular, linear), at the centre of mass of the kinematic tree of a body on it.
pub(super) fn at_com<L: LaneQuery>(world: World<'_, L>, link: u32, motion: [DVec3; 2], com: DVec3) -> [DVec3; 2] {
    let [turn, shift] = motion;
    [turn, shift + turn.cross(com - origin(world, link))]
}

/// Velocity of a body at a point.
pub(super) fn com_velocity<L: LaneQuery>(world: World<'_, L>, placement: &Placement, com: DVec3) -> [DVec3; 2] {
    if placement.link == NONE {
        return [DVec3::ZERO; 2];
    }
    let velocity = &world.workspace.velocity.cvel[placement.link as usize];
    at_com(world, placement.link, [world.vector(&velocity[..3]), world.vector(&velocity[3..])], com)
}

/// Velocities of bodies at the centre of mass of their whole kinematic tree.
pub(super) fn com_velocities<L: LaneQuery>(world: World<'_, L>, poses: &mut Poses, out: &mut Vec<f64>) {
    let com = subtree_com(world, poses);
    let roots = integers(world, "body_rootid");
    for (placement, root) in world.model.placements().bodies.iter().zip(roots) {
        let motion = com_velocity(world, placement, com[*root as usize]);
        out.extend(motion.iter().flat_map(|part| part.to_array()));
    }
}

/// Jacobian of the world's point: linear rows, then angular ones.
pub(super) fn jacobian<L: LaneQuery>(world: World<'_, L>, _: &mut Poses, out: &mut Vec<f64>) {
    let nv = world.tables.sizes.nv;
    let start = out.len();
    out.resize(start + 6 * nv, 0.0);
    let placement = world.point.and_then(|point| point.placements(world.model).get(point.id()));
    let Some(placement) = placement.filter(|placement| placement.link != NONE) else { return };
    let at = position(world, placement) - origin(world, placement.link);
    let mut dof = world.tables.links[placement.link as usize].last_dof();
    while dof != NONE {
        let motion = &world.workspace.position.cdof[dof as usize];
        let turn = world.vector(&motion[..3]);
        let shift = world.vector(&motion[3..]) + turn.cross(at);
        for (row, x) in shift.to_array().into_iter().chain(turn.to_array()).enumerate() {
            out[start + row * nv + dof as usize] = x;
        }
        dof = world.tables.dofs[dof as usize].parent;
    }
}
