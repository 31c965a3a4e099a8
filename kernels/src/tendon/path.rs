//! Paths of spatial tendons, piece by piece.

use super::wrap::{Wrapped, wrap};
use crate::lane::Lane;
use crate::math::spatial::{Spatial, dot6, join};
use crate::math::vec3::{
    Mat3, Vec3, add, cross, mul, mul_add, mul_mat, mul_t, neg, normalize, scale, select, splat, sub, zero,
};
use crate::model::{Model, NONE, Passes, Stretch, Tendon};
use crate::position::Position;

/// Length of a spatial tendon; sets its part of the Jacobian.
pub(super) fn measure<L: Lane>(
    model: &Model<L::Real>,
    tendon: &Tendon<L::Real>,
    position: &Position<L>,
    jacobian: &mut [L],
) -> L {
    jacobian[tendon.dofs.range()].fill(L::zero());
    let mut length = L::zero();
    for stretch in &model.stretches[tendon.stretches.range()] {
        let share = L::splat(stretch.share);
        let (own, pulls) = piece(model, stretch, position, share);
        length = share.mul_add(own, length);
        for entry in &model.stretch_dofs[stretch.dofs.range()] {
            let j = &mut jacobian[entry.entry as usize];
            for (pull, _) in pulls.iter().zip(entry.moves).filter(|(_, moves)| *moves) {
                *j += dot6(&position.cdof[entry.dof as usize], pull);
            }
        }
    }
    length
}

/// For a unit of tension along the tendon, what pushes each of a piece's links outwards, at the origin of the link's tree.
#[inline(always)]
pub fn pulls<L: Lane>(model: &Model<L::Real>, stretch: &Stretch<L::Real>, position: &Position<L>) -> [Spatial<L>; 3] {
    piece(model, stretch, position, L::splat(stretch.share)).1
}

/// A piece as if nothing were in its way.
#[derive(Clone, Copy, Debug)]
pub struct Straight<L> {
    /// Its ends, each relative to the origin of the tree of its link.
    pub points: [Vec3<L>; 2],
    /// Direction from the first to the second; (1, 0, 0) if it has none.
    pub unit: Vec3<L>,
    /// Length.
    pub length: L,
}

/// The straight line between a piece's ends.
#[inline(always)]
pub fn straight<L: Lane>(model: &Model<L::Real>, stretch: &Stretch<L::Real>, position: &Position<L>) -> Straight<L> {
    let points = [0, 1].map(|side| placed(position, stretch.links[side], &stretch.pos[side]));
    let [first, second, _] = stretch.links;
    let (unit, length) = normalize(&between(model, position, (&points[1], second), (&points[0], first)));
    Straight { points, unit, length }
}

/// From one point to another, each relative to the origin of the tree of its link.
#[inline(always)]
fn between<L: Lane>(
    model: &Model<L::Real>,
    position: &Position<L>,
    (to, to_link): (&Vec3<L>, u32),
    (from, from_link): (&Vec3<L>, u32),
) -> Vec3<L> {
    let own = sub(to, from);
    if tree(model, to_link) == tree(model, from_link) {
        return own;
    }
    position.moved(model, &own, to_link, from_link)
}

/// Length of a piece, and for a unit of tension along the tendon what pushes each of its links outwards, at the origin of the link's tree.
#[inline(always)]
fn piece<L: Lane>(
    model: &Model<L::Real>,
    stretch: &Stretch<L::Real>,
    position: &Position<L>,
    share: L,
) -> (L, [Spatial<L>; 3]) {
    let Straight { points, unit: straight, length: direct } = straight(model, stretch, position);
    let [first, second, around] = stretch.links;
    let Some(round) = stretch.round else {
        let force = scale(share, &straight);
        return (direct, [push(&points[0], &neg(&force)), push(&points[1], &force), zero()]);
    };
    let middle = placed(position, around, &stretch.middle);
    let own: Mat3<L> = splat(&stretch.rot);
    let rot = if around == NONE { own } else { mul_mat(&position.rot[around as usize], &own) };
    let local = |point: &Vec3<L>, link: u32| mul_t(&rot, &between(model, position, (point, link), (&middle, around)));
    let ends = [local(&points[0], first), local(&points[1], second)];
    let side = match stretch.passes {
        Passes::Either => local(&placed(position, stretch.side_link, &stretch.side), stretch.side_link),
        _ => splat(&stretch.side),
    };
    let Wrapped { wraps, touches, arc } = wrap(round, stretch.passes, L::splat(stretch.radius), &ends, &side);
    let (leave, before) = normalize(&mul(&rot, &sub(&touches[0], &ends[0])));
    let (arrive, after) = normalize(&mul(&rot, &sub(&ends[1], &touches[1])));
    let leave = scale(share, &select(wraps, &leave, &straight));
    let arrive = scale(share, &select(wraps, &arrive, &straight));
    let touching = touches.map(|touch| mul_add(&rot, &touch, &middle));
    let held = add(&push(&touching[0], &leave), &push(&touching[1], &neg(&arrive)));
    let pulls = [push(&points[0], &neg(&leave)), push(&points[1], &arrive), select(wraps, &held, &zero())];
    (L::select(wraps, before + arc + after, direct), pulls)
}

/// A point of a link relative to the origin of its tree, or one that stands still.
#[inline(always)]
fn placed<L: Lane>(position: &Position<L>, link: u32, pos: &[L::Real; 3]) -> Vec3<L> {
    let own = splat(pos);
    if link == NONE { own } else { mul_add(&position.rot[link as usize], &own, &position.pos[link as usize]) }
}

fn tree<T>(model: &Model<T>, link: u32) -> u32 {
    if link == NONE { NONE } else { model.links[link as usize].tree }
}

/// A force at a point.
#[inline(always)]
fn push<L: Lane>(point: &Vec3<L>, force: &Vec3<L>) -> Spatial<L> {
    join(&cross(point, force), force)
}
