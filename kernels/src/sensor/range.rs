//! Rangefinders: rays from sites and cameras, and the geoms that they meet.

use super::frame::Frame;
use super::ground::{self, Any};
use super::ray::{Nearest, distance, normal, triangle};
use crate::lane::{Lane, Mask, Real};
use crate::math::vec3::{Vec3, add, mul, mul_t, scale_add, select, splat, zero};
use crate::model::{Instance, RayField, Sensor, Shape, Surface};
use crate::position::Position;

/// What a ray meets first.
struct Met<L> {
    at: Nearest<L>,
    /// Normal of the surface, world axes.
    normal: Vec3<L>,
}

/// Finds what a rangefinder returns, ray by ray, and hands it over number by number.
pub(super) fn measure<L: Lane>(
    model: Instance<'_, L>,
    position: &Position<L>,
    sensor: &Sensor<L::Real>,
    any: Any<'_, L::Mask>,
    mut put: impl FnMut(L),
) {
    let frame = Frame::new(&model, position, sensor.mount);
    let inclined = sensor.fields & RayField::Normal.bit() != 0;
    for ray in &model.rays[sensor.items.range()] {
        let from = frame.moved(&splat(&ray.pos));
        let direction = mul(&frame.rot, &splat(&ray.dir));
        let met = cast(model, position, sensor.id, (&from, &direction), inclined, any);
        let dist = met.at.0;
        let hit = dist.ge(L::zero());
        let shown = |x: Vec3<L>| select(hit, &x, &zero());
        let origin = add(&from.origin, &from.pos);
        for field in RayField::of(sensor.fields) {
            match field {
                RayField::Dist => put(dist),
                RayField::Depth => put(L::select(hit, dist * L::splat(ray.depth), dist)),
                RayField::Dir => shown(direction).into_iter().for_each(&mut put),
                RayField::Origin => origin.into_iter().for_each(&mut put),
                RayField::Point => shown(scale_add(dist, &direction, &origin)).into_iter().for_each(&mut put),
                RayField::Normal => shown(met.normal).into_iter().for_each(&mut put),
            }
        }
    }
}

/// The nearest geom along a ray that is not of `body`.
#[inline(always)]
fn cast<L: Lane>(
    model: Instance<'_, L>,
    position: &Position<L>,
    body: u32,
    (from, direction): (&Frame<L>, &Vec3<L>),
    inclined: bool,
    any: Any<'_, L::Mask>,
) -> Met<L> {
    let mut met = Met { at: Nearest::none(), normal: zero() };
    for target in model.targets.iter().filter(|target| target.seen && target.body != body) {
        let frame = Frame::new(&model, position, target.mount);
        let (p, v) = (mul_t(&frame.rot, &from.from(&frame)), mul_t(&frame.rot, direction));
        let size = splat(&target.size);
        let (at, own) = match target.shape {
            Shape::Mesh => pierce(&model.surfaces[target.surface as usize], &p, &v),
            Shape::HeightField => ground::meet(&model.heights[target.surface as usize], &p, &v, any),
            shape => {
                let at = distance(shape, &size, &p, &v);
                (at, if inclined { normal(shape, &size, &scale_add(at, &v, &p)) } else { zero() })
            }
        };
        let nearer = met.at.take(at, L::Mask::splat(true));
        if inclined {
            met.normal = select(nearer, &mul(&frame.rot, &own), &met.normal);
        }
    }
    met
}

/// Distance along a ray to the nearest of some triangles, from either side, and that one's normal; -1: none is met.
fn pierce<L: Lane>(surface: &Surface, p: &Vec3<L>, v: &Vec3<L>) -> (L, Vec3<L>) {
    let (mut nearest, mut normal) = (Nearest::none(), zero());
    for face in &surface.faces {
        let [a, b, c] = face.map(|corner| surface.vertices[corner as usize].map(L::of));
        let (at, ok, own) = triangle([a, b, c], p, v);
        let nearer = nearest.take(at, ok);
        normal = select(nearer, &own, &normal);
    }
    (nearest.0, normal)
}

/// Where a camera sees a point, pixels from the upper left corner of its picture.
pub(super) fn project<L: Lane>(sensor: &Sensor<L::Real>, camera: &Frame<L>, point: &Frame<L>) -> [L; 2] {
    let [x, y, z] = mul_t(&camera.rot, &point.from(camera));
    let [across, down, half_width, half_height]: [L; 4] = splat(&sensor.lens);
    // In the plane of the camera, a point is beyond all pictures.
    let flat = z.abs().lt(L::of(L::Real::MINVAL));
    let inverse = L::one() / L::select(flat, L::of(L::Real::MINVAL), z);
    [half_width - across * x * inverse, half_height + down * y * inverse]
}
