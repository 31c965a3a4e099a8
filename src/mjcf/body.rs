//! The body tree: bodies, frames, and what they hold.

use std::collections::{BTreeMap, HashMap};

use super::defaults::{Classes, MAIN};
use super::geom::{Held, RawGeom};
use super::joint;
use super::orientation::{Angles, Orientation, Pose, mul, rotate};
use super::reader::Reader;
use super::reference::{Entry, References};
use super::replicate::Replica;
use super::report::Report;
use super::tree::{Element, Tree};
use crate::spec::{
    Body, Compiler, Equality, Exclude, HeightField, Inertia, Inertial, JointKind, Key, Mesh, Pair, Sensor, SleepPolicy,
    Spec, Tendon,
};

/// Words of `body/fuse`.
const FUSE: &[(&str, bool)] = &[("auto", true), ("false", false)];
/// Words of `body/sleep`.
const SLEEP: &[(&str, SleepPolicy)] = &[
    ("auto", SleepPolicy::Auto),
    ("never", SleepPolicy::Never),
    ("allowed", SleepPolicy::Allowed),
    ("init", SleepPolicy::Init),
];
/// Most elements of a model once replicas are made.
const MOST_ELEMENTS: usize = 1_000_000;

/// What surrounds an element.
#[derive(Clone, Copy, Debug)]
struct Scope {
    /// Index of the body that holds it.
    body: usize,
    /// Pose of the frames around it, in that body or in the replica.
    frame: Pose,
    /// Class of elements that name none.
    class: usize,
    /// Whether a `replicate` stands between it and its body.
    replicated: bool,
    /// Whether that body has an `inertial`, and whether it can move.
    held: Held,
}

/// What is still to be done.
enum Task {
    Visit(usize, Scope),
    Replicate(Replica),
}

/// Builds the body tree, and replicates what refers to it.
pub(super) struct Builder<'a> {
    pub tree: &'a Tree,
    pub classes: &'a Classes,
    pub angles: &'a Angles,
    pub report: &'a mut Report,
    pub bodies: Vec<Body>,
    pub pairs: References<Pair>,
    pub excludes: References<Exclude>,
    pub tendons: References<Tendon>,
    pub equalities: References<Equality>,
    pub actuators: References<Entry>,
    pub sensors: References<Sensor>,
    pub compiler: &'a Compiler,
    /// What is to be attached, by the index of its element.
    pub parts: HashMap<usize, Spec>,
    /// Meshes and keyframes of what was.
    pub meshes: Vec<Mesh>,
    pub hfields: Vec<HeightField>,
    pub keys: Vec<Key>,
    /// Geoms that are left out though nothing says lenient, by why: how many, and the first.
    pub decorations: BTreeMap<&'static str, (usize, String)>,
    /// Names of geoms that were left out.
    pub lost_geoms: Vec<String>,
    /// Whether something was left out that has coordinates of its own.
    pub lost_coordinates: bool,
    pub lights: usize,
    pub elements: usize,
}

impl Builder<'_> {
    /// Walks all `worldbody` sections in the order of the file, without recursion.
    pub fn build(&mut self) {
        let tree = self.tree;
        let world = Scope { body: 0, frame: Pose::IDENTITY, class: MAIN, replicated: false, held: Held::default() };
        let sections = tree[0].children.iter().copied().filter(|&s| matches!(&*tree[s].tag, "worldbody" | "world"));
        let mut tasks = Vec::new();
        for section in sections {
            if tree[section].tag == "world" {
                self.report.note("world is an old name of worldbody");
            }
            visit_children(tree, section, world, &mut tasks);
            while let Some(task) = tasks.pop() {
                match task {
                    Task::Visit(index, scope) => self.visit(index, scope, &mut tasks),
                    Task::Replicate(replica) => replica.expand(self),
                }
                if self.elements > MOST_ELEMENTS {
                    return;
                }
            }
        }
    }

    /// Counts elements to come; false, with a problem reported, if they are too many.
    pub fn reserve(&mut self, element: &Element, count: usize) -> bool {
        let before = self.elements;
        self.elements = before.saturating_add(count);
        if self.elements > MOST_ELEMENTS && before <= MOST_ELEMENTS {
            let message = format!("the model has more than {MOST_ELEMENTS} elements");
            self.report.error(element, message, "replicate less");
        }
        self.elements <= MOST_ELEMENTS
    }

    fn visit(&mut self, index: usize, scope: Scope, tasks: &mut Vec<Task>) {
        let tree = self.tree;
        let element = &tree[index];
        match element.tag.as_str() {
            "body" => self.body(index, scope, tasks),
            "frame" => {
                let frame = scope.frame.then(&self.pose(element));
                let class = self.classes.named(element, "childclass", scope.class, self.report);
                visit_children(tree, index, Scope { frame, class, ..scope }, tasks);
            }
            "replicate" => {
                let class = self.classes.named(element, "childclass", scope.class, self.report);
                tasks.push(Task::Replicate(Replica::start(self, index, scope.body, scope.frame)));
                let inner = Scope { frame: Pose::IDENTITY, class, replicated: true, ..scope };
                visit_children(tree, index, inner, tasks);
            }
            "joint" | "freejoint" => self.joint(element, scope),
            "inertial" => self.inertial(element, scope),
            "geom" => self.geom(index, scope),
            "site" => self.site(element, scope),
            "camera" => self.camera(element, scope),
            "light" => self.lights += 1,
            "plugin" => self.report.unsupported(element, "plugins are"),
            "attach" => self.attach(index, scope),
            tag @ ("composite" | "flexcomp") => {
                self.report.unsupported(element, &format!("{tag} is"));
                self.lost_coordinates = true;
            }
            // Unknown elements were reported by the check against the schema.
            _ => {}
        }
    }

    fn body(&mut self, index: usize, scope: Scope, tasks: &mut Vec<Task>) {
        let element = &self.tree[index];
        if !self.reserve(element, 1) {
            return;
        }
        let pose = scope.frame.then(&self.pose(element));
        let class = self.classes.named(element, "childclass", scope.class, self.report);
        let mut reader = Reader::new(element, self.report);
        let mut body = Body {
            name: reader.text("name"),
            parent: scope.body,
            pos: pose.pos,
            quat: pose.quat,
            source: element.source.clone(),
            ..Body::default()
        };
        reader.boolean("mocap", &mut body.mocap);
        reader.real("gravcomp", &mut body.gravcomp);
        reader.keyword("fuse", FUSE, &mut body.fuse);
        reader.keyword("sleep", SLEEP, &mut body.sleep);
        self.bodies.push(body);
        let held = Held::of(self.tree, index, scope.held);
        let inner = Scope { body: self.bodies.len() - 1, frame: Pose::IDENTITY, class, replicated: false, held };
        visit_children(self.tree, index, inner, tasks);
    }

    /// Puts a part of another model here.
    fn attach(&mut self, index: usize, scope: Scope) {
        let element = &self.tree[index];
        let Some(mut part) = self.parts.remove(&index) else {
            // Why is reported.
            self.lost_coordinates = true;
            return;
        };
        let count = part
            .bodies
            .iter()
            .map(|body| 1 + body.joints.len() + body.geoms.len() + body.sites.len() + body.cameras.len());
        let count = count.sum();
        if !self.reserve(element, count) {
            return;
        }
        self.report.adopt(&mut part);
        let (shift, mut bodies) = (self.bodies.len() - 1, part.bodies.into_iter());
        if let Some(mut content) = bodies.next() {
            content.geoms.iter_mut().for_each(|geom| place(scope.frame, &mut geom.pos, &mut geom.quat));
            content.sites.iter_mut().for_each(|site| place(scope.frame, &mut site.pos, &mut site.quat));
            content.cameras.iter_mut().for_each(|camera| place(scope.frame, &mut camera.pos, &mut camera.quat));
            let holder = &mut self.bodies[scope.body];
            holder.geoms.append(&mut content.geoms);
            holder.sites.append(&mut content.sites);
            holder.cameras.append(&mut content.cameras);
        }
        for mut body in bodies {
            if body.parent == 0 {
                place(scope.frame, &mut body.pos, &mut body.quat);
                body.parent = scope.body;
            } else {
                body.parent += shift;
            }
            self.bodies.push(body);
        }
        part.pairs.into_iter().for_each(|pair| self.pairs.push(pair));
        part.excludes.into_iter().for_each(|exclude| self.excludes.push(exclude));
        part.tendons.into_iter().for_each(|tendon| self.tendons.push(tendon));
        part.equalities.into_iter().for_each(|equality| self.equalities.push(equality));
        part.actuators.into_iter().for_each(|actuator| self.actuators.push(Entry { actuator, kept: true }));
        part.sensors.into_iter().for_each(|sensor| self.sensors.push(sensor));
        self.meshes.append(&mut part.meshes);
        self.hfields.append(&mut part.hfields);
        for mut key in part.keys {
            key.parts.iter_mut().for_each(|part| part.body += shift);
            self.keys.push(key);
        }
    }

    /// Position and orientation of an element; what is wrong is reported.
    pub fn pose(&mut self, element: &Element) -> Pose {
        let mut reader = Reader::new(element, self.report);
        let (mut pos, mut orientation) = ([0.0; 3], Orientation::IDENTITY);
        reader.list("pos", &mut pos);
        reader.orientation(&mut orientation);
        let quat = self.quat(element, orientation);
        Pose { pos, quat }
    }

    /// The quaternion of an orientation; what is wrong is reported.
    pub fn quat(&mut self, element: &Element, orientation: Orientation) -> [f64; 4] {
        orientation.quat(self.angles).unwrap_or_else(|message| {
            self.report.error(element, message, "");
            Pose::IDENTITY.quat
        })
    }

    /// Whether the body of a scope may have a joint or an inertia of its own there; reported if not.
    fn movable(&mut self, element: &Element, scope: Scope) -> bool {
        if scope.body == 0 {
            self.report.error(element, format!("the world cannot have a {}", element.tag), "put it in a body");
        } else if scope.replicated {
            let message = format!("{} cannot be replicated within one body", element.tag);
            self.report.error(element, message, "replicate a body that holds it");
        }
        scope.body != 0 && !scope.replicated
    }

    fn joint(&mut self, element: &Element, scope: Scope) {
        if !self.movable(element, scope) || !self.reserve(element, 1) {
            return;
        }
        let class = self.classes.named(element, "class", scope.class, self.report);
        let mut reader = Reader::new(element, self.report);
        let mut joint = if element.tag == "freejoint" {
            joint::free(&mut reader)
        } else {
            let mut joint = self.classes[class].joint.clone();
            joint::read(&mut reader, &mut joint);
            joint
        };
        joint.name = reader.text("name");
        joint.source = element.source.clone();
        joint::finish(&mut joint, self.angles);
        if joint.kind != JointKind::Free {
            joint.pos = scope.frame.then(&Pose { pos: joint.pos, ..Pose::IDENTITY }).pos;
        }
        if matches!(joint.kind, JointKind::Hinge | JointKind::Slide) {
            joint.axis = rotate(scope.frame.quat, joint.axis);
        }
        self.bodies[scope.body].joints.push(joint);
    }

    fn inertial(&mut self, element: &Element, scope: Scope) {
        if !self.movable(element, scope) {
            return;
        }
        let mut reader = Reader::new(element, self.report);
        let (mut mass, mut diagonal, mut full) = (0.0, [0.0; 3], [0.0; 6]);
        let complete = reader.required("pos") & reader.required("mass");
        reader.real("mass", &mut mass);
        let has_diagonal = reader.list("diaginertia", &mut diagonal);
        let has_full = reader.list("fullinertia", &mut full);
        let oriented = super::schema::ORIENTATIONS.split_ascii_whitespace().any(|name| reader.has(name));
        if has_full && (has_diagonal || oriented) {
            let message = "fullinertia does not go with diaginertia or an orientation";
            return self.report.error(element, message, "keep one");
        }
        let pose = scope.frame.then(&self.pose(element));
        if complete {
            let inertia = if has_full { Inertia::Full(turn(pose.quat, full)) } else { Inertia::Diagonal(diagonal) };
            let source = element.source.clone();
            self.bodies[scope.body].inertial = Some(Inertial { pos: pose.pos, quat: pose.quat, mass, inertia, source });
        }
    }

    fn geom(&mut self, index: usize, scope: Scope) {
        let element = &self.tree[index];
        if !self.reserve(element, 1) {
            return;
        }
        for plugin in self.tree.children(index).filter(|child| child.tag == "plugin") {
            self.report.unsupported(plugin, "plugins are");
        }
        let class = self.classes.named(element, "class", scope.class, self.report);
        let mut raw = self.classes[class].geom.clone();
        raw.read(&mut Reader::new(element, self.report));
        let name = element.get("name").unwrap_or_default().to_string();
        if let Some(what) = raw.missing() {
            self.leave_out(element, &raw, what, scope);
            self.lost_geoms.push(name);
        } else if let Some(mut geom) = raw.finish(element, self.angles, self.report) {
            geom.name = name;
            place(scope.frame, &mut geom.pos, &mut geom.quat);
            self.bodies[scope.body].geoms.push(geom);
        } else {
            self.lost_geoms.push(name);
        }
    }

    /// Leaves out a geom whose shape is not built: with a note if nothing depends on it, else as a loss or problem.
    fn leave_out(&mut self, element: &Element, raw: &RawGeom, what: &'static str, scope: Scope) {
        let named = element.get("name").is_some_and(|name| self.pairs.mention(name));
        let (touches, weighs) = (raw.touches() || named, raw.weighs(self.compiler, scope.held));
        if !touches && !weighs {
            let place = || super::report::placed(&element.source, &element.label(), "the first");
            self.decorations.entry(what).or_insert_with(|| (0, place())).0 += 1;
            return;
        }
        let with = match (touches, weighs) {
            (true, true) => "with its contacts and its mass",
            (true, false) => "with its contacts",
            _ => "with its mass",
        };
        self.report.unsupported_with(element, what, with);
        if weighs {
            let name = || element.source.placed(&element.label());
            self.bodies[scope.body].lost_mass.get_or_insert_with(name);
        }
    }

    fn site(&mut self, element: &Element, scope: Scope) {
        if !self.reserve(element, 1) {
            return;
        }
        let class = self.classes.named(element, "class", scope.class, self.report);
        let mut raw = self.classes[class].site.clone();
        raw.read(&mut Reader::new(element, self.report));
        if let Some(mut site) = raw.finish(element, self.angles, self.report) {
            site.name = element.get("name").unwrap_or_default().to_string();
            place(scope.frame, &mut site.pos, &mut site.quat);
            self.bodies[scope.body].sites.push(site);
        }
    }

    fn camera(&mut self, element: &Element, scope: Scope) {
        if !self.reserve(element, 1) {
            return;
        }
        let class = self.classes.named(element, "class", scope.class, self.report);
        let mut raw = self.classes[class].camera.clone();
        raw.read(&mut Reader::new(element, self.report));
        if let Some(mut camera) = raw.finish(element, self.angles, self.report) {
            place(scope.frame, &mut camera.pos, &mut camera.quat);
            self.bodies[scope.body].cameras.push(camera);
        }
    }
}

/// Puts the children of an element on the stack, so that the first comes first.
fn visit_children(tree: &Tree, index: usize, scope: Scope, tasks: &mut Vec<Task>) {
    tasks.extend(tree[index].children.iter().rev().map(|&child| Task::Visit(child, scope)));
}

/// Moves a pose from a frame to what is around it.
pub(super) fn place(frame: Pose, pos: &mut [f64; 3], quat: &mut [f64; 4]) {
    let pose = frame.then(&Pose { pos: *pos, quat: *quat });
    (*pos, *quat) = (pose.pos, pose.quat);
}

/// An inertia (xx, yy, zz, xy, xz, yz) seen from outside a frame.
fn turn(quat: [f64; 4], [xx, yy, zz, xy, xz, yz]: [f64; 6]) -> [f64; 6] {
    if quat == Pose::IDENTITY.quat {
        return [xx, yy, zz, xy, xz, yz];
    }
    let inertia = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let inverse = [quat[0], -quat[1], -quat[2], -quat[3]];
    let unit = mul(inverse, quat)[0];
    // Column i of R I Rᵀ: what the inertia makes of axis i.
    let column = |i: usize| {
        let mut axis = [0.0; 3];
        axis[i] = 1.0 / unit;
        let inside = rotate(inverse, axis);
        let product = inertia.map(|row| row[0] * inside[0] + row[1] * inside[1] + row[2] * inside[2]);
        rotate(quat, product)
    };
    let [x, y, z] = [column(0), column(1), column(2)];
    [x[0], y[1], z[2], y[0], z[0], z[1]]
}
