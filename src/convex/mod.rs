//! Contacts of convex shapes from their support functions: our collider for pairs without a formula.
//!
//! Spheres and capsules are a point and a segment with a radius about them. Shapes whose cores are apart are treated by
//! distance (`distance`), others by penetration (`penetration`); shapes that touch with flat sides or edges get several
//! points (`manifold`). Everything lives on the stack, in the first shape's own axes: so a scene turned as a whole gives the
//! same contacts, turned.

mod calipers;
mod distance;
mod feature;
mod heights;
mod manifold;
mod penetration;
mod plane;
mod support;

use glam::{DMat3, DVec3};
use lanesim_kernels::collision::{Body, ConvexCollider, Outline, Point};
use lanesim_kernels::model::Shape;

use support::Solid;

/// Cores nearer than this, relative to their size, are treated as penetrating: the direction between their nearest points
/// would be lost in rounding.
const TOUCHING: f64 = 1e-7;

/// Shapes that were apart are passed over if they still are by so much more than asked for, relative to their size: the search
/// itself would then say so, too, whatever the rounding.
const CLEAR: f64 = 1e-9;

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
        outlines: [Outline<'_>; 2],
        [a, b]: [&Body<f64>; 2],
        include: f64,
        most: usize,
        axis: &mut [f64; 3],
        found: &mut dyn FnMut(Point<f64>),
    ) {
        if outlines[0].shape == Shape::Plane {
            return plane::collide(&Solid::new(outlines[1], b), a, include, most, found);
        }
        let (own, origin) = (DMat3::from_cols_array(&a.rot).transpose(), DVec3::from_array(a.pos));
        let [one, other] = [Solid::new(outlines[0], a), Solid::new(outlines[1], b)];
        let size = one.extent + one.radius + other.extent + other.radius;
        let (centre, rot) = (own.transpose() * (other.centre - origin), own.transpose() * other.rot);
        let solids = [
            Solid { centre: DVec3::ZERO, rot: DMat3::IDENTITY, ..one },
            Solid {
                centre: centre.map(|x| without_rounding(x, size)),
                rot: DMat3::from_cols_array(&rot.to_cols_array().map(|x| without_rounding(x, 1.0))),
                ..other
            },
        ];
        let mut place = |point: Point<f64>| {
            let (pos, normal) = (own * DVec3::from(point.pos) + origin, own * DVec3::from(point.normal));
            found(Point { pos: pos.to_array(), normal: normal.to_array(), ..point });
        };
        if let Some(heights) = outlines[0].heights {
            return heights::collide(heights, &solids[1], include, &mut place);
        }
        let radius = solids[0].radius + solids[1].radius;
        let reach = include + radius;
        if distance::is_far(&solids, reach + CLEAR * size, DVec3::from_array(*axis)) {
            return;
        }
        let nearest = match nearest(&solids, reach) {
            Ok(nearest) if nearest.dist - radius <= include => nearest,
            Ok(Nearest { normal: far, .. }) | Err(far) => {
                *axis = far.to_array();
                return;
            }
        };
        *axis = [0.0; 3];
        let mut add = |dist: f64, at: DVec3, normal: DVec3| {
            if dist <= include {
                place(Point { dist, pos: at.to_array(), normal: normal.to_array() });
            }
        };
        if manifold::manifold(&solids, &nearest, (include, most), &mut add) {
            return;
        }
        place(point(&solids, &nearest));
    }
}

/// The point midway between nearest points of two shapes.
fn point(solids: &[Solid<'_>; 2], nearest: &Nearest) -> Point<f64> {
    let [radius1, radius2] = [solids[0].radius, solids[1].radius];
    let first = nearest.on[0] + nearest.normal * radius1;
    let second = nearest.on[1] - nearest.normal * radius2;
    let pos = (first + second) * 0.5;
    Point { dist: nearest.dist - radius1 - radius2, pos: pos.to_array(), normal: nearest.normal.to_array() }
}

/// Zero, or the size, where a number is that up to a few roundings of the size: shapes that are aligned stay so.
fn without_rounding(x: f64, size: f64) -> f64 {
    let near = |y: f64| (x.abs() - y).abs() < 32.0 * f64::EPSILON * size;
    if near(0.0) {
        0.0
    } else if near(size) {
        size.copysign(x)
    } else {
        x
    }
}

/// The nearest points, or a direction along which the cores are farther apart than `reach`.
fn nearest(solids: &[Solid<'_>; 2], reach: f64) -> Result<Nearest, DVec3> {
    let size = solids[0].extent + solids[1].extent;
    match distance::distance(solids, reach, TOUCHING * size) {
        distance::Outcome::Far(along) => Err(along),
        distance::Outcome::Apart(nearest) => Ok(nearest),
        distance::Outcome::Touching => Ok(penetration::penetration(solids, size)),
    }
}
