//! Which numbers of a parameter have an effect in a model.

use lanesim_kernels::model::{Actuator, Joint, NONE, Transmission};

use super::Parameter;
use crate::model::{ArrayData, Model};
use crate::spec::Dynamics;

/// Numbers of MuJoCo's arrays of gains, biases and dynamics per actuator.
pub(super) const PRM: usize = 10;

/// MuJoCo's numbers of kinds of gains and biases.
const FIXED: i32 = 0;
pub(super) const AFFINE: i32 = 1;

impl Parameter {
    /// Whether it says how contacts and limits press.
    pub(super) fn presses(self) -> bool {
        use Parameter::{GeomSolimp, GeomSolref, JntSolimp, JntSolref, TendonSolimp, TendonSolref};
        matches!(self, JntSolref | JntSolimp | TendonSolref | TendonSolimp | GeomSolref | GeomSolimp)
    }

    /// Whether entry `i` has an effect: actuators do not use all of their numbers, and joints and tendons have not got everything.
    pub(crate) fn counts(self, model: &Model, i: usize) -> bool {
        let kind = |name: &str| match model.array(name).map(|array| &array.data) {
            Some(ArrayData::I32(kinds)) => kinds[i / PRM],
            _ => 0,
        };
        let (tables, at) = (model.tables(), i as u32);
        let width =
            if self.presses() && !matches!(self, Parameter::JntSolref | Parameter::TendonSolref) { 5 } else { 2 };
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
            Parameter::DofFrictionloss => {
                tables.friction_losses.iter().any(|loss| (loss.tendon, loss.dof) == (NONE, at))
            }
            Parameter::TendonFrictionloss => tables.friction_losses.iter().any(|loss| loss.tendon == at),
            Parameter::JntRange | Parameter::JntSolref | Parameter::JntSolimp => {
                let joint = at / width;
                let limit = tables.limits.iter().find(|limit| limit.tendon == NONE && limit.joint == joint);
                limit.is_some_and(|limit| !(limit.ball && self == Parameter::JntRange && i.is_multiple_of(2)))
            }
            Parameter::TendonRange | Parameter::TendonSolref | Parameter::TendonSolimp => {
                tables.limits.iter().any(|limit| limit.tendon == at / width)
            }
            Parameter::TendonStiffness => tables.features.springs && tables.tendons[i].stiffness[0] != 0.0,
            Parameter::TendonDamping => tables.features.dampers && tables.tendons[i].damping[0] != 0.0,
            Parameter::TendonLengthspring => {
                let own = &tables.tendons[i / 2];
                tables.features.springs && own.spring && own.plastic == NONE
            }
            Parameter::QposSpring => {
                let of = |joint: &&Joint<f64>| joint.qpos <= at;
                let joint = tables.joints.iter().rfind(of);
                tables.features.springs && joint.is_some_and(|joint| joint.spring && joint.plastic == NONE)
            }
            Parameter::ActuatorForcerange => {
                let bounded = |own: &Actuator<f64>| own.id == at / 2 && own.force_limited;
                tables.features.actuation && tables.actuators.iter().any(bounded)
            }
            Parameter::ActuatorCtrlrange => {
                let flags = &tables.options.flags;
                tables.features.actuation && flags.clampctrl && tables.controls[i / 2].limited
            }
            Parameter::ActuatorDynprm => {
                tables.features.actuation
                    && match model.basis().spec.actuators[i / PRM].dynamics {
                        Dynamics::Filter => i.is_multiple_of(PRM),
                        Dynamics::Muscle => {
                            i % PRM < 2 || i % PRM == 2 && model.basis().spec.actuators[i / PRM].dynprm[2] > 0.0
                        }
                        _ => false,
                    }
            }
            _ => true,
        }
    }
}
