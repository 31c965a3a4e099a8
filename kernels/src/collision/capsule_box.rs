//! Capsule against box: one or two spheres on the capsule's axis, each against the box.
//!
//! The first is where the axis comes nearest to the box's surface: an end over a face, or the nearest point to one of the
//! twelve edges (segments' nearest points: Ericson, Real-Time Collision Detection, 2005, §5.1.9). The second follows the
//! axis from there over the face that it runs along, to that face's far side or the capsule's other end. An end inside the
//! box is the only point.
//!
//! An axis that runs level along a face or an edge is as near to it at many places. Rounding would choose one of them, and
//! with it what follows, so there the points are the two ends of the part that lies beside the face or edge.

use super::body::{Body, Candidate};
use super::single::{Point, Points};
use super::sphere;
use crate::lane::Scalar;
use crate::math::vec3::{Vec3, add, dot, mul, mul_t, scale, scale_add, sub};

/// An axis that rises over a face by no more than this fraction of its length, or a few roundings, runs level with it. The
/// distances of its ends differ from the least by the square of it, normals by as much.
const LEVEL: f64 = 1e-6;

/// The capsule's axis in the box's frame: from -1 to 1, p + x a.
struct Segment<R> {
    p: Vec3<R>,
    a: Vec3<R>,
}

impl<R: Scalar> Segment<R> {
    /// Whether coordinate k stays the same along the axis.
    fn level(&self, k: usize) -> bool {
        let level = LEVEL.max(32.0 * R::EPSILON);
        self.a[k] * self.a[k] <= dot(&self.a, &self.a) * R::of(level * level)
    }

    /// Lengths along coordinate k below this are a few roundings.
    fn slack(&self, size: &Vec3<R>, k: usize) -> R {
        (self.p[k].abs() + size[k]) * R::of(32.0 * R::EPSILON)
    }
}

/// What the axis is nearest to.
enum Feature {
    /// An end inside the box.
    Inside,
    /// A face with this normal.
    Face(usize),
    /// An edge along `axis`, or one of its ends; bit k of `upper`: at the upper side of coordinate k.
    Edge { axis: usize, upper: u8, end: bool },
}

/// The nearest place found.
struct Nearest<R> {
    x: R,
    square: R,
    feature: Feature,
}

/// The points within `include`.
pub(super) fn capsule_box<R: Scalar>(capsule: &Body<R>, cuboid: &Body<R>, include: R, points: &mut Points<R>) {
    let axis = scale(capsule.size[1], &capsule.axis());
    let p = mul_t(&cuboid.rot, &sub(&capsule.pos, &cuboid.pos));
    let segment = Segment { p, a: mul_t(&cuboid.rot, &axis) };
    let mut put = |Candidate { dist, pos, normal, .. }| {
        if dist <= include {
            points.push(Point { dist, pos, normal });
        }
    };
    if let Some(ends) = beside(&segment, &cuboid.size) {
        return ends.into_iter().for_each(|x| put(level_ball(capsule, cuboid, &segment, x)));
    }
    let nearest = nearest(&segment, &cuboid.size);
    let second = match nearest.feature {
        Feature::Inside => None,
        Feature::Face(k) => Some(along_face(&segment, &cuboid.size, nearest.x, k)),
        Feature::Edge { axis, upper, end: false } => along_edge(&segment, &cuboid.size, nearest.x, axis, upper),
        Feature::Edge { upper, end: true, .. } => from_corner(&segment, &cuboid.size, nearest.x, upper),
    };
    // An axis that runs level with two coordinates meets the box at one place, at which rounding may see a second.
    let aligned = (0..3).filter(|&k| segment.level(k)).count() == 2;
    let second = second.filter(|x| !aligned || (*x - nearest.x).abs() > R::of(32.0 * R::EPSILON));
    for x in [Some(nearest.x), second].into_iter().flatten() {
        let ball = Body { pos: scale_add(x, &axis, &capsule.pos), ..*capsule };
        put(sphere::cuboid(&ball, cuboid));
    }
}

/// The part of the axis that lies beside a face or an edge with which it runs level; `None` if it runs level with none, or
/// no part of it lies beside.
fn beside<R: Scalar>(segment: &Segment<R>, size: &Vec3<R>) -> Option<[R; 2]> {
    let Segment { p, a } = segment;
    let (mut from, mut to, mut outside) = (-R::one(), R::one(), false);
    for k in 0..3 {
        if segment.level(k) {
            outside = outside || p[k].abs() >= size[k] - segment.slack(size, k);
        } else {
            let (middle, half) = (-p[k] / a[k], size[k] / a[k].abs());
            from = from.max(middle - half);
            to = to.min(middle + half);
        }
    }
    let past = (0..3).any(|k| !segment.level(k) && (from - to) * a[k].abs() > segment.slack(size, k));
    (outside && !past).then_some([from, to])
}

/// A place beside, as a sphere against the box. In the directions along which the axis runs, the box counts as endless: its
/// other faces are not in question.
fn level_ball<R: Scalar>(capsule: &Body<R>, cuboid: &Body<R>, segment: &Segment<R>, x: R) -> Candidate<R> {
    let local = scale_add(x, &segment.a, &segment.p);
    let keep = |level: bool| std::array::from_fn(|k| if segment.level(k) == level { local[k] } else { R::zero() });
    let [across, along] = [keep(true), keep(false)].map(|part| mul(&cuboid.rot, &part));
    let ball = Body { pos: add(&cuboid.pos, &across), ..*capsule };
    let candidate = sphere::cuboid(&ball, cuboid);
    Candidate { pos: add(&candidate.pos, &along), ..candidate }
}

fn nearest<R: Scalar>(segment: &Segment<R>, size: &Vec3<R>) -> Nearest<R> {
    let one = R::one();
    let mut best = Nearest { x: -one, square: R::of(R::MAX), feature: Feature::Inside };
    for x in [-one, one] {
        let end = scale_add(x, &segment.a, &segment.p);
        let excess: Vec3<R> = std::array::from_fn(|k| end[k].abs() - size[k]);
        let mut outside = (0..3).filter(|&k| excess[k] > R::zero());
        match (outside.next(), outside.next()) {
            (None, _) => return Nearest { x, square: R::zero(), feature: Feature::Inside },
            (Some(k), None) if excess[k] * excess[k] < best.square => {
                best = Nearest { x, square: excess[k] * excess[k], feature: Feature::Face(k) };
            }
            _ => {}
        }
    }
    for axis in 0..3 {
        for corner in 0..4_u8 {
            let (k1, k2) = ((axis + 1) % 3, (axis + 2) % 3);
            let upper = (corner & 1) << k1 | (corner >> 1) << k2;
            let candidate = nearest_to_edge(segment, size, axis, upper);
            if candidate.square < best.square {
                best = candidate;
            }
        }
    }
    best
}

/// Coordinate k of the corner or edge on the sides that `upper` names.
fn side<R: Scalar>(size: &Vec3<R>, upper: u8, k: usize) -> R {
    if upper >> k & 1 == 1 { size[k] } else { -size[k] }
}

/// The axis's nearest place to an edge. The edge's end counts where the nearest point of its line lies beyond it.
fn nearest_to_edge<R: Scalar>(segment: &Segment<R>, size: &Vec3<R>, axis: usize, upper: u8) -> Nearest<R> {
    let (one, half) = (R::one(), size[axis]);
    let mut mid: Vec3<R> = std::array::from_fn(|k| side(size, upper, k));
    mid[axis] = R::zero();
    let to = sub(&mid, &segment.p);
    let square = dot(&segment.a, &segment.a);
    let along = segment.a[axis];
    let forward = dot(&to, &segment.a);
    let (k1, k2) = ((axis + 1) % 3, (axis + 2) % 3);
    let (mut x, mut y);
    if !(segment.level(k1) && segment.level(k2)) {
        // Seen along the edge, which is a point there.
        let (a1, a2) = (segment.a[k1], segment.a[k2]);
        x = a2.mul_add(to[k2], a1 * to[k1]) / a2.mul_add(a2, a1 * a1);
        y = x.mul_add(along, segment.p[axis]);
    } else {
        // Parallel: the first place on the axis that lies beside the edge.
        x = -one;
        y = (segment.p[axis] - along).clamp(-half, half);
        if square > R::zero() {
            x = (y - segment.p[axis]) * along / square;
        }
    }
    let mut end = y.abs() > half;
    if end {
        y = y.clamp(-half, half);
        x = y.mul_add(along, forward) / square;
    }
    if x.abs() > one {
        x = x.clamp(-one, one);
        let free = x.mul_add(along, segment.p[axis]);
        y = free.clamp(-half, half);
        end = end || free.abs() > half;
    }
    let mut at = mid;
    at[axis] = y;
    let gap = sub(&scale_add(x, &segment.a, &segment.p), &at);
    let upper = if end && y > R::zero() { upper | 1 << axis } else { upper };
    Nearest { x, square: dot(&gap, &gap), feature: Feature::Edge { axis, upper, end } }
}

/// How far from `x`, in the direction `sign`, until coordinate k leaves the box on its far side.
fn exit<R: Scalar>(segment: &Segment<R>, size: &Vec3<R>, x: R, sign: R, k: usize) -> R {
    let rate = sign * segment.a[k];
    if rate == R::zero() {
        return R::of(R::MAXVAL);
    }
    let far = if rate > R::zero() { size[k] } else { -size[k] };
    (far - x.mul_add(segment.a[k], segment.p[k])) / rate
}

/// How far until coordinate k has crossed the box's whole width.
fn width<R: Scalar>(segment: &Segment<R>, size: &Vec3<R>, k: usize) -> R {
    let rate = segment.a[k].abs();
    if rate == R::zero() { R::of(R::MAXVAL) } else { (size[k] + size[k]) / rate }
}

/// From an end over face k: to where the axis leaves the face.
fn along_face<R: Scalar>(segment: &Segment<R>, size: &Vec3<R>, x: R, k: usize) -> R {
    let sign = -x;
    let (k1, k2) = ((k + 1) % 3, (k + 2) % 3);
    let length = exit(segment, size, x, sign, k1).min(exit(segment, size, x, sign, k2)).min(R::of(2.0));
    sign.mul_add(length, x)
}

/// Whether the axis, followed upward, moves towards the box's inside along coordinate k, seen from the named side. One that keeps
/// still counts as moving down, as with MuJoCo.
fn inward<R: Scalar>(segment: &Segment<R>, upper: u8, k: usize) -> bool {
    (segment.a[k] > R::zero()) != (upper >> k & 1 == 1)
}

/// From beside an edge: over the face that the axis runs along more than the other. None if it runs over neither.
fn along_edge<R: Scalar>(segment: &Segment<R>, size: &Vec3<R>, x: R, axis: usize, upper: u8) -> Option<R> {
    let (k1, k2) = ((axis + 1) % 3, (axis + 2) % 3);
    if inward(segment, upper, k1) == inward(segment, upper, k2) {
        return None;
    }
    let k = if segment.a[k1].abs() > segment.a[k2].abs() { k1 } else { k2 };
    let sign = if inward(segment, upper, k) { R::one() } else { -R::one() };
    let crossed = width(segment, size, k);
    let length = crossed.min(exit(segment, size, x, sign, axis)).min(sign.neg_mul_add(x, R::one()));
    Some(sign.mul_add(length.max(R::zero()), x))
}

/// From beside a corner: in the direction in which the axis moves more inward than outward. None if it only leaves.
fn from_corner<R: Scalar>(segment: &Segment<R>, size: &Vec3<R>, x: R, upper: u8) -> Option<R> {
    let one = R::one();
    let sum = |inwards: bool| {
        let ks = (0..3).filter(|&k| inward(segment, upper, k) == inwards);
        ks.fold(R::zero(), |sum, k| segment.a[k].mul_add(segment.a[k], sum))
    };
    let (towards, away) = (sum(true), sum(false));
    if towards == R::zero() || away == R::zero() {
        return None;
    }
    let onward = towards > away;
    let sign = if onward { one } else { -one };
    let crossed = (0..3)
        .filter(|&k| inward(segment, upper, k) == onward)
        .fold(R::of(R::MAXVAL), |least, k| width(segment, size, k).min(least));
    Some(sign.mul_add(crossed.min(sign.neg_mul_add(x, one)), x))
}
