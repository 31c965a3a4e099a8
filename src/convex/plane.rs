//! A plane and a mesh: the deepest vertex, and the corners of the face that lies flattest on the plane there. Of other shapes, which
//! collide by formulas, the deepest point, from which distances are measured.

use glam::DVec3;
use lanesim_kernels::collision::{Body, Point};

use super::calipers::spanning;
use super::support::{Solid, vertex};

/// Adds the points of a mesh within `include` of a plane, `most` at most: corners of the face, the deepest first; of more than four
/// corners, those that span it.
pub(super) fn collide(
    mesh: &Solid<'_>,
    plane: &Body<f64>,
    include: f64,
    most: usize,
    found: &mut dyn FnMut(Point<f64>),
) {
    let (rot, origin) = (plane.rot, DVec3::from_array(plane.pos));
    let normal = DVec3::new(rot[2], rot[5], rot[8]);
    let Some(hull) = mesh.hull else { return deepest(mesh, (origin, normal), include, found) };
    let (down, shift) = (mesh.local(-normal), normal.dot(mesh.centre - origin));
    let top = hull.support(down.to_array());
    let mut add = |corner: u32| {
        let at = vertex(hull, corner);
        let dist = shift - down.dot(at);
        if dist <= include {
            let pos = mesh.place(at) - normal * (0.5 * dist);
            found(Point { dist, pos: pos.to_array(), normal: normal.to_array() });
        }
    };
    let flat = |normal: &[f64; 3]| DVec3::from_array(*normal).dot(down);
    let face = hull.faces_at(top).max_by(|a, b| flat(&a.normal).total_cmp(&flat(&b.normal)));
    let Some(corners) = face.map(|face| &face.corners) else { return add(top) };
    let first = corners.iter().position(|corner| *corner == top).unwrap_or(0);
    let corner = |i: usize| corners[(first + i) % corners.len()];
    spanning(corners.len(), |i| vertex(hull, corner(i))).take(most).for_each(|i| add(corner(i)));
}

/// The deepest point of a shape on a plane.
fn deepest(solid: &Solid<'_>, (origin, normal): (DVec3, DVec3), include: f64, found: &mut dyn FnMut(Point<f64>)) {
    let at = solid.support(-normal) - normal * solid.radius;
    let dist = normal.dot(at - origin);
    if dist <= include {
        let pos = at - normal * (0.5 * dist);
        found(Point { dist, pos: pos.to_array(), normal: normal.to_array() });
    }
}
