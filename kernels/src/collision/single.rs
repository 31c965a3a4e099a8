//! The narrow phase of one world at a time: pairs that branch too much for lanes.
//!
//! Each near lane's numbers are taken out, treated in the lane's own real type, and the points put back into the lanes of
//! the pair's slots. A world's points follow from its own numbers alone, by the same scalar code whatever the lane's width.

use super::body::{Body, Candidate};
use super::{ConvexCollider, Outline};
use crate::lane::{LaneQuery, Scalar};
use crate::math::vec3::{Vec3, zero};

/// Most points of a pair, but for height fields.
pub(crate) const MOST: usize = 8;
/// Most points of a height field and another shape.
pub const MOST_OF_FIELD: usize = 50;

/// A point of a world.
#[derive(Clone, Copy, Debug)]
pub struct Point<R> {
    /// Distance, negative when penetrating.
    pub dist: R,
    /// Midway between the surfaces.
    pub pos: Vec3<R>,
    /// From the first body to the second.
    pub normal: Vec3<R>,
}

/// The points of one world's pair.
#[derive(Debug)]
pub struct Points<R, const N: usize = MOST> {
    len: usize,
    list: [Point<R>; N],
}

impl<R: Scalar, const N: usize> Default for Points<R, N> {
    fn default() -> Self {
        Points { len: 0, list: [Point { dist: R::zero(), pos: zero(), normal: zero() }; N] }
    }
}

impl<R: Scalar, const N: usize> Points<R, N> {
    /// The points.
    pub fn as_slice(&self) -> &[Point<R>] {
        &self.list[..self.len]
    }

    /// Adds a point; one beyond the last place is dropped.
    pub fn push(&mut self, point: Point<R>) {
        if let Some(place) = self.list.get_mut(self.len) {
            *place = point;
            self.len += 1;
        }
    }
}

/// A lane of a body.
fn lane<L: LaneQuery>(body: &Body<L>, i: usize) -> Body<L::Real> {
    Body { pos: body.pos.map(|x| x.get(i)), rot: body.rot.map(|x| x.get(i)), size: body.size.map(|x| x.get(i)) }
}

/// Runs `collide` for every lane of `near`, by its number, and emits its points.
pub(super) fn each<L: LaneQuery, const N: usize>(
    a: &Body<L>,
    b: &Body<L>,
    near: L::Mask,
    mut collide: impl FnMut(usize, [&Body<L::Real>; 2], &mut Points<L::Real, N>),
    emit: &mut dyn FnMut(u32, Candidate<L>, L::Mask),
) {
    let (z, one) = (L::zero(), L::one());
    // Lanes without the point hold a unit normal, so that what is computed from them stays finite.
    let blank = Candidate { dist: z, pos: zero(), normal: [one, z, z], tangent: zero() };
    let mut candidates = [blank; N];
    let mut exists = [0_u32; N];
    let near = L::bits(near);
    for i in (0..L::WIDTH).filter(|i| near >> i & 1 != 0) {
        let mut points = Points::default();
        collide(i, [&lane(a, i), &lane(b, i)], &mut points);
        for (p, point) in points.as_slice().iter().enumerate() {
            exists[p] |= 1 << i;
            candidates[p].dist.set(i, point.dist);
            for k in 0..3 {
                candidates[p].pos[k].set(i, point.pos[k]);
                candidates[p].normal[k].set(i, point.normal[k]);
            }
        }
    }
    for (p, (candidate, bits)) in candidates.into_iter().zip(exists).enumerate() {
        if bits != 0 {
            emit(p as u32, candidate, L::mask_of(bits));
        }
    }
}

/// A body in f64.
fn widen<R: Scalar>(body: &Body<R>) -> Body<f64> {
    Body { pos: body.pos.map(R::to_f64), rot: body.rot.map(R::to_f64), size: body.size.map(R::to_f64) }
}

/// Runs a collider of convex shapes in f64, and rounds its points.
pub(super) fn convex<R: Scalar, const N: usize>(
    collider: &dyn ConvexCollider,
    outlines: [Outline<'_>; 2],
    bodies: (&Body<R>, &Body<R>),
    (include, most): (R, usize),
    axis: &mut [f64; 3],
    points: &mut Points<R, N>,
) {
    let mut add = |point: Point<f64>| {
        points.push(Point {
            dist: R::from_f64(point.dist),
            pos: point.pos.map(R::from_f64),
            normal: point.normal.map(R::from_f64),
        });
    };
    collider.collide(outlines, [&widen(bodies.0), &widen(bodies.1)], include.to_f64(), most, axis, &mut add);
}
