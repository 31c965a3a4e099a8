//! Whether worlds of a model can have a parameter, or certain numbers of it, of their own.

use lanesim_kernels::model::{Impedance, Joint, JointKind, NONE};
use lanesim_kernels::options::Integrator;

use super::Parameter;
use super::follow::{laws, limits, real};
use crate::error::Error;
use crate::model::{ArrayData, Model};

/// Least mass and inertia of a body that has any.
const MINVAL: f64 = 1e-15;

impl Parameter {
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
            Parameter::GeomFriction | Parameter::GeomSolref | Parameter::GeomSolimp | Parameter::GeomMargin
                if model.basis().mixed.iter().all(Option::is_none) =>
            {
                refuse("no contact has the numbers of its geoms")
            }
            _ if self.presses() && model.tables().options.integrator == Integrator::Discrete => {
                refuse("discrete steps take solref and solimp in a form of their own")
            }
            _ if !self.weighs() => self.check_effect(model),
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

    /// Whether some entry of what not all elements have has an effect.
    fn check_effect(self, model: &Model) -> Result<(), Error> {
        let why = match self {
            Parameter::DofFrictionloss => "no dof has dry friction, or the flag frictionloss or constraint is off",
            Parameter::TendonFrictionloss => {
                "no tendon has dry friction, or the flag frictionloss or constraint is off"
            }
            Parameter::QposSpring => "no joint has a spring that does not yield",
            Parameter::JntRange | Parameter::JntSolref | Parameter::JntSolimp => "no joint has a limit in force",
            Parameter::TendonRange | Parameter::TendonSolref | Parameter::TendonSolimp => {
                "no tendon has a limit in force"
            }
            Parameter::TendonStiffness | Parameter::TendonLengthspring => "no tendon has a spring",
            Parameter::TendonDamping => "no tendon has a damper",
            Parameter::ActuatorForcerange => "no actuator's force is bounded",
            Parameter::ActuatorCtrlrange => "no control is bounded",
            Parameter::ActuatorDynprm => "no activation follows its control by a time (filterexact aside)",
            _ => return Ok(()),
        };
        let some = (0..self.len(model)).any(|i| self.counts(model, i));
        let name = self.name();
        let refused = || Error::Input(format!("{name} cannot differ between worlds of this model: {why}"));
        if some { Ok(()) } else { Err(refused()) }
    }

    /// Whether a world can have these numbers, none of which is larger than `most`, beside the parameters that vary already.
    pub(crate) fn check_values(
        self,
        model: &Model,
        (world, values): (usize, &[f64]),
        varying: &[Parameter],
        most: f64,
    ) -> Result<(), Error> {
        let own = self.of(model);
        let wrong = |i: usize, expected: &str| {
            let (name, x) = (self.name(), values[i]);
            Err(Error::Input(format!("{name}[{i}] of world {world} is {x}; expected {expected}")))
        };
        let find = |bad: &dyn Fn(usize) -> bool| (0..values.len()).find(|i| bad(*i));
        // Ranges may have ends that bound nothing.
        if let Some(i) = find(&|i| !values[i].is_finite() && values[i].to_bits() != own[i].to_bits()) {
            return wrong(i, "a finite number");
        }
        if let Some(i) = find(&|i| values[i].is_finite() && values[i].abs() > most) {
            return wrong(i, "a number within the range of single precision");
        }
        match self {
            Parameter::BodyMass | Parameter::BodyInertia => {
                let bad = |i: usize| if own[i] > 0.0 { values[i] < MINVAL } else { values[i] != own[i] };
                if let Some(i) = find(&bad) {
                    return wrong(i, if own[i] > 0.0 { "a positive number" } else { "0, as in the model" });
                }
                let moments =
                    values.chunks_exact(3).position(|moments| self != Parameter::BodyMass && violates(moments));
                return moments.map_or(Ok(()), |b| wrong(3 * b, "moments A, B, C with A + B >= C"));
            }
            Parameter::DofDamping | Parameter::GeomFriction | Parameter::DofArmature => {
                return find(&|i| values[i] < 0.0).map_or(Ok(()), |i| wrong(i, "a number that is not negative"));
            }
            _ => {}
        }
        let sprung = varying.contains(&Parameter::JntStiffness) && self == Parameter::QposSpring;
        if let Some(i) = find(&|i| values[i] != own[i] && !self.counts(model, i) && !sprung) {
            return wrong(i, &format!("the model's {}, since it has no effect", own[i]));
        }
        match self.flaw(model, values) {
            Some((i, expected)) => wrong(i, expected),
            None => self.check_form(model, world, values),
        }
    }

    /// The first number that is none of those that there can be, and what would be one. What is as in the model is right.
    fn flaw(self, model: &Model, values: &[f64]) -> Option<(usize, &'static str)> {
        let own = self.of(model);
        let changed = |i: usize| values[i] != own[i];
        let pairs = |bad: &dyn Fn(usize, [f64; 2]) -> bool| {
            let pair = |k: usize| [values[2 * k], values[2 * k + 1]];
            let ours = |k: usize| changed(2 * k) || changed(2 * k + 1);
            (0..values.len() / 2).find(|k| ours(*k) && bad(*k, pair(*k))).map(|k| 2 * k)
        };
        match self {
            Parameter::DofFrictionloss
            | Parameter::TendonFrictionloss
            | Parameter::TendonStiffness
            | Parameter::TendonDamping
            | Parameter::ActuatorDynprm => {
                let found = (0..values.len()).find(|i| changed(*i) && values[*i] < 0.0);
                found.map(|i| (i, "a number that is not negative"))
            }
            Parameter::QposSpring => no_rotation(model, values).map(|i| (i, "a quaternion of length 1")),
            Parameter::JntRange | Parameter::TendonRange => {
                let margin = if self == Parameter::JntRange { "jnt_margin" } else { "tendon_margin" };
                // Of a range that is wider than both margins, one end acts at a time.
                let wide = |k: usize, [low, high]: [f64; 2]| low + 2.0 * real(model, margin)[k] < high;
                let narrow = |k: usize, new: [f64; 2]| {
                    !wide(k, new) && (wide(k, [own[2 * k], own[2 * k + 1]]) || new[0] > new[1])
                };
                pairs(&narrow).map(|i| (i, "a lower end, then an upper one beyond both margins"))
            }
            Parameter::TendonLengthspring | Parameter::ActuatorForcerange | Parameter::ActuatorCtrlrange => {
                pairs(&|_, [low, high]| low > high).map(|i| (i, "a lower end that is not above the upper one"))
            }
            Parameter::JntSolref | Parameter::TendonSolref | Parameter::GeomSolref => {
                let mixed = |_, [time, ratio]: [f64; 2]| (time > 0.0) != (ratio > 0.0);
                let expected = "two positive numbers (time, damping ratio), or two that are not (-stiffness, -damping)";
                pairs(&mixed).map(|i| (i, expected))
            }
            _ => None,
        }
    }

    /// Whether impedances keep the form that code was made for, and contacts are listed where they begin to act.
    fn check_form(self, model: &Model, world: usize, values: &[f64]) -> Result<(), Error> {
        let name = self.name();
        let own = |parameter: Parameter| if parameter == self { values } else { parameter.of(model) };
        let same = |a: &Impedance<f64>, b: &Impedance<f64>| (a.flat, a.small_power) == (b.flat, b.small_power);
        let other_form = |what: String| {
            Err(Error::Input(format!(
                "{name} of world {world} gives {what} another form of impedance than the model; expected the model's power, \
                 and a width and two different ends where it has them"
            )))
        };
        match self {
            Parameter::JntSolimp | Parameter::TendonSolimp => {
                for (limit, new) in model.tables().limits.iter().zip(limits(model, &own)) {
                    if !same(&limit.impedance, &new.impedance) {
                        let joint = limit.tendon == NONE;
                        let (of, id) = if joint { ("joint", limit.joint) } else { ("tendon", limit.tendon) };
                        return other_form(format!("{of} {id}"));
                    }
                }
            }
            Parameter::GeomSolimp | Parameter::GeomMargin => {
                for (pair, law) in model.tables().pairs.iter().zip(laws(model, &own)) {
                    let Some(law) = law else { continue };
                    let geoms = pair.geoms().map(|geom| model.tables().geoms[geom].id);
                    if !same(&pair.impedance, &law.impedance) {
                        return other_form(format!("geoms {} and {}", geoms[0], geoms[1]));
                    }
                    if law.margin > pair.include {
                        let [(one, two), (margin, most)] =
                            [(geoms[0] as f64, geoms[1] as f64), (law.margin, pair.include)];
                        return Err(Error::Input(format!(
                            "geom_margin of world {world} lets geoms {one} and {two} touch at {margin}, but their contacts are \
                             found within {most} alone; give the geoms a gap in the model"
                        )));
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }
}

/// Whether some entry is not zero.
fn has_some(data: &ArrayData) -> bool {
    match data {
        ArrayData::F64(x) => x.iter().any(|x| *x != 0.0),
        ArrayData::I32(x) => x.iter().any(|x| *x != 0),
    }
}

/// The first entry of a quaternion that is not of length 1, of a row of positions.
fn no_rotation(model: &Model, qpos: &[f64]) -> Option<usize> {
    let first = |joint: &Joint<f64>| match joint.kind {
        JointKind::Free => Some(joint.qpos as usize + 3),
        JointKind::Ball => Some(joint.qpos as usize),
        JointKind::Slide | JointKind::Hinge => None,
    };
    let unit = |at: usize| (qpos[at..at + 4].iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-9;
    model.tables().joints.iter().filter_map(first).find(|at| !unit(*at))
}

/// Whether no body can have these moments of inertia.
fn violates(moments: &[f64]) -> bool {
    let [a, b, c] = [moments[0], moments[1], moments[2]];
    let slack = 1.0 + 1e-12;
    (a + b) * slack < c || (a + c) * slack < b || (b + c) * slack < a
}

/// Whether steps use inverse weights of dofs.
fn fitted(model: &Model) -> bool {
    let lanesim_kernels::model::Model { options, features, .. } = &**model.tables();
    options.integrator == Integrator::Midpoint && (features.springs || features.dampers || features.actuation)
}
