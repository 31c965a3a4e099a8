//! The model, with the text that it came from.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use lanesim::Diagnostics;
use lanesim::cloud;
use lanesim::mjcf::{self, Asset, Document, Include, LoadOptions};
use lanesim::model::{ArrayData, Names};
use lanesim::spec::Spec;
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;

use crate::arrays::Numbers;
use crate::cloud::target;
use crate::failure::{self, raise, rejected};
use crate::home::Home;
use crate::watch::abandonable;

/// A compiled model; immutable.
#[pyclass(frozen, module = "lanesim._lanesim")]
pub struct Model {
    pub(crate) model: lanesim::Model,
    home: Home,
    /// The same compiled anew in a forked process.
    anew: Mutex<Option<(Home, lanesim::Model)>>,
    source: Arc<Source>,
    spec: Spec,
    overrides: Overrides,
}

/// Options that replace those of the text, in the order in which they were given.
type Overrides = Vec<(String, String)>;

/// Where the model came from.
struct Source {
    document: Document,
    lenient: bool,
}

/// An included file: (including path, name, path, text).
type File = (Option<String>, String, String, String);

/// The file of a mesh: (name, path, bytes).
type AssetFile = (String, String, Vec<u8>);

impl Model {
    fn compile(py: Python<'_>, source: Arc<Source>, spec: Spec, overrides: Overrides) -> PyResult<Model> {
        let compile = move || (lanesim::Model::from_spec(&spec), spec);
        let (model, spec) = abandonable(py, compile)?;
        let model = model.map_err(|e| rejected(py, &e))?;
        Ok(Model { model, home: Home::here(), anew: Mutex::new(None), source, spec, overrides })
    }

    /// Reads a document, then compiles what it describes.
    fn read(
        py: Python<'_>,
        lenient: bool,
        overrides: Overrides,
        read: impl FnOnce(&LoadOptions) -> Result<(Document, Spec), Diagnostics> + Send + 'static,
    ) -> PyResult<Model> {
        let options = LoadOptions { lenient, overrides: overrides.clone() };
        let (document, spec) = abandonable(py, move || read(&options))?.map_err(|e| rejected(py, &e))?;
        Model::compile(py, Arc::new(Source { document, lenient }), spec, overrides)
    }

    /// The model, fit for stepping in this process. Where it was made by the parent of a forked process, some thread may
    /// have been making its code, and nobody would ever end that: it is compiled anew.
    pub fn here(&self, py: Python<'_>) -> PyResult<lanesim::Model> {
        if self.home.is_here() {
            return Ok(self.model.clone());
        }
        // A lock that a thread held during the fork stays closed.
        let mut kept = self.anew.try_lock().ok();
        if let Some(Some((home, model))) = kept.as_deref()
            && home.is_here()
        {
            return Ok(model.clone());
        }
        let model = py.detach(|| lanesim::Model::from_spec(&self.spec)).map_err(|e| rejected(py, &e))?;
        if let Some(kept) = &mut kept {
            **kept = Some((Home::here(), model.clone()));
        }
        Ok(model)
    }

    fn names_of(&self, kind: &str) -> PyResult<&Names> {
        let names = self.model.names();
        Ok(match kind {
            "body" => &names.bodies,
            "joint" => &names.joints,
            "geom" => &names.geoms,
            "site" => &names.sites,
            "tendon" => &names.tendons,
            "equality" => &names.equalities,
            "actuator" => &names.actuators,
            "sensor" => &names.sensors,
            "key" => &names.keys,
            _ => return Err(PyKeyError::new_err(kind.to_string())),
        })
    }
}

#[pymethods]
impl Model {
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, lenient: bool, overrides: Overrides) -> PyResult<Model> {
        Model::read(py, lenient, overrides, move |options| Document::load(&path, options))
    }

    #[staticmethod]
    fn parse(
        py: Python<'_>,
        text: String,
        files: BTreeMap<String, Vec<u8>>,
        lenient: bool,
        overrides: Overrides,
    ) -> PyResult<Model> {
        Model::read(py, lenient, overrides, move |options| Document::parse(&text, &files, options))
    }

    /// The model from what `document` returned.
    #[staticmethod]
    fn restore(
        py: Python<'_>,
        file: Option<String>,
        text: String,
        includes: Vec<File>,
        assets: Vec<AssetFile>,
        lenient: bool,
        overrides: Overrides,
    ) -> PyResult<Model> {
        let includes = includes.into_iter().map(|(by, name, path, text)| Include { by, name, path, text }).collect();
        let assets = assets.into_iter().map(|(name, path, bytes)| Asset { name, path, bytes: bytes.into() }).collect();
        let document = Document { file, text, includes, assets };
        Model::read(py, lenient, overrides, move |options| document.spec(options).map(|spec| (document, spec)))
    }

    /// All that the model was made from.
    fn document(&self) -> (Option<String>, String, Vec<File>, Vec<AssetFile>, bool, Overrides) {
        let Source { document, lenient } = &*self.source;
        let file = |i: &Include| (i.by.clone(), i.name.clone(), i.path.clone(), i.text.clone());
        let includes = document.includes.iter().map(file).collect();
        let asset = |a: &Asset| (a.name.clone(), a.path.clone(), a.bytes.to_vec());
        let assets = document.assets.iter().map(asset).collect();
        (document.file.clone(), document.text.clone(), includes, assets, *lenient, self.overrides.clone())
    }

    /// The same model with other options.
    fn with_options(&self, py: Python<'_>, overrides: Overrides) -> PyResult<Model> {
        let mut spec = self.spec.clone();
        mjcf::override_options(&mut spec, &overrides).map_err(|e| rejected(py, &e))?;
        let overrides = mjcf::replace_overrides(&self.overrides, &overrides);
        Model::compile(py, self.source.clone(), spec, overrides)
    }

    /// The same model with options by which constraints are solved accurately.
    fn accurate(&self, py: Python<'_>) -> PyResult<Model> {
        let options = cloud::accurate_options(&self.spec.option);
        let numbers = [
            ("solver", "Newton".to_owned()),
            ("tolerance", options.tolerance.to_string()),
            ("ls_tolerance", options.ls_tolerance.to_string()),
            ("iterations", options.iterations.to_string()),
            ("ls_iterations", options.ls_iterations.to_string()),
        ];
        self.with_options(py, numbers.map(|(name, value)| (name.to_owned(), value)).to_vec())
    }

    /// An exception if a quaternion in rows of positions is as good as zero.
    fn check_quaternions(&self, py: Python<'_>, qpos: Numbers<'_>, shape: Vec<usize>) -> PyResult<()> {
        let values = qpos.values()?;
        py.detach(|| cloud::check_quaternions(&self.model, values, &shape)).map_err(|e| raise(py, e))
    }

    /// Arrays of derivatives of `of`, "transition", "acceleration" or "inverse": name, a world's dimensions, and whether it is of integers.
    fn derivatives(&self, of: &str, sensors: bool) -> Vec<(&'static str, Vec<usize>, bool)> {
        target(of, None, 0).arrays(&self.model, sensors)
    }

    #[getter]
    fn name(&self) -> &str {
        self.model.name()
    }

    fn sizes(&self) -> Vec<(&'static str, usize)> {
        self.model.sizes().to_vec()
    }

    fn array_names(&self) -> Vec<&'static str> {
        self.model.array_names().collect()
    }

    /// An array by its name, copied.
    fn array<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(array) = self.model.array(name) else { return Ok(None) };
        let shape = array.shape.clone();
        Ok(Some(match &array.data {
            ArrayData::F64(x) => x.clone().into_pyarray(py).reshape(shape)?.into_any(),
            ArrayData::I32(x) => x.clone().into_pyarray(py).reshape(shape)?.into_any(),
        }))
    }

    /// Flags of MJCF's `option/flag` by their names.
    fn flags(&self) -> Vec<(&'static str, bool)> {
        let f = &self.spec.option.flags;
        vec![
            ("constraint", f.constraint),
            ("equality", f.equality),
            ("frictionloss", f.frictionloss),
            ("limit", f.limit),
            ("contact", f.contact),
            ("spring", f.spring),
            ("damper", f.damper),
            ("gravity", f.gravity),
            ("clampctrl", f.clampctrl),
            ("warmstart", f.warmstart),
            ("filterparent", f.filterparent),
            ("actuation", f.actuation),
            ("refsafe", f.refsafe),
            ("sensor", f.sensor),
            ("midphase", f.midphase),
            ("eulerdamp", f.eulerdamp),
            ("autoreset", f.autoreset),
            ("nativeccd", f.nativeccd),
            ("island", f.island),
            ("multiccd", f.multiccd),
            ("override", f.override_),
            ("energy", f.energy),
            ("fwdinv", f.fwdinv),
            ("invdiscrete", f.invdiscrete),
            ("sleep", f.sleep),
            ("diagexact", f.diagexact),
            ("ipc", f.ipc),
            ("speculative", f.speculative),
        ]
    }

    fn names(&self, kind: &str) -> PyResult<Vec<String>> {
        Ok(self.names_of(kind)?.iter().map(str::to_string).collect())
    }

    fn id(&self, kind: &str, name: &str) -> PyResult<Option<usize>> {
        Ok(self.names_of(kind)?.id(name))
    }

    fn notes(&self) -> Vec<String> {
        self.model.report().notes.clone()
    }

    fn losses(&self) -> Vec<String> {
        self.model.report().losses.clone()
    }

    /// Range of every actuator's control: its own if it is limited, two units from its other end where one is infinite; else
    /// [-1, 1].
    fn control_ranges(&self) -> Vec<[f64; 2]> {
        (0..self.model.tables().sizes.nu).map(|a| self.model.control_range(a)).collect()
    }

    /// An output's (lengths equal in all worlds, shape per world or per entry, integer).
    fn output(&self, py: Python<'_>, name: &str) -> PyResult<(bool, Vec<usize>, bool)> {
        let output = self.model.output(name).map_err(|e| failure::raise(py, e))?;
        let (fixed, shape) = output.shape(&self.model);
        Ok((fixed, shape, output.is_integer()))
    }

    /// A field's dimensions after the worlds': names, empty where all models have the same, and counts.
    fn field(&self, py: Python<'_>, name: &str) -> PyResult<Vec<(&'static str, usize)>> {
        let unknown = || failure::raise(py, lanesim::Error::Unknown(format!("there is no field {name}")));
        lanesim::Field::named(name).map(|field| field.shape(&self.model)).ok_or_else(unknown)
    }
}
