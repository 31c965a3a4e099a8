//! Accelerations of bodies, and the forces between them: the recursive Newton-Euler algorithm after the constraints, body by body as MJCF
//! has them, at the centre of mass of each kinematic tree.

use glam::{DMat3, DQuat, DVec3};
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{Equality, EqualityKind, NONE, Quantity};
use lanesim_kernels::options::Integrator;
use lanesim_kernels::sensor;

use super::frames::{self, Poses};
use super::{World, contacts};

/// A motion or a force: rotational part, then translational.
type Spatial = [DVec3; 2];

/// Where a force acts is moved from `at` to `to`.
fn moved([torque, force]: Spatial, at: DVec3, to: DVec3) -> Spatial {
    [torque + (at - to).cross(force), force]
}

fn add(to: &mut Spatial, other: Spatial, sign: f64) {
    to[0] += sign * other[0];
    to[1] += sign * other[1];
}

fn write(bodies: &[Spatial], out: &mut Vec<f64>) {
    out.extend(bodies.iter().flatten().flat_map(|part| part.to_array()));
}

/// Centre of mass of the kinematic tree of each body.
fn references<L: LaneQuery>(world: World<'_, L>, poses: &mut Poses) -> Vec<DVec3> {
    let com = frames::subtree_com(world, poses);
    frames::integers(world, "body_rootid").iter().map(|root| com[*root as usize]).collect()
}

pub(super) fn accelerations<L: LaneQuery>(world: World<'_, L>, poses: &mut Poses, out: &mut Vec<f64>) {
    let at = references(world, poses);
    write(&of_bodies(world, &at), out);
}

pub(super) fn external<L: LaneQuery>(world: World<'_, L>, poses: &mut Poses, out: &mut Vec<f64>) {
    let at = references(world, poses);
    write(&from_outside(world, &at, poses), out);
}

pub(super) fn internal<L: LaneQuery>(world: World<'_, L>, poses: &mut Poses, out: &mut Vec<f64>) {
    let at = references(world, poses);
    let mut forces = needed(world, &at, &of_bodies(world, &at));
    for (force, outside) in forces.iter_mut().zip(from_outside(world, &at, poses)) {
        add(force, outside, -1.0);
    }
    let parents = frames::integers(world, "body_parentid");
    for b in (1..forces.len()).rev() {
        let carried = forces[b];
        add(&mut forces[parents[b] as usize], carried, 1.0);
    }
    write(&forces, out);
}

/// Accelerations of bodies, gravity as an upward acceleration of the world.
fn of_bodies<L: LaneQuery>(world: World<'_, L>, at: &[DVec3]) -> Vec<Spatial> {
    let tables = world.tables;
    let (velocity, axes) = (&world.workspace.velocity, &world.workspace.position.cdof);
    // With no acceleration of the joints first, then what these add.
    let mut links = Vec::<Spatial>::with_capacity(tables.links.len());
    for link in &tables.links {
        let mut added = if link.parent == NONE { [DVec3::ZERO; 2] } else { links[link.parent as usize] };
        for dof in link.dofs.range() {
            let qacc = world.number(&world.workspace.solver.fields.qacc[dof]);
            add(&mut added, [world.vector(&axes[dof][..3]), world.vector(&axes[dof][3..])], qacc);
        }
        links.push(added);
    }
    let gravity = world.instance().gravity();
    let still = [DVec3::ZERO, -world.vector(&gravity)];
    let body = |(placement, at): (&crate::model::Placement, &DVec3)| match placement.link {
        NONE => still,
        link => {
            let bias = &velocity.cacc[link as usize];
            let mut motion = [world.vector(&bias[..3]), world.vector(&bias[3..])];
            add(&mut motion, links[link as usize], 1.0);
            frames::at_com(world, link, motion, *at)
        }
    };
    world.model.placements().bodies.iter().zip(at).map(body).collect()
}

/// Forces that bodies need for their accelerations; none for the world.
fn needed<L: LaneQuery>(world: World<'_, L>, at: &[DVec3], accelerations: &[Spatial]) -> Vec<Spatial> {
    let (mut masses, mut moments) = (Vec::new(), Vec::new());
    frames::of_bodies(world, Quantity::BodyMass, "body_mass", &mut masses);
    frames::of_bodies(world, Quantity::BodyInertia, "body_inertia", &mut moments);
    let (bodies, inertials) = (&world.model.placements().bodies, &world.model.placements().inertials);
    let force = |b: usize| {
        if b == 0 {
            return [DVec3::ZERO; 2];
        }
        let axes = frames::orientation(world, &inertials[b]);
        let tensor = axes * DMat3::from_diagonal(DVec3::from_slice(&moments[3 * b..])) * axes.transpose();
        let arm = frames::position(world, &inertials[b]) - at[b];
        let inertial = |[turn, shift]: Spatial| {
            let momentum = masses[b] * (shift + turn.cross(arm));
            [tensor * turn + arm.cross(momentum), momentum]
        };
        let velocity = frames::com_velocity(world, &bodies[b], at[b]);
        let [spin, momentum] = inertial(velocity);
        let mut force = inertial(accelerations[b]);
        let [turn, shift] = velocity;
        add(&mut force, [turn.cross(spin) + shift.cross(momentum), turn.cross(momentum)], 1.0);
        force
    };
    (0..bodies.len()).map(force).collect()
}

/// Forces on bodies from outside, from constraints between points, contacts among them, and from spatial tendons.
fn from_outside<L: LaneQuery>(world: World<'_, L>, at: &[DVec3], poses: &mut Poses) -> Vec<Spatial> {
    let mut forces = vec![[DVec3::ZERO; 2]; at.len()];
    let inertials = &world.model.placements().inertials;
    if let Some(applied) = world.block.applied.as_deref() {
        for (b, wrench) in applied.xfrc_applied.iter().enumerate().skip(1) {
            let wrench = [world.vector(&wrench[3..]), world.vector(&wrench[..3])];
            add(&mut forces[b], moved(wrench, frames::position(world, &inertials[b]), at[b]), 1.0);
        }
    }
    let owners = frames::integers(world, "geom_bodyid");
    for (contact, wrench) in contacts::wrenches(world) {
        let axes = DMat3::from_cols_array(&contacts::frame(world, &contact));
        let wrench = [axes * DVec3::from_slice(&wrench[3..]), axes * DVec3::from_slice(&wrench[..3])];
        let place = contacts::position(world, &contact);
        for (geom, sign) in contacts::geoms(world, &contact).into_iter().zip([-1.0, 1.0]) {
            let b = owners[geom] as usize;
            add(&mut forces[b], moved(wrench, place, at[b]), sign);
        }
    }
    let turns = if world.tables.equalities.is_empty() { &[][..] } else { frames::turns(world, poses) };
    for (equality, [force, turning]) in contacts::holds(world) {
        let torque = if equality.kind == EqualityKind::Weld { torque(equality, turns, turning) } else { DVec3::ZERO };
        for (side, sign) in [1.0, -1.0].into_iter().enumerate() {
            let b = held(world, equality.id as usize)[side];
            let place = side_of(world, equality.links[side], equality.pos[side].map(Real::to_f64).into());
            add(&mut forces[b], moved([torque, force], place, at[b]), sign);
        }
    }
    sensor::pushes(world.instance(), &world.workspace.stages(), &world.block.state.plastic, |push| {
        let (b, wrench) = (push.body as usize, [world.vector(&push.wrench[..3]), world.vector(&push.wrench[3..])]);
        let origin = if push.link == NONE { DVec3::ZERO } else { frames::origin(world, push.link) };
        add(&mut forces[b], moved(wrench, origin, at[b]), 1.0);
    });
    // Nothing is asked of the world.
    forces[0] = [DVec3::ZERO; 2];
    forces
}

/// MuJoCo's number for objects that are sites.
const SITE: i32 = 6;

/// The two bodies that a connect or weld holds.
fn held<L: LaneQuery>(world: World<'_, L>, equality: usize) -> [usize; 2] {
    let array = |name| frames::integers(world, name);
    ["eq_obj1id", "eq_obj2id"].map(|object| {
        let object = array(object)[equality] as usize;
        if array("eq_objtype")[equality] == SITE { array("site_bodyid")[object] as usize } else { object }
    })
}

/// Torque of a weld on its first body, from the forces of its rows of orientation: these measure s times the vector of E, the first
/// frame's orientation in the second's, which a rotation at u, seen in the second, changes by ½ (0, u) ∘ E.
fn torque<T: Real>(equality: &Equality<T>, turns: &[DQuat], force: DVec3) -> DVec3 {
    let [first, second] = [0, 1].map(|side| {
        let [w, x, y, z] = equality.quat[side].map(Real::to_f64);
        let (own, link) = (DQuat::from_xyzw(x, y, z, w), equality.links[side]);
        if link == NONE { own } else { turns[link as usize] * own }
    });
    let error = second.conjugate() * first;
    let half = 0.5 * equality.torquescale.to_f64();
    second * (half * (error.w * force + error.xyz().cross(force)))
}

/// A point of a link, or one that stands still, in the world.
fn side_of<L: LaneQuery>(world: World<'_, L>, link: u32, pos: DVec3) -> DVec3 {
    if link == NONE {
        return pos;
    }
    let place = world.vector(&world.workspace.position.pos[link as usize]);
    frames::rotation(world, link) * pos + place + frames::origin(world, link)
}

/// Appends the inertia matrix as nv × nv numbers.
pub(super) fn inertia<L: LaneQuery>(world: World<'_, L>, out: &mut Vec<f64>) {
    let nv = world.tables.sizes.nv;
    let start = out.len();
    out.resize(start + nv * nv, 0.0);
    let out = &mut out[start..];
    for i in 0..nv {
        let columns = world.tables.tree_pattern.row(i).iter().flat_map(|run| run.range()).chain([i]);
        for j in columns {
            let x = world.number(&world.workspace.inertia.m[world.tables.rows.at(i, j)]);
            out[i * nv + j] = x;
            out[j * nv + i] = x;
        }
    }
}

/// Appends the actuators' moments as nu × nv numbers.
pub(super) fn moments<L: LaneQuery>(world: World<'_, L>, _: &mut Poses, out: &mut Vec<f64>) {
    let (start, nv) = (out.len(), world.tables.sizes.nv);
    out.resize(start + world.tables.actuators.len() * nv, 0.0);
    for (a, actuator) in world.tables.actuators.iter().enumerate() {
        for k in actuator.moments.range() {
            let dof = world.tables.moment_dofs[k].dof as usize;
            out[start + a * nv + dof] = world.number(&world.workspace.actuation.moment[k]);
        }
    }
}

/// Appends M qacc + bias - passive - constraint.
pub(super) fn inverse<L: LaneQuery>(world: World<'_, L>, _: &mut Poses, out: &mut Vec<f64>) {
    let (nv, ws) = (world.tables.sizes.nv, world.workspace);
    let mut matrix = Vec::with_capacity(nv * nv);
    inertia(world, &mut matrix);
    let qacc: Vec<f64> = ws.solver.fields.qacc.iter().map(|x| world.number(x)).collect();
    // A model without passive forces keeps none.
    let passive = |i: usize| ws.passive.qfrc_passive.get(i).map_or(0.0, |x| world.number(x));
    for (i, row) in matrix.chunks_exact(nv.max(1)).enumerate() {
        let inertial: f64 = row.iter().zip(&qacc).map(|(m, a)| m * a).sum();
        let (bias, held) = (&ws.velocity.qfrc_bias[i], &ws.solver.fields.qfrc_constraint[i]);
        out.push(inertial + world.number(bias) - passive(i) - world.number(held));
    }
}

/// Appends the smooth force; that of a discrete step without what it loses on the way.
pub(super) fn smooth<L: LaneQuery>(world: World<'_, L>, _: &mut Poses, out: &mut Vec<f64>) {
    let ws = world.workspace;
    let start = out.len();
    world.numbers(&ws.acceleration.qfrc_smooth, world.tables.sizes.nv, out);
    if world.tables.options.integrator == Integrator::Discrete {
        out[start..].iter_mut().zip(&ws.derivative.pull).for_each(|(force, pull)| *force += world.number(pull));
    }
}
