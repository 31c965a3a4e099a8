//! What parts work on, and its fields by name.

use crate::collision::{Colliders, Collision};
use crate::constraint::{Constraint, ContactRow};
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

/// Stage and name of a field.
pub type Name = [&'static str; 2];

impl<L: Lane> Step<'_, L> {
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

    /// Lends all fields, one by one, in the order of their numbers.
    pub fn lend_all<'b>(&'b mut self, f: &mut impl FnMut(usize, Name, Lanes<'b, L>)) {
        self.lend(Groups::ALL, &mut Single(f));
    }

    /// Lends the fields of some groups. Returns the list of contacts.
    #[inline(always)]
    pub fn lend<'b>(&'b mut self, groups: Groups, to: &mut impl Borrower<'b, L>) -> &'b [ContactRow] {
        let Step { model, state, applied, ws, .. } = self;
        let Workspace { position, inertia, velocity, passive, actuation, acceleration, energy, integration, .. } = ws;
        let Workspace { collision, constraint, solver, .. } = ws;
        let Collision { colliders, found, parallel, .. } = collision;
        let Constraint { dof_lanes, strengths, reference, motion, jacobian, contact_rows, .. } = constraint;
        let SolverWork { fields, y, jp, force, line, edge_force, dual, .. } = solver;
        let Dual { b, z, root, bias, .. } = dual;
        let varied = |quantity: Quantity| Lanes::Read(model.varied.map_or(&[], |varied| varied.lanes(quantity)));
        macro_rules! group {
            ($group:ident, $($name:literal: $lanes:expr),* $(,)?) => {
                if groups.has(Group::$group) {
                    to.take(Group::$group, [$($name),*], [$(Lanes::Write($lanes)),*]);
                }
            };
            ($($group:ident: $stage:expr;)*) => {
                $(if groups.has(Group::$group) {
                    let fields = $stage.all();
                    let names = std::array::from_fn(|i| fields[i].name);
                    to.take(Group::$group, names, fields.map(|field| Lanes::Write(field.data)));
                })*
            };
        }
        group!(State: state;);
        if groups.has(Group::Applied) {
            let [qfrc, xfrc]: [&'b [L]; 2] = match applied {
                Some(applied) => [&applied.qfrc_applied, applied.xfrc_applied.as_flattened()],
                None => [&[]; 2],
            };
            to.take(Group::Applied, ["qfrc_applied", "xfrc_applied"], [Lanes::Read(qfrc), Lanes::Read(xfrc)]);
        }
        if groups.has(Group::Varied) {
            to.take(Group::Varied, Quantity::VARYING.map(Quantity::name), Quantity::VARYING.map(varied));
        }
        if groups.has(Group::Shared) {
            to.take(Group::Shared, Quantity::SHARED.map(Quantity::name), Quantity::SHARED.map(varied));
        }
        group!(Position: position; Inertia: inertia; Velocity: velocity; Passive: passive; Actuation: actuation;
            Acceleration: acceleration; Energy: energy; Integration: integration; Colliders: colliders;);
        group!(Found, "found": found.as_flattened_mut(), "parallel": parallel);
        group!(Constraint,
            "dof_lanes": dof_lanes.as_flattened_mut(),
            "strengths": strengths.as_flattened_mut(),
            "reference": reference,
            "motion": motion.as_flattened_mut(),
            "jacobian": jacobian,
        );
        group!(Solver: fields;);
        group!(Rows,
            "line": &mut line.0,
            "y.dof": &mut y.dof,
            "y.component": &mut y.component,
            "jp.dof": &mut jp.dof,
            "jp.component": &mut jp.component,
            "force.dof": &mut force.dof,
            "force.component": &mut force.component,
        );
        group!(Dual,
            "b": b,
            "z": z,
            "root": root,
            "bias.dof": &mut bias.dof,
            "bias.component": &mut bias.component,
            "edge_force": edge_force,
        );
        contact_rows
    }
}

macro_rules! groups {
    ($($(#[$doc:meta])* $group:ident: $stage:literal, $count:expr;)*) => {
        /// Fields that are lent together.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Group {
            $($(#[$doc])* $group,)*
        }

        impl Group {
            /// All.
            pub const ALL: &[Group] = &[$(Group::$group),*];
            /// Number of fields of each.
            const COUNTS: [usize; Group::ALL.len()] = [$($count),*];

            /// The stage in the names of its fields.
            pub fn stage(self) -> &'static str {
                match self { $(Group::$group => $stage,)* }
            }
        }
    };
}

groups! {
    /// State.
    State: "state", State::<f64>::COUNT;
    /// Forces from outside.
    Applied: "applied", Applied::<f64>::COUNT;
    /// What varies from world to world.
    Varied: "varied", Quantity::VARYING.len();
    /// What all worlds share.
    Shared: "varied", Quantity::SHARED.len();
    /// Poses.
    Position: "position", position::Position::<f64>::COUNT;
    /// Inertia.
    Inertia: "inertia", inertia::Inertia::<f64>::COUNT;
    /// Motions.
    Velocity: "velocity", velocity::Velocity::<f64>::COUNT;
    /// Passive forces.
    Passive: "passive", passive::Passive::<f64>::COUNT;
    /// Actuators.
    Actuation: "actuation", actuation::Actuation::<f64>::COUNT;
    /// Smooth acceleration.
    Acceleration: "acceleration", acceleration::Acceleration::<f64>::COUNT;
    /// Energy.
    Energy: "energy", energy::Energy::<f64>::COUNT;
    /// The next state.
    Integration: "integration", integration::Integration::<f64>::COUNT;
    /// Geoms.
    Colliders: "collision", Colliders::<f64>::COUNT;
    /// Contacts.
    Found: "collision", 2;
    /// Numbers of rows.
    Constraint: "constraint", 5;
    /// Vectors and matrices of the solver.
    Solver: "solver", solver::Solver::<f64>::COUNT;
    /// What the solver has to do with by rows.
    Rows: "solver", 7;
    /// What dual solvers have.
    Dual: "dual", 6;
}

impl Group {
    /// Number of its first field.
    pub const fn first(self) -> usize {
        let (mut first, mut group) = (0, 0);
        while group < self as usize {
            first += Group::COUNTS[group];
            group += 1;
        }
        first
    }

    /// The group of a field.
    ///
    /// # Panics
    ///
    /// If there is no such field.
    pub fn of(field: usize) -> Group {
        let mut of = Group::ALL.iter().filter(|group| field < group.first() + Group::COUNTS[**group as usize]);
        *of.next().expect("a field")
    }
}

/// A set of groups.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Groups(u32);

impl Groups {
    /// All.
    pub const ALL: Groups = Groups(u32::MAX);

    /// Those of a list.
    pub const fn of(list: &[Group]) -> Groups {
        Groups::NONE.and(list)
    }

    /// None.
    pub const NONE: Groups = Groups(0);

    /// With more.
    #[must_use]
    pub const fn and(self, list: &[Group]) -> Groups {
        let (mut set, mut i) = (self.0, 0);
        while i < list.len() {
            set |= 1 << list[i] as u32;
            i += 1;
        }
        Groups(set)
    }

    /// Whether a group is among them.
    #[inline(always)]
    pub const fn has(self, group: Group) -> bool {
        self.0 >> group as u32 & 1 != 0
    }
}

/// Takes the fields that a step lends, a group at a time, each with its name.
pub trait Borrower<'b, L> {
    /// Takes those of a group, whose numbers are consecutive.
    fn take<const N: usize>(&mut self, group: Group, names: [&'static str; N], fields: [Lanes<'b, L>; N]);
}

/// Takes fields one by one.
struct Single<'f, F>(&'f mut F);

impl<'b, L: 'b, F: FnMut(usize, Name, Lanes<'b, L>)> Borrower<'b, L> for Single<'_, F> {
    fn take<const N: usize>(&mut self, group: Group, names: [&'static str; N], fields: [Lanes<'b, L>; N]) {
        assert_eq!(N, Group::COUNTS[group as usize], "{group:?}");
        for (i, (name, field)) in names.into_iter().zip(fields).enumerate() {
            self.0(group.first() + i, [group.stage(), name], field);
        }
    }
}
