//! Outputs: what a run can return, by MuJoCo's names. An output is one entry of the [`table`].

mod contacts;
mod forces;
mod frames;
mod point;
mod table;

use std::borrow::Cow;
use std::ops::Deref;
use std::sync::atomic::AtomicBool;

use glam::DVec3;
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{Instance, Model as KernelModel};
use lanesim_kernels::stage::Stage;
use lanesim_kernels::workspace::Workspace;

use self::frames::Poses;
pub use self::point::Point;
pub(crate) use self::table::Rest;
use self::table::{Entry, Read, Table};
use crate::block::Block;
use crate::error::Error;
use crate::model::Model;
use crate::rows::Rows;
use crate::suggest;

/// A block's stages, for outputs.
pub(crate) struct View<'a, L: LaneQuery> {
    pub model: &'a Model,
    pub tables: &'a KernelModel<L::Real>,
    pub block: &'a Block<L>,
    pub workspace: &'a Workspace<L>,
    /// The worlds of which the workspace holds what follows from their state, as bits: not those that are frozen.
    pub valid: u32,
    /// Those of them whose constraints were solved: not those whose smooth acceleration is too large for it.
    pub solved: u32,
}

/// One world of a block.
struct World<'a, L: LaneQuery> {
    view: &'a View<'a, L>,
    lane: usize,
    /// Of an output that is of a point.
    point: Option<Point>,
}

impl<L: LaneQuery> Clone for World<'_, L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L: LaneQuery> Copy for World<'_, L> {}

impl<'a, L: LaneQuery> Deref for World<'a, L> {
    type Target = &'a View<'a, L>;
    fn deref(&self) -> &&'a View<'a, L> {
        &self.view
    }
}

impl<'a, L: LaneQuery> World<'a, L> {
    /// The model as the world has it.
    fn instance(self) -> Instance<'a, L> {
        Instance { model: self.view.tables, varied: self.view.block.varied.as_deref() }
    }

    /// Its entry, widened; a zero of either sign is +0.
    fn number(&self, x: &L) -> f64 {
        x.get(self.lane).to_f64() + 0.0
    }

    /// Its entries of the first three.
    fn vector(&self, lanes: &[L]) -> DVec3 {
        DVec3::new(self.number(&lanes[0]), self.number(&lanes[1]), self.number(&lanes[2]))
    }

    /// Appends its entries; `n` zeros if there are none: a stage that the model does not have keeps no numbers.
    fn numbers(&self, lanes: &[L], n: usize, out: &mut Vec<f64>) {
        let end = out.len() + n;
        out.extend(lanes.iter().map(|x| self.number(x)));
        out.resize(end, 0.0);
    }
}

/// What to read of the present states.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reading<'a> {
    /// Names of outputs.
    pub names: &'a [&'a str],
    /// Numbers of the worlds that are read, each at most once; `None`: all. Rows are theirs, in this order.
    pub ids: Option<&'a [usize]>,
    /// Stops the reading when it turns true; the result is [`Error::Cancelled`], and the rows hold nothing of use.
    pub cancel: Option<&'a AtomicBool>,
}

/// What outputs are made in, kept from world to world.
#[derive(Debug, Default)]
pub(crate) struct Buffers {
    row: Vec<f64>,
    poses: Poses,
}

/// Where the names of all outputs are, for who meant none that is near.
const LISTED: &str = "`lanesim rollout --help`, lanesim.OUTPUTS in Python and Output::all in Rust list them";

/// An output that was asked for.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// Its place in the table.
    entry: usize,
    point: Option<Point>,
}

/// What is said of an output where outputs are listed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Description {
    /// Name; with `:NAME` at its end for those that are of one body, geom or site.
    pub name: &'static str,
    /// What it is, with its shape and unit.
    pub meaning: String,
}

impl Output {
    /// The output called `name`, of any model. Those that are of one element of a model are found by [`Model::output`].
    ///
    /// # Errors
    ///
    /// If there is none; the message names the nearest.
    pub fn named(name: &str) -> Result<Output, Error> {
        if let Some((kind, element)) = Point::split(name) {
            return Err(Error::Unknown(format!(
                "{name} is of one element of a model: ask for it by Model::output, or give \
                 the number of {} {element} to Output::jac",
                kind.element()
            )));
        }
        let found = Table::<f64>::ENTRIES.iter().position(|entry| entry.name == name && !entry.of_point());
        found.map(|entry| Output { entry, point: None }).ok_or_else(|| {
            let near = suggest::did_you_mean(name, Table::<f64>::ENTRIES.iter().map(|entry| entry.name));
            let remedy = if near.is_empty() { LISTED } else { &near };
            Error::Unknown(format!("there is no output {name}; {remedy}"))
        })
    }

    /// The Jacobian of a point, `[6, nv]`: three rows of its velocity, three of the angular velocity of what it is on, world axes.
    /// MuJoCo's `mj_jacBody`, `mj_jacGeom`, `mj_jacSite`. Strings name it `jac_body:NAME`, `jac_geom:NAME`, `jac_site:NAME`.
    ///
    /// ```
    /// use lanesim::outputs::{Output, Point};
    /// use lanesim::{Field, Model, Options, Rollout, Worlds};
    ///
    /// let xml = "<mujoco><worldbody><body pos='0 0 1'><joint axis='0 1 0'/><geom size='.1'/><site name='tip' pos='1 0 0'/></body>
    ///     </worldbody></mujoco>";
    /// let model = Model::from_xml_string(xml, &Default::default())?;
    /// let mut worlds = Worlds::new(&model, 1, &Options::default())?;
    /// let outputs = [Output::jac(Point::Site(0)), model.output("jac_site:tip")?];
    /// let found = worlds.rollout(&Rollout { nstep: 1, outputs: &outputs, ..Rollout::default() })?.outputs;
    /// assert_eq!(found[0], [0.0, 0.0, -1.0, 0.0, 1.0, 0.0]);
    /// assert_eq!(found[1], found[0]);
    /// # Ok::<(), lanesim::Error>(())
    /// ```
    pub fn jac(point: Point) -> Output {
        let entry = Table::<f64>::ENTRIES.iter().position(|entry| entry.name == point.listed());
        Output { entry: entry.unwrap_or_default(), point: Some(point) }
    }

    /// The output called `name`, as [`Model::output`] says.
    pub(crate) fn of_model(model: &Model, name: &str) -> Result<Output, Error> {
        let Some((kind, element)) = Point::split(name) else {
            let output = Output::named(name)?;
            output.check(model)?;
            return Ok(output);
        };
        kind.find(model, element).map(Output::jac)
    }

    /// Names and meanings of all outputs.
    pub fn all() -> impl Iterator<Item = Description> {
        Table::<f64>::ENTRIES.iter().map(|entry| Description { name: entry.name, meaning: entry.meaning() })
    }

    /// Name; of those that are of one element, with its number: `jac_site:3`.
    pub fn name(&self) -> Cow<'static, str> {
        let listed = self.entry().name;
        self.point.map_or(listed.into(), |point| format!("{}:{}", point.prefix(), point.id()).into())
    }

    /// Its entry in the table.
    fn entry(&self) -> &'static Entry<f64> {
        &Table::<f64>::ENTRIES[self.entry]
    }

    /// Whether the numbers are integers.
    pub fn is_integer(&self) -> bool {
        self.entry().integer
    }

    /// The stage that computes it; `None` for the state itself.
    pub(crate) fn stage(&self) -> Option<Stage> {
        match self.entry().read {
            Read::State(_) => None,
            // What a forward run flags, it flags anywhere up to the solver.
            Read::Status => Some(Stage::Solver),
            Read::Stage(stage, _) => Some(stage),
        }
    }

    /// Whether it follows from the state that a step starts from; the state itself and the status are what the step leaves.
    pub(crate) fn derived(&self) -> bool {
        matches!(self.entry().read, Read::Stage(..))
    }

    /// Whether it needs the solver's residual.
    pub(crate) fn needs_residual(&self) -> bool {
        self.entry().residual
    }

    /// What its first dimension counts, where that differs between worlds.
    pub(crate) fn rest(&self) -> Rest {
        self.entry().rest
    }

    /// Shape per world; `false` where the first dimension, of which this is the rest, differs between worlds.
    pub fn shape(&self, model: &Model) -> (bool, Vec<usize>) {
        let entry = self.entry();
        let shape = match entry.read {
            Read::State([field]) => field.shape(model).into_iter().map(|(_, count)| count).collect(),
            Read::State(fields) => vec![fields.iter().map(|field| field.len(model)).sum()],
            _ => entry.shape.iter().map(|dim| dim.count(&model.tables().sizes)).collect(),
        };
        (entry.rest == Rest::World, shape)
    }

    /// Numbers per world, if all worlds have the same number.
    pub fn width(&self, model: &Model) -> Option<usize> {
        let (fixed, shape) = self.shape(model);
        fixed.then(|| shape.iter().product())
    }

    /// An error if it is of an element that the model does not have.
    pub(crate) fn check(&self, model: &Model) -> Result<(), Error> {
        self.point.map_or(Ok(()), |point| point.check(model))
    }

    /// Writes a world's numbers to `out`, from entry `at` on. Allocates nothing once the buffers have grown.
    pub(crate) fn write<L: LaneQuery>(
        &self,
        view: &View<'_, L>,
        lane: usize,
        buffers: &mut Buffers,
        out: &mut Rows<'_>,
        at: usize,
    ) {
        let Buffers { row, poses } = buffers;
        row.clear();
        let known = |worlds: u32| worlds >> lane & 1 != 0;
        match Table::<L>::ENTRIES[self.entry].read {
            Read::State(fields) => {
                fields.iter().for_each(|field| view.block.read(*field, &view.tables.sizes, lane, row));
            }
            Read::Status => row.push(f64::from(view.block.status.lane(lane).0)),
            Read::Stage(stage, write) if known(if stage == Stage::Solver { view.solved } else { view.valid }) => {
                write(World { view, lane, point: self.point }, poses, row);
            }
            Read::Stage(..) => self.leave_out(view.model, row),
        }
        out.write(at, row);
    }

    /// What stands for numbers that a world does not have, as it is frozen, or its state from outside cannot be stepped: NaN, the
    /// count 0, empty lists.
    fn leave_out(&self, model: &Model, out: &mut Vec<f64>) {
        let nothing = if self.is_integer() { 0.0 } else { f64::NAN };
        out.resize(out.len() + self.width(model).unwrap_or(0), nothing);
    }
}

impl Model {
    /// The output called `name`: one of [`Output::all`], where `jac_body:NAME`, `jac_geom:NAME` and `jac_site:NAME` stand for one output for
    /// every element, by its name or its number.
    ///
    /// # Errors
    ///
    /// If there is no such output or element; the message names the nearest.
    pub fn output(&self, name: &str) -> Result<Output, Error> {
        Output::of_model(self, name)
    }
}
