//! One workspace: a struct for each stage, reused for every block that a thread takes.

use ::wide::f64x8;

use crate::acceleration::Acceleration;
use crate::actuation::Actuation;
use crate::collision::{Collision, groups};
use crate::constraint::{Cone, Constraint, cone};
use crate::derivative::Derivative;
use crate::energy::Energy;
use crate::inertia::Inertia;
use crate::integration::{Integration, Rk4};
use crate::kick::Kick;
use crate::lane::{Lane, LaneQuery, Real};
use crate::model::{Cast, Model, Pair, Sizes, Varied};
use crate::options::Integrator;
use crate::passive::Passive;
use crate::position::Position;
use crate::sensor::{self, Sensors};
use crate::sleep::Sleep;
use crate::smooth::Smooth;
use crate::solver::SolverWork;
use crate::stage::Stage;
use crate::state::{Applied, State, state_len};
use crate::tendon::Tendons;
use crate::velocity::Velocity;

fn has_metric<T>(model: &Model<T>) -> bool {
    model.options.integrator.has_metric()
}

fn midpoint<T>(model: &Model<T>) -> bool {
    model.options.integrator == Integrator::Midpoint
}

/// What the stages write.
#[derive(Clone, Debug)]
#[allow(missing_docs)] // each field is the stage of the same name
pub struct Workspace<L: Lane> {
    pub position: Position<L>,
    pub tendons: Tendons<L>,
    pub inertia: Inertia<L>,
    pub collision: Collision<L>,
    pub velocity: Velocity<L>,
    pub constraint: Constraint<L>,
    pub passive: Passive<L>,
    pub actuation: Actuation<L>,
    pub acceleration: Acceleration<L>,
    pub derivative: Derivative<L>,
    pub solver: SolverWork<L>,
    pub integration: Integration<L>,
    pub energy: Energy<L>,
    pub sensors: Sensors<L>,
    /// What a solver of discrete or midpoint steps has in place of the inertia: only the matrix is filled in.
    pub metric: Option<Box<Inertia<L>>>,
    /// Of a model that is integrated so.
    pub rk4: Option<Box<Rk4<L>>>,
    /// Of a model that is integrated by midpoint steps: the middle of the step.
    pub middle: Option<Box<State<L>>>,
    /// Of a model that is integrated so, or with a guard.
    pub kick: Option<Box<Kick<L>>>,
    /// Of a model in which trees may sleep.
    pub sleep: Option<Box<Sleep<L>>>,
    /// For worlds that need double precision; there once one did.
    pub double: Option<Box<Double>>,
}

impl<L: Lane> Workspace<L> {
    /// The stages that do without constraints, of a step that `kicks`, or of another evaluation.
    pub fn smooth(&mut self, kicks: bool) -> Smooth<'_, L> {
        let Workspace { position, tendons, inertia, velocity, passive, actuation, acceleration, derivative, .. } = self;
        let colliders = &mut self.collision.colliders;
        let kick = self.kick.as_deref_mut().filter(|_| kicks);
        Smooth { position, tendons, inertia, velocity, passive, actuation, acceleration, derivative, colliders, kick }
    }

    /// What sensors read.
    pub fn stages(&self) -> sensor::Stages<'_, L>
    where
        L: Lane,
    {
        let Workspace { position, tendons, inertia, velocity, actuation, collision, constraint, solver, .. } = self;
        sensor::Stages { position, tendons, inertia, velocity, actuation, collision, constraint, solver }
    }

    /// What sensors read, and what they write.
    pub fn sensing(&mut self) -> (sensor::Stages<'_, L>, &mut Energy<L>, &mut Sensors<L>)
    where
        L: Lane,
    {
        let Workspace {
            position,
            tendons,
            inertia,
            velocity,
            actuation,
            collision,
            constraint,
            solver,
            energy,
            sensors,
            ..
        } = self;
        (
            sensor::Stages { position, tendons, inertia, velocity, actuation, collision, constraint, solver },
            energy,
            sensors,
        )
    }
}

impl<L: LaneQuery> Workspace<L> {
    /// A workspace for the model: everything that a step needs, allocated once. Stages that the model does not have get
    /// no room.
    pub fn new(model: &Model<L::Real>) -> Self {
        let mut ws = Self::without_groups(model);
        ws.collision.groups = groups(model);
        ws
    }
}

impl<L: Lane> Workspace<L> {
    /// The same without groups of pairs.
    pub fn without_groups(model: &Model<L::Real>) -> Self {
        let sizes = &model.sizes;
        let of = |stage: Stage| stage.sizes(model);
        Workspace {
            position: Position::new(sizes),
            tendons: Tendons::new(sizes),
            inertia: Inertia::new(sizes),
            collision: Collision::new(model),
            velocity: Velocity::new(sizes),
            constraint: Constraint::new(model),
            passive: Passive::new(&of(Stage::Passive)),
            actuation: Actuation::new(&of(Stage::Actuation)),
            acceleration: Acceleration::new(sizes),
            derivative: Derivative::new(&of(Stage::Derivative)),
            solver: SolverWork::new(model),
            integration: Integration::new(&of(Stage::Integration)),
            energy: Energy::new(sizes),
            sensors: Sensors::new(sizes),
            metric: has_metric(model).then(|| Box::new(Inertia::new(&Sizes { nlink: 0, ..sizes.clone() }))),
            rk4: Rk4::new(model).map(Box::new),
            middle: midpoint(model).then(|| Box::new(State::new(sizes))),
            kick: Kick::new(model).map(Box::new),
            sleep: Sleep::new(model).map(Box::new),
            double: None,
        }
    }

    /// Bytes of it, but for lists that grow when they must.
    pub fn bytes(model: &Model<L::Real>) -> usize {
        let sizes = &model.sizes;
        let of = |stage: Stage| stage.sizes(model);
        let stages = [
            Position::<L>::bytes(sizes),
            Tendons::<L>::bytes(sizes),
            Inertia::<L>::bytes(sizes),
            Collision::<L>::bytes(model),
            Velocity::<L>::bytes(sizes),
            Constraint::<L>::bytes(model),
            Passive::<L>::bytes(&of(Stage::Passive)),
            Actuation::<L>::bytes(&of(Stage::Actuation)),
            Acceleration::<L>::bytes(sizes),
            Derivative::<L>::bytes(&of(Stage::Derivative)),
            SolverWork::<L>::bytes(model),
            Sleep::<L>::bytes(model),
            Integration::<L>::bytes(&of(Stage::Integration)),
            Energy::<L>::bytes(sizes),
            Sensors::<L>::bytes(sizes),
            Rk4::<L>::bytes(model),
            if midpoint(model) { State::<L>::bytes(sizes) } else { 0 },
            Kick::<L>::bytes(model),
            if has_metric(model) { Inertia::<L>::bytes(&Sizes { nlink: 0, ..sizes.clone() }) } else { 0 },
        ];
        let own = stages.into_iter().fold(0, usize::saturating_add);
        own.saturating_add(double_bytes::<L>(model, own))
    }
}

/// Worlds gathered from a block, which are evaluated in double precision.
#[derive(Clone, Debug)]
pub struct Double {
    pub(crate) model: Model<f64>,
    pub(crate) state: State<f64x8>,
    pub(crate) applied: Option<Applied<f64x8>>,
    pub(crate) varied: Option<Varied<f64x8>>,
    pub(crate) workspace: Workspace<f64x8>,
}

impl Double {
    /// Room for worlds of the model. Asked for when it is first needed: most models never do.
    pub(crate) fn new<T: Real>(model: &Model<T>) -> Self {
        let model: Model<f64> = model.cast();
        let (state, workspace) = (State::new(&model.sizes), Workspace::new(&model));
        Double { state, applied: None, varied: None, workspace, model }
    }
}

/// Bytes that evaluation in double precision takes once a world needs it, of a model whose workspace has `own`: its workspace
/// has as many numbers.
fn double_bytes<L: Lane>(model: &Model<L::Real>, own: usize) -> usize {
    let mut cones = model.pairs.iter().map(|pair| cone(model, pair));
    if L::Real::EPSILON < 1e-10 || cones.all(|cone| cone != Cone::Pyramid) {
        return 0;
    }
    let numbers = (own / size_of::<L>()).saturating_add(state_len::<f64x8>(&model.sizes));
    numbers.saturating_mul(size_of::<f64x8>()).saturating_add(model.pairs.len() * size_of::<Pair<f64>>())
}
