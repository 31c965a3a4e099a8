//! What happened to worlds, when and where: the detail behind status bits, and what a batch does about a lost world.

use std::fmt;

pub use lanesim_kernels::diagnosis::Element;
pub use lanesim_kernels::state::Status;

use crate::model::{Model, Names};

/// What a batch does with a world whose next state would be non-finite or huge. The status keeps what happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnDiverge {
    /// The world keeps its last good state and is stepped no more.
    #[default]
    Freeze,
    /// The world starts again, everything that it remembers cleared, and goes on.
    Reset {
        /// Keyframe from which it starts; `None`: the reference configuration.
        key: Option<usize>,
    },
    /// The world is frozen, and once all others are done the call returns an error that names it.
    Error,
}

/// The first time that a status bit was set in a world.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StatusEvent {
    /// The bit.
    pub status: Status,
    /// Steps that the batch had taken before the one in which it happened.
    pub step: u64,
    /// Where it happened.
    pub element: Element,
    /// The element in words, such as `joint 3 "knee"`; empty for the world as a whole.
    pub place: String,
}

impl StatusEvent {
    pub(crate) fn new(model: &Model, first: &First) -> StatusEvent {
        let (status, step, element) = (first.status, first.step, first.element);
        StatusEvent { status, step, element, place: place(model, element) }
    }
}

impl fmt::Display for StatusEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at step {}", self.status.names().join("+"), self.step)?;
        if !self.place.is_empty() {
            write!(f, ", {}", self.place)?;
        }
        Ok(())
    }
}

/// The same as a block keeps it, for one of its lanes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct First {
    pub lane: usize,
    pub status: Status,
    pub step: u64,
    pub element: Element,
}

/// An element in words.
fn place(model: &Model, element: Element) -> String {
    let (names, tables) = (model.names(), model.tables());
    match element {
        Element::World => String::new(),
        Element::Joint(j) => named("joint", j, &names.joints),
        Element::Dof(i) => match tables.dofs.get(i as usize) {
            Some(dof) => format!("dof {i} of {}", named("joint", dof.joint, &names.joints)),
            None => format!("dof {i}"),
        },
        Element::Body(b) => named("body", b, &names.bodies),
        Element::Actuator(a) => named("actuator", a, &names.actuators),
        Element::Pair(p) => {
            let Some(pair) = tables.pairs.get(p as usize) else { return format!("pair {p}") };
            let geom = |g: u32| named("geom", tables.geoms[g as usize].id, &names.geoms);
            format!("{} and {}", geom(pair.geom1), geom(pair.geom2))
        }
    }
}

fn named(kind: &str, id: u32, names: &Names) -> String {
    match names.name(id as usize) {
        "" => format!("{kind} {id}"),
        name => format!("{kind} {id} \"{name}\""),
    }
}
