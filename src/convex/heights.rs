//! A height field and a convex shape: the prisms below the triangles of the field, one by one.

use glam::{DMat3, DVec3};
use lanesim_kernels::collision::{MOST_OF_FIELD, Point};
use lanesim_kernels::model::{HeightField, Shape};

use super::support::Solid;
use super::{nearest, point};

/// Adds the point of every prism that is within `include` of a shape, which is given in the field's axes; in the order of
/// rows, columns, and the two triangles of a cell, as many as there is room for.
pub(super) fn collide(field: &HeightField, other: &Solid<'_>, include: f64, add: &mut dyn FnMut(Point<f64>)) {
    let reach = other.radius + include.max(0.0);
    let high = |axis: DVec3| other.support(axis).dot(axis) + reach;
    let [x, y] = [DVec3::X, DVec3::Y].map(|axis| [-high(-axis), high(axis)]);
    let bottom = -high(-DVec3::Z);
    if high(DVec3::Z) < -field.base {
        return;
    }
    let [rows, columns] = field.size;
    let [width, length] = field.cell();
    let cells = |[low, high]: [f64; 2], half: f64, cell: f64, points: usize| {
        // What is not a number counts as 0.
        let first = ((low + half) / cell).floor().max(0.0) as usize;
        let beyond = ((high + half) / cell).ceil().max(0.0) as usize;
        first..beyond.min(points - 1)
    };
    let mut count = 0;
    for row in cells(y, field.half[1], length, rows) {
        for column in cells(x, field.half[0], width, columns) {
            for triangle in triangles(field, row, column) {
                if triangle.iter().all(|corner| corner.z < bottom) || count == MOST_OF_FIELD {
                    continue;
                }
                if let Some(found) = touch(&triangle, field.base, other, include) {
                    add(found);
                    count += 1;
                }
            }
        }
    }
}

/// The triangles of a cell, which share its diagonal from the least x and y to the largest.
fn triangles(field: &HeightField, row: usize, column: usize) -> [[DVec3; 3]; 2] {
    let at = |i: usize, j: usize| DVec3::from_array(field.point(row + i, column + j));
    let (from, to) = (at(0, 0), at(1, 1));
    [[from, at(1, 0), to], [from, to, at(0, 1)]]
}

/// The point at which a shape is nearest to the prism below a triangle, or deepest in it.
fn touch(triangle: &[DVec3; 3], base: f64, other: &Solid<'_>, include: f64) -> Option<Point<f64>> {
    let low = triangle.map(|corner| corner.with_z(-base));
    let corners = [triangle[0], triangle[1], triangle[2], low[0], low[1], low[2]];
    let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
    let prism = corners.map(|corner| corner - centre);
    let extent = prism.iter().map(|corner| corner.length()).fold(0.0, f64::max);
    let ground = Solid {
        shape: Shape::HeightField,
        hull: None,
        prism: Some(&prism),
        centre,
        rot: DMat3::IDENTITY,
        size: DVec3::ZERO,
        radius: 0.0,
        extent,
    };
    let solids = [ground, *other];
    let found = point(&solids, &nearest(&solids, include + other.radius).ok()?);
    (found.dist <= include).then_some(found)
}
