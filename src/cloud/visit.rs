//! Points, and what a batch is told of them.

use super::request::{Of, Request};
use super::times::Kind;
use crate::model::Model;

/// States beside given ones, the same for each of them: a point is moved in some columns, each by a distance. Columns are numbered as those of
/// all matrices of a [`Target`](super::Target): positions in the tangent space, velocities, activations and controls, then, where accelerations or next
/// states are wanted, generalised forces, `nv`; of inverse dynamics positions, velocities and accelerations. Moves of a rotation's columns
/// add as one vector of the tangent space.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    moves: Vec<(usize, f64)>,
    ends: Vec<usize>,
}

impl Points {
    /// Adds a point that is moved so, each column by its distance; none: the given state itself.
    pub fn push(&mut self, moves: impl IntoIterator<Item = (usize, f64)>) {
        self.moves.extend(moves);
        self.ends.push(self.moves.len());
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// The moves of all points.
    pub(crate) fn all(&self) -> &[(usize, f64)] {
        &self.moves
    }

    /// Columns of a point, and how far it is moved in each.
    pub fn moves(&self, point: usize) -> &[(usize, f64)] {
        let start = point.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.moves[start..self.ends[point]]
    }
}

/// What is asked of a batch.
pub(crate) struct Visit<'a> {
    pub request: Request<'a>,
    pub points: &'a Points,
    /// The points by the kind that decides from where they are evaluated, in an order in which none changes what the next ones take over.
    pub order: Vec<(Kind, Vec<usize>)>,
    /// Whether next positions are wanted as differences from the nominal one.
    pub tangent: bool,
    /// How near a control can be to its limit before it is moved one way only.
    pub reach: Option<f64>,
    /// Numbers of a row of what follows, of a point, and of sides.
    pub widths: [usize; 3],
    /// Whether some point is moved by a generalised force.
    pub forces: bool,
}

impl Visit<'_> {
    /// Evaluations that a world takes if it has so many lanes.
    pub fn evaluations(&self, share: usize) -> usize {
        1 + self.order.iter().map(|(_, points)| points.len().div_ceil(share)).sum::<usize>()
    }
}

/// The kind of a column.
fn kind(model: &Model, of: Of, column: usize) -> Kind {
    match (column / model.tables().sizes.nv.max(1), of) {
        (0, _) => Kind::Position,
        (1, _) => Kind::Velocity,
        (_, Of::Inverse) => Kind::Acceleration,
        _ => Kind::Actuation,
    }
}

/// The points by their kinds, those first that need least.
pub(crate) fn order(model: &Model, of: Of, points: &Points, whole: bool) -> Vec<(Kind, Vec<usize>)> {
    let least = if of == Of::Inverse { Kind::Acceleration } else { Kind::Actuation };
    let kind = |point: usize| match whole {
        true => Kind::Position,
        false => points.moves(point).iter().map(|(column, _)| kind(model, of, *column)).min().unwrap_or(least),
    };
    let all = [least, Kind::Velocity, Kind::Position];
    let those = |wanted: Kind| (0..points.len()).filter(|point| kind(*point) == wanted).collect::<Vec<_>>();
    all.map(|wanted| (wanted, those(wanted))).into_iter().filter(|(_, points)| !points.is_empty()).collect()
}
