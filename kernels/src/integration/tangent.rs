//! Positions as points of a manifold: what is between two of them is a vector with one number per dof.

use super::advance;
use crate::lane::Lane;
use crate::math::quat::{self, Quat};
use crate::model::{JointKind, Model};

/// q ⊕ `step`: a rotation turns by its three numbers in its own axes, everything else adds. A quaternion that does not turn stays as it
/// is, of whatever length.
pub fn displace<L: Lane>(model: &Model<L::Real>, qpos: &[L], step: &[L], out: &mut [L]) {
    advance(model, [qpos, &[]], step, L::one(), [out, &mut []]);
    for joint in &model.joints {
        let (at, turn) = match joint.kind {
            JointKind::Free => (joint.qpos as usize + 3, joint.dof as usize + 3),
            JointKind::Ball => (joint.qpos as usize, joint.dof as usize),
            JointKind::Slide | JointKind::Hinge => continue,
        };
        let still = step[turn..turn + 3].iter().fold(L::zero(), |sum, x| sum + x.abs()).eq(L::zero());
        for i in at..at + 4 {
            out[i] = L::select(still, qpos[i], out[i]);
        }
    }
}

/// `to` ⊖ `from`: the vector by which one is displaced to be the other; of rotations the shortest. Quaternions must be of length one.
pub fn difference<L: Lane>(model: &Model<L::Real>, from: &[L], to: &[L], out: &mut [L]) {
    let turn = |at: usize| {
        let quat = |q: &[L]| -> Quat<L> { [q[at], q[at + 1], q[at + 2], q[at + 3]] };
        quat::log(&quat::mul(&quat::conjugate(&quat(from)), &quat(to)))
    };
    for joint in &model.joints {
        let (q, v) = (joint.qpos as usize, joint.dof as usize);
        match joint.kind {
            JointKind::Free => {
                (0..3).for_each(|k| out[v + k] = to[q + k] - from[q + k]);
                out[v + 3..v + 6].copy_from_slice(&turn(q + 3));
            }
            JointKind::Ball => out[v..v + 3].copy_from_slice(&turn(q)),
            JointKind::Slide | JointKind::Hinge => out[v] = to[q] - from[q],
        }
    }
}
