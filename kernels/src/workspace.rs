//! One workspace: a struct for each stage, reused for every block that a thread takes.

use crate::acceleration::Acceleration;
use crate::actuation::Actuation;
use crate::collision::Collision;
use crate::constraint::Constraint;
use crate::energy::Energy;
use crate::inertia::Inertia;
use crate::integration::Integration;
use crate::lane::LaneQuery;
use crate::model::{Model, Sizes};
use crate::passive::Passive;
use crate::position::Position;
use crate::solver::SolverWork;
use crate::stage::Stage;
use crate::velocity::Velocity;

/// What the stages write.
#[derive(Clone, Debug)]
#[allow(missing_docs)] // each field is the stage of the same name
pub struct Workspace<L> {
    pub position: Position<L>,
    pub inertia: Inertia<L>,
    pub collision: Collision<L>,
    pub velocity: Velocity<L>,
    pub constraint: Constraint<L>,
    pub passive: Passive<L>,
    pub actuation: Actuation<L>,
    pub acceleration: Acceleration<L>,
    pub solver: SolverWork<L>,
    pub integration: Integration<L>,
    pub energy: Energy<L>,
}

impl<L: LaneQuery> Workspace<L> {
    /// A workspace for the model: everything that a step needs, allocated once. Stages that the model does not have get
    /// no room.
    pub fn new(model: &Model<L::Real>) -> Self {
        let (sizes, none) = (&model.sizes, Sizes::default());
        // The factor of the damped inertia is needed where damping is implicit.
        let nm = if model.features.implicit_damping { sizes.nm } else { 0 };
        let implicit = Sizes { nm, ..sizes.clone() };
        let if_present = |stage: Stage| if stage.present(model) { sizes } else { &none };
        Workspace {
            position: Position::new(sizes),
            inertia: Inertia::new(sizes),
            collision: Collision::new(model),
            velocity: Velocity::new(sizes),
            constraint: Constraint::new(model),
            passive: Passive::new(if_present(Stage::Passive)),
            actuation: Actuation::new(if_present(Stage::Actuation)),
            acceleration: Acceleration::new(sizes),
            solver: SolverWork::new(model),
            integration: Integration::new(&implicit),
            energy: Energy::new(sizes),
        }
    }
}
