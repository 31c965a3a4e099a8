//! The narrow phase of a pair with a formula in lanes: from two bodies to the contacts that the pair may have.

use crate::lane::{Lane, Mask, Real};
use crate::math::vec3::{Mat3, Vec3, add, column, mul_add, mul_mat, splat, sub, zero};
use crate::model::{Instance, Model, NONE, Pair, Shape};
use crate::position::Position;

use super::bound::Rod;
use super::{capsule, contact_frame, plane, reference, shapes, sphere};

/// A contact as numbers: distance, `MAXVAL` in worlds without it; position; frame. An array, which generated code can write.
pub type Found<L> = [L; 13];

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
        Frames { trees: [tree(pair.link1), tree(pair.link2)], reference: tree(reference(pair)) }
    }

    /// A place relative to the origin of the `k`th geom's tree, made relative to the pair's reference point.
    #[inline(always)]
    pub fn shift<L: Lane>(&self, k: usize, pos: &Vec3<L>, position: &Position<L>) -> Vec3<L> {
        if self.trees[k] == self.reference {
            return *pos;
        }
        let origin = |tree: u32| if tree == NONE { zero() } else { position.origin[tree as usize] };
        add(pos, &sub(&origin(self.trees[k]), &origin(self.reference)))
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
    /// Puts down the contact, in the worlds of the mask that are not farther apart than `include`.
    #[inline(always)]
    pub fn put(&self, mask: L::Mask, include: L, found: &mut Found<L>) {
        let exists = mask & self.dist.le(include);
        found[0] = L::select(exists, self.dist, L::of(L::Real::MAXVAL));
        found[1..4].copy_from_slice(&self.pos);
        found[4..].copy_from_slice(&contact_frame(&self.normal, &self.tangent));
    }
}

/// Whether a pair has a formula in lanes.
pub fn in_lanes(shapes: (Shape, Shape)) -> bool {
    use Shape::{Box, Capsule, Cylinder, Plane, Sphere};
    matches!(
        shapes,
        (Plane, Sphere | Capsule | Shape::Ellipsoid | Cylinder | Box)
            | (Sphere, Sphere | Capsule | Cylinder | Box)
            | (Capsule, Capsule)
    )
}

/// The bodies of a pair relative to its reference point, and the distance within which contacts are listed.
#[inline(always)]
fn placed<L: Lane>(model: Instance<'_, L>, pair: u32, position: &Position<L>) -> ([Body<L>; 2], L) {
    let Pair { geom1, geom2, .. } = model.pairs[pair as usize];
    let bodies = [geom1, geom2].map(|g| body(model, position, g as usize));
    let frames = Frames::new(&model, &model.pairs[pair as usize]);
    (frames.place(position, bodies), model.include(pair as usize))
}

/// [`points`] of a pair.
pub fn narrow<L: Lane>(
    model: Instance<'_, L>,
    pair: u32,
    near: L::Mask,
    position: &Position<L>,
    found: &mut [Found<L>],
) -> L::Mask {
    let ([a, b], include) = placed(model, pair, position);
    points(shapes(&model, pair), &a, &b, include, near, found)
}

/// [`capsules`] of a pair.
pub fn narrow_parallel<L: Lane>(
    model: Instance<'_, L>,
    pair: u32,
    near: L::Mask,
    position: &Position<L>,
    found: &mut [Found<L>],
) {
    let ([a, b], include) = placed(model, pair, position);
    capsules(&a, &b, include, near, found);
}

/// The contacts of a pair with a formula in lanes, in the worlds of `near`. Of two capsules, those that are not parallel;
/// returns where they are.
#[inline(always)]
fn points<L: Lane>(
    shapes: (Shape, Shape),
    a: &Body<L>,
    b: &Body<L>,
    include: L,
    near: L::Mask,
    found: &mut [Found<L>],
) -> L::Mask {
    use Shape::{Capsule, Cylinder, Ellipsoid, Plane, Sphere};
    let nowhere = L::Mask::splat(false);
    let mut put = |i: usize, candidate: &Candidate<L>, mask| candidate.put(near & mask, include, &mut found[i]);
    let everywhere = L::Mask::splat(true);
    match shapes {
        (Plane, Sphere) => put(0, &plane::sphere(a, b), everywhere),
        (Plane, Capsule) => plane::capsule(a, b).iter().enumerate().for_each(|(i, c)| put(i, c, everywhere)),
        (Plane, Ellipsoid) => put(0, &plane::ellipsoid(a, b), everywhere),
        (Plane, Cylinder) => {
            plane::cylinder(a, b, include).iter().enumerate().for_each(|(i, (c, mask))| put(i, c, *mask));
        }
        (Plane, Shape::Box) => {
            plane::cuboid(a, b, include).iter().enumerate().for_each(|(i, (c, mask))| put(i, c, *mask));
        }
        (Sphere, Sphere) => put(0, &sphere::sphere(a, b), everywhere),
        (Sphere, Capsule) => put(0, &sphere::capsule(a, b), everywhere),
        (Sphere, Cylinder) => put(0, &sphere::cylinder(a, b), everywhere),
        (Sphere, Shape::Box) => put(0, &sphere::cuboid(a, b), everywhere),
        (Capsule, Capsule) => {
            let (crossing, parallel) = capsule::crossing(a, b);
            put(0, &crossing, !parallel);
            put(1, &crossing, nowhere);
            return near & parallel;
        }
        _ => {}
    }
    nowhere
}

/// The contacts of two capsules wherever they are, parallel ones too.
#[inline(always)]
fn capsules<L: Lane>(a: &Body<L>, b: &Body<L>, include: L, near: L::Mask, found: &mut [Found<L>]) {
    let (crossing, parallel) = capsule::crossing(a, b);
    for (i, candidate) in capsule::parallel(a, b).iter().enumerate() {
        let mask = if i == 0 { near } else { near & parallel };
        capsule::select(parallel, candidate, &crossing).put(mask, include, &mut found[i]);
    }
}
