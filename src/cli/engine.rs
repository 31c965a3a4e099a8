//! From arguments to the library's types.

use std::path::PathBuf;
use std::time::Instant;

use lanesim::mjcf::{Document, LoadOptions};
use lanesim::npz::{Array, Data};
use lanesim::outputs::Output;
use lanesim::{Field, Model, Options, Worlds, suggest};

use super::failure::Failure;
use super::{Backend, Instructions, ModelArgs, OnDiverge, Precision, RunArgs, memory};

/// The events of the first few worlds that have any, one line each, and how many worlds have more.
pub fn events(worlds: &Worlds) -> Result<Vec<String>, Failure> {
    const SHOWN: usize = 10;
    let (mut lines, mut worlds_with) = (Vec::new(), 0);
    for world in 0..worlds.nworld() {
        let events = worlds.status_detail(world)?;
        worlds_with += usize::from(!events.is_empty());
        if worlds_with <= SHOWN {
            lines.extend(events.iter().map(|event| format!("world {world}: {event}")));
        }
    }
    if worlds_with > SHOWN {
        lines.push(format!("{} more worlds have flags", worlds_with - SHOWN));
    }
    Ok(lines)
}

/// A model, what it was read from, and how long it took from file to tables.
pub struct Loaded {
    /// The model.
    pub model: Model,
    /// The files that its file includes.
    pub includes: Vec<PathBuf>,
    /// Wall time of reading and compiling.
    pub seconds: f64,
}

/// Reads and compiles the model.
pub fn load(args: &ModelArgs) -> Result<Loaded, Failure> {
    load_with(args, &[])
}

/// Reads and compiles the model with further options.
pub fn load_with(args: &ModelArgs, more: &[(&str, &str)]) -> Result<Loaded, Failure> {
    let start = Instant::now();
    let given = args.options.iter().filter(|(name, _)| more.iter().all(|(other, _)| other != name)).cloned();
    let more = more.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
    let overrides = given.chain(more).collect();
    let (document, spec) = Document::load(&args.model, &LoadOptions { lenient: args.lenient, overrides })?;
    let model = Model::from_spec(&spec)?;
    let includes = document.includes.into_iter().map(|include| include.path.into()).collect();
    Ok(Loaded { model, includes, seconds: start.elapsed().as_secs_f64() })
}

/// The number of elements of a kind, by MuJoCo's name.
pub fn size(model: &Model, name: &str) -> usize {
    model.sizes().iter().find(|(n, _)| *n == name).map_or(0, |(_, count)| *count)
}

impl RunArgs {
    /// A batch as the arguments want it, every world in keyframe `key` if it is given.
    pub fn worlds(&self, model: &Model, nworld: usize, key: Option<usize>) -> Result<Worlds, Failure> {
        self.check_memory(model, nworld)?;
        let mut worlds = Worlds::new(model, nworld, &self.options(key))?;
        notice(&worlds);
        if key.is_some() {
            (0..nworld).try_for_each(|world| worlds.reset(world, key))?;
        }
        Ok(worlds)
    }

    /// An error if so many worlds cannot fit.
    pub fn check_memory(&self, model: &Model, nworld: usize) -> Result<(), Failure> {
        let forces = [Field::QfrcApplied, Field::XfrcApplied];
        let kept = Field::ALL.iter().filter(|(field, _)| !forces.contains(field));
        let state: usize = kept.map(|(field, _)| field.len(model)).sum();
        memory::check("the worlds", &[nworld, state * size_of::<f64>() + 64], self.max_memory)
    }

    /// The library's options for worlds that start from this keyframe.
    pub fn options(&self, key: Option<usize>) -> Options {
        Options {
            precision: match self.precision {
                Precision::F32 => lanesim::Precision::F32,
                Precision::F64 => lanesim::Precision::F64,
            },
            backend: match self.backend {
                Backend::Auto => lanesim::Backend::Auto,
                Backend::Native => lanesim::Backend::Native,
                Backend::Wide => lanesim::Backend::Wide,
                Backend::Scalar => lanesim::Backend::Scalar,
            },
            instructions: self.instructions.map(|set| match set {
                Instructions::Avx2 => lanesim::InstructionSet::Avx2,
                Instructions::Avx512 => lanesim::InstructionSet::Avx512,
            }),
            threads: self.threads.map(|n| n as usize),
            pin: self.pin && !self.no_pin,
            max_memory: self.max_memory,
            on_diverge: match self.on_diverge {
                OnDiverge::Freeze => lanesim::OnDiverge::Freeze,
                OnDiverge::Reset => lanesim::OnDiverge::Reset { key },
                OnDiverge::Error => lanesim::OnDiverge::Error,
            },
            ..Options::default()
        }
    }
}

/// Outputs of a model by their names.
pub fn outputs(model: &Model, names: &[&str]) -> Result<Vec<Output>, Failure> {
    names.iter().map(|name| Ok(model.output(name)?)).collect()
}

/// The names without blanks around them; an error if one comes twice or is that of a file.
pub fn unique(names: &[String]) -> Result<Vec<&str>, Failure> {
    let names: Vec<&str> = names.iter().map(|name| name.trim()).collect();
    for (i, name) in names.iter().enumerate() {
        if names[..i].contains(name) {
            return Err(Failure::Usage(format!("--outputs names {name} twice; name every output once")));
        }
        if name.is_empty() {
            return Err(Failure::Usage("--outputs has an empty name; separate names by single commas".into()));
        }
        if name.ends_with(".npz") {
            return Err(Failure::Usage(format!("--outputs {name} is no output; did you mean --output {name}?")));
        }
    }
    Ok(names)
}

/// The keyframe that `text`, a name or a number, stands for.
pub fn keyframe(model: &Model, text: &str) -> Result<usize, Failure> {
    let names = &model.names().keys;
    if let Some(key) = names.id(text) {
        return Ok(key);
    }
    let n = model.keys().len();
    if n == 0 {
        return Err(Failure::Usage(format!("--keyframe {text}: the model has no keyframes; leave it out")));
    }
    match text.parse() {
        Ok(key) if key < n => Ok(key),
        Ok(_) => Err(Failure::Usage(format!("--keyframe {text}: the model has {n} keyframes, counted from 0"))),
        Err(_) => {
            let named: Vec<&str> = names.iter().filter(|name| !name.is_empty()).collect();
            let remedy = suggest::or_list(text, named);
            let remedy = if remedy.is_empty() { "give its number, counted from 0".to_owned() } else { remedy };
            Err(Failure::Usage(format!("--keyframe {text}: the model has {n} keyframes, none of that name; {remedy}")))
        }
    }
}

/// An output's values as an array called `name`; `leading` are the dimensions before the output's own.
pub fn named(
    (name, output): (&str, &Output),
    model: &Model,
    leading: &[usize],
    values: Vec<f64>,
) -> Result<(String, Array), Failure> {
    let shape = [leading, &output.shape(model).1].concat();
    let data = match output.is_integer() {
        true => Data::I32(values.into_iter().map(|x| x as i32).collect()),
        false => Data::F64(values),
    };
    let array = Array::new(shape, data).ok_or_else(|| {
        Failure::Input(format!("output {name} does not have the size that it says; please report this"))
    })?;
    Ok((name.to_owned(), array))
}

/// Sets a field of every world from an array with one row per world.
pub fn set_all(worlds: &mut Worlds, field: Field, values: &[f64]) -> Result<(), Failure> {
    let width = values.len() / worlds.nworld();
    Ok((0..worlds.nworld()).try_for_each(|w| worlds.set(field, w, &values[w * width..][..width]))?)
}

/// Says why there is no machine code, if that was wanted.
pub fn notice(worlds: &Worlds) {
    if let Some(notice) = &worlds.running().notice {
        eprintln!("note: {notice}");
    }
}

/// The instruction set that this build's lanes use.
pub fn isa() -> String {
    let name = if cfg!(target_feature = "avx512f") {
        "avx512"
    } else if cfg!(all(target_feature = "avx2", target_feature = "fma")) {
        "avx2+fma"
    } else if cfg!(target_arch = "aarch64") {
        "neon"
    } else {
        "baseline"
    };
    name.to_owned()
}
