//! The compiled model: what the kernels run, and what users ask of it by name.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::{Arc, OnceLock};

use lanesim_kernels::model::{self as kernel, Cast};

use crate::diagnostics::Diagnostics;
use crate::mjcf::{self, LoadOptions};
use crate::native::Codes;
use crate::spec::{self, Spec};

/// A compiled model. Immutable; a clone shares everything.
#[derive(Clone, Debug)]
pub struct Model(Arc<Data>);

#[derive(Debug)]
struct Data {
    name: String,
    tables: Arc<kernel::Model<f64>>,
    tables_f32: OnceLock<Arc<kernel::Model<f32>>>,
    codes: (Codes<f64>, Codes<f32>),
    names: ElementNames,
    placements: Placements,
    keys: Vec<Key>,
    arrays: BTreeMap<&'static str, Array>,
    counts: Vec<(&'static str, usize)>,
    report: Report,
    basis: Basis,
}

/// What numbers of the tables follow from, beside the arrays.
#[derive(Clone, Debug)]
pub(crate) struct Basis {
    /// Masses and centres of mass of the bodies that stand still.
    pub still: Vec<(f64, [f64; 3])>,
    /// By geom, what it brings to its contacts.
    pub surfaces: Vec<Surface>,
    /// By pair, the geoms whose numbers its contacts mix, if they do.
    pub mixed: Vec<Option<[usize; 2]>>,
    /// Whether some joint's spring and damper follow from inertias, by `springdamper`.
    pub spring_dampers: bool,
    /// What the model was compiled from.
    pub spec: Spec,
    /// Whether some muscle's force follows from inertias.
    pub scaled_muscles: bool,
    /// Whether some actuator's bias follows from its gain and from inertias, by `dampratio`.
    pub damping_ratios: bool,
}

/// What a geom brings to its contacts.
#[derive(Clone, Debug)]
pub(crate) struct Surface {
    pub priority: i32,
    pub condim: i32,
    pub solmix: f64,
    pub friction: [f64; 3],
    pub solref: [f64; 2],
    pub solimp: [f64; 5],
    pub margin: f64,
    pub gap: f64,
}

impl Surface {
    /// That of a geom.
    pub fn of(geom: &spec::Geom) -> Self {
        let spec::Geom { priority, condim, solmix, friction, solref, solimp, margin, gap, .. } = *geom;
        Surface { priority, condim, solmix, friction, solref, solimp, margin, gap }
    }
}

/// What the compiler hands over.
pub(crate) struct Parts {
    pub name: String,
    pub tables: kernel::Model<f64>,
    pub names: ElementNames,
    pub placements: Placements,
    pub keys: Vec<Key>,
    pub arrays: BTreeMap<&'static str, Array>,
    pub counts: Vec<(&'static str, usize)>,
    pub report: Report,
    pub basis: Basis,
}

/// The names of one kind of element: by number and by name.
#[derive(Clone, Debug, Default)]
pub struct Names {
    list: Vec<String>,
    index: HashMap<String, usize>,
}

impl Names {
    /// Of names in the order of the elements; empty ones are not indexed, and of equal ones the first is.
    pub(crate) fn new(list: Vec<String>) -> Names {
        let mut index = HashMap::with_capacity(list.len());
        for (i, name) in list.iter().enumerate() {
            if !name.is_empty() {
                index.entry(name.clone()).or_insert(i);
            }
        }
        Names { list, index }
    }

    /// Number of elements, named or not.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether there is no element.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Name of element `i`; empty if it has none or there is no such element.
    pub fn name(&self, i: usize) -> &str {
        self.list.get(i).map_or("", String::as_str)
    }

    /// Number of the element called `name`.
    pub fn id(&self, name: &str) -> Option<usize> {
        self.index.get(name).copied()
    }

    /// The names, in the order of the elements.
    pub fn iter(&self) -> impl Iterator<Item = &str> {
        self.list.iter().map(String::as_str)
    }
}

/// Names by kind of element.
#[derive(Clone, Debug, Default)]
pub struct ElementNames {
    /// Bodies; body 0 is the world.
    pub bodies: Names,
    /// Joints.
    pub joints: Names,
    /// Geoms.
    pub geoms: Names,
    /// Sites.
    pub sites: Names,
    /// Cameras.
    pub cameras: Names,
    /// Tendons.
    pub tendons: Names,
    /// Equality constraints.
    pub equalities: Names,
    /// Actuators.
    pub actuators: Names,
    /// Sensors.
    pub sensors: Names,
    /// Keyframes.
    pub keys: Names,
}

/// Where a frame is: fixed to a link, or still in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Link that carries it, or [`NONE`](kernel::NONE): it stands still, and the pose is in the world.
    pub link: u32,
    /// Position in the link's frame, or in the world.
    pub pos: [f64; 3],
    /// Orientation (w, x, y, z), likewise.
    pub quat: [f64; 4],
    /// The same as a matrix, row-major.
    pub mat: [f64; 9],
}

/// Where everything is that has a pose, in MJCF's numbering.
#[derive(Clone, Debug, Default)]
pub struct Placements {
    /// Frames of bodies.
    pub bodies: Vec<Placement>,
    /// Inertial frames of bodies: centre of mass and principal axes.
    pub inertials: Vec<Placement>,
    /// Geoms.
    pub geoms: Vec<Placement>,
    /// Sites.
    pub sites: Vec<Placement>,
}

/// A keyframe with every field filled in.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Key {
    /// Name, or empty.
    pub name: String,
    /// Time, s.
    pub time: f64,
    /// Positions, quaternions of length one; `qpos0` where not given.
    pub qpos: Vec<f64>,
    /// Velocities.
    pub qvel: Vec<f64>,
    /// Activations.
    pub act: Vec<f64>,
    /// Histories: as at the beginning.
    pub history: Vec<f64>,
    /// Where springs rest that yield.
    pub plastic: Vec<f64>,
    /// Controls.
    pub ctrl: Vec<f64>,
    /// Positions of mocap bodies.
    pub mpos: Vec<f64>,
    /// Orientations of mocap bodies.
    pub mquat: Vec<f64>,
    /// Whether each equality constraint is active, 1 or 0: as the model has it.
    pub eq_active: Vec<f64>,
    /// For how long trees have rested; empty: they have not.
    pub tree_rest: Vec<f64>,
}

/// An array of the model as MuJoCo has it, dense, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Lengths of its dimensions; empty for a single number.
    pub shape: Vec<usize>,
    /// Its entries.
    pub data: ArrayData,
}

/// The entries of an [`Array`].
#[derive(Clone, Debug, PartialEq)]
pub enum ArrayData {
    /// Real numbers.
    F64(Vec<f64>),
    /// Integers, kinds and switches.
    I32(Vec<i32>),
}

/// What the user should know about a model that compiled.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// What was adjusted, or acts otherwise than it may seem.
    pub notes: Vec<String>,
    /// What a lenient load left out.
    pub losses: Vec<String>,
}

impl Model {
    /// Loads and compiles an MJCF file.
    pub fn from_xml_path(path: &Path, options: &LoadOptions) -> Result<Model, Diagnostics> {
        Model::from_spec(&mjcf::load(path, options)?)
    }

    /// Parses and compiles MJCF text.
    pub fn from_xml_string(text: &str, options: &LoadOptions) -> Result<Model, Diagnostics> {
        Model::from_spec(&mjcf::parse(text, options)?)
    }

    /// Compiles a spec, or says everything that is wrong with it.
    pub fn from_spec(spec: &Spec) -> Result<Model, Diagnostics> {
        crate::compile::compile(spec)
    }

    pub(crate) fn new(parts: Parts) -> Model {
        let Parts { name, tables, names, placements, keys, arrays, counts, report, basis } = parts;
        let (tables, tables_f32) = (Arc::new(tables), OnceLock::new());
        let codes = Default::default();
        Model(Arc::new(Data {
            name,
            tables,
            tables_f32,
            codes,
            names,
            placements,
            keys,
            arrays,
            counts,
            report,
            basis,
        }))
    }

    /// Machine code of the model, for `f64` and `f32`.
    pub(crate) fn codes(&self) -> &(Codes<f64>, Codes<f32>) {
        &self.0.codes
    }

    /// Name of the model.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// The tables of the kernels in double precision.
    pub fn tables(&self) -> &Arc<kernel::Model<f64>> {
        &self.0.tables
    }

    /// The tables of the kernels in single precision, made when first asked for.
    pub fn tables_f32(&self) -> &Arc<kernel::Model<f32>> {
        self.0.tables_f32.get_or_init(|| Arc::new(self.0.tables.cast()))
    }

    /// Names of the elements.
    pub fn names(&self) -> &ElementNames {
        &self.0.names
    }

    /// Where bodies, geoms and sites are.
    pub fn placements(&self) -> &Placements {
        &self.0.placements
    }

    /// Keyframes.
    pub fn keys(&self) -> &[Key] {
        &self.0.keys
    }

    /// A model array by MuJoCo's name, such as `body_mass`; options too, such as `timestep`. They are as the model says,
    /// whatever flags are off.
    pub fn array(&self, name: &str) -> Option<&Array> {
        self.0.arrays.get(name)
    }

    /// Names of all arrays, sorted.
    pub fn array_names(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.0.arrays.keys().copied()
    }

    /// Numbers of elements by MuJoCo's names.
    pub fn sizes(&self) -> &[(&'static str, usize)] {
        &self.0.counts
    }

    /// The state in which worlds start: the reference configuration at rest, without controls.
    pub fn initial_key(&self) -> Key {
        let sizes = &self.tables().sizes;
        let mocap = || self.tables().links.iter().filter(|link| link.mocap != kernel::NONE);
        Key {
            qpos: self.tables().qpos0.clone(),
            qvel: vec![0.0; sizes.nv],
            act: vec![0.0; sizes.na],
            history: self.tables().history0.clone(),
            plastic: self.tables().plastic0.clone(),
            ctrl: vec![0.0; sizes.nu],
            mpos: mocap().flat_map(|link| link.pos).collect(),
            mquat: mocap().flat_map(|link| link.quat).collect(),
            eq_active: self.tables().eq_active0.clone(),
            tree_rest: self.tables().tree_rest0.clone(),
            ..Key::default()
        }
    }

    /// Range of a control for noise: its own if it is limited, else [-1, 1]; two units from its
    /// other end where one end is infinite.
    pub fn control_range(&self, control: usize) -> [f64; 2] {
        const INFINITE: f64 = f32::MAX as f64;
        let control = &self.tables().controls[control];
        match control.range {
            _ if !control.limited => [-1.0, 1.0],
            [lo, hi] if lo <= -INFINITE => [hi - 2.0, hi],
            [lo, hi] if hi >= INFINITE => [lo, lo + 2.0],
            range => range,
        }
    }

    /// What numbers of the tables follow from.
    pub(crate) fn basis(&self) -> &Basis {
        &self.0.basis
    }

    /// Notes and losses.
    pub fn report(&self) -> &Report {
        &self.0.report
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_directions() {
        let names = Names::new(vec!["world".into(), String::new(), "arm".into()]);
        assert_eq!((names.len(), names.name(2), names.name(1), names.name(9)), (3, "arm", "", ""));
        assert_eq!((names.id("arm"), names.id(""), names.id("leg")), (Some(2), None, None));
    }
}
