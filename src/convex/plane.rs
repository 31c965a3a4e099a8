//! A plane and a mesh: the deepest vertex, and others that span what is within reach. Of other shapes, which collide by formulas, the
//! deepest point, from which distances are measured.

use glam::DVec3;
use lanesim_kernels::collision::{Body, Point, Points};

use super::support::{Solid, vertex};

/// Most points of a mesh on a plane.
const MOST: usize = 4;
/// Differences below this, relative to the mesh's size, are rounding: of equals the first vertex is taken.
const EQUAL: f64 = 1e-9;

/// Adds the points of a mesh within `include` of a plane: the deepest, the one farthest from it, and the farthest on either side
/// of the line through both; `most` at most.
pub(super) fn collide(mesh: &Solid<'_>, plane: &Body<f64>, include: f64, most: usize, points: &mut Points<f64>) {
    let (rot, origin) = (plane.rot, DVec3::from_array(plane.pos));
    let normal = DVec3::new(rot[2], rot[5], rot[8]);
    let Some(hull) = mesh.hull else { return deepest(mesh, (origin, normal), include, points) };
    let (down, shift) = (mesh.local(-normal), normal.dot(mesh.centre - origin));
    let height = |at: DVec3| shift - down.dot(at);
    let deepest = vertex(hull, hull.support(down.to_array()));
    if height(deepest) > include {
        return;
    }
    let near = || (0..hull.vertices.len() as u32).map(|v| vertex(hull, v)).filter(|at| height(*at) <= include);
    let farthest = |value: &dyn Fn(DVec3) -> f64| {
        let better = |best: (f64, DVec3), at: DVec3| if value(at) > best.0 { (value(at), at) } else { best };
        near().fold((EQUAL * mesh.extent, deepest), better).1
    };
    let second = farthest(&|at| at.distance(deepest));
    let across = (second - deepest).cross(down).normalize_or_zero();
    let sides = [1.0, -1.0].map(|sign| farthest(&|at| sign * across.dot(at - deepest)));
    let mut chosen = [deepest, second, sides[0], sides[1]];
    let mut count = 0;
    for i in 0..MOST {
        if !chosen[..count].contains(&chosen[i]) {
            chosen[count] = chosen[i];
            count += 1;
        }
    }
    for at in &chosen[..count.min(most)] {
        let dist = height(*at);
        let pos = mesh.place(*at) - normal * (0.5 * dist);
        points.push(Point { dist, pos: pos.to_array(), normal: normal.to_array() });
    }
}

/// The deepest point of a shape on a plane.
fn deepest(solid: &Solid<'_>, (origin, normal): (DVec3, DVec3), include: f64, points: &mut Points<f64>) {
    let at = solid.support(-normal) - normal * solid.radius;
    let dist = normal.dot(at - origin);
    if dist <= include {
        let pos = at - normal * (0.5 * dist);
        points.push(Point { dist, pos: pos.to_array(), normal: normal.to_array() });
    }
}
