//! Several points where flat sides or straight edges of two shapes lie against each other.
//!
//! Of the sides that may touch, the two that face each other most squarely, within a small angle, are clipped to each other
//! (Sutherland and Hodgman, Reentrant polygon clipping, 1974), seen along the first one's normal; every corner of what they
//! share is a point, whose distance is that from the second one's plane, and whose normal is that side's. Of many corners,
//! four that span a large area are kept. Else an edge that lies nearly in a side's plane is clipped to that side, whose
//! normal its two points have. All this is where MuJoCo, of which the choice of points was found by experiment, has them.

use arrayvec::ArrayVec;
use glam::{DVec2, DVec3};

use super::Nearest;
use super::calipers::spanning;
use super::feature::{EDGE, Face, MOST, Side, each_edge, each_face};
use super::support::Solid;

/// Cosine of the largest angle between two sides that lie against each other.
const FACE: f64 = 0.996;
/// Least cosine of the angle between the contact normal and that of a side that an edge lies against, however deep it is beyond that. (Where
/// shapes touch with an edge, one of the sides on either hand faces elsewhere; MuJoCo takes that, too, if the other shape is as near it.)
const FACING: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Most corners of what two sides share: each side of a convex polygon that clips adds one at most.
const SHARED: usize = 2 * MOST;
/// Corners less deep than the deepest by less than this, relative to the shapes' size, count as equally deep where one
/// point stands for all.
const LEVEL: f64 = 1e-6;
/// Edges at an angle of a smaller sine count as parallel.
const PARALLEL: f64 = 1e-6;
/// A corner no farther beyond a side than this, relative to the shapes' size, lies on it.
const ROUNDING: f64 = 1e-12;
/// Differences below this, relative to the shapes' size, are rounding: of equals the first is taken.
const EQUAL: f64 = 1e-9;

/// A point of what two shapes share.
#[derive(Clone, Copy, Default)]
struct Corner {
    /// On the first of the two sides, or on the edge.
    at: DVec3,
    dist: f64,
}

/// What two shapes share.
struct Shared {
    corners: ArrayVec<Corner, SHARED>,
    /// Of an edge, which of its ends lie on the rim of the side.
    cut: [bool; 2],
    /// From the first shape to the second.
    normal: DVec3,
    /// Whether the corners are on the first shape, else on the second.
    on_first: bool,
}

impl Shared {
    /// Midway between the shapes.
    fn place(&self, corner: &Corner) -> DVec3 {
        let towards = if self.on_first { 0.5 } else { -0.5 };
        corner.at + self.normal * (towards * corner.dist)
    }
}

/// Adds the points within `include` of two shapes that touch with sides or edges, `most` at most; false if they touch otherwise.
pub(super) fn manifold(
    solids: &[Solid<'_>; 2],
    nearest: &Nearest,
    (include, most): (f64, usize),
    add: &mut impl FnMut(f64, DVec3, DVec3),
) -> bool {
    let size = solids.iter().map(|solid| solid.extent + solid.radius).sum();
    let dist = nearest.dist - solids[0].radius - solids[1].radius;
    let mut shared = Shared::new();
    let faced = shared.sides(solids, nearest.normal, size)
        || shared.edge_and_side(solids, nearest.normal, 2.0 * dist.min(0.0) - EQUAL * size);
    if !faced || shared.corners.is_empty() {
        let middle = edges_middle(solids, nearest.normal);
        middle.inspect(|at| add(dist, *at, nearest.normal));
        return middle.is_some();
    }
    if most == 1 {
        let middle = deepest_middle(&shared, size);
        middle.inspect(|at| add(dist, *at, nearest.normal));
        return middle.is_some();
    }
    shared.keep_within(include);
    for i in spanning(shared.corners.len(), |i| shared.corners[i].at).take(most) {
        let corner = &shared.corners[i];
        add(corner.dist, shared.place(corner), shared.normal);
    }
    !shared.corners.is_empty()
}

impl Shared {
    fn new() -> Self {
        Shared { corners: ArrayVec::new(), cut: [false; 2], normal: DVec3::ZERO, on_first: true }
    }

    /// What two sides share that face each other; false if none do.
    fn sides(&mut self, solids: &[Solid<'_>; 2], normal: DVec3, size: f64) -> bool {
        let mut best: Option<(f64, [Face<'_>; 2])> = None;
        each_face(&solids[0], normal, &mut |one| {
            let out = solids[0].rot * one.normal;
            each_face(&solids[1], -normal, &mut |other| {
                let facing = -out.dot(solids[1].rot * other.normal);
                if facing >= best.map_or(FACE, |(most, _)| most + ROUNDING) {
                    best = Some((facing, [one, other]));
                }
            });
        });
        if let Some((_, [one, other])) = best {
            self.clip_side(&one.place(&solids[0]), &other.place(&solids[1]), size);
        }
        best.is_some()
    }

    /// What the first side shares with the second: in the first one's plane, seen along its normal.
    fn clip_side(&mut self, one: &Side, other: &Side, size: f64) {
        let (outline, left) = &mut (Outline::new(), Outline::new());
        let (mut outline, mut left) = (outline, left);
        for corner in other.corners.iter().rev() {
            outline.push(*corner - one.normal * one.normal.dot(*corner - one.corners[0]));
        }
        // The order of corners is MuJoCo's, on which it depends which of many are kept.
        let count = one.corners.len();
        let backwards = |i: usize| one.corners[count - 1 - i % count];
        for i in 0..count {
            let (p, q) = (backwards(i), backwards(i + 1));
            clip(outline, p, one.normal.cross(q - p).normalize_or_zero(), ROUNDING * size, left);
            std::mem::swap(&mut outline, &mut left);
        }
        let height = |at: DVec3| other.normal.dot(at - other.corners[0]);
        self.corners.extend(outline.iter().map(|at| Corner { at: *at, dist: height(*at) }));
        (self.normal, self.on_first) = (-other.normal, true);
    }

    /// What an edge shares with a side in whose plane it lies nearly; false if none does. The first shape's edges are tried first. No side is
    /// taken that faces elsewhere and beyond which the edge is deeper than `deepest`.
    fn edge_and_side(&mut self, solids: &[Solid<'_>; 2], normal: DVec3, deepest: f64) -> bool {
        for (i, out) in [(0, normal), (1, -normal)] {
            let (edged, sided) = (&solids[i], &solids[1 - i]);
            let mut best: Option<([f64; 2], [DVec3; 2], Face<'_>)> = None;
            each_edge(edged, out, &mut |edge| {
                let along = (edge[1] - edge[0]).normalize_or_zero();
                each_face(sided, -out, &mut |face| {
                    let leaning = along.dot(sided.rot * face.normal).abs();
                    let most = if face.bare { PARALLEL } else { EDGE };
                    // The side that ranks first, then the edge that leans least.
                    let better = |[rank, least]: [f64; 2]| {
                        face.rank > rank + ROUNDING || (face.rank > rank - ROUNDING && leaning < least - ROUNDING)
                    };
                    if leaning <= most && best.is_none_or(|(known, ..)| better(known)) {
                        best = Some(([face.rank, leaning], edge, face));
                    }
                });
            });
            if let Some((_, edge, face)) = best {
                let side = face.place(sided);
                self.clip_edge(edge, &side);
                if side.normal.dot(-out) < FACING && self.corners.iter().any(|corner| corner.dist < deepest) {
                    self.corners.clear();
                    continue;
                }
                (self.normal, self.on_first) = (if i == 0 { -side.normal } else { side.normal }, i == 0);
                return true;
            }
        }
        false
    }

    /// The ends of the part of an edge that lies over a side.
    fn clip_edge(&mut self, [p, q]: [DVec3; 2], side: &Side) {
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        for (i, a) in side.corners.iter().enumerate() {
            let b = side.corners[(i + 1) % side.corners.len()];
            let out = (b - a).cross(side.normal);
            let (fp, fq) = (out.dot(p - a), out.dot(q - a));
            if fp > 0.0 && fq > 0.0 {
                to = -1.0;
            } else if fp > 0.0 {
                from = from.max(fp / (fp - fq));
            } else if fq > 0.0 {
                to = to.min(fp / (fp - fq));
            }
        }
        self.cut = [from > 0.0, to < 1.0];
        if from <= to {
            let corner = |at: DVec3| Corner { at, dist: side.normal.dot(at - side.corners[0]) };
            self.corners.extend([from, to].map(|t| corner(p.lerp(q, t))));
        }
    }

    /// Leaves out corners beyond `include`. Of an edge, a point on the side's rim counts twice if the other end is left out.
    fn keep_within(&mut self, include: f64) {
        if let Some(other) = (0..2).find(|&i| self.cut[i] && self.corners[1 - i].dist > include) {
            self.corners[1 - other] = self.corners[other];
        }
        self.corners.retain(|corner| corner.dist <= include);
    }
}

/// The middle of what two parallel edges share, midway between them; `None` if they are not parallel or share nothing.
fn edges_middle(solids: &[Solid<'_>; 2], normal: DVec3) -> Option<DVec3> {
    let mut found = None;
    each_edge(&solids[0], normal, &mut |one| {
        each_edge(&solids[1], -normal, &mut |other| found = found.or_else(|| middle(one, other)));
    });
    found
}

fn middle([p, q]: [DVec3; 2], other: [DVec3; 2]) -> Option<DVec3> {
    let along = (q - p).normalize_or_zero();
    let across = along.cross((other[1] - other[0]).normalize_or_zero());
    let [a, b] = other.map(|end| along.dot(end - p));
    let (from, to) = (a.min(b).max(0.0), a.max(b).min(along.dot(q - p)));
    if across.length() > PARALLEL || from > to || a == b {
        return None;
    }
    let middle = 0.5 * (from + to);
    let opposite = other[0].lerp(other[1], (middle - a) / (b - a));
    Some(0.5 * (p + along * middle + opposite))
}

/// The middle of the deepest corners; `None` if one alone is deepest.
fn deepest_middle(shared: &Shared, size: f64) -> Option<DVec3> {
    let corners = &shared.corners;
    let least = corners.iter().map(|corner| corner.dist).fold(f64::INFINITY, f64::min);
    let (u, v) = shared.normal.any_orthonormal_pair();
    let flat = |corner: &Corner| DVec2::new(corner.at.dot(u), corner.at.dot(v));
    let deepest = || corners.iter().filter(|corner| corner.dist <= least + LEVEL * size);
    let first = deepest().next()?;
    let from = flat(first);
    let (mut area, mut moment) = (0.0, DVec2::ZERO);
    for (a, b) in deepest().zip(deepest().skip(1)) {
        let (a, b) = (flat(a) - from, flat(b) - from);
        let twice = a.perp_dot(b);
        area += twice;
        moment += twice * (a + b) / 3.0;
    }
    if area.abs() > EQUAL * size * size {
        let off = moment / area;
        let at = first.at + u * off.x + v * off.y;
        return Some(shared.place(&Corner { at, dist: least }));
    }
    // An edge: between the corners that are farthest apart.
    let end = |from: DVec3| {
        let off = |corner: &&Corner| corner.at.distance_squared(from);
        deepest().max_by(|p, q| off(p).total_cmp(&off(q)))
    };
    let one = end(first.at)?;
    let other = end(one.at)?;
    let between = Corner { at: 0.5 * (one.at + other.at), dist: least };
    (one.at.distance(other.at) > EQUAL * size).then(|| shared.place(&between))
}

/// A polygon in a plane.
type Outline = ArrayVec<DVec3, SHARED>;

/// Puts the part of a polygon on the inner side of the plane through `p` with normal `out` into `left`.
fn clip(outline: &Outline, p: DVec3, out: DVec3, slack: f64, left: &mut Outline) {
    left.clear();
    let mut add = |at: DVec3| {
        // There is room for a corner more for each side; only a polygon that rounding has made concave may want more.
        if !left.is_full() {
            left.push(at);
        }
    };
    for (c, &a) in outline.iter().enumerate() {
        let b = outline[(c + 1) % outline.len()];
        let (fa, fb) = ((a - p).dot(out), (b - p).dot(out));
        if (fa < -slack && fb > slack) || (fa > slack && fb < -slack) {
            add(a + (b - a) * (fa / (fa - fb)));
        }
        if fb <= slack {
            add(b);
        }
    }
}
