//! What a unit force of an actuator accelerates, in the reference configuration.
//!
//! A force acts on the dofs of one joint. Only the dofs between that joint and the root of its tree need their
//! accelerations one by one. The subtrees that hang off this path follow passively: the sum of the squares of their
//! accelerations is a quadratic form in the motion of the dof that they hang on. The forms are gathered once, from the
//! leaves on, so that an actuator costs as much as its joint is deep, however large the model is.

use lanesim_kernels::model::NONE;

use super::derived::{Hinge, Spatial, Symmetric};

/// Squared accelerations of the subtrees of a model, as forms in the motion that carries them.
pub(super) struct Responses<'a> {
    hinges: &'a [Hinge],
    /// Of all dofs beyond a dof, by the motion behind it.
    beyond: Vec<Symmetric>,
    /// Of a dof's siblings and all that they carry, by the motion behind their parent.
    beside: Vec<Symmetric>,
}

/// The accelerations that a force causes.
pub(super) struct Response {
    /// Norm over all dofs.
    pub norm: f64,
    /// Acceleration along the force itself, the inverse of the mass that it feels.
    pub along: f64,
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

    /// The response to the generalised force `moment` on the dofs of one joint, the first of which is `dof`.
    pub fn to(&self, dof: usize, moment: &[f64]) -> Response {
        let force = |k: usize| k.checked_sub(dof).map_or(0.0, |i| moment[i]);
        let last = dof + moment.len() - 1;
        let mut path = Vec::new();
        let mut bias = Spatial::ZERO;
        let mut next = last as u32;
        while next != NONE {
            let (k, hinge) = (next as usize, &self.hinges[next as usize]);
            let left = force(k) - hinge.axis.dot(bias);
            path.push((k, left));
            bias.add_scaled(hinge.force, left / hinge.inertia);
            bias = bias.force_to_parent(hinge.shift);
            next = hinge.parent;
        }
        let mut motion = Spatial::ZERO;
        let (mut squares, mut along) = (0.0, 0.0);
        for (k, left) in path.into_iter().rev() {
            let hinge = &self.hinges[k];
            squares += motion.dot(self.beside[k].times(motion));
            motion = motion.motion_to_child(hinge.shift);
            let qacc = (left - hinge.force.dot(motion)) / hinge.inertia;
            motion.add_scaled(hinge.axis, qacc);
            squares += qacc * qacc;
            along += force(k) * qacc;
        }
        squares += motion.dot(self.beyond[last].times(motion));
        Response { norm: squares.max(0.0).sqrt(), along }
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
