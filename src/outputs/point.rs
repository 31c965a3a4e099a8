//! Points whose Jacobians can be asked for.

use crate::error::Error;
use crate::model::{Model, Names, Placement};
use crate::suggest;

/// A point of the model, by the number of the element that it is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Point {
    /// The origin of a body's frame.
    Body(usize),
    /// The middle of a geom.
    Geom(usize),
    /// A site.
    Site(usize),
}

/// What stands between an output's name and an element's.
const SEPARATOR: char = ':';
/// One of each kind.
const KINDS: [Point; 3] = [Point::Body(0), Point::Geom(0), Point::Site(0)];

impl Point {
    /// The kind of point and the element that the name of an output asks for; `None` if it asks for none.
    pub(super) fn split(name: &str) -> Option<(Point, &str)> {
        let (prefix, element) = name.split_once(SEPARATOR)?;
        KINDS.into_iter().find(|kind| kind.prefix() == prefix).map(|kind| (kind, element))
    }

    /// What the names of its outputs begin with.
    pub(super) fn prefix(self) -> &'static str {
        match self {
            Point::Body(_) => "jac_body",
            Point::Geom(_) => "jac_geom",
            Point::Site(_) => "jac_site",
        }
    }

    /// The name under which outputs of its kind are listed.
    pub(super) fn listed(self) -> &'static str {
        match self {
            Point::Body(_) => "jac_body:NAME",
            Point::Geom(_) => "jac_geom:NAME",
            Point::Site(_) => "jac_site:NAME",
        }
    }

    /// What it is on.
    pub(super) fn element(self) -> &'static str {
        match self {
            Point::Body(_) => "body",
            Point::Geom(_) => "geom",
            Point::Site(_) => "site",
        }
    }

    /// Number of the element.
    pub(super) fn id(self) -> usize {
        let (Point::Body(id) | Point::Geom(id) | Point::Site(id)) = self;
        id
    }

    /// The same on another element.
    fn at(self, id: usize) -> Point {
        match self {
            Point::Body(_) => Point::Body(id),
            Point::Geom(_) => Point::Geom(id),
            Point::Site(_) => Point::Site(id),
        }
    }

    fn names(self, model: &Model) -> &Names {
        match self {
            Point::Body(_) => &model.names().bodies,
            Point::Geom(_) => &model.names().geoms,
            Point::Site(_) => &model.names().sites,
        }
    }

    /// Where all elements of its kind are.
    pub(super) fn placements(self, model: &Model) -> &[Placement] {
        match self {
            Point::Body(_) => &model.placements().bodies,
            Point::Geom(_) => &model.placements().geoms,
            Point::Site(_) => &model.placements().sites,
        }
    }

    /// The point on the element that is called `name`, or has this number where no name is so.
    pub(super) fn find(self, model: &Model, name: &str) -> Result<Point, Error> {
        let number = || name.parse().ok().filter(|id| *id < self.placements(model).len());
        self.names(model).id(name).or_else(number).map(|id| self.at(id)).ok_or_else(|| {
            let (output, element) = (format!("{}{SEPARATOR}{name}", self.prefix()), self.element());
            let near = suggest::did_you_mean(name, self.names(model).iter());
            let remedy = match self.placements(model).len() {
                _ if !near.is_empty() => near,
                0 => "the model has none".into(),
                n => format!("the model has {n}, which can be given by name or number, counted from 0"),
            };
            Error::Unknown(format!("there is no {element} {name} for the output {output}; {remedy}"))
        })
    }

    /// An error if the model has no such element.
    pub(super) fn check(self, model: &Model) -> Result<(), Error> {
        let (n, id, element) = (self.placements(model).len(), self.id(), self.element());
        if id < n {
            return Ok(());
        }
        Err(Error::Input(format!("output {} of {element} {id}: the model has {n}, counted from 0", self.prefix())))
    }
}
