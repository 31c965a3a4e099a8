//! From arguments to the library's types.

use std::sync::Arc;
use std::time::Instant;

use lanesim::mjcf::{self, LoadOptions};
use lanesim::model::{Array as ModelArray, ArrayData};
use lanesim::npz::{Array, Data};
use lanesim::worlds::Field;
use lanesim::{Model, Options, Worlds};

use super::failure::Failure;
use super::{Backend, ModelArgs, Precision, RunArgs, memory};

/// A model, and how long it took from file to tables.
pub struct Loaded {
    pub model: Arc<Model>,
    pub seconds: f64,
}

/// Reads and compiles the model.
pub fn load(args: &ModelArgs) -> Result<Loaded, Failure> {
    load_with(args, &[])
}

/// Reads and compiles the model with further options.
pub fn load_with(args: &ModelArgs, more: &[(&str, &str)]) -> Result<Loaded, Failure> {
    let start = Instant::now();
    let more = more.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
    let overrides = args.options.iter().cloned().chain(more).collect();
    let spec = mjcf::load(&args.model, &LoadOptions { lenient: args.lenient, overrides })?;
    let model = Arc::new(Model::from_spec(&spec)?);
    Ok(Loaded { model, seconds: start.elapsed().as_secs_f64() })
}

/// The number of elements of a kind, by MuJoCo's name.
pub fn size(model: &Model, name: &str) -> usize {
    model.sizes().iter().find(|(n, _)| *n == name).map_or(0, |(_, count)| *count)
}

/// A model array as it is written to files.
pub fn model_array(array: &ModelArray) -> Option<Array> {
    let data = match &array.data {
        ArrayData::F64(v) => Data::F64(v.clone()),
        ArrayData::I32(v) => Data::I32(v.clone()),
    };
    Array::new(array.shape.clone(), data)
}

impl RunArgs {
    /// A batch as the arguments want it.
    pub fn worlds(&self, model: &Arc<Model>, nworld: usize) -> Result<Worlds, Failure> {
        self.check_memory(model, nworld)?;
        Ok(Worlds::new(model, nworld, &self.options())?)
    }

    /// An error if so many worlds cannot fit.
    pub fn check_memory(&self, model: &Model, nworld: usize) -> Result<(), Failure> {
        let state: usize = Field::ALL[..6].iter().map(|(field, _)| field.len(model)).sum();
        memory::check("the worlds", &[nworld, state * size_of::<f64>() + 64])
    }

    /// The backend as it was asked for.
    pub fn backend_name(&self) -> &'static str {
        match self.backend {
            Backend::Auto | Backend::Wide => "wide",
            Backend::Scalar => "scalar",
        }
    }

    /// The library's options.
    pub fn options(&self) -> Options {
        Options {
            precision: match self.precision {
                Precision::F32 => lanesim::Precision::F32,
                Precision::F64 => lanesim::Precision::F64,
            },
            backend: match self.backend {
                Backend::Auto => lanesim::Backend::Auto,
                Backend::Wide => lanesim::Backend::Wide,
                Backend::Scalar => lanesim::Backend::Scalar,
            },
            threads: self.threads.map(|n| n as usize),
            ..Options::default()
        }
    }
}

/// Sets a field of every world from an array with one row per world.
pub fn set_all(worlds: &mut Worlds, field: Field, values: &[f64]) -> Result<(), Failure> {
    let width = values.len() / worlds.nworld();
    Ok((0..worlds.nworld()).try_for_each(|w| worlds.set(field, w, &values[w * width..][..width]))?)
}

/// The instruction set that this build's lanes use.
pub const fn isa() -> &'static str {
    if cfg!(target_feature = "avx512f") {
        "avx512"
    } else if cfg!(all(target_feature = "avx2", target_feature = "fma")) {
        "avx2+fma"
    } else if cfg!(target_arch = "aarch64") {
        "neon"
    } else {
        "baseline"
    }
}
