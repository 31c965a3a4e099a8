//! Arrays of many states, such as those of whole trajectories: checked together, then worked on some worlds at a time.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::error::Error;
use crate::field::Field;
use crate::memory;
use crate::model::Model;
use crate::npz::Array;
use crate::rows::{Strided, Values};
use crate::suggest;
use crate::worlds::{Options, Worlds};

/// Worlds that are worked on at once.
const MOST: usize = 1 << 14;

/// An array that may be given.
pub(crate) struct Known {
    pub name: &'static str,
    /// The part of the state that it is; `None`: as many numbers as dofs, which whoever asked for it reads himself.
    field: Option<Field>,
    /// Whether there must be one, if a state has any such numbers.
    pub required: bool,
}

impl Known {
    /// A part of the state.
    pub const fn field(field: Field, required: bool) -> Known {
        Known { name: field.name(), field: Some(field), required }
    }

    /// A number for each dof, without which nothing can be done.
    pub const fn dofs(name: &'static str) -> Known {
        Known { name, field: None, required: true }
    }

    /// Lengths of a state's own dimensions.
    fn dims(&self, model: &Model) -> Vec<usize> {
        let dofs = || vec![model.tables().sizes.nv];
        self.field.map_or_else(dofs, |field| field.shape(model).into_iter().map(|(_, n)| n).collect())
    }

    /// The dimensions before a state's own of an array of this shape, if it can be one: [N] or [nworld, nstep].
    fn leading<'a>(&self, model: &Model, shape: &'a [usize]) -> Option<&'a [usize]> {
        let dims = self.dims(model);
        let flat = [dims.iter().product()];
        let before = |own: &[usize]| shape.strip_suffix(own).filter(|before| (1..=2).contains(&before.len()));
        before(&dims).or_else(|| before(&flat))
    }
}

/// Arrays with one row per state.
pub(crate) struct States<'a> {
    /// What is before a state's own dimensions.
    pub leading: Vec<usize>,
    /// How many states there are.
    pub count: usize,
    arrays: BTreeMap<&'static str, (Option<Field>, std::borrow::Cow<'a, [f64]>)>,
}

impl<'a> States<'a> {
    /// Those of `inputs`. An error if one is unknown or missing, does not have as many states as the others, or holds a number that
    /// is none of a state.
    pub fn new(model: &Model, inputs: &'a BTreeMap<String, Array>, known: &[Known]) -> Result<Self, Error> {
        let mut found: Option<(&str, &[usize])> = None;
        let mut arrays = BTreeMap::new();
        for (name, array) in inputs {
            let Some(known) = known.iter().find(|known| known.name == name) else {
                let remedy = suggest::or_list(name, known.iter().map(|known| known.name));
                return Err(Error::Input(format!("unknown input array {name}; {remedy}")));
            };
            let shape = array.shape();
            let Some(before) = known.leading(model, shape) else {
                let own: String = known.dims(model).iter().map(|n| format!(", {n}")).collect();
                return Err(Error::Input(format!(
                    "{name} has shape {shape:?}; expected [N{own}] or [nworld, nstep{own}]"
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
            let numbers = array.to_f64();
            Values::F64(&numbers).check_finite(name, shape)?;
            if known.field == Some(Field::EqActive)
                && let Some(x) = numbers.iter().find(|x| ![0.0, 1.0].contains(*x))
            {
                return Err(Error::Input(format!("array `{name}` holds {x}; expected 0 or 1")));
            }
            arrays.insert(known.name, (known.field, numbers));
        }
        let missing = |known: &&Known| known.required && !arrays.contains_key(known.name);
        let needed = |known: &&Known| known.dims(model).iter().product::<usize>() > 0;
        if let Some(missing) = known.iter().filter(missing).find(needed) {
            let names: Vec<_> = known.iter().filter(|known| known.required).map(|known| known.name).collect();
            let (last, names) = names.split_last().map_or(("", &[][..]), |(last, names)| (*last, names));
            return Err(Error::Input(format!(
                "there is no array {}; give {} and {last}",
                missing.name,
                names.join(", ")
            )));
        }
        let leading = found.map_or(vec![1], |(_, leading)| leading.to_vec());
        let count = memory::product(&leading).unwrap_or(usize::MAX);
        Ok(States { leading, count, arrays })
    }

    /// An array's numbers; none if it was not given.
    pub fn numbers(&self, name: &str) -> &[f64] {
        self.arrays.get(name).map_or(&[], |(_, numbers)| numbers)
    }

    /// Does `work` on worlds in these states, and says which they are.
    pub fn each(
        &self,
        model: &Model,
        options: &Options,
        work: impl FnMut(&mut Worlds, Range<usize>) -> Result<(), Error>,
    ) -> Result<(), Error> {
        self.each_of(model, options, MOST, work)
    }

    /// The same with so many worlds at most at once.
    pub fn each_of(
        &self,
        model: &Model,
        options: &Options,
        most: usize,
        mut work: impl FnMut(&mut Worlds, Range<usize>) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let mut worlds = Worlds::new(model, self.count.min(most), options)?;
        let mut first = 0;
        while first < self.count {
            if worlds.nworld() > self.count - first {
                worlds = Worlds::new(model, self.count - first, options)?;
            }
            let here = first..first + worlds.nworld();
            for (field, numbers) in self.arrays.values() {
                let Some(field) = field.filter(|field| field.len(model) > 0) else { continue };
                let width = field.len(model);
                let rows = Strided { values: Values::F64(numbers), offset: here.start * width, stride: width };
                worlds.write_all(field, &rows, None)?;
            }
            work(&mut worlds, here.clone())?;
            first = here.end;
        }
        Ok(())
    }
}
