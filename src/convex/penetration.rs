//! Penetration of two cores: the expanding polytope algorithm (van den Bergen, Proximity Queries and Penetration Depth
//! Computation on 3D Game Objects, 2001).
//!
//! The polytope starts as a tetrahedron of extreme points of the difference, whether or not it holds the origin: faces
//! are ranked by signed distance, so a face that the origin is beyond is expanded first.

use glam::DVec3;

use super::Nearest;
use super::support::{Solid, Vertex, combine, difference};

/// Most vertices.
const VERTICES: usize = 224;
/// Most faces: 2 V - 4 of a closed polytope, and some room.
const FACES: usize = 2 * VERTICES;
/// Most edges of the hole that a new vertex tears.
const EDGES: usize = 3 * VERTICES;
/// Accuracy of the depth, relative to the shapes' size.
const TOLERANCE: f64 = 1e-11;

/// Faces whose distances differ by less, relative to the shapes' size, may share the nearest point.
const SAME: f64 = 1e-9;

/// Faces are told apart by distance if it differs by more than this, relative to the shapes' size.
const EQUAL: f64 = 1e-13;

/// Height below which a triangle is a sliver, relative to the shapes' size.
const SLIVER: f64 = 1e-12;

/// A triangle, its outward normal and signed distance from the origin.
#[derive(Clone, Copy, Default)]
struct Face {
    corners: [u16; 3],
    normal: DVec3,
    distance: f64,
}

struct Polytope {
    nvertex: usize,
    nface: usize,
    nedge: usize,
    vertices: [Vertex; VERTICES],
    faces: [Face; FACES],
    edges: [(u16, u16); EDGES],
}

/// Depth, normal and points of cores that penetrate or nearly touch; `size` is a length of the order of the shapes'.
pub(super) fn penetration(solids: &[Solid<'_>; 2], size: f64) -> Nearest {
    let mut polytope = Polytope {
        nvertex: 0,
        nface: 0,
        nedge: 0,
        vertices: [Vertex::default(); VERTICES],
        faces: [Face::default(); FACES],
        edges: [(0, 0); EDGES],
    };
    polytope.start(solids, size);
    let mut best = polytope.least(size);
    while polytope.nvertex < VERTICES {
        let vertex = difference(solids, best.normal);
        if best.normal.dot(vertex.at) - best.distance <= TOLERANCE * size || !polytope.expand(&best, vertex, size) {
            break;
        }
        best = polytope.least(size);
    }
    let on = polytope.points(&best, size);
    // The second solid leaves the first by moving against the normal of the face: the origin then reaches that face.
    Nearest { dist: -best.distance, normal: -best.normal, on }
}

/// The point of a triangle near `at`, a point of its plane: weights of the corners, and the distance from `at`.
fn weights(corners: &[Vertex; 3], at: DVec3) -> ([f64; 3], f64) {
    let [a, b, c] = corners.map(|x| x.at - at);
    let normal = (b - a).cross(c - a);
    let w = [b.cross(c), c.cross(a), a.cross(b)].map(|x| x.dot(normal).max(0.0));
    let sum = w[0] + w[1] + w[2];
    let w = if sum > 0.0 { w.map(|x| x / sum) } else { [1.0, 0.0, 0.0] };
    (w, (a * w[0] + b * w[1] + c * w[2]).length())
}

impl Polytope {
    /// A tetrahedron of extreme points: along an axis, away from that line, away from that plane.
    fn start(&mut self, solids: &[Solid<'_>; 2], size: f64) {
        let farther = |direction: DVec3, from: Vertex| {
            let (p, q) = (difference(solids, direction), difference(solids, -direction));
            let off = |x: &Vertex| (x.at - from.at).dot(direction).abs();
            if off(&p) >= off(&q) { p } else { q }
        };
        let a = difference(solids, DVec3::X);
        let b = difference(solids, -DVec3::X);
        let along = (b.at - a.at).normalize_or(DVec3::X);
        let c = farther(along.any_orthonormal_vector(), a);
        let plane = (b.at - a.at).cross(c.at - a.at).normalize_or(DVec3::Z);
        let d = farther(plane, a);
        self.vertices[..4].copy_from_slice(&[a, b, c, d]);
        self.nvertex = 4;
        let above = (d.at - a.at).dot(plane) > 0.0;
        for [i, j, k] in [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]] {
            // Corners anticlockwise, seen from outside.
            self.add_face(if above { [i, k, j] } else { [i, j, k] }, size);
        }
    }

    /// Adds a face; false if there is no place. A sliver, whose normal would be noise, is kept for the sake of its
    /// neighbours and never the nearest.
    fn add_face(&mut self, corners: [u16; 3], size: f64) -> bool {
        if self.nface == FACES {
            return false;
        }
        let [a, b, c] = corners.map(|i| self.vertices[usize::from(i)].at);
        let normal = (b - a).cross(c - a);
        let area = normal.length();
        let longest = (b - a).length().max((c - b).length()).max((a - c).length());
        let sliver = area <= SLIVER * size * longest;
        let normal = if sliver { DVec3::ZERO } else { normal / area };
        let distance = if sliver { f64::INFINITY } else { normal.dot(a) };
        self.faces[self.nface] = Face { corners, normal, distance };
        self.nface += 1;
        true
    }

    /// The face of least signed distance; the first of those that are equal up to rounding.
    fn least(&self, size: f64) -> Face {
        let mut best = self.faces[0];
        for face in &self.faces[1..self.nface] {
            if face.distance < best.distance - EQUAL * size {
                best = *face;
            }
        }
        best
    }

    /// The solids' points that the nearest point of the boundary comes from. Faces that are as near as the nearest to within
    /// the accuracy take part: of long thin ones, rounding may have put one first that the nearest point lies beside.
    fn points(&self, best: &Face, size: f64) -> [DVec3; 2] {
        let at = best.normal * best.distance;
        let (mut on, mut least) = ([DVec3::ZERO; 2], f64::INFINITY);
        for face in &self.faces[..self.nface] {
            if face.distance > best.distance + SAME * size {
                continue;
            }
            let corners = face.corners.map(|i| self.vertices[usize::from(i)]);
            let (w, off) = weights(&corners, at);
            if off < least {
                (on, least) = (combine(&corners, &w), off);
            }
        }
        on
    }

    /// Replaces the faces that the vertex is outside of by faces to the vertex; false if it cannot be done. They are sought
    /// from the nearest face outwards, so that rounding cannot tear more than one hole.
    fn expand(&mut self, nearest: &Face, vertex: Vertex, size: f64) -> bool {
        let slack = 1e-14 * size;
        self.nedge = 0;
        let Some(first) = self.faces[..self.nface].iter().position(|f| f.corners == nearest.corners) else {
            return false;
        };
        self.remove(first);
        let mut f = 0;
        while f < self.nface {
            let face = self.faces[f];
            let outside = face.distance.is_infinite() || face.normal.dot(vertex.at) - face.distance > slack;
            if outside && self.borders(&face) {
                self.remove(f);
                f = 0;
            } else {
                f += 1;
            }
        }
        let new = self.nvertex as u16;
        self.vertices[self.nvertex] = vertex;
        self.nvertex += 1;
        let mut whole = self.nedge > 0;
        for e in 0..self.nedge {
            let (i, j) = self.edges[e];
            whole &= self.add_face([i, j, new], size);
        }
        whole
    }

    /// Takes out a face and notes its edges.
    fn remove(&mut self, f: usize) {
        let [i, j, k] = self.faces[f].corners;
        self.nface -= 1;
        self.faces[f] = self.faces[self.nface];
        for edge in [(i, j), (j, k), (k, i)] {
            self.toggle(edge);
        }
    }

    /// Whether a face has an edge on the rim of the hole.
    fn borders(&self, face: &Face) -> bool {
        let [i, j, k] = face.corners;
        self.edges[..self.nedge].iter().any(|&edge| edge == (j, i) || edge == (k, j) || edge == (i, k))
    }

    /// Notes an edge of a removed face; the two of a pair of neighbours cancel.
    fn toggle(&mut self, (i, j): (u16, u16)) {
        match self.edges[..self.nedge].iter().position(|&edge| edge == (j, i)) {
            Some(e) => {
                self.nedge -= 1;
                self.edges[e] = self.edges[self.nedge];
            }
            None if self.nedge < EDGES => {
                self.edges[self.nedge] = (i, j);
                self.nedge += 1;
            }
            None => {}
        }
    }
}
