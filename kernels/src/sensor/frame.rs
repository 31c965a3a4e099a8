//! Frames that are fixed to links, and how they move.

use super::Seen;
use crate::lane::Lane;
use crate::math::spatial::{lin, rot};
use crate::math::vec3::{Mat3, Vec3, add, cross, mul_add, mul_mat, neg, splat, sub, zero};
use crate::model::{Instance, Model, NONE};
use crate::position::Position;

/// A frame in the world.
#[derive(Clone, Copy)]
pub(super) struct Frame<L> {
    link: u32,
    /// Origin of its link's tree; zero for frames that stand still.
    pub origin: Vec3<L>,
    /// Position relative to that, world axes.
    pub pos: Vec3<L>,
    /// Orientation: frame to world.
    pub rot: Mat3<L>,
}

impl<L: Lane> Frame<L> {
    /// A mount of the model.
    #[inline(always)]
    pub fn new(model: &Model<L::Real>, position: &Position<L>, mount: u32) -> Frame<L> {
        let mount = &model.mounts[mount as usize];
        let frame = Frame::fixed(model, position, mount.link, &mount.pos);
        let own = splat(&mount.rot);
        let rot = if mount.link == NONE { own } else { mul_mat(&frame.rot, &own) };
        Frame { rot, ..frame }
    }

    /// A point of a link, or of the world ([`NONE`]), with that one's axes.
    #[inline(always)]
    pub fn fixed(model: &Model<L::Real>, position: &Position<L>, link: u32, pos: &[L::Real; 3]) -> Frame<L> {
        let pos = splat(pos);
        if link == NONE {
            let (one, z) = (L::one(), L::zero());
            return Frame { link, origin: zero(), pos, rot: [one, z, z, z, one, z, z, z, one] };
        }
        let (l, tree) = (link as usize, model.links[link as usize].tree as usize);
        let (origin, rot) = (position.origin[tree], position.rot[l]);
        Frame { link, origin, pos: mul_add(&rot, &pos, &position.pos[l]), rot }
    }

    /// The same with another position, told in its axes.
    #[inline(always)]
    pub fn moved(&self, by: &Vec3<L>) -> Frame<L> {
        Frame { pos: mul_add(&self.rot, by, &self.pos), ..*self }
    }

    /// The way to it from another.
    #[inline(always)]
    pub fn from(&self, other: &Frame<L>) -> Vec3<L> {
        add(&sub(&self.pos, &other.pos), &sub(&self.origin, &other.origin))
    }

    /// Angular and linear velocity, world axes.
    #[inline(always)]
    pub fn velocity(&self, seen: &Seen<'_, L>) -> [Vec3<L>; 2] {
        if self.link == NONE {
            return [zero(); 2];
        }
        point_velocity(&seen.velocity.cvel[self.link as usize], &self.pos)
    }

    /// Angular and linear acceleration, world axes, that of gravity upwards in it.
    #[inline(always)]
    pub fn acceleration(&self, model: Instance<'_, L>, seen: &Seen<'_, L>) -> [Vec3<L>; 2] {
        point_acceleration(model, seen, self.link, &self.pos)
    }
}

/// Angular and linear velocity of a point of a body that has a spatial velocity.
#[inline(always)]
pub(super) fn point_velocity<L: Lane>(motion: &[L; 6], at: &Vec3<L>) -> [Vec3<L>; 2] {
    let turn = rot(motion);
    [turn, add(&lin(motion), &cross(&turn, at))]
}

/// Angular and linear acceleration of a point of a link, or of one that stands still ([`NONE`]): the rate of the velocity of the
/// matter that is there, which the spatial acceleration is not.
#[inline(always)]
pub(super) fn point_acceleration<L: Lane>(
    model: Instance<'_, L>,
    seen: &Seen<'_, L>,
    link: u32,
    at: &Vec3<L>,
) -> [Vec3<L>; 2] {
    if link == NONE {
        return [zero(), neg(&model.gravity())];
    }
    let [turn, shift] = point_velocity(&seen.velocity.cvel[link as usize], at);
    let [turning, rising] = point_velocity(&seen.cacc[link as usize], at);
    [turning, add(&rising, &cross(&turn, &shift))]
}
