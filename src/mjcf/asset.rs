//! `asset/mesh`: meshes from files, written out or built in. Only those that some geom has are read.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::include::Assets;
use super::reader::Reader;
use super::report::{Report, quoted};
use super::tree::{Element, Tree};
use crate::mesh::{FORMATS, Format, Triangles, builtin};
use crate::spec::{InertiaFromGeom, Mesh, MeshInertia, Spec};

/// A mesh as written, or its default.
#[derive(Clone, Debug, Default)]
pub(super) struct RawMesh {
    mesh: Mesh,
    file: String,
    content_type: String,
}

const INERTIA: &[(&str, MeshInertia)] = &[
    ("legacy", MeshInertia::Legacy),
    ("exact", MeshInertia::Exact),
    ("convex", MeshInertia::Convex),
    ("shell", MeshInertia::Shell),
];

impl RawMesh {
    /// Reads what a mesh and its default have in common.
    pub fn read(&mut self, reader: &mut Reader) {
        let mesh = &mut self.mesh;
        reader.list("scale", &mut mesh.scale);
        reader.keyword("inertia", INERTIA, &mut mesh.inertia);
        let mut most = mesh.maxhullvert.map_or(-1, |most| most as i32);
        reader.integer("maxhullvert", &mut most);
        if most != -1 && most < 4 {
            reader.report.error(
                reader.element,
                format!("attribute \"maxhullvert\": {most} is too few"),
                "use -1 or 4 and more",
            );
        }
        mesh.maxhullvert = usize::try_from(most).ok();
    }

    /// Reads an element; the file is not opened.
    fn element(mut self, reader: &mut Reader) -> RawMesh {
        self.read(reader);
        (self.file, self.content_type) = (reader.text("file"), reader.text("content_type"));
        reader.list("refpos", &mut self.mesh.refpos);
        reader.list("refquat", &mut self.mesh.refquat);
        reader.boolean("centered", &mut self.mesh.centered);
        let mut name = reader.text("name");
        if name.is_empty() {
            let last = self.file.rsplit(['/', '\\']).next().unwrap_or_default();
            name = last.rsplit_once('.').map_or(last, |(stem, _)| stem).to_string();
        }
        self.mesh.name = name;
        self.mesh.source = reader.element.source.clone();
        self
    }
}

/// Reads the meshes that geoms have. Geoms that only decorate are dropped, with a note, where their mesh cannot be had.
pub(super) fn meshes(
    tree: &Tree,
    classes: &super::Classes,
    assets: &mut Assets<'_, '_>,
    spec: &mut Spec,
    report: &mut Report,
) {
    let weighs = weighing(spec);
    let paired: BTreeSet<String> = spec.pairs.iter().flat_map(|p| [p.geom1.clone(), p.geom2.clone()]).collect();
    let matters = |body: usize, geom: &crate::spec::Geom| {
        let touches =
            geom.contype != 0 || geom.conaffinity != 0 || (!geom.name.is_empty() && paired.contains(&geom.name));
        touches || (weighs[body] && has_mass(geom, spec.compiler.inertiagrouprange))
    };
    // Of every mesh that is used, whether anything depends on it.
    let mut used: BTreeMap<String, bool> = BTreeMap::new();
    for (b, body) in spec.bodies.iter().enumerate() {
        for geom in body.geoms.iter().filter(|geom| !geom.mesh.is_empty()) {
            *used.entry(geom.mesh.clone()).or_default() |= matters(b, geom);
        }
    }
    let mut lost: BTreeMap<String, String> = BTreeMap::new();
    let mut lines: BTreeMap<String, u32> = BTreeMap::new();
    for index in tree.section("asset").filter(|&index| tree[index].tag == "mesh") {
        let element = &tree[index];
        let class = classes.named(element, "class", super::MAIN, report);
        let raw = classes[class].mesh.clone().element(&mut Reader::new(element, report));
        if !raw.mesh.name.is_empty()
            && let Some(first) = lines.insert(raw.mesh.name.clone(), element.source.line)
        {
            let message = format!("repeated name {}, first used in line {first}", quoted(&raw.mesh.name));
            report.error(element, message, "rename one of them");
            continue;
        }
        let Some(matters) = used.get(&raw.mesh.name).copied() else { continue };
        match triangles(element, &raw, assets, report) {
            Ok(triangles) => spec.meshes.push(Mesh { triangles: Arc::new(triangles), ..raw.mesh }),
            Err((message, remedy)) if matters => report.error(element, message, remedy),
            Err((message, _)) => {
                lost.entry(raw.mesh.name).or_insert(element.source.placed(&format!("{}: {message}", element.label())));
            }
        }
    }
    drop_decorations(&lost, spec, report);
}

/// Drops the geoms of meshes that were not found.
fn drop_decorations(lost: &BTreeMap<String, String>, spec: &mut Spec, report: &mut Report) {
    let mut dropped = 0;
    let known: BTreeSet<&str> = spec.meshes.iter().map(|mesh| mesh.name.as_str()).collect();
    for body in &mut spec.bodies {
        let before = body.geoms.len();
        body.geoms.retain(|geom| !lost.contains_key(&geom.mesh) || known.contains(geom.mesh.as_str()));
        dropped += before - body.geoms.len();
    }
    if dropped > 0 {
        let (geoms, are) = if dropped == 1 { ("geom", "is") } else { ("geoms", "are") };
        let first = lost.values().next().map_or("", String::as_str);
        report.note(format!("{dropped} {geoms} on which no motion depends {are} left out: {first}"));
    }
}

/// Of every body, whether the motion depends on the mass of its geoms.
fn weighing(spec: &Spec) -> Vec<bool> {
    let mut moves = vec![false; spec.bodies.len()];
    let total = spec.compiler.settotalmass > 0.0;
    let weighs = |(b, body): (usize, &crate::spec::Body)| {
        moves[b] = !body.joints.is_empty() || moves[body.parent];
        let counts = match spec.compiler.inertiafromgeom {
            InertiaFromGeom::True => true,
            InertiaFromGeom::Auto => body.inertial.is_none(),
            InertiaFromGeom::False => false,
        };
        counts && (moves[b] || total)
    };
    spec.bodies.iter().enumerate().map(weighs).collect()
}

/// Whether a geom has mass that counts.
fn has_mass(geom: &crate::spec::Geom, [low, high]: [i32; 2]) -> bool {
    use crate::spec::GeomMass::{Density, Mass, Solid};
    let (Mass(mass) | Density(mass) | Solid { mass, .. }) = geom.mass;
    mass != 0.0 && (low..=high).contains(&geom.group)
}

/// Vertices and faces of a mesh; the error is a message and a remedy.
fn triangles(
    element: &Element,
    raw: &RawMesh,
    assets: &mut Assets<'_, '_>,
    report: &mut Report,
) -> Result<Triangles, (String, String)> {
    let written = element.get("vertex").is_some_and(|text| !text.trim().is_empty());
    let kind = element.get("builtin").filter(|kind| *kind != "none");
    let mesh = match (kind, written, raw.file.is_empty()) {
        (Some(_), true, _) | (Some(_), _, false) => {
            return Err(("builtin is given with a file or with vertices".into(), "keep one".into()));
        }
        (Some(kind), ..) => {
            let params = Reader::new(element, report).all("params").unwrap_or_default();
            builtin(kind, &params)?
        }
        (_, true, false) => return Err(("both file and vertex are given".into(), "keep one".into())),
        (_, false, true) => return Err(("neither file nor vertex is given".into(), "name a file".into())),
        (_, true, true) => inline(&mut Reader::new(element, report)),
        (_, false, false) => {
            let format = format(&raw.file, &raw.content_type)?;
            let bytes = assets.mesh(&raw.file, element.source.file.as_deref())?;
            format.read(&bytes).map_err(|message| (format!("file {} {message}", quoted(&raw.file)), String::new()))?
        }
    };
    match mesh.problem() {
        Some(problem) => Err((problem, String::new())),
        None => Ok(mesh),
    }
}

fn format(file: &str, content_type: &str) -> Result<Format, (String, String)> {
    let extension = file.rsplit_once('.').map_or("", |(_, extension)| extension).to_ascii_lowercase();
    let named = if content_type.is_empty() { extension } else { content_type.to_ascii_lowercase() };
    FORMATS.iter().find(|(name, _)| *name == named).map(|(_, format)| *format).ok_or_else(|| {
        let message = format!("file {}: meshes of type {} are not supported", quoted(file), quoted(&named));
        (message, "use OBJ, STL or MSH".to_string())
    })
}

/// Vertices and faces that are written out, in single precision as MuJoCo reads them.
fn inline(reader: &mut Reader) -> Triangles {
    let vertices = reader.all("vertex").unwrap_or_default();
    if !vertices.len().is_multiple_of(3) {
        reader.report.error(
            reader.element,
            "attribute \"vertex\": the count is no multiple of 3",
            "give x y z of each",
        );
    }
    let faces = reader.indices("face");
    if !faces.len().is_multiple_of(3) {
        reader.report.error(
            reader.element,
            "attribute \"face\": the count is no multiple of 3",
            "give three vertices of each",
        );
    }
    let position = |p: &[f64]| DVec3::from_slice(p).as_vec3();
    Triangles {
        vertices: vertices.chunks_exact(3).map(position).map(Vec3::as_dvec3).collect(),
        faces: faces.chunks_exact(3).map(|f| [f[0], f[1], f[2]]).collect(),
    }
}
