//! Some of the worlds, and whole states: what is done with a list of worlds costs what these take, and leaves the other
//! worlds' bits alone.

use std::sync::atomic::Ordering;

use crate::batch::Engine;
use crate::error::Error;
use crate::field::Field;
use crate::model::Model;
use crate::outputs::{Output, Reading};
use crate::rollout::Rollout;
use crate::rows::{Rows, Strided};
use crate::worlds::{Worlds, check_fit, key_state};

/// Length of a row of the output `state`: time, qpos, qvel, act.
fn state_len(model: &Model) -> usize {
    Field::STATE.iter().map(|field| field.len(model)).sum()
}

impl Worlds {
    /// Number of worlds that `ids` chooses; an error if there is no such world, or one is named twice.
    pub(crate) fn count(&self, ids: Option<&[usize]>) -> Result<usize, Error> {
        let Some(ids) = ids else { return Ok(self.nworld()) };
        ids.iter().try_for_each(|world| self.check_world(*world))?;
        if !ids.is_sorted_by(|a, b| a < b) {
            let mut sorted = ids.to_vec();
            sorted.sort_unstable();
            if let Some(pair) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
                return Err(Error::Input(format!("world {} is named twice in ids; each can be named once", pair[0])));
            }
        }
        Ok(ids.len())
    }

    /// Does `work` on all worlds, or on the chosen ones alone.
    pub(crate) fn on(&mut self, ids: Option<&[usize]>, work: &mut dyn FnMut(&mut dyn Engine)) -> Result<(), Error> {
        match ids {
            Some(ids) => self.engine.among(ids, work),
            None => {
                work(self.engine.as_mut());
                Ok(())
            }
        }
    }

    /// Advances some worlds by `nstep` steps with their present controls; the others stay as they are. Costs what a batch of
    /// so many worlds would.
    ///
    /// ```
    /// use lanesim::{Field, Model, Options, Worlds};
    ///
    /// let xml = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>";
    /// let model = Model::from_xml_string(xml, &Default::default())?;
    /// let mut worlds = Worlds::new(&model, 100, &Options::default())?;
    /// worlds.step_at(&[70, 3], 5)?;
    /// assert_eq!(worlds.get(Field::Time, 3)?, worlds.get(Field::Time, 70)?);
    /// assert_eq!((worlds.get(Field::Time, 3)?[0], worlds.get(Field::Time, 4)?[0]), (0.01, 0.0));
    /// # Ok::<(), lanesim::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// If there is no such world, or one is named twice; otherwise as [`step`](Worlds::step).
    pub fn step_at(&mut self, ids: &[usize], nstep: usize) -> Result<(), Error> {
        self.rollout(&Rollout { nstep, ids: Some(ids), ..Rollout::default() }).map(|_| ())
    }

    /// Writes outputs of present states to the caller's arrays, `[worlds, width]` each, as [`read_all`](Worlds::read_all)
    /// does, of all worlds or of some.
    ///
    /// # Errors
    ///
    /// If arrays do not fit, there is no such world, or no memory for lists.
    pub fn read(&mut self, reading: &Reading<'_>, rows: Vec<Rows<'_>>) -> Result<(), Error> {
        let Reading { names, ids, cancel } = *reading;
        let outputs = names.iter().map(|name| self.model.output(name)).collect::<Result<Vec<_>, _>>()?;
        let nworld = self.count(ids)?;
        self.check_rows(&outputs, &rows, (nworld, 1))?;
        if rows.iter().any(|rows| matches!(rows, Rows::Lists(_))) {
            self.ask_for_lists(&outputs, ids)?;
        }
        let mut rows = Some(rows);
        if outputs.is_empty() {
            let status = [Output::named("status")?];
            let mut lists = vec![Vec::new(); nworld];
            self.on(ids, &mut |engine| engine.read_all(&status, vec![Rows::Lists(&mut lists)], cancel))?;
        } else {
            self.on(ids, &mut |engine| engine.read_all(&outputs, rows.take().unwrap_or_default(), cancel))?;
        }
        if cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) { Err(Error::Cancelled) } else { Ok(()) }
    }

    /// Sets a field of some worlds: the first of `rows` is that of world `ids[0]`, and so on. Nothing is set if a row is
    /// missing; values are not looked at.
    pub fn write_at(&mut self, ids: &[usize], field: Field, rows: &Strided<'_>) -> Result<(), Error> {
        let (nworld, width) = (self.count(Some(ids))?, field.len(&self.model));
        check_fit(field.name(), rows, nworld, width)?;
        self.engine.ask_for_forces(field, nworld)?;
        let mut row = vec![0.0; width];
        for (i, world) in ids.iter().enumerate() {
            rows.row(i, width, |k, x| row[k] = x);
            self.engine.set(field, *world, &row);
        }
        Ok(())
    }

    /// Resets some worlds, as [`reset`](Worlds::reset) does.
    pub fn reset_at(&mut self, ids: &[usize], key: Option<usize>) -> Result<(), Error> {
        self.count(Some(ids))?;
        let key = key_state(&self.model, key)?;
        ids.iter().for_each(|world| self.engine.reset(*world, &key));
        Ok(())
    }

    /// Sets the state of one world from a row like those of the output `state`: time, qpos, qvel and act. Values must be
    /// finite. Controls, warm start, forces and status stay as they are: a world that is frozen needs a
    /// [`reset`](Worlds::reset) first.
    ///
    /// ```
    /// use lanesim::{Field, Model, Options, Worlds};
    ///
    /// let xml = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>";
    /// let model = Model::from_xml_string(xml, &Default::default())?;
    /// let mut worlds = Worlds::new(&model, 2, &Options::default())?;
    /// worlds.set_state(1, &[0.5, 0.1, -2.0])?;
    /// assert_eq!((worlds.get(Field::Time, 1)?, worlds.get(Field::Qvel, 1)?), (vec![0.5], vec![-2.0]));
    /// # Ok::<(), lanesim::Error>(())
    /// ```
    pub fn set_state(&mut self, world: usize, row: &[f64]) -> Result<(), Error> {
        self.check_world(world)?;
        let expected = state_len(&self.model);
        if row.len() != expected {
            return Err(Error::Input(format!("state has {} numbers; expected {expected}", row.len())));
        }
        if let Some(i) = row.iter().position(|x| !x.is_finite()) {
            return Err(Error::Input(format!("state[{i}] of world {world} is {}; expected a finite number", row[i])));
        }
        let mut rest = row;
        for field in Field::STATE {
            let (values, others) = rest.split_at(field.len(&self.model));
            self.engine.set(field, world, values);
            rest = others;
        }
        Ok(())
    }

    /// Sets the states of all worlds, or of those where `mask` is true, from rows like those of the output `state`; see
    /// [`set_state`](Worlds::set_state). Values are not looked at.
    pub fn write_states(&mut self, rows: &Strided<'_>, mask: Option<&[bool]>) -> Result<(), Error> {
        mask.map_or(Ok(()), |mask| self.check_mask(mask))?;
        check_fit("state", rows, self.nworld(), state_len(&self.model))?;
        self.each_part(rows, |worlds, field, rows| worlds.write_all(field, rows, mask))
    }

    /// The same for some worlds: the first of `rows` is that of world `ids[0]`, and so on.
    pub fn write_states_at(&mut self, ids: &[usize], rows: &Strided<'_>) -> Result<(), Error> {
        check_fit("state", rows, self.count(Some(ids))?, state_len(&self.model))?;
        self.each_part(rows, |worlds, field, rows| worlds.write_at(ids, field, rows))
    }

    /// Calls `write` with the columns of every field of the state.
    fn each_part(
        &mut self,
        rows: &Strided<'_>,
        mut write: impl FnMut(&mut Self, Field, &Strided<'_>) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let mut rows = *rows;
        for field in Field::STATE {
            write(self, field, &rows)?;
            rows.offset += field.len(&self.model);
        }
        Ok(())
    }
}
