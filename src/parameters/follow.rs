//! What follows from a world's parameters: the numbers of the tables.

use lanesim_kernels::model::{Body, Joint, JointKind, Limit, Model as Tables, NONE, Quantities, Quantity};
use lanesim_kernels::options::Integrator;

use super::counts::{AFFINE, PRM};
use super::{Own, Parameter};
use crate::compile::{self, Bound, Contact, Law, Weights, potential};
use crate::model::{ArrayData, Model, Surface};

/// What follows from masses, inertias and armature.
pub(crate) const WEIGHTS: [Quantity; 11] = [
    Quantity::Link,
    Quantity::Compensation,
    Quantity::Armature,
    Quantity::LimitWeight,
    Quantity::Regulariser,
    Quantity::MeanInertia,
    Quantity::BodyMass,
    Quantity::StillPotential,
    Quantity::Grip,
    Quantity::EqualityWeight,
    Quantity::BodyInertia,
];

impl Parameter {
    /// The numbers of the tables that follow from a world's, which are `own`, quantity by quantity; but what follows from several
    /// together with masses: see [`reweigh`].
    pub(super) fn derive(self, model: &Model, own: &Own<'_>, put: &mut dyn FnMut(Quantity, &[f64])) {
        let (values, tables) = (own(self), model.tables());
        match self {
            Parameter::Gravity => {
                put(Quantity::Gravity, values);
                put(Quantity::StillPotential, &[potential(&model.basis().still, [values[0], values[1], values[2]])]);
            }
            Parameter::DofDamping => put(Quantity::Damping, &reflected(model, values, "actuator_damping")),
            Parameter::JntStiffness => put(Quantity::Stiffness, values),
            Parameter::ActuatorGainprm => put(Quantity::Gain, &affine(self, model, values)),
            Parameter::ActuatorBiasprm => put(Quantity::Bias, &affine(self, model, values)),
            Parameter::ActuatorGear => put(Quantity::Gear, values),
            Parameter::GeomFriction | Parameter::GeomSolref | Parameter::GeomSolimp | Parameter::GeomMargin => {
                let governed = tables.pairs.iter().zip(laws(model, own)).flat_map(|(pair, law)| {
                    let mut pair = pair.clone();
                    law.into_iter().for_each(|law| law.govern(&mut pair));
                    pair.law()
                });
                put(Quantity::Grip, &governed.collect::<Vec<f64>>());
            }
            Parameter::DofFrictionloss | Parameter::TendonFrictionloss => {
                let [of_dofs, of_tendons] = [Parameter::DofFrictionloss, Parameter::TendonFrictionloss].map(own);
                let bound = |tendon: u32, dof: u32| match tendon {
                    NONE => of_dofs[dof as usize],
                    tendon => of_tendons[tendon as usize],
                };
                let bounds = tables.friction_losses.iter().map(|loss| bound(loss.tendon, loss.dof));
                put(Quantity::Loss, &bounds.collect::<Vec<f64>>());
            }
            Parameter::QposSpring => put(Quantity::Rest, &rests(&tables.joints, values)),
            Parameter::JntRange
            | Parameter::JntSolref
            | Parameter::JntSolimp
            | Parameter::TendonRange
            | Parameter::TendonSolref
            | Parameter::TendonSolimp => {
                put(Quantity::Limit, &limits(model, own).iter().flat_map(Limit::numbers).collect::<Vec<f64>>());
            }
            Parameter::TendonStiffness | Parameter::TendonDamping | Parameter::TendonLengthspring => {
                let [stiffness, damping] = [Parameter::TendonStiffness, Parameter::TendonDamping].map(own);
                let rest = own(Parameter::TendonLengthspring);
                let of = |t: usize| [stiffness[t], damping[t], rest[2 * t], rest[2 * t + 1]];
                put(Quantity::Tension, &(0..tables.tendons.len()).flat_map(of).collect::<Vec<f64>>());
            }
            Parameter::ActuatorForcerange => {
                let range = |id: u32| compile::of_clamp([values[2 * id as usize], values[2 * id as usize + 1]]);
                let ranges = tables.actuators.iter().flat_map(|actuator| range(actuator.id));
                put(Quantity::ForceRange, &ranges.collect::<Vec<f64>>());
            }
            Parameter::ActuatorCtrlrange => {
                let ranges = values.as_chunks::<2>().0.iter().flat_map(|range| compile::of_clamp(*range));
                put(Quantity::ControlRange, &ranges.collect::<Vec<f64>>());
            }
            Parameter::ActuatorDynprm => {
                let written = &model.basis().spec.actuators;
                let times = |id: usize| compile::times(written[id].dynamics, &values[PRM * id..][..PRM]);
                let all = tables.actuators.iter().flat_map(|actuator| times(actuator.id as usize));
                put(Quantity::Times, &all.collect::<Vec<f64>>());
            }
            Parameter::BodyMass | Parameter::BodyInertia | Parameter::DofArmature => {}
        }
    }
}

/// Damping or armature of dofs, with what actuators add to the joints' own.
fn reflected(model: &Model, own: &[f64], array: &str) -> Vec<f64> {
    let tables = model.tables();
    let mut added = vec![0.0; tables.joints.len()];
    let all = real(model, array);
    for actuator in &tables.actuators {
        let x = all.get(actuator.id as usize).copied().unwrap_or(0.0);
        // What acts on sites has none.
        if let Some(added) = added.get_mut(actuator.joint as usize) {
            *added += x * (actuator.gear[0] * actuator.gear[0]);
        }
    }
    tables.dofs.iter().zip(own).map(|(dof, own)| own + added[dof.joint as usize]).collect()
}

/// An array of real numbers.
pub(super) fn real<'a>(model: &'a Model, name: &str) -> &'a [f64] {
    match model.array(name).map(|array| &array.data) {
        Some(ArrayData::F64(data)) => data,
        _ => &[],
    }
}

/// What the kernels have of gains or biases: the first three numbers of each actuator, those without effect zero.
fn affine(parameter: Parameter, model: &Model, values: &[f64]) -> Vec<f64> {
    let number = |a: usize, k: usize| if parameter.counts(model, PRM * a + k) { values[PRM * a + k] } else { 0.0 };
    (0..values.len() / PRM).flat_map(|a| (0..3).map(move |k| number(a, k))).collect()
}

/// By pair, the law that its geoms' numbers mix; `None`: it has its own.
pub(super) fn laws(model: &Model, own: &Own<'_>) -> impl Iterator<Item = Option<Law>> {
    use Parameter::{GeomFriction, GeomMargin, GeomSolimp, GeomSolref};
    let [friction, solref, solimp, margin] = [GeomFriction, GeomSolref, GeomSolimp, GeomMargin].map(own);
    let surface = |geom: usize| Surface {
        friction: std::array::from_fn(|k| friction[3 * geom + k]),
        solref: std::array::from_fn(|k| solref[2 * geom + k]),
        solimp: std::array::from_fn(|k| solimp[5 * geom + k]),
        margin: margin[geom],
        ..model.basis().surfaces[geom]
    };
    let options = &model.basis().spec.option;
    let mixed = model.basis().mixed.iter();
    mixed.map(move |geoms| geoms.map(|[one, two]| Contact::mix(&surface(one), &surface(two)).law(options)))
}

/// The limits.
pub(super) fn limits(model: &Model, own: &Own<'_>) -> Vec<Limit<f64>> {
    use Parameter::{JntRange, JntSolimp, JntSolref, TendonRange, TendonSolimp, TendonSolref};
    let [joints, tendons] =
        [[JntRange, JntSolref, JntSolimp], [TendonRange, TendonSolref, TendonSolimp]].map(|of| of.map(own));
    let options = &model.basis().spec.option;
    let limit = |limit: &Limit<f64>| {
        let ([range, solref, solimp], i) = match limit.tendon {
            NONE => (joints, limit.joint as usize),
            tendon => (tendons, tendon as usize),
        };
        let [solref, range] = [solref, range].map(|all| [all[2 * i], all[2 * i + 1]]);
        let solimp = std::array::from_fn(|k| solimp[5 * i + k]);
        Limit {
            range: compile::range_of(range, limit.ball),
            impedance: compile::impedance(options, Bound::Below, solref, solimp),
            ..limit.clone()
        }
    };
    model.tables().limits.iter().map(limit).collect()
}

/// Where joints' springs rest, seven numbers of each, by a row of positions.
fn rests(joints: &[Joint<f64>], qpos: &[f64]) -> Vec<f64> {
    let rest = |joint: &Joint<f64>| {
        let count = match joint.kind {
            JointKind::Free => 7,
            JointKind::Ball => 4,
            JointKind::Slide | JointKind::Hinge => 1,
        };
        let mut rest = [0.0; 7];
        rest[..count].copy_from_slice(&qpos[joint.qpos as usize..][..count]);
        rest
    };
    joints.iter().flat_map(rest).collect()
}

/// Puts all that follows from masses, inertias and armature of a world, whose rows are `own`, into the tables.
pub(super) fn reweigh(model: &Model, own: &Own<'_>, tables: &mut Tables<f64>) {
    if let [x, y, z] = own(Parameter::Gravity) {
        tables.gravity = [*x, *y, *z];
    }
    for (pair, law) in tables.pairs.iter_mut().zip(laws(model, own)) {
        law.into_iter().for_each(|law| law.govern(pair));
    }
    let armature = reflected(model, own(Parameter::DofArmature), "actuator_armature");
    let (mass, inertia) = (own(Parameter::BodyMass), own(Parameter::BodyInertia));
    compile::reweigh(&model.basis().spec, &Weights { mass, inertia, armature: &armature }, tables);
}

/// Which components of a link's centre of mass and of its inertia are zero whatever its bodies weigh: in a planar model, for
/// one, all products of inertia with the axis of its joints.
fn zeros<'a>(bodies: impl Iterator<Item = &'a Body<f64>> + Clone) -> ([bool; 3], [bool; 6]) {
    // As much as rounding leaves of a right angle.
    const NONE: f64 = 4e-16;
    let one = bodies.clone().count() == 1;
    let com = std::array::from_fn(|c| bodies.clone().all(|body| body.com[c] == 0.0));
    let product = |a: usize, b: usize| {
        let own = |body: &Body<f64>| (0..3).all(|k| (body.rot[3 * a + k] * body.rot[3 * b + k]).abs() <= NONE);
        (one || com[a] || com[b]) && bodies.clone().all(own)
    };
    (com, [false, false, false, product(0, 1), product(0, 2), product(1, 2)])
}

/// The tables with a structure that allows for what varies, whatever values it takes.
pub(crate) fn widened(model: &Model, set: Quantities) -> Tables<f64> {
    let mut tables = Tables::clone(model.tables());
    let flags = &tables.options.flags;
    let features = &mut tables.features;
    if set.has(Quantity::Gravity) {
        features.gravcomp = (flags.spring || flags.damper) && tables.links.iter().any(|link| link.gravcomp != 0.0);
    }
    if set.has(Quantity::Damping) {
        let euler = tables.options.integrator == Integrator::Euler;
        (features.dampers, features.implicit_damping) = (flags.damper, flags.damper && flags.eulerdamp && euler);
        tables.dofs.iter_mut().for_each(|dof| dof.damped = true);
    }
    if set.has(Quantity::Stiffness) {
        features.springs = flags.spring;
        tables.joints.iter_mut().for_each(|joint| joint.spring = true);
    }
    if set.has(Quantity::Link) {
        for (l, link) in tables.links.iter_mut().enumerate() {
            link.zeros = zeros(tables.bodies.iter().filter(|body| body.link as usize == l && body.mass > 0.0));
        }
    }
    let affine = |name: &str, a: usize| match model.array(name).map(|array| &array.data) {
        Some(ArrayData::I32(kinds)) => kinds[a] == AFFINE,
        _ => false,
    };
    for (a, actuator) in tables.actuators.iter_mut().enumerate() {
        actuator.turns |= set.has(Quantity::Gear);
        if set.has(Quantity::Gain) {
            actuator.gain_affine = affine("actuator_gaintype", a);
        }
        if set.has(Quantity::Bias) {
            actuator.bias_affine = affine("actuator_biastype", a);
        }
    }
    tables
}
