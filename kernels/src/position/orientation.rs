//! Orientations of links as quaternions, composed from joint to joint as MuJoCo does: which of the two that are one rotation, the
//! signs of a weld's rows and of sensors tell.

use super::Configuration;
use crate::lane::{Lane, sin_cos};
use crate::math::quat::{self, Quat};
use crate::math::vec3::splat;
use crate::model::{JointKind, Model, NONE};

/// Orientations of the given links, parents first, at their places.
pub(crate) fn quaternions<L: Lane>(
    model: &Model<L::Real>,
    configuration: Configuration<'_, L>,
    links: impl Iterator<Item = u32>,
    out: &mut [Quat<L>],
) {
    for l in links {
        let parent = model.links[l as usize].parent;
        let before = (parent != NONE).then(|| out[parent as usize]);
        out[l as usize] = turned(model, configuration, l, before);
    }
}

/// Orientation of a link that its parent, turned by `before`, carries; or that the world does.
#[inline(always)]
pub fn turned<L: Lane>(
    model: &Model<L::Real>,
    configuration: Configuration<'_, L>,
    l: u32,
    before: Option<Quat<L>>,
) -> Quat<L> {
    let link = &model.links[l as usize];
    if let Some((_, quat)) = configuration.mocap(link) {
        return quat;
    }
    let placed = splat(&link.quat);
    let mut turn = before.map_or(placed, |before| quat::mul(&before, &placed));
    for joint in &model.joints[link.joints.range()] {
        let q = &configuration.qpos[joint.qpos as usize..];
        match joint.kind {
            JointKind::Free => turn = quat::unit(&[q[3], q[4], q[5], q[6]]),
            JointKind::Ball => turn = quat::mul(&turn, &quat::unit(&[q[0], q[1], q[2], q[3]])),
            JointKind::Hinge => {
                let (sin, cos) = sin_cos((q[0] - L::splat(joint.qpos0)) * L::of(0.5));
                let axis: [L; 3] = splat(&joint.axis);
                turn = quat::mul(&turn, &[cos, sin * axis[0], sin * axis[1], sin * axis[2]]);
            }
            JointKind::Slide => {}
        }
    }
    turn
}

/// Orientation of a frame that is turned by `own` on a link, or in the world for [`NONE`].
#[inline(always)]
pub fn orientation<L: Lane>(
    model: &Model<L::Real>,
    configuration: Configuration<'_, L>,
    mut l: u32,
    own: Quat<L>,
) -> Quat<L> {
    let mut turn = own;
    while l != NONE {
        turn = quat::mul(&turned(model, configuration, l, None), &turn);
        l = model.links[l as usize].parent;
    }
    turn
}
