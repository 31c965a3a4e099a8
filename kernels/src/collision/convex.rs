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
    /// Adds the points of two bodies that are within `include`, `most` at most. Positions of points lie midway between
    /// the surfaces, normals point from the first to the second.
    ///
    /// `axis`, in the axes of the first, is a direction along which shapes that were like these are apart, or zero; it may save the
    /// search, but changes no result. It is left so for the next time.
    fn collide(
        &self,
        outlines: [Outline<'_>; 2],
        bodies: [&Body<f64>; 2],
        include: f64,
        most: usize,
        axis: &mut [f64; 3],
        add: &mut dyn FnMut(Point<f64>),
    );
}
