//! Forward kinematics: positions to link poses, joint axes and dof axes.
//!
//! A tree's links are placed relative to the tree's origin, the position of its first link's frame (see [`crate::model`]).
//! Spatial vectors of a tree are in world axes at that origin. Joints act in order; a rotation keeps its anchor in place.

pub(crate) mod orientation;

use crate::fields::fields;
use crate::lane::{Lane, sin_cos};
use crate::math::quat::{self, Quat};
use crate::math::vec3::{
    Mat3, Vec3, add, column, cross, mul, mul_add, mul_mat, neg, rotate_columns, rotation, scale, splat, sub, zero,
};
use crate::model::{AxisKind, Instance, Joint, JointKind, Link, Model, NONE};
use crate::state::State;

fields! {
    /// Poses of links and axes of dofs.
    pub struct Position(sizes) {
        /// Origin of each tree in the world, m.
        pub origin: Vec<[L; 3]> = sizes.ntree,
        /// Its low word; zero but for free trees.
        pub origin_low: Vec<[L; 3]> = if sizes.nlow > 0 { sizes.ntree } else { 0 },
        /// Position of each link's frame relative to its tree's origin, m, world axes.
        pub pos: Vec<[L; 3]> = sizes.nlink,
        /// Orientation of each link's frame: link to world.
        pub rot: Vec<[L; 9]> = sizes.nlink,
        /// Centre of mass of each link relative to its tree's origin, m, world axes.
        pub com: Vec<[L; 3]> = sizes.nlink,
        /// Anchor of each joint relative to its tree's origin, m, world axes.
        pub anchor: Vec<[L; 3]> = sizes.njnt,
        /// Axis of each joint, world axes, as it was before the joint acted.
        pub axis: Vec<[L; 3]> = sizes.njnt,
        /// Motion of each dof (ω; v) at its tree's origin, world axes.
        pub cdof: Vec<[L; 6]> = sizes.nv,
    } L
}

impl<L: Lane> Position<L> {
    /// Origin of the tree of a link, that of the world for [`NONE`].
    #[inline(always)]
    pub fn origin_of(&self, model: &Model<L::Real>, link: u32) -> Vec3<L> {
        if link == NONE { zero() } else { self.origin[model.links[link as usize].tree as usize] }
    }

    /// A place relative to the origin of one link's tree, made relative to that of another's; either may be [`NONE`], the world's.
    #[inline(always)]
    pub fn moved(&self, model: &Model<L::Real>, at: &Vec3<L>, from: u32, to: u32) -> Vec3<L> {
        let tree = |link: u32| if link == NONE { NONE } else { model.links[link as usize].tree };
        self.between(at, tree(from), tree(to))
    }

    /// The same of trees. Low words come last: they matter where origins are near each other.
    #[inline(always)]
    pub fn between(&self, at: &Vec3<L>, from: u32, to: u32) -> Vec3<L> {
        let far = |tree: u32| self.origin.get(tree as usize).copied().unwrap_or(zero());
        let low = |tree: u32| self.origin_low.get(tree as usize).copied().unwrap_or(zero());
        let near = add(at, &sub(&far(from), &far(to)));
        if self.origin_low.is_empty() { near } else { add(&near, &sub(&low(from), &low(to))) }
    }
}

/// What places all links: positions of joints, and poses of mocap bodies (quaternions of any positive length).
#[derive(Debug)]
pub struct Configuration<'a, L> {
    /// Positions.
    pub qpos: &'a [L],
    /// Their low words, or none.
    pub low: &'a [L],
    /// Positions of mocap bodies; none: they are where the model puts them.
    pub mocap_pos: &'a [[L; 3]],
    /// Orientations of mocap bodies, likewise.
    pub mocap_quat: &'a [[L; 4]],
}

impl<L> Clone for Configuration<'_, L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L> Copy for Configuration<'_, L> {}

/// Mocap bodies are where the model puts them.
impl<'a, L> From<&'a [L]> for Configuration<'a, L> {
    fn from(qpos: &'a [L]) -> Self {
        Configuration { qpos, low: &[], mocap_pos: &[], mocap_quat: &[] }
    }
}

impl<'a, L> From<&'a State<L>> for Configuration<'a, L> {
    fn from(state: &'a State<L>) -> Self {
        let [qpos, low] = state.positions();
        Configuration { qpos, low, mocap_pos: &state.mocap_pos, mocap_quat: &state.mocap_quat }
    }
}

impl<L: Lane> Configuration<'_, L> {
    /// Position and orientation of a link that is a mocap body, unless it is where the model puts it.
    #[inline(always)]
    pub fn mocap(&self, link: &Link<L::Real>) -> Option<(Vec3<L>, Quat<L>)> {
        let number = link.mocap as usize;
        Some((*self.mocap_pos.get(number)?, quat::unit(self.mocap_quat.get(number)?)))
    }
}

/// Poses of all links.
pub fn kinematics<L: Lane>(model: Instance<'_, L>, configuration: Configuration<'_, L>, position: &mut Position<L>) {
    let qpos = configuration.qpos;
    for (l, link) in model.links.iter().enumerate() {
        let root = link.parent == NONE;
        let moved = configuration.mocap(link).map(|(pos, quat)| (pos, quat::to_matrix(&quat)));
        let (mut pos, mut rot) = moved.unwrap_or_else(|| placed(link, position));
        let (first, mut low) = (link.joints.start as usize, zero());
        for j in link.joints.range() {
            let joint = &model.joints[j];
            let q = &qpos[joint.qpos as usize..];
            if joint.kind == JointKind::Free {
                pos = [q[0], q[1], q[2]];
                rot = quat::to_matrix(&quat::unit(&[q[3], q[4], q[5], q[6]]));
                position.anchor[j] = zero();
                if let [x, y, z, ..] = configuration.low.get(joint.qpos as usize..).unwrap_or_default() {
                    low = [*x, *y, *z];
                }
                continue;
            }
            let shift = move_joint(joint, q, &mut rot, &mut position.axis[j], &mut position.anchor[j]);
            if let Some(shift) = shift {
                pos = add(&pos, &shift);
                for before in &mut position.anchor[first..j] {
                    *before = sub(before, &shift);
                }
            }
        }
        if root {
            position.origin[link.tree as usize] = pos;
            if let Some(origin_low) = position.origin_low.get_mut(link.tree as usize) {
                *origin_low = low;
            }
            pos = zero();
        } else {
            for anchor in &mut position.anchor[link.joints.range()] {
                *anchor = add(anchor, &pos);
            }
        }
        position.pos[l] = pos;
        position.rot[l] = rot;
        let (_, com, _) = model.mass(l);
        position.com[l] = mul_add(&rot, &com, &pos);
        for j in link.joints.range() {
            dof_axes(&model.joints[j], j, &rot, position);
        }
    }
}

/// Origin of the tree of a link; zero for [`NONE`].
#[inline(always)]
pub fn origin<L: Lane>(model: &Model<L::Real>, position: &Position<L>, link: u32) -> Vec3<L> {
    if link == NONE { zero() } else { position.origin[model.links[link as usize].tree as usize] }
}

/// A link's frame before its joints act.
#[inline(always)]
fn placed<L: Lane>(link: &Link<L::Real>, position: &Position<L>) -> (Vec3<L>, Mat3<L>) {
    if link.parent == NONE {
        return (splat(&link.pos), splat(&link.rot));
    }
    let parent = link.parent as usize;
    let rot = &position.rot[parent];
    let pos = mul_add(rot, &splat(&link.pos), &position.pos[parent]);
    (pos, if link.aligned { *rot } else { mul_mat(rot, &splat(&link.rot)) })
}

/// Lets a slide, hinge or ball act on the frame's orientation. Records the axis and the anchor relative to the frame's
/// position after the joint; returns how far the frame's position moves, if it can move.
#[inline(always)]
fn move_joint<L: Lane>(
    joint: &Joint<L::Real>,
    q: &[L],
    rot: &mut Mat3<L>,
    axis: &mut Vec3<L>,
    anchor: &mut Vec3<L>,
) -> Option<Vec3<L>> {
    *axis = match joint.axis_kind {
        AxisKind::Plus(k) => column(rot, k as usize),
        AxisKind::Minus(k) => neg(&column(rot, k as usize)),
        AxisKind::General => mul(rot, &splat(&joint.axis)),
    };
    if joint.kind == JointKind::Slide {
        *anchor = if joint.anchored { mul(rot, &splat(&joint.pos)) } else { zero() };
        return Some(scale(q[0] - L::splat(joint.qpos0), axis));
    }
    let before = if joint.anchored { mul(rot, &splat(&joint.pos)) } else { zero() };
    if joint.kind == JointKind::Ball {
        *rot = mul_mat(rot, &quat::to_matrix(&quat::unit(&[q[0], q[1], q[2], q[3]])));
    } else {
        let (sin, cos) = sin_cos(q[0] - L::splat(joint.qpos0));
        match joint.axis_kind {
            AxisKind::Plus(k) => rotate_columns(rot, k, sin, cos),
            AxisKind::Minus(k) => rotate_columns(rot, k, -sin, cos),
            AxisKind::General => *rot = mul_mat(rot, &rotation(&splat(&joint.axis), sin, cos)),
        }
    }
    if !joint.anchored {
        *anchor = zero();
        return None;
    }
    *anchor = mul(rot, &splat(&joint.pos));
    Some(sub(&before, anchor))
}

/// Motions of a joint's dofs: a rotation about `a` through `p` is (a; p × a), a translation (0; a).
#[inline(always)]
fn dof_axes<L: Lane>(joint: &Joint<L::Real>, j: usize, rot: &Mat3<L>, position: &mut Position<L>) {
    let dof = joint.dof as usize;
    let turn = |a: &Vec3<L>, p: &Vec3<L>| {
        let v = cross(p, a);
        [a[0], a[1], a[2], v[0], v[1], v[2]]
    };
    let (z, one) = (L::zero(), L::one());
    match joint.kind {
        JointKind::Free => {
            for k in 0..3 {
                let mut shift = [z; 6];
                shift[3 + k] = one;
                position.cdof[dof + k] = shift;
                let a = column(rot, k);
                position.cdof[dof + 3 + k] = [a[0], a[1], a[2], z, z, z];
            }
        }
        JointKind::Ball => {
            for k in 0..3 {
                position.cdof[dof + k] = turn(&column(rot, k), &position.anchor[j]);
            }
        }
        JointKind::Slide => {
            let a = position.axis[j];
            position.cdof[dof] = [z, z, z, a[0], a[1], a[2]];
        }
        JointKind::Hinge => position.cdof[dof] = turn(&position.axis[j], &position.anchor[j]),
    }
}
