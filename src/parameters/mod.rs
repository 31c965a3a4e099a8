//! Numbers of the model that differ from world to world.
//!
//! A [`Parameter`] is an array of the model that users set per world, by MuJoCo's name. From a world's arrays follow the
//! numbers of the kernels' tables that depend on them, its [`Quantity`]s: they are found again whenever a parameter is set, so
//! that no step ever uses a constant that was derived from other numbers. Where that is not possible, the parameter is
//! refused.

mod worlds;

use lanesim_kernels::model::{Body, Model as Tables, Quantities, Quantity, Transmission};
use lanesim_kernels::options::Integrator;

use crate::compile::{self, MINMU, Weights, potential};
use crate::error::Error;
use crate::model::{ArrayData, FrictionSource, Model};
use crate::suggest;

/// An array of the model that can differ from world to world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Parameter {
    /// Gravity, m/s²: 3 numbers.
    Gravity,
    /// Damping of each dof: `nv`.
    DofDamping,
    /// Stiffness of each joint's spring: `njnt`.
    JntStiffness,
    /// Gains of actuators: `nu` × 10, of which the first three count.
    ActuatorGainprm,
    /// Biases of actuators: `nu` × 10, of which the first three count.
    ActuatorBiasprm,
    /// Gears of actuators: `nu` × 6.
    ActuatorGear,
    /// Friction of geoms: `ngeom` × (sliding, spinning, rolling). Contacts have the larger of both geoms', or that of the
    /// geom of higher priority; explicit pairs have their own.
    GeomFriction,
    /// Mass of each body, kg: `nbody`. Its inertia does not follow.
    BodyMass,
    /// Principal moments of inertia of each body, kg m²: `nbody` × 3.
    BodyInertia,
    /// Armature of each dof: `nv`.
    DofArmature,
}

/// Arrays on which constants of the reference configuration depend, in places where every world has the same.
const INERTIAL: [&str; 3] = ["body_ipos", "body_iquat", "actuator_armature"];
const STALE: &str = " (inverse weights of limits and contacts and the mean inertia follow from it and would be stale; compile a model for each)";

/// Least mass and inertia of a body that has any.
const MINVAL: f64 = 1e-15;

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

/// Numbers of MuJoCo's arrays of gains and biases per actuator.
const PRM: usize = 10;
/// MuJoCo's numbers of kinds of gains and biases.
const FIXED: i32 = 0;
const AFFINE: i32 = 1;

impl Parameter {
    /// All of them, with MuJoCo's names.
    pub const ALL: [(Parameter, &'static str); 10] = [
        (Parameter::Gravity, "gravity"),
        (Parameter::DofDamping, "dof_damping"),
        (Parameter::JntStiffness, "jnt_stiffness"),
        (Parameter::ActuatorGainprm, "actuator_gainprm"),
        (Parameter::ActuatorBiasprm, "actuator_biasprm"),
        (Parameter::ActuatorGear, "actuator_gear"),
        (Parameter::GeomFriction, "geom_friction"),
        (Parameter::BodyMass, "body_mass"),
        (Parameter::BodyInertia, "body_inertia"),
        (Parameter::DofArmature, "dof_armature"),
    ];

    /// MuJoCo's name.
    pub fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }

    /// What it is, with dimensions and units.
    pub fn meaning(self) -> &'static str {
        match self {
            Parameter::Gravity => "gravity [3], m/s^2",
            Parameter::DofDamping => "damping of each dof [nv], N s/m or N m s",
            Parameter::JntStiffness => "stiffness of each joint's spring [njnt], N/m or N m",
            Parameter::ActuatorGainprm => "gain of each actuator [nu, 10], of which three count",
            Parameter::ActuatorBiasprm => "bias of each actuator [nu, 10], of which three count",
            Parameter::ActuatorGear => "gear of each actuator [nu, 6]",
            Parameter::GeomFriction => "sliding, spinning, rolling friction of each geom [ngeom, 3]",
            Parameter::BodyMass => "mass of each body [nbody], kg; inertia does not follow",
            Parameter::BodyInertia => "principal moments of inertia of each body [nbody, 3], kg m^2",
            Parameter::DofArmature => "armature of each dof [nv], kg or kg m^2",
        }
    }

    /// The parameter of a name.
    ///
    /// # Errors
    ///
    /// If there is none; the message lists those that there are.
    pub fn named(name: &str) -> Result<Parameter, Error> {
        let found = Self::ALL.iter().find(|(_, known)| *known == name).map(|(parameter, _)| *parameter);
        let names = suggest::or_list(name, Self::ALL.map(|(_, name)| name));
        let stale = if INERTIAL.contains(&name) { STALE } else { "" };
        found.ok_or_else(|| Error::Unknown(format!("{name} cannot differ between worlds{stale}; {names}")))
    }

    /// A world's dimensions.
    pub fn shape(self, model: &Model) -> &[usize] {
        model.array(self.name()).map_or(&[], |array| &array.shape)
    }

    /// Numbers per world.
    pub fn len(self, model: &Model) -> usize {
        self.shape(model).iter().product()
    }

    /// The model's own numbers.
    pub fn of(self, model: &Model) -> &[f64] {
        match model.array(self.name()).map(|array| &array.data) {
            Some(ArrayData::F64(data)) => data,
            _ => &[],
        }
    }

    /// The tables' numbers that follow from it.
    pub(crate) const fn quantities(self) -> Quantities {
        Quantities::of(match self {
            Parameter::Gravity => &[Quantity::Gravity, Quantity::StillPotential],
            Parameter::DofDamping => &[Quantity::Damping],
            Parameter::JntStiffness => &[Quantity::Stiffness],
            Parameter::ActuatorGainprm => &[Quantity::Gain],
            Parameter::ActuatorBiasprm => &[Quantity::Bias],
            Parameter::ActuatorGear => &[Quantity::Gear],
            Parameter::GeomFriction => &[Quantity::Grip],
            Parameter::BodyMass | Parameter::BodyInertia | Parameter::DofArmature => &WEIGHTS,
        })
    }

    /// Whether inverse weights follow from it.
    pub(crate) fn weighs(self) -> bool {
        matches!(self, Parameter::BodyMass | Parameter::BodyInertia | Parameter::DofArmature)
    }

    /// Whether the model has something that it governs, and worlds can have it of their own when the `others` vary already.
    pub(crate) fn check(self, model: &Model, others: &[Parameter]) -> Result<(), Error> {
        let (flags, name) = (&model.tables().options.flags, self.name());
        let refuse = |why: &str| Err(Error::Input(format!("{name} cannot differ between worlds of this model: {why}")));
        let some = |name: &str| model.array(name).is_some_and(|array| has_some(&array.data));
        if self.len(model) == 0 {
            return refuse("it has none");
        }
        match self {
            Parameter::Gravity if !flags.gravity => refuse("the flag gravity is off"),
            Parameter::DofDamping if !flags.damper => refuse("the flag damper is off"),
            Parameter::JntStiffness if !flags.spring => refuse("the flag spring is off"),
            Parameter::ActuatorGainprm | Parameter::ActuatorBiasprm | Parameter::ActuatorGear if !flags.actuation => {
                refuse("the flag actuation is off")
            }
            Parameter::ActuatorGainprm | Parameter::ActuatorBiasprm | Parameter::ActuatorGear
                if !model.tables().servos.is_empty() =>
            {
                refuse("orientation servos have several forces, which share their numbers")
            }
            Parameter::ActuatorGainprm
                if model.basis().damping_ratios && !others.contains(&Parameter::ActuatorBiasprm) =>
            {
                refuse("dampratio derives biases from gains, which would be stale; set actuator_biasprm first")
            }
            Parameter::ActuatorBiasprm if !some("actuator_biastype") => refuse("no actuator has a bias"),
            Parameter::ActuatorGear
                if ["actuator_armature", "actuator_damping", "actuator_dampingpoly"].into_iter().any(some) =>
            {
                refuse("armature and damping of actuators act on joints through the gear and would be stale")
            }
            Parameter::ActuatorGear if model.basis().damping_ratios => {
                refuse("dampratio derives biases from gears, which would be stale")
            }
            Parameter::ActuatorGear if !model.tables().muscles.is_empty() => {
                refuse("ranges of lengths and forces of muscles follow from gears, and would be stale")
            }
            Parameter::GeomFriction if model.basis().frictions.iter().all(|source| *source == FrictionSource::Own) => {
                refuse("no contact has the friction of its geoms")
            }
            _ if !self.weighs() => Ok(()),
            _ if model.tables().links.is_empty() => refuse("no body moves"),
            Parameter::BodyMass | Parameter::BodyInertia if model.tables().features.fluid => {
                refuse("the medium's forces follow from masses and inertias, and would be stale")
            }
            _ if fitted(model) => {
                refuse("springs and dampers are fitted to inertias by midpoint steps, and would be stale")
            }
            _ if model.basis().scaled_muscles => {
                refuse("forces of muscles follow from inertias, and would be stale; give muscles a force")
            }
            _ if model.basis().damping_ratios && !others.contains(&Parameter::ActuatorBiasprm) => {
                refuse("dampratio derives biases from inertias, which would be stale; set actuator_biasprm first")
            }
            _ if model.basis().spring_dampers
                && ![Parameter::JntStiffness, Parameter::DofDamping].iter().all(|own| others.contains(own)) =>
            {
                refuse("springdamper derives stiffness and damping from inertias, which would be stale; set both first")
            }
            _ => Ok(()),
        }
    }

    /// Whether a world can have these numbers, none of which is larger than `most`.
    pub(crate) fn check_values(self, model: &Model, world: usize, values: &[f64], most: f64) -> Result<(), Error> {
        let wrong = |i: usize, expected: &str| {
            let (name, x) = (self.name(), values[i]);
            Err(Error::Input(format!("{name}[{i}] of world {world} is {x}; expected {expected}")))
        };
        if let Some(i) = values.iter().position(|x| !x.is_finite()) {
            return wrong(i, "a finite number");
        }
        if let Some(i) = values.iter().position(|x| x.abs() > most) {
            return wrong(i, "a number within the range of single precision");
        }
        match self {
            Parameter::BodyMass | Parameter::BodyInertia => {
                let own = self.of(model);
                let bad = |i: &usize| if own[*i] > 0.0 { values[*i] < MINVAL } else { values[*i] != own[*i] };
                if let Some(i) = (0..values.len()).find(bad) {
                    return wrong(i, if own[i] > 0.0 { "a positive number" } else { "0, as in the model" });
                }
                let moments =
                    values.chunks_exact(3).position(|moments| self != Parameter::BodyMass && violates(moments));
                moments.map_or(Ok(()), |b| wrong(3 * b, "moments A, B, C with A + B >= C"))
            }
            Parameter::DofDamping | Parameter::GeomFriction | Parameter::DofArmature => {
                values.iter().position(|x| *x < 0.0).map_or(Ok(()), |i| wrong(i, "a number that is not negative"))
            }
            _ => {
                let own = self.of(model);
                let stray = |i: &usize| values[*i] != own[*i] && !self.counts(model, *i);
                let found = (0..values.len()).find(stray);
                found.map_or(Ok(()), |i| wrong(i, &format!("the model's {}, since it has no effect", own[i])))
            }
        }
    }

    /// Whether entry `i` has an effect: actuators do not use all of their numbers.
    fn counts(self, model: &Model, i: usize) -> bool {
        let kind = |name: &str| match model.array(name).map(|array| &array.data) {
            Some(ArrayData::I32(kinds)) => kinds[i / PRM],
            _ => 0,
        };
        match self {
            Parameter::ActuatorGainprm => match kind("actuator_gaintype") {
                FIXED => i.is_multiple_of(PRM),
                AFFINE => i % PRM < 3,
                _ => false,
            },
            Parameter::ActuatorBiasprm => i % PRM < 3 && kind("actuator_biastype") == AFFINE,
            Parameter::ActuatorGear => match model.tables().actuators[i / 6].transmission {
                Transmission::Scalar | Transmission::Tendon | Transmission::SliderCrank => i.is_multiple_of(6),
                Transmission::Body | Transmission::Turn | Transmission::TurnBetween => false,
                Transmission::Ball | Transmission::BallInParent => i % 6 < 3,
                Transmission::Free | Transmission::FreeInParent | Transmission::Site | Transmission::Relative => true,
            },
            _ => true,
        }
    }

    /// The numbers of the tables that follow from a world's, quantity by quantity.
    pub(crate) fn derive(self, model: &Model, values: &[f64], put: &mut dyn FnMut(Quantity, &[f64])) {
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
            Parameter::GeomFriction => put(Quantity::Grip, &grips(model, values)),
            // What follows from several parameters together: see `reweigh`.
            Parameter::BodyMass | Parameter::BodyInertia | Parameter::DofArmature => {}
        }
    }
}

/// Whether some entry is not zero.
fn has_some(data: &ArrayData) -> bool {
    match data {
        ArrayData::F64(x) => x.iter().any(|x| *x != 0.0),
        ArrayData::I32(x) => x.iter().any(|x| *x != 0),
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
fn real<'a>(model: &'a Model, name: &str) -> &'a [f64] {
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

/// Friction of the pairs of geoms, mixed as the compiler does, and their inverse weights.
fn grips(model: &Model, friction: &[f64]) -> Vec<f64> {
    let of = |geom: usize| [friction[3 * geom], friction[3 * geom + 1], friction[3 * geom + 2]];
    let mut out = Quantity::Grip.of(model.tables());
    for (own, source) in out.chunks_exact_mut(6).zip(&model.basis().frictions) {
        let [slide, spin, roll] = match *source {
            FrictionSource::Own => continue,
            FrictionSource::Geom(geom) => of(geom),
            FrictionSource::Larger(a, b) => std::array::from_fn(|k| of(a)[k].max(of(b)[k])),
        };
        own[..5].copy_from_slice(&[slide, slide, spin, roll, roll].map(|x| x.max(MINMU)));
    }
    out
}

/// Puts all that follows from masses, inertias and armature of a world, whose rows are `own`, into the tables.
pub(crate) fn reweigh<'a>(model: &Model, own: &dyn Fn(Parameter) -> &'a [f64], tables: &mut Tables<f64>) {
    if let [x, y, z] = own(Parameter::Gravity) {
        tables.gravity = [*x, *y, *z];
    }
    for (pair, grip) in tables.pairs.iter_mut().zip(grips(model, own(Parameter::GeomFriction)).chunks_exact(6)) {
        pair.friction.copy_from_slice(&grip[..5]);
    }
    let armature = reflected(model, own(Parameter::DofArmature), "actuator_armature");
    let (mass, inertia) = (own(Parameter::BodyMass), own(Parameter::BodyInertia));
    compile::reweigh(&model.basis().spec, &Weights { mass, inertia, armature: &armature }, tables);
}

/// Whether no body can have these moments of inertia.
fn violates(moments: &[f64]) -> bool {
    let [a, b, c] = [moments[0], moments[1], moments[2]];
    let slack = 1.0 + 1e-12;
    (a + b) * slack < c || (a + c) * slack < b || (b + c) * slack < a
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

/// Whether steps use inverse weights of dofs.
fn fitted(model: &Model) -> bool {
    let Tables { options, features, .. } = &**model.tables();
    options.integrator == Integrator::Midpoint && (features.springs || features.dampers || features.actuation)
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
