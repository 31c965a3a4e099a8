//! Actuators and what they add to the joints that they act on.

use glam::DVec3;
use lanesim_kernels::model::{Actuator, Joint, JointKind, Span, Transmission};

use super::bounds;
use super::derived::Derived;
use super::order::Scene;
use super::response::Responses;
use crate::model::Names;
use crate::spec::{self, Bias, Gain, Spec, is_limited};

/// Armature and damping that actuators add to every dof of a joint.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Reflected {
    pub armature: f64,
    pub damping: [f64; 3],
}

/// Joint of every actuator. Names have been checked.
pub(crate) fn targets(spec: &Spec, joints: &Names) -> Vec<usize> {
    let target = |a: &spec::Actuator| {
        let (spec::Transmission::Joint(name) | spec::Transmission::JointInParent(name)) = &a.transmission;
        joints.id(name)
    };
    spec.actuators.iter().filter_map(target).collect()
}

/// What actuators add to each joint: their own armature and damping times the square of the first gear.
pub(crate) fn reflected(spec: &Spec, targets: &[usize], njnt: usize) -> Vec<Reflected> {
    let mut out = vec![Reflected::default(); njnt];
    for (actuator, &joint) in spec.actuators.iter().zip(targets) {
        let squared = actuator.gear[0] * actuator.gear[0];
        out[joint].armature += actuator.armature * squared;
        for (sum, x) in out[joint].damping.iter_mut().zip(actuator.damping) {
            *sum += x * squared;
        }
    }
    out
}

/// The actuators' table, and for MuJoCo's arrays the norm of the acceleration that a unit force causes.
pub(crate) struct Actuators {
    pub table: Vec<Actuator<f64>>,
    /// Sum of the degrees of freedom of their joints.
    pub nmoment: usize,
    /// Control ranges, infinite ones as they are.
    pub ctrl_ranges: Vec<[f64; 2]>,
    pub acc0: Vec<f64>,
    pub length0: Vec<f64>,
}

/// Compiles the actuators in their order.
pub(crate) fn actuators(
    spec: &Spec,
    scene: &Scene,
    targets: &[usize],
    joints: &[Joint<f64>],
    derived: &Derived,
) -> Actuators {
    let mut out =
        Actuators { table: Vec::new(), nmoment: 0, ctrl_ranges: Vec::new(), acc0: Vec::new(), length0: Vec::new() };
    let responses = Responses::new(&derived.hinges);
    for (actuator, &target) in spec.actuators.iter().zip(targets) {
        let joint = &joints[target];
        let mut compiled = actuator_table(spec, actuator, target, joint);
        if let (Some([lo, hi]), true) = (scene.joints[target].spec.range, actuator.inheritrange > 0.0) {
            let (mean, half) = (0.5 * (lo + hi), 0.5 * (hi - lo) * actuator.inheritrange);
            let range = [mean - half, mean + half];
            out.ctrl_ranges.push(range);
            set_ctrl_range(&mut compiled, range, actuator.ctrllimited);
        } else {
            out.ctrl_ranges.push(actuator.ctrlrange.unwrap_or_default());
        }
        let row = moment_row(&compiled, joint, derived);
        compiled.moments = Span { start: out.nmoment as u32, len: row.len() as u32 };
        out.nmoment += row.len();
        let response = responses.to(joint.dof as usize, &row);
        out.acc0.push(response.norm);
        out.length0.push(match joint.kind {
            JointKind::Slide | JointKind::Hinge => compiled.gear[0] * joint.qpos0,
            _ => 0.0,
        });
        if actuator.dampratio > 0.0 {
            let mass = 1.0 / response.along.max(1e-15);
            compiled.bias[2] = -2.0 * actuator.dampratio * (compiled.gain[0].max(0.0) * mass).sqrt();
            compiled.bias_affine = true;
        }
        out.table.push(compiled);
    }
    out
}

fn actuator_table(spec: &Spec, a: &spec::Actuator, target: usize, joint: &Joint<f64>) -> Actuator<f64> {
    let in_parent = matches!(a.transmission, spec::Transmission::JointInParent(_));
    let transmission = match (joint.kind, in_parent) {
        (JointKind::Ball, false) => Transmission::Ball,
        (JointKind::Ball, true) => Transmission::BallInParent,
        (JointKind::Free, false) => Transmission::Free,
        (JointKind::Free, true) => Transmission::FreeInParent,
        _ => Transmission::Scalar,
    };
    let gain = match a.gain {
        Gain::Fixed => [a.gainprm[0], 0.0, 0.0],
        Gain::Affine => a.gainprm,
    };
    let bias = match a.bias {
        Bias::None => [0.0; 3],
        Bias::Affine => a.biasprm,
    };
    let groups = spec.option.actuatorgroupdisable;
    let force_range = a.forcerange.unwrap_or_default();
    let mut compiled = Actuator {
        transmission,
        joint: target as u32,
        qpos: joint.qpos,
        dof: joint.dof,
        moments: Span::default(),
        gain_affine: gain[1..] != [0.0; 2],
        bias_affine: bias != [0.0; 3],
        ctrl_limited: false,
        force_limited: is_limited(a.forcerange, a.forcelimited) && !bounds::are_none(force_range),
        disabled: u32::try_from(a.group).ok().and_then(|g| groups.checked_shr(g)).is_some_and(|g| g & 1 == 1),
        gear: a.gear,
        gain,
        bias,
        ctrl_range: [0.0; 2],
        force_range: bounds::of_clamp(force_range),
    };
    set_ctrl_range(&mut compiled, a.ctrlrange.unwrap_or_default(), a.ctrllimited);
    compiled
}

/// Gives an actuator a control range, which is in force if the flag says so.
fn set_ctrl_range(compiled: &mut Actuator<f64>, range: [f64; 2], flag: spec::Tri) {
    compiled.ctrl_range = bounds::of_clamp(range);
    compiled.ctrl_limited = is_limited(Some(range), flag) && !bounds::are_none(range);
}

/// Derivative of an actuator's length by the dofs of its joint, in the reference configuration.
fn moment_row(actuator: &Actuator<f64>, joint: &Joint<f64>, derived: &Derived) -> Vec<f64> {
    let g = actuator.gear;
    match actuator.transmission {
        Transmission::Scalar => vec![g[0]],
        // A ball joint's reference is the identity: both frames agree.
        Transmission::Ball | Transmission::BallInParent => g[..3].to_vec(),
        Transmission::Free => g.to_vec(),
        Transmission::FreeInParent => {
            let local = derived.orientation(joint.link).conjugate() * DVec3::new(g[3], g[4], g[5]);
            vec![g[0], g[1], g[2], local.x, local.y, local.z]
        }
    }
}
