//! Convex pairs without a formula of their own: solved by a collider that the caller supplies.

use super::Body;
use super::single::Point;
use crate::model::{HeightField, Hull, Shape};

/// The shape of a geom, and what belongs to it.
#[derive(Clone, Copy, Debug)]
pub struct Outline<'a> {
    /// Shape.
    pub shape: Shape,
    /// Hull of a mesh, in the geom's axes.
    pub hull: Option<&'a Hull>,
    /// Heights of a height field.
    pub heights: Option<&'a HeightField>,
}

/// Finds the contacts of two convex shapes, one world at a time, without allocating.
///
/// Kernels know only this; the algorithm, and what it depends on, is the caller's. Equal arguments must give equal bits.
pub trait ConvexCollider: Sync {
    /// Adds the points of `a` and `b` that are within `include`, `most` at most. Positions of points lie midway between
    /// the surfaces, normals point from `a` to `b`.
    fn collide(
        &self,
        outlines: [Outline<'_>; 2],
        a: &Body<f64>,
        b: &Body<f64>,
        include: f64,
        most: usize,
        add: &mut dyn FnMut(Point<f64>),
    );
}
