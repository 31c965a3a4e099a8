//! Evaluation: given states in, named arrays out.

use std::collections::BTreeMap;

use crate::columns::Column;
use crate::error::Error;
use crate::field::Field;
use crate::memory;
use crate::model::{ArrayData, Model};
use crate::npz::{Array, Data};
use crate::outputs::Output;
use crate::suggest;
use crate::worlds::{Options, Worlds};

/// What a field name stands for.
enum Request {
    /// An array of the model: comes once.
    Model(ArrayData, Vec<usize>),
    /// An output of every world.
    World(Output),
}

/// Inputs that may be given: all that decides what follows from a state.
pub fn inputs() -> impl Iterator<Item = Field> + Clone {
    Field::ALL.into_iter().map(|(field, _)| field).filter(|field| *field != Field::QaccWarmstart)
}

/// Evaluates `fields` for the states in `inputs` (arrays `[N, ...]`; none at all: one world in the reference
/// configuration), after `nstep` steps. Outputs have a leading `[N]`; those whose length differs between worlds are padded
/// with zeros to the longest. Model arrays come once.
pub fn eval(
    model: &Model,
    inputs: &BTreeMap<String, Array>,
    fields: &[&str],
    nstep: usize,
    options: &Options,
) -> Result<Vec<(String, Array)>, Error> {
    let requests = fields.iter().map(|name| request(model, name)).collect::<Result<Vec<_>, _>>()?;
    let nworld = count(model, inputs)?;
    let outputs: Vec<Output> =
        requests.iter().filter_map(|r| if let Request::World(output) = r { Some(*output) } else { None }).collect();
    let mut columns = Vec::new();
    if !outputs.is_empty() {
        let mut worlds = Worlds::new(model, nworld, options)?;
        load(model, inputs, &mut worlds)?;
        if nstep > 0 {
            worlds.step(nstep)?;
        }
        columns = worlds.columns(&outputs)?;
    }
    let mut columns = columns.into_iter();
    let mut out = Vec::with_capacity(fields.len());
    for (name, request) in fields.iter().zip(requests) {
        let array = match request {
            Request::Model(data, shape) => {
                let data = match data {
                    ArrayData::F64(x) => Data::F64(x),
                    ArrayData::I32(x) => Data::I32(x),
                };
                Array::new(shape, data)
            }
            Request::World(output) => match columns.next() {
                Some(column) => join(model, &output, nworld, column, options)?,
                None => None,
            },
        };
        let array = array.ok_or_else(|| Error::Input(format!("{name} has more entries than can be counted")))?;
        out.push(((*name).to_string(), array));
    }
    Ok(out)
}

fn request(model: &Model, name: &str) -> Result<Request, Error> {
    if let Some(array) = model.array(name) {
        return Ok(Request::Model(array.data.clone(), array.shape.clone()));
    }
    model.output(name).map(Request::World).map_err(|e| {
        let known = Output::all().map(|output| output.name).chain(model.array_names());
        let near = suggest::did_you_mean(name, known);
        if near.is_empty() { e } else { Error::Unknown(format!("there is no output or model array {name}; {near}")) }
    })
}

/// Number of worlds that the inputs describe; checks names and shapes.
fn count(model: &Model, inputs: &BTreeMap<String, Array>) -> Result<usize, Error> {
    let mut nworld = None;
    for (name, array) in inputs {
        let Some(field) = self::inputs().find(|field| field.name() == name.as_str()) else {
            let remedy = suggest::or_list(name, self::inputs().map(Field::name));
            return Err(Error::Input(format!("unknown input array {name}; {remedy}")));
        };
        let width = field.len(model);
        let n = array.shape().first().copied().unwrap_or(0);
        let entries: usize = array.shape().iter().skip(1).product();
        if array.shape().is_empty() || entries != width {
            let shape = array.shape();
            return Err(Error::Input(format!("{name} has shape {shape:?}; expected [N, {width}] entries per world")));
        }
        if *nworld.get_or_insert(n) != n {
            return Err(Error::Input(format!("{name} has {n} worlds, another input has {}", nworld.unwrap_or(0))));
        }
    }
    Ok(nworld.unwrap_or(1))
}

fn load(model: &Model, inputs: &BTreeMap<String, Array>, worlds: &mut Worlds) -> Result<(), Error> {
    for field in self::inputs() {
        let Some(array) = inputs.get(field.name()) else { continue };
        let width = field.len(model);
        if width > 0 {
            for (world, row) in array.to_f64().chunks_exact(width).enumerate() {
                worlds.set(field, world, row)?;
            }
        }
    }
    Ok(())
}

/// One array of the worlds' rows.
fn join(
    model: &Model,
    output: &Output,
    nworld: usize,
    column: Column,
    options: &Options,
) -> Result<Option<Array>, Error> {
    let rest = output.shape(model).1;
    let mut shape = vec![nworld];
    let data = match column {
        Column::Numbers { values, .. } => values,
        Column::Lists(lists) => {
            let longest = lists.iter().map(Vec::len).max().unwrap_or(0);
            shape.push(longest.checked_div(rest.iter().product()).unwrap_or(0));
            let mut data = memory::zeros("the outputs", &[nworld, longest], options.max_memory)?;
            if longest > 0 {
                data.chunks_exact_mut(longest)
                    .zip(&lists)
                    .for_each(|(row, list)| row[..list.len()].copy_from_slice(list));
            }
            data
        }
    };
    shape.extend(rest);
    let data = if output.is_integer() { Data::I32(data.iter().map(|x| *x as i32).collect()) } else { Data::F64(data) };
    Ok(Array::new(shape, data))
}
