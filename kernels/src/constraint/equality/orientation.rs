//! Orientations of the links that welds hold, composed from joint to joint: of the two quaternions that are one rotation, the sign of a
//! weld's rows tells which.

use crate::lane::Lane;
use crate::math::quat::Quat;
use crate::math::tree;
use crate::model::{EqualityKind, Model, NONE};

/// The links that welds hold, with all that carry them, parents first.
pub(super) fn turning<T>(model: &Model<T>) -> Vec<u32> {
    let mut links = Vec::new();
    for weld in model.equalities.iter().filter(|equality| equality.kind == EqualityKind::Weld) {
        for mut link in weld.links {
            while link != NONE {
                links.push(link);
                link = model.links[link as usize].parent;
            }
        }
    }
    links.sort_unstable();
    links.dedup();
    links
}

/// Orientations of the given links, at their places.
pub(super) fn quaternions<L: Lane>(model: &Model<L::Real>, qpos: &[L], links: &[u32], out: &mut [Quat<L>]) {
    for l in links {
        let parent = model.links[*l as usize].parent;
        let before = (parent != NONE).then(|| out[parent as usize]);
        out[*l as usize] = tree::turned(model, qpos, *l, before);
    }
}
