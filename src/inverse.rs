//! Inverse dynamics: states and accelerations in, forces out.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use lanesim_kernels::inverse::invertible;

use crate::error::Error;
use crate::field::Field;
use crate::memory;
use crate::model::Model;
use crate::npz::{Array, Data};
use crate::rows::{Rows, Strided, Values};
use crate::states::{Known, States};
use crate::worlds::{Options, Worlds, check_fit};

/// The accelerations.
const QACC: &str = "qacc";
/// Arrays that [`inverse`] reads: the state and the acceleration, and what of the former decides the force.
pub(crate) const INPUTS: [Known; 8] = [
    Known::field(Field::Qpos, true),
    Known::field(Field::Qvel, true),
    Known::dofs(QACC),
    Known::field(Field::Act, false),
    Known::field(Field::Ctrl, false),
    Known::field(Field::EqActive, false),
    Known::field(Field::MocapPos, false),
    Known::field(Field::MocapQuat, false),
];

/// Names of these arrays, and whether there must be one.
pub fn inputs() -> impl Iterator<Item = (&'static str, bool)> {
    INPUTS.iter().map(|known| (known.name, known.required))
}

/// An error if the model asks for what cannot be had.
pub(crate) fn check_model(model: &Model) -> Result<(), Error> {
    let options = &model.tables().options;
    if !options.flags.invdiscrete || invertible(model.tables()) {
        return Ok(());
    }
    Err(Error::Options(format!(
        "flag invdiscrete: inverse dynamics of a step do not go with integrator {}, which evaluates other states (set \
         integrator=\"implicitfast\", or leave out invdiscrete)",
        options.integrator
    )))
}

impl Worlds {
    /// Inverse dynamics of the worlds' present states: for each, the generalised force that must come from actuators and from outside so
    /// that it has the acceleration `qacc`, `[nworld, nv]`; MuJoCo's `qfrc_inverse`, in the same shape. Where the model's flag
    /// `invdiscrete` is set, or its integrator is `discrete`, the acceleration is that over a step: what velocity gains, divided by the
    /// time step. Controls and forces that the worlds have count for nothing, except that with `invdiscrete` and an implicit integrator, or
    /// with `discrete`, controls decide what the gains of actuators contribute. Of worlds that are frozen or whose state cannot be stepped, NaN.
    ///
    /// ```
    /// use lanesim::{Field, Model, Options, Worlds};
    ///
    /// let xml = "<mujoco><option gravity='0 0 -10'/><worldbody><body><joint type='slide' axis='0 0 1'/>
    ///     <geom size='.1' mass='2'/></body></worldbody></mujoco>";
    /// let model = Model::from_xml_string(xml, &Default::default())?;
    /// let mut worlds = Worlds::new(&model, 2, &Options::default())?;
    /// assert_eq!(worlds.inverse(&[0.0, 1.0])?, [20.0, 22.0]);
    /// # Ok::<(), lanesim::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// If `qacc` has another length or a number that is not finite; if the model has `invdiscrete` and integrator RK4.
    pub fn inverse(&mut self, qacc: &[f64]) -> Result<Vec<f64>, Error> {
        let shape = [self.nworld(), self.model.tables().sizes.nv];
        Values::F64(qacc).check_finite(QACC, &shape)?;
        let mut out = memory::zeros("the forces", &shape, self.options.max_memory)?;
        self.inverse_into(
            &Strided { values: Values::F64(qacc), offset: 0, stride: shape[1] },
            Rows::F64(&mut out),
            None,
        )?;
        Ok(out)
    }

    /// The same with accelerations in an array of any layout, which is not looked at for numbers that are not finite, and forces written
    /// to the caller's array, `[nworld, nv]`. Once `cancel` turns true the result is [`Error::Cancelled`].
    ///
    /// # Errors
    ///
    /// As above.
    pub fn inverse_into(
        &mut self,
        qacc: &Strided<'_>,
        rows: Rows<'_>,
        cancel: Option<&AtomicBool>,
    ) -> Result<(), Error> {
        check_model(&self.model)?;
        let (nworld, nv) = (self.nworld(), self.model.tables().sizes.nv);
        check_fit(QACC, qacc, nworld, nv)?;
        if memory::product(&[nworld, nv]) != Some(rows.len()) || matches!(rows, Rows::Lists(_) | Rows::I32(_)) {
            let (given, expected) = (rows.len(), memory::count(&[nworld, nv]));
            return Err(Error::Input(format!("array for qfrc_inverse has {given} real entries; expected {expected}")));
        }
        self.engine.inverse(qacc, rows, cancel);
        if cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
            return Err(Error::Cancelled);
        }
        Ok(())
    }
}

/// Inverse dynamics of many states, such as those of whole trajectories: arrays `qpos`, `qvel` and `qacc`, and those of `act`, `ctrl`, `eq_active`,
/// `mocap_pos` and `mocap_quat` that are not as the model starts, all with the same leading dimensions, `[N, ...]` or `[nworld, nstep, ...]`. Returns `qfrc_inverse` with the same ones (see
/// [`Worlds::inverse`]).
///
/// # Errors
///
/// If an array is missing, unknown, of another shape or has a number that is not finite; if the model has `invdiscrete` and integrator RK4.
pub fn inverse(model: &Model, inputs: &BTreeMap<String, Array>, options: &Options) -> Result<Array, Error> {
    check_model(model)?;
    let states = States::new(model, inputs, &INPUTS)?;
    let nv = model.tables().sizes.nv;
    let mut out = memory::zeros("the forces", &[states.count, nv], options.max_memory)?;
    let qacc = states.numbers(QACC);
    states.each(model, options, |worlds, here| {
        let rows = Strided { values: Values::F64(qacc), offset: here.start * nv, stride: nv };
        worlds.inverse_into(&rows, Rows::F64(&mut out[here.start * nv..here.end * nv]), None)
    })?;
    let shape = states.leading.into_iter().chain([nv]).collect();
    Array::new(shape, Data::F64(out))
        .ok_or_else(|| Error::Input("qfrc_inverse has more entries than can be counted".into()))
}
