//! Orientations of links as quaternions, composed from joint to joint as MuJoCo does: of the two that are one rotation, the
//! sign of a weld's rows tells which.

use crate::lane::{Lane, sin_cos};
use crate::math::quat::{self, Quat};
use crate::math::vec3::splat;
use crate::model::{EqualityKind, JointKind, Model, NONE};

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
        let link = &model.links[*l as usize];
        let placed = splat(&link.quat);
        let mut turn = if link.parent == NONE { placed } else { quat::mul(&out[link.parent as usize], &placed) };
        for joint in &model.joints[link.joints.range()] {
            let q = &qpos[joint.qpos as usize..];
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
        out[*l as usize] = turn;
    }
}
