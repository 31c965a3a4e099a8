//! One execution: an input, and everything that a user could do with it. Nothing here may panic, hang or take the machine's
//! memory, and what may be refused must be refused with words.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use clap::Parser;
use lanesim::mjcf::{self, LoadOptions};
use lanesim::npz::{self, Archive};
use lanesim::outputs::Output;
use lanesim::pool::Pool;
use lanesim::{Backend, Controls, Field, OnDiverge, Options, Parameter, Precision, Rollout, Worlds};
use lanesim_kernels::state::Status;

use super::cli::Cli;
use super::model::{Model, Node, model, overrides};
use super::random::Random;
use super::{archive, arguments};

/// What executions share.
pub struct Fuzzer {
    corpus: Vec<Node>,
    pool: Arc<Pool>,
    small: lanesim::Model,
}

/// Largest model that is stepped as often as others.
const SMALL: (usize, usize) = (30, 20);

impl Fuzzer {
    /// Reads the corpus: the models of unit tests, and texts that once found something.
    pub fn new() -> Fuzzer {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let texts = ["models/unit", "tests/fuzz/corpus"].iter().flat_map(|folder| files(&root.join(folder), "xml"));
        let corpus: Vec<Node> = texts.filter_map(|(_, bytes)| Node::parse(&String::from_utf8(bytes).ok()?)).collect();
        assert!(corpus.len() > 20, "the corpus is missing");
        let text = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>";
        let small = lanesim::Model::from_xml_string(text, &LoadOptions::default()).expect("a small model");
        Fuzzer { corpus, pool: Arc::new(Pool::new(Some(1), false).expect("a thread")), small }
    }

    /// Runs execution `index`; its input goes to standard output if it is to be shown.
    pub fn execute(&self, seed: u64, index: u64, show: bool) {
        let random = &mut Random::new(seed, index);
        match random.below(10) {
            0 => {
                let line = arguments::arguments(random);
                if show {
                    println!("arguments: {line:?}");
                }
                self.arguments(line);
            }
            1 | 2 => {
                let bytes = archive::archive(random);
                if show {
                    println!("archive: {}", bytes.iter().map(|b| format!("{b:02x}")).collect::<String>());
                }
                self.archive(&bytes, random);
            }
            _ => {
                let (model, overrides) = (model(&self.corpus, random), overrides(random));
                if show {
                    println!("{}\n{:?}\noverrides: {overrides:?}", model.text, model.files);
                }
                self.model(&model, overrides, random, show);
            }
        }
    }

    /// Runs everything in the corpus, as it is.
    pub fn run_corpus(&self) {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/corpus");
        for (name, bytes) in files(&folder, "xml") {
            let text = String::from_utf8_lossy(&bytes).into_owned();
            for index in 0..20 {
                let model = Model { text: text.clone(), files: BTreeMap::new() };
                self.model(&model, Vec::new(), &mut Random::new(1, index), false);
            }
            println!("corpus: {name} passed");
        }
        for (name, bytes) in files(&folder, "npz") {
            self.archive(&bytes, &mut Random::new(1, 1));
            println!("corpus: {name} passed");
        }
    }

    fn arguments(&self, line: Vec<std::ffi::OsString>) {
        if let Err(error) = Cli::try_parse_from(line) {
            assert!(!error.to_string().is_empty(), "an error without words");
        }
    }

    fn archive(&self, bytes: &[u8], random: &mut Random) {
        let limit = random.one_in(3).then(|| random.next() >> random.below(64));
        match Archive::new(Cursor::new(bytes), limit) {
            Ok(archive) => {
                let shapes: Vec<(String, Vec<usize>)> =
                    archive.names().filter_map(|n| Some((n.to_owned(), archive.shape(n)?.to_vec()))).collect();
                if let Ok(arrays) = archive.read_all() {
                    assert_eq!(arrays.len(), shapes.len());
                    for (name, shape) in shapes {
                        let n = if shape.contains(&0) { 0 } else { shape.iter().product() };
                        assert_eq!(arrays[&name].data().len(), n, "{name}");
                    }
                    let options = Options { backend: Backend::Scalar, threads: Some(1), ..Options::default() };
                    if random.one_in(20) {
                        let _ = lanesim::eval::eval(&self.small, &arrays, &["qpos", "ncon"], 1, &options);
                    }
                }
            }
            Err(error) => assert!(!error.to_string().is_empty(), "an error without words"),
        }
        let _ = npz::read_from(Cursor::new(bytes));
    }

    fn model(&self, given: &Model, overrides: Vec<(String, String)>, random: &mut Random, show: bool) {
        let mut strict = false;
        for lenient in [false, true] {
            let options = LoadOptions { lenient, overrides: overrides.clone() };
            let model = match mjcf::parse_with_files(&given.text, &given.files, &options) {
                Ok(spec) => lanesim::Model::from_spec(&spec).map_err(|e| e.to_string()),
                Err(e) => Err(e.to_string()),
            };
            match model {
                Ok(model) => {
                    strict |= !lenient;
                    if lenient != strict {
                        self.step(&model, random, show);
                    }
                }
                Err(message) => {
                    assert!(!message.is_empty(), "an error without words");
                    assert!(!strict, "refused only where it is lenient: {message}");
                }
            }
        }
    }

    /// Three worlds of a model in states that only have to be finite.
    fn step(&self, model: &lanesim::Model, random: &mut Random, show: bool) {
        let sizes = &model.tables().sizes;
        let small = sizes.nv <= SMALL.0 && sizes.ngeom <= SMALL.1;
        if !random.one_in(if small { 2 } else { 200 }) {
            return;
        }
        let options = Options {
            precision: if random.one_in(2) { Precision::F64 } else { Precision::F32 },
            backend: match random.below(24) {
                0 if small => Backend::Native,
                1..10 => Backend::Wide,
                _ => Backend::Scalar,
            },
            threads: Some(1),
            max_contacts: *random.pick(&[1024, 1024, 1, 0]),
            on_diverge: *random.pick(&[OnDiverge::Freeze, OnDiverge::Reset { key: None }, OnDiverge::Error]),
            ..Options::default()
        };
        if show {
            println!("{options:?}");
        }
        let Ok(mut worlds) = Worlds::with_pool(model, 3, &options, self.pool.clone()) else { return };
        disturb(model, &mut worlds, random);
        let names: Vec<&str> = Output::all().map(|output| output.name).collect();
        let mut output = || model.output(&random.pick::<&str>(&names).replace("NAME", "0")).ok();
        let outputs: Vec<Output> = (0..3).filter_map(|_| output()).collect();
        let controls = if random.one_in(2) { Controls::Noise { seed: 1, scale: 1.0 } } else { Controls::Keep };
        let mut stepped = true;
        for _ in 0..1 + random.below(2) {
            let recorded: Vec<Output> = outputs.iter().filter(|o| o.width(model).is_some()).copied().collect();
            let nstep = 1 + random.below(3);
            let run = Rollout { nstep, controls, outputs: &recorded, statistics: true, ..Rollout::default() };
            stepped &= worlds.rollout(&run).is_ok();
            let _ = worlds.forward(&outputs, &mut |_, _| {});
        }
        let qacc: Vec<f64> = (0..3 * model.tables().sizes.nv).map(|_| random.unit() - 0.5).collect();
        if let Err(error) = worlds.inverse(&qacc) {
            assert!(!error.to_string().is_empty(), "an error without words");
        }
        for world in 0..3 {
            // What a step leaves is finite, whatever it began with, or the world has a flag.
            let flagged = worlds.status(world).expect("a world") != Status::default();
            let qvel = worlds.get(Field::Qvel, world).expect("a field");
            assert!(
                !stepped || flagged || qvel.iter().all(|x| x.is_finite()),
                "a velocity that is not finite and no flag"
            );
            let events = worlds.status_detail(world).expect("a world");
            assert!(events.iter().all(|event| !event.to_string().is_empty()));
        }
    }
}

/// States, forces and parameters from all of the numbers that there are.
fn disturb(model: &lanesim::Model, worlds: &mut Worlds, random: &mut Random) {
    for _ in 0..random.below(4) {
        let (field, _) = *random.pick(&Field::ALL);
        let world = random.below(3);
        let mut values = worlds.get(field, world).expect("a field");
        for value in &mut values {
            if random.one_in(2) {
                *value = random.finite();
            }
        }
        if random.one_in(8) && !values.is_empty() {
            let place = random.below(values.len());
            values[place] = *random.pick(&[f64::NAN, f64::INFINITY]);
            let _ = worlds.set_unchecked(field, world, &values);
        } else {
            let _ = worlds.set(field, world, &values);
        }
    }
    if random.one_in(6) {
        let (parameter, _) = *random.pick(&Parameter::ALL);
        let values: Vec<f64> = (0..parameter.len(model)).map(|_| random.finite()).collect();
        let _ = worlds.set_parameter(parameter, random.below(3), &values);
    }
}

/// Names and contents of a folder's files with an ending, in order.
fn files(folder: &Path, ending: &str) -> Vec<(String, Vec<u8>)> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut found: Vec<_> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|e| e == ending))
        .filter_map(|path| Some((path.file_name()?.to_string_lossy().into_owned(), std::fs::read(&path).ok()?)))
        .collect();
    found.sort();
    found
}
