//! Points of a cloud: states that are moved in some columns at once, and what follows from each.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::request::{Of, Request, Scheme};
use super::visit::{Points, Visit, order};
use super::{Solving, Target};
use crate::error::Error;
use crate::inverse;
use crate::memory;
use crate::model::Model;
use crate::rows::Rows;
use crate::worlds::{Worlds, check_fit};

/// How a cloud's points are visited.
#[derive(Clone, Copy, Debug, Default)]
pub struct How {
    /// How constraints are solved.
    pub solving: Solving,
    /// Whether sensors are wanted, too, of next states.
    pub sensors: bool,
    /// Whether next positions are wanted as differences from the one that follows from the given state, `nv`, in the tangent space.
    pub tangent: bool,
    /// Controls that are nearer than this to a limit of theirs are moved the other way only, or not at all; `None`: limits do not matter, and
    /// actuators do with controls beyond them what they always do.
    pub reach: Option<f64>,
    /// Whether every point is evaluated from its positions on, though nothing that decides about them was moved: for those who want to
    /// know what an evaluation costs.
    pub whole: bool,
}

/// Where what is found goes: each of as many rows as worlds, or empty if it is not wanted.
#[derive(Debug)]
pub struct Found<'a> {
    /// What follows from the points, `[nworld, npoint, width]`, see [`Target::after`]. NaN where nothing does.
    pub after: Rows<'a>,
    /// The points themselves, `[nworld, npoint, width]`, see [`Target::before`].
    pub before: Rows<'a>,
    /// How many limits and contacts push at a point and not in the given state, or the other way round, `[nworld, npoint]`.
    pub changed: Rows<'a>,
    /// How columns can be moved, `[nworld, ncolumn]`: 2 to both sides, 1 forward, -1 backward, 0 not at all.
    pub sides: Rows<'a>,
    /// Bits of [`Status`](crate::status::Status): what happened to the worlds, `[nworld]`.
    pub status: Rows<'a>,
}

/// Numbers of a point by their names, and how many each has.
type Parts = Vec<(&'static str, usize)>;

impl Target<'_> {
    /// How many columns a point can be moved in.
    pub fn columns(&self, model: &Model) -> usize {
        let sizes = &model.tables().sizes;
        match self.of() {
            Of::Inverse => 3 * sizes.nv,
            Of::Transition | Of::Acceleration => 3 * sizes.nv + sizes.na + sizes.nu,
        }
    }

    /// What follows from a point: names and numbers of each, in the order in which they are in a row.
    pub fn after(&self, model: &Model, how: &How) -> Parts {
        let sizes = &model.tables().sizes;
        match self.of() {
            Of::Inverse => vec![("qfrc_inverse", sizes.nv)],
            Of::Acceleration => vec![("qacc", sizes.nv)],
            Of::Transition => {
                let positions = if how.tangent { sizes.nv } else { sizes.nq };
                let sensors = if how.sensors { sizes.nsensordata } else { 0 };
                vec![("qpos", positions), ("qvel", sizes.nv), ("act", sizes.na), ("sensordata", sensors)]
            }
        }
    }

    /// What a point is, likewise.
    pub fn before(&self, model: &Model) -> Parts {
        let sizes = &model.tables().sizes;
        let mut parts = vec![("qpos", sizes.nq), ("qvel", sizes.nv), ("act", sizes.na), ("ctrl", sizes.nu)];
        if self.of() == Of::Inverse {
            parts.push(("qacc", sizes.nv));
        }
        parts
    }
}

/// Numbers of a row in all.
pub(crate) fn width(parts: &[(&'static str, usize)]) -> usize {
    parts.iter().map(|(_, n)| n).sum()
}

impl Worlds {
    /// What follows from states beside the worlds' present ones, which stay as they are: every world visits all points. With
    /// [`Solving::Accurate`] the model must be an [`accurate`](super::accurate) one, and points that did not converge are NaN. The number
    /// that is given counts the worlds that are done; once the flag turns true the result is [`Error::Cancelled`].
    ///
    /// # Errors
    ///
    /// If an array has another length; if a point is moved in a column that there is not, or by no finite number; if the model's steps
    /// cannot be inverted.
    pub fn points_into(
        &mut self,
        target: &Target<'_>,
        points: &Points,
        how: &How,
        found: Found<'_>,
        (progress, cancel): (Option<&AtomicU64>, Option<&AtomicBool>),
    ) -> Result<(), Error> {
        let (nworld, nv) = (self.nworld(), self.model.tables().sizes.nv);
        let qacc = if let Target::Inverse(qacc) = target { Some(qacc) } else { None };
        if let Some(qacc) = qacc {
            inverse::check_model(&self.model)?;
            check_fit("qacc", qacc, nworld, nv)?;
        }
        let widths =
            [width(&target.after(&self.model, how)), width(&target.before(&self.model)), target.columns(&self.model)];
        check_moves(points, widths[2])?;
        let rows = check_found(found, nworld, points.len(), widths)?;
        let (of, strict) = (target.of(), how.solving == Solving::Accurate);
        let first_force = 2 * nv + self.model.tables().sizes.na + self.model.tables().sizes.nu;
        let forces = of != Of::Inverse && points.all().iter().any(|(column, _)| *column >= first_force);
        // What is asked of differences does not matter.
        let scheme = Scheme { sensors: how.sensors, ..Scheme::default() };
        let request = Request { of, scheme, qacc, strict, progress, cancel, times: None };
        let order = order(&self.model, of, points, how.whole);
        let How { tangent, reach, .. } = *how;
        self.engine.points(&Visit { request, points, order, tangent, reach, widths, forces }, rows);
        if cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
            return Err(Error::Cancelled);
        }
        Ok(())
    }
}

fn check_moves(points: &Points, columns: usize) -> Result<(), Error> {
    match points.all().iter().find(|(column, distance)| *column >= columns || !distance.is_finite()) {
        None => Ok(()),
        Some((column, _)) if *column >= columns => {
            Err(Error::Input(format!("a point is moved in column {column}; there are {columns}, counted from 0")))
        }
        Some((column, distance)) => {
            Err(Error::Input(format!("a point is moved by {distance} in column {column}; expected a finite number")))
        }
    }
}

/// The arrays in the order of [`Found`], an error if one has another length than it must have.
fn check_found<'a>(
    found: Found<'a>,
    nworld: usize,
    npoint: usize,
    [after, before, columns]: [usize; 3],
) -> Result<Vec<Rows<'a>>, Error> {
    let named = [
        ("after", found.after, vec![nworld, npoint, after]),
        ("before", found.before, vec![nworld, npoint, before]),
        ("changed", found.changed, vec![nworld, npoint]),
        ("sides", found.sides, vec![nworld, columns]),
        ("status", found.status, vec![nworld]),
    ];
    let checked = named.into_iter().map(|(name, rows, entries)| {
        let fits = rows.is_empty() || memory::product(&entries) == Some(rows.len());
        if !fits || matches!(rows, Rows::Lists(_)) {
            let (given, expected) = (rows.len(), memory::count(&entries));
            return Err(Error::Input(format!("array for {name} has {given} entries; expected {expected}, or none")));
        }
        Ok(rows)
    });
    checked.collect()
}
