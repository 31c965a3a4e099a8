//! Shapes as support functions.

use glam::{DMat3, DVec3};
use lanesim_kernels::collision::{Body, Outline};
use lanesim_kernels::model::{Hull, Shape};

/// Corners of the prism below a triangle: those above, then those at the ground.
pub(super) type Prism = [DVec3; 6];

/// A convex shape in place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solid<'a> {
    pub shape: Shape,
    /// Of a mesh.
    pub hull: Option<&'a Hull>,
    /// Of what lies below a triangle of a height field.
    pub prism: Option<&'a Prism>,
    pub centre: DVec3,
    /// Shape to world.
    pub rot: DMat3,
    pub size: DVec3,
    /// Radius about the core: that of spheres and capsules.
    pub radius: f64,
    /// Radius of a sphere about the centre that holds the core.
    pub extent: f64,
}

impl<'a> Solid<'a> {
    pub fn new(Outline { shape, hull, .. }: Outline<'a>, body: &Body<f64>) -> Solid<'a> {
        let size = DVec3::from_array(body.size);
        let (radius, extent) = match shape {
            Shape::Plane | Shape::HeightField => (0.0, 0.0),
            Shape::Sphere => (size.x, 0.0),
            Shape::Capsule => (size.x, size.y),
            Shape::Ellipsoid => (0.0, size.max_element()),
            Shape::Cylinder => (0.0, size.x.hypot(size.y)),
            Shape::Box | Shape::Mesh => (0.0, size.length()),
        };
        let rot = DMat3::from_cols_array(&body.rot).transpose();
        Solid { shape, hull, prism: None, centre: DVec3::from_array(body.pos), rot, size, radius, extent }
    }

    /// A direction in the shape's own axes.
    pub fn local(&self, direction: DVec3) -> DVec3 {
        self.rot.transpose() * direction
    }

    /// A point of the shape's own axes in place.
    pub fn place(&self, local: DVec3) -> DVec3 {
        self.centre + self.rot * local
    }

    /// The core's farthest point along a direction.
    pub fn support(&self, direction: DVec3) -> DVec3 {
        let d = self.local(direction);
        let s = self.size;
        self.place(match self.shape {
            Shape::Plane | Shape::Sphere => DVec3::ZERO,
            Shape::HeightField => self.prism.map_or(DVec3::ZERO, |prism| farthest(prism, d)),
            Shape::Capsule => DVec3::new(0.0, 0.0, s.y.copysign(d.z)),
            Shape::Ellipsoid => {
                let scaled = s * d;
                s * scaled / scaled.length().max(f64::MIN_POSITIVE)
            }
            Shape::Cylinder => {
                let across = (d.x * d.x + d.y * d.y).sqrt();
                let rim = if across > 0.0 { DVec3::new(d.x, d.y, 0.0) / across } else { DVec3::X };
                s.x * rim + DVec3::new(0.0, 0.0, s.y.copysign(d.z))
            }
            Shape::Box => DVec3::new(s.x.copysign(d.x), s.y.copysign(d.y), s.z.copysign(d.z)),
            Shape::Mesh => self.hull.map_or(DVec3::ZERO, |hull| vertex(hull, hull.support(d.to_array()))),
        })
    }
}

/// The corner of a prism that is farthest along a direction.
fn farthest(prism: &Prism, direction: DVec3) -> DVec3 {
    let better = |best: DVec3, next: &DVec3| if next.dot(direction) > best.dot(direction) { *next } else { best };
    prism.iter().fold(prism[0], better)
}

/// A vertex of a hull, in its own axes.
pub(super) fn vertex(hull: &Hull, vertex: u32) -> DVec3 {
    DVec3::from_array(hull.vertices[vertex as usize])
}

/// A point of the difference of two solids, second minus first, with the points that it comes from.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Vertex {
    pub at: DVec3,
    pub on: [DVec3; 2],
}

/// The difference's farthest point along a direction.
pub(super) fn difference(solids: &[Solid<'_>; 2], direction: DVec3) -> Vertex {
    let on = [solids[0].support(-direction), solids[1].support(direction)];
    Vertex { at: on[1] - on[0], on }
}

/// The points of both solids with the given weights.
pub(super) fn combine(vertices: &[Vertex], weights: &[f64]) -> [DVec3; 2] {
    let mut on = [DVec3::ZERO; 2];
    for (vertex, weight) in vertices.iter().zip(weights) {
        on[0] += vertex.on[0] * *weight;
        on[1] += vertex.on[1] * *weight;
    }
    on
}
