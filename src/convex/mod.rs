//! Contacts of convex shapes from their support functions: our collider for pairs without a formula.
//!
//! Spheres and capsules are a point and a segment with a radius about them. Shapes whose cores are apart are treated by
//! distance (`distance`), others by penetration (`penetration`); shapes that touch with flat sides or edges get several
//! points (`manifold`). Everything lives on the stack and depends on the two shapes only.

mod distance;
mod manifold;
mod penetration;
mod support;

use glam::DVec3;
use lanesim_kernels::collision::{Body, ConvexCollider, Point, Points};
use lanesim_kernels::model::Shape;

use support::Solid;

/// Cores nearer than this, relative to their size, are treated as penetrating: the direction between their nearest points
/// would be lost in rounding.
const TOUCHING: f64 = 1e-7;

/// A collider by support functions.
#[derive(Clone, Copy, Debug, Default)]
pub struct SupportCollider;

/// The deepest or nearest points of two cores.
#[derive(Clone, Copy, Debug)]
struct Nearest {
    /// Signed distance of the cores.
    dist: f64,
    /// From the first to the second.
    normal: DVec3,
    /// Points of the cores.
    on: [DVec3; 2],
}

impl ConvexCollider for SupportCollider {
    fn collide(
        &self,
        shapes: (Shape, Shape),
        a: &Body<f64>,
        b: &Body<f64>,
        include: f64,
        most: usize,
        points: &mut Points<f64>,
    ) {
        // About the first solid's centre, so that numbers stay small.
        let origin = DVec3::from_array(a.pos);
        let solids = [Solid::new(shapes.0, a, origin), Solid::new(shapes.1, b, origin)];
        let radius = solids[0].radius + solids[1].radius;
        let Some(nearest) = nearest(&solids, include + radius) else { return };
        let dist = nearest.dist - radius;
        if dist > include {
            return;
        }
        let mut add = |dist: f64, at: DVec3, normal: DVec3| {
            if dist <= include {
                let pos = (at + origin).to_array();
                points.push(Point { dist, pos, normal: normal.to_array() });
            }
        };
        if most > 1 && manifold::manifold(&solids, nearest.normal, most, &mut add) {
            return;
        }
        let first = nearest.on[0] + nearest.normal * solids[0].radius;
        let second = nearest.on[1] - nearest.normal * solids[1].radius;
        add(dist, (first + second) * 0.5, nearest.normal);
    }
}

/// The nearest points, or `None` if the cores are farther apart than `reach`.
fn nearest(solids: &[Solid; 2], reach: f64) -> Option<Nearest> {
    let size = solids[0].extent + solids[1].extent;
    match distance::distance(solids, reach, TOUCHING * size) {
        distance::Outcome::Far => None,
        distance::Outcome::Apart(nearest) => Some(nearest),
        distance::Outcome::Touching => Some(penetration::penetration(solids, size)),
    }
}
