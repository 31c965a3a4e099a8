//! The parts of a step: what runs between two *joints*, the places where a driver asks whether any world needs something.
//!
//! A part is declared once, in [`parts!`](self) below: its name, the stage that it belongs to, the masks that it takes and
//! returns, the fields that it leaves for others, and the kernel that it is. Drivers say "run this part" to an [`Executor`];
//! what runs it then, the kernel over lanes or code that was made from the same kernel, is not theirs to know. What a part
//! reads is not declared: whoever records it sees it.

mod executor;
mod item;
mod step;

pub use executor::{Executor, Factor, Kernels, OneByOne, Parts};
pub use item::{COLUMNS, Item, KIND_COLUMNS, Starts, WINDOWS, Window, stride};
pub use step::{Group, Lanes, Name, Step, Threes};

use crate::collision::Collision;
use crate::constraint::ContactRow;
use crate::integration::Rk4;
use crate::lane::{Lane, LaneQuery};
use crate::model::{Model, Quantities, Quantity};
use crate::options::Integrator;
use crate::solver::{Arrival, Problem, Solver, SolverWork, Tile, Trial, Whitened, Work, contact, noslip, pgs};
use crate::stage::{Stage, Start};
use crate::workspace::Workspace;
use crate::{actuation, collision, constraint, energy, integration, kick, sensor, smooth, solver};

/// A part, and which of its kind: options as bits, or the number of a class of pairs or kind of contacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Part {
    /// What it does.
    pub op: Op,
    /// For which class, or with which options.
    pub of: u32,
}

/// What tells the parts of an [`Op`] apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// Nothing: there are so many, by options.
    Options(u32),
    /// Groups of pairs whose bounding tests are run together.
    Group,
    /// Pairs by their shapes, and what moves ([`collision::Classes`]).
    Shapes,
    /// Contacts by the law of their numbers ([`constraint::Classes`]).
    Law,
    /// Contacts by the dofs of the links that they join, and the law of their numbers.
    Links,
    /// Contacts by the links that they join.
    Couple,
    /// Kinds of contacts ([`constraint::Classes`]).
    Kind,
    /// The same, by their whitened rows.
    Whitened,
    /// Tiles of the Hessian, by the lengths of so many strips.
    Tiles(Work),
    /// Tiles to which contacts add, by their shapes.
    Patches,
}

macro_rules! parts {
    ($($(#[$doc:meta])* $op:ident: $name:literal, $stage:ident, $family:expr, $given:literal => $returned:literal,
        shared $shared:expr, changes $changes:expr,
        |$part:pat_param, $step:ident, $item:pat_param, $masks:pat_param| $kernel:expr;)*) => {
        /// What a part does.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Op {
            $($(#[$doc])* $op,)*
        }

        impl Op {
            /// All.
            pub const ALL: &[Op] = &[$(Op::$op),*];

            /// Name.
            pub fn name(self) -> &'static str {
                match self { $(Op::$op => $name,)* }
            }

            /// The stage whose time it takes.
            pub fn stage(self) -> Stage {
                match self { $(Op::$op => Stage::$stage,)* }
            }

            /// What tells its parts apart.
            pub fn family(self) -> Family {
                match self { $(Op::$op => $family,)* }
            }

            /// Number of masks that it takes and returns; of [`Family::Group`] it returns one for each pair.
            pub fn masks(self) -> [usize; 2] {
                match self { $(Op::$op => [$given, $returned],)* }
            }

            /// Numbers that code for many elements shall read from arrays.
            pub fn shared(self) -> Quantities {
                match self { $(Op::$op => Quantities::of(&$shared),)* }
            }

            /// Fields that it leaves for others: names, or all of a stage. All else that it writes is scratch.
            pub fn changes(self) -> &'static [&'static str] {
                match self { $(Op::$op => &$changes,)* }
            }
        }

        impl Part {
            /// Runs the kernel.
            #[allow(unused_variables)]
            pub fn run<L: Lane>(
                self,
                item: &Item<'_>,
                given: L::Mask,
                returned: &mut dyn FnMut(L::Mask),
                step: &mut Step<'_, L>,
            ) {
                match self.op {
                    $(Op::$op => {
                        let ($part, $step, $item, $masks) = (self, step, item, (given, returned));
                        $kernel
                    })*
                }
            }
        }
    };
}

const WHOLE: Family = Family::Options(1);
/// Of [`Op::Smooth`], the first with a kick.
pub const KICKED: u32 = 12;
const FLAG: Family = Family::Options(2);

parts! {
    /// [`smooth::smooth`]: with forces from outside (1), and for whoever reads what the stages leave (2); from positions, from velocities
    /// (4), or from activations and controls on (8); of a step that is kicked (12; see [`crate::kick`]).
    Smooth: "smooth", Acceleration, Family::Options(24), 0 => 5, shared [], changes [],
        |part, step, _, (_, put)| {
            let Step { model, state, applied, ws, stages, clock } = step;
            let start = part.start();
            let runs = |stage: Stage| start.runs(stage, model.model) && stages.run(stage, model.model);
            let mut end = |stage| clock.iter_mut().for_each(|clock| clock.end(stage));
            let found = smooth::smooth(*model, state, *applied, &runs, ws.smooth(part.of >= KICKED), &mut end);
            <[_; 5]>::from(found).into_iter().for_each(put);
        };
    /// [`energy::energy`].
    Energy: "energy", Energy, WHOLE, 0 => 0, shared [], changes ["energy"],
        |_, step, _, _| {
            let Workspace { position, tendons, inertia, energy, .. } = &mut *step.ws;
            let stages = energy::Stages { position, tendons, inertia };
            energy::energy(step.model, stages, step.state, energy);
        };
    /// [`sensor::measure`].
    Sensor: "sensor", Sensor, WHOLE, 0 => 0, shared [], changes ["sensor"],
        |_, step, _, _| {
            let (stages, energy, sensors) = step.ws.sensing();
            sensor::measure(step.model, step.state, stages, energy, sensors);
        };
    /// [`collision::near_pairs`] of a group: where each of its pairs is near, and the gaps.
    Near: "near", Collision, Family::Group, 0 => 0, shared [], changes ["collision.gaps"],
        |part, step, _, (_, put)| {
            let collision = &mut step.ws.collision;
            let group = &collision.groups[part.of as usize];
            collision::near_pairs(&step.model, &step.ws.position, group, put, &mut collision.colliders.gaps);
        };
    /// [`collision::narrow`]: contacts of a pair; of two capsules, those that are not parallel.
    Narrow: "narrow", Collision, Family::Shapes, 1 => 0, shared [Quantity::Geom, Quantity::Include],
        changes ["collision.found", "collision.parallel"],
        |_, step, item, (worlds, _)| {
            let Item::Near(near) = item else { return };
            let Collision { found, parallel, .. } = &mut step.ws.collision;
            let found = &mut found[near.first as usize..][..near.points as usize];
            let alongside = collision::narrow(step.model, near.pair, worlds, &step.ws.position, found);
            parallel[near.first as usize] = L::select(alongside, L::one(), L::zero());
        };
    /// [`collision::narrow_parallel`]: contacts of two capsules that may be parallel.
    Parallel: "parallel", Collision, Family::Shapes, 1 => 0, shared [Quantity::Geom, Quantity::Include],
        changes ["collision.found"],
        |_, step, item, (worlds, _)| {
            let Item::Near(near) = item else { return };
            let found = &mut step.ws.collision.found[near.first as usize..][..near.points as usize];
            collision::narrow_parallel(step.model, near.pair, worlds, &step.ws.position, found);
        };
    /// [`constraint::equality_rows`]: where some are active, and where some are that join branches.
    Equality: "equality", Constraint, WHOLE, 1 => 2, shared [],
        changes ["equality.jacobian", "equality.pos", "equality.d", "equality.reference", "equality.swamping"],
        |_, step, _, (alive, put)| {
            let Step { model, state, ws, .. } = step;
            let Workspace { position, tendons, velocity, constraint, .. } = &mut **ws;
            let motion = constraint::Motion { position, velocity, tendons, qvel: &state.qvel };
            let read = ((&**state).into(), &state.eq_active[..]);
            let masks = constraint::equality_rows(*model, motion, read, alive, &mut constraint.equality);
            masks.into_iter().for_each(put);
        };
    /// [`constraint::dof_lanes`]: rows on joints and tendons; where some act, and where some do that join branches.
    Joints: "joints", Constraint, WHOLE, 1 => 2, shared [], changes ["constraint.dof_lanes"],
        |_, step, _, (alive, put)| {
            let Step { model, state, ws, .. } = step;
            let measured = constraint::Measured { qpos: &state.qpos, qvel: &state.qvel, tendons: &ws.tendons };
            let masks = constraint::dof_lanes(*model, measured, alive, &mut ws.constraint);
            masks.into_iter().for_each(put);
        };
    /// [`constraint::measure`]: numbers of the rows of a contact one side of which stands still.
    Measure: "rows", Constraint, Family::Law, 0 => 0, shared [Quantity::Law],
        changes ["constraint.strengths", "constraint.motion", "constraint.reference"],
        |_, step, item, _| measure(step, item);
    /// The same, and the Jacobian, of a contact both sides of which move.
    MeasureBoth: "rows of both", Constraint, Family::Links, 0 => 0, shared [Quantity::Law],
        changes ["constraint.strengths", "constraint.motion", "constraint.reference", "constraint.jacobian"],
        |_, step, item, _| measure(step, item);
    /// [`solver::depart`].
    Depart: "solver.depart", Solver, WHOLE, 0 => 0, shared [],
        changes ["solver.search", "solver.msearch", "solver.twist", "solver.cold_twist", "solver.line", "solver.jp.dof",
            "solver.y.dof", "solver.jp.equality", "solver.y.equality"],
        |_, step, _, _| {
            let (problem, warmstart, work) = step.solver();
            solver::depart(&problem, warmstart, work);
        };
    /// [`solver::choose`]: where the warm start is taken.
    Choose: "solver.choose", Solver, WHOLE, 0 => 1, shared [],
        changes ["solver.qacc", "solver.ma", "solver.y.dof", "solver.y.equality", "solver.line", "solver.search",
            "solver.msearch"],
        |_, step, _, (_, put)| {
            let (problem, _, work) = step.solver();
            put(solver::choose(&problem, work));
        };
    /// [`solver::conjugate`], the first direction (1) or a later one.
    Conjugate: "solver.conjugate", Solver, FLAG, 0 => 0, shared [],
        changes ["solver.search", "solver.msearch", "solver.twist", "solver.line", "solver.jp.dof", "solver.jp.equality",
            "solver.last_gradient", "solver.last_scaled"],
        |part, step, _, _| {
            let (problem, _, work) = step.solver();
            solver::conjugate(&problem, part.of == 1, work);
        };
    /// [`solver::curve`], then [`solver::descend`]: where no contact is coupled.
    Turn: "solver.turn", Solver, WHOLE, 0 => 0, shared [],
        changes ["solver.search", "solver.msearch", "solver.twist", "solver.line", "solver.jp.dof", "solver.jp.equality",
            "solver.hessian", "solver.inverse", "solver.stiffness"],
        |_, step, _, _| {
            let (problem, _, work) = step.solver();
            solver::curve(&problem, work);
            solver::descend(&problem, false, work);
        };
    /// [`solver::curve`].
    Curve: "solver.curve", Solver, WHOLE, 0 => 0, shared [], changes ["solver.hessian", "solver.stiffness"],
        |_, step, _, _| {
            let (problem, _, work) = step.solver();
            solver::curve(&problem, work);
        };
    /// [`solver::descend`], on the inertia matrix's pattern or on a filled one (1).
    Descend: "solver.descend", Solver, FLAG, 0 => 0, shared [],
        changes ["solver.search", "solver.msearch", "solver.twist", "solver.line", "solver.jp.dof", "solver.jp.equality",
            "solver.hessian", "solver.inverse"],
        |part, step, _, _| {
            let (problem, _, work) = step.solver();
            solver::descend(&problem, part.of == 1, work);
        };
    /// [`solver::polish`], likewise.
    Polish: "solver.polish", Solver, FLAG, 1 => 0, shared [],
        changes ["solver.qacc", "solver.ma", "solver.qfrc_constraint"],
        |part, step, _, (open, _)| {
            let (problem, _, work) = step.solver();
            solver::polish(&problem, part.of == 1, open, work);
        };
    /// [`solver::curve`], then [`solver::spread`]: where trees touch.
    Spread: "solver.spread", Solver, WHOLE, 0 => 0, shared [], changes ["solver.tiles", "solver.stiffness"],
        |_, step, _, _| {
            let (problem, _, work) = step.solver();
            solver::curve(&problem, work);
            solver::spread(&problem, work);
        };
    /// [`solver::aim`].
    Aim: "solver.aim", Solver, WHOLE, 0 => 0, shared [], changes ["solver.multipliers", "solver.search"],
        |_, step, _, _| {
            let (problem, _, work) = step.solver();
            solver::aim(&problem, &mut work.fields);
        };
    /// [`solver::motion`].
    Motion: "solver.motion", Solver, WHOLE, 0 => 0, shared [],
        changes ["solver.msearch", "solver.twist", "solver.line", "solver.jp.dof", "solver.jp.equality"],
        |_, step, _, _| {
            let (problem, _, work) = step.solver();
            solver::motion(&problem, work);
        };
    /// [`solver::settle`].
    Settle: "solver.settle", Solver, WHOLE, 1 => 0, shared [],
        changes ["solver.qacc", "solver.ma", "solver.qfrc_constraint"],
        |_, step, _, (open, _)| {
            let (problem, _, work) = step.solver();
            solver::settle(&problem, open, &mut work.fields);
        };
    /// [`solver::clear`].
    Clear: "tile.clear", Solver, Family::Tiles(Work::Clear), 0 => 0, shared [], changes ["solver.tiles"],
        |_, step, item, _| tile(step, item, solver::clear);
    /// [`solver::couple_tile`].
    Join: "tile.couple", Solver, Family::Patches, 0 => 0, shared [], changes ["solver.tiles"],
        |_, step, item, _| {
            if let Item::Patch(row, patch) = item {
                let (problem, _, work) = step.solver();
                solver::couple_tile(&problem, row, patch, work);
            }
        };
    /// [`solver::pivot`].
    Pivot: "tile.pivot", Solver, Family::Tiles(Work::Pivot), 0 => 0, shared [],
        changes ["solver.tiles", "solver.inverse"],
        |_, step, item, _| tile(step, item, solver::pivot);
    /// [`solver::panel`].
    Panel: "tile.panel", Solver, Family::Tiles(Work::Panel), 0 => 0, shared [],
        changes ["solver.tiles", "solver.panel"],
        |_, step, item, _| tile(step, item, solver::panel);
    /// [`solver::eliminate`] on the diagonal.
    Square: "tile.square", Solver, Family::Tiles(Work::Square), 0 => 0, shared [], changes ["solver.tiles"],
        |_, step, item, _| tile(step, item, |tile, solver| solver::eliminate(tile, true, solver));
    /// [`solver::eliminate`].
    Eliminate: "tile.eliminate", Solver, Family::Tiles(Work::Eliminate), 0 => 0, shared [], changes ["solver.tiles"],
        |_, step, item, _| tile(step, item, |tile, solver| solver::eliminate(tile, false, solver));
    /// [`solver::forward`].
    Forward: "tile.forward", Solver, Family::Tiles(Work::Forward), 0 => 0, shared [],
        changes ["solver.search", "solver.multipliers"],
        |_, step, item, _| tile(step, item, solver::forward);
    /// [`solver::forward_tile`].
    ForwardTile: "tile.forward by", Solver, Family::Tiles(Work::ForwardTile), 0 => 0, shared [],
        changes ["solver.search"],
        |_, step, item, _| tile(step, item, solver::forward_tile);
    /// [`solver::backward_tile`].
    BackwardTile: "tile.backward by", Solver, Family::Tiles(Work::BackwardTile), 0 => 0, shared [],
        changes ["solver.multipliers"],
        |_, step, item, _| tile(step, item, solver::backward_tile);
    /// [`solver::backward`].
    Backward: "tile.backward", Solver, Family::Tiles(Work::Backward), 0 => 0, shared [], changes ["solver.search"],
        |_, step, item, _| tile(step, item, solver::backward);
    /// [`solver::probe`], of a full step (1) or of another: lanes that search on, and those whose end a full step is.
    Probe: "solver.probe", Solver, FLAG, 1 => 2, shared [], changes ["solver.line"],
        |part, step, _, (open, put)| {
            let (problem, _, work) = step.solver();
            let Trial { open, full } = solver::probe(&problem, part.of == 1, open, work);
            [open, full].into_iter().for_each(put);
        };
    /// [`solver::gather`]: lanes that have converged, and those that stand still.
    Gather: "solver.gather", Solver, WHOLE, 1 => 2, shared [],
        changes ["solver.qfrc_constraint", "solver.gradient", "solver.qacc", "solver.ma", "solver.y.dof",
            "solver.force.dof", "solver.y.equality", "solver.force.equality", "solver.wrench", "solver.pull"],
        |_, step, _, (open, put)| {
            let (problem, _, work) = step.solver();
            let Arrival { converged, still } = solver::gather(&problem, open, work);
            [converged, still].into_iter().for_each(put);
        };
    /// [`contact::survey_row`].
    Survey: "contact.survey", Solver, Family::Kind, 0 => 0, shared [],
        changes ["solver.jp.component", "solver.y.component", "solver.line"],
        |_, step, item, _| row(step, item, |problem, row, work| contact::survey_row(problem, row, work));
    /// [`contact::choose_row`].
    Take: "contact.choose", Solver, Family::Kind, 1 => 0, shared [], changes ["solver.y.component"],
        |_, step, item, (warm, _)| row(step, item, |_, row, work| contact::choose_row(warm, row, work));
    /// [`contact::approach_row`].
    Approach: "contact.approach", Solver, Family::Kind, 0 => 0, shared [], changes ["solver.jp.component", "solver.line"],
        |_, step, item, _| row(step, item, |problem, row, work| contact::approach_row(problem, row, work));
    /// [`contact::slope_row`].
    Slope: "contact.slope", Solver, Family::Kind, 0 => 0, shared [], changes ["solver.line"],
        |_, step, item, _| row(step, item, |problem, row, work| contact::slope_row(problem, row, work));
    /// [`contact::act_row`].
    Act: "contact.act", Solver, Family::Kind, 1 => 0, shared [],
        changes ["solver.y.component", "solver.force.component", "solver.wrench", "solver.pull"],
        |_, step, item, (open, _)| row(step, item, |problem, row, work| contact::act_row(problem, open, row, work));
    /// [`contact::stiffen_row`], of a contact one side of which stands still.
    Stiffen: "contact.stiffen", Solver, Family::Kind, 0 => 0, shared [], changes ["solver.stiffness"],
        |_, step, item, _| row(step, item, |problem, row, work| contact::stiffen_row(problem, row, work));
    /// [`solver::couple_row`], of a contact both sides of which move.
    Couple: "contact.couple", Solver, Family::Couple, 0 => 0, shared [], changes ["solver.hessian"],
        |_, step, item, _| row(step, item, |problem, row, work| solver::couple_row(problem, row, work));
    /// Begins a sweep: [`pgs::sweep_rows`] (0), [`noslip::sweep_rows`] (1), or neither (2).
    Sweep: "sweep", Solver, Family::Options(3), 1 => 0, shared [],
        changes ["solver.gain", "solver.z", "solver.force.dof", "solver.force.equality"],
        |part, step, _, (open, _)| {
            let (problem, _, work) = step.solver();
            match part.of {
                0 => pgs::sweep_rows(&problem, open, work),
                1 => noslip::sweep_rows(&problem, open, work),
                _ => work.dual.gain[0] = L::zero(),
            }
        };
    /// [`pgs::sweep_contact`].
    Push: "contact.push", Solver, Family::Whitened, 1 => 0, shared [],
        changes ["solver.gain", "solver.z", "solver.force.component", "solver.edge_force"],
        |_, step, item, (open, _)| whitened(step, item, open, pgs::sweep_contact);
    /// [`noslip::sweep_contact`].
    Hold: "contact.hold", Solver, Family::Whitened, 1 => 0, shared [],
        changes ["solver.gain", "solver.z", "solver.force.component", "solver.edge_force"],
        |_, step, item, (open, _)| whitened(step, item, open, noslip::sweep_contact);
    /// The step of an integrator that evaluates once, and [`integration::commit`]: worlds that take the next state.
    Integrate: "integration", Integration, WHOLE, 1 => 1, shared [Quantity::Zero],
        changes ["state.qpos", "state.qvel", "state.act", "state.qacc_warmstart", "state.time", "state.low", "state.tree_guard",
            "integration.qpos",
            "integration.low", "integration.qvel", "integration.act", "integration.qacc"],
        |_, step, _, (alive, put)| {
            let Step { model, state, ws, .. } = step;
            let Workspace {
                position, inertia, actuation, acceleration, derivative, solver, integration: next, middle, kick, ..
            } = &mut **ws;
            let solver::Solver { qacc, qfrc_constraint, .. } = &solver.fields;
            let forces = [&acceleration.qfrc_smooth[..], qfrc_constraint];
            if matches!(model.options.integrator, Integrator::Implicit | Integrator::ImplicitFast) {
                integration::implicit(model, state, forces, derivative, next);
            } else if let Some(middle) = middle {
                integration::staggered(model, middle.positions(), &state.qvel, qacc, next);
            } else {
                integration::euler(*model, (position, inertia), state.positions(), &state.qvel, qacc, forces, next);
            }
            actuation::activations(model, &state.act, (&actuation.act_dot, &actuation.bent), &mut next.act);
            let good = integration::commit(*model, next, [qacc, &acceleration.qacc_smooth], alive, state);
            if let Some(kick) = kick.as_deref_mut().filter(|_| model.sizes.nguard > 0) {
                kick::book(*model, (position, inertia), &next.qvel, kick);
                kick::keep(*model, &kick.guard, good, state);
            }
            put(good);
        };
    /// What an evaluation of a Runge-Kutta step has found: [`Rk4::take`](integration::Rk4::take), after the last one
    /// [`integration::replace`]: worlds that go on.
    Combine: "rk4", Integration, Family::Options(4), 1 => 1, shared [Quantity::Zero],
        changes ["between.time", "between.qpos", "between.low", "between.qvel", "between.act", "between.qacc_warmstart", "rates.rate", "rates.rates",
            "rates.qaccs", "rates.act_dots", "rates.bristles", "integration.qpos", "integration.low", "integration.qvel",
            "integration.act", "integration.qacc", "state.qpos", "state.qvel", "state.act", "state.qacc_warmstart", "state.time",
            "state.low"],
        |part, step, _, (good, put)| {
            let Step { model, state, ws, .. } = step;
            let Workspace { actuation, acceleration, solver, integration: next, rk4, .. } = &mut **ws;
            let Some(rk4) = rk4 else { return };
            let accelerations = [&solver.fields.qacc[..], &acceleration.qacc_smooth];
            let (number, rates) = (part.of as usize, [&actuation.act_dot[..], &actuation.bent]);
            let good = rk4.take(model, number, (accelerations, rates), state, good, next);
            if number + 1 == Rk4::<L>::PARTS {
                // An acceleration on the way counts by the states to which it leads.
                integration::replace(*model, next, accelerations, good, state);
            }
            put(good);
        };
}

/// Runs a kernel for a contact.
#[inline(always)]
fn row<L: Lane>(
    step: &mut Step<'_, L>,
    item: &Item<'_>,
    kernel: impl FnOnce(&Problem<'_, L>, &ContactRow, &mut SolverWork<L>),
) {
    if let Item::Row(row) = item {
        let (problem, _, work) = step.solver();
        kernel(&problem, row, work);
    }
}

/// Runs a kernel for the whitened rows of a contact.
#[inline(always)]
fn whitened<L: Lane>(
    step: &mut Step<'_, L>,
    item: &Item<'_>,
    open: L::Mask,
    kernel: impl FnOnce(&Problem<'_, L>, (&ContactRow, &Whitened), L::Mask, &mut SolverWork<L>),
) {
    if let Item::Whitened(row, place) = item {
        let (problem, _, work) = step.solver();
        kernel(&problem, (row, place), open, work);
    }
}

/// Runs a kernel for a tile.
#[inline(always)]
fn tile<L: Lane>(step: &mut Step<'_, L>, item: &Item<'_>, kernel: impl FnOnce(&Tile, &mut Solver<L>)) {
    if let Item::Tile(tile) = item {
        kernel(tile, &mut step.ws.solver.fields);
    }
}

impl From<Work> for Op {
    fn from(work: Work) -> Op {
        match work {
            Work::Clear => Op::Clear,
            Work::Couple => Op::Join,
            Work::Pivot => Op::Pivot,
            Work::Panel => Op::Panel,
            Work::Square => Op::Square,
            Work::Eliminate => Op::Eliminate,
            Work::Forward => Op::Forward,
            Work::ForwardTile => Op::ForwardTile,
            Work::BackwardTile => Op::BackwardTile,
            Work::Backward => Op::Backward,
        }
    }
}

/// Numbers of a contact's rows.
#[inline(always)]
fn measure<L: Lane>(step: &mut Step<'_, L>, item: &Item) {
    if let Item::Row(row) = item {
        let Workspace { position, tendons, velocity, collision, constraint, .. } = &mut *step.ws;
        let motion = constraint::Motion { position, velocity, tendons, qvel: &step.state.qvel };
        let contact = collision::Contact(&collision.found[row.place as usize]);
        constraint::measure(step.model, motion, contact, row, constraint);
    }
}

impl Part {
    /// A part without options.
    pub const fn new(op: Op) -> Part {
        Part { op, of: 0 }
    }

    /// That part of a class, or with options.
    pub const fn of(op: Op, of: u32) -> Part {
        Part { op, of }
    }

    /// Where [`Op::Smooth`] starts.
    fn start(self) -> Start {
        Start::ALL[(self.of % KICKED) as usize >> 2]
    }

    /// Runs the kernel over lanes that can be asked: masks as bits.
    pub fn run_lanes<L: LaneQuery>(self, item: &Item<'_>, given: u32, returned: &mut [u32], step: &mut Step<'_, L>) {
        let mut places = returned.iter_mut();
        let mut put = |mask: L::Mask| places.next().into_iter().for_each(|place| *place = L::bits(mask));
        self.run(item, L::mask_of(given & item.worlds()), &mut put, step);
    }

    /// Fields that it leaves for others: names, or all of a stage.
    pub fn changes<T>(self, model: &Model<T>) -> Vec<&'static str> {
        match self.op {
            Op::Smooth => smooth::changes(model, self.of & 2 != 0, self.start()),
            Op::Combine if self.of as usize + 1 < Rk4::<f64>::PARTS => {
                self.op.changes().iter().copied().filter(|name| !name.starts_with("state.")).collect()
            }
            op => op.changes().to_vec(),
        }
    }
}
