//! What has no exact derivatives yet, and what forces depend on.

use std::ops::Range;

use super::Of;
use crate::derivative;
use crate::lane::Real;
use crate::model::{DofKind, EqualityKind, Model, Transmission};
use crate::options::Integrator;

/// What of a model has no exact derivatives of this, for whoever asks for them.
pub fn missing<T: Real>(model: &Model<T>, of: Of) -> Option<String> {
    let step = of == Of::Transition;
    // Accelerations over an implicit step are not those of the solver.
    let inverts_step = of == Of::Inverse && model.options.flags.invdiscrete && super::is_implicit(model);
    let of = |what: &str| Some(format!("{what} have no exact derivatives yet: take them by differences"));
    match model.options.integrator {
        Integrator::Rk4 if step => return of("Runge-Kutta steps"),
        Integrator::Discrete => return of("discrete steps"),
        Integrator::Midpoint if step => return of("midpoint steps"),
        _ => {}
    }
    if inverts_step {
        return of("inverse dynamics of implicit steps (invdiscrete)");
    }
    if model.sizes.nguard > 0 && step {
        return of("guarded steps");
    }
    if model.sizes.nsleep > 0 {
        return of("trees that sleep");
    }
    if model.options.noslip_iterations > 0 {
        return of("forces of the pass without slip");
    }
    if model.sizes.nplastic > 0 {
        return of("springs that yield");
    }
    if !model.controllers.is_empty() || !model.motors.is_empty() || !model.servos.is_empty() {
        return of("actuators with several controls");
    }
    if model.sizes.ndelayed > 0 {
        return of("controls that act late");
    }
    if model.features.adhesion {
        return of("actuators that act by what touches a body");
    }
    if !model.belts.is_empty() {
        return of("surfaces that move like belts");
    }
    if !model.own.is_empty() {
        return of("contacts between so many trees");
    }
    None
}

/// The dofs of its joint on whose motion the forces on a dof depend that are of this joint alone: springs and limits of rotations couple their axes.
pub(super) fn companions<T>(model: &Model<T>, dof: usize) -> Range<usize> {
    let joint = model.dofs[dof].joint;
    let limited = || model.limits.iter().any(|limit| limit.ball && limit.joint == joint);
    match model.dofs[dof].kind {
        DofKind::FreeTranslation(k) | DofKind::FreeRotation(k) | DofKind::BallRotation(k)
            if model.joints[joint as usize].spring || limited() =>
        {
            let first = dof - usize::from(k);
            first..first + 3
        }
        _ => dof..dof + 1,
    }
}

/// What forces other than those of rigid bodies and contacts depend on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    /// Every one on one joint, on which alone it acts.
    pub local: bool,
    /// Some on where links are.
    pub places: bool,
    /// Some on how links move, or they are part of what rigid bodies do.
    pub rigid: bool,
}

impl Reach {
    pub fn new<T: Real>(model: &Model<T>) -> Reach {
        let features = &model.features;
        let skew =
            super::is_implicit(model) && model.options.integrator != Integrator::Euler && derivative::of_bias(model);
        let heavy = model.tendons.iter().any(|tendon| tendon.heavy);
        let sides = |kind: EqualityKind| matches!(kind, EqualityKind::Connect | EqualityKind::Weld);
        let sides = model.equalities.iter().any(|equality| sides(equality.kind));
        let rigid = skew || heavy || sides || features.fluid;
        let scalar = |transmission: Transmission| transmission == Transmission::Scalar;
        let along = |transmission: Transmission| scalar(transmission) || transmission == Transmission::Tendon;
        let transmissions = || model.actuators.iter().map(|actuator| actuator.transmission);
        let spatial = model.tendons.iter().any(|tendon| tendon.stretches.len > 0);
        let places = rigid || spatial || features.gravcomp || !transmissions().all(along);
        let local = !places && transmissions().all(scalar) && model.tendons.is_empty() && model.equalities.is_empty();
        Reach { local, places, rigid }
    }
}
