//! What parts work on, and its fields by name.

use crate::collision::{Colliders, Collision};
use crate::constraint::{Constraint, ContactRow, Kind};
use crate::fields::FieldView;
use crate::lane::Lane;
use crate::model::{Instance, Quantity};
use crate::solver::{Dual, Problem, SolverWork};
use crate::stage::{Stage, StageClock, Stages};
use crate::state::{Applied, State};
use crate::workspace::Workspace;
use crate::{acceleration, actuation, energy, inertia, integration, passive, position, solver, velocity};

/// A step of a block: the model as its worlds have it, what comes from outside, and the workspace.
pub struct Step<'a, L: Lane> {
    /// Model.
    pub model: Instance<'a, L>,
    /// State.
    pub state: &'a mut State<L>,
    /// Forces from outside, if there are any.
    pub applied: Option<&'a Applied<L>>,
    /// What the stages write.
    pub ws: &'a mut Workspace<L>,
    /// The stages that are wanted.
    pub stages: Stages,
    /// Clock, if stages are to be timed.
    pub clock: Option<&'a mut StageClock>,
}

/// Lanes of a field: those of the block's own memory may be changed.
#[derive(Debug)]
pub enum Lanes<'a, L> {
    /// To be read.
    Read(&'a [L]),
    /// To be read and written.
    Write(&'a mut [L]),
}

/// A set of fields, by number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FieldSet([u64; 2]);

impl FieldSet {
    /// All.
    pub const ALL: FieldSet = FieldSet([u64::MAX; 2]);

    /// Adds a field.
    pub fn add(&mut self, number: usize) {
        self.0[number / 64] |= 1 << (number % 64);
    }

    /// Those of either.
    #[must_use]
    pub fn or(self, other: FieldSet) -> FieldSet {
        FieldSet([self.0[0] | other.0[0], self.0[1] | other.0[1]])
    }

    /// Whether all of another set are among them.
    pub fn includes(self, other: FieldSet) -> bool {
        self.or(other) == self
    }

    /// Whether a field is among them.
    #[inline(always)]
    pub fn has(self, number: usize) -> bool {
        self.0[number / 64] >> (number % 64) & 1 != 0
    }

    /// The place of a field among them, in the order of numbers.
    pub fn place(self, number: usize) -> Option<usize> {
        self.has(number).then(|| (0..number).filter(|before| self.has(*before)).count())
    }

    /// Whether any of `count` fields from `first` on is.
    #[inline(always)]
    fn any(self, first: usize, count: usize) -> bool {
        let all = u128::from(self.0[0]) | u128::from(self.0[1]) << 64;
        all >> first & ((1 << count) - 1) != 0
    }
}

/// Stage and name of a field.
pub type Name = [&'static str; 2];

impl<L: Lane> Step<'_, L> {
    /// Number of the first field of what varies, in the order of [`Quantity::ALL`].
    pub const VARIED: usize = State::<L>::COUNT + Applied::<L>::COUNT;

    /// Whether a stage is wanted, and the model has it.
    #[inline(always)]
    pub fn runs(&self, stage: Stage) -> bool {
        self.stages.has(stage) && stage.present(self.model.model)
    }

    /// Ends a stage's span of time.
    #[inline(always)]
    pub fn end(&mut self, stage: Stage) {
        if let Some(clock) = &mut self.clock {
            clock.end(stage);
        }
    }

    /// What the solver solves, where it starts, and what it works with.
    #[inline(always)]
    pub fn solver(&mut self) -> (Problem<'_, L>, &[L], &mut SolverWork<L>) {
        let Workspace { position, inertia, acceleration, constraint, solver, .. } = &mut *self.ws;
        let (model, mean_inertia) = (self.model.model, self.model.mean_inertia());
        let problem = Problem { model, mean_inertia, position, inertia, acceleration, constraint };
        (problem, &self.state.qacc_warmstart, solver)
    }

    /// Lends all fields.
    pub fn lend_all<'b>(&'b mut self, f: &mut impl FnMut(usize, Name, Lanes<'b, L>)) {
        self.lend(FieldSet::ALL, f);
    }

    /// Lends the fields of a set, in the order of their numbers. Returns the list of contacts.
    #[inline(always)]
    pub fn lend<'b>(
        &'b mut self,
        set: FieldSet,
        f: &mut impl FnMut(usize, Name, Lanes<'b, L>),
    ) -> (&'b [ContactRow], &'b [Kind]) {
        let Step { model, state, applied, ws, .. } = self;
        let Workspace { position, inertia, velocity, passive, actuation, acceleration, energy, integration, .. } = ws;
        let Workspace { collision, constraint, solver, .. } = ws;
        let mut lender = Lender { set, stage: "", number: 0, f };
        if lender.stage("state", State::<L>::COUNT) {
            state.for_each(&mut |field| lender.field(field));
        }
        if lender.stage("applied", Applied::<L>::COUNT) {
            let [qfrc, xfrc]: [&'b [L]; 2] = match applied {
                Some(applied) => [&applied.qfrc_applied, applied.xfrc_applied.as_flattened()],
                None => [&[]; 2],
            };
            lender.put("qfrc_applied", Lanes::Read(qfrc));
            lender.put("xfrc_applied", Lanes::Read(xfrc));
        }
        if lender.stage("varied", Quantity::ALL.len()) {
            for quantity in Quantity::ALL {
                lender.put(quantity.name(), Lanes::Read(model.varied.map_or(&[], |varied| varied.lanes(quantity))));
            }
        }
        macro_rules! stages {
            ($($stage:ident: $type:ident),*) => {
                $(if lender.stage(stringify!($stage), $stage::$type::<L>::COUNT) {
                    $stage.for_each(&mut |field| lender.field(field));
                })*
            };
        }
        stages!(position: Position, inertia: Inertia, velocity: Velocity, passive: Passive, actuation: Actuation);
        stages!(acceleration: Acceleration, energy: Energy, integration: Integration);
        let Collision { colliders, found, parallel, .. } = collision;
        if lender.stage("collision", Colliders::<L>::COUNT + 2) {
            colliders.for_each(&mut |field| lender.field(field));
            lender.put("found", Lanes::Write(found.as_flattened_mut()));
            lender.put("parallel", Lanes::Write(parallel));
        }
        let Constraint { dof_lanes, strengths, reference, motion, jacobian, contact_rows, kinds, .. } = constraint;
        if lender.stage("constraint", 5) {
            lender.put("dof_lanes", Lanes::Write(dof_lanes.as_flattened_mut()));
            lender.put("strengths", Lanes::Write(strengths.as_flattened_mut()));
            lender.put("reference", Lanes::Write(reference));
            lender.put("motion", Lanes::Write(motion.as_flattened_mut()));
            lender.put("jacobian", Lanes::Write(jacobian));
        }
        let SolverWork { fields, y, jp, force, line, edge_force, dual, .. } = solver;
        if lender.stage("solver", solver::Solver::<L>::COUNT + 7) {
            fields.for_each(&mut |field| lender.field(field));
            lender.put("line", Lanes::Write(&mut line.0));
            lender.put("y.dof", Lanes::Write(&mut y.dof));
            lender.put("y.component", Lanes::Write(&mut y.component));
            lender.put("jp.dof", Lanes::Write(&mut jp.dof));
            lender.put("jp.component", Lanes::Write(&mut jp.component));
            lender.put("force.dof", Lanes::Write(&mut force.dof));
            lender.put("force.component", Lanes::Write(&mut force.component));
        }
        let Dual { b, z, root, bias, .. } = dual;
        if lender.stage("dual", 6) {
            lender.put("b", Lanes::Write(b));
            lender.put("z", Lanes::Write(z));
            lender.put("root", Lanes::Write(root));
            lender.put("bias.dof", Lanes::Write(&mut bias.dof));
            lender.put("bias.component", Lanes::Write(&mut bias.component));
            lender.put("edge_force", Lanes::Write(edge_force));
        }
        (contact_rows, kinds)
    }
}

/// Goes through the fields in order, and hands on those of a set.
struct Lender<'f, F> {
    set: FieldSet,
    stage: &'static str,
    number: usize,
    f: &'f mut F,
}

impl<F> Lender<'_, F> {
    /// Begins a stage with so many fields; whether any of them is wanted.
    #[inline(always)]
    fn stage(&mut self, stage: &'static str, count: usize) -> bool {
        let wanted = self.set.any(self.number, count);
        self.stage = stage;
        if !wanted {
            self.number += count;
        }
        wanted
    }

    #[inline(always)]
    fn put<'b, L: 'b>(&mut self, name: &'static str, lanes: Lanes<'b, L>)
    where
        F: FnMut(usize, Name, Lanes<'b, L>),
    {
        if self.set.has(self.number) {
            (self.f)(self.number, [self.stage, name], lanes);
        }
        self.number += 1;
    }

    #[inline(always)]
    fn field<'b, L: 'b>(&mut self, field: FieldView<'b, L>)
    where
        F: FnMut(usize, Name, Lanes<'b, L>),
    {
        self.put(field.name, Lanes::Write(field.data));
    }
}
