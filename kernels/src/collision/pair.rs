//! The narrow phase of a pair with a formula in lanes: from two bodies to the contacts that the pair may have.

use super::body::{Body, Candidate, Found, Frames, body};
use super::{capsule, plane, shapes, sphere};
use crate::lane::{Lane, Mask};
use crate::model::{Instance, Pair, Shape};
use crate::position::Position;

/// Whether a pair has a formula in lanes.
pub fn in_lanes(shapes: (Shape, Shape)) -> bool {
    use Shape::{Box, Capsule, Cylinder, Plane, Sphere};
    matches!(
        shapes,
        (Plane, Sphere | Capsule | Shape::Ellipsoid | Cylinder | Box)
            | (Sphere, Sphere | Capsule | Cylinder | Box)
            | (Capsule, Capsule)
    )
}

/// The bodies of a pair relative to its reference point, and the distance within which contacts are listed.
#[inline(always)]
fn placed<L: Lane>(model: Instance<'_, L>, pair: u32, position: &Position<L>) -> ([Body<L>; 2], L) {
    let Pair { geom1, geom2, .. } = model.pairs[pair as usize];
    let bodies = [geom1, geom2].map(|g| body(model, position, g as usize));
    let frames = Frames::new(&model, &model.pairs[pair as usize]);
    (frames.place(position, bodies), model.include(pair as usize))
}

/// [`points`] of a pair.
pub fn narrow<L: Lane>(
    model: Instance<'_, L>,
    pair: u32,
    near: L::Mask,
    position: &Position<L>,
    found: &mut [Found<L>],
) -> L::Mask {
    let ([a, b], include) = placed(model, pair, position);
    points(shapes(&model, pair), &a, &b, include, near, found)
}

/// [`capsules`] of a pair.
pub fn narrow_parallel<L: Lane>(
    model: Instance<'_, L>,
    pair: u32,
    near: L::Mask,
    position: &Position<L>,
    found: &mut [Found<L>],
) {
    let ([a, b], include) = placed(model, pair, position);
    capsules(&a, &b, include, near, found);
}

/// The contacts of a pair with a formula in lanes, in the worlds of `near`. Of two capsules, those that are not parallel;
/// returns where they are.
#[inline(always)]
fn points<L: Lane>(
    shapes: (Shape, Shape),
    a: &Body<L>,
    b: &Body<L>,
    include: L,
    near: L::Mask,
    found: &mut [Found<L>],
) -> L::Mask {
    use Shape::{Capsule, Cylinder, Ellipsoid, Plane, Sphere};
    let nowhere = L::Mask::splat(false);
    let mut put = |i: usize, candidate: &Candidate<L>, mask| candidate.put(near & mask, include, &mut found[i]);
    let everywhere = L::Mask::splat(true);
    match shapes {
        (Plane, Sphere) => put(0, &plane::sphere(a, b), everywhere),
        (Plane, Capsule) => plane::capsule(a, b).iter().enumerate().for_each(|(i, c)| put(i, c, everywhere)),
        (Plane, Ellipsoid) => put(0, &plane::ellipsoid(a, b), everywhere),
        (Plane, Cylinder) => {
            plane::cylinder(a, b, include).iter().enumerate().for_each(|(i, (c, mask))| put(i, c, *mask));
        }
        (Plane, Shape::Box) => {
            plane::cuboid(a, b, include).iter().enumerate().for_each(|(i, (c, mask))| put(i, c, *mask));
        }
        (Sphere, Sphere) => put(0, &sphere::sphere(a, b), everywhere),
        (Sphere, Capsule) => put(0, &sphere::capsule(a, b), everywhere),
        (Sphere, Cylinder) => put(0, &sphere::cylinder(a, b), everywhere),
        (Sphere, Shape::Box) => put(0, &sphere::cuboid(a, b), everywhere),
        (Capsule, Capsule) => {
            let (crossing, parallel) = capsule::crossing(a, b);
            put(0, &crossing, !parallel);
            put(1, &crossing, nowhere);
            return near & parallel;
        }
        _ => {}
    }
    nowhere
}

/// The contacts of two capsules wherever they are, parallel ones too.
#[inline(always)]
fn capsules<L: Lane>(a: &Body<L>, b: &Body<L>, include: L, near: L::Mask, found: &mut [Found<L>]) {
    let (crossing, parallel) = capsule::crossing(a, b);
    for (i, candidate) in capsule::parallel(a, b).iter().enumerate() {
        let mask = if i == 0 { near } else { near & parallel };
        Candidate::select(parallel, candidate, &crossing).put(mask, include, &mut found[i]);
    }
}
