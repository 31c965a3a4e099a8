//! What a unit force of an actuator accelerates, in the reference configuration.
//!
//! Most forces act on the dofs of one joint, or on dofs along one path to the root. Only the dofs on that path need their
//! accelerations one by one. The subtrees that hang off this path follow passively: the sum of the squares of their
//! accelerations is a quadratic form in the motion of the dof that they hang on. The forms are gathered once, from the
//! leaves on, so that such an actuator costs as much as its joint is deep, however large the model is.

use lanesim_kernels::model::{MomentDof, NONE};

use super::derived::{Hinge, Response, Spatial, Symmetric};

/// Squared accelerations of the subtrees of a model, as forms in the motion that carries them.
pub(super) struct Responses<'a> {
    hinges: &'a [Hinge],
    /// Of all dofs beyond a dof, by the motion behind it.
    beyond: Vec<Symmetric>,
    /// Of a dof's siblings and all that they carry, by the motion behind their parent.
    beside: Vec<Symmetric>,
}

impl<'a> Responses<'a> {
    pub fn new(hinges: &'a [Hinge]) -> Self {
        let n = hinges.len();
        let mut own = vec![Symmetric::ZERO; n];
        let (mut beyond, mut beside) = (own.clone(), own.clone());
        for k in (0..n).rev().filter(|&k| hinges[k].parent != NONE) {
            let parent = hinges[k].parent as usize;
            own[k] = carried(&hinges[k], &beyond[k]);
            beside[k] = beyond[parent];
            beyond[parent].add(&own[k]);
        }
        let mut before = vec![Symmetric::ZERO; n];
        for k in (0..n).filter(|&k| hinges[k].parent != NONE) {
            let parent = hinges[k].parent as usize;
            beside[k].add(&before[parent]);
            before[parent].add(&own[k]);
        }
        Responses { hinges, beyond, beside }
    }

    /// Those of a force `moment` on the given dofs, which ascend.
    pub fn to(&self, dofs: &[MomentDof], moment: &[f64]) -> Response {
        let Some(last) = dofs.last() else { return Response { norm: 0.0, along: 0.0 } };
        let mut path = Vec::new();
        let (mut next, mut forces) = (last.dof, dofs.iter().zip(moment).rev().peekable());
        while next != NONE {
            let own = forces.next_if(|(entry, _)| entry.dof == next).map_or(0.0, |(_, moment)| *moment);
            path.push((next as usize, own));
            next = self.hinges[next as usize].parent;
        }
        if forces.peek().is_some() { self.to_branches(dofs, moment) } else { self.to_path(path) }
    }

    /// Of a force on dofs from a leaf to the root.
    fn to_path(&self, path: Vec<(usize, f64)>) -> Response {
        let last = path[0].0;
        let mut bias = Spatial::ZERO;
        let mut rest = Vec::with_capacity(path.len());
        for (k, force) in path {
            let hinge = &self.hinges[k];
            let left = force - hinge.axis.dot(bias);
            rest.push((k, force, left));
            bias.add_scaled(hinge.force, left / hinge.inertia);
            bias = bias.force_to_parent(hinge.shift);
        }
        let mut motion = Spatial::ZERO;
        let (mut squares, mut along) = (0.0, 0.0);
        for (k, force, left) in rest.into_iter().rev() {
            let hinge = &self.hinges[k];
            squares += motion.dot(self.beside[k].times(motion));
            motion = motion.motion_to_child(hinge.shift);
            let qacc = (left - hinge.force.dot(motion)) / hinge.inertia;
            motion.add_scaled(hinge.axis, qacc);
            squares += qacc * qacc;
            along += force * qacc;
        }
        squares += motion.dot(self.beyond[last].times(motion));
        Response { norm: squares.max(0.0).sqrt(), along }
    }

    /// Of a force on dofs anywhere: the accelerations of all.
    fn to_branches(&self, dofs: &[MomentDof], moment: &[f64]) -> Response {
        let n = self.hinges.len();
        let mut left = vec![0.0; n];
        dofs.iter().zip(moment).for_each(|(entry, moment)| left[entry.dof as usize] = *moment);
        let mut bias = vec![Spatial::ZERO; n];
        for (k, hinge) in self.hinges.iter().enumerate().rev() {
            left[k] -= hinge.axis.dot(bias[k]);
            if hinge.parent != NONE {
                let mut push = bias[k];
                push.add_scaled(hinge.force, left[k] / hinge.inertia);
                bias[hinge.parent as usize].add_scaled(push.force_to_parent(hinge.shift), 1.0);
            }
        }
        let mut motions: Vec<Spatial> = Vec::with_capacity(n);
        for (hinge, left) in self.hinges.iter().zip(&mut left) {
            let behind = if hinge.parent == NONE { Spatial::ZERO } else { motions[hinge.parent as usize] };
            let mut motion = behind.motion_to_child(hinge.shift);
            *left = (*left - hinge.force.dot(motion)) / hinge.inertia;
            motion.add_scaled(hinge.axis, *left);
            motions.push(motion);
        }
        let along = dofs.iter().zip(moment).map(|(entry, moment)| moment * left[entry.dof as usize]).sum();
        Response { norm: left.iter().map(|a| a * a).sum::<f64>().sqrt(), along }
    }
}

/// The squared accelerations of a dof and of all beyond it, by the motion behind its parent. The dof follows that motion
/// m by -(f·m)/I along its axis.
fn carried(hinge: &Hinge, beyond: &Symmetric) -> Symmetric {
    let push = beyond.times(hinge.axis);
    let mut form = *beyond;
    form.add_outer(hinge.force, push, -1.0 / hinge.inertia);
    let squares = 1.0 + hinge.axis.dot(push);
    form.add_outer(hinge.force, hinge.force, 0.5 * squares / (hinge.inertia * hinge.inertia));
    form.inertia_to_parent(hinge.shift)
}
