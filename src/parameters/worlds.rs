//! Parameters of the worlds of a batch.

use std::sync::atomic::{AtomicBool, Ordering};

use lanesim_kernels::model::{Quantities, Quantity};

use super::Parameter;
use super::follow::{WEIGHTS, reweigh};
use crate::error::Error;
use crate::memory;
use crate::rows::Strided;
use crate::worlds::{Precision, Worlds, check_fit};

impl Worlds {
    /// The parameters that vary, in the order in which they began to.
    pub fn varying(&self) -> impl Iterator<Item = Parameter> + '_ {
        self.parameters.iter().map(|(parameter, _)| *parameter)
    }

    /// A parameter of one world; the model's own numbers if it does not vary.
    pub fn parameter(&self, parameter: Parameter, world: usize) -> Result<&[f64], Error> {
        self.check_world(world)?;
        let (own, n) = (parameter.of(&self.model), parameter.len(&self.model));
        let varied = self.parameters.iter().find(|(known, _)| *known == parameter);
        Ok(varied.map_or(own, |(_, rows)| &rows[world * n..][..n]))
    }

    /// Sets a parameter of one world. From the first time on, all worlds have numbers of their own, at first the model's;
    /// a reset leaves them as they are.
    ///
    /// ```
    /// use lanesim::{Model, Options, Parameter, Worlds};
    ///
    /// let xml = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>";
    /// let model = Model::from_xml_string(xml, &Default::default())?;
    /// let mut worlds = Worlds::new(&model, 2, &Options::default())?;
    /// worlds.set_parameter(Parameter::Gravity, 1, &[0.0, 0.0, -1.62])?;
    /// worlds.step(1)?;
    /// let speed = |world: usize| worlds.get(lanesim::Field::Qvel, world).map(|qvel| qvel[2]);
    /// assert_eq!((speed(0)?, speed(1)?), (-9.81 * 0.002, -1.62 * 0.002));
    /// # Ok::<(), lanesim::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// If the model has nothing that the parameter governs, or derived a constant from it that would be stale; if the
    /// numbers are too few, too many or impossible; if there is no such world, or no memory.
    pub fn set_parameter(&mut self, parameter: Parameter, world: usize, values: &[f64]) -> Result<(), Error> {
        self.check_world(world)?;
        self.check_varies(parameter)?;
        let expected = parameter.len(&self.model);
        if values.len() != expected {
            let given = values.len();
            return Err(Error::Input(format!("{} has {given} numbers; expected {expected}", parameter.name())));
        }
        self.check_parameter(parameter, world, values)?;
        self.vary(parameter)?;
        self.put(parameter, world, values);
        Ok(())
    }

    /// The same for all worlds, or those where `mask` is true. Nothing is set if any of the rows is refused.
    pub fn set_parameters(
        &mut self,
        parameter: Parameter,
        rows: &Strided<'_>,
        mask: Option<&[bool]>,
    ) -> Result<(), Error> {
        self.set_parameters_until(parameter, rows, mask, &AtomicBool::new(false))
    }

    /// The same until `cancel` turns true. What follows from masses takes long where worlds are many.
    ///
    /// # Errors
    ///
    /// [`Error::Cancelled`]: the first worlds may have their new numbers, the others have their old ones.
    pub fn set_parameters_until(
        &mut self,
        parameter: Parameter,
        rows: &Strided<'_>,
        mask: Option<&[bool]>,
        cancel: &AtomicBool,
    ) -> Result<(), Error> {
        self.check_varies(parameter)?;
        mask.map_or(Ok(()), |mask| self.check_mask(mask))?;
        let (width, nworld) = (parameter.len(&self.model), self.nworld());
        check_fit(parameter.name(), rows, nworld, width)?;
        let mut row = vec![0.0; width];
        let chosen = |world: &usize| mask.is_none_or(|mask| mask[*world]);
        let go_on = || if cancel.load(Ordering::Relaxed) { Err(Error::Cancelled) } else { Ok(()) };
        for world in (0..nworld).filter(chosen) {
            go_on()?;
            rows.row(world, width, |i, x| row[i] = x);
            self.check_parameter(parameter, world, &row)?;
        }
        self.vary(parameter)?;
        for world in (0..nworld).filter(chosen) {
            go_on()?;
            rows.row(world, width, |i, x| row[i] = x);
            self.put(parameter, world, &row);
        }
        Ok(())
    }

    /// Whether a world can have these numbers.
    fn check_parameter(&self, parameter: Parameter, world: usize, values: &[f64]) -> Result<(), Error> {
        let most = if self.options.precision == Precision::F32 { f64::from(f32::MAX) } else { f64::MAX };
        let varying: Vec<Parameter> = self.varying().collect();
        parameter.check_values(&self.model, (world, values), &varying, most)
    }

    /// Whether worlds can have the parameter of their own.
    fn check_varies(&self, parameter: Parameter) -> Result<(), Error> {
        let known: Vec<Parameter> = self.varying().collect();
        if known.contains(&parameter) { Ok(()) } else { parameter.check(&self.model, &known) }
    }

    /// Gives every world numbers of its own, if they have not got them.
    fn vary(&mut self, parameter: Parameter) -> Result<(), Error> {
        let known: Vec<Parameter> = self.varying().collect();
        if known.contains(&parameter) {
            return Ok(());
        }
        let mut rows = memory::zeros(
            "the worlds' parameters",
            &[self.nworld(), parameter.len(&self.model)],
            self.options.max_memory,
        )?;
        rows.chunks_exact_mut(parameter.len(&self.model))
            .for_each(|row| row.copy_from_slice(parameter.of(&self.model)));
        let all = known.into_iter().chain([parameter]).map(Parameter::quantities);
        self.engine.vary(all.fold(Quantities::NONE, Quantities::or))?;
        self.parameters.push((parameter, rows));
        if parameter.weighs() && self.reweighed.is_none() {
            self.reweighed = Some(Box::new(lanesim_kernels::model::Model::clone(self.model.tables())));
        }
        Ok(())
    }

    /// Keeps a world's row of a parameter that varies, and what follows from it.
    fn put(&mut self, parameter: Parameter, world: usize, values: &[f64]) {
        let Worlds { model, engine, parameters, reweighed, .. } = self;
        for (_, rows) in parameters.iter_mut().filter(|(known, _)| *known == parameter) {
            rows[world * values.len()..][..values.len()].copy_from_slice(values);
        }
        let own = |wanted: Parameter| {
            let (own, n) = (wanted.of(model), wanted.len(model));
            let varied = parameters.iter().find(|(known, _)| *known == wanted);
            varied.map_or(own, |(_, rows)| &rows[world * n..][..n])
        };
        let heavy = parameter.weighs() || parameter.quantities().has(Quantity::Grip) || parameter == Parameter::Gravity;
        match reweighed.as_deref_mut().filter(|_| heavy) {
            Some(tables) => {
                reweigh(model, &own, tables);
                WEIGHTS.iter().for_each(|quantity| engine.put(*quantity, world, &quantity.of(tables)));
                if parameter == Parameter::Gravity {
                    engine.put(Quantity::Gravity, world, own(parameter));
                }
            }
            None => parameter.derive(model, &own, &mut |quantity, numbers| engine.put(quantity, world, numbers)),
        }
    }
}
