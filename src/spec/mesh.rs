//! Meshes.

use std::sync::Arc;

use super::Source;
pub use crate::mesh::{MeshInertia, Triangles};

/// A mesh that geoms may have as their shape (MJCF `asset/mesh`).
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Name.
    pub name: String,
    /// Vertices and faces as the file has them; without faces, the convex hull of the vertices is meant.
    pub triangles: Arc<Triangles>,
    /// Position of the mesh's origin in the file's axes.
    pub refpos: [f64; 3],
    /// Orientation of the mesh's axes in the file's.
    pub refquat: [f64; 4],
    /// Scale along the mesh's axes; an odd number of negative ones mirrors it.
    pub scale: [f64; 3],
    /// What of it has mass.
    pub inertia: MeshInertia,
    /// Its geoms' frames are at its origin along its axes: the vertices are about their centre of mass, along their principal axes.
    pub centered: bool,
    /// Most vertices of the hull that collides.
    pub maxhullvert: Option<usize>,
    /// Where it was written.
    pub source: Source,
}

impl Default for Mesh {
    fn default() -> Self {
        Mesh {
            name: String::new(),
            triangles: Arc::default(),
            refpos: [0.0; 3],
            refquat: [1.0, 0.0, 0.0, 0.0],
            scale: [1.0; 3],
            inertia: MeshInertia::default(),
            centered: false,
            maxhullvert: None,
            source: Source::default(),
        }
    }
}
