//! Wild worlds: joints thrown about at random speeds, actuators pulling as hard as they can in directions drawn again and again.
//! All numbers come from counters, so that a run can be stopped and resumed.

use lanesim::model::ArrayData;
use lanesim::rows::{Strided, Values};
use lanesim::{Field, Model, Parameter, Worlds, noise};

use super::super::failure::Failure;

/// How wild.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wildness {
    /// Standard deviation of joint speeds at the start, rad/s or m/s.
    pub speed: f64,
    /// Share of their ranges by which controls differ from the middle.
    pub torque: f64,
    /// Factor of gains and biases of actuators.
    pub gain: f64,
    /// How often controls are drawn, 1/s.
    pub hertz: f64,
    /// Seed of everything.
    pub seed: u64,
}

/// What gains multiply.
const GAINS: [(Parameter, &str); 2] =
    [(Parameter::ActuatorGainprm, "actuator_gainprm"), (Parameter::ActuatorBiasprm, "actuator_biasprm")];
/// Streams of random numbers.
const SPEEDS: u64 = 0;
const CONTROLS: u64 = 1;

/// Dofs that are thrown about: all but those of free joints.
fn thrown(model: &Model) -> Vec<bool> {
    let nv = model.tables().sizes.nv;
    let integers = |name: &str| match model.array(name).map(|array| &array.data) {
        Some(ArrayData::I32(values)) => values.clone(),
        _ => Vec::new(),
    };
    let (kinds, joints) = (integers("jnt_type"), integers("dof_jntid"));
    (0..nv).map(|dof| kinds[joints[dof] as usize] != 0).collect()
}

impl Wildness {
    /// Steps for which controls are held.
    pub fn held(&self, timestep: f64) -> usize {
        ((1.0 / (self.hertz * timestep)).round() as usize).max(1)
    }

    /// Throws all worlds about, from a keyframe or the reference configuration, and scales their actuators.
    pub fn start(&self, worlds: &mut Worlds, key: Option<usize>) -> Result<(), Failure> {
        worlds.reset_all(None, key)?;
        let thrown = thrown(worlds.model());
        for world in 0..worlds.nworld() {
            let mut qvel = worlds.get(Field::Qvel, world)?;
            for (dof, v) in qvel.iter_mut().enumerate().filter(|(dof, _)| thrown[*dof]) {
                *v += self.speed * noise::normal(self.seed, world as u64, SPEEDS, dof as u64);
            }
            worlds.set(Field::Qvel, world, &qvel)?;
        }
        self.scale(worlds)
    }

    /// Scales the actuators of all worlds.
    pub fn scale(&self, worlds: &mut Worlds) -> Result<(), Failure> {
        let model = worlds.model().clone();
        if model.tables().sizes.nu == 0 {
            return Ok(());
        }
        for (parameter, name) in GAINS {
            let Some(ArrayData::F64(own)) = model.array(name).map(|array| &array.data) else { continue };
            let scaled: Vec<f64> = own.iter().map(|x| self.gain * x).collect();
            // A batch whose gains never differ from the model's keeps its quicker code.
            if worlds.parameter(parameter, 0)? != scaled {
                (0..worlds.nworld()).try_for_each(|world| worlds.set_parameter(parameter, world, &scaled))?;
            }
        }
        Ok(())
    }

    /// Sets all controls for the interval of this number.
    pub fn drive(&self, worlds: &mut Worlds, interval: u64) -> Result<(), Failure> {
        let model = worlds.model().clone();
        let nu = model.tables().sizes.nu;
        if nu == 0 {
            return Ok(());
        }
        let ranges: Vec<[f64; 2]> = (0..nu).map(|i| model.control_range(i)).collect();
        let one = |world: usize, i: usize| {
            let [low, high] = ranges[i];
            let draw = noise::uniform(self.seed ^ CONTROLS, world as u64, interval, i as u64);
            let side = if draw < 0.5 { -1.0 } else { 1.0 };
            0.5 * (low + high) + 0.5 * self.torque * side * (high - low)
        };
        let n = worlds.nworld();
        let all: Vec<f64> = (0..n).flat_map(|world| (0..nu).map(move |i| (world, i))).map(|(w, i)| one(w, i)).collect();
        Ok(worlds.write_all(Field::Ctrl, &Strided::new(Values::F64(&all), nu), None)?)
    }
}
