//! What parts work on, and its fields by name.

use crate::collision::{Colliders, Collision};
use crate::constraint::{Constraint, ContactRow};
use crate::integration::Rk4;
use crate::lane::Lane;
use crate::model::{Instance, Quantity};
use crate::solver::{Dual, Problem, SolverWork};
use crate::stage::{Stage, StageClock, Stages};
use crate::state::{Applied, State};
use crate::workspace::Workspace;
use crate::{
    acceleration, actuation, derivative, energy, inertia, integration, kick, passive, position, sensor, solver, tendon,
    velocity,
};

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
        self.stages.run(stage, self.model.model)
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
        let Workspace { position, tendons, inertia, metric, acceleration, constraint, solver, .. } = &mut *self.ws;
        let inertia = metric.as_deref().unwrap_or(inertia);
        let (model, mean_inertia) = (self.model, self.model.mean_inertia());
        let problem = Problem { model, mean_inertia, position, tendons, inertia, acceleration, constraint };
        (problem, &self.state.qacc_warmstart, solver)
    }

    /// Lends all fields, in the order of their numbers.
    pub fn lend_all<'b>(&'b mut self, f: &mut impl FnMut(usize, Name, Lanes<'b, L>)) {
        self.lend(Threes::ALL, f);
    }

    /// Lends the fields of a set, in the order of their numbers. Returns the list of contacts.
    #[inline(always)]
    pub fn lend<'b>(&'b mut self, set: Threes, f: &mut impl FnMut(usize, Name, Lanes<'b, L>)) -> &'b [ContactRow] {
        let Step { model, state, applied, ws, .. } = self;
        let Workspace { position, inertia, velocity, passive, actuation, acceleration, energy, integration, .. } = ws;
        let Workspace {
            tendons, derivative, collision, constraint, solver, sensors, metric, rk4, middle, kick, ..
        } = ws;
        let Collision { colliders, found, parallel, .. } = collision;
        let Constraint { dof_lanes, strengths, reference, motion, jacobian, contact_rows, equality, .. } = constraint;
        let SolverWork { fields, y, jp, force, line, edge_force, dual, .. } = solver;
        let Dual { rows, diagonal, contacts, z, root, bias, gain, .. } = dual;
        let mut lender = Lender { set, group: Group::State, place: 0, wanted: false, f };
        macro_rules! stages {
            ($($group:ident: $stage:expr;)*) => {
                $(if lender.group(Group::$group) {
                    $stage.for_each(&mut |field| lender.put(field.name, Lanes::Write(field.data)));
                })*
            };
        }
        macro_rules! group {
            ($group:ident, $($name:literal: $lanes:expr),* $(,)?) => {
                if lender.group(Group::$group) {
                    $(lender.put($name, Lanes::Write($lanes));)*
                }
            };
        }
        stages!(State: state;);
        if lender.group(Group::Applied) {
            let [qfrc, xfrc]: [&'b [L]; 2] = match applied {
                Some(applied) => [&applied.qfrc_applied, applied.xfrc_applied.as_flattened()],
                None => [&[]; 2],
            };
            lender.put("qfrc_applied", Lanes::Read(qfrc));
            lender.put("xfrc_applied", Lanes::Read(xfrc));
        }
        let varied = |quantity: Quantity| Lanes::Read(model.varied.map_or(&[], |varied| varied.lanes(quantity)));
        if lender.group(Group::Varied) {
            Quantity::VARYING.into_iter().for_each(|quantity| lender.put(quantity.name(), varied(quantity)));
        }
        if lender.group(Group::Shared) {
            Quantity::SHARED.into_iter().for_each(|quantity| lender.put(quantity.name(), varied(quantity)));
        }
        stages!(Position: position; Tendons: tendons; Inertia: inertia; Velocity: velocity; Passive: passive; Actuation: actuation;
            Acceleration: acceleration; Derivative: derivative; Energy: energy; Sensor: sensors; Integration: integration;
            Colliders: colliders;);
        group!(Found, "found": found.as_flattened_mut(), "parallel": parallel);
        group!(Constraint,
            "dof_lanes": dof_lanes.as_flattened_mut(),
            "strengths": strengths.as_flattened_mut(),
            "reference": reference,
            "motion": motion.as_flattened_mut(),
            "jacobian": jacobian,
        );
        group!(Equality,
            "jacobian": &mut equality.jacobian,
            "pos": &mut equality.pos,
            "d": &mut equality.d,
            "reference": &mut equality.reference,
            "quats": equality.quats.as_flattened_mut(),
            "swamping": std::slice::from_mut(&mut equality.swamping),
        );
        stages!(Solver: fields;);
        group!(Rows,
            "line": &mut line.0,
            "y.dof": &mut y.dof,
            "y.component": &mut y.component,
            "jp.dof": &mut jp.dof,
            "jp.component": &mut jp.component,
            "force.dof": &mut force.dof,
            "force.component": &mut force.component,
            "y.equality": &mut y.equality,
            "jp.equality": &mut jp.equality,
            "force.equality": &mut force.equality,
        );
        group!(Dual,
            "rows": rows,
            "diagonal": diagonal,
            "contacts": contacts,
            "z": z,
            "root": root,
            "bias.dof": &mut bias.dof,
            "bias.component": &mut bias.component,
            "bias.equality": &mut bias.equality,
            "edge_force": edge_force,
            "gain": gain,
            "metric": metric.as_deref_mut().map_or(&mut [][..], |metric| &mut metric.m),
        );
        if let Some(kick) = kick {
            stages!(Guard: kick.guard;);
        }
        if let Some(middle) = middle {
            stages!(Between: middle;);
        }
        if let Some(rk4) = rk4 {
            let Rk4 { stage, rates } = &mut **rk4;
            stages!(Between: stage; Rates: rates;);
        }
        contact_rows
    }
}

/// Goes through the fields in order, and hands on those of a set.
struct Lender<'f, F> {
    set: Threes,
    group: Group,
    /// Of the next field in the group.
    place: usize,
    /// Whether its three is in the set.
    wanted: bool,
    f: &'f mut F,
}

impl<F> Lender<'_, F> {
    /// Begins a group; whether any of it is wanted.
    #[inline(always)]
    fn group(&mut self, group: Group) -> bool {
        (self.group, self.place) = (group, 0);
        self.set.any(group)
    }

    #[inline(always)]
    fn put<'b, L: 'b>(&mut self, name: &'static str, lanes: Lanes<'b, L>)
    where
        F: FnMut(usize, Name, Lanes<'b, L>),
    {
        if self.place.is_multiple_of(self.group.run()) {
            self.wanted = self.set.has(self.group, self.place / self.group.run());
        }
        if self.wanted {
            (self.f)(const { FIRSTS }[self.group as usize][0] + self.place, [self.group.stage(), name], lanes);
        }
        self.place += 1;
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
    /// Tendons.
    Tendons: "tendon", tendon::Tendons::<f64>::COUNT;
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
    /// What the implicit integrators have.
    Derivative: "derivative", derivative::Derivative::<f64>::COUNT;
    /// Energy.
    Energy: "energy", energy::Energy::<f64>::COUNT;
    /// Sensors.
    Sensor: "sensor", sensor::Sensors::<f64>::COUNT;
    /// The next state.
    Integration: "integration", integration::Integration::<f64>::COUNT;
    /// Geoms.
    Colliders: "collision", Colliders::<f64>::COUNT;
    /// Contacts.
    Found: "collision", 2;
    /// Numbers of rows.
    Constraint: "constraint", 5;
    /// Numbers of equality constraints.
    Equality: "equality", 6;
    /// Vectors and matrices of the solver.
    Solver: "solver", solver::Solver::<f64>::COUNT;
    /// What the solver has to do with by rows.
    Rows: "solver", 10;
    /// What dual solvers have; then what discrete steps have in place of the inertia matrix.
    Dual: "solver", 11;
    /// What the guard hands on, if the model has one.
    Guard: "guard", kick::Guard::<f64>::COUNT;
    /// The intermediate state of a Runge-Kutta step, or the middle of a midpoint step, if the model is integrated so.
    Between: "between", State::<f64>::COUNT;
    /// What the evaluations of a Runge-Kutta step have added up to.
    Rates: "rates", integration::Rates::<f64>::COUNT;
}

impl Group {
    /// Fields that a bit of a set stands for.
    const fn run(self) -> usize {
        use Group::{Between, Dual, Equality, Rates, Sensor, Varied};
        if matches!(self, Varied | Sensor | Equality | Dual | Between | Rates) { 6 } else { 3 }
    }

    /// Number of its first field.
    pub const fn first(self) -> usize {
        FIRSTS[self as usize][0]
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

/// A set of fields, three by three of each group; six by six of what varies, which is lent where anything does, and of what few models
/// have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Threes(u64);

impl Threes {
    /// All.
    pub const ALL: Threes = Threes(u64::MAX);
    /// None.
    pub const NONE: Threes = Threes(0);

    /// With a field.
    #[must_use]
    pub fn with(self, field: usize) -> Threes {
        let group = Group::of(field);
        Threes(self.0 | 1 << (FIRSTS[group as usize][1] + (field - group.first()) / group.run()))
    }

    /// Those of either.
    #[must_use]
    pub fn or(self, other: Threes) -> Threes {
        Threes(self.0 | other.0)
    }

    /// Whether all of another set are among them.
    pub fn includes(self, other: Threes) -> bool {
        other.0 & !self.0 == 0
    }

    /// Whether a group's three is among them.
    #[inline(always)]
    const fn has(self, group: Group, three: usize) -> bool {
        self.0 >> (const { FIRSTS }[group as usize][1] + three) & 1 != 0
    }

    /// Whether any of a group is among them.
    #[inline(always)]
    const fn any(self, group: Group) -> bool {
        let of_group = (1 << Group::COUNTS[group as usize].div_ceil(group.run())) - 1;
        self.0 >> const { FIRSTS }[group as usize][1] & of_group != 0
    }
}

/// By group, the numbers of its first field and of its first three.
const FIRSTS: [[usize; 2]; Group::ALL.len()] = {
    let (mut all, mut i) = ([[0; 2]; Group::ALL.len()], 1);
    while i < all.len() {
        let (count, run) = (Group::COUNTS[i - 1], Group::ALL[i - 1].run());
        all[i] = [all[i - 1][0] + count, all[i - 1][1] + count.div_ceil(run)];
        i += 1;
    }
    // Wider sets would cost small models some per cent of a step.
    let last = all.len() - 1;
    assert!(all[last][1] + Group::COUNTS[last].div_ceil(Group::ALL[last].run()) <= u64::BITS as usize);
    all
};
