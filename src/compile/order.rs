//! The elements of a model in MuJoCo's order: bodies depth first, each body's joints, geoms and sites together.

use std::collections::HashSet;
use std::ops::Range;

use glam::DVec3;

use super::check::{dof_count, qpos_count, used_sizes};
use super::inertia::{self, Mass};
use super::names::{List, label};
use super::pose::Pose;
use crate::diagnostics::Diagnostics;
use crate::spec::{self, Held, InertiaFromGeom, JointKind, ObjectKind, Path, Spec, Waypoint};

/// A body in its place.
pub(crate) struct Body<'a> {
    pub spec: &'a spec::Body,
    pub parent: usize,
    /// Pose in the parent.
    pub pose: Pose,
    /// In a frame that is the body's where it is nearly that, as MuJoCo has it.
    pub mass: Mass,
    /// The frame of its mass as it is.
    pub inertial: Pose,
    pub mocap: Option<usize>,
    pub joints: Range<usize>,
    pub geoms: Range<usize>,
}

/// A joint in its place.
pub(crate) struct Joint<'a> {
    pub spec: &'a spec::Joint,
    pub body: usize,
    pub qpos: usize,
    pub dof: usize,
}

/// A geom or site in its place.
pub(crate) struct Placed<'a, T> {
    pub spec: &'a T,
    pub body: usize,
    /// Pose in the body: that of the body or of its inertia where it is nearly that, as MuJoCo has it.
    pub pose: Pose,
    /// The same as it is.
    pub written: Pose,
}

/// All elements, numbered.
pub(crate) struct Scene<'a> {
    pub bodies: Vec<Body<'a>>,
    pub joints: Vec<Joint<'a>>,
    pub geoms: Vec<Placed<'a, spec::Geom>>,
    pub sites: Vec<Placed<'a, spec::Site>>,
    pub cameras: Vec<Placed<'a, spec::Camera>>,
    pub nq: usize,
    pub nv: usize,
    pub nmocap: usize,
}

/// Bodies of the spec depth first, children in their order. Needs parents before children.
pub(crate) fn preorder(spec: &Spec) -> Vec<usize> {
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); spec.bodies.len()];
    for (i, body) in spec.bodies.iter().enumerate().skip(1) {
        if body.parent < i {
            children[body.parent].push(i);
        }
    }
    let mut order = Vec::with_capacity(spec.bodies.len());
    let mut stack = vec![0; usize::from(!spec.bodies.is_empty())];
    while let Some(b) = stack.pop() {
        order.push(b);
        stack.extend(children[b].iter().rev());
    }
    order
}

/// A body while bodies may still be merged.
struct Draft<'a> {
    spec: &'a spec::Body,
    index: usize,
    parent: usize,
    pose: Pose,
    mass: Mass,
    /// Whether its mass follows from numbers that have been refused.
    flawed: bool,
    geoms: Vec<(&'a spec::Geom, Pose)>,
    sites: Vec<(&'a spec::Site, Pose)>,
    cameras: Vec<(&'a spec::Camera, Pose)>,
}

impl<'a> Scene<'a> {
    /// Orders the elements of `spec`, whose bodies form a tree; finds masses, and applies the compiler settings that
    /// merge, drop, bound or rescale.
    pub fn new(spec: &'a Spec, diagnostics: &mut Diagnostics, notes: &mut Vec<String>) -> Scene<'a> {
        let mut balanced = List::default();
        let mut drafts = drafts(spec, diagnostics, &mut balanced);
        notes.extend(balanced.sentence("inertia violated A + B >= C and was replaced by its mean"));
        if spec.compiler.fusestatic {
            let before = drafts.len();
            drafts = fuse(spec, drafts);
            if drafts.len() < before {
                notes.push(format!("fusestatic merged {} bodies into their parents", before - drafts.len()));
            }
        }
        align(spec, &mut drafts);
        if spec.compiler.discardvisual {
            discard(spec, &mut drafts, notes);
        }
        rescale(spec, &mut drafts);
        check_moving(&drafts, diagnostics);
        number(drafts)
    }
}

fn drafts<'a>(spec: &'a Spec, diagnostics: &mut Diagnostics, balanced: &mut List) -> Vec<Draft<'a>> {
    let order = preorder(spec);
    let mut position = vec![0; spec.bodies.len()];
    for (i, &b) in order.iter().enumerate() {
        position[b] = i;
    }
    let draft = |&index: &usize| {
        let body = &spec.bodies[index];
        let pose = if index == 0 { Pose::IDENTITY } else { Pose::new(body.pos, body.quat) };
        let before = diagnostics.0.len();
        let mass = if index == 0 { Mass::none(pose) } else { body_mass(spec, index, pose, diagnostics, balanced) };
        let shapeless = |g: &spec::Geom| g.size[..used_sizes(g.shape)].iter().any(|&s| s.is_nan() || s <= 0.0);
        Draft {
            spec: body,
            index,
            parent: if index == 0 { 0 } else { position[body.parent] },
            pose,
            mass,
            flawed: diagnostics.0.len() > before || body.geoms.iter().any(shapeless),
            geoms: body.geoms.iter().map(|g| (g, Pose::new(g.pos, g.quat))).collect(),
            sites: body.sites.iter().map(|s| (s, Pose::new(s.pos, s.quat))).collect(),
            cameras: body.cameras.iter().map(|c| (c, Pose::new(c.pos, c.quat))).collect(),
        }
    };
    order.iter().map(draft).collect()
}

/// Mass of a body with bounds and rules applied.
fn body_mass(spec: &Spec, index: usize, pose: Pose, diagnostics: &mut Diagnostics, balanced: &mut List) -> Mass {
    let (body, compiler) = (&spec.bodies[index], &spec.compiler);
    let source = body.inertial.as_ref().map_or(&body.source, |i| &i.source);
    let label = || label("body", &body.name, index);
    let mut mass = match inertia::of_body(body, compiler) {
        // MuJoCo puts the inertial frame of a body without mass where the body is in its parent.
        Ok(mass) => mass.unwrap_or(Mass::none(pose)),
        Err(message) => {
            diagnostics.push(source, label(), message, "check the products of inertia");
            return Mass::none(pose);
        }
    };
    mass.mass = mass.mass.max(compiler.boundmass);
    mass.inertia = mass.inertia.max(DVec3::splat(compiler.boundinertia));
    if mass.violates_triangle() {
        if compiler.balanceinertia {
            mass.inertia = DVec3::splat((mass.inertia.x + mass.inertia.y + mass.inertia.z) / 3.0);
            balanced.push(source, label());
        } else {
            let [a, b, c] = mass.inertia.to_array();
            let message = format!("inertia {a} {b} {c} violates A + B >= C: no body can have it");
            diagnostics.push(source, label(), message, "correct it, or set balanceinertia");
        }
    }
    mass
}

/// Merges bodies without joints into their parents, unless they are mocap, say so, are named by others, or have mass and
/// a parent that differs in gravity compensation.
fn fuse<'a>(spec: &'a Spec, drafts: Vec<Draft<'a>>) -> Vec<Draft<'a>> {
    let excluded = spec.excludes.iter().flat_map(|e| [e.body1.as_str(), e.body2.as_str()]);
    let held = spec.equalities.iter().flat_map(|equality| match &equality.held {
        Held::Points { bodies, .. } | Held::Frames { bodies, .. } => bodies.each_ref().map(String::as_str),
        Held::Sites(_) | Held::SiteFrames { .. } | Held::Joints { .. } | Held::Tendons { .. } => [""; 2],
    });
    let sensed = spec.sensors.iter().flat_map(|sensor| sensor.object.iter().chain(&sensor.reference));
    let sensed = sensed.filter(|object| matches!(object.kind, ObjectKind::Body | ObjectKind::XBody));
    let named: HashSet<&str> = excluded.chain(held).chain(sensed.map(|object| object.name.as_str())).collect();
    let mut kept: Vec<Draft> = Vec::with_capacity(drafts.len());
    // Where each draft went, and its pose there.
    let mut host: Vec<(usize, Pose)> = Vec::with_capacity(drafts.len());
    for mut draft in drafts {
        if draft.index == 0 {
            host.push((0, Pose::IDENTITY));
            kept.push(draft);
            continue;
        }
        let (parent, in_parent) = host[draft.parent];
        let pose = in_parent.then(&draft.pose);
        let body = draft.spec;
        let referenced = !body.name.is_empty() && named.contains(body.name.as_str());
        let lifted = parent != 0 && draft.mass.mass > 0.0 && body.gravcomp != kept[parent].spec.gravcomp;
        if !body.joints.is_empty() || body.mocap || !body.fuse || referenced || lifted {
            draft.parent = parent;
            draft.pose = pose;
            host.push((kept.len(), Pose::IDENTITY));
            kept.push(draft);
            continue;
        }
        let target = &mut kept[parent];
        target.geoms.extend(draft.geoms.into_iter().map(|(g, p)| (g, pose.then(&p))));
        target.sites.extend(draft.sites.into_iter().map(|(s, p)| (s, pose.then(&p))));
        target.cameras.extend(draft.cameras.into_iter().map(|(c, p)| (c, pose.then(&p))));
        if parent != 0 {
            let geoms = target.geoms.iter().copied();
            let from_geoms = || inertia::of_geoms(geoms, &spec.compiler);
            let parts = [target.mass, draft.mass.moved(&pose)];
            let parts: Vec<Mass> = parts.into_iter().filter(|m| m.mass > 0.0).collect();
            target.mass = match spec.compiler.inertiafromgeom {
                InertiaFromGeom::True => from_geoms().unwrap_or(target.mass),
                _ if parts.is_empty() => target.mass,
                _ => inertia::combine(&parts),
            };
        }
        host.push((parent, pose));
    }
    kept
}

/// Moves the frames of free bodies without children to their inertia.
fn align(spec: &Spec, drafts: &mut [Draft]) {
    let mut children = vec![0; drafts.len()];
    for draft in drafts.iter().skip(1) {
        children[draft.parent] += 1;
    }
    for (draft, children) in drafts.iter_mut().zip(children) {
        let Some(joint) = draft.spec.joints.first() else { continue };
        let wanted = match joint.align {
            spec::Tri::Auto => spec.compiler.alignfree,
            other => other == spec::Tri::True,
        };
        if joint.kind != JointKind::Free || !wanted || children > 0 {
            continue;
        }
        let frame = draft.mass.frame;
        draft.pose = draft.pose.then(&frame);
        draft.mass.frame = Pose::IDENTITY;
        let poses = draft.geoms.iter_mut().map(|g| &mut g.1).chain(draft.sites.iter_mut().map(|s| &mut s.1));
        for pose in poses.chain(draft.cameras.iter_mut().map(|c| &mut c.1)) {
            *pose = frame.inverse_then(pose);
        }
    }
}

/// Drops geoms that never collide and that nothing names.
fn discard(spec: &Spec, drafts: &mut [Draft], notes: &mut Vec<String>) {
    let wrapped = spec.tendons.iter().flat_map(|tendon| match &tendon.path {
        Path::Fixed(_) => &[][..],
        Path::Spatial(points) => points,
    });
    let wrapped = wrapped.filter_map(|point| match point {
        Waypoint::Geom { geom, .. } => Some(geom.as_str()),
        Waypoint::Site(_) | Waypoint::Pulley(_) => None,
    });
    let paired = spec.pairs.iter().flat_map(|p| [p.geom1.as_str(), p.geom2.as_str()]);
    let sensed = spec.sensors.iter().flat_map(|sensor| sensor.object.iter().chain(&sensor.reference));
    let sensed = sensed.filter(|object| object.kind == ObjectKind::Geom).map(|object| object.name.as_str());
    let named: HashSet<&str> = paired.chain(wrapped).chain(sensed).collect();
    let mut dropped = 0;
    for draft in drafts {
        let before = draft.geoms.len();
        draft.geoms.retain(|(g, _)| {
            g.contype != 0 || g.conaffinity != 0 || (!g.name.is_empty() && named.contains(g.name.as_str()))
        });
        dropped += before - draft.geoms.len();
    }
    if dropped > 0 {
        notes.push(format!("discardvisual dropped {dropped} geoms; their mass still counts"));
    }
}

fn rescale(spec: &Spec, drafts: &mut [Draft]) {
    let total: f64 = drafts.iter().map(|d| d.mass.mass).sum();
    if spec.compiler.settotalmass > 0.0 && total > 0.0 {
        let scale = spec.compiler.settotalmass / total;
        for draft in drafts {
            draft.mass.mass *= scale;
            draft.mass.inertia *= scale;
        }
    }
}

/// Refuses bodies that move without mass, neither their own nor that of bodies fixed to them, and infinite ones.
fn check_moving(drafts: &[Draft], diagnostics: &mut Diagnostics) {
    let mut heavy: Vec<bool> = drafts.iter().map(|d| d.mass.can_move()).collect();
    let mut lost: Vec<Option<&str>> = drafts.iter().map(|d| d.spec.lost_mass.as_deref()).collect();
    for i in (1..drafts.len()).rev().filter(|&i| drafts[i].spec.joints.is_empty()) {
        let parent = drafts[i].parent;
        heavy[parent] |= heavy[i];
        lost[parent] = lost[parent].or(lost[i]);
    }
    for (i, draft) in drafts.iter().enumerate().skip(1) {
        let label = || label("body", &draft.spec.name, draft.index);
        if !(draft.mass.mass.is_finite() && draft.mass.inertia.is_finite()) {
            // Numbers that are not finite as written have been refused with their attribute.
            if diagnostics.0.is_empty() {
                diagnostics.push(&draft.spec.source, label(), "mass or inertia overflows", "use smaller sizes");
            }
        } else if !draft.spec.joints.is_empty() && !heavy[i] && !draft.flawed {
            let why = lost[i].map_or(String::new(), |geom| format!(": what has it was left out ({geom})"));
            let message = format!("moves, but has no mass or no inertia{why}");
            let remedy = "add inertial or a geom with mass, or set boundmass and boundinertia";
            diagnostics.push(&draft.spec.source, label(), message, remedy);
        }
    }
}

fn number(drafts: Vec<Draft>) -> Scene {
    let mut scene = Scene {
        bodies: Vec::with_capacity(drafts.len()),
        joints: Vec::new(),
        geoms: Vec::new(),
        sites: Vec::new(),
        cameras: Vec::new(),
        nq: 0,
        nv: 0,
        nmocap: 0,
    };
    for (body, draft) in drafts.into_iter().enumerate() {
        let (joint, geom) = (scene.joints.len(), scene.geoms.len());
        for j in &draft.spec.joints {
            scene.joints.push(Joint { spec: j, body, qpos: scene.nq, dof: scene.nv });
            scene.nq += qpos_count(j.kind);
            scene.nv += dof_count(j.kind);
        }
        let inertial = draft.mass.frame;
        let mass = Mass { frame: inertial.settled(&inertial), ..draft.mass };
        let settled = |pose: Pose| pose.settled(&mass.frame);
        let place = |(spec, written)| Placed { spec, body, pose: settled(written), written };
        scene.geoms.extend(draft.geoms.into_iter().map(place));
        let place = |(spec, written)| Placed { spec, body, pose: settled(written), written };
        scene.sites.extend(draft.sites.into_iter().map(place));
        let place = |(spec, written)| Placed { spec, body, pose: settled(written), written };
        scene.cameras.extend(draft.cameras.into_iter().map(place));
        let mocap = draft.spec.mocap.then_some(scene.nmocap);
        scene.nmocap += usize::from(draft.spec.mocap);
        scene.bodies.push(Body {
            spec: draft.spec,
            parent: draft.parent,
            pose: draft.pose,
            mass,
            inertial,
            mocap,
            joints: joint..scene.joints.len(),
            geoms: geom..scene.geoms.len(),
        });
    }
    scene
}
