//! Orientations of links as quaternions, composed from joint to joint as MuJoCo does: which of the two that are one rotation, the
//! signs of a weld's rows and of sensors tell.

use crate::lane::Lane;
use crate::math::quat::Quat;
use crate::math::tree;
use crate::model::{Model, NONE};

/// Orientations of the given links, parents first, at their places.
pub(crate) fn quaternions<L: Lane>(
    model: &Model<L::Real>,
    qpos: &[L],
    links: impl Iterator<Item = u32>,
    out: &mut [Quat<L>],
) {
    for l in links {
        let parent = model.links[l as usize].parent;
        let before = (parent != NONE).then(|| out[parent as usize]);
        out[l as usize] = tree::turned(model, qpos, l, before);
    }
}
