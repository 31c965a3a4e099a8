//! Joints and their degrees of freedom.

use glam::DVec3;
use lanesim_kernels::model::{AxisKind, Dof, DofKind, Joint, JointKind, NONE};

use super::bounds;
use super::derived;
use super::links::Links;
use super::order::{self, Scene};
use super::pose::snap;
use crate::spec::{self, is_limited};

/// Armature and damping that actuators add to every dof of a joint.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Reflected {
    pub armature: f64,
    pub damping: [f64; 3],
}

/// The joints of a scene, without what `springdamper` says.
pub(crate) fn joints(scene: &Scene, links: &Links) -> Vec<Joint<f64>> {
    scene.joints.iter().map(|j| joint(j, links.body_link[j.body], scene)).collect()
}

fn joint(j: &order::Joint, link: u32, scene: &Scene) -> Joint<f64> {
    let spec = j.spec;
    let kind = match spec.kind {
        spec::JointKind::Free => JointKind::Free,
        spec::JointKind::Ball => JointKind::Ball,
        spec::JointKind::Slide => JointKind::Slide,
        spec::JointKind::Hinge => JointKind::Hinge,
    };
    let scalar = matches!(kind, JointKind::Slide | JointKind::Hinge);
    let axis = if scalar { unit_axis(spec.axis) } else { [0.0, 0.0, 1.0] };
    // Negative zeros would count as an anchor.
    let pos = if kind == JointKind::Free { [0.0; 3] } else { spec.pos.map(|x| x + 0.0) };
    let mut qpos_spring = [0.0; 7];
    match kind {
        JointKind::Free => {
            let pose = &scene.bodies[j.body].pose;
            qpos_spring[..3].copy_from_slice(&pose.pos.to_array());
            qpos_spring[3..].copy_from_slice(&pose.wxyz());
        }
        JointKind::Ball => qpos_spring[0] = 1.0,
        _ => qpos_spring[0] = spec.springref,
    }
    let force_range = spec.actuatorfrcrange.unwrap_or_default();
    let limited = is_limited(spec.actuatorfrcrange, spec.actuatorfrclimited);
    let force_limited = scalar && limited && !bounds::are_none(force_range);
    Joint {
        kind,
        link,
        qpos: j.qpos as u32,
        dof: j.dof as u32,
        axis_kind: axis_kind(axis),
        anchored: pos != [0.0; 3],
        spring: spec.stiffness != [0.0; 3],
        plastic: NONE,
        springyield: spec.springyield,
        actuator_gravcomp: spec.actuatorgravcomp,
        force_limited,
        pos,
        axis,
        qpos0: if scalar { spec.reference } else { 0.0 },
        qpos_spring,
        stiffness: spec.stiffness,
        force_range: bounds::of_clamp(force_range),
    }
}

/// The axis with length one; exact if it is a coordinate axis.
fn unit_axis(axis: [f64; 3]) -> [f64; 3] {
    let unit = DVec3::from(axis).normalize_or(DVec3::Z).to_array().map(snap);
    if axis_kind(unit) == AxisKind::General { DVec3::from(axis).normalize_or(DVec3::Z).to_array() } else { unit }
}

fn axis_kind(axis: [f64; 3]) -> AxisKind {
    // Beside a component that rounds to one, another may be small and not zero.
    let along = |i: usize| axis[i].abs() == 1.0 && (0..3).all(|k| k == i || axis[k] == 0.0);
    match (0..3).find(|&i| along(i)) {
        Some(i) if axis[i] > 0.0 => AxisKind::Plus(i as u8),
        Some(i) => AxisKind::Minus(i as u8),
        None => AxisKind::General,
    }
}

/// The degrees of freedom of the joints. `reflected` is what actuators add, per joint.
pub(crate) fn dofs(scene: &Scene, links: &Links, reflected: &[Reflected]) -> Vec<Dof<f64>> {
    let mut dofs: Vec<Dof<f64>> = Vec::with_capacity(scene.nv);
    for (index, j) in scene.joints.iter().enumerate() {
        let link = links.body_link[j.body];
        let kinds: Vec<DofKind> = match j.spec.kind {
            spec::JointKind::Free => {
                (0..3).map(DofKind::FreeTranslation).chain((0..3).map(DofKind::FreeRotation)).collect()
            }
            spec::JointKind::Ball => (0..3).map(DofKind::BallRotation).collect(),
            spec::JointKind::Slide => vec![DofKind::Slide],
            spec::JointKind::Hinge => vec![DofKind::Hinge],
        };
        for kind in kinds {
            let parent = match dofs.last() {
                Some(last) if last.link == link => dofs.len() as u32 - 1,
                _ => links.last_dof(links.links[link as usize].parent),
            };
            let mut dof = Dof {
                kind,
                link,
                joint: index as u32,
                parent,
                free_base: match kind {
                    DofKind::FreeTranslation(k) => dofs.len() as u32 - u32::from(k),
                    DofKind::FreeRotation(k) => dofs.len() as u32 - 3 - u32::from(k),
                    _ if parent == NONE => NONE,
                    _ => dofs[parent as usize].free_base,
                },
                simple: derived::is_simple(scene, links, j.body),
                damped: false,
                damping_linear: true,
                armature: j.spec.armature + reflected[index].armature,
                damping: [0.0; 3],
                invweight: 0.0,
            };
            set_damping(&mut dof, j.spec.damping, &reflected[index]);
            dofs.push(dof);
        }
    }
    dofs
}

/// Sets the damping to the joint's, and adds that of its actuators.
pub(crate) fn set_damping(dof: &mut Dof<f64>, joint: [f64; 3], reflected: &Reflected) {
    dof.damping = std::array::from_fn(|k| joint[k] + reflected.damping[k]);
    dof.damped = dof.damping != [0.0; 3];
    dof.damping_linear = dof.damping[1..] == [0.0; 2];
}

/// Positions in the reference configuration.
pub(crate) fn qpos0(scene: &Scene) -> Vec<f64> {
    positions(scene, |j| j.reference)
}

/// Positions at which springs rest.
pub(crate) fn qpos_spring(scene: &Scene) -> Vec<f64> {
    positions(scene, |j| j.springref)
}

fn positions(scene: &Scene, scalar: impl Fn(&spec::Joint) -> f64) -> Vec<f64> {
    let mut qpos = Vec::with_capacity(scene.nq);
    for j in &scene.joints {
        match j.spec.kind {
            spec::JointKind::Free => {
                let pose = &scene.bodies[j.body].pose;
                qpos.extend(pose.pos.to_array());
                qpos.extend(pose.wxyz());
            }
            spec::JointKind::Ball => qpos.extend([1.0, 0.0, 0.0, 0.0]),
            _ => qpos.push(scalar(j.spec)),
        }
    }
    qpos
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_that_is_nearly_straight_is_not() {
        assert_eq!(axis_kind([0.0, 0.0, -1.0]), AxisKind::Minus(2));
        assert_eq!(axis_kind([-2.3e-8, 0.0, -1.0]), AxisKind::General);
    }
}
