//! The long test: many wild worlds for hours of simulated time. Its state is written to a file every now and then, from which the
//! same command goes on: with the same bits as if it had never stopped.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use lanesim::model::ArrayData;
use lanesim::npz::{self, Array, Data};
use lanesim::rows::{Strided, Values};
use lanesim::{Field, Model, Rollout, Worlds};
use lanesim_kernels::state::Status;

use super::super::failure::Failure;
use super::wild::Wildness;

/// What identifies a run, in its file.
const IDENTITY: &str = "stress_identity";
/// Its model's name, as numbers of characters.
const NAME: &str = "stress_model";
/// Intervals that are done.
const DONE: &str = "stress_intervals";
const STATUS: &str = "status";

/// A long test.
pub struct Long<'a> {
    /// How wild.
    pub wildness: Wildness,
    /// Intervals of held controls in all.
    pub intervals: u64,
    /// Where its state is kept.
    pub file: &'a Path,
    /// Time between two times that it is written.
    pub every: Duration,
}

/// A number that differs where models, or how wild worlds are, differ.
fn identity(worlds: &Worlds, wildness: &Wildness) -> u64 {
    let model = worlds.model();
    let mut text = format!("{wildness:?} {} {:?}", worlds.nworld(), worlds.options().precision);
    let options = &model.tables().options;
    text += &format!("{options:?}");
    for name in model.array_names() {
        match model.array(name).map(|array| &array.data) {
            Some(ArrayData::F64(values)) => text += &format!("{name}{values:?}"),
            Some(ArrayData::I32(values)) => text += &format!("{name}{values:?}"),
            None => {}
        }
    }
    u64::from(crc32fast::hash(text.as_bytes())) << 32 | text.len() as u64
}

fn letters(model: &Model) -> Vec<u32> {
    model.name().chars().map(u32::from).collect()
}

impl Long<'_> {
    /// Starts, or goes on from the file; the number of intervals that are done.
    pub fn begin(&self, worlds: &mut Worlds, key: Option<usize>) -> Result<u64, Failure> {
        if !self.file.exists() {
            self.wildness.start(worlds, key)?;
            return Ok(0);
        }
        self.wildness.scale(worlds)?;
        self.restore(worlds)
    }

    fn restore(&self, worlds: &mut Worlds) -> Result<u64, Failure> {
        let fail = |why: String| Failure::file(self.file, why);
        let mut arrays = npz::read(self.file).map_err(|e| fail(e.to_string()))?;
        let mut take = |name: &str| {
            arrays.remove(name).ok_or_else(|| fail(format!("has no array `{name}`: not a file of this command")))
        };
        let whole = |array: Array| match array.data() {
            Data::U64(values) => values.first().copied(),
            _ => None,
        };
        let name: String = match take(NAME)?.data() {
            Data::U32(letters) => letters.iter().filter_map(|c| char::from_u32(*c)).collect(),
            _ => String::new(),
        };
        let same = whole(take(IDENTITY)?) == Some(identity(worlds, &self.wildness));
        if !same {
            let now = worlds.model().name();
            let why = if name == now { "with other numbers or options" } else { "another one" };
            return Err(fail(format!(
                "was written by a run of model \"{name}\" and this is \"{now}\", {why}; give the options of that run, or another file"
            )));
        }
        let done = whole(take(DONE)?).ok_or_else(|| fail("holds no number of intervals".into()))?;
        let n = worlds.nworld();
        for (field, name) in Field::ALL {
            let width = field.len(worlds.model());
            if width == 0 || FORCES.contains(&field) {
                continue;
            }
            let values = take(name)?.into_f64().filter(|values| values.len() == n * width);
            let values = values.ok_or_else(|| fail(format!("array `{name}` is not of {n} worlds")))?;
            worlds.write_all(field, &Strided::new(Values::F64(&values), width), None)?;
        }
        match take(STATUS)?.data() {
            Data::U32(bits) if bits.len() == n => {
                (0..n).try_for_each(|world| worlds.set_status(world, Status(bits[world])))?;
            }
            _ => return Err(fail(format!("array `{STATUS}` is not of {n} worlds"))),
        }
        Ok(done)
    }

    fn save(&self, worlds: &Worlds, done: u64) -> Result<(), Failure> {
        let n = worlds.nworld();
        let mut arrays = Vec::new();
        let mut add = |name: &str, shape: Vec<usize>, data: Data| {
            arrays.extend(Array::new(shape, data).map(|array| (name.to_owned(), array)));
        };
        let name = letters(worlds.model());
        add(NAME, vec![name.len()], Data::U32(name));
        add(IDENTITY, vec![1], Data::U64(vec![identity(worlds, &self.wildness)]));
        add(DONE, vec![1], Data::U64(vec![done]));
        for (field, name) in Field::ALL {
            let width = field.len(worlds.model());
            if width > 0 && !FORCES.contains(&field) {
                add(name, vec![n, width], Data::F64(worlds.get_all(field)));
            }
        }
        let bits = (0..n).map(|world| Ok(worlds.status(world)?.0)).collect::<Result<Vec<_>, lanesim::Error>>()?;
        add(STATUS, vec![n], Data::U32(bits));
        npz::write(self.file, &arrays).map_err(|e| Failure::file(self.file, e))
    }

    /// Goes on to the end; the file holds the last state.
    pub fn run(&self, worlds: &mut Worlds, from: u64, steps: &AtomicU64) -> Result<(), Failure> {
        let held = self.wildness.held(worlds.model().tables().options.timestep);
        steps.fetch_add(from * (held * worlds.nworld()) as u64, Ordering::Relaxed);
        let mut saved = Instant::now();
        for interval in from..self.intervals {
            self.wildness.drive(worlds, interval)?;
            worlds.rollout(&Rollout { nstep: held, progress: Some(steps), ..Rollout::default() })?;
            if saved.elapsed() > self.every {
                self.save(worlds, interval + 1)?;
                saved = Instant::now();
            }
        }
        self.save(worlds, self.intervals.max(from))
    }
}

/// Forces from outside: there are none here.
const FORCES: [Field; 2] = [Field::QfrcApplied, Field::XfrcApplied];
