//! Convex hulls, by parry, and what a collider wants to know of them.

use std::collections::BTreeMap;

use glam::DVec3;
use lanesim_kernels::model::{Hull, HullFace};
use parry3d_f64::transformation::try_convex_hull;

use super::Triangles;

/// Cells of an angle that tells where a normal points, per radian. Triangles that share an edge and whose normals lie in the same cell, by
/// azimuth and inclination in the axes of the mesh's file, are one face: so it is with MuJoCo, found by experiment.
const CELLS: f64 = 100.0;
/// Normals whose height differs from ±1 by no more have no azimuth.
const POLE: f64 = 1e-7;
/// A hull of less thickness, relative to its extent, is flat.
const THIN: f64 = 1e-9;
/// Fewest vertices of a hull.
const FEWEST: usize = 4;

/// Why a mesh has no hull.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Refused;

/// The convex hull of some vertices, of `most` vertices at most.
pub(crate) fn hull(vertices: &[DVec3], most: Option<usize>) -> Result<Triangles, Refused> {
    let mut all = whole(vertices)?;
    if let Some(most) = most.filter(|most| all.vertices.len() > *most) {
        all = simplified(&all.vertices, most.max(FEWEST))?;
    }
    Ok(all)
}

fn whole(vertices: &[DVec3]) -> Result<Triangles, Refused> {
    // What is thin along an axis is widened for the search: the hull goes along.
    let low = vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let extent = vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max) - low;
    let wide = DVec3::ONE / extent.max(DVec3::splat(THIN * extent.max_element()));
    let bits = |p: DVec3| p.to_array().map(f64::to_bits);
    let widened: Vec<DVec3> = vertices.iter().map(|p| (*p - low) * wide).collect();
    let own: BTreeMap<[u64; 3], DVec3> = widened.iter().map(|p| bits(*p)).zip(vertices.iter().copied()).collect();
    let (found, faces) = try_convex_hull(&widened).map_err(|_| Refused)?;
    let vertices = found.iter().map(|p| own.get(&bits(*p)).copied()).collect::<Option<_>>().ok_or(Refused)?;
    let hull = Triangles { vertices, faces };
    if hull.faces.len() < 4 || hull.problem().is_some() || hull.is_flat() { Err(Refused) } else { Ok(hull) }
}

/// The hull of some of the vertices: each is the one farthest from the hull of those before.
fn simplified(vertices: &[DVec3], most: usize) -> Result<Triangles, Refused> {
    let farthest = |value: &dyn Fn(DVec3) -> f64| {
        let better = |best: DVec3, next: &DVec3| if value(*next) > value(best) { *next } else { best };
        vertices.iter().fold(vertices[0], better)
    };
    let first = farthest(&|p| p.x);
    let second = farthest(&|p| p.distance_squared(first));
    let line = second - first;
    let third = farthest(&|p| line.cross(p - first).length_squared());
    let normal = line.cross(third - first);
    let fourth = farthest(&|p| normal.dot(p - first).abs());
    let mut chosen = vec![first, second, third, fourth];
    let mut hull = whole(&chosen)?;
    while chosen.len() < most {
        let planes: Vec<(DVec3, f64)> = hull.faces.iter().map(|face| plane(hull.corners(*face))).collect();
        let beyond = |p: DVec3| planes.iter().map(|(n, d)| n.dot(p) - d).fold(f64::NEG_INFINITY, f64::max);
        let next = farthest(&beyond);
        if beyond(next) <= 0.0 {
            break;
        }
        chosen.push(next);
        hull = whole(&chosen)?;
    }
    Ok(hull)
}

/// Twice the area, as a vector along the outward normal.
fn twice_area([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

fn plane([a, b, c]: [DVec3; 3]) -> (DVec3, f64) {
    let normal = twice_area([a, b, c]).normalize_or_zero();
    (normal, normal.dot(a))
}

impl Triangles {
    /// Whether a hull has no thickness, but for rounding.
    fn is_flat(&self) -> bool {
        let from = self.vertices[0];
        let extent = self.vertices.iter().map(|p| p.distance(from)).fold(0.0, f64::max);
        let volume: f64 = self
            .faces
            .iter()
            .map(|face| self.corners(*face).map(|p| p - from))
            .map(|[a, b, c]| a.dot(b.cross(c)))
            .sum();
        volume <= THIN * extent.powi(3)
    }

    /// A hull as colliders see it: vertices with their neighbours, and flat faces. `exact`: its vertices before they were rounded; `filed`: in
    /// the axes of the mesh's file.
    pub(crate) fn outline(&self, exact: &[DVec3], filed: &[DVec3]) -> Hull {
        let faces = self.flat_faces(exact, filed);
        let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); self.vertices.len()];
        for [a, b, c] in &self.faces {
            // Every edge belongs to two triangles, once in either direction.
            for (from, to) in [(a, b), (b, c), (c, a)] {
                neighbours[*from as usize].push(*to);
            }
        }
        Hull::new(self.vertices.iter().map(|p| p.to_array()).collect(), &neighbours, faces)
    }

    /// Neighbouring triangles in a cell of directions are one face, and those without a normal belong to any.
    fn flat_faces(&self, exact: &[DVec3], filed: &[DVec3]) -> Vec<HullFace> {
        let cells = self.directions(filed);
        let edges = |f: usize| {
            let [a, b, c] = self.faces[f];
            [(a, b), (b, c), (c, a)]
        };
        let across: BTreeMap<(u32, u32), usize> =
            (0..self.faces.len()).flat_map(|f| edges(f).map(|edge| (edge, f))).collect();
        let beyond = |(from, to): (u32, u32)| across.get(&(to, from)).copied();
        // Of every triangle the face that it belongs to.
        let mut face_of: Vec<Option<usize>> = vec![None; self.faces.len()];
        let mut out = Vec::new();
        for start in 0..self.faces.len() {
            if face_of[start].is_some() || cells[start].is_none() {
                continue;
            }
            let (mut members, mut next) = (vec![start], 0);
            face_of[start] = Some(start);
            while let Some(f) = members.get(next).copied() {
                next += 1;
                for other in edges(f).into_iter().filter_map(beyond) {
                    if face_of[other].is_none() && cells[other].is_none_or(|cell| Some(cell) == cells[start]) {
                        face_of[other] = Some(start);
                        members.push(other);
                    }
                }
            }
            let inner = |edge: (u32, u32)| beyond(edge).is_some_and(|other| face_of[other] == Some(start));
            let rim = members.iter().flat_map(|f| edges(*f)).filter(|edge| !inner(*edge)).collect();
            // Of many thin triangles each has its own rounding; together they say how the face lies.
            let corners = |f: &usize| self.faces[*f].map(|vertex| exact[vertex as usize]);
            let area: DVec3 = members.iter().map(|f| twice_area(corners(f))).sum();
            if let Some(normal) = area.try_normalize() {
                out.extend(walk(&rim).map(|corners| HullFace { normal: normal.to_array(), corners }));
            }
        }
        out
    }

    /// Of every triangle of a hull the cell in which its outward normal lies; `None` if it has no normal.
    fn directions(&self, filed: &[DVec3]) -> Vec<Option<[i32; 2]>> {
        let filed = Triangles { vertices: filed.to_vec(), faces: self.faces.clone() };
        // A file's axes can be mirrored.
        let from = filed.vertices[0];
        let volume = |face: &[u32; 3]| {
            let [a, b, c] = filed.corners(*face).map(|p| p - from);
            a.dot(b.cross(c))
        };
        let outward = filed.faces.iter().map(volume).sum::<f64>().signum();
        let cell = |face: &[u32; 3]| (twice_area(filed.corners(*face)) * outward).try_normalize().map(direction);
        filed.faces.iter().map(cell).collect()
    }
}

/// The cell of directions in which a unit vector lies.
fn direction(normal: DVec3) -> [i32; 2] {
    // Zeros without a sign, on which a straight angle's depends.
    let [x, y, z] = (normal + DVec3::ZERO).to_array();
    let azimuth = if z.abs() > 1.0 - POLE { 0.0 } else { y.atan2(x) };
    [azimuth, z.clamp(-1.0, 1.0).acos()].map(|angle| (CELLS * angle).round() as i32)
}

/// The vertices of a rim in their order; `None` unless it is one round.
fn walk(rim: &BTreeMap<u32, u32>) -> Option<Vec<u32>> {
    let first = *rim.keys().next()?;
    let mut corners = vec![first];
    let mut at = *rim.get(&first)?;
    while at != first {
        if corners.len() > rim.len() {
            return None;
        }
        corners.push(at);
        at = *rim.get(&at)?;
    }
    Some(corners)
}
