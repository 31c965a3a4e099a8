//! Geoms as the narrow phase sees them, and the contacts that it finds.

use super::{contact_frame, reference};
use crate::lane::{Lane, Real};
use crate::math::vec3::{self, Mat3, Vec3, column, mul_add, mul_mat, splat};
use crate::model::{Instance, Model, NONE, Pair};
use crate::position::Position;

/// A contact as numbers: distance, `MAXVAL` in worlds without it; position; frame. An array, which generated code can write.
pub type Found<L> = [L; 13];

/// A geom as the bounding test sees it: centre and local z axis.
pub(super) type Rod<L> = [Vec3<L>; 2];

/// A geom as the narrow phase sees it.
#[derive(Clone, Copy, Debug)]
pub struct Body<L> {
    /// Centre.
    pub pos: Vec3<L>,
    /// Orientation, row-major.
    pub rot: Mat3<L>,
    /// Sizes.
    pub size: Vec3<L>,
}

impl<L: Lane> Body<L> {
    /// Local z axis in the world.
    pub(super) fn axis(&self) -> Vec3<L> {
        column(&self.rot, 2)
    }

    /// Carried by a link.
    #[inline(always)]
    pub fn carried(&self, pos: &Vec3<L>, rot: &Mat3<L>) -> Self {
        Body { pos: mul_add(rot, &self.pos, pos), rot: mul_mat(rot, &self.rot), size: self.size }
    }

    /// Centre and axis.
    pub(super) fn rod(&self) -> Rod<L> {
        [self.pos, self.axis()]
    }
}

/// A geom at the pose of its link, or in the world.
#[inline(always)]
pub fn body<L: Lane>(model: Instance<'_, L>, position: &Position<L>, g: usize) -> Body<L> {
    let (geom, inputs) = (&model.geoms[g], model.geom(g));
    let [x, y, z, rot @ .., a, b, c] = inputs.unwrap_or_else(|| splat(&geom.numbers()));
    let own = Body { pos: [x, y, z], rot, size: [a, b, c] };
    if geom.link == NONE {
        return own;
    }
    let (pos, rot) = (&position.pos[geom.link as usize], &position.rot[geom.link as usize]);
    let body = own.carried(pos, rot);
    if geom.aligned && inputs.is_none() { Body { rot: *rot, ..body } } else { body }
}

/// The trees of a pair's geoms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frames {
    /// Trees of the geoms, [`NONE`] for one that stands still.
    pub trees: [u32; 2],
    /// The tree at whose origin the contacts are placed.
    pub reference: u32,
}

impl Frames {
    /// Those of the pair.
    pub fn new<T>(model: &Model<T>, pair: &Pair<T>) -> Self {
        let tree = |link: u32| if link == NONE { NONE } else { model.links[link as usize].tree };
        let trees = pair.geoms().map(|geom| tree(model.geoms[geom].link));
        Frames { trees, reference: tree(reference(pair)) }
    }

    /// A place relative to the origin of the `k`th geom's tree, made relative to the pair's reference point.
    #[inline(always)]
    pub fn shift<L: Lane>(&self, k: usize, pos: &Vec3<L>, position: &Position<L>) -> Vec3<L> {
        if self.trees[k] == self.reference {
            return *pos;
        }
        position.between(pos, self.trees[k], self.reference)
    }

    /// Both bodies relative to the pair's reference point.
    #[inline(always)]
    pub fn place<L: Lane>(&self, position: &Position<L>, bodies: [Body<L>; 2]) -> [Body<L>; 2] {
        let [first, second] = bodies;
        let [pos1, pos2] = [self.shift(0, &first.pos, position), self.shift(1, &second.pos, position)];
        [Body { pos: pos1, ..first }, Body { pos: pos2, ..second }]
    }
}

/// One candidate of the narrow phase: distance, position and normal, and a hint for the first tangent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate<L> {
    pub dist: L,
    pub pos: Vec3<L>,
    pub normal: Vec3<L>,
    pub tangent: Vec3<L>,
}

impl<L: Lane> Candidate<L> {
    /// The candidate `a` where the mask holds, else `b`.
    #[inline(always)]
    pub fn select(mask: L::Mask, a: &Candidate<L>, b: &Candidate<L>) -> Candidate<L> {
        Candidate {
            dist: L::select(mask, a.dist, b.dist),
            pos: vec3::select(mask, &a.pos, &b.pos),
            normal: vec3::select(mask, &a.normal, &b.normal),
            tangent: vec3::select(mask, &a.tangent, &b.tangent),
        }
    }

    /// Puts down the contact, in the worlds of the mask that are not farther apart than `include`.
    #[inline(always)]
    pub fn put(&self, mask: L::Mask, include: L, found: &mut Found<L>) {
        let exists = mask & self.dist.le(include);
        found[0] = L::select(exists, self.dist, L::of(L::Real::MAXVAL));
        found[1..4].copy_from_slice(&self.pos);
        found[4..].copy_from_slice(&contact_frame(&self.normal, &self.tangent));
    }
}
