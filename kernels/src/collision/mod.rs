//! Collision: bounding tests of the candidate pairs, then the narrow phase of those that are near in some world of the
//! block, into a compact list of contacts.
//!
//! A block's list is the union of its worlds' contacts; a world without a given contact has it at distance `MAXVAL`.

mod body;
mod bound;
mod boxes;
mod broad;
mod capsule;
mod capsule_box;
mod classes;
mod convex;
mod frame;
mod pair;
mod plane;
mod single;
mod sphere;
mod way;

pub use body::{Body, Found, Frames};
pub use bound::near_pairs;
pub use classes::{Class, classes, groups};
pub use convex::{ConvexCollider, Outline};
pub use frame::contact_frame;
pub use pair::{in_lanes, narrow, narrow_parallel};
pub use single::{MOST_OF_FIELD, Point, Points};
pub use way::{blur, levers, way};

pub(crate) use body::Candidate;
pub use body::body;
use broad::Broad;

use crate::fields::fields;
use crate::lane::{Lane, LaneQuery, Mask, Real};
use crate::math::vec3::{Mat3, Vec3};
use crate::model::{Instance, Model, NONE, Pair, Shape};
use crate::position::Position;

fields! {
    /// What is known of the geoms that take part in pairs.
    pub struct Colliders(sizes) {
        /// Centre relative to the origin of the link's tree, m, world axes; in the world for geoms that stand still.
        pub pos: Vec<[L; 3]> = sizes.ncollider,
        /// Local z axis in the world.
        pub axis: Vec<[L; 3]> = sizes.ncollider,
        /// Positions when pairs were last tested.
        pub qpos: Vec<L> = sizes.nq,
        /// Orientations of mocap bodies then.
        pub mocap_quat: Vec<[L; 4]> = sizes.nmocap,
        /// Origins of trees then.
        pub origin: Vec<[L; 3]> = sizes.ntree,
        /// By tree, bounds of the way since then, m, from the joints below its first link, and from those of it.
        pub stir: Vec<[L; 2]> = sizes.ntree,
        /// Bounds of the way of any geom since then, m, relative to the rest of its tree, and in the world; `MAX` where they are
        /// not numbers.
        pub way: Vec<L> = 2,
        /// By how much rounding can make distances less than they were, m: of geoms within a tree, and of others.
        pub blur: Vec<L> = 2,
        /// Sums of those ways over all tests, each with a little added.
        pub travel: Vec<L> = 2,
        /// Travel from which on groups of pairs are to be tested: of pairs within a tree, and of others.
        pub due: Vec<L> = 2,
        /// Lower bounds of the distances by which the pairs of a group that was tested are not near: within a tree, and others.
        pub gaps: Vec<L> = 2,
    } L
}

/// Where a contact of the block's list comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    /// Pair.
    pub pair: u32,
    /// Number of the contact within the pair.
    pub point: u32,
    /// Its place in what the narrow phase found.
    pub place: u32,
}

/// A contact of each world of the block, where the narrow phase put it down.
#[derive(Clone, Copy, Debug)]
pub struct Contact<'a, L>(pub &'a Found<L>);

impl<'a, L: Copy> Contact<'a, L> {
    /// Distance, negative when penetrating; `MAXVAL` in worlds without this contact.
    #[inline(always)]
    pub fn dist(&self) -> L {
        self.0[0]
    }

    /// Point midway between the surfaces, relative to the pair's reference point (see [`reference`]), world axes.
    #[inline(always)]
    pub fn pos(&self) -> Vec3<L> {
        [self.0[1], self.0[2], self.0[3]]
    }

    /// Rows: normal from the first geom to the second, two tangents.
    #[inline(always)]
    pub fn frame(&self) -> &'a Mat3<L> {
        let [_, _, _, _, frame @ ..] = self.0;
        frame
    }
}

/// A pair that is near in some world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Near {
    /// Pair.
    pub pair: u32,
    /// The worlds, as bits.
    pub worlds: u32,
    /// First place of its contacts in what the narrow phase found.
    pub first: u32,
    /// Number of contacts that it can have.
    pub points: u32,
    /// Number of its class; [`NONE`]: it is treated world by world.
    pub class: u32,
}

/// What the list of near pairs has to know of a pair.
#[derive(Clone, Copy, Debug)]
struct Extent {
    /// Number of contacts that it can have.
    points: u32,
    /// Number of its class; [`NONE`]: it is treated world by world, for want of a formula in lanes.
    class: u32,
    /// Its number among those.
    single: u32,
}

/// Contacts of a block.
#[derive(Clone, Debug)]
pub struct Collision<L> {
    /// Poses and ways of geoms.
    pub colliders: Colliders<L>,
    /// Bounding tests.
    pub broad: Broad<L>,
    /// By pair.
    extents: Vec<Extent>,
    /// Classes of pairs that are treated alike.
    pub classes: Vec<Class>,
    /// Groups of pairs whose bounding tests may be run together.
    pub groups: Vec<Vec<u32>>,
    /// Where the pairs of a group are near.
    pub words: Vec<u32>,
    /// Pairs that are near.
    pub near: Vec<Near>,
    /// What the narrow phase found: the listed contacts, each at its place, and others.
    pub found: Vec<Found<L>>,
    /// At the first place of two capsules, 1 where they are parallel.
    pub parallel: Vec<L>,
    /// The contacts that exist in some world, in the order of pairs and points.
    pub slots: Vec<Slot>,
    /// Of pairs that are treated world by world, along which axis each world's shapes were apart when they were last looked at.
    axes: Vec<[f64; 3]>,
}

/// Number of the worlds' pairs that are treated world by world.
fn singles<L: Lane>(of_pairs: &[u32]) -> usize {
    let worlds = size_of::<L>() / size_of::<L::Real>();
    worlds * of_pairs.iter().filter(|class| **class == NONE).count()
}

impl<L: Lane> Collision<L> {
    /// Room for the contacts that the model can have.
    pub fn new(model: &Model<L::Real>) -> Self {
        let most = model.capacity().contacts;
        let (classes, of_pairs) = classes(model);
        let axes = vec![[0.0; 3]; singles::<L>(&of_pairs)];
        let mut single = 0;
        let extent = |(pair, class): (&Pair<_>, u32)| {
            single += u32::from(class == NONE);
            Extent { points: pair.slots.len, class, single: single.saturating_sub(1) }
        };
        Collision {
            colliders: Colliders::new(&model.sizes),
            extents: model.pairs.iter().zip(of_pairs).map(extent).collect(),
            classes,
            groups: Vec::new(),
            words: vec![0; model.pairs.len()],
            broad: Broad::new(model),
            near: Vec::with_capacity(model.pairs.len().min(most)),
            found: Vec::with_capacity(most),
            parallel: Vec::with_capacity(most),
            slots: Vec::with_capacity(most),
            axes,
        }
    }

    /// Bytes of that.
    pub fn bytes(model: &Model<L::Real>) -> usize {
        let (most, pairs) = (model.capacity().contacts, model.pairs.len());
        let found = size_of::<Found<L>>() + size_of::<L>() + size_of::<Slot>();
        let lists = most * found + pairs.min(most) * size_of::<Near>();
        Colliders::<L>::bytes(&model.sizes)
            + lists
            + pairs * (size_of::<Extent>() + 2 * size_of::<u32>())
            + singles::<L>(&classes(model).1) * size_of::<[f64; 3]>()
            + Broad::<L>::bytes(model)
    }

    /// Listed contact by number.
    #[inline(always)]
    pub fn contact(&self, number: usize) -> Contact<'_, L> {
        Contact(&self.found[self.slots[number].place as usize])
    }

    /// The listed contacts.
    pub fn contacts(&self) -> impl DoubleEndedIterator<Item = Contact<'_, L>> + ExactSizeIterator {
        (0..self.slots.len()).map(|number| self.contact(number))
    }
}

/// The tree at whose origin a pair's contacts are placed, that of the second link or else of the first, as a link.
pub fn reference<T>(pair: &Pair<T>) -> u32 {
    if pair.link2 != NONE { pair.link2 } else { pair.link1 }
}

impl<L: LaneQuery> Collision<L> {
    /// Lists the pairs that are near in some world of `alive`, each with room for its contacts. Returns whether some are treated
    /// world by world.
    pub fn list_near(&mut self, alive: u32) -> bool {
        let Collision { broad, extents, near, found, parallel, .. } = self;
        near.clear();
        let (mut first, mut any_single) = (0, false);
        for (c, chunk) in broad.near.chunks(16).enumerate() {
            if chunk.iter().fold(0, |any, worlds| any | worlds) & alive == 0 {
                continue;
            }
            for (i, worlds) in chunk.iter().enumerate().filter(|(_, worlds)| **worlds & alive != 0) {
                let pair = (16 * c + i) as u32;
                let Extent { points, class, .. } = extents[pair as usize];
                near.push(Near { pair, worlds: *worlds & alive, first, points, class });
                first += points;
                any_single |= class == NONE;
            }
        }
        if found.len() < first as usize {
            found.resize(first as usize, [L::zero(); 13]);
            parallel.resize(first as usize, L::zero());
        }
        any_single
    }

    /// Contacts of a pair that is treated world by world.
    pub fn world_by_world(
        &mut self,
        model: Instance<'_, L>,
        near: &Near,
        position: &Position<L>,
        convex: &dyn ConvexCollider,
    ) {
        let pair = &model.pairs[near.pair as usize];
        let bodies = [pair.geom1, pair.geom2].map(|g| body(model, position, g as usize));
        let [a, b] = &Frames::new(&model, pair).place(position, bodies);
        let found = points_found(near, &mut self.found);
        let axes = &mut self.axes[L::WIDTH * self.extents[near.pair as usize].single as usize..][..L::WIDTH];
        let include = model.pairs[near.pair as usize].include;
        let most = found.len();
        found.iter_mut().for_each(|found| found[0] = L::of(L::Real::MAXVAL));
        let emit = &mut |point: u32, candidate: Candidate<L>, mask| {
            candidate.put(mask, L::splat(include), &mut found[point as usize]);
        };
        let worlds = L::mask_of(near.worlds);
        match shapes(&model, near.pair) {
            (Shape::Capsule, Shape::Box) => {
                let collide =
                    |_, [a, b]: [&_; 2], points: &mut Points<_>| capsule_box::capsule_box(a, b, include, points);
                single::each(a, b, worlds, collide, emit);
            }
            (Shape::Box, Shape::Box) => {
                let axes = boxes::Axes::new(a, b);
                let collide =
                    |i, [a, b]: [&_; 2], points: &mut Points<_>| boxes::boxes(a, b, &axes.lane(i), include, points);
                single::each(a, b, worlds, collide, emit);
            }
            (Shape::HeightField, _) => {
                let outlines = outlines(&model, near.pair);
                let collide = |i: usize, [a, b]: [&_; 2], points: &mut Points<_, MOST_OF_FIELD>| {
                    single::convex(convex, outlines, (a, b), (include, most), &mut axes[i], points)
                };
                single::each(a, b, worlds, collide, emit);
            }
            _ => {
                let outlines = outlines(&model, near.pair);
                let collide = |i: usize, [a, b]: [&_; 2], points: &mut Points<_>| {
                    single::convex(convex, outlines, (a, b), (include, most), &mut axes[i], points)
                };
                single::each(a, b, worlds, collide, emit);
            }
        }
    }

    /// Lists the contacts that exist in some world. Returns the lanes in which there were more than `capacity`.
    pub fn list_contacts(&mut self, model: &Model<L::Real>, capacity: usize) -> L::Mask {
        let Collision { near, found, slots, .. } = self;
        let may_overflow = model.sizes.nslot > capacity;
        let mut count = L::zero();
        let mut overflow = L::Mask::splat(false);
        for near in near {
            for (point, found) in (0..).zip(points_found(near, found)) {
                let mut exists = found[0].lt(L::of(L::Real::MAXVAL));
                if may_overflow {
                    count += L::select(exists, L::one(), L::zero());
                    let beyond = exists & count.gt(L::of(capacity as f64));
                    overflow = overflow | beyond;
                    exists = exists & !beyond;
                    found[0] = L::select(beyond, L::of(L::Real::MAXVAL), found[0]);
                }
                if L::any(exists) {
                    slots.push(Slot { pair: near.pair, point, place: near.first + point });
                }
            }
        }
        overflow
    }
}

/// Calls `found` with points of two convex shapes, among them the nearest, of the worlds in which it is not farther than `include`.
pub(crate) fn nearest<L: LaneQuery>(
    convex: &dyn ConvexCollider,
    outlines: [Outline<'_>; 2],
    [a, b]: &[Body<L>; 2],
    include: L::Real,
    found: &mut dyn FnMut(&Candidate<L>, L::Mask),
) {
    let everywhere = L::Mask::splat(true);
    let collide = |_, [a, b]: [&_; 2], points: &mut single::Points<L::Real, 1>| {
        single::convex(convex, outlines, (a, b), (include, 1), &mut [0.0; 3], points);
    };
    single::each(a, b, everywhere, collide, &mut |_, candidate, mask| found(&candidate, mask));
}

/// The shapes of a pair.
pub fn shapes<T>(model: &Model<T>, pair: u32) -> (Shape, Shape) {
    let pair = &model.pairs[pair as usize];
    (model.geoms[pair.geom1 as usize].shape, model.geoms[pair.geom2 as usize].shape)
}

/// The places of its contacts.
fn points_found<'a, L>(near: &Near, found: &'a mut [Found<L>]) -> &'a mut [Found<L>] {
    &mut found[near.first as usize..][..near.points as usize]
}

/// The outlines of a pair.
fn outlines<T>(model: &Model<T>, pair: u32) -> [Outline<'_>; 2] {
    let pair = &model.pairs[pair as usize];
    [pair.geom1, pair.geom2].map(|geom| {
        let geom = &model.geoms[geom as usize];
        let (shape, place) = (geom.shape, geom.hull as usize);
        let of = |wanted| shape == wanted;
        Outline {
            shape,
            hull: model.hulls.get(place).filter(|_| of(Shape::Mesh)),
            heights: model.heights.get(place).filter(|_| of(Shape::HeightField)),
        }
    })
}
