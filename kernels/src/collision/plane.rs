//! A plane against every other shape. The normal is the plane's; a contact lies midway between plane and surface.

use super::body::{Body, Candidate};
use super::sphere::rounding;
use crate::lane::{Lane, Mask};
use crate::math::vec3::{Vec3, column, cross, dot, mul, mul_t, neg, norm, scale, scale_add, select, sub, zero};

/// The contact of surface point `at`, `dist` above the plane.
#[inline(always)]
fn below<L: Lane>(normal: &Vec3<L>, at: &Vec3<L>, dist: L, tangent: Vec3<L>) -> Candidate<L> {
    Candidate { dist, pos: scale_add(dist * L::of(-0.5), normal, at), normal: *normal, tangent }
}

/// Height of a point above the plane.
#[inline(always)]
fn height<L: Lane>(plane: &Body<L>, normal: &Vec3<L>, at: &Vec3<L>) -> L {
    dot(normal, &sub(at, &plane.pos))
}

/// A sphere of the given centre and radius.
#[inline(always)]
fn ball<L: Lane>(plane: &Body<L>, centre: &Vec3<L>, radius: L, tangent: Vec3<L>) -> Candidate<L> {
    let normal = plane.axis();
    let dist = height(plane, &normal, centre) - radius;
    below(&normal, &scale_add(-radius, &normal, centre), dist, tangent)
}

pub(super) fn sphere<L: Lane>(plane: &Body<L>, sphere: &Body<L>) -> Candidate<L> {
    ball(plane, &sphere.pos, sphere.size[0], zero())
}

/// Both ends, the one at +axis first; the first tangent follows the axis.
pub(super) fn capsule<L: Lane>(plane: &Body<L>, capsule: &Body<L>) -> [Candidate<L>; 2] {
    let axis = capsule.axis();
    [capsule.size[1], -capsule.size[1]]
        .map(|end| ball(plane, &scale_add(end, &axis, &capsule.pos), capsule.size[0], axis))
}

/// The support point against the normal.
pub(super) fn ellipsoid<L: Lane>(plane: &Body<L>, ellipsoid: &Body<L>) -> Candidate<L> {
    let normal = plane.axis();
    let local = mul_t(&ellipsoid.rot, &normal);
    let scaled: Vec3<L> = std::array::from_fn(|i| ellipsoid.size[i] * local[i]);
    let inverse = L::one() / norm(&scaled);
    let support: Vec3<L> = std::array::from_fn(|i| ellipsoid.size[i] * scaled[i] * inverse);
    let at = sub(&ellipsoid.pos, &mul(&ellipsoid.rot, &support));
    below(&normal, &at, height(plane, &normal, &at), zero())
}

/// The lowest rim point of each disk, then two rim points of the nearer disk at ±120° from its lowest. None of the others
/// counts unless the first is within `include`.
pub(super) fn cylinder<L: Lane>(plane: &Body<L>, cylinder: &Body<L>, include: L) -> [(Candidate<L>, L::Mask); 4] {
    let normal = plane.axis();
    let (radius, half) = (cylinder.size[0], cylinder.size[1]);
    let up = cylinder.axis();
    let projection = dot(&normal, &up);
    let away = projection.gt(L::zero());
    // The axis points to the plane: its disk is the nearer one.
    let axis = select(away, &neg(&up), &up);
    // Towards the plane and orthogonal to the axis: by the cylinder's own x and y, for a difference of world vectors would
    // lose the direction of a disk that is nearly flat on the plane, and leave the disk.
    let (x_axis, y_axis) = (column(&cylinder.rot, 0), column(&cylinder.rot, 1));
    let (x, y) = (-dot(&normal, &x_axis), -dot(&normal, &y_axis));
    let length = y.mul_add(y, x * x).sqrt();
    let flat = length.lt(rounding());
    let inverse = radius / L::select(flat, L::one(), length);
    let (x, y) = (L::select(flat, radius, x * inverse), L::select(flat, L::zero(), y * inverse));
    let rim = scale_add(y, &y_axis, &scale(x, &x_axis));
    let near_disk = scale_add(half, &axis, &cylinder.pos);
    let far_disk = scale_add(-half, &axis, &cylinder.pos);
    // ±120°: half of the opposite of `rim`, plus or minus √3/2 of the direction orthogonal to it and the axis.
    let side = cross(&rim, &axis).map(|x| x * L::of(0.75_f64.sqrt()));
    let back = scale_add(L::of(-0.5), &rim, &near_disk);
    let points: [Vec3<L>; 4] = [
        std::array::from_fn(|i| near_disk[i] + rim[i]),
        std::array::from_fn(|i| far_disk[i] + rim[i]),
        std::array::from_fn(|i| back[i] + side[i]),
        std::array::from_fn(|i| back[i] - side[i]),
    ];
    let first = height(plane, &normal, &points[0]).le(include);
    points.map(|at| (below(&normal, &at, height(plane, &normal, &at), zero()), first))
}

/// The first four corners, in index order (bit 0: x, bit 1: y, bit 2: z), that lie on the plane's side of the centre and
/// within `include`.
pub(super) fn cuboid<L: Lane>(plane: &Body<L>, cuboid: &Body<L>, include: L) -> [(Candidate<L>, L::Mask); 4] {
    let normal = plane.axis();
    let centre = height(plane, &normal, &cuboid.pos);
    let blank = (below(&normal, &cuboid.pos, centre, zero()), L::Mask::splat(false));
    let mut found = [blank; 4];
    let mut count = L::zero();
    for corner in 0..8 {
        let local: Vec3<L> =
            std::array::from_fn(|i| if corner >> i & 1 == 1 { cuboid.size[i] } else { -cuboid.size[i] });
        let offset = mul(&cuboid.rot, &local);
        let lower = dot(&normal, &offset);
        let dist = centre + lower;
        let counts = lower.le(L::zero()) & dist.le(include);
        let at: Vec3<L> = std::array::from_fn(|i| cuboid.pos[i] + offset[i]);
        let candidate = below(&normal, &at, dist, zero());
        for (i, (slot, mask)) in found.iter_mut().enumerate() {
            let here = counts & count.eq(L::of(i as f64));
            *slot = Candidate::select(here, &candidate, slot);
            *mask = *mask | here;
        }
        count = L::select(counts, count + L::one(), count);
    }
    found
}
