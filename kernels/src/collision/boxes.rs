//! Box against box.
//!
//! The separating axis test over the six face normals and the nine products of edges (Gottschalk, Lin, Manocha, OBBTree,
//! 1996; Ericson, Real-Time Collision Detection, 2005, §4.4.1) finds the direction of least overlap. If it is a face's,
//! the other box's opposing face is clipped to it (Sutherland and Hodgman, 1974); if it is an edge pair's, the nearest
//! points of the two edges are the one contact. Faces are preferred where both say nearly the same: several points that
//! persist rest better than one that jumps.

use super::Body;
use super::single::{Point, Points};
use crate::lane::{Lane, LaneQuery, Real, Scalar};
use crate::math::vec3::{Mat3, Vec3, add, column, dot, mul, mul_t, neg, scale, scale_add, sub, zero};

/// An edge pair's direction within this cosine of the best face's ...
const SAME_DIRECTION: f64 = 0.99;
/// ... must separate more by this fraction of the face's separation to be taken.
const EDGE_GAIN: f64 = 0.05;

/// Corners of a face are one if they are nearer to each other than this many roundings.
const SAME_CORNER: f64 = 16.0;

/// A direction that separates, or overlaps least.
#[derive(Clone, Copy, Debug)]
struct Axis<L> {
    /// Separation along it, negative: overlap.
    separation: L,
    /// Which: 0-2 faces of the first box, 3-5 of the second; or 3 i + j for the edges i and j.
    index: L,
    /// Direction from the first box to the second, in the first box's axes; of edge pairs only.
    direction: Vec3<L>,
}

impl<L: Lane> Axis<L> {
    fn none() -> Self {
        Axis { separation: L::of(-L::Real::MAXVAL), index: L::zero(), direction: zero() }
    }

    /// The other in the worlds of the mask.
    fn or(self, mask: L::Mask, other: Axis<L>) -> Self {
        let pick = |a: L, b: L| L::select(mask, a, b);
        Axis {
            separation: pick(other.separation, self.separation),
            index: pick(other.index, self.index),
            direction: std::array::from_fn(|k| pick(other.direction[k], self.direction[k])),
        }
    }
}

/// The second box as the first one sees it.
#[derive(Clone, Copy, Debug)]
struct Relative<L> {
    pos: Vec3<L>,
    rot: Mat3<L>,
}

fn relative<L: Lane>(a: &Body<L>, b: &Body<L>) -> Relative<L> {
    let rot = std::array::from_fn(|k| dot(&column(&a.rot, k / 3), &column(&b.rot, k % 3)));
    Relative { pos: mul_t(&a.rot, &sub(&b.pos, &a.pos)), rot }
}

/// Lengths below this compare as equal: a few roundings of the boxes' sizes.
fn slack<L: Lane>(a: &Body<L>, b: &Body<L>) -> L {
    let largest = |s: &Vec3<L>| s[0].max(s[1]).max(s[2]);
    (largest(&a.size) + largest(&b.size)) * L::of(32.0 * L::Real::EPSILON)
}

/// What decides how two boxes touch, which does without branches: all worlds of a block at once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axes<L> {
    to: Relative<L>,
    face: Axis<L>,
    edges: Axis<L>,
}

impl<L: Lane> Axes<L> {
    /// That of two boxes.
    pub fn new(a: &Body<L>, b: &Body<L>) -> Self {
        let to = relative(a, b);
        Axes { face: best_face(a, b, &to), edges: best_edges(a, b, &to), to }
    }
}

impl<L: LaneQuery> Axes<L> {
    /// That of one world.
    pub fn lane(&self, i: usize) -> Axes<L::Real> {
        let axis = |axis: &Axis<L>| Axis {
            separation: axis.separation.get(i),
            index: axis.index.get(i),
            direction: axis.direction.map(|x| x.get(i)),
        };
        let to = Relative { pos: self.to.pos.map(|x| x.get(i)), rot: self.to.rot.map(|x| x.get(i)) };
        Axes { to, face: axis(&self.face), edges: axis(&self.edges) }
    }
}

/// The face normal that separates most; the first of those that are equal up to rounding.
fn best_face<L: Lane>(a: &Body<L>, b: &Body<L>, to: &Relative<L>) -> Axis<L> {
    let back = mul_t(&to.rot, &to.pos);
    let reach = |s: &Vec3<L>, along: Vec3<L>| dot(s, &along.map(L::abs));
    let slack = slack(a, b);
    let mut best = Axis::none();
    for index in 0..6 {
        let k = index % 3;
        let separation = if index < 3 {
            let row = [to.rot[3 * k], to.rot[3 * k + 1], to.rot[3 * k + 2]];
            to.pos[k].abs() - a.size[k] - reach(&b.size, row)
        } else {
            back[k].abs() - b.size[k] - reach(&a.size, column(&to.rot, k))
        };
        let better = separation.gt(best.separation + slack);
        best = best.or(better, Axis { separation, index: L::of(index as f64), direction: zero() });
    }
    best
}

/// The product of edges that separates most; edges that are nearly parallel have none.
fn best_edges<L: Lane>(a: &Body<L>, b: &Body<L>, to: &Relative<L>) -> Axis<L> {
    let mut best = Axis::none();
    for index in 0..9 {
        let (i, j) = (index / 3, index % 3);
        let (i1, i2, j1, j2) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        // e_i × the second box's axis j.
        let mut axis = zero();
        axis[i1] = -to.rot[3 * i2 + j];
        axis[i2] = to.rot[3 * i1 + j];
        let square = dot(&axis, &axis);
        let parallel = square.lt(L::of(64.0 * L::Real::EPSILON));
        let along = dot(&axis, &to.pos);
        let reach1 = a.size[i1].mul_add(axis[i1].abs(), a.size[i2] * axis[i2].abs());
        // The second box's other two axes along it: e_i · (c_j × c_j1) = ± c_j2 along e_i.
        let reach2 = b.size[j1].mul_add(to.rot[3 * i + j2].abs(), b.size[j2] * to.rot[3 * i + j1].abs());
        let inverse = L::one() / square.sqrt();
        let separation = (along.abs() - reach1 - reach2) * inverse;
        let sign = L::select(along.lt(L::zero()), -inverse, inverse);
        let found = Axis { separation, index: L::of(index as f64), direction: scale(sign, &axis) };
        best = best.or(!parallel & separation.gt(best.separation), found);
    }
    best
}

/// Cosine between a face's normal and an edge pair's direction.
fn agreement<R: Scalar>(to: &Relative<R>, face: usize, edges: &Axis<R>) -> R {
    if face < 3 { edges.direction[face].abs() } else { dot(&column(&to.rot, face - 3), &edges.direction).abs() }
}

/// The points within `include`.
pub(super) fn boxes<R: Scalar>(a: &Body<R>, b: &Body<R>, axes: &Axes<R>, include: R, points: &mut Points<R>) {
    let Axes { to, face, edges } = axes;
    if face.separation > include || edges.separation > include {
        return;
    }
    let of_face = face.index.to_f64() as usize;
    let same = agreement(to, of_face, edges) > R::of(SAME_DIRECTION);
    let least = if same { face.separation.abs() * R::of(EDGE_GAIN) } else { R::zero() };
    if edges.separation > face.separation + least + slack(a, b) {
        points.push(crossing(a, b, to, edges));
    } else if of_face < 3 {
        clipped((a, b, to), of_face, include, false, points);
    } else {
        clipped((b, a, &relative(b, a)), of_face - 3, include, true, points);
    }
}

/// The nearest points of the two edges that face each other along the direction (Ericson, §5.1.9).
fn crossing<R: Scalar>(a: &Body<R>, b: &Body<R>, to: &Relative<R>, edges: &Axis<R>) -> Point<R> {
    let index = edges.index.to_f64() as usize;
    let (i, j) = (index / 3, index % 3);
    let normal = edges.direction;
    let toward = |x: R, size: R| if x < R::zero() { -size } else { size };
    // Midpoints of the edges, in the first box's axes.
    let mut mid1: Vec3<R> = std::array::from_fn(|k| toward(normal[k], a.size[k]));
    mid1[i] = R::zero();
    let back = mul_t(&to.rot, &normal);
    let mut mid2: Vec3<R> = std::array::from_fn(|k| -toward(back[k], b.size[k]));
    mid2[j] = R::zero();
    let mid2 = add(&to.pos, &mul(&to.rot, &mid2));
    let along2 = column(&to.rot, j);
    let between = sub(&mid2, &mid1);
    let (cos, u, v) = (along2[i], between[i], dot(&between, &along2));
    let (half1, half2) = (a.size[i], b.size[j]);
    // Not parallel: `best_edges` has seen to it.
    let x1 = (cos.neg_mul_add(v, u) / cos.neg_mul_add(cos, R::one())).clamp(-half1, half1);
    let x2 = x1.mul_add(cos, -v).clamp(-half2, half2);
    let x1 = x2.mul_add(cos, u).clamp(-half1, half1);
    mid1[i] = x1;
    let at2 = scale_add(x2, &along2, &mid2);
    let middle = scale(R::of(0.5), &add(&mid1, &at2));
    Point { dist: edges.separation, pos: add(&a.pos, &mul(&a.rot, &middle)), normal: mul(&a.rot, &normal) }
}

/// A polygon of up to eight corners: a face clipped by four planes.
struct Polygon<R> {
    len: usize,
    /// Corners nearer to each other than this are one.
    same: R,
    corners: [Vec3<R>; 8],
}

impl<R: Scalar> Polygon<R> {
    fn push(&mut self, corner: Vec3<R>) {
        let near = |other: &Vec3<R>| sub(&corner, other).iter().all(|x| x.abs() <= self.same);
        let known = &self.corners[..self.len];
        if known.first().is_some_and(near) || known.last().is_some_and(near) {
            return;
        }
        if let Some(place) = self.corners.get_mut(self.len) {
            *place = corner;
            self.len += 1;
        }
    }

    /// Leaves the part where `sign` times coordinate k is at most `limit`.
    fn clip(&mut self, k: usize, sign: R, limit: R, slack: R) {
        let mut beyond = [R::zero(); 8];
        for (f, p) in beyond.iter_mut().zip(&self.corners[..self.len]) {
            *f = sign.mul_add(p[k], -limit);
        }
        if beyond[..self.len].iter().all(|f| *f <= slack) {
            return;
        }
        let mut out = Polygon { len: 0, same: self.same, corners: [zero(); 8] };
        for c in 0..self.len {
            let next = if c + 1 == self.len { 0 } else { c + 1 };
            let (p, q) = (&self.corners[c], &self.corners[next]);
            let (fp, fq) = (beyond[c], beyond[next]);
            if fp <= slack {
                out.push(*p);
            }
            if (fp < -slack && fq > slack) || (fp > slack && fq < -slack) {
                out.push(scale_add(fp / (fp - fq), &sub(q, p), p));
            }
        }
        *self = out;
    }
}

/// The face of `other` that opposes face `k` of `base`, clipped to that face's sides: a point for every corner within
/// `include`, midway between the corner and the face. `swapped`: `base` is the pair's second box.
fn clipped<R: Scalar>(
    (base, other, to): (&Body<R>, &Body<R>, &Relative<R>),
    k: usize,
    include: R,
    swapped: bool,
    points: &mut Points<R>,
) {
    let sign = if to.pos[k] < R::zero() { -R::one() } else { R::one() };
    let row = [to.rot[3 * k], to.rot[3 * k + 1], to.rot[3 * k + 2]];
    let mut j = 0;
    for m in 1..3 {
        if row[m].abs() > row[j].abs() {
            j = m;
        }
    }
    let facing = if row[j] * sign > R::zero() { -other.size[j] } else { other.size[j] };
    let centre = scale_add(facing, &column(&to.rot, j), &to.pos);
    let (u, v) = ((j + 1) % 3, (j + 2) % 3);
    let u = scale(other.size[u], &column(&to.rot, u));
    let v = scale(other.size[v], &column(&to.rot, v));
    let slack = slack(base, other);
    let mut polygon = Polygon { len: 0, same: slack * R::of(SAME_CORNER), corners: [zero(); 8] };
    for corner in [add(&u, &v), sub(&v, &u), neg(&add(&u, &v)), sub(&u, &v)] {
        polygon.push(add(&centre, &corner));
    }
    for side in [(k + 1) % 3, (k + 2) % 3] {
        for sign in [R::one(), -R::one()] {
            polygon.clip(side, sign, base.size[side], slack);
        }
    }
    let mut normal = zero();
    normal[k] = if swapped { -sign } else { sign };
    let normal = mul(&base.rot, &normal);
    for corner in &polygon.corners[..polygon.len] {
        let dist = sign.mul_add(corner[k], -base.size[k]);
        if dist <= include {
            let mut middle = *corner;
            middle[k] = sign * dist.mul_add(R::of(0.5), base.size[k]);
            points.push(Point { dist, pos: add(&base.pos, &mul(&base.rot, &middle)), normal });
        }
    }
}
