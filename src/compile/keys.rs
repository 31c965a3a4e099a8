//! Keyframes, completed.

use lanesim_kernels::model as kernel;

use super::joints::qpos0;
use super::order::Scene;
use super::pose::{unit_quat, wxyz};
use crate::model::Key;
use crate::spec::{JointKind, Spec};

/// The keyframes with every field filled in and every quaternion of length one. None is longer than the model's.
pub(crate) fn keys(
    spec: &Spec,
    scene: &Scene,
    (joints, rest): (&[kernel::Joint<f64>], &[f64]),
    history: &[f64],
) -> Vec<Key> {
    let mocap = || scene.bodies.iter().filter(|b| b.mocap.is_some());
    let defaults = Key {
        qpos: qpos0(scene),
        qvel: vec![0.0; scene.nv],
        act: vec![0.0; spec.activations()],
        ctrl: vec![0.0; spec.controls()],
        mpos: mocap().flat_map(|b| b.pose.pos.to_array()).collect(),
        mquat: mocap().flat_map(|b| b.pose.wxyz()).collect(),
        eq_active: spec.equalities.iter().map(|equality| f64::from(u8::from(equality.active))).collect(),
        ..Key::default()
    };
    let complete = |key: &crate::spec::Key| {
        let (mut qpos, mut qvel) = (filled(&key.qpos, &defaults.qpos, 1), filled(&key.qvel, &defaults.qvel, 1));
        for part in &key.parts {
            let Some(body) = scene
                .bodies
                .iter()
                .find(|body| spec.bodies.get(part.body).is_some_and(|written| std::ptr::eq(body.spec, written)))
            else {
                continue;
            };
            let Some(joint) = scene.joints.get(body.joints.start) else { continue };
            copy(&mut qpos, joint.qpos, &part.qpos);
            copy(&mut qvel, joint.dof, &part.qvel);
        }
        let mut ctrl = filled(&key.ctrl, &defaults.ctrl, 1);
        for (name, x) in &key.controls {
            if let Some(actuator) = spec.actuators.iter().position(|actuator| actuator.name == *name) {
                let before = spec.actuators[..actuator].iter().map(crate::spec::Actuator::controls).sum::<usize>();
                copy(&mut ctrl, before, x);
            }
        }
        for joint in &scene.joints {
            match joint.spec.kind {
                JointKind::Free => normalise(&mut qpos[joint.qpos + 3..joint.qpos + 7]),
                JointKind::Ball => normalise(&mut qpos[joint.qpos..joint.qpos + 4]),
                _ => {}
            }
        }
        let mut mquat = filled(&key.mquat, &defaults.mquat, 4);
        mquat.chunks_exact_mut(4).for_each(normalise);
        let mut plastic = filled(&key.plastic, rest, 1);
        for ball in joints.iter().filter(|joint| joint.kind == kernel::JointKind::Ball) {
            plastic.get_mut(ball.plastic as usize..).and_then(|own| own.get_mut(..4)).into_iter().for_each(normalise);
        }
        Key {
            name: key.name.clone(),
            time: key.time,
            qpos,
            qvel,
            act: filled(&key.act, &defaults.act, 1),
            history: history.to_vec(),
            plastic,
            ctrl,
            mpos: filled(&key.mpos, &defaults.mpos, 3),
            mquat,
            eq_active: defaults.eq_active.clone(),
            tree_rest: Vec::new(),
        }
    };
    spec.keys.iter().map(complete).collect()
}

/// What is given, in whole units, and the defaults from there on.
fn filled(given: &Option<Vec<f64>>, defaults: &[f64], unit: usize) -> Vec<f64> {
    let mut out = defaults.to_vec();
    let given = given.as_deref().unwrap_or_default();
    let whole = given.len() / unit * unit;
    out[..whole].copy_from_slice(&given[..whole]);
    out
}

/// Copies numbers to where they belong, if they are as many as there is room for.
fn copy(to: &mut [f64], start: usize, numbers: &[f64]) {
    if let Some(to) = to.get_mut(start..start + numbers.len()) {
        to.copy_from_slice(numbers);
    }
}

fn normalise(quat: &mut [f64]) {
    if let &mut [w, x, y, z] = quat {
        quat.copy_from_slice(&wxyz(unit_quat([w, x, y, z])));
    }
}
