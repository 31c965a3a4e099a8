//! Meshes: where their geoms' frames are, what these weigh, and the hulls that collide.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};

use glam::{DMat3, DQuat, DVec3};
use lanesim_kernels::model::{HeightField, Hull, NONE, Surface};

use super::inertia::principal;
use super::names::label;
use super::pose::{Pose, unit_quat};
use crate::diagnostics::{Diagnostics, quoted};
use crate::mesh::{self, Triangles};
use crate::spec::{self, Geom, GeomMass, Mesh, MeshInertia, Shape, Spec};
use crate::suggest::did_you_mean;

/// Tolerance of principal axes, MuJoCo's for meshes: what is symmetric but for rounding keeps the axes of its file.
const AXES: f64 = 1e-7;
const NO_HULL: &str = "has no convex hull: its vertices lie in a plane, or nearly so";

/// A mesh about its centre of mass, along its principal axes.
struct Solid {
    /// The frame of centre and axes in the mesh's own.
    frame: Pose,
    /// Volume, or area.
    volume: f64,
    /// Principal moments at a density of one.
    moments: DVec3,
    /// The corners of the box along the axes that holds it.
    bounds: [DVec3; 2],
    /// In that frame.
    vertices: Vec<DVec3>,
    /// In the axes of its file.
    filed: Vec<DVec3>,
    /// Its triangles, or those of its hull if it has none.
    triangles: Triangles,
    maxhullvert: Option<usize>,
}

/// The meshes that geoms have, by name.
#[derive(Default)]
pub(crate) struct Meshes {
    solids: BTreeMap<String, Solid>,
    heights: BTreeMap<String, HeightField>,
}

/// The model with its meshes' geoms where they are: position and orientation are those of their centres, sizes those of boxes
/// that hold them, and what they weigh is known; shapes fitted to a mesh are as any other.
pub(crate) fn place<'a>(spec: &'a Spec, diagnostics: &mut Diagnostics) -> (Cow<'a, Spec>, Meshes) {
    let mut meshes = Meshes::default();
    let shaped = |geom: &Geom| !geom.mesh.is_empty() || geom.shape == Shape::HeightField;
    if !spec.bodies.iter().flat_map(|body| &body.geoms).any(shaped) {
        return (Cow::Borrowed(spec), meshes);
    }
    let mut placed = spec.clone();
    let by_name: HashMap<&str, (usize, &Mesh)> =
        spec.meshes.iter().enumerate().map(|(m, mesh)| (mesh.name.as_str(), (m, mesh))).collect();
    let geoms = placed.bodies.iter_mut().flat_map(|body| &mut body.geoms);
    for (g, geom) in geoms.enumerate().filter(|(_, geom)| shaped(geom)) {
        if geom.shape == Shape::HeightField {
            if let Err((message, remedy)) = meshes.place_field(geom, &spec.hfields) {
                diagnostics.push(&geom.source, label("geom", &geom.name, g), message, remedy);
            }
            continue;
        }
        let Some((m, mesh)) = by_name.get(geom.mesh.as_str()) else {
            let near = did_you_mean(&geom.mesh, spec.meshes.iter().map(|mesh| mesh.name.as_str()));
            let message = format!("mesh names an unknown mesh {}", quoted(&geom.mesh));
            diagnostics.push(&geom.source, label("geom", &geom.name, g), message, near);
            continue;
        };
        if !meshes.solids.contains_key(&geom.mesh) {
            match Solid::new(mesh) {
                Ok(solid) => drop(meshes.solids.insert(geom.mesh.clone(), solid)),
                Err(message) => {
                    let before = diagnostics.0.iter().any(|d| d.element == label("mesh", &mesh.name, *m));
                    if !before {
                        diagnostics.push(&mesh.source, label("mesh", &mesh.name, *m), message, "");
                    }
                    continue;
                }
            }
        }
        if geom.shape == Shape::Mesh && geom.shellinertia {
            let remedy = "set inertia=\"shell\" of the mesh";
            diagnostics.push(
                &geom.source,
                label("geom", &geom.name, g),
                "a mesh geom cannot have shellinertia",
                remedy,
            );
        }
        meshes.solids[&geom.mesh].place(geom, spec.compiler.fitaabb);
    }
    (Cow::Owned(placed), meshes)
}

impl Meshes {
    /// Gives a geom the sizes of its height field; the error is a message and a remedy.
    fn place_field(&mut self, geom: &mut Geom, fields: &[spec::HeightField]) -> Result<(), (String, String)> {
        let Some(field) = fields.iter().find(|field| field.name == geom.hfield) else {
            let near = did_you_mean(&geom.hfield, fields.iter().map(|field| field.name.as_str()));
            return Err((format!("hfield names an unknown height field {}", quoted(&geom.hfield)), near.to_string()));
        };
        let [x, y, top, base] = field.size;
        let whole = field.rows >= 2 && field.columns >= 2 && field.heights.len() == field.rows * field.columns;
        let sound = field.heights.iter().all(|height| height.is_finite());
        if !whole || !sound || !field.size.iter().all(|size| size.is_finite() && *size > 0.0) {
            let message = format!("its height field {} is not one", quoted(&field.name));
            return Err((
                message,
                "give four positive sizes, and a finite height for each of 2 by 2 or more points".into(),
            ));
        }
        geom.size = [x, y, 0.25 * top + 0.5 * base];
        self.heights.entry(field.name.clone()).or_insert_with(|| HeightField {
            half: [x, y],
            base,
            size: [field.rows, field.columns],
            heights: field.heights.iter().map(|height| height * top).collect(),
        });
        Ok(())
    }
}

impl Solid {
    fn new(mesh: &Mesh) -> Result<Solid, String> {
        if let Some(problem) = mesh.triangles.problem() {
            return Err(problem);
        }
        let (refpos, turn) = (DVec3::from(mesh.refpos), unit_quat(mesh.refquat).conjugate());
        let scale = DVec3::from(mesh.scale);
        if !(refpos.is_finite() && turn.is_finite() && scale.is_finite()) || scale.min_element() == 0.0 {
            return Err("refpos, refquat and scale must be finite, and no scale 0".into());
        }
        let vertices: Vec<DVec3> = mesh.triangles.vertices.iter().map(|p| (turn * (*p - refpos)) * scale).collect();
        let mirrored = scale.x * scale.y * scale.z < 0.0;
        let faces = mesh.triangles.faces.iter().map(|[a, b, c]| if mirrored { [*a, *c, *b] } else { [*a, *b, *c] });
        let mut own = Triangles { faces: faces.collect(), vertices };
        let hull = || mesh::hull(&own.vertices, None).map_err(|_| NO_HULL.to_string());
        let bulk = if own.faces.is_empty() || mesh.inertia == MeshInertia::Convex {
            mesh::bulk(&hull()?, mesh.inertia)?
        } else {
            mesh::bulk(&own, mesh.inertia)?
        };
        let (moments, frame) = if mesh.centered {
            let i = bulk.inertia;
            (DVec3::new(i.x_axis.x, i.y_axis.y, i.z_axis.z), Pose::IDENTITY)
        } else {
            let (moments, quat) = principal(bulk.inertia, AXES);
            (moments, Pose { pos: bulk.centre, quat })
        };
        let inward = DMat3::from_quat(frame.quat).transpose();
        let centred = |p: &DVec3| inward * (*p - frame.pos);
        let start = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let bounds = own.vertices.iter().map(centred).fold(start, |[low, high], p| [low.min(p), high.max(p)]);
        let vertices = own.vertices.iter().map(centred).collect();
        let filed = mesh.triangles.vertices.iter().map(rounded).collect();
        if own.faces.is_empty() {
            own = hull()?;
        }
        let triangles =
            Triangles { vertices: own.vertices.iter().map(|p| rounded(&centred(p))).collect(), faces: own.faces };
        Ok(Solid {
            frame,
            volume: bulk.volume,
            moments,
            bounds,
            vertices,
            filed,
            triangles,
            maxhullvert: mesh.maxhullvert,
        })
    }

    /// The hull that collides.
    fn hull(&self) -> Result<Hull, mesh::Refused> {
        let all: Vec<DVec3> = self.vertices.iter().map(rounded).collect();
        let hull = mesh::hull(&all, self.maxhullvert)?;
        let bits = |p: &DVec3| p.to_array().map(f64::to_bits);
        let places: HashMap<[u64; 3], usize> = all.iter().map(bits).zip(0..).collect();
        let taken = |from: &[DVec3]| hull.vertices.iter().map(|p| from[places[&bits(p)]]).collect::<Vec<_>>();
        Ok(hull.outline(&taken(&self.vertices), &taken(&self.filed)))
    }

    /// Half sizes of the box of the same inertia.
    fn inertia_box(&self) -> DVec3 {
        let [a, b, c] = self.moments.to_array();
        let half = |sum: f64| (1.5 * sum / self.volume).max(0.0).sqrt();
        DVec3::new(half(b + c - a), half(a + c - b), half(a + b - c))
    }

    fn place(&self, geom: &mut Geom, aabb: bool) {
        let [low, high] = self.bounds;
        let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
        let own = Pose::new(geom.pos, geom.quat);
        let mut frame = self.frame;
        if geom.shape == Shape::Mesh {
            geom.size = (middle.abs() + half).to_array();
            let mass = match geom.mass {
                GeomMass::Density(density) => density * self.volume,
                GeomMass::Mass(mass) | GeomMass::Solid { mass, .. } => mass,
            };
            geom.mass = GeomMass::Solid { mass, moments: (self.moments * (mass / self.volume)).to_array() };
        } else {
            let fitted = if aabb { half } else { self.inertia_box() };
            frame = if aabb { frame.then(&Pose { pos: middle, quat: DQuat::IDENTITY }) } else { frame };
            geom.size = fit(geom.shape, fitted.to_array(), aabb).map(|size| size * geom.fitscale);
        }
        let pose = own.then(&frame);
        (geom.pos, geom.quat) = (pose.pos.to_array(), pose.wxyz());
    }
}

/// A point in single precision, in which MuJoCo has vertices.
fn rounded(p: &DVec3) -> DVec3 {
    p.as_vec3().as_dvec3()
}

/// Sizes of a shape fitted to a box: within it, or of about its volume.
fn fit(shape: Shape, [a, b, c]: [f64; 3], aabb: bool) -> [f64; 3] {
    let round = if aabb { a.max(b) } else { 0.5 * (a + b) };
    match shape {
        Shape::Sphere if aabb => [a.max(b).max(c), 0.0, 0.0],
        Shape::Sphere => [(a + b + c) / 3.0, 0.0, 0.0],
        Shape::Capsule if aabb => [round, (c - round).max(0.0), 0.0],
        Shape::Capsule => [round, (c - 0.5 * round).max(0.0), 0.0],
        Shape::Cylinder => [round, c, 0.0],
        _ => [a, b, c],
    }
}

/// Triangles of the meshes that rays can meet, each once.
pub(crate) struct Surfaces<'a> {
    meshes: &'a Meshes,
    places: HashMap<&'a str, u32>,
    pub surfaces: Vec<Surface>,
}

impl<'a> Surfaces<'a> {
    pub fn new(meshes: &'a Meshes) -> Self {
        Surfaces { meshes, places: HashMap::new(), surfaces: Vec::new() }
    }

    /// The place of a geom's triangles, or [`NONE`] if it has none.
    pub fn of(&mut self, geom: &'a Geom) -> u32 {
        let Some(solid) = self.meshes.solids.get(&geom.mesh).filter(|_| geom.shape == Shape::Mesh) else { return NONE };
        *self.places.entry(&geom.mesh).or_insert_with(|| {
            let vertices = solid.triangles.vertices.iter().map(|vertex| vertex.to_array()).collect();
            self.surfaces.push(Surface { vertices, faces: solid.triangles.faces.clone() });
            self.surfaces.len() as u32 - 1
        })
    }
}

/// Hulls of the meshes that collide, each once.
pub(crate) struct Hulls<'a> {
    meshes: &'a Meshes,
    places: HashMap<&'a str, u32>,
    pub hulls: Vec<Hull>,
    fields: HashMap<&'a str, u32>,
    pub heights: Vec<HeightField>,
}

impl<'a> Hulls<'a> {
    pub fn new(meshes: &'a Meshes) -> Self {
        Hulls { meshes, places: HashMap::new(), hulls: Vec::new(), fields: HashMap::new(), heights: Vec::new() }
    }

    /// The place of a geom's height field.
    pub fn field(&mut self, geom: &'a Geom) -> u32 {
        let Some(field) = self.meshes.heights.get(&geom.hfield) else { return NONE };
        *self.fields.entry(&geom.hfield).or_insert_with(|| {
            self.heights.push(field.clone());
            self.heights.len() as u32 - 1
        })
    }

    /// The place of a geom's hull or height field, or [`NONE`] if it has none.
    pub fn of(&mut self, geom: &'a Geom, id: usize, diagnostics: &mut Diagnostics) -> u32 {
        if geom.shape == Shape::HeightField {
            return self.field(geom);
        }
        let Some(solid) = self.meshes.solids.get(&geom.mesh).filter(|_| geom.shape == Shape::Mesh) else { return NONE };
        if let Some(place) = self.places.get(geom.mesh.as_str()) {
            return *place;
        }
        let place = match solid.hull() {
            Ok(hull) => {
                self.hulls.push(hull);
                self.hulls.len() as u32 - 1
            }
            Err(mesh::Refused) => {
                let message = format!("its mesh {} {NO_HULL}", quoted(&geom.mesh));
                diagnostics.push(
                    &geom.source,
                    label("geom", &geom.name, id),
                    message,
                    "set contype and conaffinity to 0",
                );
                NONE
            }
        };
        self.places.insert(&geom.mesh, place);
        place
    }
}
