//! Numbers of the model that differ from world to world.
//!
//! A [`Parameter`] is an array of the model that users set per world, by MuJoCo's name. From a world's arrays follow the
//! numbers of the kernels' tables that depend on them, its [`Quantity`]s: they are found again whenever a parameter is set, so
//! that no step ever uses a constant that was derived from other numbers. Where that is not possible, the parameter is
//! refused.

mod check;
mod counts;
mod follow;
mod worlds;

use lanesim_kernels::model::{Quantities, Quantity};

use self::follow::WEIGHTS;
pub(crate) use self::follow::widened;
use crate::error::Error;
use crate::model::{ArrayData, Model};
use crate::suggest;

/// Arrays on which constants of the reference configuration depend, in places where every world has the same.
const INERTIAL: [&str; 3] = ["body_ipos", "body_iquat", "actuator_armature"];
const STALE: &str = " (inverse weights of limits and contacts and the mean inertia follow from it and would be stale; compile a model for each)";

/// Declares the parameters: what each is, its name, and the same for Python's documentation, with dimensions and units.
macro_rules! parameters {
    ($($(#[$doc:meta])* $variant:ident: $name:literal, $meaning:literal;)*) => {
        /// An array of the model that can differ from world to world.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Parameter {
            $($(#[$doc])* $variant,)*
        }

        impl Parameter {
            /// All of them, with MuJoCo's names.
            pub const ALL: [(Parameter, &'static str); [$($name),*].len()] = [$((Parameter::$variant, $name)),*];

            /// What it is, with dimensions and units.
            pub fn meaning(self) -> &'static str {
                match self {
                    $(Parameter::$variant => $meaning,)*
                }
            }
        }
    };
}

parameters! {
    /// Gravity, m/s²: 3 numbers.
    Gravity: "gravity", "gravity [3], m/s^2";
    /// Damping of each dof: `nv`.
    DofDamping: "dof_damping", "damping of each dof [nv], N s/m or N m s";
    /// Stiffness of each joint's spring: `njnt`.
    JntStiffness: "jnt_stiffness", "stiffness of each joint's spring [njnt], N/m or N m";
    /// Gains of actuators: `nactuator` × 10, of which the first three count.
    ActuatorGainprm: "actuator_gainprm", "gain of each actuator [nactuator, 10], of which three count";
    /// Biases of actuators: `nactuator` × 10, of which the first three count.
    ActuatorBiasprm: "actuator_biasprm", "bias of each actuator [nactuator, 10], of which three count";
    /// Gears of actuators: `nactuator` × 6.
    ActuatorGear: "actuator_gear", "gear of each actuator [nactuator, 6]";
    /// Friction of geoms: `ngeom` × (sliding, spinning, rolling). Contacts have the larger of both geoms', or that of the
    /// geom of higher priority; explicit pairs have their own.
    GeomFriction: "geom_friction", "sliding, spinning, rolling friction of each geom [ngeom, 3]";
    /// Mass of each body, kg: `nbody`. Its inertia does not follow.
    BodyMass: "body_mass", "mass of each body [nbody], kg; inertia does not follow";
    /// Principal moments of inertia of each body, kg m²: `nbody` × 3.
    BodyInertia: "body_inertia", "principal moments of inertia of each body [nbody, 3], kg m^2";
    /// Armature of each dof: `nv`.
    DofArmature: "dof_armature", "armature of each dof [nv], kg or kg m^2";
    /// Dry friction of each dof: `nv`. There is none where the model has none.
    DofFrictionloss: "dof_frictionloss", "dry friction of each dof [nv], N or N m";
    /// Where joints' springs rest: `nq`.
    QposSpring: "qpos_spring", "where joints' springs rest [nq], m or rad";
    /// Ranges of limited joints: `njnt` × 2.
    JntRange: "jnt_range", "range of each limited joint [njnt, 2], m or rad";
    /// Reference of limits of joints: `njnt` × 2.
    JntSolref: "jnt_solref", "solref of each joint's limit [njnt, 2]";
    /// Impedance of limits of joints: `njnt` × 5.
    JntSolimp: "jnt_solimp", "solimp of each joint's limit [njnt, 5]";
    /// Stiffness of tendons' springs: `ntendon`. There is none where the model has none.
    TendonStiffness: "tendon_stiffness", "stiffness of each tendon's spring [ntendon], N/m";
    /// Damping of tendons: `ntendon`, likewise.
    TendonDamping: "tendon_damping", "damping of each tendon [ntendon], N s/m";
    /// Lengths between which tendons' springs rest: `ntendon` × 2.
    TendonLengthspring: "tendon_lengthspring", "lengths between which each tendon's spring rests [ntendon, 2], m";
    /// Dry friction of tendons: `ntendon`. There is none where the model has none.
    TendonFrictionloss: "tendon_frictionloss", "dry friction of each tendon [ntendon], N";
    /// Ranges of limited tendons: `ntendon` × 2.
    TendonRange: "tendon_range", "range of each limited tendon's length [ntendon, 2], m";
    /// Reference of limits of tendons: `ntendon` × 2.
    TendonSolref: "tendon_solref_lim", "solref of each tendon's limit [ntendon, 2]";
    /// Impedance of limits of tendons: `ntendon` × 5.
    TendonSolimp: "tendon_solimp_lim", "solimp of each tendon's limit [ntendon, 5]";
    /// Bounds of actuators' forces: `nactuator` × 2.
    ActuatorForcerange: "actuator_forcerange", "bounds of each actuator's force [nactuator, 2], N or N m";
    /// Bounds of controls: `nu` × 2.
    ActuatorCtrlrange: "actuator_ctrlrange", "bounds of each control [nu, 2]";
    /// By what times activations follow controls: `nactuator` × 10, of which filters have one and muscles three.
    ActuatorDynprm: "actuator_dynprm", "times by which activations follow controls [nactuator, 10], s; filters have one, muscles three";
    /// Reference of contacts: `ngeom` × 2, mixed as the compiler does.
    GeomSolref: "geom_solref", "solref of each geom's contacts [ngeom, 2]";
    /// Impedance of contacts: `ngeom` × 5, likewise.
    GeomSolimp: "geom_solimp", "solimp of each geom's contacts [ngeom, 5]";
    /// Distance at which contacts begin to act: `ngeom`; those of both geoms add up. The distance within which they are listed stays the
    /// model's (margin + gap), so it is the gap that makes room.
    GeomMargin: "geom_margin", "distance at which each geom's contacts begin to act [ngeom], m, within the model's margin + gap";
}

impl Parameter {
    /// MuJoCo's name.
    pub fn name(self) -> &'static str {
        Self::ALL[self as usize].1
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
            Parameter::BodyMass | Parameter::BodyInertia | Parameter::DofArmature => &WEIGHTS,
            Parameter::DofFrictionloss | Parameter::TendonFrictionloss => &[Quantity::Loss],
            Parameter::QposSpring => &[Quantity::Rest],
            Parameter::JntRange | Parameter::JntSolref | Parameter::JntSolimp => &[Quantity::Limit],
            Parameter::TendonRange | Parameter::TendonSolref | Parameter::TendonSolimp => &[Quantity::Limit],
            Parameter::TendonStiffness | Parameter::TendonDamping | Parameter::TendonLengthspring => {
                &[Quantity::Tension]
            }
            Parameter::ActuatorForcerange => &[Quantity::ForceRange],
            Parameter::ActuatorCtrlrange => &[Quantity::ControlRange],
            Parameter::ActuatorDynprm => &[Quantity::Times],
            Parameter::GeomFriction | Parameter::GeomSolref | Parameter::GeomSolimp | Parameter::GeomMargin => {
                &[Quantity::Grip]
            }
        })
    }

    /// Whether inverse weights follow from it.
    pub(crate) fn weighs(self) -> bool {
        matches!(self, Parameter::BodyMass | Parameter::BodyInertia | Parameter::DofArmature)
    }
}

/// A world's numbers of a parameter: its own, or the model's.
pub(crate) type Own<'a> = dyn Fn(Parameter) -> &'a [f64] + 'a;
