//! Orientations of links as quaternions, composed from joint to joint as MuJoCo does: which of the two that are one rotation, the
//! signs of a weld's rows and of sensors tell.

use crate::lane::{Lane, sin_cos};
use crate::math::quat::{self, Quat};
use crate::math::vec3::splat;
use crate::model::{JointKind, Model, NONE};

/// Orientations of the given links, parents first, at their places.
pub(crate) fn quaternions<L: Lane>(
    model: &Model<L::Real>,
    qpos: &[L],
    links: impl Iterator<Item = u32>,
    out: &mut [Quat<L>],
) {
    for l in links {
        let link = &model.links[l as usize];
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
        out[l as usize] = turn;
    }
}
