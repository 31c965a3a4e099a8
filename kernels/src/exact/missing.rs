//! What has no exact derivatives yet, and where forces are local.

use crate::derivative;
use crate::lane::Real;
use crate::model::{Model, Transmission};
use crate::options::Integrator;

/// What of a model has no exact derivatives, for whoever asks for them; `step`: of steps too.
pub fn missing<T: Real>(model: &Model<T>, step: bool) -> Option<String> {
    let of = |what: &str| Some(format!("{what} have no exact derivatives yet: take them by differences"));
    match model.options.integrator {
        Integrator::Rk4 if step => return of("Runge-Kutta steps"),
        Integrator::Discrete => return of("discrete steps"),
        Integrator::Midpoint if step => return of("midpoint steps"),
        _ => {}
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
    if model.features.adhesion {
        return of("actuators that act by what touches a body");
    }
    if !model.belts.is_empty() {
        return of("surfaces that move like belts");
    }
    None
}

/// Whether every force but those of rigid bodies and contacts acts on one joint by what is known of that joint alone.
pub(super) fn is_local<T: Real>(model: &Model<T>) -> bool {
    let features = &model.features;
    let scalar = |transmission: Transmission| transmission == Transmission::Scalar;
    let joints = model.actuators.iter().all(|actuator| scalar(actuator.transmission));
    let skew = super::is_implicit(model) && model.options.integrator != Integrator::Euler && derivative::of_bias(model);
    joints && !skew && !features.fluid && !features.gravcomp && model.tendons.is_empty() && model.equalities.is_empty()
}
