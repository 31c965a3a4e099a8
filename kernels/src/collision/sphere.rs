//! A sphere against sphere, capsule, cylinder and box.

use super::body::{Body, Candidate};
use crate::lane::{Lane, Real};
use crate::math::vec3::{Vec3, add, cross, dot, mul, mul_t, neg, norm, normalize, scale, scale_add, select, sub, zero};

/// What rounding may leave of a number of size one: a difference within it is none, so that ties are broken in the shapes'
/// own axes, whatever the scene's orientation.
pub(super) fn rounding<L: Lane>() -> L {
    L::of((16.0 * L::Real::EPSILON).max(L::Real::MINVAL))
}

/// Two spheres given by centre and radius. Centres that coincide, but for rounding: the normal is orthogonal to both z axes; the world's x axis
/// if these are parallel.
#[inline(always)]
pub(super) fn balls<L: Lane>(c1: &Vec3<L>, r1: L, z1: &Vec3<L>, c2: &Vec3<L>, r2: L, z2: &Vec3<L>) -> Candidate<L> {
    let between = sub(c2, c1);
    let length = norm(&between);
    let coincident = length.lt((rounding::<L>() * (r1 + r2)).max(L::of(L::Real::MINVAL)));
    let (across, sin) = normalize(&cross(z1, z2));
    let fallback = select(sin.lt(rounding()), &[L::one(), L::zero(), L::zero()], &across);
    let inverse = L::one() / L::select(coincident, L::one(), length);
    let normal = select(coincident, &fallback, &scale(inverse, &between));
    let dist = length - (r1 + r2);
    Candidate { dist, pos: scale_add(dist.mul_add(L::of(0.5), r1), &normal, c1), normal, tangent: zero() }
}

pub(super) fn sphere<L: Lane>(a: &Body<L>, b: &Body<L>) -> Candidate<L> {
    balls(&a.pos, a.size[0], &a.axis(), &b.pos, b.size[0], &b.axis())
}

/// The nearest point of the capsule's segment, as a sphere.
pub(super) fn capsule<L: Lane>(sphere: &Body<L>, capsule: &Body<L>) -> Candidate<L> {
    let axis = capsule.axis();
    let half = capsule.size[1];
    let along = dot(&axis, &sub(&sphere.pos, &capsule.pos)).clamp(-half, half);
    let nearest = scale_add(along, &axis, &capsule.pos);
    balls(&sphere.pos, sphere.size[0], &sphere.axis(), &nearest, capsule.size[0], &axis)
}

/// Against the side, a cap or the rim; a centre within both slabs takes the shallower of side and cap.
pub(super) fn cylinder<L: Lane>(sphere: &Body<L>, cylinder: &Body<L>) -> Candidate<L> {
    let axis = cylinder.axis();
    let (radius, half) = (cylinder.size[0], cylinder.size[1]);
    let between = sub(&sphere.pos, &cylinder.pos);
    let along = dot(&axis, &between);
    let radial = scale_add(-along, &axis, &between);
    let distance = norm(&radial);
    let within_height = along.abs().lt(half);
    let within_radius = distance.lt(radius);
    let on_axis = scale_add(along, &axis, &cylinder.pos);
    let side = balls(&sphere.pos, sphere.size[0], &sphere.axis(), &on_axis, radius, &axis);
    // The cap on the sphere's side, as a plane; the normal points from sphere to cylinder.
    let slack = rounding::<L>() * (radius + half);
    let top = along.gt(slack);
    let outward = select(top, &axis, &neg(&axis));
    let cap_dist = along.abs() - half - sphere.size[0];
    let cap = Candidate {
        dist: cap_dist,
        pos: scale_add(-(cap_dist.mul_add(L::of(0.5), sphere.size[0])), &outward, &sphere.pos),
        normal: neg(&outward),
        tangent: zero(),
    };
    let rim_direction = scale(L::one() / L::select(distance.lt(L::of(L::Real::MINVAL)), L::one(), distance), &radial);
    let rim = scale_add(half, &outward, &scale_add(radius, &rim_direction, &cylinder.pos));
    let rim = balls(&sphere.pos, sphere.size[0], &sphere.axis(), &rim, L::zero(), &axis);
    let shallow_side = (half - along.abs()).ge(radius - distance - slack);
    let use_side = within_height & (!within_radius | shallow_side);
    let use_cap = within_radius & !use_side;
    Candidate::select(use_side, &side, &Candidate::select(use_cap, &cap, &rim))
}

/// The nearest point of the box; a centre inside takes the face of least depth.
pub(super) fn cuboid<L: Lane>(sphere: &Body<L>, cuboid: &Body<L>) -> Candidate<L> {
    let local = mul_t(&cuboid.rot, &sub(&sphere.pos, &cuboid.pos));
    let nearest: Vec3<L> = std::array::from_fn(|i| local[i].clamp(-cuboid.size[i], cuboid.size[i]));
    let outside = sub(&local, &nearest);
    let distance = norm(&outside);
    let inside = distance.lt(L::of(L::Real::MINVAL));
    let inverse = L::one() / L::select(inside, L::one(), distance);
    // Face of least depth.
    let mut depth = L::of(L::Real::MAXVAL);
    let mut face: Vec3<L> = zero();
    for i in 0..3 {
        let slack = rounding::<L>() * cuboid.size[i];
        let sign = L::select(local[i].gt(slack), L::one(), -L::one());
        let here = cuboid.size[i] - local[i].abs();
        let less = here.lt(depth - slack);
        let mut direction = zero();
        direction[i] = sign;
        face = select(less, &direction, &face);
        depth = L::select(less, here, depth);
    }
    let out = select(inside, &face, &scale(inverse, &outside));
    let dist = L::select(inside, -depth, distance) - sphere.size[0];
    let normal = neg(&mul(&cuboid.rot, &out));
    let pos = add(&sphere.pos, &scale(dist.mul_add(L::of(0.5), sphere.size[0]), &normal));
    Candidate { dist, pos, normal, tangent: zero() }
}
