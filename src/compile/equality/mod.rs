//! Equality constraints: what they hold, as the tables have it, and as MuJoCo's arrays do.

mod check;
mod redundant;

use std::collections::BTreeMap;

use lanesim_kernels::model::{Dof, DofKind, Equality, EqualityDof, EqualityKind, NONE, Span};

use super::constraints::{Bound, impedance};
use super::derived::Derived;
use super::links::Links;
use super::order::Scene;
use super::pose::{Pose, unit_quat, wxyz};
use super::rows::joins;
use super::tendons::Tendons;
use crate::model::{ElementNames, Names};
use crate::spec::{self, Held, Spec};
pub(super) use check::check;
pub(super) use redundant::notes;

/// Numbers of an equality constraint in MuJoCo's `eq_data`.
pub(crate) const DATA: usize = 12;
/// Most entries of all Jacobians.
const MOST_ENTRIES: usize = 1 << 26;

/// The equality constraints of a model.
#[derive(Default)]
pub(crate) struct Equalities {
    /// Those that can act.
    pub table: Vec<Equality<f64>>,
    pub dofs: Vec<EqualityDof>,
    /// Rows of those, and entries of their Jacobians.
    pub ne: usize,
    pub nej: usize,
    /// What each holds, in the order of the file.
    pub held: Vec<Objects>,
}

/// What an equality constraint holds, in MuJoCo's numbering.
pub(crate) struct Objects {
    pub kind: EqualityKind,
    /// MuJoCo's type of the objects.
    pub objtype: i32,
    /// Their numbers; -1 for a second joint that there is not.
    pub ids: [i32; 2],
    pub data: [f64; DATA],
}

/// Where the two sides are.
struct Sides {
    links: [u32; 2],
    poses: [Pose; 2],
}

/// MuJoCo's numbers for types of objects; of joints and tendons it says nothing.
const NO_TYPE: i32 = 0;
const BODY: i32 = 1;
const SITE: i32 = 6;

impl Equalities {
    /// Those of a spec without faults; `Err`: their Jacobians have too many entries.
    pub fn new(
        spec: &Spec,
        scene: &Scene,
        links: &Links,
        dofs: &[Dof<f64>],
        derived: &Derived,
        tendons: &Tendons,
        names: &ElementNames,
    ) -> Result<Equalities, usize> {
        let mut out = Equalities::default();
        let world = world_poses(scene);
        let flags = &spec.option.flags;
        for (id, equality) in spec.equalities.iter().enumerate() {
            let objects = objects(equality, &world, names);
            if flags.equality && flags.constraint {
                out.add(id, equality, &objects, tendons, (spec, scene, links, dofs, derived));
            }
            out.held.push(objects);
            if out.nej > MOST_ENTRIES {
                return Err(out.nej);
            }
        }
        Ok(out)
    }

    /// Adds a constraint to the tables, if anything moves what it holds.
    fn add(
        &mut self,
        id: usize,
        equality: &spec::Equality,
        objects: &Objects,
        tendons: &Tendons,
        (spec, scene, links, dofs, derived): (&Spec, &Scene, &Links, &[Dof<f64>], &Derived),
    ) {
        let mut entry = Equality {
            id: id as u32,
            kind: objects.kind,
            links: [NONE; 2],
            bodies: [0; 2],
            qpos: [NONE; 2],
            tendons: [NONE; 2],
            dofs: Span::default(),
            cross: false,
            row: self.ne as u32,
            jacobian: self.nej as u32,
            pos: [[0.0; 3]; 2],
            quat: [[1.0, 0.0, 0.0, 0.0]; 2],
            torquescale: 0.0,
            polynomial: [0.0; 5],
            reference: [0.0; 2],
            impedance: impedance(&spec.option, Bound::Other, equality.solref, equality.solimp),
            invweight: weights(objects, scene, derived, &tendons.invweight0),
        };
        let moved: Vec<EqualityDof>;
        if let EqualityKind::Joint = objects.kind {
            let joints = objects.ids.map(|id| usize::try_from(id).ok().map(|id| &scene.joints[id]));
            for (side, joint) in joints.iter().enumerate() {
                let Some(joint) = joint else { continue };
                entry.qpos[side] = joint.qpos as u32;
                entry.reference[side] = joint.spec.reference;
            }
            entry.polynomial.copy_from_slice(&objects.data[..5]);
            let side = |side: usize| {
                let joint = joints[side]?;
                Some(EqualityDof { dof: joint.dof as u32, moves: [side == 0, side == 1] })
            };
            let mut list: Vec<EqualityDof> = [side(0), side(1)].into_iter().flatten().collect();
            list.sort_by_key(|entry| entry.dof);
            moved = list;
        } else if let EqualityKind::Tendon = objects.kind {
            let mut union: BTreeMap<u32, [bool; 2]> = BTreeMap::new();
            for (side, id) in objects.ids.iter().enumerate().filter(|(_, id)| **id >= 0) {
                entry.tendons[side] = *id as u32;
                entry.reference[side] = tendons.length0[*id as usize];
                for own in tendons.dofs_of(*id as usize) {
                    union.entry(own.dof).or_default()[side] = true;
                }
            }
            entry.polynomial.copy_from_slice(&objects.data[..5]);
            moved = union.into_iter().map(|(dof, moves)| EqualityDof { dof, moves }).collect();
        } else {
            let Sides { links: sides, poses } = sides(objects, scene, links);
            entry.links = sides;
            entry.bodies = objects.ids.map(|id| {
                let id = id as usize;
                if objects.objtype == SITE { scene.sites[id].body as u32 } else { id as u32 }
            });
            entry.pos = poses.map(|pose| pose.pos.to_array());
            entry.quat = poses.map(|pose| pose.wxyz());
            entry.torquescale = objects.data[10];
            moved = between(dofs, links, sides);
        }
        if moved.is_empty() {
            return;
        }
        entry.dofs = Span { start: self.dofs.len() as u32, len: moved.len() as u32 };
        entry.cross = joins(dofs, &moved.iter().map(|entry| entry.dof).collect::<Vec<_>>());
        self.ne += entry.dim();
        self.nej += entry.dim() * moved.len();
        self.dofs.extend(moved);
        self.table.push(entry);
    }

    /// The dofs of each that couples what the tree does not.
    pub fn joining(&self) -> impl Iterator<Item = Vec<u32>> {
        let dofs = |entry: &Equality<f64>| self.dofs[entry.dofs.range()].iter().map(|entry| entry.dof).collect();
        self.table.iter().filter(|entry| entry.cross).map(dofs)
    }

    /// Gives the tables the inverse weights that follow from other masses.
    pub fn reweigh(
        table: &mut [Equality<f64>],
        held: &[Objects],
        scene: &Scene,
        derived: &Derived,
        tendon_invweight0: &[f64],
    ) {
        for entry in table {
            entry.invweight = weights(&held[entry.id as usize], scene, derived, tendon_invweight0);
        }
    }
}

/// What each constraint of a spec holds.
pub(crate) fn all_objects(spec: &Spec, scene: &Scene, names: &ElementNames) -> Vec<Objects> {
    let world = world_poses(scene);
    spec.equalities.iter().map(|equality| objects(equality, &world, names)).collect()
}

/// Poses of bodies in the world, in the reference configuration.
fn world_poses(scene: &Scene) -> Vec<Pose> {
    let mut world: Vec<Pose> = Vec::with_capacity(scene.bodies.len());
    for (b, body) in scene.bodies.iter().enumerate() {
        let pose = if b == 0 { body.pose } else { world[body.parent].then(&body.pose) };
        world.push(pose);
    }
    world
}

/// What a constraint holds; `world` has the bodies' poses.
fn objects(equality: &spec::Equality, world: &[Pose], names: &ElementNames) -> Objects {
    let id = |names: &Names, name: &String, otherwise: i32| names.id(name).map_or(otherwise, |id| id as i32);
    let pair =
        |table: &Names, pair: &[String; 2], otherwise: i32| pair.each_ref().map(|name| id(table, name, otherwise));
    let mut data = [0.0; DATA];
    // What MuJoCo has where a kind has nothing.
    (data[1], data[10]) = (1.0, 1.0);
    let (kind, objtype, ids) = match &equality.held {
        Held::Points { bodies, anchor } => {
            let ids = pair(&names.bodies, bodies, 0);
            let [first, second] = ids.map(|id| world[id as usize]);
            let point = Pose { pos: (*anchor).into(), ..Pose::IDENTITY };
            data[..3].copy_from_slice(anchor);
            data[3..6].copy_from_slice(&second.inverse_then(&first.then(&point)).pos.to_array());
            (EqualityKind::Connect, BODY, ids)
        }
        Held::Sites(sites) => {
            (data[1], data[10]) = (0.0, 0.0);
            (EqualityKind::Connect, SITE, pair(&names.sites, sites, 0))
        }
        Held::Frames { bodies, anchor, relpose, torquescale } => {
            let ids = pair(&names.bodies, bodies, 0);
            let [first, second] = ids.map(|id| world[id as usize]);
            let (pos, quat) = relpose.map_or_else(
                || {
                    let held = Pose { pos: (*anchor).into(), ..Pose::IDENTITY };
                    let pose = first.inverse_then(&second.then(&held));
                    (pose.pos.to_array(), pose.wxyz())
                },
                |(pos, quat)| (pos, wxyz(unit_quat(quat))),
            );
            data[..3].copy_from_slice(anchor);
            data[3..6].copy_from_slice(&pos);
            data[6..10].copy_from_slice(&quat);
            data[10] = *torquescale;
            data[11] = f64::from(u8::from(relpose.is_none()));
            (EqualityKind::Weld, BODY, ids)
        }
        Held::SiteFrames { sites, torquescale } => {
            data[10] = *torquescale;
            (EqualityKind::Weld, SITE, pair(&names.sites, sites, 0))
        }
        Held::Joints { joints, polycoef } => {
            data[..5].copy_from_slice(polycoef);
            (EqualityKind::Joint, NO_TYPE, pair(&names.joints, joints, -1))
        }
        Held::Tendons { tendons, polycoef } => {
            data[..5].copy_from_slice(polycoef);
            (EqualityKind::Tendon, NO_TYPE, pair(&names.tendons, tendons, -1))
        }
    };
    Objects { kind, objtype, ids, data }
}

/// The points and frames that a connect or a weld compares, on their links.
fn sides(objects: &Objects, scene: &Scene, links: &Links) -> Sides {
    let data = &objects.data;
    let side = |side: usize| {
        let id = objects.ids[side] as usize;
        if objects.objtype == SITE {
            let site = &scene.sites[id];
            return (site.body, site.pose);
        }
        let point = |at: usize| [data[at], data[at + 1], data[at + 2]].into();
        let pose = match (objects.kind, side) {
            (EqualityKind::Connect, _) => Pose { pos: point(3 * side), ..Pose::IDENTITY },
            (_, 0) => Pose { pos: point(3), quat: unit_quat([data[6], data[7], data[8], data[9]]) },
            _ => Pose { pos: point(0), ..Pose::IDENTITY },
        };
        (id, pose)
    };
    let all = [side(0), side(1)];
    Sides {
        links: all.map(|(body, _)| links.body_link[body]),
        poses: all.map(|(body, pose)| links.body_pose[body].then(&pose)),
    }
}

/// Â of rows of position and of orientation: the inverse weights of both objects together.
fn weights(objects: &Objects, scene: &Scene, derived: &Derived, tendon_invweight0: &[f64]) -> [f64; 2] {
    let weight = |id: i32| match usize::try_from(id) {
        Err(_) => [0.0; 2],
        Ok(tendon) if objects.kind == EqualityKind::Tendon => [tendon_invweight0[tendon], 0.0],
        Ok(joint) if objects.objtype == NO_TYPE => [derived.dof_invweight0[scene.joints[joint].dof], 0.0],
        Ok(site) if objects.objtype == SITE => derived.body_invweight0[scene.sites[site].body],
        Ok(body) => derived.body_invweight0[body],
    };
    let [a, b] = objects.ids.map(weight);
    [a[0] + b[0], a[1] + b[1]]
}

/// The dofs that move one of two links against the other, ascending. Rotations that move both do, about a point between those
/// that are held together; translations do not.
pub(super) fn between(dofs: &[Dof<f64>], links: &Links, sides: [u32; 2]) -> Vec<EqualityDof> {
    let mut at = sides.map(|link| links.last_dof(link));
    let mut out = Vec::new();
    while at != [NONE; 2] {
        // The later of two dofs cannot move the other's link.
        let dof = at.into_iter().filter(|dof| *dof != NONE).max().unwrap_or(NONE);
        let moves = at.map(|side| side == dof);
        let entry = &dofs[dof as usize];
        let shifts = matches!(entry.kind, DofKind::FreeTranslation(_) | DofKind::Slide);
        if moves != [true; 2] || !shifts {
            out.push(EqualityDof { dof, moves });
        }
        at = at.map(|side| if side == dof { entry.parent } else { side });
    }
    out.reverse();
    out
}
