//! Sensors: what is refused of them, their tables, and MuJoCo's arrays.

use std::collections::HashMap;
use std::ops::Range;

use glam::DVec3;
use lanesim_kernels::model::{
    Bound, HeightField, Hull, Limit, Mount, NONE, Ray, Sensor, SensorKind, Shape as KernelShape, Side, Span, Surface,
    Target,
};

use super::element::Element;
use super::histories;
use super::links::Links;
use super::meshes::{Hulls, Meshes, Surfaces};
use super::names::label;
use super::order::{self, Scene};
use super::pairs::shape;
use super::pose::{Pose, row_major};
use crate::diagnostics::{Diagnostics, quoted};
use crate::model::ElementNames;
use crate::spec::{
    self, ContactField, DataType, JointKind, NeedStage, Object, ObjectKind, Reduce, Shape, Spec, is_limited,
};

/// Most numbers of all sensors.
const MOST_NUMBERS: usize = 10_000_000;
/// Most pairs of geoms of which distances are measured.
const MOST_SPACES: usize = 1_000_000;

impl ObjectKind {
    /// As messages call it.
    fn word(self) -> &'static str {
        match self {
            ObjectKind::Body | ObjectKind::XBody => "body",
            ObjectKind::Joint => "joint",
            ObjectKind::Geom => "geom",
            ObjectKind::Site => "site",
            ObjectKind::Camera => "camera",
            ObjectKind::Tendon => "tendon",
            ObjectKind::Actuator => "actuator",
        }
    }

    /// MuJoCo's number of it.
    fn number(self) -> i32 {
        match self {
            ObjectKind::Body => 1,
            ObjectKind::XBody => 2,
            ObjectKind::Joint => 3,
            ObjectKind::Geom => 5,
            ObjectKind::Site => 6,
            ObjectKind::Camera => 7,
            ObjectKind::Tendon => 18,
            ObjectKind::Actuator => 19,
        }
    }
}

/// Adds every problem that sensors show.
pub(crate) fn check(spec: &Spec, diagnostics: &mut Diagnostics) {
    if spec.sensors.is_empty() {
        return;
    }
    let bodies = || spec.bodies.iter();
    let joints: HashMap<&str, &spec::Joint> = bodies().flat_map(|b| &b.joints).map(|j| (j.name.as_str(), j)).collect();
    let mut known: HashMap<&str, Vec<&str>> = HashMap::new();
    known.insert("body", bodies().map(|b| b.name.as_str()).collect());
    known.insert("joint", joints.keys().copied().collect());
    known.insert("geom", bodies().flat_map(|b| &b.geoms).map(|g| g.name.as_str()).collect());
    known.insert("site", bodies().flat_map(|b| &b.sites).map(|s| s.name.as_str()).collect());
    let cameras = cameras(spec);
    known.insert("camera", cameras.keys().copied().collect());
    known.insert("tendon", spec.tendons.iter().map(|t| t.name.as_str()).collect());
    known.insert("actuator", spec.actuators.iter().map(|a| a.name.as_str()).collect());
    let owners: HashMap<&str, &str> =
        bodies().flat_map(|b| b.geoms.iter().map(|g| (g.name.as_str(), b.name.as_str()))).collect();
    known.values_mut().for_each(|names| names.sort_unstable());
    let mut numbers = 0_usize;
    for (i, sensor) in spec.sensors.iter().enumerate() {
        let mut element = Element::new(label(sensor.kind.tag(), &sensor.name, i), &sensor.source, diagnostics);
        for (attribute, x) in [("cutoff", sensor.cutoff), ("noise", sensor.noise)] {
            if element.finite(attribute, &[x]) && x < 0.0 {
                element.refuse(format!("{attribute} is negative: {x}"), "give 0 or more");
            }
        }
        histories::check(&sensor.history, &mut element);
        let (width, data, _) = sensor.shape();
        let width = width * forces(spec, sensor);
        let seen = camera(sensor, &cameras);
        let rays = seen.filter(|_| sensor.kind == SensorKind::Rangefinder).map_or(1, pixels);
        let count = width.saturating_mul(rays);
        if let Some(camera) = seen {
            check_camera(sensor, camera, &mut element);
        }
        let cuts = sensor.kind != SensorKind::GeomNormal;
        if cuts && sensor.cutoff > 0.0 && matches!(data, DataType::Axis | DataType::Quaternion) {
            element.refuse("an axis or quaternion cannot be cut off", "remove cutoff");
        }
        let wanted = match data {
            DataType::Axis => 3,
            DataType::Quaternion => 4,
            _ => count,
        };
        if count != wanted {
            element.refuse(format!("dim is {count}"), format!("this datatype has dim {wanted}"));
        }
        numbers = numbers.saturating_add(count);
        check_objects(sensor, &mut element);
        for object in sensor.object.iter().chain(&sensor.reference) {
            let word = object.kind.word();
            if object.name.is_empty() || known[word].binary_search(&object.name.as_str()).is_err() {
                let message = format!("unknown {word} {}", quoted(&object.name));
                element.unknown(message, &object.name, known[word].iter().copied().filter(|name| !name.is_empty()));
            }
        }
        check_sides(sensor, &owners, &mut element);
        let of = |kind: ObjectKind| {
            sensor.object.as_ref().filter(|object| object.kind == kind).map(|object| object.name.as_str())
        };
        if let Some(joint) = of(ObjectKind::Joint).and_then(|name| joints.get(name)) {
            check_joint(sensor, joint, &mut element);
        }
        if let Some(name) = of(ObjectKind::Tendon).filter(|_| sensor.kind.of_limit().is_some())
            && spec.tendons.iter().any(|tendon| tendon.name == name && !is_limited(tendon.range, tendon.limited))
        {
            element.refuse(format!("tendon {} has no limits", quoted(name)), "give it a range, or remove the sensor");
        }
    }
    if numbers > MOST_NUMBERS {
        let message = format!("sensors have {numbers} numbers");
        diagnostics.push(&Default::default(), "sensor", message, format!("use at most {MOST_NUMBERS}"));
    }
}

/// Refuses a sensor that is about nothing, or about another kind of element than it measures.
fn check_objects(sensor: &spec::Sensor, element: &mut Element) {
    use ObjectKind::{Actuator, Body, Camera, Geom, Joint, Site, Tendon, XBody};
    use SensorKind as Kind;
    const FRAMES: &[ObjectKind] = &[Body, XBody, Geom, Site, Camera];
    let (object, reference): (&[ObjectKind], &[ObjectKind]) = match sensor.kind {
        Kind::User => return,
        Kind::EPotential | Kind::EKinetic | Kind::Clock => (&[], &[]),
        Kind::Touch | Kind::Accelerometer | Kind::Velocimeter | Kind::Gyro | Kind::Force | Kind::Torque => {
            (&[Site], &[])
        }
        Kind::Magnetometer => (&[Site], &[]),
        Kind::Rangefinder => (&[Site, Camera], &[]),
        Kind::CamProjection => (&[Site], &[Camera]),
        Kind::JointPos | Kind::JointVel | Kind::JointActuatorFrc | Kind::BallQuat | Kind::BallAngVel => (&[Joint], &[]),
        Kind::JointLimitPos | Kind::JointLimitVel | Kind::JointLimitFrc => (&[Joint], &[]),
        Kind::TendonPos | Kind::TendonVel | Kind::TendonActuatorFrc => (&[Tendon], &[]),
        Kind::TendonLimitPos | Kind::TendonLimitVel | Kind::TendonLimitFrc => (&[Tendon], &[]),
        Kind::ActuatorPos | Kind::ActuatorVel | Kind::ActuatorFrc => (&[Actuator], &[]),
        Kind::SubtreeCom | Kind::SubtreeLinVel | Kind::SubtreeAngMom => (&[Body, XBody], &[]),
        Kind::InsideSite => (FRAMES, &[Site]),
        Kind::GeomDist | Kind::GeomNormal | Kind::GeomFromTo => (&[Geom, Body], &[Geom, Body]),
        Kind::Contact => (&[Geom, Body, XBody, Site], &[Geom, Body, XBody]),
        Kind::FrameLinAcc | Kind::FrameAngAcc => (FRAMES, &[]),
        Kind::FramePos | Kind::FrameQuat | Kind::FrameXAxis | Kind::FrameYAxis | Kind::FrameZAxis => (FRAMES, FRAMES),
        Kind::FrameLinVel | Kind::FrameAngVel => (FRAMES, FRAMES),
    };
    let any = sensor.kind == Kind::Contact;
    let optional = any || reference == FRAMES;
    for (what, given, wanted, optional) in
        [("object", &sensor.object, object, any), ("reference", &sensor.reference, reference, optional)]
    {
        let fits = given.as_ref().map_or(optional || wanted.is_empty(), |given| wanted.contains(&given.kind));
        if !fits {
            let words: Vec<&str> = wanted.iter().map(|kind| kind.word()).collect();
            let remedy =
                if words.is_empty() { "leave it out".into() } else { format!("name one of: {}", words.join(", ")) };
            element.refuse(format!("its {what} is missing or of a kind that it does not measure"), remedy);
        }
    }
}

/// Numbers of forces of the actuator that a sensor is about; 1 of another sensor.
fn forces(spec: &Spec, sensor: &spec::Sensor) -> usize {
    let measures = matches!(sensor.kind, SensorKind::ActuatorPos | SensorKind::ActuatorVel | SensorKind::ActuatorFrc);
    let name = sensor.object.as_ref().filter(|_| measures).map(|object| &object.name);
    let of = |name: &String| spec.actuators.iter().find(|actuator| actuator.name == *name);
    name.and_then(of).map_or(1, spec::Actuator::outputs)
}

/// The cameras that have names.
fn cameras(spec: &Spec) -> HashMap<&str, &spec::Camera> {
    let all = spec.bodies.iter().flat_map(|body| &body.cameras);
    all.filter(|camera| !camera.name.is_empty()).map(|camera| (camera.name.as_str(), camera)).collect()
}

/// The camera that a sensor is about, or from which it is seen.
fn camera<'a>(sensor: &spec::Sensor, cameras: &HashMap<&str, &'a spec::Camera>) -> Option<&'a spec::Camera> {
    let mut objects = sensor.object.iter().chain(&sensor.reference);
    let object = objects.find(|object| object.kind == ObjectKind::Camera)?;
    cameras.get(object.name.as_str()).copied()
}

/// Number of a camera's pixels.
fn pixels(camera: &spec::Camera) -> usize {
    camera.resolution.iter().fold(1, |product, n| product.saturating_mul(*n as usize))
}

/// Refuses a camera that turns by itself, or of which no ray can be told.
fn check_camera(sensor: &spec::Sensor, camera: &spec::Camera, element: &mut Element) {
    let name = quoted(&camera.name);
    if camera.tracking {
        element.refuse(format!("camera {name} tracks something, which is not supported for sensors"), "use mode fixed");
    }
    if !matches!(sensor.kind, SensorKind::Rangefinder | SensorKind::CamProjection) {
        return;
    }
    let [width, height] = camera.sensorsize;
    let lens = [camera.fovy, width, height, camera.focal[0], camera.focal[1], camera.principal[0], camera.principal[1]];
    if pixels(camera) == 0 || lens.iter().any(|x| !x.is_finite()) {
        element
            .refuse(format!("camera {name} has no pixels, or numbers that are none"), "give resolution, fovy or focal");
    } else if width > 0.0 && height > 0.0 {
        if camera.focal.iter().any(|focal| *focal <= 0.0) {
            element.refuse(format!("camera {name} has no focal length"), "give focal or focalpixel");
        }
    } else if camera.fovy <= 0.0 || (!camera.orthographic && camera.fovy >= 180.0) {
        element
            .refuse(format!("fovy of camera {name} is {}", camera.fovy), "give more than 0, and less than 180 degrees");
    }
}

/// Refuses what is at no distance from itself, and what no contact sensor can return.
fn check_sides(sensor: &spec::Sensor, owners: &HashMap<&str, &str>, element: &mut Element) {
    if sensor.kind == SensorKind::Contact {
        let moving = |field: &ContactField| matches!(field, ContactField::LinVel | ContactField::AngVel);
        if sensor.contacts.reduce == Reduce::NetForce && sensor.contacts.fields.iter().any(moving) {
            element.refuse("a net force has no velocity", "remove linvel and angvel, or reduce otherwise");
        }
        let places: Vec<u32> = sensor.contacts.fields.iter().map(|field| *field as u32).collect();
        if sensor.contacts.num == 0 || !places.is_sorted_by(|a, b| a < b) {
            element.refuse("it returns nothing, or something twice", "give num, and each of data once, in their order");
        }
    }
    let [Some(first), Some(second)] = [&sensor.object, &sensor.reference] else { return };
    let owner = |of: &'_ Object| match of.kind {
        ObjectKind::Geom => owners.get(of.name.as_str()).map(|owner| (*owner).to_string()),
        _ => Some(of.name.clone()),
    };
    let shared = if first.kind == second.kind { first.name == second.name } else { owner(first) == owner(second) };
    if sensor.kind.of_space() && shared {
        element.refuse("both sides have the same geom", "name different geoms, or bodies that do not hold them");
    }
}

/// Refuses a joint of another kind than a sensor is made for.
fn check_joint(sensor: &spec::Sensor, joint: &spec::Joint, element: &mut Element) {
    use SensorKind as Kind;
    let name = quoted(&joint.name);
    match sensor.kind {
        Kind::JointPos | Kind::JointVel | Kind::JointActuatorFrc
            if !matches!(joint.kind, JointKind::Slide | JointKind::Hinge) =>
        {
            element
                .refuse(format!("joint {name} is neither a slide nor a hinge"), "use ballquat, framepos or framequat");
        }
        Kind::BallQuat | Kind::BallAngVel if joint.kind != JointKind::Ball => {
            element.refuse(format!("joint {name} is not a ball"), "use jointpos or jointvel");
        }
        Kind::JointLimitPos | Kind::JointLimitVel | Kind::JointLimitFrc
            if joint.kind == JointKind::Free || !is_limited(joint.range, joint.limited) =>
        {
            element.refuse(format!("joint {name} has no limits"), "give it a range, or remove the sensor");
        }
        _ => {}
    }
}

/// The sensors of a model without faults.
#[derive(Default)]
pub(crate) struct Sensors {
    pub table: Vec<Sensor<f64>>,
    /// Frames that they are about, after those on which actuators act.
    pub mounts: Vec<Mount<f64>>,
    pub rays: Vec<Ray<f64>>,
    pub targets: Vec<Target<f64>>,
    /// Meshes among those that rays meet.
    pub surfaces: Vec<Surface>,
    /// Height fields among them, behind those of pairs.
    pub heights: Vec<HeightField>,
    /// Hulls of those whose distances are measured, behind those of pairs.
    pub hulls: Vec<Hull>,
    pub spaces: Vec<[u32; 2]>,
    /// Places of the contact sensor with most.
    pub nkey: usize,
    /// Numbers of all.
    pub ndata: usize,
    /// Of each, the objects that it is about, in MuJoCo's types and numbers; -1: none.
    pub objects: Vec<[(i32, i32); 2]>,
}

/// What sensors are made of.
pub(crate) struct Sources<'a> {
    pub spec: &'a Spec,
    pub scene: &'a Scene<'a>,
    pub links: &'a Links,
    pub names: &'a ElementNames,
    pub limits: &'a [Limit<f64>],
    /// Forces of each actuator.
    pub rows: &'a [Span],
    /// Frames on which actuators act.
    pub mounts: &'a [Mount<f64>],
    pub meshes: &'a Meshes,
    /// Number of hulls of pairs.
    pub nhull: usize,
    /// Number of height fields of pairs.
    pub nheight: usize,
}

impl Sensors {
    /// Their tables.
    pub fn new(s: &Sources, diagnostics: &mut Diagnostics) -> Sensors {
        let mut out = Sensors { mounts: s.mounts.to_vec(), ..Sensors::default() };
        let cameras = cameras(s.spec);
        let spaces = |sensor: &spec::Sensor| {
            let sides = [&sensor.object, &sensor.reference].map(|side| side.as_ref().map(|of| (of, id(s, of))));
            sides.map(|side| geoms(s, side).len()).iter().fold(1_usize, |product, n| product.saturating_mul(*n))
        };
        let measured = s.spec.sensors.iter().filter(|sensor| sensor.kind.of_space()).map(spaces);
        let pairs = measured.fold(0_usize, |sum, pairs| sum.saturating_add(pairs));
        if pairs > MOST_SPACES {
            let message = format!("distances of {pairs} pairs of geoms are measured");
            diagnostics.push(&Default::default(), "sensor", message, format!("measure at most {MOST_SPACES}"));
            return out;
        }
        if s.spec.sensors.iter().any(|sensor| refuse_height_fields(s, sensor, diagnostics)) {
            return out;
        }
        out.add_targets(s);
        for sensor in &s.spec.sensors {
            out.add(s, sensor, camera(sensor, &cameras));
        }
        out.add_hulls(s, diagnostics);
        out
    }

    fn add(&mut self, s: &Sources, sensor: &spec::Sensor, camera: Option<&spec::Camera>) {
        use SensorKind as Kind;
        let (width, data, _) = sensor.shape();
        let width = width * forces(s.spec, sensor);
        let ids =
            [&sensor.object, &sensor.reference].map(|object| object.as_ref().map(|object| (object, id(s, object))));
        self.objects.push(ids.map(|of| of.map_or((0, -1), |(object, id)| (object.kind.number(), id as i32))));
        let items = if sensor.kind.of_space() { self.add_spaces(s, ids) } else { self.add_rays(sensor, camera) };
        let count = if sensor.kind == Kind::Rangefinder { width * items.len as usize } else { width };
        if sensor.kind == Kind::Contact {
            self.nkey = self.nkey.max(sensor.contacts.num);
        }
        let volume =
            ids[usize::from(sensor.kind == Kind::InsideSite)].filter(|(object, _)| object.kind == ObjectKind::Site);
        let site = volume.map(|(_, id)| &s.scene.sites[id]);
        let mut entry = Sensor {
            kind: sensor.kind,
            data: Span { start: self.ndata as u32, len: count as u32 },
            bound: match data {
                _ if sensor.cutoff <= 0.0 && sensor.kind != Kind::GeomDist => Bound::None,
                _ if matches!(sensor.kind, Kind::GeomNormal | Kind::GeomFromTo | Kind::Contact) => Bound::None,
                DataType::Positive => Bound::Above,
                _ => Bound::Both,
            },
            mount: NONE,
            reference: NONE,
            id: NONE,
            bodies: Span::default(),
            items,
            fields: sensor.bits(),
            reduce: sensor.contacts.reduce,
            sides: ids.map(|of| side(s, of)),
            shape: site.map_or(KernelShape::Sphere, |site| shape(site.spec.shape)),
            size: site.map_or([0.0; 3], |site| site.spec.size),
            lens: camera.map_or([0.0; 4], |camera| {
                let ([across, down], [width, height]) = (camera.lens(), camera.resolution.map(f64::from));
                [across, down, 0.5 * width, 0.5 * height]
            }),
            cutoff: sensor.cutoff,
        };
        self.ndata += count;
        if let Some((object, id)) = ids[0] {
            let joint = s.scene.joints.get(id);
            let number = |of: fn(&order::Joint) -> usize| joint.map_or(NONE, |joint| of(joint) as u32);
            match sensor.kind {
                Kind::JointPos | Kind::BallQuat => entry.id = number(|joint| joint.qpos),
                Kind::JointVel | Kind::JointActuatorFrc | Kind::BallAngVel => entry.id = number(|joint| joint.dof),
                Kind::JointLimitPos | Kind::JointLimitVel | Kind::JointLimitFrc => {
                    entry.id = limit(s, |limit| limit.tendon == NONE && limit.joint as usize == id);
                }
                Kind::TendonLimitPos | Kind::TendonLimitVel | Kind::TendonLimitFrc => {
                    entry.id = limit(s, |limit| limit.tendon as usize == id);
                }
                Kind::TendonPos | Kind::TendonVel | Kind::TendonActuatorFrc => entry.id = id as u32,
                Kind::ActuatorPos | Kind::ActuatorVel | Kind::ActuatorFrc => entry.id = s.rows[id].start,
                Kind::SubtreeCom | Kind::SubtreeLinVel | Kind::SubtreeAngMom => entry.bodies = subtree(s.scene, id),
                Kind::User | Kind::GeomDist | Kind::GeomNormal | Kind::GeomFromTo => {}
                Kind::Contact if object.kind != ObjectKind::Site => {}
                _ => {
                    let (body, pose) = frame(s, object.kind, id);
                    entry.mount = self.mount(s, body, &pose);
                    (entry.id, entry.bodies) = (body as u32, subtree(s.scene, body));
                }
            }
        }
        let seen_from = |_: &(&Object, usize)| !sensor.kind.of_space() && sensor.kind != Kind::Contact;
        if let Some((object, id)) = ids[1].filter(seen_from) {
            let (body, pose) = frame(s, object.kind, id);
            entry.reference = self.mount(s, body, &pose);
        }
        self.table.push(entry);
    }

    /// A frame fixed to a body.
    fn mount(&mut self, s: &Sources, body: usize, in_body: &Pose) -> u32 {
        let pose = s.links.body_pose[body].then(in_body);
        let (pos, quat, rot) = (pose.pos.to_array(), pose.wxyz(), row_major(pose.rotation()));
        self.mounts.push(Mount { link: s.links.body_link[body], pos, rot, quat });
        self.mounts.len() as u32 - 1
    }

    /// The rays of a rangefinder: along the z axis of a site, or through the pixels of a camera, row by row.
    fn add_rays(&mut self, sensor: &spec::Sensor, camera: Option<&spec::Camera>) -> Span {
        let start = self.rays.len();
        match camera.filter(|_| sensor.kind == SensorKind::Rangefinder) {
            Some(camera) => {
                let [width, height] = camera.resolution;
                let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
                self.rays.extend(pixels.map(|(column, row)| {
                    let [pos, way] = camera.ray(column, row);
                    let dir = DVec3::from(way).normalize();
                    Ray { pos, dir: dir.to_array(), depth: -dir.z }
                }));
            }
            None if sensor.kind == SensorKind::Rangefinder => {
                self.rays.push(Ray { pos: [0.0; 3], dir: [0.0, 0.0, 1.0], depth: 1.0 });
            }
            None => {}
        }
        Span { start: start as u32, len: (self.rays.len() - start) as u32 }
    }

    /// The geoms of the model, if there are rays or distances.
    fn add_targets(&mut self, s: &Sources) {
        let any = |wanted: fn(SensorKind) -> bool| s.spec.sensors.iter().any(|sensor| wanted(sensor.kind));
        let (rays, spaces) = (any(|kind| kind == SensorKind::Rangefinder), any(SensorKind::of_space));
        if !rays && !spaces {
            return;
        }
        let (mut surfaces, mut fields) = (Surfaces::new(s.meshes), Hulls::new(s.meshes));
        for geom in &s.scene.geoms {
            let mount = self.mount(s, geom.body, &geom.pose);
            let seen = rays && !geom.spec.clear;
            let surface = match geom.spec.shape {
                _ if !seen => NONE,
                Shape::HeightField => s.nheight as u32 + fields.field(geom.spec),
                _ => surfaces.of(geom.spec),
            };
            let (body, size, shape) = (geom.body as u32, geom.spec.size, shape(geom.spec.shape));
            self.targets.push(Target { body, mount, shape, surface, hull: NONE, seen, size });
        }
        (self.surfaces, self.heights) = (surfaces.surfaces, fields.heights);
    }

    /// Hulls of the meshes whose distances are measured.
    fn add_hulls(&mut self, s: &Sources, diagnostics: &mut Diagnostics) {
        let mut hulls = Hulls::new(s.meshes);
        for id in self.spaces.iter().flatten().map(|id| *id as usize) {
            let hull = hulls.of(s.scene.geoms[id].spec, id, diagnostics);
            self.targets[id].hull = if hull == NONE { NONE } else { hull + s.nhull as u32 };
        }
        self.hulls = hulls.hulls;
    }

    /// The pairs of geoms between two sides, but for planes, which have no distance.
    fn add_spaces(&mut self, s: &Sources, sides: [Option<(&Object, usize)>; 2]) -> Span {
        let start = self.spaces.len();
        let geoms = sides.map(|of| geoms(s, of));
        for first in geoms[0].clone() {
            let flat = |id: usize| s.scene.geoms[id].spec.shape == Shape::Plane;
            let others = geoms[1].clone().filter(|second| !(flat(first) && flat(*second)));
            self.spaces.extend(others.map(|second| [first as u32, second as u32]));
        }
        Span { start: start as u32, len: (self.spaces.len() - start) as u32 }
    }
}

/// Whether a sensor measures the distance of a height field.
fn refuse_height_fields(s: &Sources, sensor: &spec::Sensor, diagnostics: &mut Diagnostics) -> bool {
    let of = [&sensor.object, &sensor.reference].map(|side| side.as_ref().map(|of| (of, id(s, of))));
    let among = |geom: usize| sensor.kind.of_space() && of.iter().any(|of| geoms(s, *of).contains(&geom));
    let mut fields = (0..s.scene.geoms.len()).filter(|geom| s.scene.geoms[*geom].spec.shape == Shape::HeightField);
    let Some(geom) = fields.find(|geom| among(*geom)) else { return false };
    let name = quoted(&s.scene.geoms[geom].spec.name);
    let message = format!("distances to height fields are not supported, and geom {name} is one");
    let remedy = "measure to another geom";
    diagnostics.push(&sensor.source, label(sensor.kind.tag(), &sensor.name, 0), message, remedy);
    true
}

/// The geoms between which and others a distance is.
fn geoms(s: &Sources, of: Option<(&Object, usize)>) -> Range<usize> {
    match of {
        Some((object, id)) if object.kind == ObjectKind::Body => s.scene.bodies[id].geoms.clone(),
        Some((_, id)) => id..id + 1,
        None => 0..0,
    }
}

/// The geoms that an object has; all, if there is none, or a site, which says where contacts are.
fn side(s: &Sources, of: Option<(&Object, usize)>) -> Side {
    let all = Span { start: 0, len: s.scene.bodies.len() as u32 };
    match of.map(|(object, id)| (object.kind, id)) {
        Some((ObjectKind::Geom, id)) => Side { geom: id as u32, bodies: all },
        Some((ObjectKind::Body, id)) => Side { geom: NONE, bodies: Span { start: id as u32, len: 1 } },
        Some((ObjectKind::XBody, id)) => Side { geom: NONE, bodies: subtree(s.scene, id) },
        _ => Side { geom: NONE, bodies: all },
    }
}

/// Number of a limit; [`NONE`]: none is in force.
fn limit(s: &Sources, of: impl Fn(&Limit<f64>) -> bool) -> u32 {
    s.limits.iter().position(of).map_or(NONE, |limit| limit as u32)
}

/// Number of an object among those of its kind.
fn id(s: &Sources, object: &Object) -> usize {
    let names = match object.kind {
        ObjectKind::Body | ObjectKind::XBody => &s.names.bodies,
        ObjectKind::Joint => &s.names.joints,
        ObjectKind::Geom => &s.names.geoms,
        ObjectKind::Site => &s.names.sites,
        ObjectKind::Camera => &s.names.cameras,
        ObjectKind::Tendon => &s.names.tendons,
        ObjectKind::Actuator => &s.names.actuators,
    };
    // Checked before.
    names.id(&object.name).unwrap_or_default()
}

/// The body that has a frame, and the frame's pose in it.
fn frame(s: &Sources, kind: ObjectKind, id: usize) -> (usize, Pose) {
    match kind {
        ObjectKind::Body => (id, s.scene.bodies[id].mass.frame),
        ObjectKind::Geom => (s.scene.geoms[id].body, s.scene.geoms[id].pose),
        ObjectKind::Site => (s.scene.sites[id].body, s.scene.sites[id].pose),
        ObjectKind::Camera => (s.scene.cameras[id].body, s.scene.cameras[id].pose),
        _ => (id, Pose::IDENTITY),
    }
}

/// A body and all that it carries: bodies come depth first.
fn subtree(scene: &Scene, body: usize) -> Span {
    let carried = scene.bodies[body + 1..].iter().take_while(|other| body == 0 || other.parent >= body).count();
    Span { start: body as u32, len: carried as u32 + 1 }
}

/// MuJoCo's number of a data type.
pub(super) fn data_type(sensor: &spec::Sensor) -> i32 {
    match sensor.shape().1 {
        DataType::Real => 0,
        DataType::Positive => 1,
        DataType::Axis => 2,
        DataType::Quaternion => 3,
    }
}

/// MuJoCo's number of the stage by which a sensor is known.
pub(super) fn need_stage(sensor: &spec::Sensor) -> i32 {
    match sensor.shape().2 {
        NeedStage::Pos => 1,
        NeedStage::Vel => 2,
        NeedStage::Acc => 3,
    }
}
