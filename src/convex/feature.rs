//! The flat sides and straight edges of shapes that may lie against another shape.
//!
//! Where a shape touches with a corner, any side and any edge that meets there may lie nearly flat against the other shape;
//! where it touches with an edge, the sides on either hand and the edge itself; where with a side, that side alone. A disk
//! counts as a polygon of sixteen corners, and the line of a round side along which it is touched as an edge.

use arrayvec::ArrayVec;
use glam::DVec3;
use lanesim_kernels::model::{Hull, HullFace, Shape};

use super::support::{Solid, vertex};

/// Corners of a disk.
const CORNERS: usize = 16;
/// Most corners of a side.
pub(super) const MOST: usize = 512;
/// Largest sine of the angle by which an edge may lean out of a side's plane.
pub(super) const EDGE: f64 = 0.0888;
/// Points whose heights along the contact normal differ by less than this, relative to the shape's size, touch together.
const TOGETHER: f64 = 1e-7;

/// A polygon in place; its corners go round counterclockwise, seen from outside.
pub(super) struct Side {
    pub corners: ArrayVec<DVec3, MOST>,
    /// Outward.
    pub normal: DVec3,
}

/// A side of a shape, in its own axes.
#[derive(Clone, Copy)]
pub(super) struct Face<'a> {
    pub normal: DVec3,
    /// Whether only an edge that is parallel lies against it: a disk that is touched flat, of which MuJoCo knows a point only.
    pub bare: bool,
    /// How much it is preferred where an edge may lie against several: by how squarely it faces `out`; of a box, x before y before z,
    /// as with MuJoCo. (Of a mesh, MuJoCo takes the first in an order that nothing but its tables tells.)
    pub rank: f64,
    kind: Kind<'a>,
}

#[derive(Clone, Copy)]
enum Kind<'a> {
    /// Of a box, across an axis.
    Box(usize),
    /// Of a cylinder.
    Disk,
    Hull(&'a Hull, &'a HullFace),
}

impl Face<'_> {
    /// In place, its normal too.
    pub fn place(&self, solid: &Solid<'_>) -> Side {
        let s = solid.size;
        let mut side = Side { corners: ArrayVec::new(), normal: solid.rot * self.normal };
        let mut add = |corner: DVec3| side.corners.push(solid.place(corner));
        match self.kind {
            Kind::Box(k) => {
                let up = self.normal[k];
                let (u, v) = ((k + 1) % 3, (k + 2) % 3);
                for i in 0..4 {
                    let (x, y) = AROUND[if up > 0.0 { FIRST[0][k] + i } else { FIRST[1][k] + 4 - i } % 4];
                    let mut corner = DVec3::ZERO;
                    (corner[k], corner[u], corner[v]) = (up * s[k], x * s[u], y * s[v]);
                    add(corner);
                }
            }
            Kind::Disk => {
                let up = self.normal.z;
                for i in 1..=CORNERS {
                    let (sin, cos) = CIRCLE[i % CORNERS];
                    add(DVec3::new(s.x * cos, up * s.x * sin, up * s.y));
                }
            }
            Kind::Hull(hull, face) => {
                // Of a face with more corners, as many as there is room for, all around.
                let count = face.corners.len();
                let len = count.min(MOST);
                (0..len).for_each(|i| add(vertex(hull, face.corners[i * count / len])));
            }
        }
        side
    }
}

/// The sides that may lie against a shape in the direction `out`.
pub(super) fn each_face<'a>(solid: &Solid<'a>, out: DVec3, show: &mut dyn FnMut(Face<'a>)) {
    let d = solid.local(out);
    match solid.shape {
        Shape::Box => {
            for k in (0..3).filter(|&k| leans(solid, d, k)) {
                let mut normal = DVec3::ZERO;
                normal[k] = 1.0_f64.copysign(d[k]);
                show(Face { normal, bare: false, rank: -(k as f64), kind: Kind::Box(k) });
            }
        }
        Shape::Cylinder if d.z.abs() > TOGETHER => {
            let normal = DVec3::new(0.0, 0.0, 1.0_f64.copysign(d.z));
            show(Face { normal, bare: d.x.hypot(d.y) <= TOGETHER, rank: d.z.abs(), kind: Kind::Disk });
        }
        Shape::Mesh => {
            let Some(hull) = solid.hull else { return };
            let touched = Touched::new(hull, solid, d);
            for face in touched.faces() {
                let normal = DVec3::from_array(face.normal);
                show(Face { normal, bare: false, rank: normal.dot(d), kind: Kind::Hull(hull, face) });
            }
        }
        _ => {}
    }
}

/// The edges, in place, that may lie against a shape in the direction `out`.
pub(super) fn each_edge(solid: &Solid<'_>, out: DVec3, show: &mut dyn FnMut([DVec3; 2])) {
    let d = solid.local(out);
    let s = solid.size;
    let mut place = |ends: [DVec3; 2]| show(ends.map(|end| solid.place(end)));
    match solid.shape {
        Shape::Box => {
            let along = |k: usize| !leans(solid, d, k);
            let touching = (0..3).filter(|&k| along(k)).count();
            let corner = DVec3::new(s.x.copysign(d.x), s.y.copysign(d.y), s.z.copysign(d.z));
            for k in (0..3).filter(|&k| touching == 0 || (touching == 1 && along(k))) {
                let mut ends = [corner; 2];
                (ends[0][k], ends[1][k]) = (s[k], -s[k]);
                place(ends);
            }
        }
        Shape::Cylinder | Shape::Capsule => {
            let across = d.x.hypot(d.y);
            if across > TOGETHER && (solid.shape == Shape::Cylinder || d.z.abs() <= EDGE) {
                // That of a capsule is a little within its round side where the contact normal leans, as MuJoCo has it.
                let radius = if solid.shape == Shape::Cylinder { s.x / across } else { s.x };
                let rim = DVec3::new(d.x, d.y, 0.0) * radius;
                let up = DVec3::new(0.0, 0.0, s.y);
                place([rim + up, rim - up]);
            }
        }
        Shape::Mesh => {
            if let Some(hull) = solid.hull {
                Touched::new(hull, solid, d).edges(|ends| place(ends.map(|end| vertex(hull, end))));
            }
        }
        _ => {}
    }
}

/// Whether the corners of a box at the two ends of an axis are not touched together.
fn leans(solid: &Solid<'_>, d: DVec3, k: usize) -> bool {
    2.0 * solid.size[k] * d[k].abs() > TOGETHER * solid.extent
}

/// Most corners that are looked at of those that touch together.
const SPOTS: usize = 32;

/// What of a hull touches: how many of a face's corners do where most do.
struct Touched<'a> {
    hull: &'a Hull,
    top: u32,
    /// The corners that touch, the farthest first, then their neighbours: of a flat side with small slivers beside it, the farthest may be a
    /// corner of slivers alone.
    spots: ArrayVec<u32, SPOTS>,
    direction: DVec3,
    least: f64,
    most: usize,
}

impl<'a> Touched<'a> {
    fn new(hull: &'a Hull, solid: &Solid<'_>, direction: DVec3) -> Self {
        let top = hull.support(direction.to_array());
        let least = vertex(hull, top).dot(direction) - TOGETHER * solid.extent;
        let mut touched = Touched { hull, top, spots: ArrayVec::new(), direction, least, most: 0 };
        touched.find_spots();
        touched.most = touched.faces_at_spots().map(|face| touched.count(face)).max().unwrap_or(0).min(3);
        touched
    }

    fn find_spots(&mut self) {
        self.spots.push(self.top);
        let mut next = 0;
        while let Some(&spot) = self.spots.get(next) {
            next += 1;
            for neighbour in self.hull.neighbours(spot) {
                if self.touches(*neighbour) && !self.spots.contains(neighbour) && !self.spots.is_full() {
                    self.spots.push(*neighbour);
                }
            }
        }
    }

    /// The faces that meet at the corners that touch, each once.
    fn faces_at_spots(&self) -> impl Iterator<Item = &'a HullFace> {
        let met = |before: usize, face: &HullFace| self.spots[..before].iter().any(|spot| face.corners.contains(spot));
        let spots = self.spots.iter().enumerate();
        spots.flat_map(move |(i, spot)| self.hull.faces_at(*spot).filter(move |face| !met(i, face)))
    }

    fn touches(&self, corner: u32) -> bool {
        vertex(self.hull, corner).dot(self.direction) >= self.least
    }

    fn count(&self, face: &HullFace) -> usize {
        face.corners.iter().filter(|corner| self.touches(**corner)).count()
    }

    fn faces(&self) -> impl Iterator<Item = &'a HullFace> {
        self.faces_at_spots().filter(|face| self.count(face) >= self.most)
    }

    /// None where a face touches, the one that touches, or all that meet at the corner.
    fn edges(&self, mut show: impl FnMut([u32; 2])) {
        for face in self.hull.faces_at(self.top).filter(|_| self.most < 3) {
            let count = face.corners.len();
            for i in 0..count {
                let ends = [face.corners[i], face.corners[(i + 1) % count]];
                let touching = ends.iter().filter(|end| self.touches(**end)).count();
                if ends.contains(&self.top) && touching == self.most {
                    show(ends);
                }
            }
        }
    }
}

/// Corners of a rectangle, counterclockwise.
const AROUND: [(f64, f64); 4] = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
/// Which of them MuJoCo has first, by axis, of the upper and the lower side: what is kept of many points depends on it.
const FIRST: [[usize; 3]; 2] = [[1, 3, 2], [2, 2, 3]];

/// Sine and cosine of multiples of π/8.
const CIRCLE: [(f64, f64); CORNERS] = {
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
