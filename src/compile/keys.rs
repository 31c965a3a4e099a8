//! Keyframes, completed.

use super::joints;
use super::order::Scene;
use super::pose::{unit_quat, wxyz};
use crate::model::Key;
use crate::spec::{JointKind, Spec};

/// The keyframes with every field filled in and every quaternion of length one. Sizes have been checked.
pub(crate) fn keys(spec: &Spec, scene: &Scene) -> Vec<Key> {
    let qpos0 = joints::qpos0(scene);
    let mocap = || scene.bodies.iter().filter(|b| b.mocap.is_some());
    let mpos: Vec<f64> = mocap().flat_map(|b| b.pose.pos.to_array()).collect();
    let mquat: Vec<f64> = mocap().flat_map(|b| b.pose.wxyz()).collect();
    let zeros = |n: usize| vec![0.0; n];
    let complete = |key: &crate::spec::Key| {
        let mut qpos = key.qpos.clone().unwrap_or_else(|| qpos0.clone());
        for joint in &scene.joints {
            match joint.spec.kind {
                JointKind::Free => normalise(&mut qpos[joint.qpos + 3..joint.qpos + 7]),
                JointKind::Ball => normalise(&mut qpos[joint.qpos..joint.qpos + 4]),
                _ => {}
            }
        }
        let mut mquat = key.mquat.clone().unwrap_or_else(|| mquat.clone());
        mquat.chunks_exact_mut(4).for_each(normalise);
        Key {
            name: key.name.clone(),
            time: key.time,
            qpos,
            qvel: key.qvel.clone().unwrap_or_else(|| zeros(scene.nv)),
            act: key.act.clone().unwrap_or_default(),
            ctrl: key.ctrl.clone().unwrap_or_else(|| zeros(spec.actuators.len())),
            mpos: key.mpos.clone().unwrap_or_else(|| mpos.clone()),
            mquat,
        }
    };
    spec.keys.iter().map(complete).collect()
}

fn normalise(quat: &mut [f64]) {
    if let &mut [w, x, y, z] = quat {
        quat.copy_from_slice(&wxyz(unit_quat([w, x, y, z])));
    }
}
