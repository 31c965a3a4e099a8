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
use crate::suggest;
use crate::worlds::{Options, Worlds, check_fit};

/// Worlds that are inverted at once.
const MOST: usize = 1 << 14;

/// Arrays that [`inverse`] reads: the state, and what of it decides the force.
const INPUTS: [Field; 5] = [Field::Qpos, Field::Qvel, Field::Act, Field::Ctrl, Field::EqActive];
/// The accelerations.
const QACC: &str = "qacc";

/// An error if the model asks for what cannot be had.
fn check_model(model: &Model) -> Result<(), Error> {
    let options = &model.tables().options;
    if !options.flags.invdiscrete || invertible(model.tables()) {
        return Ok(());
    }
    Err(Error::Options(format!(
        "flag invdiscrete: inverse dynamics of a step do not go with integrator {}, which evaluates several states (set \
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

/// Inverse dynamics of many states, such as those of whole trajectories: arrays `qpos`, `qvel` and `qacc`, and `act`, `ctrl` and `eq_active` if
/// they are not as the model starts, all with the same leading dimensions, `[N, ...]` or `[nworld, nstep, ...]`. Returns `qfrc_inverse` with the same ones (see
/// [`Worlds::inverse`]).
///
/// # Errors
///
/// If an array is missing, unknown, of another shape or has a number that is not finite; if the model has `invdiscrete` and integrator RK4.
pub fn inverse(model: &Model, inputs: &BTreeMap<String, Array>, options: &Options) -> Result<Array, Error> {
    check_model(model)?;
    let leading = leading(model, inputs)?;
    let nv = model.tables().sizes.nv;
    let count = memory::product(&leading).unwrap_or(usize::MAX);
    let mut out = memory::zeros("the forces", &[count, nv], options.max_memory)?;
    let arrays: Vec<_> = INPUTS
        .into_iter()
        .filter(|field| field.len(model) > 0)
        .filter_map(|field| Some((field, field.len(model), inputs.get(field.name())?.to_f64())))
        .collect();
    let qacc = inputs.get(QACC).map(Array::to_f64).unwrap_or_default();
    let mut worlds = Worlds::new(model, count.min(MOST), options)?;
    let mut first = 0;
    while first < count {
        if worlds.nworld() > count - first {
            worlds = Worlds::new(model, count - first, options)?;
        }
        let here = first..first + worlds.nworld();
        let rows = |values, width| Strided { values: Values::F64(values), offset: here.start * width, stride: width };
        for (field, width, values) in &arrays {
            worlds.write_all(*field, &rows(values, *width), None)?;
        }
        let part = &mut out[here.start * nv..here.end * nv];
        worlds.inverse_into(&rows(&qacc, nv), Rows::F64(part), None)?;
        first = here.end;
    }
    let shape = leading.into_iter().chain([nv]).collect();
    Array::new(shape, Data::F64(out))
        .ok_or_else(|| Error::Input("qfrc_inverse has more entries than can be counted".into()))
}

/// The dimensions before each state's own; checks all arrays.
fn leading(model: &Model, inputs: &BTreeMap<String, Array>) -> Result<Vec<usize>, Error> {
    let width = |name: &str| {
        let field = INPUTS.into_iter().find(|field| field.name() == name);
        if name == QACC { Some(model.tables().sizes.nv) } else { field.map(|field| field.len(model)) }
    };
    let mut found: Option<(&str, &[usize])> = None;
    for (name, array) in inputs {
        let Some(width) = width(name) else {
            let remedy = suggest::or_list(name, INPUTS.map(Field::name).into_iter().chain([QACC]));
            return Err(Error::Input(format!("unknown input array {name}; {remedy}")));
        };
        let shape = array.shape();
        let fits = |(own, before): &(&usize, &[usize])| **own == width && (1..=2).contains(&before.len());
        let Some((_, before)) = shape.split_last().filter(fits) else {
            return Err(Error::Input(format!(
                "{name} has shape {shape:?}; expected [N, {width}] or [nworld, nstep, {width}]"
            )));
        };
        match found {
            Some((other, leading)) if leading != before => {
                return Err(Error::Input(format!(
                    "{name} has leading dimensions {before:?} and {other} has {leading:?}; give all arrays for the same states"
                )));
            }
            _ => found = Some((name, before)),
        }
        Values::F64(&array.to_f64()).check_finite(name, shape)?;
        if name == Field::EqActive.name()
            && let Some(x) = array.to_f64().iter().find(|x| ![0.0, 1.0].contains(*x))
        {
            return Err(Error::Input(format!("array `{name}` holds {x}; expected 0 or 1")));
        }
    }
    let required = [Field::Qpos.name(), Field::Qvel.name(), QACC];
    if let Some(missing) = required.into_iter().find(|name| !inputs.contains_key(*name) && width(name) > Some(0)) {
        return Err(Error::Input(format!("there is no array {missing}; give qpos, qvel and qacc")));
    }
    Ok(found.map_or(vec![1], |(_, leading)| leading.to_vec()))
}
