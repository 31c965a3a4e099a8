//! `geom` and `site`.

use super::orientation::{Angles, Orientation, from_z};
use super::reader::Reader;
use super::report::Report;
use super::tree::{Element, Tree};
use crate::spec::{Compiler, Geom, GeomMass, InertiaFromGeom, Shape, Site};

/// The shapes of MJCF: ours, and those that are not supported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Shape(Shape),
    DistanceField,
}

const KINDS: &[(&str, Kind)] = &[
    ("plane", Kind::Shape(Shape::Plane)),
    ("hfield", Kind::Shape(Shape::HeightField)),
    ("sphere", Kind::Shape(Shape::Sphere)),
    ("capsule", Kind::Shape(Shape::Capsule)),
    ("ellipsoid", Kind::Shape(Shape::Ellipsoid)),
    ("cylinder", Kind::Shape(Shape::Cylinder)),
    ("box", Kind::Shape(Shape::Box)),
    ("mesh", Kind::Shape(Shape::Mesh)),
    ("sdf", Kind::DistanceField),
];

/// Where a shape is, as written.
#[derive(Clone, Debug)]
pub(super) struct Placement {
    kind: Kind,
    size: [f64; 3],
    pos: [f64; 3],
    orientation: Orientation,
    fromto: Option<[f64; 6]>,
    /// Name of the mesh that is the shape, or to which it is fitted.
    mesh: String,
    /// Name of the height field that is the shape.
    hfield: String,
    /// Colour and opacity.
    rgba: [f64; 4],
}

impl Placement {
    fn new(size: [f64; 3]) -> Self {
        Placement {
            kind: Kind::Shape(Shape::Sphere),
            size,
            pos: [0.0; 3],
            orientation: Orientation::IDENTITY,
            fromto: None,
            mesh: String::new(),
            hfield: String::new(),
            rgba: [0.5, 0.5, 0.5, 1.0],
        }
    }

    fn read(&mut self, reader: &mut Reader) {
        reader.keyword("type", KINDS, &mut self.kind);
        reader.leading("size", &mut self.size);
        reader.list("pos", &mut self.pos);
        reader.orientation(&mut self.orientation);
        let mut fromto = [0.0; 6];
        if reader.list("fromto", &mut fromto) {
            self.fromto = Some(fromto);
        }
        reader.list("rgba", &mut self.rgba);
        if let Some(mesh) = reader.element.get("mesh") {
            self.mesh = mesh.to_string();
        }
        if let Some(hfield) = reader.element.get("hfield") {
            self.hfield = hfield.to_string();
        }
    }

    /// Why the shape cannot be had.
    fn missing(&self) -> Option<&'static str> {
        match self.kind {
            Kind::DistanceField => Some("signed distance fields are"),
            Kind::Shape(_) => None,
        }
    }

    /// Shape, size, position and orientation; `None` if something is wrong, which is reported.
    fn resolve(&self, element: &Element, angles: &Angles, report: &mut Report) -> Option<Resolved> {
        let Kind::Shape(shape) = self.kind else { return None };
        let (size, pos) = (self.size, self.pos);
        let problem = match self.fromto {
            None => match self.orientation.quat(angles) {
                Ok(quat) => return Some(Resolved { shape, size, pos, quat }),
                Err(message) => message,
            },
            Some(_) if pos != [0.0; 3] => "both pos and fromto are given",
            Some(ends) => match span(shape, size, ends) {
                Ok(resolved) => return Some(resolved),
                Err(message) => message,
            },
        };
        report.error(element, problem, "");
        None
    }
}

/// Where a shape is.
struct Resolved {
    shape: Shape,
    size: [f64; 3],
    pos: [f64; 3],
    quat: [f64; 4],
}

/// A shape between two points: its z axis points from the second to the first.
fn span(shape: Shape, mut size: [f64; 3], ends: [f64; 6]) -> Result<Resolved, &'static str> {
    let [a, b, c, d, e, f] = ends;
    let axis = [a - d, b - e, c - f];
    let half = 0.5 * axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    match shape {
        Shape::Capsule | Shape::Cylinder => size[1] = half,
        Shape::Box | Shape::Ellipsoid => size = [size[0], size[0], half],
        Shape::Plane | Shape::HeightField | Shape::Sphere | Shape::Mesh => {
            return Err("fromto needs a capsule, cylinder, box or ellipsoid");
        }
    }
    let quat = from_z(axis).ok_or("the two points of fromto coincide")?;
    Ok(Resolved { shape, size, pos: [0.5 * (a + d), 0.5 * (b + e), 0.5 * (c + f)], quat })
}

/// What a body has that decides what its geoms count for.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Held {
    pub inertial: bool,
    pub moves: bool,
}

impl Held {
    /// Looks at a body's own children, and into frames.
    pub fn of(tree: &Tree, body: usize, around: Held) -> Held {
        let mut held = Held { inertial: false, ..around };
        let mut open = vec![body];
        while let Some(index) = open.pop() {
            for &child in &tree[index].children {
                match tree[child].tag.as_str() {
                    "joint" | "freejoint" => held.moves = true,
                    "inertial" => held.inertial = true,
                    "frame" => open.push(child),
                    _ => {}
                }
            }
        }
        held
    }
}

/// A geom as written, or its default.
#[derive(Clone, Debug)]
pub(super) struct RawGeom {
    geom: Geom,
    placement: Placement,
    mass: Option<f64>,
    density: f64,
    /// Whether it is an ellipsoid to a medium, and its coefficients.
    fluid: bool,
    fluidcoef: [f64; 5],
    /// What it asks for that is not supported, by attribute.
    adhesion: f64,
}

const FLUID: &[(&str, bool)] = &[("none", false), ("ellipsoid", true)];

impl Default for RawGeom {
    fn default() -> Self {
        RawGeom {
            geom: Geom::default(),
            placement: Placement::new([0.0; 3]),
            mass: None,
            density: 1000.0,
            fluid: false,
            fluidcoef: [0.5, 0.25, 1.5, 1.0, 1.0],
            adhesion: 0.0,
        }
    }
}

impl RawGeom {
    /// Reads what a geom and its default have in common.
    pub fn read(&mut self, reader: &mut Reader) {
        self.placement.read(reader);
        let geom = &mut self.geom;
        let mut mass = 0.0;
        if reader.real("mass", &mut mass) {
            self.mass = Some(mass);
        }
        reader.real("density", &mut self.density);
        reader.real("fitscale", &mut geom.fitscale);
        reader.boolean("shellinertia", &mut geom.shellinertia);
        reader.bits("contype", &mut geom.contype);
        reader.bits("conaffinity", &mut geom.conaffinity);
        reader.integer("condim", &mut geom.condim);
        reader.integer("priority", &mut geom.priority);
        reader.integer("group", &mut geom.group);
        reader.leading("friction", &mut geom.friction);
        reader.real("solmix", &mut geom.solmix);
        reader.leading("solref", &mut geom.solref);
        reader.leading("solimp", &mut geom.solimp);
        reader.real("margin", &mut geom.margin);
        reader.real("gap", &mut geom.gap);
        reader.keyword("fluidshape", FLUID, &mut self.fluid);
        reader.leading("fluidcoef", &mut self.fluidcoef);
        reader.leading("surfacevel", &mut geom.surfacevel);
        reader.real("adhesion", &mut self.adhesion);
    }

    /// Why the shape cannot be had.
    pub fn missing(&self) -> Option<&'static str> {
        self.placement.missing()
    }

    /// Whether it can touch what it is not paired with by name.
    pub fn touches(&self) -> bool {
        self.geom.contype != 0 || self.geom.conaffinity != 0
    }

    /// Whether the motion depends on its mass.
    pub fn weighs(&self, compiler: &Compiler, held: Held) -> bool {
        let [low, high] = compiler.inertiagrouprange;
        let counts = match compiler.inertiafromgeom {
            InertiaFromGeom::True => true,
            InertiaFromGeom::Auto => !held.inertial,
            InertiaFromGeom::False => false,
        };
        let moves = held.moves || compiler.settotalmass > 0.0;
        let heavy = self.mass.unwrap_or(self.density) != 0.0;
        counts && moves && heavy && (low..=high).contains(&self.geom.group)
    }

    /// The geom in the coordinates of its frame; `None` if something is wrong, which is reported. Its shape is not
    /// [`missing`](Self::missing).
    pub fn finish(self, element: &Element, angles: &Angles, report: &mut Report) -> Option<Geom> {
        let features = [(self.adhesion != 0.0, "adhesive contact (adhesion) is")];
        for (_, what) in features.iter().filter(|(asked, _)| *asked) {
            report.unsupported(element, what);
        }
        let mesh = self.placement.mesh.clone();
        let field = self.placement.kind == Kind::Shape(Shape::HeightField);
        let hfield = if field { self.placement.hfield.clone() } else { String::new() };
        match self.placement.kind {
            Kind::Shape(Shape::Mesh) if mesh.is_empty() => {
                report.error(element, "a geom of type mesh needs a mesh", "name one in attribute mesh");
                return None;
            }
            Kind::Shape(Shape::HeightField) if hfield.is_empty() => {
                report.error(element, "a geom of type hfield needs a height field", "name one in attribute hfield");
                return None;
            }
            Kind::Shape(Shape::Plane | Shape::HeightField) if !mesh.is_empty() => {
                report.error(element, "a plane or height field cannot be fitted to a mesh", "remove mesh");
                return None;
            }
            _ => {}
        }
        let Resolved { shape, size, pos, quat } = self.placement.resolve(element, angles, report)?;
        let mass = self.mass.map_or(GeomMass::Density(self.density), GeomMass::Mass);
        let clear = self.placement.rgba[3] == 0.0;
        let fluid = self.fluid.then_some(self.fluidcoef);
        let source = element.source.clone();
        Some(Geom { shape, clear, fluid, size, mesh, hfield, pos, quat, mass, source, ..self.geom })
    }
}

/// A site as written, or its default.
#[derive(Clone, Debug)]
pub(super) struct RawSite {
    placement: Placement,
    group: i32,
}

impl Default for RawSite {
    fn default() -> Self {
        RawSite { placement: Placement::new([0.005; 3]), group: 0 }
    }
}

impl RawSite {
    /// Reads what a site and its default have in common.
    pub fn read(&mut self, reader: &mut Reader) {
        self.placement.read(reader);
        reader.integer("group", &mut self.group);
    }

    /// The site in the coordinates of its frame; `None` if it cannot be had, which is reported.
    pub fn finish(self, element: &Element, angles: &Angles, report: &mut Report) -> Option<Site> {
        if matches!(self.placement.kind, Kind::Shape(Shape::Plane | Shape::HeightField)) {
            report.error(element, "a site cannot be a plane or height field", "");
            return None;
        }
        let fitted = (!self.placement.mesh.is_empty()).then_some("a site fitted to a mesh is");
        if let Some(what) = self.placement.missing().or(fitted) {
            report.unsupported(element, what);
            return None;
        }
        let Resolved { shape, size, pos, quat } = self.placement.resolve(element, angles, report)?;
        let source = element.source.clone();
        Some(Site { name: String::new(), shape, size, pos, quat, group: self.group, source })
    }
}
