//! Collision: bounding tests for every candidate pair, then the narrow phase of pairs that are near in some world of the
//! block, into a compact list of contacts.
//!
//! A block's list is the union of its worlds' contacts; a world without a given contact has it at distance `MAXVAL`.

mod boxes;
mod broad;
mod capsule;
mod capsule_box;
mod convex;
mod frame;
mod plane;
mod single;
mod sphere;

pub use convex::ConvexCollider;
pub use frame::contact_frame;
pub use single::{Point, Points};

use broad::Broad;

use crate::fields::fields;
use crate::lane::{Lane, LaneQuery, Mask, Real, Scalar};
use crate::math::vec3::{Mat3, Vec3, column, dot, mul_add, mul_mat, splat, sub, zero};
use crate::model::{Model, NONE, Pair, Shape};
use crate::position::Position;

fields! {
    /// Poses of the geoms that take part in pairs.
    pub struct Colliders(sizes) {
        /// Centre relative to the origin of the link's tree, m, world axes; in the world for geoms that stand still.
        pub pos: Vec<[L; 3]> = sizes.ncollider,
        /// Orientation: geom to world.
        pub rot: Vec<[L; 9]> = sizes.ncollider,
        /// Largest square of the way of any centre since the step before, m²; `MAX` where a way is not a number.
        pub way: Vec<L> = usize::from(sizes.ncollider > 0),
    } L
}

/// Where a contact of the block's list comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    /// Pair.
    pub pair: u32,
    /// Number of the contact within the pair.
    pub point: u32,
}

/// A contact of each world of the block.
#[derive(Clone, Copy, Debug)]
pub struct Contact<L> {
    /// Distance, negative when penetrating; `MAXVAL` in worlds without this contact.
    pub dist: L,
    /// Point midway between the surfaces, relative to the pair's reference point (see [`reference`]), world axes.
    pub pos: Vec3<L>,
    /// Rows: normal from the first geom to the second, two tangents.
    pub frame: Mat3<L>,
}

/// Contacts of a block.
#[derive(Clone, Debug)]
pub struct Collision<L> {
    /// Geom poses.
    pub colliders: Colliders<L>,
    /// Bounding tests.
    pub broad: Broad<L>,
    /// Geoms whose orientation is that of this step: what stands still, and what some pair needed.
    pub oriented: Vec<bool>,
    /// Origin of each contact, in the order of pairs and points.
    pub slots: Vec<Slot>,
    /// The contacts.
    pub contacts: Vec<Contact<L>>,
}

/// One candidate of the narrow phase: distance, position and normal, and a hint for the first tangent.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate<L> {
    dist: L,
    pos: Vec3<L>,
    normal: Vec3<L>,
    tangent: Vec3<L>,
}

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
    fn axis(&self) -> Vec3<L> {
        column(&self.rot, 2)
    }
}

impl<L: LaneQuery> Collision<L> {
    /// Room for the contacts that the model can have.
    pub fn new(model: &Model<L::Real>) -> Self {
        let mut colliders = Colliders::new(&model.sizes);
        for (g, geom) in model.geoms.iter().enumerate().filter(|(_, geom)| geom.link == NONE) {
            colliders.pos[g] = splat(&geom.pos);
            colliders.rot[g] = splat(&geom.rot);
        }
        Collision {
            colliders,
            broad: Broad::new(model),
            oriented: vec![true; model.geoms.len()],
            slots: Vec::with_capacity(model.capacity().contacts),
            contacts: Vec::with_capacity(model.capacity().contacts),
        }
    }

    /// Takes note of how far geoms moved when they were placed.
    pub fn moved(&mut self, position: &Position<L>, alive: L::Mask) {
        self.broad.advance(position, self.colliders.way[0], alive);
    }

    /// Bytes of the list of contacts.
    pub fn bytes(&self) -> usize {
        self.contacts.capacity() * size_of::<Contact<L>>() + self.slots.capacity() * size_of::<Slot>()
    }
}

/// The tree at whose origin a pair's contacts are placed, that of the second link or else of the first, as a link.
pub fn reference<T>(pair: &Pair<T>) -> u32 {
    if pair.link2 != NONE { pair.link2 } else { pair.link1 }
}

/// Origin of the tree of a link; zero for [`NONE`].
#[inline(always)]
pub fn origin<L: Lane>(model: &Model<L::Real>, position: &Position<L>, link: u32) -> Vec3<L> {
    if link == NONE { zero() } else { position.origin[model.links[link as usize].tree as usize] }
}

/// Places the centres of the geoms that move, and finds how far they moved. Their orientations wait until a pair needs them;
/// what stands still was placed before.
pub fn place<L: Lane>(model: &Model<L::Real>, position: &Position<L>, colliders: &mut Colliders<L>) {
    let mut longest = L::zero();
    let mut known = L::Mask::splat(true);
    for (g, geom) in model.geoms.iter().enumerate().filter(|(_, geom)| geom.link != NONE) {
        let l = geom.link as usize;
        let pos = mul_add(&position.rot[l], &splat(&geom.pos), &position.pos[l]);
        let way = sub(&pos, &colliders.pos[g]);
        let square = dot(&way, &way);
        known = known & square.lt(L::of(L::Real::MAX));
        longest = longest.max(square);
        colliders.pos[g] = pos;
    }
    colliders.way[0] = L::select(known, longest, L::of(L::Real::MAX));
}

/// Orientation of a geom, if it is not known yet.
fn orient<L: Lane>(
    model: &Model<L::Real>,
    position: &Position<L>,
    g: usize,
    colliders: &mut Colliders<L>,
    oriented: &mut [bool],
) {
    if !oriented[g] {
        let geom = &model.geoms[g];
        let rot = &position.rot[geom.link as usize];
        colliders.rot[g] = if geom.aligned { *rot } else { mul_mat(rot, &splat(&geom.rot)) };
        oriented[g] = true;
    }
}

/// Finds the contacts of the worlds in `alive`, whose geoms have been placed, which [`Collision::moved`] knows. Returns the lanes in which some world had more than `capacity` contacts;
/// those beyond it, in the order of pairs, are left out.
pub fn collide<L: LaneQuery>(
    model: &Model<L::Real>,
    position: &Position<L>,
    alive: L::Mask,
    capacity: usize,
    convex: &dyn ConvexCollider,
    collision: &mut Collision<L>,
) -> L::Mask {
    let Collision { colliders, broad, oriented, slots, contacts } = collision;
    slots.clear();
    contacts.clear();
    let may_overflow = model.sizes.nslot > capacity;
    let mut count = L::zero();
    let mut overflow = L::Mask::splat(false);
    if !broad.any_due() {
        return overflow;
    }
    oriented.clear();
    oriented.extend(model.geoms.iter().map(|geom| geom.link == NONE));
    for p in 0..model.pairs.len() {
        if !broad.is_due(p) {
            continue;
        }
        let near = broad.near(p, position, colliders, alive);
        if !L::any(near) {
            continue;
        }
        let pair = &model.pairs[p];
        let geoms = [&model.geoms[pair.geom1 as usize], &model.geoms[pair.geom2 as usize]];
        let centres = broad.centres(p, position, colliders);
        // Orientations, sizes and the rest are fetched for the few pairs that are near.
        orient(model, position, pair.geom1 as usize, colliders, oriented);
        orient(model, position, pair.geom2 as usize, colliders, oriented);
        let body =
            |k: usize, g: u32| Body { pos: centres[k], rot: colliders.rot[g as usize], size: splat(&geoms[k].size) };
        let (first, second) = (body(0, pair.geom1), body(1, pair.geom2));
        let include = L::splat(pair.include);
        let shapes = (geoms[0].shape, geoms[1].shape);
        let narrow = Narrow { shapes, include: pair.include, most: pair.slots.len as usize, convex };
        narrow.points::<L>(&first, &second, near, &mut |point, candidate, mask| {
            let mut exists = mask & candidate.dist.le(include);
            if may_overflow {
                count += L::select(exists, L::one(), L::zero());
                let beyond = exists & count.gt(L::of(capacity as f64));
                overflow = overflow | beyond;
                exists = exists & !beyond;
            }
            if L::any(exists) {
                slots.push(Slot { pair: p as u32, point });
                contacts.push(Contact {
                    dist: L::select(exists, candidate.dist, L::of(L::Real::MAXVAL)),
                    pos: candidate.pos,
                    frame: contact_frame(&candidate.normal, &candidate.tangent),
                });
            }
        });
    }
    broad.look_ahead();
    overflow
}

/// A pair as the narrow phase sees it.
struct Narrow<'a, T> {
    shapes: (Shape, Shape),
    /// Distance up to which there are contacts.
    include: T,
    /// Most contacts of the pair.
    most: usize,
    convex: &'a dyn ConvexCollider,
}

impl<T: Scalar> Narrow<'_, T> {
    /// Calls `emit` with number, geometry and mask of every contact that the pair may have.
    fn points<L: LaneQuery<Real = T>>(
        &self,
        a: &Body<L>,
        b: &Body<L>,
        near: L::Mask,
        emit: &mut dyn FnMut(u32, Candidate<L>, L::Mask),
    ) {
        use Shape::{Box, Capsule, Cylinder, Plane, Sphere};
        match self.shapes {
            (Plane, _) | (Sphere, Sphere | Capsule | Cylinder | Box) | (Capsule, Capsule) => {
                in_lanes(self.shapes, a, b, L::splat(self.include), near, emit);
            }
            (Capsule, Box) => {
                single::each(a, b, near, |a, b, points| capsule_box::capsule_box(a, b, self.include, points), emit)
            }
            (Box, Box) => single::each(a, b, near, |a, b, points| boxes::boxes(a, b, self.include, points), emit),
            shapes => single::each(
                a,
                b,
                near,
                |a, b, points| single::convex(self.convex, shapes, (a, b), self.include, self.most, points),
                emit,
            ),
        }
    }
}

/// Pairs with a formula in lanes.
fn in_lanes<L: LaneQuery>(
    shapes: (Shape, Shape),
    a: &Body<L>,
    b: &Body<L>,
    include: L,
    near: L::Mask,
    emit: &mut dyn FnMut(u32, Candidate<L>, L::Mask),
) {
    use Shape::{Capsule, Cylinder, Ellipsoid, Plane, Sphere};
    match shapes {
        (Plane, Sphere) => emit(0, plane::sphere(a, b), near),
        (Plane, Capsule) => {
            for (i, candidate) in plane::capsule(a, b).into_iter().enumerate() {
                emit(i as u32, candidate, near);
            }
        }
        (Plane, Ellipsoid) => emit(0, plane::ellipsoid(a, b), near),
        (Plane, Cylinder) => {
            for (i, (candidate, mask)) in plane::cylinder(a, b, include).into_iter().enumerate() {
                emit(i as u32, candidate, near & mask);
            }
        }
        (Plane, Shape::Box) => {
            for (i, (candidate, mask)) in plane::cuboid(a, b, include).into_iter().enumerate() {
                emit(i as u32, candidate, near & mask);
            }
        }
        (Sphere, Sphere) => emit(0, sphere::sphere(a, b), near),
        (Sphere, Capsule) => emit(0, sphere::capsule(a, b), near),
        (Sphere, Cylinder) => emit(0, sphere::cylinder(a, b), near),
        (Sphere, Shape::Box) => emit(0, sphere::cuboid(a, b), near),
        (Capsule, Capsule) => {
            let (crossing, parallel) = capsule::crossing(a, b);
            let mut candidates = [(crossing, !parallel), (crossing, L::Mask::splat(false))];
            if L::any(parallel & near) {
                for (slot, (candidate, mask)) in candidates.iter_mut().zip(capsule::parallel(a, b, include)) {
                    slot.0 = capsule::select(parallel, &candidate, &slot.0);
                    slot.1 = slot.1 | (parallel & mask);
                }
            }
            for (i, (candidate, mask)) in candidates.into_iter().enumerate() {
                emit(i as u32, candidate, near & mask);
            }
        }
        _ => {}
    }
}
