//! Triangle meshes and height fields: the files that hold them, or what makes them; the mass of meshes, and their convex hulls.

mod builtin;
mod files;
mod heights;
mod hull;
mod mass;

use glam::DVec3;

pub(crate) use builtin::builtin;
pub(crate) use files::{FORMATS, Format};
pub(crate) use heights::{MOST_POINTS, Raw as RawHeights};
pub(crate) use hull::{Refused, hull};
pub use mass::MeshInertia;
pub(crate) use mass::bulk;

/// Most vertices and most triangles of a mesh.
pub(crate) const MOST: usize = 2_000_000;

/// Corners, and the triangles between them, whose normals point outward where they go round counterclockwise.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Triangles {
    /// Positions.
    pub vertices: Vec<DVec3>,
    /// Three vertices each.
    pub faces: Vec<[u32; 3]>,
}

impl Triangles {
    /// Corners of a face.
    pub(crate) fn corners(&self, face: [u32; 3]) -> [DVec3; 3] {
        face.map(|vertex| self.vertices[vertex as usize])
    }

    /// What makes it no mesh: numbers that are not finite, faces without vertices.
    pub(crate) fn problem(&self) -> Option<String> {
        let count = self.vertices.len();
        if count < 4 {
            return Some(format!("{count} vertices are too few; a mesh has at least 4"));
        }
        if count > MOST || self.faces.len() > MOST {
            return Some(format!("more than {MOST} vertices or triangles"));
        }
        if let Some(v) = self.vertices.iter().position(|vertex| !vertex.is_finite()) {
            return Some(format!("vertex {v} is not finite"));
        }
        let bad = self.faces.iter().flatten().find(|vertex| **vertex as usize >= count);
        bad.map(|vertex| format!("a face has vertex {vertex}, but there are {count}"))
    }
}

#[cfg(test)]
mod tests;
