//! Constants of the reference configuration: inverse weights of bodies and dofs, and the inertia matrix's diagonal.
//!
//! Everything follows from the articulated-body recursions, so that the cost is linear in the number of dofs and no
//! matrix is formed. Spatial quantities of a link are in world axes relative to the link's own frame, which keeps
//! them accurate on long chains; they are shifted on the way from link to link.

use glam::{DMat3, DQuat, DVec3};
use lanesim_kernels::model::{Dof, DofKind, Joint, JointKind, Link, MomentDof, NONE};

use super::heavy::Heavy;
use super::links::Links;
use super::order::Scene;
use super::pose::{rotation, skew, unit_quat};
use crate::spec;

/// A motion or a force: rotational and translational part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spatial {
    rot: DVec3,
    trans: DVec3,
}

impl Spatial {
    pub const ZERO: Spatial = Spatial { rot: DVec3::ZERO, trans: DVec3::ZERO };

    pub fn dot(self, other: Spatial) -> f64 {
        self.rot.dot(other.rot) + self.trans.dot(other.trans)
    }

    pub fn add_scaled(&mut self, other: Spatial, scale: f64) {
        self.rot += other.rot * scale;
        self.trans += other.trans * scale;
    }

    /// A motion at the parent's frame, seen `r` further.
    pub fn motion_to_child(self, r: DVec3) -> Spatial {
        Spatial { rot: self.rot, trans: self.trans + self.rot.cross(r) }
    }

    /// A force at a frame `r` away, seen at the parent's.
    pub fn force_to_parent(self, r: DVec3) -> Spatial {
        Spatial { rot: self.rot + r.cross(self.trans), trans: self.trans }
    }
}

/// A symmetric 6×6 matrix [[a, b], [bᵀ, c]] on (rotation, translation).
#[derive(Clone, Copy, Debug)]
pub(super) struct Symmetric {
    a: DMat3,
    b: DMat3,
    c: DMat3,
}

impl Symmetric {
    pub const ZERO: Symmetric = Symmetric { a: DMat3::ZERO, b: DMat3::ZERO, c: DMat3::ZERO };

    pub fn add(&mut self, other: &Symmetric) {
        self.a += other.a;
        self.b += other.b;
        self.c += other.c;
    }

    pub fn times(&self, s: Spatial) -> Spatial {
        Spatial { rot: self.a * s.rot + self.b * s.trans, trans: self.b.transpose() * s.rot + self.c * s.trans }
    }

    /// Adds `scale · (x yᵀ + y xᵀ)`.
    pub fn add_outer(&mut self, x: Spatial, y: Spatial, scale: f64) {
        let outer = |u: DVec3, v: DVec3| DMat3::from_cols(u * v.x, u * v.y, u * v.z) * scale;
        self.a += outer(x.rot, y.rot) + outer(y.rot, x.rot);
        self.b += outer(x.rot, y.trans) + outer(y.rot, x.trans);
        self.c += outer(x.trans, y.trans) + outer(y.trans, x.trans);
    }

    /// An inertia at a frame `r` away, seen at the parent's.
    pub fn inertia_to_parent(&self, r: DVec3) -> Symmetric {
        let r = skew(r);
        Symmetric {
            a: self.a - self.b * r + r * self.b.transpose() - r * self.c * r,
            b: self.b + r * self.c,
            c: self.c,
        }
    }

    /// A mobility (motion per force) at the parent's frame, seen `r` further.
    fn mobility_to_child(&self, r: DVec3) -> Symmetric {
        let r = skew(r);
        Symmetric {
            a: self.a,
            b: self.b + self.a * r,
            c: self.c - r * self.a * r + self.b.transpose() * r - r * self.b,
        }
    }
}

/// What the backward recursion leaves per dof.
pub(super) struct Hinge {
    /// Motion per unit velocity.
    pub axis: Spatial,
    /// Articulated inertia times `axis`.
    pub force: Spatial,
    /// Articulated inertia along `axis`, armature included.
    pub inertia: f64,
    /// From the parent dof's frame to this dof's; zero within a link.
    pub shift: DVec3,
    pub parent: u32,
}

/// The articulated inertias of a model in its reference configuration, and the constants that follow from them.
pub(crate) struct Derived {
    /// The backward quantities of every dof.
    pub(super) hinges: Vec<Hinge>,
    /// Diagonal of the inertia matrix.
    pub dof_m0: Vec<f64>,
    /// Inverse weight of each dof, the mean over the dofs of a rotation or translation.
    pub dof_invweight0: Vec<f64>,
    /// Translational and rotational inverse weight of each body.
    pub body_invweight0: Vec<[f64; 2]>,
    /// The inertia matrix with armature of tendons, if they have any.
    heavy: Option<Heavy>,
}

/// The accelerations that a force causes.
pub(super) struct Response {
    /// Norm over all dofs.
    pub norm: f64,
    /// Acceleration along the force itself, the inverse of the mass that it feels.
    pub along: f64,
}

impl Derived {
    pub fn new(scene: &Scene, links: &Links, joints: &[Joint<f64>], dofs: &[Dof<f64>]) -> Derived {
        let table = &links.links;
        let (orientations, shifts) = frames(table);
        let mut hinges: Vec<Hinge> = dofs
            .iter()
            .enumerate()
            .map(|(i, dof)| Hinge {
                axis: axis(dof, &joints[dof.joint as usize], orientations[dof.link as usize]),
                force: Spatial::ZERO,
                inertia: 0.0,
                shift: if table[dof.link as usize].dofs.start == i as u32 {
                    shifts[dof.link as usize]
                } else {
                    DVec3::ZERO
                },
                parent: dof.parent,
            })
            .collect();
        let rigid: Vec<Symmetric> = table.iter().zip(&orientations).map(|(l, &q)| rigid_inertia(l, q)).collect();
        let dof_m0 = diagonal(table, &shifts, &rigid, &hinges, dofs);
        let mobilities = articulate(table, rigid, &mut hinges, dofs);
        let mut dof_invweight0 = inverse_diagonal(&hinges, &mobilities);
        average(&mut dof_invweight0, joints);
        let mut body_invweight0: Vec<[f64; 2]> =
            (0..scene.bodies.len()).map(|b| body_weight(scene, links, b, &orientations, &mobilities)).collect();
        for (b, body) in scene.bodies.iter().enumerate().filter(|&(b, _)| is_slider(scene, links, b)) {
            let weight = 1.0 / body.mass.mass;
            body_invweight0[b] = [weight, 0.0];
            dof_invweight0[table[links.body_link[b] as usize].dofs.range()].fill(weight);
        }
        Derived { hinges, dof_m0, dof_invweight0, body_invweight0, heavy: None }
    }

    /// Takes armature of tendons into account.
    pub fn with_tendons(&mut self, heavy: Heavy, scene: &Scene, links: &Links, joints: &[Joint<f64>]) {
        let mut weights = heavy.dofs();
        average(&mut weights, joints);
        for (b, body) in scene.bodies.iter().enumerate().filter(|(b, _)| links.moving(*b) != NONE) {
            let link = links.body_link[b];
            let mut dofs = links.links[link as usize].dofs.range();
            if is_slider(scene, links, b) && !dofs.any(|dof| heavy.holds(dof)) {
                let own = links.links[link as usize].dofs.range();
                weights[own.clone()].copy_from_slice(&self.dof_invweight0[own]);
                continue;
            }
            let com = links.body_pose[b].then(&body.mass.frame).pos;
            self.body_invweight0[b] = heavy.body(link, com.to_array());
        }
        self.dof_invweight0 = weights;
        self.heavy = Some(heavy);
    }

    /// What a force on some dofs accelerates, where tendons have armature.
    pub(super) fn heavy_response(&self, dofs: &[MomentDof], moment: &[f64]) -> Option<Response> {
        let force = || dofs.iter().map(|entry| entry.dof as usize).zip(moment.iter().copied());
        let qacc = self.heavy.is_some().then(|| self.response(force()))?;
        let along = force().map(|(dof, x)| x * qacc[dof]).sum();
        Some(Response { norm: qacc.iter().map(|a| a * a).sum::<f64>().sqrt(), along })
    }

    /// Accelerations of all dofs that a generalised force causes, given where it acts.
    pub fn response(&self, force: impl Iterator<Item = (usize, f64)>) -> Vec<f64> {
        let mut left = vec![0.0; self.hinges.len()];
        force.for_each(|(dof, x)| left[dof] += x);
        if let Some(heavy) = &self.heavy {
            return heavy.response(left);
        }
        let mut bias = vec![Spatial::ZERO; self.hinges.len()];
        for (k, hinge) in self.hinges.iter().enumerate().rev() {
            left[k] -= hinge.axis.dot(bias[k]);
            if hinge.parent != NONE {
                let mut passed = bias[k];
                passed.add_scaled(hinge.force, left[k] / hinge.inertia);
                bias[hinge.parent as usize].add_scaled(passed.force_to_parent(hinge.shift), 1.0);
            }
        }
        let mut motion: Vec<Spatial> = Vec::with_capacity(self.hinges.len());
        for (hinge, left) in self.hinges.iter().zip(&mut left) {
            let mut own = match hinge.parent {
                NONE => Spatial::ZERO,
                parent => motion[parent as usize].motion_to_child(hinge.shift),
            };
            *left = (*left - hinge.force.dot(own)) / hinge.inertia;
            own.add_scaled(hinge.axis, *left);
            motion.push(own);
        }
        left
    }
}

/// Orientation of every link in the world and the vector from its parent's frame to its own, zero for the first of a
/// tree.
fn frames(links: &[Link<f64>]) -> (Vec<DQuat>, Vec<DVec3>) {
    let mut orientations: Vec<DQuat> = Vec::with_capacity(links.len());
    let mut shifts = Vec::with_capacity(links.len());
    for link in links {
        let own = unit_quat(link.quat);
        if link.parent == NONE {
            orientations.push(own);
            shifts.push(DVec3::ZERO);
        } else {
            let parent = orientations[link.parent as usize];
            orientations.push((parent * own).normalize());
            shifts.push(parent * DVec3::from(link.pos));
        }
    }
    (orientations, shifts)
}

/// Motion of the link's frame per unit velocity of a dof.
fn axis(dof: &Dof<f64>, joint: &Joint<f64>, orientation: DQuat) -> Spatial {
    let unit = |i: u8| DVec3::AXES[i as usize];
    let rotate = |axis: DVec3| {
        let rot = orientation * axis;
        Spatial { rot, trans: (orientation * DVec3::from(joint.pos)).cross(rot) }
    };
    match dof.kind {
        DofKind::FreeTranslation(i) => Spatial { rot: DVec3::ZERO, trans: unit(i) },
        DofKind::FreeRotation(i) | DofKind::BallRotation(i) => rotate(unit(i)),
        DofKind::Slide => Spatial { rot: DVec3::ZERO, trans: orientation * DVec3::from(joint.axis) },
        DofKind::Hinge => rotate(DVec3::from(joint.axis)),
    }
}

fn rigid_inertia(link: &Link<f64>, orientation: DQuat) -> Symmetric {
    let r = rotation(orientation);
    let [xx, yy, zz, xy, xz, yz] = link.inertia;
    let local = DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz));
    let com = skew(orientation * DVec3::from(link.com));
    Symmetric {
        a: r * local * r.transpose() - com * com * link.mass,
        b: com * link.mass,
        c: DMat3::from_diagonal(DVec3::splat(link.mass)),
    }
}

/// Diagonal of the inertia matrix, by composite inertias.
fn diagonal(
    links: &[Link<f64>],
    shifts: &[DVec3],
    rigid: &[Symmetric],
    hinges: &[Hinge],
    dofs: &[Dof<f64>],
) -> Vec<f64> {
    let mut composite = rigid.to_vec();
    for l in (0..links.len()).rev() {
        let parent = links[l].parent;
        if parent != NONE {
            let moved = composite[l].inertia_to_parent(shifts[l]);
            composite[parent as usize].add(&moved);
        }
    }
    let own = |(hinge, dof): (&Hinge, &Dof<f64>)| {
        hinge.axis.dot(composite[dof.link as usize].times(hinge.axis)) + dof.armature
    };
    hinges.iter().zip(dofs).map(own).collect()
}

/// Fills the backward quantities of `hinges`; returns the mobility beyond every dof.
fn articulate(links: &[Link<f64>], rigid: Vec<Symmetric>, hinges: &mut [Hinge], dofs: &[Dof<f64>]) -> Vec<Symmetric> {
    const MINVAL: f64 = 1e-15;
    let mut beyond = vec![Symmetric::ZERO; hinges.len()];
    for (link, inertia) in links.iter().zip(&rigid) {
        if let Some(last) = link.dofs.range().last() {
            beyond[last].add(inertia);
        }
    }
    for k in (0..hinges.len()).rev() {
        let hinge = &mut hinges[k];
        hinge.force = beyond[k].times(hinge.axis);
        hinge.inertia = (hinge.axis.dot(hinge.force) + dofs[k].armature).max(MINVAL);
        if hinge.parent != NONE {
            let mut passed = beyond[k];
            passed.add_outer(hinge.force, hinge.force, -0.5 / hinge.inertia);
            beyond[hinge.parent as usize].add(&passed.inertia_to_parent(hinge.shift));
        }
    }
    let mut mobilities = beyond;
    for k in 0..hinges.len() {
        let hinge = &hinges[k];
        let mut m = incoming(hinge, &mobilities);
        let push = m.times(hinge.force);
        let along = hinge.force.dot(push);
        m.add_outer(hinge.axis, push, -1.0 / hinge.inertia);
        m.add_outer(hinge.axis, hinge.axis, 0.5 * (1.0 / hinge.inertia + along / (hinge.inertia * hinge.inertia)));
        mobilities[k] = m;
    }
    mobilities
}

/// The mobility that a dof stands on.
fn incoming(hinge: &Hinge, mobilities: &[Symmetric]) -> Symmetric {
    match hinge.parent {
        NONE => Symmetric::ZERO,
        p => mobilities[p as usize].mobility_to_child(hinge.shift),
    }
}

/// Diagonal of the inverse inertia matrix.
fn inverse_diagonal(hinges: &[Hinge], mobilities: &[Symmetric]) -> Vec<f64> {
    let own = |hinge: &Hinge| {
        let along = hinge.force.dot(incoming(hinge, mobilities).times(hinge.force));
        1.0 / hinge.inertia + along / (hinge.inertia * hinge.inertia)
    };
    hinges.iter().map(own).collect()
}

/// Replaces the dofs of each rotation and of each free translation by their mean.
fn average(weights: &mut [f64], joints: &[Joint<f64>]) {
    let mut mean = |start: usize| {
        let three = &mut weights[start..start + 3];
        three.fill(three.iter().sum::<f64>() / 3.0);
    };
    for joint in joints {
        let dof = joint.dof as usize;
        match joint.kind {
            JointKind::Free => {
                mean(dof);
                mean(dof + 3);
            }
            JointKind::Ball => mean(dof),
            _ => {}
        }
    }
}

/// Whether a body only slides, and is simple. MuJoCo gives such bodies the inverse of their mass as weight, in every direction and
/// without armature.
fn is_slider(scene: &Scene, links: &Links, b: usize) -> bool {
    let slides = scene.joints[scene.bodies[b].joints.clone()].iter().all(|j| j.spec.kind == spec::JointKind::Slide);
    slides && is_simple(scene, links, b)
}

/// Whether a body moves on the world, or on a body of the world that stands still, alone, along and about coordinate axes, and turns last, with its frame in its centre of mass and
/// along its principal axes. MuJoCo keeps only the diagonal of the inertia matrix of such bodies, and of what is added to it.
pub(super) fn is_simple(scene: &Scene, links: &Links, b: usize) -> bool {
    const NEAR: f64 = 1e-6;
    let body = &scene.bodies[b];
    let along_axes = |j: &super::order::Joint| {
        let aside = j.spec.axis.iter().filter(|x| x.abs() > 1e-14 * DVec3::from(j.spec.axis).length()).count() > 1;
        let centred = j.spec.pos.iter().all(|x| x.abs() < NEAR);
        match j.spec.kind {
            spec::JointKind::Slide | spec::JointKind::Hinge => centred && !aside,
            spec::JointKind::Ball => centred,
            spec::JointKind::Free => true,
        }
    };
    let frame = &body.mass.frame;
    let turned = DVec3::new(frame.quat.x, frame.quat.y, frame.quat.z);
    let joints = &scene.joints[body.joints.clone()];
    let before_last = &joints[..joints.len().saturating_sub(1)];
    // Bodies are numbered depth first: a child would be next.
    let lone = scene.bodies.get(b + 1).is_none_or(|next| next.parent != b);
    b > 0
        && lone
        && !joints.is_empty()
        && joints.iter().all(along_axes)
        && before_last.iter().all(|j| j.spec.kind == spec::JointKind::Slide)
        && links.moving(body.parent) == NONE
        && (body.parent == 0 || scene.bodies[body.parent].parent == 0)
        && frame.pos.abs().max_element() < NEAR
        && turned.abs().max_element() < NEAR
}

/// Translational and rotational inverse weight of a body at its centre of mass; zero if no joints move it.
fn body_weight(scene: &Scene, links: &Links, b: usize, orientations: &[DQuat], mobilities: &[Symmetric]) -> [f64; 2] {
    let link = links.moving(b);
    if link == NONE {
        return [0.0; 2];
    }
    let com = links.body_pose[b].then(&scene.bodies[b].mass.frame).pos;
    let last = links.last_dof(link) as usize;
    let mobility = mobilities[last].mobility_to_child(orientations[link as usize] * com);
    // A direction that does not move leaves rounding of either sign.
    let mean = |m: DMat3| ((m.x_axis.x + m.y_axis.y + m.z_axis.z) / 3.0).max(0.0);
    [mean(mobility.c), mean(mobility.a)]
}
