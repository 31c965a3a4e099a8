//! Several points where flat sides or straight edges of two shapes lie against each other.
//!
//! Along the contact normal each shape shows a face, an edge or neither, within a small angle. Faces and edges are seen
//! along the normal, one clipped to the other (Sutherland and Hodgman, Reentrant polygon clipping, 1974), and every corner
//! of what they share is a point whose distance is that between the two planes along the normal. A disk counts as a
//! polygon of sixteen corners.

use glam::{DVec2, DVec3};
use lanesim_kernels::model::{Hull, HullFace, Shape};

use super::Nearest;
use super::support::{Solid, vertex};

/// Cosine of the largest angle between a face's normal and the contact normal.
const FACE: f64 = 0.996;
/// Largest sine of the angle by which an edge may lean out of the contact plane.
const EDGE: f64 = 0.0888;
/// Corners of a disk.
const DISK: usize = 16;
/// Most corners: each side of a convex polygon that clips adds one at most.
const CORNERS: usize = 2 * DISK;
/// Most points of a manifold.
const POINTS: usize = 4;
/// Corners less deep than the deepest by less than this, relative to the shapes' size, count as equally deep where one
/// point stands for all.
const LEVEL: f64 = 1e-6;
/// Edges at an angle of a smaller sine count as parallel.
const PARALLEL: f64 = 1e-4;
/// A corner no farther beyond a side than this, relative to the shapes' size, lies on it.
const ROUNDING: f64 = 1e-12;
/// Differences below this, relative to the shapes' size, are rounding: of equals the first is taken, in the order of the
/// shapes' own corners.
const EQUAL: f64 = 1e-9;

/// What a shape shows along the normal: a point on it and a polygon (or the two ends of an edge) in place.
#[derive(Clone, Copy)]
struct Feature {
    len: usize,
    corners: [DVec3; DISK],
}

impl Feature {
    fn of(corners: &[DVec3], solid: &Solid<'_>, out: DVec3) -> Feature {
        let mut feature = Feature { len: corners.len().min(DISK), corners: [DVec3::ZERO; DISK] };
        for (place, corner) in feature.corners.iter_mut().zip(corners) {
            *place = solid.place(*corner) + out * solid.radius;
        }
        feature
    }

    /// A normal of the feature's plane: for an edge, of the plane through it that faces the contact normal.
    fn normal(&self, towards: DVec3) -> DVec3 {
        let along = self.corners[1] - self.corners[0];
        let across = if self.len > 2 { self.corners[2] - self.corners[0] } else { along.cross(towards) };
        let normal = along.cross(across).normalize_or(towards);
        if normal.dot(towards) < 0.0 { -normal } else { normal }
    }
}

/// The face or edge that a solid shows in the direction `out`.
fn feature(solid: &Solid<'_>, out: DVec3) -> Option<Feature> {
    let d = solid.local(out);
    let s = solid.size;
    match solid.shape {
        Shape::Box => {
            if let Some(k) = (0..3).find(|&k| d[k].abs() >= FACE) {
                let (u, v) = ((k + 1) % 3, (k + 2) % 3);
                let corner = |x: f64, y: f64| {
                    let mut p = DVec3::ZERO;
                    (p[k], p[u], p[v]) = (s[k].copysign(d[k]), x * s[u], y * s[v]);
                    p
                };
                let face = [corner(1.0, 1.0), corner(-1.0, 1.0), corner(-1.0, -1.0), corner(1.0, -1.0)];
                return Some(Feature::of(&face, solid, out));
            }
            let k = (0..3).find(|&k| d[k].abs() <= EDGE)?;
            let mut ends = [DVec3::new(s.x.copysign(d.x), s.y.copysign(d.y), s.z.copysign(d.z)); 2];
            (ends[0][k], ends[1][k]) = (s[k], -s[k]);
            Some(Feature::of(&ends, solid, out))
        }
        Shape::Cylinder if d.z.abs() >= FACE => {
            let disk: [DVec3; DISK] = std::array::from_fn(|i| {
                let (sin, cos) = CIRCLE[i];
                DVec3::new(s.x * cos, s.x * sin, s.y.copysign(d.z))
            });
            Some(Feature::of(&disk, solid, out))
        }
        Shape::Cylinder if d.z.abs() <= EDGE => {
            let rim = DVec3::new(d.x, d.y, 0.0) * (s.x / d.x.hypot(d.y));
            let up = DVec3::new(0.0, 0.0, s.y);
            Some(Feature::of(&[rim + up, rim - up], solid, out))
        }
        Shape::Capsule if d.z.abs() <= EDGE => {
            let up = DVec3::new(0.0, 0.0, s.y);
            Some(Feature::of(&[up, -up], solid, out))
        }
        Shape::Mesh => solid.hull.and_then(|hull| of_hull(hull, solid, d, out)),
        _ => None,
    }
}

/// The face or edge that a hull shows in the direction `d` of its own axes, `out` in place: at the vertex that is farthest out.
fn of_hull(hull: &Hull, solid: &Solid<'_>, d: DVec3, out: DVec3) -> Option<Feature> {
    let top = hull.support(d.to_array());
    let facing = |face: &&HullFace| DVec3::from_array(face.normal).dot(d);
    if let Some(face) = hull.faces_at(top).max_by(|a, b| facing(a).total_cmp(&facing(b))).filter(|f| facing(f) >= FACE)
    {
        // Of a face with more corners, as many as there is room for, all around.
        let count = face.corners.len();
        let kept = count.min(DISK);
        let corners: [DVec3; DISK] =
            std::array::from_fn(|i| vertex(hull, face.corners[i.min(kept - 1) * count / kept]));
        return Some(Feature::of(&corners[..kept], solid, out));
    }
    let end = vertex(hull, top);
    let steep = |other: &u32| (end - vertex(hull, *other)).normalize_or_zero().dot(d).abs();
    let other =
        hull.neighbours(top).iter().min_by(|a, b| steep(a).total_cmp(&steep(b))).filter(|o| steep(o) <= EDGE)?;
    Some(Feature::of(&[end, vertex(hull, *other)], solid, out))
}

/// A corner of the shared outline, seen along the normal, and its distance.
#[derive(Clone, Copy, Default)]
struct Corner {
    at: DVec2,
    dist: f64,
}

/// Adds the points of two flat features, `most` at most; false if the shapes touch otherwise or nothing is shared.
///
/// Their common normal is that of a face: of two, the one that separates more.
pub(super) fn manifold(
    solids: &[Solid<'_>; 2],
    nearest: &Nearest,
    most: usize,
    add: &mut impl FnMut(f64, DVec3, DVec3),
) -> bool {
    let (Some(first), Some(second)) = (feature(&solids[0], nearest.normal), feature(&solids[1], -nearest.normal))
    else {
        return false;
    };
    let [radius1, radius2] = [solids[0].radius, solids[1].radius];
    let dist = nearest.dist - radius1 - radius2;
    if first.len < 3 && second.len < 3 {
        let middle = edges_middle(&first, &second);
        middle.inspect(|at| add(dist, *at, nearest.normal));
        return middle.is_some();
    }
    let size = solids[0].extent + solids[1].extent + radius1 + radius2;
    let view = View::new(solids, [&first, &second], nearest.normal);
    let mut corners = [Corner::default(); CORNERS];
    let len = view.shared([&first, &second], size, &mut corners);
    if most == 1 {
        let middle = deepest_middle(&corners[..len], size);
        middle.inspect(|at| add(dist, view.place(*at), nearest.normal));
        return middle.is_some();
    }
    for corner in spread(&corners[..len], most.min(POINTS), size).into_iter().flatten() {
        add(corner.dist, view.place(corner.at), view.normal);
    }
    len > 0
}

/// The middle of what two parallel edges share, midway between them; `None` if they are not parallel or share nothing.
fn edges_middle(first: &Feature, second: &Feature) -> Option<DVec3> {
    let [p, q] = [first.corners[0], first.corners[1]];
    let along = (q - p).normalize_or_zero();
    let across = along.cross((second.corners[1] - second.corners[0]).normalize_or_zero());
    let [a, b] = [second.corners[0], second.corners[1]].map(|end| along.dot(end - p));
    let (from, to) = (a.min(b).max(0.0), a.max(b).min(along.dot(q - p)));
    if across.length() > PARALLEL || from > to || a == b {
        return None;
    }
    let middle = 0.5 * (from + to);
    let opposite = second.corners[0].lerp(second.corners[1], (middle - a) / (b - a));
    Some(0.5 * (p + along * middle + opposite))
}

/// The middle of the deepest corners; `None` if one alone is deepest.
fn deepest_middle(corners: &[Corner], size: f64) -> Option<DVec2> {
    let least = corners.iter().map(|corner| corner.dist).fold(f64::INFINITY, f64::min);
    let deepest = || corners.iter().filter(|corner| corner.dist <= least + LEVEL * size).map(|corner| corner.at);
    let first = deepest().next()?;
    let (mut area, mut moment) = (0.0, DVec2::ZERO);
    for (a, b) in deepest().zip(deepest().skip(1)) {
        let twice = (a - first).perp_dot(b - first);
        area += twice;
        moment += twice * (a + b - 2.0 * first) / 3.0;
    }
    if area.abs() > EQUAL * size * size {
        return Some(first + moment / area);
    }
    // An edge: between the corners that are farthest apart.
    let end = |from: DVec2| deepest().max_by(|p, q| p.distance_squared(from).total_cmp(&q.distance_squared(from)));
    let (one, other) = (end(first)?, end(end(first)?)?);
    (one.distance(other) > EQUAL * size).then_some(0.5 * (one + other))
}

/// Two features, seen along the normal.
struct View {
    normal: DVec3,
    u: DVec3,
    v: DVec3,
    /// The features' planes n · p = d.
    planes: [(DVec3, f64); 2],
}

impl View {
    fn new(solids: &[Solid<'_>; 2], features: [&Feature; 2], normal: DVec3) -> View {
        let normal = snap(solids, features, normal);
        let (u, v) = normal.any_orthonormal_pair();
        View { normal, u, v, planes: features.map(|feature| plane(feature, normal)) }
    }

    fn flat(&self, p: DVec3) -> DVec2 {
        DVec2::new(p.dot(self.u), p.dot(self.v))
    }

    /// Height along the normal at which a plane is met.
    fn lift(&self, at: DVec2, (n, d): (DVec3, f64)) -> f64 {
        (d - at.x * self.u.dot(n) - at.y * self.v.dot(n)) / self.normal.dot(n)
    }

    /// Midway between the planes.
    fn place(&self, at: DVec2) -> DVec3 {
        let middle = 0.5 * (self.lift(at, self.planes[0]) + self.lift(at, self.planes[1]));
        self.u * at.x + self.v * at.y + self.normal * middle
    }

    /// The corners of what the features share; their number.
    fn shared(&self, [first, second]: [&Feature; 2], size: f64, corners: &mut [Corner; CORNERS]) -> usize {
        // An edge is clipped to a face; of two faces, the second to the first.
        let (base, other) = if first.len > 2 { (first, second) } else { (second, first) };
        let mut outline = Outline { len: 0, corners: [DVec2::ZERO; CORNERS] };
        for corner in &other.corners[..other.len] {
            outline.push(self.flat(*corner));
        }
        let centre: DVec2 = base.corners[..base.len].iter().map(|p| self.flat(*p)).sum::<DVec2>() / base.len as f64;
        for i in 0..base.len {
            let (p, q) = (self.flat(base.corners[i]), self.flat(base.corners[(i + 1) % base.len]));
            let out = DVec2::new(q.y - p.y, p.x - q.x);
            let out = if out.dot(centre - p) > 0.0 { -out } else { out };
            outline = outline.clip(p, out.normalize_or_zero(), other.len > 2, ROUNDING * size);
        }
        for (corner, at) in corners.iter_mut().zip(&outline.corners[..outline.len]) {
            let [low, high] = self.planes.map(|plane| self.lift(*at, plane));
            *corner = Corner { at: *at, dist: high - low };
        }
        outline.len
    }
}

/// The normal of the features' faces along which the solids are farthest apart.
fn snap(solids: &[Solid<'_>; 2], features: [&Feature; 2], normal: DVec3) -> DVec3 {
    let mut best = (f64::NEG_INFINITY, normal);
    for feature in features.into_iter().filter(|f| f.len > 2) {
        let n = feature.normal(normal);
        let apart = n.dot(solids[1].support(-n) - solids[0].support(n));
        if apart > best.0 + EQUAL * (solids[0].extent + solids[1].extent) {
            best = (apart, n);
        }
    }
    best.1
}

/// The feature's plane n · p = d.
fn plane(feature: &Feature, towards: DVec3) -> (DVec3, f64) {
    let n = feature.normal(towards);
    (n, n.dot(feature.corners[0]))
}

/// A polygon, or a segment, seen along the normal.
struct Outline {
    len: usize,
    corners: [DVec2; CORNERS],
}

impl Outline {
    fn push(&mut self, corner: DVec2) {
        if let Some(place) = self.corners.get_mut(self.len) {
            *place = corner;
            self.len += 1;
        }
    }

    /// The part on the inner side of the line through `p` with normal `out`.
    fn clip(&self, p: DVec2, out: DVec2, closed: bool, slack: f64) -> Outline {
        let mut left = Outline { len: 0, corners: [DVec2::ZERO; CORNERS] };
        for c in 0..self.len {
            let (a, b) = (self.corners[c], self.corners[(c + 1) % self.len]);
            let (fa, fb) = ((a - p).dot(out), (b - p).dot(out));
            if fa <= slack {
                left.push(a);
            }
            let crosses = (fa < -slack && fb > slack) || (fa > slack && fb < -slack);
            // The last side of a segment is its first one backwards.
            if crosses && (closed || c + 1 < self.len) {
                left.push(a + (b - a) * (fa / (fa - fb)));
            }
        }
        left
    }
}

/// Up to `most` corners that span the outline: the deepest, the one farthest from it, and the farthest on either side of
/// the line through both.
fn spread(corners: &[Corner], most: usize, size: f64) -> [Option<Corner>; POINTS] {
    let mut kept = [None; POINTS];
    if corners.len() <= most {
        for (place, corner) in kept.iter_mut().zip(corners) {
            *place = Some(*corner);
        }
        return kept;
    }
    let pick = |unit: f64, value: &dyn Fn(&Corner) -> f64| {
        let mut best = corners[0];
        for corner in &corners[1..] {
            if value(corner) > value(&best) + EQUAL * unit {
                best = *corner;
            }
        }
        best
    };
    let deepest = pick(size, &|c| -c.dist);
    let farthest = pick(size * size, &|c| c.at.distance_squared(deepest.at));
    let across = (farthest.at - deepest.at).perp();
    let left = pick(size * size, &|c| (c.at - deepest.at).dot(across));
    let right = pick(size * size, &|c| -(c.at - deepest.at).dot(across));
    for (place, corner) in kept.iter_mut().zip([deepest, farthest, left, right]).take(most) {
        *place = Some(corner);
    }
    kept
}

/// Sine and cosine of multiples of π/8.
const CIRCLE: [(f64, f64); DISK] = {
    // cos π/8 and sin π/8
    let (c, s) = (0.923_879_532_511_286_7, 0.382_683_432_365_089_8);
    let h = std::f64::consts::FRAC_1_SQRT_2;
    [
        (0.0, 1.0),
        (s, c),
        (h, h),
        (c, s),
        (1.0, 0.0),
        (c, -s),
        (h, -h),
        (s, -c),
        (0.0, -1.0),
        (-s, -c),
        (-h, -h),
        (-c, -s),
        (-1.0, 0.0),
        (-c, s),
        (-h, h),
        (-s, c),
    ]
};
