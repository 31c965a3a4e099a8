//! The space between geoms: how far they are apart, and where they are nearest.

use super::frame::Frame;
use crate::collision::{Body, Candidate, ConvexCollider, Outline, nearest};
use crate::lane::LaneQuery;
use crate::math::vec3::{Vec3, add, scale, scale_add, select, splat, sub, zero};
use crate::model::{Instance, Sensor, SensorKind, Shape};
use crate::position::Position;

/// The shortest way from the geoms on one side to those on the other.
pub(super) struct Way<L> {
    /// Its length, negative when they penetrate; at most the cutoff.
    pub dist: L,
    /// Its direction: a unit vector, or zero where the cutoff is less.
    pub normal: Vec3<L>,
    /// Its ends.
    pub ends: [Vec3<L>; 2],
}

/// Finds the shortest way.
pub(super) fn way<L: LaneQuery>(
    model: Instance<'_, L>,
    position: &Position<L>,
    sensor: &Sensor<L::Real>,
    convex: &dyn ConvexCollider,
) -> Way<L> {
    let mut way = Way { dist: L::splat(sensor.cutoff), normal: zero(), ends: [zero(); 2] };
    for pair in &model.spaces[sensor.items.range()] {
        let targets = pair.map(|target| &model.targets[target as usize]);
        // A collider wants planes first.
        let turned = targets[1].shape == Shape::Plane;
        let [first, second] = if turned { [targets[1], targets[0]] } else { targets };
        let frames = [first, second].map(|target| Frame::new(&model, position, target.mount));
        let body = |k: usize, pos: Vec3<L>| Body { pos, rot: frames[k].rot, size: splat(&[first, second][k].size) };
        let between = add(&frames[1].pos, &sub(&frames[1].origin, &frames[0].origin));
        let outlines = [first, second].map(|target| Outline {
            shape: target.shape,
            hull: model.hulls.get(target.hull as usize),
            heights: None,
        });
        let bodies = [body(0, frames[0].pos), body(1, between)];
        nearest(convex, outlines, &bodies, sensor.cutoff, &mut |found: &Candidate<L>, exists| {
            let nearer = exists & found.dist.lt(way.dist);
            let half = scale(L::of(0.5) * found.dist, &found.normal);
            let at = add(&frames[0].origin, &found.pos);
            let mut ends = [sub(&at, &half), add(&at, &half)];
            let mut along = L::select(found.dist.lt(L::zero()), -L::one(), L::one());
            if turned {
                ends.swap(0, 1);
                along = -along;
            }
            way.dist = L::select(nearer, found.dist, way.dist);
            way.normal = select(nearer, &scale_add(along, &found.normal, &zero()), &way.normal);
            way.ends = [0, 1].map(|k| select(nearer, &ends[k], &way.ends[k]));
        });
    }
    way
}

/// What a sensor says of it.
pub(super) fn numbers<L: LaneQuery>(kind: SensorKind, way: &Way<L>) -> [L; 6] {
    let ([[a, b, c], [d, e, f]], z) = (way.ends, L::zero());
    match kind {
        SensorKind::GeomDist => [way.dist, z, z, z, z, z],
        SensorKind::GeomNormal => [way.normal[0], way.normal[1], way.normal[2], z, z, z],
        _ => [a, b, c, d, e, f],
    }
}
