//! Rays, and what they meet: distances along them to the surfaces of shapes, in units of the ray's direction.

use super::frame::Frame;
use crate::lane::{Lane, Mask, Real};
use crate::math::vec3::{Vec3, build, cross, dot, mul_t, normalize, scale, select, sub};
use crate::model::Shape;

/// The nearest meeting so far; less than 0: none.
pub(super) struct Nearest<L>(pub L);

impl<L: Lane> Nearest<L> {
    pub fn none() -> Self {
        Nearest(L::of(-1.0))
    }

    /// Takes a meeting where `ok` holds and it is neither behind nor farther; says where that is.
    #[inline(always)]
    pub fn take(&mut self, at: L, ok: L::Mask) -> L::Mask {
        let nearer = ok & at.ge(L::zero()) & (self.0.lt(L::zero()) | at.lt(self.0));
        self.0 = L::select(nearer, at, self.0);
        nearer
    }
}

/// Roots of a x² + 2 b x + c, ascending where a > 0, and where there are any.
#[inline(always)]
fn roots<L: Lane>(a: L, b: L, c: L) -> ([L; 2], L::Mask) {
    let discriminant = b.mul_add(b, -(a * c));
    let some = discriminant.ge(L::of(L::Real::MINVAL)) & a.gt(L::zero());
    let root = L::select(some, discriminant, L::zero()).sqrt();
    let inverse = L::one() / L::select(some, a, L::one());
    ([(-b - root) * inverse, (root - b) * inverse], some)
}

/// The least root that is not negative, and where there is one.
#[inline(always)]
fn first_root<L: Lane>(a: L, b: L, c: L) -> (L, L::Mask) {
    let ([low, high], some) = roots(a, b, c);
    let first = L::select(low.ge(L::zero()), low, high);
    (first, some & first.ge(L::zero()))
}

/// Distance along a ray from `p` in direction `v`, both in the axes of the shape, to its surface; -1: it is not met. From within,
/// a surface is met on the way out.
#[inline(always)]
pub(super) fn distance<L: Lane>(shape: Shape, size: &Vec3<L>, p: &Vec3<L>, v: &Vec3<L>) -> L {
    let mut nearest = Nearest::none();
    match shape {
        Shape::Plane => plane(size, p, v, &mut nearest),
        Shape::Sphere => {
            let (at, ok) = first_root(dot(v, v), dot(v, p), dot(p, p) - size[0] * size[0]);
            nearest.take(at, ok);
        }
        Shape::Ellipsoid => {
            let inverse = size.map(|s| L::one() / s);
            let scaled = |a: &Vec3<L>| [a[0] * inverse[0], a[1] * inverse[1], a[2] * inverse[2]];
            let (v, p) = (scaled(v), scaled(p));
            let (at, ok) = first_root(dot(&v, &v), dot(&v, &p), dot(&p, &p) - L::one());
            nearest.take(at, ok);
        }
        Shape::Capsule => {
            wall(size, p, v, &mut nearest);
            for side in [-L::one(), L::one()] {
                let centre = [L::zero(), L::zero(), side * size[1]];
                let from = sub(p, &centre);
                let (both, some) = roots(dot(v, v), dot(v, &from), dot(&from, &from) - size[0] * size[0]);
                for at in both {
                    let beyond = (side * at.mul_add(v[2], p[2])).ge(size[1]);
                    nearest.take(at, some & beyond);
                }
            }
        }
        Shape::Cylinder => {
            wall(size, p, v, &mut nearest);
            let (turned, inverse) = inverse(v[2]);
            for side in [-L::one(), L::one()] {
                let at = side.mul_add(size[1], -p[2]) * inverse;
                let (x, y) = (at.mul_add(v[0], p[0]), at.mul_add(v[1], p[1]));
                nearest.take(at, turned & (x.mul_add(x, y * y)).le(size[0] * size[0]));
            }
        }
        Shape::Box => {
            for axis in 0..3 {
                let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
                let (turned, inverse) = inverse(v[axis]);
                for side in [-L::one(), L::one()] {
                    let at = side.mul_add(size[axis], -p[axis]) * inverse;
                    let (x, y) = (at.mul_add(v[i], p[i]), at.mul_add(v[j], p[j]));
                    nearest.take(at, turned & x.abs().le(size[i]) & y.abs().le(size[j]));
                }
            }
        }
        // Meshes and height fields are met triangle by triangle.
        Shape::Mesh | Shape::HeightField => {}
    }
    nearest.0
}

/// Where a component of a direction is not zero, and its inverse there.
#[inline(always)]
fn inverse<L: Lane>(x: L) -> (L::Mask, L) {
    let some = x.abs().gt(L::of(L::Real::MINVAL));
    (some, L::one() / L::select(some, x, L::one()))
}

/// A plane seen from its front, within its rectangle where that is bounded.
#[inline(always)]
fn plane<L: Lane>(size: &Vec3<L>, p: &Vec3<L>, v: &Vec3<L>, nearest: &mut Nearest<L>) {
    let front = v[2].lt(L::of(-L::Real::MINVAL));
    let at = -p[2] / L::select(front, v[2], L::one());
    let within = |i: usize| size[i].le(L::zero()) | at.mul_add(v[i], p[i]).abs().le(size[i]);
    nearest.take(at, front & within(0) & within(1));
}

/// The round side of a capsule or cylinder.
#[inline(always)]
fn wall<L: Lane>(size: &Vec3<L>, p: &Vec3<L>, v: &Vec3<L>, nearest: &mut Nearest<L>) {
    let a = v[0].mul_add(v[0], v[1] * v[1]);
    let b = v[0].mul_add(p[0], v[1] * p[1]);
    let c = p[0].mul_add(p[0], p[1].mul_add(p[1], -(size[0] * size[0])));
    let (at, ok) = first_root(a, b, c);
    nearest.take(at, ok & at.mul_add(v[2], p[2]).abs().le(size[1]));
}

/// Whether a point, in the axes of a shape, is in it.
#[inline(always)]
pub(super) fn inside<L: Lane>(shape: Shape, size: &Vec3<L>, p: &Vec3<L>) -> L::Mask {
    let radial = p[0].mul_add(p[0], p[1] * p[1]);
    match shape {
        Shape::Sphere => dot(p, p).le(size[0] * size[0]),
        Shape::Capsule => {
            let over = p[2] - p[2].clamp(-size[1], size[1]);
            over.mul_add(over, radial).le(size[0] * size[0])
        }
        Shape::Ellipsoid => {
            let [x, y, z] = [p[0] / size[0], p[1] / size[1], p[2] / size[2]];
            x.mul_add(x, y.mul_add(y, z * z)).le(L::one())
        }
        Shape::Cylinder => radial.le(size[0] * size[0]) & p[2].abs().le(size[1]),
        Shape::Box => p[0].abs().le(size[0]) & p[1].abs().le(size[1]) & p[2].abs().le(size[2]),
        // Sites are neither.
        Shape::Plane | Shape::Mesh | Shape::HeightField => L::Mask::splat(false),
    }
}

/// Distance along a ray to a triangle, from either side, where it is met, and its normal.
#[inline(always)]
pub(super) fn triangle<L: Lane>([a, b, c]: [Vec3<L>; 3], p: &Vec3<L>, v: &Vec3<L>) -> (L, L::Mask, Vec3<L>) {
    // How far towards b and c the ray passes, and how far along it that is, times a determinant (Möller and Trumbore, 1997).
    let (one, other, start) = (sub(&b, &a), sub(&c, &a), sub(p, &a));
    let (turned, moment) = (cross(v, &other), cross(&start, &one));
    let det = dot(&one, &turned);
    let some = det.abs().gt(L::of(L::Real::TINY));
    let inverse = L::one() / L::select(some, det, L::one());
    let (x, y) = (dot(&start, &turned) * inverse, dot(v, &moment) * inverse);
    let within = x.ge(L::zero()) & y.ge(L::zero()) & (x + y).le(L::one());
    let normal = cross(&one, &other);
    // Those of thin triangles are small.
    let most = normal[0].abs().max(normal[1].abs()).max(normal[2].abs());
    let unit = L::one() / L::select(most.gt(L::zero()), most, L::one());
    (dot(&other, &moment) * inverse, some & within, normalize(&scale(unit, &normal)).0)
}

/// Outward normal of a shape, in its axes, at a point of its surface.
#[inline(always)]
pub(super) fn normal<L: Lane>(shape: Shape, size: &Vec3<L>, p: &Vec3<L>) -> Vec3<L> {
    let (zero, one) = (L::zero(), L::one());
    let up = |z: L| L::select(z.lt(zero), -one, one);
    match shape {
        Shape::Plane | Shape::Mesh | Shape::HeightField => [zero, zero, one],
        Shape::Sphere => normalize(p).0,
        Shape::Capsule => normalize(&[p[0], p[1], p[2] - p[2].clamp(-size[1], size[1])]).0,
        Shape::Ellipsoid => normalize(&build(|i| p[i] / (size[i] * size[i]))).0,
        Shape::Cylinder => {
            let beyond = p[0].mul_add(p[0], p[1] * p[1]).sqrt() - size[0];
            let wall = normalize(&[p[0], p[1], zero]).0;
            select((p[2].abs() - size[1]).gt(beyond), &[zero, zero, up(p[2])], &wall)
        }
        Shape::Box => {
            let beyond: Vec3<L> = build(|i| p[i].abs() - size[i]);
            let x = beyond[0].ge(beyond[1]) & beyond[0].ge(beyond[2]);
            let z = !x & beyond[2].gt(beyond[1]);
            let side = |mask, i: usize| L::select(mask, up(p[i]), zero);
            [side(x, 0), side(!(x | z), 1), side(z, 2)]
        }
    }
}

/// Whether a ray from a contact away from the body that it pushes meets a site's volume.
#[inline(always)]
pub(super) fn meets<L: Lane>(shape: Shape, size: &Vec3<L>, site: &Frame<L>, at: &Vec3<L>, normal: &Vec3<L>) -> L::Mask {
    let (p, v) = (mul_t(&site.rot, at), mul_t(&site.rot, normal));
    distance(shape, size, &p, &v).ge(L::zero())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Distances that geometry gives.
    #[test]
    fn rays_meet_shapes_where_they_are() {
        let size = [1.0, 2.0, 3.0];
        let down = [0.0, 0.0, -1.0];
        let cases: [(Shape, [f64; 3], [f64; 3], f64); 12] = [
            (Shape::Sphere, [0.0, 0.0, 5.0], down, 4.0),
            (Shape::Sphere, [0.0, 0.0, 0.0], down, 1.0),
            (Shape::Sphere, [1.5, 0.0, 5.0], down, -1.0),
            (Shape::Sphere, [0.0, 0.0, -5.0], down, -1.0),
            (Shape::Capsule, [0.0, 0.0, 5.0], down, 2.0),
            (Shape::Capsule, [3.0, 0.0, 1.0], [-1.0, 0.0, 0.0], 2.0),
            (Shape::Cylinder, [0.5, 0.0, 5.0], down, 3.0),
            (Shape::Cylinder, [3.0, 0.0, 2.5], [-1.0, 0.0, 0.0], -1.0),
            (Shape::Ellipsoid, [0.0, 0.0, 5.0], down, 2.0),
            (Shape::Box, [0.9, 1.9, 5.0], down, 2.0),
            (Shape::Box, [0.9, 1.9, 0.0], down, 3.0),
            (Shape::Plane, [0.5, 0.5, -1.0], [0.0, 0.0, 1.0], -1.0),
        ];
        for (shape, p, v, distance) in cases {
            assert_eq!(super::distance(shape, &size, &p, &v), distance, "{shape:?} from {p:?} along {v:?}");
        }
        assert_eq!(super::distance(Shape::Plane, &[0.0; 3], &[9.0, 9.0, 2.0], &down), 2.0);
        assert_eq!(super::distance(Shape::Plane, &[1.0, 1.0, 0.0], &[9.0, 9.0, 2.0], &down), -1.0);
    }

    #[test]
    fn points_are_inside_or_not() {
        let size = [1.0, 2.0, 3.0];
        for shape in [Shape::Sphere, Shape::Capsule, Shape::Cylinder, Shape::Ellipsoid, Shape::Box] {
            assert!(inside::<f64>(shape, &size, &[0.5, 0.0, 0.0]), "{shape:?}");
            assert!(!inside::<f64>(shape, &size, &[1.1, 0.0, 0.0]), "{shape:?}");
        }
        assert!(
            inside::<f64>(Shape::Capsule, &size, &[0.0, 0.0, 2.9])
                && !inside::<f64>(Shape::Cylinder, &size, &[0.0, 0.0, 2.9])
        );
    }
}
